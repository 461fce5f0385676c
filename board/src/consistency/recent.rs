//! Mean exposures of the rows of the last bursts: a change of the light or of the exposures repeats in the next bursts, a false frame does not.

use super::jump::JUMP;
use super::levels::{Seen, is_same};
use super::samples::ROWS;
use hemilux_core::MAX_EXPOSURES;

/// Number of stored bursts, and number of them that a burst must equal to count as repeated. Two equal false bursts in a row are not rare
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

    /// Returns true if all exposures are equal and no row differs by more than [`JUMP`].
    fn equals(&self, other: &Self) -> bool {
        let are_same = |a: &[f32; ROWS], b: &[f32; ROWS]| {
            a.iter().zip(b).all(|(a, b)| (JUMP.recip()..JUMP).contains(&(a / b)))
        };
        let mut lights = self.lights.iter().zip(&other.lights).take(self.frames);
        self.frames == other.frames
            && lights.all(|(a, b)| is_same(*a, *b))
            && self.rows.iter().zip(&other.rows).take(self.frames).all(|(a, b)| are_same(a, b))
    }
}

/// Row means of the last bursts, newest first.
#[derive(Debug, Default)]
pub(super) struct Recent([Means; STORED]);

impl Recent {
    /// Returns true if the burst equals [`REPEATS`] of the last bursts, and stores its means.
    pub fn repeats(&mut self, seen: &Seen<'_>, floor: f32) -> bool {
        let means = Means::of(seen, floor);
        let equal = self.0.iter().filter(|earlier| means.equals(earlier)).count();
        self.0.rotate_right(1);
        self.0[0] = means;
        equal >= REPEATS
    }
}
