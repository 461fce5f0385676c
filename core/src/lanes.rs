//! The lanes of an accumulator: up to four sums per texel, one for each sample of a pixel or of a mosaic cell.

use crate::format::Format;
use crate::quad::Quad;
use crate::tally::Tally;

/// The assignment of lanes to colour channels, and the energy per count of each channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lanes {
    pub(crate) pick: Pick,
    scale: [f32; 3],
    /// Conversion of the texels' integer sums of codes; `None` if the texels have none.
    pub(crate) tally: Option<Tally>,
}

/// The lanes of an accumulator whose sums belong to each colour channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Pick {
    /// Red, green, blue; the fourth lane is unused.
    Plain,
    /// Blue, green, red; the fourth lane is unused.
    Swapped,
    /// One lane, whose sum is that of all colour channels.
    Grey,
    /// The lanes of a mosaic cell: the index of the lane of red, of the two lanes of green, and of the lane of blue.
    Cell { red: usize, green: [usize; 2], blue: usize },
}

impl Lanes {
    /// Returns the lanes in which the front end accumulates `format`; `scale` is the energy per count of each channel.
    #[must_use]
    pub fn of(format: Format, scale: [f32; 3]) -> Self {
        let pick = match (format, format.pattern()) {
            (_, Some(pattern)) => {
                let channels = pattern.channels();
                let find = |c| channels.iter().position(|own| *own == c).unwrap_or(0);
                let second = channels.iter().rposition(|own| *own == 1).unwrap_or(0);
                Pick::Cell { red: find(0), green: [find(1), second], blue: find(2) }
            }
            (Format::Bgr24, _) => Pick::Swapped,
            (Format::Grey, _) => Pick::Grey,
            _ => Pick::Plain,
        };
        Self { pick, scale, tally: None }
    }

    pub(crate) fn with_tally(self, tally: Option<Tally>) -> Self {
        Self { tally, ..self }
    }

    /// Returns the sums of the light in `quad`, one per lane of the accumulator.
    #[inline]
    pub(crate) fn sums(&self, quad: &Quad) -> [f32; 4] {
        self.tally.as_ref().map_or(quad.energy, |tally| tally.settled(quad))
    }

    /// Returns counts of red, green and blue multiplied by the energy per count.
    #[inline]
    pub(crate) fn scaled(&self, rgb: [f32; 3]) -> [f32; 3] {
        core::array::from_fn(|c| rgb[c] * self.scale[c])
    }

    /// Converts the sum of each lane to red, green and blue energy.
    #[must_use]
    pub fn rgb(&self, sum: [f32; 4]) -> [f32; 3] {
        let at = |i: usize| sum[i & 3];
        self.scaled(match self.pick {
            Pick::Plain => [sum[0], sum[1], sum[2]],
            Pick::Swapped => [sum[2], sum[1], sum[0]],
            Pick::Grey => [sum[0]; 3],
            Pick::Cell { red, green: [a, b], blue } => [at(red), 0.5 * (at(a) + at(b)), at(blue)],
        })
    }
}
