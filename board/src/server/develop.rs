//! Camera frames as pictures to look at: eight bits, red, green and blue, whatever the packing.

use crate::calibration::{Calibration, Frame, Pixels};
use hemilux_core::Response;
use hemilux_core::format::{Format, Layout, Matrix, Pattern, Yuv};
use hemilux_core::tonemap::srgb_code;

/// The interleaved codes of `frame`; `None` if it is shorter than its layout says.
///
/// Codes of eight bits stay as they are; deeper ones are scaled, and linear ones given the sRGB curve. A mosaic's cells of two by two
/// are four equal pixels.
pub(super) fn develop(frame: &Frame, calibration: &Calibration) -> Option<Vec<u8>> {
    let layout = calibration.layout;
    let mut rgb = vec![0u8; 3 * layout.width() as usize * layout.height() as usize];
    let table = deep(calibration);
    match &frame.pixels {
        Pixels::U16(words) => {
            let row = layout.bytes_per_line() / 2;
            for (out, line) in rgb.chunks_mut(3 * layout.width() as usize).zip(words.chunks(row)) {
                out.iter_mut().zip(line).for_each(|(o, v)| *o = table[usize::from(*v)]);
            }
        }
        Pixels::U8(bytes) => {
            let bytes = bytes.get(..layout.frame_bytes())?;
            for y in 0..layout.height() as usize {
                let out = &mut rgb[3 * layout.width() as usize * y..][..3 * layout.width() as usize];
                row(&layout, bytes, y, &table, out.as_chunks_mut::<3>().0);
            }
        }
    }
    Some(rgb)
}

/// Code at and above which a developed sample is clipped.
pub(super) fn white(calibration: &Calibration) -> f64 {
    if calibration.layout.format().max_code() > 255 { 255.0 } else { calibration.levels.white }
}

/// Eight bits of each deeper code; empty for formats without.
fn deep(c: &Calibration) -> Vec<u8> {
    if c.layout.format().max_code() <= 255 {
        return Vec::new();
    }
    let is_linear = matches!(c.response, Response::Linear);
    let code = |v: u16| {
        let x = ((f64::from(v) - c.levels.black) / (c.levels.white - c.levels.black)) as f32;
        if is_linear { srgb_code(x) } else { (255.0 * x.clamp(0.0, 1.0) + 0.5) as u8 }
    };
    (0..=u16::MAX).map(code).collect()
}

/// One row of a format of bytes.
fn row(layout: &Layout, bytes: &[u8], y: usize, table: &[u8], out: &mut [[u8; 3]]) {
    let stride = layout.bytes_per_line();
    let line = &bytes[stride * y..];
    let byte = |y: usize, x: usize| bytes.get(stride * y + x).copied().unwrap_or(0);
    let word = |y: usize, x: usize| u16::from(byte(y, x));
    match layout.format() {
        Format::Rgb24 => out.as_flattened_mut().iter_mut().zip(line).for_each(|(o, v)| *o = *v),
        Format::Bgr24 => {
            out.iter_mut().zip(line.as_chunks::<3>().0).for_each(|(o, [b, g, r])| *o = [*r, *g, *b]);
        }
        Format::Yuyv(yuv) => {
            for (two, [y0, u, y1, v]) in out.chunks_mut(2).zip(line.as_chunks::<4>().0) {
                two.iter_mut().zip([*y0, *y1]).for_each(|(o, y)| *o = rgb(yuv, y, *u, *v));
            }
        }
        Format::Nv12(yuv) => {
            let chroma = &bytes[stride * (layout.height() as usize + y / 2)..];
            for ((two, luma), [u, v]) in out.chunks_mut(2).zip(line.chunks(2)).zip(chroma.as_chunks::<2>().0)
            {
                two.iter_mut().zip(luma).for_each(|(o, y)| *o = rgb(yuv, *y, *u, *v));
            }
        }
        Format::Grey => out.iter_mut().zip(line).for_each(|(o, v)| *o = [*v; 3]),
        Format::Bayer8(pattern) => mosaic(pattern, y, out, byte),
        Format::Raw10(pattern) => mosaic(pattern, y, out, |y, x| {
            let low = word(y, x / 4 * 5 + 4) >> (2 * (x % 4));
            table[usize::from(word(y, x / 4 * 5 + x % 4) << 2 | low & 3)]
        }),
        Format::Raw12(pattern) => mosaic(pattern, y, out, |y, x| {
            let low = word(y, x / 2 * 3 + 2) >> (4 * (x % 2));
            table[usize::from(word(y, x / 2 * 3 + x % 2) << 4 | low & 15)]
        }),
        Format::Bayer16(pattern, _) => {
            mosaic(pattern, y, out, |y, x| table[usize::from(word(y, 2 * x) | word(y, 2 * x + 1) << 8)]);
        }
        // Words, not bytes.
        Format::Rgb48 => {}
    }
}

/// Red, the first green and blue of each cell.
fn mosaic(pattern: Pattern, y: usize, out: &mut [[u8; 3]], code: impl Fn(usize, usize) -> u8) {
    let channels = pattern.channels();
    let place = |channel| channels.iter().position(|c| *c == channel).unwrap_or(0);
    let places = [place(0), place(1), place(2)];
    for (x, pixel) in out.iter_mut().enumerate() {
        *pixel = places.map(|at| code((y & !1) + at / 2, (x & !1) + at % 2));
    }
}

/// Luma and chroma to red, green and blue, by ITU-R BT.601 or BT.709.
fn rgb(yuv: Yuv, y: u8, u: u8, v: u8) -> [u8; 3] {
    let (kr, kb) = if yuv.matrix == Matrix::Bt709 { (0.2126, 0.0722) } else { (0.299, 0.114) };
    let (black, luma, chroma) =
        if yuv.limited { (16.0, 255.0 / 219.0, 255.0 / 224.0) } else { (0.0, 1.0, 1.0) };
    let y: f32 = (f32::from(y) - black) * luma;
    let (u, v) = ((f32::from(u) - 128.0) * chroma, (f32::from(v) - 128.0) * chroma);
    let (red, blue) = (y + 2.0 * (1.0 - kr) * v, y + 2.0 * (1.0 - kb) * u);
    let green = (y - kr * red - kb * blue) / (1.0 - kr - kb);
    [red, green, blue].map(|c| (c + 0.5) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::{SceneSource, Source};
    use hemilux_core::Exposure;

    fn seen(format: Format, width: u32, height: u32, bytes: Vec<u8>) -> Option<Vec<u8>> {
        let scene = crate::scene::by_name("room").expect("a scene");
        let source = SceneSource::new(scene, crate::source::Pace::Free);
        let lens = source.calibration().lens;
        let calibration = Calibration::try_new(lens, format, width, height).expect("a layout");
        let exposure = Exposure { seconds: 0.01, gain: 1.0 };
        develop(&Frame { exposure, pixels: Pixels::U8(bytes) }, &calibration)
    }

    #[test]
    fn every_packing_becomes_red_green_and_blue() {
        let red = [200u8, 20, 30];
        assert_eq!(seen(Format::Rgb24, 1, 1, red.to_vec()), Some(red.to_vec()));
        assert_eq!(seen(Format::Bgr24, 1, 1, vec![30, 20, 200]), Some(red.to_vec()));
        assert_eq!(seen(Format::Grey, 2, 1, vec![7, 9]), Some(vec![7, 7, 7, 9, 9, 9]));
        let grey = Yuv { limited: true, ..Yuv::default() };
        assert_eq!(
            seen(Format::Yuyv(grey), 2, 1, vec![16, 128, 235, 128]),
            Some(vec![0, 0, 0, 255, 255, 255])
        );
        let plane = vec![235, 16, 16, 235, 128, 128];
        let expected = [255, 0, 0, 255].map(|v| [v; 3]).as_flattened().to_vec();
        assert_eq!(seen(Format::Nv12(grey), 2, 2, plane), Some(expected));
        let cell = seen(Format::Bayer8(Pattern::Bggr), 2, 2, vec![30, 20, 21, 200]);
        assert_eq!(cell, Some([red; 4].as_flattened().to_vec()));
        // Codes 1023, 0, 0, 0 in the red and green row, all 0 below.
        let raw =
            seen(Format::Raw10(Pattern::Rggb), 4, 2, vec![255, 0, 0, 0, 3, 0, 0, 0, 0, 0]).expect("whole");
        assert_eq!((&raw[..3], &raw[9..12]), (&[255, 0, 0][..], &[0, 0, 0][..]));
        let wide = seen(Format::Bayer16(Pattern::Rggb, 12), 2, 2, vec![255, 15, 0, 0, 0, 0, 255, 15]);
        assert_eq!(wide, Some([[255, 0, 255]; 4].as_flattened().to_vec()));
        assert_eq!(seen(Format::Rgb24, 2, 2, vec![0; 11]), None, "a short frame");
    }
}
