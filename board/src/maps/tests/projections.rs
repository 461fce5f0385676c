//! Tests of the directions, solid angles and flux of maps in each projection.

use super::*;

/// Returns the flux of a map over the sphere, and the sum of its directions weighted by flux.
fn flux(map: &DecodedMap) -> (f64, [f64; 3]) {
    let edge = |i: usize| (i as f64 * PI / map.height as f64).cos();
    let (mut sum, mut moment) = (0.0, [0.0; 3]);
    for (k, texel) in map.texels.iter().enumerate() {
        let (row, column) = (k / map.width, k % map.width);
        let e = f64::from(texel[0]) * (edge(row) - edge(row + 1)) * 2.0 * PI / map.width as f64;
        let theta = (row as f64 + 0.5) * PI / map.height as f64;
        let phi = PI - (column as f64 + 0.5) * 2.0 * PI / map.width as f64;
        let d = [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()];
        moment.iter_mut().zip(d).for_each(|(m, v)| *m += e * v);
        sum += e;
    }
    (sum, moment.map(|m| m / sum))
}

fn projected(bytes: &[u8], projection: Projection) -> DecodedMap {
    decode_with(bytes, &ReadOptions { projection: Some(projection), ..ReadOptions::default() })
        .expect("a map")
}

#[test]
fn uniform_maps_of_every_projection_have_the_flux_of_the_sphere() {
    for (projection, size) in [
        (Projection::Angular, (64, 64)),
        (Projection::MirrorBall, (64, 64)),
        (Projection::Cube, (48, 64)),
        (Projection::Cube, (64, 48)),
        (Projection::Cube, (16, 96)),
    ] {
        let (sum, moment) = flux(&projected(&painted(size, |_, _| 1.0), projection));
        assert!((sum / (4.0 * PI) - 1.0).abs() < 0.005, "{projection:?} {size:?}: {sum}");
        assert!(moment.iter().all(|m| m.abs() < 0.01), "{projection:?} {size:?}: {moment:?}");
    }
    let square = painted((64, 32), |_, _| 1.0);
    let options = ReadOptions { projection: Some(Projection::Angular), ..ReadOptions::default() };
    assert!(decode_with(&square, &options).expect_err("refused").expected.contains("square"), "2:1");
}

#[test]
fn texels_of_cube_maps_have_the_solid_angles_of_their_definitions() {
    // The solid angle of a square of half side h on a face of half side 1 is 4 asin(h^2 / (1 + h^2)).
    let square = |h: f64| 4.0 * (h * h / (1.0 + h * h)).asin();
    let middle = |place: (usize, usize)| move |x: usize, y: usize| f32::from(u8::from((x, y) == place));
    // OpenEXR: of five texels in a row the first and the last are centred on the edges.
    let (strip, _) = flux(&projected(&painted((5, 30), middle((2, 2))), Projection::Cube));
    assert!((strip / square(1.0 / 4.0) - 1.0).abs() < 1e-6, "{strip}");
    let (cross, _) = flux(&projected(&painted((15, 20), middle((7, 7))), Projection::Cube));
    assert!((cross / square(1.0 / 5.0) - 1.0).abs() < 1e-6, "{cross}");
}

#[test]
fn projections_place_lamps_by_their_definitions() {
    // The lamp is 45 degrees to the left of forward; the texel with the lamp follows by hand from the definition of each projection.
    let left = [0.5f64.sqrt(), 0.5f64.sqrt(), 0.0];
    let up = [0.0, 0.0, 1.0];
    let lamp = |at: (usize, usize)| move |x: usize, y: usize| f32::from(u8::from((x, y) == at)) * 100.0;
    let cases = [
        // Angular map: radius 45 / 180 of 64 texels left of the centre; the zenith at radius 1/2.
        (Projection::Angular, (128, 128), (47, 63), left),
        (Projection::Angular, (128, 128), (63, 32), up),
        // Mirror ball: radius sin(22.5 degrees) of 64 texels, on the right as reflections are; the zenith at sin(45 degrees).
        (Projection::MirrorBall, (128, 128), (88, 63), left),
        (Projection::MirrorBall, (128, 128), (63, 18), up),
        // Crosses: the edge between the left and the front face; the middle of the top face for the zenith.
        (Projection::Cube, (96, 128), (32, 47), left),
        (Projection::Cube, (128, 96), (32, 47), left),
        (Projection::Cube, (96, 128), (47, 15), up),
        // OpenEXR: face +X is 90 degrees to the left, and its right edge touches +Z.
        (Projection::Cube, (32, 192), (31, 15), left),
        (Projection::Cube, (32, 192), (15, 79), up),
    ];
    for (projection, size, at, expected) in cases {
        let (_, moment) = flux(&projected(&painted(size, lamp(at)), projection));
        let cosine: f64 = moment.iter().zip(expected).map(|(a, b)| a * b).sum();
        assert!(
            cosine > 4f64.to_radians().cos(),
            "{projection:?} {size:?}: {moment:?}, expected {expected:?}"
        );
    }
    // The back face of a vertical cross is upside down: its lower edge touches the top face, at 45 degrees above the horizon behind.
    let (_, moment) = flux(&projected(&painted((96, 128), lamp((47, 127))), Projection::Cube));
    assert!(moment[0] < -0.68 && moment[2] > 0.68, "{moment:?}");
    let (_, moment) = flux(&projected(&painted((96, 128), lamp((32, 111))), Projection::Cube));
    assert!(
        moment[0] < -0.68 && moment[1] > 0.68,
        "the back face's left edge touches the left face: {moment:?}"
    );
}

#[test]
fn openexr_cube_maps_are_converted_as_stated() {
    let attributes = LayerAttributes {
        environment_map: Some(attribute::EnvironmentMap::Cube),
        ..LayerAttributes::default()
    };
    let map = decode(&written(&uniform(&RGB, (8, 48), attributes))).expect("a map");
    assert_eq!((map.width, map.height), (32, 16), "a latitude-longitude map");
    assert!((flux(&map).0 / (12.0 * PI) - 1.0).abs() < 0.005, "flux");
}
