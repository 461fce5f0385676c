//! The images of a recorded burst.

use super::{Image, RecordedError};
use crate::calibration::Pixels;
use image::{DynamicImage, ImageFormat, ImageReader, Limits};
use std::path::Path;

/// Longest side of an image, pixels.
const MAX_SIDE: u32 = 1 << 14;

/// Most bytes that decoding one image may take.
const MAX_BYTES: u64 = 1 << 29;

const EXPECTED: &str = "a whole PNG, JPEG, PGM or PPM image";

/// Reads one image, by what it holds and not by its name; grey is repeated in all channels.
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
    let pixels = match image {
        DynamicImage::ImageLuma16(_)
        | DynamicImage::ImageLumaA16(_)
        | DynamicImage::ImageRgb16(_)
        | DynamicImage::ImageRgba16(_) => Pixels::U16(image.into_rgb16().into_raw()),
        _ => Pixels::U8(image.into_rgb8().into_raw()),
    };
    Ok(Image { width, height, pixels })
}
