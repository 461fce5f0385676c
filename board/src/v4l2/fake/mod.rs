//! A scripted kernel with a simulated camera, in simulated time: with the faults of real ones, on demand.
//!
//! The camera exposes frame `n` from the light that the newest control write gives which came at least `delay` whole frames before it.
//! What each frame really was exposed with is kept as the truth that tests compare with.

mod controls;
mod node;

use super::{Kernel, Node, abi};
use hemilux_core::format::{Format, Layout, Yuv};
use node::FakeNode;
use rustix::io::Errno;
use std::collections::{BTreeMap, HashMap, VecDeque};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

/// Time of every request and of every wait that finds something, nanoseconds.
const CALL_NS: u64 = 20_000;

/// Bytes behind each row.
const PADDING: usize = 16;

/// What goes wrong at a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// The cable is pulled, and put back after so long.
    Disconnect(Duration),
    /// The frame has too few bytes.
    Short,
    /// The frame has no byte.
    Empty,
    /// The frame is cut in half; of JPEG frames that shows when they are decoded.
    Damaged,
    /// All frames from here on have the error flag.
    AllError,
    /// The frame has the error flag.
    Error,
    /// No frames arrive for this time.
    Stall(Duration),
    /// From this frame on, the control delay is this number of frames.
    Delay(u32),
    /// The frame has the number of the one before.
    Repeat,
    /// The driver says that the picture format changed.
    SourceChange,
}

/// Which controls the camera has.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// 100 us units, a menu of modes with holes.
    Uvc,
    /// Lines, on a sub-device.
    Csi,
    /// Brightness only.
    NoExposure,
}

/// What a camera does with an exposure that is not in its list.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Manner {
    Refuses,
    Ignores,
    RoundsDown,
}

/// How the camera behaves.
#[derive(Clone, Debug)]
pub struct Script {
    pub kind: Kind,
    /// Name of its sensor's sub-device.
    pub sensor: &'static str,
    /// Pad formats that were asked for.
    pub pads: Vec<(u32, u32)>,
    /// What it offers; pictures are of the first, or of none if they cannot be read.
    pub formats: Vec<&'static str>,
    pub size: (u32, u32),
    pub period: Duration,
    pub delay: u32,
    /// Share of frames that are lost.
    pub loss: f64,
    /// One of this number of requests is interrupted; 0 for none.
    pub interrupt: u32,
    /// Number of attempts to open the device, from the first, that fail because it is busy.
    pub busy: u32,
    /// Range of the exposure control.
    pub range: (i64, i64),
    /// Radiance: 1 fills a pixel in 33 ms at the bright end of the picture.
    pub light: f64,
    pub faults: Vec<(u64, Fault)>,
    /// Automatic processing and exposure are reset when the stream starts.
    pub reset_at_start: bool,
    /// Sharpness cannot be set to less.
    pub least_sharpness: i64,
    /// One of this number of writes of the exposure fails while streaming; 0 for none.
    pub fail_write_every: u32,
    /// Stamps are those of the wall clock, else the simulated ones.
    pub wall_clock: bool,
    /// Exposures that are taken, and what happens to others.
    pub accepts: Option<Vec<i64>>,
    pub manner: Manner,
    /// Exposures that the sensor really has; the control reads back what was written.
    pub really: Option<Vec<i64>>,
}

impl Default for Script {
    fn default() -> Self {
        let period = Duration::from_millis(40);
        let range = (1, 5000);
        Self {
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
            accepts: None,
            manner: Manner::Refuses,
            really: None,
        }
    }
}

pub struct World {
    pub script: Script,
    pub now_ns: u64,
    /// Frames since the camera was plugged in, the disconnected time left out.
    pub total: u64,
    /// What each frame of the present stream was exposed with.
    pub truth: HashMap<u32, i64>,
    /// Nodes and mappings that are open.
    pub open: usize,
    pub mapped: usize,
    /// Opens that succeeded.
    pub opened: usize,
    pub gone_until_ns: u64,
    /// What was written to VBLANK and EXPOSURE, in order.
    pub written: Vec<(u32, i64)>,
    controls: BTreeMap<u32, i64>,
    writes: Vec<(u32, i64)>,
    streaming: bool,
    start_ns: u64,
    next: u32,
    queued: VecDeque<u32>,
    done: VecDeque<(abi::Buffer, Vec<u8>)>,
    events: u32,
    all_error: bool,
    calls: u32,
    pub tried: u32,
    random: u64,
    generation: u32,
}

#[derive(Clone)]
pub struct FakeKernel(pub Arc<Mutex<World>>);

impl FakeKernel {
    pub fn new(script: Script) -> Self {
        let controls = BTreeMap::from([
            (abi::BRIGHTNESS, 128),
            (abi::EXPOSURE_AUTO, 3),
            (abi::EXPOSURE_ABSOLUTE, 156),
            (abi::DYNAMIC_FRAME_RATE, 1),
            (abi::SHARPNESS, 3),
            (abi::AUTO_WHITE_BALANCE, 1),
            (abi::EXPOSURE, 100),
            (abi::VBLANK, 10),
            (abi::HBLANK, 936),
            (abi::PIXEL_RATE, 10_000_000),
            (abi::ANALOGUE_GAIN, 100),
        ]);
        Self(Arc::new(Mutex::new(World {
            script,
            now_ns: 1_000_000_000,
            total: 0,
            truth: HashMap::new(),
            open: 0,
            mapped: 0,
            opened: 0,
            gone_until_ns: 0,
            written: Vec::new(),
            controls,
            writes: Vec::new(),
            streaming: false,
            start_ns: 0,
            next: 0,
            queued: VecDeque::new(),
            done: VecDeque::new(),
            events: 0,
            all_error: false,
            calls: 0,
            tried: 0,
            random: 0x9e37_79b9_7f4a_7c15,
            generation: 0,
        })))
    }

    /// Nodes and mappings that are open.
    pub fn held(&self) -> (usize, usize) {
        let world = self.world();
        (world.open, world.mapped)
    }

    pub fn world(&self) -> MutexGuard<'_, World> {
        self.0.lock().expect("no test has panicked with it")
    }
}

impl World {
    /// The value that makes the exposure.
    fn knob(&self) -> u32 {
        match self.script.kind {
            Kind::Uvc => abi::EXPOSURE_ABSOLUTE,
            Kind::Csi => abi::EXPOSURE,
            Kind::NoExposure => abi::BRIGHTNESS,
        }
    }

    /// The value of a control.
    pub fn control(&self, id: u32) -> i64 {
        self.controls[&id]
    }

    /// What the sensor makes of an exposure.
    pub fn really(&self, value: i64) -> i64 {
        let all = self.script.really.iter().flatten();
        all.copied().min_by_key(|v| (v - value).abs()).unwrap_or(value)
    }

    /// The first format that is offered.
    fn fourcc(&self) -> [u8; 4] {
        self.script.formats[0].as_bytes().try_into().expect("four characters")
    }

    /// Limited range where there is one.
    fn format(&self) -> Format {
        if self.is_jpeg() {
            return Format::Rgb24;
        }
        let yuv = Yuv { limited: true, ..Yuv::default() };
        Format::from_fourcc(self.fourcc(), yuv).expect("a format that is read")
    }

    /// Whether the pictures are JPEG.
    fn is_jpeg(&self) -> bool {
        self.fourcc() == *b"MJPG"
    }

    fn bytes_per_line(&self) -> usize {
        let padding = if self.is_jpeg() { 0 } else { PADDING };
        self.format().line_bytes(self.script.size.0) + padding
    }

    /// How pictures lie.
    fn layout(&self) -> Layout {
        let (width, height) = self.script.size;
        Layout::try_new(self.format(), width, height, self.bytes_per_line()).expect("a size that suits it")
    }

    fn is_gone(&self) -> bool {
        self.now_ns < self.gone_until_ns
    }

    fn chance(&mut self) -> f64 {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        (self.random >> 11) as f64 / (1u64 << 53) as f64
    }

    fn finished_at(&self, frame: u32) -> u64 {
        self.start_ns + (u64::from(frame) + 1) * self.script.period.as_nanos() as u64
    }

    /// Lets all frames finish that are over by now.
    fn advance(&mut self, to_ns: u64) {
        while self.streaming && !self.is_gone() && self.finished_at(self.next) <= to_ns {
            self.now_ns = self.now_ns.max(self.finished_at(self.next));
            self.finish();
        }
        self.now_ns = self.now_ns.max(to_ns);
    }

    fn finish(&mut self) {
        let frame = self.next;
        self.next += 1;
        self.total += 1;
        let acting = self.writes.iter().rev().find(|(first, _)| *first <= frame);
        let value = acting.map_or(100, |(_, v)| *v);
        self.truth.insert(frame, value);
        let faults: Vec<Fault> =
            self.script.faults.iter().filter(|(at, _)| *at == self.total).map(|(_, f)| *f).collect();
        let mut picture = self.expose(self.really(value));
        let (mut flags, mut used, mut number) = (0, picture.len(), frame);
        for fault in faults {
            match fault {
                Fault::Disconnect(time) => {
                    self.gone_until_ns = self.now_ns + time.as_nanos() as u64;
                    self.generation += 1;
                    self.streaming = false;
                    return;
                }
                Fault::Short => used -= 1,
                Fault::Damaged => {
                    used /= 2;
                    picture.truncate(used);
                }
                Fault::Empty => used = 0,
                Fault::AllError => self.all_error = true,
                Fault::Error => flags = abi::BUFFER_ERROR,
                Fault::Stall(time) => self.start_ns += time.as_nanos() as u64,
                Fault::Repeat => number -= 1,
                Fault::Delay(delay) => self.script.delay = delay,
                Fault::SourceChange => self.events += 1,
            }
        }
        if self.all_error {
            flags = abi::BUFFER_ERROR;
        }
        if self.chance() < self.script.loss {
            return;
        }
        let Some(index) = self.queued.pop_front() else { return };
        let mut us = (self.finished_at(frame) / 1000).cast_signed();
        if self.script.wall_clock {
            let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
            us = now.expect("after 1970").as_micros() as i64;
        }
        let timestamp = [us / 1_000_000, us % 1_000_000];
        let buffer = abi::Buffer {
            index,
            flags,
            bytes_used: used as u32,
            timestamp,
            sequence: number,
            ..Default::default()
        };
        self.done.push_back((buffer, picture));
    }
}

impl Kernel for FakeKernel {
    fn open(&mut self, path: &Path) -> Result<Box<dyn Node>, Errno> {
        let mut w = self.world();
        if w.is_gone() {
            return Err(Errno::NOENT);
        }
        if w.script.busy > 0 {
            w.script.busy -= 1;
            return Err(Errno::BUSY);
        }
        w.open += 1;
        w.opened += 1;
        let sensor = path.to_string_lossy().contains("subdev");
        let generation = w.generation;
        Ok(Box::new(FakeNode::new(Arc::clone(&self.0), generation, sensor)))
    }

    fn video_nodes(&mut self) -> Vec<PathBuf> {
        vec!["/dev/video0".into()]
    }

    fn subdevices(&mut self) -> Vec<(PathBuf, String)> {
        let script = &self.world().script;
        let is_csi = script.kind == Kind::Csi;
        if is_csi { vec![("/dev/v4l-subdev0".into(), script.sensor.into())] } else { Vec::new() }
    }

    fn now_ns(&self) -> u64 {
        self.world().now_ns
    }

    fn sleep(&mut self, duration: Duration) {
        let mut w = self.world();
        let to = w.now_ns + duration.as_nanos() as u64;
        w.advance(to);
        drop(w);
        // Other tests want the machine too.
        std::thread::sleep(Duration::from_millis(1));
    }
}
