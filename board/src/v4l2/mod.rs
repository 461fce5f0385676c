//! Real cameras through Video4Linux: what the kernel says, and cameras as what they are for us.
//!
//! [`abi`] has the kernel's structures, [`Kernel`] and [`Node`] are the seam at which tests put a scripted kernel, [`real`] is the
//! real one and the only module with `unsafe`. Above the seam: [`device`] asks what a camera can do, [`controls`] finds and sets
//! what makes its exposure, [`schedule`] knows which frame has which exposure, [`verify`] looks whether that is true, and
//! [`capture`] brings it all together, one frame at a time, and [`supervise`] opens what has died again.
//!
//! There is no bindgen and so no libclang here: sixteen requests, whose layouts are asserted when the crate is compiled. The crate `v4l`
//! (0.14) would save the enumeration only: it panics on control types that it does not know and when a stream cannot be stopped,
//! queues a buffer twice after a time-out, hands EINTR on, refuses controls of several classes, and has neither sub-devices nor
//! events.

pub mod abi;
mod arrivals;
pub mod capture;
pub mod controls;
mod delay;
pub mod device;
pub mod exposure;
#[cfg(test)]
pub(crate) mod fake;
#[cfg(test)]
mod field_tests;
pub mod formats;
pub mod frame;
mod ids;
pub mod luma;
pub mod measured;
#[cfg(target_os = "linux")]
pub mod real;
pub mod schedule;
pub mod setup;
pub mod supervise;
#[cfg(test)]
mod tests;
pub mod verify;

use rustix::io::Errno;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// One request to a node, with the structure that it reads and writes.
#[derive(Debug)]
#[allow(missing_docs, reason = "each is the request of the same name")]
pub enum Call<'a> {
    QueryCapability(&'a mut abi::Capability),
    EnumFormats(&'a mut abi::FormatDescription),
    EnumSizes(&'a mut abi::SizeDescription),
    EnumIntervals(&'a mut abi::IntervalDescription),
    SetFormat(&'a mut abi::Format),
    SetParameters(&'a mut abi::Parameters),
    QueryControl(&'a mut abi::ControlDescription),
    QueryMenu(&'a mut abi::MenuItem),
    GetControl(&'a mut abi::Control),
    SetControl(&'a mut abi::Control),
    RequestBuffers(&'a mut abi::BufferRequest),
    QueryBuffer(&'a mut abi::Buffer),
    Queue(&'a mut abi::Buffer),
    Dequeue(&'a mut abi::Buffer),
    StreamOn,
    StreamOff,
    Subscribe(&'a mut abi::Subscription),
    DequeueEvent(&'a mut abi::Event),
    SetPadFormat(&'a mut abi::PadFormat),
    EnumBusCodes(&'a mut abi::BusCode),
}

/// What waiting for a node gave.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Ready {
    /// A frame can be taken.
    pub frame: bool,
    /// An event can be taken.
    pub event: bool,
    /// The device is gone or its queue is broken.
    pub gone: bool,
}

/// An open device node; dropping it closes it and unmaps its buffers.
pub trait Node: Send {
    /// Makes one request.
    ///
    /// # Errors
    /// What the kernel says, EINTR included.
    fn call(&mut self, call: Call<'_>) -> Result<(), Errno>;

    /// Waits for a frame or an event; all false when there was none in time.
    ///
    /// # Errors
    /// What the kernel says, EINTR included.
    fn wait(&mut self, timeout: Duration) -> Result<Ready, Errno>;

    /// Maps the buffer that `QueryBuffer` described; buffers are mapped in order of their index.
    ///
    /// # Errors
    /// What the kernel says.
    fn map(&mut self, buffer: &abi::Buffer) -> Result<(), Errno>;

    /// Bytes of buffer `index` while it is not with the driver, else none.
    fn bytes(&self, index: u32) -> &[u8];
}

/// Opens nodes and keeps time.
pub trait Kernel: Send {
    /// Opens a node for reading and writing, without blocking.
    ///
    /// # Errors
    /// What the kernel says.
    fn open(&mut self, path: &Path) -> Result<Box<dyn Node>, Errno>;

    /// Paths of all capture nodes (`/dev/video*`), in order of their numbers.
    fn video_nodes(&mut self) -> Vec<PathBuf>;

    /// Paths and names of all sub-devices (`/dev/v4l-subdev*`).
    fn subdevices(&mut self) -> Vec<(PathBuf, String)>;

    /// CLOCK_MONOTONIC, nanoseconds: the clock of the frames' timestamps.
    fn now_ns(&self) -> u64;

    /// Lets time pass.
    fn sleep(&mut self, duration: Duration);
}

/// Why a camera does not give frames.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CameraError {
    /// A request failed.
    #[error("{path}: {operation}: found {errno}, expected {expected}")]
    Failed {
        /// The node.
        path: PathBuf,
        /// What was tried.
        operation: &'static str,
        /// The kernel's answer in words.
        errno: String,
        /// What would have been right.
        expected: &'static str,
    },
    /// The device is not there, or not any more.
    #[error("{0}: found no camera, expected one that is plugged in")]
    Gone(PathBuf),
    /// No frame for too long.
    #[error("{path}: found no frame in {ms} ms, expected one every {period_ms} ms")]
    Silent {
        /// The node.
        path: PathBuf,
        /// How long.
        ms: u64,
        /// Time between frames.
        period_ms: u64,
    },
    /// Something is not as it must be.
    #[error("{path}: found {found}, expected {expected}")]
    Unfit {
        /// The node.
        path: PathBuf,
        /// What was found.
        found: String,
        /// What was expected.
        expected: String,
    },
}

/// Most tries of a request that the driver answers with EBUSY or EAGAIN.
const BUSY_TRIES: u32 = 4;

/// Makes a request again while signals interrupt it, and a few times while the driver is busy.
pub(crate) fn persist<T>(mut attempt: impl FnMut() -> Result<T, Errno>) -> Result<T, Errno> {
    let mut busy = 0;
    loop {
        match attempt() {
            Err(Errno::INTR) => {}
            Err(Errno::BUSY) if busy + 1 < BUSY_TRIES => busy += 1,
            other => return other,
        }
    }
}

/// Text of the kernel: up to the first NUL, and readable whatever it is.
pub(crate) fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).chars().filter(|c| !c.is_control()).collect()
}
