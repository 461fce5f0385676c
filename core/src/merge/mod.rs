//! HDR merge: the radiance of a sample is the sum of y_i / gain_i divided by the sum of the times t_i, over the exposures i in which the
//! sample is valid; y is relative exposure.
//!
//! For a linear sensor this mean has the least photon noise: each exposure is weighted by its time. A sample is valid in an exposure if
//! its code is below saturation and, for a non-linear response, at least [`crate::response::TRUSTED`]. If a sample is valid in no
//! exposure, the longest exposure in which it is not saturated determines the radiance; if it is saturated in all, the value of the
//! shortest exposure is a lower bound and the pixel counts as clipped.
//!
//! Two vectorised loops return radiance as integers, whose sums are exact: module `linear` for linear sensors, module `table` for other
//! responses of 8-bit samples. Bursts whose exposures are too many or too far apart for integers, and samples that are valid in no
//! exposure, are merged in floats.

mod codes;
mod detached;
mod exposure;
mod linear;
mod mode;
mod scalar;
mod table;

use crate::buffer::{self, Buffer};
use crate::response::{CURVE_BITS, Curve, Depth};
use crate::tally::Tally;
use bytemuck::{Pod, Zeroable};
pub use codes::{Channels, Codes, Samples};
pub(crate) use detached::{Detached, Tables};
use exposure::check;
pub use exposure::{Exposure, MAX_EXPOSURES, MergeError};
use linear::{Code, Linear, Suffixes};
pub use mode::MergeMode;

/// The conversion of a sum of table entries to radiance: radiance = sum x factor - offset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Reciprocal {
    factor: f32,
    offset: f32,
}

/// The loop that merges the samples, with its constants.
#[derive(Clone, Copy, Debug)]
enum MergeLoop {
    Linear(Suffixes),
    Table(table::Scale),
    Plain,
}

/// A merge for one response curve and one set of exposures, in buffers that the caller lends.
#[derive(Clone, Debug)]
pub struct Merge<C, P, R> {
    curve: Curve<C>,
    tables: P,
    reciprocals: R,
    parameters: Parameters,
}

/// The values of a merge that are stored outside of its buffers.
#[derive(Clone, Copy, Debug)]
struct Parameters {
    merge_loop: MergeLoop,
    /// Reciprocal of the gain of each exposure, relative to the least gain, with [`GAIN_BITS`] fraction bits.
    inverse_gain: [u32; MAX_EXPOSURES],
    /// Number of table counts per unit of [`Curve::exposure_q27`].
    plain: f32,
    count: usize,
    /// The largest index of an exposure before which the times sum to at most a fifth of the burst's whole time.
    most_unread: usize,
    unit: f64,
}

/// A borrowed merge: the input of the front end for each burst.
#[derive(Clone, Copy, Debug)]
pub struct MergeView<'a> {
    pub(crate) mode: MergeMode,
    /// The codes from which on texels are marked; `None` unless the single exposure of a window is merged.
    pub(crate) limits: Option<Limits>,
    curve: Curve<&'a [i32]>,
    tables: &'a [u32],
    /// The conversion for each bit mask of valid exposures.
    reciprocals: &'a [Reciprocal],
    parameters: &'a Parameters,
}

/// Codes of an exposure from which on a pixel cannot be compared with other exposures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Limits {
    /// Smallest code that would be saturated in the next longer exposure.
    pub(crate) bright: u32,
    /// Smallest code of a pixel that makes the pixel's texel invalid in this exposure.
    pub(crate) clipped: u32,
    /// Smallest saturated code of this exposure.
    pub(crate) saturated: u32,
}

/// Number of elements of each buffer of a merge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MergeSize {
    /// Number of entries of the exposure tables.
    pub tables: usize,
    /// Number of reciprocals of sums of exposure times: one for each subset of the exposures.
    pub reciprocals: usize,
}

/// Computes the buffer lengths of [`Merge::try_new`].
///
/// # Errors
/// [`MergeError`] for exposures that cannot be merged.
pub fn merge_size<C>(curve: &Curve<C>, exposures: &[Exposure]) -> Result<MergeSize, MergeError> {
    check(exposures)?;
    let needs_tables = curve.depth() == Depth::U8 && linear(curve, exposures).is_none();
    let tables = if needs_tables { exposures.len() * table::ENTRIES } else { 0 };
    Ok(MergeSize { tables, reciprocals: 1 << exposures.len() })
}

/// Returns the constants of the linear loop; `None` if the response or the exposures do not permit it.
fn linear<C>(curve: &Curve<C>, exposures: &[Exposure]) -> Option<Suffixes> {
    Suffixes::find(exposures, curve.linear_levels()?, curve.saturated())
}

/// Number of fraction bits of the reciprocals of gains.
const GAIN_BITS: u32 = 30;

/// Number of bits of an integer radiance: the sum of 16 radiances fits 32 bits.
pub const COUNT_BITS: u32 = 27;

impl<C: AsRef<[i32]>, P: Buffer<u32>, R: Buffer<Reciprocal>> Merge<C, P, R> {
    /// Prepares the merge of `exposures`, which ascend by time x gain. `scale` is the radiance of relative exposure 1 at one second and
    /// gain 1. [`merge_size`] returns the lengths of `tables` and `reciprocals`.
    ///
    /// # Errors
    /// [`MergeError`] for exposures that cannot be merged, an invalid scale, and buffers with too few elements.
    pub fn try_new(
        curve: Curve<C>,
        exposures: &[Exposure],
        scale: f64,
        mut tables: P,
        mut reciprocals: R,
    ) -> Result<Self, MergeError> {
        let size = merge_size(&curve, exposures)?;
        if !(scale > 0.0 && scale.is_finite()) {
            return Err(MergeError::BadScale);
        }
        buffer::check(&tables, size.tables).map_err(MergeError::TooSmall)?;
        buffer::check(&reciprocals, size.reciprocals).map_err(MergeError::TooSmall)?;
        let least = |f: fn(&Exposure) -> f64| exposures.iter().map(f).fold(f64::INFINITY, f64::min);
        let (shortest, least_gain) = (least(|e| e.seconds), least(|e| e.gain));
        let merge_loop = match linear(&curve, exposures) {
            Some(linear) => MergeLoop::Linear(linear),
            None if size.tables > 0 => {
                MergeLoop::Table(table::fill(&mut tables.as_mut()[..size.tables], &curve, exposures))
            }
            None => MergeLoop::Plain,
        };
        let plain_one = f64::from(1u32 << CURVE_BITS);
        // `one` is the number of table counts of relative exposure 1, `raised` the relative exposure that is added to every entry.
        let (one, raised) = match &merge_loop {
            MergeLoop::Table(scale) => (scale.one, scale.raised),
            _ => (plain_one, 0.0),
        };
        // `counts` is the number of integer counts of relative exposure 1 in the shortest exposure.
        let counts = match (&merge_loop, curve.linear_levels()) {
            (MergeLoop::Linear(l), Some(levels)) => l.counts_per_code() * (levels.white - levels.black),
            (MergeLoop::Table(table::Scale { whole: Some(whole), .. }), _) => whole.one,
            _ => f64::from(1u32 << 20),
        };
        // Finite for any scale: an infinite unit times a white balance of 0 would not be a number.
        let unit = (scale / (least_gain * shortest) / counts).min(f64::MAX);
        for (mask, r) in reciprocals.as_mut().iter_mut().enumerate().take(size.reciprocals) {
            let used = || exposures.iter().enumerate().filter(|(i, _)| mask >> i & 1 == 1);
            let seconds: f64 = used().map(|(_, e)| e.seconds).sum();
            let factor = counts * (shortest / seconds) / one;
            let lifted: f64 = used().map(|(_, e)| least_gain / e.gain * raised * one).sum();
            *r = if mask == 0 {
                Reciprocal { factor: f32::NAN, offset: 0.0 }
            } else {
                Reciprocal { factor: factor as f32, offset: (lifted * factor) as f32 }
            };
        }
        let mut inverse_gain = [0; MAX_EXPOSURES];
        for (q, e) in inverse_gain.iter_mut().zip(exposures) {
            *q = libm::round(least_gain / e.gain * f64::from(1u32 << GAIN_BITS)) as u32;
        }
        let plain = (one / plain_one) as f32;
        let (count, most_unread) = (exposures.len(), mode::most_unread(exposures));
        let parameters = Parameters { merge_loop, inverse_gain, plain, count, most_unread, unit };
        Ok(Self { curve, tables, reciprocals, parameters })
    }

    /// Borrows the merge for the front end.
    #[must_use]
    pub fn view(&self) -> MergeView<'_> {
        MergeView {
            mode: MergeMode::All,
            limits: None,
            curve: self.curve.view(),
            tables: self.tables.as_ref(),
            reciprocals: self.reciprocals.as_ref(),
            parameters: &self.parameters,
        }
    }

    /// Returns the merge without its buffers, for storage.
    pub(crate) fn detached(&self) -> Detached {
        Detached { curve: self.curve.over(()), parameters: self.parameters }
    }

    /// Returns the number of elements in use of each buffer of the merge.
    #[must_use]
    pub fn size(&self) -> MergeSize {
        let tables = if let MergeLoop::Table(_) = self.parameters.merge_loop {
            self.parameters.count * table::ENTRIES
        } else {
            0
        };
        MergeSize { tables, reciprocals: 1 << self.parameters.count }
    }
}

impl<'a> MergeView<'a> {
    /// Returns the response curve of the merge.
    pub(crate) fn curve(&self) -> Curve<&'a [i32]> {
        self.curve
    }

    /// Returns the same merge for frames whose texels are marked where codes reach `limits`.
    pub(crate) fn marking(self, limits: Limits) -> Self {
        Self { limits: Some(limits), ..self }
    }
}

impl MergeView<'_> {
    /// Returns the radiance per count of a merged result.
    #[must_use]
    pub fn unit(&self) -> f64 {
        self.parameters.unit
    }

    /// Returns an upper bound of the merged radiance of any sample, counts.
    #[must_use]
    pub fn most(&self) -> f64 {
        // Full scale of the shortest exposure, scaled to the longest time, with a margin of a factor of 2.
        match self.parameters.merge_loop {
            MergeLoop::Linear(_) => f64::from(1u32 << 31),
            _ => f64::from(1u32 << 22),
        }
    }

    /// Returns the depth of the samples that are merged.
    #[must_use]
    pub fn depth(&self) -> Depth {
        self.curve.depth()
    }

    /// Returns the number of exposures in a burst.
    #[must_use]
    pub fn exposures(&self) -> usize {
        self.parameters.count
    }

    /// Returns whether [`MergeView::counts`] reads red, green and blue codes as separate planes.
    #[must_use]
    pub fn wants_planes(&self) -> bool {
        matches!(&self.parameters.merge_loop, MergeLoop::Table(scale) if scale.whole.is_some())
    }

    /// Returns whether [`MergeView::products`] can merge the samples of the burst.
    #[must_use]
    pub fn has_products(&self) -> bool {
        matches!(self.parameters.merge_loop, MergeLoop::Linear(_))
    }

    /// Merges samples like [`MergeView::counts`], but writes the two factors of each integer radiance to `sums` and `reciprocals`, so that the caller
    /// can multiply and accumulate in one step. Returns the radiance of a product of 1 in units of [`Merge::unit`], which depends on the
    /// exposures that are read; `None` if the response is not linear (see [`MergeView::has_products`]).
    #[must_use]
    pub fn products(&self, codes: &[Codes<'_>], sums: &mut [i16], reciprocals: &mut [i16]) -> Option<f32> {
        let MergeLoop::Linear(linear) = &self.parameters.merge_loop else { return None };
        let from = codes.iter().take_while(|codes| !codes.is_read()).count();
        let (codes, suffix) = (codes.get(from..)?, linear.of(from)?);
        let is_merged = match codes.first() {
            Some(Codes::Bytes(_)) => unrolled(&suffix.linear, codes, Codes::bytes, sums, reciprocals),
            Some(Codes::Words(_)) => unrolled(&suffix.linear, codes, Codes::words, sums, reciprocals),
            _ => false,
        };
        is_merged.then_some(suffix.unit)
    }

    /// Merges samples into integer radiances in units of [`Merge::unit`], of magnitude below 2^[`COUNT_BITS`]; sensor noise around the
    /// black level can make them negative. `codes` holds the same samples once per exposure; `channels` states the colour of each sample
    /// and repeats along the row.
    ///
    /// Returns `false` if the burst has no integer loop, if a sample is valid in no exposure, or if not all exposures of a linear burst are
    /// read; `out` is then undefined, and [`MergeView::samples`] merges the samples instead.
    ///
    /// # Accuracy
    /// Within 0.1 % RMS of an `f64` merge with the same weights over seven decades of radiance (`tests/merge_twin`).
    #[must_use]
    pub fn counts(&self, codes: &[Codes<'_>], channels: Channels, out: &mut [i32]) -> bool {
        match &self.parameters.merge_loop {
            MergeLoop::Linear(_) => self.multiplied(codes, out),
            MergeLoop::Table(scale) => self.tables(scale).counts(codes, channels, out),
            MergeLoop::Plain => false,
        }
    }

    /// Writes prefix sums of the radiances of pixels of which only the longest exposure is read, and returns the number of counts per unit of
    /// the sums; the sum of 16 radiances fits 31 bits. `None` for other codes, and for bursts that are not merged by tables.
    pub(crate) fn sums(&self, codes: &[Codes<'_>], channels: Channels, sums: &mut [[i32; 4]]) -> Option<f32> {
        let MergeLoop::Table(scale) = &self.parameters.merge_loop else { return None };
        let (Codes::Planes(planes), shorter) = codes.split_last()? else { return None };
        let is_alone = shorter.last().map_or(self.saturated() == u32::MAX, |codes| !codes.is_read());
        if is_alone { self.tables(scale).sums(planes, channels, sums) } else { None }
    }

    /// Returns the smallest code that counts as saturated.
    pub(crate) fn saturated(&self) -> u32 {
        self.curve.saturated()
    }

    /// Returns whether the mode is [`MergeMode::Needed`] and the exposures from index `from` on determine the radiance of every sample: none of
    /// `codes`, the codes of exposure `from`, is saturated, and the merge has a loop for these exposures.
    pub(crate) fn suffices(&self, from: usize, codes: &Codes<'_>) -> bool {
        if self.mode == MergeMode::All || from > self.parameters.most_unread {
            return false;
        }
        let has_loop = match &self.parameters.merge_loop {
            MergeLoop::Linear(linear) => linear.of(from).is_some(),
            _ => true,
        };
        has_loop && (self.saturated() == u32::MAX || codes.are_below(self.saturated()))
    }

    /// Returns the conversion of a sum of codes of the longest exposure to a count of light; `None` unless the mode is
    /// [`MergeMode::Needed`] and the sensor linear.
    pub(crate) fn tally(&self) -> Option<Tally> {
        match &self.parameters.merge_loop {
            MergeLoop::Linear(linear) if self.mode == MergeMode::Needed => {
                linear.tally(self.parameters.count)
            }
            _ => None,
        }
    }

    /// Returns whether sample `at` is saturated in every exposure.
    #[must_use]
    pub fn is_clipped(&self, codes: &[Codes<'_>], at: usize) -> bool {
        codes.iter().take(self.parameters.count).all(|c| c.is_read() && self.curve.is_saturated(c.code(at)))
    }

    /// Writes the products of the linear loop to `out`; returns `false` if that loop cannot merge all exposures.
    fn multiplied(&self, codes: &[Codes<'_>], out: &mut [i32]) -> bool {
        const PIECE: usize = 128;
        let (mut sums, mut reciprocals) = ([0; PIECE], [0; PIECE]);
        for (i, out) in out.chunks_mut(PIECE).enumerate() {
            let mut own = [Codes::NONE; MAX_EXPOSURES];
            for (own, codes) in own.iter_mut().zip(codes) {
                *own = codes.part(PIECE * i, out.len());
            }
            let own = own.get(..codes.len()).unwrap_or_default();
            let (sums, reciprocals) = (&mut sums[..out.len()], &mut reciprocals[..out.len()]);
            if self.products(own, sums, reciprocals) != Some(1.0) {
                return false;
            }
            for (value, (sum, reciprocal)) in out.iter_mut().zip(sums.iter().zip(reciprocals)) {
                *value = i32::from(*sum) * i32::from(*reciprocal);
            }
        }
        true
    }

    /// Returns the exposure tables together with their number format.
    fn tables<'a>(&'a self, scale: &'a table::Scale) -> table::Tables<'a> {
        table::Tables { rows: self.tables.as_chunks().0, exposures: self.parameters.count, scale }
    }
}

/// Calls [`Linear::merge`] with the number of exposures as a constant.
#[inline(always)]
fn unrolled<'a, T: Code + 'a>(
    linear: &Linear,
    codes: &[Codes<'a>],
    slice: impl Fn(&Codes<'a>) -> Option<&'a [T]>,
    sums: &mut [i16],
    reciprocals: &mut [i16],
) -> bool {
    let mut slices: [&[T]; linear::MAX_UNROLLED] = [&[]; _];
    for (slot, samples) in slices.iter_mut().zip(codes) {
        let Some(found) = slice(samples) else { return false };
        *slot = found;
    }
    let [a, b, c, d] = slices;
    match codes.len() {
        1 => linear.merge([a], sums, reciprocals),
        2 => linear.merge([a, b], sums, reciprocals),
        3 => linear.merge([a, b, c], sums, reciprocals),
        4 => linear.merge([a, b, c, d], sums, reciprocals),
        _ => false,
    }
}
