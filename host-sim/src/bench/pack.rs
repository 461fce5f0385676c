//! Packing of RGB codes into the bytes of camera pixel formats.

use hemilux_core::format::{Format, Matrix, Yuv};

/// Packs an image of `width` columns, whose codes are red, green, blue from 0 to [`Format::max_code`], into bytes without padding of rows.
///
/// A pixel of a mosaic has the code of one channel; a chroma sample is the mean over the pixels that share it.
///
/// # Panics
/// For [`Format::Rgb48`], whose samples are 16-bit words, and for unsupported formats and matrices.
#[must_use]
pub fn pack(format: Format, width: usize, codes: &[[u16; 3]]) -> Vec<u8> {
    let rows = || codes.chunks_exact(width);
    let mosaic = |cell: [usize; 4]| -> Vec<u16> {
        let row = |(y, row): (usize, &[[u16; 3]])| -> Vec<u16> {
            row.iter().enumerate().map(|(x, rgb)| rgb[cell[2 * (y % 2) + x % 2]]).collect()
        };
        rows().enumerate().flat_map(row).collect()
    };
    let luma = |yuv: Yuv| -> Vec<[f64; 3]> { codes.iter().map(|rgb| ycc(*rgb, yuv)).collect() };
    match format {
        Format::Rgb24 => codes.iter().flatten().map(|v| *v as u8).collect(),
        Format::Bgr24 => codes.iter().flat_map(|[r, g, b]| [*b as u8, *g as u8, *r as u8]).collect(),
        Format::Grey => codes.iter().map(|rgb| rgb[1] as u8).collect(),
        Format::Yuyv(yuv) => {
            let pair = |p: &[[f64; 3]]| {
                let [cb, cr] = [1, 2].map(|i| code(0.5 * (p[0][i] + p[1][i])));
                [code(p[0][0]), cb, code(p[1][0]), cr]
            };
            luma(yuv).chunks_exact(2).flat_map(pair).collect()
        }
        Format::Nv12(yuv) => {
            let all = luma(yuv);
            let mut bytes: Vec<u8> = all.iter().map(|p| code(p[0])).collect();
            for two in all.chunks_exact(2 * width) {
                for x in (0..width).step_by(2) {
                    let four = [two[x], two[x + 1], two[width + x], two[width + x + 1]];
                    bytes.extend([1, 2].map(|i| code(four.iter().map(|p| p[i]).sum::<f64>() / 4.0)));
                }
            }
            bytes
        }
        Format::Bayer8(p) => mosaic(p.channels()).into_iter().map(|v| v as u8).collect(),
        Format::Bayer16(p, _) => mosaic(p.channels()).into_iter().flat_map(u16::to_le_bytes).collect(),
        Format::Raw10(p) => {
            mosaic(p.channels()).chunks(width).flat_map(|r| r.chunks(4)).flat_map(raw10).collect()
        }
        Format::Raw12(p) => {
            mosaic(p.channels()).chunks(width).flat_map(|r| r.chunks(2)).flat_map(raw12).collect()
        }
        other => panic!("{other:?}: found an unsupported format, expected one of bytes"),
    }
}

fn code(v: f64) -> u8 {
    v.round().clamp(0.0, 255.0) as u8
}

/// Returns the codes of luma, blue difference and red difference of an RGB code, by the definitions of BT.601 and BT.709.
fn ycc(rgb: [u16; 3], yuv: Yuv) -> [f64; 3] {
    let (kr, kb) = match yuv.matrix {
        Matrix::Bt601 => (0.299, 0.114),
        Matrix::Bt709 => (0.2126, 0.0722),
        other => panic!("{other:?}: found an unsupported matrix, expected BT.601 or BT.709"),
    };
    let [r, g, b] = rgb.map(f64::from);
    let y = kr * r + (1.0 - kr - kb) * g + kb * b;
    let (cb, cr) = ((b - y) / (2.0 * (1.0 - kb)), (r - y) / (2.0 * (1.0 - kr)));
    if yuv.limited {
        return [16.0 + y * 219.0 / 255.0, 128.0 + cb * 224.0 / 255.0, 128.0 + cr * 224.0 / 255.0];
    }
    [y, 128.0 + cb, 128.0 + cr]
}

fn raw10(four: &[u16]) -> Vec<u8> {
    let at = |i: usize| four.get(i).copied().unwrap_or(0);
    let low = (0..4).fold(0, |low, i| low | (at(i) & 3) << (2 * i));
    (0..4).map(|i| (at(i) >> 2) as u8).chain([low as u8]).collect()
}

fn raw12(two: &[u16]) -> Vec<u8> {
    let at = |i: usize| two.get(i).copied().unwrap_or(0);
    vec![(at(0) >> 4) as u8, (at(1) >> 4) as u8, (at(0) & 15 | (at(1) & 15) << 4) as u8]
}
