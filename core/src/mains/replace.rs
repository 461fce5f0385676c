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

/// Replaces the energy of the texels of a cell by `level`; the fraction of each texel in the cell's energy is unchanged. A modulated cell has the
/// mean colour of the last bursts.
pub(super) fn replace(texels: &mut [Quad], level: &Level, cell: &Cell, index: CellIndex) {
    let found: f32 = texels.iter().map(Quad::y).sum();
    let mean = luminance(cell.colour);
    // The divisions come first: each quotient is limited, but the reciprocal of a small number may be infinite.
    let rgb = (level.is_modulated && mean > 0.0).then(|| cell.colour.map(|v| v / mean * level.y));
    if found > 0.0 {
        for quad in texels {
            let share = quad.y() / found;
            let scaled = |v: f32| v / found * level.y;
            quad.energy = quad.energy.map(scaled);
            if let Some(rgb) = rgb {
                quad.energy.iter_mut().zip(rgb).for_each(|(energy, v)| *energy = v * share);
            }
            quad.moment = quad.moment.map(scaled);
        }
    } else if let Some(rgb) = rgb {
        let share = 1.0 / texels.len().max(1) as f32;
        let centre = healpix::centre(index.order, index.cell).as_vec3();
        texels.fill(Quad::from_light(rgb.map(|v| v * share), centre));
    }
}
