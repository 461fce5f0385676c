//! Irradiance of the probes under a map, and the errors of a light set against it.

use std::f64::consts::PI;
use std::sync::Arc;

use super::irradiance::{OPEN_SET, ReceiverSet, SHADOWED_SET};
use super::{Domain, Grid, LitSet, Reading, holds, luminance, relative, rms};
use crate::env::EnvMap;

/// The accuracy of a light set on one map: dimensionless ratios, lower is better.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Score {
    /// RMS over the open probes of (E_set - E_ref) / mu.
    pub open: f64,
    /// RMS over the shadowed probes of (E_set - E_ref) / mu.
    pub shadowed: f64,
    /// `open` of the lights read as discs of their radius.
    pub soft_open: f64,
    /// `shadowed` of the lights read as discs of their radius.
    pub soft_shadowed: f64,
    /// |set's sum - map's sum| / map's sum, of luminance; at most 1e-3 for a correct sampler.
    pub energy: f64,
}

/// The irradiance of every probe under one map.
#[derive(Clone, Debug)]
pub struct Reference {
    grid: Arc<Grid>,
    open: Truth,
    shadowed: Truth,
    total: f64,
}

/// E_ref of the probes of one kind, and mu, their mean.
#[derive(Clone, Debug)]
struct Truth {
    irradiance: Vec<f64>,
    mu: f64,
}

impl Truth {
    fn new(irradiance: Vec<f64>) -> Self {
        let mu = irradiance.iter().sum::<f64>() / irradiance.len() as f64;
        Self { irradiance, mu }
    }

    /// RMS of `set - truth` over mu.
    fn error(&self, set: &[f64]) -> f64 {
        relative(rms(set.iter().zip(&self.irradiance).map(|(set, truth)| set - truth)), self.mu)
    }
}

impl Reference {
    /// Integrates `map` over all probes.
    #[must_use]
    pub fn new(map: &EnvMap, domain: Domain) -> Self {
        Self::on_grid(Arc::new(Grid::new(map, domain)), map)
    }

    /// Integrates another map over the same domain; maps of one size share one grid.
    #[must_use]
    pub fn following(&self, map: &EnvMap) -> Self {
        if self.grid.fits(map) {
            Self::on_grid(Arc::clone(&self.grid), map)
        } else {
            Self::new(map, self.grid.domain())
        }
    }

    fn on_grid(grid: Arc<Grid>, map: &EnvMap) -> Self {
        let open = Truth::new(OPEN_SET.irradiance(grid.luminous(map)));
        let shadowed = Truth::new(SHADOWED_SET.irradiance(grid.luminous(map)));
        let total = grid.luminous(map).map(|(_, flux)| flux).sum();
        Self { grid, open, shadowed, total }
    }

    /// The texels the sums ran over.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// Sum of Y dOmega: the map's scalar flux density.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.total
    }

    /// E_ref of the open probes.
    #[must_use]
    pub fn open(&self) -> &[f64] {
        &self.open.irradiance
    }

    /// E_ref of the shadowed probes.
    #[must_use]
    pub fn shadowed(&self) -> &[f64] {
        &self.shadowed.irradiance
    }

    /// mu of the open probes.
    #[must_use]
    pub fn open_mu(&self) -> f64 {
        self.open.mu
    }

    /// mu of the shadowed probes.
    #[must_use]
    pub fn shadowed_mu(&self) -> f64 {
        self.shadowed.mu
    }

    /// E_set of the open probes.
    #[must_use]
    pub fn open_of(&self, set: &LitSet, reading: Reading) -> Vec<f64> {
        self.irradiance_of(set, reading, &OPEN_SET, |grid| &grid.ambient().open)
    }

    /// E_set of the shadowed probes.
    #[must_use]
    pub fn shadowed_of(&self, set: &LitSet, reading: Reading) -> Vec<f64> {
        self.irradiance_of(set, reading, &SHADOWED_SET, |grid| &grid.ambient().shadowed)
    }

    /// Scores a set against this map.
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

    /// The shadowed error alone: less work than [`Reference::score`], for long sequences.
    #[must_use]
    pub fn shadowed_error(&self, set: &LitSet, reading: Reading) -> f64 {
        self.shadowed.error(&self.shadowed_of(set, reading))
    }

    /// Sum of Y(E) over the lights plus the ambient's: 2 sqrt(pi) Y(c00) over the sphere, the sum over
    /// the texels over the hemisphere.
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
        ambient: impl Fn(&'a Grid) -> &'a [[f64; 9]],
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

    /// (direction, radius in radians, Y(E)) of the lights inside the domain.
    fn discs<'a>(&self, set: &'a LitSet) -> impl Iterator<Item = ([f64; 3], f64, f64)> + 'a {
        let domain = self.grid.domain();
        let inside = set.lights.iter().filter(move |light| holds(domain, light.direction));
        inside.map(|light| (light.direction, light.radius_deg.to_radians(), luminance(light.irradiance)))
    }

    /// (direction, Y(E)) of the lights inside the domain.
    fn counted<'a>(&self, set: &'a LitSet) -> impl Iterator<Item = ([f64; 3], f64)> + 'a {
        let domain = self.grid.domain();
        let inside = set.lights.iter().filter(move |light| holds(domain, light.direction));
        inside.map(|light| (light.direction, luminance(light.irradiance)))
    }
}

/// Luminance of the ambient coefficients, where the set carries any.
pub(super) fn ambient_luminance(set: &LitSet) -> Option<[f64; 9]> {
    set.ambient_sh.map(|rows| rows.map(luminance))
}

fn product(a: &[f64; 9], b: &[f64; 9]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
