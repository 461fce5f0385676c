//! Vectors of three f64 for the scores.

/// Returns the scalar product of two vectors.
pub(crate) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Adds `scale * b` to `a`.
pub(crate) fn add_scaled(a: &mut [f64; 3], b: [f64; 3], scale: f64) {
    for (a, b) in a.iter_mut().zip(b) {
        *a += scale * b;
    }
}

/// Returns the length of a vector.
pub(crate) fn norm(a: [f64; 3]) -> f64 {
    dot(a, a).sqrt()
}

/// Returns the unit vector along `a`; `None` if `a` has no direction.
pub(crate) fn unit(a: [f64; 3]) -> Option<[f64; 3]> {
    let length = norm(a);
    (length > 0.0 && length.is_finite()).then(|| a.map(|v| v / length))
}

/// Returns the angle between two vectors in degrees; rounding errors are small for small angles too.
pub(crate) fn angle_deg(a: [f64; 3], b: [f64; 3]) -> f64 {
    let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    norm(cross).atan2(dot(a, b)).to_degrees()
}

/// Returns two unit vectors at right angles to `d` and to each other.
pub(crate) fn tangents(d: [f64; 3]) -> [[f64; 3]; 2] {
    // Method: T. Duff et al., "Building an Orthonormal Basis, Revisited", 2017.
    let sign = 1f64.copysign(d[2]);
    let a = -1.0 / (sign + d[2]);
    let b = d[0] * d[1] * a;
    [[1.0 + sign * d[0] * d[0] * a, sign * b, -sign * d[0]], [b, sign + d[1] * d[1] * a, -d[1]]]
}
