//! Extrapolation: an estimate of the light outside of the field of view.

use crate::buffer::Buffer;
use crate::healpix::{self, Domain};
use crate::pixel_table::Texel;
use crate::pyramid::{Pyramid, Quad};
use glam::Vec3;

/// The estimate of the light from the part of the hemisphere outside of the field of view.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Extrapolation {
    /// Directions outside of the field of view have no light.
    #[default]
    None,
    /// The mean radiance inside the field of view without its brightest and its darkest quarter: a single lamp does not raise the estimate.
    Average,
}

/// HEALPix order of the quads whose radiance is averaged: 384 quads of 7 degrees, fine enough to separate a lamp from its surroundings.
const ORDER: u8 = 3;
const QUADS: usize = Domain::Hemisphere.quads(ORDER);

/// Adds the mean radiance inside the field of view to the texels outside of it, rebuilds the map and returns the mean (RGB).
///
/// A map of an order below 3 or of the whole sphere is unchanged.
pub fn average<Q: Buffer<Quad>>(map: &mut Pyramid<Q>, geometry: &[Texel]) -> [f32; 3] {
    let order = map.view().order().get();
    if order < ORDER || map.view().domain() != Domain::Hemisphere {
        return [0.0; 3];
    }
    let radiance = seen_average(map, geometry);
    for (quad, texel) in map.texels_mut().iter_mut().zip(geometry).filter(|(_, t)| t.unseen_sr > 0.0) {
        let rgb = radiance.map(|v| v * texel.unseen_sr);
        quad.add(&Quad::from_light(rgb, Vec3::from_array(texel.direction)));
    }
    map.build();
    radiance
}

/// Returns the mean RGB radiance of the quads of order 3 that are at least half inside the field of view. The brightest and the darkest
/// quarter of these quads, by luminance, are left out of the mean.
fn seen_average<Q: Buffer<Quad>>(map: &Pyramid<Q>, geometry: &[Texel]) -> [f32; 3] {
    let view = map.view();
    let below = 1 << (2 * (view.order().get() - ORDER));
    let mut seen = [(0.0f32, [0.0f32; 3]); QUADS];
    let mut count = 0;
    for (ipix, (texels, quad)) in geometry.chunks(below).zip(view.quads_of(ORDER)).enumerate() {
        let omega = (healpix::solid_angle(ORDER) * Domain::Hemisphere.share(ORDER, ipix as u32)) as f32;
        let visible = omega - texels.iter().map(|t| t.unseen_sr).sum::<f32>();
        if omega > 0.0 && visible > 0.5 * omega {
            let Some(slot) = seen.get_mut(count) else { break };
            *slot = (quad.y() / visible, quad.rgb().map(|v| v / visible));
            count += 1;
        }
    }
    let seen = seen.get_mut(..count).unwrap_or_default();
    seen.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let middle = seen.get(count / 4..count - count / 4).unwrap_or_default();
    let mut sum = [0.0; 3];
    middle.iter().for_each(|(_, rgb)| crate::color::add(&mut sum, *rgb));
    if middle.is_empty() { sum } else { sum.map(|v| v / middle.len() as f32) }
}
