//! Samplers neither panic nor return non-finite lights on 2,000 seeded maps with arbitrary numbers.

use crate::common::{Pcg64Mcg, RngExt, above, dark, seeded};
use hemilux_core::Order;
use hemilux_core::color::luminance;
use hemilux_core::healpix::Domain;
use hemilux_core::light::Light;
use hemilux_core::polar::{Grid, LatLongView};
use hemilux_core::pyramid::{Pyramid, Quad};
use hemilux_core::sampler::adaptive::{self, Adaptive};
use hemilux_core::sampler::hemigon::follow::Follow;
use hemilux_core::sampler::hemigon::inversion::{Inversion, Ring, rings_len};
use hemilux_core::sampler::hemigon::kalman::{self, Gated};
use hemilux_core::sampler::hemigon::{Hemigon, fir};
use hemilux_core::sampler::pharr::{self, Pharr};
use hemilux_core::sampler::q2tree::{Parameters, Placement};
use hemilux_core::sampler::{Map, Request, Sampler};
use std::collections::HashSet;

/// Returns a random number over the range of f32, often a boundary value of the type.
fn number(rng: &mut Pcg64Mcg) -> f32 {
    const HARD: [f32; 12] = [
        0.0,
        -0.0,
        1.0,
        -1.0,
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::MAX,
        f32::MIN,
        f32::MIN_POSITIVE,
        1e-45,
        1e20,
    ];
    match rng.random_range(0..4) {
        0 => HARD[rng.random_range(0..HARD.len())],
        1 => f32::from_bits(rng.random()),
        _ => rng.random(),
    }
}

fn rgb(rng: &mut Pcg64Mcg) -> [f32; 3] {
    [(); 3].map(|()| number(rng))
}

/// Returns a pyramid whose quads have arbitrary numbers, or the sums of single lights, in a few texels or in all.
fn pyramid(rng: &mut Pcg64Mcg, domain: Domain, order: u8) -> Pyramid<Vec<Quad>> {
    let mut map = dark(domain, order);
    let density = rng.random_range(0.0..1.2);
    for (ipix, quad) in map.texels_mut().iter_mut().enumerate() {
        if rng.random::<f64>() > density {
            continue;
        }
        *quad = match rng.random_range(0..3) {
            0 => Quad { energy: [(); 4].map(|()| number(rng)), moment: [(); 4].map(|()| number(rng)) },
            _ => Quad::from_light(rgb(rng), above(domain, order, ipix as u32)),
        };
    }
    map.build();
    map
}

fn check(lights: &[Light], requested: usize, what: &str) {
    assert!(lights.len() <= requested, "{what}: {} of {requested}", lights.len());
    let ids: HashSet<u32> = lights.iter().map(|l| l.id).collect();
    assert_eq!(ids.len(), lights.len(), "{what}: ids are unique");
    for light in lights {
        assert!(light.id != 0 && (light.direction.length() - 1.0).abs() < 1e-5, "{what}: {light:?}");
        assert!(light.irradiance.iter().all(|v| v.is_finite() && *v >= 0.0), "{what}: {light:?}");
        assert!((0.0..=180.0).contains(&light.radius_deg), "{what}: {light:?}");
    }
}

type Sampling = Box<dyn Sampler>;

fn q2tree(parameters: Parameters, domain: Domain, order: Order, lights: usize) -> Sampling {
    Box::new(crate::common::q2tree(parameters, domain, order.get(), lights))
}

fn pharr(grid: &Grid, lights: usize) -> Sampling {
    let (conditional, marginal) = (vec![0.0; grid.len()], vec![0.0; grid.height]);
    let memory = pharr::Memory { conditional, marginal, lights: vec![Light::default(); lights] };
    Box::new(Pharr::try_new(grid, memory).expect("room enough"))
}

fn adaptive(domain: Domain, order: Order, lights: usize) -> Sampling {
    let bits = || vec![0; adaptive::bits_len(domain, order)];
    let (room, tracks) =
        (|| vec![Light::default(); lights], || vec![adaptive::LightFilter::default(); lights]);
    let memory = adaptive::Memory {
        interior: [bits(), bits()],
        leaves: vec![adaptive::Leaf::default(); lights],
        lights: [room(), room()],
        tracks: [tracks(), tracks()],
        workspace: Box::new(adaptive::Workspace::new()),
    };
    Box::new(Adaptive::try_new(domain, order, memory).expect("room enough"))
}

fn hemigon<F: Follow + 'static>(grid: &Grid, lights: usize, filter: F) -> Sampling {
    let rings = vec![Ring::default(); rings_len(grid)];
    let inversion = Inversion::try_new(grid, vec![0.0; grid.len()], rings).expect("room enough");
    let (lives, lights) = (vec![0; 2 * lights], vec![Light::default(); lights]);
    Box::new(Hemigon::try_new(inversion, filter, lives, lights).expect("room enough"))
}

/// Returns one sampler of each kind, for `lights` lights.
fn samplers(rng: &mut Pcg64Mcg, domain: Domain, order: Order, grid: &Grid, lights: usize) -> Vec<Sampling> {
    let jitter = Placement::Jitter { spread: rng.random() };
    let tracks = vec![kalman::PathFilter::default(); 2 * lights];
    let gated = Gated::try_new(kalman::Parameters::LIGHTS, lights, tracks).expect("room enough");
    let parameters = fir::Parameters { taps: rng.random_range(0..70), ..fir::Parameters::default() };
    let paths = vec![glam::Vec3::ZERO; fir::paths_len(&parameters, lights)];
    let published = fir::Fir::try_new(&parameters, lights, paths).expect("room enough");
    let tree = |placement, threshold| Parameters { placement, threshold, ..Parameters::CENTROID };
    vec![
        q2tree(tree(Placement::Centroid, rng.random()), domain, order, lights),
        q2tree(tree(jitter, rng.random()), domain, order, lights),
        pharr(grid, lights),
        adaptive(domain, order, lights),
        hemigon(grid, lights, gated),
        hemigon(grid, lights, published),
    ]
}

fn run(seed: u64) {
    let mut rng = seeded(seed);
    let domain = if rng.random() { Domain::Sphere } else { Domain::Hemisphere };
    let order = rng.random_range(0..4);
    let grid = Grid { width: rng.random_range(1..12), height: rng.random_range(1..9), domain };
    let capacity = rng.random_range(0..300);
    let mut samplers = samplers(&mut rng, domain, Order::saturating(order), &grid, capacity);
    for _ in 0..3 {
        let pyramid = pyramid(&mut rng, domain, order);
        let texels: Vec<_> = (0..grid.len()).map(|_| rgb(&mut rng)).collect();
        let map = Map { pyramid: pyramid.view(), polar: LatLongView { grid, texels: &texels } };
        let lights = rng.random_range(0..400);
        let tolerance = rng.random::<bool>().then(|| rng.random_range(0.0..1.0));
        let request = Request { lights, tolerance, ambient: rng.random(), soft: rng.random() };
        for sampler in &mut samplers {
            let what = format!("{} {seed}", sampler.kind());
            let made = sampler.update(&map, &request);
            check(made.lights, lights, &what);
            let ambient = made.ambient.iter().flatten().flatten();
            assert!(ambient.chain(&made.estimated_error).all(|v| v.is_finite()), "{what}");
        }
        let total = pyramid.view().total();
        assert!(total.energy.iter().chain(&total.moment).all(|v| v.is_finite()), "{seed}: {total:?}");
        assert!(pyramid.view().horizontal_irradiance().iter().all(|v| v.is_finite()), "{seed}");
    }
}

#[test]
fn lights_of_every_sampler_are_finite_and_positive_on_hostile_maps() {
    (0..2000).for_each(run);
}

/// Every texel has 96 random bits: most hold no light, a few hold nearly all of it, and channels differ by up to 76 decades.
#[test]
fn lights_of_every_sampler_are_finite_and_positive_on_random_bits() {
    for seed in 0..300 {
        let mut rng = seeded(seed);
        let grid = Grid { width: 48, height: 24, domain: Domain::Sphere };
        let order = Order::saturating(3);
        let mut samplers = samplers(&mut rng, Domain::Sphere, order, &grid, 64);
        for _ in 0..3 {
            let mut bits = || [(); 3].map(|()| f32::from_bits(rng.random()));
            let texels: Vec<_> = (0..grid.len()).map(|_| bits()).collect();
            let mut pyramid = dark(Domain::Sphere, 3);
            for (ipix, quad) in pyramid.texels_mut().iter_mut().enumerate() {
                *quad = Quad::from_light(bits(), above(Domain::Sphere, 3, ipix as u32));
            }
            pyramid.build();
            let map = Map { pyramid: pyramid.view(), polar: LatLongView { grid, texels: &texels } };
            for sampler in &mut samplers {
                let what = format!("{} {seed}", sampler.kind());
                check(sampler.update(&map, &Request::of_lights(64)).lights, 64, &what);
            }
        }
    }
}

/// In this test, the fraction of a subnormal sum is rounded to a multiple of the smallest number, up to the sum itself.
#[test]
fn pharr_finds_the_only_texel_of_subnormal_light() {
    let grid = Grid { width: 8, height: 4, domain: Domain::Sphere };
    let map = dark(Domain::Sphere, 0);
    for (light, at) in [1e-45, 3e-45, 1e-41].into_iter().flat_map(|light| (0..32).map(move |at| (light, at)))
    {
        let mut texels = vec![[0.0; 3]; grid.len()];
        texels[at] = [light; 3];
        let map = Map { pyramid: map.view(), polar: LatLongView { grid, texels: &texels } };
        let mut sampler = pharr(&grid, 64);
        let made = sampler.update(&map, &Request::of_lights(64));
        check(made.lights, 64, &format!("{light:e} at {at}"));
        // The corners of a texel of 45 x 45 degrees are at most 32 degrees from its centre.
        let centre = grid.centre(at);
        let is_there = |light: &Light| light.direction.as_dvec3().dot(centre) > 0.84;
        assert!(made.lights.len() == 64 && made.lights.iter().all(is_there), "{light:e} at {at}");
    }
}

#[test]
fn invalid_texel_does_not_change_the_light_of_others() {
    for bad in [f32::NAN, f32::INFINITY, -1e30] {
        let mut map = dark(Domain::Sphere, 3);
        map.texels_mut().fill(Quad::from_light([1.0; 3], glam::Vec3::X));
        map.texels_mut()[100].energy[0] = bad;
        map.build();
        assert!((map.view().total().y() - 767.0 * luminance([1.0; 3])).abs() < 0.01, "{bad}");
    }
}
