//! The images and raw frames of a recorded burst.

use super::{Image, ReadLimits, RecordedError, jpeg};
use crate::calibration::Pixels;
use hemilux_core::format::{Format, Layout};
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};
use std::fs::File;
use std::io::{BufRead, BufReader, Cursor, Read, Seek};
use std::path::Path;
use std::sync::Arc;

/// Largest accepted number of pixels per byte of an image file, beyond [`FREE_PIXELS`].
const PIXELS_PER_BYTE: u64 = 200;

/// Number of pixels that are accepted for image files of any length; uniform images compress without limit.
const FREE_PIXELS: u64 = 1 << 23;

/// Memory that a decoder may allocate in addition to the pixels, bytes.
const DECODER_BYTES: u64 = 1 << 26;

/// Memory that a decoder may allocate for the header of an image, such as a compressed colour profile, bytes.
const HEADER_BYTES: u64 = 1 << 24;

const EXPECTED: &str = "a complete PNG, JPEG, PGM or PPM image";

/// An image file whose header was read.
pub(super) struct Opened {
    decoder: Box<dyn ImageDecoder>,
    /// Bytes of the file if it is a JPEG image.
    jpeg_bytes: Option<Arc<[u8]>>,
    /// Largest sample of a PNM image, as its header states it.
    maxval: Option<u32>,
    orientation: image::metadata::Orientation,
    format: Format,
    size: [u32; 2],
}

impl Opened {
    /// Returns the columns and rows of the image after its rotation to upright.
    pub fn size(&self) -> [u32; 2] {
        let [width, height] = self.size;
        let turned = self.orientation.to_exif() >= 5;
        if turned { [height, width] } else { [width, height] }
    }

    /// Returns the memory of the decoded samples of the image, bytes.
    pub fn bytes(&self) -> u64 {
        let sample = if self.format == Format::Rgb48 { 2 } else { 1 };
        3 * sample * u64::from(self.size[0]) * u64::from(self.size[1])
    }
}

/// Reads the header of the image file at `path`; the format follows from the contents, not from the file name.
pub(super) fn open(path: &Path, limits: &ReadLimits) -> Result<Opened, RecordedError> {
    let refused = |found: &dyn std::fmt::Display| RecordedError::new(path, found, EXPECTED);
    let file = File::open(path).map_err(|e| refused(&e))?;
    let length = file.metadata().map_err(|e| refused(&e))?.len();
    let mut file = BufReader::new(file);
    let begin = file.fill_buf().map_err(|e| refused(&e))?;
    let kind = image::guess_format(begin).ok();
    let maxval = if kind == Some(ImageFormat::Pnm) { maxval(begin) } else { None };
    let mut jpeg_bytes = None;
    let mut decoder = match kind {
        Some(ImageFormat::Png | ImageFormat::Pnm) => decoder(file, kind),
        Some(ImageFormat::Jpeg) => {
            let bytes = jpeg_bytes.insert(whole_jpeg(path, file)?);
            decoder(Cursor::new(Arc::clone(bytes)), kind)
        }
        _ => return Err(refused(&other(begin, kind))),
    }
    .map_err(|e| refused(&e))?;
    let (width, height) = decoder.dimensions();
    limits.check(path, [width, height], length)?;
    let orientation = decoder.orientation().unwrap_or(image::metadata::Orientation::NoTransforms);
    let deep = decoder.color_type().bytes_per_pixel() / decoder.color_type().channel_count() > 1;
    let format = if deep { Format::Rgb48 } else { Format::Rgb24 };
    Ok(Opened { decoder, jpeg_bytes, maxval, orientation, format, size: [width, height] })
}

/// Creates a decoder whose memory in addition to the pixels of the image is limited.
fn decoder(
    input: impl BufRead + Seek + 'static,
    format: Option<ImageFormat>,
) -> image::ImageResult<Box<dyn ImageDecoder>> {
    let mut reader = ImageReader::new(input);
    if let Some(format) = format {
        reader.set_format(format);
    }
    let mut of_header = Limits::no_limits();
    of_header.max_alloc = Some(HEADER_BYTES);
    reader.limits(of_header);
    let mut decoder: Box<dyn ImageDecoder> = Box::new(reader.into_decoder()?);
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(decoder.total_bytes().saturating_add(DECODER_BYTES));
    decoder.set_limits(limits)?;
    Ok(decoder)
}

/// Reads a JPEG file and checks that it has an end marker; decoders fill missing parts with grey.
fn whole_jpeg(path: &Path, mut file: BufReader<File>) -> Result<Arc<[u8]>, RecordedError> {
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes).map_err(|e| RecordedError::new(path, e, EXPECTED))?;
    if jpeg::is_whole(&bytes) {
        return Ok(bytes.into());
    }
    Err(RecordedError::new(path, "a JPEG image that ends early", EXPECTED))
}

/// Decodes an image and rotates it to upright; grey is repeated in all channels, and PNM samples keep their codes.
pub(super) fn read(path: &Path, opened: Opened) -> Result<Image, RecordedError> {
    let refused = |found: &dyn std::fmt::Display| RecordedError::new(path, found, EXPECTED);
    let Opened { decoder, jpeg_bytes, maxval, orientation, format, .. } = opened;
    if jpeg_bytes.is_some_and(|bytes| !jpeg::is_sound(&bytes)) {
        return Err(refused(&"a JPEG image with damaged blocks"));
    }
    let mut image = DynamicImage::from_decoder(decoder).map_err(|e| refused(&e))?;
    image.apply_orientation(orientation);
    let (width, height) = (image.width(), image.height());
    let mut pixels = match format {
        Format::Rgb48 => Pixels::U16(image.into_rgb16().into_raw()),
        _ => Pixels::U8(image.into_rgb8().into_raw()),
    };
    if let Some(maxval) = maxval {
        unscale(&mut pixels, maxval);
    }
    let layout = Layout::tight(format, width, height).map_err(|e| refused(&e))?;
    Ok(Image { layout, pixels, white: maxval.map(f64::from) })
}

/// Converts samples that the decoder scaled to the whole range back to codes of 0 to `maxval`.
fn unscale(pixels: &mut Pixels, maxval: u32) {
    let code = |v: u32, most: u32| (v * maxval + most / 2) / most;
    match pixels {
        Pixels::U8(codes) => codes.iter_mut().for_each(|v| *v = code((*v).into(), 0xff) as u8),
        Pixels::U16(codes) => codes.iter_mut().for_each(|v| *v = code((*v).into(), 0xffff) as u16),
    }
}

/// Returns the largest sample that the header of a PGM, PPM or PAM image states.
fn maxval(begin: &[u8]) -> Option<u32> {
    let text = String::from_utf8_lossy(&begin[..begin.len().min(4096)]);
    let lines = text.lines().map(|line| line.split('#').next().unwrap_or_default());
    let mut words = lines.flat_map(str::split_whitespace);
    match words.next()? {
        "P2" | "P3" | "P5" | "P6" => words.nth(2)?.parse().ok(),
        "P7" => words.find(|word| *word == "MAXVAL").and_then(|_| words.next())?.parse().ok(),
        _ => None,
    }
    .filter(|maxval| (1..=0xffff).contains(maxval))
}

/// Returns the name of an image format that is not supported.
fn other(begin: &[u8], kind: Option<ImageFormat>) -> String {
    let raw = [
        "a raw picture or TIFF file (develop it to a linear 16-bit PNG: no raw reader has a permissive licence)",
        "a file of another type",
    ];
    let is_raw = [&b"II*\0"[..], b"MM\0*", b"FUJIFILM", b"IIU\0", b"IIRO"]
        .iter()
        .any(|magic| begin.starts_with(magic));
    let is_raw = is_raw || begin.get(4..11) == Some(b"ftypcrx");
    match kind {
        Some(ImageFormat::Tiff) | None if is_raw => raw[0].into(),
        Some(kind) => format!("a {kind:?} image"),
        None => raw[1].into(),
    }
}

impl ReadLimits {
    /// Checks the size of one image, whose file has `length` bytes, before memory is allocated for its pixels.
    fn check(&self, path: &Path, [width, height]: [u32; 2], length: u64) -> Result<(), RecordedError> {
        let pixels = u64::from(width) * u64::from(height);
        let by_length = length.saturating_mul(PIXELS_PER_BYTE).max(FREE_PIXELS);
        let most = self.max_pixels.unwrap_or(Self::MAX_PIXELS.min(by_length));
        if pixels <= most {
            return Ok(());
        }
        let found = format!("{width} x {height} pixels in a file of {length} bytes");
        Err(RecordedError::new(path, found, format!("at most {most} pixels")))
    }
}

/// Largest accepted number of bytes after the rows of a raw frame.
const MAX_TRAILER: u64 = 1 << 16;

/// Reads the file of one raw frame, in the packing of the driver.
pub(super) fn read_raw(path: &Path, layout: Layout) -> Result<Image, RecordedError> {
    let rows = layout.frame_bytes() as u64;
    let expected = format!("{rows} bytes of a raw frame");
    let refused = |found: &dyn std::fmt::Display| RecordedError::new(path, found, &expected);
    let file = File::open(path).map_err(|e| refused(&e))?;
    let most = rows + layout.bytes_per_line() as u64 + MAX_TRAILER;
    let mut bytes = Vec::new();
    file.take(most + 1).read_to_end(&mut bytes).map_err(|e| refused(&e))?;
    match bytes.len() as u64 {
        found if found < rows => Err(refused(&format!("{found} bytes"))),
        found if found > most => Err(refused(&format!("more than {most} bytes"))),
        _ => Ok(Image { layout, pixels: Pixels::U8(bytes), white: None }),
    }
}
