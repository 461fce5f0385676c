//! Conversion of pictures of calibration targets to grey.

use nalgebra::Vector2;

/// A grey picture of 8-bit samples; pixel centres have integer coordinates.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Grey {
    width: usize,
    height: usize,
    pixels: Vec<u8>,
}

impl Grey {
    /// Creates a picture of `width` columns from `pixels`, row after row; `None` if they do not fill whole rows.
    #[must_use]
    pub fn new(width: usize, pixels: Vec<u8>) -> Option<Self> {
        let height = pixels.len().checked_div(width)?;
        (height > 0 && width * height == pixels.len()).then_some(Self { width, height, pixels })
    }

    /// Returns the columns and rows of the picture.
    #[must_use]
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// Returns the samples of the picture, row after row.
    #[must_use]
    pub fn pixels(&self) -> &[u8] {
        &self.pixels
    }

    /// Returns the sample of the picture at column `x` and row `y`.
    pub(super) fn code(&self, x: usize, y: usize) -> f64 {
        f64::from(self.pixels[y * self.width + x])
    }

    /// Returns whether the square with `margin` pixels on each side of the point `at` lies in the picture.
    pub(super) fn holds(&self, at: Vector2<f64>, margin: f64) -> bool {
        let inside = |v: f64, size: usize| v >= margin && v + margin <= size as f64 - 1.0;
        inside(at.x, self.width) && inside(at.y, self.height)
    }

    /// Returns the bilinear sample of the picture at the point `at`; outside of the picture, the sample of the nearest pixel.
    pub(super) fn sample(&self, at: Vector2<f64>) -> f64 {
        let x = at.x.clamp(0.0, (self.width - 1) as f64);
        let y = at.y.clamp(0.0, (self.height - 1) as f64);
        let (left, top) = (x as usize, y as usize);
        let (right, bottom) = ((left + 1).min(self.width - 1), (top + 1).min(self.height - 1));
        let (fx, fy) = (x - left as f64, y - top as f64);
        let row = |y: usize| self.code(left, y) * (1.0 - fx) + self.code(right, y) * fx;
        row(top) * (1.0 - fy) + row(bottom) * fy
    }

    /// Returns the picture at half the size, each pixel the mean of 2 x 2; `None` if fewer than 64 rows or columns would remain.
    pub(super) fn halved(&self) -> Option<Self> {
        let (width, height) = (self.width / 2, self.height / 2);
        if width.min(height) < 64 {
            return None;
        }
        let mean = |i: usize| {
            let at = 2 * (i / width) * self.width + 2 * (i % width);
            let four = [at, at + 1, at + self.width, at + self.width + 1];
            let sum: u16 = four.iter().map(|i| u16::from(self.pixels[*i])).sum();
            ((sum + 2) / 4) as u8
        };
        Some(Self { width, height, pixels: (0..width * height).map(mean).collect() })
    }

    /// Returns the picture with left and right exchanged.
    #[must_use]
    pub fn mirrored(&self) -> Self {
        let rows = self.pixels.chunks_exact(self.width);
        Self { pixels: rows.flat_map(|row| row.iter().rev().copied()).collect(), ..*self }
    }
}
