//! The merge of linear samples in 16-bit integers: exact sums, and one multiplication by a reciprocal.
//!
//! Where every exposure that saturates is longer than every one that does not, which all samples of a still scene obey, the
//! reciprocal of the exposures' sum of times is that of the shortest plus one difference per further valid exposure: no table is
//! gathered from, nothing branches, and a block of samples is a row of vector instructions. Most blocks need less: those where every
//! exposure is valid, all but the longest, or the longest in some samples.

use super::Exposure;

/// Most exposures of the unrolled loops; longer bursts go through the tables.
pub(super) const MAX_UNROLLED: usize = 4;

/// Largest reciprocal: products of two `i16`.
const MOST: u32 = i16::MAX as u32;

/// Largest relative error of a reciprocal, a fifth of what the merge may be off.
const WORST: f64 = 2e-4;

/// Largest error of the black level, codes.
const BLACK_ERROR: f64 = 0.002;

/// Samples that are merged at a time: four vectors of bytes.
const BLOCK: usize = 64;

/// A block of anything.
type Block<T> = [T; BLOCK];

/// A sample as a frame holds it.
pub(super) trait Code: Copy + Default + Ord + TryFrom<u32> {
    /// The largest.
    const MAX: Self;

    /// Its low 15 bits; what needs more is saturated.
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

/// What the loop needs to know.
#[derive(Clone, Copy, Debug)]
pub(super) struct Linear {
    /// Reciprocal of the shortest exposure alone, then the differences that each longer one adds.
    steps: [i16; MAX_UNROLLED],
    /// Reciprocal of so many exposures, from the shortest, less 1.
    whole: [i16; MAX_UNROLLED],
    /// Black level, 2^-`shift` codes.
    black: i16,
    shift: u32,
    white: u32,
    saturated: u32,
    /// Reciprocal count of the shortest exposure alone.
    one: u32,
}

impl Linear {
    /// Finds reciprocals for `exposures`, whose codes run from `black` to `white`; `None` where 16 bits do not suffice.
    pub(super) fn find(exposures: &[Exposure], (black, white): (f64, f64), saturated: u32) -> Option<Self> {
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
        let mut parts = [1.0; MAX_UNROLLED];
        let mut sum = 0.0;
        for (part, e) in parts.iter_mut().zip(exposures) {
            sum += e.seconds;
            *part = exposures[0].seconds / sum;
        }
        let parts = &parts[..many];
        let (one, error) =
            (MOST / 2..=MOST).map(|one| (one, worst(one, parts))).min_by(|a, b| a.1.total_cmp(&b.1))?;
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
        Some(Self { steps, whole, black, shift, white, saturated, one })
    }

    /// Counts of a relative exposure of 1 code in the shortest exposure.
    pub(super) fn counts_per_code(&self) -> f64 {
        f64::from(self.one) * f64::from(1u32 << self.shift)
    }

    /// Merges as many samples as `out` holds; says whether any clips in the shortest exposure or saturates in one that is shorter
    /// than a valid one, so that this loop's answer is not the merge's.
    ///
    /// # Accuracy
    /// Reciprocals are within 2e-4 of their values, sums are exact.
    pub(super) fn merge<T: Code, const N: usize>(&self, codes: [&[T]; N], out: &mut [f32]) -> bool {
        // A level that no code reaches is no limit; saturation that none reaches would need another comparison.
        let white = T::try_from(self.white).unwrap_or(T::MAX);
        let Ok(saturated) = T::try_from(self.saturated) else { return true };
        if codes.iter().any(|c| c.len() < out.len()) {
            return true;
        }
        let mut unusual = false;
        let (blocks, rest) = out.as_chunks_mut::<BLOCK>();
        let whole = codes.map(|c| c.as_chunks::<BLOCK>().0);
        for (i, out) in blocks.iter_mut().enumerate() {
            let Some(codes) = at(&whole, i) else { return true };
            unusual |= self.block(codes, (white, saturated), out);
        }
        if !rest.is_empty() {
            let mut padded = [[T::default(); BLOCK]; N];
            for (to, from) in padded.iter_mut().zip(codes) {
                to.iter_mut()
                    .zip(from.iter().skip(BLOCK * blocks.len()).take(rest.len()))
                    .for_each(|(t, f)| *t = *f);
            }
            let mut last = [0.0; BLOCK];
            unusual |= self.block(padded.each_ref(), (white, saturated), &mut last);
            rest.iter_mut().zip(last).for_each(|(to, v)| *to = v);
        }
        unusual
    }

    // A name to look for its vector instructions under.
    #[inline(never)]
    fn block<T: Code, const N: usize>(
        &self,
        codes: [&Block<T>; N],
        (white, saturated): (T, T),
        out: &mut Block<f32>,
    ) -> bool {
        let (shorter, least, most) = extremes(codes);
        if shorter >= saturated {
            return self.mixed(codes, (white, saturated), out);
        }
        let all = [codes.as_slice(), codes.get(..N - 1).unwrap_or_default()];
        if most < saturated {
            self.uniform(all[0], out);
        } else if least >= saturated && N > 1 {
            self.uniform(all[1], out);
        } else if N > 1 {
            self.mixed_in_last(codes, saturated, out);
        } else {
            return self.mixed(codes, (white, saturated), out);
        }
        false
    }

    /// Samples that are valid in all of `codes`.
    #[inline(always)]
    fn uniform<T: Code>(&self, codes: &[&Block<T>], out: &mut Block<f32>) {
        let black = self.black.wrapping_mul(codes.len() as i16);
        let reciprocal = codes.len().checked_sub(1).and_then(|i| self.whole.get(i)).copied().unwrap_or(0);
        for (j, value) in out.iter_mut().enumerate() {
            let sum = codes.iter().fold(0i16, |sum, c| sum.wrapping_add(c[j].low()));
            let sum = sum.wrapping_shl(self.shift).wrapping_sub(black);
            *value = (i32::from(sum) * i32::from(reciprocal)) as f32;
        }
    }

    /// Samples that are valid in all exposures but, some of them, the longest.
    #[inline(always)]
    fn mixed_in_last<T: Code, const N: usize>(
        &self,
        codes: [&Block<T>; N],
        saturated: T,
        out: &mut Block<f32>,
    ) {
        let (shorter, last) = (&codes[..N - 1], codes[N - 1]);
        let black = self.black.wrapping_mul(N as i16 - 1);
        let (whole, step) = (self.whole[N.saturating_sub(2)], self.steps[N - 1]);
        let (mut sums, mut reciprocals) = ([0i16; BLOCK], [0i16; BLOCK]);
        for j in 0..BLOCK {
            let sum = shorter.iter().fold(0i16, |sum, c| sum.wrapping_add(c[j].low()));
            let mask = if last[j] < saturated { -1i16 } else { 0 };
            let light = last[j].low().wrapping_shl(self.shift).wrapping_sub(self.black);
            sums[j] = sum.wrapping_shl(self.shift).wrapping_sub(black).wrapping_add(light & mask);
            reciprocals[j] = whole.wrapping_add(step & mask);
        }
        multiply(&sums, &reciprocals, out);
    }

    /// Any samples; says whether the answer is in doubt.
    fn mixed<T: Code, const N: usize>(
        &self,
        codes: [&Block<T>; N],
        (white, saturated): (T, T),
        out: &mut Block<f32>,
    ) -> bool {
        let valid = |c: T| if c < saturated { -1i16 } else { 0 };
        let mut doubts = 0i16;
        let (mut sums, mut reciprocals) = ([0i16; BLOCK], [0i16; BLOCK]);
        for j in 0..BLOCK {
            let first = codes[0][j];
            let mut shorter = valid(first);
            doubts = doubts.wrapping_sub(!shorter);
            let (mut sum, mut used, mut reciprocal) = (first.min(white).low(), 1i16, self.steps[0]);
            for (codes, step) in codes[1..].iter().zip(&self.steps[1..]) {
                let mask = valid(codes[j]);
                sum = sum.wrapping_add(codes[j].low() & mask);
                used = used.wrapping_sub(mask);
                reciprocal = reciprocal.wrapping_add(step & mask);
                doubts = doubts.wrapping_sub(mask & !shorter);
                shorter = mask;
            }
            sums[j] = sum.wrapping_shl(self.shift).wrapping_sub(used.wrapping_mul(self.black));
            reciprocals[j] = reciprocal;
        }
        multiply(&sums, &reciprocals, out);
        doubts != 0
    }
}

/// Block `i` of every exposure.
fn at<'a, T: Copy, const N: usize>(blocks: &[&'a [Block<T>]; N], i: usize) -> Option<[&'a Block<T>; N]> {
    let mut found = [blocks.first()?.get(i)?; N];
    for (slot, blocks) in found.iter_mut().zip(blocks) {
        *slot = blocks.get(i)?;
    }
    Some(found)
}

/// The largest code of all exposures but the longest; the least and the largest of that.
#[inline(always)]
fn extremes<T: Code, const N: usize>(codes: [&Block<T>; N]) -> (T, T, T) {
    let (mut shorter, mut least, mut most) = (T::default(), T::MAX, T::default());
    for j in 0..BLOCK {
        for c in &codes[..N - 1] {
            shorter = shorter.max(c[j]);
        }
        least = least.min(codes[N - 1][j]);
        most = most.max(codes[N - 1][j]);
    }
    (shorter, least, most)
}

#[inline(always)]
fn multiply(sums: &Block<i16>, reciprocals: &Block<i16>, out: &mut Block<f32>) {
    for ((value, sum), reciprocal) in out.iter_mut().zip(sums).zip(reciprocals) {
        *value = (i32::from(*sum) * i32::from(*reciprocal)) as f32;
    }
}

/// Largest relative error of `parts` of `one` once they are whole numbers.
fn worst(one: u32, parts: &[f64]) -> f64 {
    let error = |part: &f64| {
        let exact = f64::from(one) * part;
        libm::fabs(libm::round(exact) / exact - 1.0)
    };
    parts.iter().map(error).fold(0.0, f64::max)
}
