//! HDR merge of a burst by sums: radiance = sum(y_i / gain_i) / sum(t_i) over the valid exposures of each channel.
//!
//! For a linear sensor this is the photon-noise-optimal mean: the weight of an exposure is its time. A sample is valid when it is
//! neither saturated nor (non-linear responses only) below the trust of its table. Without a valid sample the longest unsaturated
//! exposure decides; where even the shortest saturates, its own value stands as a lower bound and the pixel counts as clipped.
//!
//! Three loops do the work: [`linear`] for linear sensors, [`table`] for every other one of 8 bits, and a plain one for the rest and
//! for what is rare in the others' samples.

mod exposure;
mod linear;
mod table;

use crate::arena::{self, Buffer};
use crate::response::{CURVE_BITS, Curve, Depth};
use exposure::check;
pub use exposure::{Exposure, MAX_EXPOSURES, MergeError};
use linear::{Code, Linear};

/// One frame, packed as a [`crate::format::Layout`] says.
#[derive(Clone, Copy, Debug)]
pub enum Samples<'a> {
    /// The bytes of any format but [`crate::format::Format::Rgb48`].
    U8(&'a [u8]),
    /// The words of [`crate::format::Format::Rgb48`].
    U16(&'a [u16]),
}

impl Samples<'_> {
    /// Bytes or words.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::U8(s) => s.len(),
            Self::U16(s) => s.len(),
        }
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Codes of a part of a frame, one for each sample.
#[derive(Clone, Copy, Debug)]
pub enum Codes<'a> {
    /// As bytes.
    Bytes(&'a [u8]),
    /// As words.
    Words(&'a [u16]),
    /// Red, green and blue bytes, each on their own.
    Planes([&'a [u8]; 3]),
}

impl<'a> Codes<'a> {
    /// No codes.
    pub const NONE: Self = Self::Bytes(&[]);

    /// The code of sample `at`; 0 where there is none.
    fn code(&self, at: usize) -> u32 {
        match self {
            Self::Bytes(s) => s.get(at).copied().map_or(0, u32::from),
            Self::Words(s) => s.get(at).copied().map_or(0, u32::from),
            Self::Planes(s) => s[at % 3].get(at / 3).copied().map_or(0, u32::from),
        }
    }

    fn bytes(&self) -> Option<&'a [u8]> {
        if let Self::Bytes(s) = *self { Some(s) } else { None }
    }

    fn planes(&self) -> Option<[&'a [u8]; 3]> {
        if let Self::Planes(s) = *self { Some(s) } else { None }
    }

    fn words(&self) -> Option<&'a [u16]> {
        if let Self::Words(s) = *self { Some(s) } else { None }
    }
}

/// The channels (0 red, 1 green, 2 blue) of a run of samples, over and over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channels {
    /// All of one.
    One([usize; 1]),
    /// Two in turn: a row of a mosaic.
    Two([usize; 2]),
    /// Three in turn.
    Three([usize; 3]),
}

impl Channels {
    /// Red, green, blue.
    pub const RGB: Self = Self::Three([0, 1, 2]);

    fn of(&self, at: usize) -> usize {
        match self {
            Self::One([c]) => *c,
            Self::Two(c) => c[at % 2],
            Self::Three(c) => c[at % 3],
        }
    }
}

/// What a sum of light is worth: light x factor - offset.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reciprocal {
    factor: f32,
    offset: f32,
}

/// Which loop merges.
#[derive(Clone, Copy, Debug)]
enum Way {
    Linear(Linear),
    Table(table::Scale),
    Plain,
}

/// The merge of bursts with one response and one set of exposures.
#[derive(Clone, Debug)]
pub struct Merge<C, P, R> {
    curve: Curve<C>,
    tables: P,
    reciprocals: R,
    own: Own,
}

/// What needs no buffer.
#[derive(Clone, Copy, Debug)]
struct Own {
    way: Way,
    /// 1 / gain of each exposure, 2^-[`GAIN_BITS`].
    inverse_gain: [u32; MAX_EXPOSURES],
    /// Reciprocals are for light of this many counts of [`Curve::exposure_q27`].
    plain: f32,
    count: usize,
    unit: f64,
}

/// A merge that a frame runs through.
#[derive(Clone, Copy, Debug)]
pub struct MergeView<'a> {
    curve: Curve<&'a [i32]>,
    tables: &'a [u32],
    /// Indexed by the mask of valid exposures.
    reciprocals: &'a [Reciprocal],
    own: Own,
}

/// Elements that a merge needs of each buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MergeSize {
    /// Entries of the tables.
    pub tables: usize,
    /// Reciprocals.
    pub reciprocals: usize,
}

/// Counts what [`Merge::try_new`] needs.
///
/// # Errors
/// [`MergeError`].
pub fn merge_size<C: Buffer<i32>>(curve: &Curve<C>, exposures: &[Exposure]) -> Result<MergeSize, MergeError> {
    check(exposures)?;
    let needs_tables = curve.depth() == Depth::U8 && linear(curve, exposures).is_none();
    let tables = if needs_tables { exposures.len() * table::ENTRIES } else { 0 };
    Ok(MergeSize { tables, reciprocals: 1 << exposures.len() })
}

fn linear<C: Buffer<i32>>(curve: &Curve<C>, exposures: &[Exposure]) -> Option<Linear> {
    Linear::find(exposures, curve.linear_levels()?, curve.saturated())
}

const GAIN_BITS: u32 = 30;

impl<C: Buffer<i32>, P: Buffer<u32>, R: Buffer<Reciprocal>> Merge<C, P, R> {
    /// Prepares the merge of `exposures`, which ascend by time x gain; `scale` is the radiance of relative exposure 1 at one
    /// second and gain 1. The buffers hold what [`merge_size`] says.
    ///
    /// # Errors
    /// [`MergeError`].
    pub fn try_new(
        curve: Curve<C>,
        exposures: &[Exposure],
        scale: f64,
        (mut tables, mut reciprocals): (P, R),
    ) -> Result<Self, MergeError> {
        let size = merge_size(&curve, exposures)?;
        if !(scale > 0.0 && scale.is_finite()) {
            return Err(MergeError::BadScale);
        }
        arena::check(&tables, size.tables).map_err(MergeError::TooSmall)?;
        arena::check(&reciprocals, size.reciprocals).map_err(MergeError::TooSmall)?;
        let least = |f: fn(&Exposure) -> f64| exposures.iter().map(f).fold(f64::INFINITY, f64::min);
        let (shortest, least_gain) = (least(|e| e.seconds), least(|e| e.gain));
        let way = match linear(&curve, exposures) {
            Some(linear) => Way::Linear(linear),
            None if size.tables > 0 => {
                Way::Table(table::fill(&mut tables.as_mut()[..size.tables], &curve, exposures))
            }
            None => Way::Plain,
        };
        let plain_one = f64::from(1u32 << CURVE_BITS);
        // Counts of relative exposure 1 in the tables, and by how much those are raised.
        let (one, raised) = match &way {
            Way::Table(scale) => (scale.one, scale.raised),
            _ => (plain_one, 0.0),
        };
        // Radiance of one count, seconds of the shortest exposure.
        let unit = scale / (least_gain * shortest)
            * match (&way, curve.linear_levels()) {
                (Way::Linear(l), Some((black, white))) => 1.0 / (l.counts_per_code() * (white - black)),
                _ => 1.0 / f64::from(1u32 << 20),
            };
        for (mask, r) in reciprocals.as_mut().iter_mut().enumerate().take(size.reciprocals) {
            let used = || exposures.iter().enumerate().filter(|(i, _)| mask >> i & 1 == 1);
            let seconds: f64 = used().map(|(_, e)| e.seconds).sum();
            let factor = scale / (least_gain * seconds) / unit / one;
            let lifted: f64 = used().map(|(_, e)| least_gain / e.gain * raised * one).sum();
            *r = if mask == 0 {
                Reciprocal { factor: f32::NAN, offset: 0.0 }
            } else {
                Reciprocal { factor: factor as f32, offset: (lifted * factor) as f32 }
            };
        }
        let mut inverse_gain = [0; MAX_EXPOSURES];
        for (q, e) in inverse_gain.iter_mut().zip(exposures) {
            *q = libm::round(least_gain / e.gain * f64::from(1u32 << GAIN_BITS)) as u32;
        }
        let plain = (one / plain_one) as f32;
        let own = Own { way, inverse_gain, plain, count: exposures.len(), unit };
        Ok(Self { curve, tables, reciprocals, own })
    }

    /// What a frame runs through.
    #[must_use]
    pub fn view(&self) -> MergeView<'_> {
        MergeView {
            curve: self.curve.view(),
            tables: self.tables.as_ref(),
            reciprocals: self.reciprocals.as_ref(),
            own: self.own,
        }
    }

    /// Radiance of one count.
    #[must_use]
    pub fn unit(&self) -> f64 {
        self.own.unit
    }

    /// Depth of the samples it reads.
    #[must_use]
    pub fn depth(&self) -> Depth {
        self.curve.depth()
    }

    /// Exposures of a burst.
    #[must_use]
    pub fn exposures(&self) -> usize {
        self.own.count
    }

    /// Elements of its buffers.
    #[must_use]
    pub fn size(&self) -> MergeSize {
        let tables = if let Way::Table(_) = self.own.way { self.own.count * table::ENTRIES } else { 0 };
        MergeSize { tables, reciprocals: 1 << self.own.count }
    }
}

impl MergeView<'_> {
    /// Radiance of one count.
    #[must_use]
    pub fn unit(&self) -> f64 {
        self.own.unit
    }

    /// Most counts of any sample.
    #[must_use]
    pub fn most(&self) -> f64 {
        // What the longest time would make of full scale in the shortest exposure, twice over.
        match self.own.way {
            Way::Linear(_) => f64::from(1u32 << 31),
            _ => f64::from(1u32 << 22),
        }
    }

    /// Depth of the samples it reads.
    #[must_use]
    pub fn depth(&self) -> Depth {
        self.curve.depth()
    }

    /// Exposures of a burst.
    #[must_use]
    pub fn exposures(&self) -> usize {
        self.own.count
    }

    /// Merges samples whose channels are `channels` over and over into `out`, in counts of [`Merge::unit`]; noise round black may
    /// be negative. `codes` are the same samples in each exposure. Says whether any sample may be clipped.
    ///
    /// Samples that a frame does not have are dark.
    ///
    /// # Accuracy
    /// Within 0.1 % RMS of an `f64` merge with the same weights over seven decades (`tests/merge_twin`).
    pub fn samples(&self, codes: &[Codes<'_>], channels: Channels, out: &mut [f32]) -> bool {
        // The tables leave a mark where no exposure is valid; the other loops' answers are all in doubt or there are none.
        let (unusual, all) = match &self.own.way {
            Way::Linear(linear) => (self.linear(linear, codes, out), true),
            Way::Table(scale) => {
                let merged = match channels {
                    Channels::One(c) => self.by_table(scale, codes, c, out),
                    Channels::Two(c) => self.by_table(scale, codes, c, out),
                    Channels::Three(c) => self.by_table(scale, codes, c, out),
                };
                (merged.unwrap_or(true), merged.is_none())
            }
            Way::Plain => (true, true),
        };
        if unusual {
            for (at, value) in out.iter_mut().enumerate().filter(|(_, v)| all || v.is_nan()) {
                *value = self.sample(codes, channels.of(at), at);
            }
        }
        unusual
    }

    /// Whether sample `at` is saturated in every exposure.
    #[must_use]
    pub fn is_clipped(&self, codes: &[Codes<'_>], at: usize) -> bool {
        codes.iter().take(self.own.count).all(|c| self.curve.is_saturated(c.code(at)))
    }

    fn linear(&self, linear: &Linear, codes: &[Codes<'_>], out: &mut [f32]) -> bool {
        match codes.first() {
            Some(Codes::Bytes(_)) => unrolled(linear, codes, Codes::bytes, out),
            Some(Codes::Words(_)) => unrolled(linear, codes, Codes::words, out),
            _ => true,
        }
    }

    fn by_table<const K: usize>(
        &self,
        scale: &table::Scale,
        codes: &[Codes<'_>],
        channels: [usize; K],
        out: &mut [f32],
    ) -> Option<bool> {
        match self.own.count {
            1 => self.table::<1, K>(scale, codes, channels, out),
            2 => self.table::<2, K>(scale, codes, channels, out),
            3 => self.table::<3, K>(scale, codes, channels, out),
            4 => self.table::<4, K>(scale, codes, channels, out),
            5..=8 => self.table::<8, K>(scale, codes, channels, out),
            _ => self.table::<MAX_EXPOSURES, K>(scale, codes, channels, out),
        }
    }

    fn table<const N: usize, const K: usize>(
        &self,
        scale: &table::Scale,
        codes: &[Codes<'_>],
        channels: [usize; K],
        out: &mut [f32],
    ) -> Option<bool> {
        let (entries, _) = self.tables.as_chunks::<256>();
        let (tables, _) = entries.as_chunks::<3>();
        let used = |i: &usize| *i < self.own.count;
        // What there is not adds nothing.
        let table = |i| Some(i).filter(used).and_then(|i| tables.get(i)).unwrap_or(&table::NOTHING);
        let table = table::Table { tables: core::array::from_fn(table), channels, scale };
        // Nor does it matter what is looked up there.
        let code = |i: usize| codes.get(if used(&i) { i } else { 0 }).copied().unwrap_or(Codes::NONE);
        let codes: [Codes<'_>; N] = core::array::from_fn(code);
        let reciprocals = self.reciprocals;
        if let Some(bytes) = all(&codes, Codes::bytes) {
            return table.interleaved(bytes, reciprocals, out);
        }
        all(&codes, Codes::planes).and_then(|planes| table.planes(planes, reciprocals, out))
    }

    /// Radiance of one sample by the rules themselves.
    fn sample(&self, codes: &[Codes<'_>], channel: usize, at: usize) -> f32 {
        let (mut sum, mut valid, mut longest) = (0i32, 0usize, None);
        for (i, samples) in codes.iter().enumerate().take(self.own.count) {
            let code = samples.code(at);
            if self.curve.is_saturated(code) {
                continue;
            }
            let y = self.exposure(channel, code, i);
            longest = Some((i, y));
            if self.curve.is_trusted(code) {
                sum += y;
                valid |= 1 << i;
            }
        }
        if valid != 0 {
            return self.radiance(sum, valid);
        }
        if let Some((i, y)) = longest {
            return self.radiance(y, 1 << i);
        }
        self.radiance(codes.first().map_or(0, |c| self.exposure(channel, c.code(at), 0)), 1)
    }

    /// y / gain of `code` in exposure `i`, 2^-27.
    fn exposure(&self, channel: usize, code: u32, i: usize) -> i32 {
        let y = i64::from(self.curve.exposure_q27(channel, code));
        ((y * i64::from(self.own.inverse_gain.get(i).copied().unwrap_or(0))) >> GAIN_BITS) as i32
    }

    fn radiance(&self, sum: i32, mask: usize) -> f32 {
        let factor = self.reciprocals.get(mask).map_or(0.0, |r| r.factor);
        sum as f32 * self.own.plain * factor
    }
}

/// What `of` makes of every element; none where it makes nothing of one.
fn all<'a, T: Copy + Default, const N: usize>(
    codes: &[Codes<'a>; N],
    of: impl Fn(&Codes<'a>) -> Option<T>,
) -> Option<[T; N]> {
    let mut found = [T::default(); N];
    for (slot, codes) in found.iter_mut().zip(codes) {
        *slot = of(codes)?;
    }
    Some(found)
}

/// Runs the loop of [`linear`] for as many exposures as there are.
fn unrolled<'a, T: Code + 'a>(
    linear: &Linear,
    codes: &[Codes<'a>],
    slice: impl Fn(&Codes<'a>) -> Option<&'a [T]>,
    out: &mut [f32],
) -> bool {
    let mut slices: [&[T]; linear::MAX_UNROLLED] = [&[]; _];
    for (slot, samples) in slices.iter_mut().zip(codes) {
        let Some(found) = slice(samples) else { return true };
        *slot = found;
    }
    let [a, b, c, d] = slices;
    match codes.len() {
        1 => linear.merge([a], out),
        2 => linear.merge([a, b], out),
        3 => linear.merge([a, b, c], out),
        4 => linear.merge([a, b, c, d], out),
        _ => true,
    }
}
