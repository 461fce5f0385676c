//! The start of a camera's stream: buffers, the first exposure, STREAMON, and the controls that the camera resets at STREAMON.

use super::access::failed;
use super::arrivals::Arrivals;
use super::capture::Camera;
use super::schedule::Schedule;
use super::setup::{self, Agreed};
use super::{Call, CameraError, Kernel, Node, abi, persist};
use rustix::io::Errno;
use std::path::Path;
use std::time::Duration;

/// Number of requested buffers: the driver fills one and the program reads one; the others absorb a delay of four
/// frames without loss.
const BUFFERS: u32 = 6;

/// Number of attempts to start the stream, and the time between two attempts: USB cameras fail while another device ends its transfers,
/// and some drivers fail after their first start.
const START_TRIES: u32 = 6;
const START_PAUSE: Duration = Duration::from_millis(100);

/// Number of attempts to write the first exposure of a stream.
const FIRST_TRIES: u32 = 4;

impl Camera {
    /// Allocates buffers, sets the first exposure and starts the stream.
    pub(super) fn start(&mut self, kernel: &mut dyn Kernel) -> Result<(), CameraError> {
        let video = self.setup.video.as_mut();
        let mut subscription = abi::Subscription { kind: abi::EVENT_SOURCE_CHANGE, ..Default::default() };
        let _ = persist(|| video.call(Call::Subscribe(&mut subscription)));
        let path = &self.path;
        let mut request = abi::BufferRequest { count: BUFFERS, ..Default::default() };
        persist(|| video.call(Call::RequestBuffers(&mut request))).map_err(|e| {
            failed(path, "REQBUFS", e, "memory for frames, and no other program that streams")
        })?;
        if !(2..=32).contains(&request.count) {
            let (found, expected) = (format!("{} buffers", request.count), "2 to 32".into());
            return Err(CameraError::Unfit { path: path.clone(), found, expected });
        }
        for index in 0..request.count {
            map(video, path, index)?;
        }
        for index in 0..request.count {
            self.queue(index)?;
        }
        self.write_first(kernel)?;
        self.stream_on(kernel)?;
        self.arrivals = Arrivals::new(self.setup.period_s, kernel.now_ns());
        self.restore(kernel)
    }

    fn stream_on(&mut self, kernel: &mut dyn Kernel) -> Result<(), CameraError> {
        let passing = [Errno::BUSY, Errno::IO, Errno::AGAIN, Errno::PROTO, Errno::TIMEDOUT];
        let mut tries = 1;
        loop {
            let errno = match persist(|| self.setup.video.call(Call::StreamOn)) {
                Ok(()) => return Ok(()),
                Err(errno) => errno,
            };
            if tries == START_TRIES || !passing.contains(&errno) {
                return Err(failed(&self.path, "STREAMON", errno, "a sensor whose format and links fit"));
            }
            tries += 1;
            kernel.sleep(START_PAUSE);
        }
    }

    /// Sets again the controls that the camera reset when the stream started.
    fn restore(&mut self, kernel: &mut dyn Kernel) -> Result<(), CameraError> {
        let changed = setup::restore(&mut self.setup);
        let expected = self.setup.settings.first().map(|s| s.value);
        let can_tell = self.setup.knob.is_some() && self.setup.reads_back;
        if !changed && (!can_tell || setup::exposure_value(&mut self.setup) == expected) {
            return Ok(());
        }
        self.setup.agreed.push(Agreed {
            what: "controls",
            asked: "kept at STREAMON".into(),
            got: "reset, set again".into(),
        });
        self.schedule.doubt_initial();
        self.write(kernel, u32::MAX, 0)
    }

    /// Writes the first exposure before the stream starts, so that it acts from the first frame.
    fn write_first(&mut self, kernel: &mut dyn Kernel) -> Result<(), CameraError> {
        self.write_repeatedly(kernel, 0)?;
        self.schedule = Schedule::new(self.setup.settings.len(), 0, self.schedule.delay());
        Ok(())
    }

    /// Writes the first exposure after frame `sequence`, up to [`FIRST_TRIES`] times while the driver refuses it.
    pub(super) fn write_repeatedly(
        &mut self,
        kernel: &mut dyn Kernel,
        sequence: u32,
    ) -> Result<(), CameraError> {
        for _ in 0..FIRST_TRIES {
            let failed = self.counters.failed_writes;
            self.write(kernel, sequence, 0)?;
            if self.counters.failed_writes == failed {
                break;
            }
        }
        Ok(())
    }
}

fn map(video: &mut dyn Node, path: &Path, index: u32) -> Result<(), CameraError> {
    let mut buffer = abi::Buffer { index, ..Default::default() };
    persist(|| video.call(Call::QueryBuffer(&mut buffer)))
        .map_err(|e| failed(path, "QUERYBUF", e, "the buffer"))?;
    buffer.index = index;
    video.map(&buffer).map_err(|e| failed(path, "mmap", e, "memory for frames"))
}
