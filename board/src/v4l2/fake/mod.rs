//! A scripted kernel with a simulated camera in simulated time, which has faults of real cameras on request.
//!
//! The camera exposes frame `n` with the newest control write that came at least `delay` whole frames before it. The true exposure of each
//! frame is stored for comparison by tests.

mod controls;
pub(crate) mod graph;
mod node;
mod quirks;
mod script;

use super::media::Device;
use super::{Kernel, Node, abi};
use graph::Board;
use hemilux_core::format::{Format, Layout, Yuv};
use node::{FakeNode, Role};
use rustix::io::Errno;
pub use script::{Fault, Kind, Manner, Quirk, Script};
use std::collections::{BTreeMap, HashMap, VecDeque};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

/// Duration of every request to the scripted kernel and of every successful wait, nanoseconds.
const CALL_NS: u64 = 20_000;

/// Number of padding bytes at the end of each row of a picture.
const PADDING: usize = 16;

/// A filled buffer of the simulated camera.
struct Done {
    buffer: abi::Buffer,
    picture: Vec<u8>,
    /// Control value with which the frame was exposed.
    value: i64,
}

pub struct World {
    pub script: Script,
    pub boards: Vec<Board>,
    /// True if frames wait for a buffer of another node.
    starved: bool,
    pub now_ns: u64,
    /// Number of frames since the camera was plugged in, without the time of disconnections.
    pub total: u64,
    /// True exposure, as a control value, of each frame of the present stream, by sequence number.
    pub truth: HashMap<u32, i64>,
    /// Number of open nodes and mappings of the scripted kernel.
    pub open: usize,
    pub mapped: usize,
    /// Number of successful openings of nodes.
    pub opened: usize,
    pub gone_until_ns: u64,
    /// Values written to VBLANK and EXPOSURE, in order.
    pub written: Vec<(u32, i64)>,
    controls: BTreeMap<u32, i64>,
    writes: Vec<(u32, i64)>,
    streaming: bool,
    start_ns: u64,
    next: u32,
    queued: VecDeque<u32>,
    done: VecDeque<Done>,
    events: u32,
    always: Option<Fault>,
    calls: u32,
    /// Value of the exposure control before the last write of it.
    old_value: i64,
    /// Numbers of attempts to start the stream and to fetch a frame.
    starts: u32,
    fetched: u32,
    /// Control value of the frame that was fetched last.
    pub last_fetched: Option<i64>,
    /// Samples of the previous frame of the scripted camera.
    shown: Vec<u8>,
    pub tried: u32,
    random: u64,
    /// Number of disconnections of the simulated camera.
    pub generation: u32,
}

#[derive(Clone)]
pub struct FakeKernel(pub Arc<Mutex<World>>);

impl FakeKernel {
    pub fn new(script: Script) -> Self {
        let now_ns = if script.real_time { crate::clock::monotonic_ns() } else { 1_000_000_000 };
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
            boards: script.graphs.iter().cloned().map(Board::new).collect(),
            starved: false,
            script,
            now_ns,
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
            always: None,
            calls: 0,
            old_value: 100,
            starts: 0,
            fetched: 0,
            last_fetched: None,
            shown: Vec::new(),
            tried: 0,
            random: 0x9e37_79b9_7f4a_7c15,
            generation: 0,
        })))
    }

    /// Returns the number of open nodes and the number of mappings.
    pub fn held(&self) -> (usize, usize) {
        let world = self.world();
        (world.open, world.mapped)
    }

    pub fn world(&self) -> MutexGuard<'_, World> {
        self.0.lock().expect("no test has panicked with it")
    }
}

impl World {
    /// Returns the number of the control that sets the exposure.
    fn knob(&self) -> u32 {
        match self.script.kind {
            Kind::Uvc => abi::EXPOSURE_ABSOLUTE,
            Kind::Csi => abi::EXPOSURE,
            Kind::NoExposure => abi::BRIGHTNESS,
        }
    }

    /// Returns the value of control `id`.
    pub fn control(&self, id: u32) -> i64 {
        self.controls[&id]
    }

    fn has(&self, quirk: Quirk) -> bool {
        self.script.quirks.contains(&quirk)
    }

    /// Returns the exposure that the sensor uses for the control value `value`.
    pub fn really(&self, value: i64) -> i64 {
        if self.has(Quirk::Inverted) {
            return self.script.range.1 / value.max(1);
        }
        let all = self.script.really.iter().flatten();
        all.copied().min_by_key(|v| (v - value).abs()).unwrap_or(value)
    }

    /// Returns the FourCC of the first format that the camera offers.
    fn fourcc(&self) -> [u8; 4] {
        self.script.formats[0].as_bytes().try_into().expect("four characters")
    }

    /// Returns the packing of the frames, limited range if the format has it.
    fn format(&self) -> Format {
        if self.is_jpeg() {
            return Format::Rgb24;
        }
        let yuv = Yuv { limited: true, ..Yuv::default() };
        Format::from_fourcc(self.fourcc(), yuv).expect("a format that is read")
    }

    /// Returns whether the camera's frames are JPEG.
    fn is_jpeg(&self) -> bool {
        self.fourcc() == *b"MJPG"
    }

    fn bytes_per_line(&self) -> usize {
        let padding = if self.is_jpeg() || self.has(Quirk::NoStride) { 0 } else { PADDING };
        self.format().line_bytes(self.script.size.0) + padding
    }

    /// Returns the layout of the camera's pictures.
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

    /// Advances the simulated clock by the duration of a request; returns EINTR for the requests that the
    /// script interrupts.
    fn pass_call(&mut self) -> Result<(), Errno> {
        self.keep_time();
        if !self.script.real_time {
            self.advance(self.now_ns + CALL_NS);
        }
        self.calls += 1;
        let every = self.script.interrupt;
        if every > 0 && self.calls.is_multiple_of(every) { Err(Errno::INTR) } else { Ok(()) }
    }

    /// Follows the real time, if the script requests it.
    fn keep_time(&mut self) {
        if self.script.real_time {
            self.advance(crate::clock::monotonic_ns());
        }
    }

    fn finished_at(&self, frame: u32) -> u64 {
        self.start_ns + (u64::from(frame) + 1) * self.script.period.as_nanos() as u64
    }

    /// Completes all frames that end before `to_ns`.
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
        let mut faults: Vec<Fault> =
            self.script.faults.iter().filter(|(at, _)| *at == self.total).map(|(_, f)| *f).collect();
        faults.extend(self.always);
        for fault in [Fault::Short, Fault::Empty, Fault::Error, Fault::Repeat] {
            if self.script.chance > 0.0 && self.chance() < self.script.chance {
                faults.push(fault);
            }
        }
        let mut picture = self.expose(self.really(value));
        self.add_noise(&mut picture);
        let (mut flags, mut used, mut number) = (0, picture.len(), frame);
        self.spoil_frame(value, &mut picture, &mut used, &mut number);
        for fault in faults {
            match fault {
                Fault::Disconnect(time) => {
                    self.gone_until_ns = self.now_ns + time.as_nanos() as u64;
                    self.generation += 1;
                    self.streaming = false;
                    return;
                }
                Fault::Short | Fault::AllShort => used = used.saturating_sub(1),
                Fault::Damaged => {
                    used /= 2;
                    picture.truncate(used);
                }
                Fault::Empty | Fault::AllEmpty => used = 0,
                Fault::Error | Fault::AllError => flags = abi::BUFFER_ERROR,
                Fault::Stall(time) => self.start_ns += time.as_nanos() as u64,
                Fault::Repeat => number = number.saturating_sub(1),
                Fault::Delay(delay) => self.script.delay = delay,
                Fault::SourceChange => self.events += 1,
            }
            if [Fault::AllError, Fault::AllShort, Fault::AllEmpty].contains(&fault) {
                self.always = Some(fault);
            }
        }
        if self.starved || self.chance() < self.script.loss {
            return;
        }
        let Some(index) = self.queued.pop_front() else { return };
        let mut us = (self.finished_at(frame) / 1000).cast_signed();
        if self.script.wall_clock {
            let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
            us = now.expect("after 1970").as_micros() as i64;
        }
        if let Some(stamp) = self.script.stamps {
            us = (stamp(self.finished_at(frame)) / 1000).cast_signed();
        }
        if self.script.chance > 0.0 && self.chance() < self.script.chance {
            us += 3_000_000;
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
        self.done.push_back(Done { buffer, picture, value });
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
        let text = path.to_string_lossy();
        let media = text.strip_prefix("/dev/media").and_then(|n| n.parse().ok());
        let entity = device(path).and_then(|device| w.place(device));
        let role = match (media, entity) {
            (Some(board), _) if board < w.boards.len() => Role::Media(board),
            (None, Some((board, entity))) => Role::Entity(board, entity),
            (None, None) if w.boards.is_empty() => Role::Plain { sensor: text.contains("subdev") },
            _ => {
                (w.open, w.opened) = (w.open - 1, w.opened - 1);
                return Err(Errno::NOENT);
            }
        };
        let generation = w.generation;
        Ok(Box::new(FakeNode::new(Arc::clone(&self.0), generation, role)))
    }

    fn video_nodes(&mut self) -> Vec<PathBuf> {
        let w = self.world();
        if w.boards.is_empty() {
            return vec!["/dev/video0".into()];
        }
        let nodes =
            w.boards.iter().flat_map(|b| (0..b.entities()).filter(|e| b.is_node(*e)).map(|e| b.path(e)));
        nodes.collect()
    }

    fn subdevices(&mut self) -> Vec<(PathBuf, String)> {
        let script = &self.world().script;
        let is_csi = script.kind == Kind::Csi;
        if is_csi { vec![("/dev/v4l-subdev0".into(), script.sensor.into())] } else { Vec::new() }
    }

    fn media_nodes(&mut self) -> Vec<PathBuf> {
        (0..self.world().boards.len()).map(|n| format!("/dev/media{n}").into()).collect()
    }

    fn device_of(&mut self, path: &Path) -> Option<Device> {
        let device = device(path)?;
        self.world().place(device).map(|_| device)
    }

    fn node_of(&mut self, device: Device) -> Option<PathBuf> {
        let w = self.world();
        let (board, entity) = w.place(device)?;
        Some(w.boards[board].path(entity))
    }

    fn now_ns(&self) -> u64 {
        let mut w = self.world();
        w.keep_time();
        w.now_ns
    }

    fn sleep(&mut self, duration: Duration) {
        let mut w = self.world();
        let to = w.now_ns + duration.as_nanos() as u64;
        w.advance(to);
        drop(w);
        // A short sleep leaves processor time to other tests.
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Returns the device number of a described node, from the number in its name.
fn device(path: &Path) -> Option<Device> {
    let name = path.to_str()?;
    let number = name.strip_prefix("/dev/video").or_else(|| name.strip_prefix("/dev/v4l-subdev"))?;
    Some(Device { major: graph::MAJOR, minor: number.parse().ok()? })
}
