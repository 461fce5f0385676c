//! Errors and estimates of the samplers on real maps, against the figures of the README.

use hemilux::samplers;
use hemilux_core::SamplerKind;
use hemilux_core::healpix::Domain;
use hemilux_core::sampler::Request;
use hemilux_sim::contender::judged;
use hemilux_sim::env::EnvMap;
use hemilux_sim::maps::OrderedMaps;
use hemilux_sim::metrics::{Reference, Score};

struct Prepared {
    maps: OrderedMaps,
    reference: Reference,
}

fn prepare() -> Vec<Prepared> {
    let Some(folder) = crate::common::shared("hdri") else { return Vec::new() };
    let paths = hemilux_sim::decompose::list(&folder).expect("maps");
    let prepared = paths.iter().map(|path| {
        let env = EnvMap::read(path).expect("a map");
        let mut maps = OrderedMaps::new(&env, Domain::Sphere, &[1, 1024]);
        maps.fill(&env);
        Prepared { maps, reference: Reference::new(&env, Domain::Sphere) }
    });
    prepared.collect()
}

/// Returns the score and the estimated error of one sampler on every map.
fn scores(prepared: &[Prepared], sampler: SamplerKind, request: &Request) -> Vec<(Score, Option<f32>)> {
    let score = |p: &Prepared| {
        let (shape, map) = p.maps.of(request.lights);
        let mut sampler = samplers::make(sampler, shape, request.lights).expect("a sampler");
        let made = sampler.update(&map, request);
        assert!(made.lights.len() <= request.lights, "{} lights", made.lights.len());
        (p.reference.score(&judged(&made)), made.estimated_error)
    };
    prepared.iter().map(score).collect()
}

#[test]
fn errors_on_real_maps_are_within_the_stated_limits() {
    let prepared = prepare();
    // Limits of the mean open and of the mean shadowed error, per cent.
    let promises = [
        (SamplerKind::Pharr, 64, 6.0, 7.0),
        (SamplerKind::Q2Tree, 64, 0.8, 2.6),
        (SamplerKind::Adaptive, 4, 13.0, 20.0),
        (SamplerKind::Adaptive, 16, 2.0, 6.0),
        (SamplerKind::Adaptive, 64, 0.40, 2.0),
        (SamplerKind::Adaptive, 256, 0.10, 0.60),
        (SamplerKind::Adaptive, 1024, 0.02, 0.22),
    ];
    for (sampler, lights, open, shadowed) in promises {
        if prepared.is_empty() {
            return;
        }
        let scores = scores(&prepared, sampler, &Request::of_lights(lights));
        let mean = |f: fn(&Score) -> f64| {
            100.0 * scores.iter().map(|(s, _)| f(s)).sum::<f64>() / scores.len() as f64
        };
        let found = (mean(|s| s.open), mean(|s| s.shadowed));
        println!("{sampler} {lights}: open {:.3} %, shadowed {:.3} %", found.0, found.1);
        assert!(found.0 <= open && found.1 <= shadowed, "{sampler} {lights}: {found:?}");
        assert!(scores.iter().all(|(s, _)| s.energy <= 1e-3), "{sampler} {lights}: energy");
    }
}

#[test]
fn nine_of_ten_estimated_errors_are_within_a_factor_of_1_25_of_the_scores() {
    let prepared = prepare();
    let (mut near, mut all) = (0, 0);
    for (lights, ambient) in
        [1, 4, 8, 16, 32, 64, 128, 256].map(|n| [(n, false), (n, true)]).into_iter().flatten()
    {
        let request = Request { lights, tolerance: None, ambient, soft: false };
        for (score, estimate) in scores(&prepared, SamplerKind::Adaptive, &request) {
            let ratio = f64::from(estimate.expect("adaptive estimates")) / score.shadowed.max(0.002);
            near += usize::from((0.8..=1.25).contains(&ratio));
            all += 1;
        }
    }
    println!("{near} of {all} estimates are within a factor of 1.25 of the error");
    assert!(10 * near >= 9 * all, "{near} of {all}");
}

#[test]
fn ambient_light_reduces_the_error_of_few_lights() {
    let prepared = prepare();
    // Limits of the mean shadowed error, per cent, and of the energy error, 1e-3.
    for (lights, promise) in [(0, 12.0), (16, 2.8), (64, 1.2)] {
        let request = Request { lights, tolerance: None, ambient: true, soft: false };
        let scores = scores(&prepared, SamplerKind::Adaptive, &request);
        let mean = 100.0 * scores.iter().map(|(s, _)| s.shadowed).sum::<f64>() / scores.len().max(1) as f64;
        println!("adaptive {lights} and ambient: shadowed {mean:.3} %");
        assert!(mean <= promise, "{lights}: {mean} %");
        assert!(scores.iter().all(|(s, _)| s.energy <= 1e-3), "{lights}: energy");
    }
}

#[test]
fn errors_of_sets_for_a_tolerance_are_at_most_1_25_times_the_tolerance() {
    let prepared = prepare();
    for (tolerance, ambient) in [(0.03, false), (0.03, true), (0.1, true)] {
        let request = Request { lights: 1024, tolerance: Some(tolerance), ambient, soft: false };
        for (score, _) in scores(&prepared, SamplerKind::Adaptive, &request) {
            assert!(
                score.shadowed <= 1.25 * f64::from(tolerance),
                "{tolerance}, {ambient}: {}",
                score.shadowed
            );
        }
    }
}
