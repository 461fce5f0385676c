//! `hemilux-sim decompose`: environment maps to light sets.

use crate::env::EnvMap;
use crate::error::SimError;
use crate::maps::{self, Maps};
use crate::output::{self, Files};
use hemilux::samplers::{self, Shape};
use hemilux::scene;
use hemilux_core::healpix::Domain;
use hemilux_core::sampler::Request;
use hemilux_core::wire::{Latency, LightSet};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Arguments of `decompose`.
#[derive(Clone, Debug)]
pub struct Job {
    /// A map, or a folder of maps that are one sequence in name order.
    pub env: PathBuf,
    /// Name of the sampler.
    pub sampler: String,
    /// Lights, tolerance, ambient light.
    pub request: Request,
    /// The whole sphere or its upper half.
    pub domain: Domain,
    /// Maps a second of a sequence.
    pub fps: f64,
    /// Paths of pictures and maps to write.
    pub files: Files,
}

/// Prints one light set per map.
///
/// # Errors
/// [`SimError`].
pub fn run(job: &Job) -> Result<(), SimError> {
    samplers::check(&job.sampler, job.domain, &job.request)?;
    let paths = list(&job.env)?;
    let first = read(&paths[0])?;
    let order = samplers::order_for(job.request.lights);
    let shape = Shape { domain: job.domain, order, grid: maps::grid(&first, job.domain) };
    let mut sampler = samplers::make(&job.sampler, &shape, job.request.lights)?;
    let mut maps = Maps::new(shape.domain, shape.order, shape.grid);
    let many = paths.len() > 1 || job.env.is_dir();
    let mut first = Some(first);
    for (frame, path) in paths.iter().enumerate() {
        let env = first.take().map_or_else(|| read(path), Ok)?;
        let began = Instant::now();
        maps.fill(&env);
        let filled = began.elapsed();
        let map = maps.view();
        let name = sampler.name();
        let made = sampler.update(&map, &job.request);
        let us = |d: std::time::Duration| u32::try_from(d.as_micros()).unwrap_or(u32::MAX);
        let total = began.elapsed();
        let latency = Latency {
            pyramid: us(filled),
            sample: us(total - filled),
            total: us(total),
            ..Latency::default()
        };
        let set = LightSet {
            run: "sim",
            frame: frame as u64,
            timestamp_ns: (frame as f64 / job.fps * 1e9) as u64,
            valid: true,
            sampler: name,
            requested: job.request.lights as u32,
            lights: made.lights,
            ambient_sh: made.ambient.as_ref(),
            scalar_flux: map.pyramid.total().rgb(),
            horizontal_irradiance: map.pyramid.horizontal_irradiance(),
            estimated_error: made.estimated_error,
            latency,
            ..LightSet::EMPTY
        };
        output::print(&set)?;
        job.files.write(many.then_some(frame), &map.polar, made.lights)?;
    }
    Ok(())
}

/// Rows of the map of a built-in scene, as in the maps of the charts.
const SCENE_ROWS: usize = 256;

/// Reads a map, or makes that of the built-in scene `scene:NAME` at its beginning, and tells on standard error how many texels were
/// out of range.
///
/// # Errors
/// [`SimError`].
pub fn read(path: &Path) -> Result<EnvMap, SimError> {
    if let Some(name) = path.to_str().and_then(|p| p.strip_prefix("scene:")) {
        let expected = format!("scene:{}", scene::NAMES.join(", scene:"));
        let scene = scene::by_name(name).ok_or_else(|| SimError::at(path, "no such scene", &expected))?;
        return Ok(EnvMap::from_fn(2 * SCENE_ROWS, SCENE_ROWS, |d| scene.radiance(d.map(|v| v as f32), 0.0)));
    }
    let env = EnvMap::read(path)?;
    if env.clamped > 0 {
        eprintln!("hemilux-sim: {}: clamped {} texels to 0..65504", path.display(), env.clamped);
    }
    Ok(env)
}

/// The maps that `env` names: itself, or what a folder holds in name order.
///
/// # Errors
/// [`SimError`].
pub fn list(env: &Path) -> Result<Vec<PathBuf>, SimError> {
    if !env.is_dir() {
        return Ok(vec![env.into()]);
    }
    let entries = std::fs::read_dir(env).map_err(|e| SimError::at(env, e, "a readable folder"))?;
    let is_map = |path: &PathBuf| {
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        matches!(extension.as_deref(), Some("exr" | "hdr"))
    };
    let mut paths: Vec<_> = entries.filter_map(|entry| Some(entry.ok()?.path())).filter(is_map).collect();
    paths.sort();
    if paths.is_empty() {
        Err(SimError::at(env, "no .exr or .hdr file", "at least one map"))
    } else {
        Ok(paths)
    }
}
