//! Soak test: days of simulated time through the probe's pipeline, server and sockets, with clients of every kind, changes of every setting and
//! faults of the source. The source does not wait between bursts, whose times are simulated; ten bursts count as a second.

mod camera;
mod clients;
mod judge;
mod lamps;
mod report;
mod tally;
#[cfg(test)]
mod tests;

use crate::error::SimError;
use camera::DayCamera;
use hemilux::pipeline::{Pipeline, Settings};
use hemilux::probe::settings::SETTINGS;
use hemilux::probe::{Config, Worker};
use hemilux::server::{self, KnownHosts, Limits, Options};
use hemilux::source::{FaultSource, FaultSpec, Source};
use hemilux_core::Extrapolation;
use judge::{Fluxes, Outcome, SetJudge};
use report::{MemoryLog, SoakReport};
use std::net::{Ipv4Addr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use tally::Tally;

/// Bursts per second of simulated time.
pub const FRAMES_A_SECOND: u64 = 10;

/// Pause between attempts to read a burst while the device is gone.
const RETRY: Duration = Duration::from_millis(1);

/// Number of bursts between two samples of the memory.
const SAMPLED: u64 = 100;

/// Bursts of an hour of simulated time.
const HOUR: u64 = 3600 * FRAMES_A_SECOND;

/// Parameters of a soak test.
#[derive(Clone, Debug)]
pub struct SoakJob {
    /// Number of bursts that the test processes at least.
    pub frames: u64,
    /// Faults that the test injects into the source.
    pub faults: FaultSpec,
    /// Least number of replies to clients; the test processes further bursts until the clients have received as many.
    pub replies: u64,
}

/// Returns the fluxes of sets of the daylight and of the lamps, computed from bursts without faults.
fn fluxes() -> Result<Fluxes, SimError> {
    Ok(Fluxes {
        day: brightest(camera(2)?.without_lamps())?,
        lamps: brightest(camera(2)?.with_lamps_alone())?,
    })
}

/// Returns the flux of a set of `camera` at the brightest moment without and with extrapolation.
fn brightest(mut camera: DayCamera) -> Result<[f64; 2], SimError> {
    let mut burst = hemilux::calibration::Burst::default();
    let failed = |e: &dyn std::fmt::Display| SimError::Failed(format!("soak: {e}"));
    for _ in 0..2 {
        camera.next(&mut burst).map_err(|e| failed(&e))?;
    }
    let mut flux = [0.0; 2];
    for (flux, extrapolation) in flux.iter_mut().zip([Extrapolation::None, Extrapolation::Average]) {
        let settings = Settings { extrapolation, ..Settings::default() };
        let mut pipeline = Pipeline::try_new(*camera.calibration(), &camera.exposures(), settings)?;
        *flux = f64::from(pipeline.process(&burst)?.scalar_flux[1]);
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
    let flux = fluxes()?;
    let camera = camera(job.frames)?;
    let newest = camera.newest();
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
    let mut judge = SetJudge::new(flux, &newest, &tally, &counts);
    let threads = clients::start(address, &tally).map_err(|e| failed(&e))?;
    let (mut bursts, mut memory) = (0, MemoryLog::default());
    while bursts < job.frames || tally.replies.load(Ordering::Relaxed) < job.replies {
        let is_ok = worker.step().is_ok();
        let taken = newest.bursts();
        if taken == bursts {
            // The device is gone for the duration of a fault.
            std::thread::sleep(RETRY);
            continue;
        }
        bursts = taken;
        judge.judge_burst(&link, is_ok);
        if bursts % SAMPLED == 0 {
            memory.sample(bursts, job.frames);
            // The threads of the clients run.
            std::thread::yield_now();
        }
        if bursts % HOUR == 0 {
            tell_progress(bursts, judge.outcome(), &tally, &memory);
        }
    }
    let took = began.elapsed();
    tally.over.store(true, Ordering::Relaxed);
    // Further sets end the waits of the clients.
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
        outcome: judge.into_outcome(),
        quality: link.status().quality(),
        settings: [tally.settings(), SETTINGS.len()],
        memory,
        descriptors: [descriptors, left],
        took,
        tally,
    })
}

/// Prints the counts after each hour of simulated time to standard error.
fn tell_progress(bursts: u64, outcome: &Outcome, tally: &Tally, memory: &MemoryLog) {
    let [replies, errors] = [&tally.replies, &tally.errors].map(|counter| counter.load(Ordering::Relaxed));
    eprintln!(
        "soak: {} h: {} wrong sets, {replies} replies, {errors} errors, most memory {} kB",
        bursts / HOUR,
        outcome.wrong,
        memory.most_kb
    );
}
