//! Camera of a soak test: a source of bursts of 64 by 48 pixels whose light rises and falls like daylight, with lamps on the mains in the
//! evening and in the morning. A call of `next` returns a burst without a wait, except during outages, which are long enough for stale sets.

use super::lamps::{self, LampLight};
use hemilux::calibration::{Burst, Calibration, Frame, Pixels};
use hemilux::clock;
use hemilux::source::{Source, SourceError};
use hemilux_core::format::Format;
use hemilux_core::{Exposure, Lens, Levels};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Columns of a frame.
const WIDTH: u32 = 64;
/// Rows of a frame.
const HEIGHT: u32 = 48;

/// Largest sensor code, 16 bits.
const WHITE: f32 = 65_535.0;

/// Exposure times of a burst until a client sets others, seconds.
pub(super) const SECONDS: [f64; 3] = [0.000_926, 0.005_555, 0.033_333];

/// Number of bursts from the darkest to the brightest moment: twelve hours at ten bursts a second.
const HALF_DAY: f64 = 432_000.0;

/// Radiance at the darkest moment divided by the radiance at the brightest moment.
const DARKEST: f64 = 1.0 / 500.0;

/// Number of bursts between two outages, the first of which is after half of this number.
const BETWEEN_OUTAGES: u64 = 12_000;

/// Duration of an outage, real time: longer than the age at which the server marks a set stale (1.5 s).
const OUTAGE: Duration = Duration::from_secs(2);

/// Simulated time from burst to burst, nanoseconds: three frames at 29.1 a second. Bursts at this rate record lamps on the mains
/// at different phases. At exactly ten bursts a second, the search for mains light would have nothing to find.
const INTERVAL_NS: u64 = 103_092_784;

/// Simulated time of the first burst, nanoseconds: later than the largest backward step of a fault of the clock.
const FIRST_NS: u64 = 3_600_000_000_000;

/// Code of the sun in the shortest exposure at the brightest moment, divided by the largest code.
const BRIGHTEST: f32 = 0.8;

/// Light of a burst.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Light {
    /// Daylight divided by the daylight at the brightest moment.
    pub day: f64,
    /// Light of the lamps; `None` while they are off.
    pub lamps: Option<LampLight>,
}

/// Light of the newest burst and number of the bursts that the camera has returned; the camera and the judge of the sets share both.
#[derive(Clone, Debug, Default)]
pub(super) struct Newest {
    light: Arc<Mutex<Light>>,
    bursts: Arc<AtomicU64>,
}

impl Newest {
    /// Returns the light of the newest burst.
    pub fn light(&self) -> Light {
        *self.light.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the number of bursts that the camera has returned.
    pub fn bursts(&self) -> u64 {
        self.bursts.load(Ordering::Relaxed)
    }
}

/// A source of bursts of a still scene whose daylight rises and falls exponentially with the burst number, with or without lamps.
pub(super) struct DayCamera {
    calibration: Calibration,
    exposures: Vec<Exposure>,
    /// Code of each sample in the shortest exposure at the brightest moment, divided by the largest code.
    still: Vec<f32>,
    /// Code of each sample under the lamps in the shortest exposure at the mean of their waveform, divided by the largest code; `None` for a
    /// camera without lamps.
    lit: Option<Vec<f32>>,
    /// Offset of each sample in codes, added before rounding down: the mean of dark samples is unbiased, as with the noise of a sensor.
    dither: Vec<f32>,
    bursts: u64,
    /// Number of bursts from the darkest to the brightest moment.
    half_day: f64,
    /// Time until which the device is missing.
    gone_until: Option<Instant>,
    newest: Newest,
}

impl DayCamera {
    /// Creates a camera for a run of `frames` bursts. The light of a short run changes faster, so that every run passes the darkest and the
    /// brightest moment.
    pub fn try_new(frames: u64) -> Option<Self> {
        let middle = [f64::from(WIDTH - 1) / 2.0, f64::from(HEIGHT - 1) / 2.0];
        let lens = Lens::equidistant(middle, 21.0, 80f64.to_radians()).ok()?;
        let mut calibration = Calibration::try_new(lens, Format::Rgb48, WIDTH, HEIGHT).ok()?;
        calibration.levels = Levels { black: 0.0, white: WHITE.into() };
        let still: Vec<f32> = (0..HEIGHT).flat_map(|y| (0..WIDTH).flat_map(move |x| colour(x, y))).collect();
        let exposures = SECONDS.map(exposure).to_vec();
        let half_day = HALF_DAY.min(frames as f64 / 2.0).max(1.0);
        let dither = (0..still.len()).map(dither).collect();
        Some(Self {
            calibration,
            exposures,
            still,
            lit: Some(lamps::levels(WIDTH, HEIGHT)),
            dither,
            bursts: 0,
            half_day,
            gone_until: None,
            newest: Newest::default(),
        })
    }

    /// Returns the camera as after `bursts` bursts.
    #[cfg(test)]
    pub fn starting_at(self, bursts: u64) -> Self {
        Self { bursts, ..self }
    }

    /// Returns the camera without lamps.
    pub fn without_lamps(self) -> Self {
        Self { lit: None, ..self }
    }

    /// Returns the camera with steady lamps, at the mean of their waveform, in place of the daylight at the brightest moment.
    pub fn with_lamps_alone(self) -> Self {
        Self { still: lamps::levels(WIDTH, HEIGHT), lit: None, ..self }
    }

    /// Returns a handle to the light and the number of bursts, which `next` updates.
    pub fn newest(&self) -> Newest {
        self.newest.clone()
    }

    /// Returns true during the outage that precedes a burst of every [`BETWEEN_OUTAGES`].
    fn is_gone(&mut self) -> bool {
        if self.bursts % BETWEEN_OUTAGES != BETWEEN_OUTAGES / 2 {
            self.gone_until = None;
            return false;
        }
        Instant::now() < *self.gone_until.get_or_insert_with(|| Instant::now() + OUTAGE)
    }

    /// Returns the time of day of the next burst: 0 at the darkest moment, 1 at the brightest, below 2.
    fn time_of_day(&self) -> f64 {
        (self.bursts as f64 / self.half_day) % 2.0
    }

    /// Returns the daylight of the next burst, which changes by a constant factor per burst, and the lamps without an exposure.
    fn light(&self) -> Light {
        let time = self.time_of_day();
        let day = DARKEST.powf(1.0 - if time < 1.0 { time } else { 2.0 - time });
        Light { day, lamps: self.lit.as_ref().and_then(|_| lamps::wave(time)).map(LampLight::new) }
    }

    /// Writes the codes of a frame: the still scene times `gain`, and the light of the lamps times `lamps`.
    fn record(&self, codes: &mut Vec<u16>, gain: f32, lamps: Option<f32>) {
        codes.clear();
        let still = self.still.iter().zip(&self.dither);
        match self.lit.as_ref().zip(lamps) {
            Some((lit, lamps)) => {
                let samples = still.zip(lit);
                codes.extend(samples.map(|((day, dither), lit)| (day * gain + lit * lamps + dither) as u16));
            }
            None => codes.extend(still.map(|(level, dither)| (level * gain + dither) as u16)),
        }
    }
}

/// Returns the simulated time of burst `number`, nanoseconds: bursts at equal intervals, and the outages before them. It does not depend on
/// the speed of the machine.
fn time_ns(number: u64) -> u64 {
    let outages = (number + BETWEEN_OUTAGES / 2) / BETWEEN_OUTAGES;
    FIRST_NS + number * INTERVAL_NS + outages * OUTAGE.as_nanos() as u64
}

/// Returns the relative code of a pixel in the shortest exposure at the brightest moment: a sun, a bright wall, and a gradient.
fn colour(x: u32, y: u32) -> [f32; 3] {
    let sun = (40..42).contains(&x) && (12..14).contains(&y);
    let wall = x < 16;
    let level = if sun {
        BRIGHTEST
    } else if wall {
        0.02
    } else {
        0.004 + 0.008 * y as f32 / HEIGHT as f32
    };
    [level, 0.9 * level, if sun { 0.7 } else { 1.1 } * level]
}

/// Returns an offset from 0 to 1; the offsets of consecutive samples are multiples of the golden ratio modulo 1, which are evenly distributed.
fn dither(sample: usize) -> f32 {
    (sample as f64 * 0.618_033_988_749_894_9).fract() as f32
}

fn exposure(seconds: f64) -> Exposure {
    Exposure { seconds, gain: 1.0 }
}

impl Source for DayCamera {
    fn calibration(&self) -> &Calibration {
        &self.calibration
    }

    fn exposures(&self) -> Vec<Exposure> {
        self.exposures.clone()
    }

    fn set_exposures(&mut self, seconds: Option<&[f64]>) -> Result<(), String> {
        self.exposures = seconds.unwrap_or(&SECONDS).iter().map(|s| exposure(*s)).collect();
        Ok(())
    }

    fn fixed_exposures(&self) -> Option<&'static str> {
        None
    }

    fn next(&mut self, burst: &mut Burst) -> Result<(), SourceError> {
        if self.is_gone() {
            return Err(SourceError::Gone("found no device, expected the camera of the soak test".into()));
        }
        let mut light = self.light();
        burst.phase_ns = time_ns(self.bursts);
        self.bursts += 1;
        burst.before_ns = clock::monotonic_ns();
        burst.frames.truncate(self.exposures.len());
        while burst.frames.len() < self.exposures.len() {
            burst.frames.push(Frame { exposure: self.exposures[0], pixels: Pixels::U16(Vec::new()) });
        }
        let frame_ns = INTERVAL_NS / self.exposures.len().max(1) as u64;
        let first_ns = burst.phase_ns;
        let ends = (0..).map(|index: u64| (first_ns + index * frame_ns) as f64 * 1e-9);
        for ((frame, exposure), end_s) in burst.frames.iter_mut().zip(&self.exposures).zip(ends) {
            frame.exposure = *exposure;
            let gain = f64::from(WHITE) * exposure.seconds / SECONDS[0];
            let lamps = light.lamps.as_mut().map(|lamps| gain * lamps.expose(end_s, exposure.seconds));
            if let Pixels::U16(codes) = &mut frame.pixels {
                self.record(codes, (gain * light.day) as f32, lamps.map(|v| v as f32));
            }
        }
        *self.newest.light.lock().unwrap_or_else(PoisonError::into_inner) = light;
        self.newest.bursts.store(self.bursts, Ordering::Relaxed);
        burst.timestamp_ns = clock::monotonic_ns();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hemilux_core::mains::{Lamps, best_rate};

    #[test]
    fn bursts_have_simulated_times_at_which_lamps_have_different_phases() {
        let mut camera = DayCamera::try_new(100).expect("a camera");
        let mut burst = Burst::default();
        let times: Vec<_> = (0..100).map(|_| camera.next(&mut burst).map(|()| burst.phase_ns)).collect();
        let times: Vec<_> = times.into_iter().map(|time| time.expect("a burst")).collect();
        let rate_hz = 29.1;
        assert_eq!(best_rate(rate_hz, 3, Lamps::Mains50), rate_hz, "phases of lamps of 100 Hz differ");
        let interval_ns = 3e9 / rate_hz;
        for pair in times.windows(2) {
            assert!(((pair[1] - pair[0]) as f64 - interval_ns).abs() < 1.0, "{pair:?}, {interval_ns}");
        }
    }

    #[test]
    fn time_goes_on_during_an_outage() {
        let before = BETWEEN_OUTAGES / 2;
        assert_eq!(time_ns(before) - time_ns(before - 1), INTERVAL_NS + 2_000_000_000);
        assert_eq!(time_ns(before + 1) - time_ns(before), INTERVAL_NS);
    }
}
