//! The light of a lamp over time.

use std::f64::consts::{PI, TAU};

/// The waveform of a lamp, of mean 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Wave {
    /// Constant light.
    Steady,
    /// A sinusoid: the ripple of an incandescent lamp has a depth of 0.1 to 0.3.
    Sine {
        /// Periods a second.
        hz: f64,
        /// Amplitude over the mean.
        depth: f64,
    },
    /// A rectified sinusoid, as of an LED behind a rectifier without a capacitor.
    Rectified {
        /// Periods a second.
        hz: f64,
    },
    /// The mean of a rectified sinusoid and constant light, as of an LED whose phosphor stores light.
    Phosphor {
        /// Periods a second.
        hz: f64,
    },
    /// On for the share `duty` of each period, else off.
    Pwm {
        /// Periods a second.
        hz: f64,
        /// Share of the period, above 0.
        duty: f64,
    },
}

impl Wave {
    fn hz(self) -> f64 {
        match self {
            Self::Steady => 1.0,
            Self::Sine { hz, .. } | Self::Rectified { hz } | Self::Phosphor { hz } | Self::Pwm { hz, .. } => {
                hz
            }
        }
    }

    /// Integral of the light from 0 to `turns` periods, in periods.
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

    /// Mean light from `start_s` to `end_s`; `phase` is the phase at time 0, periods.
    #[must_use]
    pub fn mean(self, phase: f64, start_s: f64, end_s: f64) -> f64 {
        let turns = |s: f64| phase + self.hz() * s;
        (self.integral(turns(end_s)) - self.integral(turns(start_s))) / (self.hz() * (end_s - start_s))
    }
}

/// The level of a lamp from some time on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Change {
    /// Time of the change, seconds.
    pub at_s: f64,
    /// Factor of the lamp's light.
    pub level: f64,
}

/// Means of a lamp's light over intervals: a waveform times a level that changes at once.
#[derive(Clone, Debug, PartialEq)]
pub struct Course {
    /// Waveform of the lamp.
    pub wave: Wave,
    /// Phase at time 0, periods.
    pub phase: f64,
    /// Changes of the level, ascending in time; the level before the first is 1.
    pub changes: Vec<Change>,
}

impl Course {
    /// A waveform at level 1.
    #[must_use]
    pub fn of(wave: Wave) -> Self {
        Self { wave, phase: 0.0, changes: Vec::new() }
    }

    /// The level at a time.
    #[must_use]
    pub fn level(&self, at_s: f64) -> f64 {
        self.changes.iter().rev().find(|c| c.at_s <= at_s).map_or(1.0, |c| c.level)
    }

    /// Mean light from `start_s` to `end_s`.
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
