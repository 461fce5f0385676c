//! A sparse look at a frame's brightness: enough to tell exposures apart, too little to cost anything.

use super::formats::{Layout, Picture};

/// Samples across and down: 3,072 in all, a hundredth of a 640 x 480 frame.
const GRID: (u32, u32) = (64, 48);

/// Relative codes (0 black, 1 white; outside for limited range) on a grid over the frame, always in the same places.
pub fn sample(picture: &Picture, bytes: &[u8], codes: &mut Vec<f32>) {
    codes.clear();
    for j in 0..GRID.1 {
        // Even places: with a mosaic they all lie under the same colour.
        let y = (picture.height * (2 * j + 1) / (2 * GRID.1)) & !1;
        let row = bytes.get(picture.stride as usize * y as usize..).unwrap_or(&[]);
        codes.extend((0..GRID.0).map(|i| {
            let x = (picture.width * (2 * i + 1) / (2 * GRID.0)) & !1;
            code(picture, row, x as usize)
        }));
    }
}

/// The brightness of pixel `x` of `row`; 0 beyond its end.
fn code(picture: &Picture, row: &[u8], x: usize) -> f32 {
    let byte = |at: usize| f32::from(row.get(at).copied().unwrap_or(0));
    let low = |at: usize| u16::from(row.get(at).copied().unwrap_or(0));
    let luma = |y: f32| if picture.full_range { y / 255.0 } else { (y - 16.0) / 219.0 };
    match picture.layout {
        Layout::Yuyv => luma(byte(2 * x)),
        Layout::Nv12 | Layout::Grey => luma(byte(x)),
        Layout::Rgb24 | Layout::Bgr24 => byte(3 * x + 1) / 255.0,
        Layout::Bayer8(_) => byte(x) / 255.0,
        Layout::Bayer10Packed(_) => {
            let group = x / 4 * 5;
            let low = (low(group + 4) >> (2 * (x % 4))) & 3;
            (4.0 * byte(group + x % 4) + f32::from(low)) / 1023.0
        }
        Layout::Bayer12Packed(_) => {
            let group = x / 2 * 3;
            let low = (low(group + 2) >> (4 * (x % 2))) & 15;
            (16.0 * byte(group + x % 2) + f32::from(low)) / 4095.0
        }
        Layout::Bayer16(_, bits) => {
            let code = low(2 * x) | (low(2 * x + 1) << 8);
            f32::from(code) / ((1u32 << bits.min(16)) - 1) as f32
        }
    }
}

/// Mean of `codes`; 0 of none.
#[must_use]
pub fn mean(codes: &[f32]) -> f32 {
    codes.iter().sum::<f32>() / codes.len().max(1) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::v4l2::formats::{layout, parse};

    fn picture(name: &str, stride: u32) -> Picture {
        let fourcc = parse(name).expect("a name");
        let layout = layout(fourcc).expect("known");
        Picture { width: 4, height: 2, fourcc, layout, stride, full_range: true, bt709: false }
    }

    /// Bits written by hand from the kernel's tables of the packed formats.
    #[test]
    fn packed_samples_are_where_the_kernel_says() {
        // Pixels 0x3ff, 0x001, 0x200, 0x102: high bytes, then two low bits each from pixel 0 up.
        let ten = [0xff, 0x00, 0x80, 0x40, 0b10_00_01_11];
        let p = picture("pBAA", 5);
        let found: Vec<f32> = (0..4).map(|x| (code(&p, &ten, x) * 1023.0).round()).collect();
        assert_eq!(found, [1023.0, 1.0, 512.0, 258.0], "ten bits");
        let twelve = [0xff, 0x12, 0x3f];
        let p = picture("pBCC", 3);
        let found: Vec<f32> = (0..2).map(|x| (code(&p, &twelve, x) * 4095.0).round()).collect();
        assert_eq!(found, [4095.0, f32::from(0x123u16)], "twelve bits");
    }

    #[test]
    fn short_frames_are_dark_where_they_end() {
        let mut codes = Vec::new();
        sample(&picture("GREY", 4), &[255; 4], &mut codes);
        assert_eq!(codes.len(), 3072, "all places");
        assert!(mean(&codes) > 0.99, "a first row only, from which even rows are taken: {}", mean(&codes));
        sample(&picture("GREY", 4), &[], &mut codes);
        assert_eq!(mean(&codes), 0.0, "nothing");
    }
}
