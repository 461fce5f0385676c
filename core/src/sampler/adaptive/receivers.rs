//! The shadowed error by the definition of the score: net irradiance of the lights and the map at 512 receivers with occluding cones.
//!
//! The receivers are those of the score, [`crate::receiver`]. The map is approximated by the discs of [`super::source`], of which the edge
//! of a cone may hide a part. The arithmetic is in integers, so that the loop vectorises: directions in Q14, energies as shares in Q18.

use crate::receiver::{self, SHADOWED as RECEIVERS, Shadowed};
use glam::Vec3;

/// Largest number of points whose light is received: sources, lights and quads of ambient light.
const POINTS: usize = 2 * super::source::SOURCES + super::ambient::QUADS;

/// Number of receivers that are evaluated in a frame that continues the last one: a sixteenth, so that sixteen frames evaluate all.
const TURN: usize = RECEIVERS / 16;

/// Largest product of points and receivers in one frame, which bounds the time of the first frame after a cut.
const MOST: usize = 1 << 19;

/// Step between the indices of successively evaluated receivers, which visits all of them with evenly spread directions.
const STRIDE: usize = 197;

/// Mean over receivers of max(0, n . d) V(d): 1/4 times the fraction of the sphere outside of the mean cone.
const MEAN: f32 = 0.224_17;

/// Scale of energies, which are stored as fractions of the map's light.
const SHARE: f32 = (1u32 << 18) as f32;

/// A shadowed receiver in fixed point: normal and axis in Q14.
#[derive(Clone, Copy, Debug, Default)]
struct Receiver {
    normal: [i16; 3],
    axis: [i16; 3],
    /// Cosine of the half-angle of the occluding cone, Q28.
    cos: i32,
    /// Reciprocal of the sine of the cone's half-angle, Q12, which converts differences of cosines near the edge to angles.
    per_sin: i32,
}

/// The receivers, and the points whose light they receive: sources of positive energy, lights of negative energy.
#[derive(Clone, Debug)]
pub(super) struct Receivers {
    receivers: [Receiver; RECEIVERS],
    /// Latest errors of the receivers in the order of [`STRIDE`], relative to the mean irradiance.
    errors: [f32; RECEIVERS],
    /// Index of the next receiver to evaluate, and number of receivers with a known error.
    next: usize,
    known: usize,
    /// Directions of the points, Q14: x in the upper and y in the lower half of a number.
    across: [i32; POINTS],
    /// Direction of each point, Q14: z in the upper half. Lower half: reciprocal of the disc's diameter, in Q12 per Q14 of angle, Q8.
    up: [i32; POINTS],
    energies: [i32; POINTS],
    points: usize,
}

impl Receivers {
    pub(super) const fn new() -> Self {
        Self {
            receivers: [Receiver { normal: [0; 3], axis: [0; 3], cos: 0, per_sin: 0 }; RECEIVERS],
            errors: [0.0; RECEIVERS],
            next: 0,
            known: 0,
            across: [0; POINTS],
            up: [0; POINTS],
            energies: [0; POINTS],
            points: 0,
        }
    }

    /// Initialises the receivers and discards their errors.
    pub(super) fn prepare(&mut self) {
        for (k, receiver) in self.receivers.iter_mut().enumerate() {
            *receiver = receiver_at(k);
        }
        (self.next, self.known, self.points) = (0, 0, 0);
    }

    pub(super) fn clear(&mut self) {
        self.points = 0;
    }

    /// Adds a disc of `radius` radians at the unit vector `at`; `share` is its fraction of the map's light, negative for lights.
    pub(super) fn add(&mut self, at: Vec3, radius: f32, share: f32) {
        let i = self.points;
        if i < POINTS {
            let [x, y, z] = fixed(at);
            self.across[i] = pair(x, y);
            self.up[i] = pair(z, (32.0 / radius.max(1e-3)) as i16);
            self.energies[i] = nearest(share * SHARE);
            self.points += 1;
        }
    }

    /// Evaluates all receivers, or as many as [`MOST`] allows; returns the RMS of their errors, relative to the mean irradiance.
    pub(super) fn evaluate_all(&mut self) -> f32 {
        self.known = 0;
        self.evaluate(RECEIVERS.min(MOST / self.points.max(1)).max(TURN))
    }

    /// Evaluates the next [`TURN`] receivers and returns the RMS over their errors and the stored errors of the others.
    pub(super) fn evaluate_next(&mut self) -> f32 {
        self.evaluate(TURN)
    }

    fn evaluate(&mut self, count: usize) -> f32 {
        for _ in 0..count {
            let receiver = self.receivers[(self.next * STRIDE) % RECEIVERS];
            self.errors[self.next % RECEIVERS] = self.received(&receiver) as f32 / (SHARE * 4096.0 * MEAN);
            self.next = (self.next + 1) % RECEIVERS;
            self.known = (self.known + 1).min(RECEIVERS);
        }
        // Only the last `known` receivers up to `next` have an error.
        let first = self.next + RECEIVERS - self.known;
        let sum: f32 = (first..first + self.known).map(|k| self.errors[k % RECEIVERS]).map(|e| e * e).sum();
        libm::sqrtf(sum / self.known.max(1) as f32)
    }

    /// Returns the net irradiance of the receiver `to`, Q30.
    fn received(&self, to: &Receiver) -> i32 {
        let n = self.points.min(POINTS);
        let (across, up, energies) = (&self.across[..n], &self.up[..n], &self.energies[..n]);
        let mut sum = 0i32;
        for i in 0..n {
            let [[x, y], [z, slope]] = [across[i], up[i]].map(halves);
            let along = |v: [i16; 3]| {
                let [a, b, c] = v.map(i32::from);
                x * a + y * b + z * c
            };
            // The irradiance is converted from Q28 to Q12.
            let facing = along(to.normal).max(0) >> 16;
            // First the angle from the edge of the cone, Q14, then the fraction of the disc that is outside of the cone, Q12.
            let outside =
                (((to.cos - along(to.axis)) >> 14).wrapping_mul(to.per_sin) >> 12).clamp(-0x7fff, 0x7fff);
            let clear = (2048 + (outside.wrapping_mul(slope) >> 8)).clamp(0, 4096);
            sum = sum.wrapping_add(energies[i].wrapping_mul((facing * clear) >> 12));
        }
        sum
    }
}

/// Returns shadowed receiver `k` in fixed point.
fn receiver_at(k: usize) -> Receiver {
    let Shadowed { normal, axis, half_angle } = receiver::shadowed(k);
    Receiver {
        normal: fixed(normal),
        axis: fixed(axis),
        cos: (libm::cos(half_angle) * f64::from(1u32 << 28)) as i32,
        per_sin: (4096.0 / libm::sin(half_angle)) as i32,
    }
}

/// Returns a number with `upper` and `lower` as its halves. Loads of whole numbers vectorise on ARMv7; those of 16 bits go through the stack.
fn pair(upper: i16, lower: i16) -> i32 {
    i32::from(upper) << 16 | i32::from(lower as u16)
}

/// Returns the upper and the lower half of the number `pair`.
fn halves(pair: i32) -> [i32; 2] {
    [pair >> 16, pair << 16 >> 16]
}

/// Returns the unit vector `v` in Q14.
fn fixed(v: Vec3) -> [i16; 3] {
    v.to_array().map(|c| nearest(c * 16384.0) as i16)
}

/// Returns the integer nearest to `v`.
fn nearest(v: f32) -> i32 {
    (v + 0.5f32.copysign(v)) as i32
}
