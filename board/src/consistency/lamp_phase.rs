//! Phase of the lamps on the mains in each burst.

/// Phase of lamps, added up from burst to burst: an error of the frequency shifts the phases slowly.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct LampPhase {
    /// Frequency of the lamps, hertz; `None` while no lamps are found.
    frequency_hz: Option<f64>,
    /// Phase, periods, 0 to 1, and time of the last burst, seconds.
    last: Option<(f64, f64)>,
}

impl LampPhase {
    pub fn set_frequency(&mut self, frequency_hz: Option<f32>) {
        self.frequency_hz = frequency_hz.map(f64::from);
        if frequency_hz.is_none() {
            self.last = None;
        }
    }

    /// Returns the phase of the lamps in a burst at the time `at_s`, seconds, periods from 0 to 1; `None` without lamps or without a time.
    pub fn advance(&mut self, at_s: Option<f64>) -> Option<f32> {
        let (frequency_hz, at_s) = (self.frequency_hz?, at_s?);
        let (phase, before_s) = self.last.unwrap_or((0.0, at_s));
        let phase = (phase + frequency_hz * (at_s - before_s)).rem_euclid(1.0);
        self.last = Some((phase, at_s));
        Some(phase as f32)
    }
}
