//! The detected corners of a board in one picture, and their refinement.

use super::corners::refine;
use super::grey::Grey;
use super::grid::{Cell, Grid};
use super::sighting::Sighting;
use nalgebra::Vector2;

/// Least number of corners from which the pose of a board is computed.
pub(super) const FEWEST: usize = 8;

/// The board that was detected in one picture.
#[derive(Clone, Debug, Default)]
pub(super) struct Found {
    /// Detected corners of the board; empty if no board was detected.
    pub seen: Vec<Sighting>,
    /// Number of corners of a second grid of squares in the picture.
    pub second: usize,
    /// Evidence of mirroring from the board's marks or squares: above 0 for a mirrored picture, below 0 for a picture that is not mirrored.
    pub mirror: i32,
}

/// Returns the corners of a grid at sub-pixel accuracy, row by row; `part` is the fraction of a square's side around a corner that has no
/// other pattern.
pub(super) fn refined(grey: &Grey, grid: &Grid, scale: f64, part: f64) -> Vec<Sighting> {
    let mut cells: Vec<_> = grid.iter().collect();
    cells.sort_unstable_by_key(|([i, j], _)| (*j, *i));
    let one = |(cell, at): (&Cell, &Vector2<f64>)| {
        let found = refine(grey, *at, window(part * side(grid, *cell)).max(2.0 * scale))?;
        Some(Sighting { cell: *cell, at: found })
    };
    cells.into_iter().filter_map(one).collect()
}

/// Returns half the side of the window in which a corner is refined, pixels; the shortest edge at the corner has `side` pixels.
pub(super) fn window(side: f64) -> f64 {
    (0.4 * side).clamp(2.0, 9.0)
}

/// Returns the length of the shortest edge from a corner of the grid to its neighbours, pixels.
fn side(grid: &Grid, [i, j]: Cell) -> f64 {
    let here = grid[&[i, j]];
    let beside = [[i + 1, j], [i - 1, j], [i, j + 1], [i, j - 1]];
    beside.iter().filter_map(|cell| grid.get(cell)).map(|at| (at - here).norm()).fold(20.0, f64::min)
}
