//! Mean vectors with energies in fixed point, and the sums of the kernel K over them.
//!
//! One light is compared with all vectors in three loops: the first computes the squared distances and the last the sums, in vectors of
//! 16-bit numbers; the one between looks up K. Energies are shares of a total, rounded so that the sum of successive energies is exact.

use super::kernel::MeanVector;
use super::table::{self, KERNEL_BITS, SLOPE_BITS};
use glam::Vec3;

/// Scale of coordinates of half a mean vector, which are rounded towards 0, so that the difference of two fits 16 bits.
const HALF: f32 = 32_767.0;

/// Scale of spreads: [`table::SQUARE_BITS`] fractional bits.
const SQUARE: f32 = (1u32 << table::SQUARE_BITS) as f32;

/// Scale of energies, of which the total is 1.
const SHARE: f32 = 32_767.0;

/// Number of fractional bits of the product of a slope and a difference.
const PULL_BITS: u32 = 16;

/// Number of 16-bit numbers in a vector.
const LANES: usize = 8;

/// A mean vector in fixed point.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Point {
    half: [i16; 3],
    spread: i32,
}

impl Point {
    pub(super) fn new(vector: &MeanVector) -> Self {
        Self {
            half: vector.half.to_array().map(|v| (v * HALF) as i16),
            spread: (vector.spread * SQUARE) as i32,
        }
    }
}

/// At most `N` mean vectors with energies.
#[derive(Clone, Debug)]
pub(super) struct Points<const N: usize> {
    halves: [[i16; N]; 3],
    spreads: [i32; N],
    shares: [i16; N],
    count: usize,
}

/// K and its derivative between one light and each point.
#[derive(Clone, Debug)]
pub(super) struct Kernels<const N: usize> {
    squares: [i32; N],
    /// Indices of tangents, later the tangents.
    tangents: [u32; N],
    kernels: [i16; N],
    slopes: [i16; N],
}

impl<const N: usize> Kernels<N> {
    pub(super) const fn new() -> Self {
        Self { squares: [0; N], tangents: [0; N], kernels: [0; N], slopes: [0; N] }
    }
}

/// Converts a sum of K times shares to a number.
pub(super) fn kernel_sum(sum: i32) -> f32 {
    sum as f32 * (1.0 / (SHARE * (1u32 << KERNEL_BITS) as f32))
}

/// Converts a sum of gradients times shares to a vector: the gradient with respect to a mean vector, without a multiple of that vector.
pub(super) fn pull_sum(sum: [i32; 3]) -> Vec3 {
    // The sums are of differences of half mean vectors.
    Vec3::from_array(sum.map(|v| v as f32)) * (2.0 / (SHARE * (1u32 << PULL_BITS) as f32))
}

impl<const N: usize> Points<N> {
    pub(super) const fn new() -> Self {
        const { assert!(N.is_multiple_of(LANES), "points fill whole vectors") };
        Self { halves: [[0; N]; 3], spreads: [0; N], shares: [0; N], count: 0 }
    }

    pub(super) fn clear(&mut self) {
        self.count = 0;
    }

    /// Adds a point without energy; a point beyond the `N`th is ignored.
    pub(super) fn push(&mut self, point: &Point) {
        let i = self.count;
        if i < N {
            self.halves.iter_mut().zip(point.half).for_each(|(axis, v)| axis[i] = v);
            self.spreads[i] = point.spread;
            self.shares[i] = 0;
            self.count += 1;
        }
    }

    /// Returns the point of index `i`.
    pub(super) fn point(&self, i: usize) -> Point {
        Point { half: self.halves.each_ref().map(|axis| axis[i]), spread: self.spreads[i] }
    }

    /// Sets the energies of the points to `shares`, fractions of the total.
    pub(super) fn set_shares(&mut self, shares: impl Iterator<Item = f32>) {
        let (mut exact, mut rounded) = (0.0f32, 0i32);
        for (share, of) in self.shares[..self.count].iter_mut().zip(shares) {
            exact += of * SHARE;
            let next = (exact + 0.5) as i32;
            *share = next.saturating_sub(rounded).clamp(0, i32::from(i16::MAX)) as i16;
            rounded = next;
        }
        let n = self.padded();
        self.shares[self.count..n].fill(0);
    }

    /// Sets `out` to K and its derivative between `at` and each point.
    pub(super) fn look_up(&self, at: &Point, out: &mut Kernels<N>) {
        let n = self.padded();
        let [xs, ys, zs] = &self.halves;
        let (xs, ys, zs, spreads) = (&xs[..n], &ys[..n], &zs[..n], &self.spreads[..n]);
        let ([x, y, z], spread) = (at.half, at.spread);
        let Kernels { squares, tangents, kernels, slopes } = out;
        let (squares, tangents) = (&mut squares[..n], &mut tangents[..n]);
        let (kernels, slopes) = (&mut kernels[..n], &mut slopes[..n]);
        for i in 0..n {
            let square = square([xs[i].wrapping_sub(x), ys[i].wrapping_sub(y), zs[i].wrapping_sub(z)]);
            squares[i] = table::limited(square.wrapping_add(spreads[i].wrapping_add(spread)));
            tangents[i] = table::index(squares[i]);
        }
        // The lookup is a loop of its own, since it does not vectorise.
        for four in tangents.as_chunks_mut::<4>().0 {
            *four = four.map(table::tangent);
        }
        for i in 0..n {
            kernels[i] = table::kernel(tangents[i], squares[i]);
            slopes[i] = table::slope(tangents[i]);
        }
    }

    /// Replaces numbers of `least` by the squared distance of their point to `at`, whose bits in `mask` are replaced by `index`, where that
    /// is less.
    pub(super) fn approach(&self, at: &Point, index: i32, mask: i32, least: &mut [i32; N]) {
        let n = self.padded();
        let [xs, ys, zs] = &self.halves;
        let (xs, ys, zs, least) = (&xs[..n], &ys[..n], &zs[..n], &mut least[..n]);
        let [x, y, z] = at.half;
        for i in 0..n {
            let square = square([xs[i].wrapping_sub(x), ys[i].wrapping_sub(y), zs[i].wrapping_sub(z)]);
            least[i] = least[i].min(square & !mask | index);
        }
    }

    /// Returns the number of points rounded up to whole vectors; points without energy fill the last one.
    fn padded(&self) -> usize {
        self.count.next_multiple_of(LANES).min(N)
    }

    /// Returns the sum of the shares times K.
    pub(super) fn kernel(&self, of: &Kernels<N>) -> i32 {
        let n = self.padded();
        let products =
            self.shares[..n].iter().zip(&of.kernels[..n]).map(|(&s, &k)| i32::from(s) * i32::from(k));
        products.fold(0, i32::wrapping_add)
    }

    /// Returns the sum of the shares times the derivatives of K times the differences between the points and `at`.
    pub(super) fn pull(&self, at: &Point, of: &Kernels<N>) -> [i32; 3] {
        let n = self.padded();
        let (shares, slopes) = (&self.shares[..n], &of.slopes[..n]);
        let sum = |axis: &[i16; N], at: i16| {
            let axis = &axis[..n];
            let mut sum = 0i32;
            for i in 0..n {
                let difference = i32::from(axis[i].wrapping_sub(at));
                let along = (difference * i32::from(slopes[i])) >> (15 + SLOPE_BITS - PULL_BITS);
                sum = sum.wrapping_add(i32::from(along as i16) * i32::from(shares[i]));
            }
            sum
        };
        let [xs, ys, zs] = &self.halves;
        [sum(xs, at.half[0]), sum(ys, at.half[1]), sum(zs, at.half[2])]
    }
}

/// Returns the squared length of a difference of half mean vectors, with [`table::SQUARE_BITS`] fractional bits.
#[inline(always)]
fn square(difference: [i16; 3]) -> i32 {
    let [x, y, z] = difference.map(i32::from);
    (x * x + y * y).wrapping_add(z * z)
}

#[cfg(test)]
mod tests {
    use super::super::kernel::KERNEL;
    use super::*;
    use crate::healpix;
    use glam::DVec3;

    /// Returns K and its derivative with respect to the cosine, of two half mean vectors with a sum of spreads.
    fn exact(half: DVec3, other: DVec3, spread: f64) -> (f64, f64) {
        let square = half.distance_squared(other) + spread;
        let at = |h: f64| KERNEL.iter().rev().fold(0.0, |sum, c| sum * h + f64::from(*c));
        let h = libm::sqrt(square);
        (at(h), (at(h + 1e-5) - at(h - 1e-5)) / 2e-5 / h * -0.25)
    }

    /// Returns disc `i` of 48, whose radii are up to 20 degrees, and its energy.
    fn disc(i: u32) -> (MeanVector, f32) {
        let radius = (i % 21) as f32;
        (MeanVector::of_disc(healpix::centre(1, i).as_vec3(), radius.to_radians()), 0.001 * radius + 0.01)
    }

    #[test]
    fn sums_match_those_in_double_precision() {
        let discs = (0..47).map(disc);
        let total: f32 = discs.clone().map(|(_, y)| y).sum();
        let mut points = Points::<64>::new();
        discs.clone().for_each(|(disc, _)| points.push(&Point::new(&disc)));
        points.set_shares(discs.clone().map(|(_, y)| y / total));
        let mut kernels = Kernels::new();
        for angle in 0..20 {
            let at = Vec3::new(libm::sinf(angle as f32), 0.3, libm::cosf(angle as f32)).normalize();
            let light = MeanVector::of_disc(at, 0.02 * angle as f32);
            let point = Point::new(&light);
            points.look_up(&point, &mut kernels);
            let (mut kernel, mut pull) = (0.0, DVec3::ZERO);
            for (disc, y) in discs.clone() {
                let (half, other) = (light.half.as_dvec3(), disc.half.as_dvec3());
                let (k, slope) = exact(half, other, f64::from(light.spread) + f64::from(disc.spread));
                kernel += f64::from(y / total) * k;
                pull += f64::from(y / total) * slope * 2.0 * (other - half);
            }
            let found = kernel_sum(points.kernel(&kernels));
            assert!((f64::from(found) - kernel).abs() < 1e-4, "{angle}: {found}, expected {kernel}");
            let found = pull_sum(points.pull(&point, &kernels));
            assert!(found.as_dvec3().distance(pull) < 2e-3, "{angle}: {found}, expected {pull}");
        }
    }

    #[test]
    fn shares_of_any_numbers_are_the_rounded_sum() {
        let mut points = Points::<64>::new();
        (0..64).for_each(|i| points.push(&Point::new(&disc(i % 48).0)));
        points.set_shares((0..64).map(|_| 1.0 / 64.0));
        assert_eq!(points.shares.iter().map(|&s| i32::from(s)).sum::<i32>(), 32_767);
        for hostile in [f32::NAN, f32::INFINITY, -1.0, 1e30] {
            points.set_shares((0..64).map(|_| hostile));
            assert!(points.shares.iter().all(|&s| s >= 0), "{hostile}");
        }
    }
}
