//! Writers of the commands' output: bytes to standard output, pictures and maps to files.

use crate::error::SimError;
use hemilux::maps::{self, Covers};
use hemilux_core::healpix::Domain;
use hemilux_core::light::Light;
use hemilux_core::polar::LatLongView;
use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Paths of the pictures and maps that a command writes.
#[derive(Clone, Debug, Default)]
pub struct Files {
    /// Path of the PNG or JPEG picture of the tone-mapped map with its lights.
    pub picture: Option<PathBuf>,
    /// Path of the OpenEXR file of the map's radiance.
    pub map: Option<PathBuf>,
    /// Whether the map of a hemisphere is extended to a whole sphere, black below the horizon.
    pub whole_maps: bool,
}

impl Files {
    /// Returns the path that a light set in the map's folder contains for the map: `./NAME.exr`; `None` if no map is written.
    #[must_use]
    pub fn map_name(&self) -> Option<PathBuf> {
        self.map.as_ref().and_then(|path| Some(Path::new(".").join(path.file_name()?)))
    }

    /// Writes the picture and the map whose paths are set; the files of frame `index` of a sequence have numbered names.
    ///
    /// `radiance` is the radiance of each texel of `map`, row by row, if a file contained it; the OpenEXR file then has these values. Otherwise
    /// each texel's energy is divided by the texel's solid angle.
    ///
    /// # Errors
    /// [`SimError`] with the path of the file that cannot be written.
    pub fn write(
        &self,
        index: Option<usize>,
        map: &LatLongView<'_>,
        radiance: Option<&[[f32; 3]]>,
        lights: &[Light],
    ) -> Result<(), SimError> {
        if let Some(path) = &self.picture {
            let path = numbered(path, index);
            save_picture(&path, &hemilux::picture::draw(map, lights))?;
        }
        if let Some(path) = &self.map {
            save_exr(&numbered(path, index), map, radiance, self.whole_maps)?;
        }
        Ok(())
    }
}

/// Returns `name-0003.png` for `name.png` and frame 3 of a sequence.
fn numbered(path: &Path, index: Option<usize>) -> PathBuf {
    let Some(index) = index else { return path.into() };
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let extension = path.extension().map(|e| format!(".{}", e.to_string_lossy())).unwrap_or_default();
    path.with_file_name(format!("{stem}-{index:04}{extension}"))
}

/// Quality of written JPEG pictures, 1 to 100.
const JPEG_QUALITY: u8 = 92;

/// Parses the path of a picture: `.png`, `.jpg` or `.jpeg`, in upper or lower case.
///
/// # Errors
/// An error message with the expected extensions, if `text` has another extension.
pub fn picture_path(text: &str) -> Result<PathBuf, String> {
    with_extension(text, &["png", "jpg", "jpeg"])
}

/// Parses the path of an OpenEXR map: `.exr`, in upper or lower case.
///
/// # Errors
/// An error message with the expected extension, if `text` has another extension.
pub fn map_path(text: &str) -> Result<PathBuf, String> {
    with_extension(text, &["exr"])
}

fn with_extension(text: &str, known: &[&str]) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    let found = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let expected = known.iter().map(|e| format!(".{e}")).collect::<Vec<_>>().join(" or ");
    if known.contains(&found.as_str()) {
        Ok(path)
    } else {
        Err(format!("expected a name that ends in {expected}"))
    }
}

/// Writes `picture` to `path` as PNG if its extension is `png`, and as JPEG otherwise.
///
/// # Errors
/// [`SimError`] with the path if the picture cannot be encoded or written.
pub fn save_picture(path: &Path, picture: &RgbImage) -> Result<(), SimError> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    let is_png = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png"));
    let written = if is_png {
        picture.write_to(&mut bytes, image::ImageFormat::Png)
    } else {
        picture.write_with_encoder(JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY))
    };
    written.map_err(|e| SimError::at(path, e, "a picture that the format can hold"))?;
    save(path, bytes.get_ref())
}

/// Writes `bytes` to standard output; a closed pipe is not an error.
///
/// # Errors
/// [`SimError`] if the bytes cannot be written.
pub fn say(bytes: &[u8]) -> Result<(), SimError> {
    let mut out = std::io::stdout().lock();
    match out.write_all(bytes).and_then(|()| out.flush()) {
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => Err(SimError::Failed(format!(
            "standard output: found {e}, expected a stream that can be written"
        ))),
        _ => Ok(()),
    }
}

/// Writes `bytes` to the file `path` and replaces its earlier contents.
///
/// # Errors
/// [`SimError`] with the path if the file cannot be written.
pub fn save(path: &Path, bytes: &[u8]) -> Result<(), SimError> {
    std::fs::write(path, bytes).map_err(|e| SimError::at(path, e, "a file that can be written"))
}

/// Writes radiance as OpenEXR of 32-bit floats, with an attribute for the covered part of the sphere; with `whole`, black rows extend a hemisphere.
fn save_exr(
    path: &Path,
    map: &LatLongView<'_>,
    read: Option<&[[f32; 3]]>,
    whole: bool,
) -> Result<(), SimError> {
    let grid = map.grid;
    let (covers, height) = match grid.domain {
        Domain::Sphere => (Covers::Sphere, grid.height),
        Domain::Hemisphere if whole => (Covers::Sphere, 2 * grid.height),
        Domain::Hemisphere => (Covers::Hemisphere, grid.height),
    };
    let radiance = |row: usize, column: usize| {
        if row >= grid.height {
            return [0.0; 3];
        }
        let at = row * grid.width + column;
        let measured = || map.texels[at].map(|v| (f64::from(v) / grid.solid_angle(row)) as f32);
        read.map_or_else(measured, |read| read[at])
    };
    let bytes = maps::write::openexr(grid.width, height, covers, radiance);
    save(path, &bytes.map_err(|e| SimError::at(path, e, "a map that OpenEXR can hold"))?)
}
