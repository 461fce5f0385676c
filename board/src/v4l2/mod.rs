//! Cameras through Video4Linux (V4L2).
//!
//! [`abi`] defines the kernel's structures. The traits [`Kernel`] and [`Node`] abstract the kernel: [`real`] implements them by system
//! calls and is the only module with `unsafe`; tests implement them by a scripted kernel. [`device`] lists a camera's formats and ranges,
//! [`controls`] reads and sets controls, [`media`] connects a sensor with its node, [`exposure`] finds the exposure control, `agree` its values,
//! [`setup`] negotiates format, rate and exposures, [`schedule`] predicts each frame's exposure, [`verify`] and [`measured`] compare the
//! prediction with brightness ratios, [`capture`] returns one frame at a time, and [`supervise`] opens a failed camera again.
//!
//! The requests are written by hand: bindgen would need libclang, and there are two dozen requests, whose layouts are asserted at compile
//! time. The crate `v4l` (0.14) would replace the enumeration only: it panics on unknown control types and on streams that cannot be
//! stopped, queues a buffer twice after a timeout, returns EINTR to the caller, refuses controls of several classes, and supports neither
//! sub-devices nor events.

#[macro_use]
mod layout;

pub mod abi;
mod access;
mod agree;
mod arrivals;
pub mod capture;
pub mod controls;
mod delay;
pub mod device;
pub mod exposure;
#[cfg(test)]
pub(crate) mod fake;
mod fetch;
#[cfg(test)]
mod field_tests;
pub mod formats;
pub mod frame;
mod huffman;
mod ids;
pub mod jpeg;
pub mod luma;
pub mod measured;
pub mod media;
mod negotiate;
mod numbers;
#[cfg(test)]
mod odd_tests;
pub mod options;
mod pads;
mod place;
#[cfg(target_os = "linux")]
pub mod real;
pub mod schedule;
pub mod setup;
mod size;
mod start;
pub mod supervise;
#[cfg(test)]
mod tests;
pub mod verify;
pub mod view;

use media::Device;
use rustix::io::Errno;
pub use size::Size;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// One request to a node, with the structure that the kernel reads and writes.
#[derive(Debug)]
#[allow(missing_docs, reason = "each is the request of the same name")]
pub enum Call<'a> {
    QueryCapability(&'a mut abi::Capability),
    EnumFormats(&'a mut abi::FormatDescription),
    EnumSizes(&'a mut abi::SizeDescription),
    EnumIntervals(&'a mut abi::IntervalDescription),
    GetFormat(&'a mut abi::Format),
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
    GetPadFormat(&'a mut abi::PadFormat),
    SetPadFormat(&'a mut abi::PadFormat),
    EnumBusCodes(&'a mut abi::BusCode),
    EnumPadSizes(&'a mut abi::PadSize),
    GetSelection(&'a mut abi::Selection),
    GetPadSelection(&'a mut abi::PadSelection),
    Topology(&'a mut media::Topology),
    SetupLink(&'a mut media::abi::LinkSetup),
    GetRoutes(&'a mut Vec<abi::PadRoute>),
    SetRoutes(&'a mut Vec<abi::PadRoute>),
}

/// The events for which a wait on a device node has ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Ready {
    /// True if a frame can be dequeued.
    pub frame: bool,
    /// True if an event can be dequeued.
    pub event: bool,
    /// The device is gone or its queue of buffers is broken.
    pub gone: bool,
}

/// An open device node; dropping it closes the node and unmaps its buffers.
pub trait Node: Send {
    /// Makes one request to the device node.
    ///
    /// # Errors
    /// The kernel's error, EINTR included.
    fn call(&mut self, call: Call<'_>) -> Result<(), Errno>;

    /// Waits for a frame or an event of the device node; all fields of the result are false after `timeout`.
    ///
    /// # Errors
    /// The kernel's error, EINTR included.
    fn wait(&mut self, timeout: Duration) -> Result<Ready, Errno>;

    /// Maps the buffer that `QueryBuffer` described; buffers are mapped in the order of their indices.
    ///
    /// # Errors
    /// The kernel's error.
    fn map(&mut self, buffer: &abi::Buffer) -> Result<(), Errno>;

    /// Returns the bytes of buffer `index`; an empty slice while the driver owns the buffer.
    fn bytes(&self, index: u32) -> &[u8];
}

/// Access to device nodes and to the clock.
pub trait Kernel: Send {
    /// Opens a node for reading and writing in non-blocking mode.
    ///
    /// # Errors
    /// The kernel's error.
    fn open(&mut self, path: &Path) -> Result<Box<dyn Node>, Errno>;

    /// Returns the paths of all capture nodes (`/dev/video*`), in order of their numbers.
    fn video_nodes(&mut self) -> Vec<PathBuf>;

    /// Returns the paths and names of all sub-devices (`/dev/v4l-subdev*`).
    fn subdevices(&mut self) -> Vec<(PathBuf, String)>;

    /// Returns the paths of all media devices (`/dev/media*`).
    fn media_nodes(&mut self) -> Vec<PathBuf>;

    /// Returns the number of the character device at `path`.
    fn device_of(&mut self, path: &Path) -> Option<Device>;

    /// Returns the path of the video node or sub-device with the number `device`.
    fn node_of(&mut self, device: Device) -> Option<PathBuf>;

    /// Returns the time of CLOCK_MONOTONIC, the clock of frame timestamps, nanoseconds.
    fn now_ns(&self) -> u64;

    /// Sleeps for `duration`.
    fn sleep(&mut self, duration: Duration);
}

/// Reasons why a camera delivers no frames.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CameraError {
    /// A request to the kernel failed.
    #[error("{path}: {operation}: found {errno}, expected {expected}")]
    Failed {
        /// Path of the device node.
        path: PathBuf,
        /// Name of the kernel request that failed.
        operation: &'static str,
        /// Description of the kernel's error number.
        errno: String,
        /// The condition under which the request succeeds.
        expected: &'static str,
    },
    /// The device is missing or was unplugged.
    #[error("{0}: found no camera, expected one that is plugged in")]
    Gone(PathBuf),
    /// The camera delivered no frame within the timeout.
    #[error("{path}: found no frame in {ms} ms, expected one every {period_ms} ms")]
    Silent {
        /// Path of the device node.
        path: PathBuf,
        /// Time since the last frame of the camera, milliseconds.
        ms: u64,
        /// Frame interval of the camera, milliseconds.
        period_ms: u64,
    },
    /// A property of the camera cannot be used.
    #[error("{path}: found {found}, expected {expected}")]
    Unfit {
        /// Path of the device node.
        path: PathBuf,
        /// Description of the property that was found.
        found: String,
        /// Description of the property that was expected.
        expected: String,
    },
}

/// Largest number of attempts of a request that the driver refuses with EBUSY or EAGAIN.
const BUSY_TRIES: u32 = 4;

/// Repeats a request while it is interrupted by signals (EINTR), and up to [`BUSY_TRIES`] times while the driver is busy.
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

/// Decodes a NUL-terminated text of the kernel; invalid UTF-8 is replaced and control characters are removed.
pub(crate) fn text(bytes: &[u8]) -> String {
    let end = bytes.iter().position(|b| *b == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end]).chars().filter(|c| !c.is_control()).collect()
}
