//! Limits on the size of a map, checked before memory is taken for its texels.

use super::{MAX_PIXELS, Raster, Refusal};

/// Texels that one byte of a file may stand for. Deflate reaches 1032 bytes a byte, so that a uniform half-float map has 172 texels
/// a byte.
const PIXELS_PER_BYTE: u64 = 200;

/// Texels that a file of any length may have.
const FREE: u64 = 1 << 16;

/// What a file may unpack to.
pub(super) struct Budget {
    /// Length of the file.
    pub bytes: u64,
    /// The user's limit, which takes the place of both defaults.
    pub max_pixels: Option<u64>,
}

impl Budget {
    /// Checks the size of an image.
    pub fn check(&self, width: u64, height: u64) -> Result<(), Refusal> {
        if width == 0 || height == 0 {
            return Err(Refusal::new(format!("{width} x {height} texels"), "at least one texel"));
        }
        let by_length = self.bytes.saturating_mul(PIXELS_PER_BYTE).max(FREE);
        let most = self.max_pixels.unwrap_or(MAX_PIXELS.min(by_length));
        if width.checked_mul(height).is_some_and(|pixels| pixels <= most) {
            return Ok(());
        }
        let found = format!("{width} x {height} texels in a file of {} bytes", self.bytes);
        Err(Refusal::new(found, format!("at most {most} texels (--max-pixels sets the limit)")))
    }

    /// An empty raster with memory reserved for its texels, which are only touched as they are decoded.
    pub fn raster(&self, width: u64, height: u64) -> Result<Raster, Refusal> {
        self.check(width, height)?;
        let size =
            |v: u64| usize::try_from(v).map_err(|_| Refusal::new(format!("a side of {v}"), "a smaller map"));
        let (width, height) = (size(width)?, size(height)?);
        let mut texels = Vec::new();
        let found = format!("{width} x {height} texels");
        let reserved = width.checked_mul(height).map(|count| texels.try_reserve_exact(count));
        match reserved {
            Some(Ok(())) => Ok(Raster { width, height, texels }),
            _ => Err(Refusal::new(found, "a map that fits into memory")),
        }
    }
}

impl Raster {
    /// Sets the texel at `index`, filling with black up to it.
    pub fn row_mut(&mut self, row: usize) -> &mut [[f32; 3]] {
        let end = (row + 1) * self.width;
        if self.texels.len() < end {
            self.texels.resize(end, [0.0; 3]);
        }
        &mut self.texels[row * self.width..end]
    }

    /// Fills what was not decoded with black.
    pub fn complete(&mut self) {
        self.texels.resize(self.width * self.height, [0.0; 3]);
    }
}
