//! The HEALPix pixel of a direction [Gorski2005], NESTED order: the quads of the volume sampler.

use std::f64::consts::{FRAC_PI_2, TAU};

/// NESTED pixel of the unit vector `d` at `order` (nside = 2^order).
#[must_use]
pub fn ipix(order: u32, d: [f64; 3]) -> usize {
    let nside = 1usize << order;
    let quarter = d[1].atan2(d[0]).rem_euclid(TAU) / FRAC_PI_2;
    let (face, x, y) =
        if d[2].abs() <= 2.0 / 3.0 { equatorial(nside, d[2], quarter) } else { polar(nside, d[2], quarter) };
    face * nside * nside + interleave(order, x, y)
}

/// (face, x, y) where |z| <= 2/3, from the indices of the ascending and descending lines.
fn equatorial(nside: usize, z: f64, quarter: f64) -> (usize, usize, usize) {
    let n = nside as f64;
    let falling = (n * (0.5 + quarter - 0.75 * z)) as usize;
    let rising = (n * (0.5 + quarter + 0.75 * z)) as usize;
    let (a, b) = (falling / nside, rising / nside);
    let face = match a.cmp(&b) {
        std::cmp::Ordering::Equal => 4 + a % 4,
        std::cmp::Ordering::Less => a % 4,
        std::cmp::Ordering::Greater => 8 + b % 4,
    };
    (face, rising % nside, nside - 1 - falling % nside)
}

/// (face, x, y) in the caps.
fn polar(nside: usize, z: f64, quarter: f64) -> (usize, usize, usize) {
    let n = nside as f64;
    let corner = (quarter as usize).min(3);
    let along = quarter - corner as f64;
    let ring = n * (3.0 * (1.0 - z.abs())).max(0.0).sqrt();
    let line = |v: f64| (v as usize).min(nside - 1);
    let (rising, falling) = (line(along * ring), line((1.0 - along) * ring));
    if z > 0.0 { (corner, nside - 1 - falling, nside - 1 - rising) } else { (8 + corner, rising, falling) }
}

/// Bits of x at even, of y at odd places.
fn interleave(order: u32, x: usize, y: usize) -> usize {
    (0..order).map(|bit| ((x >> bit & 1) << (2 * bit)) | ((y >> bit & 1) << (2 * bit + 1))).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Centre of a pixel by the face equations (x, y in 0..1 inside a face), an independent route.
    fn centre(order: u32, ipix: usize) -> [f64; 3] {
        const RING: [f64; 12] = [2.0, 2.0, 2.0, 2.0, 3.0, 3.0, 3.0, 3.0, 4.0, 4.0, 4.0, 4.0];
        const TURN: [f64; 12] = [1.0, 3.0, 5.0, 7.0, 0.0, 2.0, 4.0, 6.0, 1.0, 3.0, 5.0, 7.0];
        let nside = 1usize << order;
        let (face, within) = (ipix / (nside * nside), ipix % (nside * nside));
        let bits = |from: u32| (0..order).map(|b| (within >> (2 * b + from) & 1) << b).sum::<usize>();
        let [x, y] = [0, 1].map(|from| (bits(from) as f64 + 0.5) / nside as f64);
        let ring = RING[face] - x - y;
        let (n, z) = if ring < 1.0 {
            (ring, 1.0 - ring * ring / 3.0)
        } else if ring > 3.0 {
            (4.0 - ring, (4.0 - ring).powi(2) / 3.0 - 1.0)
        } else {
            (1.0, (2.0 - ring) * 2.0 / 3.0)
        };
        let phi = std::f64::consts::FRAC_PI_4 * (TURN[face] * n + x - y) / n;
        let r = (1.0 - z * z).sqrt();
        [r * phi.cos(), r * phi.sin(), z]
    }

    #[test]
    fn pixel_of_every_centre_is_the_pixel() {
        for order in 0..=5 {
            for k in 0..12 << (2 * order) {
                assert_eq!(ipix(order, centre(order, k)), k, "order {order}");
            }
        }
    }

    #[test]
    fn poles_and_seam_have_pixels() {
        for d in [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [1.0, -0.0, 0.0], [-1.0, -0.0, 0.0]] {
            assert!(ipix(5, d) < 12 << 10);
        }
    }
}
