//! Relative exposures on a grid of pixels of a frame, for every pixel format: of green, of luma, or of the samples of a mosaic.
//!
//! The grid is coarse and its pixels are read one by one: decoding whole rows took a fifth of the time of a merge.

use crate::calibration::{Calibration, Frame};
use hemilux_core::format::Layout;
use hemilux_core::response::{CURVE_BITS, Curve, curve_len};
use hemilux_core::{ResponseError, read_luma};

/// Number of rows of the grid of compared pixels.
pub(super) const ROWS: usize = 16;

/// Rows of the grid with a property.
pub(super) type RowSet = [bool; ROWS];

/// Adds the rows of `other` to `rows`.
pub(super) fn unite(rows: &mut RowSet, other: &RowSet) {
    rows.iter_mut().zip(other).for_each(|(row, other)| *row |= other);
}

/// Largest number of pixels in a row of the grid of compared pixels.
const COLUMNS: usize = 64;

/// Number of codes above the black level from which a sample is compared.
const LEAST_CODES: f64 = 8.0;

/// Bounds of the least relative exposure that is compared ([`Grid::least`]).
const LEAST: f64 = 1.0 / 128.0;
const MOST_LEAST: f64 = 1.0 / 32.0;

/// Value in place of the relative exposure of a saturated sample.
pub(super) const SATURATED: f32 = 2.0;

/// Positions of the grid's pixels in a frame, and the conversion of codes to relative exposures.
#[derive(Debug)]
pub(super) struct Grid {
    layout: Layout,
    curve: Curve<Vec<i32>>,
    table_len: usize,
    /// Number of pixels in a row of the grid.
    columns: usize,
    /// Least relative exposure of a sample that is compared: below it, quantisation and noise dominate.
    pub least: f32,
    /// Relative exposure of one code above the black level.
    pub code: f32,
    /// Distance between neighbouring pixels of the grid, pixels of the frame.
    step: usize,
}

/// Relative exposures of the grid's samples, row by row: 0 to 1, or [`SATURATED`].
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Sampled {
    values: Vec<f32>,
    per_row: usize,
}

impl Sampled {
    pub fn rows(&self) -> impl Iterator<Item = &[f32]> {
        self.values.chunks_exact(self.per_row.max(1))
    }

    pub fn bytes(&self) -> usize {
        size_of::<f32>() * self.values.len()
    }

    /// Copies the samples of `other`, which has the same grid.
    pub fn copy_from(&mut self, other: &Self) {
        self.values.copy_from_slice(&other.values);
    }
}

impl Grid {
    pub fn try_new(calibration: &Calibration) -> Result<Self, ResponseError> {
        let layout = calibration.layout;
        let depth = layout.format().depth();
        let table_len = curve_len(depth);
        let curve = Curve::try_new(&calibration.response, depth, calibration.levels, vec![0; table_len])?;
        let width = layout.width() as usize;
        let codes = calibration.levels.white - calibration.levels.black;
        let least = (LEAST_CODES / codes).clamp(LEAST, MOST_LEAST) as f32;
        let step = width.div_ceil(COLUMNS).max(1);
        let code = codes.recip() as f32;
        Ok(Self { layout, curve, least, code, table_len, columns: width.div_ceil(step), step })
    }

    /// Returns the number of samples of a frame.
    pub fn len(&self) -> usize {
        ROWS * self.columns
    }

    pub fn bytes(&self) -> usize {
        size_of::<i32>() * self.table_len
    }

    pub fn empty(&self) -> Sampled {
        Sampled { values: vec![0.0; self.len()], per_row: self.columns }
    }

    /// Converts the grid's samples of `frame` to relative exposures in `sampled`.
    pub fn sample(&self, frame: &Frame, sampled: &mut Sampled) {
        let height = self.layout.height() as usize;
        let full = (1u32 << CURVE_BITS) as f32;
        let most = self.layout.format().max_code() as f32;
        let pixels = frame.pixels.samples();
        for (i, values) in sampled.values.chunks_exact_mut(sampled.per_row.max(1)).enumerate() {
            let y = ((2 * i + 1) * height / (2 * ROWS)) as u32;
            for (x, value) in values.iter_mut().enumerate() {
                let luma = read_luma(&self.layout, pixels, (x * self.step) as u32, y);
                let code = (luma * most + 0.5) as u32;
                let exposure = self.curve.exposure_q27(1, code) as f32 / full;
                *value = if self.curve.is_saturated(code) { SATURATED } else { exposure };
            }
        }
    }
}
