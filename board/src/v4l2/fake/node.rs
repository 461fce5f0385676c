//! An open node of the scripted kernel.

use super::{CALL_NS, Kind, World};
use crate::v4l2::{Call, Node, Ready, abi};
use rustix::io::Errno;
use std::sync::{Arc, Mutex};
use std::time::Duration;

pub(super) struct FakeNode {
    pub(super) world: Arc<Mutex<World>>,
    /// Of each buffer that is not with the driver.
    contents: Vec<Option<Vec<u8>>>,
    generation: u32,
    sensor: bool,
}

impl FakeNode {
    pub(super) fn new(world: Arc<Mutex<World>>, generation: u32, sensor: bool) -> Self {
        Self { world, contents: Vec::new(), generation, sensor }
    }
}

fn one<T>(index: u32, value: T) -> Result<T, Errno> {
    if index == 0 { Ok(value) } else { Err(Errno::INVAL) }
}

/// Starts streaming: the last exposure written applies from the first frame on.
fn start(w: &mut World) {
    let last = w.writes.last().map(|(_, v)| (0, *v));
    w.writes = last.into_iter().collect();
    (w.streaming, w.next, w.start_ns) = (true, 0, w.now_ns);
    w.truth.clear();
    if w.script.reset_at_start {
        w.reset();
    }
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
        let (width, height) = w.script.size;
        match call {
            Call::QueryCapability(d) => {
                d.capabilities = abi::CAP_CAPTURE | abi::CAP_STREAMING;
                d.card[..4].copy_from_slice(b"fake");
            }
            Call::EnumFormats(d) => {
                let name = w.script.formats.get(d.index as usize).ok_or(Errno::INVAL)?;
                d.fourcc = u32::from_le_bytes(name.as_bytes().try_into().expect("four characters"));
            }
            Call::EnumSizes(d) => {
                (d.kind, d.size[0], d.size[1]) = one(d.index, (abi::DISCRETE, width, height))?;
            }
            Call::EnumIntervals(d) => {
                (d.kind, d.interval[0], d.interval[1]) = one(d.index, (abi::DISCRETE, 1, 25))?;
            }
            Call::SetFormat(d) => {
                (d.pixel.width, d.pixel.height) = (width, height);
                d.pixel.fourcc = u32::from_le_bytes(w.fourcc());
                let line = w.bytes_per_line();
                (d.pixel.bytes_per_line, d.pixel.size_image) = (line as u32, 2 * line as u32 * height);
            }
            Call::SetParameters(d) => d.interval = [w.script.period.as_millis() as u32, 1000],
            Call::QueryControl(_) | Call::GetControl(_) | Call::SetControl(_) if on_sensor != self.sensor => {
                return Err(Errno::INVAL);
            }
            Call::QueryControl(d) => w.describe(d)?,
            Call::QueryMenu(d) if d.id == abi::EXPOSURE_AUTO && [1, 3].contains(&d.index) => {}
            Call::QueryMenu(_) => return Err(Errno::INVAL),
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
            Call::QueryBuffer(d) => d.length = w.layout().frame_bytes() as u32,
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
            Call::StreamOn => start(&mut w),
            Call::StreamOff => w.streaming = false,
            Call::Subscribe(_) => {}
            Call::DequeueEvent(d) => {
                w.events = w.events.checked_sub(1).ok_or(Errno::NOENT)?;
                d.kind = abi::EVENT_SOURCE_CHANGE;
            }
            Call::SetPadFormat(d) => {
                w.script.pads.push((d.width, d.height));
                (d.width, d.height) = (width, height);
            }
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
