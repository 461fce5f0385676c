//! Helpers that several test files share: seeded random numbers, lenses, maps, samplers.
#![allow(dead_code, reason = "each test file uses its own part")]

use glam::{DVec2, DVec3, Vec3};
use hemilux_core::Levels;
use hemilux_core::Order;
use hemilux_core::format::{Format, Layout};
use hemilux_core::healpix::{self, Domain};
use hemilux_core::internals;
use hemilux_core::internals::merge::{COUNT_BITS, Channels, Codes, Merge, MergeView, Reciprocal, merge_size};
use hemilux_core::internals::pixel_table::{Buffers, PixelTable, Run, Span, Texel, pixel_table_size};
use hemilux_core::lens::{Intrinsics, Lens, Model};
use hemilux_core::light::{Light, Sh9};
use hemilux_core::polar::LatLongView;
use hemilux_core::pyramid::{Pyramid, Quad, pyramid_len};
use hemilux_core::response::{Curve, curve_len};
use hemilux_core::sampler::adaptive::{self, Adaptive, LightFilter, Memory, Workspace, bits_len};
use hemilux_core::sampler::q2tree::{Leaf, Parameters, Past, Q2Tree, interior_len};
use hemilux_core::sampler::{Map, Request, Sampler};
use hemilux_core::wire::{Coordinates, Degraded, FramesLeftOut, Latency, LightSet, Overrun, Unit};
use hemilux_core::{BurstError, Coverage, ImageSize, MapShape};
use hemilux_core::{Depth, Response};
use hemilux_core::{Exposure, Samples};
pub use rand::RngExt;
use rand::SeedableRng;
pub use rand_pcg::Pcg64Mcg;

/// A pixel table whose buffers are vectors.
pub type VecPixelTable = PixelTable<Vec<Span>, Vec<u16>, Vec<Run>, Vec<Texel>>;

/// A merge whose buffers are vectors.
pub type VecMerge = Merge<Vec<i32>, Vec<u32>, Vec<Reciprocal>>;

/// The sampler `q2tree` with vectors as buffers.
pub type VecQ2Tree = Q2Tree<Vec<u8>, Vec<Leaf>, Vec<Light>, Vec<Past>>;

/// Creates a `q2tree` for maps of `domain` and `order` and `lights` lights. All bits of its bit sets are 1 before the constructor clears them.
pub fn q2tree(parameters: Parameters, domain: Domain, order: u8, lights: usize) -> VecQ2Tree {
    let order = Order::saturating(order);
    let bits = || vec![0xff; interior_len(domain, order)];
    let (heap, past) = (vec![Leaf::default(); lights], vec![Past::default(); lights]);
    let shape = MapShape { domain, order };
    Q2Tree::try_new(parameters, shape, [bits(), bits()], heap, vec![Light::default(); lights], past)
        .expect("buffers of the lengths that the sampler names")
}

/// The sampler `adaptive` with vectors as buffers.
pub type VecAdaptive = Adaptive<Vec<u8>, Vec<adaptive::Leaf>, Vec<Light>, Vec<LightFilter>, Box<Workspace>>;

/// Creates an `adaptive` for maps of `domain` and `order` and `lights` lights. All bits of its bit sets are 1 before the constructor clears
/// them.
pub fn adaptive(domain: Domain, order: u8, lights: usize) -> VecAdaptive {
    let order = Order::saturating(order);
    let bits = || vec![0xff; bits_len(domain, order)];
    let buffer = || vec![Light::default(); lights];
    let filters = || vec![LightFilter::default(); lights];
    let memory = Memory {
        interior: [bits(), bits()],
        leaves: vec![adaptive::Leaf::default(); lights],
        lights: [buffer(), buffer()],
        tracks: [filters(), filters()],
        workspace: Box::default(),
    };
    Adaptive::try_new(domain, order, memory).expect("buffers of the lengths that the sampler names")
}

/// Returns the lights of `map` by `sampler`, which reads the pyramid only.
pub fn update(sampler: &mut impl Sampler, map: &Pyramid<Vec<Quad>>, lights: usize) -> Vec<Light> {
    let map = Map { pyramid: map.view(), polar: LatLongView::NONE };
    sampler.update(&map, &Request::of_lights(lights)).lights.to_vec()
}

/// Returns a light set of `lights` and `ambient` in which every field has a different value.
pub fn light_set<'a>(lights: &'a [Light], ambient: Option<&'a Sh9>) -> LightSet<'a> {
    LightSet {
        run: "k3v9",
        frame: 0x0102_0304_0506_0708,
        timestamp_ns: 123_456_789_012,
        wall_ms: 1_700_000_000_000,
        valid: true,
        stale: None,
        sampler: "q2tree",
        requested: 64,
        unit: Unit::Lux,
        unit_uncertainty: None,
        coordinates: Coordinates::YUp,
        lights,
        ambient_sh: ambient,
        left_out: None,
        scalar_flux: [1.0, 2.0, 3.0],
        horizontal_irradiance: [0.5, 1.0, 1.5],
        clipped_irradiance_at_least: [0.0; 3],
        clipped: 0.0,
        unseen: 0.125,
        estimated_error: Some(0.125),
        latency: Latency { capture: 1, front: 2, pyramid: 3, sample: 4, filter: 5, encode: 6, total: 7 },
        overrun: Overrun::NONE,
        frames_left_out: FramesLeftOut::NONE,
        degraded: Degraded::NONE,
        flicker: hemilux_core::mains::Flicker::NONE,
    }
}

/// Returns a random number generator whose sequence depends on `seed` only.
pub fn seeded(seed: u64) -> Pcg64Mcg {
    Pcg64Mcg::seed_from_u64(seed)
}

/// Returns a uniformly distributed unit vector.
pub fn direction(rng: &mut Pcg64Mcg) -> DVec3 {
    let z: f64 = rng.random_range(-1.0..1.0);
    let phi: f64 = rng.random_range(0.0..std::f64::consts::TAU);
    let r = (1.0 - z * z).sqrt();
    DVec3::new(r * phi.cos(), r * phi.sin(), z)
}

/// Returns intrinsics with equal focal lengths, no skew and no vignetting; angles in degrees.
pub fn plain(model: Model, centre: [f64; 2], focal: f64, max_deg: f64) -> Intrinsics {
    Intrinsics {
        model,
        centre_px: DVec2::from_array(centre),
        focal_px: DVec2::splat(focal),
        skew_px: 0.0,
        max_theta: max_deg.to_radians(),
        vignetting: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    }
}

/// Returns the standard lens of `board/FORMATS.md`: 160 x 140 degrees on 640 x 480 pixels.
pub fn bench_lens() -> Lens {
    Lens::try_new(plain(Model::Equidistant, [319.5, 239.5], 196.4, 80.0)).expect("a sound lens")
}

/// Returns a lens with a field of view of `max_deg` degrees off axis, whose image circle has the diameter of a square of `side` pixels.
pub fn full_circle(model: Model, side: u32, max_deg: f64) -> Lens {
    let unit = Lens::try_new(plain(model, [0.0; 2], 1.0, max_deg)).expect("a sound lens");
    let theta = max_deg.to_radians() * (1.0 - 1e-12);
    let edge = unit.project(DVec3::new(theta.sin(), 0.0, theta.cos())).expect("inside the view").x;
    let middle = (f64::from(side) - 1.0) / 2.0;
    let focal = (f64::from(side) / 2.0 - 1.0) / edge;
    Lens::try_new(plain(model, [middle; 2], focal, max_deg)).expect("a sound lens")
}

/// Creates a pixel table for hemisphere maps of `order`, in buffers of exactly the required lengths.
pub fn pixel_table(lens: &Lens, width: u32, height: u32, order: u8) -> VecPixelTable {
    let size = pixel_table_size(lens, ImageSize { width, height }, order).expect("a sound image");
    let buffers = Buffers {
        spans: vec![Span::default(); size.spans],
        weights: vec![0; size.weights],
        runs: vec![Run::default(); size.runs],
        texels: vec![Texel::default(); size.texels],
    };
    PixelTable::try_new(lens, ImageSize { width, height }, order, buffers).expect("a sound pixel table")
}

/// Returns a pyramid without light.
pub fn dark(domain: Domain, order: u8) -> Pyramid<Vec<Quad>> {
    Pyramid::try_new(
        vec![Quad::default(); pyramid_len(domain, Order::saturating(order))],
        domain,
        Order::saturating(order),
    )
    .expect("room enough")
}

/// Returns a built pyramid whose texel `ipix` holds `energy(ipix)` from its centre; texels outside the domain have no light.
pub fn lit(domain: Domain, order: u8, mut energy: impl FnMut(u32) -> [f32; 3]) -> Pyramid<Vec<Quad>> {
    let mut map = dark(domain, order);
    for (ipix, quad) in map.texels_mut().iter_mut().enumerate() {
        let ipix = ipix as u32;
        if domain.share(order, ipix) > 0.0 {
            *quad = Quad::from_light(energy(ipix), above(domain, order, ipix));
        }
    }
    map.build();
    map
}

/// Returns a direction inside the part of quad `ipix` that lies in the domain.
pub fn above(domain: Domain, order: u8, ipix: u32) -> Vec3 {
    let at = if domain.share(order, ipix) == 0.5 { 2.0 / 3.0 } else { 0.5 };
    healpix::point(order, ipix, at, at).as_vec3()
}

/// Returns an energy of `v` in each channel.
pub fn grey(v: f32) -> [f32; 3] {
    [v; 3]
}

/// Returns the relative difference |a - b| / |b|.
pub fn off(a: f64, b: f64) -> f64 {
    (a - b).abs() / b.abs()
}

/// Creates the merge of one 16-bit linear exposure of 10 ms, white at 65535.
pub fn one_exposure() -> VecMerge {
    let curve = Curve::try_new(
        &Response::Linear,
        Depth::U16,
        Levels { black: 0.0, white: 65535.0 },
        vec![0; curve_len(Depth::U16)],
    );
    let exposure = Exposure { seconds: 0.01, gain: 1.0 };
    merge(curve.expect("sound"), &[exposure])
}

/// Creates a merge of radiance scale 1 in buffers of exactly the required lengths.
pub fn merge(curve: Curve<Vec<i32>>, exposures: &[Exposure]) -> VecMerge {
    let size = merge_size(&curve, exposures).expect("sound exposures");
    let reciprocals = vec![Reciprocal::default(); size.reciprocals];
    Merge::try_new(curve, exposures, 1.0, vec![0; size.tables], reciprocals).expect("sound exposures")
}

/// Returns the radiance of `code` in [`one_exposure`].
pub fn radiance_of(code: u16) -> f64 {
    f64::from(code) / 65535.0 / 0.01
}

/// Processes one frame of 16-bit samples to a built pyramid.
pub fn expose(pixel_table: &VecPixelTable, frame: &[u16]) -> (Pyramid<Vec<Quad>>, Coverage) {
    let mut map = dark(Domain::Hemisphere, pixel_table.order());
    let seen = burst(pixel_table, &[Samples::U16(frame)], [1.0; 3], &mut map);
    (map, seen.expect("a frame that fits"))
}

/// Processes a burst of one exposure of 16-bit samples.
pub fn burst(
    pixel_table: &VecPixelTable,
    frames: &[Samples<'_>],
    balance: [f32; 3],
    map: &mut Pyramid<Vec<Quad>>,
) -> Result<Coverage, BurstError> {
    let layout =
        Layout::tight(Format::Rgb48, pixel_table.width(), pixel_table.height()).expect("a sound size");
    internals::burst(frames, &layout, &one_exposure().view(), &pixel_table.view(), balance, map)
}

/// Merges whole pixels: in integers where the merge has an integer loop, otherwise in floats. Returns the number of samples that were merged
/// in integers.
pub fn merged(view: &MergeView<'_>, codes: &[Codes<'_>], channels: Channels, out: &mut [f32]) -> usize {
    let many = channels.many();
    let mut counts = vec![0; out.len()];
    if view.counts(codes, channels, &mut counts) {
        let whole = |v: &i32| {
            assert!(v.unsigned_abs() < 1 << COUNT_BITS, "{v}");
            *v as f32
        };
        out.iter_mut().zip(&counts).for_each(|(to, v)| *to = whole(v));
        return out.len();
    }
    if out.len() <= many {
        view.samples(codes, channels, out);
        return 0;
    }
    let middle = out.len() / many / 2 * many;
    let (first, second) = out.split_at_mut(middle);
    let side = |after| codes.iter().map(|c| half(c, middle, after)).collect::<Vec<_>>();
    merged(view, &side(false), channels, first) + merged(view, &side(true), channels, second)
}

/// Returns the samples of `codes` before `middle`, or from `middle` on if `after`.
fn half<'a>(codes: &Codes<'a>, middle: usize, after: bool) -> Codes<'a> {
    fn cut<T>(all: &[T], middle: usize, after: bool) -> &[T] {
        let (first, second) = all.split_at(middle.min(all.len()));
        if after { second } else { first }
    }
    match *codes {
        Codes::Bytes(s) => Codes::Bytes(cut(s, middle, after)),
        Codes::Words(s) => Codes::Words(cut(s, middle, after)),
        Codes::Planes(s) => Codes::Planes(s.map(|s| cut(s, middle / 3, after))),
        Codes::Unread => Codes::Unread,
    }
}
