//! How much memory a front end needs, and how one lent buffer is divided.

use crate::calibration::Calibration;
use crate::error::FrontError;
use crate::healpix::{Domain, Order};
use crate::merge::{Exposure, MergeError, MergeSize, Reciprocal, merge_size};
use crate::pixel_table::{self, PixelTableSize, Run, Span, Texel, pixel_table_size};
use crate::pyramid::{Quad, pyramid_len};
use crate::response::curve_len;
use bytemuck::Pod;
use core::mem::{size_of, take};

/// One part of the memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BufferSize {
    /// What it holds.
    pub name: &'static str,
    /// Elements.
    pub count: usize,
    /// Bytes of an element.
    pub element_bytes: usize,
}

impl BufferSize {
    /// `count` elements of type `T`.
    #[must_use]
    pub const fn of<T>(name: &'static str, count: usize) -> Self {
        Self { name, count, element_bytes: size_of::<T>() }
    }

    /// Bytes of all elements.
    #[must_use]
    pub const fn bytes(&self) -> usize {
        self.count.saturating_mul(self.element_bytes)
    }

    /// Words of 64 bits that hold all elements.
    const fn words(&self) -> usize {
        self.bytes().div_ceil(WORD)
    }
}

/// Bytes of a word of the lent memory.
const WORD: usize = size_of::<u64>();

/// Elements of each buffer of a [`FrontEnd`](crate::FrontEnd).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Sizes {
    /// Sums over quads of the map: 32 bytes each.
    pub quads: usize,
    /// Geometry of the map's texels: 16 bytes each.
    pub texels: usize,
    /// Columns that the lens sees in each image row: 8 bytes each.
    pub spans: usize,
    /// Entries of the response curve: 4 bytes each.
    pub curve: usize,
    /// Runs of pixels that share a texel: 4 bytes each.
    pub runs: usize,
    /// Solid angle of each run's pixels: 2 bytes each.
    pub weights: usize,
    /// Reciprocals of sums of exposure times: 8 bytes each.
    pub reciprocals: usize,
    /// Entries of the tables of the exposures: 4 bytes each.
    pub tables: usize,
}

impl Sizes {
    /// What a front end of these arguments needs. It visits every pixel, as [`FrontEnd::try_new`](crate::FrontEnd::try_new) does.
    ///
    /// # Errors
    /// [`FrontError`]: those of the constructor, but for the memory, the curve and the white balance, which need no size.
    pub fn of(calibration: &Calibration, exposures: &[Exposure], order: Order) -> Result<Self, FrontError> {
        let image = calibration.layout.merged_size();
        let pixel_table = pixel_table_size(&calibration.merged_lens(), image, order.get())?;
        Ok(Self::fixed(calibration, order)?
            .with_pixel_table(pixel_table)
            .with_merge(merge_sizes(calibration, exposures)?))
    }

    /// The sizes that follow from the image's rows, the order and the depth alone.
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

    /// As many runs as fit into `words` of 64 bits beside the buffers of fixed size.
    pub(crate) fn with_most_runs(self, words: usize) -> Self {
        let left = words.saturating_sub(self.words());
        let with = |runs| Self { runs, weights: runs, ..self };
        // Less by what the last word of each buffer leaves empty.
        let most = left.saturating_mul(WORD) / (size_of::<Run>() + size_of::<u16>());
        let fitting = (0..4).map(|less| with(most.saturating_sub(less)));
        fitting.into_iter().find(|sizes| sizes.words() <= words).unwrap_or(with(0))
    }

    /// The buffers one by one, in the order in which they lie.
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

    /// Words of 64 bits to lend for all of them.
    #[must_use]
    pub fn words(&self) -> usize {
        self.buffers().iter().fold(0, |sum, buffer| sum.saturating_add(buffer.words()))
    }
}

/// Elements that the merge of `exposures` needs.
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

/// The buffers in lent memory; a buffer that the memory is too short for is empty.
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

/// Takes the words of `count` elements from the front of `memory`.
fn first<'m, T: Pod>(memory: &mut &'m mut [u64], count: usize) -> &'m mut [T] {
    let words = BufferSize::of::<T>("", count).words();
    let (own, rest) = take(memory).split_at_mut_checked(words).unwrap_or_default();
    *memory = rest;
    bytemuck::try_cast_slice_mut(own).unwrap_or_default().get_mut(..count).unwrap_or_default()
}

/// The quads of the map, which come first.
pub(crate) fn quads<'m>(memory: &'m [u64], sizes: &Sizes) -> &'m [Quad] {
    let words = BufferSize::of::<Quad>("", sizes.quads).words();
    let own = memory.get(..words).unwrap_or_default();
    bytemuck::try_cast_slice(own).unwrap_or_default()
}

/// Moves the weights that `most` places to where `exact`, which has fewer runs, does.
pub(crate) fn close_gap(memory: &mut [u64], most: &Sizes, exact: &Sizes) {
    let up_to = |sizes: &Sizes, buffers: usize| -> usize {
        sizes.buffers().iter().take(buffers).fold(0, |sum, buffer| sum.saturating_add(buffer.words()))
    };
    const WEIGHTS: usize = 5;
    let to = up_to(exact, WEIGHTS);
    let from = up_to(most, WEIGHTS).max(to);
    for at in to..up_to(exact, WEIGHTS + 1) {
        // A loop in place of `copy_within`, whose panic for a wrong range a linker cannot rule out.
        let moved = memory.get(from - to + at).copied();
        if let (Some(slot), Some(word)) = (memory.get_mut(at), moved) {
            *slot = word;
        }
    }
}
