//! Measurement of times and scores of one method on one map.

use super::Point;
use crate::baseline::gather;
use crate::burst;
use crate::contender::{Method, MethodKind, baseline_called, judged, methods};
use crate::env::EnvMap;
use crate::error::SimError;
use crate::maps::OrderedMaps;
use crate::metrics::{Domain, LitSet, Reference, Score};
use hemilux::pipeline::{Pipeline, Settings};
use hemilux::recorded::LensFile;
use hemilux::samplers;
use hemilux_core::lens::{Intrinsics, Lens, Model};
use std::time::Instant;

/// An environment map with the inputs of samplers and the reference integrals of the scores.
pub struct ChartMap {
    env: EnvMap,
    maps: OrderedMaps,
    reference: Reference,
}

/// Light set of a method on one map, and the time of the decomposition.
#[derive(Clone, Debug)]
pub struct Timed {
    /// Directional lights and ambient light.
    pub set: LitSet,
    /// Time of one decomposition by the method, milliseconds.
    pub ms: f64,
}

impl ChartMap {
    /// Computes the inputs of samplers and the reference integrals of `env`.
    #[must_use]
    pub fn new(env: &EnvMap) -> Self {
        let domain = Domain::Sphere;
        let mut maps = OrderedMaps::new(env, domain, &[1, super::MOST]);
        maps.fill(env);
        Self { env: env.clone(), maps, reference: Reference::new(env, domain) }
    }

    /// Scores a light set against the map.
    #[must_use]
    pub fn score(&self, set: &LitSet) -> Score {
        self.reference.score(set)
    }

    /// Updates a new sampler of the core `repeats` times with the map; returns the last set and the median time of an update.
    ///
    /// # Panics
    /// If the sampler does not support `lights` lights.
    #[must_use]
    pub fn time_core(&self, method: &Method, lights: usize, repeats: usize) -> Timed {
        let (shape, view) = self.maps.of(lights);
        let mut sampler = samplers::make(method.sampler(), shape, lights)
            .expect("the sampler supports the number of lights");
        let (mut times, mut set) = (Vec::new(), LitSet::default());
        for _ in 0..repeats.max(1) {
            let began = Instant::now();
            let made = sampler.update(&view, &method.request(lights));
            times.push(1e3 * began.elapsed().as_secs_f64());
            set = judged(&made);
        }
        Timed { set, ms: median(times) }
    }

    /// Runs a new baseline; returns its set and its set after the Voronoi gather, each with its time. A baseline with state (`-warm`) runs twice,
    /// and the second run is returned.
    #[must_use]
    pub fn time_baseline(&self, name: &str, lights: usize) -> [Timed; 2] {
        let mut sampler = baseline_called(name);
        if name.ends_with("-warm") {
            let _ = sampler.decompose(&self.env, Domain::Sphere, lights);
        }
        let began = Instant::now();
        let made = sampler.decompose(&self.env, Domain::Sphere, lights);
        let ms = 1e3 * began.elapsed().as_secs_f64();
        let gathered = gather(&self.env, Domain::Sphere, &made);
        let gathered_ms = 1e3 * began.elapsed().as_secs_f64();
        [Timed { set: made.into(), ms }, Timed { set: gathered.into(), ms: gathered_ms }]
    }
}

/// Returns the median; for an even number of values the upper of the two middle values, for no values 0.
pub(super) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// Returns the standard lens of `board/FORMATS.md`, with the values of `fixtures/lens-160x140.toml`.
fn standard_lens() -> LensFile {
    let mut vignetting = [0.0; 8];
    vignetting[0] = 1.0;
    let intrinsics = Intrinsics {
        model: Model::Equidistant,
        centre_px: glam::DVec2::new(319.5, 239.5),
        focal_px: glam::DVec2::splat(196.4),
        skew_px: 0.0,
        max_theta: 80f64.to_radians(),
        vignetting,
    };
    LensFile {
        lens: Lens::try_new(intrinsics).expect("the intrinsics are legal"),
        size: [640, 480],
        response: hemilux_core::Response::Linear,
        levels: None,
        noise: None,
        lens_table: toml::Table::new(),
        response_table: None,
        calibration_table: None,
        shown: None,
        notes: Vec::new(),
    }
}

/// Sets the median time from a burst of three frames to lights of the points of core samplers.
pub(super) fn bursts(env: &EnvMap, points: &mut [Point], repeats: usize) -> Result<(), SimError> {
    let sensor = burst::Sensor { bits: 8, full_well: 10_000.0, read_noise: 3.0 };
    let (calibration, burst) = burst::in_memory(env, &standard_lens(), &burst::THESIS_EXPOSURES_S, sensor, 1);
    let exposures: Vec<_> = burst.frames.iter().map(|f| f.exposure).collect();
    let core: Vec<_> = methods().into_iter().filter(|m| m.kind == MethodKind::Core).collect();
    for point in points {
        let Some(method) = core.iter().find(|m| m.name == point.sampler) else { continue };
        let lights = point.lights.max(method.least(Domain::Hemisphere));
        let ambient = method.request(lights).ambient;
        let settings = Settings { sampler: method.sampler(), lights, ambient, ..Settings::default() };
        let mut pipeline = Pipeline::try_new(calibration, &exposures, settings)?;
        let mut times = Vec::new();
        for _ in 0..repeats.max(1) {
            let began = Instant::now();
            pipeline.process(&burst)?;
            times.push(1e3 * began.elapsed().as_secs_f64());
        }
        point.burst_ms = Some(median(times));
    }
    Ok(())
}
