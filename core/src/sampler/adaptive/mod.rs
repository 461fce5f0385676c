//! `adaptive`: a binary tree over the pyramid, energy centroids that are smoothed but not delayed, and weights that light shadowed
//! receivers best. Our own method.
//!
//! 1. [`tree`]: best-first splits of a binary tree by Y (1 - |m|)^(3/8), which is nearly what a light costs in shadowed error. Each
//!    split adds one light, so every number of lights is reached, down to one.
//! 2. [`gather`]: up to eight lights are moved to the centroids of what is nearest to them; more lights gain little from it and flicker.
//! 3. [`filter`]: noise is taken from directions; a light that moves or jumps is followed at once. After a [`cut`] all begins anew.
//! 4. [`weights`]: up to 64 lights share their energy so that the expected error over receivers with random occluders is least.
//!    Above, it would cost more than another light does.
//! 5. [`estimate`]: how wrong the set is for shadowed receivers, from the lights themselves.
//!
//! The total energy of each channel is that of the map in every frame.

mod cut;
mod estimate;
mod filter;
mod gather;
mod tree;
mod weights;

use super::{Map, Request, Sampler};
use crate::arena::{self, Buffer, TooSmall};
use crate::healpix::Domain;
use crate::light::{Decomposition, Light};
use crate::pyramid::PyramidView;
pub use filter::Track;
use tree::Tree;
pub use tree::{Leaf, bits_len};

/// Most lights whose weights are fitted.
const FITTED: usize = 64;

/// Most lights that are moved to the centroids of what is nearest to them.
const GATHERED: usize = 8;

/// The sampler. `B` holds [`bits_len`] bytes, twice; `H` one [`Leaf`] per light; `L` one [`Light`] per light, twice; `T` one [`Track`]
/// per light, twice.
#[derive(Clone, Debug)]
pub struct Adaptive<B, H, L, T> {
    tree: Tree<B, H>,
    lights: [L; 2],
    tracks: [T; 2],
    fit: weights::Fit,
    cut: cut::Cut,
    count: usize,
}

impl<B: Buffer<u8>, H: Buffer<Leaf>, L: Buffer<Light>, T: Buffer<Track>> Adaptive<B, H, L, T> {
    /// Takes the memory for maps of `domain` up to `order` and for as many lights as the shortest of `heap`, `lights` and `tracks`
    /// holds.
    ///
    /// # Errors
    /// [`TooSmall`].
    pub fn try_new(
        (domain, order): (Domain, u8),
        bits: [B; 2],
        heap: H,
        lights: [L; 2],
        tracks: [T; 2],
    ) -> Result<Self, TooSmall> {
        for bits in &bits {
            arena::check(bits, bits_len(domain, order))?;
        }
        let mut new = Self {
            tree: Tree::new(bits, heap),
            lights,
            tracks,
            fit: weights::Fit::new(),
            cut: cut::Cut::new(),
            count: 0,
        };
        new.reset();
        Ok(new)
    }

    /// Most lights it can give.
    #[must_use]
    pub fn capacity(&self) -> usize {
        let lights = self.lights.iter().map(|l| l.as_ref().len());
        let tracks = self.tracks.iter().map(|t| t.as_ref().len());
        lights.chain(tracks).chain([self.tree.capacity()]).min().unwrap_or(0)
    }

    fn decompose(&mut self, map: &PyramidView<'_>, limit: usize) {
        if self.cut.seen(map) {
            self.reset();
        }
        let previous = self.count;
        self.lights.swap(0, 1);
        self.tracks.swap(0, 1);
        self.tree.grow(map, limit);
        let [lights, old] = &mut self.lights;
        self.count = self.tree.emit(map, &mut lights.as_mut()[..limit]);
        let lights = &mut lights.as_mut()[..self.count];
        if self.count <= GATHERED {
            gather::gather(map, lights);
        }
        let [tracks, old_tracks] = &mut self.tracks;
        let old = (&old.as_ref()[..previous], &old_tracks.as_ref()[..previous]);
        filter::follow(lights, &mut tracks.as_mut()[..self.count], old);
        if (2..=FITTED).contains(&self.count) {
            self.fit.run(map, &self.tree, lights, self.count <= GATHERED);
        }
        keep_energy(lights, map.total().rgb());
    }
}

/// Scales each channel so that it adds up to `total`.
fn keep_energy(lights: &mut [Light], total: [f32; 3]) {
    let mut sum = [0.0f64; 3];
    for light in lights.iter() {
        for (s, v) in sum.iter_mut().zip(light.irradiance) {
            *s += f64::from(v);
        }
    }
    let factor: [f32; 3] =
        core::array::from_fn(|c| if sum[c] > 0.0 { (f64::from(total[c]) / sum[c]) as f32 } else { 1.0 });
    for light in lights {
        for (v, f) in light.irradiance.iter_mut().zip(factor) {
            *v *= f;
        }
    }
}

impl<B: Buffer<u8>, H: Buffer<Leaf>, L: Buffer<Light>, T: Buffer<Track>> Sampler for Adaptive<B, H, L, T> {
    fn name(&self) -> &'static str {
        "adaptive"
    }

    fn update(&mut self, map: &Map<'_>, request: &Request) -> Decomposition<'_> {
        let limit = request.lights.min(self.capacity());
        if limit > 0 && self.tree.fits(&map.pyramid) && map.pyramid.total().y() > 0.0 {
            self.decompose(&map.pyramid, limit);
        } else {
            self.count = 0;
        }
        let lights = &self.lights[0].as_ref()[..self.count];
        let estimated_error = Some(estimate::shadowed_error(lights));
        Decomposition { estimated_error, ..Decomposition::of_lights(lights) }
    }

    fn reset(&mut self) {
        self.count = 0;
        self.tree.reset();
    }
}
