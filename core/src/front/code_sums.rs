//! Light of the parts of rows in which the longest exposure of a linear 8-bit sensor suffices: sums of codes in integers.
//!
//! The code sum of each run, times the weight of the run, is added to integers of its texel. They are stored in the memory of the texel's
//! first moment, which is computed when the map is finished. No step for a pixel or a run uses floating point.

use super::gather::{PrefixSums, RunLight, Runs};
use crate::pixel_table::{CHUNK, Run};
use crate::pyramid::Quad;
use crate::tally::Tally;

/// Codes of a chunk and their prefix sums, in buffers that the merge uses for other chunks.
pub(super) struct CodeSums<'s> {
    /// Codes above black of each pixel of the chunk; the fourth lane is 0.
    codes: &'s mut [[i16; 4]],
    /// Prefix sums of the codes per lane, modulo 2^32.
    sums: &'s mut [[i32; 4]; CHUNK],
}

impl<'s> CodeSums<'s> {
    pub(super) fn new(sums: &'s mut PrefixSums, light: &'s mut RunLight) -> Self {
        Self { codes: bytemuck::cast_slice_mut(light.as_mut_slice()), sums: sums.all_mut() }
    }

    /// Computes the prefix sums of `codes`, which has three codes per pixel.
    pub(super) fn sum_up(&mut self, codes: &[u8], tally: &Tally) {
        let pixels = codes.as_chunks::<3>().0;
        self.above_black(pixels, tally.shift, tally.black);
        self.add_up(pixels.len());
    }

    // Not inlined: tests find its vector instructions under this symbol.
    #[inline(never)]
    fn above_black(&mut self, pixels: &[[u8; 3]], shift: u32, black: i16) {
        let above = |code: u8| i16::from(code).wrapping_shl(shift).wrapping_sub(black);
        for (to, [a, b, c]) in self.codes.iter_mut().zip(pixels) {
            *to = [above(*a), above(*b), above(*c), 0];
        }
    }

    // Not inlined: tests find its vector instructions under this symbol.
    #[inline(never)]
    fn add_up(&mut self, len: usize) {
        let mut sum = [0i32; 4];
        let (sums, codes) = (self.sums.get_mut(..len), self.codes.get(..len));
        for (to, own) in sums.unwrap_or_default().iter_mut().zip(codes.unwrap_or_default()) {
            sum = core::array::from_fn(|lane| sum[lane].wrapping_add(i32::from(own[lane])));
            *to = sum;
        }
    }

    /// Adds the codes of the runs of the first `len` pixels to their texels and removes these runs; codes from below the horizon are converted
    /// to counts and added to `below`.
    pub(super) fn add(
        &self,
        len: usize,
        tally: &Tally,
        runs: &mut Runs<'_>,
        quads: &mut [Quad],
        below: &mut [f32; 4],
    ) {
        let mut rest = Quad::default();
        let taken = self.add_runs(len, runs.runs, runs.weights, quads, &mut rest);
        if rest.moment.iter().any(|sum| sum.to_bits() != 0) {
            self.add_below(runs, taken, quads.len(), tally, below);
        }
        runs.skip(taken);
    }

    /// Adds the weighted code sum of each run that ends within the first `len` pixels to its texel and returns the number of these runs. Runs
    /// without a texel are added to `rest`.
    // Not inlined: tests find its vector instructions under this symbol.
    #[inline(never)]
    fn add_runs(
        &self,
        len: usize,
        runs: &[Run],
        weights: &[u16],
        quads: &mut [Quad],
        rest: &mut Quad,
    ) -> usize {
        let len = len.min(CHUNK);
        let mut before = [0i32; 4];
        let mut last = u8::MAX;
        for (i, (run, weight)) in runs.iter().zip(weights).enumerate() {
            last = last.wrapping_add(run.len() as u8);
            // A run that ends beyond the chunk belongs to the next chunk.
            if usize::from(last) >= len {
                return i;
            }
            let sum = self.sums[usize::from(last)];
            let quad = quads.get_mut(run.texel()).unwrap_or(&mut *rest);
            let (texel, weight): (&mut [i32; 4], _) =
                (bytemuck::cast_mut(&mut quad.moment), i32::from(*weight));
            let own: [i32; 4] = core::array::from_fn(|lane| sum[lane].wrapping_sub(before[lane]));
            *texel = core::array::from_fn(|lane| texel[lane].wrapping_add(own[lane].wrapping_mul(weight)));
            before = sum;
        }
        runs.len().min(weights.len())
    }

    /// Adds the light of those of the first `taken` runs whose texel index is `texels` or more to `below`, in counts.
    #[cold]
    fn add_below(&self, runs: &Runs<'_>, taken: usize, texels: usize, tally: &Tally, below: &mut [f32; 4]) {
        let mut first = 0;
        for (run, weight) in runs.runs.iter().zip(runs.weights).take(taken) {
            let end = first + run.len();
            let sum = |end: usize| {
                end.checked_sub(1).and_then(|last| self.sums.get(last)).copied().unwrap_or_default()
            };
            if run.texel() >= texels {
                let weight = tally.unit * f32::from(*weight);
                for ((below, after), before) in below.iter_mut().zip(sum(end)).zip(sum(first)) {
                    *below += after.wrapping_sub(before) as f32 * weight;
                }
            }
            first = end;
        }
    }
}
