//! Sources that change the bursts of another source.

use super::{Lux, Source, SourceError};
use crate::calibration::{Burst, Calibration};
use crate::camera_status::CameraStatus;
use crate::exposure_plan::TimeRange;
use crate::noise::Noise;
use hemilux_core::Exposure;
use hemilux_core::mains::Lamps;

/// A source that changes the bursts of an inner source. Each [`Adapter`] is a [`Source`]; methods that the adapter does not define call those of
/// the inner source.
pub trait Adapter: Send {
    /// Returns the inner source, whose bursts the adapter changes.
    fn inner(&self) -> &dyn Source;

    /// Returns the inner source, for changes of its state.
    fn inner_mut(&mut self) -> &mut dyn Source;

    /// Implements [`Source::next`] for the adapter.
    ///
    /// # Errors
    /// [`SourceError`] of the inner source, or of the adapter's own change of the burst.
    fn next_burst(&mut self, burst: &mut Burst) -> Result<(), SourceError>;

    /// Implements [`Source::calibration`] for the adapter.
    fn calibration(&self) -> &Calibration {
        self.inner().calibration()
    }

    /// Implements [`Source::lux`] for the adapter.
    fn lux(&self) -> Option<Lux> {
        self.inner().lux()
    }

    /// Implements [`Source::set_exposures`] for the adapter.
    ///
    /// # Errors
    /// The reason of a refusal; the exposures are then unchanged.
    fn set_exposures(&mut self, seconds: Option<&[f64]>) -> Result<(), String> {
        self.inner_mut().set_exposures(seconds)
    }

    /// Implements [`Source::set_sliding`] for the adapter.
    fn set_sliding(&mut self, is_sliding: bool) -> bool {
        self.inner_mut().set_sliding(is_sliding)
    }

    /// Implements [`Source::camera`] for the adapter.
    fn camera(&self, status: &mut CameraStatus) -> bool {
        self.inner().camera(status)
    }
}

impl<A: Adapter> Source for A {
    fn calibration(&self) -> &Calibration {
        Adapter::calibration(self)
    }

    fn exposures(&self) -> Vec<Exposure> {
        self.inner().exposures()
    }

    fn lux(&self) -> Option<Lux> {
        Adapter::lux(self)
    }

    fn noise(&self) -> Option<Noise> {
        self.inner().noise()
    }

    fn fixed_exposures(&self) -> Option<&'static str> {
        self.inner().fixed_exposures()
    }

    fn exposure_range(&self) -> Option<TimeRange> {
        self.inner().exposure_range()
    }

    fn follows_light(&self) -> bool {
        self.inner().follows_light()
    }

    fn notes(&self) -> &[String] {
        self.inner().notes()
    }

    fn set_exposures(&mut self, seconds: Option<&[f64]>) -> Result<(), String> {
        Adapter::set_exposures(self, seconds)
    }

    fn set_lamps(&mut self, lamps: Lamps) {
        self.inner_mut().set_lamps(lamps);
    }

    fn set_sliding(&mut self, is_sliding: bool) -> bool {
        Adapter::set_sliding(self, is_sliding)
    }

    fn camera(&self, status: &mut CameraStatus) -> bool {
        Adapter::camera(self, status)
    }

    fn next(&mut self, burst: &mut Burst) -> Result<(), SourceError> {
        self.next_burst(burst)
    }
}
