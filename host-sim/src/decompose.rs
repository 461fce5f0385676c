//! `hemilux-sim decompose`: converts environment maps to light sets.

use crate::env::EnvMap;
use crate::error::SimError;
use crate::export::Export;
use crate::maps::{self, Maps};
use crate::output::Files;
use hemilux::maps::{Covers, FLOAT_MAX, HALF_MAX, ReadOptions};
use hemilux::samplers::{self, Shape};
use hemilux::scene;
use hemilux_core::SamplerKind;
use hemilux_core::healpix::Domain;
use hemilux_core::sampler::Request;
use hemilux_core::wire::{Latency, LightSet};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Arguments of `decompose`.
#[derive(Clone, Debug)]
pub struct DecomposeJob {
    /// Path of a map, or of a folder whose maps in name order are one sequence.
    pub env: PathBuf,
    /// Sampler that decomposes the maps.
    pub sampler: SamplerKind,
    /// Number of lights, tolerance, ambient light and disc shape.
    pub request: Request,
    /// Options for reading maps; `covers` can also select the upper half of a map of the whole sphere.
    pub options: ReadOptions,
    /// Number of maps per second of a sequence.
    pub fps: f64,
    /// Paths of pictures and maps to write.
    pub files: Files,
    /// File format and axes of the light sets.
    pub export: Export,
}

/// Writes one light set per map to standard output.
///
/// # Errors
/// [`SimError`] if a map cannot be read or decomposed, or an output cannot be written.
pub fn run(job: &DecomposeJob) -> Result<(), SimError> {
    let paths = list(&job.env)?;
    job.export.check_count(paths.len())?;
    let first = read(&paths[0], &job.options)?;
    let domain = domain(&first, &job.options);
    samplers::check(job.sampler, domain, &job.request)?;
    let order = samplers::order_for(job.request.lights);
    let shape = Shape { domain, order, grid: maps::grid(&first, domain) };
    let mut sampler = samplers::make(job.sampler, &shape, job.request.lights)?;
    let mut maps = Maps::new(shape.domain, shape.order, shape.grid);
    let many = paths.len() > 1 || job.env.is_dir();
    let mut first = Some(first);
    for (frame, path) in paths.iter().enumerate() {
        let env = first.take().map_or_else(|| read(path, &job.options), Ok)?;
        check_domain(&env, domain, path, &job.options)?;
        let began = Instant::now();
        maps.fill(&env);
        let filled = began.elapsed();
        let map = maps.view();
        let name = sampler.kind().name();
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
            clipped: env.clipped_share(domain) as f32,
            estimated_error: made.estimated_error,
            latency,
            ..LightSet::EMPTY
        };
        job.export.print(&set, map_name(job, domain).as_deref())?;
        job.files.write(
            many.then_some(frame),
            &map.polar,
            maps::radiance(&env, map.polar.grid),
            made.lights,
        )?;
    }
    Ok(())
}

/// Returns the path of the map to which a light set refers: the written map if there is one, else the input map if it covers the whole sphere.
fn map_name(job: &DecomposeJob, domain: Domain) -> Option<PathBuf> {
    let read = || job.env.canonicalize().ok().filter(|env| env.is_file() && domain == Domain::Sphere);
    job.files.map_name().or_else(read)
}

/// Number of rows of the map that is rendered of a built-in scene.
const SCENE_ROWS: usize = 256;

/// Reads the map `path`; `scene:NAME` is the map of a built-in scene at time 0. The number of texels out of range and the notes of the file's
/// reader are printed on standard error.
///
/// # Errors
/// [`SimError`] with the path of a map that cannot be read, or with the name of an unknown scene.
pub fn read(path: &Path, options: &ReadOptions) -> Result<EnvMap, SimError> {
    if let Some(name) = path.to_str().and_then(|p| p.strip_prefix("scene:")) {
        let expected = format!("scene:{}", scene::NAMES.join(", scene:"));
        let scene = scene::by_name(name).ok_or_else(|| SimError::at(path, "an unknown scene", &expected))?;
        return Ok(EnvMap::from_fn(2 * SCENE_ROWS, SCENE_ROWS, |d| scene.radiance(d.map(|v| v as f32), 0.0)));
    }
    let env = EnvMap::read_with(path, options)?;
    let print = |note: &str| eprintln!("hemilux-sim: {}: {note}", path.display());
    env.notes.iter().for_each(|note| print(note));
    if env.negative > 0 {
        print(&format!("found {} texels with negative values or NaN, which are read as 0", env.negative));
    }
    if env.clipped() > 0 {
        print(&format!(
            "found {} texels above the largest value ({}), which are clipped",
            env.clipped(),
            limits()
        ));
    }
    Ok(env)
}

/// Returns the largest accepted values of half floats and of other maps, in words.
fn limits() -> String {
    format!("{HALF_MAX} for half floats and infinities, {FLOAT_MAX:e} for others")
}

/// Returns the part of the sphere that lights and scores cover: the coverage of the command line if there is one, else the map's own.
#[must_use]
pub fn domain(env: &EnvMap, options: &ReadOptions) -> Domain {
    match options.covers {
        Some(Covers::Hemisphere) => Domain::Hemisphere,
        Some(Covers::Sphere) => Domain::Sphere,
        None => env.domain(),
    }
}

/// Refuses a map of a sequence whose coverage differs from `expected`, the coverage of the sequence's first map.
fn check_domain(env: &EnvMap, expected: Domain, path: &Path, options: &ReadOptions) -> Result<(), SimError> {
    if domain(env, options) == expected {
        return Ok(());
    }
    let found = format!(
        "a map of the {}",
        Covers::name(if expected == Domain::Sphere { Covers::Hemisphere } else { Covers::Sphere })
    );
    Err(SimError::at(
        path,
        found,
        "the coverage of the sequence's first map (--hemisphere or --sphere sets it)",
    ))
}

/// Returns the path `env` if it is no folder, else the paths of the folder's maps in name order.
///
/// # Errors
/// [`SimError`] if the folder cannot be read or has no map.
pub fn list(env: &Path) -> Result<Vec<PathBuf>, SimError> {
    if !env.is_dir() {
        return Ok(vec![env.into()]);
    }
    let entries = std::fs::read_dir(env).map_err(|e| SimError::at(env, e, "a readable folder"))?;
    let is_map = |path: &PathBuf| {
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        matches!(extension.as_deref(), Some("exr" | "hdr" | "pic" | "rgbe" | "xyze" | "pfm"))
    };
    let mut paths: Vec<_> = entries.filter_map(|entry| Some(entry.ok()?.path())).filter(is_map).collect();
    paths.sort();
    if paths.is_empty() {
        Err(SimError::at(env, "no .exr, .hdr, .pic or .pfm file", "at least one map"))
    } else {
        Ok(paths)
    }
}
