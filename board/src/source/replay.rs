//! A recording as a source, repeated at its own pace.
//!
//! The whole recording is read when it is opened, so that playing it neither reads files nor allocates memory.

use super::pace::wait_for;
use super::{Pace, Source, SourceError};
use crate::calibration::{Burst, Calibration, Frame, Pixels};
use crate::clock;
use crate::consistency;
use crate::recorded::{self, ReadLimits, RecordedBurst, RecordedError};
use hemilux_core::Exposure;
use std::path::Path;
use std::time::{Duration, Instant};

/// Largest memory of a recording's samples, bytes: 185 bursts of three 640 x 480 RGB24 frames, half of the memory of a board with 1 GB.
pub const MAX_RECORDING_BYTES: u64 = 512 << 20;

/// Plays a recorded burst or sequence.
#[derive(Debug)]
pub struct ReplaySource {
    calibration: Calibration,
    bursts: Vec<Burst>,
    /// Notes about the frames that were left out of their bursts.
    notes: Vec<String>,
    /// Time from each burst to the next; the last element is the time from the last burst to the first.
    intervals: Vec<Duration>,
    /// Time of the shortest exposure of each burst, nanoseconds from any origin.
    phases: Vec<u64>,
    at: usize,
    is_sliding: bool,
    /// Index of the next frame of a sliding window.
    frame: usize,
    due: Option<Instant>,
}

impl ReplaySource {
    /// Reads the recording in `folder`; `pace` applies to recordings without times, and [`Pace::Free`] overrides recorded times.
    ///
    /// # Errors
    /// [`RecordedError`]: files that cannot be read, more than [`MAX_RECORDING_BYTES`], or bursts of different cameras.
    pub fn open(folder: &Path, pace: Pace) -> Result<Self, RecordedError> {
        let listed = recorded::read_sequence(folder)?;
        let mut bursts: Vec<Burst> = Vec::with_capacity(listed.len());
        let mut camera: Option<Calibration> = None;
        let mut notes = Vec::new();
        for recorded::BurstFolder { folder: path, timestamp_ns } in &listed {
            let mut read = recorded::read_recorded(path, &ReadLimits::default())?;
            // The frames of a sequence are compared while it is played; a repeated single burst would become its own reference.
            if listed.len() == 1 {
                let left_out = consistency::leave_out(&mut read)
                    .map_err(|e| RecordedError::new(path, e, "a response that rises"))?;
                notes.extend(left_out.iter().map(|frame| format!("{}/{frame}", path.display())));
            }
            let RecordedBurst { calibration, mut burst, .. } = read;
            check_size(folder, listed.len(), &burst)?;
            if *camera.get_or_insert(calibration) != calibration {
                let expected = "the lens, response and image size of the sequence's first burst";
                return Err(RecordedError::new(path, "another camera", expected));
            }
            if *timestamp_ns != 0 {
                burst.timestamp_ns = *timestamp_ns;
            }
            bursts.push(burst);
        }
        let none = || RecordedError::new(folder, "no bursts", "at least one");
        let calibration = camera.ok_or_else(none)?;
        Ok(Self::new(calibration, bursts, notes, pace))
    }

    /// Creates a source that repeats `bursts` of the camera `calibration` at `pace`; `None` without bursts.
    #[must_use]
    pub fn of_bursts(calibration: Calibration, bursts: Vec<Burst>, pace: Pace) -> Option<Self> {
        (!bursts.is_empty()).then(|| Self::new(calibration, bursts, Vec::new(), pace))
    }

    /// Creates a source that begins with the first of `bursts`, of which there is at least one.
    fn new(calibration: Calibration, bursts: Vec<Burst>, notes: Vec<String>, pace: Pace) -> Self {
        let intervals = intervals(&bursts, pace);
        let phases = phases(&bursts, &intervals);
        Self { calibration, bursts, notes, intervals, phases, at: 0, is_sliding: false, frame: 0, due: None }
    }

    /// Returns the number of bursts of the recording.
    #[must_use]
    pub fn len(&self) -> usize {
        self.bursts.len()
    }

    /// Returns true if the recording has no bursts, which [`ReplaySource::open`] refuses.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.bursts.is_empty()
    }
}

impl Source for ReplaySource {
    fn calibration(&self) -> &Calibration {
        &self.calibration
    }

    fn fixed_exposures(&self) -> Option<&'static str> {
        Some("a recording keeps the exposures that it was made with")
    }

    fn notes(&self) -> &[String] {
        &self.notes
    }

    fn set_sliding(&mut self, is_sliding: bool) -> bool {
        self.is_sliding = is_sliding;
        true
    }

    fn exposures(&self) -> Vec<Exposure> {
        self.bursts[0].frames.iter().map(|f| f.exposure).collect()
    }

    fn next(&mut self, burst: &mut Burst) -> Result<(), SourceError> {
        let due = *self.due.get_or_insert_with(Instant::now);
        wait_for(due)?;
        let recorded = &self.bursts[self.at].frames;
        let slides = self.is_sliding && burst.frames.len() == recorded.len();
        let steps = if slides { recorded.len() as u32 } else { 1 };
        // The next burst is timed from the due time of this one; if that has passed, the recording plays slower.
        self.due = Some((due + self.intervals[self.at] / steps).max(Instant::now()));
        burst.before_ns = clock::monotonic_ns();
        burst.timestamp_ns = burst.before_ns;
        burst.phase_ns = self.phases[self.at];
        if slides {
            let frame = self.frame.min(recorded.len() - 1);
            copy_frame(&recorded[frame], &mut burst.frames[frame]);
            burst.renew(frame);
            self.frame = (frame + 1) % recorded.len();
        } else {
            copy_frames(recorded, &mut burst.frames);
            (burst.stale, self.frame) = (0, 0);
        }
        if self.frame == 0 {
            self.at = (self.at + 1) % self.bursts.len();
        }
        Ok(())
    }
}

/// Refuses a recording of `count` bursts like `burst` that exceeds [`MAX_RECORDING_BYTES`].
fn check_size(folder: &Path, count: usize, burst: &Burst) -> Result<(), RecordedError> {
    let bytes: u64 = burst.frames.iter().map(|f| frame_bytes(&f.pixels)).sum();
    let all = bytes.saturating_mul(count as u64);
    if all <= MAX_RECORDING_BYTES {
        return Ok(());
    }
    let found = format!("a recording of {count} bursts, {} MB in memory", all >> 20);
    Err(RecordedError::new(folder, found, format!("at most {} MB", MAX_RECORDING_BYTES >> 20)))
}

fn frame_bytes(pixels: &Pixels) -> u64 {
    match pixels {
        Pixels::U8(v) => v.len() as u64,
        Pixels::U16(v) => 2 * v.len() as u64,
    }
}

/// Returns the time from each burst to the next. The time after the last burst is that between the two bursts before it.
fn intervals(bursts: &[Burst], pace: Pace) -> Vec<Duration> {
    let Pace::Every(period) = pace else { return vec![Duration::ZERO; bursts.len()] };
    let steps =
        bursts.windows(2).map(|w| w[1].timestamp_ns.checked_sub(w[0].timestamp_ns).filter(|d| *d > 0));
    match steps.collect::<Option<Vec<u64>>>() {
        Some(mut steps) if !steps.is_empty() => {
            steps.extend(steps.last().copied());
            steps.into_iter().map(Duration::from_nanos).collect()
        }
        _ => vec![period; bursts.len()],
    }
}

/// Returns a time for each burst, nanoseconds: the recorded time of its shortest exposure, or, if a burst lacks this time, the times at
/// which all bursts are played.
fn phases(bursts: &[Burst], intervals: &[Duration]) -> Vec<u64> {
    if bursts.iter().all(|burst| burst.phase_ns != 0) {
        return bursts.iter().map(|burst| burst.phase_ns).collect();
    }
    let nanoseconds = |interval: &Duration| u64::try_from(interval.as_nanos()).unwrap_or(u64::MAX);
    let played = intervals.iter().scan(1, |at: &mut u64, interval| {
        let now = *at;
        *at = at.saturating_add(nanoseconds(interval));
        Some(now)
    });
    played.collect()
}

/// Copies the frames `from` to `to`, whose memory is reused from the second call on.
fn copy_frames(from: &[Frame], to: &mut Vec<Frame>) {
    to.truncate(from.len());
    to.reserve(from.len() - to.len());
    for (i, frame) in from.iter().enumerate() {
        match to.get_mut(i) {
            Some(old) => copy_frame(frame, old),
            None => to.push(frame.clone()),
        }
    }
}

fn copy_frame(from: &Frame, to: &mut Frame) {
    to.exposure = from.exposure;
    match (&from.pixels, &mut to.pixels) {
        (Pixels::U8(from), Pixels::U8(to)) => to.clone_from(from),
        (Pixels::U16(from), Pixels::U16(to)) => to.clone_from(from),
        (from, to) => *to = from.clone(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::RgbImage;

    /// Writes a folder with one burst whose samples all have `code`.
    fn record(folder: &Path, code: u8, timestamp_ns: u64) {
        std::fs::create_dir_all(folder).expect("a folder");
        let image = RgbImage::from_pixel(32, 32, image::Rgb([code; 3]));
        image.save(folder.join("a.png")).expect("an image");
        let manifest = format!(
            "version = 1\n[lens]\nmodel = \"equidistant\"\ncentre = [15.5, 15.5]\nfocal = [12.0, 12.0]\nmax_angle_deg = 80.0\n\
             [response]\nmodel = \"linear\"\nscale = 1.0\n[[frame]]\nfile = \"a.png\"\nexposure_s = 0.01\ntimestamp_ns = {timestamp_ns}\n"
        );
        std::fs::write(folder.join("burst.toml"), manifest).expect("a manifest");
    }

    fn codes(burst: &Burst) -> u8 {
        let Pixels::U8(codes) = &burst.frames[0].pixels else { panic!("8-bit frames") };
        codes[0]
    }

    #[test]
    fn a_sequence_loops_in_name_order() {
        let root = tempfile::tempdir().expect("a folder");
        for i in 0..3u8 {
            record(&root.path().join(format!("{i:04}")), 10 * i, 0);
        }
        let mut source = ReplaySource::open(root.path(), Pace::Free).expect("a recording");
        let mut burst = Burst::default();
        for expected in [0, 10, 20, 0, 10] {
            source.next(&mut burst).expect("a burst");
            assert_eq!(codes(&burst), expected, "order");
        }
    }

    #[test]
    fn recorded_times_are_kept_and_others_become_ten_a_second() {
        let root = tempfile::tempdir().expect("a folder");
        for (i, ms) in [5u64, 35, 95].into_iter().enumerate() {
            record(&root.path().join(format!("{i:04}")), 1, ms * 1_000_000);
        }
        let source = ReplaySource::open(root.path(), Pace::TEN_A_SECOND).expect("a recording");
        assert_eq!(source.intervals, [30, 60, 60].map(Duration::from_millis), "recorded");
        record(&root.path().join("0002"), 1, 35_000_000);
        let source = ReplaySource::open(root.path(), Pace::TEN_A_SECOND).expect("a recording");
        assert_eq!(source.intervals, [100; 3].map(Duration::from_millis), "not ascending");
    }

    #[test]
    fn contradicting_frames_of_a_single_burst_are_left_out_and_noted() {
        let root = tempfile::tempdir().expect("a folder");
        record(root.path(), 120, 0);
        let manifest = std::fs::read_to_string(root.path().join("burst.toml")).expect("a manifest");
        let black = RgbImage::from_pixel(32, 32, image::Rgb([0; 3]));
        black.save(root.path().join("black.png")).expect("an image");
        let more = format!("{manifest}[[frame]]\nfile = \"black.png\"\nexposure_s = 0.02\n");
        std::fs::write(root.path().join("burst.toml"), more).expect("a manifest");
        let source = ReplaySource::open(root.path(), Pace::Free).expect("a recording");
        assert_eq!(source.exposures(), [Exposure { seconds: 0.01, gain: 1.0 }]);
        assert!(
            matches!(source.notes(), [note] if note.contains("black.png: left out")),
            "{:?}",
            source.notes()
        );
    }

    #[test]
    fn a_recording_above_the_memory_limit_is_refused_on_one_line() {
        let exposure = Exposure { seconds: 1.0, gain: 1.0 };
        let frame = Frame { exposure, pixels: Pixels::U16(vec![0; 1 << 20]) };
        let burst = Burst { frames: vec![frame], ..Burst::default() };
        assert!(check_size(Path::new("x"), 256, &burst).is_ok(), "at capacity");
        let error = check_size(Path::new("x"), 257, &burst).expect_err("one over").to_string();
        assert_eq!(error, "x: found a recording of 257 bursts, 514 MB in memory, expected at most 512 MB");
    }
}
