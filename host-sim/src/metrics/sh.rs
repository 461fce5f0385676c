//! Real spherical harmonics up to degree 2: orthonormal, without Condon-Shortley sign.
//!
//! The functions (degree, order) are sorted as in the light set's JSON: (0,0) (1,-1) (1,0) (1,1) (2,-2) (2,-1) (2,0) (2,1) (2,2).

use std::f64::consts::PI;

/// Solid angle of each of the twelve nodes of [`icosahedron`], steradians.
const NODE_SR: f64 = PI / 3.0;

/// Returns the nine basis functions at the unit vector `d`.
#[must_use]
pub fn basis([x, y, z]: [f64; 3]) -> [f64; 9] {
    let c0 = 0.5 * (1.0 / PI).sqrt();
    let c1 = (3.0 / (4.0 * PI)).sqrt();
    let c2 = 0.5 * (15.0 / PI).sqrt();
    let c20 = 0.25 * (5.0 / PI).sqrt();
    [
        c0,
        c1 * y,
        c1 * z,
        c1 * x,
        c2 * x * y,
        c2 * y * z,
        c20 * (3.0 * z * z - 1.0),
        c2 * x * z,
        0.5 * c2 * (x * x - y * y),
    ]
}

/// Returns the value at the unit vector `d` of the function with the nine `coefficients`.
#[must_use]
pub fn evaluate(coefficients: &[f64; 9], d: [f64; 3]) -> f64 {
    basis(d).iter().zip(coefficients).map(|(y, c)| y * c).sum()
}

/// Returns the coefficients of f(d) = g(axes(d)), where g has the coefficients `sh` and `axes` is orthogonal (a rotation or a reflection).
///
/// The projection integrates polynomials of degree 4, for which quadrature over the twelve vertices of the icosahedron is exact (a spherical
/// 5-design).
#[must_use]
pub fn change_axes(sh: &[[f64; 3]; 9], axes: impl Fn([f64; 3]) -> [f64; 3]) -> [[f64; 3]; 9] {
    let mut turned = [[0.0; 3]; 9];
    for node in icosahedron() {
        let (from, onto) = (basis(axes(node)), basis(node));
        for channel in 0..3 {
            let value: f64 = (0..9).map(|i| sh[i][channel] * from[i]).sum();
            for (row, y) in turned.iter_mut().zip(onto) {
                row[channel] += value * y * NODE_SR;
            }
        }
    }
    turned
}

/// Returns the vertices of the regular icosahedron: the cyclic permutations of (0, +-1, +-golden ratio), normalised.
fn icosahedron() -> [[f64; 3]; 12] {
    let golden = (1.0 + 5.0f64.sqrt()) / 2.0;
    let length = (1.0 + golden * golden).sqrt();
    std::array::from_fn(|k| {
        let short = if k & 1 == 0 { 1.0 } else { -1.0 } / length;
        let long = if k & 2 == 0 { golden } else { -golden } / length;
        let mut vertex = [0.0, short, long];
        vertex.rotate_right(k / 4);
        vertex
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::vector::unit;

    #[test]
    fn basis_has_the_values_of_the_formats_test_vector() {
        // The test vector of the light set's format: a unit light from (1, 2, 3) / sqrt(14).
        let printed =
            [0.282095, 0.261169, 0.391754, 0.130585, 0.156078, 0.468235, 0.292864, 0.234117, -0.117059];
        let d = unit([1.0, 2.0, 3.0]).unwrap();
        for (y, expected) in basis(d).iter().zip(printed) {
            assert!((y - expected).abs() < 1e-6, "{y} against {expected}");
        }
    }

    #[test]
    fn icosahedron_integrates_the_basis_orthonormally() {
        for i in 0..9 {
            for j in 0..9 {
                let sum: f64 = icosahedron().iter().map(|&d| basis(d)[i] * basis(d)[j] * NODE_SR).sum();
                let expected = if i == j { 1.0 } else { 0.0 };
                assert!((sum - expected).abs() < 1e-12, "({i}, {j}): {sum}");
            }
        }
    }

    #[test]
    fn coefficients_follow_a_change_of_axes() {
        let sh: [[f64; 3]; 9] =
            std::array::from_fn(|i| [1.0 + i as f64, 0.3 * i as f64 - 1.0, 2.0 - i as f64]);
        let y_up = |[x, y, z]: [f64; 3]| [x, z, -y];
        let turned = change_axes(&sh, y_up);
        let d = unit([0.3, -0.5, 0.8]).unwrap();
        for channel in 0..3 {
            let of = |rows: &[[f64; 3]; 9]| std::array::from_fn(|i| rows[i][channel]);
            let (here, there) = (evaluate(&of(&turned), d), evaluate(&of(&sh), y_up(d)));
            assert!((here - there).abs() < 1e-12, "{here} against {there}");
        }
    }
}
