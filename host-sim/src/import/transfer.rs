//! The transfer function of a photograph.
//!
//! JPEG holds sRGB. Of PNG, cICP is believed, then sRGB, then gAMA of 1 (linear) and of 1/2.2 (sRGB); other values are refused. A PNG
//! that states nothing holds sRGB with 8 bits and linear samples with 16. PGM and PPM are linear, as raw converters write them.

use crate::error::SimError;
use std::io::Read;
use std::path::Path;

/// Most bytes of a PNG file up to its pixels that are searched for statements.
const MAX_HEADER: u64 = 1 << 20;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Transfer {
    Linear,
    Srgb,
}

impl Transfer {
    /// The model of a `[response]` table.
    pub fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Srgb => "srgb",
        }
    }
}

/// Reads the statement of a file.
pub(super) fn read(path: &Path) -> Result<Transfer, SimError> {
    let mut begin = Vec::new();
    let file = std::fs::File::open(path).and_then(|f| f.take(MAX_HEADER).read_to_end(&mut begin));
    file.map_err(|e| SimError::at(path, e, "a photograph that can be read"))?;
    match begin.as_slice() {
        [0x89, b'P', b'N', b'G', ..] => of_png(path, &begin),
        [b'P', b'2'..=b'7', ..] => Ok(Transfer::Linear),
        _ => Ok(Transfer::Srgb),
    }
}

fn of_png(path: &Path, begin: &[u8]) -> Result<Transfer, SimError> {
    let refused = |found: String| {
        SimError::at(path, found, "linear or sRGB samples (or a [response] table in the lens file)")
    };
    let mut stated = None;
    for chunk in chunks(begin) {
        match (&chunk.kind, chunk.data) {
            (b"cICP", [_, 8, ..]) => return Ok(Transfer::Linear),
            (b"cICP", [_, 13, ..]) => return Ok(Transfer::Srgb),
            (b"cICP", [_, other, ..]) => {
                return Err(refused(format!("cICP with the transfer function {other}")));
            }
            (b"sRGB", _) => stated = Some(Transfer::Srgb),
            (b"gAMA", [a, b, c, d]) if stated.is_none() => {
                stated = Some(match u32::from_be_bytes([*a, *b, *c, *d]) {
                    100_000 => Transfer::Linear,
                    45_000..=46_000 => Transfer::Srgb,
                    other => return Err(refused(format!("gAMA {other}"))),
                });
            }
            _ => {}
        }
    }
    let is_deep = begin.get(24).is_some_and(|bits| *bits == 16);
    Ok(stated.unwrap_or(if is_deep { Transfer::Linear } else { Transfer::Srgb }))
}

struct Chunk<'a> {
    kind: [u8; 4],
    data: &'a [u8],
}

/// The chunks of a PNG file before its pixels.
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
