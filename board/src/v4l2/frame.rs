//! Frames from drivers, with their exposures and counters.

use super::abi;
use super::schedule::Known;
use crate::camera_status::{FrameCounts, KnownCounts};

/// Counters of the frames of a camera since it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Number of complete frames that were delivered.
    pub frames: u64,
    /// Number of frames that the sensor counted and the driver did not deliver.
    pub lost: u64,
    /// Numbers of dropped frames by their fault.
    pub broken: Broken,
    /// Number of exposure writes that were skipped because they would have acted too late.
    pub late: u64,
    /// Number of exposure writes that the driver refused.
    pub failed_writes: u64,
    /// Number of frames whose timestamp is not of CLOCK_MONOTONIC or did not advance; their arrival time is used instead.
    pub unstamped: u64,
    /// Number of complete frames by the origin of their exposure.
    pub known: KnownCounts,
    /// Number of frames whose brightness ratio to the frame before contradicted the predicted exposure.
    pub mismatches: u64,
    /// Number of corrections of the assumed control delay.
    pub resyncs: u64,
}

impl Counters {
    /// Counts a complete frame by the origin of its exposure.
    pub(super) const fn note(&mut self, known: Known) {
        let count = match known {
            Known::Verified => &mut self.known.verified,
            Known::Measured => &mut self.known.measured,
            Known::Predicted | Known::Reported => &mut self.known.predicted,
            Known::Unknown => &mut self.known.unknown,
        };
        *count += 1;
    }

    /// Returns counters with the sums of these counters and those of `other`.
    #[must_use]
    pub const fn plus(&self, other: &Self) -> Self {
        let (a, b) = (&self.broken, &other.broken);
        Self {
            frames: self.frames.saturating_add(other.frames),
            lost: self.lost.saturating_add(other.lost),
            broken: Broken {
                flagged: a.flagged.saturating_add(b.flagged),
                empty: a.empty.saturating_add(b.empty),
                short: a.short.saturating_add(b.short),
                repeated: a.repeated.saturating_add(b.repeated),
                damaged: a.damaged.saturating_add(b.damaged),
            },
            late: self.late.saturating_add(other.late),
            failed_writes: self.failed_writes.saturating_add(other.failed_writes),
            unstamped: self.unstamped.saturating_add(other.unstamped),
            known: KnownCounts {
                verified: self.known.verified.saturating_add(other.known.verified),
                measured: self.known.measured.saturating_add(other.known.measured),
                predicted: self.known.predicted.saturating_add(other.known.predicted),
                unknown: self.known.unknown.saturating_add(other.known.unknown),
            },
            mismatches: self.mismatches.saturating_add(other.mismatches),
            resyncs: self.resyncs.saturating_add(other.resyncs),
        }
    }

    /// Returns the counters of frames in the form of the camera's status.
    #[must_use]
    pub const fn counts(&self) -> FrameCounts {
        let Broken { flagged, empty, short, repeated, damaged } = self.broken;
        FrameCounts {
            complete: self.frames,
            lost: self.lost,
            flagged,
            empty,
            short,
            repeated,
            damaged,
            unstamped: self.unstamped,
        }
    }
}

/// Numbers of a camera's dropped frames by their fault.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Broken {
    /// Number of frames with the driver's error flag.
    pub flagged: u64,
    /// Number of dropped frames that have no byte.
    pub empty: u64,
    /// Number of frames with fewer bytes than the format requires.
    pub short: u64,
    /// Number of frames whose sequence number does not increase.
    pub repeated: u64,
    /// Number of truncated or damaged JPEG frames.
    pub damaged: u64,
}

impl Broken {
    /// Returns the total number of dropped frames.
    #[must_use]
    pub const fn total(&self) -> u64 {
        let cut = self.empty.saturating_add(self.short).saturating_add(self.damaged);
        self.flagged.saturating_add(cut).saturating_add(self.repeated)
    }

    /// Returns the number of frames that were dropped since the counters `earlier` were read.
    #[must_use]
    pub const fn since(&self, earlier: &Self) -> Self {
        Self {
            flagged: self.flagged.saturating_sub(earlier.flagged),
            empty: self.empty.saturating_sub(earlier.empty),
            short: self.short.saturating_sub(earlier.short),
            repeated: self.repeated.saturating_sub(earlier.repeated),
            damaged: self.damaged.saturating_sub(earlier.damaged),
        }
    }

    /// Counts the frame of `buffer` under its fault if the frame has one. Returns true if the frame has no fault and contains the `whole`
    /// bytes of the format.
    pub(super) const fn check(&mut self, buffer: &abi::Buffer, repeated: bool, whole: usize) -> bool {
        let count = match buffer.bytes_used as usize {
            _ if repeated => &mut self.repeated,
            0 => &mut self.empty,
            _ if buffer.flags & abi::BUFFER_ERROR != 0 => &mut self.flagged,
            bytes if bytes < whole => &mut self.short,
            _ => return true,
        };
        *count += 1;
        false
    }
}

impl std::fmt::Display for Broken {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let kinds = [
            (self.flagged, "with the error flag"),
            (self.empty, "empty"),
            (self.short, "short"),
            (self.repeated, "with a repeated number"),
            (self.damaged, "damaged"),
        ];
        let told: Vec<_> = kinds.iter().filter(|k| k.0 > 0).map(|(n, kind)| format!("{n} {kind}")).collect();
        f.write_str(if told.is_empty() { "none".into() } else { told.join(", ") }.as_str())
    }
}

/// Identity of a frame: number, time and exposure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Taken {
    /// Sequence number of the sensor's frame.
    pub sequence: u32,
    /// CLOCK_MONOTONIC timestamp of the driver; the arrival time if the driver's timestamp is of another clock.
    pub timestamp_ns: u64,
    /// Index of the frame's exposure in the camera's settings; `None` if the frame may have one of several
    /// exposures.
    pub slot: Option<usize>,
    /// How the exposure of the frame is known.
    pub known: Known,
}

/// A frame in the packing of the driver.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RawFrame {
    /// Sequence number, time and exposure of the frame.
    pub taken: Taken,
    /// Samples of the frame in the packing of the picture's format.
    pub bytes: Vec<u8>,
}

impl Default for RawFrame {
    fn default() -> Self {
        let taken = Taken { sequence: 0, timestamp_ns: 0, slot: None, known: Known::Unknown };
        Self { taken, bytes: Vec::new() }
    }
}

/// A buffer that the driver has filled with a frame.
#[derive(Debug)]
pub(super) struct Filled {
    pub buffer: abi::Buffer,
    /// Whether the frame in the buffer is complete.
    pub good: bool,
}

/// Returns the driver's timestamp of `buffer`, nanoseconds.
pub(super) fn stamped_ns(buffer: &abi::Buffer) -> u64 {
    let [s, us] = buffer.timestamp.map(|v| u64::try_from(v).unwrap_or(0));
    s.saturating_mul(1_000_000_000).saturating_add(us.saturating_mul(1000))
}
