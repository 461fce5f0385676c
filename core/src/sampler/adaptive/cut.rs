//! Detects a cut: a frame that does not continue the last one, after which the state of earlier frames is discarded.
//!
//! With r the ratio of a quad's light to that of the last frame, a scene that goes on has most r near their median, however much the
//! whole was dimmed and whatever one lamp does; after a cut more than half are elsewhere.

use crate::pyramid::PyramidView;

/// Order of the quads compared: 15 degrees, so that a lamp or a person is in few of them.
const ORDER: u8 = 2;

/// The number of quads of a sphere.
const QUADS: usize = crate::healpix::Domain::Sphere.quads(ORDER);

/// Ratios within this factor of their median are of a scene that goes on: clouds and lamps change a wall by less.
const FACTOR: f32 = 1.5;

/// Luminance of each quad in the last frame.
#[derive(Clone, Debug)]
pub(super) struct Cut {
    past: [f32; QUADS],
}

impl Cut {
    pub(super) const fn new() -> Self {
        Self { past: [0.0; QUADS] }
    }

    /// Stores the frame; returns whether it is a cut.
    pub(super) fn seen(&mut self, map: &PyramidView<'_>) -> bool {
        let mut ratios = heapless::Vec::<f32, QUADS>::new();
        let mut one = 0;
        for (past, quad) in self.past.iter_mut().zip(map.quads_of(ORDER)) {
            let now = quad.y();
            match (*past > 0.0, now > 0.0) {
                (true, true) => {
                    // One ratio a quad: the list has a place for each.
                    let _ = ratios.push(now / *past);
                }
                (false, false) => {}
                _ => one += 1,
            }
            *past = now;
        }
        ratios.sort_unstable_by(f32::total_cmp);
        let median = ratios.get(ratios.len() / 2).copied().unwrap_or(0.0);
        let near = ratios.iter().filter(|r| **r < median * FACTOR && **r * FACTOR > median).count();
        2 * near < ratios.len() + one
    }
}
