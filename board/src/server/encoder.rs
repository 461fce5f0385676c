//! One thread for long jobs that requests of clients cause, limited to half of one core. Of the waiting jobs, the one whose kind has used the
//! least processor time runs first: answers with short jobs keep their rate, those with long jobs become less frequent.

use rustix::process::{getpriority_process, setpriority_process};
use rustix::time::{ClockId, clock_gettime};
use std::collections::HashMap;
use std::hash::Hash;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};
use tokio::sync::oneshot;

/// Processor time of a job above which the thread pauses after the job, for the same duration as the job took.
const LONG: Duration = Duration::from_millis(1);

/// Half-life of the recorded processor time of a kind of job.
const HALF_LIFE: Duration = Duration::from_secs(1);

/// Largest number of kinds of jobs with a recorded processor time.
const KINDS: usize = 256;

/// A thread that runs jobs of the kinds `K`; it ends when the encoder is dropped.
#[derive(Debug)]
pub(super) struct Encoder<K> {
    queue: Arc<Queue<K>>,
}

#[derive(Debug)]
struct Queue<K> {
    state: Mutex<EncoderState<K>>,
    changed: Condvar,
}

struct EncoderState<K> {
    jobs: Vec<Job<K>>,
    /// Recorded processor time of each kind of job, and the time at which it was recorded.
    spent: HashMap<K, (Duration, Instant)>,
}

impl<K> std::fmt::Debug for EncoderState<K> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "EncoderState({} jobs)", self.jobs.len())
    }
}

struct Job<K> {
    kind: K,
    work: Box<dyn FnOnce() + Send>,
}

impl<K> Drop for Encoder<K> {
    fn drop(&mut self) {
        self.queue.changed.notify_all();
    }
}

impl<K: Copy + Eq + Hash + Send + 'static> Encoder<K> {
    /// Starts the thread, called `name`; its nice value exceeds that of the process by `nice`.
    pub(super) fn new(name: &str, nice: i32) -> Self {
        let state = Mutex::new(EncoderState { jobs: Vec::new(), spent: HashMap::new() });
        let queue = Arc::new(Queue { state, changed: Condvar::new() });
        let theirs = Arc::downgrade(&queue);
        if let Err(error) = std::thread::Builder::new().name(name.into()).spawn(move || run(&theirs, nice)) {
            tracing::warn!("thread {name}: found {error}, expected it to start");
        }
        Self { queue }
    }

    /// Runs `work`, a job of one kind, on the thread and returns its result; `None` if `work` panics.
    pub(super) async fn run<T: Send + 'static>(
        &self,
        kind: K,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Option<T> {
        let (done, result) = oneshot::channel();
        let work = Box::new(move || drop(done.send(work())));
        self.queue.lock().jobs.push(Job { kind, work });
        self.queue.changed.notify_one();
        result.await.ok()
    }
}

impl<K> Queue<K> {
    fn lock(&self) -> MutexGuard<'_, EncoderState<K>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<K: Copy + Eq + Hash> EncoderState<K> {
    /// Returns the recorded processor time of the jobs of `kind`, halved for each [`HALF_LIFE`] since the
    /// record.
    fn spent(&self, kind: K, now: Instant) -> Duration {
        let Some((spent, noted)) = self.spent.get(&kind) else { return Duration::ZERO };
        let lives = now.saturating_duration_since(*noted).as_secs_f32() / HALF_LIFE.as_secs_f32();
        spent.mul_f32((-lives).exp2())
    }

    fn note(&mut self, kind: K, took: Duration, now: Instant) {
        let spent = self.spent(kind, now) + took;
        if self.spent.len() >= KINDS && !self.spent.contains_key(&kind) {
            self.spent.clear();
        }
        self.spent.insert(kind, (spent, now));
    }

    fn next(&mut self, now: Instant) -> Option<Job<K>> {
        let least = (0..self.jobs.len()).min_by_key(|i| self.spent(self.jobs[*i].kind, now))?;
        Some(self.jobs.remove(least))
    }
}

/// Raises the nice value of the calling thread by `by`. On Linux, each thread has a nice value.
fn nice_thread(by: i32) -> rustix::io::Result<()> {
    setpriority_process(None, getpriority_process(None)? + by)
}

/// Returns the processor time of the calling thread.
fn processor_time() -> Duration {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    let (seconds, nanoseconds) = (u64::try_from(time.tv_sec), u32::try_from(time.tv_nsec));
    Duration::new(seconds.unwrap_or(0), nanoseconds.unwrap_or(0))
}

/// Runs the jobs of the queue until the encoder is dropped.
fn run<K: Copy + Eq + Hash>(queue: &Weak<Queue<K>>, nice: i32) {
    let _ = nice_thread(nice);
    while let Some(queue) = queue.upgrade() {
        let mut state = queue.lock();
        let Some(Job { kind, work }) = state.next(Instant::now()) else {
            let waited = queue.changed.wait_timeout(state, Duration::from_millis(200));
            drop(waited);
            continue;
        };
        drop(state);
        let began = processor_time();
        // The request that waits for the result detects a panic by the closed channel.
        let _ = std::panic::catch_unwind(std::panic::AssertUnwindSafe(work));
        let took = processor_time().saturating_sub(began);
        queue.lock().note(kind, took, Instant::now());
        if took > LONG {
            std::thread::sleep(took);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn work_runs_on_the_thread_and_a_panic_is_reported() {
        let encoder = Encoder::<u8>::new("test", 0);
        let here = std::thread::current().id();
        assert_eq!(encoder.run(1, move || std::thread::current().id() != here).await, Some(true), "done");
        assert_eq!(encoder.run(1, || -> () { std::panic::panic_any(()) }).await, None, "told");
        assert_eq!(encoder.run(1, || 7).await, Some(7), "and it goes on");
    }

    #[test]
    fn the_kind_with_the_least_processor_time_runs_first() {
        let now = Instant::now();
        let mut state = EncoderState { jobs: Vec::new(), spent: HashMap::new() };
        state.note(1, Duration::from_millis(10), now);
        state.note(2, Duration::from_millis(4), now);
        for kind in [1, 2, 3] {
            state.jobs.push(Job { kind, work: Box::new(|| ()) });
        }
        let order = [(); 3].map(|()| state.next(now).expect("a job").kind);
        assert_eq!(order, [3, 2, 1], "least first");
        let later = now + 2 * HALF_LIFE;
        assert_eq!(state.spent(1, later), Duration::from_millis(10) / 4, "forgotten by and by");
    }
}
