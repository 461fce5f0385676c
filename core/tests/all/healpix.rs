//! HEALPix indices and directions against the crate `cdshealpix`.

use crate::common::{RngExt, direction, off, seeded};
use cdshealpix::nested;
use core::f64::consts::{FRAC_PI_2, TAU};
use glam::DVec3;
use hemilux_core::healpix::{self, Domain, FaceCell, Order};

fn from_lon_lat((lon, lat): (f64, f64)) -> DVec3 {
    DVec3::new(lat.cos() * lon.cos(), lat.cos() * lon.sin(), lat.sin())
}

fn reference(order: u8, d: DVec3) -> u64 {
    let lon = d.y.atan2(d.x).rem_euclid(TAU);
    nested::hash(order, lon, d.z.atan2(d.x.hypot(d.y)))
}

#[test]
fn quads_of_coarse_orders_agree_with_cdshealpix() {
    let mut worst = 0.0f64;
    for order in 0..=6 {
        for ipix in 0..12u32 << (2 * order) {
            let expected = from_lon_lat(nested::center(order, u64::from(ipix)));
            worst = worst.max((healpix::centre(order, ipix) - expected).length());
            assert_eq!(healpix::ipix(order, expected), ipix, "order {order}");
        }
    }
    println!("worst centre {worst:.1e}");
    assert!(worst < 1e-12, "{worst}");
}

#[test]
fn indices_of_random_directions_agree_with_cdshealpix() {
    for order in 0..=Order::MAX.get() {
        let mut rng = seeded(u64::from(order));
        for _ in 0..100_000 {
            let d = direction(&mut rng);
            assert_eq!(u64::from(healpix::ipix(order, d)), reference(order, d), "order {order} {d}");
        }
    }
}

#[test]
fn centres_of_fine_orders_agree_with_cdshealpix() {
    for order in 7..=Order::MAX.get() {
        let mut rng = seeded(u64::from(order));
        for _ in 0..20_000 {
            let ipix = rng.random_range(0..12u32 << (2 * order));
            let expected = from_lon_lat(nested::center(order, u64::from(ipix)));
            assert!((healpix::centre(order, ipix) - expected).length() < 1e-12, "order {order} {ipix}");
            assert_eq!(healpix::ipix(order, expected), ipix, "order {order}");
        }
    }
}

#[test]
fn points_near_the_poles_map_back_to_their_quads() {
    for order in 0..=Order::MAX.get() {
        let mut rng = seeded(77);
        for _ in 0..10_000 {
            let colatitude = 10f64.powf(rng.random_range(-7.0..-1.0));
            let phi = rng.random_range(0.0..TAU);
            let (sin, cos) = colatitude.sin_cos();
            for sign in [1.0, -1.0] {
                let d = DVec3::new(sin * phi.cos(), sin * phi.sin(), sign * cos);
                assert_eq!(u64::from(healpix::ipix(order, d)), reference(order, d), "order {order} {d}");
            }
        }
    }
}

#[test]
fn points_of_a_quad_map_back_into_it() {
    for order in 0..=Order::MAX.get() {
        let mut rng = seeded(u64::from(order) + 40);
        for _ in 0..20_000 {
            let ipix = rng.random_range(0..12u32 << (2 * order));
            // The points keep a distance from the edges of their quad that exceeds the rounding error at the finest order.
            let [x, y] = [(); 2].map(|()| rng.random_range(1e-6..1.0 - 1e-6));
            let d = healpix::point(order, ipix, x, y);
            assert!((d.length() - 1.0).abs() < 1e-12, "a unit vector");
            assert_eq!(healpix::ipix(order, d), ipix, "order {order} at {x} {y}");
        }
    }
}

/// A direction on an edge may be assigned to any adjacent quad, which must contain it as a closed set.
#[test]
fn boundary_directions_belong_to_an_adjacent_quad() {
    let mut edges = vec![DVec3::Z, DVec3::NEG_Z];
    for quarter in 0..4 {
        for z in [-0.99, -2.0 / 3.0, -0.3, -1e-17, 0.0, 1e-17, 0.3, 2.0 / 3.0, 0.99] {
            let r = f64::sqrt(1.0 - z * z);
            for step in [-1e-16, 0.0, 1e-16] {
                let phi = f64::from(quarter) * FRAC_PI_2 + step;
                edges.push(DVec3::new(r * phi.cos(), r * phi.sin(), z));
            }
            let axis = [DVec3::X, DVec3::Y, DVec3::NEG_X, DVec3::NEG_Y][quarter as usize];
            edges.push(axis * r + DVec3::Z * z);
            edges.push(DVec3::new(axis.x * r, -axis.y * r, z).with_y(-0.0));
        }
    }
    edges.retain(|d| (d.length() - 1.0).abs() < 1e-9);
    for order in 0..=Order::MAX.get() {
        for d in &edges {
            let ipix = healpix::ipix(order, *d);
            assert!(ipix < 12 << (2 * order), "order {order} {d}");
            assert!(touches(order, ipix, *d), "order {order} {d}: {ipix}");
        }
    }
}

/// Returns whether a grid of points over the closed quad is as near to `d` as the spacing of the grid permits.
fn touches(order: u8, ipix: u32, d: DVec3) -> bool {
    let side = healpix::solid_angle(order).sqrt();
    let near = |i: u32| {
        let p = healpix::point(order, ipix, f64::from(i % 33) / 32.0, f64::from(i / 33) / 32.0);
        (p - d).length()
    };
    (0..33 * 33).map(near).fold(f64::INFINITY, f64::min) < side / 16.0
}

#[test]
fn split_and_join_are_inverse() {
    for order in 0..=6u8 {
        for ipix in 0..12u32 << (2 * order) {
            let FaceCell { face, x, y } = healpix::split(order, ipix);
            assert!(face < 12 && x >> order == 0 && y >> order == 0, "{ipix}");
            assert_eq!(healpix::join(order, FaceCell { face, x, y }), ipix);
        }
    }
    // Written by hand: x = 0b0101, y = 0b0011 interleave to 0b00_01_10_11 (y first).
    assert_eq!(healpix::join(4, FaceCell { face: 0, x: 0b0101, y: 0b0011 }), 0b0001_1011);
    assert_eq!(healpix::join(13, FaceCell { face: 11, x: 8191, y: 8191 }), 12 * (1 << 26) - 1);
}

#[test]
fn children_of_p_are_4p_to_4p_plus_3() {
    let mut rng = seeded(5);
    for _ in 0..100_000 {
        let d = direction(&mut rng);
        for order in 0..Order::MAX.get() {
            assert_eq!(healpix::ipix(order + 1, d) / 4, healpix::ipix(order, d), "order {order} {d}");
        }
    }
}

#[test]
fn shares_add_up_to_exactly_the_hemisphere() {
    for order in 0..=8u8 {
        let quads = 12u32 << (2 * order);
        let sum: f64 = (0..quads).map(|i| Domain::Hemisphere.share(order, i)).sum();
        assert_eq!(sum, f64::from(6u32 << (2 * order)), "order {order}");
        assert!(off(sum * healpix::solid_angle(order), TAU) < 1e-14, "order {order}");
        let stored = Domain::Hemisphere.quads(order) as u32;
        assert!((stored..quads).all(|i| Domain::Hemisphere.share(order, i) == 0.0), "order {order}");
        assert_eq!((0..quads).map(|i| Domain::Sphere.share(order, i)).sum::<f64>(), f64::from(quads));
    }
}

#[test]
fn share_is_the_fraction_of_a_quad_above_the_horizon() {
    for order in 0..=3u8 {
        for ipix in 0..12u32 << (2 * order) {
            let n = 32;
            let above = (0..n * n)
                .filter(|i| {
                    let at = |k: u32| (f64::from(k) + 0.5) / f64::from(n);
                    // Off the diagonal, where a sample would lie exactly on the horizon.
                    healpix::point(order, ipix, at(i % n) + 0.002, at(i / n)).z > 0.0
                })
                .count();
            let share = Domain::Hemisphere.share(order, ipix);
            let measured = above as f64 / f64::from(n * n);
            assert!(
                (measured - share).abs() <= 0.5 / f64::from(n),
                "order {order} {ipix}: {measured} {share}"
            );
        }
    }
}

#[test]
fn non_finite_directions_give_a_valid_index() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, 0.0] {
        for d in [DVec3::splat(bad), DVec3::new(bad, 0.0, 1.0), DVec3::new(0.0, 1.0, bad)] {
            for order in [0, 5, Order::MAX.get()] {
                assert!(healpix::ipix(order, d) < 12 << (2 * order), "order {order} {d}");
            }
        }
    }
}
