//! Scanlines of a Radiance picture: flat, run-length encoded as before 1991, or run-length encoded by component.

use super::super::limit::Budget;
use super::super::{Raster, Refusal};
use std::io::{BufRead, ErrorKind};

/// Lengths in texels of scanlines that may be encoded by component.
const BY_COMPONENT: std::ops::RangeInclusive<usize> = 8..=0x7fff;

/// Mantissas of red, green and blue, and their common exponent.
type Rgbe = [u8; 4];

/// One axis of a Radiance picture, in the order of storage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Axis {
    pub is_x: bool,
    /// True if X increases to the right, or Y upwards, along the axis.
    pub is_positive: bool,
    pub count: u32,
}

impl Axis {
    pub const DOWN: Self = Self { is_x: false, is_positive: false, count: 0 };
    pub const RIGHT: Self = Self { is_x: true, is_positive: true, count: 0 };

    /// Returns the column or row of the picture at the stored position `k`.
    fn place(self, k: usize) -> usize {
        if self.is_x == self.is_positive { k } else { self.count as usize - 1 - k }
    }
}

/// The order of texels: scanlines follow each other along `major`, their texels along `minor`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Resolution {
    pub major: Axis,
    pub minor: Axis,
}

impl Resolution {
    /// Decodes all scanlines of a picture. Scanlines that are columns are decoded as rows, and the raster is transposed at the end, so that
    /// memory is used for decoded scanlines alone.
    pub fn decode(&self, reader: &mut impl BufRead, budget: &Budget) -> Result<Raster, Refusal> {
        let mut raster = budget.raster(self.minor.count.into(), self.major.count.into())?;
        let mut line = Vec::new();
        for stored in 0..self.major.count as usize {
            decode_line(reader, self.minor.count as usize, &mut line)
                .map_err(|found| Refusal::new(format!("scanline {stored}: {found}"), "a whole scanline"))?;
            let row = raster.row_mut(self.major.place(stored));
            for (k, texel) in line.iter().enumerate() {
                row[self.minor.place(k)] = radiance(*texel);
            }
        }
        if self.major.is_x { transposed(&raster, budget) } else { Ok(raster) }
    }
}

/// Returns `from` with rows and columns exchanged.
fn transposed(from: &Raster, budget: &Budget) -> Result<Raster, Refusal> {
    let mut to = budget.raster(from.height as u64, from.width as u64)?;
    for y in 0..to.height {
        let column = from.texels.iter().skip(y).step_by(from.width);
        to.row_mut(y).iter_mut().zip(column).for_each(|(texel, value)| *texel = *value);
    }
    Ok(to)
}

/// Returns the radiance of a stored texel: mantissas times 2^(exponent - 136).
fn radiance([r, g, b, e]: Rgbe) -> [f32; 3] {
    // The factor is 2^119 for e = 255 and 2^-135 for e = 1: it is computed as a product of two powers that f32 can represent.
    let half = |n: i32| f32::from_bits(((127 + n) as u32) << 23);
    let n = i32::from(e) - 136;
    let (first, second) = (half(n / 2), half(n - n / 2));
    if e == 0 { [0.0; 3] } else { [r, g, b].map(|v| f32::from(v) * first * second) }
}

fn decode_line(reader: &mut impl BufRead, length: usize, line: &mut Vec<Rgbe>) -> Result<(), String> {
    line.clear();
    if !BY_COMPONENT.contains(&length) {
        return decode_flat(reader, length, None, line);
    }
    let first = texel(reader)?;
    let [2, 2, high @ 0..0x80, low] = first else {
        return decode_flat(reader, length, Some(first), line);
    };
    let stated = usize::from(u16::from_be_bytes([high, low]));
    if stated != length {
        return Err(format!("{stated} texels in a picture of {length} along this axis"));
    }
    line.resize(length, [0; 4]);
    (0..4).try_for_each(|component| decode_component(reader, component, line))
}

/// Decodes one component of a scanline, which consists of runs (128 + length, value) and literals (length, values).
fn decode_component(reader: &mut impl BufRead, component: usize, line: &mut [Rgbe]) -> Result<(), String> {
    let mut at = 0;
    while at < line.len() {
        let code = usize::from(byte(reader)?);
        let (count, run) = if code > 128 { (code - 128, Some(byte(reader)?)) } else { (code, None) };
        let texels = line.get_mut(at..at + count).ok_or("a run beyond the end of the scanline")?;
        for texel in texels {
            texel[component] = run.map_or_else(|| byte(reader), Ok)?;
        }
        at += count;
    }
    Ok(())
}

/// Decodes the texels of a scanline one by one; (1, 1, 1, n) repeats the preceding texel n times, and successive repeats are digits of base
/// 256.
fn decode_flat(
    reader: &mut impl BufRead,
    length: usize,
    mut first: Option<Rgbe>,
    line: &mut Vec<Rgbe>,
) -> Result<(), String> {
    let mut shift = 0;
    while line.len() < length {
        let next = first.take().map_or_else(|| texel(reader), Ok)?;
        let [1, 1, 1, n] = next else {
            line.push(next);
            shift = 0;
            continue;
        };
        let last = *line.last().ok_or("a repetition without a texel before it")?;
        let count = if shift < 32 { usize::from(n) << shift } else { 0 };
        if count > length - line.len() {
            return Err("a repetition beyond the end of the scanline".into());
        }
        line.resize(line.len() + count, last);
        shift += 8;
    }
    Ok(())
}

fn texel(reader: &mut impl BufRead) -> Result<Rgbe, String> {
    let mut texel = [0; 4];
    reader.read_exact(&mut texel).map_err(|e| told(&e))?;
    Ok(texel)
}

fn byte(reader: &mut impl BufRead) -> Result<u8, String> {
    let mut byte = [0; 1];
    reader.read_exact(&mut byte).map_err(|e| told(&e))?;
    Ok(byte[0])
}

fn told(e: &std::io::Error) -> String {
    if e.kind() == ErrorKind::UnexpectedEof { "the end of the file".into() } else { e.to_string() }
}
