//! Prefix sums over the pixels of a chunk, and their differences added to texels.

use super::mark::Mark;
use crate::healpix;
use crate::merge::{Codes, Limits};
use crate::pixel_table::{CHUNK, MAX_RUN, Run};
use crate::pyramid::Quad;
use core::ops::Range;

/// Integer radiances of a chunk: up to four samples per pixel, and four elements of padding that [`sum_up`] reads.
pub(super) type Counts = [i32; 4 * CHUNK + 4];

/// Float radiances of a chunk, in the layout of [`Counts`].
pub(super) type Radiance = [f32; 4 * CHUNK + 4];

/// Radiances of a chunk as pairs of factors, in the layout of [`Counts`].
pub(super) struct Products {
    pub(super) sums: [i16; 4 * CHUNK + 4],
    pub(super) reciprocals: [i16; 4 * CHUNK + 4],
}

/// The merged samples of a chunk of an image row.
pub(super) enum MergedChunk<'s> {
    Counts(&'s mut Counts),
    Products(&'s mut Products),
}

impl MergedChunk<'_> {
    /// Calls `f` with zeroed buffers for the radiances of a chunk: as pairs of factors if `has_products`, otherwise as integers.
    pub(super) fn with<R>(has_products: bool, f: impl FnOnce(MergedChunk<'_>) -> R) -> R {
        if has_products { products(f) } else { counts(f) }
    }
}

// Not inlined: the buffers of each variant take stack only in their own function.
#[inline(never)]
fn products<R>(f: impl FnOnce(MergedChunk<'_>) -> R) -> R {
    f(MergedChunk::Products(&mut Products { sums: [0; _], reciprocals: [0; _] }))
}

#[inline(never)]
fn counts<R>(f: impl FnOnce(MergedChunk<'_>) -> R) -> R {
    f(MergedChunk::Counts(&mut [0; _]))
}

/// Prefix sums per lane of the radiances of a chunk's pixels, modulo 2^32; differences of two sums are exact.
pub(super) struct PrefixSums {
    sums: [[i32; 4]; CHUNK],
    /// Number of radiance counts per unit of the sums.
    pub(super) unit: f32,
}

impl PrefixSums {
    pub(super) fn new() -> Self {
        Self { sums: [[0; 4]; _], unit: 1.0 }
    }

    /// Returns the prefix sums of the first `len` pixels for writing.
    pub(super) fn of_mut(&mut self, len: usize) -> &mut [[i32; 4]] {
        self.sums.get_mut(..len).unwrap_or_default()
    }

    /// Returns the prefix sums of a whole chunk for writing.
    pub(super) fn all_mut(&mut self) -> &mut [[i32; 4]; CHUNK] {
        &mut self.sums
    }

    fn of(&self, len: usize) -> &[[i32; 4]] {
        self.sums.get(..len).unwrap_or_default()
    }
}

/// Sum of the radiances of the pixels of each run of a chunk, per lane.
pub(super) type RunLight = [[f32; 4]; CHUNK];

/// Float radiances of `len` pixels with `samples` samples each.
#[derive(Clone, Copy)]
pub(super) struct Merged<'r> {
    pub(super) len: usize,
    pub(super) samples: usize,
    pub(super) radiance: &'r Radiance,
}

impl Merged<'_> {
    /// Returns the radiance of the sample `lane` of `pixel`; 0 for lanes beyond the samples of a pixel.
    fn value(&self, pixel: usize, lane: usize) -> f32 {
        let own = self.radiance.get(self.samples * pixel + lane).filter(|_| lane < self.samples);
        own.copied().unwrap_or(0.0)
    }
}

/// Weight and light of the clipped pixels of a chunk.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Clipped {
    /// Sum of the weights of the clipped pixels.
    pub(super) weight: u64,
    /// Sums per lane over the clipped pixels of radiance times weight times the cosine of the angle to the zenith.
    pub(super) light: [f32; 4],
}

/// The runs and their weights that remain to be processed.
pub(super) struct Runs<'a> {
    pub(super) runs: &'a [Run],
    pub(super) weights: &'a [u16],
}

/// Computes the prefix sums of the first `len` pixels of a chunk with `samples` lanes each.
// Not inlined: tests find its vector instructions under this symbol.
#[inline(never)]
pub(super) fn sum_up(light: &MergedChunk<'_>, samples: usize, len: usize, sums: &mut PrefixSums) {
    let sums = sums.sums.get_mut(..len).unwrap_or_default();
    match light {
        MergedChunk::Counts(counts) => match samples {
            1 => add_up(sums.iter_mut().zip(single(&**counts, len)), |own| own),
            3 => add_up(sums.iter_mut().zip(triple(&**counts, len)), |own| own),
            _ => add_up(sums.iter_mut().zip(four(&**counts, len)), |own| own),
        },
        MergedChunk::Products(Products { sums: a, reciprocals: b }) => match samples {
            1 => add_up(sums.iter_mut().zip(single(a, len).zip(single(b, len))), |(a, b)| product(a, b)),
            3 => add_up(sums.iter_mut().zip(triple(a, len).zip(triple(b, len))), |(a, b)| product(a, b)),
            _ => add_up(sums.iter_mut().zip(four(a, len).zip(four(b, len))), |(a, b)| product(a, b)),
        },
    }
}

/// Returns the lanes of the first `len` pixels with one sample each.
#[inline(always)]
fn single<T: Copy + Default>(samples: &[T], len: usize) -> impl Iterator<Item = [T; 4]> {
    samples.get(..len).unwrap_or_default().iter().map(|v| [*v, T::default(), T::default(), T::default()])
}

/// Returns the lanes of the first `len` pixels with three samples each. The fourth lane holds the next pixel's first sample and is ignored;
/// it makes each load a full vector.
#[inline(always)]
fn triple<T: Copy>(samples: &[T], len: usize) -> impl Iterator<Item = [T; 4]> {
    let of = |from: usize| {
        samples.get(from..).unwrap_or_default().as_chunks::<3>().0.get(..len).unwrap_or_default()
    };
    of(0).iter().zip(of(3)).map(|([a, b, c], [next, ..])| [*a, *b, *c, *next])
}

/// Returns the lanes of the first `len` pixels with four samples each.
#[inline(always)]
fn four<T: Copy>(samples: &[T], len: usize) -> impl Iterator<Item = [T; 4]> {
    samples.as_chunks::<4>().0.get(..len).unwrap_or_default().iter().map(|[a, b, c, d]| [*a, *b, *c, *d])
}

#[inline(always)]
fn product(sums: [i16; 4], reciprocals: [i16; 4]) -> [i32; 4] {
    core::array::from_fn(|i| i32::from(sums[i]) * i32::from(reciprocals[i]))
}

#[inline(always)]
fn add_up<'a, P>(places: impl Iterator<Item = (&'a mut [i32; 4], P)>, four: impl Fn(P) -> [i32; 4]) {
    let mut sum = [0i32; 4];
    for (to, place) in places {
        let own = four(place);
        sum = core::array::from_fn(|i| sum[i].wrapping_add(own[i]));
        *to = sum;
    }
}

/// Writes the light of each run within the first `len` pixels to `light` and returns the number of runs. On 32-bit ARM, whose vectors hold
/// no IEEE floats, this integer loop is separate from [`add`] so that it is vectorised.
#[inline(never)]
fn cut(runs: &[Run], len: usize, sums: &PrefixSums, light: &mut RunLight) -> usize {
    let sums = sums.of(len);
    let mut before = [0i32; 4];
    let mut last = usize::MAX;
    for (i, (run, light)) in runs.iter().zip(light).enumerate() {
        last = last.wrapping_add(run.len());
        // A run that ends beyond the chunk belongs to the next chunk.
        let Some(sum) = sums.get(last) else { return i };
        *light = core::array::from_fn(|lane| sum[lane].wrapping_sub(before[lane]) as f32);
        before = *sum;
    }
    runs.len().min(CHUNK)
}

/// Adds the weighted light of each run to its texel; runs whose texel index is out of range add to `below`, the light below the horizon.
#[inline(never)]
fn add<const LANES: usize>(
    runs: &[Run],
    weights: &[u16],
    unit: f32,
    light: &[[f32; 4]],
    quads: &mut [Quad],
    below: &mut [f32; 4],
) {
    for ((run, weight), light) in runs.iter().zip(weights).zip(light) {
        let weight = unit * f32::from(*weight);
        let texel = match quads.get_mut(run.texel()) {
            Some(quad) => &mut quad.energy,
            None => &mut *below,
        };
        for lane in 0..LANES.min(4) {
            texel[lane] += light[lane] * weight;
        }
    }
}

/// Does the work of [`cut`] and [`add`] in one loop, for processors whose vectors hold floats.
#[inline(never)]
fn cut_and_add(
    runs: &[Run],
    weights: &[u16],
    unit: f32,
    sums: &[[i32; 4]],
    quads: &mut [Quad],
    below: &mut [f32; 4],
) -> usize {
    let mut before = [0i32; 4];
    let mut last = usize::MAX;
    for (i, (run, weight)) in runs.iter().zip(weights).enumerate() {
        last = last.wrapping_add(run.len());
        // A run that ends beyond the chunk belongs to the next chunk.
        let Some(sum) = sums.get(last) else { return i };
        let weight = unit * f32::from(*weight);
        let texel = match quads.get_mut(run.texel()) {
            Some(quad) => &mut quad.energy,
            None => &mut *below,
        };
        for lane in 0..4 {
            texel[lane] += sum[lane].wrapping_sub(before[lane]) as f32 * weight;
        }
        before = *sum;
    }
    runs.len().min(weights.len())
}

/// Returns whether one of the codes `at` is `limit` or more.
#[inline]
fn reach(codes: &[u8], limit: u32, at: Range<usize>) -> bool {
    let codes = codes.get(at).unwrap_or_default();
    u8::try_from(limit).is_ok_and(|limit| codes.iter().any(|code| *code >= limit))
}

impl Runs<'_> {
    /// Adds the light of the first `len` pixels, computed from their prefix sums, and removes the runs of these pixels.
    pub(super) fn add_merged(
        &mut self,
        len: usize,
        samples: usize,
        sums: &PrefixSums,
        light: &mut RunLight,
        quads: &mut [Quad],
        below: &mut [f32; 4],
    ) {
        let taken = if cfg!(target_arch = "arm") {
            let taken = cut(self.runs, len, sums, light);
            let light = light.get(..taken).unwrap_or_default();
            if samples == 3 {
                // Only three lanes are added: the scalar additions of the unused lane would cost as many instructions as those of a used
                // lane.
                add::<3>(self.runs, self.weights, sums.unit, light, quads, below);
            } else {
                add::<4>(self.runs, self.weights, sums.unit, light, quads, below);
            }
            taken
        } else {
            cut_and_add(self.runs, self.weights, sums.unit, sums.of(len), quads, below)
        };
        self.skip(taken);
    }

    /// Returns weight and light of those of the first `len` pixels for which `is` returns true and whose texel is one of the `quads` texels
    /// of `order`.
    pub(super) fn clipped(
        &self,
        part: Merged<'_>,
        order: u8,
        quads: usize,
        is: impl Fn(usize) -> bool,
    ) -> Clipped {
        let mut clipped = Clipped::default();
        let mut end = 0;
        for (run, weight) in self.runs.iter().zip(self.weights) {
            let places = end..(end + run.len()).min(part.len);
            end += run.len();
            if run.texel() < quads && places.clone().any(&is) {
                let height = healpix::centre(order, run.texel() as u32).z as f32;
                for i in places.filter(|i| is(*i)) {
                    clipped.weight += u64::from(*weight);
                    for (lane, sum) in clipped.light.iter_mut().enumerate() {
                        *sum += part.value(i, lane) * f32::from(*weight) * height;
                    }
                }
            }
            if end >= part.len {
                break;
            }
        }
        clipped
    }

    /// Sets the [marks](Mark) of the texels of those of the first `len` pixels that have a code of `limits` or more.
    // Not inlined: few chunks need it.
    #[inline(never)]
    pub(super) fn mark(
        &self,
        codes: &Codes<'_>,
        samples: usize,
        len: usize,
        limits: Limits,
        quads: &mut [Quad],
    ) {
        let blocks = codes.blocks_that_reach(limits.bright.min(limits.clipped), samples);
        let at = |pixels: Range<usize>| samples * pixels.start..samples * pixels.end;
        match codes {
            Codes::Bytes(codes) => {
                self.mark_where(|limit, pixels| reach(codes, limit, at(pixels)), blocks, len, limits, quads);
            }
            Codes::Planes(planes) => {
                let reach = |limit, pixels: Range<usize>| {
                    planes.iter().any(|plane| reach(plane, limit, pixels.clone()))
                };
                self.mark_where(reach, blocks, len, limits, quads);
            }
            _ => {
                let reach = |limit, pixels| at(pixels).any(|at| codes.code(at) >= limit);
                self.mark_where(reach, blocks, len, limits, quads);
            }
        }
    }

    /// Does the work of [`Runs::mark`]. `reach` returns whether a range of pixels has a code of a limit or more; `blocks` has a bit for
    /// each block of [`MAX_RUN`] pixels, set if a code of the block reaches one of `limits`.
    #[inline]
    fn mark_where(
        &self,
        reach: impl Fn(u32, Range<usize>) -> bool,
        blocks: u32,
        len: usize,
        limits: Limits,
        quads: &mut [Quad],
    ) {
        let least = limits.bright.min(limits.clipped);
        let mut first = 0;
        for run in self.runs {
            let pixels = first..(first + run.len()).min(len);
            first = pixels.end;
            // A run is no longer than a block, so that it lies in at most two blocks.
            let may_reach = blocks.unbounded_shr((pixels.start / MAX_RUN) as u32) & 3 != 0;
            if may_reach
                && reach(least, pixels.clone())
                && let Some(quad) = quads.get_mut(run.texel())
            {
                let reach = |limit| limit == least || reach(limit, pixels.clone());
                Mark { bright: reach(limits.bright), clipped: reach(limits.clipped) }.add_to(quad);
            }
            if first >= len {
                break;
            }
        }
    }

    /// Removes the first `count` runs and their weights.
    pub(super) fn skip(&mut self, count: usize) {
        self.runs = self.runs.get(count..).unwrap_or_default();
        self.weights = self.weights.get(count..).unwrap_or_default();
    }

    /// Adds the light of the first `len` pixels, given as float radiances, and removes the runs of these pixels.
    pub(super) fn add_radiance(
        &mut self,
        len: usize,
        samples: usize,
        radiance: &Radiance,
        quads: &mut [Quad],
        below: &mut [f32; 4],
    ) {
        let merged = Merged { len, samples, radiance };
        let value = |i, lane| merged.value(i, lane);
        let (mut from, mut taken) = (0, 0);
        for (run, weight) in self.runs.iter().zip(self.weights) {
            if from >= len {
                break;
            }
            let places = from..from + run.len();
            let texel = quads.get_mut(run.texel()).map_or(&mut *below, |q| &mut q.energy);
            for (lane, sum) in texel.iter_mut().enumerate() {
                *sum += places.clone().map(|i| value(i, lane)).sum::<f32>() * f32::from(*weight);
            }
            (from, taken) = (places.end, taken + 1);
        }
        self.skip(taken);
    }
}

#[cfg(test)]
mod tests;
