//! Limits of the sizes that blocks with DWA compression state.

use super::super::Refusal;
use exr::block::chunk::{Chunk, CompressedBlock};
use exr::compression::Compression;
use exr::meta::header::Header;

/// Positions of the counters in a block's header that state sizes after decompression: of the channels without a rule, of the run lengths before
/// and after their expansion, and the numbers of cosine coefficients.
const SIZES: [usize; 5] = [1, 6, 7, 8, 9];

/// Number of pixels to which each side of a block is extended before the cosine transform.
const TRANSFORMED: usize = 8;

/// Checks the sizes that `chunk` states: the crate exr allocates memory of these sizes before it decompresses the block.
pub(super) fn check(chunk: &Chunk, header: &Header) -> Result<(), Refusal> {
    let bytes = match &chunk.compressed_block {
        CompressedBlock::ScanLine(block) => &block.compressed_pixels_le,
        CompressedBlock::Tile(block) => &block.compressed_pixels_le,
        _ => return Ok(()),
    };
    if !matches!(header.compression, Compression::DWAA(_) | Compression::DWAB(_)) {
        return Ok(());
    }
    let bounds = header
        .get_block_data_indices(&chunk.compressed_block)
        .and_then(|indices| header.get_absolute_block_pixel_coordinates(indices))
        .map_err(|e| Refusal::new(e, super::EXPECTED))?;
    let of_pixels = |width: usize, height: usize| {
        width.saturating_mul(height).saturating_mul(header.channels.bytes_per_pixel)
    };
    if bytes.len() == of_pixels(bounds.size.x(), bounds.size.y()) {
        // A block whose compression would not be shorter is stored as it is.
        return Ok(());
    }
    let extended = |side: usize| side.saturating_add(TRANSFORMED - 1);
    // Run lengths of values that do not repeat take more bytes than the values.
    let most = of_pixels(extended(bounds.size.x()), extended(bounds.size.y())).saturating_mul(2) as u64;
    let counters = bytes.as_chunks::<8>().0;
    let sizes = SIZES.into_iter().filter_map(|at| counters.get(at)).map(|bytes| u64::from_le_bytes(*bytes));
    match sizes.max() {
        Some(size) if size > most => {
            let found =
                format!("a size of {size} in a block of {} x {} pixels", bounds.size.x(), bounds.size.y());
            Err(Refusal::new(found, format!("at most {most}")))
        }
        _ => Ok(()),
    }
}
