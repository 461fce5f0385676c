//! Marks of the texels in the map of one exposure, in the fourth number of the first moment, which no sum of light uses.

use crate::quad::Quad;

/// The codes that pixels of a texel reach in an exposure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Mark {
    /// True if a pixel has a code that would be saturated in the next longer exposure.
    pub(crate) bright: bool,
    /// True if a pixel has a saturated code.
    pub(crate) clipped: bool,
}

impl Mark {
    /// Adds the mark to the marks of `quad`.
    #[inline]
    pub(super) fn add_to(self, quad: &mut Quad) {
        let bits = quad.moment[3].to_bits() | u32::from(self.bright) | u32::from(self.clipped) << 1;
        quad.moment[3] = f32::from_bits(bits);
    }

    /// Returns the marks that are stored in `quad`.
    #[inline]
    pub(crate) fn of(quad: &Quad) -> Self {
        let bits = quad.moment[3].to_bits();
        Self { bright: bits & 1 != 0, clipped: bits & 2 != 0 }
    }
}
