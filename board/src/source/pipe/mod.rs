//! Frames of another program, read from a file, a FIFO or a Unix socket: `pipe:PATH[,lens=FILE]`.
//!
//! Each frame has a header with its own exposure and gain ("Frame pipe" in `board/FORMATS.md`).

mod collect;
mod header;
mod input;
#[cfg(test)]
mod tests;

use super::camera::Terms;
use super::pace::wait_for;
use super::{Source, SourceError};
use crate::calibration::{Burst, Calibration, Frame, Pixels};
use crate::clock;
use crate::recorded::{LensFile, RecordedError, read_lens};
use crate::v4l2::setup::Options;
use collect::{Collector, Piped};
use header::Header;
use hemilux_core::Exposure;
use input::Input;
use std::fmt;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Longest wait for a burst of the pipe in one call of [`Source::next`].
const WAIT: Duration = Duration::from_millis(250);

/// Time between two bursts of a regular file, and between two attempts to read a FIFO without a writer.
const PERIOD: Duration = Duration::from_millis(100);

/// Age of a frame from which its timestamp is taken to be of another clock, nanoseconds.
const OLDEST_NS: u64 = 5_000_000_000;

/// The path of a pipe and its lens file, as in the option `--source`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PipeSpec {
    pub(super) path: PathBuf,
    lens: Option<PathBuf>,
}

impl PipeSpec {
    /// Returns the path of the lens file, if one is given.
    #[must_use]
    pub fn lens(&self) -> Option<PathBuf> {
        self.lens.clone()
    }

    /// Parses `text`, the part of a source's name behind `pipe:`.
    ///
    /// # Errors
    /// The text that was found and the form that was expected.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (path, lens) = text.split_once(",lens=").map_or((text, None), |(path, lens)| (path, Some(lens)));
        if path.is_empty() || lens == Some("") {
            return Err(format!("found 'pipe:{text}', expected pipe:PATH or pipe:PATH,lens=FILE"));
        }
        Ok(Self { path: path.into(), lens: lens.map(Into::into) })
    }
}

impl fmt::Display for PipeSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.path.display())?;
        self.lens.as_ref().map_or(Ok(()), |lens| write!(f, ",lens={}", lens.display()))
    }
}

/// A source of bursts whose frames another program writes to a pipe.
#[derive(Debug)]
pub struct PipeSource {
    path: PathBuf,
    lens: Option<LensFile>,
    terms: Terms,
    calibration: Calibration,
    exposures: Vec<Exposure>,
    input: Option<Input>,
    reader: FrameReader,
    collector: Collector,
    /// Memory of frames that newer frames have replaced, for reuse.
    spare: Vec<Vec<u8>>,
    /// Number of bursts since the input was opened.
    bursts: u64,
    /// Time at which the next burst of a regular file is due.
    due: Instant,
}

/// The header or frame that is being read from the pipe.
#[derive(Debug)]
struct FrameReader {
    head: [u8; header::BYTES],
    header: Option<Header>,
    bytes: Vec<u8>,
    /// Number of bytes of the header or of the frame that have been read.
    filled: usize,
    /// Number of frames since the input was opened.
    frames: u64,
}

impl FrameReader {
    const fn new() -> Self {
        Self { head: [0; header::BYTES], header: None, bytes: Vec::new(), filled: 0, frames: 0 }
    }

    /// Returns the part of the header or of the frame into which the next bytes are read.
    fn room(&mut self) -> &mut [u8] {
        let all = if self.header.is_some() { self.bytes.as_mut_slice() } else { &mut self.head };
        all.get_mut(self.filled..).unwrap_or_default()
    }

    /// Adds `read` to the number of bytes that have been read, and returns the frame if it is complete.
    fn advance(&mut self, read: usize, spare: &mut Vec<Vec<u8>>) -> Result<Option<Piped>, String> {
        self.filled += read;
        if !self.room().is_empty() {
            return Ok(None);
        }
        self.filled = 0;
        let Some(header) = self.header.take() else {
            let header = Header::parse(&self.head)?;
            self.bytes = spare.pop().unwrap_or_default();
            self.bytes.resize(header.payload, 0);
            self.header = Some(header);
            return Ok(None);
        };
        self.frames += 1;
        let mut bytes = std::mem::take(&mut self.bytes);
        bytes.truncate(header.picture.layout.frame_bytes());
        let now = clock::monotonic_ns();
        let stamp = header.timestamp_ns;
        let good = stamp <= now && now - stamp <= OLDEST_NS.saturating_add((header.seconds * 1e9) as u64);
        Ok(Some(Piped { header, time_ns: if good { stamp } else { now }, bytes }))
    }
}

impl PipeSource {
    /// Creates the source of `spec`; a pipe that does not exist yet is waited for.
    ///
    /// # Errors
    /// [`RecordedError`] for a lens file that cannot be read.
    pub fn open(spec: &PipeSpec) -> Result<Self, RecordedError> {
        let lens = spec.lens.as_deref().map(read_lens).transpose()?;
        let mut options = Options::of(&spec.path);
        options.size = lens.as_ref().map_or(options.size, |l| l.size.into());
        let terms = Terms::assumed(&options);
        let exposures =
            terms.seconds.iter().map(|seconds| Exposure { seconds: *seconds, gain: 1.0 }).collect();
        Ok(Self {
            path: spec.path.clone(),
            calibration: terms.calibration(lens.as_ref()),
            lens,
            terms,
            exposures,
            input: None,
            reader: FrameReader::new(),
            collector: Collector::default(),
            spare: Vec::new(),
            bursts: 0,
            due: Instant::now(),
        })
    }

    /// Returns the path of the FIFO, file or socket that the source reads.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    fn gone(&self, found: impl fmt::Display, expected: &str) -> SourceError {
        SourceError::Gone(format!("pipe:{}: found {found}, expected {expected}", self.path.display()))
    }

    /// Closes the input; the next call of [`Source::next`] opens it again.
    fn close(&mut self) {
        (self.input, self.reader) = (None, FrameReader::new());
    }

    /// Reads until a burst is complete, at most for [`WAIT`].
    fn read_burst(&mut self) -> Result<Vec<Piped>, SourceError> {
        let end = Instant::now() + WAIT;
        loop {
            if let Some(frame) = self.read_frame(end)? {
                self.check_lens(&frame.header)?;
                if self.collector.push(frame, &mut self.spare) {
                    return Ok(self.collector.take());
                }
            }
            if Instant::now() >= end {
                return Err(SourceError::NotYet);
            }
        }
    }

    fn check_lens(&mut self, header: &Header) -> Result<(), SourceError> {
        let size = [header.picture.width(), header.picture.height()];
        match &self.lens {
            Some(lens) if lens.size != size => {
                let found = format!("frames of {} x {} pixels", size[0], size[1]);
                let expected = format!("{} x {} as in the lens file", lens.size[0], lens.size[1]);
                Err(self.gone(found, &expected))
            }
            _ => Ok(()),
        }
    }

    /// Reads once, after waiting for input at most until `end`.
    fn read_frame(&mut self, end: Instant) -> Result<Option<Piped>, SourceError> {
        if self.input.is_none() {
            let opened = Input::open(&self.path);
            self.input = Some(opened.map_err(|e| {
                std::thread::sleep(PERIOD);
                self.gone(e, "a file, a FIFO or a Unix socket with frames")
            })?);
        }
        let Some(input) = &mut self.input else { return Ok(None) };
        match input.read(self.reader.room()) {
            Ok(0) => self.end_of_input().map(|()| None),
            Ok(read) => self.reader.advance(read, &mut self.spare).map_err(|line| {
                self.close();
                std::thread::sleep(PERIOD);
                SourceError::Gone(format!("pipe:{}: {line}", self.path.display()))
            }),
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => {
                input.wait(end.saturating_duration_since(Instant::now()));
                Ok(None)
            }
            Err(e) => {
                self.close();
                Err(self.gone(e, "frames"))
            }
        }
    }

    /// Handles the end of the input: a file is read from its start, a FIFO waits for the next writer, a socket is connected again.
    fn end_of_input(&mut self) -> Result<(), SourceError> {
        let (frames, bursts) = (self.reader.frames, std::mem::take(&mut self.bursts));
        let cut = self.reader.filled > 0 || self.reader.header.is_some();
        self.reader = FrameReader::new();
        self.collector = Collector::default();
        if bursts > 0 && !cut && self.input.as_mut().is_some_and(Input::rewind) {
            return Ok(());
        }
        if !matches!(self.input, Some(Input::Fifo(_))) {
            self.close();
        }
        std::thread::sleep(PERIOD);
        let found = match (cut, frames, bursts) {
            (true, ..) => "an end within a frame".into(),
            (_, 0, _) => "no frames".into(),
            (_, _, 0) => format!("{frames} frames without a burst"),
            _ => "the end of the frames".into(),
        };
        Err(self.gone(
            found,
            "a program that writes complete frames, with as many exposures as their headers state",
        ))
    }

    /// Adopts the picture format, the black level and the exposures of the burst `frames`.
    fn follow(&mut self, frames: &[Piped]) {
        let Some(first) = frames.first() else { return };
        let black = first.header.black / first.header.picture.max_code();
        if self.terms.picture != first.header.picture || self.terms.black != black {
            (self.terms.picture, self.terms.black) = (first.header.picture, black);
            self.calibration = self.terms.calibration(self.lens.as_ref());
        }
        self.exposures.clear();
        self.exposures
            .extend(frames.iter().map(|f| Exposure { seconds: f.header.seconds, gain: f.header.gain }));
    }
}

impl Source for PipeSource {
    fn calibration(&self) -> &Calibration {
        &self.calibration
    }

    fn fixed_exposures(&self) -> Option<&'static str> {
        Some("the program that writes the pipe chooses the exposures")
    }

    fn exposures(&self) -> Vec<Exposure> {
        self.exposures.clone()
    }

    fn next(&mut self, burst: &mut Burst) -> Result<(), SourceError> {
        if matches!(self.input, Some(Input::File(_))) {
            wait_for(self.due)?;
        }
        let frames = self.read_burst()?;
        self.due = Instant::now() + PERIOD;
        self.bursts += 1;
        self.follow(&frames);
        let began = |f: &Piped| f.time_ns.saturating_sub((f.header.seconds * 1e9) as u64);
        burst.before_ns = frames.iter().map(began).min().unwrap_or(0);
        burst.timestamp_ns = frames.iter().map(|f| f.time_ns).max().unwrap_or(0);
        let shortest = frames.iter().min_by(|a, b| a.header.seconds.total_cmp(&b.header.seconds));
        burst.phase_ns = shortest.map_or(0, |f| f.time_ns);
        let old = burst.frames.drain(..).filter_map(|f| match f.pixels {
            Pixels::U8(bytes) => Some(bytes),
            Pixels::U16(_) => None,
        });
        self.spare.extend(old);
        self.spare.truncate(2 * frames.len());
        let exposures = self.exposures.iter().copied();
        burst.frames.extend(
            frames
                .into_iter()
                .zip(exposures)
                .map(|(f, exposure)| Frame { exposure, pixels: Pixels::U8(f.bytes) }),
        );
        Ok(())
    }
}
