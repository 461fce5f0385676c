//! The memory requirement of a front end, and the division of its buffer.

use crate::calibration::Calibration;
use crate::error::FrontError;
use crate::healpix::{Domain, Order};
use crate::merge::{Exposure, MergeError, MergeSize, Reciprocal, merge_size};
use crate::pixel_table::{self, PixelTableSize, Run, Span, Texel, pixel_table_size};
use crate::pyramid::{Quad, pyramid_len};
use crate::response::curve_len;
use bytemuck::Pod;
use core::mem::{size_of, take};

/// Name, length and element size of one buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BufferSize {
    /// Name of the buffer in reports of memory.
    pub name: &'static str,
    /// Number of elements of the buffer.
    pub count: usize,
    /// Size of an element of the buffer, bytes.
    pub element_bytes: usize,
}

impl BufferSize {
    /// Describes a buffer of `count` elements of type `T`.
    #[must_use]
    pub const fn of<T>(name: &'static str, count: usize) -> Self {
        Self { name, count, element_bytes: size_of::<T>() }
    }

    /// Returns the size of the buffer, bytes.
    #[must_use]
    pub const fn bytes(&self) -> usize {
        self.count.saturating_mul(self.element_bytes)
    }

    /// Returns the number of 64-bit words that hold all elements of the buffer.
    const fn words(&self) -> usize {
        self.bytes().div_ceil(WORD)
    }
}

/// Number of bytes per word of the lent memory.
const WORD: usize = size_of::<u64>();

/// Number of elements of each buffer of a [`FrontEnd`](crate::FrontEnd).
///
/// ```
/// use hemilux_core::{Calibration, Exposure, Format, Lens, Sizes};
///
/// let lens = Lens::equidistant([15.5, 15.5], 9.0, 1.5)?;
/// let calibration = Calibration::try_new(lens, Format::Grey, 32, 32)?;
/// let sizes = Sizes::of(&calibration, &[Exposure { seconds: 0.01, gain: 1.0 }], 2.try_into()?)?;
/// assert_eq!(sizes.texels, 128);
/// let bytes: usize = sizes.buffers().iter().map(|buffer| buffer.bytes()).sum();
/// assert!(8 * sizes.words() >= bytes);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Sizes {
    /// Number of quads of all orders of the map: 32 bytes each.
    pub quads: usize,
    /// Number of texels of the map, with their geometry: 16 bytes each.
    pub texels: usize,
    /// Number of image rows, with the range of columns inside the image circle: 8 bytes each.
    pub spans: usize,
    /// Number of entries of the tabulated response: 4 bytes each.
    pub curve: usize,
    /// Number of runs of adjacent pixels with a common texel and weight: 4 bytes each.
    pub runs: usize,
    /// Number of weights of runs: 2 bytes each.
    pub weights: usize,
    /// Number of reciprocals of sums of exposure times: 8 bytes each.
    pub reciprocals: usize,
    /// Number of entries of the exposure tables: 4 bytes each.
    pub tables: usize,
}

impl Sizes {
    /// Computes the sizes for the arguments of [`FrontEnd::try_new`](crate::FrontEnd::try_new). Every pixel is visited, so the time is that of
    /// the constructor.
    ///
    /// # Errors
    /// The [`FrontError`]s of the constructor, except those of the memory, the response curve and the white balance.
    pub fn of(calibration: &Calibration, exposures: &[Exposure], order: Order) -> Result<Self, FrontError> {
        let image = calibration.layout.merged_size();
        let pixel_table = pixel_table_size(&calibration.merged_lens(), image, order.get())?;
        Ok(Self::fixed(calibration, order)?
            .with_pixel_table(pixel_table)
            .with_merge(merge_sizes(calibration, exposures)?))
    }

    /// Returns the sizes that do not depend on the exposures and the lens; all others are 0.
    pub(crate) fn fixed(calibration: &Calibration, order: Order) -> Result<Self, FrontError> {
        let image = calibration.layout.merged_size();
        pixel_table::check(image, order.get())?;
        Ok(Self {
            quads: pyramid_len(Domain::Hemisphere, order),
            texels: Domain::Hemisphere.quads(order.get()),
            spans: image.height as usize,
            curve: curve_len(calibration.layout.format().depth()),
            runs: 0,
            weights: 0,
            reciprocals: 0,
            tables: 0,
        })
    }

    pub(crate) fn with_pixel_table(self, pixel_table: PixelTableSize) -> Self {
        Self { runs: pixel_table.runs, weights: pixel_table.weights, ..self }
    }

    pub(crate) fn with_merge(self, merge: MergeSize) -> Self {
        Self { reciprocals: merge.reciprocals, tables: merge.tables, ..self }
    }

    /// Returns these sizes with the largest number of runs that fits into `words` words of 64 bits in addition to the buffers of fixed
    /// size.
    pub(crate) fn with_most_runs(self, words: usize) -> Self {
        let left = words.saturating_sub(self.words());
        let with = |runs| Self { runs, weights: runs, ..self };
        // Up to 3 runs fewer, since the last word of each buffer may be partly empty.
        let most = left.saturating_mul(WORD) / (size_of::<Run>() + size_of::<u16>());
        let fitting = (0..4).map(|less| with(most.saturating_sub(less)));
        fitting.into_iter().find(|sizes| sizes.words() <= words).unwrap_or(with(0))
    }

    /// Returns name, length and element size of all buffers of the front end, in their order in memory.
    #[must_use]
    pub fn buffers(&self) -> [BufferSize; 8] {
        [
            BufferSize::of::<Quad>("pyramid", self.quads),
            BufferSize::of::<Texel>("texels", self.texels),
            BufferSize::of::<Span>("spans", self.spans),
            BufferSize::of::<i32>("response table", self.curve),
            BufferSize::of::<Run>("runs", self.runs),
            BufferSize::of::<u16>("weights", self.weights),
            BufferSize::of::<Reciprocal>("reciprocals", self.reciprocals),
            BufferSize::of::<u32>("exposure tables", self.tables),
        ]
    }

    /// Returns the number of `u64` elements to lend to [`FrontEnd::try_new`](crate::FrontEnd::try_new).
    #[must_use]
    pub fn words(&self) -> usize {
        self.buffers().iter().fold(0, |sum, buffer| sum.saturating_add(buffer.words()))
    }
}

/// Returns the number of elements that the merge of `exposures` needs.
pub(crate) fn merge_sizes(
    calibration: &Calibration,
    exposures: &[Exposure],
) -> Result<MergeSize, FrontError> {
    let curve = calibration.untabulated()?;
    let scale = calibration.scale;
    if !(scale > 0.0 && scale.is_finite()) {
        return Err(MergeError::BadScale.into());
    }
    Ok(merge_size(&curve, exposures)?)
}

/// The buffers of a front end in lent memory; a buffer that does not fit is empty.
pub(crate) struct Parts<'m> {
    pub(crate) quads: &'m mut [Quad],
    pub(crate) texels: &'m mut [Texel],
    pub(crate) spans: &'m mut [Span],
    pub(crate) curve: &'m mut [i32],
    pub(crate) runs: &'m mut [Run],
    pub(crate) weights: &'m mut [u16],
    pub(crate) reciprocals: &'m mut [Reciprocal],
    pub(crate) tables: &'m mut [u32],
}

impl<'m> Parts<'m> {
    pub(crate) fn divide(mut memory: &'m mut [u64], sizes: &Sizes) -> Self {
        let memory = &mut memory;
        Self {
            quads: first(memory, sizes.quads),
            texels: first(memory, sizes.texels),
            spans: first(memory, sizes.spans),
            curve: first(memory, sizes.curve),
            runs: first(memory, sizes.runs),
            weights: first(memory, sizes.weights),
            reciprocals: first(memory, sizes.reciprocals),
            tables: first(memory, sizes.tables),
        }
    }
}

/// Splits the words of `count` elements off the front of `memory` and returns them as `T`.
pub(crate) fn first<'m, T: Pod>(memory: &mut &'m mut [u64], count: usize) -> &'m mut [T] {
    let words = BufferSize::of::<T>("", count).words();
    let (own, rest) = take(memory).split_at_mut_checked(words).unwrap_or_default();
    *memory = rest;
    bytemuck::try_cast_slice_mut(own).unwrap_or_default().get_mut(..count).unwrap_or_default()
}

/// Returns the quads of the map, which are the first buffer.
pub(crate) fn quads<'m>(memory: &'m [u64], sizes: &Sizes) -> &'m [Quad] {
    let words = BufferSize::of::<Quad>("", sizes.quads).words();
    let own = memory.get(..words).unwrap_or_default();
    bytemuck::try_cast_slice(own).unwrap_or_default()
}

/// Moves the weights from their position after `most` runs to their lower position after the `exact` number of runs.
pub(crate) fn close_gap(memory: &mut [u64], most: &Sizes, exact: &Sizes) {
    let up_to = |sizes: &Sizes, buffers: usize| -> usize {
        sizes.buffers().iter().take(buffers).fold(0, |sum, buffer| sum.saturating_add(buffer.words()))
    };
    const WEIGHTS: usize = 5;
    let to = up_to(exact, WEIGHTS);
    let from = up_to(most, WEIGHTS).max(to);
    for at in to..up_to(exact, WEIGHTS + 1) {
        // A loop instead of `copy_within`, whose panic for an invalid range the linker could not remove.
        let moved = memory.get(from - to + at).copied();
        if let (Some(slot), Some(word)) = (memory.get_mut(at), moved) {
            *slot = word;
        }
    }
}
