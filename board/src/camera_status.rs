//! Counters and states of a camera's exposures and frames, for `/v1/status` and `/metrics`.

use serde::Serialize;

/// Exposures and frames of a camera since the probe started.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct CameraStatus {
    /// The exposures of the last burst, in ascending order.
    pub exposures: Vec<ExposureStatus>,
    /// Control delay: number of frames after the next one until a written exposure takes effect; null while it is unknown.
    pub delay_frames: Option<u32>,
    /// The part of the sensor that pictures show; null where it is unknown.
    pub view: Option<ViewStatus>,
    /// Number of frames by the origin of their exposure.
    pub known: KnownCounts,
    /// Numbers of the camera's frames by their result.
    pub frames: FrameCounts,
    /// Number of writes of the exposure that were skipped because they would have taken effect too late.
    pub late_writes: u64,
    /// Number of writes of the exposure that the driver refused.
    pub failed_writes: u64,
    /// Number of frames whose brightness ratio to a neighbouring frame contradicts their exposure.
    pub mismatches: u64,
    /// Number of times that the measured control delay changed.
    pub resyncs: u64,
    /// Number of times that the camera was opened again.
    pub reopened: u64,
}

/// An exposure of the camera's last burst.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ExposureStatus {
    /// Exposure time that was requested of the camera, seconds.
    pub asked_s: f64,
    /// Exposure time that the merge uses, seconds.
    pub seconds: f64,
    /// Origin of the exposure: "verified", "measured", "predicted" or "unknown".
    pub known: &'static str,
}

/// The part of a sensor that pictures show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ViewStatus {
    /// Fraction of the sensor's area that pictures show, 0 to 1.
    pub share: f64,
    /// Left edge, top edge, width and height of the part, in sensor pixels.
    pub crop: [u32; 4],
    /// Number of sensor pixels per pixel of the picture, horizontally and vertically.
    pub binning: [u32; 2],
}

/// Numbers of frames by the origin of their exposure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct KnownCounts {
    /// Number of frames whose brightness ratio to a neighbouring frame agrees with their exposure within 10 %.
    pub verified: u64,
    /// Number of frames whose exposure was measured from brightness ratios.
    pub measured: u64,
    /// Number of frames whose exposure follows from the writes of the exposure control alone.
    pub predicted: u64,
    /// Number of frames whose exposure is unknown.
    pub unknown: u64,
}

impl KnownCounts {
    /// Returns each count with the name of the origin.
    #[must_use]
    pub const fn named(&self) -> [(&'static str, u64); 4] {
        let Self { verified, measured, predicted, unknown } = *self;
        [("verified", verified), ("measured", measured), ("predicted", predicted), ("unknown", unknown)]
    }
}

/// Numbers of a camera's frames by their result, since the start of the probe.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct FrameCounts {
    /// Number of frames that were received completely.
    pub complete: u64,
    /// Number of frames that are missing between the sensor's frame numbers: the driver did not deliver them.
    pub lost: u64,
    /// Number of frames with the driver's error flag.
    pub flagged: u64,
    /// Number of dropped frames that have no byte.
    pub empty: u64,
    /// Number of frames with fewer bytes than the format requires.
    pub short: u64,
    /// Number of frames whose number is not greater than that of the frame before.
    pub repeated: u64,
    /// Number of compressed frames that are truncated or damaged.
    pub damaged: u64,
    /// Number of complete frames whose timestamp is not of CLOCK_MONOTONIC.
    pub unstamped: u64,
}

impl FrameCounts {
    /// Returns the number of dropped frames for each fault, with the name of the fault.
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
