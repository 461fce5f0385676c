//! Tests of the properties of every baseline, and of its errors on real maps.

use std::path::PathBuf;
use std::time::Instant;

use super::cells::{Cells, Flux, voronoi};
use super::sat::{Rect, Sat};
use super::*;
use crate::metrics::vector::{angle_deg, norm};
use crate::metrics::{Reference, Score, TexelGrid, holds};

fn room() -> EnvMap {
    // The map has a coloured background, a window across the phi seam, and a small lamp near the zenith.
    EnvMap::from_fn(96, 48, |d| {
        let window = angle_deg(d, [-0.8, 0.0, 0.6]) < 20.0;
        let lamp = angle_deg(d, [0.1, 0.2, 0.97]) < 6.0;
        let base = [0.2 + 0.1 * d[0] as f32, 0.3, 0.2 + 0.1 * d[2] as f32];
        base.map(|v| v + if window { 5.0 } else { 0.0 } + if lamp { 200.0 } else { 0.0 })
    })
}

fn one_texel() -> EnvMap {
    let mut texels = vec![[0.0; 3]; 96 * 48];
    texels[10 * 96 + 95] = [900.0, 600.0, 300.0];
    EnvMap::new(96, 48, texels)
}

fn rgb_sum(map: &EnvMap, domain: Domain) -> [f64; 3] {
    TexelGrid::new(map, domain)
        .fluxes(map)
        .fold([0.0; 3], |sum, (_, rgb)| std::array::from_fn(|i| sum[i] + rgb[i]))
}

fn assert_keeps_energy(name: &str, lights: &[Lit], map: &EnvMap, domain: Domain) {
    for (channel, truth) in rgb_sum(map, domain).into_iter().enumerate() {
        let sum: f64 = lights.iter().map(|light| light.irradiance[channel]).sum();
        assert!((sum / truth - 1.0).abs() < 1e-6, "{name}: {sum} against {truth}");
    }
}

#[test]
fn every_baseline_keeps_energy_and_number_of_lights_and_has_unit_directions() {
    for domain in [Domain::Sphere, Domain::Hemisphere] {
        for mut sampler in all() {
            for count in [1, 2, 5, 16, 37, 64] {
                let lights = sampler.decompose(&room(), domain, count);
                let name = format!("{} {domain:?} {count}", sampler.name());
                assert_keeps_energy(&name, &lights, &room(), domain);
                assert!(lights.iter().all(|l| (norm(l.direction) - 1.0).abs() < 1e-12), "{name}");
                assert!(lights.iter().all(|l| holds(domain, l.direction)), "{name}: below the horizon");
                assert_eq!(lights.len(), count, "{name}");
                let ids: std::collections::HashSet<u32> = lights.iter().map(|l| l.id).collect();
                assert_eq!(ids.len(), count, "{name}: ids are unique");
            }
        }
    }
}

#[test]
fn one_bright_texel_becomes_one_light() {
    let map = one_texel();
    for mut sampler in all() {
        let lights = sampler.decompose(&map, Domain::Sphere, 16);
        assert_keeps_energy(sampler.name(), &lights, &map, Domain::Sphere);
        // Several ranked candidates may lie beside the texel; the gather combines them.
        let raw_candidates = sampler.name() == "rank-threshold";
        let tolerance_deg = if raw_candidates { 6.0 } else { 1e-6 };
        assert_eq!(lights.len(), 1, "{}", sampler.name());
        assert!(angle_deg(lights[0].direction, map.direction(10, 95)) < tolerance_deg, "{}", sampler.name());
    }
}

#[test]
fn black_map_has_no_lights() {
    let black = EnvMap::new(8, 4, vec![[0.0; 3]; 32]);
    for mut sampler in all() {
        assert!(sampler.decompose(&black, Domain::Sphere, 16).is_empty(), "{}", sampler.name());
        assert!(sampler.decompose(&room(), Domain::Sphere, 0).is_empty(), "{}", sampler.name());
        assert_eq!(sampler.decompose(&room(), Domain::Sphere, 3).len(), 3, "{} after black", sampler.name());
    }
    assert_eq!(volume(&[black], Domain::Sphere, 4), [Vec::new()]);
    assert!(volume(&[], Domain::Sphere, 4).is_empty());
}

#[test]
fn maps_of_a_few_texels_keep_their_energy() {
    for (width, height) in [(1, 1), (3, 1), (1, 5), (5, 3)] {
        let map = EnvMap::new(width, height, vec![[1.0; 3]; width * height]);
        for domain in [Domain::Sphere, Domain::Hemisphere] {
            for mut sampler in all() {
                let lights = sampler.decompose(&map, domain, 4);
                assert_keeps_energy(sampler.name(), &lights, &map, domain);
            }
        }
    }
}

#[test]
fn samplers_are_deterministic() {
    for (mut a, mut b) in all().into_iter().zip(all()) {
        let run = |s: &mut Box<dyn Baseline>| s.decompose(&room(), Domain::Sphere, 24);
        assert_eq!(run(&mut a), run(&mut b), "{}", a.name());
    }
}

#[test]
fn two_point_sources_are_found_exactly() {
    // Two texels of equal radiance on the equator: two lights have exactly the directions of the texels.
    let mut texels = vec![[0.0; 3]; 96 * 48];
    let places = [(23, 10), (23, 60)];
    places.iter().for_each(|&(row, column)| texels[row * 96 + column] = [7.0; 3]);
    let map = EnvMap::new(96, 48, texels);
    for mut sampler in all().into_iter().filter(|s| s.name() != "rank-threshold") {
        let lights = sampler.decompose(&map, Domain::Sphere, 2);
        for (row, column) in places {
            let d = map.direction(row, column);
            let hit = lights.iter().filter(|l| angle_deg(l.direction, d) < 1e-6).count();
            assert_eq!(hit, 1, "{}", sampler.name());
        }
    }
}

#[test]
fn median_cut_of_a_constant_sky_has_lights_of_equal_energy() {
    let sky = EnvMap::new(256, 128, vec![[1.0; 3]; 256 * 128]);
    let lights = (Stateless::MEDIAN_CUT.decompose)(&sky, Domain::Sphere, 16);
    for light in &lights {
        // The ideal energy is 4 pi / 16; a cut deviates by at most one column of texels.
        let share = light.irradiance[1] / (std::f64::consts::PI / 4.0);
        assert!((share - 1.0).abs() < 0.07, "{share}");
    }
}

#[test]
fn reduced_cells_keep_energy_and_moment() {
    for (width, height) in [(96, 48), (97, 49), (50, 51)] {
        let map = EnvMap::from_fn(width, height, |d| [1.0, 2.0 + d[0] as f32, 3.0 + d[2] as f32]);
        for domain in [Domain::Sphere, Domain::Hemisphere] {
            let truth = TexelGrid::new(&map, domain)
                .fluxes(&map)
                .fold(Flux::default(), |sum, (d, rgb)| sum + Flux::of_texel(d, rgb));
            let cells = Cells::new(&map, domain, 32);
            assert!(cells.width() <= 32 && cells.height() <= 16);
            assert!(norm(std::array::from_fn(|i| cells.total().rgb[i] - truth.rgb[i])) < 1e-9);
            assert!(norm(std::array::from_fn(|i| cells.total().moment[i] - truth.moment[i])) < 1e-9);
            assert!((0..cells.len()).all(|k| cells.at(cells.direction(k)) == k), "{width} x {height}");
        }
    }
}

#[test]
fn tables_agree_with_brute_force_sums() {
    for (width, height) in [(1, 6), (6, 1), (13, 7)] {
        let map = EnvMap::from_fn(width, height, |d| [1.0 + d[0] as f32, 2.0 + d[1] as f32, 0.5]);
        let cells = Cells::texels(&map, Domain::Sphere);
        let sat = Sat::new(&cells);
        for (top, left) in [(0, 0), (height / 2, width / 3)] {
            let rect = Rect { rows: (top, height), columns: (left, width) };
            let inside = (0..cells.len()).filter(|k| k / width >= top && k % width >= left);
            let sum = inside.fold(Flux::default(), |sum, k| sum + *cells.flux(k));
            let found = sat.flux(rect);
            assert!((found.luminance - sum.luminance).abs() < 1e-12);
            assert!(norm(std::array::from_fn(|i| found.moment[i] - sum.moment[i])) < 1e-12);
            assert!(norm(std::array::from_fn(|i| found.rgb[i] - sum.rgb[i])) < 1e-12);
        }
    }
}

#[test]
fn spread_is_the_energy_times_half_the_mean_squared_chord() {
    // Two texels at an angle of 20 degrees: S0 - |S1| against the sum of E |d - centroid|^2 / 2.
    let at = |deg: f64| [deg.to_radians().sin(), 0.0, deg.to_radians().cos()];
    let parts = [(at(10.0), 3.0), (at(30.0), 1.0)];
    let flux = parts.iter().fold(Flux::default(), |sum, &(d, e)| sum + Flux::of_texel(d, [e; 3]));
    let centroid = flux.centroid().unwrap();
    let chord = |d: [f64; 3]| norm(std::array::from_fn(|i| d[i] - centroid[i]));
    let expected: f64 = parts.iter().map(|&(d, e)| e * chord(d).powi(2) / 2.0).sum();
    assert!((flux.spread() - expected).abs() < 1e-12);
}

#[test]
fn warm_lloyd_keeps_its_ids() {
    let mut sampler = Lloyd::warm();
    let before = sampler.decompose(&room(), Domain::Sphere, 32);
    let after = sampler.decompose(&room(), Domain::Sphere, 32);
    let ids = |lights: &[Lit]| lights.iter().map(|l| l.id).collect::<Vec<_>>();
    assert_eq!(ids(&before), ids(&after));
}

#[test]
fn rank_threshold_keeps_candidates_away_from_a_brighter_lamp() {
    // If the lamp has twice the power, candidates away from the lamp are kept or dropped by rank alone, so that the kept candidates are a subset of
    // the candidates that were kept before.
    let lamp = |power: f32| {
        EnvMap::from_fn(96, 48, move |d| [if angle_deg(d, [1.0, 0.0, 0.0]) < 8.0 { power } else { 1.0 }; 3])
    };
    let far = |lights: &[Lit]| {
        let apart = lights.iter().filter(|l| angle_deg(l.direction, [1.0, 0.0, 0.0]) > 15.0);
        apart.map(|l| l.id).collect::<std::collections::HashSet<_>>()
    };
    let before = far(&(Stateless::RANK_THRESHOLD.decompose)(&lamp(20.0), Domain::Sphere, 64));
    let after = far(&(Stateless::RANK_THRESHOLD.decompose)(&lamp(40.0), Domain::Sphere, 64));
    assert!(after.len() > 10 && after.is_subset(&before), "{} of {}", after.len(), before.len());
}

#[test]
fn volume_keeps_energy_budget_and_light_positions() {
    let lamp = |on: bool| {
        EnvMap::from_fn(96, 48, move |d| {
            [if on && angle_deg(d, [0.0, 1.0, 0.0]) < 10.0 { 300.0 } else { 1.0 + 0.2 * d[2] as f32 }; 3]
        })
    };
    let maps: Vec<EnvMap> = (0..8).map(|t| lamp(t >= 4)).collect();
    for domain in [Domain::Sphere, Domain::Hemisphere] {
        let frames = volume(&maps, domain, 24);
        assert!(frames.iter().map(Vec::len).sum::<usize>() <= 24 * 8);
        frames.iter().zip(&maps).for_each(|(lights, map)| assert_keeps_energy("volume", lights, map, domain));
        assert_eq!(frames[0], frames[3], "the frames before the switch have equal lights");
        assert_eq!(frames[4], frames[7], "the frames after the switch have equal lights");
        assert!(frames[4].len() > frames[0].len(), "the frames with the lamp need more lights");
        assert!(frames[4].len() > 12);
    }
    assert_eq!(volume(&maps, Domain::Sphere, 1)[0].len(), 1);
}

#[test]
fn voronoi_cells_of_opposite_points_are_hemispheres() {
    let sky = EnvMap::new(64, 32, vec![[1.0; 3]; 64 * 32]);
    let halves = voronoi(&Cells::texels(&sky, Domain::Sphere), &[[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]);
    assert!(halves.iter().all(|half| (half.rgb[0] - std::f64::consts::TAU).abs() < 1e-9));
}

/// Returns the maps in the folder `$HEMILUX_HDRI`, else in `../shared/data/hdri`; prints a message if the folder has no map.
fn real_maps() -> Vec<(PathBuf, EnvMap)> {
    let beside = || concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/hdri").into();
    let folder = std::env::var_os("HEMILUX_HDRI").map_or_else(beside, PathBuf::from);
    let mut paths: Vec<PathBuf> = std::fs::read_dir(&folder)
        .map(|entries| entries.flatten().map(|entry| entry.path()).collect())
        .unwrap_or_default();
    paths.retain(|path| path.extension().is_some_and(|e| e == "exr"));
    paths.sort();
    if paths.is_empty() {
        eprintln!("SKIPPED: no maps in {}", folder.display());
    }
    paths.into_iter().map(|path| (path.clone(), EnvMap::read(&path).unwrap())).collect()
}

fn mean(scores: &[Score]) -> Score {
    let over = |of: fn(&Score) -> f64| scores.iter().map(of).sum::<f64>() / scores.len() as f64;
    Score {
        open: over(|s| s.open),
        shadowed: over(|s| s.shadowed),
        soft_open: over(|s| s.soft_open),
        soft_shadowed: over(|s| s.soft_shadowed),
        energy: over(|s| s.energy),
    }
}

#[test]
fn median_cut_on_real_maps_has_the_errors_of_another_implementation() {
    let maps = real_maps();
    if maps.is_empty() {
        return;
    }
    for (lights, open, shadowed) in [(16, 0.046, 0.079), (64, 0.010, 0.022)] {
        let score = |(_, map): &(PathBuf, EnvMap)| {
            let set = (Stateless::MEDIAN_CUT.decompose)(map, Domain::Sphere, lights).into();
            Reference::new(map, Domain::Sphere).score(&set)
        };
        let found = mean(&maps.iter().map(score).collect::<Vec<_>>());
        println!("{lights} lights: {found:?}, the other implementation on 18 other maps {open} / {shadowed}");
        assert!(found.energy < 1e-9);
        assert!((found.open / open - 1.0).abs() < 1.0 / 3.0);
        assert!((found.shadowed / shadowed - 1.0).abs() < 1.0 / 3.0);
    }
}

/// Prints every baseline's mean errors and times; run with `--ignored --nocapture`.
#[test]
#[ignore = "prints a table and checks nothing"]
fn table_on_real_maps() {
    let maps = real_maps();
    let started = Instant::now();
    let references: Vec<Reference> =
        maps.iter().map(|(_, map)| Reference::new(map, Domain::Sphere)).collect();
    println!("reference: {:.3} s a map", started.elapsed().as_secs_f64() / maps.len().max(1) as f64);
    for (index, name) in all().iter().map(|sampler| sampler.name()).enumerate() {
        for lights in [16, 64, 256] {
            let (mut scores, mut fewest) = (Vec::new(), usize::MAX);
            let mut seconds = 0.0;
            for ((_, map), reference) in maps.iter().zip(&references) {
                // A new baseline for every map, since the maps are not a sequence.
                let mut sampler = all().swap_remove(index);
                let started = Instant::now();
                let set = sampler.decompose(map, Domain::Sphere, lights);
                seconds += started.elapsed().as_secs_f64();
                fewest = fewest.min(set.len());
                scores.push(reference.score(&set.into()));
            }
            let (m, worst) = (mean(&scores), scores.iter().map(|s| s.shadowed).fold(0.0, f64::max));
            println!(
                "{:18} {lights:4} (least {fewest}): {:6.3} / {:6.3} %, worst {:6.3} %, energy {:.1e}, {:.0} ms",
                name,
                100.0 * m.open,
                100.0 * m.shadowed,
                100.0 * worst,
                m.energy,
                1e3 * seconds / maps.len() as f64
            );
        }
    }
}
