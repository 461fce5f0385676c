//! Distinguishes an abrupt change of the whole map from noise and motion.

use super::inversion::light_of;
use crate::polar::LatLongView;

/// Rows and columns of blocks that the map is compared in.
const ROWS: usize = 16;
const COLUMNS: usize = 48;

/// A change this many times the usual one is abrupt: changes under noise vary by a tenth.
const FACTOR: f32 = 8.0;

/// Least change that is abrupt, a part of the energy: less is left to each light's own filter.
const LEAST: f32 = 0.01;

/// Weight of a new change in the usual one.
const MEMORY: f32 = 0.1;

/// A change counts at most this many times the usual one: what is abrupt is not usual until it goes on.
const MOST: f32 = 3.0;

/// Distribution of the last map's light over blocks, and the usual change from map to map.
#[derive(Clone, Debug)]
pub(super) struct Detector {
    /// Share of the light in each block.
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

    /// Takes the next map, of luminance `total`; whether it is no continuation of the last.
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
