//! Estimation of the relative illumination of a lens from readings at angles from the axis.
//!
//! All readings are of one object of constant radiance: a lit screen that is shown at several angles, or the pixels of a flat field. A
//! polynomial of even powers of theta describes a lens with rotational symmetry.

use super::Grey;
use glam::DVec2;
use hemilux_core::Response;
use hemilux_core::lens::{Intrinsics, Lens};
use nalgebra::{DMatrix, DVector};
use std::f64::consts::PI;

/// A vignetting reading: the mean relative exposure of a screen or of a ring of pixels at one angle from the axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Angle of the reading from the axis, radians.
    pub theta: f64,
    /// Relative exposure of the reading, in any unit.
    pub light: f64,
}

/// Relative illumination of a lens with the quality of its fit.
#[derive(Clone, Debug, PartialEq)]
pub struct FittedVignetting {
    /// Coefficients of the polynomial in theta, the constant first; the value on the axis is 1.
    pub coefficients: [f64; 8],
    /// Relative root mean square difference of the readings from the polynomial.
    pub rms: f64,
    /// Largest relative difference of a reading from the polynomial.
    pub largest: f64,
    /// Angle from the axis of the outermost reading, radians.
    pub covered: f64,
    /// Number of readings that the fit used.
    pub readings: usize,
}

/// Reasons why no vignetting is computed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum VignettingRefusal {
    /// There are too few readings of the vignetting.
    #[error(
        "found {0} reading(s), expected at least 5: show the screen at 5 or more angles from the axis to the rim"
    )]
    Few(usize),
    /// There are no readings near the axis, or none near the rim.
    #[error(
        "found readings from {from_deg:.0} to {to_deg:.0} degrees, expected some within 15 degrees of the axis and some beyond 40"
    )]
    Range {
        /// Angle of the innermost reading from the axis of the lens, degrees.
        from_deg: f64,
        /// Angle of the outermost reading from the axis of the lens, degrees.
        to_deg: f64,
    },
    /// The readings do not fit a polynomial.
    #[error(
        "found readings that scatter by {percent:.0} %, expected at most 10: keep exposure, gain and white balance of the camera fixed, the \
         screen steady and at one distance, and other lights off"
    )]
    Scatter {
        /// Relative root mean square difference of the readings from the polynomial, per cent.
        percent: f64,
    },
    /// The fitted polynomial is not positive over the field of view.
    #[error(
        "found an illumination that is not positive over the field of view, expected readings nearer to the rim at {0:.0} degrees"
    )]
    NotPositive(f64),
}

/// Largest accepted relative root mean square difference of the readings from the polynomial.
const MOST_RMS: f64 = 0.10;

/// Number of even powers of the polynomial in addition to the constant: theta^2, theta^4, theta^6.
const TERMS: usize = 3;

/// Fits the relative illumination of `lens` to readings.
///
/// # Errors
/// [`VignettingRefusal`] if the readings determine no illumination.
pub fn fit_vignetting(lens: &Lens, readings: &[Reading]) -> Result<FittedVignetting, VignettingRefusal> {
    let used: Vec<Reading> =
        readings.iter().copied().filter(|r| r.light > 0.0 && r.theta.is_finite()).collect();
    if used.len() < 5 {
        return Err(VignettingRefusal::Few(used.len()));
    }
    let (from, covered) = used.iter().fold((f64::MAX, 0f64), |(a, b), r| (a.min(r.theta), b.max(r.theta)));
    if from > 15f64.to_radians() || covered < 40f64.to_radians() {
        return Err(VignettingRefusal::Range { from_deg: from.to_degrees(), to_deg: covered.to_degrees() });
    }
    let coefficients = robust(&used).ok_or(VignettingRefusal::Few(used.len()))?;
    let off: Vec<f64> = used.iter().map(|r| r.light / polynomial(&coefficients, r.theta) - 1.0).collect();
    let rms = (off.iter().map(|v| v * v).sum::<f64>() / off.len() as f64).sqrt();
    if rms.is_nan() || rms > MOST_RMS {
        return Err(VignettingRefusal::Scatter { percent: 100.0 * rms });
    }
    let axis = coefficients[0];
    let relative = coefficients.map(|c| c / axis);
    let max = lens.intrinsics().max_theta;
    let checked = Lens::try_new(Intrinsics { vignetting: relative, ..*lens.intrinsics() });
    checked.map_err(|_| VignettingRefusal::NotPositive(max.to_degrees()))?;
    let largest = off.iter().map(|v| v.abs()).fold(0.0, f64::max);
    Ok(FittedVignetting { coefficients: relative, rms, largest, covered, readings: used.len() })
}

fn polynomial(coefficients: &[f64; 8], theta: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, c| sum * theta + c)
}

/// Fits the polynomial by least squares of relative differences, with lower weights for outliers.
fn robust(readings: &[Reading]) -> Option<[f64; 8]> {
    let terms = TERMS.min(readings.len() / 3) + 1;
    let mut weights: Vec<f64> = readings.iter().map(|r| 1.0 / r.light).collect();
    let mut coefficients = [0.0; 8];
    for _ in 0..6 {
        let row = |i: usize, j: usize| weights[i] * readings[i].theta.powi(2 * j as i32);
        let matrix = DMatrix::from_fn(readings.len(), terms, row);
        let right = DVector::from_fn(readings.len(), |i, _| weights[i] * readings[i].light);
        let solved = matrix.svd(true, true).solve(&right, 1e-12).ok()?;
        coefficients = [0.0; 8];
        solved.iter().enumerate().for_each(|(j, c)| coefficients[2 * j] = *c);
        for (weight, r) in weights.iter_mut().zip(readings) {
            let off = (r.light / polynomial(&coefficients, r.theta) - 1.0) / 0.05;
            *weight = 1.0 / (r.light * (1.0 + off * off).sqrt());
        }
    }
    Some(coefficients)
}

/// A picture with the response of its camera.
pub struct CodedPicture<'a> {
    /// Grey picture; codes 0 to 255 are black to white.
    pub grey: &'a Grey,
    /// Response of the camera from codes to relative exposure.
    pub response: &'a Response,
}

impl CodedPicture<'_> {
    fn light(&self, x: usize, y: usize) -> f64 {
        self.response.exposure(1, self.grey.code(x, y) / 255.0)
    }

    fn pixels(&self) -> impl Iterator<Item = [usize; 2]> {
        let [width, height] = self.grey.size();
        (0..height).flat_map(move |y| (0..width).map(move |x| [x, y]))
    }
}

/// Width of the rings around the axis into which a flat field is divided, radians.
const RING: f64 = 0.02;

/// Returns readings of a flat field, an evenly lit surface that fills the view: the median of each ring of pixels around the axis.
#[must_use]
pub fn flat_field(lens: &Lens, shown: &CodedPicture<'_>) -> Vec<Reading> {
    let mut rings: Vec<Vec<f64>> = vec![Vec::new(); 160];
    for [x, y] in shown.pixels() {
        let direction = lens.unproject(DVec2::new(x as f64, y as f64));
        let unclipped = shown.grey.code(x, y) < 250.0;
        if let (Some(direction), true) = (direction, unclipped) {
            let ring = (direction.z.clamp(-1.0, 1.0).acos() / RING) as usize;
            rings[ring.min(159)].push(shown.light(x, y));
        }
    }
    let reading = |(i, mut ring): (usize, Vec<f64>)| {
        ring.sort_by(f64::total_cmp);
        let light = *ring.get(ring.len() / 2)?;
        (ring.len() > 10).then_some(Reading { theta: (i as f64 + 0.5) * RING, light })
    };
    rings.into_iter().enumerate().filter_map(reading).collect()
}

/// Returns the reading of a picture in which a small lit screen is the brightest object: the mean of the screen's centre; `None` if the
/// screen is clipped or absent.
#[must_use]
pub fn screen(lens: &Lens, shown: &CodedPicture<'_>) -> Option<Reading> {
    let lit = |[x, y]: &[usize; 2]| lens.unproject(DVec2::new(*x as f64, *y as f64)).is_some();
    let brightest = shown.pixels().filter(lit).map(|[x, y]| shown.grey.code(x, y)).fold(0.0, f64::max);
    if !(25.0..250.0).contains(&brightest) {
        return None;
    }
    let inside: Vec<[usize; 2]> =
        shown.pixels().filter(lit).filter(|[x, y]| shown.grey.code(*x, *y) > 0.75 * brightest).collect();
    let count = inside.len() as f64;
    let sum = inside.iter().fold(DVec2::ZERO, |sum, [x, y]| sum + DVec2::new(*x as f64, *y as f64));
    let middle = sum / count;
    let direction = lens.unproject(middle).filter(|_| inside.len() >= 9)?;
    // The mean covers half of the radius of a disc with the screen's area: mixed pixels of the screen's edge are left out, and a linear
    // slope cancels.
    let near =
        |[x, y]: &&[usize; 2]| DVec2::new(*x as f64, *y as f64).distance_squared(middle) < 0.25 * count / PI;
    let values: Vec<f64> = inside.iter().filter(near).map(|[x, y]| shown.light(*x, *y)).collect();
    let light = values.iter().sum::<f64>() / values.len().max(1) as f64;
    Some(Reading { theta: direction.z.clamp(-1.0, 1.0).acos(), light })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// Returns the relative illumination of the test camera: the fourth power of the cosine of half the angle, which is not of the fit's
    /// form.
    fn truth(theta: f64) -> f64 {
        (0.5 * theta).cos().powi(4) * (1.0 - 0.1 * (theta / 1.6).powi(8))
    }

    fn lens() -> Lens {
        Lens::equidistant([319.5, 319.5], 200.0, 92f64.to_radians()).expect("a lens")
    }

    /// Returns a picture whose codes are proportional to `light`, with noise of one code.
    fn picture(light: impl Fn(DVec2) -> f64) -> Grey {
        let code = |i: usize| {
            let noise = ((i * 7919) % 97) as f64 / 48.5 - 1.0;
            (220.0 * light(DVec2::new((i % 640) as f64, (i / 640) as f64)) + noise).round().clamp(0.0, 255.0)
                as u8
        };
        Grey::new(640, (0..640 * 640).map(code).collect()).expect("whole rows")
    }

    fn angle(lens: &Lens, at: DVec2) -> Option<f64> {
        lens.unproject(at).map(|d| d.z.clamp(-1.0, 1.0).acos())
    }

    fn assert_found(fitted: &FittedVignetting) {
        for degrees in [0.0, 20.0, 40.0, 60.0, 75.0, 85.0f64] {
            let theta = degrees.to_radians();
            let off = polynomial(&fitted.coefficients, theta) / truth(theta) - 1.0;
            assert!(off.abs() < 0.02, "{degrees} degrees: {off}, {fitted:?}");
        }
    }

    #[test]
    fn flat_fields_determine_the_illumination_within_two_per_cent() {
        let lens = lens();
        let grey = picture(|at| angle(&lens, at).map_or(0.0, truth));
        let readings = flat_field(&lens, &CodedPicture { grey: &grey, response: &Response::Linear });
        let fitted = fit_vignetting(&lens, &readings).expect("an illumination");
        assert_found(&fitted);
        assert!(fitted.rms < 0.02, "{fitted:?}");
    }

    #[test]
    fn screens_at_several_angles_determine_the_illumination_within_two_per_cent() {
        let lens = lens();
        let screens = (0..19).map(|i| {
            let (theta, phi) = (f64::from(i) * 5f64.to_radians(), 0.3 + TAU * 0.381 * f64::from(i));
            let middle = DVec2::new(319.5 + 200.0 * theta * phi.cos(), 319.5 + 200.0 * theta * phi.sin());
            let grey = picture(|at| {
                let lit = at.distance(middle) < 9.0;
                angle(&lens, at).map_or(0.0, |theta| truth(theta) * if lit { 1.0 } else { 0.02 })
            });
            screen(&lens, &CodedPicture { grey: &grey, response: &Response::Linear })
        });
        let readings: Vec<Reading> = screens.flatten().collect();
        assert!(readings.len() >= 18, "{}", readings.len());
        assert_found(&fit_vignetting(&lens, &readings).expect("an illumination"));
    }

    #[test]
    fn insufficient_readings_are_refused() {
        let reading = |degrees: f64, light: f64| Reading { theta: degrees.to_radians(), light };
        let few = [reading(0.0, 1.0), reading(50.0, 0.7)];
        assert_eq!(fit_vignetting(&lens(), &few), Err(VignettingRefusal::Few(2)));
        let narrow: Vec<_> = (0..8).map(|i| reading(f64::from(i) * 3.0, 1.0)).collect();
        assert!(matches!(fit_vignetting(&lens(), &narrow), Err(VignettingRefusal::Range { .. })));
        let scattered: Vec<_> =
            (0..12).map(|i| reading(f64::from(i) * 7.0, if i % 2 == 0 { 1.0 } else { 0.5 })).collect();
        assert!(matches!(fit_vignetting(&lens(), &scattered), Err(VignettingRefusal::Scatter { .. })));
    }
}
