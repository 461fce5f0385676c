//! The fused front end: merges a burst directly into energy per HEALPix texel, without an HDR image in between.
//!
//! Each image row is processed in chunks of pixels that fit the first-level cache. A chunk is merged into integer radiances, whose prefix
//! sums are computed; the light of a run of pixels is then the difference of two prefix sums and is added to the texel of the run.

mod bin;
mod gather;
mod planes;
pub(crate) mod rows;
mod yuv;

use crate::buffer::Buffer;
use crate::color::{MAX_ENERGY, luminance};
use crate::format::{Format, Layout};
use crate::healpix::Domain;
use crate::lanes::Lanes;
use crate::merge::{Channels, Codes, MAX_EXPOSURES, MergeView, Samples};
use crate::pixel_table::{CHUNK, PixelTableView};
use crate::pyramid::{Pyramid, Quad};
use gather::{MergedChunk, PrefixSums, Products, Radiance, RunLight, Runs};
use rows::{Part, Scratch};

/// Statistics of one burst.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Coverage {
    /// Share of the hemisphere's solid angle in which even the shortest exposure is clipped, 0..=1.
    pub clipped: f64,
    /// Share of the hemisphere's solid angle outside of the field of view, 0..=1.
    pub unseen: f64,
    /// Scalar flux from below the horizon, which no light represents, divided by the flux from above.
    pub below: f64,
}

/// The reason why a burst cannot be processed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum BurstError {
    /// The number of frames differs from the number of exposures.
    FrameCount {
        /// Number of frames in the burst.
        found: usize,
        /// Number of exposures.
        expected: usize,
    },
    /// A frame has fewer samples than its layout states.
    FrameSize {
        /// Index of the frame.
        index: usize,
        /// Number of bytes (or words, for 16-bit samples) in the frame.
        found: usize,
        /// Number of bytes (or words) of the layout.
        expected: usize,
    },
    /// A frame has samples of another depth than the format.
    FrameDepth {
        /// Index of the frame.
        index: usize,
    },
    /// The size of the layout differs from that of the pixel table.
    OtherSize,
    /// The map is not a hemisphere map of the order of the pixel table.
    OtherMap,
}

impl core::fmt::Display for BurstError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::FrameCount { found, expected } => write!(f, "{found} frames, expected {expected}"),
            Self::FrameSize { index, found, expected } => {
                write!(f, "frame {index} of {found} samples, expected {expected}")
            }
            Self::FrameDepth { index } => {
                write!(f, "frame {index} of another sample depth than the response")
            }
            Self::OtherSize => write!(f, "a frame layout of another size than the pixel table's"),
            Self::OtherMap => write!(f, "a map that is not a hemisphere of the pixel table's order"),
        }
    }
}

impl core::error::Error for BurstError {}

/// Merges a burst of frames with the given `layout` into `map` and builds all orders of the map. `white_balance` multiplies red, green and
/// blue.
///
/// # Errors
/// [`BurstError`] if the frames do not match; `map` is then unchanged.
pub fn burst<Q: Buffer<Quad>>(
    frames: &[Samples<'_>],
    layout: &Layout,
    merge: &MergeView<'_>,
    pixel_table: &PixelTableView<'_>,
    white_balance: [f32; 3],
    map: &mut Pyramid<Q>,
) -> Result<Coverage, BurstError> {
    let excluded = accumulate(frames, layout, merge, pixel_table, map)?;
    Ok(finish(&excluded, layout, merge, pixel_table, white_balance, map))
}

/// First stage of [`burst`]: adds the light of each pixel to its texel. The map is invalid until [`finish`] has run.
///
/// # Errors
/// [`BurstError`] if the frames do not match; `map` is then unchanged.
pub(crate) fn accumulate<Q: Buffer<Quad>>(
    frames: &[Samples<'_>],
    layout: &Layout,
    merge: &MergeView<'_>,
    pixel_table: &PixelTableView<'_>,
    map: &mut Pyramid<Q>,
) -> Result<Excluded, BurstError> {
    check_frames(frames, layout, merge)?;
    if layout.merged_size() != pixel_table.image {
        return Err(BurstError::OtherSize);
    }
    if map.view().domain() != Domain::Hemisphere || map.view().order().get() != pixel_table.order {
        return Err(BurstError::OtherMap);
    }
    Ok(add_up(frames, layout, merge, pixel_table, map.accumulators(pixel_table.source_order)))
}

// Instruction counts and profiles find the first stage of a frame under this symbol.
#[inline(never)]
fn add_up(
    frames: &[Samples<'_>],
    layout: &Layout,
    merge: &MergeView<'_>,
    pixel_table: &PixelTableView<'_>,
    quads: &mut [Quad],
) -> Excluded {
    Scratch::with(layout.format(), merge.wants_planes(), |scratch| {
        let scratch = scratch.saturated_from(merge.saturated());
        MergedChunk::with(merge.has_products(), |merged| {
            walk(Chunks::new(frames, layout, merge, scratch, merged), pixel_table, quads)
        })
    })
}

/// Processes all spans chunk by chunk.
#[inline(never)]
fn walk(mut chunks: Chunks<'_, '_, '_>, pixel_table: &PixelTableView<'_>, quads: &mut [Quad]) -> Excluded {
    let mut excluded = Excluded::default();
    let mut runs = Runs { runs: pixel_table.runs, weights: pixel_table.weights };
    for (row, span) in pixel_table.spans.iter().enumerate() {
        let mut left = span.len as usize;
        let mut first = span.first as usize;
        while left > 0 {
            let len = left.min(CHUNK);
            chunks.add(Part { row, first, len }, &mut runs, quads, &mut excluded);
            (first, left) = (first + len, left - len);
        }
    }
    excluded
}

/// Second stage of [`burst`]: converts sums to energy and first moments, and sums the coarser orders.
pub(crate) fn finish<Q: Buffer<Quad>>(
    excluded: &Excluded,
    layout: &Layout,
    merge: &MergeView<'_>,
    pixel_table: &PixelTableView<'_>,
    white_balance: [f32; 3],
    map: &mut Pyramid<Q>,
) -> Coverage {
    let unit = merge.unit() * pixel_table.weight_unit;
    // Limits the energy so that sums stay finite for any radiance scale.
    let most = f64::from(MAX_ENERGY) / (merge.most() * pixel_table.weight_sum as f64);
    let scale = white_balance.map(|w| (f64::from(w) * unit).min(most) as f32);
    let lanes = Lanes::of(layout.format(), scale);
    map.finish(pixel_table.source_order, pixel_table.texels, &lanes);
    let below = luminance(lanes.rgb(excluded.below.map(|v| v.max(0.0))));
    let above = if below > 0.0 { map.view().total().y() } else { 0.0 };
    Coverage {
        clipped: (excluded.clipped as f64 * pixel_table.weight_unit / Domain::Hemisphere.solid_angle())
            .min(1.0),
        unseen: pixel_table.unseen,
        below: if above > 0.0 { f64::from(below / above) } else { 0.0 },
    }
}

/// Light that is not part of the map.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Excluded {
    /// Sums of light from below the horizon, per lane.
    below: [f32; 4],
    /// Sum of the weights of clipped pixels above the horizon.
    clipped: u64,
}

/// The state of the loop over chunks.
struct Chunks<'a, 'f, 's> {
    frames: &'a [Samples<'f>],
    layout: &'a Layout,
    merge: &'a MergeView<'a>,
    channels: Channels,
    scratch: Scratch<'s>,
    merged: MergedChunk<'s>,
    sums: PrefixSums,
    light: RunLight,
}

/// The channel of each sample of `format`, in the order of the lanes.
fn channels(format: Format) -> Channels {
    match (format, format.pattern()) {
        (_, Some(pattern)) => Channels::Four(pattern.channels()),
        (Format::Grey, _) => Channels::One([1]),
        (Format::Bgr24, _) => Channels::Three([2, 1, 0]),
        _ => Channels::RGB,
    }
}

impl<'a, 'f, 's> Chunks<'a, 'f, 's> {
    fn new(
        frames: &'a [Samples<'f>],
        layout: &'a Layout,
        merge: &'a MergeView<'a>,
        scratch: Scratch<'s>,
        merged: MergedChunk<'s>,
    ) -> Self {
        let (sums, light) = (PrefixSums::new(), [[0.0; 4]; _]);
        Self { frames, layout, merge, channels: channels(layout.format()), scratch, merged, sums, light }
    }

    fn add(&mut self, part: Part, runs: &mut Runs<'_>, quads: &mut [Quad], excluded: &mut Excluded) {
        let samples = self.channels.many();
        let mut codes = [Codes::Unread; MAX_EXPOSURES];
        let (frames, merge) = (self.frames, self.merge);
        let codes = self.scratch.codes(frames, self.layout, part, merge, &mut codes);
        let all = ..samples * part.len;
        let unit = match &mut self.merged {
            MergedChunk::Products(Products { sums, reciprocals }) => {
                match (sums.get_mut(all), reciprocals.get_mut(all)) {
                    (Some(a), Some(b)) => merge.products(codes, a, b),
                    _ => return,
                }
            }
            MergedChunk::Counts(counts) => match counts.get_mut(all) {
                Some(counts) => merge.counts(codes, self.channels, counts).then_some(1.0),
                None => return,
            },
        };
        if let Some(unit) = unit {
            self.sums.unit = unit;
            gather::sum_up(&self.merged, samples, part.len, &mut self.sums);
            runs.add_merged(part.len, samples, &self.sums, &mut self.light, quads, &mut excluded.below);
        } else {
            unusual(codes, self.merge, self.channels, part.len, runs, quads, excluded);
        }
    }
}

/// Adds a chunk of `len` pixels with the scalar merge. Not inlined, so that its buffer takes stack only when it is needed.
#[inline(never)]
fn unusual(
    codes: &[Codes<'_>],
    merge: &MergeView<'_>,
    channels: Channels,
    len: usize,
    runs: &mut Runs<'_>,
    quads: &mut [Quad],
    excluded: &mut Excluded,
) {
    let samples = channels.many();
    let mut values: Radiance = [0.0; _];
    let Some(radiance) = values.get_mut(..samples * len) else { return };
    if merge.samples(codes, channels, radiance) {
        let is_clipped = |j| (samples * j..samples * (j + 1)).any(|at| merge.is_clipped(codes, at));
        excluded.clipped += runs.weight(len, quads.len(), is_clipped);
    }
    runs.add_radiance(len, samples, &values, quads, &mut excluded.below);
}

fn check_frames(frames: &[Samples<'_>], layout: &Layout, merge: &MergeView<'_>) -> Result<(), BurstError> {
    if frames.len() != merge.exposures() {
        return Err(BurstError::FrameCount { found: frames.len(), expected: merge.exposures() });
    }
    let words = layout.format() == Format::Rgb48;
    let wrong = |f: &Samples<'_>| matches!(f, Samples::U16(_)) != words;
    if let Some(index) = frames.iter().position(wrong) {
        return Err(BurstError::FrameDepth { index });
    }
    if layout.format().depth() != merge.depth() {
        return Err(BurstError::FrameDepth { index: 0 });
    }
    let expected = layout.frame_samples();
    match frames.iter().position(|f| f.len() < expected) {
        Some(index) => Err(BurstError::FrameSize { index, found: frames[index].len(), expected }),
        None => Ok(()),
    }
}
