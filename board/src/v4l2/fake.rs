//! A scripted kernel with a simulated camera, in simulated time: what a real one does on a bad day, on demand.
//!
//! The camera exposes frame `n` from the light that the newest control write gives which came at least `delay` whole frames before it.
//! What each frame really was exposed with is kept as the truth that tests compare with.

use super::{Call, Kernel, Node, Ready, abi, formats};
use rustix::io::Errno;
use std::collections::{BTreeMap, HashMap, VecDeque};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

pub const WIDTH: u32 = 64;
pub const HEIGHT: u32 = 48;
const BYTES: usize = (WIDTH * HEIGHT) as usize;
/// Time of every request and of every wait that finds something, nanoseconds.
const CALL_NS: u64 = 20_000;

/// What goes wrong at a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// The cable is pulled, and put back after so long.
    Disconnect(Duration),
    /// The frame has too few bytes.
    Short,
    /// The frame has the error flag.
    Error,
    /// No frames for so long.
    Stall(Duration),
    /// From here on controls take so many frames.
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

/// How the camera behaves.
#[derive(Clone, Debug)]
pub struct Script {
    pub kind: Kind,
    pub period: Duration,
    pub delay: u32,
    /// Share of frames that nobody delivers.
    pub loss: f64,
    /// Every so manyth request is interrupted; 0 none.
    pub interrupt: u32,
    /// So many first opens find it busy.
    pub busy: u32,
    /// Range of the exposure control.
    pub range: (i64, i64),
    /// Radiance: 1 fills a pixel in 33 ms at the bright end of the picture.
    pub light: f64,
    pub faults: Vec<(u64, Fault)>,
}

impl Default for Script {
    fn default() -> Self {
        let period = Duration::from_millis(40);
        let range = (1, 5000);
        Self {
            kind: Kind::Uvc,
            period,
            delay: 2,
            loss: 0.0,
            interrupt: 0,
            busy: 0,
            range,
            light: 4.0,
            faults: Vec::new(),
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
    calls: u32,
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
            (abi::EXPOSURE_ABSOLUTE, 150),
            (abi::DYNAMIC_FRAME_RATE, 1),
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
            calls: 0,
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
        let (mut flags, mut used, mut number) = (0, BYTES, frame);
        for fault in faults {
            match fault {
                Fault::Disconnect(time) => {
                    self.gone_until_ns = self.now_ns + time.as_nanos() as u64;
                    self.generation += 1;
                    self.streaming = false;
                    return;
                }
                Fault::Short => used -= 1,
                Fault::Error => flags = abi::BUFFER_ERROR,
                Fault::Stall(time) => self.start_ns += time.as_nanos() as u64,
                Fault::Repeat => number -= 1,
                Fault::Delay(delay) => self.script.delay = delay,
                Fault::SourceChange => self.events += 1,
            }
        }
        if self.chance() < self.script.loss {
            return;
        }
        let Some(index) = self.queued.pop_front() else { return };
        let us = (self.finished_at(frame) / 1000).cast_signed();
        let timestamp = [us / 1_000_000, us % 1_000_000];
        let buffer = abi::Buffer {
            index,
            flags,
            bytes_used: used as u32,
            timestamp,
            sequence: number,
            ..Default::default()
        };
        let picture = self.expose(value);
        self.done.push_back((buffer, picture));
    }

    /// A scene whose radiance rises a thousandfold from left to right, as a linear sensor sees it.
    fn expose(&self, value: i64) -> Vec<u8> {
        // Lines take 100 us like the units of UVC.
        let seconds = value as f64 * 1e-4;
        let row: Vec<u8> = (0..WIDTH)
            .map(|x| {
                let radiance = self.script.light * 10f64.powf(3.0 * (f64::from(x) / f64::from(WIDTH) - 1.0));
                (255.0 * radiance * seconds / 0.033).round().min(255.0) as u8
            })
            .collect();
        row.repeat(HEIGHT as usize)
    }

    fn set(&mut self, id: u32, value: i64) -> Result<(), Errno> {
        if id == abi::EXPOSURE_ABSOLUTE && self.controls[&abi::EXPOSURE_AUTO] == 3 {
            return Err(Errno::ACCESS);
        }
        let (low, high) = self.range(id).ok_or(Errno::INVAL)?;
        let value = value.clamp(low, high);
        self.controls.insert(id, value);
        self.written.push((id, value));
        if id == self.knob() {
            self.writes.push((if self.streaming { self.next + self.script.delay } else { 0 }, value));
        }
        Ok(())
    }

    /// Range of a control that this kind of camera has.
    fn range(&self, id: u32) -> Option<(i64, i64)> {
        let csi = self.script.kind == Kind::Csi;
        match id {
            abi::EXPOSURE_AUTO if self.script.kind == Kind::Uvc => Some((0, 3)),
            abi::DYNAMIC_FRAME_RATE if self.script.kind == Kind::Uvc => Some((0, 1)),
            abi::EXPOSURE_ABSOLUTE if self.script.kind == Kind::Uvc => Some(self.script.range),
            // The sensor's exposure ends four lines before the frame does.
            abi::EXPOSURE if csi => Some((4, i64::from(HEIGHT) + self.controls[&abi::VBLANK] - 4)),
            abi::VBLANK if csi => Some((10, 4000)),
            abi::HBLANK if csi => Some((936, 936)),
            abi::PIXEL_RATE if csi => Some((10_000_000, 10_000_000)),
            abi::ANALOGUE_GAIN if csi => Some((0, 232)),
            abi::BRIGHTNESS => Some((0, 255)),
            _ => None,
        }
    }

    fn describe(&self, d: &mut abi::ControlDescription) -> Result<(), Errno> {
        let id = if d.id & abi::NEXT_CONTROL == 0 {
            d.id
        } else {
            let after = d.id & !abi::NEXT_CONTROL;
            let next = self.controls.keys().find(|id| **id > after && self.range(**id).is_some());
            *next.ok_or(Errno::INVAL)?
        };
        let (minimum, maximum) = self.range(id).ok_or(Errno::INVAL)?;
        let kind = match id {
            abi::EXPOSURE_AUTO => abi::TYPE_MENU,
            abi::PIXEL_RATE => abi::TYPE_INTEGER64,
            // A type from the future, which must not upset anybody.
            abi::HBLANK => 0x7777,
            _ => abi::TYPE_INTEGER,
        };
        *d = abi::ControlDescription { id, kind, minimum, maximum, step: 1, ..Default::default() };
        let name: &[u8] = if id == abi::BRIGHTNESS { b"Brightness" } else { b"\xff\xfecontrol" };
        d.name[..name.len()].copy_from_slice(name);
        Ok(())
    }
}

struct FakeNode {
    world: Arc<Mutex<World>>,
    contents: Vec<Option<Vec<u8>>>,
    generation: u32,
    sensor: bool,
}

fn one<T>(index: u32, value: T) -> Result<T, Errno> {
    if index == 0 { Ok(value) } else { Err(Errno::INVAL) }
}

impl Node for FakeNode {
    fn call(&mut self, call: Call<'_>) -> Result<(), Errno> {
        let mut w = self.world.lock().expect("whole");
        let now = w.now_ns + CALL_NS;
        w.advance(now);
        w.calls += 1;
        if w.script.interrupt > 0 && w.calls.is_multiple_of(w.script.interrupt) {
            return Err(Errno::INTR);
        }
        if w.is_gone() || self.generation != w.generation {
            return Err(Errno::NODEV);
        }
        let on_sensor = w.script.kind == Kind::Csi;
        let grey = formats::parse(if on_sensor { "BA81" } else { "GREY" }).expect("a name");
        match call {
            Call::QueryCapability(d) => {
                d.capabilities = abi::CAP_CAPTURE | abi::CAP_STREAMING;
                d.card[..4].copy_from_slice(b"fake");
            }
            Call::EnumFormats(d) => d.fourcc = one(d.index, grey)?,
            Call::EnumSizes(d) => {
                (d.kind, d.size[0], d.size[1]) = one(d.index, (abi::DISCRETE, WIDTH, HEIGHT))?;
            }
            Call::EnumIntervals(d) => {
                (d.kind, d.interval[0], d.interval[1]) = one(d.index, (abi::DISCRETE, 1, 25))?;
            }
            Call::SetFormat(d) => {
                (d.pixel.width, d.pixel.height, d.pixel.fourcc) = (WIDTH, HEIGHT, grey);
                (d.pixel.bytes_per_line, d.pixel.size_image) = (WIDTH, BYTES as u32);
            }
            Call::SetParameters(d) => d.interval = [w.script.period.as_millis() as u32, 1000],
            Call::QueryControl(_) | Call::GetControl(_) | Call::SetControl(_) if on_sensor != self.sensor => {
                return Err(Errno::INVAL);
            }
            Call::QueryControl(d) => w.describe(d)?,
            Call::QueryMenu(d) => {
                let there = d.id == abi::EXPOSURE_AUTO && [1, 3].contains(&d.index);
                return if there { Ok(()) } else { Err(Errno::INVAL) };
            }
            Call::GetControl(d) => {
                let value = *w.controls.get(&d.id).ok_or(Errno::INVAL)?;
                d.value = [value as u32, 0];
            }
            Call::SetControl(d) => w.set(d.id, i64::from(d.value[0].cast_signed()))?,
            Call::RequestBuffers(d) => {
                w.queued.clear();
                w.done.clear();
                d.count = d.count.min(8);
            }
            Call::QueryBuffer(d) => d.length = BYTES as u32,
            Call::Queue(d) => {
                if w.queued.contains(&d.index) {
                    return Err(Errno::INVAL);
                }
                w.queued.push_back(d.index);
                self.contents[d.index as usize] = None;
            }
            Call::Dequeue(d) => {
                let (buffer, picture) = w.done.pop_front().ok_or(Errno::AGAIN)?;
                *d = buffer;
                self.contents[d.index as usize] = Some(picture);
            }
            Call::StreamOn => {
                let last = w.writes.last().map(|(_, v)| (0, *v));
                w.writes = last.into_iter().collect();
                (w.streaming, w.next, w.start_ns) = (true, 0, w.now_ns);
                w.truth.clear();
            }
            Call::StreamOff => w.streaming = false,
            Call::Subscribe(_) => {}
            Call::DequeueEvent(d) => {
                w.events = w.events.checked_sub(1).ok_or(Errno::NOENT)?;
                d.kind = abi::EVENT_SOURCE_CHANGE;
            }
            Call::SetPadFormat(d) => (d.width, d.height) = (WIDTH, HEIGHT),
            Call::EnumBusCodes(d) => d.code = one(d.index, 0x3001)?,
        }
        Ok(())
    }

    fn wait(&mut self, timeout: Duration) -> Result<Ready, Errno> {
        let mut w = self.world.lock().expect("whole");
        let now = w.now_ns + CALL_NS;
        w.advance(now);
        w.calls += 1;
        if w.script.interrupt > 0 && w.calls.is_multiple_of(w.script.interrupt) {
            return Err(Errno::INTR);
        }
        let end = w.now_ns + timeout.as_nanos() as u64;
        loop {
            let gone = w.is_gone() || self.generation != w.generation;
            let ready = Ready { frame: !w.done.is_empty() && !gone, event: w.events > 0, gone };
            if ready != Ready::default() || w.now_ns >= end {
                return Ok(ready);
            }
            let next = if w.streaming { w.finished_at(w.next).min(end) } else { end };
            w.advance(next);
        }
    }

    fn map(&mut self, buffer: &abi::Buffer) -> Result<(), Errno> {
        assert_eq!(buffer.index as usize, self.contents.len(), "in order");
        self.contents.push(Some(Vec::new()));
        self.world.lock().expect("whole").mapped += 1;
        Ok(())
    }

    fn bytes(&self, index: u32) -> &[u8] {
        self.contents.get(index as usize).and_then(|c| c.as_deref()).unwrap_or(&[])
    }
}

impl Drop for FakeNode {
    fn drop(&mut self) {
        let mut w = self.world.lock().expect("whole");
        w.open -= 1;
        w.mapped -= self.contents.len();
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
        Ok(Box::new(FakeNode { world: Arc::clone(&self.0), contents: Vec::new(), generation, sensor }))
    }

    fn video_nodes(&mut self) -> Vec<PathBuf> {
        vec!["/dev/video0".into()]
    }

    fn subdevices(&mut self) -> Vec<(PathBuf, String)> {
        let csi = self.world().script.kind == Kind::Csi;
        if csi { vec![("/dev/v4l-subdev0".into(), "fake219 10-0010".into())] } else { Vec::new() }
    }

    fn now_ns(&self) -> u64 {
        self.world().now_ns
    }

    fn sleep(&mut self, duration: Duration) {
        let mut w = self.world();
        let to = w.now_ns + duration.as_nanos() as u64;
        w.advance(to);
    }
}
