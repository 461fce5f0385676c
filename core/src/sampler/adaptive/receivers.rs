//! The shadowed error as it is scored: what the lights and the map give to 512 receivers with occluding cones.
//!
//! The receivers are those of the score, [`crate::receiver`]. The map is approximated by the discs of [`super::source`], of which a cone's
//! edge may hide a part. All in integers, so that the loop vectorises: directions in Q14, energies as shares in Q18.

use crate::receiver::{self, SHADOWED as RECEIVERS, Shadowed};
use glam::Vec3;

/// Most points: sources, lights and quads of ambient light.
const POINTS: usize = 2 * super::source::SOURCES + super::ambient::QUADS;

/// Receivers evaluated in a frame that continues the last one: all of them in sixteen frames.
const TURN: usize = RECEIVERS / 16;

/// Points times receivers in one frame: more, and the first frame after a cut would take several times as long as any other.
const MOST: usize = 1 << 19;

/// From one receiver to the next: a step that leads to all of them, by way of all directions.
const STRIDE: usize = 197;

/// Mean over receivers of max(0, n . d) V(d): 1/4 times the share of the sphere outside the mean cone.
const MEAN: f32 = 0.224_17;

/// Energies as shares of the map's light.
const SHARE: f32 = (1u32 << 18) as f32;

#[derive(Clone, Copy, Debug, Default)]
struct Receiver {
    normal: [i16; 3],
    axis: [i16; 3],
    /// Cosine of the cone's half-angle, Q28.
    cos: i32,
    /// 1 / sine of it, Q12: turns differences of cosines near the edge into angles.
    per_sin: i32,
}

/// The receivers, and the points that they receive: sources of positive energy, lights of negative energy.
#[derive(Clone, Debug)]
pub(super) struct Receivers {
    receivers: [Receiver; RECEIVERS],
    /// The errors of the receivers in the order of [`STRIDE`], as they were found last, over the mean.
    errors: [f32; RECEIVERS],
    /// The receiver to evaluate next, and the number of receivers whose error is known.
    next: usize,
    known: usize,
    axes: [[i16; POINTS]; 3],
    energies: [i32; POINTS],
    /// 1 / diameter, in Q12 per Q14 of angle, Q8.
    slopes: [i32; POINTS],
    points: usize,
}

impl Receivers {
    pub(super) const fn new() -> Self {
        Self {
            receivers: [Receiver { normal: [0; 3], axis: [0; 3], cos: 0, per_sin: 0 }; RECEIVERS],
            errors: [0.0; RECEIVERS],
            next: 0,
            known: 0,
            axes: [[0; POINTS]; 3],
            energies: [0; POINTS],
            slopes: [0; POINTS],
            points: 0,
        }
    }

    /// Places the receivers and discards their errors.
    pub(super) fn prepare(&mut self) {
        for (k, receiver) in self.receivers.iter_mut().enumerate() {
            *receiver = receiver_at(k);
        }
        (self.next, self.known, self.points) = (0, 0, 0);
    }

    pub(super) fn clear(&mut self) {
        self.points = 0;
    }

    /// Adds a disc at the unit vector `at` of `radius` radians; `share` of the map's light, negative for what stands in its place.
    pub(super) fn add(&mut self, at: Vec3, radius: f32, share: f32) {
        let i = self.points;
        if i < POINTS {
            for (axis, v) in self.axes.iter_mut().zip(fixed(at)) {
                axis[i] = v;
            }
            self.energies[i] = nearest(share * SHARE);
            self.slopes[i] = (32.0 / radius.max(1e-3)) as i32;
            self.points += 1;
        }
    }

    /// Evaluates all receivers, or as many as [`MOST`] allows; returns the RMS of their errors over the mean irradiance.
    pub(super) fn look(&mut self) -> f32 {
        self.known = 0;
        self.go_on(RECEIVERS.min(MOST / self.points.max(1)).max(TURN))
    }

    /// Like [`Receivers::look`], but evaluates [`TURN`] more receivers and keeps the known errors of the others.
    pub(super) fn turn(&mut self) -> f32 {
        self.go_on(TURN)
    }

    fn go_on(&mut self, count: usize) -> f32 {
        for _ in 0..count {
            let receiver = self.receivers[(self.next * STRIDE) % RECEIVERS];
            self.errors[self.next % RECEIVERS] = self.received(&receiver) as f32 / (SHARE * 4096.0 * MEAN);
            self.next = (self.next + 1) % RECEIVERS;
            self.known = (self.known + 1).min(RECEIVERS);
        }
        // The last `known` up to `next`.
        let first = self.next + RECEIVERS - self.known;
        let sum: f32 = (first..first + self.known).map(|k| self.errors[k % RECEIVERS]).map(|e| e * e).sum();
        libm::sqrtf(sum / self.known.max(1) as f32)
    }

    /// Net irradiance of a receiver, Q30.
    fn received(&self, to: &Receiver) -> i32 {
        let n = self.points.min(POINTS);
        let [x, y, z] = [&self.axes[0][..n], &self.axes[1][..n], &self.axes[2][..n]];
        let (energies, slopes) = (&self.energies[..n], &self.slopes[..n]);
        let mut sum = 0i32;
        for i in 0..n {
            let along = |v: [i16; 3]| {
                let [a, b, c] = v.map(i32::from);
                i32::from(x[i]) * a + i32::from(y[i]) * b + i32::from(z[i]) * c
            };
            // Q28 to Q12.
            let facing = along(to.normal).max(0) >> 16;
            // Angle from the cone's edge, Q14, then the part of the disc that is clear of the cone, Q12.
            let outside =
                (((to.cos - along(to.axis)) >> 14).wrapping_mul(to.per_sin) >> 12).clamp(-0x7fff, 0x7fff);
            let clear = (2048 + (outside.wrapping_mul(slopes[i]) >> 8)).clamp(0, 4096);
            sum = sum.wrapping_add(energies[i].wrapping_mul((facing * clear) >> 12));
        }
        sum
    }
}

/// Receiver `k`.
fn receiver_at(k: usize) -> Receiver {
    let Shadowed { normal, axis, half_angle } = receiver::shadowed(k);
    Receiver {
        normal: fixed(normal),
        axis: fixed(axis),
        cos: (libm::cos(half_angle) * f64::from(1u32 << 28)) as i32,
        per_sin: (4096.0 / libm::sin(half_angle)) as i32,
    }
}

/// A unit vector in Q14.
fn fixed(v: Vec3) -> [i16; 3] {
    v.to_array().map(|c| nearest(c * 16384.0) as i16)
}

/// The nearest integer.
fn nearest(v: f32) -> i32 {
    (v + 0.5f32.copysign(v)) as i32
}
