//! Detection of motion in the map: the quads with moving light, and whether the scene moves.
//!
//! A light that represents a moving source has a new error in every frame, which is visible as flicker, so quads with moving light get more
//! lights. While no quad moves, all changes are noise, and the filters may smooth them.

use crate::healpix::{Domain, Order};
use crate::pyramid::{PyramidView, pyramid_len};
use crate::root::root;
use glam::Vec3;

/// HEALPix order of the quads in which motion is detected: 7 degrees.
const ORDER: u8 = 3;

const QUADS: usize = Domain::Sphere.quads(ORDER);
const SUMS: usize = pyramid_len(Domain::Sphere, Order::saturating(ORDER));

/// Largest factor on the importance of a quad with moving light. Of 2, 3, 5 and 9, 3 gives the least flicker per error over moving lamps.
const MOST: f32 = 3.0;

/// Step of a quad's first moment from frame to frame, relative to its energy, above which the step counts as motion, and the step of full
/// motion.
const STEP: (f32, f32) = (0.025, 0.25);

/// Gains per frame with which the factor of a quad rises and falls: a rise takes one frame, so that former splits do not delay it.
const RISE_AND_FALL: (f32, f32) = (1.0, 0.5);

/// Relative change of a quad's fraction of the light above which the change is not noise.
const CHANGE: f32 = 0.08;

/// Fraction of the light that changing quads must have for the scene to count as moving.
const MOVED: f32 = 0.003;

/// Ratio of the mean square of steps over two frames to that of steps over one frame, above which the scene moves slowly: the ratio is 1
/// for noise and 4 for uniform motion.
const DRIFT: f32 = 1.6;

/// Number of frames for which a scene counts as moving after the last detected motion.
const AFTER: u32 = 2;

/// State of a quad in the last two frames, as fractions of the map's light.
#[derive(Clone, Copy, Debug, Default)]
struct QuadHistory {
    y: f32,
    moment: Vec3,
    /// Luminance energy of the quad two frames ago, as a fraction of the map's.
    y_before: f32,
}

/// Histories of the quads, and the factors derived from them.
#[derive(Clone, Debug)]
pub(super) struct Activity {
    past: [QuadHistory; QUADS],
    /// Factors on the importance of the quads of all orders up to [`ORDER`]; a coarse quad has the largest factor of its children.
    factor: [f32; SUMS],
    /// Number of frames that have been processed.
    frames: u32,
    /// Number of frames after which the scene counts as at rest if no motion is detected.
    moving: u32,
}

impl Activity {
    pub(super) const fn new() -> Self {
        let none = QuadHistory { y: 0.0, moment: Vec3::ZERO, y_before: 0.0 };
        Self { past: [none; QUADS], factor: [1.0; SUMS], frames: 0, moving: 0 }
    }

    pub(super) fn reset(&mut self) {
        self.factor = [1.0; SUMS];
        (self.frames, self.moving) = (0, 0);
    }

    /// Processes the next frame; returns true if the scene moves. Maps coarser than order 3 always count as at rest.
    pub(super) fn update(&mut self, map: &PyramidView<'_>) -> bool {
        let whole = map.total().y();
        if map.order().get() < ORDER || whole <= 0.0 {
            return false;
        }
        let (mut moved, mut one, mut two) = (0.0f32, 0.0f32, 0.0f32);
        for (ipix, (past, quad)) in self.past.iter_mut().zip(map.quads_of(ORDER)).enumerate() {
            let (y, moment) = (quad.y() / whole, quad.first_moment() / whole);
            let most = y.max(past.y);
            if most > 0.0 {
                let (step, two_steps) = ((y - past.y) / most, (y - past.y_before) / most);
                if step.abs() > CHANGE {
                    moved += most;
                } else {
                    one += step * step;
                    two += two_steps * two_steps;
                }
                let motion = (length(moment - past.moment) / most - STEP.0) / (STEP.1 - STEP.0);
                let aim = if self.frames > 0 { 1.0 + (MOST - 1.0) * motion.clamp(0.0, 1.0) } else { 1.0 };
                let factor = &mut self.factor[at(ORDER, ipix)];
                *factor += (aim - *factor) * if aim > *factor { RISE_AND_FALL.0 } else { RISE_AND_FALL.1 };
            }
            *past = QuadHistory { y, moment, y_before: past.y };
        }
        for order in (0..ORDER).rev() {
            for ipix in 0..map.domain().quads(order) {
                let children = at(order + 1, 4 * ipix)..at(order + 1, 4 * ipix) + 4;
                self.factor[at(order, ipix)] = self.factor[children].iter().copied().fold(1.0, f32::max);
            }
        }
        let moves = (self.frames > 0 && moved > MOVED) || (self.frames > 1 && two > DRIFT * one);
        self.moving = if moves { AFTER + 1 } else { self.moving.saturating_sub(1) };
        self.frames = self.frames.saturating_add(1);
        self.moving > 0
    }

    /// Returns the factor on the importance of quad `ipix` of `order`.
    pub(super) fn factor(&self, order: u8, ipix: u32) -> f32 {
        let shift = 2 * order.saturating_sub(ORDER);
        self.factor.get(at(order.min(ORDER), (ipix >> shift) as usize)).copied().unwrap_or(1.0)
    }
}

/// Returns the length of the vector `v`; 0 for the null vector.
fn length(v: Vec3) -> f32 {
    root(v.length_squared().max(f32::MIN_POSITIVE))
}

/// Returns the index of quad `ipix` of `order` in the array of factors.
const fn at(order: u8, ipix: usize) -> usize {
    Domain::Sphere.faces() * (((1 << (2 * order)) - 1) / 3) + ipix
}
