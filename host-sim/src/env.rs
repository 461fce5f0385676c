//! Full-sphere latitude-longitude environment maps: reading and texel geometry.
//!
//! Texel (row i, column j) of an H x W map lies at theta = (i + 1/2) pi / H from +Z and
//! phi = pi - (j + 1/2) 2 pi / W, so that columns run clockwise seen from above.

use std::f64::consts::{PI, TAU};
use std::path::{Path, PathBuf};

/// Largest value a channel may hold; what is above is clamped (the largest finite half float).
pub const MAX_VALUE: f32 = 65504.0;

/// Why an environment map could not be read.
#[derive(Debug, thiserror::Error)]
pub enum EnvError {
    /// The file could not be opened or read.
    #[error("{path}: found {source}, expected a latitude-longitude map that can be read")]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is not a readable OpenEXR or Radiance HDR picture.
    #[error("{path}: found {found}, expected a latitude-longitude OpenEXR or Radiance HDR map")]
    Format {
        /// The file.
        path: PathBuf,
        /// What was found instead.
        found: String,
    },
}

/// A latitude-longitude map of RGB radiance, row 0 at the zenith.
#[derive(Clone, Debug, PartialEq)]
pub struct EnvMap {
    width: usize,
    height: usize,
    rgb: Vec<[f32; 3]>,
    /// How many texels held a value outside 0..65504 (or NaN) and were clamped.
    pub clamped: usize,
}

impl EnvMap {
    /// Makes a map from row-major texels, clamping each channel to 0..65504 (NaN becomes 0).
    ///
    /// # Panics
    /// If `rgb.len() != width * height` or a side is zero.
    #[must_use]
    pub fn new(width: usize, height: usize, mut rgb: Vec<[f32; 3]>) -> Self {
        assert!(width > 0 && height > 0, "a map has at least one texel");
        assert_eq!(rgb.len(), width * height, "texels do not fill the map");
        let mut clamped = 0;
        for texel in &mut rgb {
            let safe = texel.map(|v| if v.is_nan() { 0.0 } else { v.clamp(0.0, MAX_VALUE) });
            if safe != *texel {
                clamped += 1;
                *texel = safe;
            }
        }
        Self { width, height, rgb, clamped }
    }

    /// Evaluates `radiance(direction)` at every texel's centre.
    #[must_use]
    pub fn from_fn(width: usize, height: usize, radiance: impl Fn([f64; 3]) -> [f32; 3]) -> Self {
        let rgb =
            (0..height * width).map(|k| radiance(direction(width, height, k / width, k % width))).collect();
        Self::new(width, height, rgb)
    }

    /// Reads an OpenEXR or Radiance HDR file.
    ///
    /// # Errors
    /// When the file cannot be read, is not such a picture, or has no texels.
    pub fn read(path: &Path) -> Result<Self, EnvError> {
        let bytes = std::fs::read(path).map_err(|source| EnvError::Io { path: path.into(), source })?;
        let decoded = if bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
            read_exr(&bytes)
        } else if bytes.starts_with(b"#?") {
            read_hdr(&bytes)
        } else {
            Err(format!("a file that begins with {:02x?}", &bytes[..bytes.len().min(4)]))
        };
        let (width, height, rgb) = decoded.map_err(|found| EnvError::Format { path: path.into(), found })?;
        Ok(Self::new(width, height, rgb))
    }

    /// Columns.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// All texels, row-major.
    #[must_use]
    pub fn texels(&self) -> &[[f32; 3]] {
        &self.rgb
    }

    /// Unit direction of the texel's centre.
    #[must_use]
    pub fn direction(&self, row: usize, column: usize) -> [f64; 3] {
        direction(self.width, self.height, row, column)
    }

    /// Solid angle of a texel of `row`, steradians.
    #[must_use]
    pub fn solid_angle(&self, row: usize) -> f64 {
        let edge = |i: usize| (i as f64 * PI / self.height as f64).cos();
        (edge(row) - edge(row + 1)) * TAU / self.width as f64
    }
}

/// Unit direction of the centre of texel (`row`, `column`) of a full-sphere map.
#[must_use]
pub fn direction(width: usize, height: usize, row: usize, column: usize) -> [f64; 3] {
    let theta = (row as f64 + 0.5) * PI / height as f64;
    let phi = PI - (column as f64 + 0.5) * TAU / width as f64;
    [theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()]
}

type Decoded = Result<(usize, usize, Vec<[f32; 3]>), String>;

fn read_exr(bytes: &[u8]) -> Decoded {
    use exr::prelude::{ReadChannels, ReadLayers};
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .rgb_channels(
            |size, _| (size.width(), vec![[0.0f32; 3]; size.area()]),
            |(width, texels): &mut (usize, Vec<[f32; 3]>), at, (r, g, b): (f32, f32, f32)| {
                texels[at.y() * *width + at.x()] = [r, g, b];
            },
        )
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(std::io::Cursor::new(bytes))
        .map_err(|e| format!("an OpenEXR file that does not decode ({e})"))?;
    let (width, texels) = image.layer_data.channel_data.pixels;
    if width == 0 || texels.is_empty() {
        return Err("an OpenEXR file without texels".into());
    }
    Ok((width, texels.len() / width, texels))
}

fn read_hdr(bytes: &[u8]) -> Decoded {
    let decoder = image::codecs::hdr::HdrDecoder::new(std::io::Cursor::new(bytes))
        .map_err(|e| format!("a Radiance HDR file that does not decode ({e})"))?;
    let image = image::DynamicImage::from_decoder(decoder)
        .map_err(|e| format!("a Radiance HDR file that does not decode ({e})"))?
        .into_rgb32f();
    let (width, height) = (image.width() as usize, image.height() as usize);
    if width == 0 || height == 0 {
        return Err("a Radiance HDR file without texels".into());
    }
    Ok((width, height, image.pixels().map(|p| p.0).collect()))
}
