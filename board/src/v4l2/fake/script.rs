//! The properties and faults of a scripted camera.

use super::graph::Described;
use std::time::Duration;

/// The fault of a frame of the scripted camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// From the frame of this entry on, the camera is disconnected for the given duration.
    Disconnect(Duration),
    /// The frame has fewer bytes than its format requires.
    Short,
    /// The frame has no bytes.
    Empty,
    /// The frame is cut in half; in JPEG frames the decoder finds it.
    Damaged,
    /// The frame of this entry and all later frames have the error flag.
    AllError,
    /// The frame of this entry and all later frames have too few bytes.
    AllShort,
    /// The frame of this entry and all later frames have no byte.
    AllEmpty,
    /// The driver sets the error flag of the frame.
    Error,
    /// From the frame of this entry on, no frames arrive for the given duration.
    Stall(Duration),
    /// From the frame of this entry on, the control delay is the given number of frames.
    Delay(u32),
    /// The frame repeats the sequence number of the frame before.
    Repeat,
    /// The driver reports a change of the picture format.
    SourceChange,
}

/// The set of controls that the camera has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// Exposure in units of 100 us, and a menu of exposure modes with missing indices.
    Uvc,
    /// Exposure in lines of a sensor, on a sub-device.
    Csi,
    /// A brightness control, but no exposure control.
    NoExposure,
}

/// Reaction of a camera to a requested exposure that is not in its list.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Manner {
    Refuses,
    Ignores,
    RoundsDown,
}

/// A behaviour of some cameras that contradicts the documentation of V4L2 or the values that their drivers
/// report.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Quirk {
    /// The exposure control reads as this value, whatever was written.
    ReadsAs(i64),
    /// The exposure control reads as the value before the last write.
    ReadsOld,
    /// Requests for the value of the exposure control fail.
    Unreadable,
    /// The menu of exposure modes lists no item; the modes can be set.
    NoMenu,
    /// Larger values of the exposure control are shorter exposures.
    Inverted,
    /// Each write of the exposure takes the given duration.
    SlowWrites(Duration),
    /// One of the given number of exposure writes has no effect while the camera streams.
    Forgets(u32),
    /// The control delay is one frame longer for a write with a probability of one half.
    Jitters,
    /// From the write of the exposure with this number on, the exposure mode is automatic again.
    AutomaticAgain(u32),
    /// Frames report more bytes than the buffer has.
    Oversized,
    /// All frames have the sequence number 0.
    Unnumbered,
    /// The sequence numbers of the frames rise by two.
    EverySecond,
    /// At every frame whose number is a multiple of the given one, the sequence numbers jump ahead by a thousand.
    JumpsAhead(u32),
    /// At every frame whose number is a multiple of the given one, the sequence numbers restart at 0.
    Restarts(u32),
    /// A frame takes at least twice its exposure time at every frame rate.
    Slows,
    /// This number of frames from the start of the stream are black.
    DarkStart(u32),
    /// Every frame whose number is a multiple of the given one shows the picture of the frame before.
    RepeatsPicture(u32),
    /// One of the given number of requests for a frame fails with EIO.
    DequeueFails(u32),
    /// The first starts of the stream, as many as the given number, fail with EIO.
    StartFails(u32),
    /// The first starts of the stream, as many as the given number, fail with EBUSY.
    StartIsBusy(u32),
    /// The driver lists frame sizes and frame rates as ranges.
    Ranges,
    /// The driver reports a frame interval of 40 ms, whatever the true one is.
    ReportsInterval,
    /// The driver sets the requested frame rate.
    TakesRates,
    /// The driver reports neither the length of a row nor that of a frame.
    NoStride,
}

/// Properties and faults of the scripted camera.
#[derive(Clone, Debug)]
pub struct Script {
    pub quirks: Vec<Quirk>,
    pub kind: Kind,
    /// Name of the sensor's sub-device.
    pub sensor: &'static str,
    /// Sizes of the pad formats that were requested.
    pub pads: Vec<(u32, u32)>,
    /// FourCCs of the offered formats; pictures have the first one, and are empty if the program cannot read
    /// it.
    pub formats: Vec<&'static str>,
    pub size: (u32, u32),
    pub period: Duration,
    pub delay: u32,
    /// Fraction of the frames that are lost, 0 to 1.
    pub loss: f64,
    /// Interval, in requests, of the requests that are interrupted; 0 for none.
    pub interrupt: u32,
    /// Number of attempts to open the device, from the first, that fail because it is busy.
    pub busy: u32,
    /// Least and largest value of the exposure control.
    pub range: (i64, i64),
    /// Radiance of the scene: at 1, a pixel at the bright end of the picture saturates in 33 ms.
    pub light: f64,
    pub faults: Vec<(u64, Fault)>,
    /// True if the camera resets automatic processing and exposure when the stream starts.
    pub reset_at_start: bool,
    /// Least value of the sharpness control.
    pub least_sharpness: i64,
    /// Interval, in writes, of the writes of the exposure that fail while streaming; 0 for none.
    pub fail_write_every: u32,
    /// Whether frame timestamps are those of the wall clock instead of the simulated clock.
    pub wall_clock: bool,
    /// Function from a frame's time to its timestamp, both in nanoseconds.
    pub stamps: Option<fn(u64) -> u64>,
    /// Whether simulated time passes as fast as real time.
    pub real_time: bool,
    /// Largest difference that noise adds to a sample of one byte, in codes, up or down.
    pub noise: u32,
    /// Codes per electron of the photon noise of a sample of one byte; 0 for no photon noise.
    pub codes_per_electron: f64,
    /// Probability of each random fault at a frame, 0 to 1.
    pub chance: f64,
    /// List of the exposures that the camera accepts; `None` for all. `manner` is the reaction to others.
    pub accepts: Option<Vec<i64>>,
    pub manner: Manner,
    /// Exposures that the sensor uses for a written value, although the control reads back that value.
    pub really: Option<Vec<i64>>,
    /// Media devices of the scripted kernel.
    pub graphs: Vec<Described>,
}

impl Default for Script {
    fn default() -> Self {
        let period = Duration::from_millis(40);
        let range = (1, 5000);
        Self {
            quirks: Vec::new(),
            kind: Kind::Uvc,
            sensor: "fake219 10-0010",
            pads: Vec::new(),
            formats: vec!["GREY"],
            size: (64, 48),
            period,
            delay: 2,
            loss: 0.0,
            interrupt: 0,
            busy: 0,
            range,
            light: 4.0,
            faults: Vec::new(),
            reset_at_start: false,
            least_sharpness: 0,
            fail_write_every: 0,
            wall_clock: false,
            stamps: None,
            real_time: false,
            noise: 0,
            codes_per_electron: 0.0,
            chance: 0.0,
            accepts: None,
            manner: Manner::Refuses,
            really: None,
            graphs: Vec::new(),
        }
    }
}
