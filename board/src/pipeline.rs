//! The core's stages with memory from the heap: a burst in, lights out.
//!
//! All memory is allocated when the pipeline is made or the exposures of its bursts change; processing a burst allocates nothing. The polar
//! map is allocated when a sampler or a picture needs it first.

mod compared;
mod inspection;
mod parts;
mod processed;
mod settings;
mod times;
mod window;
mod window_mode;

use crate::calibration::{Burst, Calibration, Frame};
use crate::consistency::Inspector;
use crate::polar::Polar;
use crate::samplers::{self, Shape};
use compared::Compared;
use hemilux_core::mains::{Cell, Flicker, Mains};
use hemilux_core::polar::LatLongView;
use hemilux_core::pyramid::Quad;
use hemilux_core::sampler::Timer;
use hemilux_core::wire::FramesLeftOut;
use hemilux_core::{
    Coverage, Domain, Exposure, FrontEnd, FrontError, MAX_EXPOSURES, Map, Request, Sampler, SamplerKind,
    Samples,
};
use parts::{Span, front_end, is_read, mains};
use std::time::{Duration, Instant};
use window::Sliding;

pub use processed::{Processed, Sampled};
pub use settings::{PipelineError, Settings};
pub use times::Times;
pub use window_mode::{WINDOWS, WindowMode};

/// A hemisphere map and the sampler that computes lights from it.
pub struct Pipeline {
    settings: Settings,
    exposures: Vec<Exposure>,
    front: FrontEnd<Vec<u64>>,
    /// Present in [`WindowMode::Sliding`].
    sliding: Option<Sliding>,
    inspector: Inspector,
    mains: Mains<Vec<Cell>>,
    compared: Compared,
    /// Modulation of the light over a mains period, as detected in the last merged burst.
    flicker: Flicker,
    /// Clipped and unseen shares of the map; `None` before the first merged burst.
    seen: Option<Coverage>,
    /// True if a burst was merged, into the present map or into an earlier map of another size.
    was_seen: bool,
    /// Number of consecutive bursts whose shortest exposure is wrong or whose wrong frames cannot be identified.
    doubtful: u32,
    /// The polar map; `None` until a sampler or a picture needs it.
    polar: Option<Polar>,
    /// True if `polar` holds the map of the last burst.
    polar_fresh: bool,
    sampler: Box<dyn Sampler + Send>,
    /// Largest number of exposures of a burst that are merged, set by [`Pipeline::limit_exposures`].
    most_exposures: usize,
}

impl Pipeline {
    /// Allocates all memory and builds the tables of a pipeline.
    ///
    /// # Errors
    /// [`PipelineError`] if calibration, exposures and settings do not fit together.
    pub fn try_new(
        calibration: Calibration,
        exposures: &[Exposure],
        settings: Settings,
    ) -> Result<Self, PipelineError> {
        let order = settings.order();
        let shape = Shape { domain: Domain::Hemisphere, order, grid: settings.grid };
        settings.check()?;
        let sampler = samplers::make_tuned(settings.sampler, &shape, settings.lights, &settings.tuning)?;
        let mut front = front_end(&calibration, exposures, &settings)?;
        let inspector = Inspector::try_new(&calibration, exposures.len()).map_err(PipelineError::Response)?;
        let mains = mains(&settings)?;
        let polar = sampler.needs_polar().then(|| Polar::new(&shape));
        let exposures = exposures.to_vec();
        let sliding = match settings.window {
            WindowMode::Burst => None,
            WindowMode::Sliding => Some(Sliding::open(&mut front, exposures.clone())?),
        };
        Ok(Self {
            settings,
            exposures,
            front,
            sliding,
            inspector,
            mains,
            compared: Compared::new(),
            flicker: Flicker::default(),
            seen: None,
            was_seen: false,
            doubtful: 0,
            polar,
            polar_fresh: false,
            sampler,
            most_exposures: usize::MAX,
        })
    }

    /// Changes the settings and keeps the buffers that they do not affect; on an error the earlier settings stay in effect.
    ///
    /// # Errors
    /// [`PipelineError`] if calibration and settings do not fit together.
    pub fn configure(&mut self, settings: Settings) -> Result<(), PipelineError> {
        let same_maps = settings.order() == self.front.order().get() && settings.grid == self.settings.grid;
        settings.check()?;
        if !same_maps {
            return self.replace_maps(settings);
        }
        if !settings.same_sampler(&self.settings) {
            let (shape, tuning) = (self.shape(), &settings.tuning);
            self.sampler = samplers::make_tuned(settings.sampler, &shape, settings.lights, tuning)?;
            if self.sampler.needs_polar() && self.polar.is_none() {
                self.polar = Some(Polar::new(&self.shape()));
            }
        }
        if settings.extrapolation != self.settings.extrapolation {
            // With other settings, the energy of unseen directions may appear in the map or vanish from it, which is no flicker.
            self.mains.restart();
        }
        self.front.set_extrapolation(settings.extrapolation);
        self.mains.set_lamps(settings.lamps);
        self.front.set_merge_mode(settings.merge);
        if settings.window != self.settings.window {
            self.flicker = Flicker::default();
            self.sliding = match settings.window {
                WindowMode::Burst => None,
                WindowMode::Sliding => Some(Sliding::open(&mut self.front, self.exposures.clone())?),
            };
        }
        self.settings = settings;
        Ok(())
    }

    /// Allocates maps of another size, and the sampler after the release of the former one: of many lights, the sampler is most of the
    /// pipeline's memory.
    fn replace_maps(&mut self, settings: Settings) -> Result<(), PipelineError> {
        self.sampler = samplers::make(SamplerKind::Adaptive, &self.shape(), 1)?;
        match Self::try_new(*self.front.calibration(), &self.exposures, settings) {
            Ok(made) => {
                let before = std::mem::replace(self, made);
                (self.inspector, self.doubtful) = (before.inspector, before.doubtful);
                self.was_seen = before.was_seen;
                Ok(())
            }
            Err(error) => {
                let Settings { sampler, lights, tuning, .. } = &self.settings;
                self.sampler = samplers::make_tuned(*sampler, &self.shape(), *lights, tuning)?;
                Err(error)
            }
        }
    }

    /// Returns the shape of the maps that the samplers read.
    #[must_use]
    pub fn shape(&self) -> Shape {
        let order = self.front.order().get();
        Shape { domain: Domain::Hemisphere, order, grid: self.settings.grid }
    }

    /// Processes one burst, or, in [`WindowMode::Sliding`], the new frames of a burst; frames that contradict the others are not merged.
    ///
    /// # Errors
    /// [`PipelineError`] when the frames do not fit the calibration; the last map stays.
    pub fn process(&mut self, burst: &Burst) -> Result<Processed<'_>, PipelineError> {
        let began = Instant::now();
        let left_out = self.inspect(burst);
        self.process_kept(burst, left_out, began)
    }

    /// Processes one burst without the frames `frames_left_out`; if these are all frames, the map of the burst before is sampled again. The
    /// front stage is timed from `began`. Of the frames left out, the result names those that were not part of the burst before.
    ///
    /// # Errors
    /// [`PipelineError`] when the frames do not fit the calibration; the last map stays.
    pub fn process_kept(
        &mut self,
        burst: &Burst,
        mut frames_left_out: FramesLeftOut,
        began: Instant,
    ) -> Result<Processed<'_>, PipelineError> {
        let mut front = Duration::ZERO;
        let added_up = || front = began.elapsed();
        let seen = match self.settings.window {
            WindowMode::Burst => self.merge_burst(burst, &frames_left_out, added_up)?,
            WindowMode::Sliding => self.slide(burst, &frames_left_out, added_up)?,
        };
        frames_left_out.retain(|index| burst.is_new(index));
        Ok(self.sample_map(seen, frames_left_out, Span { began, front }))
    }

    /// Merges the frames of `burst` without `frames_left_out` into the map and removes the flicker from it; `added_up` is called as by
    /// [`FrontEnd::process_timed`].
    fn merge_burst(
        &mut self,
        burst: &Burst,
        frames_left_out: &FramesLeftOut,
        added_up: impl FnOnce(),
    ) -> Result<Coverage, PipelineError> {
        let steady: [bool; MAX_EXPOSURES] = self.steady(burst);
        let count = burst.frames.len();
        let most = if frames_left_out.is_empty() { self.most_exposures } else { count };
        let merged = || {
            let is_kept = move |index: &usize| {
                let is_sound = steady.get(*index) != Some(&false) && !frames_left_out.contains(*index);
                is_sound && is_read(*index, count, most)
            };
            burst.frames.iter().enumerate().filter(move |(index, _)| is_kept(index)).map(|(_, frame)| frame)
        };
        match self.seen {
            Some(seen) if merged().next().is_none() => Ok(seen),
            None if merged().next().is_none() => Err(PipelineError::NoFrame),
            _ => {
                let seen = self.merge(merged(), added_up)?;
                self.flicker = self.remove_flicker(burst, frames_left_out);
                Ok(seen)
            }
        }
    }

    /// Samples the map.
    fn sample_map(&mut self, seen: Coverage, frames_left_out: FramesLeftOut, span: Span) -> Processed<'_> {
        let Span { began, front } = span;
        self.polar_fresh = self.sampler.needs_polar();
        if self.polar_fresh {
            let shape = self.shape();
            self.polar.get_or_insert_with(|| Polar::new(&shape)).fill(&self.front.map());
        }
        let summed = began.elapsed();
        let view = self.front.map();
        let (total, horizontal_irradiance) = (view.total(), view.horizontal_irradiance());
        let polar =
            self.polar.as_ref().filter(|_| self.polar_fresh).map_or(LatLongView::NONE, |p| p.map.view());
        let map = Map { pyramid: view, polar };
        let Sampled { decomposition, sample, filter } =
            sample(self.sampler.as_mut(), &map, &self.settings.request());
        let times = Times { front, pyramid: summed - front, sample, filter };
        Processed {
            decomposition,
            seen,
            scalar_flux: total.rgb(),
            horizontal_irradiance,
            frames_left_out,
            flicker: self.flicker,
            times,
        }
    }

    /// Merges the frames of a burst into the map; `added_up` is called after the pixels are summed and before the map is built from the
    /// sums.
    fn merge<'b>(
        &mut self,
        merged: impl Iterator<Item = &'b Frame> + Clone,
        added_up: impl FnOnce(),
    ) -> Result<Coverage, PipelineError> {
        self.follow_exposures(merged.clone().map(|frame| frame.exposure))?;
        let mut frames = [Samples::U8(&[]); MAX_EXPOSURES];
        let mut count = 0;
        for (slot, frame) in frames.iter_mut().zip(merged) {
            *slot = frame.pixels.samples();
            count += 1;
        }
        let seen = self.front.process_timed(&frames[..count], added_up)?;
        self.seen = Some(seen);
        self.was_seen = true;
        Ok(seen)
    }

    /// Limits the number of exposures that are merged of each later burst without contradictions to `most`: the shortest, the longest, and
    /// others evenly spaced between them.
    pub fn limit_exposures(&mut self, most: usize) {
        self.most_exposures = most;
    }

    /// Computes the lights of another sampler from the map of the last burst.
    pub fn sample_again<'a>(&mut self, sampler: &'a mut dyn Sampler, request: &Request) -> Sampled<'a> {
        let map = if sampler.needs_polar() {
            self.map()
        } else {
            Map { pyramid: self.front.map(), polar: LatLongView::NONE }
        };
        sample(sampler, &map, request)
    }

    /// Returns the quads of the last burst's map at `order`, or at the map's own order if that is less.
    #[must_use]
    pub fn sketch(&self, order: u8) -> &[Quad] {
        let view = self.front.map();
        view.quads_of(order.min(view.order().get()))
    }

    /// Rebuilds the merge tables if the exposures of a burst differ from those of the burst before.
    fn follow_exposures(
        &mut self,
        exposures: impl Iterator<Item = Exposure> + Clone,
    ) -> Result<(), PipelineError> {
        if !self.exposures.iter().copied().eq(exposures.clone()) {
            let exposures: Vec<_> = exposures.collect();
            match self.front.set_exposures(&exposures) {
                Ok(()) => {}
                Err(FrontError::Memory(_)) => {
                    self.front = front_end(self.front.calibration(), &exposures, &self.settings)?;
                    self.seen = None;
                }
                Err(error) => return Err(error.into()),
            }
            self.exposures = exposures;
        }
        Ok(())
    }

    /// Returns the settings of the pipeline that are in effect.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Returns true if the sampler reads the polar map.
    #[must_use]
    pub fn needs_polar(&self) -> bool {
        self.sampler.needs_polar()
    }

    /// Returns true if a burst was merged since the map was made.
    #[must_use]
    pub fn has_map(&self) -> bool {
        self.seen.is_some()
    }

    /// Returns the memory of the inspector that compares the frames of a burst, bytes.
    #[must_use]
    pub fn inspector_bytes(&self) -> usize {
        self.inspector.bytes()
    }

    /// Returns the size of the sampler's own state, without the buffers that a memory plan lists, bytes.
    #[must_use]
    pub fn sampler_bytes(&self) -> usize {
        size_of_val(&*self.sampler)
    }

    /// Returns the calibration of the camera whose bursts the pipeline processes.
    #[must_use]
    pub fn calibration(&self) -> &Calibration {
        self.front.calibration()
    }

    /// Returns the front end, which computes the map.
    #[must_use]
    pub fn front(&self) -> &FrontEnd<Vec<u64>> {
        &self.front
    }

    /// Returns the number of exposures of the last burst.
    #[must_use]
    pub fn exposures(&self) -> usize {
        self.sliding.as_ref().map_or(self.exposures.len(), Sliding::exposures)
    }

    /// Returns the map of the last burst, computed by the stages before the sampler.
    pub fn map(&mut self) -> Map<'_> {
        let shape = self.shape();
        let polar = self.polar.get_or_insert_with(|| Polar::new(&shape));
        if !self.polar_fresh {
            polar.fill(&self.front.map());
            self.polar_fresh = true;
        }
        Map { pyramid: self.front.map(), polar: polar.map.view() }
    }
}

/// Runs `sampler` on `map` and measures its durations.
fn sample<'a>(sampler: &'a mut dyn Sampler, map: &Map<'_>, request: &Request) -> Sampled<'a> {
    let began = Instant::now();
    let mut clock = || u64::try_from(began.elapsed().as_nanos()).unwrap_or(u64::MAX);
    let mut timer = Timer::new(&mut clock);
    let decomposition = sampler.update_timed(map, request, &mut timer);
    let filter = Duration::from_nanos(timer.ns());
    Sampled { decomposition, sample: began.elapsed().saturating_sub(filter), filter }
}

#[cfg(test)]
mod tests;
