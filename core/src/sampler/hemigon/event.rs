//! Detection of abrupt changes of a map from frame to frame, which are distinguished from noise and motion.

use super::inversion::light_of;
use crate::polar::LatLongView;

/// Numbers of rows and columns of the blocks in which successive maps are compared.
const ROWS: usize = 16;
const COLUMNS: usize = 48;

/// Ratio of a change from map to map to the mean change, above which the change is abrupt; noise varies this ratio by about a tenth.
const FACTOR: f32 = 8.0;

/// Least abrupt change, as a fraction of the map's energy; smaller changes are processed by the filter of each light.
const LEAST: f32 = 0.01;

/// Weight of the newest change of energy from map to map in the running mean of such changes.
const MEMORY: f32 = 0.1;

/// Limit of a change that enters the running mean, relative to the mean, so that one abrupt change raises the mean by little.
const MOST: f32 = 3.0;

/// The distribution of the last map's light over blocks, and the running mean of the change from map to map.
#[derive(Clone, Debug)]
pub(super) struct Detector {
    /// Fraction of the last map's luminance energy in each block.
    blocks: [f32; ROWS * COLUMNS],
    usual: Option<f32>,
    begun: bool,
}

impl Detector {
    pub(super) const fn new() -> Self {
        Self { blocks: [0.0; ROWS * COLUMNS], usual: None, begun: false }
    }

    pub(super) fn reset(&mut self) {
        *self = Self::new();
    }

    /// Compares the next map, of luminance `total`, with the last map; returns whether the change is abrupt.
    pub(super) fn is_abrupt(&mut self, map: &LatLongView<'_>, total: f64) -> bool {
        let last = self.blocks;
        self.blocks = blocks(map, total);
        let change: f32 = self.blocks.iter().zip(last).map(|(a, b)| (a - b).abs()).sum();
        if !core::mem::replace(&mut self.begun, true) {
            return false;
        }
        let usual = self.usual.unwrap_or(change);
        self.usual = Some(usual + (change.min(MOST * usual.max(LEAST / FACTOR)) - usual) * MEMORY);
        change > LEAST.max(FACTOR * usual)
    }
}

/// Returns the fraction of the luminance `total` in each block of the map.
fn blocks(map: &LatLongView<'_>, total: f64) -> [f32; ROWS * COLUMNS] {
    let (width, height) = (map.grid.width.max(1), map.grid.height.max(1));
    let mut blocks = [0.0; ROWS * COLUMNS];
    for (i, row) in map.texels.chunks_exact(width).enumerate() {
        let first = i * ROWS / height * COLUMNS;
        for (j, texel) in row.iter().enumerate() {
            blocks[first + j * COLUMNS / width] += (light_of(*texel) / total) as f32;
        }
    }
    blocks
}
