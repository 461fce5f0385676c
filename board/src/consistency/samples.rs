//! Relative exposures on a grid of pixels of a frame, for every format.

use crate::calibration::{Calibration, Frame};
use hemilux_core::format::Layout;
use hemilux_core::response::{CURVE_BITS, Curve, curve_len};
use hemilux_core::{ResponseError, read_rgb_row};

/// Rows of the grid.
pub(super) const ROWS: usize = 16;

/// Most pixels of a row of the grid.
const COLUMNS: usize = 64;

/// Codes above black from which a sample is judged.
const LEAST_CODES: f64 = 8.0;

/// Bounds of the least relative exposure that is judged.
const LEAST: f64 = 1.0 / 256.0;
const MOST_LEAST: f64 = 1.0 / 32.0;

/// The value of a saturated sample.
pub(super) const SATURATED: f32 = 2.0;

/// Where a frame is read, and the conversion of its codes.
#[derive(Debug)]
pub(super) struct Grid {
    layout: Layout,
    curve: Curve<Vec<i32>>,
    table_len: usize,
    /// The codes of one row of the frame.
    row: Vec<[u16; 3]>,
    /// Least relative exposure that is judged: below it quantisation and noise decide.
    pub least: f32,
    /// Distance between pixels of the grid, pixels.
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
        Ok(Self {
            layout,
            curve,
            least,
            table_len,
            row: vec![[0; 3]; width],
            step: width.div_ceil(COLUMNS).max(1),
        })
    }

    fn per_row(&self) -> usize {
        3 * self.row.len().div_ceil(self.step)
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        ROWS * self.per_row()
    }

    pub fn bytes(&self) -> usize {
        size_of::<i32>() * self.table_len + size_of::<[u16; 3]>() * self.row.len()
    }

    pub fn empty(&self) -> Sampled {
        Sampled { values: vec![0.0; self.len()], per_row: self.per_row() }
    }

    /// Reads the samples of `frame`.
    pub fn sample(&mut self, frame: &Frame, sampled: &mut Sampled) {
        let height = self.layout.height() as usize;
        let full = f64::from(1u32 << CURVE_BITS) as f32;
        for (i, values) in sampled.values.chunks_exact_mut(sampled.per_row.max(1)).enumerate() {
            let y = (2 * i + 1) * height / (2 * ROWS);
            read_rgb_row(&self.layout, frame.pixels.samples(), y as u32, &mut self.row);
            let pixels = self.row.iter().step_by(self.step);
            for (pixel, values) in pixels.zip(values.as_chunks_mut::<3>().0) {
                for (channel, (code, value)) in pixel.iter().zip(values).enumerate() {
                    let code = u32::from(*code);
                    let exposure = self.curve.exposure_q27(channel, code) as f32 / full;
                    *value = if self.curve.is_saturated(code) { SATURATED } else { exposure };
                }
            }
        }
    }
}
