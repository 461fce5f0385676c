//! OCamCalib's `calib_results.txt`: polynomials, centre (row, column), affine terms c, d, e, and size (rows, columns).

use super::model::{ForeignCamera, Model};
use super::{Refusal, refuse};

const EXPECTED: &str = "OCamCalib's five lines: direct polynomial, inverse polynomial, centre, affine terms c d e, height and width";

pub(super) fn is(text: &str) -> bool {
    text.starts_with("#polynomial") || text.starts_with("# polynomial")
}

pub(super) fn parse(text: &str) -> Result<ForeignCamera, Refusal> {
    let lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
    let numbers =
        |line: &str| line.split_whitespace().map(|w| w.parse::<f64>().ok()).collect::<Option<Vec<_>>>();
    let Some(lines) = lines.map(numbers).collect::<Option<Vec<_>>>() else {
        return refuse("a line that is not of numbers", EXPECTED);
    };
    let [direct, _, centre, affine, size] = lines.as_slice() else {
        return refuse(format!("{} lines of numbers", lines.len()), EXPECTED);
    };
    let (&[row, column], &[c, d, e], &[height, width]) =
        (centre.as_slice(), affine.as_slice(), size.as_slice())
    else {
        return refuse("a line of another length", EXPECTED);
    };
    let polynomial = match direct.as_slice() {
        [count, polynomial @ ..] if *count == polynomial.len() as f64 => polynomial.to_vec(),
        _ => return refuse("a direct polynomial of another length than it states", EXPECTED),
    };
    let focal = polynomial.first().map_or(0.0, |a| -a);
    // Columns and rows are (v, u) = (y + e x, c x + d y): with d = 0 the core's lens has the same terms.
    if focal <= 0.0 || d.abs() > 1e-3 {
        return refuse(
            format!("the constant {} and the affine term d = {d}", -focal),
            "a negative constant, and d near 0",
        );
    }
    Ok(ForeignCamera {
        model: Model::Ocam(polynomial),
        size: [width as u32, height as u32],
        focal: [focal, focal * c],
        centre: [column, row],
        skew: focal * e,
    })
}
