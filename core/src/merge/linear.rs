//! Merge of linear samples in 16-bit integers: an exact sum of codes times the reciprocal of the sum of times.
//!
//! A sample that saturates in one exposure saturates in every longer one if the scene is still. The reciprocal for the valid exposures is
//! then the reciprocal for the shortest exposure plus one difference per further valid exposure: no table lookup and no branch, so a block
//! of samples maps to vector instructions. Most blocks have a simpler case: all samples are valid in every exposure, in all exposures but
//! the longest, or in all of them with the longest valid for some samples only.

use super::{COUNT_BITS, Exposure};
use crate::response::Levels;
use crate::tally::Tally;
use core::num::NonZeroU32;

/// Largest number of exposures for which the loops are unrolled; longer bursts are merged by tables.
pub(super) const MAX_UNROLLED: usize = 4;

/// Largest reciprocal: a radiance is the product of two `i16`.
const MOST: u32 = i16::MAX as u32;

/// Largest relative error of a rounded reciprocal: a fifth of the accuracy of the merge.
const WORST: f64 = 2e-4;

/// Largest rounding error of the black level that is accepted, codes.
const BLACK_ERROR: f64 = 0.002;

/// Number of samples per iteration of a merge: the lanes of a 128-bit vector of 16-bit integers.
const BLOCK: usize = 8;

/// Number of codes per iteration of loops that only compare.
const WIDE: usize = 16;

type Block<T> = [T; BLOCK];

/// The integer type of a sample.
pub(super) trait Code: Copy + Default + Ord + TryFrom<u32> {
    /// Largest value that a sample of the type can have.
    const MAX: Self;

    /// Returns the low 15 bits of the sample; samples that need more bits are saturated and masked out.
    fn low(self) -> i16;
}

impl Code for u8 {
    const MAX: Self = Self::MAX;

    #[inline]
    fn low(self) -> i16 {
        i16::from(self)
    }
}

impl Code for u16 {
    const MAX: Self = Self::MAX;

    #[inline]
    fn low(self) -> i16 {
        self as i16
    }
}

/// The constants of the linear loop for one set of exposures.
#[derive(Clone, Copy, Debug)]
pub(super) struct Linear {
    /// Reciprocal of the shortest exposure, then the difference that each longer exposure adds.
    steps: [i16; MAX_UNROLLED],
    /// Reciprocal of the sum of the i + 1 shortest exposures.
    whole: [i16; MAX_UNROLLED],
    /// Black level, in units of 2^-`shift` codes.
    black: i16,
    shift: u8,
    white: u32,
    saturated: u32,
    /// Reciprocal of the shortest exposure before rounding to 16 bits, from which the other reciprocals are derived.
    one: NonZeroU32,
}

/// The constants of the linear loop for the exposures from one index to the last.
#[derive(Clone, Copy, Debug)]
pub(super) struct Suffix {
    pub(super) linear: Linear,
    /// Number of counts of the merge of all exposures that one count of the merge of these exposures equals.
    pub(super) unit: f32,
}

/// The constants for all exposures, and for the exposures from the second, the third and the fourth on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Suffixes([Option<Suffix>; MAX_UNROLLED]);

impl Suffixes {
    /// Finds the constants of every suffix of `exposures`; a suffix without precise reciprocals is absent. `None` if all exposures together
    /// have none.
    pub(super) fn find(exposures: &[Exposure], levels: Levels, saturated: u32) -> Option<Self> {
        let all = Linear::find(exposures, levels, saturated)?;
        let counts = |linear: &Linear, first: &Exposure| linear.counts_per_code() * first.seconds;
        let one = counts(&all, exposures.first()?);
        let mut suffixes = [None; MAX_UNROLLED];
        for (i, (slot, first)) in suffixes.iter_mut().zip(exposures).enumerate() {
            let linear =
                if i == 0 { Some(all) } else { Linear::find(exposures.get(i..)?, levels, saturated) };
            *slot = linear.map(|linear| Suffix { linear, unit: (one / counts(&linear, first)) as f32 });
        }
        Some(Self(suffixes))
    }

    /// Returns the constants for the exposures from index `from` to the last; `None` if there are none.
    pub(super) fn of(&self, from: usize) -> Option<&Suffix> {
        self.0.get(from)?.as_ref()
    }

    /// Returns the conversion of a sum of codes of the longest of `count` exposures to a count of light; `None` for no exposure.
    pub(super) fn tally(&self, count: usize) -> Option<Tally> {
        let Suffix { linear, unit } = self.of(count.checked_sub(1)?)?;
        let most_weight = i32::MAX as u32 / (255 << linear.shift);
        Some(Tally {
            black: linear.black,
            shift: linear.shift.into(),
            most_weight,
            unit: unit * f32::from(linear.whole[0]),
        })
    }

    /// Returns the number of radiance counts per code above black in the shortest exposure.
    pub(super) fn counts_per_code(&self) -> f64 {
        self.of(0).map_or(0.0, |all| all.linear.counts_per_code())
    }
}

impl Linear {
    /// Finds reciprocals for `exposures` of samples with the given `levels`; `None` if 16 bits are not precise enough.
    pub(super) fn find(exposures: &[Exposure], levels: Levels, saturated: u32) -> Option<Self> {
        let Levels { black, white } = levels;
        let gain = exposures.first()?.gain;
        let many = exposures.len();
        let too_negative = black > white - black;
        if many > MAX_UNROLLED || too_negative || exposures.iter().any(|e| e.gain != gain) {
            return None;
        }
        let shift = (0..8).find(|shift| {
            let scaled = black * f64::from(1u32 << shift);
            libm::fabs(libm::round(scaled) - scaled) <= BLACK_ERROR * f64::from(1u32 << shift)
        })?;
        let white = libm::floor(white) as u32;
        if (white << shift) as usize * many > i16::MAX as usize {
            return None;
        }
        let most = MOST.min(((1 << COUNT_BITS) - 1) / (white << shift).max(1));
        let mut parts = [1.0; MAX_UNROLLED];
        let mut sum = 0.0;
        for (part, e) in parts.iter_mut().zip(exposures) {
            sum += e.seconds;
            *part = exposures[0].seconds / sum;
        }
        let parts = &parts[..many];
        let (one, error) =
            (most / 2..=most).map(|one| (one, worst(one, parts))).min_by(|a, b| a.1.total_cmp(&b.1))?;
        if error > WORST {
            return None;
        }
        let (mut steps, mut whole) = ([0; MAX_UNROLLED], [0; MAX_UNROLLED]);
        let mut last = 0;
        for ((step, whole), part) in steps.iter_mut().zip(&mut whole).zip(parts) {
            *whole = libm::round(f64::from(one) * part) as i16;
            *step = *whole - last;
            last = *whole;
        }
        let black = libm::round(black * f64::from(1u32 << shift)) as i16;
        let (shift, one) = (shift as u8, NonZeroU32::new(one)?);
        Some(Self { steps, whole, black, shift, white, saturated, one })
    }

    /// Returns the number of radiance counts per code above black in the shortest exposure.
    pub(super) fn counts_per_code(&self) -> f64 {
        f64::from(self.one.get()) * f64::from(1u32 << self.shift)
    }

    /// Merges samples into `sums` and `reciprocals`, whose products are the radiances. Returns `false` if a sample is clipped in the
    /// shortest exposure, or saturated in an exposure that is shorter than a valid one: the products are then not the radiances.
    ///
    /// # Accuracy
    /// Reciprocals are within 2e-4 of their exact values; sums are exact.
    // Not inlined: tests find its vector instructions under this symbol.
    #[inline(never)]
    pub(super) fn merge<T: Code, const N: usize>(
        &self,
        codes: [&[T]; N],
        sums: &mut [i16],
        reciprocals: &mut [i16],
    ) -> bool {
        // A white level above the type's range clips no sample. The comparison does not support a saturation level above that range.
        let white = T::try_from(self.white).unwrap_or(T::MAX);
        let count = sums.len().min(reciprocals.len());
        if codes.iter().any(|c| c.len() < count) {
            return false;
        }
        let codes = codes.map(|c| c.get(..count).unwrap_or_default());
        let (sums, reciprocals) = (first_of(sums, count), first_of(reciprocals, count));
        if N == 1 && self.saturated == u32::MAX {
            self.each_block(&mut AllBut::<0>, codes, sums, reciprocals);
            return true;
        }
        let Ok(saturated) = T::try_from(self.saturated) else { return false };
        let [shorter @ .., longest] = &codes[..] else { return false };
        let most = extreme(longest, T::max);
        let is_certain = shorter.iter().all(|c| extreme(c, T::max) < saturated);
        if !is_certain || (N == 1 && most >= saturated) {
            let mut any = Any { white, saturated, doubts: [0; BLOCK] };
            self.each_block(&mut any, codes, sums, reciprocals);
            return any.doubts == [0; BLOCK];
        }
        if most < saturated {
            self.each_block(&mut AllBut::<0>, codes, sums, reciprocals);
        } else if extreme(longest, T::min) >= saturated {
            self.each_block(&mut AllBut::<1>, codes, sums, reciprocals);
        } else {
            self.each_block(&mut LongestOr { saturated }, codes, sums, reciprocals);
        }
        true
    }

    /// Merges samples block by block. The last block overlaps its predecessor; if there are fewer samples than a block has, they are padded
    /// with zeros.
    #[inline(always)]
    fn each_block<T: Code, const N: usize>(
        &self,
        case: &mut impl Case<T, N>,
        codes: [&[T]; N],
        sums: &mut [i16],
        reciprocals: &mut [i16],
    ) {
        let zeros = [T::default(); BLOCK];
        let blocks = codes.map(|c| c.as_chunks::<BLOCK>().0);
        let places = sums.as_chunks_mut::<BLOCK>().0.iter_mut().zip(reciprocals.as_chunks_mut::<BLOCK>().0);
        for (i, (sums, reciprocals)) in places.enumerate() {
            [*sums, *reciprocals] = case.merge(self, blocks.map(|blocks| blocks.get(i).unwrap_or(&zeros)));
        }
        if let (Some(sums), Some(reciprocals)) = (sums.last_chunk_mut(), reciprocals.last_chunk_mut()) {
            [*sums, *reciprocals] = case.merge(self, codes.map(|c| c.last_chunk().unwrap_or(&zeros)));
            return;
        }
        let padded = codes.map(|c| {
            let mut padded = zeros;
            padded.iter_mut().zip(c).for_each(|(to, code)| *to = *code);
            padded
        });
        let [own_sums, own_reciprocals] = case.merge(self, padded.each_ref());
        sums.iter_mut().zip(own_sums).for_each(|(to, own)| *to = own);
        reciprocals.iter_mut().zip(own_reciprocals).for_each(|(to, own)| *to = own);
    }
}

/// A validity pattern of the samples of a row, with the loop for it.
trait Case<T: Code, const N: usize> {
    fn merge(&mut self, linear: &Linear, codes: [&Block<T>; N]) -> [Block<i16>; 2];
}

/// The case in which every sample is valid in all exposures but the `LESS` longest.
struct AllBut<const LESS: usize>;

impl<T: Code, const N: usize, const LESS: usize> Case<T, N> for AllBut<LESS> {
    #[inline(always)]
    fn merge(&mut self, linear: &Linear, codes: [&Block<T>; N]) -> [Block<i16>; 2] {
        let many = N.saturating_sub(LESS);
        let black = linear.black.wrapping_mul(many as i16);
        let mut sums = [0i16; BLOCK];
        for (j, to) in sums.iter_mut().enumerate() {
            let sum = codes.iter().take(many).fold(0i16, |sum, c| sum.wrapping_add(c[j].low()));
            *to = sum.wrapping_shl(linear.shift.into()).wrapping_sub(black);
        }
        let whole = many.checked_sub(1).and_then(|i| linear.whole.get(i));
        [sums, [whole.copied().unwrap_or(0); BLOCK]]
    }
}

/// The case in which every sample is valid in all exposures but the longest, and some samples are valid in the longest as well.
struct LongestOr<T> {
    saturated: T,
}

/// The case of samples of any validity.
struct Any<T> {
    white: T,
    saturated: T,
    /// Not 0 in each lane whose result is not the radiance.
    doubts: Block<i16>,
}

impl<T: Code, const N: usize> Case<T, N> for LongestOr<T> {
    #[inline(always)]
    fn merge(&mut self, linear: &Linear, codes: [&Block<T>; N]) -> [Block<i16>; 2] {
        let black = linear.black.wrapping_mul(N as i16 - 1);
        let (whole, step) = (linear.whole[N.saturating_sub(2)], linear.steps[N - 1]);
        let [mut sums, mut reciprocals] = [[0; BLOCK]; 2];
        for (j, (sum, reciprocal)) in sums.iter_mut().zip(&mut reciprocals).enumerate() {
            let shorter = codes.iter().take(N - 1).fold(0i16, |sum, c| sum.wrapping_add(c[j].low()));
            let last = codes[N - 1][j];
            let mask = if last < self.saturated { -1i16 } else { 0 };
            let light = last.low().wrapping_shl(linear.shift.into()).wrapping_sub(linear.black);
            *sum = shorter.wrapping_shl(linear.shift.into()).wrapping_sub(black).wrapping_add(light & mask);
            *reciprocal = whole.wrapping_add(step & mask);
        }
        [sums, reciprocals]
    }
}

impl<T: Code, const N: usize> Case<T, N> for Any<T> {
    #[inline(always)]
    fn merge(&mut self, linear: &Linear, codes: [&Block<T>; N]) -> [Block<i16>; 2] {
        let valid = |c: T| if c < self.saturated { -1i16 } else { 0 };
        let [mut sums, mut reciprocals] = [[0; BLOCK]; 2];
        for (j, (value, factor)) in sums.iter_mut().zip(&mut reciprocals).enumerate() {
            let first = codes[0][j];
            let mut shorter = valid(first);
            let mut doubts = !shorter;
            let (mut sum, mut used, mut reciprocal) = (first.min(self.white).low(), 1i16, linear.steps[0]);
            for (codes, step) in codes[1..].iter().zip(&linear.steps[1..]) {
                let code = codes[j];
                let mask = valid(code);
                sum = sum.wrapping_add(code.low() & mask);
                used = used.wrapping_sub(mask);
                reciprocal = reciprocal.wrapping_add(step & mask);
                doubts |= mask & !shorter;
                shorter = mask;
            }
            self.doubts[j] |= doubts;
            *value = sum.wrapping_shl(linear.shift.into()).wrapping_sub(used.wrapping_mul(linear.black));
            *factor = reciprocal;
        }
        [sums, reciprocals]
    }
}

/// Returns the first `count` elements of `values`.
#[inline(always)]
fn first_of(values: &mut [i16], count: usize) -> &mut [i16] {
    values.get_mut(..count).unwrap_or_default()
}

/// Returns the minimum or maximum of `codes`, as `of` selects; the default value for no codes. Computing both in one loop was not
/// vectorised on AArch64.
#[inline(always)]
pub(super) fn extreme<T: Code>(codes: &[T], of: impl Fn(T, T) -> T) -> T {
    let (Some(first), Some(last)) = (codes.first_chunk::<WIDE>(), codes.last_chunk::<WIDE>()) else {
        return codes.iter().copied().reduce(&of).unwrap_or_default();
    };
    let mut found = *first;
    let mut take = |block: &[T; WIDE]| {
        for (found, code) in found.iter_mut().zip(block) {
            *found = of(*found, *code);
        }
    };
    // Addresses ascend and the last block is read at the end: hardware prefetches ascending reads.
    codes.as_chunks::<WIDE>().0.iter().for_each(&mut take);
    take(last);
    found.into_iter().reduce(&of).unwrap_or_default()
}

/// Returns the largest relative error of `one` x `parts` after rounding to integers.
fn worst(one: u32, parts: &[f64]) -> f64 {
    let error = |part: &f64| {
        let exact = f64::from(one) * part;
        libm::fabs(libm::round(exact) / exact - 1.0)
    };
    parts.iter().map(error).fold(0.0, f64::max)
}
