//! Portable float maps (PFM): `PF` or `Pf`, size, byte order, then rows of 32-bit floats from the bottom.

use super::limit::Budget;
use super::{DecodedFile, Refusal, Stated};
use std::io::{BufRead, Read};

const EXPECTED: &str = "a PFM file: PF or Pf, columns, rows, 1.0 or -1.0, then 32-bit floats";

pub(super) fn is(begin: &[u8]) -> bool {
    matches!(begin, [b'P', b'F' | b'f', b' ' | b'\n' | b'\r' | b'\t', ..])
}

pub(super) fn read(reader: impl BufRead, budget: &Budget) -> Result<DecodedFile, Refusal> {
    let mut reader = Counted { reader, bytes: 0 };
    let grey = word(&mut reader)? == "Pf";
    let mut number = || -> Result<u64, Refusal> {
        let text = word(&mut reader)?;
        text.parse::<u32>().map(u64::from).map_err(|_| Refusal::new(format!("the size {text:?}"), EXPECTED))
    };
    let (width, height) = (number()?, number()?);
    let scale = word(&mut reader)?;
    let little = match scale.parse::<f32>() {
        Ok(-1.0) => true,
        Ok(1.0) => false,
        _ => return Err(Refusal::new(format!("the scale {scale:?}"), EXPECTED)),
    };
    let mut raster = budget.raster(width, height)?;
    let samples = if grey { 1 } else { 3 };
    let mut row = Vec::new();
    let line = raster.width as u64 * samples as u64 * 4;
    let rest = budget.bytes.saturating_sub(reader.bytes).saturating_sub(line * height);
    let mut reader = reader.reader;
    skip_blanks(&mut reader, rest)?;
    for y in 0..raster.height {
        row.clear();
        reader.by_ref().take(line).read_to_end(&mut row).map_err(|e| Refusal::new(e, EXPECTED))?;
        if row.len() as u64 != line {
            return Err(Refusal::new(format!("a PFM file that ends in row {y}"), format!("{height} rows")));
        }
        let values = row
            .as_chunks::<4>()
            .0
            .iter()
            .map(|b| if little { f32::from_le_bytes(*b) } else { f32::from_be_bytes(*b) });
        let values: Vec<f32> = values.collect();
        let texels = values.chunks_exact(samples).map(|v| [v[0], v[samples / 2], v[samples - 1]]);
        raster.row_mut(height as usize - 1 - y).iter_mut().zip(texels).for_each(|(to, texel)| *to = texel);
    }
    Ok(DecodedFile { raster, stated: Stated::default() })
}

/// A reader that counts the bytes of the header of a portable float map.
struct Counted<R> {
    reader: R,
    bytes: u64,
}

/// Skips the second byte of a line end, and blanks before it, between the scale and the samples. The samples are the last `rest` bytes of the
/// file, so that no byte of a sample is skipped.
fn skip_blanks(reader: &mut impl BufRead, rest: u64) -> Result<(), Refusal> {
    for _ in 0..rest.min(64) {
        let next = reader.fill_buf().map_err(|e| Refusal::new(e, EXPECTED))?;
        if !next.first().is_some_and(u8::is_ascii_whitespace) {
            break;
        }
        reader.consume(1);
    }
    Ok(())
}

/// Returns the next word of the header, up to a white-space byte, which is consumed.
fn word(reader: &mut Counted<impl BufRead>) -> Result<String, Refusal> {
    let mut text = String::new();
    for byte in reader.reader.by_ref().take(64).bytes() {
        let byte = byte.map_err(|e| Refusal::new(e, EXPECTED))?;
        reader.bytes += 1;
        if !byte.is_ascii_whitespace() {
            text.push(byte as char);
        } else if !text.is_empty() {
            return Ok(text);
        }
    }
    Err(Refusal::new("a PFM header that does not end", EXPECTED))
}
