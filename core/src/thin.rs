//! Fewer lights from a finished set: merged to a number, or restricted to those that a surface can receive.
//!
//! After the clustering and the invisible-light elimination of \[Havran2005\] (Interactive System for Dynamic Scene Lighting using
//! Captured Video Environment Maps), of which only the abstract was at hand: cost and order are ours.

use crate::buffer::{self, Buffer, TooSmall};
use crate::color::luminance;
use crate::light::{Light, cap_radius_deg};
use glam::Vec3;

/// Number of following lights among which a light's partner is searched: all of a small set; of a large one, those near it in a tree's order.
const WINDOW: usize = 256;

/// Divisor of the number of lights: so many merges are made before the costs are computed again.
const PART: usize = 8;

/// Two lights and the cost of merging them.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pair {
    cost: f32,
    first: u32,
    second: u32,
}

/// Merges lights until at most `most` are left, which are then the first of `lights`, and returns how many; 0 leaves none.
///
/// The energy of each channel is kept. A merged light stands at the centroid of the two and keeps the id, age and parent of the brighter.
/// `pairs` holds as many as there are lights. Time: about 256 x 8 x the number of lights.
///
/// # Errors
/// [`TooSmall`] for `pairs`; the lights are then untouched.
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
/// // The two neighbours become one light of their energy.
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
            // A light without id has been merged in this round; so has one that was moved, but that errs little.
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

/// The cheapest partner of each light but the last.
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

/// Moves the lights whose id is not 0 to the front and keeps their order.
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

fn energy(light: &Light) -> f32 {
    luminance(light.irradiance)
}

/// The cost of one light in place of two: the expected squared error over shadowed receivers is nearly proportional to y1 y2 times their
/// distance.
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

/// Length of the mean direction of a light's cap.
fn resultant(light: &Light) -> f32 {
    0.5 + 0.5 * libm::cosf(light.radius_deg.to_radians())
}

/// The lights that a surface can see whose normals are within `spread` (radians) of the unit vector `normal`.
///
/// `spread` is 0 for a flat surface. A light is kept if any part of its disc is above the horizon of a normal, so that soft shadows keep
/// their edge.
pub fn facing(lights: &[Light], normal: Vec3, spread: f32) -> impl Iterator<Item = &Light> {
    lights.iter().filter(move |light| {
        let beyond = (spread.max(0.0) + light.radius_deg.to_radians()).min(core::f32::consts::FRAC_PI_2);
        light.direction.dot(normal) > -libm::sinf(beyond)
    })
}
