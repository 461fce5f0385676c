//! The loop of the processing thread.

use super::compare::SecondarySlot;
use super::ladder::{FrameTime, Ladder};
use super::light_follower::LightFollower;
use super::ring::Ring;
use super::settings::SETTINGS;
use super::settings_channel::SettingsRequest;
use super::status::QualityStatus;
use super::tiers::TierSamplers;
use super::{Config, Exposures, Link, Refusal};
use crate::calibration::{Burst, Frame};
use crate::clock;
use crate::light_set::{self, OwnedSet};
use crate::pipeline::{Pipeline, PipelineError, WindowMode};
use crate::source::{Source, SourceError};
use hemilux_core::Exposure;
use hemilux_core::wire::{Latency, LightSet, Unit};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Pause after a fault of the source: it limits the load of a loop over faults, and it is short compared with a client's wait for a frame.
pub(crate) const RETRY_PAUSE: Duration = Duration::from_millis(100);

/// Largest ratio of the shortest exposure of a burst to that of the source at which both count as the same exposure.
const MARGIN: f64 = 1.01;

/// Processes the bursts of a source and publishes their light sets: the state of the processing thread.
pub struct Worker {
    source: Box<dyn Source>,
    pipeline: Pipeline,
    burst: Burst,
    ring: Ring<OwnedSet>,
    /// The second sampler, while clients request a comparison.
    secondary: SecondarySlot,
    tiers: TierSamplers,
    /// The values of the settings in effect.
    config: Config,
    link: Arc<Link>,
    light: LightFollower,
    /// The steps of quality, which lower the quality where frames exceed the budget.
    ladder: Ladder,
    /// Number of bursts since the start, including those that were skipped.
    bursts: u32,
    /// Usual time from the end of a burst to its delivery by the source, microseconds: the smallest of the last frames.
    delivery_us: u32,
    /// The exposures that a complete burst of the source has.
    nominal: Vec<Exposure>,
    /// Number of light sets that were published since the start.
    frames: u64,
    /// End of the last burst, CLOCK_MONOTONIC, nanoseconds; at first the start of the probe.
    last_ns: u64,
    /// The last fault of the source that was logged; `None` when the fault has ended.
    fault: Option<String>,
}

impl Worker {
    /// Allocates the memory of all stages for `source` and `config`.
    ///
    /// # Errors
    /// [`PipelineError`] when the settings do not suit the source.
    pub fn try_new(mut source: Box<dyn Source>, name: String, config: Config) -> Result<Self, PipelineError> {
        if config.exposures_s.is_some() {
            source.set_exposures(config.exposures_s.as_deref()).map_err(PipelineError::Exposures)?;
        }
        source.notes().iter().for_each(|note| tracing::warn!("{note}"));
        let settings = config.pipeline.clone();
        let ring = Ring::with_lights(settings.lights);
        let ladder = Ladder::new(&settings, source.exposures().len());
        let nominal = source.exposures();
        let pipeline = Pipeline::try_new(*source.calibration(), &nominal, settings)?;
        let link = Link::new(name, config.clone(), exposures(&*source));
        Ok(Self {
            source,
            pipeline,
            burst: Burst::default(),
            ring,
            secondary: SecondarySlot::default(),
            tiers: TierSamplers::default(),
            config,
            link: Arc::new(link),
            ladder,
            light: LightFollower::default(),
            bursts: 0,
            delivery_us: u32::MAX,
            nominal,
            frames: 0,
            last_ns: clock::monotonic_ns(),
            fault: None,
        })
    }

    /// Returns the state that this thread and the server share.
    #[must_use]
    pub fn link(&self) -> Arc<Link> {
        Arc::clone(&self.link)
    }

    /// Processes bursts until the probe is stopped.
    pub(super) fn run(&mut self) {
        while !self.link.status.is_stopping() {
            self.link.status.count_turn();
            if self.step().is_err() {
                std::thread::park_timeout(RETRY_PAUSE);
            }
        }
    }

    /// Waits for one burst and publishes its lights; returns without a set if no burst is due.
    ///
    /// # Errors
    /// The fault of the source or of the burst, which [`ThreadStatus::failure`](super::ThreadStatus::failure) returns as well. The newest
    /// light set is then still available to clients.
    pub fn step(&mut self) -> Result<(), SourceError> {
        self.follow_switch();
        let began = Instant::now();
        self.burst.phase_ns = 0;
        let is_sliding = self.pipeline.settings().window == WindowMode::Sliding;
        if !self.source.set_sliding(is_sliding) {
            self.burst.stale = 0;
        }
        let outcome = self.source.next(&mut self.burst);
        let capture = began.elapsed();
        let outcome = outcome.and_then(|()| self.check_complete());
        self.follow_requests();
        self.link.note_camera(&*self.source);
        let outcome = outcome.and_then(|()| self.follow_camera());
        let outcome = outcome.and_then(|()| if self.is_left_out() { Ok(()) } else { self.process(capture) });
        match outcome {
            Ok(()) => self.recover(),
            Err(SourceError::NotYet) => {}
            Err(error) => {
                self.fail(&error);
                if let Some(set) = self.link.sets.latest() {
                    self.link.views.serve_last(&mut self.pipeline, &set);
                }
                return Err(error);
            }
        }
        Ok(())
    }

    fn process(&mut self, capture: Duration) -> Result<(), SourceError> {
        let ended_ns = self.end_of_burst();
        let delivery_us = clock::us_since(ended_ns);
        self.link.durations.start_frame(Instant::now());
        let name = self.config.pipeline.sampler.name();
        let requested = u32::try_from(self.config.pipeline.lights).unwrap_or(u32::MAX);
        self.pipeline.expect_exposures(&self.nominal);
        let processed = self.pipeline.process(&self.burst);
        let mut processed = processed.map_err(|e| SourceError::Broken(e.to_string()))?;
        if self.config.slowdown > 1.0 {
            let slowed = processed.times.slowed(self.config.slowdown);
            std::thread::sleep(slowed.sum().saturating_sub(processed.times.sum()));
            processed.times = slowed;
        }
        let mut latency = Latency {
            capture: u32::try_from(capture.as_micros()).unwrap_or(u32::MAX),
            encode: self.link.durations.encode_us(),
            ..processed.times.latency()
        };
        let lux = self.source.lux();
        let made = LightSet {
            run: &self.link.run,
            frame: self.frames,
            timestamp_ns: ended_ns,
            valid: true,
            sampler: name,
            requested,
            unit: lux.map_or(Unit::Relative, |_| Unit::Lux),
            unit_uncertainty: lux.map(|lux| lux.uncertainty),
            ..processed.light_set()
        };
        let durations = &self.link.durations;
        let set = self.ring.fill(|set| {
            light_set::copy(&made, set);
            latency.total = clock::us_since(ended_ns);
            set.latency = latency;
            set.overrun = durations.add(&latency, self.ladder.quality().every);
            set.wall_ms = clock::wall_ms();
            set.degraded = self.ladder.quality().steps;
        });
        self.frames += 1;
        self.link.status.count_left_out(&set.frames_left_out);
        self.tiers.sample(&self.link.tiers, &mut self.pipeline, &set);
        self.link.sets.publish(Arc::clone(&set));
        self.secondary.compare(&self.link.comparison, &mut self.pipeline, &set);
        self.link.views.serve(&self.burst, &mut self.pipeline, &set, lux);
        if self.follows_light()
            && self.light.follow(self.source.as_mut(), &self.burst, f64::from(set.clipped))
        {
            self.link.settings.set_exposures(exposures(&*self.source));
        }
        self.light.follow_lamps(self.source.as_mut(), self.config.pipeline.lamps, &set.flicker);
        self.follow_duration(set.latency.total, delivery_us);
        self.burst.stale = u16::MAX;
        Ok(())
    }

    /// Returns true if the exposures follow the light: by the setting, or by the default of the source unless the setting
    /// `exposures_s` fixes them.
    fn follows_light(&self) -> bool {
        let is_free = self.config.exposures_s.is_none();
        self.config.auto_exposures || (is_free && self.source.follows_light())
    }

    /// Counts a burst; returns true if the burst is skipped at the present quality.
    fn is_left_out(&mut self) -> bool {
        self.bursts = self.bursts.wrapping_add(1);
        !self.ladder.quality().reads(self.bursts)
    }

    /// Lowers or raises the quality after a frame that took `total_us` microseconds, of which `delivery_us` passed before the processing.
    /// The part of `delivery_us` above the usual delivery time is not counted: a lower quality would not shorten it.
    fn follow_duration(&mut self, total_us: u32, delivery_us: u32) {
        if !self.config.degrade {
            return;
        }
        self.delivery_us = delivery_us.min(self.delivery_us.saturating_add(self.delivery_us / 16 + 1));
        let us = total_us - delivery_us.min(total_us) + self.delivery_us.min(delivery_us);
        let budget_us = self.config.budgets.total();
        if self.ladder.add(FrameTime { us, budget_us, now: self.link.started.elapsed() }) {
            self.apply_quality();
        }
    }

    /// Applies the present step of quality to the pipeline.
    fn apply_quality(&mut self) {
        let quality = *self.ladder.quality();
        let settings = quality.settings(&self.config.pipeline);
        self.link.tiers.follow(&settings, self.config.tiers);
        if let Err(error) = self.pipeline.configure(settings) {
            tracing::warn!("the quality stays as it was: {error}");
        }
        self.pipeline.limit_exposures(quality.exposures);
        let [down, up] = self.ladder.steps();
        self.link.status.set_quality(QualityStatus { steps: quality.steps, down, up });
        let names: Vec<_> = quality.steps.names().collect();
        tracing::info!(
            "quality: steps in force: {}",
            if names.is_empty() { "none".into() } else { names.join(", ") }
        );
    }

    /// Returns to the full quality of the settings, also where the number of exposures per burst has changed.
    fn reset_quality(&mut self) {
        self.ladder.reset(&self.config.pipeline, self.nominal.len());
        self.apply_quality();
    }

    /// Returns the end of the present burst, CLOCK_MONOTONIC, nanoseconds: the timestamp of the burst, or the present time where the
    /// timestamp is in the future or not later than the end of the previous burst.
    fn end_of_burst(&mut self) -> u64 {
        let (stated, now) = (self.burst.timestamp_ns, clock::monotonic_ns());
        self.last_ns = if stated > self.last_ns && stated <= now { stated } else { now };
        self.last_ns
    }

    /// Refuses a burst that lacks the shortest exposure of the source, without which the brightest light is
    /// clipped. A request may change the exposures of the source thereafter, but not those of this burst.
    fn check_complete(&mut self) -> Result<(), SourceError> {
        let frames = &self.burst.frames;
        let first = frames.first().map_or(f64::INFINITY, Frame::light);
        let is_shortest = |shortest: &Exposure| first <= MARGIN * shortest.seconds * shortest.gain;
        if frames.iter().map(|frame| frame.exposure).eq(self.nominal.iter().copied()) {
            return Ok(());
        }
        let exposures = self.source.exposures();
        if exposures != self.nominal {
            self.nominal = exposures;
            self.link.settings.set_exposures(self::exposures(&*self.source));
        }
        if self.nominal.len() != self.ladder.exposures() {
            self.reset_quality();
        }
        let (found, expected) = (self.burst.frames.len(), self.nominal.len());
        // In a burst from before a change of the exposures, the shortest exposure equals no later exposure of the source.
        let is_same = |later: &Exposure| (first / (later.seconds * later.gain) - 1.0).abs() < MARGIN - 1.0;
        let has_lost = found < expected || self.nominal.iter().skip(1).any(is_same);
        if !has_lost || self.nominal.first().is_some_and(is_shortest) {
            return Ok(());
        }
        Err(SourceError::Broken(format!(
            "burst: found {found} frames without the shortest exposure, expected {expected} frames"
        )))
    }

    /// Replaces the source if a client has requested another one.
    fn follow_switch(&mut self) {
        let Some(source) = self.link.source.take() else { return };
        self.source = source;
        // A sliding window begins with a whole burst of the new source.
        self.burst.frames.clear();
        self.source.notes().iter().for_each(|note| tracing::warn!("{note}"));
        self.light.greet(self.source.as_mut());
        self.link.settings.set_exposures(exposures(&*self.source));
    }

    /// Replaces the pipeline if the calibration of the source has changed, for example after a camera was connected.
    fn follow_camera(&mut self) -> Result<(), SourceError> {
        let calibration = self.source.calibration();
        if calibration == self.pipeline.calibration() {
            return Ok(());
        }
        let settings = self.pipeline.settings().clone();
        let made = Pipeline::try_new(*calibration, &self.source.exposures(), settings);
        self.pipeline = made.map_err(|e| SourceError::Broken(e.to_string()))?;
        self.pipeline.limit_exposures(self.ladder.quality().exposures);
        Ok(())
    }

    /// Applies the newest settings request of the clients, or answers it with the reason of its refusal.
    fn follow_requests(&mut self) {
        let Some(SettingsRequest { serial, config }) = self.link.settings.take() else { return };
        let refused = self.follow(&config).err();
        tell_changes(&self.config, &config, refused.as_ref());
        if refused.is_none() {
            let config = Config { slowdown: self.config.slowdown, ..config };
            let before = std::mem::replace(&mut self.config, config);
            let now = &self.config;
            if (now.degrade, &now.pipeline, &now.exposures_s)
                == (before.degrade, &before.pipeline, &before.exposures_s)
            {
                self.link.tiers.follow(self.pipeline.settings(), self.config.tiers);
            } else {
                self.reset_quality();
            }
        }
        let in_effect = self.config.clone();
        self.link.settings.answer(serial, in_effect, refused);
    }

    /// Applies all settings of `config` from the next frame on; after a refusal, all settings are unchanged.
    fn follow(&mut self, config: &Config) -> Result<(), Refusal> {
        let is_left = self.config.auto_exposures && !config.auto_exposures;
        let is_new = config.exposures_s != self.config.exposures_s || is_left;
        if is_new {
            let refused = |why| Refusal { setting: "exposures_s", why };
            self.source.set_exposures(config.exposures_s.as_deref()).map_err(refused)?;
        }
        let is_same = config.pipeline == self.config.pipeline;
        let settings = if is_same { self.pipeline.settings() } else { &config.pipeline };
        if let Err(error) = self.pipeline.configure(settings.clone()) {
            if is_new && self.source.set_exposures(self.config.exposures_s.as_deref()).is_err() {
                tracing::warn!("source {}: the earlier exposures are refused", self.link.source());
            }
            return Err(error.into());
        }
        self.link.settings.set_exposures(exposures(&*self.source));
        self.link.durations.set_budgets(config.budgets);
        self.ring.reserve(config.pipeline.lights);
        Ok(())
    }

    fn fail(&mut self, error: &SourceError) {
        let reason = error.to_string();
        if self.fault.as_ref() != Some(&reason) {
            tracing::warn!("source {}: {reason}", self.link.source());
            self.link.status.set_failure(Some(reason.clone()));
            self.fault = Some(reason);
        }
    }

    fn recover(&mut self) {
        if self.fault.take().is_some() {
            tracing::info!("source {}: bursts again", self.link.source());
            self.link.status.set_failure(None);
        }
    }
}

/// Logs each setting whose value differs between `before` and `after`.
fn tell_changes(before: &Config, after: &Config, refused: Option<&Refusal>) {
    if let Some(refusal) = refused {
        tracing::info!("settings: {refusal}; nothing was changed");
        return;
    }
    for setting in SETTINGS {
        let (old, new) = (setting.value(before), setting.value(after));
        if old != new {
            tracing::info!("setting {}: {old} becomes {new}", setting.name);
        }
    }
}

impl Drop for Worker {
    /// Reports the end of the thread to waiting clients.
    fn drop(&mut self) {
        self.link.status.set_failure(Some("the processing thread has ended".into()));
        self.link.status.set_ended();
    }
}

fn exposures(source: &dyn Source) -> Exposures {
    let seconds = source.exposures().iter().map(|e| e.seconds).collect();
    Exposures { seconds, fixed: source.fixed_exposures() }
}

#[cfg(test)]
mod tests;
