//! The merge of 8-bit samples by tables: one sum adds up both the light and the mask of valid exposures.
//!
//! An entry holds y / gain of a code in its low bits and a mark for its exposure above them, or 0 where the code is not valid. The
//! low bits hold the sum of all exposures without a carry.
//!
//! Of few exposures that are not far apart the light of a sample becomes a whole count, by one multiplication. There an untrusted
//! code of the longest has its light too, and a mark of its own: it decides where nothing else is valid.

use super::{COUNT_BITS, Channels, Codes, Exposure, Reciprocal};
use crate::arena::Buffer;
use crate::response::{CURVE_BITS, Curve};

/// Entries for one exposure: 256 codes of three channels.
pub(super) const ENTRIES: usize = 3 * 256;

/// Most exposures that are merged into whole counts.
const MAX_UNROLLED: usize = 4;

/// Largest sum of times over the shortest of whole counts: the light of the darkest code is then still tens of counts.
const WIDEST: f64 = 128.0;

/// Samples of one channel that are merged at a time, and told apart by their least and largest code.
const BLOCK: usize = 64;

/// A table of one exposure and channel.
type Row = [u32; 256];

/// Where the light ends and the marks begin.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scale {
    /// Bits of light.
    bits: u32,
    /// Counts of relative exposure 1 at the least gain.
    pub(super) one: f64,
    /// Relative exposure that every entry is raised by, so that none is negative.
    pub(super) raised: f64,
    /// How sums become whole counts.
    pub(super) whole: Option<Whole>,
}

/// Reciprocals of whole counts.
#[derive(Clone, Copy, Debug)]
pub(super) struct Whole {
    /// By which the light of a mask is multiplied, 2^-32; odd where the mask leaves the light in doubt.
    reciprocals: [u32; 32],
    /// First trusted and first saturated code.
    valid: [u8; 2],
    /// Counts of relative exposure 1 in the shortest exposure.
    pub(super) one: f64,
}

/// Fills `tables` ([`ENTRIES`] for each of `exposures`).
pub(super) fn fill<C: Buffer<i32>>(tables: &mut [u32], curve: &Curve<C>, exposures: &[Exposure]) -> Scale {
    let y = |channel, code| f64::from(curve.exposure_q27(channel, code)) / f64::from(1u32 << CURVE_BITS);
    let least = (0..3).map(|c| y(c, 0)).fold(0.0, f64::min);
    let most = (0..3).map(|c| y(c, 255)).fold(0.0, f64::max);
    let least_gain = exposures.iter().map(|e| e.gain).fold(f64::INFINITY, f64::min);
    let all: f64 = exposures.iter().map(|e| least_gain / e.gain).sum();
    let shortest = exposures.iter().map(|e| e.seconds).fold(f64::INFINITY, f64::min);
    let seconds: f64 = exposures.iter().map(|e| e.seconds).sum();
    let is_whole = least >= 0.0 && exposures.len() <= MAX_UNROLLED && seconds <= WIDEST * shortest;
    let bits = 32 - exposures.len() as u32 - u32::from(is_whole);
    // Rounding may add half a count for each exposure.
    let one = (f64::from((1u64 << bits) as f32) - 32.0) / ((most - least) * all);
    for (i, (table, e)) in tables.chunks_exact_mut(ENTRIES).zip(exposures).enumerate() {
        let dark = if is_whole && i + 1 == exposures.len() { DARK } else { 0 };
        for (at, entry) in table.iter_mut().enumerate() {
            let (channel, code) = (at / 256, at as u32 % 256);
            let light = libm::round((y(channel, code) - least) * (least_gain / e.gain) * one) as u32;
            *entry = match (curve.is_saturated(code), curve.is_trusted(code)) {
                (false, true) => light | 1 << (bits + i as u32),
                (false, false) if dark > 0 => light | dark,
                _ => 0,
            };
        }
    }
    let whole = is_whole.then(|| Whole::of(curve, exposures, (shortest, bits, one)));
    Scale { bits, one, raised: -least, whole }
}

/// The mark of an untrusted code of the longest exposure.
const DARK: u32 = 1 << 31;

impl Whole {
    fn of<C: Buffer<i32>>(
        curve: &Curve<C>,
        exposures: &[Exposure],
        (shortest, bits, one): (f64, u32, f64),
    ) -> Self {
        let many = exposures.len();
        // Full scale of the shortest exposure alone is 2^COUNT_BITS.
        let full = 2.0 * f64::from(1u32 << (COUNT_BITS + 31 - bits));
        let reciprocal = |mask: usize| {
            let alone = mask == 1 << many;
            let used = exposures
                .iter()
                .enumerate()
                .filter(|(i, _)| if alone { i + 1 == many } else { mask >> i & 1 == 1 });
            let seconds: f64 = used.map(|(_, e)| e.seconds).sum();
            if mask == 0 || mask > 1 << many {
                return 1;
            }
            (libm::round(full * shortest / seconds).min(f64::from(u32::MAX)) as u32) & !1
        };
        let first =
            |has: &dyn Fn(u32) -> bool| (0..=255).find(|code| has(u32::from(*code))).unwrap_or(u8::MAX);
        let valid = [first(&|code| curve.is_trusted(code)), first(&|code| curve.is_saturated(code))];
        let one = one * full / (1u64 << 32) as f64;
        Self { reciprocals: core::array::from_fn(reciprocal), valid, one }
    }
}

/// The tables of a burst, three a exposure.
pub(super) struct Tables<'a> {
    pub(super) tables: &'a [[Row; 3]],
    pub(super) scale: &'a Scale,
}

impl Tables<'_> {
    /// Merges planes into whole counts; says whether it could: where all samples have some valid exposure, or are dark in the longest.
    pub(super) fn counts(&self, codes: &[Codes<'_>], channels: Channels, out: &mut [i32]) -> bool {
        let Some(whole) = &self.scale.whole else { return false };
        match channels {
            Channels::One(c) => self.planes(whole, codes, c, out.as_chunks_mut().0),
            Channels::Three(c) => self.planes(whole, codes, c, out.as_chunks_mut().0),
            Channels::Four(_) => false,
        }
    }

    fn planes<const K: usize>(
        &self,
        whole: &Whole,
        codes: &[Codes<'_>],
        channels: [usize; K],
        out: &mut [[i32; K]],
    ) -> bool {
        match self.tables.len() {
            1 => self.blocks::<1, K>(whole, codes, channels, out),
            2 => self.blocks::<2, K>(whole, codes, channels, out),
            3 => self.blocks::<3, K>(whole, codes, channels, out),
            4 => self.blocks::<4, K>(whole, codes, channels, out),
            _ => false,
        }
    }

    fn blocks<const N: usize, const K: usize>(
        &self,
        whole: &Whole,
        codes: &[Codes<'_>],
        channels: [usize; K],
        out: &mut [[i32; K]],
    ) -> bool {
        let (Some(tables), Some(codes)) = (self.tables.first_chunk::<N>(), codes.first_chunk::<N>()) else {
            return false;
        };
        let mut doubts = 0;
        for (k, channel) in channels.into_iter().enumerate() {
            let rows = tables.each_ref().map(|t| &t[channel.min(2)]);
            let planes = codes.map(|c| c.plane(k, K).and_then(|p| p.get(..out.len())));
            if planes.iter().any(Option::is_none) {
                return false;
            }
            let planes = planes.map(Option::unwrap_or_default);
            for (i, out) in out.chunks_mut(BLOCK).enumerate() {
                let own =
                    planes.map(|p| p.get(BLOCK * i..).and_then(|p| p.get(..out.len())).unwrap_or_default());
                doubts |= self.block(whole, &rows, own, k, out);
            }
        }
        doubts & 1 == 0
    }

    /// Merges samples of channel `k`; says by an odd number that one is in doubt.
    // A name to look for its instructions under.
    #[inline(never)]
    fn block<const N: usize, const K: usize>(
        &self,
        whole: &Whole,
        rows: &[&Row; N],
        codes: [&[u8]; N],
        k: usize,
        out: &mut [[i32; K]],
    ) -> u32 {
        let [trusted, saturated] = whole.valid;
        // Exposures that are valid in none of the samples need no look; where the others are valid in all, neither do masks.
        let (mut used, mut count, mut mask, mut mixed) = ([(rows[0], codes[0]); N], 0, 0usize, false);
        for (i, (row, codes)) in rows.iter().zip(codes).enumerate() {
            let (least, most) = codes.iter().fold((u8::MAX, 0), |(l, m), c| (l.min(*c), m.max(*c)));
            if least >= saturated || (most < trusted && i + 1 < N) {
                continue;
            }
            used[count % N] = (*row, codes);
            (count, mask) = (count + 1, mask | 1 << i);
            mixed |= least < trusted || most >= saturated;
        }
        let (one, each) = (whole.reciprocals[mask & 31], |mask: usize| whole.reciprocals[mask & 31]);
        match (count, mixed) {
            (1, false) => self.look_up::<1, K>(used.first_chunk(), |_| one, k, out),
            (2, false) => self.look_up::<2, K>(used.first_chunk(), |_| one, k, out),
            (3, false) => self.look_up::<3, K>(used.first_chunk(), |_| one, k, out),
            (4, false) => self.look_up::<4, K>(used.first_chunk(), |_| one, k, out),
            (1, true) => self.look_up::<1, K>(used.first_chunk(), each, k, out),
            (2, true) => self.look_up::<2, K>(used.first_chunk(), each, k, out),
            (3, true) => self.look_up::<3, K>(used.first_chunk(), each, k, out),
            (4, true) => self.look_up::<4, K>(used.first_chunk(), each, k, out),
            _ => 1,
        }
    }

    /// Adds up what `used` hold; `reciprocal` is that of a mask. Gives the reciprocals' bits.
    #[inline(always)]
    fn look_up<const U: usize, const K: usize>(
        &self,
        used: Option<&[(&Row, &[u8]); U]>,
        reciprocal: impl Fn(usize) -> u32,
        k: usize,
        out: &mut [[i32; K]],
    ) -> u32 {
        let Some(used) = used else { return 1 };
        let bits = self.scale.bits & 31;
        let light = (1u32 << bits) - 1;
        let count = out.len();
        if k >= K || used.iter().any(|(_, codes)| codes.len() < count) {
            return 1;
        }
        let used = used.map(|(row, codes)| (row, codes.get(..count).unwrap_or_default()));
        let mut doubts = 0;
        for (j, pixel) in out.iter_mut().enumerate() {
            let light_of = |row: &Row, codes: &[u8]| row[usize::from(codes.get(j).copied().unwrap_or(0))];
            let sum = used.iter().fold(0u32, |sum, (row, codes)| sum.wrapping_add(light_of(row, codes)));
            let reciprocal = reciprocal((sum >> bits) as usize);
            doubts |= reciprocal;
            pixel[k] = ((u64::from(sum & light) * u64::from(reciprocal)) >> 32) as i32;
        }
        doubts
    }

    /// Merges whole pixels into floats; those of samples that are valid nowhere are no numbers.
    pub(super) fn floats(
        &self,
        codes: &[Codes<'_>],
        channels: Channels,
        reciprocals: &[Reciprocal],
        out: &mut [f32],
    ) {
        let bits = self.scale.bits & 31;
        let light = (1u32 << bits) - 1;
        for (at, value) in out.iter_mut().enumerate() {
            let channel = channels.of(at).min(2);
            let looked_up =
                self.tables.iter().zip(codes).map(|(t, c)| t[channel][(c.code(at) as usize).min(255)]);
            let sum = looked_up.fold(0u32, u32::wrapping_add);
            let r = reciprocals.get((sum >> bits) as usize).copied().unwrap_or_default();
            *value = (sum & light) as i32 as f32 * r.factor - r.offset;
        }
    }
}
