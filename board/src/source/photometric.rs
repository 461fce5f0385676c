//! A source whose radiance is in candela per square metre.

use super::{Adapter, Lux, Source, SourceError};
use crate::calibration::{Burst, Calibration};
use crate::recorded::{Photometric, radiometry};

/// A source whose photometric calibration converts radiance to candela per square metre.
///
/// The photometric calibration applies while response, levels, scale, white balance and vignetting of the source are those with which it
/// was measured; otherwise radiance is relative, and a warning is logged.
pub struct PhotometricSource {
    inner: Box<dyn Source>,
    photometric: Photometric,
    /// The calibration that the source `inner` returns.
    own: Calibration,
    /// The calibration `own` with the photometric factor in its scale, where the factor applies.
    calibration: Calibration,
    applies: bool,
}

impl PhotometricSource {
    /// Applies the photometric calibration to the source `inner`.
    #[must_use]
    pub fn new(inner: Box<dyn Source>, photometric: Photometric) -> Self {
        let own = *inner.calibration();
        let mut source = Self { inner, photometric, own, calibration: own, applies: false };
        source.apply();
        source
    }

    /// Returns true if radiance is in candela per square metre.
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

impl Adapter for PhotometricSource {
    fn inner(&self) -> &dyn Source {
        self.inner.as_ref()
    }

    fn inner_mut(&mut self) -> &mut dyn Source {
        self.inner.as_mut()
    }

    fn calibration(&self) -> &Calibration {
        &self.calibration
    }

    fn lux(&self) -> Option<Lux> {
        let Photometric { factor, uncertainty, .. } = self.photometric;
        self.applies.then_some(Lux { factor, uncertainty: uncertainty as f32 })
    }

    fn next_burst(&mut self, burst: &mut Burst) -> Result<(), SourceError> {
        self.inner.next(burst)?;
        if *self.inner.calibration() != self.own {
            self.apply();
            if !self.applies {
                tracing::warn!(
                    "photometric: found another response, level or vignetting than that of the calibration, lights are relative: \
                     calibrate photometric again"
                );
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene;
    use crate::source::{FaultSource, Pace, SceneSource, Source};
    use hemilux_core::Exposure;

    #[test]
    fn exposures_of_an_adapted_source_can_be_changed() {
        let scene = SceneSource::new(scene::by_name("room").expect("a scene"), Pace::Free);
        let range = scene.exposure_range();
        assert!(range.is_some());
        let camera = radiometry(scene.calibration());
        let photometric = Photometric { class: "any".into(), factor: 3.0, uncertainty: 0.02, camera };
        let faulty = FaultSource::new(Box::new(scene), "torn=0.5".parse().expect("faults"));
        let source: &mut dyn Source = &mut PhotometricSource::new(Box::new(faulty), photometric);
        assert_eq!((source.exposure_range(), source.fixed_exposures()), (range, None));
        source.set_exposures(Some(&[0.002])).expect("exposures that can be changed");
        assert_eq!(source.exposures(), [Exposure { seconds: 0.002, gain: 1.0 }]);
    }
}
