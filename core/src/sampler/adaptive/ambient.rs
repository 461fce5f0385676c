//! Ambient light: light without a direction as spherical harmonics, and the excess above it for the directional lights.
//!
//! The harmonics are a least-squares fit of degree 2 to the map. The fit is repeated on a map that is cut off at a ceiling over the
//! previous fit, so that lamps and the sun drop out of the fit. The light above the ceiling is the excess, which only the directional
//! lights represent. Since the constant function is one of the nine basis functions, the fit keeps the energy of the cut map. If no lights
//! are requested, the map is not cut off.
//!
//! Beside discs, the harmonics also contain the part of degree 1 and 2 of the excess that the discs do not represent ([`Ambient::complete`]).
//!
//! The height of the ceiling determines the share of the directional lights: few lights need a high ceiling, many lights a low one. The
//! sampler tries [`CEILINGS`] and selects the ceiling with the least error.

use crate::color::{self, luminance};
use crate::harmonics;
use crate::healpix::{self, Domain, Order};
use crate::light::{Light, Sh9};
use crate::pyramid::{PyramidView, Quad};
use crate::root;
use glam::Vec3;

/// HEALPix order of the quads to which the harmonics are fitted: 7 degrees, a tenth of the resolution of degree 2.
const ORDER: u8 = 3;

/// Number of quads of [`ORDER`] on a sphere.
pub(super) const QUADS: usize = Domain::Sphere.quads(ORDER);

/// Number of quads of all orders up to [`ORDER`] on a sphere.
const SUMS: usize = crate::pyramid::pyramid_len(Domain::Sphere, Order::saturating(ORDER));

/// Ceilings as multiples of the fit: light above the ceiling is not ambient. With the last ceiling there is no excess.
pub(super) const CEILINGS: [f32; 10] = [0.25, 0.5, 0.7, 1.0, 1.5, 3.0, 6.0, 12.0, 24.0, f32::INFINITY];

/// Index of the infinite ceiling in [`CEILINGS`].
pub(super) const ALL: usize = CEILINGS.len() - 1;

/// Index in [`CEILINGS`] at which the search for the best ceiling begins; the search continues with the indices above and below.
pub(super) const USUAL: usize = 4;
pub(super) const HIGHER: &[usize] = &[5, 6, 7, 8];
pub(super) const LOWER: &[usize] = &[3, 2, 1, 0];

/// Radius of a disc with the area of a quad of [`ORDER`], radians: (4 / 768)^(1/2).
pub(super) const RADIUS: f32 = 0.0722;

/// Number of fits of the harmonics per map.
const ROUNDS: usize = 4;

/// Fraction of the difference by which the correction beside discs changes per frame in a scene at rest, as much as a filtered light.
const FOLLOWED: f32 = 0.11;

/// The ambient light of one map and the excess above it.
#[derive(Clone, Debug)]
pub(super) struct Ambient {
    domain: Domain,
    /// HEALPix order of `directions`: [`ORDER`], or that of the map if it is coarser.
    order: u8,
    directions: [Vec3; QUADS],
    /// Inverse of the matrix of the integrals over the domain of the products of basis functions.
    inverse: [[f32; 9]; 9],
    sh: Sh9,
    /// Integrals of the products of the light below the ceiling and the basis functions.
    kept: Sh9,
    /// Luminance of the fitted harmonics at the centre of each quad.
    level: [f32; QUADS],
    /// Luminance of each quad above which light is not ambient.
    ceiling: [f32; QUADS],
    /// Light above the ceiling, in quads of all orders up to `order`.
    excess: [Quad; SUMS],
}

/// The residual of the fit in a quad.
pub(super) struct QuadResidual {
    /// Direction of the quad's centre.
    pub(super) direction: Vec3,
    /// Luminance energy of the map below the ceiling minus that of the fit in the quad; may be negative.
    pub(super) y: f32,
}

impl Ambient {
    pub(super) const fn new() -> Self {
        Self {
            domain: Domain::Sphere,
            order: 0,
            directions: [Vec3::Z; QUADS],
            inverse: [[0.0; 9]; 9],
            sh: [[0.0; 3]; 9],
            kept: [[0.0; 3]; 9],
            level: [0.0; QUADS],
            ceiling: [f32::INFINITY; QUADS],
            excess: [Quad { energy: [0.0; 4], moment: [0.0; 4] }; SUMS],
        }
    }

    /// Initialises the geometry for maps of `domain` up to `order` and discards any former fit.
    pub(super) fn prepare(&mut self, domain: Domain, order: u8) {
        (self.domain, self.order) = (domain, order.min(ORDER));
        for (ipix, direction) in self.directions.iter_mut().enumerate().take(domain.quads(self.order)) {
            *direction = healpix::centre(self.order, ipix as u32).as_vec3();
        }
        self.inverse = inverse(products(domain)).map(|row| row.map(|v| v as f32));
        self.sh = [[0.0; 3]; 9];
        self.level = [0.0; QUADS];
        self.excess = [Quad::default(); SUMS];
    }

    /// Returns the ambient radiance as spherical harmonics.
    pub(super) fn harmonics(&self) -> &Sh9 {
        &self.sh
    }

    /// Fits the harmonics to `map`, cut off at ceiling `which` of [`CEILINGS`].
    pub(super) fn fit(&mut self, map: &PyramidView<'_>, which: usize) {
        self.ceiling = [f32::INFINITY; QUADS];
        self.round(map);
        let Some(factor) = CEILINGS[..ALL].get(which) else { return };
        // A ceiling below the fit would lower the fit in every round, so it is applied in the last round only.
        for round in 1..ROUNDS {
            let factor = if round + 1 < ROUNDS { factor.max(CEILINGS[USUAL]) } else { *factor };
            for (ceiling, level) in self.ceiling.iter_mut().zip(&self.level) {
                *ceiling = factor * level.max(0.0);
            }
            self.round(map);
        }
    }

    /// Limits the map's luminance to `ceiling` and fits the harmonics to the limited map; the light above the ceiling goes to `excess`.
    fn round(&mut self, map: &PyramidView<'_>) {
        let mut sums = [[0.0f32; 3]; 9];
        let quads = self.domain.quads(self.order);
        for ipix in 0..quads {
            let excess = self.cut(map, ipix);
            let whole = map.quad(self.order, ipix as u32).rgb();
            let kept: [f32; 3] = core::array::from_fn(|c| (whole[c] - excess.energy[c]).max(0.0));
            for (sum, value) in sums.iter_mut().zip(harmonics::basis(self.directions[ipix])) {
                color::add(sum, kept.map(|v| v * value));
            }
            self.excess[at(self.order, ipix)] = excess;
        }
        self.kept = sums;
        self.set(&sums);
        for order in (0..self.order).rev() {
            for ipix in 0..self.domain.quads(order) {
                let mut sum = Quad::default();
                (0..4).for_each(|child| sum.add(&self.excess[at(order + 1, 4 * ipix + child)]));
                self.excess[at(order, ipix)] = sum;
            }
        }
    }

    /// Sets the harmonics to those with the integrals `sums` of products with the basis functions.
    fn set(&mut self, sums: &Sh9) {
        self.sh = core::array::from_fn(|i| {
            let mut c = [0.0; 3];
            self.inverse[i].iter().zip(sums).for_each(|(g, sum)| color::add(&mut c, sum.map(|s| s * g)));
            c
        });
        let y = self.sh.map(luminance);
        let quads = self.domain.quads(self.order);
        for (level, direction) in self.level.iter_mut().zip(&self.directions).take(quads) {
            *level = y.iter().zip(harmonics::basis(*direction)).map(|(c, b)| c * b).sum();
        }
    }

    /// Adds the part of degree 1 and 2 of the excess that `lights`, read as discs, do not represent; returns the correction. With the
    /// `last` correction, that of a scene at rest, the correction follows the difference by [`FOLLOWED`].
    ///
    /// Irradiance contains little light of higher degrees [Ramamoorthi and Hanrahan 2001], so that the correction removes most of the
    /// error of few discs. The energy of the ambient light does not change.
    pub(super) fn complete(&mut self, lights: &[Light], last: Option<Sh9>) -> Sh9 {
        let mut missing = [[0.0; 3]; 9];
        for ipix in 0..self.domain.quads(self.order) {
            let quad = &self.excess[at(self.order, ipix)];
            if let Some(direction) = root::unit(quad.mean_direction()) {
                // A disc of the mean resultant length r = (1 + cos a) / 2 has (1 + cos a) cos a / 2 = 2 r^2 - r in degree 2.
                let r = quad.mean_direction().dot(direction);
                project(&mut missing, direction, [r, r * (2.0 * r - 1.0)], quad.rgb());
            }
        }
        for light in lights {
            let cos = libm::cosf(light.radius_deg.to_radians());
            let r = 0.5 + 0.5 * cos;
            project(&mut missing, light.direction, [r, r * cos], light.irradiance.map(|v| -v));
        }
        if let Some(last) = last {
            for (new, old) in missing.iter_mut().flatten().zip(last.iter().flatten()) {
                *new = old + FOLLOWED * (*new - old);
            }
        }
        let mut sums = self.kept;
        sums.iter_mut().zip(missing).for_each(|(sum, more)| color::add(sum, more));
        self.set(&sums);
        missing
    }

    /// Returns the order at which light is compared with the ceiling.
    fn fine(&self, map: &PyramidView<'_>) -> u8 {
        (self.order + 1).min(map.order().get())
    }

    /// Returns the light above the ceiling in a quad of `self.order`, compared in its four children.
    fn cut(&self, map: &PyramidView<'_>, ipix: usize) -> Quad {
        let fine = self.fine(map);
        let shift = 2 * (fine - self.order);
        let mut sum = Quad::default();
        for child in (ipix << shift) as u32..((ipix + 1) << shift) as u32 {
            sum.add(&self.above(map, fine, fine, child));
        }
        sum
    }

    /// Returns the light above the ceiling in a quad of `order`. The share of the light above the ceiling is computed for the enclosing quad
    /// of order `fine`, so that the sums over the quads of all orders are equal.
    fn above(&self, map: &PyramidView<'_>, fine: u8, order: u8, ipix: u32) -> Quad {
        let within = ipix >> (2 * (order - fine));
        let y = map.quad(fine, within).y();
        let ceiling = self.ceiling[(within >> (2 * (fine - self.order))) as usize % QUADS];
        let omega = omega(self.domain, fine, within);
        let below = ceiling * omega;
        if omega <= 0.0 || y <= below {
            return Quad::default();
        }
        let part = (y - below) / y;
        let quad = map.quad(order, ipix);
        Quad { energy: quad.energy.map(|v| v * part), moment: quad.moment.map(|v| v * part) }
    }

    /// Returns the excess of a quad over the ambient light.
    pub(super) fn excess(&self, map: &PyramidView<'_>, order: u8, ipix: u32) -> Quad {
        if order <= self.order {
            self.excess.get(at(order, ipix as usize)).copied().unwrap_or_default()
        } else {
            self.above(map, self.fine(map), order, ipix)
        }
    }

    /// Returns the residual of the fit in each quad.
    pub(super) fn residuals(&self, map: &PyramidView<'_>) -> impl Iterator<Item = QuadResidual> {
        (0..self.domain.quads(self.order)).map(|ipix| {
            let fit = self.level[ipix] * omega(self.domain, self.order, ipix as u32);
            let kept = map.quad(self.order, ipix as u32).y() - self.excess[at(self.order, ipix)].y();
            QuadResidual { direction: self.directions[ipix], y: kept - fit }
        })
    }
}

/// Adds to `sums` the products of the light `rgb` about `direction` with the basis functions of degree 1 and 2, of which the light has the
/// fractions `bands`.
fn project(sums: &mut Sh9, direction: Vec3, bands: [f32; 2], rgb: [f32; 3]) {
    for (k, (sum, value)) in sums.iter_mut().zip(harmonics::basis(direction)).enumerate().skip(1) {
        let band = bands[usize::from(k > 3)];
        color::add(sum, rgb.map(|v| v * value * band));
    }
}

/// Returns the index of quad `ipix` of `order` in the excess: each order fills a part of the array, the finest order the last part.
const fn at(order: u8, ipix: usize) -> usize {
    Domain::Sphere.faces() * (((1 << (2 * order)) - 1) / 3) + ipix
}

/// Returns the solid angle of a quad inside of the domain, steradians.
fn omega(domain: Domain, order: u8, ipix: u32) -> f32 {
    (healpix::solid_angle(order) * domain.share(order, ipix)) as f32
}

/// Returns the integrals of the products of the basis functions over the domain. The products are polynomials of degree 4, for which three
/// Gauss points in z and eight azimuths are exact.
fn products(domain: Domain) -> [[f64; 9]; 9] {
    let (low, points) =
        (if domain == Domain::Sphere { -1.0 } else { 0.0 }, [(-0.6f64, 5.0), (0.0, 8.0), (0.6, 5.0)]);
    let mut sums = [[0.0; 9]; 9];
    for (node, weight) in points {
        let node = libm::copysign(libm::sqrt(libm::fabs(node)), node);
        let half = (1.0 - low) / 2.0;
        let z = low + half * (1.0 + node);
        let r = libm::sqrt(1.0 - z * z);
        for step in 0..8 {
            let phi = core::f64::consts::FRAC_PI_4 * f64::from(step);
            let d = Vec3::new((r * libm::cos(phi)) as f32, (r * libm::sin(phi)) as f32, z as f32);
            let values = harmonics::basis(d).map(f64::from);
            let share = half * weight / 9.0 * core::f64::consts::FRAC_PI_4;
            for (row, a) in sums.iter_mut().zip(values) {
                row.iter_mut().zip(values).for_each(|(sum, b)| *sum += share * a * b);
            }
        }
    }
    sums
}

/// Returns the inverse of the positive definite matrix `m`, by Gauss-Jordan elimination.
fn inverse(mut m: [[f64; 9]; 9]) -> [[f64; 9]; 9] {
    let mut out: [[f64; 9]; 9] =
        core::array::from_fn(|i| core::array::from_fn(|j| f64::from(u8::from(i == j))));
    for i in 0..9 {
        let pivot = m[i][i];
        m[i] = m[i].map(|v| v / pivot);
        out[i] = out[i].map(|v| v / pivot);
        let (row, own) = (m[i], out[i]);
        for j in (0..9).filter(|j| *j != i) {
            let factor = m[j][i];
            m[j].iter_mut().zip(row).for_each(|(v, r)| *v -= factor * r);
            out[j].iter_mut().zip(own).for_each(|(v, r)| *v -= factor * r);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::{Ambient, FOLLOWED, USUAL};
    use crate::harmonics;
    use crate::healpix::{self, Domain, Order};
    use crate::light::Light;
    use crate::pyramid::{Pyramid, Quad, pyramid_len};
    use glam::Vec3;

    /// Light of two discs under a ceiling: the harmonics of degree 1 and 2 and one disc of another direction have the sum of the two discs.
    #[test]
    fn completed_harmonics_and_discs_have_the_moments_of_the_map() {
        const ORDER: u8 = 4;
        let quads = [Quad::default(); pyramid_len(Domain::Sphere, Order::saturating(ORDER))];
        let mut map = Pyramid::try_new(quads, Domain::Sphere, Order::saturating(ORDER)).expect("room enough");
        let texels =
            || (0..Domain::Sphere.quads(ORDER)).map(|ipix| healpix::centre(ORDER, ipix as u32).as_vec3());
        let light = |d: Vec3| {
            if d.x > 0.95 {
                9.0
            } else if d.z > 0.9 {
                4.0
            } else {
                0.05
            }
        };
        for (quad, d) in map.texels_mut().iter_mut().zip(texels()) {
            *quad = Quad::from_light([light(d), 2.0 * light(d), light(d)], d);
        }
        map.build();
        let mut ambient = Ambient::new();
        ambient.prepare(Domain::Sphere, ORDER);
        ambient.fit(&map.view(), USUAL);
        let excess = ambient.excess(&map.view(), 0, 0);
        let whole = (1..12).fold(excess, |mut sum, face| {
            sum.add(&ambient.excess(&map.view(), 0, face));
            sum
        });
        let direction = Vec3::new(1.0, 0.2, 0.7).normalize();
        let disc = Light { direction, irradiance: whole.rgb(), radius_deg: 30.0, ..Light::default() };
        let before = ambient.harmonics()[0];
        ambient.complete(&[disc], None);
        assert!((ambient.harmonics()[0][0] / before[0] - 1.0).abs() < 1e-6, "energy");
        // The mean of a basis function of degree 1 and 2 over a disc: (1 + cos r) / 2 and cos r (1 + cos r) / 2 times its value.
        let (one, two) = (0.933_012_7f32, 0.808_012_7);
        for (k, found) in ambient.harmonics().iter().enumerate().skip(1) {
            let band = if k > 3 { two } else { one };
            let expected: f32 = texels().map(|d| light(d) * harmonics::basis(d)[k]).sum();
            let found = found[0] + disc.irradiance[0] * band * harmonics::basis(direction)[k];
            let tolerance = 0.01 * map.view().total().rgb()[0];
            assert!((found - expected).abs() < tolerance, "{k}: {found}, expected {expected}");
        }
        // In a scene at rest, a correction is followed slowly.
        let all = ambient.complete(&[disc], None);
        let slow = ambient.complete(&[disc], Some([[0.0; 3]; 9]));
        assert!(
            slow.iter().flatten().zip(all.iter().flatten()).all(|(s, a)| (s - FOLLOWED * a).abs() < 1e-5)
        );
    }

    #[test]
    fn the_excess_has_the_same_sum_at_every_order() {
        const ORDER: u8 = 5;
        let mut map = Pyramid::try_new(
            [Quad::default(); pyramid_len(Domain::Hemisphere, Order::saturating(ORDER))],
            Domain::Hemisphere,
            Order::saturating(ORDER),
        )
        .expect("room enough");
        // A map coarser than the pyramid: light in every fifth texel, more of it in a few.
        for (ipix, quad) in map.texels_mut().iter_mut().enumerate().step_by(5) {
            let y = if ipix % 400 == 0 { 30.0 } else { 1.0 };
            *quad = Quad::from_light([y; 3], healpix::centre(ORDER, ipix as u32).as_vec3());
        }
        map.build();
        let mut ambient = Ambient::new();
        ambient.prepare(Domain::Hemisphere, ORDER);
        ambient.fit(&map.view(), USUAL);
        let sum = |order: u8| -> f32 {
            let quads = Domain::Hemisphere.quads(order) as u32;
            (0..quads).map(|ipix| ambient.excess(&map.view(), order, ipix).y()).sum()
        };
        let whole = sum(0);
        assert!(whole > 0.1 * map.view().total().y(), "{whole} exceeds");
        for order in 1..=ORDER {
            assert!(
                (sum(order) / whole - 1.0).abs() < 1e-4,
                "order {order}: {}, expected {whole}",
                sum(order)
            );
        }
    }
}
