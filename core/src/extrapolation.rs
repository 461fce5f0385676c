//! Extrapolation: an estimate of what the lens does not see.

use crate::buffer::Buffer;
use crate::healpix::{self, Domain};
use crate::pixel_table::Texel;
use crate::pyramid::{Pyramid, Quad};
use glam::Vec3;

/// What stands in the place of the part of the hemisphere that the lens does not see.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Extrapolation {
    /// Nothing: darkness.
    #[default]
    None,
    /// The average radiance of what is seen, without its brightest and darkest quarter: with the plain mean one lamp would light
    /// the whole rim.
    Average,
}

/// Order at which the average is taken: 384 quads of 7 degrees, fine enough to tell a lamp from its surroundings.
const ORDER: u8 = 3;
const QUADS: usize = Domain::Hemisphere.quads(ORDER);

/// Adds the average radiance to the unseen part of a built pyramid's texels and builds it again; returns that radiance.
///
/// A map coarser than order 3 stays as it is.
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

/// Mean radiance of the middle half, by luminance, of the order-3 quads of which at least half is seen.
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
