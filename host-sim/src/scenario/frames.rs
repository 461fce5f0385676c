//! Scenarios of camera frames: a simulated camera takes the exposures of its bursts in turn of a scene that moves, and the pipeline of the probe
//! computes a map of each burst or, with the sliding window, of each frame. A scenario has one true map for each camera frame: that of the time at
//! which the frame's exposure ends.

use super::bursts::{SENSOR, lens, polar_grid, radiance, upper};
use super::stage::{Stage, WARM, energy, with_disc};
use super::world::{MovingView, Timing};
use super::{Scenario, motion};
use crate::burst::THESIS_EXPOSURES_S;
use crate::env::EnvMap;
use crate::metrics::stability::LightSource;
use hemilux::calibration::{Burst, Calibration, Frame};
use hemilux::pipeline::{Pipeline, Settings, WindowMode};
use hemilux_core::mains::{Lamps, best_rate};
use hemilux_core::{Domain, Exposure};
use std::f64::consts::TAU;

/// Number of exposures of a burst.
const EXPOSURES: usize = THESIS_EXPOSURES_S.len();

/// Number of bursts up to the first camera frame of the scenario; in them the pipeline learns the usual ratios of the exposures.
const BEFORE: usize = 8;

/// Duration of a swing of the bulb, there and back, and of the way of the figure past the window, seconds.
const PERIOD_S: f64 = 2.0;

/// Returns the scenario of the bulb of `swinging-bulb` with the energy of the room, which swings by 35 degrees to either side in [`PERIOD_S`].
pub(super) fn swinging_bulb(stage: &Stage, name: &'static str, window: WindowMode) -> Scenario {
    let ground = upper(&stage.room);
    let flux = energy(&ground);
    let bulb = |s: f64| {
        let swing = 35f64.to_radians() * (TAU * s / PERIOD_S).sin();
        LightSource { direction: motion::hanging(swing), radius_deg: 3.0 }
    };
    let filmed = film(stage, window, |s| with_disc(&ground, bulb(s), WARM, flux));
    let sources = filmed.times_s.iter().map(|&s| vec![bulb(s)]).collect();
    Scenario { sources, moving: true, ..filmed.scenario(name, window) }
}

/// Returns the scenario of the window and the dark figure of `walker`, which walks from one side of the window to the other in [`PERIOD_S`], then
/// back.
pub(super) fn walker(stage: &Stage, name: &'static str, window: WindowMode) -> Scenario {
    let lit = upper(&motion::with_bright_window(&stage.room));
    let place = |s: f64| (0.5 * TAU * s / PERIOD_S).cos();
    film(stage, window, |s| upper(&motion::with_figure(&lit, place(s)))).scenario(name, window)
}

/// Returns the scenario of the clouds of `clouds`, in front of a sun with the energy of sky and ground.
pub(super) fn clouds(stage: &Stage, name: &'static str, window: WindowMode) -> Scenario {
    let sky = upper(&stage.sky);
    let sun = energy(&sky);
    let filmed = film(stage, window, |s| upper(&motion::with_clouds(&sky, motion::CLOUD_SPEED * s, sun)));
    let sources = vec![vec![motion::cloud_sun()]; filmed.truth.len()];
    Scenario { sources, ..filmed.scenario(name, window) }
}

/// Maps of the camera frames of a scenario.
struct Filmed {
    /// Time at which the exposure of each frame ends, seconds.
    times_s: Vec<f64>,
    truth: Vec<EnvMap>,
    seen: Vec<EnvMap>,
}

impl Filmed {
    fn scenario(self, name: &'static str, window: WindowMode) -> Scenario {
        let held = if window == WindowMode::Sliding { 1 } else { EXPOSURES };
        let (domain, seen) = (Domain::Hemisphere, Some(self.seen));
        Scenario { domain, seen, held, has_lag: true, ..Scenario::of(name, self.truth) }
    }
}

/// Returns the maps of as many bursts as the setting has frames. `scene` is the radiance at a time in seconds.
fn film(stage: &Stage, window: WindowMode, scene: impl Fn(f64) -> EnvMap) -> Filmed {
    let rate_hz = best_rate(1.0 / THESIS_EXPOSURES_S[EXPOSURES - 1], EXPOSURES, Lamps::Auto);
    let timing = Timing { rate_hz, exposures: THESIS_EXPOSURES_S.to_vec(), line_s: 0.0, rotates: false };
    let first = EXPOSURES * BEFORE - 1;
    let frames = first..first + EXPOSURES * stage.frames();
    let times_s: Vec<f64> = frames.clone().map(|frame| (frame + 1) as f64 / rate_hz).collect();
    let truth: Vec<EnvMap> = times_s.iter().map(|&s| scene(s)).collect();
    let values = truth.iter().flat_map(EnvMap::texels).flatten();
    let brightest = values.fold(0.0, |most: f32, v| most.max(*v));
    let view = MovingView::new(scene, lens(), timing, SENSOR, brightest.into(), stage.setting.seed);
    let mut probe = Probe::new(stage, &view.calibration(), &view.exposures(), window);
    let maps: Vec<_> =
        (0..frames.end).map(|frame| probe.add(view.frame(frame), frame, view.end_s(frame))).collect();
    let seen = maps.into_iter().skip(first).flatten().collect();
    Filmed { times_s, truth, seen }
}

/// The pipeline of the probe, with the newest frame of each exposure.
struct Probe<'a> {
    stage: &'a Stage,
    pipeline: Pipeline,
    window: WindowMode,
    burst: Burst,
    map: Option<EnvMap>,
}

impl<'a> Probe<'a> {
    fn new(stage: &'a Stage, calibration: &Calibration, exposures: &[Exposure], window: WindowMode) -> Self {
        // The sliding window excludes the removal of flicker.
        let lamps = if window == WindowMode::Sliding { Lamps::Off } else { Lamps::Auto };
        let settings = Settings { grid: polar_grid(stage), window, lamps, ..Settings::default() };
        let pipeline =
            Pipeline::try_new(*calibration, exposures, settings).expect("the exposures can be merged");
        Self { stage, pipeline, window, burst: Burst::default(), map: None }
    }

    /// Adds the frame `taken` with the number `frame`, whose exposure ends at `end_s`, seconds. Returns the newest map; `None` before the
    /// end of the first burst.
    fn add(&mut self, taken: Frame, frame: usize, end_s: f64) -> Option<EnvMap> {
        let (index, ns) = (frame % EXPOSURES, (1e9 * (1.0 + end_s)) as u64);
        match self.burst.frames.get_mut(index) {
            Some(older) => *older = taken,
            None => self.burst.frames.push(taken),
        }
        self.burst.timestamp_ns = ns;
        if index == 0 {
            self.burst.phase_ns = ns;
        }
        let is_first = frame + 1 == EXPOSURES;
        let slides = self.window == WindowMode::Sliding && frame >= EXPOSURES;
        self.burst.stale = if slides { !(1 << index) } else { 0 };
        if is_first || slides || (self.window == WindowMode::Burst && index + 1 == EXPOSURES) {
            self.pipeline.process(&self.burst).expect("the frames fit the calibration");
            self.map = Some(radiance(&mut self.pipeline, self.stage));
        }
        self.map.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contender;
    use crate::metrics::LitSet;
    use crate::scenario::Setting;

    #[test]
    fn set_of_a_burst_is_in_effect_for_the_frames_of_the_next_burst() {
        let setting = Setting { width: 64, frames: 3, seed: 1, background: None };
        let stage = Stage::new(&setting);
        for (window, equal) in [(WindowMode::Burst, 6), (WindowMode::Sliding, 0)] {
            let scenario = swinging_bulb(&stage, "test", window);
            let runs = contender::run_core_of(&scenario, &[16], |method| method.name == "adaptive");
            let sets = runs[0].sets.as_ref().expect("sets");
            assert_eq!(sets.len(), 9);
            let is_held = |pair: &[LitSet]| pair[0].lights == pair[1].lights;
            assert_eq!(sets.windows(2).filter(|pair| is_held(pair)).count(), equal, "{window:?}");
        }
    }
}
