//! The samplers `q2tree` and `q2tree-jitter`: numbers of lights, energy, ids and positions.

use crate::common::{RngExt, dark, grey, lit, off, q2tree as tree, seeded, update};
use hemilux_core::Order;
use hemilux_core::healpix::{self, Domain};
use hemilux_core::light::Light;
use hemilux_core::pyramid::{Pyramid, Quad};
use hemilux_core::sampler::Sampler;
use hemilux_core::sampler::q2tree::{Leaf, Parameters, Past, Placement, Q2Tree, interior_len};
use hemilux_core::{MapShape, TooSmall};
use std::collections::{HashMap, HashSet};

fn random(domain: Domain, order: u8, seed: u64) -> Pyramid<Vec<Quad>> {
    let mut rng = seeded(seed);
    lit(domain, order, |_| [(); 3].map(|()| 10f32.powf(rng.random_range(-3.0..1.0))))
}

#[test]
fn sphere_gives_the_largest_count_that_fits() {
    let map = random(Domain::Sphere, 7, 1);
    let mut tree = tree(Parameters::CENTROID, Domain::Sphere, 7, 50_000);
    for request in (12..=2000).chain([50_000]) {
        let lights = update(&mut tree, &map, request);
        assert_eq!(lights.len(), 12 + (request - 12) / 3 * 3, "{request} requested");
        let ids: HashSet<u32> = lights.iter().map(|l| l.id).collect();
        assert_eq!(ids.len(), lights.len(), "ids are unique");
    }
    assert_eq!(update(&mut tree, &map, 11), []);
    assert_eq!(update(&mut tree, &map, 60_000).len(), 49_998, "the capacity is 50,000");
    // A map of order 1 has 48 texels.
    let coarse = random(Domain::Sphere, 1, 1);
    assert_eq!(update(&mut tree, &coarse, 2000).len(), 48);
}

#[test]
fn hemisphere_gives_the_request_or_one_light_less() {
    let map = random(Domain::Hemisphere, 6, 2);
    let mut tree = tree(Parameters::CENTROID, Domain::Hemisphere, 6, 2000);
    for request in 8..=2000 {
        let count = update(&mut tree, &map, request).len();
        // The number of lights is 8 + 3 a + 2 b, which is never 9.
        assert!(count == request || count + 1 == request, "{request}: {count}");
    }
}

#[test]
fn dark_quads_give_no_lights() {
    // Only face 0 of the map is lit: 1 + 3 a lights.
    let map = lit(Domain::Hemisphere, 4, |i| grey(f32::from(i < 256)));
    let mut tree = tree(Parameters::CENTROID, Domain::Hemisphere, 4, 100);
    for (request, count) in [(8, 7), (10, 10), (11, 10), (13, 13), (14, 13), (100, 100)] {
        assert_eq!(update(&mut tree, &map, request).len(), count, "{request}");
    }
}

#[test]
fn energy_of_the_lights_equals_that_of_the_map() {
    for (domain, order) in [(Domain::Sphere, 6), (Domain::Hemisphere, 6)] {
        let map = random(domain, order, 3);
        let mut tree = tree(Parameters::CENTROID, domain, order, 1000);
        for request in [12, 64, 333, 1000] {
            let lights = update(&mut tree, &map, request);
            for c in 0..3 {
                let sum: f64 = lights.iter().map(|l| f64::from(l.irradiance[c])).sum();
                let expected: f64 = map.texels().iter().map(|q| f64::from(q.energy[c])).sum();
                assert!(off(sum, expected) < 1e-6, "{request}: {sum} {expected}");
            }
            assert!(lights.iter().all(|l| (l.direction.length() - 1.0).abs() < 1e-6));
        }
    }
}

#[test]
fn static_map_keeps_lights_in_place_and_increases_ages() {
    let map = random(Domain::Hemisphere, 5, 4);
    for parameters in
        [Parameters::CENTROID, Parameters::JITTER, Parameters { threshold: 0.3, ..Parameters::CENTROID }]
    {
        let mut tree = tree(parameters, Domain::Hemisphere, 5, 100);
        let first = update(&mut tree, &map, 100);
        for age in 0..5 {
            let again = if age == 0 { first.clone() } else { update(&mut tree, &map, 100) };
            let expected: Vec<_> = first.iter().map(|l| Light { age, ..*l }).collect();
            assert_eq!(again, expected);
        }
        tree.reset();
        assert_eq!(update(&mut tree, &map, 100), first, "the reset sampler repeats its first frame");
    }
}

#[test]
fn a_light_that_splits_is_the_parent_of_its_children() {
    let order = 5;
    let map = random(Domain::Sphere, order, 5);
    let mut tree = tree(Parameters::CENTROID, Domain::Sphere, order, 400);
    let mut last: HashMap<u32, Light> = HashMap::new();
    for request in [40, 43, 100, 70, 400, 12, 200] {
        let lights = update(&mut tree, &map, request);
        for light in &lights {
            // The id is 4 * 4^order + ipix: without its two lowest bits it is the id of the parent quad.
            let ancestors = (1..=order).map(|k| light.id >> (2 * k)).filter(|id| *id >= 4);
            let split_from = ancestors.into_iter().find(|id| last.contains_key(id));
            match last.get(&light.id) {
                Some(old) => assert_eq!((light.age, light.parent), (old.age + 1, old.parent)),
                None => assert_eq!((light.age, light.parent), (0, split_from), "{light:?}"),
            }
        }
        last = lights.iter().map(|l| (l.id, *l)).collect();
    }
}

#[test]
fn trees_with_equal_histories_give_equal_lights() {
    let maps: Vec<_> = (0..5).map(|seed| random(Domain::Hemisphere, 4, seed)).collect();
    let run = || {
        let mut tree = tree(Parameters { threshold: 0.2, ..Parameters::JITTER }, Domain::Hemisphere, 4, 64);
        maps.iter().map(|map| update(&mut tree, map, 64)).collect::<Vec<_>>()
    };
    assert_eq!(run(), run());
}

#[test]
fn lights_of_a_hemisphere_are_above_the_horizon() {
    for spread in [0.0, 0.5, 1.0] {
        let placement = Placement::Jitter { spread };
        for parameters in [Parameters::CENTROID, Parameters { placement, ..Parameters::JITTER }] {
            let mut tree = tree(parameters, Domain::Hemisphere, 6, 2000);
            for seed in 0..5 {
                for request in [8, 50, 2000] {
                    let lights = update(&mut tree, &random(Domain::Hemisphere, 6, seed), request);
                    let lowest = lights.iter().map(|l| l.direction.z).fold(f32::INFINITY, f32::min);
                    // A jitter without spread is the quad's centre, which may lie on the horizon.
                    assert!(lowest > 0.0 || (spread == 0.0 && lowest > -1e-7), "{parameters:?}: {lowest}");
                }
            }
        }
    }
}

#[test]
fn jittered_lights_are_inside_their_quads_and_distinct() {
    let order = 6;
    let map = random(Domain::Sphere, order, 7);
    let mut tree = tree(Parameters::JITTER, Domain::Sphere, order, 3000);
    let mut offsets = Vec::new();
    for light in update(&mut tree, &map, 3000) {
        let order = (light.id.ilog2() / 2 - 1) as u8;
        let ipix = light.id - (4 << (2 * order));
        assert_eq!(healpix::ipix(order, light.direction.as_dvec3()), ipix, "{light:?}");
        let side = healpix::solid_angle(order).sqrt();
        offsets.push(light.direction.as_dvec3().distance(healpix::centre(order, ipix)) / side);
    }
    // The positions are uniform over a square of half the quad's width, whose mean distance from the centre is 0.3826 of 0.5.
    let mean = offsets.iter().sum::<f64>() / offsets.len() as f64;
    assert!((mean - 0.191).abs() < 0.02, "{mean}");
}

#[test]
fn centroids_are_the_mean_directions_of_their_quads() {
    // Two texels of face 0; the other eleven faces have one light each.
    let map = lit(Domain::Sphere, 3, |i| grey(f32::from(i == 40 || i == 41 || i >= 64)));
    let mut tree = tree(Parameters::CENTROID, Domain::Sphere, 3, 100);
    let expected = (healpix::centre(3, 40) + healpix::centre(3, 41)).normalize().as_vec3();
    let lights = update(&mut tree, &map, 12);
    assert_eq!(lights.len(), 12);
    assert!((lights[0].direction - expected).length() < 1e-6);
    // For two points 2 a apart, R = cos a = (1 + cos r) / 2.
    let half = healpix::centre(3, 40).angle_between(healpix::centre(3, 41)) / 2.0;
    let radius = (2.0 * half.cos() - 1.0).acos().to_degrees();
    assert!((f64::from(lights[0].radius_deg) - radius).abs() < 0.01, "{} {radius}", lights[0].radius_deg);
}

#[test]
fn single_lit_texel_gives_one_light() {
    let order = 7;
    for ipix in [0u32, 12_345, 120_000] {
        let map = lit(Domain::Sphere, order, |i| grey(f32::from(i == ipix)));
        let mut tree = tree(Parameters::CENTROID, Domain::Sphere, order, 1000);
        for request in [12, 15, 33, 1000] {
            let lights = update(&mut tree, &map, request);
            assert_eq!(lights.len(), 1);
            assert_eq!(lights[0].irradiance, [1.0; 3]);
            let d = lights[0].direction.as_dvec3();
            assert!(d.distance(healpix::centre(order, ipix)) < 1e-6 && lights[0].radius_deg < 0.1);
        }
    }
}

#[test]
fn maps_without_light_give_no_lights() {
    for domain in [Domain::Sphere, Domain::Hemisphere] {
        let mut tree = tree(Parameters::CENTROID, domain, 4, 64);
        update(&mut tree, &random(domain, 4, 1), 64);
        assert_eq!(update(&mut tree, &dark(domain, 4), 64), []);
        assert_eq!(update(&mut tree, &random(domain, 4, 1), 64).iter().map(|l| l.age).max(), Some(0));
        assert_eq!(update(&mut tree, &random(domain, 4, 1), 0), []);
    }
}

#[test]
fn centroids_do_not_depend_on_the_unit_of_light() {
    let expected: Vec<_> = {
        let mut tree = tree(Parameters::CENTROID, Domain::Sphere, 4, 64);
        update(&mut tree, &random(Domain::Sphere, 4, 9), 64).iter().map(|l| (l.id, l.direction)).collect()
    };
    // The factors are powers of two, so that rounding is equal.
    for unit in [2f32.powi(-80), 2f32.powi(-60), 2f32.powi(60), 2f32.powi(80)] {
        let mut rng = seeded(9);
        let map =
            lit(Domain::Sphere, 4, |_| [(); 3].map(|()| unit * 10f32.powf(rng.random_range(-3.0..1.0))));
        let mut tree = tree(Parameters::CENTROID, Domain::Sphere, 4, 64);
        let found: Vec<_> = update(&mut tree, &map, 64).iter().map(|l| (l.id, l.direction)).collect();
        assert_eq!(found, expected, "unit {unit}");
    }
}

#[test]
fn bits_one_byte_short_are_refused() {
    // Quads of orders 0 to 2 of the sphere: 12 + 48 + 192 = 252, in 32 bytes.
    assert_eq!(interior_len(Domain::Sphere, Order::saturating(3)), 32);
    assert_eq!(interior_len(Domain::Sphere, Order::saturating(0)), 0);
    let new = |a: usize, b: usize| {
        let bits = [vec![0u8; a], vec![0u8; b]];
        let heap = vec![Leaf::default(); 20];
        Q2Tree::try_new(
            Parameters::CENTROID,
            MapShape { domain: Domain::Sphere, order: Order::saturating(3) },
            bits,
            heap,
            vec![Light::default(); 20],
            vec![Past::default(); 20],
        )
        .map(|_| ())
    };
    assert_eq!(new(32, 32), Ok(()));
    assert_eq!(new(31, 32), Err(TooSmall { needed: 32, lent: 31 }));
    assert_eq!(new(32, 31), Err(TooSmall { needed: 32, lent: 31 }));
    // A map finer than the bit sets gives no lights.
    let mut coarse = tree(Parameters::CENTROID, Domain::Sphere, 3, 64);
    assert_eq!(update(&mut coarse, &random(Domain::Sphere, 4, 1), 64), []);
    assert_eq!(update(&mut coarse, &random(Domain::Sphere, 2, 1), 64).len(), 63);
}
