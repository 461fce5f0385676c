//! The binary light set: fields at the offsets of its documentation, and corrupted bytes.

use crate::common::{RngExt, direction, light_set, seeded};
use glam::Vec3;
use hemilux_core::light::{Light, Sh9};
use hemilux_core::wire::{self, BinarySet, Coordinates, DecodeError, LightSet, Stale};

fn lights() -> Vec<Light> {
    let mut rng = seeded(7);
    let light = |i: u32| Light {
        id: 100 + i,
        direction: direction(&mut rng).as_vec3(),
        irradiance: [1.5 * i as f32, 0.25, 1e-20],
        radius_deg: 2.5,
        age: 7 * i,
        parent: (i % 2 == 1).then_some(i),
    };
    (0..5).map(light).collect()
}

fn set<'a>(lights: &'a [Light], ambient: Option<&'a Sh9>) -> LightSet<'a> {
    LightSet {
        stale: Some(Stale { age_ms: 1 << 40, reason: "unplugged: é" }),
        coordinates: Coordinates::Unity,
        timestamp_ns: 11,
        horizontal_irradiance: [4.0, 5.0, 6.0],
        clipped: 0.25,
        unseen: 0.5,
        ..light_set(lights, ambient)
    }
}

fn encode(set: &LightSet<'_>) -> Vec<u8> {
    let mut bytes = vec![0; 1 << 12];
    let mut rest = &mut bytes[..];
    wire::binary(set, &mut rest).expect("room enough");
    let left = rest.len();
    bytes.truncate(bytes.len() - left);
    bytes
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes"))
}

fn f32_at(bytes: &[u8], at: usize) -> f32 {
    f32::from_bits(u32_at(bytes, at))
}

/// The uncertainty follows the harmonics. The offset of the lights includes it, so that readers of version 1 without the field skip it.
#[test]
fn the_uncertainty_of_the_unit_lies_before_the_lights() {
    let (lights, ambient) = (lights(), [[0.5; 3]; 9]);
    for (ambient, at) in [(None, 128), (Some(&ambient), 236)] {
        let set = LightSet { unit_uncertainty: Some(0.054), ..set(&lights, ambient) };
        let bytes = encode(&set);
        assert_eq!(u16::from_le_bytes([bytes[6], bytes[7]]), at as u16 + 4, "the first light");
        assert_eq!((bytes[48] & 32, f32_at(&bytes, at)), (32, 0.054), "flag and number");
        let read = BinarySet::try_new(&bytes).expect("a set");
        assert_eq!(read.head().unit_uncertainty, Some(0.054));
        assert_eq!(
            read.lights().collect::<Vec<_>>(),
            BinarySet::try_new(&encode(&LightSet { unit_uncertainty: None, ..set }))
                .expect("a set")
                .lights()
                .collect::<Vec<_>>()
        );
        let mut wrong = bytes.clone();
        wrong[at..at + 4].copy_from_slice(&f32::NAN.to_le_bytes());
        assert_eq!(BinarySet::try_new(&wrong).map(|_| ()), Err(DecodeError::Malformed));
    }
}

#[test]
fn fields_are_at_the_documented_offsets() {
    let lights = lights();
    let bytes = encode(&set(&lights, None));
    assert_eq!(&bytes[..8], b"HMLX\x01\x00\x80\x00", "magic, version, first light");
    assert_eq!(&bytes[8..16], &[8, 7, 6, 5, 4, 3, 2, 1], "frame");
    assert_eq!(&bytes[32..40], b"k3v9\0\0\0\0", "run");
    assert_eq!((u32_at(&bytes, 40), u32_at(&bytes, 44)), (64, 5), "requested, count");
    assert_eq!(&bytes[48..56], &[1 | 2 | 4 | 16, 2, 40, 0, 6, 0, 13, 0], "flags, axes, stride, lengths");
    let reals: Vec<_> = (0..9).map(|i| f32_at(&bytes, 64 + 4 * i)).collect();
    assert_eq!(reals, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 0.25, 0.5, 0.125], "sums and shares");
    assert_eq!(
        (0..7).map(|i| u32_at(&bytes, 100 + 4 * i)).collect::<Vec<_>>(),
        [1, 2, 3, 4, 5, 6, 7],
        "times"
    );
    let light = &bytes[128 + 3 * 40..];
    assert_eq!([u32_at(light, 0), u32_at(light, 4), u32_at(light, 8)], [103, 3, 21], "id, parent, age");
    let d = lights[3].direction;
    let expected = [2.5, d.x, d.z, d.y, 4.5, 0.25, 1e-20];
    assert_eq!([0, 1, 2, 3, 4, 5, 6].map(|i| f32_at(light, 12 + 4 * i)), expected, "turned to Unity's axes");
    assert_eq!(&bytes[128 + 200..], "q2treeunplugged: é".as_bytes(), "texts");
}

#[test]
fn decoded_set_equals_the_encoded_set() {
    let lights = lights();
    let ambient: Sh9 = core::array::from_fn(|i| [i as f32, 0.5, -1.0]);
    for (ambient, axes) in [(None, Coordinates::Probe), (Some(&ambient), Coordinates::Unreal)] {
        let set = LightSet { coordinates: axes, ..set(&lights, ambient) };
        let bytes = encode(&set);
        let read = BinarySet::try_new(&bytes).expect("a set");
        assert_eq!(read.head(), LightSet { lights: &[], ambient_sh: None, ..set }, "{axes:?}");
        assert_eq!(read.ambient_sh(), ambient.map(|sh| axes.harmonics(sh)), "{axes:?}");
        let turned = lights.iter().map(|l| Light { direction: axes.direction(l.direction), ..*l });
        assert!(read.lights().eq(turned), "{axes:?}");
    }
    let empty = encode(&LightSet::EMPTY);
    let read = BinarySet::try_new(&empty).expect("a set");
    assert_eq!((read.head(), read.lights().len()), (LightSet::EMPTY, 0), "before the first frame");
}

#[test]
fn every_truncated_prefix_is_refused() {
    let (lights, ambient) = (lights(), [[1.0; 3]; 9]);
    let bytes = encode(&set(&lights, Some(&ambient)));
    for end in 0..bytes.len() {
        assert!(BinarySet::try_new(&bytes[..end]).is_err(), "{end} of {} bytes", bytes.len());
    }
    assert_eq!(BinarySet::try_new(b"{\"version\":1}").err(), Some(DecodeError::NotALightSet), "JSON");
    let mut next = bytes.clone();
    next[4] = 2;
    assert_eq!(BinarySet::try_new(&next).err(), Some(DecodeError::Version(2)), "another version");
}

#[test]
fn numbers_out_of_range_are_refused() {
    let bytes = encode(&set(&lights(), None));
    let first = usize::from(u16::from_le_bytes([bytes[6], bytes[7]]));
    for (what, at, value) in [
        ("a negative flux", 64, -1.0),
        ("an unseen part that is no number", 92, f32::NAN),
        ("an infinite radius", first + 12, f32::INFINITY),
        ("a direction that is no unit vector", first + 16, 2.0),
        ("a negative irradiance", first + 36, -1e-3),
    ] {
        let mut bytes = bytes.clone();
        bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
        assert_eq!(BinarySet::try_new(&bytes).err(), Some(DecodeError::Malformed), "{what}");
    }
}

#[test]
fn corrupted_bytes_never_panic_and_give_finite_numbers() {
    let (lights, ambient) = (lights(), [[1.0; 3]; 9]);
    let good = encode(&set(&lights, Some(&ambient)));
    let mut rng = seeded(9);
    let mut accepted = 0;
    for _ in 0..20_000 {
        let mut bytes = good.clone();
        for _ in 0..rng.random_range(1..6) {
            let at = rng.random_range(0..bytes.len());
            bytes[at] = rng.random();
        }
        let Ok(set) = BinarySet::try_new(&bytes) else { continue };
        accepted += 1;
        let finite =
            set.lights().all(|l| l.direction.is_finite() && l.irradiance.iter().all(|v| v.is_finite()));
        assert!(finite && set.head().clipped.is_finite(), "finite");
        assert!(set.ambient_sh().is_none_or(|sh| sh.as_flattened().iter().all(|v| v.is_finite())), "finite");
    }
    assert!(accepted > 1000, "{accepted}: most changed bytes are numbers");
}

#[test]
fn xr_estimate_separates_the_brightest_light_and_sums_the_rest_in_harmonics() {
    let at = |d: Vec3, e: f32| Light {
        id: 1,
        direction: d.normalize(),
        irradiance: [e, 2.0 * e, 0.0],
        ..Light::default()
    };
    // The test vector of the format is in the axes of the set: (1, -3, 2) in the probe's axes is (1, 2, 3) with +Y up.
    let all = [at(Vec3::new(1.0, -3.0, 2.0), 1.0), at(Vec3::Z, 5.0)];
    let found = wire::estimate(&set(&all, None));
    assert_eq!((found.direction, found.intensity), (Vec3::Y, [5.0, 10.0, 0.0]), "the zenith is +Y");
    let expected =
        [0.282095, 0.261169, 0.391754, 0.130585, 0.156078, 0.468235, 0.292864, 0.234117, -0.117059];
    for (row, expected) in found.harmonics.iter().zip(expected) {
        assert!(
            (row[0] - expected).abs() < 2e-6 && (row[1] - 2.0 * expected).abs() < 4e-6,
            "{row:?} {expected}"
        );
        assert_eq!(row[2], 0.0, "no blue");
    }
    let dark = wire::estimate(&set(&[], None));
    assert_eq!(
        (dark.direction, dark.intensity, dark.harmonics),
        (Vec3::Y, [0.0; 3], [[0.0; 3]; 9]),
        "no light"
    );
}
