//! Fetches the driver's buffers, numbers their frames, and reports a stream that ends.

use super::access::failed;
use super::capture::{Camera, SILENCE};
use super::frame::{Filled, stamped_ns};
use super::numbers::FrameTimes;
use super::{Call, CameraError, Kernel, Ready, abi, persist};
use rustix::io::Errno;
use std::time::Duration;

/// Number of successive frames whose sequence number does not increase after which the camera is opened again.
const MOST_REPEATS: u32 = 30;

/// Number of successive failures to fetch a frame after which the camera is opened again: drivers report lost transfers as EIO.
const MOST_UNFETCHED: u32 = 8;

impl Camera {
    /// Dequeues the buffer of the next frame.
    pub(super) fn dequeue(
        &mut self,
        kernel: &mut dyn Kernel,
        timeout: Duration,
    ) -> Result<Option<Filled>, CameraError> {
        let ready = persist(|| self.setup.video.wait(timeout));
        let Ready { frame, event, gone } = ready.map_err(|e| failed(&self.path, "poll", e, "frames"))?;
        if event {
            self.look_at_event()?;
        }
        if !frame {
            return if gone {
                Err(CameraError::Gone(self.path.clone()))
            } else {
                self.silence(kernel).map(|()| None)
            };
        }
        let mut buffer = abi::Buffer::default();
        match persist(|| self.setup.video.call(Call::Dequeue(&mut buffer))) {
            Ok(()) => self.unfetched = 0,
            Err(Errno::AGAIN) => return self.silence(kernel).map(|()| None),
            Err(Errno::IO) if self.unfetched < MOST_UNFETCHED => {
                self.unfetched += 1;
                self.counters.broken.flagged += 1;
                return self.silence(kernel).map(|()| None);
            }
            Err(e) => return Err(failed(&self.path, "DQBUF", e, "a frame")),
        }
        let repeated = !self.count(kernel, &mut buffer)?;
        let whole = self.setup.picture.least_bytes();
        let good = self.counters.broken.check(&buffer, repeated, whole);
        Ok(Some(Filled { buffer, good }))
    }

    /// Drops a frame whose sequence number is repeated, as busy drivers deliver occasionally: its exposure is unknown.
    fn repeat(&mut self, sequence: u32) -> Result<bool, CameraError> {
        self.repeats += 1;
        if self.repeats <= MOST_REPEATS {
            return Ok(false);
        }
        let found =
            format!("number {sequence} for a frame after a higher one, {MOST_REPEATS} times in a row");
        Err(CameraError::Unfit { path: self.path.clone(), found, expected: "rising numbers".into() })
    }

    /// Assigns a number to a frame and stores its arrival time; returns false if the driver repeats a number.
    fn count(&mut self, kernel: &dyn Kernel, buffer: &mut abi::Buffer) -> Result<bool, CameraError> {
        let (stamped_ns, now_ns) = (stamped_ns(buffer), kernel.now_ns());
        let times = FrameTimes { stamped_ns, now_ns, period_s: self.setup.period_s };
        let Some(number) = self.numbers.number(buffer.sequence, times) else {
            return self.repeat(buffer.sequence);
        };
        buffer.sequence = number;
        self.repeats = 0;
        if let Some(last) = self.last.replace(number) {
            self.counters.lost += u64::from(number.wrapping_sub(last).saturating_sub(1));
        }
        let stamp_is_used = self.arrivals.note(number, stamped_ns, now_ns);
        self.counters.unstamped += u64::from(!stamp_is_used);
        Ok(true)
    }

    /// Returns an error if no frame has come for longer than [`SILENCE`].
    fn silence(&self, kernel: &dyn Kernel) -> Result<(), CameraError> {
        let silent_ns = kernel.now_ns().saturating_sub(self.arrivals.arrived_ns());
        let allowed = SILENCE.0.max(Duration::from_secs_f64(SILENCE.1 * self.setup.period_s));
        if u128::from(silent_ns) <= allowed.as_nanos() {
            return Ok(());
        }
        let (ms, period_ms) = (allowed.as_millis() as u64, (self.setup.period_s * 1e3) as u64);
        Err(CameraError::Silent { path: self.path.clone(), ms, period_ms })
    }

    fn look_at_event(&mut self) -> Result<(), CameraError> {
        let mut event = abi::Event::default();
        let taken = persist(|| self.setup.video.call(Call::DequeueEvent(&mut event)));
        if taken.is_ok() && event.kind == abi::EVENT_SOURCE_CHANGE {
            let (found, expected) = ("another picture format".into(), "the negotiated one".into());
            return Err(CameraError::Unfit { path: self.path.clone(), found, expected });
        }
        Ok(())
    }

    pub(super) fn queue(&mut self, index: u32) -> Result<(), CameraError> {
        let mut buffer = abi::Buffer { index, ..Default::default() };
        let queued = persist(|| self.setup.video.call(Call::Queue(&mut buffer)));
        queued.map_err(|e| failed(&self.path, "QBUF", e, "a buffer that the driver accepts"))
    }
}
