//! Lights that are drawn as uniform discs of their radius: how they are placed and how wide they are.
//!
//! The mean of a kernel over a disc is nearly the kernel between mean vectors: a disc of mean resultant length R about d is the vector R d, and
//! K of two such vectors takes (1 - m . m') / 2 for the squared sine of half their angle. This is exact for a kernel that is linear in the
//! squared chord; [`SHRINK`] corrects it for the kernel's kink at 0. So all that is fitted for points is fitted for discs at the same cost.
//!
//! What a disc costs is not its spread but what it cannot show: light off its centre, elongated light. [`importance`] measures that, and
//! [`steer`] moves the centres to where the error falls.

use super::FITTED;
use super::nodes::Nodes;
use super::source::{SOURCES, Source, Sources};
use super::tree::Leaf;
use super::weights::{Fit, kernel, slope};
use crate::color::luminance;
use crate::light::Light;
use crate::pyramid::Quad;
use crate::root::root;
use glam::Vec3;

/// Part of a disc's angular variance that its vector is shorter by: a least-squares compromise of 2/3 and 1/2 of the radius, squared, which
/// the mean distance to a point at the centre and to one far away ask for.
const SHRINK: f32 = 0.85;

/// Radius of a light's disc over that of the disc with the angular variance of its region: the tails of a region widen its variance more
/// than its shadows. Of 0.85, 0.9, 0.93, 1 and 1.1 this has the least error over the maps.
const RADIUS: f32 = 0.93;

/// Largest radius, degrees: below a hemisphere a disc has a centre that it faces.
const WIDEST_DEG: f32 = 90.0;

/// Levels below a node at which its light is compared with its disc.
const DOWN: u8 = 2;

/// How much the spread of the parts counts, that no disc of theirs was compared with.
const SPREAD: f32 = 0.05;

/// Part of a Newton step that a centre makes, since its neighbours move as well.
const RELAXED: f32 = 0.7;

/// Longest step, over the disc's width.
const LONGEST: f32 = 0.5;

/// Curvature of the kernel: of its kink, over a disc's width, and of its smooth part.
const CURVATURE: (f32, f32) = (0.086, 1.15);

/// Least width of a disc, as half a chord.
const LEAST_WIDTH: f32 = 1e-3;

/// Parts of all discs together in the estimate of a set whose weights are fitted; of larger sets as many as sources.
const PARTS: usize = 256;

/// Fewest and most parts of one disc of a set whose weights are fitted.
const EACH: (usize, usize) = (8, 32);

/// A disc of fewer parts is left whole.
const FEWEST_PARTS: usize = 4;

/// Cosine and sine of the golden angle.
const GOLDEN: (f32, f32) = (-0.737_368_9, 0.675_490_3);

/// Number of steps of [`steer`] for so many lights: more lights gain less by it and cost more.
fn steps(lights: usize) -> usize {
    match lights {
        2..=16 => 4,
        17..=32 => 2,
        _ => 0,
    }
}

/// Sets the radii of discs that stand for the lights' regions.
fn set_radii(lights: &mut [Light]) {
    for light in lights {
        light.radius_deg = (RADIUS * light.radius_deg).min(WIDEST_DEG);
    }
}

/// The mean vector of a disc of `radius` radians at `at`.
pub(super) fn mean_vector(at: Vec3, radius: f32) -> Vec3 {
    // The squared sine of half the radius, within 1e-3 up to a right angle.
    let square = radius * radius;
    at * (1.0 - SHRINK * 0.25 * square * (1.0 + square * (square / 360.0 - 1.0 / 12.0)))
}

/// The mean vector of a light's disc.
pub(super) fn vector_of(light: &Light) -> Vec3 {
    mean_vector(light.direction, light.radius_deg.to_radians())
}

/// The importance of a node whose light is a disc: the error of the disc in the norm of the weights' kernel, where the parts of the
/// node, [`DOWN`] levels below, are discs as well.
pub(super) fn importance(nodes: &Nodes<'_>, level: u8, index: u32, quad: &Quad) -> f32 {
    let down = DOWN.min(nodes.last().saturating_sub(level));
    let mut parts = heapless::Vec::<(Vec3, f32), { 1 << DOWN }>::new();
    let mut square = 0.0;
    for part in (index << down..(index + 1) << down).map(|index| nodes.quad(level + down, index)) {
        let y = part.y();
        if y > 0.0 {
            square += SPREAD * y * y * root(part.variance().max(0.0));
            // No more parts than there is room for.
            let _ = parts.push((part.first_moment() / y, y));
        }
    }
    let apart = |a: Vec3, b: Vec3| 1.0 - kernel(0.5 - 0.5 * a.dot(b));
    let (whole, y) = (quad.first_moment() / quad.y(), quad.y());
    let mut disc = -y * y * apart(whole, whole);
    for (i, (a, ya)) in parts.iter().enumerate() {
        disc += 2.0 * y * ya * apart(whole, *a) - ya * ya * apart(*a, *a);
        disc -= parts[..i].iter().map(|(b, yb)| 2.0 * ya * yb * apart(*a, *b)).sum::<f32>();
    }
    root((square + disc.max(0.0)).max(f32::MIN_POSITIVE))
}

/// Sets the radii of discs and moves few of them; their energies stay those of their regions.
pub(super) fn place(
    (sources, fit): (&mut Sources, &mut Fit),
    nodes: &Nodes<'_>,
    leaves: &[Leaf],
    lights: &mut [Light],
) {
    set_radii(lights);
    let steps = steps(lights.len());
    if steps == 0 {
        return;
    }
    let mut own = [[0.0; 3]; FITTED];
    own.iter_mut().zip(lights.iter()).for_each(|(own, light)| *own = light.irradiance);
    sources.fill(nodes, leaves, lights);
    for _ in 0..steps {
        fit.run_discs(sources.as_slice(), lights);
        steer(sources.as_slice(), lights);
    }
    lights.iter_mut().zip(own).for_each(|(light, own)| light.irradiance = own);
}

/// The parts of which the estimate makes up a disc of a set of `lights`: centre, radius in radians, share of the energy.
///
/// They are pairs on opposite sides of the centre, each pair as far round as the golden angle from the last, so that their mean is the
/// disc's.
pub(super) fn parts(light: &Light, lights: usize) -> impl Iterator<Item = (Vec3, f32, f32)> {
    let each =
        if lights <= FITTED { (PARTS / lights.max(1)).clamp(EACH.0, EACH.1) } else { SOURCES / lights };
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
        (light.direction * z + (across * turn.0 + up * turn.1) * r, radius / root(count), 1.0 / count)
    })
}

/// Mean vectors of discs, one coordinate a row, and their energies.
struct Discs {
    axes: [[f32; FITTED]; 3],
    y: [f32; FITTED],
}

/// Moves the centres of at most [`FITTED`] discs one step down the gradient of the error in the norm of the kernel.
fn steer(sources: &[Source], lights: &mut [Light]) {
    let n = lights.len().min(FITTED);
    let mut discs = Discs { axes: [[0.0; FITTED]; 3], y: [0.0; FITTED] };
    for (i, light) in lights.iter().enumerate().take(n) {
        let vector = vector_of(light);
        discs.axes.iter_mut().zip(vector.to_array()).for_each(|(axis, v)| axis[i] = v);
        discs.y[i] = luminance(light.irradiance);
    }
    let mut pulls = [[0.0; FITTED]; 3];
    for source in sources {
        discs.pull(n, mean_vector(source.at, source.radius), source.y, &mut pulls);
    }
    for j in 0..n {
        let at = Vec3::from_array(discs.axes.map(|axis| axis[j]));
        discs.pull(n, at, -discs.y[j], &mut pulls);
    }
    for (i, light) in lights.iter_mut().enumerate().take(n).filter(|(i, _)| discs.y[*i] > 0.0) {
        let vector = Vec3::from_array(discs.axes.map(|axis| axis[i]));
        let width = root((0.5 - 0.5 * vector.length_squared()).max(LEAST_WIDTH * LEAST_WIDTH));
        let stiffness = discs.y[i] * (CURVATURE.0 / width + CURVATURE.1);
        let pull = Vec3::from_array(pulls.map(|axis| axis[i])) * (RELAXED / stiffness);
        let step = pull.clamp_length_max(LONGEST * width).reject_from_normalized(light.direction);
        light.direction = (vector + step).try_normalize().unwrap_or(light.direction);
    }
}

impl Discs {
    /// Adds to `pulls` the pull of energy `y` at `at` on each of the first `n` discs.
    fn pull(&self, n: usize, at: Vec3, y: f32, pulls: &mut [[f32; FITTED]; 3]) {
        let n = n.min(FITTED);
        let half = at * 0.5;
        let [x_axis, y_axis, z_axis] = &self.axes;
        let [px, py, pz] = pulls;
        let (x_axis, y_axis, z_axis) = (&x_axis[..n], &y_axis[..n], &z_axis[..n]);
        let (px, py, pz) = (&mut px[..n], &mut py[..n], &mut pz[..n]);
        for i in 0..n {
            let s = y * slope(0.5 - (x_axis[i] * half.x + y_axis[i] * half.y + z_axis[i] * half.z));
            px[i] += s * at.x;
            py[i] += s * at.y;
            pz[i] += s * at.z;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampler::adaptive::weights::KERNEL;

    #[test]
    fn the_slope_is_the_kernels_derivative() {
        for i in 1..40 {
            let x = 0.97 - 0.048 * i as f32;
            let exact = |x: f32| {
                let h = f64::from(0.5 - 0.5 * x).sqrt();
                KERNEL.iter().rev().fold(0.0, |sum, c| sum * h + f64::from(*c))
            };
            let expected = (exact(x + 1e-2) - exact(x - 1e-2)) / 2e-2;
            let found = f64::from(slope(0.5 - 0.5 * x));
            assert!(
                (found - expected).abs() < 0.02 + 0.02 * expected.abs(),
                "{x}: {found}, expected {expected}"
            );
        }
    }

    /// A light of energy 1 that is 0.1 radians off a source moves to it.
    #[test]
    fn a_disc_moves_to_its_source() {
        let source = Source { at: Vec3::Z, radius: 0.3, y: 1.0, owner: 0 };
        let direction = Vec3::new(0.1, 0.0, 1.0).normalize();
        let mut lights = [Light { direction, irradiance: [1.0; 3], radius_deg: 17.0, ..Light::default() }];
        for _ in 0..20 {
            steer(&[source], &mut lights);
        }
        assert!(lights[0].direction.distance(Vec3::Z) < 0.005, "{}", lights[0].direction);
    }
}
