//! Scenarios of bursts: a simulated camera takes bursts of a room whose lamps flicker, and the pipeline of the probe converts the bursts to maps.

use super::Scenario;
use super::stage::{Stage, WARM, at, energy};
use super::world::{Course, Filming, Lamp, Timing, Wave, World};
use crate::burst::{Sensor, THESIS_EXPOSURES_S};
use crate::env::EnvMap;
use crate::metrics::stability::LightSource;
use hemilux::calibration::Calibration;
use hemilux::pipeline::{Pipeline, Settings};
use hemilux::recorded::{self, LensFile};
use hemilux_core::Domain;
use hemilux_core::mains::{Lamps, best_rate};
use hemilux_core::polar::Grid;
use std::path::Path;

/// Number of bursts before the first frame of the scenario; in them the pipeline measures the flicker.
const BEFORE: usize = 22;

/// Text of the lens file: an equidistant lens of 180 degrees with pixels of about one degree, so that the whole hemisphere is in the field of view.
const LENS: &str = "version = 1\n[lens]\nmodel = \"equidistant\"\nsize = [192, 192]\ncentre = [95.5, 95.5]\nfocal = [60.5, 60.5]\nmax_angle_deg = 89.9\n";

/// Sensor of the simulated camera.
pub(super) const SENSOR: Sensor = Sensor { bits: 12, full_well: 10_000.0, read_noise: 3.0 };

/// Time from the readout of one row of a frame to that of the next, seconds.
const LINE_S: f64 = 30e-6;

/// Returns the scenario of the room of `stage` with two lamps of waveform `wave`, each with the energy of the room. The frame rate of the camera is
/// the largest below `most_hz` at which the phases of successive bursts differ.
pub(super) fn mains(stage: &Stage, name: &'static str, wave: Wave, most_hz: f64) -> Scenario {
    let world = world(stage, wave);
    let longest = (1.0 / most_hz).min(THESIS_EXPOSURES_S[2]);
    let exposures = vec![THESIS_EXPOSURES_S[0], THESIS_EXPOSURES_S[1], longest];
    let rate_hz = best_rate(most_hz, exposures.len(), Lamps::Auto);
    let timing = Timing { rate_hz, exposures, line_s: LINE_S, rotates: false };
    let filming = Filming::new(&world, lens(), timing, SENSOR, None).seeded(stage.setting.seed);
    let seen = maps(stage, &filming);
    let truth = vec![upper(&world.mean(0.0)); stage.frames()];
    let sources = vec![world.lamps.iter().map(|lamp| lamp.source).collect(); stage.frames()];
    Scenario { domain: Domain::Hemisphere, seen: Some(seen), sources, ..Scenario::of(name, truth) }
}

fn world(stage: &Stage, wave: Wave) -> World {
    // The room is without its own lamp, which has the radiance of the darker of the two lamps.
    let still = EnvMap::new(
        stage.room.width(),
        stage.room.height(),
        stage.room.texels().iter().map(|rgb| rgb.map(|v| v.min(3.0))).collect(),
    );
    let flux = energy(&upper(&still));
    let lamp = |theta, phi, phase| Lamp {
        source: LightSource { direction: at(theta, phi), radius_deg: 5.0 },
        colour: WARM,
        flux,
        course: Course { wave, phase, changes: Vec::new() },
    };
    World { still, lit: None, lamps: vec![lamp(35.0, -120.0, 0.0), lamp(50.0, 30.0, 1.0 / 3.0)] }
}

/// Returns `map` with black texels below the horizon.
pub(super) fn upper(map: &EnvMap) -> EnvMap {
    let half = map.width() * (map.height() / 2);
    let texels = map.texels().iter().enumerate().map(|(k, rgb)| if k < half { *rgb } else { [0.0; 3] });
    EnvMap::new(map.width(), map.height(), texels.collect())
}

/// Returns the lens of the simulated camera.
pub(super) fn lens() -> LensFile {
    recorded::parse_lens(Path::new("lens.toml"), LENS).expect("a lens file")
}

/// Returns the polar map that has the columns and the upper rows of the maps of `stage`.
pub(super) fn polar_grid(stage: &Stage) -> Grid {
    Grid { width: stage.room.width(), height: stage.room.height() / 2, domain: Domain::Hemisphere }
}

/// Returns the maps that the pipeline computes from the bursts after the first [`BEFORE`].
fn maps(stage: &Stage, filming: &Filming) -> Vec<EnvMap> {
    let settings = Settings { grid: polar_grid(stage), ..Settings::default() };
    let calibration: Calibration = filming.calibration();
    let mut pipeline =
        Pipeline::try_new(calibration, &filming.exposures(), settings).expect("the exposures can be merged");
    let mut seen = Vec::new();
    for burst in 0..BEFORE + stage.frames() {
        pipeline.process(&filming.burst(burst)).expect("the frames fit the calibration");
        if burst >= BEFORE {
            seen.push(radiance(&mut pipeline, stage));
        }
    }
    seen
}

/// Returns the radiance of the map of the last burst; texels below the horizon are black.
pub(super) fn radiance(pipeline: &mut Pipeline, stage: &Stage) -> EnvMap {
    let grid = polar_grid(stage);
    let energy = pipeline.map().polar.texels;
    let texels = energy.iter().enumerate().map(|(k, rgb)| {
        let omega = grid.solid_angle(k / grid.width) as f32;
        rgb.map(|v| v / omega)
    });
    let mut texels: Vec<_> = texels.collect();
    texels.resize(grid.width * stage.room.height(), [0.0; 3]);
    EnvMap::new(grid.width, stage.room.height(), texels)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Setting;

    /// Returns the flux of each map of a scenario of bursts, divided by the flux of the scene.
    fn flux(frames: usize, wave: Wave, most_hz: f64) -> Vec<f64> {
        let stage = Stage::new(&Setting { frames, ..Setting::QUICK });
        let scenario = mains(&stage, "test", wave, most_hz);
        scenario.seen().iter().zip(&scenario.truth).map(|(a, b)| energy(a) / energy(b)).collect()
    }

    /// The energies of rectangular lamps deviate at the edges: mean over 24 bursts, from the tenth burst of the scenario on.
    #[test]
    fn mean_flux_of_rectangular_lamps_is_near_their_mean_flux_at_every_frame_rate() {
        for most_hz in [25.0, 30.0, 60.0] {
            for hz in [100.0, 120.0] {
                let flux = flux(34, Wave::Pwm { hz, duty: 0.5 }, most_hz);
                let off = flux[10..].iter().map(|flux| (flux - 1.0).abs()).sum::<f64>() / 24.0;
                assert!(off < 0.02, "{hz} Hz at {most_hz}: {off}");
            }
        }
    }

    #[test]
    fn flux_of_flickering_lamps_is_their_mean_flux_at_every_frame_rate() {
        for most_hz in [25.0, 30.0, 60.0] {
            for hz in [100.0, 120.0] {
                for wave in
                    [Wave::Sine { hz, depth: 0.2 }, Wave::Rectified { hz }, Wave::Sine { hz, depth: 1.0 }]
                {
                    // Flicker of full depth at 60 Hz is removed five bursts, a quarter of a second, after the scenario begins.
                    let settled =
                        if most_hz > 30.0 && wave == (Wave::Sine { hz, depth: 1.0 }) { 5 } else { 0 };
                    for (t, flux) in flux(12, wave, most_hz).into_iter().enumerate().skip(settled) {
                        assert!((flux - 1.0).abs() < 0.02, "{wave:?} at {most_hz} Hz, burst {t}: {flux}");
                    }
                }
            }
        }
    }
}
