//! The fused front end: merges a burst directly into energy per HEALPix texel, without an HDR image in between.
//!
//! Each image row is processed in chunks of pixels that fit the first-level cache. A chunk is merged into integer radiances, whose prefix
//! sums are computed; the light of a run of pixels is the difference of two prefix sums and is added to the texel of the run.

mod bin;
mod chunks;
mod code_sums;
mod gather;
mod mark;
mod planes;
pub(crate) mod rows;

mod yuv;

use crate::buffer::Buffer;
use crate::color::{MAX_ENERGY, luminance};
use crate::format::{Format, Layout};
use crate::healpix::Domain;
use crate::lanes::Lanes;
use crate::merge::{MergeView, Samples};
use crate::pixel_table::{CHUNK, PixelTableView};
use crate::pyramid::{Pyramid, Quad};
use crate::tally::Tally;
use chunks::{Chunks, Target};
use gather::{MergedChunk, Runs};
pub(crate) use mark::Mark;
use rows::{Part, Scratch};

/// Statistics of one burst: the directions that are clipped or unseen, and the exposures that were read.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Coverage {
    /// Fraction of the hemisphere's solid angle in which the shortest exposure is clipped, 0..=1.
    pub clipped: f64,
    /// Horizontal irradiance, red, green and blue, of the directions in which the shortest exposure is clipped. Clipped pixels count with the
    /// radiance at which they clip, so the irradiance is a lower bound.
    pub clipped_irradiance: [f32; 3],
    /// Fraction of the hemisphere's solid angle outside of the field of view, 0..=1.
    pub unseen: f64,
    /// Mean number of exposures that were read per pixel, 1 to the number of frames; the number of frames for
    /// [`MergeMode::All`](crate::MergeMode).
    pub exposures_read: f64,
    /// Ratio of the scalar flux from below the horizon, which no light represents, to the flux from above.
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
        /// Number of exposures that the front end was created for.
        expected: usize,
    },
    /// A frame has fewer samples than its layout states.
    FrameSize {
        /// Index of the frame in the burst.
        index: usize,
        /// Number of bytes (or words, for 16-bit samples) in the frame.
        found: usize,
        /// Number of bytes (or words, for 16-bit samples) that the layout requires.
        expected: usize,
    },
    /// A frame has samples of another depth (bytes or 16-bit words) than the format.
    FrameDepth {
        /// Index of the frame in the burst.
        index: usize,
    },
    /// The image size of the layout differs from the image size of the pixel table.
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
    let mut excluded = Excluded::default();
    accumulate(frames, layout, merge, pixel_table, map, &mut excluded)?;
    Ok(finish(&excluded, layout, merge, pixel_table, white_balance, map))
}

/// Runs the first stage of [`burst`]: adds the light of each pixel to its texel, or to `excluded`. The map is invalid until [`finish`] has
/// run.
///
/// # Errors
/// [`BurstError`] if the frames do not match; `map` is then unchanged.
pub(crate) fn accumulate<Q: Buffer<Quad>>(
    frames: &[Samples<'_>],
    layout: &Layout,
    merge: &MergeView<'_>,
    pixel_table: &PixelTableView<'_>,
    map: &mut Pyramid<Q>,
    excluded: &mut Excluded,
) -> Result<(), BurstError> {
    check_frames(frames, layout, merge)?;
    if layout.merged_size() != pixel_table.image {
        return Err(BurstError::OtherSize);
    }
    if map.view().domain() != Domain::Hemisphere || map.view().order().get() != pixel_table.order {
        return Err(BurstError::OtherMap);
    }
    let quads = map.accumulators(pixel_table.source_order);
    add_up(frames, layout, merge, pixel_table, quads, excluded);
    Ok(())
}

// Instruction counts and profiles find the first stage of a frame under this symbol.
#[inline(never)]
fn add_up(
    frames: &[Samples<'_>],
    layout: &Layout,
    merge: &MergeView<'_>,
    pixel_table: &PixelTableView<'_>,
    quads: &mut [Quad],
    excluded: &mut Excluded,
) {
    Scratch::with(layout.format(), merge.wants_planes(), |scratch| {
        let scratch =
            scratch.saturated_from(merge.limits.map_or(merge.saturated(), |limits| limits.saturated));
        MergedChunk::with(merge.has_products(), |merged| {
            let tally = tally(layout, merge, pixel_table);
            walk(Chunks::new(frames, layout, merge, scratch, merged, tally), pixel_table, quads, excluded);
        });
    });
}

/// Returns the conversion of sums of codes to counts of light; `None` for formats and responses whose codes are not summed, and for pixel
/// tables with which a sum could exceed 32 bits.
fn tally(layout: &Layout, merge: &MergeView<'_>, pixel_table: &PixelTableView<'_>) -> Option<Tally> {
    let is_plain = matches!(layout.format(), Format::Rgb24 | Format::Bgr24);
    merge.tally().filter(|tally| is_plain && pixel_table.heaviest_texel <= tally.most_weight)
}

/// Processes all spans of the pixel table in chunks of at most [`CHUNK`] pixels.
#[inline(never)]
fn walk(
    mut chunks: Chunks<'_, '_, '_>,
    pixel_table: &PixelTableView<'_>,
    quads: &mut [Quad],
    excluded: &mut Excluded,
) {
    let runs = Runs { runs: pixel_table.runs, weights: pixel_table.weights };
    let order = pixel_table.source_order;
    let mut target = Target { runs, quads, order, excluded };
    for (row, span) in pixel_table.spans.iter().enumerate() {
        let mut left = span.len as usize;
        let mut first = span.first as usize;
        while left > 0 {
            let len = left.min(CHUNK);
            chunks.add(Part { row, first, len }, &mut target);
            (first, left) = (first + len, left - len);
        }
    }
}

/// Runs the second stage of [`burst`]: converts the sums of the texels to energy and first moments, and computes the coarser orders.
pub(crate) fn finish<Q: Buffer<Quad>>(
    excluded: &Excluded,
    layout: &Layout,
    merge: &MergeView<'_>,
    pixel_table: &PixelTableView<'_>,
    white_balance: [f32; 3],
    map: &mut Pyramid<Q>,
) -> Coverage {
    let lanes = lanes(layout, merge, pixel_table, white_balance);
    map.finish(pixel_table.source_order, pixel_table.texels, &lanes);
    coverage(excluded, &lanes, pixel_table, map)
}

/// Returns the conversion of the sums of [`accumulate`] to energy.
pub(crate) fn lanes(
    layout: &Layout,
    merge: &MergeView<'_>,
    pixel_table: &PixelTableView<'_>,
    white_balance: [f32; 3],
) -> Lanes {
    let unit = merge.unit() * pixel_table.weight_unit;
    // The energy is limited so that sums stay finite for any radiance scale.
    let most = f64::from(MAX_ENERGY) / (merge.most() * pixel_table.weight_sum as f64);
    let scale = white_balance.map(|w| (f64::from(w) * unit).min(most) as f32);
    Lanes::of(layout.format(), scale).with_tally(tally(layout, merge, pixel_table))
}

/// Returns the statistics of the burst in the finished `map`.
pub(crate) fn coverage<Q: Buffer<Quad>>(
    excluded: &Excluded,
    lanes: &Lanes,
    pixel_table: &PixelTableView<'_>,
    map: &Pyramid<Q>,
) -> Coverage {
    let below = luminance(lanes.rgb(excluded.below.map(|v| v.max(0.0))));
    let above = if below > 0.0 { map.view().total().y() } else { 0.0 };
    Coverage {
        clipped: (excluded.clipped as f64 * pixel_table.weight_unit / Domain::Hemisphere.solid_angle())
            .min(1.0),
        unseen: pixel_table.unseen,
        clipped_irradiance: lanes.rgb(excluded.clipped_light),
        exposures_read: excluded.read as f64 / excluded.pixels.max(1) as f64,
        below: if above > 0.0 { f64::from(below / above) } else { 0.0 },
    }
}

/// Light and pixel counts of a burst that are not stored in the map.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Excluded {
    /// Sums per lane of the light from below the horizon.
    below: [f32; 4],
    /// Sum of the weights of clipped pixels above the horizon.
    clipped: u64,
    /// Sums per lane of the light of clipped pixels times the cosine of the angle to the zenith.
    clipped_light: [f32; 4],
    /// Number of pixels of the burst that were processed.
    pixels: u32,
    /// Number of exposures that were read, summed over the pixels.
    read: u32,
}

/// Checks number, depth and length of the frames against the exposures and the layout.
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
