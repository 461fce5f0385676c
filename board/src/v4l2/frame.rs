//! Frames as drivers give them, and what becomes of them.

use super::abi;
use super::schedule::Known;

/// What happened to frames since the camera was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Frames that came whole.
    pub frames: u64,
    /// Frames that the sensor counted and nobody delivered.
    pub lost: u64,
    /// Frames with the error flag, too short, or with a number that was there before.
    pub broken: u64,
    /// Writes of the exposure that were left out because they would have come too late.
    pub late: u64,
    /// Frames whose exposure the ratio to their neighbour contradicted.
    pub mismatches: u64,
    /// Times that another control delay was found to be right.
    pub resyncs: u64,
}

/// A frame's identity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Taken {
    /// Counts the sensor's frames.
    pub sequence: u32,
    /// CLOCK_MONOTONIC, as the driver says.
    pub timestamp_ns: u64,
    /// Index into the camera's settings; `None` where the frame may have one exposure or another.
    pub slot: Option<usize>,
    /// How it is known.
    pub known: Known,
}

/// A frame as the driver gave it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RawFrame {
    /// Whose.
    pub taken: Taken,
    /// As the picture's format has them.
    pub bytes: Vec<u8>,
}

impl Default for RawFrame {
    fn default() -> Self {
        let taken = Taken { sequence: 0, timestamp_ns: 0, slot: None, known: Known::Unknown };
        Self { taken, bytes: Vec::new() }
    }
}

/// The driver's timestamp.
pub(super) fn stamped_ns(buffer: &abi::Buffer) -> u64 {
    let [s, us] = buffer.timestamp.map(|v| u64::try_from(v).unwrap_or(0));
    s.saturating_mul(1_000_000_000).saturating_add(us.saturating_mul(1000))
}
