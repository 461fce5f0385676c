//! The interface of a filter of light paths.

use crate::sampler::SamplerKind;
use glam::Vec3;

/// Direction and colour of a light in one frame, before or after the filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathPoint {
    /// Unit vector.
    pub direction: Vec3,
    /// Colour of luminance about 1.
    pub colour: [f32; 3],
}

/// Filters the lights of a sequence of frames. Each light keeps its slot as long as it lives.
pub trait Follow {
    /// The sampler that uses this filter.
    const KIND: SamplerKind;

    /// Number of slots that the filter has memory for.
    fn slots(&self) -> usize;

    /// Begins a frame; `abrupt` if the map is no continuation of the last.
    fn begin(&mut self, abrupt: bool);

    /// The energy that the lights give out for the map's `total`, RGB.
    fn total(&mut self, total: [f64; 3]) -> [f64; 3] {
        total
    }

    /// The next step of the light in `slot`, which begins there if `is_new`.
    fn follow(&mut self, slot: usize, is_new: bool, seen: PathPoint) -> PathPoint;

    /// Forgets the past.
    fn reset(&mut self);
}
