//! The exposure that a texel takes: the longest of those that are not clipped and agree with the newest frame.
//!
//! Frames are visited from the newest to the oldest. An older frame is used as long as its luminance differs from that of the frames
//! used so far by no more than noise; the first that differs shows another moment, and ends the search. Longer exposures have less
//! noise, so that shorter ones are taken only where longer ones are clipped or outdated.
//!
//! Light that longer exposures cannot measure is followed by the shorter ones alone: if a lamp moves between a short and a long
//! exposure, the long one is dark where the lamp was and clipped where it is. The lamp then keeps its place until the next short
//! exposure, so that it is neither lost nor shown twice.

use crate::front::Mark;
use crate::merge::MAX_EXPOSURES;
use bytemuck::{Pod, Zeroable};

/// Relative difference that response, vignetting and exposure times explain. Above it, slow drifts of light are missed until they exceed it;
/// below it, the errors of a usual calibration look like motion.
const TOLERANCE: f32 = 1.0 / 16.0;

/// Noise of a dark pixel, relative to full scale: read noise, quantisation and the rounding of equal codes of 8 bits.
const DARK_NOISE: f32 = 1.0 / 400.0;

/// Variance of the photon noise at full scale, relative to its square: a full well of 10,000 electrons.
const PHOTON_NOISE: f32 = 1e-4;

/// Standard deviations that noise explains: of 30,000 texels, less than one differs by more than that in a still scene.
const DEVIATIONS: f32 = 5.0;

/// Marks of a texel in all exposures.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Marks {
    /// One bit per exposure.
    bright: u16,
    clipped: u16,
}

impl Marks {
    #[inline]
    pub(super) fn set(&mut self, index: usize, mark: Mark) {
        let bit = 1 << (index & 15);
        let with = |bits: u16, is: bool| if is { bits | bit } else { bits & !bit };
        (self.bright, self.clipped) = (with(self.bright, mark.bright), with(self.clipped, mark.clipped));
    }

    #[inline]
    fn of(self, index: usize) -> Mark {
        let has = |bits: u16| bits >> (index & 15) & 1 != 0;
        Mark { bright: has(self.bright), clipped: has(self.clipped) }
    }
}

/// Luminance in one exposure.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Level {
    /// Radiance of full scale.
    pub(super) full: f32,
    /// Radiance below which the response is not trusted.
    pub(super) dark: f32,
}

/// The frames of a window, from the newest to the oldest.
#[derive(Clone, Debug)]
pub(super) struct Frames {
    by_age: [usize; MAX_EXPOSURES],
    count: usize,
    levels: [Level; MAX_EXPOSURES],
    /// Mean weight of a pixel, steradians.
    pixel: f32,
}

impl Frames {
    pub(super) fn new(levels: [Level; MAX_EXPOSURES], pixel: f32) -> Self {
        Self { by_age: [0; MAX_EXPOSURES], count: 0, levels, pixel }
    }

    /// Number of exposures of which there is a frame.
    pub(super) fn count(&self) -> usize {
        self.count
    }

    pub(super) fn newest(&self) -> usize {
        self.by_age[0]
    }

    /// Makes the frame of exposure `index` the newest one.
    pub(super) fn push(&mut self, index: usize) {
        let known = self.by_age.iter().take(self.count).position(|own| *own == index);
        let at = known.unwrap_or(self.count);
        if known.is_none() {
            self.count = (self.count + 1).min(MAX_EXPOSURES);
        }
        if let Some(newer) = self.by_age.get_mut(..=at) {
            newer.rotate_right(1);
        }
        self.by_age[0] = index;
    }

    /// The exposure that a texel with these `energies` per exposure takes; `weight` is the sum of the weights of its pixels.
    #[inline]
    pub(super) fn choose(&self, energies: &[[f32; 4]], marks: Marks, weight: f32) -> usize {
        let mut chosen: Option<(usize, f32)> = None;
        for &index in self.by_age.iter().take(self.count) {
            let mark = marks.of(index);
            let Some([.., y]) = energies.get(index).filter(|_| !mark.clipped) else { continue };
            let Some((best, best_y)) = chosen else {
                chosen = Some((index, *y));
                continue;
            };
            if self.agree([(best, best_y), (index, *y)], weight) {
                if index > best {
                    chosen = Some((index, *y));
                }
            } else if index < best && mark.bright && *y > best_y {
                chosen = Some((index, *y));
            } else {
                break;
            }
        }
        chosen.map_or(self.newest(), |(index, _)| index)
    }

    /// Whether the luminance energies of two exposures differ by no more than noise.
    #[inline]
    fn agree(&self, [(a, own), (b, other)]: [(usize, f32); 2], weight: f32) -> bool {
        let shorter = self.levels.get(a.min(b)).copied().unwrap_or_default();
        let most = own.max(other);
        let excess = (own - other).abs() - TOLERANCE * most - shorter.dark * weight;
        // Of the two, the shorter exposure has nearly all of the noise.
        let full = shorter.full;
        let variance = self.pixel * full * (DARK_NOISE * DARK_NOISE * full * weight + PHOTON_NOISE * most);
        excess <= 0.0 || excess * excess <= DEVIATIONS * DEVIATIONS * variance
    }
}
