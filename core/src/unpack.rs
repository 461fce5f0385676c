//! Reads single pixels and rows of packed frames: for pictures of frames and brightness statistics.

use crate::format::{Format, Layout, raw10, raw12};
use crate::front::rows::{Part, Reader, Scratch};
use crate::merge::{Codes, MAX_EXPOSURES, Samples};
use crate::pixel_table::CHUNK;

/// Reads the brightness of the pixel at column `x` and row `y` as a relative code: 0 is black, 1 is white; codes beyond the limited range
/// of luma give values below 0 or above 1. The brightness is luma, the green channel or, in a mosaic, the pixel's own sample. Returns 0
/// outside of the frame.
///
/// ```
/// use hemilux_core::format::{Format, Layout, Pattern};
/// use hemilux_core::{Samples, read_luma};
///
/// let layout = Layout::tight(Format::Raw10(Pattern::Rggb), 4, 2)?;
/// // Pixels 0x3ff, 0x001, 0x200, 0x102: the upper eight bits of each, then two low bits each.
/// let row = [0xff, 0x00, 0x80, 0x40, 0b10_00_01_11];
/// let frame = [row, row].concat();
/// assert_eq!(read_luma(&layout, Samples::U8(&frame), 0, 1), 1.0);
/// assert_eq!(read_luma(&layout, Samples::U8(&frame), 2, 1), 512.0 / 1023.0);
/// # Ok::<(), hemilux_core::LayoutError>(())
/// ```
#[must_use]
pub fn read_luma(layout: &Layout, frame: Samples<'_>, x: u32, y: u32) -> f32 {
    if x >= layout.width() || y >= layout.height() {
        return 0.0;
    }
    let (x, format) = (x as usize, layout.format());
    let code = match frame {
        Samples::U8(bytes) => {
            let line = (y as usize).saturating_mul(layout.bytes_per_line());
            code_of_byte_row(format, bytes.get(line..).unwrap_or_default(), x)
        }
        Samples::U16(words) => {
            let at = (y as usize).saturating_mul(layout.bytes_per_line() / 2).saturating_add(3 * x + 1);
            words.get(at).copied().unwrap_or(0)
        }
    };
    match format {
        Format::Yuyv(yuv) | Format::Nv12(yuv) if yuv.limited => (f32::from(code) - 16.0) / 219.0,
        _ => f32::from(code) / format.max_code() as f32,
    }
}

/// Returns the luma, the green code or the mosaic's sample of pixel `x` of a row of bytes; 0 beyond the end.
fn code_of_byte_row(format: Format, row: &[u8], x: usize) -> u16 {
    let byte = |at: usize| u16::from(row.get(at).copied().unwrap_or(0));
    match format {
        Format::Grey | Format::Bayer8(_) | Format::Nv12(_) => byte(x),
        Format::Yuyv(_) => byte(2 * x),
        Format::Rgb24 | Format::Bgr24 => byte(3 * x + 1),
        Format::Raw10(_) => row.as_chunks().0.get(x / 4).map_or(0, |group| raw10(group)[x % 4]),
        Format::Raw12(_) => row.as_chunks().0.get(x / 2).map_or(0, |group| raw12(group)[x % 2]),
        Format::Bayer16(..) => row.as_chunks().0.get(x).map_or(0, |word| u16::from_le_bytes(*word)),
        // The samples of this format are words.
        Format::Rgb48 => 0,
    }
}

/// Reads the red, green and blue codes of row `y` into `out`, up to the end of the row or of `out`. Luma and chroma are converted as in the
/// front end; the four pixels of a mosaic cell get the codes of its red, its first green and its blue sample.
///
/// Elements of `out` beyond the frame are unchanged.
///
/// ```
/// use hemilux_core::format::{Format, Layout};
/// use hemilux_core::read_rgb_row;
///
/// let layout = Layout::tight(Format::Bgr24, 2, 1)?;
/// let mut row = [[0; 3]; 2];
/// read_rgb_row(&layout, [10u8, 20, 30, 1, 2, 3].as_slice().into(), 0, &mut row);
/// assert_eq!(row, [[30, 20, 10], [3, 2, 1]]);
/// # Ok::<(), hemilux_core::LayoutError>(())
/// ```
pub fn read_rgb_row(layout: &Layout, frame: Samples<'_>, y: u32, out: &mut [[u16; 3]]) {
    let is_words = layout.format() == Format::Rgb48;
    if y >= layout.height() || matches!(frame, Samples::U16(_)) != is_words {
        return;
    }
    let Ok(layout) = &layout.binned(1) else { return };
    Scratch::with(layout.format(), false, |scratch| read_chunks(layout, frame, y as usize, out, scratch));
}

/// A [`Reader`] of all frames, with interleaved channels.
struct Interleaved;

impl Reader for Interleaved {
    fn wants_planes(&self) -> bool {
        false
    }

    fn suffices(&self, _: usize, _: &Codes<'_>) -> bool {
        false
    }
}

/// Reads row `y` in chunks of at most [`CHUNK`] pixels or mosaic cells.
fn read_chunks(
    layout: &Layout,
    frame: Samples<'_>,
    y: usize,
    out: &mut [[u16; 3]],
    mut scratch: Scratch<'_>,
) {
    let pattern = layout.format().pattern();
    let cell = if pattern.is_some() { 2 } else { 1 };
    let width = (layout.width() as usize).min(out.len());
    let pixels = out.get_mut(..width).unwrap_or_default();
    for (i, pixels) in pixels.chunks_mut(cell * CHUNK).enumerate() {
        let part = Part { row: y / cell, first: CHUNK * i, len: pixels.len().div_ceil(cell) };
        let mut codes = [Codes::NONE; MAX_EXPOSURES];
        let codes = scratch.codes(&[frame], layout, part, &Interleaved, &mut codes);
        let Some(codes) = codes.first() else { return };
        spread(layout.format(), codes, cell, pixels);
    }
}

/// Writes the red, green and blue codes of each pixel; a pixel or mosaic cell covers `cell` columns.
fn spread(format: Format, codes: &Codes<'_>, cell: usize, pixels: &mut [[u16; 3]]) {
    let channels = format.pattern().map(|pattern| pattern.channels());
    // The array has the positions of red, the first green and blue in the samples of a pixel or cell.
    let samples = match (format, channels) {
        (_, Some(channels)) => [0, 1, 2].map(|c| channels.iter().position(|own| *own == c).unwrap_or(0)),
        (Format::Bgr24, _) => [2, 1, 0],
        (Format::Grey, _) => [0; 3],
        _ => [0, 1, 2],
    };
    let many = match (format, channels) {
        (_, Some(_)) => 4,
        (Format::Grey, _) => 1,
        _ => 3,
    };
    for (x, pixel) in pixels.iter_mut().enumerate() {
        let place = many * (x / cell);
        for (value, sample) in pixel.iter_mut().zip(samples) {
            if let Some(code) = codes.get(place + sample) {
                *value = code;
            }
        }
    }
}
