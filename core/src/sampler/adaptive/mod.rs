//! The `adaptive` sampler: a binary tree over the pyramid, filtered energy centroids, and weights of least error for shadowed receivers. A
//! method of this project.
//!
//! 1. `ambient`, if requested: fits spherical harmonics to the light without a dominant direction; the other stages represent the excess.
//!    `ceiling` selects the height of the excess. Beside discs, the harmonics finally take what the discs do not represent of degree 1 and 2.
//! 2. `count`: with a tolerance, selects the fewest lights that reach it; hysteresis keeps their number from oscillating.
//! 3. `tree` over `nodes`: splits a binary tree best-first by Y (1 - |m|)^(3/8), which is nearly the shadowed error of one light. Each
//!    split adds one light, so every number of lights is reached, down to one.
//! 4. `gather`: moves up to eight points or sixteen discs to the centroids of the light nearest to them; in larger sets the error decreases
//!    little and the lights flicker. `discs`: for discs, the importance is the error of a disc, and the discs of small sets move to reduce
//!    their error.
//! 5. `filter`: smooths directions against noise; a light that moves or jumps is followed without delay. After a `cut`, a frame that does
//!    not continue the last frame, all filters are reset.
//! 6. `weights`: sets the energies of up to 64 lights to the least expected squared error of irradiance over receivers with random
//!    occluders. For more lights, the solution would take more time than one more light.
//! 7. `receivers`, or `estimate` for many lights: estimates the shadowed error of the set. Both approximate the map by sources (`source`).
//!
//! In every frame and channel, the energies of the lights and of the ambient light add up to the energy of the map.

mod activity;
mod ambient;
mod ceiling;
mod count;
mod cut;
mod discs;
mod estimate;
mod filter;
mod gather;
mod kernel;
mod memory;
mod nodes;
mod points;
mod receivers;
mod source;
mod step;
mod table;
mod tree;
mod weights;

use super::{Map, Request, Sampler, SamplerKind, Timer};
use crate::buffer::{self, Buffer, TooSmall};
use crate::healpix::{Domain, Order};
use crate::light::{Decomposition, Light, Sh9};
use crate::pyramid::PyramidView;
use core::borrow::BorrowMut;
pub use filter::LightFilter;
use glam::Vec3;
pub use memory::{Memory, Sizes, Workspace};
pub use nodes::Leaf;
use nodes::Nodes;
pub use tree::bits_len;
use tree::{Growth, Tree};

/// Largest number of lights for which the weights are fitted.
const FITTED: usize = 64;

/// Largest number of points, and of discs, that the stage `gather` moves.
const GATHERED_POINTS: usize = 8;
const GATHERED_DISCS: usize = 16;

/// Number of frames between two searches for the ceiling of the ambient light.
const REST: u32 = 32;

/// The `adaptive` sampler, over the buffers of [`Memory`].
///
/// ```
/// use hemilux_core::sampler::adaptive::{Adaptive, Leaf, Memory, Sizes, LightFilter, Workspace};
/// use hemilux_core::pyramid::{Pyramid, Quad, pyramid_len};
/// use hemilux_core::polar::LatLongView;
/// use hemilux_core::{Domain, Light, Map, Order, Request, Sampler};
///
/// // A map of 192 texels with one lit texel of irradiance 2 from straight above.
/// let (domain, order) = (Domain::Sphere, Order::saturating(2));
/// let mut map = Pyramid::try_new(vec![Quad::default(); pyramid_len(domain, order)], domain, order)?;
/// map.texels_mut()[0] = Quad::from_light([2.0; 3], glam::Vec3::Z);
/// map.build();
///
/// let sizes = Sizes::new(domain, order, 16);
/// let memory = Memory {
///     interior: [vec![0; sizes.interior], vec![0; sizes.interior]],
///     leaves: vec![Leaf::default(); sizes.lights],
///     lights: [vec![Light::default(); sizes.lights], vec![Light::default(); sizes.lights]],
///     tracks: [vec![LightFilter::default(); sizes.lights], vec![LightFilter::default(); sizes.lights]],
///     workspace: Box::new(Workspace::new()),
/// };
/// let mut sampler = Adaptive::try_new(domain, order, memory)?;
/// let map = Map { pyramid: map.view(), polar: LatLongView::NONE };
/// let made = sampler.update(&map, &Request::of_lights(16));
/// assert_eq!(made.lights.len(), 1);
/// assert!((made.lights[0].irradiance[0] - 2.0).abs() < 1e-6);
/// # Ok::<(), hemilux_core::TooSmall>(())
/// ```
#[derive(Clone, Debug)]
pub struct Adaptive<B, H, L, T, W> {
    domain: Domain,
    tree: Tree<B, H>,
    lights: [L; 2],
    tracks: [T; 2],
    count: usize,
    /// Index in [`ambient::CEILINGS`] of the ceiling in use, and number of frames since the last search for the best ceiling.
    ceiling: (usize, u32),
    /// The number of lights that was selected for a tolerance.
    wanted: count::Count,
    /// Number of lights for which the error was computed over all receivers; `None` before the first frame.
    evaluated: Option<usize>,
    /// Whether the lights of the last frame were discs.
    soft: bool,
    /// Index of the ceiling of the last frame, and the correction of its ambient light divided by the luminance of its map; `None` without a correction.
    correction: Option<(usize, Sh9)>,
    workspace: W,
}

impl<B: Buffer<u8>, H: Buffer<Leaf>, L: Buffer<Light>, T: Buffer<LightFilter>, W: BorrowMut<Workspace>>
    Adaptive<B, H, L, T, W>
{
    /// Creates a sampler for maps of `domain` up to `order`, and for as many lights as the shortest of its lists has elements.
    ///
    /// # Errors
    /// [`TooSmall`] if the bit sets are shorter than [`Sizes::interior`].
    pub fn try_new(domain: Domain, order: Order, memory: Memory<B, H, L, T, W>) -> Result<Self, TooSmall> {
        let Memory { interior, leaves, lights, tracks, mut workspace } = memory;
        for bits in &interior {
            buffer::check(bits, bits_len(domain, order))?;
        }
        workspace.borrow_mut().prepare(domain, order);
        let mut new = Self {
            domain,
            tree: Tree::new(interior, leaves),
            lights,
            tracks,
            count: 0,
            ceiling: (ambient::USUAL, 0),
            wanted: count::Count::default(),
            evaluated: None,
            soft: false,
            correction: None,
            workspace,
        };
        new.reset();
        Ok(new)
    }

    /// Returns the largest number of lights for which the buffers have memory.
    #[must_use]
    pub fn capacity(&self) -> usize {
        let lights = self.lights.iter().map(|l| l.as_ref().len());
        let tracks = self.tracks.iter().map(|t| t.as_ref().len());
        lights.chain(tracks).chain([self.tree.capacity()]).min().unwrap_or(0)
    }

    /// Computes the lights of one frame; returns the estimated shadowed error of the lights, a ratio.
    fn decompose(&mut self, map: &PyramidView<'_>, request: &Request, timer: &mut Timer<'_>) -> f32 {
        if self.workspace.borrow_mut().cut.detect(map) {
            self.reset();
        }
        let moving = self.workspace.borrow_mut().activity.update(map);
        self.workspace.borrow_mut().gather.advance();
        let previous = self.count;
        self.lights.swap(0, 1);
        self.tracks.swap(0, 1);
        self.tree.advance();
        let most = request.lights.min(self.capacity());
        let least = usize::from(!request.ambient).min(most);
        let mut count = most;
        if let Some(tolerance) = request.tolerance {
            let mut wanted = self.wanted;
            count = wanted.choose(tolerance, least..=most, |n| self.trial(map, request, n));
            self.wanted = wanted;
        }
        self.ceiling.1 += 1;
        if request.ambient && (self.evaluated != Some(count) || self.ceiling.1 > REST) {
            self.trial(map, request, count);
            self.ceiling.1 = 0;
        }
        self.place(map, request, count, self.ceiling.0);
        let quiet = self.follow(request, filter::Frame { previous, moving }, timer);
        self.weigh(map, request);
        let (lights, tracks) =
            (&mut self.lights[0].as_mut()[..self.count], &mut self.tracks[0].as_mut()[..self.count]);
        timer.measure(|| filter::settle(lights, tracks, quiet));
        let nodes = Nodes::new(map, request.ambient.then_some(&self.workspace.borrow().ambient));
        weights::keep_energy(lights, nodes.quad(0, 0).rgb());
        self.complete(map, request, quiet);
        let anew = self.evaluated != Some(count);
        self.evaluated = Some(count);
        let error = self.error(map, request, anew);
        self.wanted.note(error);
        error
    }

    /// Moves discs, and filters the directions of all lights; returns whether the scene is at rest.
    ///
    /// In a scene at rest discs keep their offsets from the centroids of their regions, since a new search would cost several fits.
    fn follow(&mut self, request: &Request, frame: filter::Frame, timer: &mut Timer<'_>) -> bool {
        let anew = core::mem::replace(&mut self.soft, request.soft) != request.soft;
        let count = self.count;
        let ([lights, old], [tracks, old_tracks]) = (&mut self.lights, &mut self.tracks);
        let (lights, tracks) = (&mut lights.as_mut()[..count], &mut tracks.as_mut()[..count]);
        let past = filter::PastLights {
            lights: &old.as_ref()[..frame.previous],
            tracks: &old_tracks.as_ref()[..frame.previous],
        };
        let leaves = self.tree.leaves();
        let quiet = filter::compare(lights, leaves, past) == filter::Regions::Same && !frame.moving;
        let mut moves = [Vec3::ZERO; FITTED];
        if request.soft {
            moves.iter_mut().zip(lights.iter()).for_each(|(by, light)| *by = -light.direction);
            if quiet && !anew {
                filter::move_again(lights, past);
            } else {
                let Workspace { sources, fit, .. } = self.workspace.borrow_mut();
                discs::steer(fit, sources.as_slice(), discs::group(lights.len(), request.ambient), lights);
            }
            moves.iter_mut().zip(lights.iter()).for_each(|(by, light)| *by += light.direction);
        }
        timer.measure(|| {
            filter::follow(lights, tracks, leaves, past);
            if request.soft {
                filter::follow_radii(lights, tracks, frame.moving);
            }
        });
        filter::note_moves(tracks, &moves);
        quiet
    }

    /// Computes the regions and directions of at most `limit` lights, under the ceiling with the index `ceiling`.
    fn place(&mut self, map: &PyramidView<'_>, request: &Request, limit: usize, ceiling: usize) {
        let Workspace { ambient, activity, gather, sources, .. } = self.workspace.borrow_mut();
        if request.ambient {
            ambient.fit(map, if limit == 0 { ambient::ALL } else { ceiling });
        }
        let nodes = Nodes::new(map, request.ambient.then_some(&*ambient));
        self.tree.grow(&nodes, activity, &Growth { limit, soft: request.soft });
        self.count = self.tree.emit(&nodes, &mut self.lights[0].as_mut()[..limit]);
        let lights = &mut self.lights[0].as_mut()[..self.count];
        let leaves = self.tree.leaves();
        let gathered = gather::applies(self.count, request.soft);
        if gathered {
            gather.run(&nodes, leaves, lights);
        }
        if request.soft {
            discs::set_radii(lights, request.ambient);
            if gathered {
                sources.fill(gather.disc_pieces(&nodes, leaves, self.count), lights, false);
            } else {
                sources.fill(source::pieces(&nodes, leaves, self.count, true), lights, false);
            }
        }
    }

    /// Computes and sets the energies of the lights at their present directions.
    fn weigh(&mut self, map: &PyramidView<'_>, request: &Request) {
        let Workspace { ambient, sources, fit, .. } = self.workspace.borrow_mut();
        let nodes = Nodes::new(map, request.ambient.then_some(&*ambient));
        let lights = &mut self.lights[0].as_mut()[..self.count];
        // The sources of discs do not depend on the lights' directions: `place` made them.
        if !request.soft {
            let pieces = source::pieces(&nodes, self.tree.leaves(), lights.len(), false);
            sources.fill(pieces, lights, gather::applies(lights.len(), false));
        }
        if (2..=FITTED).contains(&self.count) {
            if request.soft {
                fit.run_discs(sources.as_slice(), discs::group(lights.len(), request.ambient), lights);
            } else {
                fit.run(sources.as_slice(), lights);
            }
        }
        weights::keep_energy(lights, nodes.quad(0, 0).rgb());
    }

    /// Returns the estimated shadowed error of the lights, a ratio. If `anew`, all receivers are evaluated, otherwise a sixteenth of them.
    fn error(&mut self, map: &PyramidView<'_>, request: &Request, anew: bool) -> f32 {
        let lights = &self.lights[0].as_ref()[..self.count];
        if self.count > source::SOURCES {
            return estimate::shadowed_error(lights);
        }
        let whole = 1.0 / map.total().y();
        let Workspace { ambient, sources, receivers, .. } = self.workspace.borrow_mut();
        receivers.clear();
        for source in sources.as_slice() {
            receivers.add(source.at, source.radius, source.y * whole);
        }
        for light in lights {
            let share = -crate::color::luminance(light.irradiance) * whole;
            if request.soft {
                discs::parts(light, lights.len(), request.ambient)
                    .for_each(|part| receivers.add(part.at, part.radius, share * part.share));
            } else {
                receivers.add(light.direction, 0.0, share);
            }
        }
        if request.ambient {
            for residual in ambient.residuals(map) {
                receivers.add(residual.direction, ambient::RADIUS, residual.y * whole);
            }
        }
        let error = if anew { receivers.evaluate_all() } else { receivers.evaluate_next() };
        error.max(estimate::FLOOR)
    }
}

impl<B: Buffer<u8>, H: Buffer<Leaf>, L: Buffer<Light>, T: Buffer<LightFilter>, W: BorrowMut<Workspace>>
    Sampler for Adaptive<B, H, L, T, W>
{
    fn kind(&self) -> SamplerKind {
        SamplerKind::Adaptive
    }

    fn update_timed(&mut self, map: &Map<'_>, request: &Request, timer: &mut Timer<'_>) -> Decomposition<'_> {
        let map = &map.pyramid;
        let known = self.tree.fits(map) && map.domain() == self.domain && map.total().y() > 0.0;
        let error = if known && (request.lights > 0 || request.ambient) {
            self.decompose(map, request, timer)
        } else {
            self.count = 0;
            f32::from(u8::from(known))
        };
        Decomposition {
            lights: &self.lights[0].as_ref()[..self.count],
            ambient: request
                .ambient
                .then(|| if known { *self.workspace.borrow().ambient.harmonics() } else { [[0.0; 3]; 9] }),
            estimated_error: Some(error),
        }
    }

    fn reset(&mut self) {
        self.count = 0;
        self.evaluated = None;
        self.workspace.borrow_mut().activity.reset();
        self.workspace.borrow_mut().gather.reset();
        self.ceiling = (ambient::USUAL, 0);
        self.wanted.reset();
        self.tree.reset();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::healpix;
    use crate::polar::LatLongView;
    use crate::pyramid::{Pyramid, Quad, pyramid_len};

    #[test]
    fn a_constant_map_is_not_searched_again_for_any_number_of_lights() {
        const ORDER: u8 = 3;
        let quads = [Quad::default(); pyramid_len(Domain::Sphere, Order::saturating(ORDER))];
        let mut map = Pyramid::try_new(quads, Domain::Sphere, Order::saturating(ORDER)).expect("room enough");
        for (ipix, quad) in map.texels_mut().iter_mut().enumerate() {
            *quad = Quad::from_light([1.0; 3], healpix::centre(ORDER, ipix as u32).as_vec3());
        }
        map.build();
        let bits = [0u8; bits_len(Domain::Sphere, Order::saturating(ORDER))];
        let memory = Memory {
            interior: [bits; 2],
            leaves: [Leaf::default(); 8],
            lights: [[Light::default(); 8]; 2],
            tracks: [[LightFilter::default(); 8]; 2],
            workspace: Workspace::new(),
        };
        let mut sampler =
            Adaptive::try_new(Domain::Sphere, Order::saturating(ORDER), memory).expect("bits enough");
        let map = Map { pyramid: map.view(), polar: LatLongView::NONE };
        for frame in 0..10 {
            let made =
                sampler.update(&map, &Request { lights: 8, tolerance: None, ambient: true, soft: false });
            assert!(made.lights.is_empty(), "a flat map needs none");
            assert_eq!(sampler.ceiling.1, frame, "frames since the last search");
        }
    }
}
