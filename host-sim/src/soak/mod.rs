//! Soak test: days of simulated time through the probe's pipeline, server and sockets, with clients of every kind, changes of every setting and
//! faults of the source. The source does not wait between bursts; ten bursts count as a second of simulated time.

mod camera;
mod clients;
mod report;
mod tally;

use crate::error::SimError;
use camera::{DayCamera, Daylight};
use hemilux::pipeline::{Pipeline, Settings};
use hemilux::probe::settings::SETTINGS;
use hemilux::probe::{Config, Link, Worker};
use hemilux::server::{self, KnownHosts, Limits, Options};
use hemilux::source::{FaultCounts, FaultSource, FaultSpec, Source};
use hemilux_core::wire::FramesLeftOut;
use hemilux_core::{Extrapolation, SamplerKind};
use report::SoakReport;
use std::net::{Ipv4Addr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use tally::Tally;

/// Bursts per second of simulated time.
pub const FRAMES_A_SECOND: u64 = 10;

/// Largest relative difference between the flux of a set and the flux of its burst; beyond it the set counts as wrong.
const WRONG: f64 = 0.04;

/// Number of bursts after a fault within which a set of all frames must follow.
const RECOVERY: u64 = 2;

/// Largest share of the flux that may be missing from a set without a temporal filter.
const LOST: f32 = 2e-3;

/// Pause between attempts to read a burst while the device is gone.
const RETRY: Duration = Duration::from_millis(1);

/// Relative light below which most samples of the longest exposure are under 1/128 of the full scale: not every false frame can be detected there.
const DARK: f64 = 0.03;

/// Number of wrong sets that the report describes.
const DESCRIBED: usize = 10;

/// The memory at 1/`WARM` of the run is the baseline for its growth.
const WARM: u64 = 10;

/// Parameters of a soak test.
#[derive(Clone, Debug)]
pub struct SoakJob {
    /// Number of bursts.
    pub frames: u64,
    /// Faults of the source.
    pub faults: FaultSpec,
    /// Least number of replies; further bursts are processed until the clients have received as many.
    pub replies: u64,
}

/// Comparison of every published set with the known light of its burst, and the counts for the report.
struct SetJudge {
    /// Flux at the brightest moment without and with extrapolation.
    flux: [f64; 2],
    daylight: Daylight,
    tally: Arc<Tally>,
    counts: Arc<FaultCounts>,
    /// Flux of the newest set that does not repeat the lights of an earlier burst.
    merged: f64,
    /// Number of published sets.
    frames: u64,
    /// Number of bursts without a set.
    failed: u64,
    /// Number of sets that repeat the lights of the burst before.
    held: u64,
    /// Number of sets that lack frames of their burst.
    left_out: u64,
    /// Number of sets of degraded quality.
    degraded: u64,
    /// Number of bursts since the last fault; `None` after a set of all frames.
    since: Option<u64>,
    /// Number of faults at the last burst.
    faults: u64,
    /// Number of faults that a set of all frames followed within [`RECOVERY`] bursts.
    recovered: u64,
    /// Number of faults without a set of all frames within [`RECOVERY`] bursts.
    unrecovered: u64,
    /// Number of wrong sets whose relative light is at least [`DARK`].
    wrong: u64,
    /// Number of wrong sets whose relative light is below [`DARK`].
    dark: u64,
    /// Descriptions of the first wrong sets.
    words: Vec<String>,
}

impl SetJudge {
    fn new(flux: [f64; 2], daylight: &Daylight, tally: &Arc<Tally>, counts: &Arc<FaultCounts>) -> Self {
        Self {
            flux,
            daylight: daylight.clone(),
            tally: Arc::clone(tally),
            counts: Arc::clone(counts),
            merged: 0.0,
            frames: 0,
            failed: 0,
            held: 0,
            left_out: 0,
            degraded: 0,
            since: None,
            faults: 0,
            recovered: 0,
            unrecovered: 0,
            wrong: 0,
            dark: 0,
            words: Vec::new(),
        }
    }

    /// Counts a wrong set and stores its description.
    fn wrong(&mut self, description: impl FnOnce() -> String) {
        if self.daylight.light() < DARK {
            self.dark += 1;
            return;
        }
        self.wrong += 1;
        if self.words.len() < DESCRIBED {
            self.words.push(description());
        }
    }

    /// Updates the counts after the probe has processed a burst; `is_ok` is false if the burst failed.
    fn judge_burst(&mut self, link: &Link, is_ok: bool) {
        let faults: u64 = self.counts.named().map(|(_, n)| n).sum();
        self.since = if faults > self.faults { Some(0) } else { self.since.map(|bursts| bursts + 1) };
        self.faults = faults;
        let is_new = link.sets().latest().is_some_and(|set| set.frame >= self.frames);
        let is_whole = is_new && self.judge_set(link);
        self.failed += u64::from(!is_ok);
        // The probe publishes no set of a burst that it skips to keep the budget.
        if is_whole && self.since.is_some_and(|bursts| bursts > 0) {
            self.recovered += 1;
            self.since = None;
        } else if self.since.is_some_and(|bursts| bursts > RECOVERY) && is_new {
            self.unrecovered += 1;
            self.since = None;
        }
    }

    /// Compares the flux of the newest set with the flux of its burst; returns whether all frames of the burst were merged.
    fn judge_set(&mut self, link: &Link) -> bool {
        let Some(set) = link.sets().latest() else { return false };
        self.frames = set.frame + 1;
        self.tally.publish(set.frame, set.scalar_flux);
        let config = link.settings().applied().borrow().config.pipeline.clone();
        let flux = f64::from(set.scalar_flux[1]);
        let is_held = is_held(&set.frames_left_out);
        self.held += u64::from(is_held);
        self.left_out += u64::from(!set.frames_left_out.is_empty());
        self.degraded += u64::from(!set.degraded.is_none());
        let full = self.flux[usize::from(config.extrapolation == Extrapolation::Average)];
        let expected = if is_held { self.merged } else { full * self.daylight.light() };
        // The repeated set may be older than a change of the extrapolation.
        if !is_held || self.merged <= 0.0 {
            self.merged = flux;
        }
        if (flux / expected - 1.0).abs() > WRONG || !flux.is_finite() {
            let left_out = set.frames_left_out;
            self.wrong(|| format!("frame {}: flux {flux}, expected {expected}; {left_out:?}", set.frame));
        }
        let missing = set.view().missing_flux().map_or(0.0, |flux| flux[1].abs() / set.scalar_flux[1]);
        if missing > LOST && config.sampler != SamplerKind::HemigonFir {
            self.wrong(|| {
                format!(
                    "frame {}: the lights of {} lack the share {missing} of the flux",
                    set.frame, set.sampler
                )
            });
        }
        set.frames_left_out.is_empty()
    }
}

/// Returns whether a set repeats the lights of the burst before, since no frame of its own burst was usable.
fn is_held(left_out: &FramesLeftOut) -> bool {
    left_out.contains(0)
}

/// Returns the flux at the brightest moment without and with extrapolation, computed from a burst without faults.
fn brightest() -> Result<[f64; 2], SimError> {
    let mut camera = camera(2)?;
    let mut burst = hemilux::calibration::Burst::default();
    let failed = |e: &dyn std::fmt::Display| SimError::Failed(format!("soak: {e}"));
    for _ in 0..2 {
        camera.next(&mut burst).map_err(|e| failed(&e))?;
    }
    let light = camera.daylight().light();
    let mut flux = [0.0; 2];
    for (flux, extrapolation) in flux.iter_mut().zip([Extrapolation::None, Extrapolation::Average]) {
        let settings = Settings { extrapolation, ..Settings::default() };
        let mut pipeline = Pipeline::try_new(*camera.calibration(), &camera.exposures(), settings)?;
        *flux = f64::from(pipeline.process(&burst)?.scalar_flux[1]) / light;
    }
    Ok(flux)
}

fn camera(frames: u64) -> Result<DayCamera, SimError> {
    DayCamera::try_new(frames)
        .ok_or_else(|| SimError::Failed("soak: found an illegal lens or layout of its camera".into()))
}

/// Runs a soak test and returns its report.
///
/// # Errors
/// [`SimError`] if the probe or the server cannot start; violated requirements are in the report.
pub fn run(job: &SoakJob) -> Result<SoakReport, SimError> {
    let failed = |e: &dyn std::fmt::Display| {
        SimError::Failed(format!("soak: found {e}, expected a probe and a server that start"))
    };
    let flux = brightest()?;
    let camera = camera(job.frames)?;
    let daylight = camera.daylight();
    let faulty = FaultSource::new(Box::new(camera), job.faults.clone());
    let (counts, tally) = (faulty.counts(), Arc::new(Tally::new()));
    let mut worker = Worker::try_new(Box::new(faulty), "soak".into(), Config::default())?;
    let link = worker.link();
    let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).map_err(|e| failed(&e))?;
    let address = listener.local_addr().map_err(|e| failed(&e))?;
    let options = Options { hosts: KnownHosts::of(address, &[]), ..Options::default() };
    let app = server::app(Arc::clone(&link), options);
    let running = server::start(listener, app, Limits::default()).map_err(|e| failed(&e))?;
    let (began, descriptors) = (Instant::now(), report::descriptors());
    let mut judge = SetJudge::new(flux, &daylight, &tally, &counts);
    let threads = clients::start(address, &tally).map_err(|e| failed(&e))?;
    let (mut bursts, mut warm_kb, mut most_kb) = (0, 0, 0);
    while bursts < job.frames || tally.replies.load(Ordering::Relaxed) < job.replies {
        let is_ok = worker.step().is_ok();
        let taken = daylight.bursts();
        if taken == bursts {
            // The device is gone.
            std::thread::sleep(RETRY);
            continue;
        }
        bursts = taken;
        judge.judge_burst(&link, is_ok);
        if bursts == job.frames / WARM {
            warm_kb = report::resident_kb();
        }
        if bursts % 1000 == 0 {
            most_kb = report::resident_kb().max(most_kb);
            // The threads of the clients run.
            std::thread::yield_now();
        }
    }
    let (resident_kb, took) = (report::resident_kb(), began.elapsed());
    tally.over.store(true, Ordering::Relaxed);
    // Further sets unblock the clients that wait for one.
    while threads.iter().any(|thread| !thread.is_finished())
        && began.elapsed() < took + Duration::from_secs(20)
    {
        let _ = worker.step();
    }
    std::thread::sleep(Duration::from_millis(500));
    let left = report::descriptors();
    running.stop();
    Ok(SoakReport {
        bursts,
        frames: judge.frames,
        failed: judge.failed,
        held: judge.held,
        left_out: judge.left_out,
        degraded: judge.degraded,
        wrong: judge.wrong,
        dark: judge.dark,
        recovered: judge.recovered,
        unrecovered: judge.unrecovered,
        faults: counts.named().collect(),
        quality: link.status().quality(),
        settings: [tally.settings(), SETTINGS.len()],
        memory_kb: [warm_kb, resident_kb, most_kb],
        descriptors: [descriptors, left],
        took,
        words: judge.words,
        tally,
    })
}
