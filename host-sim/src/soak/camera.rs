//! Camera of a soak test: a source of bursts of 64 by 48 pixels whose light rises and falls like daylight. A call of `next` returns
//! a burst without a wait, except during outages, which are long enough for stale sets.

use hemilux::calibration::{Burst, Calibration, Frame, Pixels};
use hemilux::clock;
use hemilux::source::{Source, SourceError};
use hemilux_core::format::Format;
use hemilux_core::{Exposure, Lens, Levels};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
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

/// Simulated time from burst to burst, nanoseconds: three frames at 29.5 a second, the highest rate up to 30 at which bursts record lamps
/// on the mains at different phases. At exactly ten bursts a second, the search for mains light would have nothing to find.
const INTERVAL_NS: u64 = 101_694_915;

/// Simulated time of the first burst, nanoseconds: later than the largest backward step of a fault of the clock.
const FIRST_NS: u64 = 3_600_000_000_000;

/// Code of the sun in the shortest exposure at the brightest moment, divided by the largest code.
const BRIGHTEST: f32 = 0.8;

/// Relative light of the newest burst and number of the bursts that the camera has returned; the camera and the judge of the sets share
/// both.
#[derive(Clone, Debug, Default)]
pub(super) struct Daylight {
    /// Bits of an `f64`: the radiance in the newest burst divided by the radiance at the brightest moment.
    light: Arc<AtomicU64>,
    bursts: Arc<AtomicU64>,
}

impl Daylight {
    /// Returns the radiance in the newest burst divided by the radiance at the brightest moment.
    pub fn light(&self) -> f64 {
        f64::from_bits(self.light.load(Ordering::Relaxed))
    }

    /// Returns the number of bursts that the camera has returned.
    pub fn bursts(&self) -> u64 {
        self.bursts.load(Ordering::Relaxed)
    }
}

/// A source of bursts of a still scene whose radiance rises and falls exponentially with the burst number.
pub(super) struct DayCamera {
    calibration: Calibration,
    exposures: Vec<Exposure>,
    /// Code of each sample in the shortest exposure at the brightest moment, divided by the largest code.
    still: Vec<f32>,
    /// Offset of each sample in codes, added before rounding down: the mean of dark samples is unbiased, as with the noise of a sensor.
    dither: Vec<f32>,
    bursts: u64,
    /// Number of bursts from the darkest to the brightest moment.
    half_day: f64,
    /// Time until which the device is missing.
    gone_until: Option<Instant>,
    daylight: Daylight,
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
            dither,
            bursts: 0,
            half_day,
            gone_until: None,
            daylight: Daylight::default(),
        })
    }

    /// Returns a handle to the light and the number of bursts, which `next` updates.
    pub fn daylight(&self) -> Daylight {
        self.daylight.clone()
    }

    /// Returns true during the outage that precedes a burst of every [`BETWEEN_OUTAGES`].
    fn is_gone(&mut self) -> bool {
        if self.bursts % BETWEEN_OUTAGES != BETWEEN_OUTAGES / 2 {
            self.gone_until = None;
            return false;
        }
        Instant::now() < *self.gone_until.get_or_insert_with(|| Instant::now() + OUTAGE)
    }

    /// Returns the radiance of the next burst divided by the radiance at the brightest moment; it changes by a constant factor per burst.
    fn light(&self) -> f64 {
        let phase = (self.bursts as f64 / self.half_day) % 2.0;
        DARKEST.powf(1.0 - if phase < 1.0 { phase } else { 2.0 - phase })
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
        let light = self.light();
        burst.phase_ns = time_ns(self.bursts);
        self.bursts += 1;
        burst.before_ns = clock::monotonic_ns();
        burst.frames.truncate(self.exposures.len());
        while burst.frames.len() < self.exposures.len() {
            burst.frames.push(Frame { exposure: self.exposures[0], pixels: Pixels::U16(Vec::new()) });
        }
        for (frame, exposure) in burst.frames.iter_mut().zip(&self.exposures) {
            frame.exposure = *exposure;
            let gain = (f64::from(WHITE) * light * exposure.seconds / SECONDS[0]) as f32;
            if let Pixels::U16(codes) = &mut frame.pixels {
                codes.clear();
                let samples = self.still.iter().zip(&self.dither);
                codes.extend(samples.map(|(level, dither)| (level * gain + dither) as u16));
            }
        }
        self.daylight.light.store(light.to_bits(), Ordering::Relaxed);
        self.daylight.bursts.store(self.bursts, Ordering::Relaxed);
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
        let interval_ns = 3e9 / best_rate(30.0, 3, Lamps::Auto);
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
