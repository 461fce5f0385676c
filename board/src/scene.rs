//! Built-in scenes: analytic radiance over directions, a deterministic function of the seconds since the start.
//!
//! A scene is a static radiance field with at most twelve moving patches in front of it. Radiance is relative: a well-lit wall has about 1,
//! and the largest radiance is [`BRIGHTEST`], so that the exposures of a burst cover the whole range.

use std::f32::consts::{PI, TAU};

/// Largest radiance of any channel in a scene.
pub const BRIGHTEST: f32 = 50.0;

/// Names that `scene:NAME` accepts; the first is the default.
pub const NAMES: [&str; 4] = ["room", "sky", "lamps", "overcast"];

/// Largest number of moving patches of a scene.
const MAX_PATCHES: usize = 12;

/// A round patch over the static field: opaque in its middle, with a fading edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patch {
    /// Unit vector to the patch's centre.
    pub direction: [f32; 3],
    /// Angular radius of the patch, radians.
    pub radius: f32,
    /// Width of the edge of the patch, over which its radiance falls to 0, as a fraction of the squared chord from the centre to the edge,
    /// 0..=1.
    pub edge: f32,
    /// Radiance of the patch, red, green and blue.
    pub radiance: [f32; 3],
    /// Fraction of the light behind the patch that the patch hides, 0..=1; the radiance of the patch is added in full.
    pub cover: f32,
}

impl Patch {
    const NONE: Self =
        Self { direction: [0.0, 0.0, 1.0], radius: 0.0, edge: 1.0, radiance: [0.0; 3], cover: 0.0 };

    /// Returns the radiance in `direction` with the patch in front of the radiance `behind`.
    #[must_use]
    pub fn over(&self, behind: [f32; 3], direction: [f32; 3]) -> [f32; 3] {
        let reach = 1.0 - self.radius.cos();
        let off = 1.0 - dot(self.direction, direction);
        if off >= reach {
            return behind;
        }
        let part = smooth((1.0 - off / reach) / self.edge);
        std::array::from_fn(|c| behind[c] * (1.0 - part * self.cover) + part * self.radiance[c])
    }
}

/// The patches of a scene at one time.
#[derive(Clone, Debug)]
pub struct Patches {
    all: [Patch; MAX_PATCHES],
    count: usize,
}

impl Patches {
    fn of<const N: usize>(patches: [Patch; N]) -> Self {
        const { assert!(N <= MAX_PATCHES, "room for the patches of every scene") };
        let mut all = [Patch::NONE; MAX_PATCHES];
        all[..N].copy_from_slice(&patches);
        Self { all, count: N }
    }

    /// Returns the patches of the scene, the farthest first.
    #[must_use]
    pub fn as_slice(&self) -> &[Patch] {
        &self.all[..self.count]
    }
}

/// A function from a unit direction to the radiance of a scene's static field.
type Still = fn([f32; 3]) -> [f32; 3];

/// A function from the seconds since the start to a scene's patches at that time.
type Moving = fn(f32) -> Patches;

/// A built-in scene: a static field and moving patches.
#[derive(Clone, Copy, Debug)]
pub struct Scene {
    name: &'static str,
    still: Still,
    patches: Moving,
}

/// Returns the scene called `name`.
#[must_use]
pub fn by_name(name: &str) -> Option<Scene> {
    let (still, patches): (Still, Moving) = match name {
        "room" => (room, swinging_lamp),
        "sky" => (clear_sky, sun_and_clouds),
        "lamps" => (dim_walls, switching_lamps),
        "overcast" => (overcast_sky, thin_spots),
        _ => return None,
    };
    let name = NAMES.into_iter().find(|n| *n == name)?;
    Some(Scene { name, still, patches })
}

impl Scene {
    /// Returns the name of the scene.
    #[must_use]
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Returns the radiance in `direction` (a unit vector, +Z up) at `seconds` after the start.
    #[must_use]
    pub fn radiance(&self, direction: [f32; 3], seconds: f32) -> [f32; 3] {
        let patches = self.patches(seconds);
        patches.as_slice().iter().fold(self.still(direction), |behind, p| p.over(behind, direction))
    }

    /// Returns the radiance of the scene's static field in `direction`.
    #[must_use]
    pub fn still(&self, direction: [f32; 3]) -> [f32; 3] {
        (self.still)(direction)
    }

    /// Returns the scene's patches at `seconds` after the start.
    #[must_use]
    pub fn patches(&self, seconds: f32) -> Patches {
        (self.patches)(seconds)
    }
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Returns the cubic Hermite step at `x`: 0 for `x` up to 0, 1 for `x` from 1.
fn smooth(x: f32) -> f32 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

fn mix(a: [f32; 3], b: [f32; 3], part: f32) -> [f32; 3] {
    std::array::from_fn(|c| a[c] + (b[c] - a[c]) * part)
}

/// Returns the unit vector at zenith angle `theta_deg` and azimuth `phi_deg`, degrees.
fn towards(theta_deg: f32, phi_deg: f32) -> [f32; 3] {
    let (sin, cos) = theta_deg.to_radians().sin_cos();
    let (y, x) = phi_deg.to_radians().sin_cos();
    [sin * x, sin * y, cos]
}

fn lamp(direction: [f32; 3], radius_deg: f32, radiance: [f32; 3]) -> Patch {
    Patch { direction, radius: radius_deg.to_radians(), edge: 0.4, radiance, cover: 1.0 }
}

/// Returns a patch that hides nothing, for the light that a lamp casts on its surroundings.
fn glow(direction: [f32; 3], radius_deg: f32, radiance: [f32; 3]) -> Patch {
    Patch { direction, radius: radius_deg.to_radians(), edge: 1.0, radiance, cover: 0.0 }
}

/// Returns the radiance of a box room, 4 x 5 m wide and 1.6 m high above the probe, with a window of 1.6 x 1 m in the wall at +X.
fn room(d: [f32; 3]) -> [f32; 3] {
    let (half_x, half_y, height) = (2.0, 2.5, 1.6);
    let far = |v: f32, half: f32| if v.abs() > 1e-6 { half / v.abs() } else { f32::INFINITY };
    let (to_x, to_y, to_z) = (far(d[0], half_x), far(d[1], half_y), far(d[2], height));
    let distance = to_x.min(to_y).min(to_z);
    let at = d.map(|v| v * distance);
    if to_z <= distance {
        let from_window = ((half_x - at[0]) / (2.0 * half_x)).clamp(0.0, 1.0);
        return mix([0.75, 0.74, 0.70], [0.22, 0.21, 0.19], from_window);
    }
    let low = smooth((at[2] + 0.5) / height);
    if to_x > distance {
        return mix([0.20, 0.17, 0.14], [0.46, 0.42, 0.36], low);
    }
    let pane = at[1].abs() < 0.8 && (0.2..1.2).contains(&at[2]) && at[1].abs() > 0.04;
    match (d[0] > 0.0, pane) {
        (true, true) => mix([6.0, 6.6, 7.0], [11.0, 13.0, 16.0], smooth((at[2] - 0.2) / 0.9)),
        (true, false) => mix([0.07, 0.07, 0.07], [0.14, 0.13, 0.12], low),
        (false, _) => mix([0.34, 0.30, 0.26], [0.72, 0.67, 0.60], low),
    }
}

/// Returns the patch of a warm lamp that swings across the room with a period of four seconds.
fn swinging_lamp(seconds: f32) -> Patches {
    let swing = (TAU * seconds / 4.0).sin();
    let (x, y, z) = (0.15 * swing - 0.35, 0.65 * swing, 1.1);
    let length = (x * x + y * y + z * z).sqrt();
    let direction = [x / length, y / length, z / length];
    Patches::of([glow(direction, 40.0, [0.55, 0.42, 0.27]), lamp(direction, 4.0, [48.0, 37.0, 23.0])])
}

/// Returns the radiance of a sky, blue at the zenith and pale at the horizon.
fn clear_sky(d: [f32; 3]) -> [f32; 3] {
    let height = d[2].clamp(0.0, 1.0).sqrt();
    mix([0.95, 1.0, 1.05], [0.22, 0.42, 0.85], height)
}

/// Returns the patches of a veiled sun with its aureole, and of clouds that drift across it.
fn sun_and_clouds(seconds: f32) -> Patches {
    let sun = towards(40.0, 30.0);
    let cloud = |i: u16| {
        let i = f32::from(i);
        let across = (0.31 * i + seconds / 90.0).fract() * 160.0 - 80.0;
        let (theta, phi) = (across.abs(), if across < 0.0 { 205.0 } else { 25.0 });
        let grey = 0.75 + 0.1 * (i * 2.4).sin();
        Patch {
            direction: towards(theta, phi + 9.0 * (i * 1.7).sin()),
            radius: (9.0 + 5.0 * (i * 3.1).cos()).to_radians(),
            edge: 1.0,
            radiance: [grey, grey, 1.05 * grey],
            cover: 0.9,
        }
    };
    Patches::of([
        glow(sun, 25.0, [1.6, 1.5, 1.3]),
        lamp(sun, 2.0, [50.0, 47.0, 41.0]),
        cloud(0),
        cloud(1),
        cloud(2),
        cloud(3),
        cloud(4),
        cloud(5),
        cloud(6),
        cloud(7),
    ])
}

/// Returns the radiance of the dark walls of the scene `lamps`.
fn dim_walls(d: [f32; 3]) -> [f32; 3] {
    mix([0.05, 0.05, 0.06], [0.10, 0.09, 0.08], d[2].clamp(0.0, 1.0))
}

/// Returns the patches of five coloured lamps, each lit for a fixed fraction of its own period.
fn switching_lamps(seconds: f32) -> Patches {
    let one = |theta: f32, phi: f32, colour: [f32; 3], period: f32, on: f32| {
        let lit = (seconds / period + phi / 360.0).rem_euclid(1.0) < on;
        lamp(towards(theta, phi), 3.5, colour.map(|v| if lit { v } else { 0.02 }))
    };
    Patches::of([
        one(15.0, 80.0, [40.0, 36.0, 30.0], 6.0, 0.8),
        one(45.0, 0.0, [45.0, 6.0, 4.0], 3.0, 0.5),
        one(50.0, 120.0, [5.0, 40.0, 8.0], 4.0, 0.5),
        one(45.0, 240.0, [6.0, 10.0, 45.0], 5.0, 0.5),
        one(65.0, 300.0, [38.0, 30.0, 4.0], 7.0, 0.6),
    ])
}

/// Returns the radiance of the overcast sky of CIE S 011: three times as bright at the zenith as at the horizon.
fn overcast_sky(d: [f32; 3]) -> [f32; 3] {
    let y = 1.2 * (1.0 + 2.0 * d[2].clamp(0.0, 1.0)) / 3.0;
    [0.96 * y, y, 1.06 * y]
}

/// Returns the patches of two brighter parts of an overcast sky that move.
fn thin_spots(seconds: f32) -> Patches {
    let turn = seconds * 360.0 / 120.0;
    let wander = 25.0 * (PI * seconds / 30.0).sin();
    Patches::of([
        glow(towards(35.0, turn), 30.0, [0.5, 0.5, 0.48]),
        glow(towards(40.0 + wander, 180.0 - turn), 22.0, [0.35, 0.36, 0.36]),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn by_name_finds_every_listed_scene_and_no_other() {
        for name in NAMES {
            assert_eq!(by_name(name).map(|s| s.name()), Some(name), "{name}");
        }
        assert!(by_name("garden").is_none() && by_name("").is_none(), "unknown names");
    }

    #[test]
    fn radiance_is_finite_and_bounded_in_every_direction_at_all_times() {
        for scene in NAMES.map(|name| by_name(name).expect("a scene")) {
            for step in 0..60u8 {
                let seconds = f32::from(step) * 0.77;
                for i in 0..500u16 {
                    let direction = towards(f32::from(i % 25) * 3.7, f32::from(i) * 7.1);
                    let rgb = scene.radiance(direction, seconds);
                    let sound = rgb.iter().all(|v| v.is_finite() && (0.0..=BRIGHTEST + 3.0).contains(v));
                    assert!(sound, "{} at {seconds} s: {rgb:?}", scene.name());
                }
            }
        }
    }

    #[test]
    fn scenes_move() {
        for scene in NAMES.map(|name| by_name(name).expect("a scene")) {
            let (before, after) = (scene.patches(0.0), scene.patches(1.9));
            assert_ne!(before.as_slice(), after.as_slice(), "{}", scene.name());
        }
    }
}
