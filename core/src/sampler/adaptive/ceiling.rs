//! Selection of the ceiling between ambient light and its excess, and the correction of the ambient light beside discs.

use super::memory::Workspace;
use super::nodes::Leaf;
use super::{Adaptive, LightFilter, ambient, discs};
use crate::buffer::Buffer;
use crate::light::Light;
use crate::pyramid::PyramidView;
use crate::sampler::Request;
use core::borrow::BorrowMut;

/// Ratio of the error under another ceiling to the error under the ceiling in use, below which the other ceiling replaces it.
const BETTER: f32 = 0.95;

/// Number of ceilings without less error past which the search for the ceiling beside discs continues.
const WORSE: u32 = 1;

impl<B: Buffer<u8>, H: Buffer<Leaf>, L: Buffer<Light>, T: Buffer<LightFilter>, W: BorrowMut<Workspace>>
    Adaptive<B, H, L, T, W>
{
    /// Returns the estimated error of at most `limit` lights; with ambient light, under the ceiling of least error, which is stored.
    pub(super) fn trial(&mut self, map: &PyramidView<'_>, request: &Request, limit: usize) -> f32 {
        if !request.ambient || limit == 0 {
            return self.evaluate(map, request, limit, ambient::ALL);
        }
        // The search goes from the usual ceiling up and down while the error decreases, for discs past at most [`WORSE`] ceilings where it
        // does not. The ceiling without excess is tried too, so that the error of a few lights never exceeds the error of ambient light alone.
        let mut best = (self.evaluate(map, request, limit, ambient::USUAL), ambient::USUAL);
        for ceilings in [ambient::HIGHER, ambient::LOWER, &[ambient::ALL]] {
            let mut worse = 0;
            for ceiling in ceilings {
                let error = self.evaluate(map, request, limit, *ceiling);
                if error < best.0 {
                    best = (error, *ceiling);
                } else if !request.soft || worse == WORSE {
                    break;
                } else {
                    worse += 1;
                }
            }
        }
        let now = self.evaluate(map, request, limit, self.ceiling.0);
        if now <= best.0 / BETTER {
            return now;
        }
        self.ceiling.0 = best.1;
        best.0
    }

    /// Returns the estimated error of at most `limit` lights under the ceiling with the index `ceiling`, over all receivers.
    fn evaluate(&mut self, map: &PyramidView<'_>, request: &Request, limit: usize, ceiling: usize) -> f32 {
        self.place(map, request, limit, ceiling);
        if request.soft {
            let Workspace { sources, fit, .. } = self.workspace.borrow_mut();
            let lights = &mut self.lights[0].as_mut()[..self.count];
            discs::steer(fit, sources.as_slice(), discs::group(lights.len(), request.ambient), lights);
        }
        self.weigh(map, request);
        if request.soft && request.ambient {
            let lights = &self.lights[0].as_ref()[..self.count];
            self.workspace.borrow_mut().ambient.complete(lights, None);
        }
        self.evaluated = None;
        self.error(map, request, true)
    }

    /// Corrects the ambient light beside discs; in a `quiet` scene, the correction follows the light as slowly as the filtered lights.
    pub(super) fn complete(&mut self, map: &PyramidView<'_>, request: &Request, quiet: bool) {
        let last = self.correction.take().filter(|(ceiling, _)| quiet && *ceiling == self.ceiling.0);
        if !(request.soft && request.ambient) {
            return;
        }
        let y = map.total().y();
        let last = last.map(|(_, shares)| shares.map(|sum| sum.map(|v| v * y)));
        let ambient = &mut self.workspace.borrow_mut().ambient;
        let correction = ambient.complete(&self.lights[0].as_ref()[..self.count], last);
        self.correction = Some((self.ceiling.0, correction.map(|sum| sum.map(|v| v / y))));
    }
}
