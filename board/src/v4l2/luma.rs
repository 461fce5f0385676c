//! A sparse look at a frame's brightness: enough to tell exposures apart, too little to cost anything.

use hemilux_core::format::{Format, Layout};

/// Samples across and down: 3,072 in all, a hundredth of a 640 x 480 frame.
const GRID: (u32, u32) = (64, 48);

/// Relative codes (0 black, 1 white; outside for limited range) on a grid over the frame, always in the same places.
pub fn sample(layout: &Layout, bytes: &[u8], codes: &mut Vec<f32>) {
    codes.clear();
    for j in 0..GRID.1 {
        // Even places: with a mosaic they all lie under the same colour.
        let y = (layout.height() * (2 * j + 1) / (2 * GRID.1)) & !1;
        let row = bytes.get(layout.bytes_per_line() * y as usize..).unwrap_or(&[]);
        codes.extend((0..GRID.0).map(|i| {
            let x = (layout.width() * (2 * i + 1) / (2 * GRID.0)) & !1;
            code(layout.format(), row, x as usize)
        }));
    }
}

/// The brightness of pixel `x` of `row`; 0 beyond its end.
fn code(format: Format, row: &[u8], x: usize) -> f32 {
    let byte = |at: usize| f32::from(row.get(at).copied().unwrap_or(0));
    let low = |at: usize| u16::from(row.get(at).copied().unwrap_or(0));
    let luma = |y: f32, limited| if limited { (y - 16.0) / 219.0 } else { y / 255.0 };
    let word = |x: usize| low(2 * x) | low(2 * x + 1) << 8;
    let of = |code: u16| f32::from(code) / format.max_code() as f32;
    match format {
        Format::Yuyv(yuv) => luma(byte(2 * x), yuv.limited),
        Format::Nv12(yuv) => luma(byte(x), yuv.limited),
        Format::Grey | Format::Bayer8(_) => byte(x) / 255.0,
        Format::Rgb24 | Format::Bgr24 => byte(3 * x + 1) / 255.0,
        Format::Raw10(_) => {
            let group = x / 4 * 5;
            of(low(group + x % 4) << 2 | low(group + 4) >> (2 * (x % 4)) & 3)
        }
        Format::Raw12(_) => {
            let group = x / 2 * 3;
            of(low(group + x % 2) << 4 | low(group + 2) >> (4 * (x % 2)) & 15)
        }
        Format::Bayer16(..) => of(word(x)),
        Format::Rgb48 => of(word(3 * x + 1)),
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
    use hemilux_core::format::Pattern;

    /// Bits written by hand from the kernel's tables of the packed formats.
    #[test]
    fn packed_samples_are_where_the_kernel_says() {
        // Pixels 0x3ff, 0x001, 0x200, 0x102: high bytes, then two low bits each from pixel 0 up.
        let ten = [0xff, 0x00, 0x80, 0x40, 0b10_00_01_11];
        let format = Format::Raw10(Pattern::Bggr);
        let found: Vec<f32> = (0..4).map(|x| (code(format, &ten, x) * 1023.0).round()).collect();
        assert_eq!(found, [1023.0, 1.0, 512.0, 258.0], "ten bits");
        let twelve = [0xff, 0x12, 0x3f];
        let format = Format::Raw12(Pattern::Bggr);
        let found: Vec<f32> = (0..2).map(|x| (code(format, &twelve, x) * 4095.0).round()).collect();
        assert_eq!(found, [4095.0, f32::from(0x123u16)], "twelve bits");
    }

    #[test]
    fn short_frames_are_dark_where_they_end() {
        let (mut codes, grey) = (Vec::new(), Layout::tight(Format::Grey, 4, 2).expect("a layout"));
        sample(&grey, &[255; 4], &mut codes);
        assert_eq!(codes.len(), 3072, "all places");
        assert!(mean(&codes) > 0.99, "a first row only, from which even rows are taken: {}", mean(&codes));
        sample(&grey, &[], &mut codes);
        assert_eq!(mean(&codes), 0.0, "nothing");
    }
}
