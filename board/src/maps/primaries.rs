//! Conversion of colours in stated primaries to linear Rec. 709, without adaptation of the white point.

use super::Refusal;

/// CIE (x, y) of the red, green and blue primaries and of white.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Primaries(pub [[f64; 2]; 4]);

/// Rec. 709 with white D65, as OpenEXR and Rec. 709 state it.
pub(super) const REC_709: Primaries = Primaries([[0.64, 0.33], [0.3, 0.6], [0.15, 0.06], [0.3127, 0.329]]);

/// CIE XYZ as primaries: each of X, Y and Z is a primary, white is the equal-energy point.
pub(super) const XYZ: Primaries = Primaries([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0], [1.0 / 3.0, 1.0 / 3.0]]);

type Matrix = [[f64; 3]; 3];

impl Primaries {
    /// Returns true if the primaries are those of Rec. 709 within the rounding of 8-bit metadata.
    pub fn are_rec_709(&self) -> bool {
        let pairs = self.0.as_flattened().iter().zip(REC_709.0.as_flattened());
        pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-3)
    }

    /// Returns the matrix from RGB to XYZ, with Y = 1 for white; `None` for degenerate primaries.
    fn to_xyz(self) -> Option<Matrix> {
        let [red, green, blue, white] = self.0.map(|[x, y]| [x, y, 1.0 - x - y]);
        let columns = [red, green, blue];
        let rows = [0, 1, 2].map(|i| [0, 1, 2].map(|j| columns[j][i]));
        if white[1].abs() < 1e-9 {
            return None;
        }
        let scale = apply(&inverse(&rows)?, white.map(|v| v / white[1]));
        Some(rows.map(|row| [row[0] * scale[0], row[1] * scale[1], row[2] * scale[2]]))
    }

    /// Returns the matrix from colours in these primaries to linear Rec. 709.
    pub fn to_rec_709(self) -> Result<[[f32; 3]; 3], Refusal> {
        let unusable = || {
            let numbers: Vec<_> = self.0.as_flattened().iter().map(|v| format!("{v:.4}")).collect();
            let expected = "CIE (x, y) of three primaries and white that span a plane";
            Refusal::new(format!("primaries {}", numbers.join(" ")), expected)
        };
        let from = self.to_xyz().ok_or_else(unusable)?;
        let into = REC_709.to_xyz().and_then(|m| inverse(&m)).ok_or_else(unusable)?;
        let matrix = into.map(|row| {
            [0, 1, 2].map(|j| (row[0] * from[0][j] + row[1] * from[1][j] + row[2] * from[2][j]) as f32)
        });
        if matrix.as_flattened().iter().all(|v| v.is_finite()) { Ok(matrix) } else { Err(unusable()) }
    }
}

/// Multiplies the colour of every texel by the matrix `m`.
pub(super) fn convert(texels: &mut [[f32; 3]], m: &[[f32; 3]; 3]) {
    for texel in texels {
        let [r, g, b] = *texel;
        *texel = [0, 1, 2].map(|i| m[i][0] * r + m[i][1] * g + m[i][2] * b);
    }
}

fn apply(m: &Matrix, v: [f64; 3]) -> [f64; 3] {
    m.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

/// Returns the inverse of the matrix `m`, by cofactors; `None` for a singular matrix.
fn inverse(m: &Matrix) -> Option<Matrix> {
    let cofactor = |i: usize, j: usize| {
        let (a, b, c, d) = ((i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3);
        m[a][c] * m[b][d] - m[a][d] * m[b][c]
    };
    let determinant = (0..3).map(|j| m[0][j] * cofactor(0, j)).sum::<f64>();
    (determinant.abs() > 1e-9).then(|| [0, 1, 2].map(|i| [0, 1, 2].map(|j| cofactor(j, i) / determinant)))
}
