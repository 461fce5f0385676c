//! Replaces the light of the texels of a cell.

use super::cell::{Cell, Level};
use crate::color::luminance;
use crate::healpix;
use crate::pyramid::Quad;

/// The index of a cell, and its order.
#[derive(Clone, Copy)]
pub(super) struct CellIndex {
    pub order: u8,
    pub cell: u32,
}

/// Replaces the energy of the texels of a cell by `level`; the fraction of each texel in the cell's energy is unchanged.
pub(super) fn replace(texels: &mut [Quad], level: &Level, cell: &Cell, index: CellIndex) {
    let found: f32 = texels.iter().map(Quad::y).sum();
    let mean = luminance(cell.colour);
    if found > 0.0 && (!level.is_modulated || mean <= 0.0) {
        let factor = level.y / found;
        texels.iter_mut().for_each(|quad| scale(quad, factor));
    } else if mean > 0.0 {
        let rgb = cell.colour.map(|v| v * level.y / mean);
        let equal = 1.0 / texels.len().max(1) as f32;
        let centre = healpix::centre(index.order, index.cell).as_vec3();
        for quad in texels {
            let (share, direction) =
                if found > 0.0 { (quad.y() / found, quad.mean_direction()) } else { (equal, centre) };
            *quad = Quad::from_light(rgb.map(|v| v * share), direction);
        }
    }
}

/// Multiplies energy and first moment of `quad` by `factor`.
fn scale(quad: &mut Quad, factor: f32) {
    quad.energy = quad.energy.map(|v| v * factor);
    quad.moment = quad.moment.map(|v| v * factor);
}
