//! Lloyd relaxation [Kollig2003]: grow a set of points on the sphere and relax it.

use super::Baseline;
use super::cells::{Cells, Flux, nearest};
use crate::env::EnvMap;
use crate::metrics::vector::dot;
use crate::metrics::{Domain, Lit};

/// Relaxation steps after the set has its size. Beyond about ten the errors hardly move.
const FINAL_STEPS: usize = 12;
/// Relaxation steps after each growth.
const GROWTH_STEPS: usize = 2;
/// Relaxation steps on a frame that starts from the last one's points.
const WARM_STEPS: usize = 2;
/// Number of times that points of empty cells are placed again before a smaller set is accepted.
const REPAIRS: usize = 8;
/// Width of the reduced map it works on; energies and centroids stay exact.
const WIDTH: usize = 256;

/// Quadrature by Lloyd relaxation; a reconstruction.
///
/// From one point at the map's centroid the set grows by half (at most) a time: new points go to the
/// Voronoi cells of greatest energy times variance (S0 - |S1|), each at the place of greatest
/// Y dOmega (1 - cosine). After each growth and at the end all points move to the energy centroids of
/// their cells. Weights are the cells' integrals. The published method inserts points one by one.
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
    /// A sampler that starts from one point on every map, as published.
    #[must_use]
    pub fn cold() -> Self {
        Self::default()
    }

    /// Starts from the last map's points where the number of lights is the same: ids live on.
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

    /// Adds a point to each of the `count` worst cells; returns how many were added.
    fn insert_worst(&mut self, cells: &Cells, count: usize) -> usize {
        let assigned = self.assign(cells);
        let centres: Vec<[f64; 3]> = self.points.iter().map(|p| p.direction).collect();
        // The place of greatest Y dOmega (1 - cosine) in each Voronoi cell.
        let mut places: Vec<(f64, usize)> = vec![(0.0, 0); centres.len()];
        for (k, &owner) in cells.lit().zip(&assigned.owner) {
            let gain = cells.flux(k).luminance * (1.0 - dot(cells.direction(k), centres[owner]));
            if gain > places[owner].0 {
                places[owner] = (gain, k);
            }
        }
        // A place at the point itself, to rounding, adds nothing.
        let useful = |&i: &usize| places[i].0 > 1e-14 * cells.flux(places[i].1).luminance;
        let mut worst: Vec<usize> = (0..centres.len()).filter(useful).collect();
        worst.sort_by(|&a, &b| assigned.sums[b].spread().total_cmp(&assigned.sums[a].spread()));
        worst.truncate(count);
        worst.iter().for_each(|&i| self.insert(cells.direction(places[i].1)));
        worst.len()
    }

    /// Moves every point to the centroid of its cell; points whose cell is black are dropped.
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

    /// Adds points in place of those that relaxation dropped, so that the count is reached where the map allows it.
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

/// Voronoi cells of the points: the owner of each lit cell of the map, and the sums per point.
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
