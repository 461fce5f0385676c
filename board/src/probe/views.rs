//! Frames and maps for pictures, copied by the processing thread only on request.

use crate::calibration::{Burst, Calibration, Frame, Pixels};
use crate::light_set::OwnedSet;
use crate::pipeline::Pipeline;
use crate::source::Lux;
use hemilux_core::format::Layout;
use hemilux_core::light::Light;
use hemilux_core::polar::{Grid, LatLongView};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use tokio::sync::watch;

/// The frames of a burst as the source delivers them.
#[derive(Clone, Debug)]
pub struct BurstView {
    /// Number of the frame that the burst became, as in the light set.
    pub frame: u64,
    /// CLOCK_MONOTONIC at a time before the first exposure of the burst began, nanoseconds; 0 where unknown.
    pub before_ns: u64,
    /// The frames of the burst, shortest exposure first.
    pub frames: Vec<Frame>,
    /// The calibration of the source, which contains the format of the frames' samples.
    pub calibration: Calibration,
    /// The factor from the source's radiance to lux, already part of `calibration`; `None` where the radiance
    /// is relative.
    pub lux: Option<Lux>,
}

/// The polar map of a frame with its lights.
#[derive(Clone, Debug)]
pub struct MapView {
    /// Numbers of rows and columns of the polar map.
    pub grid: Grid,
    /// Energy of each texel: radiance times solid angle, red, green and blue.
    pub texels: Vec<[f32; 3]>,
    /// Number of the frame that the map shows, as in the light set.
    pub frame: u64,
    /// The lights that the sampler computed from the map.
    pub lights: Vec<Light>,
}

impl MapView {
    /// Returns the polar map with borrowed texels.
    #[must_use]
    pub fn map(&self) -> LatLongView<'_> {
        LatLongView { grid: self.grid, texels: &self.texels }
    }
}

/// Requests and answers for one kind of view: each request gets a number, and the next frame's view answers all numbers up to the newest.
#[derive(Debug)]
pub struct Slot<T> {
    asked: AtomicU64,
    given: watch::Sender<Given<T>>,
}

/// The newest view of a slot, and the number of the last request that the view answers.
#[derive(Debug)]
pub struct Given<T> {
    /// Number of the last request that the view answers.
    pub number: u64,
    /// The newest view; `None` before the first one.
    pub view: Option<Arc<T>>,
    /// True if the view belongs to a frame that was processed after the request.
    pub is_new: bool,
}

/// A request for a view of the next frame, and the channel in which the view arrives.
#[derive(Debug)]
pub struct ViewRequest<T> {
    /// Number of the request: a [`Given`] of this number or a greater one answers it.
    pub number: u64,
    /// The channel in which the views arrive.
    pub given: watch::Receiver<Given<T>>,
}

impl<T> Default for Slot<T> {
    fn default() -> Self {
        Self {
            asked: AtomicU64::new(0),
            given: watch::Sender::new(Given { number: 0, view: None, is_new: false }),
        }
    }
}

impl<T> Slot<T> {
    /// Requests a view of the next frame from the processing thread.
    #[must_use]
    pub fn request(&self) -> ViewRequest<T> {
        let given = self.given.subscribe();
        ViewRequest { number: self.asked.fetch_add(1, Ordering::AcqRel) + 1, given }
    }

    /// Makes a view of a new frame with `make`, if a request is waiting, and sends it to the waiting clients.
    fn serve(&self, make: impl FnOnce() -> T) {
        self.give(true, make);
    }

    fn give(&self, is_new: bool, make: impl FnOnce() -> T) {
        let asked = self.asked.load(Ordering::Acquire);
        if asked > self.given.borrow().number {
            self.given.send_replace(Given { number: asked, view: Some(Arc::new(make())), is_new });
        }
    }
}

/// The slots of the requests for each kind of view.
#[derive(Debug, Default)]
pub struct Views {
    /// Requests for the frames of the newest burst.
    pub bursts: Slot<BurstView>,
    /// Clients' requests for the newest polar map.
    pub maps: Slot<MapView>,
}

impl Views {
    /// Answers the requests for views of this frame. Without requests, the call costs two atomic loads.
    pub(super) fn serve(&self, burst: &Burst, pipeline: &mut Pipeline, set: &OwnedSet, lux: Option<Lux>) {
        self.bursts.serve(|| BurstView {
            frame: set.frame,
            before_ns: burst.before_ns,
            frames: burst
                .frames
                .iter()
                .map(|frame| complete(frame, &pipeline.calibration().layout))
                .collect(),
            calibration: *pipeline.calibration(),
            lux,
        });
        self.maps.serve(|| map_view(pipeline, set));
    }

    /// Answers the requests for maps with the map of the last frame, whose set is `set`, while the source delivers no bursts.
    pub(super) fn serve_last(&self, pipeline: &mut Pipeline, set: &OwnedSet) {
        if pipeline.has_map() {
            self.maps.give(false, || map_view(pipeline, set));
        }
    }
}

/// Returns a copy of `frame` in which missing samples are 0.
fn complete(frame: &Frame, layout: &Layout) -> Frame {
    let mut frame = frame.clone();
    match &mut frame.pixels {
        Pixels::U8(bytes) => bytes.resize(layout.frame_samples().max(bytes.len()), 0),
        Pixels::U16(words) => words.resize(layout.frame_samples().max(words.len()), 0),
    }
    frame
}

fn map_view(pipeline: &mut Pipeline, set: &OwnedSet) -> MapView {
    let polar = pipeline.map().polar;
    MapView { grid: polar.grid, texels: polar.texels.to_vec(), frame: set.frame, lights: set.lights.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::Settings;
    use crate::scene;
    use crate::source::{Pace, SceneSource, Source};

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

    #[test]
    fn samples_that_a_frame_lacks_are_black_in_its_view() {
        let mut source = SceneSource::new(scene::by_name("room").expect("a scene"), Pace::Free);
        let mut burst = Burst::default();
        source.next(&mut burst).expect("a burst");
        let sound = &burst.frames[0];
        let mut half = sound.clone();
        match &mut half.pixels {
            Pixels::U8(bytes) => bytes.truncate(bytes.len() / 2),
            Pixels::U16(words) => words.truncate(words.len() / 2),
        }
        let layout = &source.calibration().layout;
        let whole = complete(&half, layout);
        let len = |frame: &Frame| match &frame.pixels {
            Pixels::U8(bytes) => bytes.len(),
            Pixels::U16(words) => words.len(),
        };
        assert_eq!((len(&whole), len(&complete(sound, layout))), (len(sound), len(sound)));
    }

    #[test]
    fn without_bursts_the_map_of_the_last_frame_is_returned_as_not_new() {
        let mut source = SceneSource::new(scene::by_name("room").expect("a scene"), Pace::Free);
        let pipeline = Pipeline::try_new(*source.calibration(), &source.exposures(), Settings::default());
        let mut pipeline = pipeline.expect("a pipeline");
        let (views, set) = (Views::default(), OwnedSet { frame: 7, ..OwnedSet::default() });
        let given = views.maps.request().given;
        views.serve_last(&mut pipeline, &set);
        assert!(given.borrow().view.is_none(), "nothing was merged");
        let mut burst = Burst::default();
        source.next(&mut burst).expect("a burst");
        pipeline.process(&burst).expect("a frame");
        views.serve_last(&mut pipeline, &set);
        let last = given.borrow();
        let map = last.view.as_ref().expect("a map");
        assert!(!last.is_new && map.frame == 7 && map.texels.iter().any(|t| t[1] > 0.0), "the last frame");
        assert_eq!(views.bursts.request().given.borrow().number, 0, "no frames of it");
    }
}
