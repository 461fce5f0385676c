//! Irradiance of the receivers under a map, and the errors of a light set relative to it.

use std::f64::consts::PI;
use std::sync::Arc;

use super::irradiance::{OPEN_SET, ReceiverSet, SHADOWED_SET};
use super::{Domain, LitSet, Reading, TexelGrid, holds, luminance, relative, rms};
use crate::env::EnvMap;

/// The accuracy of a light set on one map: dimensionless ratios, lower is better.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Score {
    /// RMS of (E_set - E_ref) / mu over the open receivers. E_set and E_ref are the irradiance under the set and under the map, mu is the mean of
    /// E_ref.
    pub open: f64,
    /// RMS of (E_set - E_ref) / mu over the shadowed receivers.
    pub shadowed: f64,
    /// Open error of the lights read as discs.
    pub soft_open: f64,
    /// Shadowed error of the lights read as discs.
    pub soft_shadowed: f64,
    /// Relative difference between the luminous energies of the set and of the map; at most 1e-3 for a correct sampler.
    pub energy: f64,
}

/// Irradiance of every receiver under one map, against which light sets are scored.
#[derive(Clone, Debug)]
pub struct Reference {
    grid: Arc<TexelGrid>,
    open: ReceiverIrradiance,
    shadowed: ReceiverIrradiance,
    /// Luminous energy of the map, the sum of Y dOmega.
    total: f64,
}

/// Irradiance E_ref of the receivers of one kind, and its mean mu.
#[derive(Clone, Debug)]
struct ReceiverIrradiance {
    irradiance: Vec<f64>,
    mu: f64,
}

impl ReceiverIrradiance {
    fn new(irradiance: Vec<f64>) -> Self {
        let mu = irradiance.iter().sum::<f64>() / irradiance.len() as f64;
        Self { irradiance, mu }
    }

    /// Returns the RMS difference between the irradiance `set` and E_ref, divided by mu.
    fn error(&self, set: &[f64]) -> f64 {
        relative(rms(set.iter().zip(&self.irradiance).map(|(set, truth)| set - truth)), self.mu)
    }
}

impl Reference {
    /// Computes the irradiance of all receivers under `map`.
    #[must_use]
    pub fn new(map: &EnvMap, domain: Domain) -> Self {
        Self::on_grid(Arc::new(TexelGrid::new(map, domain)), map)
    }

    /// Computes the irradiance of all receivers under another map, over the domain of `self`; maps of equal size share one grid.
    #[must_use]
    pub fn following(&self, map: &EnvMap) -> Self {
        if self.grid.fits(map) {
            Self::on_grid(Arc::clone(&self.grid), map)
        } else {
            Self::new(map, self.grid.domain())
        }
    }

    fn on_grid(grid: Arc<TexelGrid>, map: &EnvMap) -> Self {
        let open = ReceiverIrradiance::new(OPEN_SET.irradiance(grid.luminous(map)));
        let shadowed = ReceiverIrradiance::new(SHADOWED_SET.irradiance(grid.luminous(map)));
        let total = grid.luminous(map).map(|(_, flux)| flux).sum();
        Self { grid, open, shadowed, total }
    }

    /// Returns the grid of texels over which the irradiance is summed.
    #[must_use]
    pub fn grid(&self) -> &TexelGrid {
        &self.grid
    }

    /// Returns the luminous energy of the map, the sum of Y dOmega over its texels.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.total
    }

    /// Returns the irradiance E_ref of the open receivers.
    #[must_use]
    pub fn open(&self) -> &[f64] {
        &self.open.irradiance
    }

    /// Returns the irradiance E_ref of the shadowed receivers.
    #[must_use]
    pub fn shadowed(&self) -> &[f64] {
        &self.shadowed.irradiance
    }

    /// Returns the mean of E_ref over the open receivers.
    #[must_use]
    pub fn open_mu(&self) -> f64 {
        self.open.mu
    }

    /// Returns the mean of E_ref over the shadowed receivers.
    #[must_use]
    pub fn shadowed_mu(&self) -> f64 {
        self.shadowed.mu
    }

    /// Returns the irradiance E_set of the open receivers under a light set.
    #[must_use]
    pub fn open_of(&self, set: &LitSet, reading: Reading) -> Vec<f64> {
        self.irradiance_of(set, reading, &OPEN_SET, |grid| &grid.ambient().open)
    }

    /// Returns the irradiance E_set of the shadowed receivers under a light set.
    #[must_use]
    pub fn shadowed_of(&self, set: &LitSet, reading: Reading) -> Vec<f64> {
        self.irradiance_of(set, reading, &SHADOWED_SET, |grid| &grid.ambient().shadowed)
    }

    /// Scores a light set against the map.
    #[must_use]
    pub fn score(&self, set: &LitSet) -> Score {
        Score {
            open: self.open.error(&self.open_of(set, Reading::Points)),
            shadowed: self.shadowed_error(set, Reading::Points),
            soft_open: self.open.error(&self.open_of(set, Reading::Discs)),
            soft_shadowed: self.shadowed_error(set, Reading::Discs),
            energy: relative((self.energy_of(set) - self.total).abs(), self.total),
        }
    }

    /// Returns the shadowed error alone, which takes less time than [`Reference::score`].
    #[must_use]
    pub fn shadowed_error(&self, set: &LitSet, reading: Reading) -> f64 {
        self.shadowed.error(&self.shadowed_of(set, reading))
    }

    /// Returns the open and the shadowed error of point lights (unit vector, luminance of the irradiance).
    #[must_use]
    pub fn errors_of_points(&self, points: impl Iterator<Item = ([f64; 3], f64)> + Clone) -> [f64; 2] {
        [
            self.open.error(&OPEN_SET.irradiance(points.clone())),
            self.shadowed.error(&SHADOWED_SET.irradiance(points)),
        ]
    }

    /// Returns the luminous energy of a light set: the sum of Y(E) over the lights, plus for ambient light 2 sqrt(pi) Y(c00) on the sphere and the
    /// sum over the texels on the hemisphere.
    #[must_use]
    pub fn energy_of(&self, set: &LitSet) -> f64 {
        let lights: f64 = self.counted(set).map(|(_, flux)| flux).sum();
        let ambient = ambient_luminance(set).map_or(0.0, |c| match self.grid.domain() {
            Domain::Sphere => 2.0 * PI.sqrt() * c[0],
            Domain::Hemisphere => product(&c, &self.grid.ambient().total),
        });
        lights + ambient
    }

    fn irradiance_of<'a>(
        &'a self,
        set: &LitSet,
        reading: Reading,
        probes: &ReceiverSet,
        ambient: impl Fn(&'a TexelGrid) -> &'a [[f64; 9]],
    ) -> Vec<f64> {
        let mut sums = match reading {
            Reading::Points => probes.irradiance(self.counted(set)),
            Reading::Discs => probes.irradiance_of_discs(self.discs(set)),
        };
        if let Some(c) = ambient_luminance(set) {
            sums.iter_mut().zip(ambient(&self.grid)).for_each(|(sum, row)| *sum += product(&c, row));
        }
        sums
    }

    /// Returns (direction, radius in radians, Y(E)) of the lights inside of the domain.
    fn discs<'a>(&self, set: &'a LitSet) -> impl Iterator<Item = ([f64; 3], f64, f64)> + 'a {
        let domain = self.grid.domain();
        let inside = set.lights.iter().filter(move |light| holds(domain, light.direction));
        inside.map(|light| (light.direction, light.radius_deg.to_radians(), luminance(light.irradiance)))
    }

    /// Returns (direction, Y(E)) of the lights inside of the domain.
    fn counted<'a>(&self, set: &'a LitSet) -> impl Iterator<Item = ([f64; 3], f64)> + 'a {
        let domain = self.grid.domain();
        let inside = set.lights.iter().filter(move |light| holds(domain, light.direction));
        inside.map(|light| (light.direction, luminance(light.irradiance)))
    }
}

/// Returns the luminance of the ambient coefficients of a light set, if the set has any.
pub(super) fn ambient_luminance(set: &LitSet) -> Option<[f64; 9]> {
    set.ambient_sh.map(|rows| rows.map(luminance))
}

fn product(a: &[f64; 9], b: &[f64; 9]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
