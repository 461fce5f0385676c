//! The interface of the filters of light paths. Only [`Hemigon`](super::Hemigon) uses these filters: its lights have slots that stay the
//! same from frame to frame. The lights of `q2tree` are not filtered; `adaptive` has a separate filter.

use crate::sampler::SamplerKind;
use glam::Vec3;

/// Direction and colour of a light in one frame, before or after a filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathPoint {
    /// Direction of the light, a unit vector.
    pub direction: Vec3,
    /// Linear RGB colour of the light, of a luminance of about 1.
    pub colour: [f32; 3],
}

/// A filter of directions and colours of lights over a sequence of frames. A light keeps its slot for as long as it exists.
pub trait Follow {
    /// Kind of the sampler that uses the filter.
    const KIND: SamplerKind;

    /// Returns the number of slots for which the filter has memory.
    fn slots(&self) -> usize;

    /// Begins a frame; `abrupt` is true if the map has changed abruptly.
    fn begin(&mut self, abrupt: bool);

    /// Filters the total RGB energy of the map; the result is the sum of the irradiances of the lights.
    fn total(&mut self, total: [f64; 3]) -> [f64; 3] {
        total
    }

    /// Returns the filtered value of the measurement `seen` of the light in `slot`; `is_new` starts a new path at `seen`.
    fn follow(&mut self, slot: usize, is_new: bool, seen: PathPoint) -> PathPoint;

    /// Discards the filter's state of earlier frames.
    fn reset(&mut self);
}
