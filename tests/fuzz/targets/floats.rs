//! Fuzz target: all samplers on maps of arbitrary numbers, and a front end of an arbitrary calibration; what leaves the core is finite and
//! not negative.

#![no_main]

use hemilux::samplers::{Shape, make};
use hemilux_core::color::sound;
use hemilux_core::format::Layout;
use hemilux_core::glam::{DVec2, Vec3};
use hemilux_core::lens::{Intrinsics, Model};
use hemilux_core::polar::{Grid, LatLong, PolarTable, Share, shares_len};
use hemilux_core::pyramid::{Pyramid, Quad, pyramid_len};
use hemilux_core::{
    Calibration, Decomposition, Domain, Exposure, Format, FrontEnd, Lens, Levels, Map, Order, Request,
    SamplerKind, Samples, Sizes, harmonics, tonemap,
};
use libfuzzer_sys::fuzz_target;

/// A source of numbers from bytes; 0 after the last byte.
struct Numbers<'a>(&'a [u8]);

impl Numbers<'_> {
    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        let (now, later) = self.0.split_at(N.min(self.0.len()));
        self.0 = later;
        std::array::from_fn(|i| now.get(i).copied().unwrap_or(0))
    }

    fn byte(&mut self) -> u8 {
        self.bytes::<1>()[0]
    }

    fn below(&mut self, most: u8) -> usize {
        usize::from(self.byte() % most)
    }

    fn single(&mut self) -> f32 {
        f32::from_le_bytes(self.bytes())
    }

    fn double(&mut self) -> f64 {
        f64::from_le_bytes(self.bytes())
    }

    fn singles<const N: usize>(&mut self) -> [f32; N] {
        [(); N].map(|()| self.single())
    }
}

fn check(set: &Decomposition<'_>, what: &str) {
    for light in set.lights {
        assert!(light.irradiance.iter().all(|v| v.is_finite() && *v >= 0.0), "{what}: {light:?}");
        assert!((light.direction.length() - 1.0).abs() < 1e-4, "{what}: {light:?}");
        assert!((0.0..=180.0).contains(&light.radius_deg), "{what}: {light:?}");
    }
    for direction in [Vec3::X, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z] {
        let radiance = set.ambient.as_ref().map_or([0.0; 3], |sh| harmonics::radiance(sh, direction));
        assert!(radiance.iter().all(|v| v.is_finite()), "{what}: ambient {radiance:?}");
    }
}

/// Returns a pyramid in which one of every 1 to 16 texels is arbitrary and the others are dark.
fn pyramid(numbers: &mut Numbers<'_>, domain: Domain, order: Order) -> Pyramid<Vec<Quad>> {
    let mut map =
        Pyramid::try_new(vec![Quad::default(); pyramid_len(domain, order)], domain, order).expect("room");
    let stride = 1 + numbers.below(16);
    for texels in map.texels_mut().chunks_mut(stride) {
        let quad = match numbers.byte() % 3 {
            0 => Quad { energy: numbers.singles(), moment: numbers.singles() },
            _ => Quad::from_light(numbers.singles(), Vec3::from_array(numbers.singles())),
        };
        texels[0] = quad;
    }
    map.build();
    map
}

fn sample(numbers: &mut Numbers<'_>) {
    let domain = [Domain::Sphere, Domain::Hemisphere][numbers.below(2)];
    let order = Order::saturating(numbers.below(4) as u8);
    let shape = Shape { domain, order: order.get(), grid: Grid { width: 16, height: 8, domain } };
    let kind = SamplerKind::ALL[numbers.below(SamplerKind::ALL.len() as u8)];
    let lights = kind.least_lights(domain) + numbers.below(48);
    let Ok(mut sampler) = make(kind, &shape, lights) else { return };
    let mut shares = vec![Share::default(); shares_len(&shape.grid, order)];
    let table = PolarTable::try_new(&shape.grid, order, &mut shares[..]).expect("room");
    // Some samplers keep state of the frames before.
    for frame in 0..3 {
        let tolerance = (numbers.below(3) == 0).then(|| numbers.single());
        let (ambient, soft) = (numbers.below(2) == 1, numbers.below(2) == 1);
        let request = Request { lights, tolerance, ambient, soft };
        let pyramid = pyramid(numbers, domain, order);
        let mut polar = LatLong::try_new(shape.grid, vec![[0.0; 3]; shape.grid.len()]).expect("room");
        if numbers.below(2) == 0 {
            polar.fill(&table, &pyramid.view());
        } else {
            polar.texels_mut().iter_mut().for_each(|texel| *texel = sound(numbers.singles()));
        }
        let map = Map { pyramid: pyramid.view(), polar: polar.view() };
        check(&sampler.update(&map, &request), &format!("{kind}, {lights} lights, frame {frame}"));
    }
}

/// Processes one burst of arbitrary bytes with a camera of arbitrary numbers.
fn front(numbers: &mut Numbers<'_>) -> Option<()> {
    let models = [
        Model::Equidistant,
        Model::Equisolid,
        Model::KannalaBrandt([(); 4].map(|()| numbers.double() % 1.0)),
    ];
    let lens = Lens::try_new(Intrinsics {
        model: models[numbers.below(3)],
        centre_px: DVec2::new(numbers.double() % 64.0, numbers.double() % 64.0),
        focal_px: DVec2::new(numbers.double() % 64.0, numbers.double() % 64.0).abs(),
        skew_px: numbers.double() % 2.0,
        max_theta: (numbers.double() % 3.0).abs(),
        vignetting: std::array::from_fn(|i| if i == 0 { 1.0 } else { numbers.double() % 0.1 }),
    });
    let mut calibration = Calibration::new(lens.ok()?, Layout::tight(Format::Rgb24, 32, 24).ok()?);
    calibration.scale = numbers.double();
    calibration.white_balance = numbers.singles();
    calibration.levels = Levels { black: numbers.double(), white: numbers.double() };
    let seconds = [numbers.double(), numbers.double()];
    let exposures = seconds.map(|seconds| Exposure { seconds, gain: 1.0 });
    let order = Order::saturating(numbers.below(4) as u8);
    let sizes = Sizes::of(&calibration, &exposures, order).ok()?;
    let mut front = FrontEnd::try_new(calibration, &exposures, order, vec![0u64; sizes.words()]).ok()?;
    let frames = [(); 2].map(|()| (0..32 * 24 * 3).map(|_| numbers.byte()).collect::<Vec<_>>());
    let seen = front.process(&[Samples::U8(&frames[0]), Samples::U8(&frames[1])]).ok()?;
    let shares = [seen.clipped, seen.unseen, seen.below, seen.exposures_read];
    assert!(shares.iter().all(|v| v.is_finite() && *v >= 0.0), "{seen:?}");
    assert!(seen.clipped_irradiance.iter().all(|v| v.is_finite() && *v >= 0.0), "{seen:?}");
    let flux = front.map().total().rgb().into_iter().chain(front.map().horizontal_irradiance());
    assert!(flux.into_iter().all(|v| v.is_finite() && v >= 0.0), "the flux of the map");
    let shape = Shape { domain: Domain::Hemisphere, order: order.get(), grid: Grid::POLAR };
    let mut sampler = make(SamplerKind::Adaptive, &shape, 16).ok()?;
    check(&front.decompose(sampler.as_mut(), 16), "front end");
    Some(())
}

fuzz_target!(|bytes: &[u8]| {
    let mut numbers = Numbers(bytes);
    if numbers.byte() % 4 == 0 {
        let _ = front(&mut numbers);
    } else {
        sample(&mut numbers);
    }
    let _ = tonemap::sigmoid(numbers.singles(), numbers.single());
});
