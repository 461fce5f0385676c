//! Square roots without a library call. The code is vectorised, whereas the root of the library for ARMv7 is a loop over bits.

use glam::Vec3;

/// Number of Newton steps for a reciprocal root; two steps give a relative error of 5e-6.
const STEPS: usize = 2;

/// Returns 1 / sqrt(v) of a positive, normal number within a relative error of 5e-6: the exponent is halved, then Newton steps follow.
pub(crate) fn inverse(v: f32) -> f32 {
    let mut r = f32::from_bits(0x5f37_59df - (v.to_bits() >> 1));
    for _ in 0..STEPS {
        r *= 1.5 - 0.5 * v * r * r;
    }
    r
}

/// Returns the square root of a positive, normal number within a relative error of 5e-6.
pub(crate) fn root(v: f32) -> f32 {
    v * inverse(v)
}

/// Returns `v` divided by its length, of length 1 within 5e-6; `None` if `v` is not finite or its length is below 1e-10 or above 1e10.
pub(crate) fn unit(v: Vec3) -> Option<Vec3> {
    let squared = v.length_squared();
    (squared > 1e-20 && squared < 1e20).then(|| v * inverse(squared))
}

#[cfg(test)]
mod tests {
    use super::{inverse, root, unit};
    use glam::Vec3;

    #[test]
    fn roots_are_right_within_5e_6() {
        for i in 1..=100_000u32 {
            for v in [i as f32 * 1e-5, i as f32 * 1e-25, i as f32 * 1e20] {
                let exact = libm::sqrt(f64::from(v));
                assert!(libm::fabs(f64::from(root(v)) / exact - 1.0) < 5e-6, "at {v}: {}", root(v));
                assert!(libm::fabs(f64::from(inverse(v)) * exact - 1.0) < 5e-6, "at {v}: {}", inverse(v));
            }
        }
    }

    #[test]
    fn unit_normalises_and_refuses_zero_and_non_finite_vectors() {
        let v = unit(Vec3::new(3e-5, -4e-5, 1e-5)).expect("some length");
        assert!((v.length() - 1.0).abs() < 1e-5);
        for nothing in [Vec3::ZERO, Vec3::splat(f32::NAN), Vec3::splat(f32::INFINITY), Vec3::splat(1e-30)] {
            assert_eq!(unit(nothing), None);
        }
    }
}
