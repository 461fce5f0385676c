//! Conversion of camera frames of every pixel format to pictures of 8-bit red, green and blue.

use crate::calibration::{Calibration, Frame};
use hemilux_core::tonemap::srgb_code;
use hemilux_core::{Response, read_rgb_row};

/// Returns the red, green and blue codes of `frame`, interleaved; `None` if the frame is shorter than its layout.
///
/// Codes of eight bits are unchanged. Deeper codes are scaled to eight bits; linear ones get the sRGB curve. A Bayer cell of two by two samples
/// becomes four equal pixels.
pub(super) fn develop(frame: &Frame, calibration: &Calibration) -> Option<Vec<u8>> {
    let layout = calibration.layout;
    let mut rgb = vec![0u8; 3 * layout.width() as usize * layout.height() as usize];
    if frame.pixels.samples().len() < layout.frame_samples() {
        return None;
    }
    let table = deep(calibration);
    let width = layout.width() as usize;
    let mut row = vec![[0u16; 3]; width];
    for (y, out) in (0..).zip(rgb.chunks_mut(3 * width)) {
        read_rgb_row(&layout, frame.pixels.samples(), y, &mut row);
        let codes = row.as_flattened().iter();
        out.iter_mut().zip(codes).for_each(|(to, code)| *to = table[usize::from(*code)]);
    }
    Some(rgb)
}

/// Returns the 8-bit code from which on a sample of a developed picture is clipped.
pub(super) fn white(calibration: &Calibration) -> f64 {
    if calibration.layout.format().max_code() > 255 { 255.0 } else { calibration.levels.white }
}

/// Returns a table from the codes of a format deeper than eight bits to codes of eight bits.
fn deep(c: &Calibration) -> Vec<u8> {
    if c.layout.format().max_code() <= 255 {
        return (0..=u8::MAX).collect();
    }
    let is_linear = matches!(c.response, Response::Linear);
    let code = |v: u16| {
        let x = ((f64::from(v) - c.levels.black) / (c.levels.white - c.levels.black)) as f32;
        if is_linear { srgb_code(x) } else { (255.0 * x.clamp(0.0, 1.0) + 0.5) as u8 }
    };
    (0..=u16::MAX).map(code).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::Pixels;
    use crate::source::{SceneSource, Source};
    use hemilux_core::Exposure;
    use hemilux_core::format::{Format, Pattern, Yuv};

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
        // The row with red and green samples has codes 1023, 0, 0, 0; the row below has codes 0.
        let raw =
            seen(Format::Raw10(Pattern::Rggb), 4, 2, vec![255, 0, 0, 0, 3, 0, 0, 0, 0, 0]).expect("whole");
        assert_eq!((&raw[..3], &raw[9..12]), (&[255, 0, 0][..], &[0, 0, 0][..]));
        let wide = seen(Format::Bayer16(Pattern::Rggb, 12), 2, 2, vec![255, 15, 0, 0, 0, 0, 255, 15]);
        assert_eq!(wide, Some([[255, 0, 255]; 4].as_flattened().to_vec()));
        assert_eq!(seen(Format::Rgb24, 2, 2, vec![0; 11]), None, "a short frame");
    }
}
