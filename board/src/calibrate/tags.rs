//! Boards whose marks identify each corner: ChArUco and AprilGrid.
//!
//! Corners are joined to grids as on a chessboard, and in each cell a mark is read through the homography of the cell's four corners. The
//! rotation and the shift of a grid on the board follow from the positions of at least two marks, independent of conventions for the
//! orientation of marks.

use super::board::{Charuco, Kind, Printed};
use super::corners::Corner;
use super::found::{FEWEST, Found, refined};
use super::grey::Grey;
use super::grid::{Cell, Grid, grids};
use calib_targets_aruco::{
    Dictionary, GrayImageView, MarkerCell, Matcher, ScanDecodeConfig, resolve_dictionary,
    scan_decode_markers_in_cells,
};
use calib_targets_core::Coord;
use nalgebra::Point2;
use std::collections::HashMap;

/// Name of the family of the tags of every AprilGrid.
pub(super) const TAG_FAMILY: &str = "DICT_APRILTAG_36h11";

/// Side of a rectified cell in which a mark is read, pixels.
const CELL_PX: f32 = 64.0;

/// Least number of marks that determine the position of a grid on the board.
const FEWEST_MARKS: usize = 2;

/// Widths of a tag's black border that are tried, in bits: boards of Kalibr have 2.
const TAG_BORDERS: [usize; 2] = [2, 1];

/// The marks of a printed board and their positions.
struct Marks {
    matcher: Matcher,
    /// Side of the printed mark, in cells.
    side: f64,
    borders: &'static [usize],
    /// Upper left corner of each mark's cell on the board, by the number of the mark.
    cells: HashMap<u32, Cell>,
}

impl Marks {
    fn of(printed: &Printed) -> Option<Self> {
        match printed.kind {
            Kind::Chessboard => None,
            Kind::Charuco(Charuco { dictionary, marker }) => {
                // The squares of the outer rows and columns lack corners at the board's edge, so the marks in them are not read.
                let cells = charuco_squares(printed).zip(0..).map(|([i, j], id)| (id, [i - 1, j - 1]));
                Some(Self::new(dictionary, marker, &[1], cells.collect()))
            }
            Kind::AprilGrid { .. } => {
                let cells = (0..).zip(tag_cells(printed)).collect();
                Some(Self::new(resolve_dictionary(TAG_FAMILY)?, 1.0, &TAG_BORDERS, cells))
            }
        }
    }

    fn new(dictionary: Dictionary, side: f64, borders: &'static [usize], cells: HashMap<u32, Cell>) -> Self {
        // Half of the number of wrong bits that the dictionary can correct is accepted, which keeps false marks rare.
        let most = dictionary.max_correction_bits() / 2;
        Self { matcher: Matcher::new(dictionary, most), side, borders, cells }
    }

    /// Reads the marks in the cells of a grid; of the widths of the border, the one with which most marks are read is used.
    fn read(&self, grey: &Grey, grid: &Grid, mirrored: bool) -> Vec<Mark> {
        let [width, height] = grey.size();
        let view = GrayImageView { width, height, data: grey.pixels() };
        let cells: Vec<MarkerCell> = grid.keys().filter_map(|cell| quad(grid, *cell, mirrored)).collect();
        let read = |border: &usize| {
            let config = ScanDecodeConfig::default()
                .with_border_bits(*border)
                .with_inset_frac(0.0)
                .with_marker_size_rel(self.side as f32)
                .with_dedup_by_id(false);
            let found = scan_decode_markers_in_cells(&view, &cells, CELL_PX, &config, &self.matcher);
            let mark = |found: calib_targets_aruco::MarkerDetection| {
                let corners = found.corners_img?;
                let at =
                    grid.iter().find(|(_, at)| at.x as f32 == corners[0].x && at.y as f32 == corners[0].y);
                let board = *self.cells.get(&found.id)?;
                Some(Mark { grid: *at?.0, board })
            };
            found.into_iter().filter_map(mark).collect::<Vec<_>>()
        };
        self.borders.iter().map(read).max_by_key(Vec::len).unwrap_or_default()
    }
}

/// Returns the squares of a ChArUco board that have marks, in the order of their numbers: the white squares row by row; the upper left square is
/// black.
pub(super) fn charuco_squares(printed: &Printed) -> impl Iterator<Item = Cell> {
    let [columns, rows] = printed.corners.size().map(|n| n + 1);
    (0..rows).flat_map(move |j| (0..columns).filter(move |i| (i + j) % 2 == 1).map(move |i| [i, j]))
}

/// Returns the upper left corner of each tag of an AprilGrid in the order of their numbers: from the lowest row up, as Kalibr numbers them.
pub(super) fn tag_cells(printed: &Printed) -> impl Iterator<Item = Cell> {
    let [columns, rows] = printed.corners.size().map(|n| n / 2);
    (0..rows).rev().flat_map(move |j| (0..columns).map(move |i| [2 * i, 2 * j]))
}

/// A mark that was read in a cell of a grid.
#[derive(Clone, Copy, Debug)]
struct Mark {
    /// Upper left corner of the mark's cell in the grid; the upper right corner in a mirrored picture.
    grid: Cell,
    /// Upper left corner of the mark's cell on the board.
    board: Cell,
}

/// Returns the corners of a cell of the grid in the image; `None` if one is missing.
fn quad(grid: &Grid, [i, j]: Cell, mirrored: bool) -> Option<MarkerCell> {
    let order = if mirrored { [[0, 0], [0, 1], [1, 1], [1, 0]] } else { [[0, 0], [1, 0], [1, 1], [0, 1]] };
    let mut corners = [Point2::origin(); 4];
    for (corner, [di, dj]) in corners.iter_mut().zip(order) {
        let at = grid.get(&[i + di, j + dj])?;
        *corner = Point2::new(at.x as f32, at.y as f32);
    }
    Some(MarkerCell::new(Coord::new(i, j), corners))
}

/// The position of a grid on the board: a number of quarter turns, followed by a shift in columns and rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Lie {
    turns: usize,
    shift: Cell,
}

fn turned([i, j]: Cell, turns: usize) -> Cell {
    [[i, j], [-j, i], [-i, -j], [j, -i]][turns % 4]
}

impl Lie {
    fn board(self, cell: Cell) -> Cell {
        let [i, j] = turned(cell, self.turns);
        [i + self.shift[0], j + self.shift[1]]
    }

    /// Returns the position that maps a mark's cell in the grid to its cell on the board.
    fn of(mark: &Mark, turns: usize) -> Self {
        // The centre of the cell is rotated, in half cells, since its corners are permuted.
        let middle = turned([2 * mark.grid[0] + 1, 2 * mark.grid[1] + 1], turns);
        let shift = |axis: usize| (2 * mark.board[axis] + 1 - middle[axis]) / 2;
        Self { turns, shift: [shift(0), shift(1)] }
    }
}

/// Returns the position of the grid on which most marks agree, at least two marks and more than half of them.
fn lie(marks: &[Mark]) -> Option<Lie> {
    let mut votes: HashMap<Lie, usize> = HashMap::new();
    for mark in marks {
        (0..4).for_each(|turns| *votes.entry(Lie::of(mark, turns)).or_default() += 1);
    }
    let (lie, count) = votes.into_iter().max_by_key(|(lie, count)| (*count, lie.turns))?;
    (count >= FEWEST_MARKS && 2 * count > marks.len()).then_some(lie)
}

/// Finds the marked board in a picture in which `corners` were detected.
pub(super) fn board(grey: &Grey, corners: &[Corner], printed: &Printed, scale: f64) -> Found {
    let Some(marks) = Marks::of(printed) else { return Found::default() };
    let grids: Vec<Grid> = grids(corners).into_iter().filter(|grid| grid.len() >= 4).collect();
    let (mut whole, mut second) = (Grid::new(), 0);
    for grid in &grids {
        let Some(lie) = lie(&marks.read(grey, grid, false)) else { continue };
        let part = placed(grid, lie, printed);
        if part.iter().any(|(cell, at)| whole.get(cell).is_some_and(|other| (other - at).norm() > 4.0)) {
            second = second.max(part.len());
        } else {
            whole.extend(part);
        }
    }
    let reads_mirrored = |grid: &Grid| marks.read(grey, grid, true).len() >= FEWEST_MARKS;
    let is_mirrored = whole.is_empty() && grids.iter().any(reads_mirrored);
    let mut seen = refined(grey, &whole, scale, printed.plain() / 0.35);
    if seen.len() < FEWEST {
        seen.clear();
    }
    let mirror = if is_mirrored { 1 } else { -i32::from(!seen.is_empty()) };
    Found { seen, second, mirror }
}

/// Returns those corners of a grid that lie on the board, by their columns and rows on the board.
fn placed(grid: &Grid, lie: Lie, printed: &Printed) -> Grid {
    let [columns, rows] = printed.corners.size();
    let on_board = |[i, j]: &Cell| (0..columns).contains(i) && (0..rows).contains(j);
    grid.iter().map(|(cell, at)| (lie.board(*cell), *at)).filter(|(cell, _)| on_board(cell)).collect()
}
