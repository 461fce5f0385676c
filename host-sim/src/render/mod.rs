//! `hemilux-sim render`: renders a scene under a map and under a light set, and the difference between the renderings.
//!
//! The scene is a ground plane, a glossy sphere, a box and a torus with direct lighting (no light between surfaces) and hard shadow rays.
//! The reference is the rendering under a dense set of directional lights for the map: one for each lit texel of a small map, or one for each of
//! the 3,072 quads of HEALPix order 4, in the direction of the quad's energy centroid.

mod letters;
mod over;
mod picture;
mod scene;
mod shade;
#[cfg(test)]
mod tests;

use crate::decompose;
use crate::env::EnvMap;
use crate::error::SimError;
use crate::maps::Maps;
use crate::metrics::receiver::fib;
use crate::metrics::{Domain, LitSet, TexelGrid, luminance, sh};
use crate::output;
use crate::progress;
use crate::score::read_set;
use hemilux::maps::ReadOptions;
use hemilux_core::healpix;
use scene::{PinholeCamera, Scene};
use shade::Directional;
use std::f64::consts::PI;
use std::path::PathBuf;

/// Width and height of a panel of the picture, pixels.
const PANEL: [usize; 2] = [640, 420];
/// Largest number of lit texels of a map that become one light each; a map with more lit texels becomes one light per quad.
const TEXELS: usize = 4096;
/// HEALPix order of the quads of a map that become one light each: 3,072 quads of 3.7 degrees.
const ORDER: u8 = 4;
/// Number of directional lights that approximate ambient light.
const AMBIENT: usize = 512;

/// Arguments of the command `render`.
#[derive(Clone, Debug)]
pub struct RenderJob {
    /// Path of the environment map.
    pub env: PathBuf,
    /// Options for reading the map.
    pub options: ReadOptions,
    /// Path of the light set, a JSON file.
    pub set: PathBuf,
    /// Path of the written picture, PNG or JPEG.
    pub out: PathBuf,
    /// Path of a photograph into which the objects are inserted; `None` for a comparison of map and light set.
    pub over: Option<PathBuf>,
}

/// Renders the scene and writes the picture `job.out`.
///
/// # Errors
/// [`SimError`] if an input cannot be read or the picture cannot be written.
pub fn run(job: &RenderJob) -> Result<(), SimError> {
    let set = read_set(&job.set)?;
    let env = decompose::read(&job.env, &job.options)?;
    let made = of_set(&set);
    let picture = match &job.over {
        Some(photo) => over::composite(&over::read(photo)?, &made),
        None => side_by_side(&env, &made, set.lights.len()),
    };
    output::save_picture(&job.out, &picture)
}

/// Returns a picture of three labelled panels: the reference, the rendering under the light set, and the difference.
fn side_by_side(env: &EnvMap, made: &[Directional], lights: usize) -> image::RgbImage {
    let truth = of_map(env);
    let scene = Scene::STANDARD;
    let camera = PinholeCamera::new(PANEL);
    let reference = shoot(&scene, &camera, &truth, env, "reference");
    let found = shoot(&scene, &camera, made, env, "light set");
    let labels = [
        format!("REFERENCE: {} DIRECTIONS", truth.len()),
        format!("LIGHT SET: {lights} LIGHTS"),
        String::new(),
    ];
    picture::panels(&reference, &found, labels)
}

/// Radiance of one rendered panel.
pub struct Shot {
    /// Columns and rows of the panel, pixels.
    pub size: [usize; 2],
    /// Radiance (red, green, blue) of each pixel, row-major.
    pub radiance: Vec<[f64; 3]>,
    /// Whether each pixel shows a surface of the scene; the other pixels show the map.
    pub surface: Vec<bool>,
}

/// Renders one panel, with its rows distributed over all cores; pixels without a surface show the map. `what` is the label of the progress bar.
fn shoot(
    scene: &Scene,
    camera: &PinholeCamera,
    lights: &[Directional],
    env: &EnvMap,
    what: &'static str,
) -> Shot {
    let [width, height] = camera.size;
    let bar = progress::bar(what, height);
    let rows = progress::on_all_cores(height, |row| {
        let pixel = |column: usize| {
            let ray = camera.ray(column, row);
            match scene.hit(&ray) {
                Some(hit) => (shade::radiance(scene, &hit, ray.direction, lights), true),
                None => (lookup(env, ray.direction), false),
            }
        };
        let pixels: Vec<([f64; 3], bool)> = (0..width).map(pixel).collect();
        bar.inc(1);
        pixels
    });
    bar.finish_and_clear();
    let (radiance, surface) = rows.into_iter().flatten().unzip();
    Shot { size: camera.size, radiance, surface }
}

fn lookup(env: &EnvMap, d: [f64; 3]) -> [f64; 3] {
    let row = (d[2].clamp(-1.0, 1.0).acos() / PI * env.height() as f64) as usize;
    let column = ((PI - d[1].atan2(d[0])) / (2.0 * PI) * env.width() as f64) as usize;
    env.texels()[row.min(env.height() - 1) * env.width() + column.min(env.width() - 1)].map(f64::from)
}

/// Converts the texels of the map, or the quads of a coarser map if there are too many texels, to directional lights.
fn of_map(env: &EnvMap) -> Vec<Directional> {
    let grid = TexelGrid::new(env, Domain::Sphere);
    if grid.luminous(env).take(TEXELS + 1).count() <= TEXELS {
        let texels = grid.fluxes(env).filter(|(_, rgb)| luminance(*rgb) > 0.0);
        return texels.map(|(direction, irradiance)| Directional { direction, irradiance }).collect();
    }
    let shape = hemilux_core::polar::Grid { width: 4, height: 2, domain: Domain::Sphere };
    let mut maps = Maps::new(Domain::Sphere, ORDER, shape);
    maps.fill(env);
    let quads = maps.view().pyramid.quads_of(ORDER).iter().enumerate().filter(|(_, quad)| quad.y() > 0.0);
    let light = |(ipix, quad): (usize, &hemilux_core::pyramid::Quad)| {
        let centre = healpix::centre(ORDER, ipix as u32).as_vec3();
        let direction = quad.first_moment().try_normalize().unwrap_or(centre).to_array().map(f64::from);
        Directional { direction, irradiance: quad.rgb().map(f64::from) }
    };
    quads.map(light).collect()
}

/// Converts a light set to directional lights; ambient light becomes [`AMBIENT`] directional lights.
fn of_set(set: &LitSet) -> Vec<Directional> {
    let lights = set.lights.iter().map(|l| Directional { direction: l.direction, irradiance: l.irradiance });
    let ambient = set.ambient_sh.iter().flat_map(|rows| {
        (0..AMBIENT).map(|k| {
            let direction = fib(k, AMBIENT);
            let channel = |c: usize| sh::evaluate(&rows.map(|rgb| rgb[c]), direction);
            let irradiance = [0, 1, 2].map(|c| channel(c) * 4.0 * PI / AMBIENT as f64);
            Directional { direction, irradiance }
        })
    });
    lights.chain(ambient).collect()
}
