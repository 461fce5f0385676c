//! Mean exposures of the rows of the last bursts: a change of the light or of the exposures repeats in the next bursts, a false frame does not.
//! Each frame is compared alone: lamps on the mains flicker in the shorter exposures, while the longer ones repeat.

use super::jump::JUMP;
use super::levels::{Seen, is_same};
use super::samples::ROWS;
use hemilux_core::MAX_EXPOSURES;

/// Number of stored bursts, and number of them whose frame a frame must equal to count as repeated. Two equal false bursts in a row are not rare
/// where a hundredth of the bursts has each kind of fault.
const STORED: usize = 4;
const REPEATS: usize = 2;

/// Stated exposures and row means of the frames of one burst.
#[derive(Clone, Copy, Debug, Default)]
struct Means {
    frames: usize,
    lights: [f64; MAX_EXPOSURES],
    rows: [[f32; ROWS]; MAX_EXPOSURES],
}

impl Means {
    /// Computes the means of the frames of `seen`; a mean below `floor` counts as `floor`.
    fn of(seen: &Seen<'_>, floor: f32) -> Self {
        let mut means = Self { frames: seen.lights.len(), ..Self::default() };
        for (index, (light, sampled)) in seen.lights.iter().zip(seen.sampled).enumerate() {
            means.lights[index] = *light;
            for (mean, row) in means.rows[index].iter_mut().zip(sampled.rows()) {
                *mean = (row.iter().sum::<f32>() / row.len().max(1) as f32).max(floor);
            }
        }
        means
    }

    /// Returns true if all exposures are equal and no row of the frame `index` differs by more than [`JUMP`].
    fn have_equal(&self, other: &Self, index: usize) -> bool {
        let mut lights = self.lights.iter().zip(&other.lights).take(self.frames);
        let mut rows = self.rows[index].iter().zip(&other.rows[index]);
        self.frames == other.frames
            && lights.all(|(a, b)| is_same(*a, *b))
            && rows.all(|(a, b)| (JUMP.recip()..JUMP).contains(&(a / b)))
    }
}

/// Row means of the last bursts, newest first.
#[derive(Debug, Default)]
pub(super) struct Recent([Means; STORED]);

impl Recent {
    /// Stores the means of a burst; returns one bit for each frame, set if the frame equals that of [`REPEATS`] of the last bursts.
    pub fn add(&mut self, seen: &Seen<'_>, floor: f32) -> u16 {
        let means = Means::of(seen, floor);
        let equal = |index: usize| self.0.iter().filter(|earlier| means.have_equal(earlier, index)).count();
        let repeated = (0..means.frames.min(MAX_EXPOSURES)).filter(|index| equal(*index) >= REPEATS);
        let repeated = repeated.fold(0, |bits, index| bits | 1 << index);
        self.0.rotate_right(1);
        self.0[0] = means;
        repeated
    }
}
