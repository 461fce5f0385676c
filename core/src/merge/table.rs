//! Merge of 8-bit samples by table lookup: one sum of table entries gives both the sum of light and the mask of valid exposures.
//!
//! The upper bits of an entry hold y / gain of a code; the lower bits hold one flag per exposure. An entry of an invalid code is 0. The sum
//! of the upper bits over all exposures does not overflow.
//!
//! For at most four exposures of similar times, one multiplication converts the sum to an integer radiance. In this case the entry of an
//! untrusted code of the longest exposure holds its light and a separate flag, since it determines the radiance of a sample that is valid
//! in no exposure.

use super::linear::extreme;
use super::{COUNT_BITS, Channels, Codes, Exposure, Reciprocal};
use crate::response::{CURVE_BITS, Curve};

/// Number of entries per exposure: 256 codes of three channels.
pub(super) const ENTRIES: usize = 3 * 256;

/// Largest number of exposures that are merged into integers by tables.
const MAX_UNROLLED: usize = 4;

/// Largest ratio of the sum of the exposure times to the shortest time: the darkest code then contributes at least tens of counts.
const WIDEST: f64 = 128.0;

/// Number of samples per iteration of the table lookup.
const STEP: usize = 8;

/// Number of flag bits of integer merges: one per exposure and [`DARK`]. The flags change the result by less than one count.
const WHOLE_MARKS: u32 = MAX_UNROLLED as u32 + 1;

/// The table entries of one exposure and channel.
type Row = [u32; 256];

/// The number format of the table entries.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scale {
    /// Number of flag bits of an entry.
    marks: u32,
    /// Number of table counts of relative exposure 1 in an exposure of the least gain.
    pub(super) one: f64,
    /// Relative exposure that is added to every entry so that no entry is negative.
    pub(super) raised: f64,
    /// Constants of the integer merge, if the exposures permit one.
    pub(super) whole: Option<Whole>,
}

/// Constants of the integer merge of one burst.
#[derive(Clone, Copy, Debug)]
pub(super) struct Whole {
    /// Factor from a sum of entries to radiance for each mask of valid exposures, with 32 fraction bits; 0 for a mask that does not
    /// determine the radiance.
    reciprocals: [u32; 32],
    /// First trusted code and first saturated code.
    valid: [u8; 2],
    /// Number of integer counts of relative exposure 1 in the shortest exposure.
    pub(super) one: f64,
}

/// Fills `tables`, [`ENTRIES`] elements per exposure, and returns their number format.
pub(super) fn fill<C: AsRef<[i32]>>(tables: &mut [u32], curve: &Curve<C>, exposures: &[Exposure]) -> Scale {
    let y = |channel, code| f64::from(curve.exposure_q27(channel, code)) / f64::from(1u32 << CURVE_BITS);
    let least = (0..3).map(|c| y(c, 0)).fold(0.0, f64::min);
    let most = (0..3).map(|c| y(c, 255)).fold(0.0, f64::max);
    let least_gain = exposures.iter().map(|e| e.gain).fold(f64::INFINITY, f64::min);
    let all: f64 = exposures.iter().map(|e| least_gain / e.gain).sum();
    let shortest = exposures.iter().map(|e| e.seconds).fold(f64::INFINITY, f64::min);
    let seconds: f64 = exposures.iter().map(|e| e.seconds).sum();
    let is_whole = least >= 0.0 && exposures.len() <= MAX_UNROLLED && seconds <= WIDEST * shortest;
    let marks = if is_whole { WHOLE_MARKS } else { exposures.len() as u32 };
    // The rounding of the entries adds up to half a count per exposure.
    let one = ((1u64 << (32 - marks)) as f64 - 32.0) / ((most - least) * all);
    let rows = tables.as_chunks_mut::<256>().0;
    for (channel, rows) in rows.chunks_exact_mut(exposures.len().max(1)).enumerate() {
        for (i, (row, e)) in rows.iter_mut().zip(exposures).enumerate() {
            let dark = if is_whole && i + 1 == exposures.len() { DARK } else { 0 };
            for (code, entry) in (0..).zip(row) {
                let light = libm::round((y(channel, code) - least) * (least_gain / e.gain) * one) as u32;
                *entry = match (curve.is_saturated(code), curve.is_trusted(code)) {
                    (false, true) => light << marks | 1 << i,
                    (false, false) if dark > 0 => light << marks | dark,
                    _ => 0,
                };
            }
        }
    }
    let whole = is_whole.then(|| Whole::of(curve, exposures, shortest, one));
    Scale { marks, one, raised: -least, whole }
}

/// Flag of an untrusted code of the longest exposure.
const DARK: u32 = 1 << MAX_UNROLLED;

impl Whole {
    fn of<C: AsRef<[i32]>>(curve: &Curve<C>, exposures: &[Exposure], shortest: f64, one: f64) -> Self {
        let many = exposures.len();
        // The full scale of the shortest exposure alone is 2^COUNT_BITS.
        let full = f64::from(1u32 << COUNT_BITS);
        let reciprocal = |mask: usize| {
            let alone = mask == DARK as usize;
            let used = exposures
                .iter()
                .enumerate()
                .filter(|(i, _)| if alone { i + 1 == many } else { mask >> i & 1 == 1 });
            let seconds: f64 = used.map(|(_, e)| e.seconds).sum();
            if mask == 0 || (mask >= 1 << many && !alone) {
                return 0;
            }
            libm::round(full * shortest / seconds) as u32
        };
        let first =
            |has: &dyn Fn(u32) -> bool| (0..=255).find(|code| has(u32::from(*code))).unwrap_or(u8::MAX);
        let valid = [first(&|code| curve.is_trusted(code)), first(&|code| curve.is_saturated(code))];
        let one = one * f64::from(1u32 << WHOLE_MARKS) * full / (1u64 << 32) as f64;
        Self { reciprocals: core::array::from_fn(reciprocal), valid, one }
    }

    /// Merges the samples of channel `k` over the exposures from index `from` on. Returns `false` if a sample is valid in none of them.
    // Not inlined: tests find its instructions under this symbol.
    #[inline(never)]
    fn plane<'a, const K: usize>(
        &self,
        rows: &[Row],
        codes: &[&'a [u8]],
        from: usize,
        k: usize,
        out: &mut [[i32; K]],
    ) -> bool {
        let [trusted, saturated] = self.valid;
        // Exposures that are valid for no sample are skipped; if the others are valid for all samples, the mask is constant.
        let (mut used, mut mask, mut certain, mut is_dark) = (0..0, 0usize, 0, false);
        for (i, codes) in codes.iter().enumerate().skip(from) {
            let (least, most) = (extreme(codes, u8::min), extreme(codes, u8::max));
            let is_longest = i + 1 == rows.len();
            is_dark = is_longest && least < trusted;
            if least >= saturated || (most < trusted && !is_longest) {
                continue;
            }
            if used.is_empty() {
                used.start = i;
            }
            used.end = i + 1;
            mask |= 1 << i;
            certain += usize::from(least >= trusted && most < saturated);
        }
        if (certain == 0 || is_dark) && !self.has_answers(codes.get(from..).unwrap_or_default()) {
            return false;
        }
        let one = Some(self.reciprocals[mask & 31]).filter(|_| certain == used.len());
        // One zip of all iterators: the length is compared once per iteration.
        let steps = |c: &&'a [u8]| c.as_chunks::<STEP>().0.iter();
        match (rows.get(used.clone()), codes.get(used)) {
            (Some([r]), Some([a])) => self.look_up([r], [a], steps(a).map(|a| [a]), one, k, out),
            (Some([r, s]), Some([a, b])) => {
                let steps = steps(a).zip(steps(b)).map(|(a, b)| [a, b]);
                self.look_up([r, s], [a, b], steps, one, k, out);
            }
            (Some([r, s, t]), Some([a, b, c])) => {
                let steps = steps(a).zip(steps(b)).zip(steps(c)).map(|((a, b), c)| [a, b, c]);
                self.look_up([r, s, t], [a, b, c], steps, one, k, out);
            }
            (Some([r, s, t, u]), Some([a, b, c, d])) => {
                let steps = steps(a).zip(steps(b)).zip(steps(c).zip(steps(d)));
                let steps = steps.map(|((a, b), (c, d))| [a, b, c, d]);
                self.look_up([r, s, t, u], [a, b, c, d], steps, one, k, out);
            }
            _ => return false,
        }
        true
    }

    /// Returns whether each sample is valid in an exposure, or valid in none and untrusted in the longest.
    // Not inlined: tests find its vector instructions under this symbol.
    #[inline(never)]
    fn has_answers(&self, codes: &[&[u8]]) -> bool {
        const WIDE: usize = 16;
        let [trusted, saturated] = self.valid;
        let Some((longest, shorter)) = codes.split_last() else { return false };
        let (steps, rest) = longest.as_chunks::<WIDE>();
        let mut doubts = [0; WIDE];
        for (i, last) in steps.iter().enumerate() {
            let mut any = [0; WIDE];
            for codes in shorter {
                let own = codes.as_chunks().0.get(i).unwrap_or(&[0; WIDE]);
                for (any, code) in any.iter_mut().zip(own) {
                    *any |= mask(*code >= trusted) & mask(*code < saturated);
                }
            }
            for ((doubts, last), any) in doubts.iter_mut().zip(last).zip(any) {
                *doubts |= (any & mask(*last < trusted)) | (!any & mask(*last >= saturated));
            }
        }
        let valid = |code: u8| code >= trusted && code < saturated;
        let from = longest.len() - rest.len();
        let is_sure = |(i, last): (usize, &u8)| {
            let any = shorter.iter().any(|codes| codes.get(from + i).is_some_and(|code| valid(*code)));
            if any { *last >= trusted } else { *last < saturated }
        };
        doubts == [0; WIDE] && rest.iter().enumerate().all(is_sure)
    }

    /// Sums the entries of `codes` (`steps`, then a remainder) and multiplies each sum by the constant factor `one` or by the factor of its mask.
    #[inline(always)]
    fn look_up<'a, const U: usize, const K: usize>(
        &self,
        rows: [&Row; U],
        codes: [&&[u8]; U],
        steps: impl Iterator<Item = [&'a [u8; STEP]; U]>,
        one: Option<u32>,
        k: usize,
        out: &mut [[i32; K]],
    ) {
        let (whole, rest) = out.as_chunks_mut::<STEP>();
        let from = STEP * whole.len();
        let each = |mask: usize| self.reciprocals[mask & 31];
        let steps = whole.iter_mut().zip(steps);
        if let Some(one) = one {
            for (out, codes) in steps {
                step(rows, codes, |_| one, k, out);
            }
        } else {
            for (out, codes) in steps {
                step(rows, codes, each, k, out);
            }
        }
        for (i, out) in rest.iter_mut().enumerate() {
            let codes = codes.map(|c| c.get(from + i).map_or(&[0], core::array::from_ref));
            step(rows, codes, each, k, core::array::from_mut(out));
        }
    }
}

/// Writes prefix sums of the light of the entries of `planes`.
// Not inlined: tests find its instructions under this symbol.
#[inline(never)]
fn sum_up(rows: [&Row; 3], planes: &[&[u8]; 3], sums: &mut [[i32; 4]]) {
    let [a, b, c] = planes;
    let light = |k: usize, code: &u8| (rows[k][usize::from(*code)] >> WHOLE_MARKS) as i32;
    let mut sum = [0i32; 3];
    for (to, ((a, b), c)) in sums.iter_mut().zip(a.iter().zip(*b).zip(*c)) {
        sum[0] = sum[0].wrapping_add(light(0, a));
        sum[1] = sum[1].wrapping_add(light(1, b));
        sum[2] = sum[2].wrapping_add(light(2, c));
        *to = [sum[0], sum[1], sum[2], 0];
    }
}

/// Returns 255 if `is`, otherwise 0.
fn mask(is: bool) -> u8 {
    if is { u8::MAX } else { 0 }
}

/// Sums the entries of `codes` and multiplies by the `reciprocal` of their flags.
#[inline(always)]
fn step<const S: usize, const U: usize, const K: usize>(
    rows: [&Row; U],
    codes: [&[u8; S]; U],
    reciprocal: impl Fn(usize) -> u32,
    k: usize,
    out: &mut [[i32; K]; S],
) {
    for (j, pixel) in out.iter_mut().enumerate() {
        let sum = rows.iter().zip(codes).fold(0u32, |sum, (row, c)| sum.wrapping_add(row[usize::from(c[j])]));
        let reciprocal = reciprocal((sum & ((1 << WHOLE_MARKS) - 1)) as usize);
        let Some(to) = pixel.get_mut(k) else { return };
        *to = ((u64::from(sum) * u64::from(reciprocal)) >> 32) as i32;
    }
}

/// The tables of a burst: for each channel, the entries of every exposure.
pub(super) struct Tables<'a> {
    pub(super) rows: &'a [Row],
    pub(super) exposures: usize,
    pub(super) scale: &'a Scale,
}

impl Tables<'_> {
    /// Returns the entries of every exposure for `channel`.
    fn of(&self, channel: usize) -> &[Row] {
        self.rows.chunks_exact(self.exposures.max(1)).nth(channel).unwrap_or_default()
    }

    /// Writes prefix sums of the light of planes of the longest exposure, of which no code is saturated, and returns the number of counts per
    /// unit of the sums.
    pub(super) fn sums(&self, planes: &[&[u8]; 3], channels: Channels, sums: &mut [[i32; 4]]) -> Option<f32> {
        let (whole, Channels::Three(channels)) = (self.scale.whole.as_ref()?, channels) else { return None };
        let [Some(a), Some(b), Some(c)] = channels.map(|channel| self.of(channel).last()) else {
            return None;
        };
        if planes.iter().any(|plane| plane.len() < sums.len()) {
            return None;
        }
        sum_up([a, b, c], planes, sums);
        let alone = *whole.reciprocals.get(1 << (self.exposures - 1))?;
        Some(alone as f32 / (1u64 << (32 - WHOLE_MARKS)) as f32)
    }

    /// Merges planes into integers. Returns `false` if a sample does not satisfy the condition of [`Whole::has_answers`].
    pub(super) fn counts(&self, codes: &[Codes<'_>], channels: Channels, out: &mut [i32]) -> bool {
        let Some(whole) = &self.scale.whole else { return false };
        match channels {
            Channels::One(c) => self.planes(whole, codes, c, out.as_chunks_mut().0),
            Channels::Three(c) => self.planes(whole, codes, c, out.as_chunks_mut().0),
            Channels::Four(_) => false,
        }
    }

    /// Merges the planes of each channel into integers; returns `false` if a plane is absent or a sample has no integer result.
    fn planes<const K: usize>(
        &self,
        whole: &Whole,
        codes: &[Codes<'_>],
        channels: [usize; K],
        out: &mut [[i32; K]],
    ) -> bool {
        let many = self.exposures;
        let Some(codes) = codes.get(..many) else { return false };
        let from = codes.iter().take_while(|codes| !codes.is_read()).count();
        for (k, channel) in channels.into_iter().enumerate() {
            let mut planes: [&[u8]; MAX_UNROLLED] = [&[]; _];
            for (plane, codes) in planes.iter_mut().zip(codes).skip(from) {
                let Some(found) = codes.plane(k, K).and_then(|p| p.get(..out.len())) else { return false };
                *plane = found;
            }
            let is_merged = match (self.of(channel).get(..many), planes.get(..many)) {
                (Some(rows), Some(planes)) => whole.plane(rows, planes, from, k, out),
                _ => false,
            };
            if !is_merged {
                return false;
            }
        }
        true
    }

    /// Merges interleaved samples into floats; the result of a sample that is valid in no exposure is NaN.
    pub(super) fn floats(
        &self,
        codes: &[Codes<'_>],
        channels: Channels,
        reciprocals: &[Reciprocal],
        out: &mut [f32],
    ) {
        let marks = self.scale.marks & 31;
        for (at, value) in out.iter_mut().enumerate() {
            let channel = channels.of(at).min(2);
            let rows = self.of(channel).iter().zip(codes).filter(|(_, c)| c.is_read());
            let looked_up = rows.map(|(row, c)| row[(c.code(at) as usize).min(255)]);
            let sum = looked_up.fold(0u32, u32::wrapping_add);
            let r = reciprocals.get((sum & ((1 << marks) - 1)) as usize).copied().unwrap_or_default();
            *value = (sum >> marks) as i32 as f32 * r.factor - r.offset;
        }
    }
}
