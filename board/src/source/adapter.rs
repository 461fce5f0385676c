//! Sources that change the bursts of another source.

use super::{Lux, Source, SourceError};
use crate::calibration::{Burst, Calibration};
use crate::camera_status::CameraStatus;
use crate::exposure_plan::TimeRange;
use hemilux_core::Exposure;

/// A source that changes the bursts of an inner source. Each [`Adapter`] is a [`Source`]; a method that the adapter does not define calls
/// the method of the inner source.
pub trait Adapter: Send {
    /// The inner source.
    fn inner(&self) -> &dyn Source;

    /// The inner source, for changes.
    fn inner_mut(&mut self) -> &mut dyn Source;

    /// [`Source::next`] of the adapter.
    ///
    /// # Errors
    /// [`SourceError`] of the inner source or of the adapter.
    fn next_burst(&mut self, burst: &mut Burst) -> Result<(), SourceError>;

    /// [`Source::calibration`] of the adapter.
    fn calibration(&self) -> &Calibration {
        self.inner().calibration()
    }

    /// [`Source::lux`] of the adapter.
    fn lux(&self) -> Option<Lux> {
        self.inner().lux()
    }

    /// [`Source::set_exposures`] of the adapter.
    ///
    /// # Errors
    /// The reason of a refusal; nothing changes then.
    fn set_exposures(&mut self, seconds: Option<&[f64]>) -> Result<(), String> {
        self.inner_mut().set_exposures(seconds)
    }

    /// [`Source::camera`] of the adapter.
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

    fn fixed_exposures(&self) -> Option<&'static str> {
        self.inner().fixed_exposures()
    }

    fn exposure_range(&self) -> Option<TimeRange> {
        self.inner().exposure_range()
    }

    fn notes(&self) -> &[String] {
        self.inner().notes()
    }

    fn set_exposures(&mut self, seconds: Option<&[f64]>) -> Result<(), String> {
        Adapter::set_exposures(self, seconds)
    }

    fn camera(&self, status: &mut CameraStatus) -> bool {
        Adapter::camera(self, status)
    }

    fn next(&mut self, burst: &mut Burst) -> Result<(), SourceError> {
        self.next_burst(burst)
    }
}
