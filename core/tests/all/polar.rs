//! Latitude-longitude maps: the pyramid's energy is assigned to the texels that `host-sim/METRICS.md` defines.

use crate::common::{RngExt, grey, lit, off, seeded};
use core::f64::consts::{FRAC_PI_2, PI, TAU};
use glam::DVec3;
use hemilux_core::Order;
use hemilux_core::TooSmall;
use hemilux_core::healpix::{self, Domain};
use hemilux_core::polar::{Grid, LatLong, PolarTable, Share, shares_len};
use hemilux_core::pyramid::{Pyramid, Quad};

fn grid(width: usize, height: usize, domain: Domain) -> Grid {
    Grid { width, height, domain }
}

fn grids() -> [(Grid, u8); 6] {
    [
        (Grid::POLAR, 5),
        (grid(64, 32, Domain::Sphere), 4),
        (grid(37, 19, Domain::Sphere), 3),
        (grid(11, 5, Domain::Hemisphere), 3),
        (grid(1, 1, Domain::Hemisphere), 2),
        (grid(3, 200, Domain::Sphere), 3),
    ]
}

fn polar_plan(grid: &Grid, order: u8) -> PolarTable<Vec<Share>> {
    let shares = vec![Share::default(); shares_len(grid, Order::saturating(order))];
    PolarTable::try_new(grid, Order::saturating(order), shares).expect("room enough")
}

fn polar(map: &Pyramid<Vec<Quad>>, grid: Grid, table: &PolarTable<Vec<Share>>) -> LatLong<Vec<[f32; 3]>> {
    let mut polar = LatLong::try_new(grid, vec![[0.0; 3]; grid.len()]).expect("room enough");
    polar.fill(table, &map.view());
    polar
}

#[test]
fn resampling_keeps_the_energy() {
    let mut worst = 0.0f64;
    for (grid, order) in grids() {
        let mut rng = seeded(11);
        let map = lit(grid.domain, order, |_| [(); 3].map(|()| 10f32.powf(rng.random_range(-3.0..3.0))));
        let polar = polar(&map, grid, &polar_plan(&grid, order));
        for c in 0..3 {
            let expected: f64 = map.texels().iter().map(|q| f64::from(q.energy[c])).sum();
            let found: f64 = polar.view().texels.iter().map(|t| f64::from(t[c])).sum();
            worst = worst.max(off(found, expected));
            assert!(off(found, expected) < 1e-5, "{grid:?}: {found} {expected}");
        }
    }
    println!("worst energy {worst:.1e}");
}

#[test]
fn uniform_sky_stays_uniform() {
    for (grid, order, tolerance) in [
        (Grid::POLAR, 5, 0.10),
        (grid(64, 32, Domain::Sphere), 5, 0.04),
        (grid(37, 19, Domain::Sphere), 5, 0.02),
        (grid(24, 6, Domain::Hemisphere), 5, 0.02),
    ] {
        let omega = healpix::solid_angle(order);
        let map = lit(grid.domain, order, |i| grey((omega * grid.domain.share(order, i)) as f32));
        let polar = polar(&map, grid, &polar_plan(&grid, order));
        // The mean is over the sphere, since single texels beside the zenith are smaller than the sub-samples.
        let texels = polar.view().texels.iter().enumerate();
        let off = |(i, t): (usize, &[f32; 3])| (f64::from(t[0]) - grid.solid_angle(i / grid.width)).abs();
        let mean = texels.map(off).sum::<f64>() / grid.domain.solid_angle();
        println!("{grid:?}: {mean:.4}");
        assert!(mean < tolerance, "{grid:?}: {mean}");
    }
}

#[test]
fn lamp_is_resampled_to_the_texel_of_its_direction() {
    let order = 5;
    for grid in [Grid::POLAR, grid(64, 32, Domain::Sphere), grid(37, 19, Domain::Sphere)] {
        let table = polar_plan(&grid, order);
        let mut rng = seeded(12);
        for _ in 0..20 {
            let lamp = loop {
                let ipix = rng.random_range(0..grid.domain.quads(order) as u32);
                if grid.domain.share(order, ipix) == 1.0 {
                    break ipix;
                }
            };
            let map = lit(grid.domain, order, |i| grey(if i == lamp { 1.0 } else { 0.0 }));
            let polar = polar(&map, grid, &table);
            let mut mean = DVec3::ZERO;
            for (i, texel) in polar.view().texels.iter().enumerate() {
                // Row i is at theta (i + 1/2) span / H, column j at phi = pi - (j + 1/2) 2 pi / W.
                let span = if grid.domain == Domain::Sphere { PI } else { FRAC_PI_2 };
                let theta = ((i / grid.width) as f64 + 0.5) * span / grid.height as f64;
                let phi = PI - ((i % grid.width) as f64 + 0.5) * TAU / grid.width as f64;
                let d = DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
                mean += f64::from(texel[1]) * d;
            }
            let expected = healpix::centre(order, lamp);
            // The tolerance is half a texel of the coarser grid; there is no systematic shift.
            let half = 0.5 * (TAU / grid.width as f64 * expected.z.acos().sin() + grid.theta(1)) + 0.002;
            assert!(mean.normalize().distance(expected) < half, "{grid:?} {lamp}: {mean} {expected}");
        }
    }
}

#[test]
fn texel_lookup_works_across_the_seam_and_at_the_poles() {
    let grid = grid(360, 180, Domain::Sphere);
    assert_eq!(grid.texel(DVec3::Z).map(|i| i / 360), Some(0));
    assert_eq!(grid.texel(DVec3::NEG_Z).map(|i| i / 360), Some(179));
    let at = |phi: f64| grid.texel(DVec3::new(phi.cos(), phi.sin(), 0.0)).map(|i| i % 360);
    // Columns run clockwise from phi = pi, where the first and the last column meet; phi = 0 lies between columns 179 and 180.
    assert_eq!((at(PI - 0.001), at(-PI + 0.001)), (Some(0), Some(359)));
    assert_eq!((at(0.001), at(-0.001)), (Some(179), Some(180)));
    assert_eq!(at(FRAC_PI_2 - 0.001), Some(90));
    assert_eq!(Grid::POLAR.texel(DVec3::new(1.0, 0.0, -1e-9)), None);
    assert_eq!(Grid::POLAR.texel(DVec3::new(1.0, 0.0, 1e-9)).map(|i| i / 360), Some(89));
}

#[test]
fn solid_angles_of_a_grid_add_up() {
    for (grid, _) in grids() {
        let sum: f64 = (0..grid.height).map(|row| grid.width as f64 * grid.solid_angle(row)).sum();
        assert!(off(sum, grid.domain.solid_angle()) < 1e-12, "{grid:?}");
    }
}

#[test]
fn texel_lookup_inverts_every_texel_centre() {
    for (grid, _) in grids() {
        for i in 0..grid.len() {
            let theta = 0.5 * (grid.theta(i / grid.width) + grid.theta(i / grid.width + 1));
            let phi = 0.5 * (grid.phi(i % grid.width) + grid.phi(i % grid.width + 1));
            let d = DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
            assert_eq!(grid.texel(d), Some(i), "{grid:?}");
            assert!(grid.centre(i).distance(d) < 1e-12, "{grid:?} {i}");
        }
    }
}

#[test]
fn buffers_one_short_are_refused_and_an_empty_grid_is_accepted() {
    let small = grid(8, 4, Domain::Hemisphere);
    let needed = shares_len(&small, Order::saturating(2));
    assert!(PolarTable::try_new(&small, Order::saturating(2), vec![Share::default(); needed]).is_ok());
    let short =
        PolarTable::try_new(&small, Order::saturating(2), vec![Share::default(); needed - 1]).map(|_| ());
    assert_eq!(short, Err(TooSmall { needed, lent: needed - 1 }));
    let short = LatLong::try_new(small, vec![[0.0; 3]; 31]).map(|_| ());
    assert_eq!(short, Err(TooSmall { needed: 32, lent: 31 }));
    for empty in [grid(0, 0, Domain::Sphere), grid(0, 4, Domain::Hemisphere), grid(4, 0, Domain::Sphere)] {
        assert_eq!(empty.texel(DVec3::X), None);
        let map = lit(empty.domain, 2, |_| grey(1.0));
        assert!(polar(&map, empty, &polar_plan(&empty, 2)).view().texels.is_empty());
    }
}
