//! Sparse sampling of a frame's brightness, sufficient to distinguish exposures.

use hemilux_core::{Layout, Samples, read_luma};

/// Number of sampled positions across and down a frame: 3,072 in all, one for every hundred pixels of a 640 x
/// 480 frame.
const GRID: (u32, u32) = (64, 48);

/// Samples the relative codes of a frame (0 black, 1 white; outside of 0 to 1 for limited range) on a fixed grid
/// and stores them in `codes`.
pub fn sample(layout: &Layout, bytes: &[u8], codes: &mut Vec<f32>) {
    codes.clear();
    for j in 0..GRID.1 {
        // The positions are even, so that all samples of a mosaic have the same colour.
        let y = (layout.height() * (2 * j + 1) / (2 * GRID.1)) & !1;
        codes.extend((0..GRID.0).map(|i| {
            let x = (layout.width() * (2 * i + 1) / (2 * GRID.0)) & !1;
            read_luma(layout, Samples::U8(bytes), x, y)
        }));
    }
}

/// Returns the mean of `codes`; 0 for an empty slice.
#[must_use]
pub fn mean(codes: &[f32]) -> f32 {
    codes.iter().sum::<f32>() / codes.len().max(1) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use hemilux_core::format::{Format, Pattern};

    /// The bytes were written by hand from the kernel's tables of the packed formats.
    #[test]
    fn packed_samples_are_read_at_the_kernels_bit_positions() {
        // Pixels 0x3ff, 0x001, 0x200, 0x102: first the high bytes, then the two low bits of each pixel, from pixel
        // 0 up.
        let ten = [[0xff, 0x00, 0x80, 0x40, 0b10_00_01_11]; 2].concat();
        let code = |format, bytes: &[u8], x| {
            let layout = Layout::tight(format, 4, 2).expect("a layout");
            read_luma(&layout, Samples::U8(bytes), x, 0)
        };
        let format = Format::Raw10(Pattern::Bggr);
        let found: Vec<f32> = (0..4).map(|x| (code(format, &ten, x) * 1023.0).round()).collect();
        assert_eq!(found, [1023.0, 1.0, 512.0, 258.0], "ten bits");
        let twelve = [0xff, 0x12, 0x3f].repeat(4);
        let format = Format::Raw12(Pattern::Bggr);
        let found: Vec<f32> = (0..2).map(|x| (code(format, &twelve, x) * 4095.0).round()).collect();
        assert_eq!(found, [4095.0, f32::from(0x123u16)], "twelve bits");
    }

    #[test]
    fn samples_beyond_the_end_of_a_short_frame_are_dark() {
        let (mut codes, grey) = (Vec::new(), Layout::tight(Format::Grey, 4, 2).expect("a layout"));
        sample(&grey, &[255; 4], &mut codes);
        assert_eq!(codes.len(), 3072, "all places");
        assert!(mean(&codes) > 0.99, "a first row only, from which even rows are taken: {}", mean(&codes));
        sample(&grey, &[], &mut codes);
        assert_eq!(mean(&codes), 0.0, "nothing");
    }
}
