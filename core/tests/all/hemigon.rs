//! The samplers `hemigon` and `hemigon-fir`: energy, ids, invalid maps, and a lamp that is switched.

use crate::common::{Pcg64Mcg, RngExt, dark, direction, off, seeded};
use glam::Vec3;
use hemilux_core::SamplerKind;
use hemilux_core::TooSmall;
use hemilux_core::color::luminance;
use hemilux_core::healpix::Domain;
use hemilux_core::light::Light;
use hemilux_core::polar::{Grid, LatLongView};
use hemilux_core::sampler::hemigon::fir::{Fir, Parameters};
use hemilux_core::sampler::hemigon::follow::Follow;
use hemilux_core::sampler::hemigon::inversion::{Inversion, Ring, rings_len};
use hemilux_core::sampler::hemigon::kalman::{self, Gated, PathFilter};
use hemilux_core::sampler::hemigon::{Hemigon, MAX_LIGHTS};
use hemilux_core::sampler::{Map, Request, Sampler};
use std::collections::HashSet;

const POLAR: Grid = Grid::POLAR;
const SPHERE: Grid = Grid { width: 64, height: 32, domain: Domain::Sphere };
const ODD_SPHERE: Grid = Grid { width: 9, height: 7, domain: Domain::Sphere };
const ODD: Grid = Grid { width: 7, height: 5, domain: Domain::Hemisphere };
const GRIDS: [Grid; 4] = [POLAR, SPHERE, ODD_SPHERE, ODD];

type Texels = Vec<[f32; 3]>;

fn with<F: Follow + 'static>(grid: &Grid, filter: F, lights: usize) -> Box<dyn Sampler> {
    let (texel, ring) = (vec![0.0; grid.len()], vec![Ring::default(); rings_len(grid)]);
    let inversion = Inversion::try_new(grid, texel, ring).expect("room enough");
    let (lives, lights) = (vec![0; 2 * lights], vec![Light::default(); lights]);
    Box::new(Hemigon::try_new(inversion, filter, lives, lights).expect("room enough"))
}

fn hemigon(grid: &Grid, lights: usize) -> Box<dyn Sampler> {
    let tracks = vec![PathFilter::default(); 2 * lights];
    let filter = Gated::try_new(kalman::Parameters::LIGHTS, lights, tracks).expect("room enough");
    with(grid, filter, lights)
}

fn hemigon_fir(grid: &Grid, lights: usize, parameters: &Parameters) -> Box<dyn Sampler> {
    let paths = vec![Vec3::ZERO; 2 * lights * parameters.taps];
    with(grid, Fir::try_new(parameters, lights, paths).expect("room enough"), lights)
}

fn published(grid: &Grid, lights: usize) -> Box<dyn Sampler> {
    hemigon_fir(grid, lights, &Parameters::default())
}

fn update(sampler: &mut dyn Sampler, grid: Grid, texels: &[[f32; 3]], lights: usize) -> Vec<Light> {
    let pyramid = dark(Domain::Sphere, 0);
    let map = Map { pyramid: pyramid.view(), polar: LatLongView { grid, texels } };
    sampler.update(&map, &Request::of_lights(lights)).lights.to_vec()
}

/// Returns a map whose texels have the radiance `l(row, column)`.
fn energies(grid: Grid, mut l: impl FnMut(usize, usize) -> [f32; 3]) -> Texels {
    (0..grid.len())
        .map(|i| l(i / grid.width, i % grid.width).map(|v| v * grid.solid_angle(i / grid.width) as f32))
        .collect()
}

fn total(rgb: impl Iterator<Item = [f32; 3]>) -> [f64; 3] {
    rgb.fold([0.0; 3], |sum, v| core::array::from_fn(|c| sum[c] + f64::from(v[c])))
}

/// Returns the energy of the texels of a map; non-finite and negative numbers count as 0.
fn light_in(texels: &[[f32; 3]]) -> [f64; 3] {
    total(texels.iter().map(|t| t.map(|v| if v > 0.0 { v.min(1e29) } else { 0.0 })))
}

fn rough(rng: &mut Pcg64Mcg) -> [f32; 3] {
    [(); 3].map(|()| 10f32.powf(rng.random_range(-2.0..2.0)))
}

fn check(lights: &[Light], texels: &[[f32; 3]], what: &str) {
    let (found, expected) = (total(lights.iter().map(|l| l.irradiance)), light_in(texels));
    for (found, expected) in found.into_iter().zip(expected) {
        assert!((found - expected).abs() <= 1e-6 * expected, "{what}: {found} of {expected}");
    }
    let ids: HashSet<u32> = lights.iter().map(|l| l.id).collect();
    assert!(ids.len() == lights.len() && !ids.contains(&0), "{what}: ids");
    for light in lights {
        assert!((light.direction.length() - 1.0).abs() < 1e-5, "{what}: {light:?}");
        assert!(light.irradiance.iter().all(|v| v.is_finite() && *v >= 0.0), "{what}: {light:?}");
        assert!((0.0..=180.0).contains(&light.radius_deg), "{what}: {light:?}");
    }
}

#[test]
fn names_and_limits_are_those_documented() {
    let (mut a, mut b) = (hemigon(&ODD, 10), published(&ODD, 10));
    assert_eq!((a.kind(), b.kind()), (SamplerKind::Hemigon, SamplerKind::HemigonFir));
    assert!(a.needs_polar() && b.needs_polar());
    let texels = energies(ODD, |_, _| [1.0; 3]);
    for sampler in [&mut a, &mut b] {
        assert_eq!(update(&mut **sampler, ODD, &texels, 99).len(), 10);
        assert_eq!(update(&mut **sampler, ODD, &texels, 0), []);
    }
    let mut many = hemigon(&SPHERE, MAX_LIGHTS + 5);
    let texels = energies(SPHERE, |row, _| [row as f32, 1.0, 0.5]);
    let lights = update(&mut *many, SPHERE, &texels, 50_000);
    assert_eq!(lights.len(), MAX_LIGHTS);
    check(&lights, &texels, "8192 lights");
}

#[test]
fn buffers_one_short_are_refused() {
    let tracks =
        |n| Gated::try_new(kalman::Parameters::LIGHTS, 4, vec![PathFilter::default(); n]).map(|_| ());
    assert_eq!((tracks(8), tracks(7)), (Ok(()), Err(TooSmall { needed: 8, lent: 7 })));
    let paths = |n| Fir::try_new(&Parameters::default(), 4, vec![Vec3::ZERO; n]).map(|_| ());
    assert_eq!((paths(56), paths(55)), (Ok(()), Err(TooSmall { needed: 56, lent: 55 })));
    let sampler = |tracks, lives| {
        let filter = Gated::try_new(kalman::Parameters::LIGHTS, 0, vec![PathFilter::default(); tracks]);
        let inversion = Inversion::try_new(&ODD, vec![0.0; 35], vec![Ring::default(); 5]).expect("room");
        let lights = vec![Light::default(); 4];
        Hemigon::try_new(inversion, filter.expect("room"), vec![0; lives], lights).map(|_| ())
    };
    assert_eq!(sampler(8, 8), Ok(()));
    assert_eq!(sampler(7, 8), Err(TooSmall { needed: 8, lent: 7 }));
    assert_eq!(sampler(8, 7), Err(TooSmall { needed: 8, lent: 7 }));
}

#[test]
fn lights_are_equally_luminous_and_keep_every_channel() {
    let mut rng = seeded(81);
    // Colours within an octave, as in real maps, and channels that differ by four decades.
    for (grid, (decades, within)) in GRIDS.into_iter().flat_map(|g| [(g, (0.3, 1e-3)), (g, (4.0, 0.2))]) {
        let texels = energies(grid, |_, _| {
            let l = rough(&mut rng)[0];
            [(); 3].map(|()| l * 10f32.powf(rng.random_range(0.0..decades)))
        });
        for n in [1, 2, 7, 64, 1000] {
            let lights = update(&mut *hemigon(&grid, n), grid, &texels, n);
            assert_eq!(lights.len(), n);
            check(&lights, &texels, "rough");
            let y: Vec<f64> = lights.iter().map(|l| f64::from(luminance(l.irradiance))).collect();
            let mean = y.iter().sum::<f64>() / n as f64;
            let worst = y.iter().map(|y| off(*y, mean)).fold(0.0, f64::max);
            assert!(worst < within, "{grid:?} {n}: {worst}");
        }
    }
}

#[test]
fn energy_of_a_channel_that_no_light_samples_is_kept() {
    // One light, and a blue channel only in another texel than that of the light.
    let texels = energies(ODD, |row, column| [1.0, 0.5, if row + column == 0 { 1.0 } else { 0.0 }]);
    for n in [1, 3] {
        check(&update(&mut *hemigon(&ODD, n), ODD, &texels, n), &texels, "blue");
    }
}

#[test]
fn additional_light_leaves_existing_lights_in_place() {
    let mut rng = seeded(82);
    for grid in GRIDS {
        let texels = energies(grid, |_, _| rough(&mut rng));
        let mut sampler = hemigon(&grid, 200);
        let mut last: Vec<Light> = Vec::new();
        for n in (1..=200).chain((1..200).rev()) {
            let lights = update(&mut *sampler, grid, &texels, n);
            let (more, fewer) = if n > last.len() { (&lights, &last) } else { (&last, &lights) };
            assert_eq!(more.len(), fewer.len() + 1);
            for light in fewer {
                let same = more.iter().find(|l| l.id == light.id).expect("the light stays");
                assert!(same.direction.distance(light.direction) < 1e-6, "{n}");
            }
            last = lights;
        }
    }
}

#[test]
fn lights_are_divided_between_hemispheres_by_luminance() {
    for upper in [0.0, 0.01, 1.0, 3.0, 100.0] {
        let texels = energies(SPHERE, |row, _| [if row < 16 { upper } else { 1.0 }; 3]);
        for n in [1, 2, 16, 100] {
            let lights = update(&mut *hemigon(&SPHERE, n), SPHERE, &texels, n);
            let above = lights.iter().filter(|l| l.direction.z > 0.0).count();
            let exact = n as f64 * f64::from(upper) / f64::from(upper + 1.0);
            assert!((above as f64 - exact).abs() <= 0.5 + 1e-6, "{upper} {n}: {above}");
            assert!(lights.iter().all(|l| (l.direction.z > 0.0) == (l.id <= MAX_LIGHTS as u32)));
            assert!(lights.windows(2).all(|w| w[0].id < w[1].id), "lights are in the order of their ids");
        }
    }
}

#[test]
fn ids_stay_when_the_division_changes() {
    let mut sampler = hemigon(&SPHERE, 64);
    let mut last: Vec<Light> = Vec::new();
    for t in 0..100u8 {
        let texels = energies(SPHERE, |row, _| [if row < 16 { 1.0 + 0.05 * f32::from(t) } else { 3.0 }; 3]);
        let lights = update(&mut *sampler, SPHERE, &texels, 64);
        let old: HashSet<u32> = last.iter().map(|l| l.id).collect();
        let stay = lights.iter().filter(|l| old.contains(&l.id)).count();
        assert!(last.is_empty() || stay >= 63, "{t}: {stay}");
        let ages = lights.iter().filter(|l| l.age == u32::from(t)).count();
        assert!(ages >= 16, "{t}");
        last = lights;
    }
}

#[test]
fn division_at_a_rounding_boundary_is_stable_under_noise() {
    let mut rng = seeded(83);
    let mut sampler = hemigon(&SPHERE, 31);
    let mut shares = HashSet::new();
    for _ in 0..100 {
        let texels = energies(SPHERE, |_, _| [1.0 + rng.random_range(-0.05..0.05); 3]);
        let lights = update(&mut *sampler, SPHERE, &texels, 31);
        shares.insert(lights.iter().filter(|l| l.direction.z > 0.0).count());
    }
    assert_eq!(shares.len(), 1, "{shares:?}");
}

#[test]
fn all_lights_of_a_single_lit_texel_are_near_it() {
    for grid in GRIDS {
        for bright in [0, 5, grid.width - 1, grid.len() / 2, grid.len() - 1] {
            let mut texels = vec![[0.0; 3]; grid.len()];
            texels[bright] = [1.0, 2.0, 3.0];
            for mut sampler in [hemigon(&grid, 300), published(&grid, 300)] {
                let lights = update(&mut *sampler, grid, &texels, 300);
                assert_eq!(lights.len(), 300);
                check(&lights, &texels, "one texel");
                // Within the texel's rows, and one more row where the floor places a light in the neighbouring ring.
                let (row, rows) = (bright / grid.width, grid.theta(1));
                for light in &lights {
                    let theta = f64::from(light.direction.z.clamp(-1.0, 1.0)).acos();
                    let from = grid.theta(row) - rows - 1e-3;
                    assert!(theta > from && theta < grid.theta(row + 1) + rows + 1e-3, "{grid:?} {bright}");
                }
            }
        }
    }
}

#[test]
fn black_maps_give_no_lights_and_grey_ones_do() {
    for grid in GRIDS {
        for mut sampler in [hemigon(&grid, 64), published(&grid, 64)] {
            let grey = energies(grid, |_, _| [0.5; 3]);
            assert_eq!(update(&mut *sampler, grid, &vec![[0.0; 3]; grid.len()], 64), []);
            let lights = update(&mut *sampler, grid, &grey, 64);
            assert_eq!(lights.len(), 64);
            check(&lights, &grey, "grey");
            assert!(
                lights
                    .iter()
                    .all(|l| off(f64::from(l.irradiance[1]), f64::from(lights[0].irradiance[1])) < 1e-6)
            );
            assert_eq!(update(&mut *sampler, grid, &vec![[0.0; 3]; grid.len()], 64), []);
            // A map that exceeds the buffers counts as dark.
            assert_eq!(update(&mut *sampler, grid, &grey[1..], 64), []);
        }
    }
}

#[test]
fn a_map_of_one_texel_gives_lights() {
    for domain in [Domain::Sphere, Domain::Hemisphere] {
        let grid = Grid { width: 1, height: 1, domain };
        for mut sampler in [hemigon(&grid, 50), published(&grid, 50)] {
            let lights = update(&mut *sampler, grid, &[[3.0, 2.0, 1.0]], 50);
            assert_eq!(lights.len(), 50);
            check(&lights, &[[3.0, 2.0, 1.0]], "one texel");
            let above = lights.iter().filter(|l| l.direction.z > 0.0).count();
            assert_eq!(above, if domain == Domain::Sphere { 25 } else { 50 });
        }
    }
}

#[test]
fn negative_and_non_finite_texels_count_as_dark() {
    const HARD: [f32; 9] =
        [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, f32::MAX, f32::MIN, 1e-45, 1e-38, 1e29];
    let mut rng = seeded(84);
    for t in 0..400 {
        let grid = GRIDS[1 + t % 3];
        let mut hard =
            |lit: f64| if rng.random::<f64>() < lit { 1.0 } else { HARD[rng.random_range(0..HARD.len())] };
        let texels: Texels = (0..grid.len()).map(|_| [(); 3].map(|()| hard(0.9))).collect();
        for mut sampler in [hemigon(&grid, 20), published(&grid, 20)] {
            for _ in 0..3 {
                check(&update(&mut *sampler, grid, &texels, 20), &texels, "hard");
            }
        }
    }
}

#[test]
fn energy_is_exact_over_random_frames() {
    let mut rng = seeded(85);
    for grid in GRIDS {
        let mut sampler = hemigon(&grid, 300);
        let mut base = energies(grid, |_, _| rough(&mut rng));
        for frame in 0..300 {
            if frame % 7 == 0 {
                base = energies(grid, |_, _| rough(&mut rng));
            }
            let i = rng.random_range(0..grid.len());
            base[i] = rough(&mut rng);
            let n = rng.random_range(1..=300);
            let lights = update(&mut *sampler, grid, &base, n);
            assert_eq!(lights.len(), n);
            check(&lights, &base, "random");
        }
    }
}

/// Returns the map of a dim sky with 1 % noise and, if `lit`, a lamp with half of the light.
fn lamp(grid: Grid, rng: &mut Pcg64Mcg, lit: bool) -> Texels {
    energies(grid, |row, column| {
        let is_lamp = lit && (40..46).contains(&row) && (100..110).contains(&column);
        let noise = 1.0 + 0.01 * rng.random_range(-1.7..1.7);
        [if is_lamp { 350.0 } else { 1.0 } * noise; 3]
    })
}

/// Returns the energy-weighted fraction of the lights within 10 degrees of the lamp.
fn at_lamp(lights: &[Light]) -> f64 {
    let (theta, phi) = (POLAR.theta(43), POLAR.phi(105));
    let lamp =
        Vec3::new((theta.sin() * phi.cos()) as f32, (theta.sin() * phi.sin()) as f32, theta.cos() as f32);
    let near = lights.iter().filter(|l| l.direction.dot(lamp) > 10f32.to_radians().cos());
    near.map(|l| f64::from(luminance(l.irradiance))).sum()
}

#[test]
fn switched_lamp_is_followed_at_once_by_kalman_and_late_by_fir() {
    for (mut sampler, frames) in [(hemigon(&POLAR, 64), 1..=2), (published(&POLAR, 64), 5..=10)] {
        let mut rng = seeded(86);
        let mut energy = Vec::new();
        for t in 0..60 {
            let lights = update(&mut *sampler, POLAR, &lamp(POLAR, &mut rng, t >= 30), 64);
            energy.push(at_lamp(&lights));
        }
        let steady = energy[59];
        let found =
            energy[30..].iter().position(|e| off(*e, steady) < 0.1).expect("the energy becomes steady") + 1;
        println!("{}: {found} frames", sampler.kind());
        assert!(frames.contains(&found), "{}: {found} frames: {energy:?}", sampler.kind());
    }
}

/// Returns the RMS change of direction from frame to frame over lights and frames, degrees.
fn jitter(sampler: &mut dyn Sampler) -> f64 {
    let mut rng = seeded(87);
    let mut last: Vec<Light> = Vec::new();
    let (mut sum, mut count) = (0.0, 0.0);
    for t in 0..120 {
        let lights = update(sampler, POLAR, &lamp(POLAR, &mut rng, true), 64);
        if t > 30 {
            sum += lights
                .iter()
                .zip(&last)
                .map(|(a, b)| f64::from(a.direction.distance_squared(b.direction)))
                .sum::<f64>();
            count += 64.0;
        }
        last = lights;
    }
    (sum / count).sqrt().to_degrees()
}

#[test]
fn kalman_smooths_noise_as_well_as_the_fir() {
    let raw = jitter(&mut *hemigon_fir(&POLAR, 64, &Parameters { taps: 1, ..Parameters::default() }));
    let (kalman, fir) = (jitter(&mut *hemigon(&POLAR, 64)), jitter(&mut *published(&POLAR, 64)));
    println!("degrees a frame: raw {raw:.4}, fir {fir:.4}, kalman {kalman:.4}");
    assert!(kalman < 0.5 * raw && fir < 0.5 * raw, "{raw} {fir} {kalman}");
    assert!(kalman < 1.5 * fir, "{fir} {kalman}");
}

#[test]
fn fir_lights_sum_to_the_filtered_energy() {
    // The sky brightens from radiance 1 to 3; the expected factor is the sum of the newest coefficients.
    let kernel = hemilux_core::sampler::hemigon::fir::Kernel::new(&Parameters::default());
    let mut sampler = published(&ODD, 16);
    let sky = |l: f32| energies(ODD, |_, _| [l; 3]);
    for _ in 0..3 {
        update(&mut *sampler, ODD, &sky(1.0), 16);
    }
    let mut part = 0.0;
    for weight in kernel.weights() {
        part += weight;
        let lights = update(&mut *sampler, ODD, &sky(3.0), 16);
        let found = total(lights.iter().map(|l| l.irradiance))[0];
        let expected = light_in(&sky(1.0))[0] * (1.0 + 2.0 * part);
        assert!(off(found, expected) < 1e-6, "{found} {expected}");
    }
}

#[test]
fn fir_side_lobes_do_not_move_lights_across_the_horizon() {
    // The lamp of this test descends to the horizon and stops there; the filter overshoots.
    let sharp = Parameters { taps: 15, cutoff_hz: 3.0, frame_rate_hz: 10.0 };
    let mut sampler = hemigon_fir(&POLAR, 8, &sharp);
    for t in 0..40usize {
        let at = (4 * t).min(89);
        let texels = energies(POLAR, |row, column| [f32::from(u8::from(row == at && column < 20)); 3]);
        for light in update(&mut *sampler, POLAR, &texels, 8) {
            assert!(
                light.direction.z >= 0.0 && (light.direction.length() - 1.0).abs() < 1e-5,
                "{t}: {light:?}"
            );
        }
    }
}

#[test]
fn ages_increase_and_reset_restarts_them() {
    let texels = energies(SPHERE, |_, _| [1.0; 3]);
    let mut rng = seeded(88);
    for mut sampler in [hemigon(&SPHERE, 16), published(&SPHERE, 16)] {
        let mut ages =
            |n| update(&mut *sampler, SPHERE, &texels, n).iter().map(|l| l.age).collect::<Vec<_>>();
        assert_eq!((ages(2), ages(4), ages(2)), (vec![0, 0], vec![1, 0, 1, 0], vec![2, 2]));
        sampler.reset();
        let lights = update(&mut *sampler, SPHERE, &texels, 4);
        assert!(lights.iter().all(|l| l.age == 0 && l.parent.is_none()));
        // After a reset the lights equal those of a new sampler.
        let other = energies(SPHERE, |_, _| [direction(&mut rng).z.abs() as f32 + 0.1; 3]);
        sampler.reset();
        let fresh = if sampler.kind() == SamplerKind::Hemigon {
            hemigon(&SPHERE, 16)
        } else {
            published(&SPHERE, 16)
        };
        let mut pair = [sampler, fresh];
        let [a, b] = pair.each_mut().map(|s| update(&mut **s, SPHERE, &other, 16));
        assert_eq!(a, b);
    }
}
