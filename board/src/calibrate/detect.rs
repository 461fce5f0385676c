//! Detection of the calibration board in a picture.

use super::corners::{Corner, alternates, find, refine};
use super::found::{FEWEST, Found, refined, window};
use super::grey::Grey;
use super::grid::{Cell, Grid, extend, fitted, grids, prune};
use super::sighting::Sighting;
use super::solve::{Model, View};
use super::{Board, Printed, tags};
use chess_corners::ChessError;
use nalgebra::{Vector2, Vector3};

/// Detects the board at the full size of the picture, then at half and a quarter of it while corners are missing.
pub(super) fn board(grey: &Grey, printed: &Printed) -> Result<Found, ChessError> {
    let whole = printed.corners.corners();
    let mut best = Found::default();
    let mut level = Some(SearchLevel::first(grey));
    while let Some(searched) = level.filter(|_| best.seen.len() < whole) {
        let scale = searched.scale;
        let corners = find(&searched.picture, scale)?;
        let found = if printed.is_marked() {
            tags::board(grey, &corners, printed, scale)
        } else {
            from_corners(grey, &corners, printed.corners, scale)
        };
        let is_more = found.seen.len() > best.seen.len();
        if is_more || (best.seen.is_empty() && found.mirror > 0) {
            best = found;
        }
        level = searched.halved().filter(|_| scale < 8.0);
    }
    Ok(best)
}

/// Largest side of a picture in which corners are searched for, pixels: in larger pictures texture has more corners than the board.
const LARGEST_SIDE: usize = 1600;

/// A picture at one of the sizes at which corners are searched for.
struct SearchLevel {
    picture: Grey,
    /// Number of full-size pixels per pixel of `picture`, along a side.
    scale: f64,
}

impl SearchLevel {
    /// Returns `grey` at the largest size at which corners are searched for.
    fn first(grey: &Grey) -> Self {
        let mut level = Self { picture: grey.clone(), scale: 1.0 };
        while level.picture.size().into_iter().max() > Some(LARGEST_SIDE) {
            let Some(half) = level.halved() else { break };
            level = half;
        }
        level
    }

    /// Returns the picture at half the size; `None` if it would be too small.
    fn halved(&self) -> Option<Self> {
        self.picture.halved().map(|picture| Self { picture, scale: 2.0 * self.scale })
    }
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
    let fitted = fitted(&grid, board.size());
    let mut seen = refined(grey, &fitted, scale, 1.0);
    if seen.len() < FEWEST {
        seen.clear();
    }
    Found { seen, second, mirror: mirror(grey, &fitted, board) }
}

/// Returns 1 if the squares of a whole board are mirrored, -1 if they are not, and 0 if the board is symmetric.
///
/// The upper left square is black; on a board with odd numbers of columns and rows of corners, a mirror makes it white.
fn mirror(grey: &Grey, grid: &Grid, board: Board) -> i32 {
    if !Printed::from(board).tells_mirror() || grid.len() < board.corners() {
        return 0;
    }
    let square = |(&[i, j], at): (&Cell, &Vector2<f64>)| {
        let others = [[i + 1, j], [i, j + 1], [i + 1, j + 1]].map(|cell| grid.get(&cell).copied());
        let sum = others.into_iter().try_fold(*at, |sum, other| Some(sum + other?))?;
        let sign = if (i + j) % 2 == 0 { 1.0 } else { -1.0 };
        Some(sign * grey.sample(sum * 0.25))
    };
    let contrast: f64 = grid.iter().filter_map(square).sum();
    if contrast > 0.0 { 1 } else { -1 }
}

/// Searches for missing corners of the board at the positions that the fit predicts; returns the number of corners found.
pub(super) fn complete(grey: &Grey, model: &Model, view: &mut View, printed: &Printed) -> usize {
    let before = view.seen.len();
    let has = |view: &View, cell: Cell| view.seen.iter().any(|s| s.cell == cell);
    for cell in printed.around(&view.seen) {
        if has(view, cell) {
            continue;
        }
        if let CornerSearch::Found(at) = look(grey, model, view, cell, printed.plain()) {
            view.seen.push(Sighting { cell, at });
        }
    }
    if !printed.is_marked() {
        rebase(view, model);
    }
    view.seen.len() - before
}

/// Shifts the origin of the board in a view so that the board's columns and rows begin at 0.
fn rebase(view: &mut View, model: &Model) {
    let least = |axis: usize| view.seen.iter().map(|s| s.cell[axis]).min().unwrap_or(0).min(0);
    let origin = [least(0), least(1)];
    for s in &mut view.seen {
        s.cell = [s.cell[0] - origin[0], s.cell[1] - origin[1]];
    }
    view.pose.shift += view.pose.turn * model.shape.plane(origin);
}

/// For each side of the board, returns the number of corners found where one more column or row would have them, and the number of such
/// positions in the picture.
pub(super) fn beyond(grey: &Grey, model: &Model, view: &View, board: Board) -> [[usize; 2]; 4] {
    let plain = Printed::from(board).plain();
    let [columns, rows] = board.size();
    let column = |i: i32| (0..rows).map(|j| [i, j]).collect::<Vec<_>>();
    let row = |j: i32| (0..columns).map(|i| [i, j]).collect::<Vec<_>>();
    [column(-1), column(columns), row(-1), row(rows)].map(|cells| {
        let looked: Vec<CornerSearch> =
            cells.iter().map(|cell| look(grey, model, view, *cell, plain)).collect();
        let found = looked.iter().filter(|look| matches!(look, CornerSearch::Found(_))).count();
        [found, looked.iter().filter(|look| !matches!(look, CornerSearch::Outside)).count()]
    })
}

/// The result of the search for a corner at its expected position.
enum CornerSearch {
    /// The position of the corner is outside of the picture.
    Outside,
    /// There is no corner at the position.
    Absent,
    /// The corner was found at this pixel.
    Found(Vector2<f64>),
}

fn look(grey: &Grey, model: &Model, view: &View, cell: Cell, plain: f64) -> CornerSearch {
    match squares_at(grey, model, view, cell, plain) {
        None => CornerSearch::Outside,
        Some(place) => search(grey, &place).map_or(CornerSearch::Absent, CornerSearch::Found),
    }
}

/// The expected position of a corner in a picture, with its surroundings.
struct CornerSite {
    at: Vector2<f64>,
    /// Centres of the four squares around the corner, pixels, in order.
    squares: [Vector2<f64>; 4],
    /// Length of the shortest edge that meets in the corner, pixels.
    side: f64,
}

fn squares_at(grey: &Grey, model: &Model, view: &View, cell: Cell, plain: f64) -> Option<CornerSite> {
    let limit = model.camera.limit();
    let pixel = |i: f64, j: f64| {
        let point = view.pose.apply(&(model.shape.place(cell) + Vector3::new(i, j, 0.0)));
        let theta = point.xy().norm().atan2(point.z);
        (theta < limit).then(|| model.camera.pixel(&point)).filter(|at| grey.holds(*at, 2.0))
    };
    let at = pixel(0.0, 0.0)?;
    let p = plain;
    // A chessboard's squares have no pattern on 0.35 of their sides; smaller fields are treated as smaller squares.
    let e = p / 0.7;
    let edges = [pixel(e, 0.0)?, pixel(0.0, e)?, pixel(-e, 0.0)?, pixel(0.0, -e)?];
    let side = edges.iter().map(|edge| 2.0 * (edge - at).norm()).fold(f64::INFINITY, f64::min);
    let squares = [pixel(p, p)?, pixel(-p, p)?, pixel(-p, -p)?, pixel(p, -p)?];
    Some(CornerSite { at, squares, side })
}

fn search(grey: &Grey, place: &CornerSite) -> Option<Vector2<f64>> {
    alternates(grey, place.squares)?;
    let found = refine(grey, place.at, window(place.side))?;
    ((found - place.at).norm() < (0.15 * place.side).clamp(1.0, 4.0)).then_some(found)
}
