//! The quads that a Q2-tree splits, against a search over all quads and against single merges and splits.

use crate::common::{RngExt, VecQ2Tree, lit, seeded};
use hemilux_core::healpix::{self, Domain};
use hemilux_core::light::Light;
use hemilux_core::polar::LatLongView;
use hemilux_core::pyramid::{Pyramid, Quad};
use hemilux_core::sampler::q2tree::Parameters;
use hemilux_core::sampler::{Map, Request, Sampler};
use std::collections::BTreeSet;

/// Order and index of a HEALPix quad.
type Place = (u8, u32);
const ORDER: u8 = 4;

fn tree(parameters: Parameters, domain: Domain, lights: usize) -> VecQ2Tree {
    crate::common::q2tree(parameters, domain, ORDER, lights)
}

fn random(domain: Domain, seed: u64) -> Pyramid<Vec<Quad>> {
    let mut rng = seeded(seed);
    lit(domain, ORDER, |_| [(); 3].map(|()| 10f32.powf(rng.random_range(-2.0..2.0))))
}

/// Returns the interior quads of the tree that the ids of the lights describe.
fn interior(lights: &[Light]) -> BTreeSet<Place> {
    let mut all = BTreeSet::new();
    for light in lights {
        let order = (light.id.ilog2() / 2 - 1) as u8;
        let ipix = light.id - (4 << (2 * order));
        all.extend((0..order).map(|o| (o, ipix >> (2 * (order - o)))));
    }
    all
}

fn update(tree: &mut VecQ2Tree, map: &Pyramid<Vec<Quad>>, lights: usize) -> BTreeSet<Place> {
    let map = Map { pyramid: map.view(), polar: LatLongView::NONE };
    interior(tree.update(&map, &Request::of_lights(lights)).lights)
}

/// Returns the importance of a quad, L^a dOmega^b, in `f64`.
fn importance(p: &Parameters, map: &Pyramid<Vec<Quad>>, (order, ipix): Place) -> f64 {
    let share = map.view().domain().share(order, ipix);
    let omega = healpix::solid_angle(order) * share;
    let energy = f64::from(map.view().quad(order, ipix).y());
    energy.powf(f64::from(p.energy_exponent)) * omega.powf(f64::from(p.solid_angle_exponent))
}

fn parameters() -> [Parameters; 4] {
    [
        Parameters::CENTROID,
        Parameters { solid_angle_exponent: 0.0, ..Parameters::CENTROID },
        Parameters { energy_exponent: 0.5, solid_angle_exponent: 0.5, ..Parameters::CENTROID },
        Parameters { energy_exponent: 0.0, solid_angle_exponent: 0.7, ..Parameters::CENTROID },
    ]
}

/// Returns all quads that can be split, those of greatest importance first.
fn ranked(map: &Pyramid<Vec<Quad>>, value: impl Fn(Place) -> f64) -> Vec<Place> {
    let domain = map.view().domain();
    let mut all: Vec<Place> = (0..ORDER)
        .flat_map(|order| (0..domain.quads(order) as u32).map(move |ipix| (order, ipix)))
        .filter(|(order, ipix)| domain.share(*order, *ipix) > 0.0)
        .collect();
    all.sort_by(|a, b| value(*b).total_cmp(&value(*a)).then(a.cmp(b)));
    all
}

#[test]
fn interior_quads_are_those_of_greatest_importance() {
    for p in parameters() {
        for seed in 0..4 {
            let map = random(Domain::Sphere, seed);
            let ranked = ranked(&map, |q| importance(&p, &map, q));
            let mut tree = tree(p, Domain::Sphere, 1000);
            for request in [12, 15, 60, 63, 300, 999] {
                let splits = (request - 12) / 3;
                let expected: BTreeSet<Place> = ranked[..splits].iter().copied().collect();
                assert_eq!(update(&mut tree, &map, request), expected, "{p:?} {request}");
            }
        }
    }
}

#[test]
fn hemisphere_is_split_best_first_and_splits_that_exceed_the_request_are_skipped() {
    for seed in 0..4 {
        let map = random(Domain::Hemisphere, seed);
        let p = Parameters::CENTROID;
        let ranked = ranked(&map, |q| importance(&p, &map, q));
        let mut tree = tree(p, Domain::Hemisphere, 600);
        for request in 8..=600 {
            // Importance decreases from parent to child, so the ranking is the best-first order.
            let (mut leaves, mut expected) = (8, BTreeSet::new());
            for quad in &ranked {
                let gain = if Domain::Hemisphere.share(quad.0, quad.1) == 0.5 { 2 } else { 3 };
                let ancestor_left_out = quad.0 > 0 && !expected.contains(&(quad.0 - 1, quad.1 >> 2));
                if leaves + gain <= request && !ancestor_left_out {
                    leaves += gain;
                    expected.insert(*quad);
                }
            }
            assert_eq!(update(&mut tree, &map, request), expected, "{request}");
        }
    }
}

/// Replaces the least important split by the most important leaf while the leaf is more important; the importance of splits of the last frame
/// counts 1 + threshold times.
fn merge_and_split(
    map: &Pyramid<Vec<Quad>>,
    p: &Parameters,
    mut interior: BTreeSet<Place>,
) -> BTreeSet<Place> {
    let last = interior.clone();
    let bonus = |q: Place| if last.contains(&q) { 1.0 + f64::from(p.threshold) } else { 1.0 };
    let value = |q: Place| importance(p, map, q) * bonus(q);
    loop {
        let children = |(order, ipix): Place| (0..4).map(move |k| (order + 1, 4 * ipix + k));
        let roots = (0..12).map(|i| (0u8, i));
        let leaves = roots.chain(interior.iter().flat_map(|q| children(*q)));
        let leaf = leaves
            .filter(|q| q.0 < ORDER && !interior.contains(q))
            .max_by(|a, b| value(*a).total_cmp(&value(*b)));
        let split = interior
            .iter()
            .copied()
            .filter(|q| children(*q).all(|child| !interior.contains(&child)))
            .min_by(|a, b| value(*a).total_cmp(&value(*b)));
        match (leaf, split) {
            (Some(leaf), Some(split)) if value(leaf) > value(split) => {
                interior.remove(&split);
                interior.insert(leaf);
            }
            _ => return interior,
        }
    }
}

#[test]
fn threshold_equals_a_sequence_of_merges_and_splits() {
    for threshold in [0.0, 0.1, 0.5, 3.0] {
        let p = Parameters { threshold, ..Parameters::CENTROID };
        let mut tree = tree(p, Domain::Sphere, 120);
        let mut rng = seeded(31);
        let mut radiance: Vec<f32> = (0..12 << (2 * ORDER)).map(|_| rng.random_range(0.01..1.0)).collect();
        let mut expected: Option<BTreeSet<Place>> = None;
        let mut kept = 0;
        for _ in 0..30 {
            for l in &mut radiance {
                *l *= 10f32.powf(rng.random_range(-0.4..0.4));
            }
            let map = lit(Domain::Sphere, ORDER, |i| [radiance[i as usize]; 3]);
            let found = update(&mut tree, &map, 120);
            if let Some(last) = expected {
                kept += last.intersection(&found).count();
                assert_eq!(found, merge_and_split(&map, &p, last), "threshold {threshold}");
            }
            expected = Some(found);
        }
        println!("threshold {threshold}: {kept} splits kept");
    }
}

#[test]
fn higher_threshold_keeps_more_splits() {
    let kept = |threshold: f32| {
        let mut tree = tree(Parameters { threshold, ..Parameters::CENTROID }, Domain::Sphere, 120);
        let mut last = BTreeSet::new();
        let mut kept = 0;
        for seed in 0..20 {
            let now = update(&mut tree, &random(Domain::Sphere, seed), 120);
            kept += now.intersection(&last).count();
            last = now;
        }
        kept
    };
    let counts = [0.0, 0.3, 1.0].map(kept);
    assert!(counts.is_sorted() && counts[0] < counts[2], "{counts:?}");
}
