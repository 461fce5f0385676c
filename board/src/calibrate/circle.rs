//! A first lens without a board: the image circle is detected in bright pictures, and an equidistant law is assumed.

use super::Grey;
use glam::DVec2;
use hemilux_core::lens::Lens;
use nalgebra::{Matrix3, Vector3};
use std::f64::consts::{FRAC_PI_2, TAU};

/// The image circle of a fisheye lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Circle {
    /// Centre of the image circle, pixels.
    pub centre: DVec2,
    /// Radius of the image circle, pixels.
    pub radius: f64,
    /// Standard deviation of the distance between the detected points of the rim and the circle, pixels.
    pub deviation_px: f64,
}

/// An equidistant lens whose field of view fills an image circle.
#[derive(Clone, Debug)]
pub struct CircleLens {
    /// Lens model with its field of view.
    pub lens: Lens,
    /// Columns and rows of the pictures in which the circle was detected.
    pub size: [usize; 2],
    /// Image circle from which the lens was computed.
    pub circle: Circle,
    /// Pairs of an angle from the axis and the standard deviation of a direction at that angle, degrees.
    pub spread: Vec<[f64; 2]>,
}

/// Reasons why no image circle is detected.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CircleRefusal {
    /// There are no pictures, or the pictures do not all have the same size.
    #[error("found pictures of several sizes, or none, expected pictures of one mode")]
    Sizes,
    /// The corners of the pictures are not dark.
    #[error(
        "found no dark corners around a bright circle, expected pictures of a bright, even scene (sky, a lit wall) in which the image circle has an edge: \
         a lens whose circle exceeds the sensor needs a board"
    )]
    NoRim,
    /// The rim of the bright area is not circular.
    #[error(
        "found a rim that is {deviation:.1} pixels off a circle over {degrees:.0} degrees, expected at most {most:.1} over 120: add pictures that are \
         bright up to the rim"
    )]
    NoCircle {
        /// Standard deviation of the distance between the rim and a circle, pixels.
        deviation: f64,
        /// Angle around the circle's centre over which the rim was found, degrees.
        degrees: f64,
        /// Largest accepted standard deviation of the distance between the rim and a circle, pixels.
        most: f64,
    },
    /// The field of view is out of range, or the circle gives no valid lens.
    #[error("found a field of view of {0} degrees, expected 60 to 280")]
    Field(f64),
}

/// Number of rays from the picture's centre along which the rim of the image circle is searched for.
const RAYS: usize = 720;

/// Largest accepted standard deviation of the rim from the circle, in radii.
const MOST_OFF: f64 = 0.02;

/// Detects the image circle in the picture whose pixels are the maxima over all `pictures`.
///
/// # Errors
/// [`CircleRefusal`] if there is no circular rim.
pub fn find_circle(pictures: &[Grey]) -> Result<Circle, CircleRefusal> {
    let bright = brightest(pictures).ok_or(CircleRefusal::Sizes)?;
    let threshold = threshold(&bright).ok_or(CircleRefusal::NoRim)?;
    let rim = rim(&bright, threshold);
    let circle = robust(&rim).ok_or(CircleRefusal::NoRim)?;
    let degrees = spanned(&rim, &circle);
    let most = (MOST_OFF * circle.radius).max(1.0);
    if circle.deviation_px > most || degrees < 120.0 {
        return Err(CircleRefusal::NoCircle { deviation: circle.deviation_px, degrees, most });
    }
    Ok(circle)
}

fn brightest(pictures: &[Grey]) -> Option<Grey> {
    let first = pictures.first()?;
    let mut pixels = first.pixels().to_vec();
    for other in &pictures[1..] {
        if other.size() != first.size() {
            return None;
        }
        pixels.iter_mut().zip(other.pixels()).for_each(|(to, from)| *to = (*to).max(*from));
    }
    Grey::new(first.size()[0], pixels)
}

/// Returns a code between those of the dark corners and of the bright centre, nearer to the dark ones, since lenses are darker at the rim;
/// `None` without dark corners.
fn threshold(grey: &Grey) -> Option<f64> {
    let [width, height] = grey.size();
    let mean = |left: usize, top: usize, w: usize, h: usize| {
        let sum: f64 = (top..top + h).flat_map(|y| (left..left + w).map(move |x| grey.code(x, y))).sum();
        sum / (w * h).max(1) as f64
    };
    let (w, h) = ((width / 32).max(1), (height / 32).max(1));
    let corners = [(0, 0), (width - w, 0), (0, height - h), (width - w, height - h)];
    let dark = corners.map(|(x, y)| mean(x, y, w, h)).into_iter().fold(0.0, f64::max);
    let middle = mean(width / 4, height / 4, width / 2, height / 2);
    (middle > dark + 24.0).then(|| dark + 0.3 * (middle - dark).min(120.0))
}

/// Returns the points of the rim with sub-pixel accuracy: along each ray from outside, where the code rises above the threshold; points on
/// the picture's edge are left out.
fn rim(grey: &Grey, threshold: f64) -> Vec<DVec2> {
    let [width, height] = grey.size();
    let middle = DVec2::new(width as f64 - 1.0, height as f64 - 1.0) * 0.5;
    let ray = |i: usize| {
        let out = DVec2::from_angle(TAU * i as f64 / RAYS as f64);
        let reach = (middle.x / out.x.abs().max(1e-9)).min(middle.y / out.y.abs().max(1e-9));
        let code = |r: f64| {
            let at = middle + out * r;
            grey.sample(nalgebra::Vector2::new(at.x, at.y))
        };
        let mut r = reach - 1.0;
        if code(r) > threshold {
            return None;
        }
        while r > 0.2 * reach && code(r) <= threshold {
            r -= 1.0;
        }
        let (inside, outside) = (code(r), code(r + 1.0));
        let part = (inside - threshold) / (inside - outside).max(1e-9);
        (r > 0.2 * reach).then(|| middle + out * (r + part.clamp(0.0, 1.0)))
    };
    (0..RAYS).filter_map(ray).collect()
}

/// Fits a circle to `points` by least squares, with lower weights for outliers.
fn robust(points: &[DVec2]) -> Option<Circle> {
    if points.len() < 24 {
        return None;
    }
    let mut weights = vec![1.0; points.len()];
    let mut circle = fit(points, &weights)?;
    for _ in 0..20 {
        let mut off: Vec<f64> =
            points.iter().map(|p| (p.distance(circle.centre) - circle.radius).abs()).collect();
        let each = off.clone();
        off.sort_by(f64::total_cmp);
        let scale = (1.4826 * off[off.len() / 2]).max(0.2);
        weights.iter_mut().zip(each).for_each(|(w, off)| *w = 1.0 / (1.0 + (off / scale).powi(2)).powi(2));
        circle = Circle { deviation_px: scale, ..fit(points, &weights)? };
    }
    Some(circle)
}

/// Fits a circle to weighted points by the method of A. Kasa, which is linear in the centre and the squared radius.
fn fit(points: &[DVec2], weights: &[f64]) -> Option<Circle> {
    let mean = points.iter().sum::<DVec2>() / points.len() as f64;
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for (point, weight) in points.iter().zip(weights) {
        let p = *point - mean;
        let row = Vector3::new(2.0 * p.x, 2.0 * p.y, 1.0);
        normal += row * row.transpose() * *weight;
        right += row * (*weight * p.length_squared());
    }
    let solved = normal.try_inverse()? * right;
    let centre = DVec2::new(solved.x, solved.y);
    let squared = solved.z + centre.length_squared();
    (squared > 0.0).then(|| Circle { centre: centre + mean, radius: squared.sqrt(), deviation_px: 0.0 })
}

/// Returns the angle around the circle's centre over which points lie near the circle, degrees.
fn spanned(points: &[DVec2], circle: &Circle) -> f64 {
    let mut sectors = [false; 72];
    let near = 3.0 * circle.deviation_px.max(0.5);
    for point in points.iter().filter(|p| (p.distance(circle.centre) - circle.radius).abs() < near) {
        let turn = (*point - circle.centre).to_angle().rem_euclid(TAU) / TAU;
        sectors[((72.0 * turn) as usize).min(71)] = true;
    }
    5.0 * sectors.iter().filter(|seen| **seen).count() as f64
}

/// Standard deviation of a field of view that the user states, degrees: data sheets give rounded values, and the edge of an image circle is
/// a gradient.
const FIELD_DEG: f64 = 5.0;

/// Returns the equidistant lens whose field of view of `field_deg` degrees fills the image circle.
///
/// # Errors
/// [`CircleRefusal::Field`] for a field of view out of range.
pub fn circle_lens(circle: &Circle, field_deg: f64, size: [usize; 2]) -> Result<CircleLens, CircleRefusal> {
    let refused = || CircleRefusal::Field(field_deg);
    if !(60.0..=280.0).contains(&field_deg) {
        return Err(refused());
    }
    let max = 0.5 * field_deg.to_radians();
    let lens =
        Lens::equidistant(circle.centre.to_array(), circle.radius / max, max).map_err(|_| refused())?;
    let tens = (0..15).map(|i| f64::from(i) * 10f64.to_radians()).take_while(|theta| *theta < max - 0.02);
    let uncertain = |theta: f64| {
        let centre = circle.deviation_px / circle.radius * max;
        [theta, law(theta, max).hypot(theta / max * FIELD_DEG.to_radians()).hypot(centre)]
            .map(f64::to_degrees)
    };
    Ok(CircleLens { lens, size, circle: *circle, spread: tens.chain([max]).map(uncertain).collect() })
}

/// Returns the difference at the angle `theta` between the directions of an equidistant and of an equisolid lens that fill the same circle.
fn law(theta: f64, max: f64) -> f64 {
    let radius = (0.5 * theta).sin() / (0.5 * max).sin();
    (radius * max - theta).abs().min(FRAC_PI_2)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Draws an uneven sky through a circle with a soft edge.
    fn picture(centre: DVec2, radius: f64, size: [usize; 2]) -> Grey {
        let code = |i: usize| {
            let at = DVec2::new((i % size[0]) as f64, (i / size[0]) as f64);
            let part = ((radius - at.distance(centre)) / 3.0 + 0.5).clamp(0.0, 1.0);
            let sky = 150.0 + 60.0 * (0.02 * at.x).sin() * (0.015 * at.y).cos();
            (4.0 + part * sky + ((i * 7919) % 5) as f64).round() as u8
        };
        Grey::new(size[0], (0..size[0] * size[1]).map(code).collect()).expect("whole rows")
    }

    #[test]
    fn circle_is_found_within_a_pixel_where_it_is_whole_or_cut() {
        for (centre, radius, size) in
            [(DVec2::new(322.0, 236.5), 210.0, [640, 480]), (DVec2::new(310.0, 250.0), 290.0, [640, 480])]
        {
            let found = find_circle(&[picture(centre, radius, size)]).expect("a circle");
            assert!(found.centre.distance(centre) < 1.0 && (found.radius - radius).abs() < 1.5, "{found:?}");
        }
    }

    /// A lamp outside of the rim in one picture and a dark part of the rim in another do not shift the circle.
    #[test]
    fn a_rim_that_is_dark_in_one_picture_is_found_in_another() {
        let (centre, radius) = (DVec2::new(322.0, 236.5), 210.0);
        let whole = picture(centre, radius, [640, 480]);
        let half = |left: bool| {
            let dark = |i: usize| (i % 640 < 320) == left;
            let codes = whole.pixels().iter().enumerate().map(|(i, v)| if dark(i) { 4 } else { *v });
            Grey::new(640, codes.collect()).expect("whole rows")
        };
        let found = find_circle(&[half(true), half(false)]).expect("a circle");
        assert!(found.centre.distance(centre) < 1.0, "{found:?}");
    }

    #[test]
    fn pictures_without_a_rim_are_refused() {
        let even = Grey::new(64, vec![200; 64 * 64]).expect("whole rows");
        assert_eq!(find_circle(&[even]), Err(CircleRefusal::NoRim));
        assert_eq!(find_circle(&[]), Err(CircleRefusal::Sizes));
        let square =
            |i: usize| if (16..112).contains(&(i % 128)) && (16..112).contains(&(i / 128)) { 200 } else { 3 };
        let square = Grey::new(128, (0..128 * 128).map(square).collect()).expect("whole rows");
        assert!(matches!(find_circle(&[square]), Err(CircleRefusal::NoCircle { .. })));
    }

    /// The directions of an equisolid camera lie within the stated uncertainty.
    #[test]
    fn lens_states_an_uncertainty_that_holds_for_another_law() {
        let circle = Circle { centre: DVec2::splat(319.5), radius: 300.0, deviation_px: 0.5 };
        let made = circle_lens(&circle, 180.0, [640, 640]).expect("a lens");
        for [angle, uncertainty] in made.spread {
            let theta = angle.to_radians();
            let radius = 300.0 * (0.5 * theta).sin() / (0.25 * std::f64::consts::PI).sin();
            let found = made.lens.unproject(DVec2::new(319.5 + radius.min(299.99), 319.5)).expect("in view");
            let off = found.z.acos().to_degrees() - angle;
            assert!(off.abs() <= uncertainty, "{angle}: {off}, stated {uncertainty}");
            assert!(uncertainty < 8.0, "{angle}: {uncertainty}");
        }
        assert!(matches!(circle_lens(&circle, 30.0, [640, 640]), Err(CircleRefusal::Field(_))));
    }
}
