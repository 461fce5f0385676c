//! Environment maps in files: OpenEXR, Radiance HDR and PFM, decoded to linear Rec. 709 radiance on a latitude-longitude grid.
//!
//! Every header field that changes radiance or direction is applied, or a [`MapError`] names it. Sizes are checked against
//! [`ReadOptions::max_pixels`] and the file's length before texels are stored. Section "Environment maps" of `board/FORMATS.md` lists the fields.

mod limit;
pub mod openexr;
mod pfm;
mod primaries;
mod projection;
pub mod radiance;
mod range;
#[cfg(test)]
mod tests;
pub mod write;

pub use projection::Projection;
pub use range::{Changed, FLOAT_MAX, HALF_MAX, limit as limit_range};

use std::fmt::Display;
use std::io::{BufRead, BufReader, Seek};
use std::path::{Path, PathBuf};

/// Default limit on the number of texels of a map: 16384 x 8192.
pub const MAX_PIXELS: u64 = 1 << 27;

/// The part of the sphere that a map covers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Covers {
    /// All directions: theta from 0 in the first row to pi in the last.
    Sphere,
    /// The upper half: theta from 0 in the first row to pi / 2 in the last.
    Hemisphere,
}

impl Covers {
    /// Returns the name of the covered part in the OpenEXR attribute and in the Radiance header line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Sphere => "sphere",
            Self::Hemisphere => "hemisphere",
        }
    }

    fn from_name(name: &str) -> Option<Self> {
        [Self::Sphere, Self::Hemisphere].into_iter().find(|c| c.name() == name)
    }
}

/// Options for reading a map file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ReadOptions {
    /// Largest accepted number of texels; `None` for [`MAX_PIXELS`] and a limit by the file's length.
    pub max_pixels: Option<u64>,
    /// Name of the layer of an OpenEXR file that is read, such as `ViewLayer.Combined`.
    pub layer: Option<String>,
    /// The projection of the map, which overrides the file's statement; `None` to use the statement.
    pub projection: Option<Projection>,
    /// The part of the sphere that the map covers, which overrides the file's statement; `None` to use the statement.
    pub covers: Option<Covers>,
}

/// A map file, decoded to radiance on a latitude-longitude grid.
#[derive(Clone, Debug, PartialEq)]
pub struct DecodedMap {
    /// Number of columns; azimuth pi at the left edge of the first column, -pi at the right edge of the last.
    pub width: usize,
    /// Number of rows of the map.
    pub height: usize,
    /// Radiance of the texels in linear Rec. 709, row after row from the zenith; every value is finite and at least 0.
    pub texels: Vec<[f32; 3]>,
    /// The part of the sphere that the rows cover.
    pub covers: Covers,
    /// Notes about the file for the user, such as a conversion of primaries.
    pub notes: Vec<String>,
    /// Number of texels that were changed because a channel was negative or not a number.
    pub negative: usize,
    /// Number of texels of each row that had a channel above the limit.
    pub clipped: Vec<u32>,
}

/// An error in a map file: one line with the file, the value that was found and the value that was expected.
#[derive(Debug, thiserror::Error)]
#[error("{path}: found {found}, expected {expected}")]
pub struct MapError {
    /// Path of the map file.
    pub path: PathBuf,
    /// Description of the value that the file contains.
    pub found: String,
    /// Description of the values that were expected in its place.
    pub expected: String,
}

/// A fault of a map file: the value that was found and the value that was expected.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// Description of the value that the file contains.
    pub found: String,
    /// Description of the values that were expected in its place.
    pub expected: String,
}

impl Refusal {
    pub(crate) fn new(found: impl Display, expected: impl Display) -> Self {
        let one_line = |v: String| {
            let line: Vec<_> = v.split_whitespace().collect();
            line.join(" ").chars().filter(|c| !c.is_control()).take(400).collect()
        };
        Self { found: one_line(found.to_string()), expected: one_line(expected.to_string()) }
    }
}

const EXPECTED: &str = "a latitude-longitude OpenEXR, Radiance HDR or PFM map";

/// The texels of a map file in the order of rows, before projection and limits.
struct Raster {
    width: usize,
    height: usize,
    texels: Vec<[f32; 3]>,
}

/// Properties of a map that the headers of all formats can state.
#[derive(Default)]
struct Stated {
    covers: Option<Covers>,
    projection: Option<Projection>,
    /// True if the file's channels are half floats.
    half: bool,
    /// The matrix from the file's primaries to linear Rec. 709, which is applied after the replacement of infinities.
    to_rec_709: Option<[[f32; 3]; 3]>,
    notes: Vec<String>,
}

/// The texels of a file and the properties that its header states.
struct DecodedFile {
    raster: Raster,
    stated: Stated,
}

/// Reads the map file at `path`.
///
/// # Errors
/// [`MapError`] for a file that cannot be read, has another format, has an unsupported property, or is too large.
pub fn read(path: &Path, options: &ReadOptions) -> Result<DecodedMap, MapError> {
    let at = |r: Refusal| MapError { path: path.into(), found: r.found, expected: r.expected };
    let io = |e: std::io::Error| at(Refusal::new(e, "a latitude-longitude map that can be read"));
    let file = std::fs::File::open(path).map_err(io)?;
    let bytes = file.metadata().map_err(io)?.len();
    read_from(BufReader::new(file), bytes, options).map_err(at)
}

/// Reads a map from `reader`, whose length is `bytes` bytes.
///
/// # Errors
/// [`Refusal`] for another format, an unsupported property, or a map that is too large.
pub fn read_from<R: BufRead + Seek>(
    mut reader: R,
    bytes: u64,
    options: &ReadOptions,
) -> Result<DecodedMap, Refusal> {
    let begin = reader.fill_buf().map_err(|e| Refusal::new(e, EXPECTED))?;
    let begin = begin[..begin.len().min(12)].to_vec();
    let budget = limit::Budget::new(bytes, options.max_pixels);
    if options.layer.is_some() && !openexr::is(&begin) {
        return Err(Refusal::new("a file format without layers", "no --layer"));
    }
    let DecodedFile { raster, stated } = if openexr::is(&begin) {
        openexr::read(reader, &budget, options)?
    } else if radiance::is(&begin) {
        radiance::read(reader, &budget, options)?
    } else if pfm::is(&begin) {
        pfm::read(reader, &budget)?
    } else {
        return Err(Refusal::new(other(&begin), EXPECTED));
    };
    finish(raster, stated, options)
}

/// Applies projection, limits and coverage to the texels of a file.
fn finish(mut raster: Raster, stated: Stated, options: &ReadOptions) -> Result<DecodedMap, Refusal> {
    let Stated { covers, projection, half, to_rec_709, mut notes } = stated;
    let range = match &to_rec_709 {
        None => range::limit(&mut raster.texels, raster.width, half),
        Some(matrix) => {
            let infinite = range::limit_infinities(&mut raster.texels, raster.width);
            primaries::convert(&mut raster.texels, matrix);
            // The components of a half-float colour can be larger in Rec. 709 than in the file's primaries.
            infinite.with(range::limit(&mut raster.texels, raster.width, false))
        }
    };
    let projection = options.projection.or(projection).unwrap_or(Projection::LatLong);
    let (width, height) = (raster.width, raster.height);
    let raster = projection::to_lat_long(raster, projection)?;
    let four_to_one = projection == Projection::LatLong && width == 4 * height;
    let covers = match options.covers {
        // If the upper half of a whole map is requested, the texels still cover the sphere at this point.
        Some(Covers::Hemisphere) if covers != Some(Covers::Hemisphere) && !four_to_one => Covers::Sphere,
        Some(covers) => covers,
        None => covers.unwrap_or(Covers::Sphere),
    };
    let wide = match covers {
        Covers::Sphere => 2,
        Covers::Hemisphere => 4,
    };
    if projection == Projection::LatLong && width != wide * height && width > 2 {
        notes.push(shape_note(width, height, wide));
    }
    let Raster { width: columns, height: rows, texels } = raster;
    let clipped = match projection {
        Projection::LatLong => range.clipped,
        // Resampling mixes rows: each row of the result gets an equal share of the total.
        _ => {
            let all = range.clipped.iter().map(|n| *n as usize).sum::<usize>();
            vec![(all * columns).div_ceil(width * height) as u32; rows]
        }
    };
    let (width, height) = (columns, rows);
    Ok(DecodedMap { width, height, texels, covers, notes, negative: range.negative, clipped })
}

fn shape_note(width: usize, height: usize, wide: usize) -> String {
    let advice = match (width, height) {
        (w, h) if w == 4 * h => "; --hemisphere reads 4:1 as the upper half",
        (w, h) if w == h => "; --projection angular or mirror-ball reads a round map",
        (w, h) if 4 * w == 3 * h || 3 * w == 4 * h || 6 * w == h => "; --projection cube reads a cube map",
        _ => "",
    };
    format!(
        "{width} x {height} texels, a shape that is not {wide}:1, spread over the covered directions{advice}"
    )
}

/// Returns the name of the file format for known formats that are not maps, or the first bytes of an unknown one.
fn other(begin: &[u8]) -> String {
    let known: [(&[u8], &str); 11] = [
        (b"\x89PNG", "a PNG picture, which holds display colours"),
        (b"\xff\xd8\xff", "a JPEG picture, which holds display colours"),
        (b"II*\0", "a TIFF file"),
        (b"MM\0*", "a TIFF file"),
        (b"DDS ", "a DDS texture"),
        (b"\xabKTX", "a KTX texture"),
        (b"GIF8", "a GIF picture"),
        (b"BM", "a BMP picture"),
        (b"qoif", "a QOI picture"),
        (b"RIFF", "a RIFF file, such as WebP"),
        (b"8BPS", "a Photoshop file"),
    ];
    let name = known.iter().find(|(magic, _)| begin.starts_with(magic)).map(|(_, name)| *name);
    let bytes = &begin[..begin.len().min(4)];
    name.map_or_else(|| format!("a file that begins with {bytes:02x?}"), Into::into)
}
