//! Smooths directions without delaying them: exponential smoothing whose gain is a tracking signal.
//!
//! With nu the step from a light's filtered to its new direction, s the running mean of nu and a that of |nu|, the gain is
//! (|s| / a)^2. Noise points everywhere, so s stays small beside a and the gain is about beta / (2 - beta); motion keeps its
//! direction, so s grows to a and the gain to 1. A step beyond [`JUMP`] times a is followed at once. The signal is Trigg and Leach's
//! (1967); its square and the jump are ours.

use crate::light::Light;
use glam::Vec3;

/// Weight beta of a new step in both running means: the gain on noise is about 0.11, and motion is recognised in some five frames.
const MEMORY: f32 = 0.2;

/// Steps this many times longer than the mean step are jumps: of normal noise one in ten thousand.
const JUMP: f32 = 4.0;

/// What the filter knows of a light.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Track {
    /// Direction as given last.
    direction: Vec3,
    /// Running mean of the steps.
    mean: Vec3,
    /// Running mean of the steps' lengths.
    length: f32,
}

/// Replaces the lights' directions by filtered ones and carries their ages; old and new lights ascend by id.
pub(super) fn follow(lights: &mut [Light], tracks: &mut [Track], (old, old_tracks): (&[Light], &[Track])) {
    let mut past = old.iter().zip(old_tracks).peekable();
    for (light, track) in lights.iter_mut().zip(tracks) {
        while past.next_if(|(o, _)| o.id < light.id).is_some() {}
        *track = Track { direction: light.direction, ..Track::default() };
        if let Some((o, known)) = past.next_if(|(o, _)| o.id == light.id) {
            light.age = o.age.saturating_add(1);
            *track = known.step(light.direction);
            light.direction = track.direction;
        }
    }
}

impl Track {
    fn step(&self, seen: Vec3) -> Self {
        let step = seen - self.direction;
        let size = step.length();
        if size > JUMP * self.length {
            // Whether it was one jump or the begin of a motion shows in the next frames.
            let length = if self.length > 0.0 { self.length } else { size };
            return Self { direction: seen, mean: step * (length / size), length };
        }
        let mean = self.mean + (step - self.mean) * MEMORY;
        let length = self.length + (size - self.length) * MEMORY;
        let signal = if length > 0.0 { (mean.length() / length).min(1.0) } else { 1.0 };
        let direction = (self.direction + step * (signal * signal)).try_normalize().unwrap_or(seen);
        Self { direction, mean, length }
    }
}
