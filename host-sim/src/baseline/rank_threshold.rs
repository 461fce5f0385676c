//! Rank thresholding: ranked candidate directions are kept by importance, in the manner of [Ostromoukhov2004].

use std::collections::HashSet;
use std::sync::OnceLock;

use super::cells::{Cells, voronoi};
use crate::env::EnvMap;
use crate::metrics::vector::dot;
use crate::metrics::{Domain, Lit};

/// Number of candidate directions on a sphere or hemisphere. A lamp that is smaller than the solid angle per candidate (0.8 msr, 1.6
/// degrees) has at most one light.
const CANDIDATES: usize = 16_384;
/// Number of columns of the cells whose mean luminance is the importance: a cell covers 1.5 msr on average, the solid angle of two candidates.
const IMPORTANCE_WIDTH: usize = 128;
/// Number of columns of the cells whose energy the lights receive.
const GATHER_WIDTH: usize = 256;
/// Largest number of rounds in which candidates with a black Voronoi cell are replaced by the next candidates.
const ROUNDS: usize = 8;

/// Decomposes a map by rank thresholding, a substitute for the Penrose-tiling sampler of the publication in comparisons.
///
/// A fixed list of candidates is ranked once; candidate i is kept if (i + 1/2) / Y(d_i) is among the N least, where Y is the mean luminance
/// in a map of 128 x 64 cells. As in the original, each decision is local except for one common factor.
///
/// Differences from the original: the candidates are a spherical Fibonacci lattice of 16384 points in farthest-first order (every prefix is
/// evenly spread) instead of the vertices of a subdivided Penrose tiling with ranks from the Fibonacci number system; there are no
/// precomputed correction vectors; exactly N lights are kept instead of a number that depends on the map; and a light has the energy of its
/// Voronoi cell instead of an equal or importance-weighted share. A light has the direction of its candidate and the candidate's rank as id, so
/// that both persist from frame to frame.
///
/// # References
/// V. Ostromoukhov, C. Donohue, P.-M. Jodoin, "Fast hierarchical importance sampling with blue noise
/// properties", SIGGRAPH 2004.
pub(super) fn decompose(map: &EnvMap, domain: Domain, lights: usize) -> Vec<Lit> {
    let importance = Cells::new(map, domain, IMPORTANCE_WIDTH);
    let energy = Cells::new(map, domain, GATHER_WIDTH);
    let mut starved = HashSet::new();
    let mut found = Vec::new();
    for _ in 0..ROUNDS {
        let kept = keep(&importance, candidates(domain), lights, &starved);
        found = weigh(&energy, &kept);
        if found.len() == kept.len() {
            break;
        }
        let lit: HashSet<u32> = found.iter().map(|light| light.id).collect();
        starved.extend(kept.iter().map(|candidate| candidate.rank).filter(|id| !lit.contains(id)));
    }
    found
}

/// A candidate direction for a light, and its rank.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    rank: u32,
    direction: [f64; 3],
}

/// Returns a light for each candidate whose Voronoi cell is not black.
fn weigh(cells: &Cells, kept: &[Candidate]) -> Vec<Lit> {
    let centres: Vec<[f64; 3]> = kept.iter().map(|candidate| candidate.direction).collect();
    let sums = voronoi(cells, &centres);
    let lit = kept.iter().zip(sums).filter(|(_, flux)| flux.luminance > 0.0);
    lit.map(|(&Candidate { rank: id, direction }, flux)| Lit {
        direction,
        irradiance: flux.rgb,
        radius_deg: flux.radius_deg(),
        id,
    })
    .collect()
}

/// Returns the `lights` candidates of least rank over importance, sorted by rank; candidates in black cells and candidates whose rank `starved` contains are skipped.
fn keep(cells: &Cells, candidates: &[[f64; 3]], lights: usize, starved: &HashSet<u32>) -> Vec<Candidate> {
    let importance = |&d: &[f64; 3]| cells.radiance(cells.at(d));
    let mut keys: Vec<(f64, usize)> = candidates
        .iter()
        .map(importance)
        .enumerate()
        .filter(|&(rank, y)| y > 0.0 && !starved.contains(&(rank as u32)))
        .map(|(rank, y)| ((rank as f64 + 0.5) / y, rank))
        .collect();
    keys.sort_by(|a, b| a.0.total_cmp(&b.0));
    keys.truncate(lights);
    keys.sort_by_key(|&(_, rank)| rank);
    let total = cells.total();
    if keys.is_empty() && lights > 0 && total.luminance > 0.0 {
        // If the Voronoi cells of all candidates are black, one light with an id past the last rank has the energy of the map.
        let direction = total.centroid().unwrap_or([0.0, 0.0, 1.0]);
        return vec![Candidate { rank: CANDIDATES as u32, direction }];
    }
    keys.into_iter().map(|(_, rank)| Candidate { rank: rank as u32, direction: candidates[rank] }).collect()
}

fn candidates(domain: Domain) -> &'static [[f64; 3]] {
    static SPHERE: OnceLock<Vec<[f64; 3]>> = OnceLock::new();
    static HEMISPHERE: OnceLock<Vec<[f64; 3]>> = OnceLock::new();
    match domain {
        Domain::Sphere => SPHERE.get_or_init(|| farthest_first(&lattice(-1.0))),
        Domain::Hemisphere => HEMISPHERE.get_or_init(|| farthest_first(&lattice(0.0))),
    }
}

/// Returns a spherical Fibonacci lattice of [`CANDIDATES`] unit vectors with z from `lowest` to 1.
fn lattice(lowest: f64) -> Vec<[f64; 3]> {
    let at = |k: usize| {
        let z = 1.0 - (1.0 - lowest) * (k as f64 + 0.5) / CANDIDATES as f64;
        let phi = std::f64::consts::TAU * (k as f64 * 0.618_033_988_749_894_9).fract();
        let r = (1.0 - z * z).sqrt();
        [r * phi.cos(), r * phi.sin(), z]
    };
    (0..CANDIDATES).map(at).collect()
}

/// Returns the points in farthest-first order: each point is the farthest from all points before it. The computation takes about 0.2 s per
/// domain.
fn farthest_first(points: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let mut left: Vec<([f64; 3], f64)> = points.iter().map(|&p| (p, -2.0)).collect();
    let mut order = Vec::with_capacity(points.len());
    let mut next = 0;
    while !left.is_empty() {
        let (point, _) = left.swap_remove(next);
        order.push(point);
        let mut least = f64::INFINITY;
        for (k, (other, cosine)) in left.iter_mut().enumerate() {
            *cosine = cosine.max(dot(*other, point));
            if *cosine < least {
                (least, next) = (*cosine, k);
            }
        }
    }
    order
}
