//! Coordinate systems of other programs: directions as stated in `board/FORMATS.md`, harmonics by evaluation of the basis at converted directions.

use crate::common::{direction, seeded};
use glam::{DVec3, Vec3};
use hemilux_core::light::Sh9;
use hemilux_core::wire::Coordinates;

const ALL: [Coordinates; 4] = [Coordinates::Probe, Coordinates::YUp, Coordinates::Unity, Coordinates::Unreal];

/// Returns the real orthonormal basis of spherical harmonics at `d`, without Condon-Shortley phase, from its textbook form.
fn basis(d: DVec3) -> [f64; 9] {
    let (x, y, z) = (d.x, d.y, d.z);
    let pi = core::f64::consts::PI;
    let (a, b) = ((3.0 / (4.0 * pi)).sqrt(), (15.0 / (4.0 * pi)).sqrt());
    [
        (1.0 / (4.0 * pi)).sqrt(),
        a * y,
        a * z,
        a * x,
        b * x * y,
        b * y * z,
        (5.0 / (16.0 * pi)).sqrt() * (3.0 * z * z - 1.0),
        b * x * z,
        0.5 * b * (x * x - y * y),
    ]
}

/// Converts a direction from the probe's axes to the coordinates `c`, as stated in `board/FORMATS.md`.
fn turned(c: Coordinates, d: DVec3) -> DVec3 {
    match c {
        Coordinates::Probe => d,
        Coordinates::YUp => DVec3::new(d.x, d.z, -d.y),
        Coordinates::Unity => DVec3::new(d.x, d.z, d.y),
        Coordinates::Unreal => DVec3::new(d.x, -d.y, d.z),
        other => panic!("no twin of {other:?}"),
    }
}

#[test]
fn the_basis_has_the_published_test_vector() {
    let expected =
        [0.282095, 0.261169, 0.391754, 0.130585, 0.156078, 0.468235, 0.292864, 0.234117, -0.117059];
    for (found, expected) in basis(DVec3::new(1.0, 2.0, 3.0).normalize()).iter().zip(expected) {
        assert!((found - expected).abs() < 1e-6, "{found} {expected}");
    }
}

#[test]
fn directions_are_converted_as_documented() {
    for c in ALL {
        let found = c.direction(Vec3::new(1.0, 2.0, 3.0));
        assert_eq!(found.as_dvec3(), turned(c, DVec3::new(1.0, 2.0, 3.0)), "{c:?}");
    }
}

#[test]
fn converting_lights_and_converting_harmonics_commute() {
    let mut rng = seeded(51);
    for c in ALL {
        for _ in 0..200 {
            let d = direction(&mut rng);
            let sh: Sh9 = basis(d).map(|v| [v as f32, 2.0 * v as f32, 0.0]);
            let expected = basis(turned(c, d));
            for (i, (found, expected)) in c.harmonics(&sh).iter().zip(expected).enumerate() {
                assert!((f64::from(found[0]) - expected).abs() < 1e-6, "{c:?} row {i}: {found:?} {expected}");
                assert!((f64::from(found[1]) - 2.0 * expected).abs() < 2e-6, "{c:?} row {i}");
                assert_eq!(found[2], 0.0);
            }
        }
    }
}

#[test]
fn names_and_aliases_are_those_of_the_format() {
    let expected: [(_, &[&str]); 4] = [
        (Coordinates::Probe, &["probe", "blender", "ros"]),
        (Coordinates::YUp, &["y-up", "gltf", "three", "webxr"]),
        (Coordinates::Unity, &["unity"]),
        (Coordinates::Unreal, &["unreal"]),
    ];
    for (c, names) in expected {
        for name in names {
            assert_eq!(Coordinates::from_name(name), Some(c), "{name}");
            assert!(Coordinates::names().any(|n| n == *name), "{name}");
        }
    }
    assert_eq!(Coordinates::names().count(), expected.iter().map(|(_, names)| names.len()).sum::<usize>());
    for c in ALL {
        assert_eq!(Coordinates::from_name(c.name()), Some(c), "requests accept the name of light sets");
    }
    for name in ["", "Probe", "yup", "y-up "] {
        assert_eq!(Coordinates::from_name(name), None, "{name}");
    }
}
