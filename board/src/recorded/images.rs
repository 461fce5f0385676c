//! The images and raw frames of a recorded burst.

use super::{Image, RecordedError};
use crate::calibration::Pixels;
use hemilux_core::format::{Format, Layout};
use image::{DynamicImage, ImageFormat, ImageReader, Limits};
use std::io::Read;
use std::path::Path;

/// Longest side of an image, pixels.
const MAX_SIDE: u32 = 1 << 14;

/// Most bytes that decoding one image may take.
const MAX_BYTES: u64 = 1 << 29;

const EXPECTED: &str = "a whole PNG, JPEG, PGM or PPM image";

/// Reads one image; the format follows from the contents, not from the file name. Grey is repeated in all channels.
pub(super) fn read(path: &Path) -> Result<Image, RecordedError> {
    let refused = |found: &dyn std::fmt::Display| RecordedError::new(path, found, EXPECTED);
    let reader = ImageReader::open(path).map_err(|e| refused(&e))?;
    let mut reader = reader.with_guessed_format().map_err(|e| refused(&e))?;
    match reader.format() {
        Some(ImageFormat::Png | ImageFormat::Jpeg | ImageFormat::Pnm) => {}
        Some(other) => return Err(refused(&format!("a {other:?} image"))),
        None => return Err(refused(&"a file of another type")),
    }
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE);
    limits.max_image_height = Some(MAX_SIDE);
    limits.max_alloc = Some(MAX_BYTES);
    reader.limits(limits);
    let image = reader.decode().map_err(|e| refused(&e))?;
    let (width, height) = (image.width(), image.height());
    let (format, pixels) = match image {
        DynamicImage::ImageLuma16(_)
        | DynamicImage::ImageLumaA16(_)
        | DynamicImage::ImageRgb16(_)
        | DynamicImage::ImageRgba16(_) => (Format::Rgb48, Pixels::U16(image.into_rgb16().into_raw())),
        _ => (Format::Rgb24, Pixels::U8(image.into_rgb8().into_raw())),
    };
    let layout = Layout::tight(format, width, height).map_err(|e| refused(&e))?;
    Ok(Image { layout, pixels })
}

/// Largest number of bytes after the rows of a raw frame.
const MAX_TRAILER: u64 = 1 << 16;

/// Reads one frame as the driver packed it.
pub(super) fn read_raw(path: &Path, layout: Layout) -> Result<Image, RecordedError> {
    let rows = layout.frame_bytes() as u64;
    let expected = format!("{rows} bytes of a raw frame");
    let refused = |found: &dyn std::fmt::Display| RecordedError::new(path, found, &expected);
    let file = std::fs::File::open(path).map_err(|e| refused(&e))?;
    let most = rows + layout.bytes_per_line() as u64 + MAX_TRAILER;
    let mut bytes = Vec::new();
    file.take(most + 1).read_to_end(&mut bytes).map_err(|e| refused(&e))?;
    match bytes.len() as u64 {
        found if found < rows => Err(refused(&format!("{found} bytes"))),
        found if found > most => Err(refused(&format!("more than {most} bytes"))),
        _ => Ok(Image { layout, pixels: Pixels::U8(bytes) }),
    }
}
