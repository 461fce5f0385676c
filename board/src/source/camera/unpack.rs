//! Camera frames to the interleaved RGB that the pipeline takes.

use crate::calibration::Pixels;
use crate::v4l2::formats::{Layout, Mosaic, Picture};

/// Unpacks a whole frame, reusing the memory of `pixels`.
pub(super) fn unpack(picture: &Picture, bytes: &[u8], pixels: &mut Pixels) {
    if picture.layout.bits() > 8 {
        let Pixels::U16(samples) = pixels else {
            *pixels = Pixels::U16(Vec::new());
            return unpack(picture, bytes, pixels);
        };
        samples.resize(3 * picture.width as usize * picture.height as usize, 0);
        wide(picture, bytes, samples);
    } else {
        let Pixels::U8(samples) = pixels else {
            *pixels = Pixels::U8(Vec::new());
            return unpack(picture, bytes, pixels);
        };
        samples.resize(3 * picture.width as usize * picture.height as usize, 0);
        narrow(picture, bytes, samples);
    }
}

fn narrow(picture: &Picture, bytes: &[u8], samples: &mut [u8]) {
    let (stride, width) = (picture.stride as usize, picture.width as usize);
    let chroma = bytes.get(stride * picture.height as usize..).unwrap_or(&[]);
    let matrix = Matrix::of(picture);
    for (y, (out, row)) in samples.chunks_exact_mut(3 * width).zip(bytes.chunks(stride)).enumerate() {
        let rgb = out.as_chunks_mut::<3>().0;
        match picture.layout {
            Layout::Rgb24 => out.copy_from_slice(&row[..3 * width]),
            Layout::Bgr24 => {
                rgb.iter_mut().zip(row.as_chunks::<3>().0).for_each(|(o, [b, g, r])| *o = [*r, *g, *b]);
            }
            Layout::Yuyv => {
                for (two, [y0, u, y1, v]) in rgb.chunks_mut(2).zip(row.as_chunks::<4>().0) {
                    let offsets = matrix.chroma(*u, *v);
                    two.iter_mut().zip([*y0, *y1]).for_each(|(o, y)| *o = matrix.rgb(y, offsets));
                }
            }
            Layout::Nv12 => {
                let pairs = chroma.get(stride * (y / 2)..).unwrap_or(&[]).as_chunks::<2>().0;
                for ((two, luma), [u, v]) in rgb.chunks_mut(2).zip(row.chunks(2)).zip(pairs) {
                    let offsets = matrix.chroma(*u, *v);
                    two.iter_mut().zip(luma).for_each(|(o, y)| *o = matrix.rgb(*y, offsets));
                }
            }
            Layout::Bayer8(mosaic) => demosaic(picture, y, mosaic, rgb, |y, x| bytes[stride * y + x]),
            _ => rgb.iter_mut().zip(row).for_each(|(o, v)| *o = [*v; 3]),
        }
    }
}

fn wide(picture: &Picture, bytes: &[u8], samples: &mut [u16]) {
    let (stride, width) = (picture.stride as usize, picture.width as usize);
    let byte = |y: usize, at: usize| u16::from(bytes[stride * y + at]);
    for (y, out) in samples.chunks_exact_mut(3 * width).enumerate() {
        let rgb = out.as_chunks_mut::<3>().0;
        match picture.layout {
            Layout::Bayer10Packed(mosaic) => demosaic(picture, y, mosaic, rgb, |y, x| {
                let group = x / 4 * 5;
                (byte(y, group + x % 4) << 2) | ((byte(y, group + 4) >> (2 * (x % 4))) & 3)
            }),
            Layout::Bayer12Packed(mosaic) => demosaic(picture, y, mosaic, rgb, |y, x| {
                let group = x / 2 * 3;
                (byte(y, group + x % 2) << 4) | ((byte(y, group + 2) >> (4 * (x % 2))) & 15)
            }),
            Layout::Bayer16(mosaic, _) => {
                demosaic(picture, y, mosaic, rgb, |y, x| byte(y, 2 * x) | (byte(y, 2 * x + 1) << 8));
            }
            _ => {}
        }
    }
}

/// Gives each pixel of row `y` the red and blue of its cell and the cell's green of its own row: no light is mixed between cells.
fn demosaic<T>(
    picture: &Picture,
    y: usize,
    mosaic: Mosaic,
    rgb: &mut [[T; 3]],
    code: impl Fn(usize, usize) -> T,
) {
    let (red_x, red_y) = (mosaic.red_x as usize, mosaic.red_y as usize);
    let top = (y & !1).min(picture.height as usize - 2);
    let green_x = if (y - top) & 1 == red_y { 1 - red_x } else { red_x };
    let last = picture.width as usize - 2;
    for (x, out) in rgb.iter_mut().enumerate() {
        let left = (x & !1).min(last);
        *out = [
            code(top + red_y, left + red_x),
            code(top + ((y - top) & 1), left + green_x),
            code(top + 1 - red_y, left + 1 - red_x),
        ];
    }
}

/// Luma and chroma to RGB, in 1/65536.
struct Matrix {
    black: i32,
    luma: i32,
    /// Red of V, green of U, green of V, blue of U.
    chroma: [i32; 4],
}

impl Matrix {
    /// The matrices of ITU-R BT.601 and BT.709 for the picture's range.
    fn of(picture: &Picture) -> Self {
        let (kr, kb) = if picture.bt709 { (0.2126, 0.0722) } else { (0.299, 0.114) };
        let kg = 1.0 - kr - kb;
        let (luma, chroma) = if picture.full_range { (1.0, 1.0) } else { (255.0 / 219.0, 255.0 / 224.0) };
        let fixed = |v: f64| (v * 65536.0).round() as i32;
        let (red, blue) = (2.0 * (1.0 - kr) * chroma, 2.0 * (1.0 - kb) * chroma);
        let chroma = [red, -blue * kb / kg, -red * kr / kg, blue].map(fixed);
        Self { black: if picture.full_range { 0 } else { 16 }, luma: fixed(luma), chroma }
    }

    fn chroma(&self, u: u8, v: u8) -> [i32; 3] {
        let (u, v) = (i32::from(u) - 128, i32::from(v) - 128);
        let [red, green_u, green_v, blue] = self.chroma;
        [red * v, green_u * u + green_v * v, blue * u]
    }

    fn rgb(&self, y: u8, offsets: [i32; 3]) -> [u8; 3] {
        let y = (i32::from(y) - self.black) * self.luma + (1 << 15);
        offsets.map(|o| ((y + o) >> 16).clamp(0, 255) as u8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::v4l2::formats::{layout, parse};

    fn picture(name: &str, width: u32, height: u32, full_range: bool) -> Picture {
        let fourcc = parse(name).expect("a name");
        let layout = layout(fourcc).expect("known");
        let stride = layout.row_bytes(width);
        Picture { width, height, fourcc, layout, stride, full_range, bt709: false }
    }

    fn narrow_of(picture: &Picture, bytes: &[u8]) -> Vec<u8> {
        let mut pixels = Pixels::U16(Vec::new());
        unpack(picture, bytes, &mut pixels);
        let Pixels::U8(found) = pixels else { panic!("eight bits") };
        found
    }

    /// The 100 % colour bars of BT.601: red is (81, 90, 240), white (235, 128, 128), blue (41, 240, 110).
    #[test]
    fn colour_bars_become_their_colours() {
        let found = narrow_of(&picture("YUYV", 2, 2, false), &[81, 90, 81, 240, 235, 128, 16, 128]);
        let expected = [255, 0, 0, 255, 0, 0, 255, 255, 255, 0, 0, 0];
        let near =
            |found: &[u8], expected: &[u8]| found.iter().zip(expected).all(|(a, b)| a.abs_diff(*b) <= 1);
        assert!(near(&found, &expected), "{found:?}");
        let found = narrow_of(&picture("NV12", 2, 2, false), &[41, 41, 41, 41, 240, 110]);
        assert!(near(&found, &[0, 0, 255].repeat(4)), "{found:?}");
        let found = narrow_of(&picture("YUYV", 2, 2, true), &[200, 128, 100, 128, 0, 128, 255, 128]);
        assert_eq!(found, [[200; 3], [100; 3], [0; 3], [255; 3]].concat(), "grey of the full range");
    }

    #[test]
    fn colours_of_a_mosaic_are_where_its_name_says() {
        let rggb = [10, 20, 10, 20, 30, 40, 30, 40];
        let found = narrow_of(&picture("RGGB", 4, 2, true), &rggb);
        assert_eq!(found, [[10, 20, 40].repeat(4), [10, 30, 40].repeat(4)].concat(), "RGGB");
        let bggr = [40, 20, 40, 20, 30, 10, 30, 10];
        let found = narrow_of(&picture("BA81", 4, 2, true), &bggr);
        assert_eq!(found, [[10, 20, 40].repeat(4), [10, 30, 40].repeat(4)].concat(), "BGGR");
    }

    #[test]
    fn ten_packed_bits_are_whole() {
        let row = [0xff, 0x00, 0x80, 0x40, 0b10_00_01_11];
        let mut pixels = Pixels::U8(Vec::new());
        unpack(&picture("pRAA", 4, 2, true), &[row, row].concat(), &mut pixels);
        // Red 1023 and 512 in the even columns, green 1 and 258 beside them, the second row likewise with blue 1 and 258.
        let Pixels::U16(found) = pixels else { panic!("sixteen bits") };
        assert_eq!(found[..6], [1023, 1, 1, 1023, 1, 1], "{found:?}");
        assert_eq!(found[6..12], [512, 258, 258, 512, 258, 258], "{found:?}");
    }
}
