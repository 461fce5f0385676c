//! Lloyd steps for small sets: each light takes the energy of the pieces of the map nearest to it and moves to their centroid.
//!
//! While the leaves of the tree remain, the pieces remain with their lights, since a piece that changes between lights would make them flicker.
//!
//! The pieces of a frame are read once. Distances are computed in fixed point ([`super::points`]): for each piece, the index of a light is in
//! the low bits of the squared distance to that light, so that the least of these numbers has the index of the nearest light.

use super::kernel::MeanVector;
use super::nodes::{Leaf, Nodes};
use super::points::{Point, Points};
use super::source::{Depth, FITTED_SOURCES, Piece, pieces};
use super::{GATHERED_DISCS, GATHERED_POINTS};
use crate::light::Light;
use crate::pyramid::Quad;
use crate::root;

const _: () = assert!(GATHERED_DISCS.is_power_of_two(), "an index of a light fills whole bits");

/// Number of Lloyd steps from the tree's lights: the error is within 2 % of convergence after four.
const STEPS: usize = 4;

/// Returns whether a set of `lights` lights is gathered; they are discs if `soft`.
pub(super) fn applies(lights: usize, soft: bool) -> bool {
    lights <= if soft { GATHERED_DISCS } else { GATHERED_POINTS }
}

/// The leaves of a set, and for each of their pieces the index of the light that has taken it.
#[derive(Clone, Debug)]
struct Assignment {
    /// Level and index of each leaf.
    leaves: heapless::Vec<(u8, u32), GATHERED_DISCS>,
    owners: [u8; FITTED_SOURCES],
}

impl Assignment {
    const fn new() -> Self {
        Self { leaves: heapless::Vec::new(), owners: [0; FITTED_SOURCES] }
    }

    fn is_of(&self, leaves: &[Leaf]) -> bool {
        self.leaves.iter().copied().eq(leaves.iter().map(|leaf| (leaf.level, leaf.index)))
    }
}

/// Working memory of the Lloyd steps, and the assignment of the last frame.
#[derive(Clone, Debug)]
pub(super) struct Gather {
    pieces: heapless::Vec<Quad, FITTED_SOURCES>,
    points: Points<FITTED_SOURCES>,
    /// For each piece, the least squared distance to a light, with the index of that light in its low bits.
    nearest: [i32; FITTED_SOURCES],
    /// The assignments of this frame and the last.
    assignments: [Assignment; 2],
}

impl Gather {
    pub(super) const fn new() -> Self {
        Self {
            pieces: heapless::Vec::new(),
            points: Points::new(),
            nearest: [0; FITTED_SOURCES],
            assignments: [const { Assignment::new() }; 2],
        }
    }

    /// Begins a frame: the assignment becomes that of the last frame.
    pub(super) fn advance(&mut self) {
        self.assignments.swap(0, 1);
    }

    /// Forgets the assignments.
    pub(super) fn reset(&mut self) {
        self.assignments.iter_mut().for_each(|assignment| assignment.leaves.clear());
    }

    /// Moves at most [`GATHERED_DISCS`] lights, the lights of `leaves`; the sum of their energies does not change.
    pub(super) fn run(&mut self, nodes: &Nodes<'_>, leaves: &[Leaf], lights: &mut [Light]) {
        let n = lights.len().min(leaves.len()).min(GATHERED_DISCS);
        let (leaves, lights) = (&leaves[..n], &mut lights[..n]);
        self.pieces.clear();
        for piece in pieces(nodes, leaves, n, false) {
            // There are at most as many pieces as places; further ones would be ignored.
            let _ = self.pieces.push(piece.quad);
        }
        let [now, last] = &mut self.assignments;
        if last.is_of(leaves) {
            now.clone_from(last);
            self.centre(lights);
            return;
        }
        now.leaves.clear();
        for leaf in leaves {
            // There are at most as many leaves as places.
            let _ = now.leaves.push((leaf.level, leaf.index));
        }
        self.points.clear();
        for quad in &self.pieces {
            // The direction of a piece without light has no effect.
            let at = root::unit(quad.mean_direction()).unwrap_or_default();
            self.points.push(&Point::new(&MeanVector::of_point(at)));
        }
        for _ in 0..STEPS {
            self.assign(lights);
            self.centre(lights);
        }
    }

    /// Returns the pieces of [`Gather::run`], combined to the pieces for the fit of discs.
    pub(super) fn disc_pieces<'a>(
        &'a self,
        nodes: &Nodes<'_>,
        leaves: &'a [Leaf],
        lights: usize,
    ) -> impl Iterator<Item = Piece> + 'a {
        let [fine, coarse] = [false, true].map(|soft| Depth::of(nodes, lights, soft));
        let mut rest = self.pieces.as_slice();
        leaves.iter().enumerate().take(lights).flat_map(move |(leaf, at)| {
            let (down, up) = (fine.below(at), fine.below(at).saturating_sub(coarse.below(at)));
            let (own, others) = rest.split_at((1 << down).min(rest.len()));
            rest = others;
            own.chunks(1 << up).map(move |part| Piece {
                leaf,
                quad: part.iter().fold(Quad::default(), |mut sum, quad| {
                    sum.add(quad);
                    sum
                }),
            })
        })
    }

    /// Assigns each piece to the nearest light.
    fn assign(&mut self, lights: &[Light]) {
        self.nearest = [i32::MAX; FITTED_SOURCES];
        for (i, light) in lights.iter().enumerate() {
            let at = Point::new(&MeanVector::of_point(light.direction));
            self.points.approach(&at, i as i32, GATHERED_DISCS as i32 - 1, &mut self.nearest);
        }
        let owners = &mut self.assignments[0].owners;
        owners
            .iter_mut()
            .zip(&self.nearest)
            .for_each(|(owner, key)| *owner = *key as u8 % GATHERED_DISCS as u8);
    }

    /// Moves each light to the centroid of its pieces.
    fn centre(&self, lights: &mut [Light]) {
        let mut sums = [Quad::default(); GATHERED_DISCS];
        for (quad, owner) in self.pieces.iter().zip(&self.assignments[0].owners) {
            sums[usize::from(*owner) % GATHERED_DISCS].add(quad);
        }
        for (light, sum) in lights.iter_mut().zip(&sums) {
            if sum.y() > 0.0 {
                let Light { id, parent, direction, .. } = *light;
                *light = Light { parent, ..Light::at_centroid(id, sum, || direction) };
            } else {
                // A light that is nearest to no piece has no energy left.
                light.irradiance = [0.0; 3];
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::healpix::{self, Domain, Order};
    use crate::pyramid::{Pyramid, pyramid_len};
    use glam::Vec3;

    const ORDER: Order = Order::saturating(3);

    /// Returns a map whose light depends on `seed`.
    fn map(seed: u32) -> Pyramid<[Quad; pyramid_len(Domain::Sphere, ORDER)]> {
        let quads = [Quad::default(); pyramid_len(Domain::Sphere, ORDER)];
        let mut map = Pyramid::try_new(quads, Domain::Sphere, ORDER).expect("room enough");
        for (ipix, quad) in map.texels_mut().iter_mut().enumerate() {
            let ipix = ipix as u32;
            let y = ((ipix + seed).wrapping_mul(0x9e37_79b9) >> 20) as f32;
            *quad = Quad::from_light([y; 3], healpix::centre(ORDER.get(), ipix).as_vec3());
        }
        map.build();
        map
    }

    /// Returns the leaves of the twelve faces, and lights that are not at their centroids.
    fn faces(nodes: &Nodes<'_>) -> (heapless::Vec<Leaf, 12>, heapless::Vec<Light, 12>) {
        let index = (0..16).filter(|index| nodes.quad(4, *index).y() > 0.0);
        let leaves: heapless::Vec<_, 12> =
            index.map(|index| Leaf { importance: 0.0, level: 4, index }).collect();
        let light = |leaf: &Leaf| {
            let quad = nodes.quad(4, leaf.index);
            let light = Light::at_centroid(1 + leaf.index, &quad, || Vec3::Z);
            Light { direction: (light.direction + Vec3::new(0.3, -0.2, 0.1)).normalize(), ..light }
        };
        let lights = leaves.iter().map(light).collect();
        (leaves, lights)
    }

    #[test]
    fn pieces_go_to_the_nearest_light_and_stay_while_the_leaves_remain() {
        let (first, second) = (map(0), map(1));
        let nodes = Nodes::new(&first.view(), None);
        let (leaves, mut lights) = faces(&nodes);
        let mut gather = Gather::new();
        gather.advance();
        gather.run(&nodes, &leaves, &mut lights);
        gather.assign(&lights);
        let mut sums = [(0.0, glam::DVec3::ZERO); 12];
        for (quad, owner) in gather.pieces.iter().zip(gather.assignments[0].owners) {
            let toward = quad.mean_direction().as_dvec3().normalize();
            let distance = |light: &Light| light.direction.as_dvec3().distance(toward);
            let least = lights.iter().map(distance).fold(f64::INFINITY, f64::min);
            let found = distance(&lights[usize::from(owner)]);
            assert!(found < least + 3e-4, "{toward}: {found}, expected {least}");
            sums[usize::from(owner)].0 += f64::from(quad.y());
            sums[usize::from(owner)].1 += quad.first_moment().as_dvec3();
        }
        gather.centre(&mut lights);
        for (light, (y, moment)) in lights.iter().zip(sums) {
            assert!(light.direction.as_dvec3().distance(moment.normalize()) < 1e-5, "{light:?}");
            assert!((f64::from(light.irradiance[0]) / y - 1.0).abs() < 1e-5, "{light:?}");
        }

        let owners = gather.assignments[0].owners;
        let nodes = Nodes::new(&second.view(), None);
        gather.advance();
        gather.run(&nodes, &leaves, &mut lights);
        assert_eq!(gather.assignments[0].owners, owners, "the leaves remain");
        let energy: f32 = lights.iter().map(|light| light.irradiance[0]).sum();
        assert!((energy / second.view().total().rgb()[0] - 1.0).abs() < 1e-5, "{energy}");
        gather.reset();
        let (_, mut lights) = faces(&nodes);
        gather.run(&nodes, &leaves, &mut lights);
        assert_ne!(gather.assignments[0].owners, owners, "assigned anew");
    }

    #[test]
    fn combined_pieces_have_the_light_of_the_map() {
        let map = map(0);
        let nodes = Nodes::new(&map.view(), None);
        let (leaves, mut lights) = faces(&nodes);
        let mut gather = Gather::new();
        gather.run(&nodes, &leaves, &mut lights);
        let combined = gather.disc_pieces(&nodes, &leaves, lights.len());
        for (piece, expected) in combined.zip(pieces(&nodes, &leaves, lights.len(), true)) {
            assert_eq!(piece.leaf, expected.leaf);
            assert!((piece.quad.y() / expected.quad.y() - 1.0).abs() < 1e-5, "{:?}", piece.quad);
        }
        assert_eq!(gather.disc_pieces(&nodes, &leaves, lights.len()).count(), 12 * 8);
    }
}
