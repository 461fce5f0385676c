//! The merge of 8-bit samples by tables: one sum adds up both the light and the mask of valid exposures.
//!
//! An entry holds y / gain of a code in its low bits and a mark for its exposure above them, or 0 where the code is not valid. The
//! low bits hold the sum of all exposures without a carry.

use super::{Exposure, Reciprocal};
use crate::arena::Buffer;
use crate::response::{CURVE_BITS, Curve};

/// Entries for one exposure: 256 codes of three channels.
pub(super) const ENTRIES: usize = 3 * 256;

/// The table of an exposure that there is not.
pub(super) static NOTHING: [[u32; 256]; 3] = [[0; 256]; 3];

/// Where the light ends and the marks begin.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scale {
    /// Bits of light.
    bits: u32,
    /// Counts of relative exposure 1 at the least gain.
    pub(super) one: f64,
    /// Relative exposure that every entry is raised by, so that none is negative.
    pub(super) raised: f64,
}

/// Fills `tables` ([`ENTRIES`] for each of `exposures`).
pub(super) fn fill<C: Buffer<i32>>(tables: &mut [u32], curve: &Curve<C>, exposures: &[Exposure]) -> Scale {
    let y = |channel, code| f64::from(curve.exposure_q27(channel, code)) / f64::from(1u32 << CURVE_BITS);
    let least = (0..3).map(|c| y(c, 0)).fold(0.0, f64::min);
    let most = (0..3).map(|c| y(c, 255)).fold(0.0, f64::max);
    let least_gain = exposures.iter().map(|e| e.gain).fold(f64::INFINITY, f64::min);
    let all: f64 = exposures.iter().map(|e| least_gain / e.gain).sum();
    let bits = 32 - exposures.len() as u32;
    // Rounding may add half a count for each exposure.
    let one = (f64::from((1u64 << bits) as f32) - 32.0) / ((most - least) * all);
    for (i, (table, e)) in tables.chunks_exact_mut(ENTRIES).zip(exposures).enumerate() {
        for (at, entry) in table.iter_mut().enumerate() {
            let (channel, code) = (at / 256, at as u32 % 256);
            let light = (y(channel, code) - least) * (least_gain / e.gain) * one;
            let valid = curve.is_trusted(code) && !curve.is_saturated(code);
            *entry = if valid { (libm::round(light) as u32) | 1 << (bits + i as u32) } else { 0 };
        }
    }
    Scale { bits, one, raised: -least }
}

/// The tables of `N` exposures for pixels of `K` samples, whose channels are `channels`.
pub(super) struct Table<'a, const N: usize, const K: usize> {
    pub(super) tables: [&'a [[u32; 256]; 3]; N],
    pub(super) channels: [usize; K],
    pub(super) scale: &'a Scale,
}

impl<const N: usize, const K: usize> Table<'_, N, K> {
    /// Merges whole pixels; says whether any sample is valid nowhere, or nothing where there are too few codes.
    pub(super) fn interleaved(
        &self,
        codes: [&[u8]; N],
        reciprocals: &[Reciprocal],
        out: &mut [f32],
    ) -> Option<bool> {
        let (out, _) = out.as_chunks_mut::<K>();
        let codes = codes.map(|c| c.as_chunks::<K>().0);
        let count = out.len();
        if codes.iter().any(|c| c.len() < count) {
            return None;
        }
        let codes = codes.map(|c| &c[..count]);
        Some(self.merge(|i, j, k| codes[i].get(j).map_or(0, |pixel| pixel[k]), reciprocals, out))
    }

    /// As [`Table::interleaved`], for samples of each channel on their own.
    pub(super) fn planes(
        &self,
        codes: [[&[u8]; 3]; N],
        reciprocals: &[Reciprocal],
        out: &mut [f32],
    ) -> Option<bool> {
        let (out, _) = out.as_chunks_mut::<K>();
        let count = out.len();
        if K > 3 || codes.iter().flatten().any(|c| c.len() < count) {
            return None;
        }
        let codes = codes.map(|planes| planes.map(|c| &c[..count]));
        Some(self.merge(|i, j, k| codes[i][k].get(j).copied().unwrap_or(0), reciprocals, out))
    }

    /// Merges samples; `code` gives exposure, pixel and sample.
    #[inline(always)]
    fn merge(
        &self,
        code: impl Fn(usize, usize, usize) -> u8,
        reciprocals: &[Reciprocal],
        out: &mut [[f32; K]],
    ) -> bool {
        let bits = self.scale.bits & 31;
        let light = (1u32 << bits) - 1;
        let mut unusual = false;
        // Channel after channel, so that the few addresses of one stay in registers.
        for (k, channel) in self.channels.iter().enumerate() {
            let rows: [&[u32; 256]; N] = self.tables.map(|t| &t[(*channel).min(2)]);
            for (j, values) in out.iter_mut().enumerate() {
                let lookups = rows.iter().enumerate().map(|(i, row)| row[usize::from(code(i, j, k))]);
                let sum = lookups.fold(0u32, u32::wrapping_add);
                let mask = (sum >> bits) as usize;
                unusual |= mask == 0;
                let r = reciprocals.get(mask).copied().unwrap_or_default();
                values[k] = (sum & light) as i32 as f32 * r.factor - r.offset;
            }
        }
        unusual
    }
}
