//! Light of a lamp over time: waveforms, and abrupt changes of the level.

use std::f64::consts::{PI, TAU};

/// Waveform of a lamp's light, with the mean 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wave {
    /// Light that does not change.
    Steady,
    /// A constant plus a sinusoid; the ripple of an incandescent lamp has a depth of 0.1 to 0.3.
    Sine {
        /// Frequency of the sinusoid, hertz.
        hz: f64,
        /// Amplitude of the sinusoid divided by the mean.
        depth: f64,
    },
    /// A rectified sinusoid, as the light of an LED on a rectifier without a capacitor.
    Rectified {
        /// Frequency of the rectified sinusoid, hertz.
        hz: f64,
    },
    /// The mean of a rectified sinusoid and constant light, as the light of an LED whose phosphor stores light.
    Phosphor {
        /// Frequency of the rectified sinusoid, hertz.
        hz: f64,
    },
    /// A rectangular wave: light in the fraction `duty` of each period, darkness in the rest.
    Pwm {
        /// Frequency of the rectangular wave, hertz.
        hz: f64,
        /// Fraction of the period with light, above 0 and at most 1.
        duty: f64,
    },
}

impl Wave {
    /// Returns the frequency of the wave, hertz; 1 for steady light.
    #[must_use]
    pub fn hz(self) -> f64 {
        match self {
            Self::Steady => 1.0,
            Self::Sine { hz, .. } | Self::Rectified { hz } | Self::Phosphor { hz } | Self::Pwm { hz, .. } => {
                hz
            }
        }
    }

    /// Returns the integral of the wave's light from phase 0 to `turns` periods, in periods.
    fn integral(self, turns: f64) -> f64 {
        let (whole, part) = (turns.floor(), turns - turns.floor());
        let rectified = whole + 0.5 * (1.0 - (PI * part).cos());
        match self {
            Self::Steady => turns,
            Self::Sine { depth, .. } => turns + depth * (1.0 - (TAU * part).cos()) / TAU,
            Self::Rectified { .. } => rectified,
            Self::Phosphor { .. } => 0.5 * (turns + rectified),
            Self::Pwm { duty, .. } => whole + part.min(duty) / duty,
        }
    }

    /// Returns the mean light of the wave from `start_s` to `end_s`, seconds; `phase` is the phase at time 0, periods.
    #[must_use]
    pub fn mean(self, phase: f64, start_s: f64, end_s: f64) -> f64 {
        let turns = |s: f64| phase + self.hz() * s;
        (self.integral(turns(end_s)) - self.integral(turns(start_s))) / (self.hz() * (end_s - start_s))
    }
}

/// Abrupt change of the level of a lamp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Change {
    /// Time at which the lamp's light changes, seconds.
    pub at_s: f64,
    /// Factor of the lamp's light from this time on.
    pub level: f64,
}

/// Light of a lamp over time: a waveform times a level that changes abruptly.
#[derive(Clone, Debug, PartialEq)]
pub struct Course {
    /// Waveform of the lamp.
    pub wave: Wave,
    /// Phase of the waveform at time 0, periods.
    pub phase: f64,
    /// Changes of the level, ascending in time; the level before the first change is 1.
    pub changes: Vec<Change>,
}

impl Course {
    /// Creates a waveform at the constant level 1.
    #[must_use]
    pub fn of(wave: Wave) -> Self {
        Self { wave, phase: 0.0, changes: Vec::new() }
    }

    /// Returns the level of the lamp at the time `at_s`, seconds.
    #[must_use]
    pub fn level(&self, at_s: f64) -> f64 {
        self.changes.iter().rev().find(|c| c.at_s <= at_s).map_or(1.0, |c| c.level)
    }

    /// Returns the mean light of the lamp from `start_s` to `end_s`, seconds.
    #[must_use]
    pub fn mean(&self, start_s: f64, end_s: f64) -> f64 {
        let inside = self.changes.iter().map(|c| c.at_s).filter(|at| (start_s..end_s).contains(at));
        let ends = inside.clone().chain([end_s]);
        let pieces = std::iter::once(start_s).chain(inside).zip(ends).filter(|(from, to)| to > from);
        let light =
            pieces.map(|(from, to)| (to - from) * self.level(from) * self.wave.mean(self.phase, from, to));
        light.sum::<f64>() / (end_s - start_s)
    }
}
