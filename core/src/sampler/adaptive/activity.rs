//! Detects where light moves, and whether it moves at all.
//!
//! A light that stands for something that moves errs anew in every frame, which is seen as flicker, so there more lights pay. And as
//! long as nothing moves what changes is noise, which may be smoothed.

use crate::healpix::{Domain, Order};
use crate::pyramid::{PyramidView, pyramid_len};
use crate::root::root;
use glam::Vec3;

/// Order of the quads that are watched: 7 degrees.
const ORDER: u8 = 3;

const QUADS: usize = Domain::Sphere.quads(ORDER);
const SUMS: usize = pyramid_len(Domain::Sphere, Order::saturating(ORDER));

/// By how much a quad whose light moves counts more. Of 2, 3, 5 and 9 this gave the least flicker per error over moving lamps.
const MOST: f32 = 3.0;

/// Least step of a quad's first moment, over its energy, that is motion and no noise; and the step that counts as full motion.
const STEP: (f32, f32) = (0.025, 0.25);

/// How fast the factor rises and falls, a frame: at once, so that what was split before does not hold the lights.
const RISE_AND_FALL: (f32, f32) = (1.0, 0.5);

/// A quad changes beyond noise if its share changes by this part.
const CHANGE: f32 = 0.08;

/// Something moves if quads with this share of the light change so.
const MOVED: f32 = 0.003;

/// Something moves slowly if steps over two frames have more than this times the mean square of those over one: noise has 1, an even
/// motion 4.
const DRIFT: f32 = 1.6;

/// Frames for which a scene is thought to move after it was seen to.
const AFTER: u32 = 2;

/// A quad in the last two frames, as shares of the map's light.
#[derive(Clone, Copy, Debug, Default)]
struct QuadHistory {
    y: f32,
    moment: Vec3,
    /// Luminance energy in the frame before the last.
    y_before: f32,
}

/// State from the last frames, and the factors derived from it.
#[derive(Clone, Debug)]
pub(super) struct Activity {
    past: [QuadHistory; QUADS],
    /// By how much quads of all orders up to [`ORDER`] count more: the most of what is in them.
    factor: [f32; SUMS],
    /// Frames seen.
    frames: u32,
    /// Frames until the scene is thought to be at rest.
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

    /// Takes the next frame; true if something moves. Maps coarser than order 3 are always at rest.
    pub(super) fn see(&mut self, map: &PyramidView<'_>) -> bool {
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

    /// Factor on the importance of quad `ipix` of `order`.
    pub(super) fn factor(&self, order: u8, ipix: u32) -> f32 {
        let shift = 2 * order.saturating_sub(ORDER);
        self.factor.get(at(order.min(ORDER), (ipix >> shift) as usize)).copied().unwrap_or(1.0)
    }
}

/// Length of a vector that may be 0.
fn length(v: Vec3) -> f32 {
    root(v.length_squared().max(f32::MIN_POSITIVE))
}

/// Index of quad `ipix` of `order` in the factors.
const fn at(order: u8, ipix: usize) -> usize {
    Domain::Sphere.faces() * (((1 << (2 * order)) - 1) / 3) + ipix
}
