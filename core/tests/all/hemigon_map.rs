//! The map of `hemigon`: continuity, density, the closed form for a uniform sky, and the point sequence.

use crate::common::{Pcg64Mcg, RngExt, off, seeded};
use core::f64::consts::{FRAC_PI_4, TAU};
use glam::DVec3;
use hemilux_core::TooSmall;
use hemilux_core::color::luminance;
use hemilux_core::healpix::Domain;
use hemilux_core::polar::{Grid, LatLongView};
use hemilux_core::sampler::hemigon::inversion::{FLOOR, Inversion, Ring, rings_len};
use hemilux_core::sampler::hemigon::sequence;

const POLAR: Grid = Grid::POLAR;
const SPHERE: Grid = Grid { width: 64, height: 32, domain: Domain::Sphere };
const ODD_SPHERE: Grid = Grid { width: 9, height: 7, domain: Domain::Sphere };
const ODD: Grid = Grid { width: 7, height: 5, domain: Domain::Hemisphere };

/// A latitude-longitude map and its inversion.
struct Twin {
    inversion: Inversion<Vec<f32>, Vec<Ring>>,
    grid: Grid,
    texels: Vec<[f32; 3]>,
    energy: [f64; 2],
}

impl Twin {
    /// Creates the inversion of a map of radiance `l(row, column)`.
    fn new(grid: Grid, mut l: impl FnMut(usize, usize) -> f32) -> Self {
        let energy = |i: usize, l: f32| [l * grid.solid_angle(i / grid.width) as f32; 3];
        let texels: Vec<_> = (0..grid.len()).map(|i| energy(i, l(i / grid.width, i % grid.width))).collect();
        let (texel, ring) = (vec![0.0; grid.len()], vec![Ring::default(); rings_len(&grid)]);
        let mut inversion = Inversion::try_new(&grid, texel, ring).expect("room enough");
        let energy = inversion.build(&LatLongView { grid, texels: &texels });
        Self { inversion, grid, texels, energy }
    }

    fn view(&self) -> LatLongView<'_> {
        LatLongView { grid: self.grid, texels: &self.texels }
    }

    fn at(&self, lower: bool, square: [f64; 2]) -> DVec3 {
        self.inversion.place(&self.view(), lower, square).expect("a lit map").direction
    }
}

/// Returns a random radiance with a log-uniform distribution over four decades.
fn rough(rng: &mut Pcg64Mcg) -> f32 {
    10f32.powf(rng.random_range(-2.0..2.0))
}

#[test]
fn a_uniform_sky_gives_the_equal_area_concentric_map() {
    // The concentric map of Shirley and Chiu 1997: the four triangles of the square, then z = 1 - r^2.
    let concentric = |u: f64, v: f64| {
        let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
        let (r, psi) = match (a > -b, a > b) {
            (true, true) => (a, FRAC_PI_4 * b / a),
            (true, false) => (b, FRAC_PI_4 * (2.0 - a / b)),
            (false, false) => (-a, FRAC_PI_4 * (4.0 + b / a)),
            (false, true) => (-b, FRAC_PI_4 * (6.0 - a / b)),
        };
        let (z, sin) = (1.0 - r * r, (1.0 - (1.0 - r * r).powi(2)).sqrt());
        DVec3::new(sin * psi.cos(), sin * psi.sin(), z)
    };
    let mut rng = seeded(61);
    for grid in [POLAR, SPHERE] {
        let sky = Twin::new(grid, |_, _| 2.0);
        assert!(off(sky.energy[0], 2.0 * TAU) < 1e-6, "{:?}", sky.energy);
        for _ in 0..20_000 {
            let [u, v]: [f64; 2] = [rng.random(), rng.random()];
            // The conditional distribution is stored in f32.
            let far = sky.at(false, [u, v]).distance(concentric(u, v));
            assert!(far < 1e-5, "{u} {v}: {far}");
            if grid.domain == Domain::Sphere {
                let below = sky.at(true, [u, v]) * DVec3::new(1.0, 1.0, -1.0);
                assert!(below.distance(concentric(u, v)) < 1e-5, "{u} {v}");
            }
        }
    }
}

#[test]
fn small_steps_in_the_square_are_small_steps_on_the_hemisphere() {
    let mut rng = seeded(62);
    // Random points, and points near both diagonals, near the ray psi = 0 and near the centre.
    let starts: [fn(f64, f64) -> [f64; 2]; 5] = [
        |a, b| [a, b],
        |a, _| [a, a],
        |a, _| [a, 1.0 - a],
        |a, _| [0.5 + a / 2.0, 0.5],
        |a, b| [0.5 + 1e-3 * (a - 0.5), 0.5 + 1e-3 * (b - 0.5)],
    ];
    for grid in [POLAR, SPHERE, ODD_SPHERE, ODD] {
        let map = Twin::new(grid, |_, _| rough(&mut rng));
        for (kind, start) in starts.iter().enumerate() {
            let mut largest = [0.0f64; 3];
            for _ in 0..4000 {
                let from = start(rng.random(), rng.random());
                let turn: f64 = rng.random_range(0.0..TAU);
                for (jump, h) in largest.iter_mut().zip([1e-6, 1e-8, 1e-10]) {
                    let to = [from[0] + h * turn.cos(), from[1] + h * turn.sin()].map(|x| x.clamp(0.0, 1.0));
                    *jump = jump.max(map.at(false, from).distance(map.at(false, to)) / h);
                }
            }
            println!("{}x{} {kind}: {largest:?}", grid.width, grid.height);
            // The slope is bounded for every step: a jump of 1e-4 would be a slope of a million at the smallest step.
            assert!(largest.iter().all(|slope| *slope < 1e5), "{grid:?} {kind}: {largest:?}");
            assert!(largest[2] < 1.1 * largest[1], "{grid:?} {kind}: {largest:?}");
        }
    }
}

#[test]
fn both_ends_of_a_turn_map_to_one_meridian() {
    let mut rng = seeded(63);
    for grid in [POLAR, ODD, ODD_SPHERE] {
        let map = Twin::new(grid, |_, _| rough(&mut rng));
        for i in 1..200 {
            let u = 0.5 + f64::from(i) / 400.0;
            let [on, below] = [0.5, 0.5 - 1e-12].map(|v| map.at(false, [u, v]));
            assert!(on.distance(below) < 1e-7, "{on} {below}");
            // Phi is 0, or half a column.
            let seam = if grid.width % 2 == 0 { 0.0 } else { TAU / grid.width as f64 / 2.0 };
            assert!((on.y.atan2(on.x) - seam).abs() < 1e-9, "{on}");
        }
    }
}

#[test]
fn map_is_injective_and_monotone() {
    // Along a circle of the square, the images turn strictly counter-clockwise; outwards, their z decreases strictly.
    let mut rng = seeded(64);
    let map = Twin::new(POLAR, |row, column| if (row + column) % 5 == 0 { 1000.0 } else { 0.001 });
    for _ in 0..200 {
        let r: f64 = rng.random_range(0.05..0.5);
        let mut last = -1.0;
        for i in 0..4000 {
            let at = f64::from(i) / 1000.0;
            let (side, along) = (i / 1000, 2.0 * at.fract() - 1.0);
            let (a, b) = [(1.0, along), (-along, 1.0), (-1.0, -along), (along, -1.0)][side as usize];
            let d = map.at(false, [0.5 + r * a, 0.5 + r * b]);
            // From the corner at an eighth of a turn on, phi exceeds that of the first point.
            let first = map.at(false, [0.5 + r, 0.5 - r]);
            let phi = (d.y.atan2(d.x) - first.y.atan2(first.x) + TAU + 1e-9) % TAU;
            assert!(phi > last, "{r} {i}: {phi} after {last}");
            last = phi;
        }
    }
    let mut z = 2.0;
    for i in 0..5000 {
        let d = map.at(false, [0.5 + f64::from(i) / 10_000.0, 0.5]);
        assert!(d.z < z, "{i}");
        z = d.z;
    }
}

/// Returns the fraction of a hemisphere's light that the map assigns to each texel: the interpolated rings integrated in 2,000 steps.
fn expected(map: &Twin) -> Vec<f64> {
    let grid = map.grid;
    let y = |k: usize, j: usize| f64::from(luminance(map.texels[k * grid.width + j])) / grid.solid_angle(k);
    let mean = map.energy[0] / TAU;
    let floored = |k, j| (1.0 - FLOOR) * y(k, j) + FLOOR * mean;
    let row = |k: usize| (0..grid.width).map(|j| floored(k, j)).sum::<f64>();
    let marginal = |k: usize| row(k) * grid.solid_angle(k) / map.energy[0];
    let mut parts = vec![0.0; grid.len()];
    for k in 0..grid.height {
        let (top, bottom) = (grid.theta(k).cos(), grid.theta(k + 1).cos());
        for step in 0..2000 {
            let z: f64 = top + (f64::from(step) + 0.5) / 2000.0 * (bottom - top);
            let g = (z.acos() / grid.theta(1) - 0.5).clamp(0.0, (grid.height - 1) as f64);
            let (a, t) = (g as usize, g.fract());
            let b = (a + 1).min(grid.height - 1);
            let whole = (1.0 - t) * row(a) + t * row(b);
            for j in 0..grid.width {
                let conditional = ((1.0 - t) * floored(a, j) + t * floored(b, j)) / whole;
                parts[k * grid.width + j] += marginal(k) * conditional / 2000.0;
            }
        }
    }
    parts
}

#[test]
fn a_large_sample_follows_the_density() {
    let mut rng = seeded(65);
    let grids = [ODD, Grid { width: 24, height: 10, domain: Domain::Hemisphere }];
    for grid in grids {
        for kind in 0..4 {
            let map = Twin::new(grid, |row, column| match kind {
                0 => 1.0,
                1 => 1.0 + column as f32,
                2 => 1.0 + row as f32,
                _ => rough(&mut rng),
            });
            let parts = expected(&map);
            let count = 200_000;
            let mut found = vec![0.0; grid.len()];
            for _ in 0..count {
                let d = map.at(false, [rng.random(), rng.random()]);
                found[grid.texel(d).expect("inside the domain")] += 1.0;
            }
            let (mut statistic, mut bins) = (0.0, 0);
            for (part, found) in parts.iter().zip(&found) {
                let expected = part * f64::from(count);
                if expected >= 20.0 {
                    statistic += (found - expected).powi(2) / expected;
                    bins += 1;
                }
            }
            println!("{}x{} {kind}: {statistic:.1} over {bins}", grid.width, grid.height);
            assert!(statistic <= f64::from(bins) + 4.0 * (2.0 * f64::from(bins)).sqrt(), "{kind}");
            let off = parts.iter().zip(&found).map(|(p, f)| (p - f / f64::from(count)).abs()).sum::<f64>();
            assert!(off < 0.03, "{kind}: {off} of the light is elsewhere");
        }
    }
}

#[test]
fn the_density_is_that_of_the_map() {
    // The mean of 1 / pdf over the square is the solid angle of the hemisphere.
    let mut rng = seeded(66);
    for grid in [SPHERE, ODD_SPHERE, ODD, Grid { width: 1, height: 1, domain: Domain::Sphere }] {
        let map = Twin::new(grid, |_, _| rng.random_range(0.5..2.0));
        for lower in [false, true] {
            if map.energy[usize::from(lower)] == 0.0 {
                continue;
            }
            let sum: f64 = (0..400 * 400)
                .map(|i| [i % 400, i / 400].map(|k| (f64::from(k) + 0.5) / 400.0))
                .map(|square| map.inversion.place(&map.view(), lower, square).expect("lit").pdf_sa.recip())
                .sum();
            assert!(off(sum / 160_000.0, TAU) < 2e-3, "{grid:?} {lower}: {}", sum / 160_000.0);
        }
    }
}

#[test]
fn no_point_maps_to_a_dark_texel() {
    let mut rng = seeded(67);
    for grid in [POLAR, SPHERE, ODD_SPHERE, ODD] {
        let map = Twin::new(grid, |_, _| if rng.random::<f64>() < 0.02 { rough(&mut rng) } else { 0.0 });
        let lit = |texel: usize| luminance(map.texels[texel]) > 0.0;
        for lower in [false, true].into_iter().filter(|l| map.energy[usize::from(*l)] > 0.0) {
            for i in 0..5000 {
                let place = map.inversion.place(&map.view(), lower, sequence::point(lower, i)).expect("lit");
                assert!(lit(place.texel) && place.pdf_sa > 0.0, "{place:?}");
                assert!((place.direction.length() - 1.0).abs() < 1e-12);
                assert!(if lower { place.direction.z <= 0.0 } else { place.direction.z >= 0.0 });
            }
        }
    }
}

#[test]
fn sequence_points_are_halton_points_of_the_disk() {
    // In base 3: 1/3, 2/3, 1/9; in base 2: 1/2, 1/4, 3/4. On the axes of the square |2u - 1| = r = sqrt(q).
    let r = [1.0f64 / 3.0, 2.0 / 3.0, 1.0 / 9.0].map(f64::sqrt);
    let upper = [[-r[0], 0.0], [0.0, r[1]], [0.0, -r[2]]];
    for (i, [a, b]) in upper.into_iter().enumerate() {
        for (lower, sign) in [(false, 1.0), (true, -1.0)] {
            let [u, v] = sequence::point(lower, i as u32);
            assert!(
                (u - 0.5 - sign * a / 2.0).abs() < 1e-15 && (v - 0.5 - sign * b / 2.0).abs() < 1e-15,
                "{i}"
            );
        }
    }
    // For a uniform sky the images are Halton points in z and phi.
    let sky = Twin::new(POLAR, |_, _| 1.0);
    for i in 0..8192u32 {
        let [u, v] = sequence::point(false, i);
        assert!((0.0..=1.0).contains(&u) && (0.0..=1.0).contains(&v));
        let d = sky.at(false, [u, v]);
        let (mut q, mut turn, mut digits) = (0.0, 0.0, [(i + 1, 1.0 / 3.0), (i + 1, 0.5)]);
        while digits[0].0 + digits[1].0 > 0 {
            q += f64::from(digits[0].0 % 3) * digits[0].1;
            turn += f64::from(digits[1].0 % 2) * digits[1].1;
            digits = [(digits[0].0 / 3, digits[0].1 / 3.0), (digits[1].0 / 2, digits[1].1 / 2.0)];
        }
        let sin = (1.0 - (1.0 - q) * (1.0 - q)).sqrt();
        let expected = DVec3::new(sin * (turn * TAU).cos(), sin * (turn * TAU).sin(), 1.0 - q);
        assert!(d.distance(expected) < 1e-5, "{i}: {d} {expected}");
    }
}

#[test]
fn maps_that_exceed_the_buffers_count_as_dark() {
    let mut inversion =
        Inversion::try_new(&ODD, vec![0.0; 35], vec![Ring::default(); 5]).expect("room enough");
    let texels = vec![[1.0; 3]; SPHERE.len()];
    for (grid, texels) in [(SPHERE, &texels[..]), (ODD, &texels[..34]), (POLAR, &[])] {
        assert_eq!(inversion.build(&LatLongView { grid, texels }), [0.0; 2]);
        assert_eq!(inversion.place(&LatLongView { grid, texels }, false, [0.3, 0.4]), None);
    }
    let short = |texels, rings| {
        Inversion::try_new(&ODD_SPHERE, vec![0.0; texels], vec![Ring::default(); rings]).map(|_| ())
    };
    assert_eq!(short(62, 8), Err(TooSmall { needed: 63, lent: 62 }));
    assert_eq!(short(63, 7), Err(TooSmall { needed: 8, lent: 7 }));
    assert_eq!(short(63, 8), Ok(()));
}
