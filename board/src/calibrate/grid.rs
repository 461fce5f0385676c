//! Joins the corners in a picture to the grid of a chessboard, square by square, so that the lines of the grid may be curved.

use super::corners::{Corner, alternates};
use super::grey::Grey;
use nalgebra::Vector2;
use std::collections::{HashMap, VecDeque};
use std::f64::consts::{PI, TAU};

/// Largest angle between an edge of a corner and the line to the next corner, radians; lines are curved in a fisheye picture.
const BEND: f64 = 0.45;

/// Column and row of a corner on the board.
pub(super) type Cell = [i32; 2];

/// Pixels of the corners of one board in a picture, by column and row.
pub(super) type Grid = HashMap<Cell, Vector2<f64>>;

/// The link from a corner to its neighbour along one of the corner's four edges.
#[derive(Clone, Copy)]
struct Link {
    to: usize,
    /// Index of the neighbour's edge that leads back to the corner.
    back: usize,
}

type Links = Vec<[Option<Link>; 4]>;

/// Joins corners to grids and returns them, the largest first.
pub(super) fn grids(corners: &[Corner]) -> Vec<Grid> {
    let links = mutual(&nearest(corners));
    let mut seen = vec![false; corners.len()];
    let mut grids = Vec::new();
    for start in 0..corners.len() {
        if !seen[start] {
            grids.push(spread(corners, &links, start, &mut seen));
        }
    }
    grids.sort_by_key(|grid| std::cmp::Reverse(grid.len()));
    grids
}

/// Returns the absolute angle between two directions, radians.
fn turn(a: f64, b: f64) -> f64 {
    let d = (a - b).rem_euclid(TAU);
    d.min(TAU - d)
}

/// Finds the nearest corner along each edge of each corner in `corners`.
fn nearest(corners: &[Corner]) -> Links {
    let along = |from: usize, edge: usize| {
        let here = &corners[from];
        let candidates = corners.iter().enumerate().filter(|(to, _)| *to != from);
        let reached = candidates.filter_map(|(to, there)| reach(here, edge, to, there));
        reached.min_by(|a, b| a.cost.total_cmp(&b.cost)).map(|reached| reached.link)
    };
    (0..corners.len()).map(|from| std::array::from_fn(|edge| along(from, edge))).collect()
}

/// A corner that lies along an edge of another corner.
struct Reached {
    /// Distance between the corners in pixels, increased where their edges are not aligned.
    cost: f64,
    link: Link,
}

/// Returns the link from an edge of `here` to the corner `there`, whose index is `to`; `None` if `there` does not lie along the edge.
fn reach(here: &Corner, edge: usize, to: usize, there: &Corner) -> Option<Reached> {
    let line = there.at - here.at;
    let direction = line.y.atan2(line.x);
    let bend = turn(direction, here.edges[edge]);
    // Dark and bright sectors alternate from corner to corner: an even edge of one corner is an odd edge of the next.
    let backward =
        [(edge + 1) % 4, (edge + 3) % 4].map(|back| (turn(direction + PI, there.edges[back]), back));
    let (bend_there, back) = if backward[0].0 < backward[1].0 { backward[0] } else { backward[1] };
    let fits = bend < BEND && bend_there < BEND;
    fits.then(|| Reached { cost: line.norm() * (1.0 + bend + bend_there), link: Link { to, back } })
}

/// Returns the links between corners that exist in both directions.
fn mutual(links: &Links) -> Links {
    let agreed = |from: usize, edge: usize| {
        let link = links[from][edge]?;
        let back = links[link.to][link.back]?;
        (back.to == from && back.back == edge).then_some(link)
    };
    (0..links.len()).map(|from| std::array::from_fn(|edge| agreed(from, edge))).collect()
}

/// A corner with its position on the board.
struct GridCorner {
    corner: usize,
    cell: Cell,
    /// Index of the corner's edge that points to the next column.
    first: usize,
}

/// Steps in columns and rows along the four edges of a corner, beginning with the edge that points to the next column.
const STEPS: [Cell; 4] = [[1, 0], [0, 1], [-1, 0], [0, -1]];

/// Returns the grid of all corners that links connect with the corner `start`.
fn spread(corners: &[Corner], links: &Links, start: usize, seen: &mut [bool]) -> Grid {
    let mut grid = Grid::new();
    let mut queue = VecDeque::from([GridCorner { corner: start, cell: [0, 0], first: 0 }]);
    while let Some(GridCorner { corner, cell, first }) = queue.pop_front() {
        if seen[corner] || grid.contains_key(&cell) {
            continue;
        }
        seen[corner] = true;
        grid.insert(cell, corners[corner].at);
        for (side, step) in STEPS.iter().enumerate() {
            if let Some(link) = links[corner][(first + side) % 4] {
                let first = (link.back + 6 - side) % 4;
                queue.push_back(GridCorner {
                    corner: link.to,
                    cell: [cell[0] + step[0], cell[1] + step[1]],
                    first,
                });
            }
        }
    }
    grid
}

/// The predicted pixel of a corner.
pub(super) struct Predicted {
    pub at: Vector2<f64>,
    /// Length of a square's side near `at`, pixels.
    pub side: f64,
}

/// A prediction of a corner's pixel from corners on one line, with the weight of the prediction.
struct Guess {
    weight: f64,
    at: Vector2<f64>,
    side: f64,
}

/// Predicts the pixel of the corner at `cell` from its neighbours in the grid; `None` if it has too few.
pub(super) fn predict(grid: &Grid, cell: Cell) -> Option<Predicted> {
    let mut guesses: Vec<Guess> = Vec::new();
    for [di, dj] in STEPS {
        let at = |n: i32| grid.get(&[cell[0] + n * di, cell[1] + n * dj]);
        if let (Some(a), Some(b)) = (at(1), at(2)) {
            let quadratic = at(3).map(|c| a * 3.0 - b * 3.0 + c);
            guesses.push(Guess {
                weight: if quadratic.is_some() { 2.0 } else { 1.0 },
                at: quadratic.unwrap_or(a * 2.0 - b),
                side: (a - b).norm(),
            });
        }
        if let (Some(a), Some(b)) = (at(1), at(-1)) {
            guesses.push(Guess { weight: 4.0, at: (a + b) * 0.5, side: 0.5 * (a - b).norm() });
        }
    }
    let weight: f64 = guesses.iter().map(|g| g.weight).sum();
    let side = guesses.iter().map(|g| g.side).reduce(f64::min)?;
    Some(Predicted { at: guesses.iter().map(|g| g.at * g.weight).sum::<Vector2<f64>>() / weight, side })
}

/// Adds to the grid those of `corners` that lie at predicted positions next to the grid.
pub(super) fn extend(grid: &mut Grid, corners: &[Corner]) {
    let mut grown = true;
    while grown {
        grown = false;
        for cell in frontier(grid) {
            let Some(Predicted { at, side }) = predict(grid, cell) else { continue };
            let near = corners.iter().map(|c| ((c.at - at).norm(), c.at));
            let best = near.min_by(|a, b| a.0.total_cmp(&b.0)).filter(|(off, _)| *off < 0.25 * side);
            let free = best.filter(|(_, at)| grid.values().all(|taken| (taken - at).norm() > 0.3 * side));
            if let Some((_, at)) = free {
                grid.insert(cell, at);
                grown = true;
            }
        }
    }
}

/// Returns the empty cells next to the corners of a grid.
fn frontier(grid: &Grid) -> Vec<Cell> {
    let beside = |cell: &Cell| STEPS.map(|step| [cell[0] + step[0], cell[1] + step[1]]);
    let mut cells: Vec<Cell> = grid.keys().flat_map(beside).filter(|cell| !grid.contains_key(cell)).collect();
    cells.sort_unstable();
    cells.dedup();
    cells
}

/// Removes from the grid the corners around which black and white squares do not alternate.
pub(super) fn prune(grid: &mut Grid, grey: &Grey) {
    let before = grid.clone();
    grid.retain(|cell, at| {
        let along = |axis: usize| edge(&before, *cell, axis);
        let Some((right, down)) = along(0).zip(along(1)) else { return false };
        let square = |i: f64, j: f64| *at + (right * i + down * j) * 0.35;
        let around = [square(1.0, 1.0), square(-1.0, 1.0), square(-1.0, -1.0), square(1.0, -1.0)];
        alternates(grey, around).is_some()
    });
}

/// Returns the vector from the corner at `cell` to the next one along an axis of the grid, pixels.
fn edge(grid: &Grid, cell: Cell, axis: usize) -> Option<Vector2<f64>> {
    let at = |n: i32| {
        let mut beside = cell;
        beside[axis] += n;
        grid.get(&beside)
    };
    let here = grid.get(&cell)?;
    match (at(1), at(-1)) {
        (Some(next), Some(last)) => Some((next - last) * 0.5),
        (Some(next), None) => Some(next - here),
        (None, Some(last)) => Some(here - last),
        (None, None) => None,
    }
}

/// Returns the part of a grid that a board of `size` columns and rows covers best, shifted to columns and rows from 0.
pub(super) fn fitted(grid: &Grid, size: Cell) -> Grid {
    let quarter: Grid = grid.iter().map(|(&[i, j], at)| ([j, -i], *at)).collect();
    let straight = best_window(grid, size);
    let turned = best_window(&quarter, size);
    if turned.len() > straight.len() { turned } else { straight }
}

fn best_window(grid: &Grid, size: Cell) -> Grid {
    let bounds = |axis: usize| {
        let least = grid.keys().map(|cell| cell[axis]).min().unwrap_or(0);
        let most = grid.keys().map(|cell| cell[axis]).max().unwrap_or(0);
        least..=least.max(most - size[axis] + 1)
    };
    let inside = |cell: &Cell, [i, j]: Cell| {
        (i..i + size[0]).contains(&cell[0]) && (j..j + size[1]).contains(&cell[1])
    };
    let corners = bounds(0).flat_map(|i| bounds(1).map(move |j| [i, j]));
    let best = corners.max_by_key(|corner| grid.keys().filter(|cell| inside(cell, *corner)).count());
    let [i, j] = best.unwrap_or([0, 0]);
    let kept = grid.iter().filter(|(cell, _)| inside(cell, [i, j]));
    kept.map(|(cell, at)| ([cell[0] - i, cell[1] - j], *at)).collect()
}
