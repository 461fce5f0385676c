//! Conversion of rendered radiance to a picture of labelled panels.

use super::{Shot, letters};
use crate::metrics::luminance;
use hemilux_core::tonemap::srgb_code;
use image::{Rgb, RgbImage};

/// Height of the strip of labels above the panels of a picture, pixels.
const STRIP: usize = 28;
/// Gap between the panels of a picture, pixels.
const GAP: usize = 4;
/// Linear display value, 0 to 1, of the 95th percentile of the surfaces' luminance.
const BRIGHT: f64 = 0.8;
/// Factor by which the third panel amplifies the difference.
const ENLARGED: f64 = 4.0;

/// Returns the factor from radiance to linear display values, with which the 95th percentile of the surfaces' luminance becomes [`BRIGHT`].
pub(super) fn exposure(shot: &Shot) -> f64 {
    let surfaces = shot.radiance.iter().zip(&shot.surface).filter(|(_, surface)| **surface);
    let mut values: Vec<f64> = surfaces.map(|(rgb, _)| luminance(*rgb)).collect();
    values.sort_by(f64::total_cmp);
    match values.get(values.len() * 19 / 20) {
        Some(v) if *v > 0.0 => BRIGHT / v,
        _ => 1.0,
    }
}

/// Returns the sRGB colour of linear display values, 0 to 1.
pub(super) fn display(rgb: [f64; 3]) -> Rgb<u8> {
    Rgb(rgb.map(|v| srgb_code(v as f32)))
}

/// Returns the RMS luminance difference over the pixels of surfaces, divided by the mean luminance of the reference on surfaces; 0 if both are
/// black.
pub(super) fn relative_rms(reference: &Shot, found: &Shot) -> f64 {
    let (mut squares, mut sum, mut count) = (0.0, 0.0, 0.0f64);
    for k in (0..reference.radiance.len()).filter(|&k| reference.surface[k]) {
        let truth = luminance(reference.radiance[k]);
        squares += (luminance(found.radiance[k]) - truth).powi(2);
        sum += truth;
        count += 1.0;
    }
    crate::metrics::relative((squares / count.max(1.0)).sqrt(), sum / count.max(1.0))
}

/// Returns a picture with the reference, the rendering under the light set and the signed difference side by side; the third label is replaced by
/// the RMS difference.
pub(super) fn panels(reference: &Shot, found: &Shot, labels: [String; 3]) -> RgbImage {
    let [width, height] = reference.size;
    let full = ((width + GAP) * 3 - GAP, height + STRIP);
    let mut picture = RgbImage::from_pixel(full.0 as u32, full.1 as u32, Rgb([24, 24, 24]));
    let scale = exposure(reference);
    for k in 0..width * height {
        let (x, y) = ((k % width) as u32, (k / width + STRIP) as u32);
        let next = (width + GAP) as u32;
        let exposed = |shot: &Shot| shot.radiance[k].map(|v| v * scale);
        picture.put_pixel(x, y, display(exposed(reference)));
        picture.put_pixel(x + next, y, display(exposed(found)));
        let off = luminance(exposed(found)) - luminance(exposed(reference));
        let off = if reference.surface[k] { ENLARGED * off } else { 0.0 };
        picture.put_pixel(x + 2 * next, y, signed(off));
    }
    let rms = 100.0 * relative_rms(reference, found);
    let difference = format!("DIFFERENCE X {ENLARGED}, RMS {rms:.1} %, ORANGE: TOO BRIGHT");
    let [first, second, _] = labels;
    for (k, label) in [first, second, difference].iter().enumerate() {
        let at = [(k * (width + GAP)) as u32 + 8, 7];
        letters::write(&mut picture, label, at, 3, [235; 3]);
    }
    picture
}

/// Returns a colour from blue (too dark) over grey to orange (too bright) for values from -1 to 1.
fn signed(v: f64) -> Rgb<u8> {
    const ENDS: [[f64; 3]; 2] = [[0.0, 40.0, 200.0], [255.0, 130.0, 0.0]];
    let end = ENDS[usize::from(v > 0.0)];
    let part = v.abs().min(1.0);
    Rgb(end.map(|c| (128.0 + part * (c - 128.0)).round() as u8))
}
