//! A soak: days of simulated time over the real pipeline, server and sockets, with clients of every kind, changes of every setting and faults of
//! the source. Bursts come as fast as they are processed; ten of them are a second.

mod camera;
mod clients;
mod report;
mod tally;

use crate::error::SimError;
use camera::{DayCamera, Truth};
use hemilux::pipeline::{Pipeline, Settings};
use hemilux::probe::settings::SETTINGS;
use hemilux::probe::{Config, Link, Worker};
use hemilux::server::{self, KnownHosts, Limits, Options};
use hemilux::source::{FaultCounts, FaultSource, FaultSpec, Source};
use hemilux_core::wire::FramesLeftOut;
use hemilux_core::{Extrapolation, SamplerKind};
use report::Report;
use std::net::{Ipv4Addr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use tally::Tally;

/// Bursts of a second of simulated time.
pub const FRAMES_A_SECOND: u64 = 10;

/// Largest relative difference of the flux of a set and that of its burst.
const WRONG: f64 = 0.04;

/// Bursts after a fault until a set has all of its frames.
const RECOVERY: u64 = 2;

/// Largest share of the flux that a set without a temporal filter may lose.
const LOST: f32 = 2e-3;

/// Pause before the next attempt while the device is gone.
const RETRY: Duration = Duration::from_millis(1);

/// Light below which most samples of the longest exposure are under 1/128 of the full scale: not every false frame can be detected there.
const DARK: f64 = 0.03;

/// Wrong sets that are described.
const DESCRIBED: usize = 10;

/// Part of the run after which the memory counts as taken.
const WARM: u64 = 10;

/// Parameters of a soak.
#[derive(Clone, Debug)]
pub struct Job {
    /// Number of bursts.
    pub frames: u64,
    /// Faults of the source.
    pub faults: FaultSpec,
    /// Fewest replies; bursts beyond `frames` follow until there are so many.
    pub replies: u64,
}

/// The expected light of each burst, with which the sets are compared.
struct Judge {
    /// Flux at the brightest moment without and with extrapolation.
    flux: [f64; 2],
    truth: Truth,
    tally: Arc<Tally>,
    counts: Arc<FaultCounts>,
    /// Flux of the last set that was merged.
    merged: f64,
    frames: u64,
    failed: u64,
    held: u64,
    left_out: u64,
    degraded: u64,
    /// Bursts since the last fault, until a set has all of its frames.
    since: Option<u64>,
    faults: u64,
    recovered: u64,
    unrecovered: u64,
    wrong: u64,
    /// Number of wrong sets whose light is below [`DARK`].
    dark: u64,
    words: Vec<String>,
}

impl Judge {
    fn new(flux: [f64; 2], truth: &Truth, tally: &Arc<Tally>, counts: &Arc<FaultCounts>) -> Self {
        Self {
            flux,
            truth: truth.clone(),
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

    fn wrong(&mut self, what: impl FnOnce() -> String) {
        if self.truth.light() < DARK {
            self.dark += 1;
            return;
        }
        self.wrong += 1;
        if self.words.len() < DESCRIBED {
            self.words.push(what());
        }
    }

    /// Looks at what a burst has come to.
    fn look(&mut self, link: &Link, is_ok: bool) {
        let faults: u64 = self.counts.named().map(|(_, n)| n).sum();
        self.since = if faults > self.faults { Some(0) } else { self.since.map(|bursts| bursts + 1) };
        self.faults = faults;
        let is_new = link.sets().latest().is_some_and(|set| set.frame >= self.frames);
        let is_whole = is_new && self.look_at_set(link);
        self.failed += u64::from(!is_ok);
        // Where bursts are left out to keep the budget, there is no set of some.
        if is_whole && self.since.is_some_and(|bursts| bursts > 0) {
            self.recovered += 1;
            self.since = None;
        } else if self.since.is_some_and(|bursts| bursts > RECOVERY) && is_new {
            self.unrecovered += 1;
            self.since = None;
        }
    }

    /// Compares the newest set with its burst; true where all frames were merged.
    fn look_at_set(&mut self, link: &Link) -> bool {
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
        let expected = if is_held { self.merged } else { full * self.truth.light() };
        // The map that is held may be the one of the other extrapolation.
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
                format!("frame {}: the lights of {} miss {missing} of the flux", set.frame, set.sampler)
            });
        }
        set.frames_left_out.is_empty()
    }
}

/// Whether a set repeats the lights of the burst before.
fn is_held(left_out: &FramesLeftOut) -> bool {
    left_out.contains(0)
}

/// The flux of the brightest moment in a clean burst, without and with extrapolation.
fn brightest() -> Result<[f64; 2], SimError> {
    let mut camera = camera(2)?;
    let mut burst = hemilux::calibration::Burst::default();
    let failed = |e: &dyn std::fmt::Display| SimError::Failed(format!("soak: {e}"));
    for _ in 0..2 {
        camera.next(&mut burst).map_err(|e| failed(&e))?;
    }
    let light = camera.truth().light();
    let mut flux = [0.0; 2];
    for (flux, extrapolation) in flux.iter_mut().zip([Extrapolation::None, Extrapolation::Average]) {
        let settings = Settings { extrapolation, ..Settings::default() };
        let mut pipeline = Pipeline::try_new(*camera.calibration(), &camera.exposures(), settings)?;
        *flux = f64::from(pipeline.process(&burst)?.scalar_flux[1]) / light;
    }
    Ok(flux)
}

fn camera(frames: u64) -> Result<DayCamera, SimError> {
    DayCamera::try_new(frames).ok_or_else(|| SimError::Failed("soak: found no camera".into()))
}

/// Runs a soak and returns its report.
///
/// # Errors
/// [`SimError`] if the soak cannot start; violated requirements are in the report.
pub fn run(job: &Job) -> Result<Report, SimError> {
    let failed =
        |e: &dyn std::fmt::Display| SimError::Failed(format!("soak: found {e}, expected it to start"));
    let flux = brightest()?;
    let camera = camera(job.frames)?;
    let truth = camera.truth();
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
    let mut judge = Judge::new(flux, &truth, &tally, &counts);
    let threads = clients::start(address, &tally).map_err(|e| failed(&e))?;
    let (mut bursts, mut warm_kb, mut most_kb) = (0, 0, 0);
    while bursts < job.frames || tally.replies.load(Ordering::Relaxed) < job.replies {
        let is_ok = worker.step().is_ok();
        let taken = truth.bursts();
        if taken == bursts {
            // The device is gone.
            std::thread::sleep(RETRY);
            continue;
        }
        bursts = taken;
        judge.look(&link, is_ok);
        if bursts == job.frames / WARM {
            warm_kb = report::resident_kb();
        }
        if bursts % 1000 == 0 {
            most_kb = report::resident_kb().max(most_kb);
            // The clients of the machine get their share of it.
            std::thread::yield_now();
        }
    }
    let (resident_kb, took) = (report::resident_kb(), began.elapsed());
    tally.over.store(true, Ordering::Relaxed);
    // Clients that wait for a set get one.
    while threads.iter().any(|thread| !thread.is_finished())
        && began.elapsed() < took + Duration::from_secs(20)
    {
        let _ = worker.step();
    }
    std::thread::sleep(Duration::from_millis(500));
    let left = report::descriptors();
    running.stop();
    Ok(Report {
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
