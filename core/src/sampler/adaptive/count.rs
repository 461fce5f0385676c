//! Selection of the number of lights for a tolerance: a search in one frame, then hysteresis.

use core::ops::RangeInclusive;

/// Ratio of the estimated error to the tolerance above which the number of lights is increased.
const TOO_MUCH: f32 = 1.1;

/// Ratio of the estimated error to the tolerance below which, for [`PATIENCE`] frames, a smaller number of lights is tried.
const LITTLE: f32 = 0.85;

/// Ratio of the estimated error to the tolerance below which a smaller number of lights is accepted. Between this ratio and [`TOO_MUCH`],
/// the number does not change.
const ACCEPTED: f32 = 0.95;

/// Number of frames between two trials of a smaller number of lights.
const PATIENCE: u32 = 16;

/// The number of lights that was selected for a tolerance.
#[derive(Clone, Copy, Debug)]
struct Selected {
    tolerance: f32,
    lights: usize,
}

/// The selected number of lights, kept from frame to frame.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Count {
    known: Option<Selected>,
    /// The estimated error of the last frame, a ratio.
    error: f32,
    /// Number of successive frames with a ratio of error to tolerance below [`LITTLE`].
    calm: u32,
}

impl Count {
    /// Returns the number of lights for this frame, one of `within`; `error` returns the error of a number of lights.
    pub(super) fn choose(
        &mut self,
        tolerance: f32,
        within: RangeInclusive<usize>,
        mut error: impl FnMut(usize) -> f32,
    ) -> usize {
        let count = match self.known {
            Some(Selected { tolerance: t, lights: n }) if t == tolerance && within.contains(&n) => {
                if self.error > TOO_MUCH * tolerance {
                    fewest(tolerance, n..=*within.end(), &mut error)
                } else if self.calm >= PATIENCE {
                    self.calm = 0;
                    let fewer = [n - (n / 8).max(1).min(n), n.saturating_sub(1)];
                    fewer
                        .into_iter()
                        .find(|m| (*within.start()..n).contains(m) && error(*m) <= ACCEPTED * tolerance)
                        .unwrap_or(n)
                } else {
                    n
                }
            }
            _ => fewest(tolerance, within, &mut error),
        };
        self.known = Some(Selected { tolerance, lights: count });
        count
    }

    /// Stores the estimated error of the frame's lights.
    pub(super) fn note(&mut self, error: f32) {
        let little = self.known.is_some_and(|known| error < LITTLE * known.tolerance);
        self.calm = if little { self.calm + 1 } else { 0 };
        self.error = error;
    }

    pub(super) fn reset(&mut self) {
        *self = Self::default();
    }
}

/// Returns the least number of lights in `within` whose error is at most `tolerance`, or the largest of `within`: doubling, then bisection.
fn fewest(tolerance: f32, within: RangeInclusive<usize>, error: &mut impl FnMut(usize) -> f32) -> usize {
    let (least, most) = within.into_inner();
    let (mut low, mut high) = (least, least);
    while high < most && error(high) > tolerance {
        low = high + 1;
        high = (2 * high).max(high + 1).min(most);
    }
    while low < high {
        let middle = low + (high - low) / 2;
        if error(middle) <= tolerance {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    high
}

#[cfg(test)]
mod tests {
    use super::{Count, fewest};

    #[test]
    fn the_fewest_lights_within_the_tolerance_are_found() {
        for tolerance in [0.5, 0.1, 0.02, 0.001] {
            let error = |n: usize| 1.0 / (n as f32 + 1.0);
            let found = fewest(tolerance, 0..=4096, &mut { error });
            let expected = (0..4096).find(|n| error(*n) <= tolerance).expect("within reach");
            assert_eq!(found, expected, "{tolerance}");
        }
        assert_eq!(fewest(0.1, 1..=64, &mut |_| 1.0), 64, "out of reach: as many as there may be");
        assert_eq!(fewest(0.1, 0..=64, &mut |_| 0.0), 0);
    }

    #[test]
    fn a_number_is_kept_if_one_light_less_exceeds_the_tolerance() {
        // In this test, two lights have a small error and one light too large an error: repeated trials of one light would make the number
        // oscillate.
        let error = |n: usize| if n < 2 { 0.05 } else { 0.01 };
        let mut count = Count::default();
        for _ in 0..200 {
            let n = count.choose(0.03, 0..=64, error);
            assert_eq!(n, 2);
            count.note(error(n));
        }
    }

    #[test]
    fn noise_on_the_error_does_not_change_the_number() {
        let mut count = Count::default();
        let first = count.choose(0.03, 0..=64, |n| 0.6 / n as f32);
        for frame in 0..200 {
            let noise = 1.0 + 0.04 * if frame % 3 == 0 { 1.0 } else { -1.0 };
            let n = count.choose(0.03, 0..=64, |n| noise * 0.6 / n as f32);
            assert_eq!(n, first, "frame {frame}");
            count.note(noise * 0.6 / n as f32);
        }
    }
}
