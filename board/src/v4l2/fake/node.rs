//! An open node of the scripted kernel.

use super::graph::PadFault;
use super::{Done, Kind, Quirk, World};
use crate::v4l2::{Call, Node, Ready, abi};
use rustix::io::Errno;
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// Kinds of nodes of the scripted kernel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Role {
    /// A node of a camera without a media graph.
    Plain { sensor: bool },
    /// A media device, by its number.
    Media(usize),
    /// The node of an entity of a media device.
    Entity(usize, usize),
}

pub(super) struct FakeNode {
    pub(super) world: Arc<Mutex<World>>,
    /// Content of each buffer; `None` while the driver owns the buffer.
    contents: Vec<Option<Vec<u8>>>,
    generation: u32,
    role: Role,
}

impl FakeNode {
    pub(super) fn new(world: Arc<Mutex<World>>, generation: u32, role: Role) -> Self {
        Self { world, contents: Vec::new(), generation, role }
    }
}

/// Answers the requests that only nodes of a graph support; `None` for all others.
fn graph_call(w: &mut World, role: Role, call: &mut Call<'_>) -> Option<Result<(), Errno>> {
    let (board, entity) = match role {
        Role::Plain { .. } => return None,
        Role::Media(board) => {
            let board = &mut w.boards[board];
            return Some(match call {
                Call::Topology(d) => {
                    board.topology(d);
                    Ok(())
                }
                Call::SetupLink(d) => board.set_link(d),
                _ => Err(Errno::NOTTY),
            });
        }
        Role::Entity(board, entity) => (board, entity),
    };
    let streaming = w.streaming;
    let board = &mut w.boards[board];
    Some(match call {
        Call::GetPadFormat(d) => board.get_pad(entity, d),
        Call::SetPadFormat(_) if streaming => Err(Errno::BUSY),
        Call::SetPadFormat(d) => board.set_pad(entity, d),
        Call::EnumBusCodes(d) if board.is_sensor(entity) => {
            let codes = if d.pad == 0 { &board.described.codes[..] } else { &[0x7002] };
            codes.get(d.index as usize).map(|code| d.code = *code).ok_or(Errno::INVAL)
        }
        Call::EnumBusCodes(_) => Err(Errno::NOTTY),
        Call::GetPadSelection(d) => board.select(entity, d),
        Call::EnumPadSizes(d) if board.is_sensor(entity) => {
            let mode = board.described.modes.get(d.index as usize).map(|m| m.size);
            mode.map(|(w, h)| d.size = [w, w, h, h]).ok_or(Errno::INVAL)
        }
        Call::QueryCapability(d) if !board.gives_pictures(entity) => {
            d.capabilities = abi::CAP_STREAMING;
            Ok(())
        }
        Call::GetFormat(d) => {
            (d.pixel.width, d.pixel.height) = w.script.size;
            Ok(())
        }
        Call::SetFormat(d) => {
            w.script.size = match board.fault_of((entity, 0)) {
                Some(PadFault::Size) => (640, 480),
                Some(_) => return Some(Err(Errno::INVAL)),
                None => (d.pixel.width, d.pixel.height),
            };
            return None;
        }
        Call::GetRoutes(d) => board.get_routes(entity, d),
        Call::SetRoutes(d) => board.set_routes(entity, d),
        Call::StreamOn => match board.validate(entity, w.script.size) {
            Ok(_) => {
                w.starved = board.is_starved(entity);
                return None;
            }
            Err(errno) => Err(errno),
        },
        _ => return None,
    })
}

/// Answers the requests for the camera's capabilities.
fn describe(w: &mut World, call: Call<'_>) -> Result<(), Errno> {
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
        Call::EnumSizes(d) if w.has(Quirk::Ranges) => {
            let all = [width / 2, 2 * width, 2, height / 2, 2 * height, 2];
            (d.kind, d.size) = one(d.index, (3, all))?;
        }
        Call::EnumIntervals(d) if w.has(Quirk::Ranges) => {
            (d.kind, d.interval) = one(d.index, (3, [1, 50, 1, 5, 1, 1000]))?;
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
            if w.has(Quirk::NoStride) {
                (d.pixel.bytes_per_line, d.pixel.size_image) = (0, 0);
            }
        }
        Call::SetParameters(d) if w.has(Quirk::ReportsInterval) => d.interval = [40, 1000],
        Call::SetParameters(d) if w.has(Quirk::TakesRates) => {
            let [n, of] = d.interval.map(f64::from);
            w.script.period = Duration::from_secs_f64(n / of);
        }
        Call::SetParameters(d) => d.interval = [w.script.period.as_millis() as u32, 1000],
        _ => return Err(Errno::NOTTY),
    }
    Ok(())
}

fn one<T>(index: u32, value: T) -> Result<T, Errno> {
    if index == 0 { Ok(value) } else { Err(Errno::INVAL) }
}

/// Starts the stream: the last exposure that was written acts from the first frame.
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
        w.pass_call()?;
        if w.is_gone() || self.generation != w.generation {
            return Err(Errno::NODEV);
        }
        let mut call = call;
        if let Some(outcome) = graph_call(&mut w, self.role, &mut call) {
            return outcome;
        }
        let sensor = match self.role {
            Role::Plain { sensor } => sensor,
            Role::Entity(board, entity) => w.boards[board].is_sensor(entity),
            Role::Media(_) => false,
        };
        let on_sensor = w.script.kind == Kind::Csi;
        let (width, height) = w.script.size;
        match call {
            Call::QueryCapability(_)
            | Call::EnumFormats(_)
            | Call::EnumSizes(_)
            | Call::EnumIntervals(_)
            | Call::SetFormat(_)
            | Call::SetParameters(_) => describe(&mut w, call)?,
            Call::QueryControl(_) | Call::GetControl(_) | Call::SetControl(_) if on_sensor != sensor => {
                return Err(Errno::INVAL);
            }
            Call::QueryControl(d) => w.describe(d)?,
            Call::QueryMenu(_) if w.has(Quirk::NoMenu) => return Err(Errno::INVAL),
            Call::QueryMenu(d) if d.id == abi::EXPOSURE_AUTO && [1, 3].contains(&d.index) => {}
            Call::QueryMenu(_) => return Err(Errno::INVAL),
            Call::GetControl(d) => {
                let value = w.read(d.id)?;
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
                if !w.done.is_empty() {
                    w.fail_fetch()?;
                }
                let Done { buffer, picture, value } = w.done.pop_front().ok_or(Errno::AGAIN)?;
                w.last_fetched = Some(value);
                *d = buffer;
                self.contents[d.index as usize] = Some(picture);
            }
            Call::StreamOn => {
                w.fail_start()?;
                start(&mut w);
            }
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
            _ => return Err(Errno::NOTTY),
        }
        Ok(())
    }

    fn wait(&mut self, timeout: Duration) -> Result<Ready, Errno> {
        let mut w = self.world.lock().expect("whole");
        w.pass_call()?;
        let end = w.now_ns + timeout.as_nanos() as u64;
        loop {
            let gone = w.is_gone() || self.generation != w.generation;
            let ready = Ready { frame: !w.done.is_empty() && !gone, event: w.events > 0, gone };
            if ready != Ready::default() || w.now_ns >= end {
                return Ok(ready);
            }
            if w.script.real_time {
                drop(w);
                std::thread::sleep(Duration::from_millis(2));
                w = self.world.lock().expect("whole");
                w.keep_time();
                continue;
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
