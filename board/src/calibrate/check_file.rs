//! Checks that a lens file, a burst and the camera match.

use super::burst::{ExposedBurst, exposed};
use super::response::{Exposed, logarithms_of};
use crate::calibration::Calibration;
use crate::recorded::{
    LensFile, RecordedError, Shown, photometric_camera, radiometry, read_lens, read_shown,
};
use glam::DVec2;
use hemilux_core::Response;
use hemilux_core::lens::Lens;
use std::f64::consts::TAU;
use std::path::Path;

/// A mismatch found by the check of a calibration; each class has its exit status.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Fault {
    /// The lens file or the burst cannot be read.
    #[error("{0}")]
    Unreadable(String),
    /// The lens file is for another image size.
    #[error("{path}: found a lens for {} x {} pixels, expected the burst's {} x {}: calibrate in the mode of the probe", lens[0], lens[1], burst[0], burst[1])]
    Size {
        /// Path of the lens file.
        path: String,
        /// Columns and rows of the images to which the lens file applies.
        lens: [u32; 2],
        /// Columns and rows of the burst's images.
        burst: [u32; 2],
    },
    /// The sum of the pixels' solid angles differs from the solid angle of the field of view.
    #[error(
        "{path}: found pixels of {found:.3} sr together, expected {expected:.3} sr for max_angle_deg: calibrate the lens again"
    )]
    SolidAngle {
        /// Path of the lens file.
        path: String,
        /// Sum of the pixels' solid angles, steradians.
        found: f64,
        /// Solid angle of the field of view, steradians.
        expected: f64,
    },
    /// The lens is used far beyond its calibrated angles, or its uncertainty is large.
    #[error(
        "{path}: found a lens {found}, expected a calibration up to the rim: take pictures with the board nearer to the rim"
    )]
    Uncertain {
        /// Path of the lens file.
        path: String,
        /// Description of the lens that the file contains.
        found: String,
    },
    /// The exposure ratio estimated from the burst's pictures differs from the ratio in `burst.toml`.
    #[error(
        "{path}: found exposures of the ratio {found:.2}, expected {expected:.2} as in burst.toml: calibrate the response, or check that the camera obeys its exposure settings"
    )]
    Exposures {
        /// Path of the recorded burst.
        path: String,
        /// Exposure ratio estimated from the pictures of the burst.
        found: f64,
        /// Ratio of two exposures that `burst.toml` states.
        expected: f64,
    },
    /// The burst was recorded in another mode of the camera.
    #[error(
        "{path}: found {found} in its burst.toml, expected {expected} as in the lens file: calibrate in the mode of the probe"
    )]
    Mode {
        /// Path of the recorded burst.
        path: String,
        /// Crop and binning of the burst, as text.
        found: String,
        /// Crop and binning of the lens file, as text.
        expected: String,
    },
    /// The camera's settings have changed since the photometric calibration.
    #[error(
        "{path}: found a photometric calibration by another response, level, white balance or vignetting than the burst has, expected one that is \
         not older than the camera's settings: run hemilux calibrate photometric again"
    )]
    Older {
        /// Path of the lens file.
        path: String,
    },
    /// The burst was recorded with another lens.
    #[error(
        "{path}: found another lens in its burst.toml, expected that of the lens file: the calibration is not the one that the camera was used with"
    )]
    OtherLens {
        /// Path of the recorded burst.
        path: String,
    },
}

impl Fault {
    /// Returns the exit status of the program for this class of fault, 3 to 10.
    #[must_use]
    pub fn status(&self) -> u8 {
        match self {
            Self::Unreadable(_) => 3,
            Self::Size { .. } => 4,
            Self::SolidAngle { .. } => 5,
            Self::Uncertain { .. } => 6,
            Self::Exposures { .. } => 7,
            Self::OtherLens { .. } => 8,
            Self::Mode { .. } => 9,
            Self::Older { .. } => 10,
        }
    }
}

/// Largest accepted relative error of the sum of the pixels' solid angles.
const MOST_SOLID: f64 = 0.01;

/// Largest accepted relative deviation of an estimated exposure ratio from the stated one.
const MOST_RATIO: f64 = 0.2;

/// Largest accepted angle between the outermost corner of the calibration and the edge of the field of view, degrees, and largest accepted
/// uncertainty at that edge, degrees.
const MOST_BEYOND_DEG: f64 = 12.0;
const MOST_UNCERTAIN_DEG: f64 = 1.0;

/// Checks the lens file at `path` and, if one is given, that the burst matches it.
///
/// # Errors
/// The first [`Fault`] that the check finds.
pub fn check(path: &Path, burst: Option<&Path>) -> Result<(), Fault> {
    let file = read_lens(path).map_err(|e| Fault::Unreadable(e.to_string()))?;
    solid_angles(path, &file)?;
    stated(path, &file)?;
    burst.map_or(Ok(()), |burst| with_burst(path, &file, burst))
}

/// Checks that the picture contains the whole image circle, and that the solid angles of its pixels add up to that of the field of view.
fn solid_angles(path: &Path, file: &LensFile) -> Result<(), Fault> {
    let [width, height] = file.size;
    let places = (0..height).flat_map(|y| (0..width).map(move |x| DVec2::new(f64::from(x), f64::from(y))));
    let found: f64 = places.filter_map(|at| file.lens.solid_angle(at)).sum();
    let expected = TAU * (1.0 - file.lens.intrinsics().max_theta.cos());
    let whole = is_whole(&file.lens, file.size);
    let is_off = if whole {
        (found / expected - 1.0).abs() > MOST_SOLID
    } else {
        found > (1.0 + MOST_SOLID) * expected
    };
    if is_off || found <= 0.0 {
        return Err(Fault::SolidAngle { path: path.display().to_string(), found, expected });
    }
    Ok(())
}

/// Returns whether no pixel of the picture's edge lies in the image circle.
fn is_whole(lens: &Lens, [width, height]: [u32; 2]) -> bool {
    let (right, bottom) = (f64::from(width) - 1.0, f64::from(height) - 1.0);
    let rows = (0..width).flat_map(|x| [DVec2::new(f64::from(x), 0.0), DVec2::new(f64::from(x), bottom)]);
    let columns = (0..height).flat_map(|y| [DVec2::new(0.0, f64::from(y)), DVec2::new(right, f64::from(y))]);
    rows.chain(columns).all(|at| lens.unproject(at).is_none())
}

/// Checks that the accuracy that the lens file states is sufficient. A file that states no accuracy passes.
fn stated(path: &Path, file: &LensFile) -> Result<(), Fault> {
    let fault = |found: String| Err(Fault::Uncertain { path: path.display().to_string(), found });
    let Some(statement) = &file.calibration_table else { return Ok(()) };
    let covered = statement.get("covered_deg").and_then(toml::Value::as_float);
    let used = file.lens.intrinsics().max_theta.to_degrees();
    if let Some(covered) = covered.filter(|covered| used > covered + MOST_BEYOND_DEG) {
        return fault(format!("that is used up to {used:.1} degrees and was calibrated up to {covered:.1}"));
    }
    let uncertainties = statement.get("uncertainty_deg").and_then(toml::Value::as_array);
    let worst = uncertainties.into_iter().flatten().filter_map(toml::Value::as_float).fold(0.0, f64::max);
    if worst > MOST_UNCERTAIN_DEG {
        fault(format!("whose uncertainty is {worst:.2} degrees"))
    } else {
        Ok(())
    }
}

fn with_burst(path: &Path, file: &LensFile, burst: &Path) -> Result<(), Fault> {
    let ExposedBurst { calibration, codes } = exposed(burst).map_err(|e| Fault::Unreadable(e.to_string()))?;
    let size = [calibration.layout.width(), calibration.layout.height()];
    if size != file.size {
        return Err(Fault::Size { path: path.display().to_string(), lens: file.size, burst: size });
    }
    mode(file, burst)?;
    photometric(path, &calibration)?;
    exposures(burst, &file.told_response().unwrap_or(calibration.response), &codes.frames)?;
    if is_other(&file.lens, &calibration.lens) {
        return Err(Fault::OtherLens { path: burst.display().to_string() });
    }
    Ok(())
}

/// Checks that the crop and binning of the burst are those of the lens file.
fn mode(file: &LensFile, burst: &Path) -> Result<(), Fault> {
    let shown = read_shown(burst).map_err(|e| Fault::Unreadable(e.to_string()))?;
    let Some((expected, found)) = file.shown.zip(shown).filter(|(a, b)| a != b) else { return Ok(()) };
    let phrase = |shown: &Shown| format!("crop = {:?}, binning = {:?}", shown.crop, shown.binning);
    let (found, expected) = (phrase(&found), phrase(&expected));
    Err(Fault::Mode { path: burst.display().to_string(), found, expected })
}

/// Checks that the photometric calibration of the lens file was measured with the present conversion from codes to radiance.
fn photometric(path: &Path, calibration: &Calibration) -> Result<(), Fault> {
    let unreadable = |e: RecordedError| Fault::Unreadable(e.to_string());
    let camera = photometric_camera(path).map_err(unreadable)?;
    match camera {
        Some(camera) if camera != radiometry(calibration) => {
            Err(Fault::Older { path: path.display().to_string() })
        }
        _ => Ok(()),
    }
}

/// Returns whether two lenses differ by more than two degrees somewhere in the field of view of both.
fn is_other(a: &Lens, b: &Lens) -> bool {
    let max = a.intrinsics().max_theta.min(b.intrinsics().max_theta);
    let directions =
        (1..=8).flat_map(|i| (0..8).map(move |j| (0.12 * f64::from(i), TAU * f64::from(j) / 8.0)));
    directions.filter(|(part, _)| *part < 1.0).any(|(part, phi)| {
        let theta = part * max;
        let direction = glam::DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
        let seen = a.project(direction).and_then(|pixel| b.unproject(pixel));
        seen.is_none_or(|other| direction.dot(other) < 2f64.to_radians().cos())
    })
}

fn exposures(path: &Path, response: &Response, frames: &[Exposed]) -> Result<(), Fault> {
    for pair in frames.windows(2) {
        let expected = pair[1].exposure / pair[0].exposure;
        let mut off = logarithms_of(pair, |code, channel| response.exposure(channel, code));
        off.sort_by(f64::total_cmp);
        let found = off.get(off.len() / 2).map(|v| v.exp());
        if let Some(found) = found.filter(|found| (found / expected).ln().abs() > MOST_RATIO) {
            return Err(Fault::Exposures { path: path.display().to_string(), found, expected });
        }
    }
    Ok(())
}
