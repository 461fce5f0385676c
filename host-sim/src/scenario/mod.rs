//! Scenarios: sequences of maps with known true radiance, in each of which some methods are expected to fail.
//!
//! All sequences are deterministic functions of a seed. Changes have compact support: outside of a lamp's disc no texel changes. If the
//! measured maps differ from the scene (noise, mains flicker, faulty exposures), `truth` contains the maps of the scene and `seen` the input of
//! the samplers; every score is relative to `truth`.
//!
//! | name | change during the sequence | methods expected to fail |
//! |---|---|---|
//! | `switch` | a lamp is switched on, then off | samplers with global distributions; temporal filters |
//! | `swinging-bulb` | a small bulb swings on its cord | fixed cells: a light keeps its direction while its energy changes |
//! | `sun-shadow` | the sun moves; the scores include only receivers in its shadow | lights of equal energy: nearly all are in the sun |
//! | `clouds` | clouds drift past the sun | global distributions |
//! | `flicker-100hz`, `flicker-120hz` | mains flicker, sampled by bursts every 103 ms | all methods without a temporal filter |
//! | `seam` | a lamp crosses phi = 0 | latitude-longitude cuts |
//! | `zenith` | a lamp crosses the zenith | latitude-longitude cuts |
//! | `rim` | a lamp sets below the hemisphere's horizon | cells that straddle the rim |
//! | `noise` | static room, 2 % texel noise | thresholds without hysteresis |
//! | `walker` | a dark figure walks past a window | fixed cells, global distributions |
//! | `grid-of-lamps` | the energies of 25 equal lamps drift by 0.5 % | samplers whose order depends on ties |
//! | `dark-and-back` | the light falls to 1/50 and returns | temporal filters |
//! | `all-clipped` | from one third on all texels have one clip value | samplers whose order depends on ties; quotients |
//! | `n-changes` | the requested number of lights N changes in every frame | structures that depend on N |
//! | `exposure-faults` | an exposure is missing, repeated or exchanged | temporal filters that keep the light of a faulty frame |
//! | `hue-shift` | the colours drift at constant luminance | importance by other weights than luminance |
//! | `bursts-steady` | bursts of two steady lamps, through lens, sensor and pipeline | - |
//! | `bursts-100-bulb`, `bursts-120-bulb` | bursts of two lamps with a ripple of 20 %, at most 25 and 60 frames per second | all methods without a fit over time |
//! | `bursts-100-led`, `bursts-120-led` | bursts of two lamps with rectified light, at most 30 frames per second | all methods without a fit over time |
//! | `bursts-100-pwm`, `bursts-1k-pwm` | bursts of two lamps that are dark for half of each period, at most 30 frames per second | all methods without a fit over time; at 1 kHz, which the fit does not search, all methods |
//! | `bursts-swinging`, `sliding-swinging` | camera frames of the bulb of `swinging-bulb`; a set after every burst, or after every frame by the sliding window | - |
//! | `bursts-walker`, `sliding-walker` | camera frames of the window and the figure of `walker`, with the same sets | - |
//! | `bursts-clouds`, `sliding-clouds` | camera frames of the clouds of `clouds`, with the same sets | - |

mod bursts;
mod events;
mod frames;
mod motion;
pub mod stage;
#[cfg(test)]
mod tests;
pub mod world;

use crate::env::EnvMap;
use crate::metrics::Domain;
use crate::metrics::stability::LightSource;
use hemilux::pipeline::WindowMode;
use stage::Stage;
use world::Wave;

/// Names of all scenarios, in the order of reports.
pub const NAMES: [&str; 30] = [
    "switch",
    "swinging-bulb",
    "sun-shadow",
    "clouds",
    "flicker-100hz",
    "flicker-120hz",
    "seam",
    "zenith",
    "rim",
    "noise",
    "walker",
    "grid-of-lamps",
    "dark-and-back",
    "all-clipped",
    "n-changes",
    "exposure-faults",
    "hue-shift",
    "bursts-steady",
    "bursts-100-bulb",
    "bursts-120-bulb",
    "bursts-100-led",
    "bursts-120-led",
    "bursts-100-pwm",
    "bursts-1k-pwm",
    "bursts-swinging",
    "sliding-swinging",
    "bursts-walker",
    "sliding-walker",
    "bursts-clouds",
    "sliding-clouds",
];

/// Size, length, seed and background of a scenario's sequence.
#[derive(Clone, Debug)]
pub struct Setting {
    /// Number of columns of the maps, which have half as many rows.
    pub width: usize,
    /// Number of frames of a sequence, at least 8; number of bursts of a sequence of camera frames.
    pub frames: usize,
    /// Seed of the scenario's random generator.
    pub seed: u64,
    /// Map that replaces the procedural interior and the procedural sky.
    pub background: Option<EnvMap>,
}

impl Setting {
    /// Setting of the full report: 128 x 64 texels, 28 frames.
    pub const FULL: Self = Self { width: 128, frames: 28, seed: 1, background: None };
    /// Setting of the quick report: 96 x 48 texels, 12 frames.
    pub const QUICK: Self = Self { width: 96, frames: 12, seed: 1, background: None };
}

/// A sequence of maps with the true sources and the changes that the scores refer to.
#[derive(Clone, Debug)]
pub struct Scenario {
    /// Name of the scenario, one of [`NAMES`].
    pub name: &'static str,
    /// Part of the sphere that the maps cover.
    pub domain: Domain,
    /// True radiance of the scenario, one map per frame.
    pub truth: Vec<EnvMap>,
    /// Maps that samplers read, if they differ from `truth`.
    pub seen: Option<Vec<EnvMap>>,
    /// Sources of compact support in each frame.
    pub sources: Vec<Vec<LightSource>>,
    /// Whether the first source of each frame moves, so that the tracking error is scored.
    pub moving: bool,
    /// Indices of the first frames after an abrupt change.
    pub changes: Vec<usize>,
    /// Luminous energy (sum of Y dOmega) of the switched source, if it has compact support.
    pub switched_energy: Option<f64>,
    /// Whether receivers that see the first source are excluded from the scores.
    pub in_shadow: bool,
    /// Fraction of the lights that is requested in each frame, 0 to 1; empty for all lights in every frame.
    pub share: Vec<f64>,
    /// Whether the scene is static and the maps are noisy, so that motion noise is scored.
    pub static_noise: bool,
    /// Number of successive frames for which a light set is in effect; the samplers read the map of the first of them.
    pub held: usize,
    /// Whether the frames are those of a camera, so that the tracking lag is scored.
    pub has_lag: bool,
}

impl Scenario {
    /// Creates a sequence over the sphere without sources, changes or noise.
    fn of(name: &'static str, truth: Vec<EnvMap>) -> Self {
        let sources = vec![Vec::new(); truth.len()];
        Self {
            name,
            domain: Domain::Sphere,
            truth,
            seen: None,
            sources,
            moving: false,
            changes: Vec::new(),
            switched_energy: None,
            in_shadow: false,
            share: Vec::new(),
            static_noise: false,
            held: 1,
            has_lag: false,
        }
    }

    /// Returns the maps that samplers read: the field `seen` if it is set, else `truth`.
    #[must_use]
    pub fn seen(&self) -> &[EnvMap] {
        self.seen.as_deref().unwrap_or(&self.truth)
    }

    /// Returns the requested number of lights in frame `t`: the frame's share of `lights`, at least `least`.
    #[must_use]
    pub fn lights(&self, t: usize, lights: usize, least: usize) -> usize {
        let share = self.share.get(t).copied().unwrap_or(1.0);
        ((lights as f64 * share).round() as usize).clamp(least.min(lights), lights)
    }

    /// Returns the moving source of frame `t`; `None` if no source moves or its centre is outside of the domain.
    #[must_use]
    pub fn tracked(&self, t: usize) -> Option<LightSource> {
        let source = self.sources[t].first().filter(|_| self.moving)?;
        crate::metrics::holds(self.domain, source.direction).then_some(*source)
    }
}

/// Creates the scenario `name`, one of [`NAMES`]; `None` for an unknown name.
#[must_use]
pub fn make(name: &str, setting: &Setting) -> Option<Scenario> {
    let stage = Stage::new(setting);
    let scenario = match name {
        "switch" => events::switch(&stage),
        "swinging-bulb" => motion::swinging_bulb(&stage),
        "sun-shadow" => motion::sun_shadow(&stage),
        "clouds" => motion::clouds(&stage),
        "flicker-100hz" => events::flicker(&stage, "flicker-100hz", 50.0),
        "flicker-120hz" => events::flicker(&stage, "flicker-120hz", 60.0),
        "seam" => motion::seam(&stage),
        "zenith" => motion::zenith(&stage),
        "rim" => motion::rim(&stage),
        "noise" => events::noise(&stage),
        "walker" => motion::walker(&stage),
        "grid-of-lamps" => events::grid_of_lamps(&stage),
        "dark-and-back" => events::dark_and_back(&stage),
        "all-clipped" => events::all_clipped(&stage),
        "n-changes" => events::n_changes(&stage),
        "exposure-faults" => events::exposure_faults(&stage),
        "hue-shift" => events::hue_shift(&stage),
        "bursts-steady" => bursts::mains(&stage, "bursts-steady", Wave::Steady, 30.0),
        "bursts-100-bulb" => bursts::mains(&stage, "bursts-100-bulb", ripple(100.0), 25.0),
        "bursts-120-bulb" => bursts::mains(&stage, "bursts-120-bulb", ripple(120.0), 60.0),
        "bursts-100-led" => bursts::mains(&stage, "bursts-100-led", Wave::Rectified { hz: 100.0 }, 30.0),
        "bursts-120-led" => bursts::mains(&stage, "bursts-120-led", Wave::Rectified { hz: 120.0 }, 30.0),
        "bursts-100-pwm" => bursts::mains(&stage, "bursts-100-pwm", pwm(100.0), 30.0),
        "bursts-1k-pwm" => bursts::mains(&stage, "bursts-1k-pwm", pwm(1000.0), 30.0),
        "bursts-swinging" => frames::swinging_bulb(&stage, "bursts-swinging", WindowMode::Burst),
        "sliding-swinging" => frames::swinging_bulb(&stage, "sliding-swinging", WindowMode::Sliding),
        "bursts-walker" => frames::walker(&stage, "bursts-walker", WindowMode::Burst),
        "sliding-walker" => frames::walker(&stage, "sliding-walker", WindowMode::Sliding),
        "bursts-clouds" => frames::clouds(&stage, "bursts-clouds", WindowMode::Burst),
        "sliding-clouds" => frames::clouds(&stage, "sliding-clouds", WindowMode::Sliding),
        _ => return None,
    };
    Some(scenario)
}

/// Returns the waveform of an incandescent lamp.
fn ripple(hz: f64) -> Wave {
    Wave::Sine { hz, depth: 0.2 }
}

/// Returns the waveform of an LED that is switched off for half of each period.
fn pwm(hz: f64) -> Wave {
    Wave::Pwm { hz, duty: 0.5 }
}
