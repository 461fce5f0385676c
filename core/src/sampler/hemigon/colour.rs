//! Equal luminance for every light and the right total for every channel, both at once.

use crate::color::{add, luminance};
use crate::light::Light;

/// Part of the map's mean colour in every light, so that a channel that no light happens to have can still be made up for.
const MEAN: f32 = 1e-3;

/// Rounds: 64 lights of a real map are even within 1e-5 after eight, colours that differ by decades in each channel within a tenth or two.
const ROUNDS: usize = 8;

/// Scales the lights' colours so that channels add up to `total` and all lights are about equally luminous.
///
/// Iterative proportional fitting of the table lights x channels; the channels come last and are exact.
pub(super) fn share(lights: &mut [Light], total: [f64; 3]) {
    let y = luminance(total.map(|v| v as f32));
    if y <= 0.0 {
        lights.iter_mut().for_each(|light| light.irradiance = [0.0; 3]);
        return;
    }
    let mean = total.map(|v| MEAN * (v as f32 / y));
    lights.iter_mut().for_each(|light| add(&mut light.irradiance, mean));
    let each = y / lights.len() as f32;
    for _ in 0..ROUNDS {
        for light in lights.iter_mut() {
            let factor = each / luminance(light.irradiance);
            light.irradiance = light.irradiance.map(|v| v * factor);
        }
        fit_channels(lights, total);
    }
}

/// Scales each channel so that it adds up to its total.
fn fit_channels(lights: &mut [Light], total: [f64; 3]) {
    let mut sum = [0.0f64; 3];
    for light in lights.iter() {
        for (s, v) in sum.iter_mut().zip(light.irradiance) {
            *s += f64::from(v);
        }
    }
    let factor: [f64; 3] = core::array::from_fn(|c| if sum[c] > 0.0 { total[c] / sum[c] } else { 0.0 });
    for light in lights {
        for (v, f) in light.irradiance.iter_mut().zip(factor) {
            *v = (f64::from(*v) * f) as f32;
        }
    }
}
