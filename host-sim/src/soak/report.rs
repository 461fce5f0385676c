//! Report of a soak test: counts, memory, and the requirements that are violated.

use super::FRAMES_A_SECOND;
use super::judge::Outcome;
use super::tally::Tally;
use hemilux::probe::QualityStatus;
use hemilux::source::Fault;
use std::fmt;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// Largest growth of the mean resident memory that does not count as a leak, as a share of the memory.
const GROWTH: f64 = 0.01;

/// Largest growth in a run of fewer than [`LONG`] bursts, kB: a tenth of it is shorter than some cycles of the settings.
const SHORT_GROWTH: f64 = 2048.0;

/// Number of bursts from which the memory must be flat within [`GROWTH`].
const LONG: u64 = 36_000;

/// Largest growth of the number of open file descriptors of the process that does not count as a leak: connections that the server has not
/// closed yet.
const DESCRIPTORS: usize = 2;

/// Longest permitted time from a client's request to its reply.
const WORST: Duration = Duration::from_secs(5);

/// Least share of the sets under lamps, with a setting `mains` that permits it, in which the probe has found the lamps. Each fault of the clock and
/// many changes of settings restart the search, which takes eight to sixteen bursts; the measured share is 87 %.
const FOUND: f64 = 0.5;

/// Largest share of the sets in which the lamps are found that may differ from the mean light of the lamps: in a simulated day, 0.05 % differ;
/// 5 % differed before the light of partial bursts was kept out of the fits.
const OFF_MEAN: f64 = 1.0 / 200.0;

/// Results of a soak test; `Display` formats them as a table.
pub struct SoakReport {
    pub(super) bursts: u64,
    pub(super) outcome: Outcome,
    pub(super) quality: QualityStatus,
    /// Number of settings that clients changed, and number of all settings of the probe.
    pub(super) settings: [usize; 2],
    pub(super) memory: MemoryLog,
    /// Number of open descriptors before the clients start and after they have ended.
    pub(super) descriptors: [usize; 2],
    pub(super) took: Duration,
    pub(super) tally: Arc<Tally>,
}

impl SoakReport {
    /// Returns one description for each violated requirement.
    #[must_use]
    pub fn failures(&self) -> Vec<String> {
        let [warm, end] = self.memory.means_kb();
        let least = if self.bursts < LONG { SHORT_GROWTH } else { 0.0 };
        let is_flat = end - warm <= least.max(GROWTH * warm);
        let count = |counter: &std::sync::atomic::AtomicU64| counter.load(Ordering::Relaxed);
        let Outcome { searched, found, off_mean, .. } = self.outcome;
        let unrecovered: u64 = self.outcome.faults.iter().map(|fault| fault.unrecovered).sum();
        let checks = [
            (self.outcome.wrong == 0, format!("{} wrong sets", self.outcome.wrong)),
            (count(&self.tally.errors) == 0, format!("{} errors of clients", count(&self.tally.errors))),
            (
                found > 0 && found as f64 >= FOUND * searched as f64,
                format!("lamps were found in {found} of {searched} sets, expected at least {FOUND}"),
            ),
            (
                off_mean as f64 <= OFF_MEAN * found as f64,
                format!("{off_mean} of {found} sets differ from the mean light of the lamps"),
            ),
            (unrecovered == 0, format!("{unrecovered} faults without recovery within two bursts")),
            (is_flat, format!("memory grew from {warm:.0} kB to {end:.0} kB")),
            (
                self.descriptors[1] <= self.descriptors[0] + DESCRIPTORS,
                format!(
                    "{} descriptors at the start and {} at the end",
                    self.descriptors[0], self.descriptors[1]
                ),
            ),
            (self.tally.worst() < WORST, format!("a reply took {:.3} s", self.tally.worst().as_secs_f64())),
            (
                self.settings[0] == self.settings[1],
                format!("{} of {} settings were changed", self.settings[0], self.settings[1]),
            ),
        ];
        checks.into_iter().filter(|(holds, _)| !holds).map(|(_, what)| what).collect()
    }
}

impl fmt::Display for SoakReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let count = |counter: &std::sync::atomic::AtomicU64| counter.load(Ordering::Relaxed);
        let hours = self.bursts as f64 / FRAMES_A_SECOND as f64 / 3600.0;
        let (took, tally) = (self.took.as_secs_f64(), &self.tally);
        writeln!(f, "{:.2} h of simulated time ({} bursts, 10 a second) in {took:.0} s", hours, self.bursts)?;
        let line = |f: &mut fmt::Formatter<'_>, name: &str, n: u64| writeln!(f, "{name:<34}{n:>12}");
        line(f, "sets", self.outcome.sets)?;
        line(f, "sets with a wrong energy", self.outcome.wrong)?;
        line(f, "sets with frames left out", self.outcome.left_out)?;
        line(f, "sets that repeat the set before", self.outcome.held)?;
        line(f, "bursts without a set", self.outcome.failed)?;
        line(f, "sets of lowered quality", self.outcome.degraded)?;
        line(f, "sets under lamps on the mains", self.outcome.lit)?;
        line(f, "sets under lamps that are searched", self.outcome.searched)?;
        line(f, "sets under lamps that are found", self.outcome.found)?;
        line(f, "sets off the mean of the lamps", self.outcome.off_mean)?;
        let steps = format!("{} / {}", self.quality.down, self.quality.up);
        writeln!(f, "{:<34}{:>12}", "steps of the quality, down / up", steps)?;
        writeln!(f, "{:<34}{:>12}", "replies", count(&tally.replies))?;
        writeln!(f, "{:<34}{:>12}", "replies compared with their set", count(&tally.checked))?;
        writeln!(f, "{:<34}{:>12}", "replies of a stale set, marked", count(&tally.stale))?;
        writeln!(f, "{:<34}{:>12}", "replies of a stale set, unmarked", count(&tally.unmarked))?;
        writeln!(f, "{:<34}{:>12}", "errors, lost replies included", count(&tally.errors))?;
        writeln!(f, "{:<34}{:>12.3}", "longest time of a reply, s", tally.worst().as_secs_f64())?;
        writeln!(f, "{:<34}{:>12}", "connections closed half-way", count(&tally.rude))?;
        writeln!(f, "{:<34}{:>12}", "changes of settings", count(&tally.changes))?;
        let settings = format!("{} of {}", self.settings[0], self.settings[1]);
        writeln!(f, "{:<34}{:>12}", "settings changed", settings)?;
        let [warm, end] = self.memory.means_kb();
        writeln!(f, "{:<34}{:>12.0}", "memory, mean of second tenth, kB", warm)?;
        writeln!(f, "{:<34}{:>12.0}", "memory, mean of last tenth, kB", end)?;
        writeln!(f, "{:<34}{:>12}", "most memory, kB", self.memory.most_kb)?;
        let descriptors = format!("{} / {}", self.descriptors[0], self.descriptors[1]);
        writeln!(f, "{:<34}{:>12}", "descriptors, start / end", descriptors)?;
        writeln!(f, "{:<34}{:>12}{:>12}{:>12}", "faults", "number", "recovered", "not")?;
        for (kind, n) in Fault::ALL.iter().zip(&self.outcome.faults) {
            writeln!(f, "  {:<32}{:>12}{:>12}{:>12}", kind.name(), n.seen, n.recovered, n.unrecovered)?;
        }
        self.outcome.words.iter().try_for_each(|what| writeln!(f, "{what}"))?;
        tally.words().iter().try_for_each(|what| writeln!(f, "error: {what}"))?;
        self.failures().iter().try_for_each(|what| writeln!(f, "violated: {what}"))?;
        if self.failures().is_empty() { writeln!(f, "all requirements hold") } else { Ok(()) }
    }
}

/// Resident memory over a run: means over tenths of the run, because each change of a setting and each large reply changes the memory for a
/// moment.
#[derive(Clone, Debug, Default)]
pub(super) struct MemoryLog {
    /// Sums and numbers of the samples in the second and in the last tenth of the run, kB.
    tenths: [(u64, u64); 2],
    pub(super) most_kb: u64,
}

impl MemoryLog {
    /// Samples the memory after `bursts` of `frames` bursts.
    pub fn sample(&mut self, bursts: u64, frames: u64) {
        let kb = resident_kb();
        self.most_kb = self.most_kb.max(kb);
        let tenth = 10 * bursts / frames.max(1);
        for ((sum, samples), index) in self.tenths.iter_mut().zip([1, 9]) {
            if tenth == index {
                *sum += kb;
                *samples += 1;
            }
        }
    }

    fn means_kb(&self) -> [f64; 2] {
        self.tenths.map(|(sum, samples)| sum as f64 / samples.max(1) as f64)
    }
}

/// Returns the resident memory of this process in kB, from `/proc/self/status`; 0 if the file lacks it.
fn resident_kb() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    line.and_then(|line| line.trim().trim_end_matches(" kB").trim().parse().ok()).unwrap_or(0)
}

/// Returns the number of open descriptors of this process, from `/proc/self/fd`; 0 if the folder cannot be read.
pub(super) fn descriptors() -> usize {
    std::fs::read_dir("/proc/self/fd").map_or(0, Iterator::count)
}
