//! Combination of repeated readings of the photometric factor to one factor, and the verdict of a check with a luxmeter.

use super::photometric::FactorReading;

/// The photometric factor that results from several readings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Factor {
    /// Illuminance in lux per unit of relative irradiance.
    pub factor: f64,
    /// Relative uncertainty of `factor` with 95 % coverage.
    pub uncertainty: f64,
}

/// Combines readings to their mean, weighted by their own uncertainties. If the readings scatter more than their uncertainties, the scatter
/// determines the uncertainty of the mean; the uncertainty of the luxmeter is not reduced by averaging.
#[must_use]
pub fn combine(readings: &[FactorReading]) -> Option<Factor> {
    let weight = |r: &FactorReading| 1.0 / r.own.max(1e-4).powi(2);
    let sum: f64 = readings.iter().map(weight).sum();
    let factor = readings.iter().map(|r| weight(r) * r.factor).sum::<f64>() / sum;
    if !(factor > 0.0 && factor.is_finite()) {
        return None;
    }
    let squares: f64 = readings.iter().map(|r| weight(r) * (r.factor / factor - 1.0).powi(2)).sum();
    let scatter = squares / (readings.len() as f64 - 1.0).max(1.0);
    let own = scatter.max(1.0).sqrt() / sum.sqrt();
    let shared = readings.iter().map(|r| r.shared).fold(0.0, f64::max);
    Some(Factor { factor, uncertainty: (2.0 * own.hypot(shared)).min(1.0) })
}

/// Verdict of comparing a reading of the luxmeter with the calibration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// The reading of the luxmeter differs from the calibration by less than 10 %.
    Good,
    /// The reading of the luxmeter differs from the calibration by 10 to 25 %.
    Fair,
    /// The reading of the luxmeter differs from the calibration by more than 25 %.
    Reject,
}

impl Verdict {
    /// Returns the verdict on a relative difference between luxmeter and calibration.
    #[must_use]
    pub fn of(difference: f64) -> Self {
        match difference.abs() {
            d if d < 0.10 => Self::Good,
            d if d <= 0.25 => Self::Fair,
            _ => Self::Reject,
        }
    }

    /// Returns the name of the verdict for people.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Fair => "fair",
            Self::Reject => "reject",
        }
    }
}
