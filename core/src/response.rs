//! Conversion of sensor codes to relative exposure: black and white level, and the response of the camera.
//!
//! ```
//! use hemilux_core::response::{CURVE_BITS, Curve, curve_len};
//! use hemilux_core::{Depth, Levels, Response};
//!
//! let levels = Levels { black: 16.0, white: 255.0 };
//! let curve = Curve::try_new(&Response::Srgb, Depth::U8, levels, vec![0; curve_len(Depth::U8)])?;
//! assert_eq!(curve.exposure_q27(0, 16), 0);
//! assert_eq!(curve.exposure_q27(0, 255), 1 << CURVE_BITS);
//! assert!(curve.is_saturated(252) && !curve.is_trusted(20));
//! # Ok::<(), hemilux_core::ResponseError>(())
//! ```

use crate::buffer::{self, Buffer, TooSmall};

/// Number of fraction bits of a tabulated relative exposure: 1.0 is `1 << CURVE_BITS`.
///
/// The sum of twelve values up to 1.05 fits an `i32`: 12 * 1.05 * 2^27 < 2^31.
pub const CURVE_BITS: u32 = 27;

/// Relative code (0 at black, 1 at white) at and above which a sample counts as saturated.
///
/// Sensors are non-linear just below their largest code, and demosaicing or compression spreads clipped values. A higher limit admits
/// partly clipped samples, which darken lamps; a lower limit wastes range.
pub const SATURATED: f64 = 0.98;

/// Relative code below which a sample of a non-linear response is used only if no longer exposure is valid.
///
/// Below this code, the response is fitted to few codes of quantised, noisy data, and its constant term can exceed the true exposure. A
/// lower limit makes dark regions too bright; a higher limit discards useful samples.
pub const TRUSTED: f64 = 16.0 / 255.0;

/// The limit [`SATURATED`] for codes that were compressed with loss: ringing of JPEG spreads clipped values by some 4 % at quality 85.
pub const SATURATED_COMPRESSED: f64 = 0.95;

/// The limit [`TRUSTED`] for codes that were compressed with loss: below it, a step of the quantisation exceeds a tenth of the code.
pub const TRUSTED_COMPRESSED: f64 = 28.0 / 255.0;

/// The codes of relative exposure 0 (black) and 1 (white).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Levels {
    /// Sensor code of darkness, relative exposure 0; fractions are permitted.
    pub black: f64,
    /// Sensor code of full scale, relative exposure 1; fractions are permitted.
    pub white: f64,
}

/// The inverse response of a camera: relative exposure y in 0..=1 as a function y(x) of the relative code x in 0..=1.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Response {
    /// Linear response: y = x.
    Linear,
    /// The transfer function of IEC 61966-2-1.
    Srgb,
    /// Relative exposure y = c4 x^4 + c3 x^3 + c2 x^2 + c1 x + c0 of red, green and blue at the relative code x, 0 to 1, highest power first.
    Polynomial([[f64; 5]; 3]),
    /// Relative exposure y = sum of c_i B_i(x) of red, green and blue at the relative code x, 0 to 1, with the Bernstein polynomials B_0..=B_8 of
    /// degree 8: monotone if the coefficients ascend.
    Bernstein([[f64; 9]; 3]),
}

impl Response {
    /// Returns the relative exposure of channel `channel` (0 red, 1 green, 2 blue) at relative code `x`.
    ///
    /// A linear response is negative below black, limited to -1: noise around black keeps its mean, and the sum of twelve frames fits an `i32`.
    #[must_use]
    pub fn exposure(&self, channel: usize, x: f64) -> f64 {
        let x = x.min(1.0);
        match self {
            Self::Linear => x.max(-1.0),
            Self::Srgb if x <= 0.040_45 => x.max(0.0) / 12.92,
            Self::Srgb => libm::pow((x + 0.055) / 1.055, 2.4),
            Self::Bernstein(c) => bernstein(&c[channel % 3], x.max(0.0)),
            Self::Polynomial(c) => c[channel % 3].iter().fold(0.0, |sum, k| sum * x.max(0.0) + k).max(0.0),
        }
    }
}

/// Returns the value at `x` of the polynomial with the Bernstein coefficients `coefficients`, by de Casteljau's algorithm.
fn bernstein(coefficients: &[f64; 9], x: f64) -> f64 {
    let mut c = *coefficients;
    for used in (1..c.len()).rev() {
        for i in 0..used {
            if let [low, high, ..] = c[i..] {
                c[i] = low + (high - low) * x;
            }
        }
    }
    c[0]
}

/// The reason why a response cannot be tabulated.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum ResponseError {
    /// The white level is not above the black level, or the codes exceed the sample type.
    BadLevels,
    /// Between black and white the curve is not finite, decreases, or leaves 0..1.05.
    BadCurve {
        /// Index of the channel: 0 red, 1 green, 2 blue.
        channel: usize,
    },
    /// A lent buffer has too few elements.
    TooSmall(TooSmall),
}

impl core::fmt::Display for ResponseError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::BadLevels => write!(f, "a white level that is not above black or does not fit the samples"),
            Self::BadCurve { channel } => {
                let name = ["red", "green", "blue"][channel % 3];
                write!(f, "a {name} response that does not rise from 0 to about 1 between black and white")
            }
            Self::TooSmall(e) => e.fmt(f),
        }
    }
}

impl core::error::Error for ResponseError {}

/// Number of bits of an unpacked sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Depth {
    /// The samples of the table have 8 bits.
    U8,
    /// The samples of the table have 16 bits.
    U16,
}

impl Depth {
    /// Returns the largest code of a sample of this depth.
    #[must_use]
    pub const fn max(self) -> u32 {
        match self {
            Self::U8 => u8::MAX as u32,
            Self::U16 => u16::MAX as u32,
        }
    }

    /// Returns the number of table entries per channel of a curve: one per code of up to 12 bits, plus one for interpolation.
    const fn entries(self) -> usize {
        match self {
            Self::U8 => 257,
            Self::U16 => 4097,
        }
    }
}

/// The tabulated relative exposure of every code, for three channels, in a lent buffer; `B` is `()` for a curve without its table.
#[derive(Clone, Copy, Debug)]
pub struct Curve<B> {
    table: B,
    depth: Depth,
    /// Right shift from a code to its table entry: 0 for codes of up to 12 bits; finer codes are interpolated.
    shift: u32,
    /// Smallest sample code that counts as saturated.
    saturated: u32,
    /// Smallest sample code that counts as trusted.
    trusted: u32,
    /// The codes at which relative exposure is 0 (black) and 1 (white).
    levels: Levels,
    linear: bool,
}

/// Returns the number of elements of the buffer of [`Curve::try_new`] for samples of `depth`.
#[must_use]
pub const fn curve_len(depth: Depth) -> usize {
    3 * depth.entries()
}

impl Curve<()> {
    /// Computes the constants of the curve for `response`, without its table.
    ///
    /// # Errors
    /// [`ResponseError::BadLevels`] for levels that do not ascend or exceed the samples.
    pub(crate) fn untabulated(
        response: &Response,
        depth: Depth,
        levels: Levels,
    ) -> Result<Self, ResponseError> {
        let Levels { black, white } = levels;
        let range = white - black;
        if !(black >= 0.0 && range > 0.0 && white <= f64::from(depth.max())) {
            return Err(ResponseError::BadLevels);
        }
        let shift = (32 - (white as u32).leading_zeros()).saturating_sub(12);
        let linear = matches!(response, Response::Linear);
        let trusted = if linear { 0 } else { levels.code(TRUSTED) };
        let saturated = levels.code(SATURATED);
        Ok(Self { table: (), depth, shift, saturated, trusted, levels, linear })
    }
}

impl Levels {
    /// Returns the smallest code whose relative code is `x` or more.
    fn code(&self, x: f64) -> u32 {
        libm::ceil(self.black + x * (self.white - self.black)) as u32
    }
}

impl<B: Buffer<i32>> Curve<B> {
    /// Tabulates `response` between the `levels` into `table`, which needs [`curve_len`] elements.
    ///
    /// # Accuracy
    /// Entries are rounded to 2^-27. If white is above 4095, codes are interpolated linearly between 2048 to 4096 entries, within 3e-5 of
    /// a smooth curve from a sixteenth of white to saturation (`every_code_is_within_its_documented_error`).
    ///
    /// # Errors
    /// [`ResponseError`] for invalid levels, a curve that is not monotone, and a table with too few elements.
    pub fn try_new(
        response: &Response,
        depth: Depth,
        levels: Levels,
        mut table: B,
    ) -> Result<Self, ResponseError> {
        let curve = Curve::untabulated(response, depth, levels)?;
        buffer::check(&table, curve_len(depth)).map_err(ResponseError::TooSmall)?;
        let x = |i: usize| {
            let code = f64::from((i as u32) << curve.shift);
            (code - levels.black) / (levels.white - levels.black)
        };
        for (channel, row) in table.as_mut().chunks_exact_mut(depth.entries()).take(3).enumerate() {
            fill_row(response, channel, row, x).ok_or(ResponseError::BadCurve { channel })?;
        }
        Ok(curve.over(table))
    }
}

impl<B: AsRef<[i32]>> Curve<B> {
    /// Returns the curve with its table borrowed.
    #[must_use]
    pub fn view(&self) -> Curve<&[i32]> {
        self.over(self.table.as_ref())
    }

    /// Returns the relative exposure of `code` in channel `channel`, with [`CURVE_BITS`] fraction bits; codes above white count as white.
    #[must_use]
    pub fn exposure_q27(&self, channel: usize, code: u32) -> i32 {
        let entries = self.depth.entries();
        let at = channel.min(2) * entries + ((code >> self.shift) as usize).min(entries - 2);
        let Some(&[low, high]) = self.table.as_ref().get(at..at + 2) else { return 0 };
        if self.shift == 0 {
            return low;
        }
        let part = code & ((1 << self.shift) - 1);
        low + ((i64::from(high - low) * i64::from(part)) >> self.shift) as i32
    }
}

impl<B> Curve<B> {
    /// Returns the curve with its table replaced by `table`.
    pub(crate) fn over<T>(&self, table: T) -> Curve<T> {
        let Self { depth, shift, saturated, trusted, levels, linear, .. } = *self;
        Curve { table, depth, shift, saturated, trusted, levels, linear }
    }

    /// Returns this curve for codes that were compressed with loss: its limits of saturated and trusted codes are narrower.
    pub(crate) fn compressed(self) -> Self {
        let trusted = if self.linear { 0 } else { self.levels.code(TRUSTED_COMPRESSED) };
        Self { trusted, saturated: self.levels.code(SATURATED_COMPRESSED), ..self }
    }

    /// Returns this curve without saturated codes, for a merge in which saturation is found separately.
    pub(crate) fn unsaturated(self) -> Self {
        Self { saturated: u32::MAX, ..self }
    }

    /// Returns whether `code` is saturated: at least [`SATURATED`] of the range from black to white.
    #[must_use]
    pub fn is_saturated(&self, code: u32) -> bool {
        code >= self.saturated
    }

    /// Returns whether `code` is trusted: at least [`TRUSTED`] of the range from black to white. Every code of a linear response is trusted,
    /// since discarding dark samples would bias the mean.
    #[must_use]
    pub fn is_trusted(&self, code: u32) -> bool {
        code >= self.trusted
    }

    /// Returns the curve marked for table lookup even if it is linear: for codes that are stored as planes.
    #[must_use]
    pub fn looked_up(self) -> Self {
        Self { linear: false, ..self }
    }

    /// Returns the smallest code that counts as saturated.
    #[must_use]
    pub fn saturated(&self) -> u32 {
        self.saturated
    }

    /// Returns the table of relative exposures of the curve.
    pub(crate) fn into_table(self) -> B {
        self.table
    }

    /// Returns the smallest code that counts as trusted.
    pub(crate) fn trusted(&self) -> u32 {
        self.trusted
    }

    /// Returns the black and white level of a linear response; `None` for any other response.
    #[must_use]
    pub fn linear_levels(&self) -> Option<Levels> {
        self.linear.then_some(self.levels)
    }

    /// Returns the depth of the samples whose codes the curve converts.
    #[must_use]
    pub fn depth(&self) -> Depth {
        self.depth
    }
}

/// Tabulates `response` for one channel in `row`; returns `None` if the response is not finite, decreases or leaves 0..1.05.
fn fill_row(response: &Response, channel: usize, row: &mut [i32], x: impl Fn(usize) -> f64) -> Option<()> {
    let mut last = f64::NEG_INFINITY;
    for (i, entry) in row.iter_mut().enumerate() {
        let y = response.exposure(channel, x(i));
        if !y.is_finite() || y < last - 1e-6 || y > 1.05 {
            return None;
        }
        last = y;
        *entry = libm::round(y * f64::from(1u32 << CURVE_BITS)) as i32;
    }
    (last > 0.1).then_some(())
}
