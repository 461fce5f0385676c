//! Tests of the scores under skies whose irradiance has a closed form.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use super::receiver::{OPEN, SHADOWED, fib, open, shadowed};
use super::stability::*;
use super::vector::{angle_deg, dot, norm, unit};
use super::*;
use crate::env::{EnvMap, direction};

fn sky(radiance: impl Fn([f64; 3]) -> f64) -> EnvMap {
    EnvMap::from_fn(128, 64, |d| [radiance(d) as f32; 3])
}

fn one_texel(row: usize, column: usize) -> EnvMap {
    let mut texels = vec![[0.0; 3]; 128 * 64];
    texels[row * 128 + column] = [1000.0, 500.0, 250.0];
    EnvMap::new(128, 64, texels)
}

/// Returns one light per lit texel, a set without error.
fn texel_lights(map: &EnvMap, domain: Domain) -> LitSet {
    let grid = TexelGrid::new(map, domain);
    let lit = |(k, (direction, irradiance))| Lit { direction, irradiance, radius_deg: 0.0, id: k as u32 };
    grid.fluxes(map).enumerate().map(lit).collect::<Vec<_>>().into()
}

fn light(direction: [f64; 3], energy: f64, id: u32) -> Lit {
    Lit { direction, irradiance: [energy; 3], radius_deg: 0.0, id }
}

#[test]
fn the_fibonacci_lattice_has_the_documented_points() {
    // k = 0 and 1 of 4: z = 3/4 and 1/4, phi = 0 and 2 pi 0.618... = 3.883222 rad.
    let [a, b] = [fib(0, 4), fib(1, 4)];
    assert!(norm([a[0] - 0.4375f64.sqrt(), a[1], a[2] - 0.75]) < 1e-15);
    let r = 0.9375f64.sqrt();
    assert!(
        norm([
            b[0] - r * 3.883_222_077_450_933f64.cos(),
            b[1] - r * 3.883_222_077_450_933f64.sin(),
            b[2] - 0.25
        ]) < 1e-12
    );
}

#[test]
fn shadowed_probes_have_cones_of_10_to_60_degrees() {
    let mut axes = std::collections::HashSet::new();
    for k in 0..SHADOWED {
        let probe = shadowed(k);
        let half_angle_deg = probe.cos_half_angle.acos().to_degrees();
        assert!((10.0..60.0).contains(&half_angle_deg));
        axes.insert((197 * k + 101) % SHADOWED);
        assert_eq!(probe.weight(probe.axis), 0.0, "inside the cone");
    }
    assert_eq!(axes.len(), SHADOWED, "197 is prime to 512: every axis is used once");
    // k = 0: half-angle 10 + 50 x 0.3774388331233463 degrees round point 101 of the lattice.
    assert!((shadowed(0).cos_half_angle.acos().to_degrees() - 28.871_941_656_167_32).abs() < 1e-9);
    assert_eq!(shadowed(0).axis, fib(101, SHADOWED));
}

#[test]
fn constant_sky_gives_pi_on_every_open_probe() {
    let reference = Reference::new(&sky(|_| 1.0), Domain::Sphere);
    assert!((reference.total() - 4.0 * PI).abs() < 1e-9);
    for e in reference.open() {
        assert!((e - PI).abs() < 2e-3, "{e}");
    }
}

#[test]
fn constant_hemisphere_gives_half_of_one_plus_the_cosine() {
    // A normal at angle t from the zenith sees the upper hemisphere with E = pi (1 + cos t) / 2.
    for height in [64, 63] {
        let map = EnvMap::from_fn(128, height, |_| [1.0; 3]);
        let reference = Reference::new(&map, Domain::Hemisphere);
        assert!((reference.total() - TAU).abs() < 1e-9, "{height} rows: {}", reference.total());
        for (k, e) in reference.open().iter().enumerate() {
            let expected = PI * (1.0 + open(k).normal[2]) / 2.0;
            assert!((e - expected).abs() < 4e-3, "{height} rows, probe {k}: {e} against {expected}");
        }
    }
}

#[test]
fn shadow_on_the_normal_takes_sine_squared_of_its_half_angle() {
    // Constant sky and a cone of half-angle a around the normal: E = pi (1 - sin^2 a) = pi cos^2 a. The receiver whose axis is nearest its
    // normal is measured, where the cone stays inside of the upper half.
    let near = |k: &usize| angle_deg(shadowed(*k).normal, shadowed(*k).axis);
    let k = (0..SHADOWED).min_by(|a, b| near(a).total_cmp(&near(b))).unwrap();
    let (probe, tilt) = (shadowed(k), near(&k).to_radians());
    assert!(tilt + probe.cos_half_angle.acos() < FRAC_PI_2);
    // The projected area of a cap tilted by t is pi sin^2 a cos t.
    let blocked = PI * (1.0 - probe.cos_half_angle.powi(2)) * tilt.cos();
    let reference = Reference::new(&EnvMap::from_fn(512, 256, |_| [1.0; 3]), Domain::Sphere);
    assert!((reference.shadowed()[k] - (PI - blocked)).abs() < 5e-3);
}

#[test]
fn cosine_lobe_has_its_closed_form() {
    // L = max(0, z): on +Z the integral is 2 pi / 3; for a normal at angle t from +Z it is
    // (2/3) (sin t + (pi - t) cos t).
    let reference = Reference::new(&EnvMap::from_fn(512, 256, |d| [d[2].max(0.0) as f32; 3]), Domain::Sphere);
    assert!((reference.total() - PI).abs() < 1e-3);
    for (k, e) in reference.open().iter().enumerate() {
        let t = angle_deg(open(k).normal, [0.0, 0.0, 1.0]).to_radians();
        let expected = 2.0 / 3.0 * (t.sin() + (PI - t) * t.cos());
        assert!((e - expected).abs() < 1e-3, "probe {k}: {e} against {expected}");
    }
    assert!((reference.open()[0] - 2.0 * PI / 3.0).abs() < 3e-3, "the first normal is 3 degrees from +Z");
}

#[test]
fn bright_texel_is_a_point_light() {
    let (row, column) = (20, 37);
    let map = one_texel(row, column);
    let reference = Reference::new(&map, Domain::Sphere);
    let d = direction(128, 64, row, column);
    let solid_angle = ((row as f64 * PI / 64.0).cos() - ((row + 1) as f64 * PI / 64.0).cos()) * TAU / 128.0;
    let flux = (0.2126 * 1000.0 + 0.7152 * 500.0 + 0.0722 * 250.0) * solid_angle;
    for k in 0..OPEN {
        let expected = flux * dot(open(k).normal, d).max(0.0);
        assert!((reference.open()[k] - expected).abs() < 1e-12 * flux);
    }
    for k in 0..SHADOWED {
        let hidden = angle_deg(shadowed(k).axis, d) < shadowed(k).cos_half_angle.acos().to_degrees();
        let expected = if hidden { 0.0 } else { flux * dot(shadowed(k).normal, d).max(0.0) };
        assert!((reference.shadowed()[k] - expected).abs() < 1e-12 * flux, "probe {k}");
    }
}

#[test]
fn one_light_per_texel_has_no_error() {
    for domain in [Domain::Sphere, Domain::Hemisphere] {
        let map = sky(|d| 1.0 + d[0] + 3.0 * d[2].max(0.0));
        let score = Reference::new(&map, domain).score(&texel_lights(&map, domain));
        assert!(score.open < 1e-12 && score.shadowed < 1e-12 && score.energy < 1e-12, "{score:?}");
    }
}

#[test]
fn a_scaled_set_has_the_error_of_its_scale() {
    // Every E_set is 1.25 E_ref: the energy error is 1/4 and the open one sqrt(mean E^2) / 4 mean E.
    let map = sky(|d| 1.0 + d[1]);
    let mut set = texel_lights(&map, Domain::Sphere);
    set.lights.iter_mut().for_each(|light| light.irradiance = light.irradiance.map(|v| 1.25 * v));
    let score = Reference::new(&map, Domain::Sphere).score(&set);
    // E(n) = pi + (2 pi / 3) n_y, so sqrt(mean E^2) / mean E = sqrt(1 + 4/27).
    assert!((score.energy - 0.25).abs() < 1e-9);
    assert!((score.open - 0.25 * (1.0 + 4.0 / 27.0f64).sqrt()).abs() < 2e-4, "{score:?}");
}

#[test]
fn single_light_for_a_constant_sky_has_its_closed_form() {
    // E_set = 4 pi max(0, z), E_ref = pi: the mean square is 16 pi^2 / 6 - 2 pi^2 + pi^2 = (5/3) pi^2.
    let reference = Reference::new(&sky(|_| 1.0), Domain::Sphere);
    let score = reference.score(&vec![light([0.0, 0.0, 1.0], 4.0 * PI, 0)].into());
    assert!((score.open - (5.0f64 / 3.0).sqrt()).abs() < 2e-3, "{score:?}");
    assert!(score.energy < 1e-9);
}

#[test]
fn ambient_alone_reproduces_a_smooth_sky() {
    // L = 1 + z / 2 is c00 = 2 sqrt(pi) and c10 = (1/2) sqrt(4 pi / 3).
    let map = sky(|d| 1.0 + 0.5 * d[2]);
    let mut sh = [[0.0; 3]; 9];
    sh[0] = [2.0 * PI.sqrt(); 3];
    sh[2] = [0.5 * (4.0 * PI / 3.0).sqrt(); 3];
    let set = LitSet { lights: Vec::new(), ambient_sh: Some(sh) };
    for domain in [Domain::Sphere, Domain::Hemisphere] {
        let score = Reference::new(&map, domain).score(&set);
        assert!(score.open < 1e-6 && score.shadowed < 1e-6 && score.energy < 1e-6, "{domain:?}: {score:?}");
    }
}

#[test]
fn the_hemisphere_ignores_light_below_the_horizon() {
    let map = sky(|d| if d[2] < 0.0 { 100.0 } else { 1.0 });
    let above = Reference::new(&map, Domain::Hemisphere);
    assert!((above.total() - TAU).abs() < 1e-9);
    let mut set = texel_lights(&map, Domain::Hemisphere);
    set.lights.push(light([0.0, 0.0, -1.0], 5.0, 9));
    assert!(above.score(&set).energy < 1e-12, "a light below the horizon does not count");
}

#[test]
fn on_a_black_map_a_black_set_has_error_0_and_a_lit_set_an_infinite_one() {
    let reference = Reference::new(&sky(|_| 0.0), Domain::Sphere);
    assert_eq!(
        reference.score(&LitSet::default()),
        Score { open: 0.0, shadowed: 0.0, soft_open: 0.0, soft_shadowed: 0.0, energy: 0.0 }
    );
    let lit = reference.score(&vec![light([0.0, 0.0, 1.0], 1.0, 0)].into());
    let none = f64::INFINITY;
    assert_eq!(lit, Score { open: none, shadowed: none, soft_open: none, soft_shadowed: none, energy: none });
}

#[test]
fn flicker_excludes_the_change_of_the_scene() {
    // A constant scene under one light with 1, 1 and 1.5 times the true energy.
    let map = one_texel(5, 5);
    let first = Reference::new(&map, Domain::Sphere);
    let references = [first.clone(), first.following(&map), first.clone()];
    let perfect = texel_lights(&map, Domain::Sphere);
    let mut brighter = perfect.clone();
    brighter.lights.iter_mut().for_each(|l| l.irradiance = l.irradiance.map(|v| 1.5 * v));
    let flicker = flicker(&references, &[perfect.clone(), perfect, brighter], Reading::Points);
    let e = first.shadowed();
    let expected = 0.5 * (e.iter().map(|v| v * v).sum::<f64>() / e.len() as f64).sqrt() / first.shadowed_mu();
    assert_eq!(flicker[0], 0.0);
    assert!((flicker[1] - expected).abs() < 1e-12);
    // A scene with the same change does not count as flicker.
    let double = EnvMap::new(128, 64, map.texels().iter().map(|t| t.map(|v| 2.0 * v)).collect());
    let sets = [texel_lights(&map, Domain::Sphere), texel_lights(&double, Domain::Sphere)];
    assert!(
        stability::flicker(&[first.clone(), first.following(&double)], &sets, Reading::Points)[0] < 1e-12
    );
}

#[test]
fn unwarranted_change_counts_only_receivers_that_cannot_see_the_source() {
    let (dark, lit) = (one_texel(5, 5), {
        let mut texels = one_texel(5, 5).texels().to_vec();
        texels[60 * 128 + 7] = [1000.0; 3];
        EnvMap::new(128, 64, texels)
    });
    let before = Reference::new(&dark, Domain::Sphere);
    let after = before.following(&lit);
    let (was, is) = (texel_lights(&dark, Domain::Sphere), texel_lights(&lit, Domain::Sphere));
    assert_eq!(
        unwarranted_change(
            ScoredFrame { reference: &before, set: &was },
            ScoredFrame { reference: &after, set: &is }
        ),
        Some(0.0)
    );
    // A sampler that creates a light of unit energy at the zenith when the source is switched on changes the receivers that see the zenith
    // and not the source.
    let mut leaky = is.clone();
    leaky.lights.push(light([0.0, 0.0, 1.0], 1.0, 9999));
    let blind = |k: &usize| shadowed(*k).weight(direction(128, 64, 60, 7)) == 0.0;
    let seen: Vec<f64> = (0..SHADOWED).filter(blind).map(|k| shadowed(k).weight([0.0, 0.0, 1.0])).collect();
    let expected = (seen.iter().map(|v| v * v).sum::<f64>() / seen.len() as f64).sqrt() / after.shadowed_mu();
    let found = unwarranted_change(
        ScoredFrame { reference: &before, set: &was },
        ScoredFrame { reference: &after, set: &leaky },
    )
    .unwrap();
    assert!((found - expected).abs() < 1e-9, "{found} against {expected}");
}

#[test]
fn motion_noise_and_churn_match_lights_by_id() {
    let at = |deg: f64| [deg.to_radians().sin(), 0.0, deg.to_radians().cos()];
    let sets: Vec<LitSet> = vec![
        vec![light(at(0.0), 1.0, 1), light(at(50.0), 1.0, 2)].into(),
        vec![light(at(51.0), 1.0, 2), light(at(3.0), 1.0, 1)].into(),
        vec![light(at(3.0), 1.0, 1), light(at(90.0), 1.0, 7), light(at(91.0), 1.0, 8)].into(),
    ];
    assert!((motion_noise_deg(&sets).unwrap() - 4.0 / 3.0).abs() < 1e-9, "3, 1 and 0 degrees");
    assert_eq!(churn(&sets), [0.0, 3.0]);
    assert_eq!(motion_noise_deg(&sets[..1]), None);
}

#[test]
fn step_response_counts_the_frame_of_the_change() {
    let errors = [0.02, 0.02, 0.5, 0.2, 0.025, 0.02, 0.02, 0.02, 0.02, 0.02];
    assert_eq!(step_response(&errors, 2), Some(3));
    assert_eq!(step_response(&[0.0, 0.0, 0.0], 1), Some(1));
    assert_eq!(step_response(&errors, 10), None);
}

#[test]
fn tracking_lag_is_the_age_of_the_sets_or_its_mean() {
    // A disc of 20 degrees radius that moves by 3 degrees per frame.
    let disc = |t: usize| {
        let phi = (3.0 * t as f64 - 36.0).to_radians();
        let middle = unit([phi.cos(), phi.sin(), 0.5]).expect("a direction");
        sky(|d| f64::from(u8::from(angle_deg(d, middle) < 20.0)))
    };
    let maps: Vec<EnvMap> = (0..24).map(disc).collect();
    let first = Reference::new(&maps[0], Domain::Sphere);
    let references: Vec<Reference> = maps.iter().map(|map| first.following(map)).collect();
    let lag = |age: fn(usize) -> usize| {
        let sets =
            (0..24).map(|t| texel_lights(&maps[t - age(t).min(t)], Domain::Sphere)).collect::<Vec<_>>();
        tracking_lag(&references, &sets).expect("a lag")
    };
    assert_eq!(lag(|_| 0), 0.0);
    // Sets of bursts of three frames, of which the first shows the light, and of a sliding window.
    for (found, expected) in [(lag(|_| 5), 5.0), (lag(|t| 2 + t % 3), 3.0), (lag(|t| t % 3), 1.0)] {
        assert!((found - expected).abs() < 0.2, "{found}, expected {expected}");
    }
    let between = lag(|t| 2 + t % 2);
    assert!((between - 2.5).abs() < 0.3, "{between} of sets of two and three frames");
    assert_eq!(tracking_lag(&references[..12], &[]), None);
}

#[test]
fn transit_energy_is_the_light_in_empty_sky() {
    let map = one_texel(32, 64);
    let grid = TexelGrid::new(&map, Domain::Sphere);
    let source = LightSource { direction: direction(128, 64, 32, 64), radius_deg: 1.0 };
    let energy: f64 = grid.luminous(&map).map(|(_, flux)| flux).sum();
    let near = vec![light(source.direction, energy, 0)].into();
    let away =
        vec![light(source.direction, 0.75 * energy, 0), light([0.0, 0.0, 1.0], 0.25 * energy, 1)].into();
    let stray: Vec<f64> = [near, away].iter().map(|set| stray_energy(&grid, &map, set, &[source])).collect();
    assert!(stray[0] < 1e-12);
    assert!((transit_energy(&stray, energy) - 0.25).abs() < 1e-12);
}

#[test]
fn tracking_error_is_the_angle_between_the_means() {
    let map = one_texel(32, 64);
    let (grid, d) = (TexelGrid::new(&map, Domain::Sphere), direction(128, 64, 32, 64));
    // Two equal lights 4 degrees apart, one at the source: their mean is 2 degrees from it.
    let phi = d[1].atan2(d[0]) + 4.0f64.to_radians();
    let r = (1.0 - d[2] * d[2]).sqrt();
    let beside = unit([r * phi.cos(), r * phi.sin(), d[2]]).unwrap();
    let error = |lights: Vec<Lit>| tracking_error_deg(&grid, &map, &lights.into(), d).unwrap();
    assert!((error(vec![light(d, 1.0, 0), light(beside, 1.0, 1)]) - 2.0).abs() < 0.01);
    assert_eq!(error(vec![light([0.0, 0.0, 1.0], 1.0, 0)]), NEIGHBOURHOOD_DEG);
    assert_eq!(tracking_error_deg(&grid, &map, &LitSet::default(), [0.0, 0.0, 1.0]), None);
}

#[test]
fn parsimony_is_the_least_number_within_the_tolerance() {
    let points = [(64, 0.02), (16, 0.08), (32, 0.04), (128, 0.01)];
    assert_eq!(parsimony(&points, 0.05), Some(32));
    assert_eq!(parsimony(&points, 0.001), None);
}

#[test]
fn the_core_has_the_same_receivers() {
    use hemilux_core::receiver;
    let near = |a: [f64; 3], b: glam::Vec3| (0..3).all(|i| (a[i] - f64::from(b[i])).abs() < 1e-6);
    assert_eq!((receiver::OPEN, receiver::SHADOWED), (OPEN, SHADOWED));
    for k in 0..OPEN {
        assert!(near(open(k).normal, receiver::open(k)), "open {k}");
    }
    for k in 0..SHADOWED {
        let (ours, core) = (shadowed(k), receiver::shadowed(k));
        assert!(near(ours.normal, core.normal) && near(ours.axis, core.axis), "shadowed {k}");
        assert!((ours.cos_half_angle - core.half_angle.cos()).abs() < 1e-12, "shadowed {k}");
    }
}
