//! The `[lens]` table of lens files and of `burst.toml`.

use super::RecordedError;
use super::shown::Shown;
use glam::DVec2;
use hemilux_core::lens::{Intrinsics, Lens, Model};
use serde::Deserialize;
use std::path::Path;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LensTable {
    model: String,
    pub(super) size: Option<[u32; 2]>,
    centre: [f64; 2],
    focal: [f64; 2],
    #[serde(default)]
    skew: f64,
    #[serde(default)]
    k: Vec<f64>,
    max_angle_deg: f64,
    #[serde(default = "no_vignetting")]
    vignetting: Vec<f64>,
    crop: Option<[u32; 4]>,
    binning: Option<[u32; 2]>,
}

fn no_vignetting() -> Vec<f64> {
    vec![1.0]
}

impl LensTable {
    /// Returns the part of the sensor that the images of the lens cover, where the table states it.
    pub(super) fn shown(&self, path: &Path) -> Result<Option<Shown>, RecordedError> {
        let refuse = |found: String, expected: &str| Err(RecordedError::new(path, found, expected));
        let (crop, binning) = match (self.crop, self.binning, self.size) {
            (None, None, _) => return Ok(None),
            (Some(crop), Some(binning), Some(_)) => (crop, binning),
            _ => {
                return refuse(
                    "[lens] with one of crop, binning and size alone".into(),
                    "all of them, or size alone",
                );
            }
        };
        let shown = Shown { crop, binning };
        let size = self.size.unwrap_or_default();
        let fits = |axis: usize| {
            let (side, bin) = (crop[2 + axis], binning[axis]);
            let is_sane = (1..=64).contains(&bin)
                && side > 0
                && crop[axis].checked_add(side).is_some_and(|end| end <= 1 << 16);
            is_sane && (side / bin).abs_diff(size[axis]) <= 1
        };
        if fits(0) && fits(1) {
            return Ok(Some(shown));
        }
        let found = format!("crop = {crop:?} and binning = {binning:?} for size = {size:?}");
        refuse(found, "a crop that is size times binning")
    }

    pub(super) fn lens(&self, path: &Path) -> Result<Lens, RecordedError> {
        let refuse = |found: String, expected: &str| Err(RecordedError::new(path, found, expected));
        let count = |n: usize| format!("{n} coefficients k for the lens model {:?}", self.model);
        let model = match (self.model.as_str(), self.k.as_slice()) {
            ("equidistant", []) => Model::Equidistant,
            ("equisolid", []) => Model::Equisolid,
            ("kannala-brandt", &[k1, k2, k3, k4]) => Model::KannalaBrandt([k1, k2, k3, k4]),
            ("radial", &[k0, k1]) => Model::Radial([k0, k1]),
            ("equidistant" | "equisolid", k) => return refuse(count(k.len()), "none"),
            ("kannala-brandt", k) => return refuse(count(k.len()), "four"),
            ("radial", k) => return refuse(count(k.len()), "two"),
            _ => {
                let expected = "equidistant, equisolid, kannala-brandt or radial";
                return refuse(format!("the lens model {:?}", self.model), expected);
            }
        };
        let mut vignetting = [0.0; 8];
        if self.vignetting.is_empty() || self.vignetting.len() > vignetting.len() {
            return refuse(format!("{} vignetting coefficients", self.vignetting.len()), "1 to 8");
        }
        vignetting[..self.vignetting.len()].copy_from_slice(&self.vignetting);
        let intrinsics = Intrinsics {
            model,
            centre_px: DVec2::from_array(self.centre),
            focal_px: DVec2::from_array(self.focal),
            skew_px: self.skew,
            max_theta: self.max_angle_deg.to_radians(),
            vignetting,
        };
        Lens::try_new(intrinsics)
            .map_err(|e| RecordedError::new(path, e, "a lens that is valid up to max_angle_deg"))
    }
}
