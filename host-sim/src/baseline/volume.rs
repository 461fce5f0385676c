//! Decomposition of a whole sequence of maps as a spatio-temporal volume, in the manner of [Wan2011].

use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::f64::consts::PI;
use std::ops::Range;

use super::cells::Flux;
use crate::env::EnvMap;
use crate::metrics::{Domain, Lit, TexelGrid};
use hemilux_core::healpix;

/// HEALPix order of the finest quads of a box: nside 32, 1.8 degrees. Centroids of the quads are exact.
const FINEST: u8 = 5;
/// Relative excess of the energy of a box's brightest frame over the mean of its frames above which the box is split in time. A lamp that doubles
/// the energy of a quad in half of the frames has about this excess; with smaller values noise consumes the budget of lights.
const RESTLESS: f64 = 0.33;
/// Exponent of the solid angle in the importance of a box, as in the Q2-tree.
const SOLID_ANGLE_EXPONENT: f64 = 0.25;

/// Decomposes a sequence offline with at most `lights` lights per frame on average, reconstructed from the publication.
///
/// A box is a HEALPix quad (the whole domain at first, then twelve base quads, then quarters) during an interval of frames. Its importance
/// is the energy of its brightest frame times dOmega^(1/4). The box of greatest importance is split next: in time if its energy varies, at the
/// frame with the least sum of squared deviations of the energy before and after; else in space, while the lights of all frames together stay
/// within the budget. The number of lights adapts to each frame. A box has one light in each of its frames, with the energy of the frame, the
/// direction of the centroid of the whole box, so that the light does not move within the box, and the id of the box.
///
/// The publication describes splits into quads in space or into two intervals in time, an importance metric, and the whole sequence as input.
/// The publication leaves open the metric, the selection of splits and the positions of lights: they were chosen here.
///
/// # References
/// L. Wan, S.-K. Mak, T.-T. Wong, C.-S. Leung, "Spatiotemporal sampling of dynamic environment sequences",
/// IEEE TVCG 2011.
#[must_use]
pub fn volume(maps: &[EnvMap], domain: Domain, lights: usize) -> Vec<Vec<Lit>> {
    let pyramids: Vec<FluxPyramid> = maps.iter().map(|map| FluxPyramid::new(map, domain)).collect();
    let mut frames = vec![Vec::new(); maps.len()];
    for (id, leaf) in split(&pyramids, lights).iter().enumerate() {
        let place = leaf.flux(&pyramids);
        for t in leaf.frames.clone() {
            let flux = pyramids[t].flux(leaf.quad);
            if flux.luminance > 0.0 {
                let direction = place.centroid().unwrap_or([0.0, 0.0, 1.0]);
                frames[t].push(Lit {
                    direction,
                    irradiance: flux.rgb,
                    radius_deg: flux.radius_deg(),
                    id: id as u32,
                });
            }
        }
    }
    frames
}

/// Quad with the index `ipix` on `level`; level 0 is the whole domain, level n has the quads of HEALPix order n - 1.
#[derive(Clone, Copy, Debug)]
struct LevelQuad {
    level: u8,
    ipix: usize,
}

impl LevelQuad {
    fn children(self) -> impl Iterator<Item = Self> {
        let count = if self.level == 0 { 12 } else { 4 };
        (0..count).map(move |k| Self { level: self.level + 1, ipix: count * self.ipix + k })
    }

    fn solid_angle(self) -> f64 {
        if self.level == 0 { 4.0 * PI } else { healpix::solid_angle(self.level - 1) }
    }
}

/// Sums of energy and first moment over the quads of all levels, for one frame.
struct FluxPyramid {
    levels: Vec<Vec<Flux>>,
}

impl FluxPyramid {
    fn new(map: &EnvMap, domain: Domain) -> Self {
        let mut levels = vec![vec![Flux::default(); 12 << (2 * FINEST)]];
        for (direction, rgb) in TexelGrid::new(map, domain).fluxes(map) {
            levels[0][healpix::ipix(FINEST, direction.into()) as usize] += Flux::of_texel(direction, rgb);
        }
        while levels[levels.len() - 1].len() > 1 {
            let finer = &levels[levels.len() - 1];
            let quads = finer.chunks(if finer.len() == 12 { 12 } else { 4 });
            let coarser =
                quads.map(|quad| quad.iter().fold(Flux::default(), |sum, &flux| sum + flux)).collect();
            levels.push(coarser);
        }
        levels.reverse();
        Self { levels }
    }

    fn flux(&self, quad: LevelQuad) -> &Flux {
        &self.levels[quad.level as usize][quad.ipix]
    }
}

/// A box: a quad of the sphere during an interval of frames.
#[derive(Clone, Debug)]
struct SequenceBox {
    quad: LevelQuad,
    frames: Range<usize>,
    importance: f64,
}

impl SequenceBox {
    fn new(pyramids: &[FluxPyramid], quad: LevelQuad, frames: Range<usize>) -> Self {
        let brightest = frames.clone().map(|t| pyramids[t].flux(quad).luminance).fold(0.0, f64::max);
        Self { quad, frames, importance: brightest * quad.solid_angle().powf(SOLID_ANGLE_EXPONENT) }
    }

    fn flux(&self, pyramids: &[FluxPyramid]) -> Flux {
        self.frames.clone().fold(Flux::default(), |sum, t| sum + *pyramids[t].flux(self.quad))
    }

    /// Returns the number of lights of the box, summed over its frames.
    fn lights(&self, pyramids: &[FluxPyramid]) -> usize {
        self.frames.clone().filter(|&t| pyramids[t].flux(self.quad).luminance > 0.0).count()
    }

    /// Returns the box cut into two intervals of frames, where the sum of squared deviations of the energy from the two means is least; `None`
    /// if the energy varies by less than [`RESTLESS`].
    fn in_time(&self, pyramids: &[FluxPyramid]) -> Option<[Self; 2]> {
        let energy: Vec<f64> = self.frames.clone().map(|t| pyramids[t].flux(self.quad).luminance).collect();
        let (sum, brightest) = (energy.iter().sum::<f64>(), energy.iter().copied().fold(0.0, f64::max));
        let count = energy.len() as f64;
        if brightest * count <= (1.0 + RESTLESS) * sum {
            return None;
        }
        // The sum of squared deviations is least where sum^2 / count, summed over the two parts, is greatest.
        let (mut before, mut best) = (0.0, (f64::NEG_INFINITY, 0));
        for at in 1..energy.len() {
            before += energy[at - 1];
            let between = before * before / at as f64 + (sum - before).powi(2) / (count - at as f64);
            if between > best.0 {
                best = (between, at);
            }
        }
        let at = self.frames.start + best.1;
        let part = |frames| Self::new(pyramids, self.quad, frames);
        (best.1 > 0).then(|| [part(self.frames.start..at), part(at..self.frames.end)])
    }

    /// Returns the boxes of those children of the box's quad that are not black; an empty list for the finest quads.
    fn in_space(&self, pyramids: &[FluxPyramid]) -> Vec<Self> {
        if self.quad.level > FINEST {
            return Vec::new();
        }
        let parts = self.quad.children().map(|quad| Self::new(pyramids, quad, self.frames.clone()));
        parts.filter(|part| part.importance > 0.0).collect()
    }
}

impl PartialEq for SequenceBox {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for SequenceBox {}

impl PartialOrd for SequenceBox {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for SequenceBox {
    fn cmp(&self, other: &Self) -> Ordering {
        let place = |leaf: &Self| (leaf.quad.level, leaf.quad.ipix, leaf.frames.start);
        self.importance.total_cmp(&other.importance).then_with(|| place(other).cmp(&place(self)))
    }
}

/// Splits the box of greatest importance until no split fits the budget; returns the boxes.
fn split(pyramids: &[FluxPyramid], lights: usize) -> Vec<SequenceBox> {
    let whole = SequenceBox::new(pyramids, LevelQuad { level: 0, ipix: 0 }, 0..pyramids.len());
    if whole.importance == 0.0 || lights == 0 {
        return Vec::new();
    }
    let budget = lights * pyramids.len();
    let mut used = whole.lights(pyramids);
    let mut open = BinaryHeap::from([whole]);
    let mut done = Vec::new();
    while let Some(leaf) = open.pop() {
        if let Some(parts) = leaf.in_time(pyramids) {
            open.extend(parts);
            continue;
        }
        let parts = leaf.in_space(pyramids);
        let made: usize = parts.iter().map(|part| part.lights(pyramids)).sum();
        let grown = used - leaf.lights(pyramids) + made;
        if parts.is_empty() || grown > budget {
            done.push(leaf);
        } else {
            used = grown;
            open.extend(parts);
        }
    }
    done
}
