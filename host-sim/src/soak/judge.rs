//! Comparison of every published set with the known light of its burst, and the recovery from each fault.
//!
//! Under lamps on the mains, the light of a burst is the mean over a period of the lamps. Sets of bursts whose flicker is not removed, or not yet,
//! may have any light that the exposures of the burst record. Few sets may differ from the mean after that; none may have more or less than
//! exposures at any phase record.

use super::camera::{Light, Newest};
use super::lamps::{LampRange, LampWatch, SetState};
use super::tally::{Published, Tally};
use hemilux::light_set::OwnedSet;
use hemilux::pipeline::Settings;
use hemilux::probe::Link;
use hemilux::source::{Fault, FaultCounts};
use hemilux_core::color::luminance;
use hemilux_core::wire::FramesLeftOut;
use hemilux_core::{Extrapolation, SamplerKind};
use std::collections::VecDeque;
use std::fmt;
use std::sync::Arc;

/// Largest relative difference between the flux of a set and the flux of its burst; beyond it the set counts as wrong.
const WRONG: f64 = 0.04;

/// Number of bursts after a fault within which a set of all frames must follow for the fault to count as recovered.
const RECOVERY: u64 = 2;

/// Largest share of the flux of a map that may be missing from the set of a sampler without a temporal filter.
const LOST: f32 = 2e-3;

/// Number of wrong sets and unrecovered faults that the report describes.
const DESCRIBED: usize = 20;

/// Number of bursts up to that of a wrong set or an unrecovered fault that its description lists.
const LISTED: usize = 8;

/// Numbers of recovered and unrecovered faults of one kind.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct FaultOutcome {
    pub seen: u64,
    /// Number of faults that a set of all frames followed within [`RECOVERY`] bursts.
    pub recovered: u64,
    /// Number of faults of the kind that no set of all frames followed within [`RECOVERY`] bursts.
    pub unrecovered: u64,
}

/// Fluxes of sets without and with extrapolation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fluxes {
    /// Flux of the daylight at the brightest moment.
    pub day: [f64; 2],
    /// Flux of the lamps at the mean of their waveform.
    pub lamps: [f64; 2],
}

/// Counts of the sets and faults of a soak test.
#[derive(Debug, Default)]
pub(super) struct Outcome {
    /// Number of published sets.
    pub sets: u64,
    /// Number of bursts without a set.
    pub failed: u64,
    /// Number of sets that repeat the lights of an earlier burst.
    pub held: u64,
    /// Number of sets that lack frames of their burst.
    pub left_out: u64,
    /// Number of sets of degraded quality.
    pub degraded: u64,
    /// Number of sets while the lamps are lit.
    pub lit: u64,
    /// Number of these sets with a setting `mains` with which the probe searches the frequency of the lamps.
    pub searched: u64,
    /// Number of the latter sets in which the lamps are found.
    pub found: u64,
    /// Number of sets whose flux differs from the mean of the lamps although they have been found for sixteen bursts, or are off.
    pub off_mean: u64,
    pub wrong: u64,
    /// Faults by kind, in the order of [`Fault::ALL`].
    pub faults: [FaultOutcome; Fault::ALL.len()],
    /// Descriptions of the first wrong sets and unrecovered faults.
    pub words: Vec<String>,
}

/// Compares the published sets of a soak test with the light of their bursts.
pub(super) struct SetJudge {
    flux: Fluxes,
    newest: Newest,
    tally: Arc<Tally>,
    counts: Arc<FaultCounts>,
    /// Flux of the newest set that does not repeat the lights of an earlier burst.
    merged: f64,
    lamps: LampWatch,
    /// Name of the kind of the last fault.
    last: &'static str,
    /// Number of faults of each kind that no set of all frames has followed so far.
    pending: [u64; Fault::ALL.len()],
    /// Number of bursts since the last fault.
    since: u64,
    /// The last bursts, oldest first.
    recent: VecDeque<JudgedBurst>,
    outcome: Outcome,
}

/// A burst in the description of a wrong set or an unrecovered fault.
struct JudgedBurst {
    /// Name of the kind of the fault of the burst; empty if it has none.
    fault: &'static str,
    /// Exposure times of the source after the burst, seconds.
    seconds: Vec<f64>,
    /// Frames that the set of the burst lacks; `None` for a burst without a set.
    left_out: Option<FramesLeftOut>,
}

impl fmt::Display for JudgedBurst {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {:?} s", if self.fault.is_empty() { "sound" } else { self.fault }, self.seconds)?;
        match &self.left_out {
            None => f.write_str(" without a set"),
            Some(frames) => frames
                .iter()
                .try_for_each(|frame| write!(f, " without frame {} ({})", frame.index, frame.fault.name())),
        }
    }
}

impl SetJudge {
    pub fn new(flux: Fluxes, newest: &Newest, tally: &Arc<Tally>, counts: &Arc<FaultCounts>) -> Self {
        Self {
            flux,
            newest: newest.clone(),
            tally: Arc::clone(tally),
            counts: Arc::clone(counts),
            merged: 0.0,
            lamps: LampWatch::default(),
            last: "",
            pending: [0; Fault::ALL.len()],
            since: 0,
            recent: VecDeque::with_capacity(LISTED),
            outcome: Outcome::default(),
        }
    }

    /// Returns the counts so far.
    pub fn outcome(&self) -> &Outcome {
        &self.outcome
    }

    pub fn into_outcome(self) -> Outcome {
        self.outcome
    }

    fn wrong(&mut self, frame: u64, what: &str) {
        self.outcome.wrong += 1;
        self.describe(&format!("wrong: frame {frame}: {what}"));
    }

    /// Adds a description of `what` with the light and the last bursts.
    fn describe(&mut self, what: &str) {
        if self.outcome.words.len() < DESCRIBED {
            let (light, bursts) = (self.newest.light(), self.recent.iter().map(ToString::to_string));
            let bursts = bursts.collect::<Vec<_>>().join(", ");
            let line = format!("{what}; {light:?}; last bursts: {bursts}");
            eprintln!("soak: {line}");
            self.outcome.words.push(line);
        }
    }

    /// Updates the counts after the probe has processed a burst; `is_ok` is false if the burst failed.
    pub fn judge_burst(&mut self, link: &Link, is_ok: bool) {
        self.count_faults();
        let latest = link.sets().latest().filter(|set| set.frame >= self.outcome.sets);
        if self.recent.len() == LISTED {
            self.recent.pop_front();
        }
        self.recent.push_back(JudgedBurst {
            fault: if self.since == 0 { self.last } else { "" },
            seconds: link.settings().exposures().seconds,
            left_out: latest.as_ref().map(|set| set.frames_left_out),
        });
        let is_whole = latest.as_ref().is_some_and(|set| self.judge_set(link, set));
        self.outcome.failed += u64::from(!is_ok);
        if self.since > 0 && is_whole {
            self.settle(|outcome, count| outcome.recovered += count);
        } else if self.since > RECOVERY && latest.is_some() {
            // The probe publishes no set of a burst that it skips to keep the budget.
            if self.pending != [0; Fault::ALL.len()] {
                let settings = link.settings().applied().borrow().config.pipeline.clone();
                self.describe(&format!("unrecovered: burst {}: {settings:?}", self.newest.bursts()));
            }
            self.settle(|outcome, count| outcome.unrecovered += count);
        }
    }

    fn count_faults(&mut self) {
        self.since += 1;
        for (((name, count), outcome), pending) in
            self.counts.named().zip(&mut self.outcome.faults).zip(&mut self.pending)
        {
            if count > outcome.seen {
                *pending += count - outcome.seen;
                outcome.seen = count;
                (self.last, self.since) = (name, 0);
            }
        }
    }

    fn settle(&mut self, count: impl Fn(&mut FaultOutcome, u64)) {
        for (outcome, pending) in self.outcome.faults.iter_mut().zip(&mut self.pending) {
            count(outcome, std::mem::take(pending));
        }
    }

    /// Compares the flux of the newest set with the flux of its burst; returns whether all frames of the burst were merged.
    fn judge_set(&mut self, link: &Link, set: &OwnedSet) -> bool {
        self.outcome.sets = set.frame + 1;
        self.tally.publish(set.frame, Published { flux: set.scalar_flux, timestamp_ns: set.timestamp_ns });
        let config = link.settings().applied().borrow().config.pipeline.clone();
        let flux = f64::from(set.scalar_flux[1]);
        let is_held = is_held(&set.frames_left_out);
        self.outcome.held += u64::from(is_held);
        self.outcome.left_out += u64::from(!set.frames_left_out.is_empty());
        self.outcome.degraded += u64::from(!set.degraded.is_none());
        let ranges = self.ranges(link, set, &config);
        let [usual, [least, most]] = if is_held { [[self.merged; 2]; 2] } else { ranges };
        // The repeated set may be older than a change of the extrapolation.
        if !is_held || self.merged <= 0.0 {
            self.merged = flux;
        }
        let is_within =
            |[least, most]: [f64; 2]| flux >= (1.0 - WRONG) * least && flux <= (1.0 + WRONG) * most;
        self.outcome.off_mean += u64::from(!is_within(usual) && is_within([least, most]));
        if !is_within([least, most]) {
            let left_out: Vec<_> = set.frames_left_out.iter().collect();
            let seconds = &link.settings().exposures().seconds;
            let set_up = format!("{seconds:?} s, {:?}, {:?}, {:?}", config.merge, config.lamps, set.flicker);
            let expected = format!("expected {least} to {most}");
            self.wrong(set.frame, &format!("flux {flux}, {expected}; {left_out:?}; {set_up}"));
        }
        // `pharr` keeps the luminance, not the single colours.
        let missing = set.view().missing_flux().map_or(0.0, luminance).abs() / luminance(set.scalar_flux);
        if missing > LOST && config.sampler != SamplerKind::HemigonFir {
            self.wrong(
                set.frame,
                &format!("the lights of {} lack the share {missing} of the flux", set.sampler),
            );
        }
        set.frames_left_out.is_empty()
    }

    /// Returns the usual and the possible least and most flux of a set of the newest burst, and counts sets under lamps.
    fn ranges(&mut self, link: &Link, set: &OwnedSet, config: &Settings) -> [[f64; 2]; 2] {
        let Light { day, lamps } = self.newest.light();
        let exposures = link.settings().exposures();
        let state = SetState {
            lamps,
            setting: config.lamps,
            flicker: set.flicker,
            seconds: &exposures.seconds,
            is_partial: self.since == 0 || !set.frames_left_out.is_empty(),
        };
        if let Some(lamps) = lamps {
            self.outcome.lit += 1;
            if lamps.is_searched(config.lamps) {
                self.outcome.searched += 1;
                self.outcome.found += u64::from(set.flicker.frequency_hz.is_some());
            }
        }
        let which = usize::from(config.extrapolation == Extrapolation::Average);
        let (day, lit) = (self.flux.day[which] * day, self.flux.lamps[which]);
        let LampRange { usual, possible } = self.lamps.follow(&state);
        [usual, possible].map(|range| range.map(|light| day + light * lit))
    }
}

/// Returns whether a set repeats the lights of the burst before: the shortest exposure and others were left out.
fn is_held(left_out: &FramesLeftOut) -> bool {
    left_out.contains(0) && left_out.iter().count() > 1
}
