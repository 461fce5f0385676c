//! Counters and states of a camera's exposures and frames, for `/v1/status` and `/metrics`.

use serde::Serialize;

/// Exposures and frames of a camera since the probe started.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CameraStatus {
    /// The exposures of the last burst, ascending.
    pub exposures: Vec<ExposureStatus>,
    /// Frames after the next one until an exposure acts; null while it is unknown.
    pub delay_frames: Option<u32>,
    /// The part of the sensor that pictures show; null where it is unknown.
    pub view: Option<ViewStatus>,
    /// Frames by how their exposure is known.
    pub known: KnownCounts,
    /// Numbers of frames by their result.
    pub frames: FrameCounts,
    /// Writes of the exposure that were left out because they would have come too late.
    pub late_writes: u64,
    /// Writes of the exposure that the driver refused.
    pub failed_writes: u64,
    /// Frames whose exposure the ratio to their neighbour contradicted.
    pub mismatches: u64,
    /// Times that another control delay was found to be right.
    pub resyncs: u64,
    /// Times that the camera was opened again.
    pub reopened: u64,
}

/// An exposure of a burst.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ExposureStatus {
    /// Seconds that were asked for.
    pub asked_s: f64,
    /// Seconds that are used.
    pub seconds: f64,
    /// Origin of the exposure: "verified", "measured", "predicted" or "unknown".
    pub known: &'static str,
}

/// The part of a sensor that pictures show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ViewStatus {
    /// Share of the sensor's area that pictures show, 0 to 1.
    pub share: f64,
    /// Left, top, width and height in sensor pixels.
    pub crop: [u32; 4],
    /// Sensor pixels that make a pixel of the picture.
    pub binning: [u32; 2],
}

/// Frames by how their exposure is known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct KnownCounts {
    /// The brightness ratio to a neighbour agrees within 10 %.
    pub verified: u64,
    /// Measured from brightness ratios.
    pub measured: u64,
    /// Known from the writes of the control alone.
    pub predicted: u64,
    /// Number of frames whose exposure is unknown.
    pub unknown: u64,
}

impl KnownCounts {
    /// Each count with its name.
    #[must_use]
    pub const fn named(&self) -> [(&'static str, u64); 4] {
        let Self { verified, measured, predicted, unknown } = *self;
        [("verified", verified), ("measured", measured), ("predicted", predicted), ("unknown", unknown)]
    }
}

/// Numbers of frames by their result.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct FrameCounts {
    /// Number of complete frames.
    pub complete: u64,
    /// Frames that the sensor counted and the driver did not deliver.
    pub lost: u64,
    /// Frames with the driver's error flag.
    pub flagged: u64,
    /// Frames without a byte.
    pub empty: u64,
    /// Frames of fewer bytes than the format has.
    pub short: u64,
    /// Frames whose number does not rise.
    pub repeated: u64,
    /// Compressed frames that are cut or damaged.
    pub damaged: u64,
    /// Complete frames whose timestamp is of another clock.
    pub unstamped: u64,
}

impl FrameCounts {
    /// Dropped frames, each count with the name of its fault.
    #[must_use]
    pub const fn broken(&self) -> [(&'static str, u64); 5] {
        let Self { flagged, empty, short, repeated, damaged, .. } = *self;
        [
            ("flagged", flagged),
            ("empty", empty),
            ("short", short),
            ("repeated", repeated),
            ("damaged", damaged),
        ]
    }
}
