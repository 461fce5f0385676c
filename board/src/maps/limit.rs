//! Limits on the size of a map, checked before memory is taken for its texels.

use super::{MAX_PIXELS, Raster, Refusal};

/// Most texels per byte of a file. Deflate compresses by a factor of up to 1032, so a uniform half-float map has up to 172 texels per byte
/// of its file.
const PIXELS_PER_BYTE: u64 = 200;

/// Texels that a file of any length may have.
const FREE: u64 = 1 << 20;

/// Texels that a file of any length may have if it is compressed by the DWA methods of OpenEXR, which keep little but noise: smooth maps of
/// 4096 x 2048 texels take 15 KB.
const FREE_DWA: u64 = 1 << 23;

/// Limits on the decoded size of a file.
pub(super) struct Budget {
    /// Length of the file.
    pub bytes: u64,
    /// The user's limit, which takes the place of both defaults.
    pub max_pixels: Option<u64>,
    /// Texels that are allowed whatever the length.
    free: u64,
}

impl Budget {
    pub fn new(bytes: u64, max_pixels: Option<u64>) -> Self {
        Self { bytes, max_pixels, free: FREE }
    }

    /// The limits on a file that is compressed by a DWA method.
    pub fn of_dwa(&self) -> Self {
        Self { free: FREE_DWA, ..*self }
    }

    /// Checks the size of an image.
    pub fn check(&self, width: u64, height: u64) -> Result<(), Refusal> {
        if width == 0 || height == 0 {
            return Err(Refusal::new(format!("{width} x {height} texels"), "at least one texel"));
        }
        let by_length = self.bytes.saturating_mul(PIXELS_PER_BYTE).max(self.free);
        let most = self.max_pixels.unwrap_or(MAX_PIXELS.min(by_length));
        if width.checked_mul(height).is_some_and(|pixels| pixels <= most) {
            return Ok(());
        }
        let found = format!("{width} x {height} texels in a file of {} bytes", self.bytes);
        Err(Refusal::new(found, format!("at most {most} texels (--max-pixels sets the limit)")))
    }

    /// A black raster. Its memory is zeroed by the system at the first use of each page, so that a file takes no more than it decodes.
    pub fn raster(&self, width: u64, height: u64) -> Result<Raster, Refusal> {
        self.check(width, height)?;
        let too_large = || Refusal::new(format!("{width} x {height} texels"), "a map that fits into memory");
        let size = |v: u64| usize::try_from(v).map_err(|_| too_large());
        let (width, height) = (size(width)?, size(height)?);
        let count = width.checked_mul(height).ok_or_else(too_large)?;
        // A failed allocation would end the process: asked for once in a way that can fail.
        Vec::<[f32; 3]>::new().try_reserve_exact(count).map_err(|_| too_large())?;
        Ok(Raster { width, height, texels: vec![[0.0; 3]; count] })
    }
}

impl Raster {
    /// The texels of a row.
    pub fn row_mut(&mut self, row: usize) -> &mut [[f32; 3]] {
        &mut self.texels[row * self.width..(row + 1) * self.width]
    }
}
