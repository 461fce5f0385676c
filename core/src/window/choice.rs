//! The choice of the exposure whose energy a texel has in the map: the longest of those that are not clipped and agree with the newest
//! frame.
//!
//! Frames are visited from the newest to the oldest. An older frame can be chosen as long as the texel's luminance in it differs from that
//! of the frame chosen so far by no more than noise; the first frame that differs shows another moment, and ends the search. Longer
//! exposures have less noise, so that a shorter one is chosen only where longer ones are clipped or outdated.
//!
//! Light that longer exposures cannot measure is followed by the shorter exposures alone: if a lamp moves between a short and a long
//! exposure, the long exposure is dark at the lamp's old position and clipped at its new one. In the map, the lamp then keeps its old
//! position until the next short exposure, so that it is neither lost nor present twice.

use crate::front::Mark;
use crate::merge::MAX_EXPOSURES;
use bytemuck::{Pod, Zeroable};

/// Relative difference between the luminances of a texel in two exposures that errors of response, vignetting and exposure times explain.
/// With a larger value, slow drifts of light are missed until they exceed it; with a smaller one, the errors of a usual calibration count
/// as motion.
const TOLERANCE: f32 = 1.0 / 16.0;

/// Noise of a dark pixel, relative to full scale: read noise, quantisation and the rounding of equal codes of 8 bits.
const DARK_NOISE: f32 = 1.0 / 400.0;

/// Variance of the photon noise of a pixel at full scale, relative to the square of full scale: a full well of 10,000 electrons.
const PHOTON_NOISE: f32 = 1e-4;

/// Number of standard deviations of a difference that noise explains: in a still scene, less than one of 30,000 texels differs by more.
const DEVIATIONS: f32 = 5.0;

/// Properties of a texel in all exposures of a window, one bit for each exposure.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Marks {
    /// Bit of each exposure: set if a pixel of the texel has a code that would be saturated in the next longer exposure.
    bright: u16,
    clipped: u16,
}

impl Marks {
    #[inline]
    pub(super) fn set(&mut self, index: usize, mark: Mark) {
        let bit = bit(index) as u16;
        let with = |bits: u16, is: bool| if is { bits | bit } else { bits & !bit };
        (self.bright, self.clipped) = (with(self.bright, mark.bright), with(self.clipped, mark.clipped));
    }

    /// Returns whether one of the exposures `older` can be chosen in place of `best`: a longer one, or a shorter one with light that longer
    /// ones cannot measure.
    #[inline]
    fn may_replace(self, best: usize, older: u32) -> bool {
        let longer = (u32::MAX << 1) << (best & 15);
        older & (longer | u32::from(self.bright)) != 0
    }
}

/// Returns the bit of exposure `index`.
#[inline]
fn bit(index: usize) -> u32 {
    1 << (index & 15)
}

/// Luminance of a pixel at two codes of one exposure.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Level {
    /// Luminance of a pixel at full scale.
    pub(super) full: f32,
    /// Luminance of a pixel below which the response is not trusted.
    pub(super) dark: f32,
}

/// The exposures of a window in the order of their newest frames, from the newest to the oldest.
#[derive(Clone, Debug)]
pub(super) struct Frames {
    by_age: [usize; MAX_EXPOSURES],
    count: usize,
    /// One bit for each exposure of which there is a frame.
    known: u32,
    levels: [Level; MAX_EXPOSURES],
    /// Mean weight of a pixel, its share of the solid angle, steradians.
    pixel: f32,
}

impl Frames {
    pub(super) fn new(levels: [Level; MAX_EXPOSURES], pixel: f32) -> Self {
        Self { by_age: [0; MAX_EXPOSURES], count: 0, known: 0, levels, pixel }
    }

    /// Returns the number of exposures of which there is a frame.
    pub(super) fn count(&self) -> usize {
        self.count
    }

    pub(super) fn newest(&self) -> usize {
        self.by_age[0]
    }

    /// Makes the frame of exposure `index` the newest frame.
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
        self.known |= bit(index);
    }

    /// Returns the index of the exposure whose energy a texel has in the map. `energies` are the texel's energies by exposure; `weight` is
    /// the sum of the weights of its pixels, steradians.
    #[inline]
    pub(super) fn choose(&self, energies: &[[f32; 4]], marks: Marks, weight: f32) -> usize {
        let newest = self.newest();
        let measured = self.known & !u32::from(marks.clipped);
        let is_settled = measured & bit(newest) != 0 && !marks.may_replace(newest, measured & !bit(newest));
        if is_settled { newest } else { self.search(energies, marks, measured, weight) }
    }

    /// Visits the frames of the exposures `measured`, in which the texel is not clipped, from the newest to the oldest, as long as one of the
    /// remaining frames can be chosen.
    // Not inlined: the loop over the texels keeps its values in registers.
    #[inline(never)]
    fn search(&self, energies: &[[f32; 4]], marks: Marks, mut measured: u32, weight: f32) -> usize {
        let level = |index: usize| energies.get(index).map_or(0.0, |energy| energy[3]);
        let mut ages = self.by_age.get(..self.count).unwrap_or_default().iter();
        let Some(&first) = ages.find(|index| measured & bit(**index) != 0) else { return self.newest() };
        let (mut best, mut most) = (first, level(first));
        measured &= !bit(first);
        for &index in ages {
            if measured & bit(index) == 0 {
                continue;
            }
            if !marks.may_replace(best, measured) {
                break;
            }
            measured &= !bit(index);
            let own = level(index);
            let is_chosen = if self.agree([(best, most), (index, own)], weight) {
                index > best
            } else if index < best && bit(index) & u32::from(marks.bright) != 0 && own > most {
                true
            } else {
                break;
            };
            if is_chosen {
                (best, most) = (index, own);
            }
        }
        best
    }

    /// Returns true if the luminance energies of a texel in two exposures, each given with the index of its exposure, differ by no more
    /// than noise.
    #[inline]
    fn agree(&self, [(a, own), (b, other)]: [(usize, f32); 2], weight: f32) -> bool {
        let most = if own > other { own } else { other };
        let excess = (own - other).abs() - TOLERANCE * most;
        // Most texels of a still scene need no further step.
        if excess <= 0.0 {
            return true;
        }
        let shorter = self.levels.get(a.min(b)).copied().unwrap_or_default();
        let excess = excess - shorter.dark * weight;
        // Nearly all noise of the difference is that of the shorter exposure.
        let full = shorter.full;
        let variance = self.pixel * full * (DARK_NOISE * DARK_NOISE * full * weight + PHOTON_NOISE * most);
        excess <= 0.0 || excess * excess <= DEVIATIONS * DEVIATIONS * variance
    }
}
