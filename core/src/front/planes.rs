//! The memory for the samples of a chunk of pixels, one plane per channel.

use crate::pixel_table::CHUNK;

/// Capacity of a plane, samples: the pixels of a chunk, rounded up to whole pairs and whole vectors.
pub(super) const PAIRED: usize = (CHUNK + 2).next_multiple_of(16);

/// Four planes of 8-bit samples of a chunk, or the interleaved samples of its mosaic cells.
pub(super) type Planes = [[u8; PAIRED]; 4];
