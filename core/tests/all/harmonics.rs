//! The basis of ambient light: the test vector of `board/FORMATS.md`, and orthonormality by quadrature.

use glam::Vec3;
use hemilux_core::harmonics::{basis, radiance};

#[test]
fn basis_matches_the_test_vector_of_the_formats() {
    let expected =
        [0.282095, 0.261169, 0.391754, 0.130585, 0.156078, 0.468235, 0.292864, 0.234117, -0.117059f32];
    let found = basis(Vec3::new(1.0, 2.0, 3.0) / 14f32.sqrt());
    for (i, (f, e)) in found.into_iter().zip(expected).enumerate() {
        assert!((f - e).abs() < 1e-6, "coefficient {i}: {f}, expected {e}");
    }
}

#[test]
fn the_functions_are_orthonormal() {
    // A midpoint rule in z and phi is exact in phi, and within 1e-5 in z for polynomials of degree 4.
    const STEPS: u32 = 400;
    let mut products = [[0.0f64; 9]; 9];
    for i in 0..STEPS {
        let z = -1.0 + (2.0 * f64::from(i) + 1.0) / f64::from(STEPS);
        for k in 0..12 {
            let phi = std::f64::consts::TAU * f64::from(k) / 12.0;
            let r = (1.0 - z * z).sqrt();
            let b = basis(Vec3::new((r * phi.cos()) as f32, (r * phi.sin()) as f32, z as f32)).map(f64::from);
            let share = 4.0 * std::f64::consts::PI / f64::from(STEPS * 12);
            for (row, a) in products.iter_mut().zip(b) {
                row.iter_mut().zip(b).for_each(|(sum, b)| *sum += share * a * b);
            }
        }
    }
    for (i, row) in products.iter().enumerate() {
        for (j, value) in row.iter().enumerate() {
            let expected = if i == j { 1.0 } else { 0.0 };
            assert!((value - expected).abs() < 1e-4, "{i}, {j}: {value}");
        }
    }
}

#[test]
fn radiance_evaluates_the_series() {
    let mut sh = [[0.0; 3]; 9];
    sh[0] = [1.0, 2.0, 3.0];
    sh[2] = [0.5, 0.0, -1.0];
    let found = radiance(&sh, Vec3::Z);
    for (f, e) in found.into_iter().zip([
        0.282_094_8 + 0.5 * 0.488_602_5,
        2.0 * 0.282_094_8,
        3.0 * 0.282_094_8 - 0.488_602_5,
    ]) {
        assert!((f - e).abs() < 1e-6, "{found:?}");
    }
}
