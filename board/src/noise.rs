//! The noise model of a linear sensor: read noise, gain and dark level, measured by photon transfer or assumed.

/// Noise of one sample, codes: variance = `read`^2 + `gain` x (code - `dark`).
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Noise {
    /// Read noise including quantisation noise, codes RMS.
    pub read: f64,
    /// Gain of the sensor, codes per electron.
    pub gain: f64,
    /// Dark level of the sensor: mean code without light.
    pub dark: f64,
}

/// Least number of bins with enough samples that a measurement needs.
const LEAST_BINS: usize = 6;

/// Least number of samples in a bin that the fit uses.
const LEAST_SAMPLES: u32 = 200;

/// Number of bins of mean codes between the dark level and saturation.
const BINS: usize = 64;

/// Sums over the samples whose mean of two frames lies in one bin.
#[derive(Clone, Copy, Debug, Default)]
struct Bin {
    count: u32,
    mean: f64,
    squares: f64,
}

/// A photon-transfer measurement: variance against mean of the samples in pairs of frames of a still scene with equal exposures.
#[derive(Clone, Debug)]
pub struct PhotonTransfer {
    dark: f64,
    saturated: f64,
    bins: [Bin; BINS],
}

impl PhotonTransfer {
    /// Creates an empty measurement of a sensor whose codes are linear from `dark` to `saturated`.
    #[must_use]
    pub fn new(dark: f64, saturated: f64) -> Self {
        Self { dark, saturated, bins: [Bin::default(); BINS] }
    }

    /// Adds the samples, codes, of the same pixels in two frames that were taken one after the other.
    pub fn add(&mut self, pairs: impl Iterator<Item = (f64, f64)>) {
        let width = (self.saturated - self.dark) / BINS as f64;
        for (a, b) in pairs {
            let mean = 0.5 * (a + b);
            let at = (mean - self.dark) / width;
            // The noise of samples near either end of the code range is clipped.
            if at < 0.0 || a.max(b) >= self.saturated || a.min(b) <= 0.0 {
                continue;
            }
            if let Some(bin) = self.bins.get_mut(at as usize) {
                bin.count += 1;
                bin.mean += mean - self.dark;
                // The difference of two samples has twice the variance of one sample.
                bin.squares += 0.5 * (a - b) * (a - b);
            }
        }
    }

    /// Returns true if `bin` has enough samples and its mean is at least four standard deviations away from both ends of the code range.
    fn is_whole(&self, bin: &Bin) -> bool {
        let n = f64::from(bin.count);
        let (code, reach) = (self.dark + bin.mean / n, 4.0 * (bin.squares / n).sqrt());
        bin.count >= LEAST_SAMPLES && code - reach > 0.0 && code + reach < self.saturated
    }

    /// Fits a line to variance against mean; `None` for scenes whose samples fill too few bins, or whose variance does not rise.
    ///
    /// The weight of a bin is its count divided by its squared variance: the inverse variance of a measured variance.
    #[must_use]
    pub fn noise(&self) -> Option<Noise> {
        let filled = || self.bins.iter().filter(|bin| self.is_whole(bin));
        if filled().count() < LEAST_BINS {
            return None;
        }
        let points = || {
            filled().map(|bin| {
                let n = f64::from(bin.count);
                let variance = bin.squares / n;
                [n / variance.max(1e-6).powi(2), bin.mean / n, variance]
            })
        };
        let sum = |of: &dyn Fn([f64; 3]) -> f64| points().map(of).sum::<f64>();
        let w = sum(&|[w, ..]| w);
        let (x, y) = (sum(&|[w, x, _]| w * x) / w, sum(&|[w, _, y]| w * y) / w);
        let spread = sum(&|[w, x0, _]| w * (x0 - x) * (x0 - x));
        let slope = sum(&|[w, x0, y0]| w * (x0 - x) * (y0 - y)) / spread;
        let floor = y - slope * x;
        let is_sound = slope.is_finite() && slope > 0.0;
        is_sound.then(|| Noise { read: floor.max(0.0).sqrt(), gain: slope, dark: self.dark })
    }
}

impl Noise {
    /// Returns the noise that is assumed for an unknown sensor with `codes` codes between black and white: a full well of 5,000 electrons,
    /// read noise of 8 electrons, and quantisation noise.
    #[must_use]
    pub fn assumed(dark: f64, codes: f64) -> Self {
        let gain = codes / 5_000.0;
        Self { read: (64.0 * gain * gain + 1.0 / 12.0).sqrt(), gain, dark }
    }

    /// Returns the standard deviation, in codes, of a sample that is `above` codes above the dark level.
    #[must_use]
    pub fn deviation(&self, above: f64) -> f64 {
        (self.read * self.read + self.gain * above.max(0.0)).sqrt()
    }

    /// Returns the number of codes above the dark level at which a sample is `ratio` times its standard deviation.
    #[must_use]
    pub fn codes_at(&self, ratio: f64) -> f64 {
        let half = 0.5 * ratio * ratio * self.gain;
        half + (half * half + ratio * ratio * self.read * self.read).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns two frames of a ramp with `read` codes of read noise and `gain` codes per electron, rounded to codes. A sum of twelve uniform
    /// deviates approximates a normal deviate.
    fn pairs(read: f64, gain: f64, dark: f64, white: f64) -> Vec<(f64, f64)> {
        let mut state = 7u64;
        let mut uniform = || {
            // The random numbers are those of the generator MMIX of [Knuth1997].
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 32) as f64 / 4_294_967_296.0
        };
        let mut normal = || (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
        let mut code = |mean: f64| {
            let own = mean + (read * read + gain * mean).sqrt() * normal() + dark;
            own.round().clamp(0.0, white)
        };
        let ramp = (0..200_000).map(|i| (white - dark) * f64::from(i) / 200_000.0);
        ramp.map(|mean| (code(mean), code(mean))).collect()
    }

    #[test]
    fn read_noise_and_gain_are_found_within_a_tenth() {
        for (read, gain, dark, white) in
            [(0.9, 0.025, 8.0, 255.0), (2.5, 0.2, 64.0, 1023.0), (6.0, 0.6, 256.0, 4095.0)]
        {
            let mut transfer = PhotonTransfer::new(dark, 0.95 * white);
            transfer.add(pairs(read, gain, dark, white).into_iter());
            let found = transfer.noise().expect("a line");
            // Rounding to codes adds a variance of 1/12 code².
            let read = (read * read + 1.0 / 12.0).sqrt();
            assert!((found.read / read - 1.0).abs() < 0.1, "{found:?}, expected read noise {read}");
            assert!((found.gain / gain - 1.0).abs() < 0.1, "{found:?}, expected gain {gain}");
        }
    }

    #[test]
    fn a_scene_of_uniform_brightness_returns_no_noise() {
        let mut transfer = PhotonTransfer::new(8.0, 250.0);
        transfer.add((0..100_000).map(|i| (f64::from(100 + i % 3), 101.0)));
        assert_eq!(transfer.noise(), None, "one bin");
    }

    #[test]
    fn codes_at_a_ratio_have_that_ratio_to_their_deviation() {
        let noise = Noise { read: 0.9, gain: 0.025, dark: 8.0 };
        for ratio in [1.0, 3.0, 10.0] {
            let codes = noise.codes_at(ratio);
            assert!((codes / noise.deviation(codes) - ratio).abs() < 1e-9, "{ratio}");
        }
    }
}
