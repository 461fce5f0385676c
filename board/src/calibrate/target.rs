//! Chessboards to print.

use super::Board;
use std::fmt::Write;

/// A chessboard on paper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Its inner corners.
    pub board: Board,
    /// Side of a square, millimetres.
    pub square_mm: f64,
}

/// Why a target was refused.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum TargetRefusal {
    /// The side of a square is out of range.
    #[error("found squares of {0} mm, expected 1 to 500")]
    Square(f64),
}

/// Length of the ruler line, millimetres, and room for it below the board.
const RULER_MM: f64 = 100.0;
const FOOT_MM: f64 = 22.0;

/// Writes the target as SVG in true size: the squares, a white margin of a square, and a line of 100 mm with ticks by which the printer's
/// scale is checked.
///
/// # Errors
/// [`TargetRefusal`].
pub fn svg(target: &Target) -> Result<String, TargetRefusal> {
    let Target { board, square_mm } = *target;
    if !(1.0..=500.0).contains(&square_mm) {
        return Err(TargetRefusal::Square(square_mm));
    }
    let (columns, rows) = (board.columns + 1, board.rows + 1);
    let width = (f64::from(columns + 2) * square_mm).max(RULER_MM + 20.0);
    let foot = f64::from(rows + 2) * square_mm;
    let height = foot + FOOT_MM;
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}mm\" height=\"{height}mm\" viewBox=\"0 0 {width} {height}\">\n\
         <title>Chessboard of {board} inner corners, squares of {square_mm} mm</title>\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n<path d=\"{}\" fill=\"black\" shape-rendering=\"crispEdges\"/>\n",
        squares(columns, rows, square_mm)
    );
    ruler(&mut text, target, foot);
    text.push_str("</svg>\n");
    Ok(text)
}

/// The black squares as one path.
fn squares(columns: u32, rows: u32, side: f64) -> String {
    let black = (0..rows).flat_map(|j| (0..columns).filter(move |i| (i + j) % 2 == 0).map(move |i| [i, j]));
    let square = |[i, j]: [u32; 2]| {
        let (x, y) = (f64::from(i + 1) * side, f64::from(j + 1) * side);
        format!("M{x} {y}h{side}v{side}h-{side}z")
    };
    black.map(square).collect()
}

fn ruler(text: &mut String, target: &Target, top: f64) {
    let (left, y) = (10.0, top + 8.0);
    let ticks: String = (0..=10).map(|i| format!("M{} {}v3", left + 10.0 * f64::from(i), y - 1.5)).collect();
    let Target { board, square_mm } = target;
    let _ = write!(
        text,
        "<path id=\"ruler\" d=\"M{left} {y}h{RULER_MM}{ticks}\" stroke=\"black\" stroke-width=\"0.3\" fill=\"none\"/>\n\
         <text x=\"{left}\" y=\"{}\" font-family=\"sans-serif\" font-size=\"4\">This line is {RULER_MM} mm long: print at 100 %. \
         hemilux calibrate lens --board {board} --square-mm {square_mm}</text>\n",
        y + 8.0
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn target_has_the_squares_and_the_ruler_in_millimetres() {
        let target = Target { board: Board { columns: 8, rows: 6 }, square_mm: 25.0 };
        let text = svg(&target).expect("a target");
        assert!(text.contains("width=\"275mm\" height=\"247mm\""), "{text}");
        assert_eq!(text.matches("h25v25").count(), 32, "9 x 7 squares have 32 black ones");
        assert!(text.contains("M10 233h100"), "a line of 100 mm: {text}");
    }

    #[test]
    fn squares_out_of_range_are_refused() {
        let board = Board { columns: 8, rows: 6 };
        for square_mm in [0.0, -1.0, f64::NAN, 1e9] {
            assert!(svg(&Target { board, square_mm }).is_err(), "{square_mm}");
        }
    }
}
