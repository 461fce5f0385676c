//! The header of a Radiance picture: lines of text, an empty line, and the resolution line.

use super::super::{Covers, Refusal};
use super::scanlines::{Axis, Resolution};
use std::io::{BufRead, Read};

/// Longest accepted line of a header, bytes.
const MAX_LINE: u64 = 4096;

/// Largest accepted number of lines of a header.
const MAX_LINES: usize = 4096;

const EXPECTED: &str =
    "a Radiance HDR picture: #?RADIANCE, header lines, an empty line, -Y rows +X columns, scanlines";

/// The values of a Radiance header that change radiance or direction.
#[derive(Debug)]
pub(super) struct Header {
    /// Product of the values of all EXPOSURE lines.
    exposure: f64,
    /// Products of the values of all COLORCORR lines, for red, green and blue.
    correction: [f64; 3],
    /// True if texels are CIE XYZ, false if they are RGB.
    pub is_xyz: bool,
    /// CIE (x, y) of the red, green and blue primaries and of white; `None` where the header states none.
    pub primaries: Option<[[f64; 2]; 4]>,
    /// Value of a VIEW line that states another projection than latitude-longitude; `None` without such a line.
    pub view: Option<String>,
    pub covers: Option<Covers>,
    pub resolution: Resolution,
}

impl Header {
    /// Returns the factors from stored values to radiance, for red, green and blue.
    pub fn factors(&self) -> [f32; 3] {
        self.correction.map(|c| (1.0 / (self.exposure * c)) as f32)
    }
}

/// Reads the header of a Radiance picture, up to the first scanline.
pub(super) fn read(reader: &mut impl BufRead) -> Result<Header, Refusal> {
    // The first line is the name of the writing program: files with RADIANCE, RGBE and other names have the same format.
    line(reader)?;
    let mut header = Header {
        exposure: 1.0,
        correction: [1.0; 3],
        is_xyz: false,
        primaries: None,
        view: None,
        covers: None,
        resolution: Resolution { major: Axis::DOWN, minor: Axis::RIGHT },
    };
    for _ in 0..MAX_LINES {
        let text = line(reader)?;
        if text.is_empty() {
            header.resolution = resolution(&line(reader)?)?;
            return Ok(header);
        }
        header.apply(&text)?;
    }
    Err(Refusal::new(format!("more than {MAX_LINES} header lines"), EXPECTED))
}

impl Header {
    /// Applies one line of the header; lines that begin with white space are the history of the picture and are ignored.
    fn apply(&mut self, text: &str) -> Result<(), Refusal> {
        let Some((name, value)) = text.split_once('=') else { return Ok(()) };
        match name {
            "FORMAT" => self.format(value.trim())?,
            "EXPOSURE" => {
                let [exposure] = numbers(text, value)?;
                self.exposure = product(self.exposure, exposure, text)?;
            }
            "COLORCORR" => {
                let correction: [f64; 3] = numbers(text, value)?;
                for (all, one) in self.correction.iter_mut().zip(correction) {
                    *all = product(*all, one, text)?;
                }
            }
            "PRIMARIES" => {
                let [a, b, c, d, e, f, g, h] = numbers(text, value)?;
                self.primaries = Some([[a, b], [c, d], [e, f], [g, h]]);
            }
            // GAMMA is not defined by Radiance, but other programs write it: the stored values are radiance to the power of 1/GAMMA.
            "GAMMA" => {
                let [gamma]: [f64; 1] = numbers(text, value)?;
                if gamma != 1.0 {
                    return Err(Refusal::new(text, "linear values, GAMMA=1"));
                }
            }
            "VIEW" if is_projection(value) => self.view = Some(value.trim().into()),
            "HEMILUX_COVERS" => {
                let expected = "HEMILUX_COVERS=sphere or hemisphere";
                let covers = Covers::from_name(value.trim());
                self.covers = Some(covers.ok_or_else(|| Refusal::new(text, expected))?);
            }
            _ => {}
        }
        Ok(())
    }

    fn format(&mut self, value: &str) -> Result<(), Refusal> {
        self.is_xyz = match value {
            "32-bit_rle_rgbe" => false,
            "32-bit_rle_xyze" => true,
            other => {
                let expected = "FORMAT=32-bit_rle_rgbe or 32-bit_rle_xyze";
                return Err(Refusal::new(format!("FORMAT={other}"), expected));
            }
        };
        Ok(())
    }
}

/// Returns true if the value of a VIEW line states a type, a direction or an angle; a position alone has no effect on directions.
fn is_projection(value: &str) -> bool {
    let flags = value.split_whitespace().filter_map(|word| word.strip_prefix("-v"));
    flags
        .into_iter()
        .any(|flag| matches!(flag.bytes().next(), Some(b't' | b'd' | b'u' | b'h' | b'v' | b's' | b'l')))
}

/// Returns `all` times `one`; a factor `one` of zero, by which programs mark an unknown value, is ignored.
fn product(all: f64, one: f64, text: &str) -> Result<f64, Refusal> {
    let product = if one == 0.0 { all } else { all * one };
    let usable = one >= 0.0 && (1e-30..1e30).contains(&product);
    if usable {
        Ok(product)
    } else {
        Err(Refusal::new(text, "factors of at least 0 whose product is finite"))
    }
}

fn numbers<const N: usize>(text: &str, value: &str) -> Result<[f64; N], Refusal> {
    let parsed: Result<Vec<f64>, _> = value.split_whitespace().map(str::parse).collect();
    let numbers = parsed.ok().and_then(|v| <[f64; N]>::try_from(v).ok());
    numbers.ok_or_else(|| Refusal::new(text, format!("{N} numbers")))
}

/// Reads one line of the header without its end, LF or CR LF.
fn line(reader: &mut impl BufRead) -> Result<String, Refusal> {
    let mut bytes = Vec::new();
    let read = reader.by_ref().take(MAX_LINE).read_until(b'\n', &mut bytes);
    read.map_err(|e| Refusal::new(e, EXPECTED))?;
    if bytes.pop() != Some(b'\n') {
        return Err(Refusal::new("a header that does not end", EXPECTED));
    }
    bytes.pop_if(|last| *last == b'\r');
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// Parses the resolution line of a picture, such as `-Y 256 +X 512`.
fn resolution(text: &str) -> Result<Resolution, Refusal> {
    let refused = || Refusal::new(format!("the resolution line {text:?}"), "a line such as -Y 256 +X 512");
    let words: Vec<&str> = text.split_whitespace().collect();
    let [major, rows, minor, columns] = words[..] else { return Err(refused()) };
    let axis = |name: &str, count: &str| {
        let (sign, letter) = name.split_at_checked(1)?;
        let count = count.parse::<u32>().ok()?;
        let is_positive = ["-", "+"].iter().position(|s| *s == sign)? == 1;
        Some(Axis { is_x: ["Y", "X"].iter().position(|l| *l == letter)? == 1, is_positive, count })
    };
    match (axis(major, rows), axis(minor, columns)) {
        (Some(major), Some(minor)) if major.is_x != minor.is_x => Ok(Resolution { major, minor }),
        _ => Err(refused()),
    }
}
