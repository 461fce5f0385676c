//! Lights that are drawn as uniform discs: their radii and the positions of their centres.
//!
//! The mean of a kernel over a disc is nearly the kernel between mean vectors: a disc of mean resultant length R about d has the vector R
//! d, and K of two such vectors uses (1 - m . m') / 2 as the squared sine of half their angle. This is exact for a kernel that is linear in
//! the squared chord; [`SHRINK`] corrects it for the kernel's kink at 0. All fits for points therefore apply to discs at the same cost.
//!
//! The spread of a disc is not its error; the error is the light that the disc does not represent: light off its centre, and elongated
//! light. [`importance`] computes this error, and [`steer`] moves the centres to reduce it.

use super::kernel::{MeanVector, kernel};
use super::nodes::Nodes;
use super::source::{HALVED, SOURCES, Source};
use super::weights::Fit;
use super::{FITTED, GATHERED_DISCS};
use crate::light::Light;
use crate::pyramid::Quad;
use crate::root::root;
use glam::Vec3;

/// Ratio of a disc's radius to that of the disc with the angular variance of its region: the tails of a region increase its variance more
/// than they soften its shadows. Of 0.85, 0.9, 0.93, 1 and 1.1, 0.93 has the least error over the maps.
const RADIUS: f32 = 0.93;

/// Value of [`RADIUS`] for at most [`FEW`] discs beside ambient light, which represents the tails. Of 0.75, 0.8, 0.85, 0.9 and 0.93, 0.85 has the
/// least error over the maps.
const RADIUS_BESIDE_AMBIENT: f32 = 0.85;

/// Largest number of discs to which [`RADIUS_BESIDE_AMBIENT`] applies, and that are moved by three steps.
const FEW: usize = 8;

/// Least radius of a disc, degrees, about a third of the sun's: narrower discs are points. Rounding errors give the light of one texel a third
/// of this radius.
pub(super) const NARROWEST_DEG: f32 = 0.1;

/// Largest radius of a disc, degrees: within a hemisphere the centre of a disc is well defined.
const WIDEST_DEG: f32 = 90.0;

/// Number of levels below a node at which its light is compared with its disc.
const DOWN: u8 = 2;

/// Weight in the error of a disc of the spread within the parts of a node, which are compared as whole discs.
const SPREAD: f32 = 0.05;

/// Number of parts of all discs together in the error estimate of a set with fitted weights, and beside ambient light: with more parts there,
/// the search would select ceilings under which lights flicker more. Sets of more lights have as many parts as sources.
const PARTS: usize = 256;
const PARTS_BESIDE_AMBIENT: usize = 128;

/// Least and largest number of parts into which the estimate divides one disc of a set with fitted weights.
const EACH: (usize, usize) = (8, 16);

/// Number of parts below which the estimate does not divide a disc.
const FEWEST_PARTS: usize = 4;

/// Cosine and sine of the golden angle, by which pairs of parts are rotated.
const GOLDEN: (f32, f32) = (-0.737_368_9, 0.675_490_3);

/// Returns the number of steps by which the discs of a set of `lights` lights are moved: for more lights, a step gains less and costs more, and
/// those that are gathered are near their place.
fn steps(lights: usize) -> usize {
    match lights {
        0..=FEW => 3,
        _ if lights <= GATHERED_DISCS => 1,
        17..=32 => 2,
        _ => 0,
    }
}

/// Returns the number of sources that count as one disc in the fit of `lights` discs: pairs halve the time and raise the error by 2 to 4 %.
/// Beside ambient light, whose computation takes more time, they would increase the flicker.
pub(super) fn group(lights: usize, beside_ambient: bool) -> usize {
    if HALVED.contains(&lights) && !beside_ambient { 2 } else { 1 }
}

/// Sets the radii of discs that represent the lights' regions, `beside_ambient` light or alone.
pub(super) fn set_radii(lights: &mut [Light], beside_ambient: bool) {
    let ratio = if beside_ambient && lights.len() <= FEW { RADIUS_BESIDE_AMBIENT } else { RADIUS };
    for light in lights {
        let radius_deg = (ratio * light.radius_deg).min(WIDEST_DEG);
        light.radius_deg = if radius_deg < NARROWEST_DEG { 0.0 } else { radius_deg };
    }
}

/// Returns the importance of a node whose light is a disc: the error of the disc in the norm of the weights' kernel, compared with the
/// parts of the node [`DOWN`] levels below, which are discs as well.
pub(super) fn importance(nodes: &Nodes<'_>, level: u8, index: u32, quad: &Quad) -> f32 {
    let down = DOWN.min(nodes.last().saturating_sub(level));
    let mut parts = heapless::Vec::<(MeanVector, f32), { 1 << DOWN }>::new();
    let mut square = 0.0;
    for part in (index << down..(index + 1) << down).map(|index| nodes.quad(level + down, index)) {
        let y = part.y();
        if y > 0.0 {
            square += SPREAD * y * y * root(part.variance().max(0.0));
            // The array has a place for each part, so that the push cannot fail.
            let _ = parts.push((MeanVector::of_quad(&part), y));
        }
    }
    let apart = |a: &MeanVector, b: &MeanVector| 1.0 - kernel(a.apart(b));
    let (whole, y) = (MeanVector::of_quad(quad), quad.y());
    let mut disc = -y * y * apart(&whole, &whole);
    for (i, (a, ya)) in parts.iter().enumerate() {
        disc += 2.0 * y * ya * apart(&whole, a) - ya * ya * apart(a, a);
        disc -= parts[..i].iter().map(|(b, yb)| 2.0 * ya * yb * apart(a, b)).sum::<f32>();
    }
    root((square + disc.max(0.0)).max(f32::MIN_POSITIVE))
}

/// Moves the discs of a small set to reduce their error against `sources`, of which `group` count as one; their energies do not change.
pub(super) fn steer(fit: &mut Fit, sources: &[Source], group: usize, lights: &mut [Light]) {
    let mut own = [[0.0; 3]; FITTED];
    own.iter_mut().zip(lights.iter()).for_each(|(own, light)| *own = light.irradiance);
    fit.move_discs(sources, group, lights, steps(lights.len()));
    lights.iter_mut().zip(own).for_each(|(light, own)| light.irradiance = own);
}

/// A part of a light's disc, which the estimate of the error reads as a smaller disc.
pub(super) struct DiscPart {
    /// Direction of the centre of the part, a unit vector.
    pub(super) at: Vec3,
    /// Angular radius of the part, radians.
    pub(super) radius: f32,
    /// Fraction of the light's energy that the part has.
    pub(super) share: f32,
}

/// Returns the parts into which the estimate divides a disc of a set of `lights`.
///
/// The parts form pairs on opposite sides of the centre, and each pair is rotated by the golden angle from the last, so that their mean is
/// the centre of the disc.
pub(super) fn parts(light: &Light, lights: usize, beside_ambient: bool) -> impl Iterator<Item = DiscPart> {
    let most = if beside_ambient { PARTS_BESIDE_AMBIENT } else { PARTS };
    let each = if lights <= FITTED { (most / lights.max(1)).clamp(EACH.0, EACH.1) } else { SOURCES / lights };
    let count = if each < FEWEST_PARTS { 1.0 } else { (each & !1) as f32 };
    let radius = light.radius_deg.to_radians();
    let height = 1.0 - libm::cosf(radius);
    let (across, up) = light.direction.any_orthonormal_pair();
    let (cos, sin) = GOLDEN;
    let mut turn = (1.0f32, 0.0f32);
    (0..count as usize).map(move |i| {
        turn = if i % 2 == 1 {
            (-turn.0, -turn.1)
        } else {
            (turn.0 * cos - turn.1 * sin, turn.0 * sin + turn.1 * cos)
        };
        let z = if count > 1.0 { 1.0 - height * ((i & !1) as f32 + 1.0) / count } else { 1.0 };
        let r = root((1.0 - z * z).max(0.0));
        let at = light.direction * z + (across * turn.0 + up * turn.1) * r;
        DiscPart { at, radius: radius / root(count), share: 1.0 / count }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn discs_narrower_than_the_least_are_points() {
        let of = |radius_deg| Light { radius_deg, ..Light::default() };
        let mut lights = [of(0.05), of(0.2), of(180.0)];
        set_radii(&mut lights, false);
        let [point, narrow, wide] = lights.map(|light| light.radius_deg);
        assert!(point == 0.0 && (0.1..0.2).contains(&narrow) && wide == WIDEST_DEG, "{lights:?}");
    }

    /// In this test, a light of energy 1 at 0.1 radians from a source moves to the source.
    #[test]
    fn a_disc_moves_to_its_source() {
        let source = Source { at: Vec3::Z, radius: 0.3, y: 1.0, owner: 0 };
        let direction = Vec3::new(0.1, 0.0, 1.0).normalize();
        let light = Light { direction, irradiance: [1.0; 3], radius_deg: 17.0, ..Light::default() };
        let mut lights = [light, Light { direction: -Vec3::Z, irradiance: [0.0; 3], ..light }];
        let mut fit = Fit::new();
        fit.move_discs(&[source], 1, &mut lights, 20);
        assert!(lights[0].direction.distance(Vec3::Z) < 0.005, "{}", lights[0].direction);
    }
}
