//! Lamps on the mains in the scene of a soak test: a bulb and the wall that it lights, in the evening at 100 Hz and in the morning at 120 Hz.

use crate::scenario::world::Wave;
use hemilux_core::mains::{Flicker, Lamps};

/// The times of day at which the lamps are lit and the waveforms of their light. The darkest moment is at 0 and 2, the brightest at 1. Daylight
/// at the ends is 1/270 and 1/42 of the brightest moment: the lamps' share of the flux is 60 % and 20 %.
const LIT: [([f64; 2], Wave); 2] =
    [([0.1, 0.4], Wave::Rectified { hz: 100.0 }), ([1.6, 1.9], Wave::Sine { hz: 120.0, depth: 1.0 })];

/// Code of the bulb's samples in the shortest exposure at the mean of the waveform, divided by the largest code: the bulb is valid at all phases
/// in the two shorter exposures, and clipped at all phases in the longest one.
const BULB: f32 = 0.04;

/// Code of the lit wall's samples, as [`BULB`].
const WALL: f32 = 6e-5;

/// Phases, periods, among which an exposure has its middle when it records the least or the most light: the waveforms of [`LIT`] are symmetric
/// about their extrema.
const SYMMETRIC: [f64; 4] = [0.0, 0.25, 0.5, 0.75];

/// Returns the waveform of the lamps at a time of day, 0 to 2; `None` while they are off.
pub(super) fn wave(time_of_day: f64) -> Option<Wave> {
    LIT.iter().find(|([on, off], _)| (*on..*off).contains(&time_of_day)).map(|(_, wave)| *wave)
}

/// Returns the code of each sample under the lamps alone in the shortest exposure at the mean of the waveform, divided by the largest code.
pub(super) fn levels(width: u32, height: u32) -> Vec<f32> {
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    pixels.flat_map(|(x, y)| colour(x, y)).collect()
}

fn colour(x: u32, y: u32) -> [f32; 3] {
    let is_bulb = (24..26).contains(&x) && (18..20).contains(&y);
    let level = if is_bulb {
        BULB
    } else if x < 16 {
        WALL
    } else {
        0.0
    };
    [level, 0.8 * level, 0.5 * level]
}

/// Light of the lamps in a burst, divided by its mean over a period.
#[derive(Clone, Copy, Debug)]
pub(super) struct LampLight {
    pub wave: Wave,
    /// Least and most mean light during an exposure of the burst.
    pub recorded: [f64; 2],
    /// Least and most mean light during an exposure of the burst if the burst begins at any phase.
    pub possible: [f64; 2],
}

impl LampLight {
    /// The light before the first exposure is added.
    pub fn new(wave: Wave) -> Self {
        let none = [f64::INFINITY, f64::NEG_INFINITY];
        Self { wave, recorded: none, possible: none }
    }

    /// Adds the exposure that ends at `end_s` after `seconds`; returns its mean light.
    pub fn expose(&mut self, end_s: f64, seconds: f64) -> f64 {
        let mean = self.wave.mean(0.0, end_s - seconds, end_s);
        extend(&mut self.recorded, mean);
        for middle in SYMMETRIC {
            extend(&mut self.possible, self.wave.mean(middle, -0.5 * seconds, 0.5 * seconds));
        }
        mean
    }

    /// Returns whether the probe searches the frequency of these lamps with the setting `mains`.
    pub fn is_searched(&self, setting: Lamps) -> bool {
        let of_50_hz = self.wave.hz() < 110.0;
        setting == Lamps::Auto || setting == if of_50_hz { Lamps::Mains50 } else { Lamps::Mains60 }
    }
}

fn extend([least, most]: &mut [f64; 2], value: f64) {
    (*least, *most) = (least.min(value), most.max(value));
}

/// Number of sets, with unchanged lamps and exposures, from the first in which the probe has found the lamps to the first that must have their mean
/// light: the probe fits the light of at most sixteen bursts.
const SETTLED: u32 = 16;

/// What a set is compared with.
#[derive(Clone, Copy, Debug)]
pub(super) struct SetState<'a> {
    pub lamps: Option<LampLight>,
    /// The setting `mains`.
    pub setting: Lamps,
    pub flicker: Flicker,
    /// Exposure times of a whole burst, seconds.
    pub seconds: &'a [f64],
    /// Whether the burst may lack frames.
    pub is_partial: bool,
}

/// Light of the lamps that a set may have, least and most, divided by the mean of a period.
#[derive(Clone, Copy, Debug)]
pub(super) struct LampRange {
    /// Light that the probe is to find; few sets may differ from it.
    pub usual: [f64; 2],
    /// Light that the exposures of the burst can record; a set beyond it is wrong.
    pub possible: [f64; 2],
}

/// The state of the lamps and of their detection from set to set, which determines the accuracy that a set must have.
#[derive(Debug, Default)]
pub(super) struct LampWatch {
    is_lit: bool,
    seconds: Vec<f64>,
    /// Number of successive sets in which the lamps were found.
    found: u32,
}

impl LampWatch {
    /// Returns the light of the lamps that a set of the present burst may have.
    pub fn follow(&mut self, set: &SetState) -> LampRange {
        let is_found = set.flicker.frequency_hz.is_some();
        let is_switched = self.is_lit != set.lamps.is_some();
        self.is_lit = set.lamps.is_some();
        if is_switched || self.seconds != set.seconds || !is_found {
            self.found = 0;
            self.seconds.clear();
            self.seconds.extend(set.seconds);
        }
        self.found += u32::from(is_found);
        let Some(lamps) = set.lamps else { return self.after_lamps(is_switched) };
        if !is_found {
            return LampRange { usual: lamps.recorded, possible: lamps.recorded };
        }
        let is_settled = self.found > SETTLED && !set.is_partial && lamps.is_searched(set.setting);
        LampRange { usual: if is_settled { [1.0; 2] } else { lamps.possible }, possible: lamps.possible }
    }

    /// Returns the light of lamps that are off. The burst of the switch does not show whether the lamps are off or in the dark part of their
    /// period, and the earlier bursts take part in fits for [`SETTLED`] bursts.
    fn after_lamps(&self, is_switched: bool) -> LampRange {
        let most = |is_unknown: bool| [0.0, f64::from(u8::from(is_unknown))];
        let has_earlier = (1..=SETTLED).contains(&self.found);
        LampRange { usual: most(is_switched && has_earlier), possible: most(has_earlier) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn least_and_most_light_are_those_of_all_phases() {
        for (_, wave) in LIT {
            for seconds in [0.000_926, 0.005_555, 0.014_816, 0.033_333] {
                let mut light = LampLight::new(wave);
                light.expose(0.0, seconds);
                let mut dense = [f64::INFINITY, f64::NEG_INFINITY];
                // The mean of the light at 500 times during the exposure, at 1000 phases.
                for phase in 0..1000 {
                    let start = f64::from(phase) / 1000.0 / wave.hz();
                    let at = |k: i32| start + (f64::from(k) + 0.5) / 500.0 * seconds;
                    extend(&mut dense, (0..500).map(|k| instant(wave, at(k))).sum::<f64>() / 500.0);
                }
                for (computed, sampled) in light.possible.iter().zip(dense) {
                    assert!(
                        (computed - sampled).abs() < 1e-3,
                        "{wave:?}, {seconds} s: {computed}, {sampled}"
                    );
                }
            }
        }
    }

    /// Returns the light of `wave` at a time, seconds, divided by its mean.
    fn instant(wave: Wave, at: f64) -> f64 {
        let angle = std::f64::consts::TAU * wave.hz() * at;
        match wave {
            Wave::Sine { depth, .. } => 1.0 + depth * angle.sin(),
            _ => std::f64::consts::FRAC_PI_2 * (0.5 * angle).sin().abs(),
        }
    }

    #[test]
    fn lamps_are_lit_in_the_evening_at_100_hz_and_in_the_morning_at_120_hz() {
        let hz = [0.05, 0.25, 0.5, 1.0, 1.5, 1.75, 1.95].map(|time| wave(time).map(Wave::hz));
        assert_eq!(hz, [None, Some(100.0), None, None, None, Some(120.0), None]);
    }
}
