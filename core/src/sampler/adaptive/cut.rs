//! Detects a cut: a frame that does not continue the last frame, after which the state of earlier frames is discarded.
//!
//! Let r be the ratio of a quad's light to its light in the last frame. In a continued scene most r lie near their median, even if the
//! whole is dimmed or a lamp changes; after a cut more than half of them do not.

use crate::pyramid::PyramidView;

/// HEALPix order of the compared quads: 15 degrees, so that a lamp or a person covers few of them.
const ORDER: u8 = 2;

/// The number of compared quads of a sphere.
const QUADS: usize = crate::healpix::Domain::Sphere.quads(ORDER);

/// Largest factor between a quad's ratio and the median in a continued scene: clouds and lamps change a wall by less.
const FACTOR: f32 = 1.5;

/// Luminance of each quad in the last frame, for the detection of cuts.
#[derive(Clone, Debug)]
pub(super) struct Cut {
    past: [f32; QUADS],
}

impl Cut {
    pub(super) const fn new() -> Self {
        Self { past: [0.0; QUADS] }
    }

    /// Stores the light of the frame; returns whether the frame is a cut.
    pub(super) fn detect(&mut self, map: &PyramidView<'_>) -> bool {
        let mut ratios = heapless::Vec::<f32, QUADS>::new();
        let mut one = 0;
        for (past, quad) in self.past.iter_mut().zip(map.quads_of(ORDER)) {
            let now = quad.y();
            match (*past > 0.0, now > 0.0) {
                (true, true) => {
                    // The capacity is the number of quads.
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
