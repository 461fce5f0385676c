//! A source whose radiance is in candela per square metre.

use super::{Lux, Source, SourceError};
use crate::calibration::{Burst, Calibration};
use crate::recorded::{Photometric, radiometry};
use hemilux_core::Exposure;

/// A source with a photometric calibration.
///
/// The calibration applies while response, levels, scale, white balance and vignetting of the source are those by which it was measured;
/// otherwise radiance is relative, and a warning says so.
pub struct PhotometricSource {
    inner: Box<dyn Source>,
    photometric: Photometric,
    /// The calibration of `inner`.
    own: Calibration,
    /// `own` with the factor in its scale, where it applies.
    calibration: Calibration,
    applies: bool,
}

impl PhotometricSource {
    /// `inner` with a photometric calibration.
    #[must_use]
    pub fn new(inner: Box<dyn Source>, photometric: Photometric) -> Self {
        let own = *inner.calibration();
        let mut source = Self { inner, photometric, own, calibration: own, applies: false };
        source.apply();
        source
    }

    /// Whether radiance is in candela per square metre.
    #[must_use]
    pub fn applies(&self) -> bool {
        self.applies
    }

    fn apply(&mut self) {
        self.own = *self.inner.calibration();
        self.calibration = self.own;
        self.applies = radiometry(&self.own) == self.photometric.camera;
        if self.applies {
            self.calibration.scale *= self.photometric.factor;
        }
    }
}

impl Source for PhotometricSource {
    fn calibration(&self) -> &Calibration {
        &self.calibration
    }

    fn lux(&self) -> Option<Lux> {
        let Photometric { factor, uncertainty, .. } = self.photometric;
        self.applies.then_some(Lux { factor, uncertainty: uncertainty as f32 })
    }

    fn exposures(&self) -> Vec<Exposure> {
        self.inner.exposures()
    }

    fn fixed_exposures(&self) -> Option<&'static str> {
        self.inner.fixed_exposures()
    }

    fn set_exposures(&mut self, seconds: Option<&[f64]>) -> Result<(), String> {
        self.inner.set_exposures(seconds)
    }

    fn next(&mut self, burst: &mut Burst) -> Result<(), SourceError> {
        self.inner.next(burst)?;
        if *self.inner.calibration() != self.own {
            self.apply();
            if !self.applies {
                tracing::warn!(
                    "photometric: found another response, level or vignetting than that of the calibration, lights are relative: \
                     calibrate photometric anew"
                );
            }
        }
        Ok(())
    }
}
