//! Cameras in a room: lit screens at one angle after another in the dark, and a still scene with a wide range of radiance.

use glam::{DVec2, DVec3};
use hemilux::calibration::{Burst, Calibration, Frame, Pixels};
use hemilux::source::{Source, SourceError};
use hemilux_core::lens::Lens;
use hemilux_core::{Exposure, Format, Response};
use std::f64::consts::{FRAC_PI_2, TAU};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::sleep;
use std::time::{Duration, Instant};

const SIDE: usize = 480;

/// Relative exposures of the frames of a burst.
const STEPS: [f64; 5] = [0.03125, 0.125, 0.5, 2.0, 8.0];

/// Number of positions of the lit screen, from the axis to 88 degrees.
const PLACES: usize = 18;

/// Returns the relative illumination of the camera with the screens at `theta`, the angle from the axis in radians.
pub fn true_illumination(theta: f64) -> f64 {
    (0.5 * theta).cos().powi(4)
}

/// Returns the relative code of the camera with the still scene for a relative exposure.
pub fn true_code(exposure: f64) -> f64 {
    exposure.clamp(0.0, 1.0).powf(1.0 / 2.2)
}

/// A camera that returns one of several pictures; the test selects it by a shared number.
pub struct RoomCamera {
    calibration: Calibration,
    pictures: Vec<Vec<Vec<u8>>>,
    selected: Arc<AtomicUsize>,
    every: Duration,
    due: Instant,
}

fn lens() -> Lens {
    let middle = SIDE as f64 / 2.0 - 0.5;
    Lens::equidistant([middle; 2], 2.0 * middle / std::f64::consts::PI, FRAC_PI_2).expect("a lens")
}

/// Returns a picture of the relative light at each pixel, taken with a relative exposure by a camera of relative code `code`.
fn picture(light: &[f64], exposure: f64, code: impl Fn(f64) -> f64) -> Vec<u8> {
    let pixel = |(i, light): (usize, &f64)| {
        let noise = ((i * 7919) % 97) as f64 / 97.0 - 0.5;
        [(255.0 * code(light * exposure) + noise).round().clamp(0.0, 255.0) as u8; 3]
    };
    light.iter().enumerate().flat_map(pixel).collect()
}

fn at(i: usize) -> DVec2 {
    DVec2::new((i % SIDE) as f64, (i / SIDE) as f64)
}

impl RoomCamera {
    fn new(
        response: Response,
        pictures: Vec<Vec<Vec<u8>>>,
        every: Duration,
        selected: Arc<AtomicUsize>,
    ) -> Self {
        let mut calibration =
            Calibration::try_new(lens(), Format::Rgb24, SIDE as u32, SIDE as u32).expect("a layout");
        calibration.response = response;
        Self { calibration, pictures, selected, every, due: Instant::now() }
    }

    /// Creates a linear camera before which a screen is at position `selected` modulo [`PLACES`], counted from the axis to the rim.
    pub fn screens(every: Duration, selected: Arc<AtomicUsize>) -> Self {
        let lens = lens();
        let shown = (0..PLACES).map(|i| {
            let theta = 88f64.to_radians() * i as f64 / (PLACES - 1) as f64;
            let phi = 0.3 + TAU * 0.381 * i as f64;
            let out = DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
            let middle = lens.project(out).expect("in view");
            let light: Vec<f64> = (0..SIDE * SIDE)
                .map(|i| {
                    let lit = at(i).distance(middle) < 8.0;
                    let theta = lens.unproject(at(i)).map(|d| d.z.clamp(-1.0, 1.0).acos());
                    theta.map_or(0.0, true_illumination) * if lit { 1.4 } else { 0.01 }
                })
                .collect();
            STEPS.map(|step| picture(&light, step, |x| x)).to_vec()
        });
        Self::new(Response::Linear, shown.collect(), every, selected)
    }

    /// Creates a camera of response [`true_code`] with a still scene over three decades of radiance.
    pub fn still(every: Duration) -> Self {
        let lens = lens();
        let light: Vec<f64> = (0..SIDE * SIDE)
            .map(|i| {
                let place = ((i % SIDE) / 8 * 37 + (i / SIDE) / 8 * 61) % 60;
                lens.unproject(at(i)).map_or(0.0, |_| 10f64.powf(-2.5 + 3.0 * place as f64 / 60.0))
            })
            .collect();
        let burst = STEPS.map(|step| picture(&light, step, true_code)).to_vec();
        Self::new(Response::Srgb, vec![burst], every, Arc::default())
    }
}

impl Source for RoomCamera {
    fn calibration(&self) -> &Calibration {
        &self.calibration
    }

    fn exposures(&self) -> Vec<Exposure> {
        STEPS.map(|step| Exposure { seconds: 0.004 * step, gain: 1.0 }).to_vec()
    }

    fn next(&mut self, burst: &mut Burst) -> Result<(), SourceError> {
        sleep(self.due.saturating_duration_since(Instant::now()));
        self.due = Instant::now() + self.every;
        let pictures = &self.pictures[self.selected.load(Ordering::Relaxed) % self.pictures.len()];
        let frame =
            |(exposure, bytes): (Exposure, &Vec<u8>)| Frame { exposure, pixels: Pixels::U8(bytes.clone()) };
        burst.frames = self.exposures().into_iter().zip(pictures).map(frame).collect();
        burst.timestamp_ns = 0;
        Ok(())
    }
}
