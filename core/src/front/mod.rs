//! The fused front end: a burst goes in, energy per texel comes out, without a full-size HDR image between.
//!
//! Rows are merged in chunks that stay in the nearest cache and added straight to the quads of the map.

mod rows;
mod yuv;

use crate::arena::Buffer;
use crate::color::{MAX_ENERGY, luminance};
use crate::format::{Format, Layout};
use crate::healpix::Domain;
use crate::merge::{Channels, Codes, MAX_EXPOSURES, MergeView, Samples};
use crate::plan::{CHUNK, PlanView, Run};
use crate::pyramid::{Lanes, Pyramid, Quad};
use rows::{Part, Scratch};

/// What a burst held besides its lights.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Seen {
    /// Share of the hemisphere's solid angle that even the shortest exposure clips.
    pub clipped: f64,
    /// Share of the hemisphere's solid angle that the lens does not see.
    pub unseen: f64,
    /// Scalar flux from below the horizon, which is left out, over the flux above.
    pub below: f64,
}

/// Frames or a map that do not fit the plan or the merge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum FrontError {
    /// Another number of frames than the merge has exposures.
    FrameCount {
        /// Frames in the burst.
        found: usize,
        /// Exposures of the merge.
        expected: usize,
    },
    /// A frame that is shorter than its layout.
    FrameSize {
        /// Which one.
        index: usize,
        /// Samples or bytes in it.
        found: usize,
        /// Samples or bytes of the layout.
        expected: usize,
    },
    /// A frame whose samples are not of the depth that the merge knows.
    FrameDepth {
        /// Which one.
        index: usize,
    },
    /// A layout of another size than the plan's.
    OtherSize,
    /// A map that is not a hemisphere of the plan's order.
    OtherMap,
}

impl core::fmt::Display for FrontError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::FrameCount { found, expected } => write!(f, "{found} frames, expected {expected}"),
            Self::FrameSize { index, found, expected } => {
                write!(f, "frame {index} of {found} samples, expected {expected}")
            }
            Self::FrameDepth { index } => {
                write!(f, "frame {index} of another sample depth than the response")
            }
            Self::OtherSize => write!(f, "a frame layout of another size than the plan's"),
            Self::OtherMap => write!(f, "a map that is not a hemisphere of the plan's order"),
        }
    }
}

impl core::error::Error for FrontError {}

/// Merges a burst whose frames lie as `layout` says into `map` and builds it.
///
/// `white_balance` multiplies the channels.
///
/// # Errors
/// [`FrontError`] when the frames do not fit; `map` is then unchanged.
pub fn burst<Q: Buffer<Quad>>(
    frames: &[Samples<'_>],
    layout: &Layout,
    merge: &MergeView<'_>,
    plan: &PlanView<'_>,
    white_balance: [f32; 3],
    map: &mut Pyramid<Q>,
) -> Result<Seen, FrontError> {
    let sums = accumulate(frames, layout, merge, plan, map)?;
    Ok(finish(&sums, layout, merge, plan, white_balance, map))
}

/// The first half of [`burst`]: adds every visited place to its texel. The map is whole again after [`finish`].
///
/// # Errors
/// [`FrontError`] when the frames do not fit; `map` is then unchanged.
pub fn accumulate<Q: Buffer<Quad>>(
    frames: &[Samples<'_>],
    layout: &Layout,
    merge: &MergeView<'_>,
    plan: &PlanView<'_>,
    map: &mut Pyramid<Q>,
) -> Result<Sums, FrontError> {
    check_frames(frames, layout, merge)?;
    if layout.places() != (plan.width, plan.height) {
        return Err(FrontError::OtherSize);
    }
    if map.view().domain() != Domain::Hemisphere || map.view().order() != plan.order {
        return Err(FrontError::OtherMap);
    }
    Ok(add_up(frames, layout, merge, plan, map.accumulators(plan.source_order)))
}

// The name is that of a frame's first half in counts and profiles.
#[inline(never)]
fn add_up(
    frames: &[Samples<'_>],
    layout: &Layout,
    merge: &MergeView<'_>,
    plan: &PlanView<'_>,
    quads: &mut [Quad],
) -> Sums {
    let format = layout.format();
    Scratch::with(format, |scratch| walk(frames, layout, merge, plan, quads, scratch))
}

/// Span after span, chunk after chunk.
#[inline(never)]
fn walk(
    frames: &[Samples<'_>],
    layout: &Layout,
    merge: &MergeView<'_>,
    plan: &PlanView<'_>,
    quads: &mut [Quad],
    scratch: Scratch<'_>,
) -> Sums {
    let radiance = [0.0; _];
    let mut chunks = Chunks { frames, layout, merge, scratch, radiance, weights: [0.0; _] };
    let mut sums = Sums::default();
    let (mut weights, mut runs) = (plan.weights, plan.runs);
    for (row, span) in plan.spans.iter().enumerate() {
        let mut left = span.len as usize;
        let mut first = span.first as usize;
        while left > 0 {
            let len = left.min(CHUNK);
            let Some((own, rest)) = weights.split_at_checked(len) else { return sums };
            weights = rest;
            chunks.add(Part { row, first, len }, own, &mut runs, quads, &mut sums);
            (first, left) = (first + len, left - len);
        }
    }
    sums
}

/// The second half of [`burst`]: energy, moments and the orders above.
pub fn finish<Q: Buffer<Quad>>(
    sums: &Sums,
    layout: &Layout,
    merge: &MergeView<'_>,
    plan: &PlanView<'_>,
    white_balance: [f32; 3],
    map: &mut Pyramid<Q>,
) -> Seen {
    let unit = merge.unit() * plan.weight_unit;
    // However bright the unit of light, no sum leaves what samplers may read.
    let most = f64::from(MAX_ENERGY) / (merge.most() * plan.weight_sum as f64);
    let scale = white_balance.map(|w| (f64::from(w) * unit).min(most) as f32);
    let lanes = Lanes::of(layout.format(), scale);
    map.finish(plan.source_order, plan.texels, &lanes);
    let below = luminance(lanes.rgb(sums.below.map(|v| v.max(0.0))));
    let above = if below > 0.0 { map.view().total().y() } else { 0.0 };
    Seen {
        clipped: (sums.clipped as f64 * plan.weight_unit / Domain::Hemisphere.solid_angle()).min(1.0),
        unseen: plan.unseen,
        below: if above > 0.0 { f64::from(below / above) } else { 0.0 },
    }
}

/// What does not go into the map.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sums {
    /// Light from below the horizon.
    below: [f32; 4],
    /// Weight of clipped places above the horizon.
    clipped: u64,
}

/// A chunk's radiance: up to four samples a place, and what [`four_lanes`] reads behind the last.
type Radiance = [f32; 4 * CHUNK + 4];

/// Where the second row of a mosaic's cells begins.
const SECOND: usize = 2 * CHUNK;

/// Merges and adds chunk after chunk.
struct Chunks<'a, 'f, 's> {
    frames: &'a [Samples<'f>],
    layout: &'a Layout,
    merge: &'a MergeView<'a>,
    scratch: Scratch<'s>,
    radiance: Radiance,
    weights: [f32; CHUNK],
}

impl Chunks<'_, '_, '_> {
    fn add(&mut self, part: Part, weights: &[u16], runs: &mut &[Run], quads: &mut [Quad], sums: &mut Sums) {
        let from = *runs;
        self.weights.iter_mut().zip(weights).for_each(|(w, q)| *w = f32::from(*q));
        let unusual = self.merge(part);
        let w = &self.weights[..part.len.min(CHUNK)];
        let below = &mut sums.below;
        match self.layout.format() {
            Format::Grey => gather_grey(runs, w, &self.radiance, quads, below),
            f if f.pattern().is_some() => gather_cells(runs, w, &self.radiance, quads, below),
            _ => gather_rgb(runs, w, &self.radiance, quads, below),
        }
        if unusual {
            sums.clipped += self.clipped(part, weights, from, quads.len());
        }
    }

    /// The rows of samples that a part's places have: their codes' place, channels and place in the radiance.
    fn rows(&self, part: Part) -> ([(Part, Channels, usize); 2], usize) {
        let Some(pattern) = self.layout.format().pattern() else {
            let (channels, samples) = match self.layout.format() {
                Format::Grey => (Channels::One([1]), 1),
                Format::Bgr24 => (Channels::Three([2, 1, 0]), 3),
                _ => (Channels::RGB, 3),
            };
            return ([(part, channels, 0); 2], samples);
        };
        let [a, b, c, d] = pattern.channels();
        let row = |i| Part { row: 2 * part.row + i, ..part };
        ([(row(0), Channels::Two([a, b]), 0), (row(1), Channels::Two([c, d]), SECOND)], 2)
    }

    /// Merges a part into `radiance`; says whether any sample may be clipped.
    fn merge(&mut self, part: Part) -> bool {
        let (rows, samples) = self.rows(part);
        let count = if samples == 2 { 2 } else { 1 };
        let mut unusual = false;
        for (part, channels, at) in rows.into_iter().take(count) {
            let mut codes = [Codes::NONE; MAX_EXPOSURES];
            let codes = self.scratch.codes(self.frames, self.layout, part, &mut codes);
            let Some(out) = self.radiance.get_mut(at..at + samples * part.len) else { continue };
            unusual |= self.merge.samples(codes, channels, out);
        }
        unusual
    }

    /// Weight of the part's clipped places above the horizon: those of texels below `texels`.
    fn clipped(&mut self, part: Part, weights: &[u16], runs: &[Run], texels: usize) -> u64 {
        let (rows, samples) = self.rows(part);
        let count = if samples == 2 { 2 } else { 1 };
        let mut clipped = [false; CHUNK];
        for (part, _, _) in rows.into_iter().take(count) {
            let mut codes = [Codes::NONE; MAX_EXPOSURES];
            let codes = self.scratch.codes(self.frames, self.layout, part, &mut codes);
            for (j, found) in clipped.iter_mut().enumerate().take(part.len) {
                *found |= (samples * j..samples * (j + 1)).any(|at| self.merge.is_clipped(codes, at));
            }
        }
        let texel_of = runs.iter().flat_map(|run| core::iter::repeat_n(run.texel(), run.len()));
        let places = weights.iter().zip(clipped).zip(texel_of);
        places.filter(|((_, c), texel)| *c && *texel < texels).map(|((w, _), _)| u64::from(*w)).sum()
    }
}

/// Adds pixels of one sample to their texels and takes their runs; what lies below the horizon, in the texel after the last, goes to
/// `below`.
fn gather_grey(
    runs: &mut &[Run],
    weights: &[f32],
    radiance: &Radiance,
    quads: &mut [Quad],
    below: &mut [f32; 4],
) {
    let mut left = weights.iter().zip(radiance);
    while left.len() > 0 {
        let Some((run, rest)) = runs.split_first() else { return };
        *runs = rest;
        let sum = left.by_ref().take(run.len()).fold(0.0, |sum, (w, v)| sum + v * w);
        add([sum, 0.0, 0.0, 0.0], run, quads, below);
    }
}

/// As [`gather_grey`], for three samples a pixel.
fn gather_rgb(
    runs: &mut &[Run],
    mut weights: &[f32],
    radiance: &Radiance,
    quads: &mut [Quad],
    below: &mut [f32; 4],
) {
    let mut values = radiance.as_slice();
    while !weights.is_empty() {
        let Some((run, rest)) = runs.split_first() else { return };
        *runs = rest;
        let Some((own, others)) = weights.split_at_checked(run.len()) else { return };
        weights = others;
        let Some((pixels, rest)) = values.split_at_checked(3 * own.len()) else { return };
        let sum = if cfg!(target_arch = "arm") { three_lanes(pixels, own) } else { four_lanes(values, own) };
        values = rest;
        add(sum, run, quads, below);
    }
}

/// Sum of pixels times weights, for cores that have no vectors of IEEE floats.
#[inline(always)]
fn three_lanes(pixels: &[f32], weights: &[f32]) -> [f32; 4] {
    let mut sum = [0.0; 3];
    for (pixel, w) in pixels.as_chunks::<3>().0.iter().zip(weights) {
        for (s, v) in sum.iter_mut().zip(pixel) {
            *s += v * w;
        }
    }
    [sum[0], sum[1], sum[2], 0.0]
}

/// The same in whole vectors: the fourth lane is the next pixel's first and means nothing.
#[inline(always)]
fn four_lanes(mut pixels: &[f32], weights: &[f32]) -> [f32; 4] {
    let mut sum = [0.0; 4];
    for w in weights {
        let Some((four, _)) = pixels.split_first_chunk::<4>() else { break };
        for (s, v) in sum.iter_mut().zip(four) {
            *s += v * w;
        }
        pixels = &pixels[3..];
    }
    sum
}

/// As [`gather_grey`], for the cells of a mosaic: two samples of each of two rows.
fn gather_cells(
    runs: &mut &[Run],
    weights: &[f32],
    radiance: &Radiance,
    quads: &mut [Quad],
    below: &mut [f32; 4],
) {
    let (first, second) = radiance.split_at(SECOND);
    let rows = first.as_chunks::<2>().0.iter().zip(second.as_chunks::<2>().0);
    let mut cells = rows.zip(weights);
    while cells.len() > 0 {
        let Some((run, rest)) = runs.split_first() else { return };
        *runs = rest;
        let mut sum = [0.0f32; 4];
        for (([a, b], [c, d]), w) in cells.by_ref().take(run.len()) {
            for (s, v) in sum.iter_mut().zip([a, b, c, d]) {
                *s += v * w;
            }
        }
        add(sum, run, quads, below);
    }
}

#[inline(always)]
fn add(sum: [f32; 4], run: &Run, quads: &mut [Quad], below: &mut [f32; 4]) {
    let to = quads.get_mut(run.texel()).map_or(below, |q| &mut q.energy);
    *to = core::array::from_fn(|i| to[i] + sum[i]);
}

fn check_frames(frames: &[Samples<'_>], layout: &Layout, merge: &MergeView<'_>) -> Result<(), FrontError> {
    if frames.len() != merge.exposures() {
        return Err(FrontError::FrameCount { found: frames.len(), expected: merge.exposures() });
    }
    let words = layout.format() == Format::Rgb48;
    let wrong = |f: &Samples<'_>| matches!(f, Samples::U16(_)) != words;
    if let Some(index) = frames.iter().position(wrong) {
        return Err(FrontError::FrameDepth { index });
    }
    if layout.format().depth() != merge.depth() {
        return Err(FrontError::FrameDepth { index: 0 });
    }
    let bytes = layout.frame_bytes();
    let expected = if words { bytes / 2 } else { bytes };
    match frames.iter().position(|f| f.len() < expected) {
        Some(index) => Err(FrontError::FrameSize { index, found: frames[index].len(), expected }),
        None => Ok(()),
    }
}
