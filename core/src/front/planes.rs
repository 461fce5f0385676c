//! The planes of a chunk of pixels.

use crate::pixel_table::CHUNK;

/// Number of pixels of a chunk, rounded up to whole pairs and whole vectors.
pub(super) const PAIRED: usize = (CHUNK + 2).next_multiple_of(16);

/// Planes of pixels, or the interleaved samples of mosaic cells.
pub(super) type Planes = [[u8; PAIRED]; 4];
