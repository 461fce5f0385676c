//! The data for pictures, copied by the processing thread only on request.

use crate::calibration::{Burst, Calibration, Frame};
use crate::light_set::OwnedSet;
use crate::pipeline::Pipeline;
use crate::source::Lux;
use hemilux_core::light::Light;
use hemilux_core::polar::{Grid, LatLongView};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use tokio::sync::watch;

/// The frames of a burst as the source delivers them.
#[derive(Clone, Debug)]
pub struct BurstView {
    /// The light set's frame.
    pub frame: u64,
    /// CLOCK_MONOTONIC at which none of the exposures had begun, nanoseconds; 0 where unknown.
    pub before_ns: u64,
    /// The exposures, shortest first.
    pub frames: Vec<Frame>,
    /// The calibration, which states the format of the samples.
    pub calibration: Calibration,
    /// The unit lux, whose factor `calibration` contains; `None` where the unit is relative.
    pub lux: Option<Lux>,
}

/// The polar map of a frame with its lights.
#[derive(Clone, Debug)]
pub struct MapView {
    /// The map's shape.
    pub grid: Grid,
    /// Energy of each texel.
    pub texels: Vec<[f32; 3]>,
    /// The light set's frame.
    pub frame: u64,
    /// The lights of the map.
    pub lights: Vec<Light>,
}

impl MapView {
    /// The map as a view.
    #[must_use]
    pub fn map(&self) -> LatLongView<'_> {
        LatLongView { grid: self.grid, texels: &self.texels }
    }
}

/// One kind of view: each request takes a number, and the next frame's view answers all numbers taken before.
#[derive(Debug)]
pub struct Slot<T> {
    asked: AtomicU64,
    given: watch::Sender<Given<T>>,
}

/// The newest view and the last number that it answers.
#[derive(Debug)]
pub struct Given<T> {
    /// Number of the last request that the view answers.
    pub number: u64,
    /// The view; `None` before the first one.
    pub view: Option<Arc<T>>,
}

/// A request for a view.
#[derive(Debug)]
pub struct ViewRequest<T> {
    /// The number from which a [`Given`] answers the request.
    pub number: u64,
    /// The channel of the answers.
    pub given: watch::Receiver<Given<T>>,
}

impl<T> Default for Slot<T> {
    fn default() -> Self {
        Self { asked: AtomicU64::new(0), given: watch::Sender::new(Given { number: 0, view: None }) }
    }
}

impl<T> Slot<T> {
    /// Requests a view of the next frame.
    #[must_use]
    pub fn request(&self) -> ViewRequest<T> {
        let given = self.given.subscribe();
        ViewRequest { number: self.asked.fetch_add(1, Ordering::AcqRel) + 1, given }
    }

    /// Makes a view if a request waits.
    fn serve(&self, make: impl FnOnce() -> T) {
        let asked = self.asked.load(Ordering::Acquire);
        if asked > self.given.borrow().number {
            self.given.send_replace(Given { number: asked, view: Some(Arc::new(make())) });
        }
    }
}

/// Requests for each kind of view.
#[derive(Debug, Default)]
pub struct Views {
    /// Exposures.
    pub bursts: Slot<BurstView>,
    /// Maps.
    pub maps: Slot<MapView>,
}

impl Views {
    /// Answers the requests for views of this frame; two atomic loads without requests.
    pub(super) fn serve(&self, burst: &Burst, pipeline: &mut Pipeline, set: &OwnedSet, lux: Option<Lux>) {
        self.bursts.serve(|| BurstView {
            frame: set.frame,
            before_ns: burst.before_ns,
            frames: burst.frames.clone(),
            calibration: *pipeline.calibration(),
            lux,
        });
        self.maps.serve(|| {
            let polar = pipeline.map().polar;
            MapView {
                grid: polar.grid,
                texels: polar.texels.to_vec(),
                frame: set.frame,
                lights: set.lights.clone(),
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_view_is_made_once_for_all_requests_before_it() {
        let slot = Slot::<u32>::default();
        slot.serve(|| unreachable!("no request"));
        let ViewRequest { number: first, given } = slot.request();
        let second = slot.request().number;
        slot.serve(|| 7);
        slot.serve(|| unreachable!("no new request"));
        let now = given.borrow();
        assert!(now.number >= first && now.number >= second, "both are answered");
        assert_eq!(now.view.as_deref(), Some(&7), "with one view");
    }
}
