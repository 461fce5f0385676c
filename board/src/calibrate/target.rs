//! Drawing of calibration boards for print.

use super::tags::{TAG_FAMILY, charuco_squares, tag_cells};
use super::{Board, Charuco, Kind, Printed};
use calib_targets_aruco::resolve_dictionary;
use std::fmt::Write;

/// A board with its printed size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// The board and its pattern.
    pub printed: Printed,
    /// Side of a square or a tag, millimetres.
    pub square_mm: f64,
}

/// A black rectangle of a printed board, in squares or tags from the corner of the board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ink {
    /// Left and top edge of the rectangle, in squares or tags from the left and top edge of the board.
    pub at: [f64; 2],
    /// Width and height of the rectangle, in squares or tags.
    pub size: [f64; 2],
}

/// Reasons why a target is not drawn.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum TargetRefusal {
    /// The side of a square or tag is out of range.
    #[error("found squares of {0} mm, expected 1 to 500")]
    Square(f64),
}

/// Length of the ruler line, and height of the space for it below the board, millimetres.
const RULER_MM: f64 = 100.0;
const FOOT_MM: f64 = 22.0;

/// Column and row of a square or tag.
type Cell = [i32; 2];

/// Returns the target as SVG in true size: the squares, a white margin of one square, and a line of 100 mm with ticks for checking the
/// printer's scale.
///
/// # Errors
/// [`TargetRefusal`] for a size out of range.
pub fn svg(target: &Target) -> Result<String, TargetRefusal> {
    let Target { printed, square_mm } = *target;
    if !(1.0..=500.0).contains(&square_mm) {
        return Err(TargetRefusal::Square(square_mm));
    }
    let [columns, rows] = size(&printed);
    let width = ((columns + 2.0) * square_mm).max(RULER_MM + 20.0);
    let foot = (rows + 2.0) * square_mm;
    let height = foot + FOOT_MM;
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}mm\" height=\"{height}mm\" viewBox=\"0 0 {width} {height}\">\n\
         <title>Board of {printed}, squares of {square_mm} mm</title>\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n<path d=\"{}\" fill=\"black\" shape-rendering=\"crispEdges\"/>\n",
        path(&printed, square_mm)
    );
    ruler(&mut text, target, foot);
    text.push_str("</svg>\n");
    Ok(text)
}

/// Returns the columns and rows of the area that a board covers, in squares or tags.
#[must_use]
pub fn size(printed: &Printed) -> [f64; 2] {
    let corners = printed.corners.size();
    match printed.kind {
        Kind::AprilGrid { gap } => corners.map(|n| printed.line(n - 1) + 2.0 * gap),
        _ => corners.map(|n| f64::from(n + 1)),
    }
}

/// Returns all black rectangles of a board.
#[must_use]
pub fn ink(printed: &Printed) -> Vec<Ink> {
    match printed.kind {
        Kind::Chessboard => squares(printed),
        Kind::Charuco(charuco) => {
            let margin = 0.5 * (1.0 - charuco.marker);
            let marker = |([i, j], code): (Cell, &u64)| {
                let at = [f64::from(i) + margin, f64::from(j) + margin];
                bits(*code, charuco.dictionary.marker_size(), 1, at, charuco.marker)
            };
            let markers = charuco_squares(printed).zip(charuco.dictionary.codes()).flat_map(marker);
            squares(printed).into_iter().chain(markers).collect()
        }
        Kind::AprilGrid { gap } => april_grid(printed, gap),
    }
}

/// Returns the black squares of a chessboard.
fn squares(printed: &Printed) -> Vec<Ink> {
    let [columns, rows] = printed.corners.size().map(|n| n + 1);
    let black = (0..rows).flat_map(|j| (0..columns).filter(move |i| (i + j) % 2 == 0).map(move |i| [i, j]));
    black.map(|cell| Ink { at: cell.map(f64::from), size: [1.0; 2] }).collect()
}

/// Returns the black rectangles of tags with a border of two bits, and of the squares between their corners, as Kalibr prints them: each
/// tag is rotated by half a turn from the dictionary's orientation.
fn april_grid(printed: &Printed, gap: f64) -> Vec<Ink> {
    let Some(family) = resolve_dictionary(TAG_FAMILY) else { return Vec::new() };
    let place = |index: i32| gap + printed.line(index);
    let side = family.marker_size();
    let tag = |([i, j], code): (Cell, &u64)| {
        bits(code.reverse_bits() >> (64 - side * side), side, 2, [place(i), place(j)], 1.0)
    };
    let tags = tag_cells(printed).zip(family.codes()).flat_map(tag);
    let [columns, rows] = printed.corners.size();
    // A square touches each corner of each tag from outside.
    let outside = |index: i32| if index % 2 == 0 { place(index) - gap } else { place(index) };
    let corners = (0..rows).flat_map(|j| (0..columns).map(move |i| [i, j]));
    let square = |[i, j]: Cell| Ink { at: [outside(i), outside(j)], size: [gap; 2] };
    tags.chain(corners.map(square)).collect()
}

/// Returns the black rectangles of a mark: its border, and the runs of black bits in its rows.
fn bits(code: u64, side: usize, border: usize, at: [f64; 2], size: f64) -> Vec<Ink> {
    let bit = size / (side + 2 * border) as f64;
    let is_black = |x: usize, y: usize| {
        let inside = |v: usize| (border..border + side).contains(&v);
        !(inside(x) && inside(y)) || code >> ((y - border) * side + x - border) & 1 == 1
    };
    let mut ink = Vec::new();
    for y in 0..side + 2 * border {
        let mut x = 0;
        while x < side + 2 * border {
            let run = (x..side + 2 * border).take_while(|x| is_black(*x, y)).count();
            if run > 0 {
                let corner = [at[0] + x as f64 * bit, at[1] + y as f64 * bit];
                ink.push(Ink { at: corner, size: [run as f64 * bit, bit] });
            }
            x += run.max(1);
        }
    }
    ink
}

/// Returns the black rectangles of a board as one SVG path, with a margin of one square.
fn path(printed: &Printed, side: f64) -> String {
    // Coordinates of the path are rounded to a thousandth of a millimetre.
    let mm = |v: f64| (1000.0 * v * side).round() / 1000.0;
    let rectangle = |Ink { at, size }: Ink| {
        format!("M{} {}h{}v{}h-{}z", mm(at[0] + 1.0), mm(at[1] + 1.0), mm(size[0]), mm(size[1]), mm(size[0]))
    };
    ink(printed).into_iter().map(rectangle).collect()
}

/// Returns the options of `hemilux calibrate lens` with which pictures of the board are calibrated.
fn options(printed: &Printed) -> String {
    let Board { columns, rows } = printed.corners;
    match printed.kind {
        Kind::Chessboard => format!("--board {columns}x{rows}"),
        Kind::Charuco(Charuco { dictionary, marker }) => {
            format!(
                "--kind charuco --board {columns}x{rows} --dictionary {} --marker {marker}",
                dictionary.name()
            )
        }
        Kind::AprilGrid { gap } => {
            format!("--kind aprilgrid --board {}x{} --gap {gap}", columns / 2, rows / 2)
        }
    }
}

fn ruler(text: &mut String, target: &Target, top: f64) {
    let (left, y) = (10.0, top + 8.0);
    let ticks: String = (0..=10).map(|i| format!("M{} {}v3", left + 10.0 * f64::from(i), y - 1.5)).collect();
    let Target { printed, square_mm } = target;
    let options = options(printed);
    let _ = write!(
        text,
        "<path id=\"ruler\" d=\"M{left} {y}h{RULER_MM}{ticks}\" stroke=\"black\" stroke-width=\"0.3\" fill=\"none\"/>\n\
         <text x=\"{left}\" y=\"{}\" font-family=\"sans-serif\" font-size=\"4\">This line is {RULER_MM} mm long: print at 100 %. \
         hemilux calibrate lens {options} --square-mm {square_mm}</text>\n",
        y + 8.0
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn target_has_the_squares_and_the_ruler_in_millimetres() {
        let target = Target { printed: Board { columns: 8, rows: 6 }.into(), square_mm: 25.0 };
        let text = svg(&target).expect("a target");
        assert!(text.contains("width=\"275mm\" height=\"247mm\""), "{text}");
        assert_eq!(text.matches("h25v25").count(), 32, "9 x 7 squares have 32 black ones");
        assert!(text.contains("M10 233h100"), "a line of 100 mm: {text}");
    }

    #[test]
    fn squares_out_of_range_are_refused() {
        let board = Board { columns: 8, rows: 6 };
        for square_mm in [0.0, -1.0, f64::NAN, 1e9] {
            assert!(svg(&Target { printed: board.into(), square_mm }).is_err(), "{square_mm}");
        }
    }
}
