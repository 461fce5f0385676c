//! Limits on the size of a map, checked before memory is allocated for its texels.

use super::{MAX_PIXELS, Raster, Refusal};

/// Largest accepted number of texels per byte of a map file. Deflate compresses by a factor of up to 1032, so that a uniform half-float map
/// has up to 172 texels per byte.
const PIXELS_PER_BYTE: u64 = 200;

/// Number of texels that are accepted for map files of any length.
const FREE: u64 = 1 << 20;

/// Number of texels that are accepted for map files of any length with the DWA compression of OpenEXR, which stores little for smooth maps:
/// 4096 x 2048 texels may take 15 KB.
const FREE_DWA: u64 = 1 << 23;

/// Limits on the decoded size of a map file.
pub(super) struct Budget {
    /// Length of the map file, bytes.
    pub bytes: u64,
    /// Largest number of texels that the user accepts, which replaces both default limits.
    pub max_pixels: Option<u64>,
    /// Number of texels that are accepted for a file of any length.
    free: u64,
}

impl Budget {
    pub fn new(bytes: u64, max_pixels: Option<u64>) -> Self {
        Self { bytes, max_pixels, free: FREE }
    }

    /// Returns these limits for a file with DWA compression.
    pub fn of_dwa(&self) -> Self {
        Self { free: FREE_DWA, ..*self }
    }

    /// Checks that a map of `width` by `height` texels is within the limits.
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

    /// Creates a black raster. The system zeroes its memory at the first use of each page, so that a file uses no more memory than the
    /// texels that are decoded.
    pub fn raster(&self, width: u64, height: u64) -> Result<Raster, Refusal> {
        self.check(width, height)?;
        let too_large = || Refusal::new(format!("{width} x {height} texels"), "a map that fits into memory");
        let size = |v: u64| usize::try_from(v).map_err(|_| too_large());
        let (width, height) = (size(width)?, size(height)?);
        let count = width.checked_mul(height).ok_or_else(too_large)?;
        // A failed allocation of a vector would end the process: the memory is reserved first by a call that can fail.
        Vec::<[f32; 3]>::new().try_reserve_exact(count).map_err(|_| too_large())?;
        Ok(Raster { width, height, texels: vec![[0.0; 3]; count] })
    }
}

impl Raster {
    /// Returns the texels of row `row` for changes.
    pub fn row_mut(&mut self, row: usize) -> &mut [[f32; 3]] {
        &mut self.texels[row * self.width..(row + 1) * self.width]
    }
}
