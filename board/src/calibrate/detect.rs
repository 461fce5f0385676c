//! The board in a picture.

use super::Board;
use super::corners::{Corner, alternates, find, refine};
use super::grey::Grey;
use super::grid::{Cell, Grid, extend, fitted, grids, prune};
use super::pose::Sighting;
use super::solve::{Model, View};
use chess_corners::ChessError;
use nalgebra::{Vector2, Vector3};

/// Fewest corners of a board of which a pose is computed.
pub(super) const FEWEST: usize = 8;

/// What was found in one picture.
#[derive(Clone, Debug, Default)]
pub(super) struct Found {
    /// The corners of the board, none where it was not found.
    pub seen: Vec<Sighting>,
    /// Corners of a second grid of the board's kind.
    pub second: usize,
}

/// Finds the board: at the full size, then at half and a quarter where corners are still missing.
pub(super) fn board(grey: &Grey, board: Board) -> Result<Found, ChessError> {
    let whole = board.corners();
    let mut best = Found::default();
    let mut level = Some(first_level(grey));
    while let Some((picture, scale)) = level.filter(|_| best.seen.len() < whole) {
        let corners = find(&picture, scale)?;
        let found = from_corners(grey, &corners, board, scale);
        if found.seen.len() > best.seen.len() {
            best = found;
        }
        level = picture.halved().filter(|_| scale < 8.0).map(|half| (half, 2.0 * scale));
    }
    Ok(best)
}

/// Largest side of a picture in which corners are searched: in larger ones texture outnumbers them.
const LARGEST_SIDE: usize = 1600;

/// The picture at the first size at which corners are searched, and the pixels of the full size in one of it.
fn first_level(grey: &Grey) -> (Grey, f64) {
    let mut level = (grey.clone(), 1.0);
    while level.0.size().into_iter().max() > Some(LARGEST_SIDE) {
        let Some(half) = level.0.halved() else { break };
        level = (half, 2.0 * level.1);
    }
    level
}

fn from_corners(grey: &Grey, corners: &[Corner], board: Board, scale: f64) -> Found {
    let whole = |mut grid: Grid| {
        extend(&mut grid, corners);
        prune(&mut grid, grey);
        grid
    };
    let mut all: Vec<Grid> = grids(corners).into_iter().filter(|grid| grid.len() >= 4).map(whole).collect();
    all.sort_by_key(|grid| std::cmp::Reverse(grid.len()));
    let mut all = all.into_iter();
    let Some(grid) = all.next() else { return Found::default() };
    let taken = |at: &Vector2<f64>| grid.values().any(|other| (other - at).norm() < 2.0);
    let apart = |other: Grid| other.values().filter(|at| !taken(at)).count();
    let second = all.map(apart).max().unwrap_or(0);
    let mut seen = refined(grey, &fitted(&grid, board.size()), scale);
    if seen.len() < FEWEST {
        seen.clear();
    }
    Found { seen, second }
}

/// The corners of a grid at sub-pixel accuracy, in order of rows.
fn refined(grey: &Grey, grid: &Grid, scale: f64) -> Vec<Sighting> {
    let mut cells: Vec<_> = grid.iter().collect();
    cells.sort_unstable_by_key(|([i, j], _)| (*j, *i));
    let one = |(cell, at): (&Cell, &Vector2<f64>)| {
        let found = refine(grey, *at, window(side(grid, *cell)).max(2.0 * scale))?;
        Some(Sighting { cell: *cell, at: found })
    };
    cells.into_iter().filter_map(one).collect()
}

/// Half-size of the window of a corner whose shortest edge has `side` pixels.
fn window(side: f64) -> f64 {
    (0.4 * side).clamp(2.0, 9.0)
}

/// The shortest edge at a corner.
fn side(grid: &Grid, [i, j]: Cell) -> f64 {
    let here = grid[&[i, j]];
    let beside = [[i + 1, j], [i - 1, j], [i, j + 1], [i, j - 1]];
    beside.iter().filter_map(|cell| grid.get(cell)).map(|at| (at - here).norm()).fold(20.0, f64::min)
}

/// Looks again for the corners that a picture lacks, where the fit says that they are; returns how many were found.
pub(super) fn complete(grey: &Grey, model: &Model, view: &mut View, board: Board) -> usize {
    let before = view.seen.len();
    let has = |view: &View, cell: Cell| view.seen.iter().any(|s| s.cell == cell);
    for cell in board.around(&view.seen) {
        if has(view, cell) {
            continue;
        }
        if let Look::Found(at) = look(grey, model, view, cell) {
            view.seen.push(Sighting { cell, at });
        }
    }
    rebase(view);
    view.seen.len() - before
}

/// Moves the board's origin so that its columns and rows begin at 0.
fn rebase(view: &mut View) {
    let least = |axis: usize| view.seen.iter().map(|s| s.cell[axis]).min().unwrap_or(0).min(0);
    let origin = [least(0), least(1)];
    for s in &mut view.seen {
        s.cell = [s.cell[0] - origin[0], s.cell[1] - origin[1]];
    }
    view.pose.shift += view.pose.turn * super::pose::place(origin);
}

/// How many corners lie on each side beyond the board, in the places where one more column or row would have them, and how many such
/// places lie in the picture.
pub(super) fn beyond(grey: &Grey, model: &Model, view: &View, board: Board) -> [[usize; 2]; 4] {
    let [columns, rows] = board.size();
    let column = |i: i32| (0..rows).map(|j| [i, j]).collect::<Vec<_>>();
    let row = |j: i32| (0..columns).map(|i| [i, j]).collect::<Vec<_>>();
    [column(-1), column(columns), row(-1), row(rows)].map(|cells| {
        let looked: Vec<Look> = cells.iter().map(|cell| look(grey, model, view, *cell)).collect();
        let found = looked.iter().filter(|look| matches!(look, Look::Found(_))).count();
        [found, looked.iter().filter(|look| !matches!(look, Look::Outside)).count()]
    })
}

/// What a look for a corner gives.
enum Look {
    /// The corner's place is not in the picture.
    Outside,
    /// No corner is there.
    Absent,
    /// The corner is there.
    Found(Vector2<f64>),
}

fn look(grey: &Grey, model: &Model, view: &View, cell: Cell) -> Look {
    match squares_at(grey, model, view, cell) {
        None => Look::Outside,
        Some(place) => search(grey, &place).map_or(Look::Absent, Look::Found),
    }
}

/// Where a corner must be.
struct Place {
    at: Vector2<f64>,
    /// The middles of its four squares, in order around it.
    squares: [Vector2<f64>; 4],
    /// Its shortest edge.
    side: f64,
}

fn squares_at(grey: &Grey, model: &Model, view: &View, cell: Cell) -> Option<Place> {
    let limit = model.camera.limit();
    let pixel = |i: f64, j: f64| {
        let point = view.pose.apply(&(model.shape.place(cell) + Vector3::new(i, j, 0.0)));
        let theta = point.xy().norm().atan2(point.z);
        (theta < limit).then(|| model.camera.pixel(&point)).filter(|at| grey.holds(*at, 2.0))
    };
    let at = pixel(0.0, 0.0)?;
    let edges = [pixel(0.5, 0.0)?, pixel(0.0, 0.5)?, pixel(-0.5, 0.0)?, pixel(0.0, -0.5)?];
    let side = edges.iter().map(|edge| 2.0 * (edge - at).norm()).fold(f64::INFINITY, f64::min);
    let squares = [pixel(0.35, 0.35)?, pixel(-0.35, 0.35)?, pixel(-0.35, -0.35)?, pixel(0.35, -0.35)?];
    Some(Place { at, squares, side })
}

fn search(grey: &Grey, place: &Place) -> Option<Vector2<f64>> {
    alternates(grey, place.squares)?;
    let found = refine(grey, place.at, window(place.side))?;
    ((found - place.at).norm() < (0.15 * place.side).clamp(1.0, 4.0)).then_some(found)
}
