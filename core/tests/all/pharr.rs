//! The sampler `pharr` against the distribution of its map.

use crate::common::{RngExt, dark, off, seeded};
use core::f64::consts::{PI, TAU};
use glam::DVec3;
use hemilux_core::TooSmall;
use hemilux_core::color::luminance;
use hemilux_core::healpix::Domain;
use hemilux_core::light::Light;
use hemilux_core::polar::{Grid, LatLongView};
use hemilux_core::sampler::pharr::{Memory, Pharr};
use hemilux_core::sampler::{Map, Request, Sampler, halton};

const POLAR: Grid = Grid::POLAR;
const SPHERE: Grid = Grid { width: 64, height: 32, domain: Domain::Sphere };
const ODD: Grid = Grid { width: 7, height: 5, domain: Domain::Hemisphere };

fn memory(texels: usize, rows: usize, lights: usize) -> Memory<Vec<f32>, Vec<f64>, Vec<Light>> {
    Memory {
        conditional: vec![0.0; texels],
        marginal: vec![0.0; rows],
        lights: vec![Light::default(); lights],
    }
}

fn sampler(grid: &Grid, lights: usize) -> Pharr<Vec<f32>, Vec<f64>, Vec<Light>> {
    Pharr::try_new(grid, memory(grid.len(), grid.height, lights)).expect("room enough")
}

fn decompose(grid: Grid, texels: &[[f32; 3]], lights: usize) -> Vec<Light> {
    let pyramid = dark(Domain::Sphere, 0);
    let map = Map { pyramid: pyramid.view(), polar: LatLongView { grid, texels } };
    sampler(&grid, lights).update(&map, &Request::of_lights(lights)).lights.to_vec()
}

/// Returns a map whose texels have the radiance `l(row, column)`.
fn energies(grid: Grid, mut l: impl FnMut(usize, usize) -> [f32; 3]) -> Vec<[f32; 3]> {
    (0..grid.len())
        .map(|i| l(i / grid.width, i % grid.width).map(|v| v * grid.solid_angle(i / grid.width) as f32))
        .collect()
}

#[test]
fn halton_points_are_radical_inverses() {
    // 1 = 1_2 = 1_3, 2 = 10_2 = 2_3, 3 = 11_2 = 10_3, 6 = 110_2 = 20_3, 11 = 1011_2 = 102_3.
    let expected = [
        (0, [0.0, 0.0]),
        (1, [1.0 / 2.0, 1.0 / 3.0]),
        (2, [1.0 / 4.0, 2.0 / 3.0]),
        (3, [3.0 / 4.0, 1.0 / 9.0]),
        (6, [3.0 / 8.0, 2.0 / 9.0]),
        (11, [13.0 / 16.0, 19.0 / 27.0]),
    ];
    for (index, [u, v]) in expected {
        let p = halton::point(index);
        assert!((p[0] - u).abs() < 1e-15 && (p[1] - v).abs() < 1e-15, "{index}: {p:?}");
        assert!((halton::radical_inverse(index, 2) - u).abs() < 1e-15, "{index}");
    }
    for index in [u32::MAX, 1 << 31, 1_000_000_007] {
        assert!(halton::point(index).iter().all(|v| (0.0..1.0).contains(v)), "{index}");
    }
}

/// Returns Pearson's statistic of the lights over bins of at least 20 expected lights, and the number of bins.
fn chi_square(grid: Grid, texels: &[[f32; 3]], lights: &[Light]) -> (f64, usize) {
    let total: f64 = texels.iter().map(|t| f64::from(luminance(*t))).sum();
    let mut found = vec![0.0; grid.len()];
    for light in lights {
        found[grid.texel(light.direction.as_dvec3()).expect("inside the domain")] += 1.0;
    }
    let (mut statistic, mut bins, mut bin) = (0.0, 0, (0.0, 0.0f64));
    for (texel, found) in texels.iter().zip(found) {
        bin.0 += f64::from(luminance(*texel)) / total * lights.len() as f64;
        bin.1 += found;
        if bin.0 >= 20.0 {
            statistic += (bin.1 - bin.0).powi(2) / bin.0;
            (bins, bin) = (bins + 1, (0.0, 0.0));
        }
    }
    (statistic, bins)
}

#[test]
fn lights_follow_the_distribution_of_the_map() {
    for grid in [POLAR, SPHERE, ODD] {
        let mut rng = seeded(21);
        let maps = [
            energies(grid, |_, _| [1.0; 3]),
            energies(grid, |_, column| [column as f32; 3]),
            energies(grid, |row, _| [row as f32, 0.5, 1.0]),
            energies(grid, |_, _| [(); 3].map(|()| 10f32.powf(rng.random_range(-2.0..2.0)))),
        ];
        for (i, texels) in maps.iter().enumerate() {
            let lights = decompose(grid, texels, 20_000);
            assert_eq!(lights.len(), 20_000);
            let (statistic, bins) = chi_square(grid, texels, &lights);
            println!("{}x{} map {i}: {statistic:.1} over {bins} bins", grid.width, grid.height);
            // Halton points fit better than random points, so mean + 3 sigma of random points is an upper bound.
            assert!(
                statistic < bins as f64 + 3.0 * (2.0 * bins as f64).sqrt(),
                "map {i}: {statistic} {bins}"
            );
        }
    }
}

#[test]
fn all_lights_of_a_single_lit_texel_are_inside_it() {
    for grid in [POLAR, SPHERE, ODD] {
        for bright in [0, 5, grid.width - 1, grid.len() / 2, grid.len() - 1] {
            let mut texels = vec![[0.0; 3]; grid.len()];
            texels[bright] = [1.0, 2.0, 3.0];
            let lights = decompose(grid, &texels, 300);
            // Rounding moves points across the edge of a texel, so points are compared with a tolerance of a millionth.
            let theta = grid.theta(bright / grid.width)..=grid.theta(bright / grid.width + 1);
            for light in &lights {
                let d = light.direction.as_dvec3();
                let row = d.x.hypot(d.y).atan2(d.z);
                assert!(row > theta.start() - 1e-6 && row < theta.end() + 1e-6, "{grid:?} {bright}");
                let column = (PI - d.y.atan2(d.x)) / TAU * grid.width as f64;
                let from = (bright % grid.width) as f64;
                let near = |c: f64| c > from - 1e-3 && c < from + 1.001;
                assert!(near(column) || near(column + grid.width as f64), "{grid:?} {bright}: {column}");
            }
            let blue: f64 = lights.iter().map(|l| f64::from(l.irradiance[2])).sum();
            assert!(off(blue, 3.0) < 1e-6, "{blue}");
        }
    }
}

#[test]
fn lights_are_equally_luminous_and_keep_the_energy() {
    for grid in [POLAR, SPHERE, ODD] {
        let mut rng = seeded(22);
        let texels = energies(grid, |_, _| [(); 3].map(|()| 10f32.powf(rng.random_range(-3.0..3.0))));
        let total: f64 = texels.iter().map(|t| f64::from(luminance(*t))).sum();
        for n in [1, 2, 7, 64, 1000] {
            let lights = decompose(grid, &texels, n);
            let y: Vec<f64> = lights.iter().map(|l| f64::from(luminance(l.irradiance))).collect();
            assert!(off(y.iter().sum(), total) < 1e-6, "{n}");
            assert!(y.iter().all(|y| off(*y, total / n as f64) < 1e-6), "{n}");
            assert!(lights.iter().all(|l| (l.direction.length() - 1.0).abs() < 1e-6));
            assert!(lights.iter().all(|l| l.radius_deg > 0.0 && l.radius_deg <= 180.0));
        }
    }
}

#[test]
fn light_directions_invert_the_halton_points_from_phi_zero() {
    // In a constant map u is the share of the domain's solid angle above the light, and v the share of the turn from phi = 0, clockwise
    // seen from above as the map's columns.
    for (grid, bottom) in [(POLAR, 0.0), (SPHERE, -1.0)] {
        for (i, light) in decompose(grid, &energies(grid, |_, _| [1.0; 3]), 500).iter().enumerate() {
            let [u, v] = halton::point(i as u32 + 1);
            let z = 1.0 + u * (bottom - 1.0);
            let (sin, phi) = ((1.0 - z * z).sqrt(), -v * TAU);
            let expected = DVec3::new(sin * phi.cos(), sin * phi.sin(), z);
            // The conditional distribution is summed in f32, and theta within a row is linear in the solid angle.
            assert!(
                light.direction.as_dvec3().distance(expected) < 1e-4,
                "{i}: {} {expected}",
                light.direction
            );
        }
    }
}

#[test]
fn smallest_second_coordinates_fall_in_the_first_column_after_phi_zero() {
    // All light is in the two columns on either side of phi = 0: small v fall in the column after it in the map's order, large v in the other.
    for width in [64, 7] {
        let grid = Grid { width, height: 4, domain: Domain::Hemisphere };
        let (after, before) = if width == 64 { (32, 31) } else { (3, 2) };
        let lights = decompose(grid, &energies(grid, |_, c| [f32::from(c == after || c == before); 3]), 100);
        for (i, light) in lights.iter().enumerate() {
            let column = grid.texel(light.direction.as_dvec3()).expect("inside") % width;
            let expected = if halton::point(i as u32 + 1)[1] < 0.5 { after } else { before };
            assert_eq!(column, expected, "width {width}, light {i}");
        }
    }
}

#[test]
fn ages_increase_and_reset_restarts_them() {
    let texels = energies(ODD, |_, _| [1.0; 3]);
    let pyramid = dark(Domain::Sphere, 0);
    let map = Map { pyramid: pyramid.view(), polar: LatLongView { grid: ODD, texels: &texels } };
    let mut pharr = sampler(&ODD, 8);
    let mut ages = |lights| {
        pharr.update(&map, &Request::of_lights(lights)).lights.iter().map(|l| l.age).collect::<Vec<_>>()
    };
    assert_eq!(ages(3), [0, 0, 0]);
    assert_eq!(ages(4), [1, 1, 1, 0]);
    assert_eq!(ages(2), [2, 2]);
    assert_eq!(ages(99), [3, 3, 0, 0, 0, 0, 0, 0]);
    pharr.reset();
    assert_eq!(pharr.update(&map, &Request::of_lights(1)).lights[0].age, 0);
}

#[test]
fn maps_without_light_or_texels_give_no_lights() {
    assert_eq!(decompose(POLAR, &vec![[0.0; 3]; POLAR.len()], 64), []);
    let pyramid = dark(Domain::Sphere, 0);
    let none = Map { pyramid: pyramid.view(), polar: LatLongView::NONE };
    assert_eq!(sampler(&POLAR, 4).update(&none, &Request::of_lights(4)).lights, []);
    // More texels than the buffers hold, and a view with fewer texels than its grid.
    let texels = energies(SPHERE, |_, _| [1.0; 3]);
    for (grid, texels) in [(SPHERE, &texels[..]), (ODD, &texels[..20]), (ODD, &texels[..64])] {
        let map = Map { pyramid: pyramid.view(), polar: LatLongView { grid, texels } };
        assert_eq!(sampler(&ODD, 4).update(&map, &Request::of_lights(4)).lights, []);
    }
    assert_eq!(decompose(ODD, &energies(ODD, |_, _| [1.0; 3]), 0), []);
}

#[test]
fn a_map_of_one_texel_gives_lights() {
    for domain in [Domain::Sphere, Domain::Hemisphere] {
        let grid = Grid { width: 1, height: 1, domain };
        let lights = decompose(grid, &[[3.0, 2.0, 1.0]], 50);
        assert_eq!(lights.len(), 50);
        let red: f64 = lights.iter().map(|l| f64::from(l.irradiance[0])).sum();
        assert!(off(red, 3.0) < 1e-6);
        assert!(lights.iter().all(|l| domain == Domain::Sphere || l.direction.z > 0.0));
    }
}

#[test]
fn buffers_one_short_are_refused() {
    let short = Pharr::try_new(&ODD, memory(34, ODD.height, 1)).map(|_| ());
    assert_eq!(short, Err(TooSmall { needed: 35, lent: 34 }));
    let low = Pharr::try_new(&ODD, memory(35, ODD.height - 1, 1)).map(|_| ());
    assert_eq!(low, Err(TooSmall { needed: ODD.height, lent: ODD.height - 1 }));
}
