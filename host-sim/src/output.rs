//! Output of the commands: light sets, pictures and maps.

use crate::error::SimError;
use hemilux::maps::{self, Covers};
use hemilux_core::healpix::Domain;
use hemilux_core::light::Light;
use hemilux_core::polar::LatLongView;
use std::path::{Path, PathBuf};

/// Paths of the pictures and maps that a command writes.
#[derive(Clone, Debug, Default)]
pub struct Files {
    /// Tone-mapped map with the lights.
    pub picture: Option<PathBuf>,
    /// The map as OpenEXR.
    pub map: Option<PathBuf>,
    /// Whether the map of a hemisphere is written as that of a whole sphere, black below the horizon.
    pub whole_maps: bool,
}

impl Files {
    /// The name by which a light set beside the map refers to it.
    #[must_use]
    pub fn map_name(&self) -> Option<PathBuf> {
        self.map.as_ref().and_then(|path| Some(Path::new(".").join(path.file_name()?)))
    }

    /// Writes the picture and the map whose paths are set; frame `index` of a sequence goes to a numbered file.
    ///
    /// # Errors
    /// [`SimError`] naming the file that could not be written.
    pub fn write(
        &self,
        index: Option<usize>,
        map: &LatLongView<'_>,
        lights: &[Light],
    ) -> Result<(), SimError> {
        if let Some(path) = &self.picture {
            let path = numbered(path, index);
            let picture = hemilux::picture::draw(map, lights);
            let mut bytes = std::io::Cursor::new(Vec::new());
            picture
                .write_to(&mut bytes, image::ImageFormat::Png)
                .map_err(|e| SimError::at(&path, e, "a picture"))?;
            save(&path, bytes.get_ref())?;
        }
        if let Some(path) = &self.map {
            save_exr(&numbered(path, index), map, self.whole_maps)?;
        }
        Ok(())
    }
}

/// `name.png` becomes `name-0003.png` for frame 3 of a sequence.
fn numbered(path: &Path, index: Option<usize>) -> PathBuf {
    let Some(index) = index else { return path.into() };
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let extension = path.extension().map(|e| format!(".{}", e.to_string_lossy())).unwrap_or_default();
    path.with_file_name(format!("{stem}-{index:04}{extension}"))
}

/// Writes `bytes` as the whole contents of a file.
///
/// # Errors
/// [`SimError`] naming the file.
pub fn save(path: &Path, bytes: &[u8]) -> Result<(), SimError> {
    std::fs::write(path, bytes).map_err(|e| SimError::at(path, e, "a file that can be written"))
}

/// Writes radiance as 32-bit OpenEXR with a statement of the covered part of the sphere.
fn save_exr(path: &Path, map: &LatLongView<'_>, whole: bool) -> Result<(), SimError> {
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
        let omega = grid.solid_angle(row) as f32;
        map.texels[row * grid.width + column].map(|v| v / omega)
    };
    let bytes = maps::write::openexr(grid.width, height, covers, radiance);
    save(path, &bytes.map_err(|e| SimError::at(path, e, "a map that OpenEXR can hold"))?)
}
