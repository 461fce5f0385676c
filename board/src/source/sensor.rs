//! A simulated sensor: linear, 8 bits, with shot noise, read noise and quantisation.

use hemilux_core::Levels;

/// Black level and code of a full well: the black level is so high that noise around it stays above code 0 and its mean has no bias.
const BLACK: f32 = 8.0;
const WHITE: f32 = 255.0;

/// Read noise of the sensor, codes RMS: it hides the steps between codes.
const READ_NOISE: f32 = 0.6;

/// Number of electrons per code: a full well has about 10,000 electrons.
const ELECTRONS: f32 = 40.0;

/// Number of entries of the noise table; each image row begins at a pseudo-random entry.
const NOISE: usize = 1 << 14;

/// A simulated sensor with its noise table; rows of images are exposed one by one.
#[derive(Debug)]
pub(super) struct Sensor {
    noise: Vec<f32>,
}

impl Sensor {
    /// Creates the sensor and its noise table.
    pub fn new() -> Self {
        Self { noise: noise() }
    }

    /// Returns the black and the white level of the simulated sensor.
    pub fn levels() -> Levels {
        Levels { black: f64::from(BLACK), white: f64::from(WHITE) }
    }

    /// Returns the codes per unit of radiance for an exposure of `seconds`, if a radiance of `full` saturates a pixel in an exposure of
    /// `shortest` seconds.
    pub fn gain(seconds: f64, full: f64, shortest: f64) -> f32 {
        (f64::from(WHITE - BLACK) * seconds / (full * shortest)) as f32
    }

    /// Exposes one row of at most 4096 samples with the given radiance; equal seeds give equal noise.
    pub fn expose(&self, radiance: &[f32], gain: f32, seed: u32, codes: &mut [u8]) {
        let at = scramble(seed) as usize % NOISE.saturating_sub(radiance.len()).max(1);
        for ((code, l), n) in codes.iter_mut().zip(radiance).zip(&self.noise[at..]) {
            let mean = l * gain;
            let deviation = (READ_NOISE * READ_NOISE + mean * (1.0 / ELECTRONS)).sqrt();
            *code = (mean + deviation * n + (BLACK + 0.5)) as u8;
        }
    }
}

/// Returns a fixed table of nearly normal deviates with variance 1 and mean 0: sums of four uniform deviates.
fn noise() -> Vec<f32> {
    let mut state = 1u32;
    let mut uniform = || {
        state = state.wrapping_add(1);
        scramble(state) as f32 / 4_294_967_296.0 - 0.5
    };
    let mut table: Vec<f32> =
        (0..NOISE).map(|_| (0..4).map(|_| uniform()).sum::<f32>() * 3f32.sqrt()).collect();
    let mean = table.iter().sum::<f32>() / NOISE as f32;
    table.iter_mut().for_each(|v| *v -= mean);
    table
}

/// Hashes a 32-bit integer (Wellons, "Prospecting for Hash Functions", lowbias32).
fn scramble(mut x: u32) -> u32 {
    x ^= x >> 16;
    x = x.wrapping_mul(0x7feb_352d);
    x ^= x >> 15;
    x = x.wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}
