//! Reader of the transfer function of a photograph, which must have the primaries of Rec. 709.
//!
//! In PNG files, cICP has precedence, then the ICC profile, then sRGB, then cHRM with gAMA of 1 (linear) or 1/2.2 (sRGB); in JPEG files, the ICC
//! profile is read. Other primaries and transfer functions are refused. Files that state no colour space are read as sRGB (JPEG, PNG of 8 bits)
//! or as linear (PNG of 16 bits, PGM, PPM), as raw converters write them.

use super::function::Transfer;
use super::profile;
use crate::error::SimError;
use image::{ImageDecoder, ImageReader, Limits};
use std::io::Read;
use std::path::Path;

/// Size of the part of a PNG file in which chunks in front of the pixels are searched, bytes.
const MAX_HEADER: u64 = 1 << 20;

/// Largest size of the memory for a decompressed colour profile, bytes.
const PROFILE_BYTES: u64 = 1 << 24;

/// The expected value in error messages about a colour space.
pub(super) const EXPECTED: &str = "linear or sRGB samples with the primaries of Rec. 709 (convert the photographs to sRGB, or use --ignore-profile)";

/// Returns the transfer function that a file states; with `ignores_profile`, the usual function of the file's format.
pub(super) fn read(path: &Path, ignores_profile: bool) -> Result<Transfer, SimError> {
    let mut begin = Vec::new();
    let file = std::fs::File::open(path).and_then(|f| f.take(MAX_HEADER).read_to_end(&mut begin));
    file.map_err(|e| SimError::at(path, e, "a photograph that can be read"))?;
    let is_png = begin.starts_with(b"\x89PNG");
    let usual = match begin.as_slice() {
        [b'P', b'2'..=b'7', ..] => Transfer::Linear,
        // The bit depth is in the image header.
        _ if is_png && begin.get(24) == Some(&16) => Transfer::Linear,
        _ => Transfer::Srgb,
    };
    if ignores_profile {
        return Ok(usual);
    }
    let stated = if is_png { of_png(path, &begin) } else { of_profile(path) };
    Ok(stated.map_err(|found| SimError::at(path, found, EXPECTED))?.unwrap_or(usual))
}

/// Returns the transfer function of a file's ICC profile; `None` without a profile.
fn of_profile(path: &Path) -> Result<Option<Transfer>, String> {
    let mut limits = Limits::default();
    limits.max_alloc = Some(PROFILE_BYTES);
    let decoder = ImageReader::open(path).ok().and_then(|reader| {
        let mut reader = reader.with_guessed_format().ok()?;
        reader.limits(limits);
        reader.into_decoder().ok()
    });
    // A file that cannot be decoded is refused later, when its pixels are read.
    let icc = decoder.and_then(|mut decoder| decoder.icc_profile().ok().flatten());
    icc.map(|icc| profile::transfer(&icc)).transpose()
}

/// Returns the transfer function that the chunks of a PNG file state; `None` if they state none.
fn of_png(path: &Path, begin: &[u8]) -> Result<Option<Transfer>, String> {
    let find = |kind: &[u8; 4]| chunks(begin).find(|c| c.kind == *kind).map(|c| c.data);
    match find(b"cICP") {
        Some([1, 8, 0, 1]) => return Ok(Some(Transfer::Linear)),
        Some([1, 13, 0, 1]) => return Ok(Some(Transfer::Srgb)),
        Some(other) => {
            return Err(format!("cICP {other:?} (primaries, transfer function, matrix and full range)"));
        }
        None => {}
    }
    if find(b"iCCP").is_some() {
        return of_profile(path);
    }
    if find(b"sRGB").is_some() {
        return Ok(Some(Transfer::Srgb));
    }
    if let Some(chromaticities) = find(b"cHRM").filter(|c| !is_rec_709(c)) {
        return Err(format!("cHRM with the chromaticities {:?}", hundred_thousandths(chromaticities)));
    }
    match find(b"gAMA").map(hundred_thousandths).as_deref() {
        None => Ok(None),
        Some([100_000]) => Ok(Some(Transfer::Linear)),
        Some([45_000..=46_000]) => Ok(Some(Transfer::Srgb)),
        Some(other) => Err(format!("gAMA {other:?}")),
    }
}

/// Returns whether the data of a cHRM chunk are the white point and the primaries of Rec. 709.
fn is_rec_709(chromaticities: &[u8]) -> bool {
    const REC_709: [u32; 8] = [31_270, 32_900, 64_000, 33_000, 30_000, 60_000, 15_000, 6_000];
    let found = hundred_thousandths(chromaticities);
    found.len() == REC_709.len() && found.iter().zip(REC_709).all(|(a, b)| a.abs_diff(b) <= 100)
}

/// Returns the numbers of a gAMA or cHRM chunk, in units of 1/100,000.
fn hundred_thousandths(data: &[u8]) -> Vec<u32> {
    data.as_chunks().0.iter().map(|bytes| u32::from_be_bytes(*bytes)).collect()
}

struct Chunk<'a> {
    kind: [u8; 4],
    data: &'a [u8],
}

/// Returns the chunks of a PNG file in front of its pixels.
fn chunks(bytes: &[u8]) -> impl Iterator<Item = Chunk<'_>> {
    let mut rest = bytes.get(8..).unwrap_or_default();
    std::iter::from_fn(move || {
        let (length, after) = rest.split_first_chunk::<4>()?;
        let (kind, after) = after.split_first_chunk::<4>()?;
        let length = usize::try_from(u32::from_be_bytes(*length)).ok()?;
        let data = after.get(..length)?;
        rest = after.get(length + 4..)?;
        (kind != b"IDAT").then_some(Chunk { kind: *kind, data })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the CRC-32 of a PNG chunk.
    fn crc(bytes: &[u8]) -> u32 {
        let step = |crc: u32, bit: u32| if crc & 1 == bit { crc >> 1 } else { crc >> 1 ^ 0xedb8_8320 };
        !bytes.iter().fold(!0, |crc, byte| (0..8).fold(crc ^ u32::from(*byte), |crc, _| step(crc, 0)))
    }

    /// Returns a PNG file of 8 or, with `deep`, 16 bits, with `chunks` after its header.
    fn png(deep: bool, chunks: &[(&[u8; 4], &[u8])]) -> tempfile::NamedTempFile {
        let mut bytes = std::io::Cursor::new(Vec::new());
        let image = image::DynamicImage::new(
            4,
            4,
            if deep { image::ColorType::Rgb16 } else { image::ColorType::Rgb8 },
        );
        image.write_to(&mut bytes, image::ImageFormat::Png).expect("a PNG file");
        let bytes = bytes.into_inner();
        let (header, rest) = bytes.split_at(8 + 25);
        let chunks = chunks.iter().flat_map(|(kind, data)| {
            let body = [kind.as_slice(), data].concat();
            [&(data.len() as u32).to_be_bytes(), body.as_slice(), &crc(&body).to_be_bytes()].concat()
        });
        let file = tempfile::NamedTempFile::new().expect("a file");
        std::fs::write(&file, [header, &chunks.collect::<Vec<_>>(), rest].concat()).expect("a file");
        file
    }

    fn found(deep: bool, chunks: &[(&[u8; 4], &[u8])]) -> Result<Transfer, String> {
        read(png(deep, chunks).path(), false).map_err(|e| e.to_string())
    }

    /// Returns the data of a gAMA or cHRM chunk with these numbers.
    fn values(values: &[u32]) -> Vec<u8> {
        values.iter().flat_map(|v| v.to_be_bytes()).collect()
    }

    #[test]
    fn png_chunks_state_the_transfer_function_in_order_of_precedence() {
        let linear = values(&[100_000]);
        for (deep, chunks, expected) in [
            (false, vec![], Transfer::Srgb),
            (true, vec![], Transfer::Linear),
            (true, vec![(b"gAMA", &values(&[45_455])[..])], Transfer::Srgb),
            (false, vec![(b"gAMA", &linear[..])], Transfer::Linear),
            (false, vec![(b"gAMA", &linear[..]), (b"sRGB", &[0])], Transfer::Srgb),
            (false, vec![(b"cICP", &[1, 8, 0, 1]), (b"sRGB", &[0])], Transfer::Linear),
            (true, vec![(b"gAMA", &linear[..]), (b"cICP", &[1, 13, 0, 1])], Transfer::Srgb),
        ] {
            let result = found(deep, &chunks);
            assert!(result.as_ref().is_ok_and(|found| *found == expected), "{chunks:?}: {result:?}");
        }
    }

    #[test]
    fn png_chunks_of_other_colour_spaces_are_refused_by_name() {
        let p3 = values(&[31_270, 32_900, 68_000, 32_000, 26_500, 69_000, 15_000, 6_000]);
        for (chunk, part) in [
            ((b"cICP", &[12, 13, 0, 1][..]), "cICP [12, 13, 0, 1]"),
            ((b"cICP", &[9, 16, 0, 1]), "cICP [9, 16, 0, 1]"),
            // Narrow range: black is 16, white is 235.
            ((b"cICP", &[1, 13, 0, 0]), "cICP [1, 13, 0, 0]"),
            ((b"gAMA", &values(&[55_556])), "gAMA [55556]"),
            ((b"cHRM", &p3), "cHRM with the chromaticities"),
        ] {
            let error = found(false, &[chunk]).expect_err("another colour space");
            assert!(error.contains(part) && error.lines().count() == 1, "{part}: {error}");
        }
    }
}
