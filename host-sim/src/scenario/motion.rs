//! Scenarios with motion: lamps, the sun, clouds and a person move.

use super::Scenario;
use super::stage::{DAYLIGHT, Stage, WARM, at, cloud, energy, repainted, with_disc, with_window};
use crate::env::EnvMap;
use crate::metrics::Domain;
use crate::metrics::stability::LightSource;
use crate::metrics::vector::unit;
use std::f64::consts::TAU;

/// Ratio of the luminous energy of a moving lamp to the energy of the background.
const LAMP_SHARE: f64 = 1.0;
/// Ratio of the luminous energy of the sun to the energy of sky and ground, on a clear day at noon.
const SUN_SHARE: f64 = 5.0;
/// Speed of the clouds, radians in a second.
pub(super) const CLOUD_SPEED: f64 = 0.9;
/// Interval of the frames of `clouds`, seconds.
const CLOUD_FRAME_S: f64 = 0.1;

/// Returns a scenario of `ground` and a lamp of `radius_deg` on a path; the lamp is the first source of every frame.
fn moving(
    name: &'static str,
    stage: &Stage,
    ground: &EnvMap,
    radius_deg: f64,
    path: impl Fn(f64) -> [f64; 3],
) -> Scenario {
    let flux = LAMP_SHARE * energy(ground);
    let source = |t: usize| LightSource { direction: path(stage.progress(t)), radius_deg };
    let truth = stage.sequence(|t| with_disc(ground, source(t), WARM, flux));
    let sources = (0..stage.frames()).map(|t| vec![source(t)]).collect();
    Scenario { sources, moving: true, ..Scenario::of(name, truth) }
}

/// Returns the scenario `swinging-bulb`: a bulb of 3 degrees radius swings one and a half times through 70 degrees, near the zenith and away from
/// the seam.
pub(super) fn swinging_bulb(stage: &Stage) -> Scenario {
    moving("swinging-bulb", stage, &stage.room, 3.0, |p| hanging(35f64.to_radians() * (1.5 * TAU * p).sin()))
}

/// Returns the direction of a bulb whose cord has the angle `swing` from the vertical, radians.
pub(super) fn hanging(swing: f64) -> [f64; 3] {
    unit([swing.sin(), 0.35, swing.cos()]).unwrap_or([0.0, 0.0, 1.0])
}

/// Returns the scenario `seam`: a lamp at 60 degrees from the zenith moves from the azimuth -20 to 20 degrees.
pub(super) fn seam(stage: &Stage) -> Scenario {
    moving("seam", stage, &stage.room, 4.0, |p| at(60.0, 40.0 * p - 20.0))
}

/// Returns the scenario `zenith`: a lamp crosses the zenith, from 25 degrees on one side to 25 degrees on the other.
pub(super) fn zenith(stage: &Stage) -> Scenario {
    moving("zenith", stage, &stage.room, 4.0, |p| at(50.0 * p - 25.0, 20.0))
}

/// Returns the scenario `rim`: a lamp moves from 12 degrees above the horizon to 12 degrees below; the domain is the hemisphere.
pub(super) fn rim(stage: &Stage) -> Scenario {
    let scenario = moving("rim", stage, &stage.room, 4.0, |p| at(78.0 + 24.0 * p, 70.0));
    Scenario { domain: Domain::Hemisphere, ..scenario }
}

/// Returns the scenario `sun-shadow`: the sun moves by about half a degree per frame; the scores exclude receivers that see the sun.
pub(super) fn sun_shadow(stage: &Stage) -> Scenario {
    let flux = SUN_SHARE * energy(&stage.sky);
    let sun = |t: usize| LightSource {
        direction: at(40.0 + 0.3 * t as f64, 100.0 + 0.5 * t as f64),
        radius_deg: 1.5,
    };
    let truth = stage.sequence(|t| with_disc(&stage.sky, sun(t), DAYLIGHT, flux));
    let sources = (0..stage.frames()).map(|t| vec![sun(t)]).collect();
    Scenario { sources, in_shadow: true, ..Scenario::of("sun-shadow", truth) }
}

/// Returns the scenario `clouds`: clouds drift across the sky and a static sun, whose radiance they attenuate to 1/50.
pub(super) fn clouds(stage: &Stage) -> Scenario {
    let clear = SUN_SHARE * energy(&stage.sky);
    let truth = stage.sequence(|t| with_clouds(&stage.sky, CLOUD_SPEED * CLOUD_FRAME_S * t as f64, clear));
    Scenario { sources: vec![vec![cloud_sun()]; stage.frames()], ..Scenario::of("clouds", truth) }
}

/// Returns the sun of `clouds`.
pub(super) fn cloud_sun() -> LightSource {
    LightSource { direction: at(45.0, 200.0), radius_deg: 1.5 }
}

/// Returns `sky` with clouds that have drifted by `drift` radians, and a sun behind them whose luminous energy is `clear` where the sky is clear.
pub(super) fn with_clouds(sky: &EnvMap, drift: f64, clear: f64) -> EnvMap {
    let covered = repainted(sky, |d, rgb| {
        let cover = cloud(d, drift) as f32;
        // The radiance of a cloud is about three times the radiance of the blue sky.
        rgb.map(|v| v * (1.0 - cover) + cover * 1.8)
    });
    let sun = cloud_sun();
    let through = (1.0 - cloud(sun.direction, drift)).max(0.02);
    with_disc(&covered, sun, DAYLIGHT, clear * through)
}

/// Half-sides of the window of `walker`, degrees.
const WINDOW_DEG: [f64; 2] = [28.0, 18.0];

/// Returns the direction of the middle of the window of `walker`.
fn window_middle() -> [f64; 3] {
    at(78.0, -90.0)
}

/// Returns the scenario `walker`: a dark figure of 10 degrees width walks past a window that emits half of the light.
pub(super) fn walker(stage: &Stage) -> Scenario {
    let lit = with_bright_window(&stage.room);
    let truth = stage.sequence(|t| with_figure(&lit, 3.0 * stage.progress(t) - 1.5));
    Scenario::of("walker", truth)
}

/// Returns `room` with a window that emits half of the light.
pub(super) fn with_bright_window(room: &EnvMap) -> EnvMap {
    let area_sr = 4.0 * WINDOW_DEG.map(|d: f64| d.to_radians().tan()).iter().product::<f64>() * 0.8;
    let radiance = energy(room) / area_sr;
    with_window(room, window_middle(), WINDOW_DEG, |_, _, _| DAYLIGHT.map(|c| (c * radiance) as f32))
}

/// Returns `lit`, a map with the window, and a dark figure in front of it, at `x` half-sides of the window to the right of its middle.
pub(super) fn with_figure(lit: &EnvMap, x: f64) -> EnvMap {
    let figure = |u: f64, v: f64| {
        let head = ((u - x) * WINDOW_DEG[0]).hypot((v - 0.55) * WINDOW_DEG[1]) < 4.0;
        head || ((u - x).abs() * WINDOW_DEG[0] < 5.0 && v < 0.35)
    };
    let middle = window_middle();
    with_window(lit, middle, WINDOW_DEG, |u, v, old| if figure(u, v) { [0.08; 3] } else { old })
}
