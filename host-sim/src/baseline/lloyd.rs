//! Lloyd relaxation [Kollig2003]: points are inserted on the sphere and moved to the energy centroids of their Voronoi cells.

use super::Baseline;
use super::cells::{Cells, Flux, nearest};
use crate::env::EnvMap;
use crate::metrics::vector::dot;
use crate::metrics::{Domain, Lit};

/// Number of relaxation steps of the complete set; after about ten steps the errors hardly change.
const FINAL_STEPS: usize = 12;
/// Number of relaxation steps after each growth of the point set.
const GROWTH_STEPS: usize = 2;
/// Number of relaxation steps in a frame that starts with the points of the frame before.
const WARM_STEPS: usize = 2;
/// Largest number of rounds in which dropped points are replaced; after the last round, a smaller set is accepted.
const REPAIRS: usize = 8;
/// Largest number of columns of the map's cells; energies and centroids of the cells are exact.
const WIDTH: usize = 256;

/// Quadrature by Lloyd relaxation, reconstructed from the publication.
///
/// The set starts with one point at the map's centroid and grows by at most half of its size at a time: new points are inserted into the
/// Voronoi cells with the greatest product of energy and variance (S0 - |S1|), each at the position of greatest Y dOmega (1 - cosine).
/// After each growth and at the end all points move to the energy centroids of their cells. Weights are the cells' integrals. The published
/// method inserts points one by one.
///
/// # References
/// T. Kollig, A. Keller, "Efficient illumination by high dynamic range images", EGSR 2003.
#[derive(Debug, Default)]
pub struct Lloyd {
    warm: bool,
    points: Vec<Point>,
    next_id: u32,
}

#[derive(Clone, Copy, Debug)]
struct Point {
    direction: [f64; 3],
    id: u32,
}

impl Lloyd {
    /// Creates a sampler that starts with one point for every map, as published.
    #[must_use]
    pub fn cold() -> Self {
        Self::default()
    }

    /// Creates a sampler that starts with the points of the previous map if the number of lights is equal, so that ids persist.
    #[must_use]
    pub fn warm() -> Self {
        Self { warm: true, ..Self::default() }
    }

    fn grow(&mut self, cells: &Cells, lights: usize) {
        (self.points, self.next_id) = (Vec::new(), 0);
        let brightest = cells.lit().max_by(|&a, &b| cells.radiance(a).total_cmp(&cells.radiance(b)));
        let Some(first) = brightest.filter(|_| lights > 0) else { return };
        self.insert(cells.total().centroid().unwrap_or(cells.direction(first)));
        while self.points.len() < lights {
            let batch = (self.points.len() / 2).clamp(1, lights - self.points.len());
            if self.insert_worst(cells, batch) == 0 {
                break;
            }
            self.relax(cells, GROWTH_STEPS);
        }
    }

    fn insert(&mut self, direction: [f64; 3]) {
        self.points.push(Point { direction, id: self.next_id });
        self.next_id += 1;
    }

    /// Inserts a point into each of the `count` Voronoi cells of greatest spread; returns the number of inserted points.
    fn insert_worst(&mut self, cells: &Cells, count: usize) -> usize {
        let assigned = self.assign(cells);
        let centres: Vec<[f64; 3]> = self.points.iter().map(|p| p.direction).collect();
        // The position of greatest Y dOmega (1 - cosine) in each Voronoi cell.
        let mut places: Vec<(f64, usize)> = vec![(0.0, 0); centres.len()];
        for (k, &owner) in cells.lit().zip(&assigned.owner) {
            let gain = cells.flux(k).luminance * (1.0 - dot(cells.direction(k), centres[owner]));
            if gain > places[owner].0 {
                places[owner] = (gain, k);
            }
        }
        // A point that equals the existing point of its Voronoi cell up to rounding is not inserted.
        let useful = |&i: &usize| places[i].0 > 1e-14 * cells.flux(places[i].1).luminance;
        let mut worst: Vec<usize> = (0..centres.len()).filter(useful).collect();
        worst.sort_by(|&a, &b| assigned.sums[b].spread().total_cmp(&assigned.sums[a].spread()));
        worst.truncate(count);
        worst.iter().for_each(|&i| self.insert(cells.direction(places[i].1)));
        worst.len()
    }

    /// Moves every point to the energy centroid of its Voronoi cell, up to `steps` times; points with black cells are dropped.
    fn relax(&mut self, cells: &Cells, steps: usize) {
        for _ in 0..steps {
            let sums = self.assign(cells).sums;
            let mut moved = false;
            for (point, flux) in self.points.iter_mut().zip(&sums) {
                let to = flux.centroid().unwrap_or(point.direction);
                moved |= to != point.direction;
                point.direction = to;
            }
            let mut lit = sums.iter().map(|flux| flux.luminance > 0.0);
            self.points.retain(|_| lit.next().unwrap_or(false));
            if !moved {
                break;
            }
        }
    }

    /// Replaces dropped points until there are `lights` points, if the map has as many lit cells.
    fn repair(&mut self, cells: &Cells, lights: usize) {
        for _ in 0..REPAIRS {
            self.relax(cells, 1);
            let missing = lights.saturating_sub(self.points.len());
            if missing == 0 || self.insert_worst(cells, missing) == 0 {
                break;
            }
        }
    }

    fn assign(&self, cells: &Cells) -> Assigned {
        let centres: Vec<[f64; 3]> = self.points.iter().map(|p| p.direction).collect();
        let mut assigned = Assigned { owner: Vec::new(), sums: vec![Flux::default(); centres.len()] };
        for k in cells.lit() {
            let owner = nearest(&centres, cells.direction(k));
            if let Some(sum) = assigned.sums.get_mut(owner) {
                *sum += *cells.flux(k);
            }
            assigned.owner.push(owner);
        }
        assigned
    }
}

/// Voronoi cells of the points: the index of the nearest point for each lit cell of the map, and the sums over each Voronoi cell.
struct Assigned {
    owner: Vec<usize>,
    sums: Vec<Flux>,
}

impl Baseline for Lloyd {
    fn name(&self) -> &'static str {
        if self.warm { "lloyd-warm" } else { "lloyd" }
    }

    fn decompose(&mut self, map: &EnvMap, domain: Domain, lights: usize) -> Vec<Lit> {
        let cells = Cells::new(map, domain, WIDTH);
        if self.warm && self.points.len() == lights {
            self.relax(&cells, WARM_STEPS);
        } else {
            self.grow(&cells, lights);
            self.relax(&cells, FINAL_STEPS);
        }
        self.repair(&cells, lights);
        let sums = self.assign(&cells).sums;
        let lit = self.points.iter().zip(sums).filter(|(_, flux)| flux.luminance > 0.0);
        lit.map(|(point, flux)| flux.lit(point.direction, point.id)).collect()
    }
}
