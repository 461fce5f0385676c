//! Whatever a map holds, samplers neither panic nor give out what is no number: 2,000 seeded maps.

mod common;

use common::{Pcg64Mcg, RngExt, above, dark, seeded};
use hemilux_core::Order;
use hemilux_core::color::luminance;
use hemilux_core::healpix::Domain;
use hemilux_core::light::Light;
use hemilux_core::polar::{Grid, LatLongView};
use hemilux_core::pyramid::{Pyramid, Quad};
use hemilux_core::sampler::pharr::Pharr;
use hemilux_core::sampler::q2tree::{Leaf, Parameters, Past, Placement, Q2Tree, interior_len};
use hemilux_core::sampler::{Map, Request, Sampler};
use std::collections::HashSet;

/// A number from all over f32, with the hard ones often.
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

/// Quads written straight into the texels, or made from light; a few of them or all.
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

fn run(seed: u64) {
    let mut rng = seeded(seed);
    let domain = if rng.random() { Domain::Sphere } else { Domain::Hemisphere };
    let order = rng.random_range(0..4);
    let grid = Grid { width: rng.random_range(1..12), height: rng.random_range(1..9), domain };
    let placement =
        if rng.random() { Placement::Centroid } else { Placement::Jitter { spread: rng.random() } };
    let threshold = rng.random();
    let parameters = Parameters { placement, threshold, ..Parameters::CENTROID };
    let capacity = rng.random_range(0..300);
    let room = || vec![Light::default(); capacity];
    let bits = || vec![0; interior_len(domain, Order::saturating(order))];
    let heap = vec![Leaf::default(); capacity];
    let mut tree = Q2Tree::try_new(
        parameters,
        (domain, Order::saturating(order)),
        [bits(), bits()],
        heap,
        (room(), vec![Past::default(); capacity]),
    )
    .expect("room enough");
    let mut pharr = Pharr::try_new(&grid, vec![0.0; grid.len()], room()).expect("room enough");
    for _ in 0..3 {
        let pyramid = pyramid(&mut rng, domain, order);
        let texels: Vec<_> = (0..grid.len()).map(|_| rgb(&mut rng)).collect();
        let map = Map { pyramid: pyramid.view(), polar: LatLongView { grid, texels: &texels } };
        let lights = rng.random_range(0..400);
        check(tree.update(&map, &Request::of_lights(lights)).lights, lights, &format!("q2tree {seed}"));
        check(pharr.update(&map, &Request::of_lights(lights)).lights, lights, &format!("pharr {seed}"));
        let total = pyramid.view().total();
        assert!(total.energy.iter().chain(&total.moment).all(|v| v.is_finite()), "{seed}: {total:?}");
        assert!(pyramid.view().horizontal_irradiance().iter().all(|v| v.is_finite()), "{seed}");
    }
}

#[test]
fn two_thousand_hostile_maps_give_sound_lights() {
    (0..2000).for_each(run);
}

#[test]
fn one_bad_texel_costs_its_own_light_alone() {
    for bad in [f32::NAN, f32::INFINITY, -1e30] {
        let mut map = dark(Domain::Sphere, 3);
        map.texels_mut().fill(Quad::from_light([1.0; 3], glam::Vec3::X));
        map.texels_mut()[100].energy[0] = bad;
        map.build();
        assert!((map.view().total().y() - 767.0 * luminance([1.0; 3])).abs() < 0.01, "{bad}");
    }
}
