//! The `[sensor]` table of manifests and lens files: levels, white balance and noise of a sensor.

use super::RecordedError;
use crate::noise::Noise;
use serde::Deserialize;
use std::path::Path;

/// The table `[sensor]` of a lens file or of `burst.toml`.
#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub(super) struct SensorTable {
    /// Sensor code of black.
    pub(super) black: Option<f64>,
    /// Sensor code of relative exposure 1.
    pub(super) white: Option<f64>,
    /// Factors of the red, green and blue relative exposure.
    pub(super) white_balance: Option<[f32; 3]>,
    /// Read noise of the sensor, codes RMS; stated together with `codes_per_electron`.
    read_noise: Option<f64>,
    /// Sensor codes per electron.
    codes_per_electron: Option<f64>,
}

impl SensorTable {
    /// Returns the noise of a sample, where the table states it; `path` is the file of the table.
    ///
    /// # Errors
    /// [`RecordedError`] if one of the two numbers is missing, or if one is not a number of at least 0.
    pub(super) fn noise(&self, path: &Path) -> Result<Option<Noise>, RecordedError> {
        let is_number = |v: f64| v.is_finite() && v >= 0.0;
        match (self.read_noise, self.codes_per_electron) {
            (None, None) => Ok(None),
            (Some(read), Some(gain)) if is_number(read) && is_number(gain) && read + gain > 0.0 => {
                Ok(Some(Noise { read, gain, dark: self.black.unwrap_or(0.0) }))
            }
            (read, gain) => {
                let text = |v: Option<f64>| v.map_or("nothing".into(), |v| v.to_string());
                let found =
                    format!("[sensor] read_noise = {}, codes_per_electron = {}", text(read), text(gain));
                Err(RecordedError::new(path, found, "both, at least 0, one of them above 0"))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(text: &str) -> Result<Option<Noise>, String> {
        let table: SensorTable = toml::from_str(text).map_err(|e| e.to_string())?;
        table.noise(Path::new("lens.toml")).map_err(|e| e.to_string())
    }

    #[test]
    fn noise_is_two_numbers_or_none() {
        let both = "black = 64\nread_noise = 2.5\ncodes_per_electron = 0.2";
        assert_eq!(noise(both), Ok(Some(Noise { read: 2.5, gain: 0.2, dark: 64.0 })));
        assert_eq!(noise("black = 64"), Ok(None));
        for bad in [
            "read_noise = 2.5",
            "codes_per_electron = 0.2",
            "read_noise = -1.0\ncodes_per_electron = 0.2",
            "read_noise = nan\ncodes_per_electron = 0.2",
            "read_noise = 0.0\ncodes_per_electron = 0.0",
        ] {
            let line = noise(bad).expect_err(bad);
            assert!(
                line.starts_with("lens.toml: found [sensor] read_noise = ") && !line.contains('\n'),
                "{line}"
            );
        }
    }
}
