//! Merging and selection of lights: energy, ids, centroids in closed form, and lights below a surface's horizon.

use crate::common::{RngExt, seeded};
use glam::Vec3;
use hemilux_core::light::Light;
use hemilux_core::thin::{Pair, facing, merge};
use std::collections::HashSet;

fn light(id: u32, direction: Vec3, y: f32) -> Light {
    Light { id, direction: direction.normalize(), irradiance: [y; 3], ..Light::default() }
}

fn random(count: u32, seed: u64) -> Vec<Light> {
    let mut rng = seeded(seed);
    let mut axis = || rng.random_range(-1.0..1.0f32);
    let directions: Vec<_> = (0..count).map(|_| Vec3::new(axis(), axis(), axis() + 1.5)).collect();
    (1..).zip(directions).map(|(id, d)| light(id, d, 10f32.powf(rng.random_range(-2.0..2.0)))).collect()
}

#[test]
fn merge_reaches_any_number_and_keeps_the_energy() {
    for count in [1u32, 2, 9, 64, 300, 2000] {
        for most in [1usize, 2, 8, 63, 64, 5000] {
            let before = random(count, u64::from(count));
            let mut after = before.clone();
            let n = merge(&mut after, most, &mut vec![Pair::default(); before.len()]).expect("room enough");
            assert_eq!(n, most.min(before.len()), "{count} to {most}");
            let sum = |lights: &[Light]| lights.iter().map(|l| f64::from(l.irradiance[1])).sum::<f64>();
            let (kept, all) = (sum(&after[..n]), sum(&before));
            assert!((kept - all).abs() < 1e-5 * all, "{count} to {most}: {kept} of {all}");
            let ids: HashSet<u32> = after[..n].iter().map(|l| l.id).collect();
            let known: HashSet<u32> = before.iter().map(|l| l.id).collect();
            assert!(ids.len() == n && ids.is_subset(&known), "{count} to {most}: ids are kept and unique");
            assert!(after[..n].iter().all(|l| (l.direction.length() - 1.0).abs() < 1e-5), "unit vectors");
        }
    }
    assert_eq!(merge(&mut random(5, 1), 0, &mut vec![Pair::default(); 5]), Ok(0));
}

#[test]
fn merged_light_is_at_the_centroid_and_keeps_the_brighter_id() {
    let mut lights = [
        light(7, Vec3::Z, 3.0),
        light(8, Vec3::new(0.1, 0.0, 1.0), 1.0),
        light(9, Vec3::new(-1.0, 0.0, 0.2), 2.0),
    ];
    let expected = (lights[0].direction * 3.0 + lights[1].direction).normalize();
    let n = merge(&mut lights, 2, &mut vec![Pair::default(); 3]).expect("room enough");
    assert_eq!((n, lights[0].id, lights[1].id), (2, 7, 9));
    assert!(lights[0].direction.distance(expected) < 1e-6, "{:?}", lights[0]);
    assert_eq!(lights[0].irradiance, [4.0; 3]);
    // The mean of two unit vectors has a length |m| in closed form; the cap with the same mean has R = (1 + cos a) / 2.
    let apart = 0.1f32.atan();
    let m = ((9.0 + 1.0 + 6.0 * apart.cos()) / 16.0f32).sqrt();
    let radius = (2.0 * m - 1.0).acos().to_degrees();
    assert!((lights[0].radius_deg - radius).abs() < 0.01, "{} and {radius}", lights[0].radius_deg);
}

#[test]
fn short_pair_buffer_is_refused_and_lights_are_unchanged() {
    let before = random(10, 3);
    let mut lights = before.clone();
    assert!(merge(&mut lights, 2, &mut vec![Pair::default(); 9]).is_err());
    assert_eq!(lights, before);
}

#[test]
fn lights_without_energy_or_direction_are_merged() {
    let mut lights = [light(1, Vec3::X, 0.0), light(2, Vec3::NEG_X, 0.0), light(3, Vec3::Y, f32::MAX)];
    let n = merge(&mut lights, 1, &mut vec![Pair::default(); 3]).expect("room enough");
    assert_eq!((n, lights[0].id), (1, 3));
    let mut opposite = [light(1, Vec3::X, 1.0), light(2, Vec3::NEG_X, 1.0)];
    merge(&mut opposite, 1, &mut vec![Pair::default(); 2]).expect("room enough");
    assert!((opposite[0].direction.length() - 1.0).abs() < 1e-6, "{:?}", opposite[0]);
}

#[test]
fn facing_keeps_the_lights_above_the_horizon_of_a_normal() {
    let at = |deg: f32| Vec3::new(deg.to_radians().sin(), 0.0, deg.to_radians().cos());
    let lights: Vec<_> =
        (1..).zip([0.0, 60.0, 89.0, 91.0, 120.0, 180.0]).map(|(id, a)| light(id, at(a), 1.0)).collect();
    let seen = |spread: f32| facing(&lights, Vec3::Z, spread.to_radians()).map(|l| l.id).collect::<Vec<_>>();
    assert_eq!(seen(0.0), [1, 2, 3]);
    assert_eq!(seen(10.0), [1, 2, 3, 4]);
    assert_eq!(seen(45.0), [1, 2, 3, 4, 5]);
    let wide = [Light { radius_deg: 5.0, ..lights[3] }];
    assert_eq!(facing(&wide, Vec3::Z, 0.0).count(), 1, "half of a wide light is above the horizon");
}
