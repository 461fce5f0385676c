//! Decoding of a camera's JPEG frames into rows of red, green and blue bytes.
//!
//! Pictures of 640 x 480 pixels and fewer are decoded by `zune-jpeg`. Larger ones are scaled to 1/2, 1/4 or 1/8 during decoding, since a
//! scaled inverse DCT costs a fraction of a full one: `jpeg-decoder` supports it, `zune-jpeg` does not.

use super::Size;
use super::huffman;
use crate::recorded::{SEAL, is_whole_jpeg};
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Number of pixels of the largest picture that is decoded at full size.
const MOST_FULL: u64 = 640 * 480;

/// Least length of the shorter side of a scaled picture, pixels: with a lens of 180 degrees, a pixel is 0.75 degrees
/// wide.
const LEAST_SIDE: u32 = 240;

/// Size of a camera's JPEG frames and the factor by which they are scaled down.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Jpeg {
    /// Width of the camera's frame, pixels.
    pub width: u32,
    /// Height of the camera's frame, pixels.
    pub height: u32,
    /// Factor by which both sides of the frame are divided during decoding: 1, 2, 4 or 8.
    pub shrink: u32,
}

impl Jpeg {
    /// Chooses the scale of decoding for frames of `width` x `height` pixels.
    #[must_use]
    pub fn of(width: u32, height: u32) -> Self {
        let is_small = u64::from(width) * u64::from(height) <= MOST_FULL;
        let fits = |shrink: &u32| width.min(height) / shrink >= LEAST_SIDE;
        let shrink = if is_small { None } else { [8, 4, 2].into_iter().find(fits) };
        Self { width, height, shrink: shrink.unwrap_or(1) }
    }

    /// Returns the size of the decoded frame.
    #[must_use]
    pub const fn decoded(&self) -> Size {
        Size::new(self.width.div_ceil(self.shrink), self.height.div_ceil(self.shrink))
    }

    /// Decodes the JPEG frame `bytes` into `rgb`; returns false for a frame that is truncated, damaged or of
    /// another size.
    #[must_use]
    pub fn decode(&self, bytes: &[u8], rgb: &mut Vec<u8>) -> bool {
        let is_whole =
            bytes.starts_with(&[0xff, 0xd8]) && is_whole_jpeg(bytes) && restarts_are_in_order(bytes);
        let Some(sealed) = sealed(bytes).filter(|_| is_whole) else { return false };
        let decoded = if self.shrink == 1 { self.full(&sealed, rgb) } else { self.scaled(&sealed, rgb) };
        decoded.is_some()
    }

    fn full(&self, bytes: &[u8], rgb: &mut Vec<u8>) -> Option<()> {
        let options = DecoderOptions::default()
            .set_strict_mode(true)
            .set_max_width(self.width as usize)
            .set_max_height(self.height as usize)
            .jpeg_set_out_colorspace(ColorSpace::RGB);
        let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
        decoder.decode_headers().ok()?;
        if decoder.dimensions()? != (self.width as usize, self.height as usize) {
            return None;
        }
        rgb.resize(decoder.output_buffer_size()?, 0);
        decoder.decode_into(rgb).ok()
    }

    fn scaled(&self, bytes: &[u8], rgb: &mut Vec<u8>) -> Option<()> {
        let mut decoder = jpeg_decoder::Decoder::new(bytes);
        decoder.read_info().ok()?;
        let found = decoder.info()?;
        if (u32::from(found.width), u32::from(found.height)) != (self.width, self.height) {
            return None;
        }
        let Size { width, height } = self.decoded();
        let granted = decoder.scale(width.try_into().ok()?, height.try_into().ok()?).ok()?;
        let pixels = decoder.decode().ok()?;
        if (u32::from(granted.0), u32::from(granted.1)) != (width, height) {
            return None;
        }
        rgb.clear();
        match found.pixel_format {
            jpeg_decoder::PixelFormat::RGB24 => rgb.extend_from_slice(&pixels),
            jpeg_decoder::PixelFormat::L8 => rgb.extend(pixels.iter().flat_map(|grey| [*grey; 3])),
            _ => return None,
        }
        Some(())
    }
}

/// Returns the JPEG frame `bytes` with Huffman tables, if it has none, and with [`SEAL`] before the end marker, which makes a decoder fail
/// if blocks are missing.
fn sealed(bytes: &[u8]) -> Option<Vec<u8>> {
    let end = bytes.windows(2).rposition(|w| w == [0xff, 0xd9])?;
    let (head, rest) = bytes.get(..end)?.split_at_checked(huffman::missing_at(bytes).unwrap_or(0))?;
    let tables = if head.is_empty() { Vec::new() } else { huffman::segment() };
    Some([head, &tables, rest, &SEAL, &[0xff, 0xd9]].concat())
}

/// Returns whether the restart markers of a JPEG frame count from 0 to 7 cyclically: a decoder ignores a missing marker and shifts the rest
/// of the picture.
fn restarts_are_in_order(bytes: &[u8]) -> bool {
    let numbers =
        bytes.windows(2).filter(|w| w[0] == 0xff && (0xd0..=0xd7).contains(&w[1])).map(|w| w[1] - 0xd0);
    numbers.zip((0..8).cycle()).all(|(found, expected)| found == expected)
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::codecs::jpeg::JpegEncoder;

    /// Returns a picture whose red increases from left to right and whose green increases from top to bottom.
    fn picture(width: u32, height: u32) -> Vec<u8> {
        let side = |at: u32, of: u32| (255 * at / of) as u8;
        let pixel = |i: u32| [side(i % width, width), side(i / width, height), 90];
        (0..width * height).flat_map(pixel).collect()
    }

    fn encoded(width: u32, height: u32) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = JpegEncoder::new_with_quality(&mut bytes, 90);
        encoder
            .encode(&picture(width, height), width, height, image::ExtendedColorType::Rgb8)
            .expect("a JPEG");
        bytes
    }

    #[test]
    fn the_scale_keeps_240_pixels_of_the_shorter_side() {
        let sizes =
            [(640, 480), (1280, 720), (1280, 960), (1920, 1080), (2592, 1944), (3840, 480), (1279, 721)];
        let found = sizes.map(|(width, height)| Jpeg::of(width, height).shrink);
        assert_eq!(found, [1, 2, 4, 4, 8, 2, 2], "scales of {sizes:?}");
        assert_eq!(Jpeg::of(1279, 721).decoded(), Size::new(640, 361), "odd sizes are rounded up");
    }

    #[test]
    fn a_decoded_frame_has_the_colours_of_the_picture_at_each_scale() {
        for (width, height) in [(64, 48), (1280, 720), (1920, 1080)] {
            let (jpeg, mut rgb) = (Jpeg::of(width, height), Vec::new());
            assert!(jpeg.decode(&encoded(width, height), &mut rgb), "{jpeg:?}");
            let Size { width: columns, height: rows } = jpeg.decoded();
            assert_eq!(rgb.len(), (3 * columns * rows) as usize, "{jpeg:?}");
            let original = picture(width, height);
            let at = |x: u32, y: u32| 3 * (y * columns + x) as usize;
            for (x, y) in [(columns / 4, rows / 4), (columns / 2, rows / 3), (3 * columns / 4, rows - 2)] {
                let of = 3 * (y * jpeg.shrink * width + x * jpeg.shrink) as usize;
                for channel in 0..3 {
                    let (found, expected) = (rgb[at(x, y) + channel], original[of + channel]);
                    assert!(found.abs_diff(expected) <= 6, "{jpeg:?} at {x}, {y}: {found} for {expected}");
                }
            }
        }
    }

    /// The encoder writes the tables of annex K.3 into each picture; the test removes them, since many USB
    /// cameras send frames without them.
    #[test]
    fn a_frame_without_huffman_tables_is_decoded_with_the_standard_ones() {
        for (width, height) in [(320, 240), (1280, 720)] {
            let (jpeg, whole, mut bare) = (Jpeg::of(width, height), encoded(width, height), Vec::new());
            let mut at = 0;
            let mut removed = 0;
            while at < whole.len() {
                if whole[at..].starts_with(&[0xff, 0xc4]) {
                    let length = 2 + usize::from(u16::from_be_bytes([whole[at + 2], whole[at + 3]]));
                    (at, removed) = (at + length, removed + length);
                    continue;
                }
                bare.push(whole[at]);
                at += 1;
            }
            assert!(removed > 400, "{removed} bytes of tables");
            let (mut expected, mut found) = (Vec::new(), Vec::new());
            assert!(
                jpeg.decode(&whole, &mut expected) && jpeg.decode(&bare, &mut found),
                "{width} x {height}"
            );
            assert_eq!(found, expected, "{width} x {height}");
        }
    }

    #[test]
    fn cut_and_damaged_frames_are_refused_at_each_scale() {
        for (width, height) in [(320, 240), (1280, 720)] {
            let (jpeg, whole, mut rgb) = (Jpeg::of(width, height), encoded(width, height), Vec::new());
            let without_end = &whole[..whole.len() - 2];
            let half = [&whole[..whole.len() / 2], &[0xff, 0xd9]].concat();
            let mut other_marker = whole.clone();
            let middle = whole.len() - 40;
            other_marker[middle..middle + 2].copy_from_slice(&[0xff, 0xd5]);
            for broken in [&[][..], without_end, &half, &other_marker, &whole[100..]] {
                assert!(!jpeg.decode(broken, &mut rgb), "{width} x {height}: {} bytes", broken.len());
            }
            assert!(!Jpeg::of(width + 8, height).decode(&whole, &mut rgb), "another size");
            assert!(jpeg.decode(&[&whole[..], &[0; 64]].concat(), &mut rgb), "padding after the end");
        }
    }
}
