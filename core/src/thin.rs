//! Reduces a light set: merges lights to a given number, or selects the lights that a surface can receive.
//!
//! The methods are the clustering and the elimination of invisible lights of \[Havran2005\], of which only the abstract was available; cost
//! and order of the merges are those of this project.

use crate::buffer::{self, Buffer, TooSmall};
use crate::color::luminance;
use crate::light::{Light, cap_radius_deg};
use glam::Vec3;

/// Number of subsequent lights among which the partner of a light is searched: in a small set all lights, in a large set the neighbours in
/// the order of the samplers' trees.
const WINDOW: usize = 256;

/// Divisor of the number of lights, which gives the number of merges before the costs are computed again.
const PART: usize = 8;

/// A candidate pair of lights and the cost of merging it: an element of the buffer of [`merge`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pair {
    cost: f32,
    first: u32,
    second: u32,
}

/// Merges lights until at most `most` are left, moves them to the front of `lights` and returns their number; `most` = 0 leaves no light.
///
/// The energy of each channel is unchanged. A merged light is at the centroid of its two lights and keeps id, age and parent of the brighter.
/// `pairs` needs as many elements as `lights`. The time is about 2,000 cost computations per light.
///
/// # Errors
/// [`TooSmall`] if `pairs` has too few elements; `lights` is then unchanged.
///
/// # Examples
/// ```
/// use hemilux_core::{Light, thin};
/// let light = |id, x: f32| Light {
///     id,
///     direction: glam::Vec3::new(x, 0.0, 1.0).normalize(),
///     irradiance: [1.0; 3],
///     ..Light::default()
/// };
/// let mut lights = [light(1, 0.0), light(2, 0.01), light(3, 5.0)];
/// let mut pairs = vec![Default::default(); lights.len()];
/// // The two neighbours become one light with the sum of their energies.
/// assert_eq!(thin::merge(&mut lights, 2, &mut pairs), Ok(2));
/// assert_eq!((lights[0].irradiance, lights[1].id), ([2.0; 3], 3));
/// ```
pub fn merge<P: Buffer<Pair>>(lights: &mut [Light], most: usize, pairs: &mut P) -> Result<usize, TooSmall> {
    buffer::check(pairs, lights.len())?;
    let pairs = pairs.as_mut();
    let mut count = lights.len();
    if most == 0 {
        return Ok(0);
    }
    while count > most {
        let merges = (count / PART).clamp(1, count - most);
        let live = &mut lights[..count];
        let found = partners(live, pairs);
        pairs[..found].sort_unstable_by(|a, b| (a.cost.total_cmp(&b.cost)).then(a.first.cmp(&b.first)));
        let mut done = 0;
        for pair in &pairs[..found] {
            let (a, b) = (pair.first as usize, pair.second as usize);
            // Id 0 marks a light that was merged into another in this round. A pair is still used if one of its lights has been moved by a
            // merge: the error is small.
            if done < merges && live[a].id != 0 && live[b].id != 0 {
                live[a] = merged(&live[a], &live[b]);
                live[b].id = 0;
                done += 1;
            }
        }
        count = compact(live);
    }
    Ok(count)
}

/// Writes the cheapest partner of each light except the last to `pairs`; returns the number of pairs.
fn partners(lights: &[Light], pairs: &mut [Pair]) -> usize {
    let last = lights.len().saturating_sub(1);
    for (i, (light, pair)) in lights[..last].iter().zip(pairs.iter_mut()).enumerate() {
        let y = energy(light);
        *pair = Pair { cost: f32::INFINITY, first: i as u32, second: i as u32 + 1 };
        for (j, other) in lights.iter().enumerate().skip(i + 1).take(WINDOW) {
            let cost = y * energy(other) * light.direction.distance(other.direction);
            if cost < pair.cost {
                *pair = Pair { cost, second: j as u32, ..*pair };
            }
        }
    }
    last
}

/// Moves lights with ids other than 0 to the front in their order; returns the number of such lights.
fn compact(lights: &mut [Light]) -> usize {
    let mut count = 0;
    for i in 0..lights.len() {
        if lights[i].id != 0 {
            lights[count] = lights[i];
            count += 1;
        }
    }
    count
}

/// Returns the luminance of the irradiance of `light`.
fn energy(light: &Light) -> f32 {
    luminance(light.irradiance)
}

/// Returns the light that replaces `a` and `b`. The cost of the merge is y1 y2 times the distance of the lights: the expected squared error
/// over shadowed receivers is nearly proportional to it.
fn merged(a: &Light, b: &Light) -> Light {
    let (ya, yb) = (energy(a), energy(b));
    let keep = if yb > ya { b } else { a };
    let moment = a.direction * (ya * resultant(a)) + b.direction * (yb * resultant(b));
    let total = ya + yb;
    let radius_deg =
        if total > 0.0 { cap_radius_deg(1.0 - (moment.length() / total).min(1.0)) } else { keep.radius_deg };
    let direction = (moment / total).try_normalize().unwrap_or(keep.direction);
    let irradiance = core::array::from_fn(|c| a.irradiance[c] + b.irradiance[c]);
    Light { direction, irradiance, radius_deg, ..*keep }
}

/// Returns the length of the mean direction over the cap of `light`.
fn resultant(light: &Light) -> f32 {
    0.5 + 0.5 * libm::cosf(light.radius_deg.to_radians())
}

/// Selects the lights that reach a surface whose normals are within `spread` radians of the unit vector `normal`; 0 for a flat surface.
///
/// A light is selected if any part of its disc is above the horizon of some normal.
///
/// ```
/// use glam::Vec3;
/// use hemilux_core::{Light, thin};
/// let lights = [Vec3::Z, Vec3::NEG_Z].map(|direction| Light { direction, ..Light::default() });
/// assert_eq!(thin::facing(&lights, Vec3::Z, 0.0).count(), 1);
/// ```
pub fn facing(lights: &[Light], normal: Vec3, spread: f32) -> impl Iterator<Item = &Light> {
    lights.iter().filter(move |light| {
        let beyond = (spread.max(0.0) + light.radius_deg.to_radians()).min(core::f32::consts::FRAC_PI_2);
        light.direction.dot(normal) > -libm::sinf(beyond)
    })
}
