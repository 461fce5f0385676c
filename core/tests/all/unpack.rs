//! Unpacked rows and pixels equal bits written by hand, also for rows wider than the front end's chunks.

use hemilux_core::format::{Pattern, Yuv};
use hemilux_core::{Format, Layout, Samples, read_luma, read_rgb_row};

/// Width of the image, pixels: more than two chunks of mosaic cells, and not a multiple of a chunk.
const WIDTH: u32 = 2 * 2 * 192 + 36;

fn rows(layout: &Layout, frame: Samples<'_>) -> Vec<Vec<[u16; 3]>> {
    let row = |y| {
        let mut row = vec![[u16::MAX; 3]; layout.width() as usize];
        read_rgb_row(layout, frame, y, &mut row);
        row
    };
    (0..layout.height()).map(row).collect()
}

/// Returns the code of ten bits of the pixel in column `x` and row `y`.
fn code(x: u32, y: u32) -> u16 {
    ((x * 7 + y * 311) % 1024) as u16
}

#[test]
fn packed_mosaic_rows_are_correct_across_chunk_boundaries() {
    let format = Format::Raw10(Pattern::Gbrg);
    let layout = Layout::try_new(format, WIDTH, 4, format.line_bytes(WIDTH) + 3).expect("a layout");
    let mut bytes = vec![0; 4 * layout.bytes_per_line()];
    for (y, line) in (0..).zip(bytes.chunks_mut(layout.bytes_per_line())) {
        for x in 0..WIDTH {
            let (group, within) = (x as usize / 4 * 5, x as usize % 4);
            line[group + within] = (code(x, y) >> 2) as u8;
            line[group + 4] |= ((code(x, y) & 3) << (2 * within)) as u8;
        }
    }
    for (y, row) in (0..).zip(rows(&layout, Samples::U8(&bytes))) {
        for (x, pixel) in (0..).zip(row) {
            let (left, top) = (x & !1, y & !1);
            // The cell has the colours green, blue; red, green.
            assert_eq!(pixel, [code(left, top + 1), code(left, top), code(left + 1, top)], "{x}, {y}");
            let luma = f32::from(code(x, y)) / 1023.0;
            assert_eq!(read_luma(&layout, Samples::U8(&bytes), x, y), luma, "{x}, {y}");
        }
    }
}

#[test]
fn rgb_rows_of_bytes_and_words_keep_the_channel_order() {
    for format in [Format::Rgb24, Format::Bgr24, Format::Rgb48, Format::Grey] {
        let layout = Layout::tight(format, WIDTH, 2).expect("a layout");
        let samples = if format == Format::Grey { 1 } else { 3 };
        let words: Vec<u16> = (0..samples * WIDTH * 2).map(|i| (i % 251) as u16).collect();
        let bytes: Vec<u8> = words.iter().map(|v| *v as u8).collect();
        let frame = if format == Format::Rgb48 { Samples::U16(&words) } else { Samples::U8(&bytes) };
        for (y, row) in (0..).zip(rows(&layout, frame)) {
            for (x, pixel) in (0..).zip(row) {
                let at = (samples * (y * WIDTH + x)) as usize;
                let expected = match format {
                    Format::Grey => [words[at]; 3],
                    Format::Bgr24 => [words[at + 2], words[at + 1], words[at]],
                    _ => [words[at], words[at + 1], words[at + 2]],
                };
                assert_eq!(pixel, expected, "{format:?} {x}, {y}");
            }
        }
    }
}

/// Without chroma, red, green and blue equal luma, since the matrices' coefficients add up to 1.
#[test]
fn luma_with_neutral_chroma_gives_grey_rows() {
    for format in [Format::Yuyv(Yuv::default()), Format::Nv12(Yuv::default())] {
        let layout = Layout::tight(format, WIDTH, 2).expect("a layout");
        let luma = |x: u32, y: u32| ((x * 3 + y * 50) % 256) as u8;
        let bytes: Vec<u8> = if matches!(format, Format::Nv12(_)) {
            let plane = (0..2).flat_map(|y| (0..WIDTH).map(move |x| luma(x, y)));
            plane.chain((0..WIDTH).map(|_| 128)).collect()
        } else {
            (0..2).flat_map(|y| (0..WIDTH).flat_map(move |x| [luma(x, y), 128])).collect()
        };
        for (y, row) in (0..).zip(rows(&layout, Samples::U8(&bytes))) {
            for (x, pixel) in (0..).zip(row) {
                assert_eq!(pixel, [u16::from(luma(x, y)); 3], "{format:?} {x}, {y}");
                assert_eq!(read_luma(&layout, Samples::U8(&bytes), x, y), f32::from(luma(x, y)) / 255.0);
            }
        }
    }
}

#[test]
fn pixels_beyond_the_frame_are_zero_or_unchanged() {
    let layout = Layout::tight(Format::Grey, 8, 4).expect("a layout");
    let short = Samples::U8(&[9; 12]);
    assert_eq!(read_luma(&layout, short, 3, 1), 9.0 / 255.0);
    assert_eq!([read_luma(&layout, short, 4, 1), read_luma(&layout, short, 8, 0)], [0.0; 2]);
    assert_eq!(read_luma(&layout, short, u32::MAX, u32::MAX), 0.0);
    let mut row = [[7; 3]; 12];
    read_rgb_row(&layout, short, 4, &mut row);
    read_rgb_row(&layout, Samples::U16(&[9; 99]), 0, &mut row);
    assert_eq!(row, [[7; 3]; 12], "a row beyond the last, a frame of words");
}
