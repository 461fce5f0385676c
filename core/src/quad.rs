//! Energy and first moment of one HEALPix quad.

use crate::color::{self, MAX_ENERGY, luminance};
use crate::root::root;
use bytemuck::{Pod, Zeroable};
use glam::Vec3;

/// Energy and first moment of the light from one HEALPix quad.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Quad {
    /// Energy of the quad: radiance times solid angle, summed over the quad, for red, green, blue and luminance.
    pub energy: [f32; 4],
    /// First moment: luminance energy times unit direction, summed over the quad; the fourth element is unused.
    pub moment: [f32; 4],
}

impl Quad {
    /// Creates a quad with the energy `rgb` from the single unit vector `direction`.
    ///
    /// Negative channels and NaN count as 0; channels are limited to [`color::MAX_ENERGY`].
    #[must_use]
    #[inline]
    pub fn from_light(rgb: [f32; 3], direction: Vec3) -> Self {
        let rgb = color::sound(rgb);
        let y = luminance(rgb);
        let m = direction * y;
        Self { energy: [rgb[0], rgb[1], rgb[2], y], moment: [m.x, m.y, m.z, 0.0] }
    }

    /// Adds the energy and the first moment of `other` to those of this quad.
    #[inline]
    pub fn add(&mut self, other: &Self) {
        for i in 0..4 {
            self.energy[i] += other.energy[i];
            self.moment[i] += other.moment[i];
        }
    }

    /// Returns the red, green and blue energy of the quad.
    #[must_use]
    #[inline]
    pub fn rgb(&self) -> [f32; 3] {
        [self.energy[0], self.energy[1], self.energy[2]]
    }

    /// Returns the luminance energy of the quad.
    #[must_use]
    #[inline]
    pub fn y(&self) -> f32 {
        self.energy[3]
    }

    /// Returns the first moment of the quad's luminance energy.
    #[must_use]
    #[inline]
    pub fn first_moment(&self) -> Vec3 {
        Vec3::new(self.moment[0], self.moment[1], self.moment[2])
    }

    /// Returns the mean direction of the quad's light: first moment divided by luminance energy, not normalised; the zero vector for a quad
    /// without light.
    ///
    /// The first moment is divided before a length is computed, so that the length neither underflows nor overflows for any unit of light.
    #[must_use]
    #[inline]
    pub fn mean_direction(&self) -> Vec3 {
        if self.y() > 0.0 { self.first_moment() / self.y() } else { Vec3::ZERO }
    }

    /// Returns the angular variance of the quad's light: 1 minus the length of the mean direction; 0 for a quad without light.
    #[must_use]
    #[inline]
    pub fn variance(&self) -> f32 {
        // 1 - r = (1 - r^2) / (1 + r) halves the effect of the error of the root.
        let squared = self.mean_direction().length_squared();
        if self.y() > 0.0 {
            (1.0 - squared).max(0.0) / (1.0 + root(squared.max(f32::MIN_POSITIVE)))
        } else {
            0.0
        }
    }

    /// Returns whether all numbers of the quad are finite and its energies are not negative.
    #[inline]
    pub(crate) fn is_sound(&self) -> bool {
        let energies = self.energy.iter().fold(true, |sound, e| sound & (0.0..=2.0 * MAX_ENERGY).contains(e));
        self.moment.iter().fold(energies, |sound, m| sound & (m.abs() <= 2.0 * MAX_ENERGY))
    }
}
