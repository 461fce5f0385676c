//! The conversion of integer sums of codes, which are stored in the memory of a texel's first moment until the map is finished.

use crate::quad::Quad;

/// Conversion of the integer sums of codes of a texel to counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Tally {
    /// Black level, in units of 2^-`shift` codes.
    pub(crate) black: i16,
    /// Number of fraction bits of codes above black.
    pub(crate) shift: u32,
    /// Number of counts per unit of the integer sums.
    pub(crate) unit: f32,
    /// Largest sum of the pixel weights of a texel whose product with any code fits 31 bits.
    pub(crate) most_weight: u32,
}

impl Tally {
    /// Returns the energy sums of `quad` plus its integer sums, in counts; the fourth lane is 0.
    #[inline]
    pub(crate) fn settled(&self, quad: &Quad) -> [f32; 4] {
        let total = |lane: usize| quad.energy[lane] + quad.moment[lane].to_bits() as i32 as f32 * self.unit;
        [total(0), total(1), total(2), 0.0]
    }
}
