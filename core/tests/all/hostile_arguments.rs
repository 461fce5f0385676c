//! No public function panics for any argument: seeded random numbers over the range of each type, often boundary values.
//!
//! The tests are built with overflow checks, so that an arithmetic overflow is a panic.

use crate::common::{Pcg64Mcg, RngExt, seeded};
use glam::{DVec2, DVec3, Vec3};
use hemilux_core::format::{Matrix, Pattern, Yuv};
use hemilux_core::healpix::FaceCell;
use hemilux_core::lens::{Intrinsics, Model};
use hemilux_core::light::cap_radius_deg;
use hemilux_core::polar::{Grid, LatLong, PolarTable, Share, shares_len};
use hemilux_core::pyramid::{Pyramid, Quad, pyramid_len};
use hemilux_core::{
    BadOrder, Calibration, Domain, Exposure, Extrapolation, Format, FrontEnd, FrontError, Layout, Lens,
    Levels, Order, Response, Samples, Sizes, color, harmonics, healpix, tonemap,
};
use std::hint::black_box;

fn double(rng: &mut Pcg64Mcg) -> f64 {
    const HARD: [f64; 12] = [
        0.0,
        -0.0,
        1.0,
        -1.0,
        f64::NAN,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::MAX,
        f64::MIN,
        f64::MIN_POSITIVE,
        5e-324,
        1e20,
    ];
    match rng.random_range(0..4) {
        0 => HARD[rng.random_range(0..HARD.len())],
        1 => f64::from_bits(rng.random()),
        2 => rng.random(),
        _ => rng.random_range(-400.0..400.0),
    }
}

fn single(rng: &mut Pcg64Mcg) -> f32 {
    if rng.random() { f32::from_bits(rng.random()) } else { double(rng) as f32 }
}

fn whole(rng: &mut Pcg64Mcg) -> u32 {
    match rng.random_range(0..3) {
        0 => [0, 1, 2, u32::MAX, u32::MAX - 1, 1 << 26, 1 << 31][rng.random_range(0..7)],
        1 => rng.random(),
        _ => rng.random_range(0..64),
    }
}

fn size(rng: &mut Pcg64Mcg) -> usize {
    if rng.random_range(0..8) == 0 { usize::MAX - rng.random_range(0..2usize) } else { whole(rng) as usize }
}

fn domain(rng: &mut Pcg64Mcg) -> Domain {
    if rng.random() { Domain::Sphere } else { Domain::Hemisphere }
}

#[test]
fn orders_above_the_highest_are_refused_or_lowered() {
    for order in 0..=u8::MAX {
        let expected = if order <= 13 { Ok(order) } else { Err(BadOrder { found: order }) };
        assert_eq!(Order::try_new(order).map(Order::get), expected);
        assert_eq!(Order::saturating(order).get(), order.min(13));
    }
    assert_eq!(pyramid_len(Domain::Sphere, Order::MAX), (4usize.pow(14) - 1) / 3 * 12);
}

#[test]
fn healpix_is_total() {
    let mut rng = seeded(1);
    for _ in 0..100_000 {
        let (order, ipix) = (rng.random::<u8>(), whole(&mut rng));
        let d = DVec3::new(double(&mut rng), double(&mut rng), double(&mut rng));
        let domain = domain(&mut rng);
        let place = healpix::split(order, ipix);
        assert!(healpix::solid_angle(order) > 0.0 && domain.quads(order) >= domain.faces());
        assert!((0.0..=1.0).contains(&domain.share(order, ipix)));
        let (x, y) = (double(&mut rng), double(&mut rng));
        let cell = FaceCell { face: whole(&mut rng), x: whole(&mut rng), y: whole(&mut rng) };
        black_box((place, healpix::join(order, cell)));
        black_box((healpix::ipix(order, d), healpix::point(order, ipix, x, y), healpix::centre(order, ipix)));
    }
}

#[test]
fn grids_of_any_size_are_total() {
    let mut rng = seeded(2);
    for _ in 0..20_000 {
        let grid = Grid { width: size(&mut rng), height: size(&mut rng), domain: domain(&mut rng) };
        let d = DVec3::new(double(&mut rng), double(&mut rng), double(&mut rng));
        let (row, column) = (size(&mut rng), size(&mut rng));
        black_box((grid.theta(row), grid.phi(column), grid.solid_angle(row), grid.is_empty()));
        black_box(grid.centre(row));
        assert!(grid.texel(d).is_none_or(|texel| texel < grid.len()), "{grid:?} {d}");
        let map = LatLong::try_new(grid, [[0.0; 3]; 32]);
        assert_eq!(map.is_ok(), grid.len() <= 32, "{grid:?}");
    }
}

#[test]
fn polar_tables_of_any_grid_and_pyramid_are_total() {
    let mut rng = seeded(3);
    for _ in 0..200 {
        let grid = Grid { width: size(&mut rng), height: size(&mut rng), domain: domain(&mut rng) };
        let order = Order::saturating(rng.random_range(0..3));
        let mut shares = vec![Share::default(); shares_len(&grid, order)];
        let table =
            PolarTable::try_new(&grid, order, &mut shares[..]).expect("shares of the computed length");
        let mut map = LatLong::try_new(Grid { width: 4, height: 3, domain: Domain::Sphere }, [[0.0; 3]; 12])
            .expect("room");
        let finest = Order::saturating(rng.random_range(0..3));
        let domain = domain(&mut rng);
        let pyramid = Pyramid::try_new(vec![Quad::default(); pyramid_len(domain, finest)], domain, finest);
        map.fill(&table, &pyramid.expect("room").view());
    }
}

#[test]
fn pyramids_are_total() {
    let mut rng = seeded(4);
    for _ in 0..2_000 {
        let (domain, order) = (domain(&mut rng), rng.random_range(0..4));
        let len = pyramid_len(domain, Order::saturating(order));
        let mut map =
            Pyramid::try_new(vec![Quad::default(); len], domain, Order::saturating(order)).expect("room");
        for quad in map.texels_mut() {
            let light = [(); 3].map(|()| single(&mut rng));
            *quad = Quad::from_light(light, Vec3::new(single(&mut rng), single(&mut rng), single(&mut rng)));
        }
        map.build();
        let view = map.view();
        let (order, ipix) = (rng.random::<u8>(), whole(&mut rng));
        let quad = view.quad(order, ipix);
        black_box((view.quads_of(order).len(), view.radiance(order, ipix), view.horizontal_irradiance()));
        black_box((quad.mean_direction(), quad.variance(), view.total()));
        assert!(view.total().energy.iter().all(|v| v.is_finite()));
    }
}

fn pattern(rng: &mut Pcg64Mcg) -> Pattern {
    [Pattern::Rggb, Pattern::Grbg, Pattern::Gbrg, Pattern::Bggr][rng.random_range(0..4)]
}

fn format(rng: &mut Pcg64Mcg) -> Format {
    let yuv = Yuv { limited: rng.random(), matrix: if rng.random() { Matrix::Bt601 } else { Matrix::Bt709 } };
    match rng.random_range(0..10) {
        0 => Format::Rgb24,
        1 => Format::Bgr24,
        2 => Format::Rgb48,
        3 => Format::Grey,
        4 => Format::Yuyv(yuv),
        5 => Format::Nv12(yuv),
        6 => Format::Bayer8(pattern(rng)),
        7 => Format::Raw10(pattern(rng)),
        8 => Format::Raw12(pattern(rng)),
        _ => Format::Bayer16(pattern(rng), rng.random()),
    }
}

#[test]
fn layouts_are_total() {
    let mut rng = seeded(5);
    for _ in 0..100_000 {
        let (format, width, height) = (format(&mut rng), whole(&mut rng), whole(&mut rng));
        black_box((
            format.line_bytes(width),
            format.max_code(),
            Format::from_fourcc(rng.random(), Yuv::default()),
        ));
        let layout = Layout::try_new(format, width, height, size(&mut rng));
        for layout in layout.into_iter().chain(Layout::tight(format, width, height)) {
            assert!(layout.frame_bytes() >= format.line_bytes(width), "{layout:?}");
            assert!(layout.merged_size().width > 0 && layout.merged_size().height > 0, "{layout:?}");
        }
    }
}

fn intrinsics(rng: &mut Pcg64Mcg) -> Intrinsics {
    let usual = rng.random_range(0..3) > 0;
    let mut number = |usual_value: f64| if usual { usual_value } else { double(rng) };
    let vignetting = [1.0, 0.0, -0.1, 0.0, 0.0, 0.0, 0.0, 0.0].map(&mut number);
    let (centre_px, focal_px) = (DVec2::new(number(7.5), number(5.5)), DVec2::new(number(5.0), number(4.0)));
    let (skew_px, max_theta) = (number(0.1), number(1.5));
    let k = [0.01, -0.002, 0.0, 0.0].map(&mut number);
    let model = match rng.random_range(0..4) {
        0 => Model::Equidistant,
        1 => Model::Equisolid,
        2 => Model::KannalaBrandt(k),
        _ => Model::Radial([k[0], k[1]]),
    };
    Intrinsics { model, centre_px, focal_px, skew_px, max_theta, vignetting }
}

#[test]
fn lenses_are_total() {
    let mut rng = seeded(6);
    for _ in 0..20_000 {
        let Ok(lens) = Lens::try_new(intrinsics(&mut rng)) else { continue };
        let pixel = DVec2::new(double(&mut rng), double(&mut rng));
        let direction = DVec3::new(double(&mut rng), double(&mut rng), double(&mut rng));
        black_box((lens.project(direction), lens.unproject(pixel), lens.solid_angle(pixel)));
        black_box(lens.illumination(double(&mut rng)));
    }
    let mut number = || double(&mut rng);
    for _ in 0..20_000 {
        let _ = black_box(Lens::equidistant([number(), number()], number(), number()));
    }
}

fn response(rng: &mut Pcg64Mcg) -> Response {
    match rng.random_range(0..4) {
        0 => Response::Srgb,
        1 => Response::Polynomial([(); 3].map(|()| [(); 5].map(|()| double(rng)))),
        _ => Response::Linear,
    }
}

/// Returns a calibration with random parameters, most of which are valid.
fn calibration(rng: &mut Pcg64Mcg) -> Option<Calibration> {
    let lens = Lens::try_new(intrinsics(rng)).ok()?;
    let format = format(rng);
    let [width, height] = [(); 2].map(|()| 2 * rng.random_range(1..10) + rng.random_range(0..5) / 4);
    let layout =
        Layout::try_new(format, width, height, format.line_bytes(width) + rng.random_range(0..3)).ok()?;
    let mut calibration = Calibration::new(lens, layout);
    match rng.random_range(0..6) {
        0 => calibration.levels = Levels { black: double(rng), white: double(rng) },
        1 => calibration.scale = double(rng),
        2 => calibration.white_balance = [(); 3].map(|()| single(rng)),
        _ => {}
    }
    calibration.response = response(rng);
    Some(calibration)
}

fn exposures(rng: &mut Pcg64Mcg) -> Vec<Exposure> {
    let many = [0, 1, 3, 3, 4, 5, 12, 13][rng.random_range(0..8)];
    if rng.random_range(0..5) == 0 {
        return (0..many).map(|_| Exposure { seconds: double(rng), gain: double(rng) }).collect();
    }
    let has_gains = rng.random();
    let gain = |i: u32| if has_gains { 1.0 + f64::from(i) } else { 1.0 };
    (0..many).map(|i| Exposure { seconds: 0.001 * f64::from(1 << i), gain: gain(i) }).collect()
}

/// Returns random frames, most of which match the layout.
fn frames(rng: &mut Pcg64Mcg, front: &FrontEnd<Vec<u64>>, many: usize) -> Vec<Vec<u16>> {
    let layout = front.calibration().layout;
    let many = if rng.random_range(0..8) == 0 { rng.random_range(0..15) } else { many };
    let len = if rng.random_range(0..8) == 0 { rng.random_range(0..99) } else { layout.frame_bytes() };
    let is_noise = rng.random();
    let most = rng.random_range(1..=u16::MAX);
    (0..many).map(|_| (0..len).map(|_| if is_noise { rng.random() } else { most }).collect()).collect()
}

fn process(rng: &mut Pcg64Mcg, front: &mut FrontEnd<Vec<u64>>, many: usize) {
    let words = frames(rng, front, many);
    let bytes: Vec<Vec<u8>> = words.iter().map(|f| f.iter().map(|v| *v as u8).collect()).collect();
    let is_words = (front.calibration().layout.format() == Format::Rgb48) != (rng.random_range(0..9) == 0);
    let samples: Vec<Samples<'_>> = bytes
        .iter()
        .zip(&words)
        .map(|(b, w)| if is_words { w.as_slice().into() } else { b.as_slice().into() })
        .collect();
    front.set_extrapolation(if rng.random() { Extrapolation::Average } else { Extrapolation::None });
    match front.process(&samples) {
        Ok(coverage) => {
            let parts = [coverage.clipped, coverage.unseen, coverage.below];
            assert!(
                parts.iter().all(|v| v.is_finite() && *v >= 0.0),
                "{coverage:?} of {:?}",
                front.calibration()
            );
        }
        Err(error) => assert!(matches!(error, FrontError::Burst(_)), "{error}"),
    }
    let total = front.map().total();
    assert!(
        total.energy.iter().chain(&total.moment).all(|v| v.is_finite()),
        "{total:?} of {:?}",
        front.calibration()
    );
    assert!(total.energy.iter().all(|v| *v >= 0.0), "{total:?} of {:?}", front.calibration());
}

/// Creates a front end in memory of the required length; asserts that one word less, or half of it, is refused with the required length.
fn make(calibration: Calibration, exposures: &[Exposure], order: Order) -> Option<FrontEnd<Vec<u64>>> {
    let words = Sizes::of(&calibration, exposures, order).ok()?.words();
    let lent = if words % 2 == 0 { words - 1 } else { words / 2 };
    let short = FrontEnd::try_new(calibration, exposures, order, vec![0; lent]).map(|_| ());
    let front = FrontEnd::try_new(calibration, exposures, order, vec![u64::MAX; words]);
    match (short, front) {
        (Err(FrontError::Memory(short)), Ok(front)) => {
            assert_eq!((short.needed, short.lent), (words, lent), "{calibration:?}");
            Some(front)
        }
        (_, Err(FrontError::Response(_) | FrontError::BadWhiteBalance)) => None,
        (short, front) => panic!("{short:?} with too little, {:?} with enough memory", front.map(|_| ())),
    }
}

#[test]
fn front_ends_of_any_camera_exposures_and_memory_are_total() {
    let mut rng = seeded(7);
    let (mut made, mut refused) = (0, 0);
    for _ in 0..8_000 {
        let Some(calibration) = calibration(&mut rng) else { continue };
        let (first, order) = (exposures(&mut rng), Order::saturating(rng.random_range(0..5)));
        let _ = black_box(FrontEnd::try_new(calibration, &first, Order::MAX, [0; 64]).map(|_| ()));
        let Some(mut front) = make(calibration, &first, order) else {
            refused += 1;
            continue;
        };
        made += 1;
        process(&mut rng, &mut front, first.len());
        let second = exposures(&mut rng);
        let many = if front.set_exposures(&second).is_ok() { second.len() } else { first.len() };
        process(&mut rng, &mut front, many);
    }
    assert!(made > 500 && refused > 500, "{made} made, {refused} refused");
}

#[test]
fn colours_and_pictures_are_total() {
    let mut rng = seeded(8);
    for _ in 0..100_000 {
        let rgb = [(); 3].map(|()| single(&mut rng));
        let d = Vec3::new(single(&mut rng), single(&mut rng), single(&mut rng));
        black_box((
            color::luminance(rgb),
            tonemap::sigmoid(rgb, single(&mut rng)),
            tonemap::srgb_code(rgb[0]),
        ));
        black_box((harmonics::radiance(&[rgb; 9], d), harmonics::basis(d)));
        assert!(color::sound(rgb).iter().all(|v| *v >= 0.0 && v.is_finite()), "{rgb:?}");
        let radius = cap_radius_deg(rgb[0]);
        assert!(radius.is_nan() || (0.0..=180.0).contains(&radius), "{rgb:?}");
    }
}
