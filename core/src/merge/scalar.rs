//! The scalar merge: any samples, one at a time, in floats.

use super::{Channels, Codes, GAIN_BITS, MergeLoop, MergeView};

impl MergeView<'_> {
    /// Merges any samples into float radiances in units of [`Merge::unit`]. Returns whether a sample may be clipped.
    ///
    /// Samples beyond the end of a frame count as code 0.
    pub fn samples(&self, codes: &[Codes<'_>], channels: Channels, out: &mut [f32]) -> bool {
        let mut doubtful = true;
        if let MergeLoop::Table(scale) = &self.parameters.merge_loop
            && scale.whole.is_none()
        {
            self.tables(scale).floats(codes, channels, self.reciprocals, out);
            doubtful = false;
        }
        let mut unusual = false;
        for (at, value) in out.iter_mut().enumerate() {
            if doubtful || value.is_nan() {
                *value = self.sample(codes, channels.of(at), at);
                unusual = true;
            }
        }
        unusual
    }

    /// Returns the radiance of sample `at` by the rules of the module's documentation, without vectors or tables.
    fn sample(&self, codes: &[Codes<'_>], channel: usize, at: usize) -> f32 {
        let (mut sum, mut valid, mut longest) = (0i32, 0usize, None);
        let read = codes.iter().enumerate().take(self.parameters.count).filter(|(_, c)| c.is_read());
        for (i, samples) in read {
            let code = samples.code(at);
            if self.curve.is_saturated(code) {
                continue;
            }
            let y = self.exposure(channel, code, i);
            longest = Some((i, y));
            if self.curve.is_trusted(code) {
                sum += y;
                valid |= 1 << i;
            }
        }
        if valid != 0 {
            return self.radiance(sum, valid);
        }
        if let Some((i, y)) = longest {
            return self.radiance(y, 1 << i);
        }
        let shortest = codes.iter().position(Codes::is_read).unwrap_or(0);
        self.radiance(
            codes.get(shortest).map_or(0, |c| self.exposure(channel, c.code(at), shortest)),
            1 << shortest,
        )
    }

    /// Returns the relative exposure of `code` in exposure `i`, divided by the gain of the exposure, with 27 fraction bits.
    fn exposure(&self, channel: usize, code: u32, i: usize) -> i32 {
        let y = i64::from(self.curve.exposure_q27(channel, code));
        ((y * i64::from(self.parameters.inverse_gain.get(i).copied().unwrap_or(0))) >> GAIN_BITS) as i32
    }

    /// Returns the radiance of a sample whose relative exposures over the exposures in `mask` add up to `sum`.
    fn radiance(&self, sum: i32, mask: usize) -> f32 {
        let factor = self.reciprocals.get(mask).map_or(0.0, |r| r.factor);
        sum as f32 * self.parameters.plain * factor
    }
}
