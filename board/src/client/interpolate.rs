//! Interpolation of lights between two sets, by id.

use super::set::Set;
use hemilux_core::light::Light;

/// Appends to `lights` the lights interpolated between the sets `from` (`part` 0) and `to` (`part` 1).
pub(super) fn interpolate(from: &Set, to: &Set, part: f32, lights: &mut Vec<Light>) {
    lights.extend(to.lights.iter().map(|light| match from.light(light.id) {
        Some(old) => between(old, light, part),
        None => scaled(light, part),
    }));
    let gone = from.lights.iter().filter(|light| to.light(light.id).is_none());
    lights.extend(gone.map(|light| scaled(light, 1.0 - part)));
}

fn between(from: &Light, to: &Light, part: f32) -> Light {
    let mix = |a: f32, b: f32| a + part * (b - a);
    // Opposite directions have no mean direction.
    let direction = from.direction.lerp(to.direction, part).try_normalize().unwrap_or(to.direction);
    let irradiance = std::array::from_fn(|k| mix(from.irradiance[k], to.irradiance[k]));
    Light { direction, irradiance, radius_deg: mix(from.radius_deg, to.radius_deg), ..*to }
}

fn scaled(light: &Light, part: f32) -> Light {
    Light { irradiance: light.irradiance.map(|v| v * part), ..*light }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hemilux_core::wire::{self, BinarySet, LightSet};

    fn set(lights: &[(u32, [f32; 3], f32)]) -> Set {
        let light = |(id, d, e): &(u32, [f32; 3], f32)| Light {
            id: *id,
            direction: (*d).into(),
            irradiance: [*e, 0.0, 0.0],
            ..Light::default()
        };
        let lights: Vec<_> = lights.iter().map(light).collect();
        let mut bytes = vec![0; 4096];
        wire::binary(&LightSet { lights: &lights, ..LightSet::EMPTY }, &mut &mut bytes[..]).expect("room");
        let mut set = Set::default();
        set.read(&BinarySet::try_new(&bytes).expect("a set"));
        set
    }

    #[test]
    fn lights_move_by_id_and_fade_with_interpolated_energy() {
        let from = set(&[(7, [1.0, 0.0, 0.0], 2.0), (9, [0.0, 0.0, 1.0], 8.0)]);
        let to = set(&[(5, [0.0, 1.0, 0.0], 4.0), (7, [0.0, 1.0, 0.0], 6.0)]);
        let mut lights = Vec::new();
        interpolate(&from, &to, 0.5, &mut lights);
        let found: Vec<_> = lights.iter().map(|l| (l.id, l.irradiance[0])).collect();
        assert_eq!(found, [(5, 2.0), (7, 4.0), (9, 4.0)], "new, moving, gone");
        let half = std::f32::consts::FRAC_1_SQRT_2;
        let d = lights[1].direction;
        assert!((d.x - half).abs() < 1e-6 && (d.y - half).abs() < 1e-6, "half a quarter turn: {d}");
        lights.clear();
        interpolate(&from, &set(&[(7, [-1.0, 0.0, 0.0], 2.0)]), 0.5, &mut lights);
        assert!(lights.iter().all(|l| (l.direction.length() - 1.0).abs() < 1e-6), "opposite: {lights:?}");
    }
}
