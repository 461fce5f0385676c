//! Measurement of the photometric factor: lux per unit of irradiance, and candela per square metre per unit of radiance.

use crate::calibration::{Burst, Calibration};
use crate::pipeline::{Pipeline, PipelineError, Settings};
use crate::source::{Source, SourceError};
use glam::{DVec2, DVec3};
use hemilux_core::color::luminance;
use hemilux_core::{healpix, read_rgb_row};
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::time::{Duration, Instant};

/// The position of the luxmeter, and its reading.
#[derive(Clone, Debug, PartialEq)]
pub enum Method {
    /// The luxmeter lies next to the probe, level with it.
    Direct {
        /// Reading of the luxmeter, lux.
        lux: f64,
        /// Assumed radiance of the part of the hemisphere outside of the lens's field of view.
        unseen: Unseen,
    },
    /// The luxmeter lies on a matt patch in the probe's field of view.
    Indirect {
        /// Outline of the patch, pixels: at least three corners in order.
        outline: Vec<DVec2>,
        /// Fraction of the light that the patch reflects, 0 to 1.
        reflectance: f64,
        /// Illuminance of the patch that the luxmeter reads, lux.
        lux: f64,
    },
}

impl Method {
    /// Returns the name of the method in lens files.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Direct { .. } => "direct",
            Self::Indirect { .. } => "indirect",
        }
    }
}

/// Assumption about the light from the part of the hemisphere outside of the lens's field of view.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Unseen {
    /// The radiance at each azimuth equals that at the rim of the field of view.
    #[default]
    Rim,
    /// The radiance equals the mean over the field of view.
    Average,
    /// The radiance is 0 outside of the field of view.
    Dark,
}

/// Reasons why no photometric factor is measured; the text is one line with the remedy.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PhotometricRefusal {
    /// The source of the camera delivered no bursts.
    #[error("source: found {0}, expected bursts")]
    Source(String),
    /// The calibration of the source does not allow a radiance map.
    #[error("{0}")]
    Pipeline(String),
    /// Pixels of the hemisphere clip in the shortest exposure.
    #[error(
        "found {percent:.4} % of the hemisphere clipped in the shortest exposure, expected none: add a shorter exposure, or measure in other light"
    )]
    Clipped {
        /// Clipped share of the hemisphere, per cent.
        percent: f64,
    },
    /// Pixels of the patch clip in the shortest exposure.
    #[error(
        "--patch: found pixels that clip in the shortest exposure, expected none: add a shorter exposure, or light the patch less"
    )]
    PatchClips,
    /// The mean radiance over the field of view or the patch is 0.
    #[error("found no light, expected a lit scene: {0}")]
    Dark(&'static str),
    /// The outline of the patch encloses too few texels of the map.
    #[error(
        "--patch: found an outline that holds {texels} texels of the map, expected at least {least}: give the corners of a larger patch in order, inside the image circle"
    )]
    Outline {
        /// Number of texels inside of the outline of the patch.
        texels: usize,
        /// Least number of texels that a patch must contain.
        least: usize,
    },
    /// The light changed from burst to burst during the measurement.
    #[error(
        "found light that varied by {percent:.1} % between bursts, expected at most 10: wait for steady light, and keep people and shadows away"
    )]
    Unsteady {
        /// Standard deviation of the light between bursts, per cent of the mean.
        percent: f64,
    },
}

impl From<PipelineError> for PhotometricRefusal {
    fn from(error: PipelineError) -> Self {
        Self::Pipeline(error.to_string())
    }
}

/// One measurement of the photometric factor; uncertainties are standard deviations.
#[derive(Clone, Debug, PartialEq)]
pub struct FactorReading {
    /// Name of the method, `direct` or `indirect`.
    pub method: String,
    /// Illuminance in lux per unit of relative irradiance.
    pub factor: f64,
    /// Relative uncertainty of this measurement alone, from noise, unevenness of the patch, and the unseen part of the hemisphere.
    pub own: f64,
    /// Relative uncertainty that is common to all measurements with the same luxmeter.
    pub shared: f64,
    /// Fraction of a level surface's irradiance that comes from outside of the lens's field of view under uniform radiance, 0 to 1.
    pub unseen: f64,
}

/// A mean radiance and its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Level {
    value: f64,
    /// Standard deviation of the mean radiance.
    deviation: f64,
}

/// Largest accepted standard deviation of the light between bursts, relative to the mean.
const MOST_UNSTEADY: f64 = 0.10;

/// Largest accepted clipped fraction of the hemisphere: below the solid angle of one pixel of most cameras.
const MOST_CLIPPED: f64 = 1e-6;

/// HEALPix orders of the measured map in order of preference, from texels of half a degree: the first one that the pixels fill is used.
const ORDERS: [u8; 4] = [7, 6, 5, 4];

/// Longest time in which all bursts of a measurement must arrive.
const PATIENCE: Duration = Duration::from_secs(20);

/// Measures the photometric factor over `bursts` bursts of `source`, whose radiance must be relative. `shared` is the relative standard
/// deviation of the luxmeter; for a patch, it includes that of the patch's reflectance.
///
/// # Errors
/// [`PhotometricRefusal`] if the light or the scene does not allow a measurement.
pub fn measure(
    source: &mut dyn Source,
    method: &Method,
    bursts: usize,
    shared: f64,
) -> Result<FactorReading, PhotometricRefusal> {
    let mut burst = Burst::default();
    next(source, &mut burst)?;
    let calibration = *source.calibration();
    let mut pipeline = pipeline(&calibration, source)?;
    let view = View::of(&calibration);
    let mut levels = Vec::new();
    for i in 0..bursts.max(1) {
        if i > 0 {
            next(source, &mut burst)?;
        }
        levels.push(level(&mut pipeline, &burst, &view, method)?);
    }
    combined(&levels, method, shared, view.unseen)
}

fn next(source: &mut dyn Source, burst: &mut Burst) -> Result<(), PhotometricRefusal> {
    let began = Instant::now();
    loop {
        match source.next(burst) {
            Ok(()) => return Ok(()),
            Err(SourceError::NotYet) if began.elapsed() < PATIENCE => {}
            Err(error) => return Err(PhotometricRefusal::Source(error.to_string())),
        }
    }
}

/// Creates a pipeline with the finest map whose texels all contain pixels.
fn pipeline(calibration: &Calibration, source: &dyn Source) -> Result<Pipeline, PhotometricRefusal> {
    let make = |order: u8| {
        let settings = Settings { order: Some(order), ..Settings::default() };
        Pipeline::try_new(*calibration, &source.exposures(), settings)
    };
    let mut made = make(ORDERS[0]);
    for order in &ORDERS[1..] {
        if matches!(made, Err(PipelineError::PixelTable(_))) {
            made = make(*order);
        }
    }
    Ok(made?)
}

/// Returns the quantity of one burst by which the luxmeter's reading is divided: irradiance, or radiance times pi.
fn level(
    pipeline: &mut Pipeline,
    burst: &Burst,
    view: &View,
    method: &Method,
) -> Result<Level, PhotometricRefusal> {
    let processed = pipeline.process(burst)?;
    let (clipped, seen) = (processed.seen.clipped, luminance(processed.horizontal_irradiance));
    match method {
        Method::Direct { unseen, .. } => {
            if f64::from(clipped as f32) > MOST_CLIPPED {
                return Err(PhotometricRefusal::Clipped { percent: 100.0 * f64::from(clipped as f32) });
            }
            Ok(view.whole(pipeline, f64::from(seen), *unseen))
        }
        Method::Indirect { outline, reflectance, .. } => {
            if patch_clips(burst, pipeline.calibration(), outline) {
                return Err(PhotometricRefusal::PatchClips);
            }
            let patch = patch(pipeline, outline)?;
            Ok(Level { value: patch.value * PI / reflectance, deviation: patch.deviation * PI / reflectance })
        }
    }
}

fn combined(
    levels: &[Level],
    method: &Method,
    shared: f64,
    unseen: f64,
) -> Result<FactorReading, PhotometricRefusal> {
    let count = levels.len() as f64;
    let mean = levels.iter().map(|level| level.value).sum::<f64>() / count;
    let (lux, what) = match method {
        Method::Direct { lux, .. } => (*lux, "the irradiance of the probe is 0"),
        Method::Indirect { lux, .. } => (*lux, "the patch is black"),
    };
    if !(mean > 0.0 && mean.is_finite()) {
        return Err(PhotometricRefusal::Dark(what));
    }
    let squares = levels.iter().map(|level| (level.value / mean - 1.0).powi(2)).sum::<f64>();
    let scatter = (squares / (count - 1.0).max(1.0)).sqrt();
    if scatter > MOST_UNSTEADY {
        return Err(PhotometricRefusal::Unsteady { percent: 100.0 * scatter });
    }
    // The systematic part of the uncertainty is the same in all bursts; the random part decreases with the number of bursts.
    let same = levels.iter().map(|level| level.deviation).fold(0.0, f64::max) / mean;
    let own = same.hypot(scatter / count.sqrt());
    Ok(FactorReading { method: method.name().into(), factor: lux / mean, own, shared, unseen })
}

/// Number of azimuths, and of angles from the zenith, of the grid on which the visible part of the hemisphere is determined.
const AZIMUTHS: usize = 360;
const ANGLES: usize = 360;

/// Width of the rim of the field of view, in steps of the angle from the zenith: 5 degrees.
const RIM: usize = 20;

/// The part of the hemisphere in a camera's field of view.
struct View {
    /// Number of visible steps of the angle from the zenith, for each azimuth.
    seen: Vec<usize>,
    /// Fraction of the cosine-weighted hemisphere outside of the field of view, 0 to 1.
    unseen: f64,
}

fn direction(azimuth: usize, angle: usize) -> DVec3 {
    let phi = TAU * (azimuth as f64 + 0.5) / AZIMUTHS as f64;
    let theta = FRAC_PI_2 * (angle as f64 + 0.5) / ANGLES as f64;
    DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
}

/// Returns the irradiance of a level surface by a radiance of 1 in one azimuth's sector, between the steps `from` and `to` of the angle
/// from the zenith.
fn weight(from: usize, to: usize) -> f64 {
    let sine2 = |angle: usize| (FRAC_PI_2 * angle as f64 / ANGLES as f64).sin().powi(2);
    PI / AZIMUTHS as f64 * (sine2(to) - sine2(from))
}

impl View {
    fn of(calibration: &Calibration) -> Self {
        let size = [calibration.layout.width(), calibration.layout.height()].map(f64::from);
        let within = |p: DVec2| p.x > -0.5 && p.y > -0.5 && p.x < size[0] - 0.5 && p.y < size[1] - 0.5;
        let is_seen =
            |azimuth, angle| calibration.lens.project(direction(azimuth, angle)).is_some_and(within);
        let seen = |azimuth| (0..ANGLES).rev().find(|angle| is_seen(azimuth, *angle)).map_or(0, |a| a + 1);
        let seen: Vec<usize> = (0..AZIMUTHS).map(seen).collect();
        let unseen = seen.iter().map(|seen| weight(*seen, ANGLES)).sum::<f64>() / PI;
        Self { seen, unseen }
    }

    /// Returns the irradiance of a level surface by the whole hemisphere, from the measured irradiance `seen` by the visible part.
    fn whole(&self, pipeline: &Pipeline, seen: f64, unseen: Unseen) -> Level {
        let average = if self.unseen < 1.0 { seen * self.unseen / (1.0 - self.unseen) } else { 0.0 };
        let rim = self.rim(pipeline);
        let added = match unseen {
            Unseen::Rim => rim,
            Unseen::Average => average,
            Unseen::Dark => 0.0,
        };
        // The standard deviation of the unseen part is at least one third of it, and at least the difference between the assumptions.
        let deviation = match unseen {
            Unseen::Dark => rim / 10.0,
            _ => (0.5 * (rim - average).abs()).max(added / 3.0),
        };
        Level { value: seen + added, deviation }
    }

    /// Returns the irradiance of a level surface by the unseen part, if the radiance at each azimuth equals that at the rim.
    fn rim(&self, pipeline: &Pipeline) -> f64 {
        let one = |(azimuth, seen): (usize, &usize)| {
            let angles = seen.saturating_sub(RIM)..*seen;
            let count = angles.len().max(1) as f64;
            let sum: f64 = angles.map(|angle| radiance(pipeline, direction(azimuth, angle))).sum();
            sum / count * weight(*seen, ANGLES)
        };
        self.seen.iter().enumerate().map(one).sum()
    }
}

/// Returns the luminance of the radiance map in `direction`.
fn radiance(pipeline: &Pipeline, direction: DVec3) -> f64 {
    let view = pipeline.front().map();
    let order = view.order().get();
    luminance(view.radiance(order, healpix::ipix(order, direction))).into()
}

/// Least number of texels of the map inside of a patch.
const FEWEST_TEXELS: usize = 12;

/// Returns the Gaussian-weighted mean radiance of a patch, and the standard deviation of the mean that results from the unevenness of the
/// patch.
fn patch(pipeline: &Pipeline, outline: &[DVec2]) -> Result<Level, PhotometricRefusal> {
    let lens = pipeline.calibration().lens;
    let (order, quads) = (pipeline.front().order().get(), pipeline.sketch(u8::MAX));
    let middle = outline.iter().sum::<DVec2>() / outline.len().max(1) as f64;
    let sigma = 0.45 * inner_radius(outline, middle);
    let texel = |ipix: usize| {
        let at = lens.project(healpix::centre(order, ipix as u32)).filter(|at| is_inside(outline, *at))?;
        let weight = (-0.5 * at.distance_squared(middle) / (sigma * sigma)).exp();
        let radiance = pipeline.front().map().radiance(order, ipix as u32);
        Some((weight, f64::from(luminance(radiance))))
    };
    let texels: Vec<(f64, f64)> = (0..quads.len()).filter_map(texel).collect();
    if texels.len() < FEWEST_TEXELS || sigma <= 0.0 {
        return Err(PhotometricRefusal::Outline { texels: texels.len(), least: FEWEST_TEXELS });
    }
    let sum: f64 = texels.iter().map(|(weight, _)| weight).sum();
    let value = texels.iter().map(|(weight, radiance)| weight * radiance).sum::<f64>() / sum;
    let squares: f64 = texels.iter().map(|(weight, radiance)| weight * (radiance - value).powi(2)).sum();
    let effective = sum * sum / texels.iter().map(|(weight, _)| weight * weight).sum::<f64>();
    Ok(Level { value, deviation: (squares / sum / effective).sqrt() })
}

/// Relative code from which a pixel of a patch counts as clipped.
const CLIPS: f64 = 0.97;

/// Returns whether a pixel of the patch clips in the shortest exposure.
fn patch_clips(burst: &Burst, calibration: &Calibration, outline: &[DVec2]) -> bool {
    let Some(shortest) = burst.frames.first() else { return false };
    let (layout, levels) = (&calibration.layout, calibration.levels);
    let full = levels.black + CLIPS * (levels.white - levels.black);
    let mut row = vec![[0u16; 3]; layout.width() as usize];
    let bound =
        |pick: fn(f64, f64) -> f64, start: f64| outline.iter().map(|p| p.y).fold(start, pick).max(0.0);
    let (top, bottom) =
        (bound(f64::min, f64::MAX), bound(f64::max, 0.0).min(f64::from(layout.height()) - 1.0));
    (top as u32..=bottom as u32).any(|y| {
        read_rgb_row(layout, shortest.pixels.samples(), y, &mut row);
        let pixels = row.iter().enumerate().filter(|(_, rgb)| rgb.iter().any(|v| f64::from(*v) >= full));
        pixels.map(|(x, _)| DVec2::new(x as f64, y.into())).any(|at| is_inside(outline, at))
    })
}

/// Returns whether the point `at` lies in the polygon `outline`, by the parity of the number of edges to its right.
fn is_inside(outline: &[DVec2], at: DVec2) -> bool {
    let edges = outline.iter().zip(outline.iter().cycle().skip(1));
    let crosses = |(a, b): &(&DVec2, &DVec2)| {
        (a.y > at.y) != (b.y > at.y) && at.x < a.x + (at.y - a.y) / (b.y - a.y) * (b.x - a.x)
    };
    edges.filter(crosses).count() % 2 == 1
}

/// Returns the distance from the point `at` inside a polygon to the nearest edge; 0 for a point outside.
fn inner_radius(outline: &[DVec2], at: DVec2) -> f64 {
    if outline.len() < 3 || !is_inside(outline, at) {
        return 0.0;
    }
    let edges = outline.iter().zip(outline.iter().cycle().skip(1));
    let distance = |(a, b): (&DVec2, &DVec2)| {
        let along = ((at - *a).dot(*b - *a) / a.distance_squared(*b).max(1e-12)).clamp(0.0, 1.0);
        at.distance(a.lerp(*b, along))
    };
    edges.map(distance).fold(f64::INFINITY, f64::min)
}
