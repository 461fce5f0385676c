//! The operating system's kernel, called by system calls. All `unsafe` of the crate is in this module.
#![allow(
    unsafe_code,
    reason = "requests and mappings are contracts with the kernel; each comment states why it is fulfilled"
)]

use super::abi::{self, CAPTURE};
use super::media::abi as media;
use super::media::graph::{self, Device, Topology};
use super::{Call, Kernel, Node, Ready};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::ioctl::{Opcode, Updater, ioctl, opcode};
use rustix::mm::{MapFlags, ProtFlags, mmap, munmap};
use std::os::fd::{AsFd, OwnedFd};
use std::path::{Path, PathBuf};
use std::ptr::NonNull;
use std::time::Duration;

const V: u8 = b'V';
const QUERYCAP: Opcode = opcode::read::<abi::Capability>(V, 0);
const ENUM_FMT: Opcode = opcode::read_write::<abi::FormatDescription>(V, 2);
const G_FMT: Opcode = opcode::read_write::<abi::Format>(V, 4);
const S_FMT: Opcode = opcode::read_write::<abi::Format>(V, 5);
const REQBUFS: Opcode = opcode::read_write::<abi::BufferRequest>(V, 8);
const QUERYBUF: Opcode = opcode::read_write::<abi::Buffer>(V, 9);
const QBUF: Opcode = opcode::read_write::<abi::Buffer>(V, 15);
const DQBUF: Opcode = opcode::read_write::<abi::Buffer>(V, 17);
const STREAMON: Opcode = opcode::write::<u32>(V, 18);
const STREAMOFF: Opcode = opcode::write::<u32>(V, 19);
const S_PARM: Opcode = opcode::read_write::<abi::Parameters>(V, 22);
const QUERYMENU: Opcode = opcode::read_write::<abi::MenuItem>(V, 37);
const G_EXT_CTRLS: Opcode = opcode::read_write::<Controls>(V, 71);
const S_EXT_CTRLS: Opcode = opcode::read_write::<Controls>(V, 72);
const ENUM_FRAMESIZES: Opcode = opcode::read_write::<abi::SizeDescription>(V, 74);
const ENUM_FRAMEINTERVALS: Opcode = opcode::read_write::<abi::IntervalDescription>(V, 75);
const DQEVENT: Opcode = opcode::read::<abi::Event>(V, 89);
const SUBSCRIBE_EVENT: Opcode = opcode::write::<abi::Subscription>(V, 90);
const QUERY_EXT_CTRL: Opcode = opcode::read_write::<abi::ControlDescription>(V, 103);
const SUBDEV_ENUM_MBUS_CODE: Opcode = opcode::read_write::<abi::BusCode>(V, 2);
const SUBDEV_G_FMT: Opcode = opcode::read_write::<abi::PadFormat>(V, 4);
const SUBDEV_S_FMT: Opcode = opcode::read_write::<abi::PadFormat>(V, 5);
const SUBDEV_G_ROUTING: Opcode = opcode::read_write::<abi::PadRouting>(V, 38);
const SUBDEV_S_ROUTING: Opcode = opcode::read_write::<abi::PadRouting>(V, 39);
const SUBDEV_S_CLIENT_CAP: Opcode = opcode::read_write::<abi::ClientCapability>(V, 102);
const SUBDEV_G_SELECTION: Opcode = opcode::read_write::<abi::PadSelection>(V, 61);
const SUBDEV_ENUM_FRAME_SIZE: Opcode = opcode::read_write::<abi::PadSize>(V, 74);
const G_SELECTION: Opcode = opcode::read_write::<abi::Selection>(V, 94);
const MEDIA: u8 = b'|';
const SETUP_LINK: Opcode = opcode::read_write::<media::LinkSetup>(MEDIA, 3);
const G_TOPOLOGY: Opcode = opcode::read_write::<media::Counts>(MEDIA, 4);

/// `struct v4l2_ext_controls`; `which` 0 accepts controls of any class.
#[repr(C)]
struct Controls {
    which: u32,
    count: u32,
    error_index: u32,
    request: i32,
    reserved: u32,
    controls: *mut abi::Control,
}

/// The sizes and request numbers are those that a C compiler gave for the kernel's headers.
const _: () = {
    assert!(
        size_of::<Controls>() == if size_of::<usize>() == 8 { 32 } else { 24 },
        "not the kernel's layout"
    );
    let wide = size_of::<usize>() == 8;
    assert!(QUERYCAP == 0x8068_5600, "VIDIOC_QUERYCAP");
    assert!(DQBUF == if wide { 0xc058_5611 } else { 0xc050_5611 }, "VIDIOC_DQBUF");
    assert!(S_FMT == if wide { 0xc0d0_5605 } else { 0xc0cc_5605 }, "VIDIOC_S_FMT");
    assert!(S_EXT_CTRLS == if wide { 0xc020_5648 } else { 0xc018_5648 }, "VIDIOC_S_EXT_CTRLS");
    assert!(DQEVENT == 0x8088_5659, "VIDIOC_DQEVENT");
    assert!(SUBDEV_S_FMT == 0xc058_5605, "VIDIOC_SUBDEV_S_FMT");
    assert!(G_SELECTION == 0xc040_565e, "VIDIOC_G_SELECTION");
    assert!(SUBDEV_G_SELECTION == 0xc040_563d, "VIDIOC_SUBDEV_G_SELECTION");
    assert!(SUBDEV_ENUM_FRAME_SIZE == 0xc040_564a, "VIDIOC_SUBDEV_ENUM_FRAME_SIZE");
    assert!(SUBDEV_S_ROUTING == 0xc040_5627, "VIDIOC_SUBDEV_S_ROUTING");
    assert!(SUBDEV_S_CLIENT_CAP == 0xc008_5666, "VIDIOC_SUBDEV_S_CLIENT_CAP");
    assert!(SETUP_LINK == 0xc034_7c03, "MEDIA_IOC_SETUP_LINK");
    assert!(G_TOPOLOGY == 0xc048_7c04, "MEDIA_IOC_G_TOPOLOGY");
};

/// Longest mapping of a buffer, bytes: a frame of 64 megapixels of four bytes each.
const MAX_BUFFER_BYTES: u32 = 256 << 20;

/// A buffer of the driver that is mapped into the memory of this process.
struct Mapping {
    start: NonNull<u8>,
    length: usize,
    /// True while the driver owns the buffer and may write to it.
    queued: bool,
}

/// An open device node.
struct File {
    fd: OwnedFd,
    mappings: Vec<Mapping>,
}

// SAFETY: a mapping belongs to the process and not to a thread, and `File` is its only owner; references to its bytes borrow `File`.
unsafe impl Send for File {}

impl File {
    /// Makes the kernel request of number `CODE` with `data`, which the kernel reads and updates.
    fn update<const CODE: Opcode, T>(&self, data: &mut T) -> Result<(), Errno> {
        // SAFETY: callers pair `CODE` with the structure from whose size it was computed (the constants above), so that the kernel reads
        // and writes no byte beyond `data`. All structures consist of integers, for which every bit pattern is a value. Pointers
        // inside one are made in `control`, `topology` and `routes`.
        unsafe { ioctl(self.fd.as_fd(), Updater::<CODE, T>::new(data)) }
    }

    /// Gets or sets one control of any class.
    fn control<const CODE: Opcode>(&self, control: &mut abi::Control) -> Result<(), Errno> {
        // The kernel writes one `v4l2_ext_control`, to which the pointer points until the call returns; size 0 in the structure
        // means that it contains no further pointer.
        control.size = 0;
        let mut all = Controls {
            which: 0,
            count: 1,
            error_index: 0,
            request: 0,
            reserved: 0,
            controls: std::ptr::from_mut(control),
        };
        self.update::<CODE, _>(&mut all)
    }

    /// Reads the graph of a media device: first the numbers of entries, then at most as many entries.
    fn topology(&self, topology: &mut Topology) -> Result<(), Errno> {
        let mut counts = media::Counts::default();
        self.update::<G_TOPOLOGY, _>(&mut counts)?;
        fn room<T: Default + Clone>(count: u32) -> Result<Vec<T>, Errno> {
            if count > graph::MOST { Err(Errno::OVERFLOW) } else { Ok(vec![T::default(); count as usize]) }
        }
        *topology = Topology {
            entities: room(counts.entities[0])?,
            interfaces: room(counts.interfaces[0])?,
            pads: room(counts.pads[0])?,
            links: room(counts.links[0])?,
        };
        let at = |address: usize| address as u64;
        counts.entities_at = at(topology.entities.as_mut_ptr() as usize);
        counts.interfaces_at = at(topology.interfaces.as_mut_ptr() as usize);
        counts.pads_at = at(topology.pads.as_mut_ptr() as usize);
        counts.links_at = at(topology.links.as_mut_ptr() as usize);
        // The kernel writes at most as many entries as each count says, which is the length of the vector at that address; the vectors
        // live until the call has returned. If the graph has grown since the counts were read, the call fails with ENOSPC.
        self.update::<G_TOPOLOGY, _>(&mut counts)?;
        topology.entities.truncate(counts.entities[0] as usize);
        topology.interfaces.truncate(counts.interfaces[0] as usize);
        topology.pads.truncate(counts.pads[0] as usize);
        topology.links.truncate(counts.links[0] as usize);
        Ok(())
    }

    /// Gets or sets the routes of an entity.
    fn routes<const CODE: Opcode>(&self, routes: &mut Vec<abi::PadRoute>) -> Result<(), Errno> {
        let mut client = abi::ClientCapability { capabilities: abi::CLIENT_STREAMS };
        self.update::<SUBDEV_S_CLIENT_CAP, _>(&mut client)?;
        let length = abi::MOST_PAD_ROUTES;
        let count = u32::try_from(routes.len()).unwrap_or(u32::MAX).min(length);
        routes.resize(length as usize, abi::PadRoute::default());
        let routes_at = routes.as_mut_ptr() as usize as u64;
        let mut routing = abi::PadRouting { length, routes_at, count, ..Default::default() };
        // The kernel reads `count` routes and writes at most `length`, the length of the vector, which lives until the call has returned.
        let outcome = self.update::<CODE, _>(&mut routing);
        routes.truncate(if outcome.is_ok() { routing.count } else { count } as usize);
        outcome
    }

    fn mark(&mut self, index: u32, queued: bool) {
        if let Some(mapping) = self.mappings.get_mut(index as usize) {
            mapping.queued = queued;
        }
    }
}

impl Node for File {
    fn call(&mut self, call: Call<'_>) -> Result<(), Errno> {
        match call {
            Call::QueryCapability(d) => self.update::<QUERYCAP, _>(d),
            Call::EnumFormats(d) => self.update::<ENUM_FMT, _>(d),
            Call::EnumSizes(d) => self.update::<ENUM_FRAMESIZES, _>(d),
            Call::EnumIntervals(d) => self.update::<ENUM_FRAMEINTERVALS, _>(d),
            Call::GetFormat(d) => self.update::<G_FMT, _>(d),
            Call::SetFormat(d) => self.update::<S_FMT, _>(d),
            Call::SetParameters(d) => self.update::<S_PARM, _>(d),
            Call::QueryControl(d) => self.update::<QUERY_EXT_CTRL, _>(d),
            Call::QueryMenu(d) => self.update::<QUERYMENU, _>(d),
            Call::GetControl(d) => self.control::<G_EXT_CTRLS>(d),
            Call::SetControl(d) => self.control::<S_EXT_CTRLS>(d),
            Call::RequestBuffers(d) => self.update::<REQBUFS, _>(d),
            Call::QueryBuffer(d) => self.update::<QUERYBUF, _>(d),
            Call::Queue(d) => {
                // After this call the driver may write to the buffer, unless it refuses the request.
                let index = d.index;
                let ours = self.mappings.get(index as usize).is_some_and(|m| !m.queued);
                self.mark(index, true);
                let outcome = self.update::<QBUF, _>(d);
                if outcome.is_err() && ours {
                    self.mark(index, false);
                }
                outcome
            }
            Call::Dequeue(d) => {
                self.update::<DQBUF, _>(d)?;
                self.mark(d.index, false);
                Ok(())
            }
            Call::StreamOn => self.update::<STREAMON, _>(&mut { CAPTURE }),
            Call::StreamOff => self.update::<STREAMOFF, _>(&mut { CAPTURE }),
            Call::Subscribe(d) => self.update::<SUBSCRIBE_EVENT, _>(d),
            Call::DequeueEvent(d) => self.update::<DQEVENT, _>(d),
            Call::GetPadFormat(d) => self.update::<SUBDEV_G_FMT, _>(d),
            Call::SetPadFormat(d) => self.update::<SUBDEV_S_FMT, _>(d),
            Call::EnumBusCodes(d) => self.update::<SUBDEV_ENUM_MBUS_CODE, _>(d),
            Call::EnumPadSizes(d) => self.update::<SUBDEV_ENUM_FRAME_SIZE, _>(d),
            Call::GetSelection(d) => self.update::<G_SELECTION, _>(d),
            Call::GetPadSelection(d) => self.update::<SUBDEV_G_SELECTION, _>(d),
            Call::Topology(d) => self.topology(d),
            Call::SetupLink(d) => self.update::<SETUP_LINK, _>(d),
            Call::GetRoutes(d) => self.routes::<SUBDEV_G_ROUTING>(d),
            Call::SetRoutes(d) => self.routes::<SUBDEV_S_ROUTING>(d),
        }
    }

    fn wait(&mut self, timeout: Duration) -> Result<Ready, Errno> {
        let timeout = Timespec::try_from(timeout).map_err(|_| Errno::INVAL)?;
        let mut fds = [PollFd::new(&self.fd, PollFlags::IN | PollFlags::PRI)];
        poll(&mut fds, Some(&timeout))?;
        let found = fds[0].revents();
        Ok(Ready {
            frame: found.contains(PollFlags::IN),
            event: found.contains(PollFlags::PRI),
            gone: found.intersects(PollFlags::ERR | PollFlags::HUP | PollFlags::NVAL),
        })
    }

    fn map(&mut self, buffer: &abi::Buffer) -> Result<(), Errno> {
        if buffer.length == 0
            || buffer.length > MAX_BUFFER_BYTES
            || buffer.index as usize != self.mappings.len()
        {
            return Err(Errno::INVAL);
        }
        let length = buffer.length as usize;
        // SAFETY: the kernel chooses a free address; no reference to that memory exists. The mapping is never written, but some
        // drivers refuse mappings that are not for reading and writing.
        let start = unsafe {
            mmap(
                std::ptr::null_mut(),
                length,
                ProtFlags::READ | ProtFlags::WRITE,
                MapFlags::SHARED,
                self.fd.as_fd(),
                u64::from(buffer.offset[0]),
            )?
        };
        let start = NonNull::new(start.cast::<u8>()).ok_or(Errno::NOMEM)?;
        self.mappings.push(Mapping { start, length, queued: false });
        Ok(())
    }

    fn bytes(&self, index: u32) -> &[u8] {
        match self.mappings.get(index as usize) {
            // SAFETY: `start..start + length` was mapped by `map` and stays mapped until `self` is dropped, which the borrow
            // prevents. Queued buffers are excluded, and queueing a buffer needs `&mut self`: by V4L2's contract the driver does not
            // write to a dequeued buffer, so the bytes do not change while the reference exists.
            Some(m) if !m.queued => unsafe { std::slice::from_raw_parts(m.start.as_ptr(), m.length) },
            _ => &[],
        }
    }
}

impl Drop for File {
    fn drop(&mut self) {
        for mapping in &self.mappings {
            // SAFETY: `map` mapped exactly this range, which is unmapped once; no reference outlives `self`.
            let _ = unsafe { munmap(mapping.start.as_ptr().cast(), mapping.length) };
        }
    }
}

/// The kernel of the operating system, called by system calls.
#[derive(Clone, Copy, Debug, Default)]
pub struct RealKernel;

/// Returns the paths of the nodes in /dev whose name is `prefix` and a number, in the order of the numbers.
fn numbered(prefix: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir("/dev").into_iter().flatten().flatten();
    let names = entries.filter_map(|e| e.file_name().into_string().ok());
    let number = |name: &String| name.strip_prefix(prefix)?.parse::<u32>().ok();
    let mut found: Vec<_> = names.filter_map(|name| Some((number(&name)?, name))).collect();
    found.sort();
    found.into_iter().map(|(_, name)| Path::new("/dev").join(name)).collect()
}

impl Kernel for RealKernel {
    fn open(&mut self, path: &Path) -> Result<Box<dyn Node>, Errno> {
        let fd = rustix::fs::open(path, OFlags::RDWR | OFlags::NONBLOCK | OFlags::CLOEXEC, Mode::empty())?;
        Ok(Box::new(File { fd, mappings: Vec::new() }))
    }

    fn video_nodes(&mut self) -> Vec<PathBuf> {
        numbered("video")
    }

    fn subdevices(&mut self) -> Vec<(PathBuf, String)> {
        let name = |path: &PathBuf| {
            let node = path.file_name()?.to_str()?;
            std::fs::read_to_string(format!("/sys/class/video4linux/{node}/name")).ok()
        };
        let named = |path: PathBuf| (name(&path).unwrap_or_default().trim().into(), path);
        numbered("v4l-subdev").into_iter().map(named).map(|(name, path): (String, _)| (path, name)).collect()
    }

    fn media_nodes(&mut self) -> Vec<PathBuf> {
        numbered("media")
    }

    fn device_of(&mut self, path: &Path) -> Option<Device> {
        let found = rustix::fs::stat(path).ok()?;
        if rustix::fs::FileType::from_raw_mode(found.st_mode) != rustix::fs::FileType::CharacterDevice {
            return None;
        }
        Some(Device { major: rustix::fs::major(found.st_rdev), minor: rustix::fs::minor(found.st_rdev) })
    }

    fn node_of(&mut self, device: Device) -> Option<PathBuf> {
        let Device { major, minor } = device;
        let event = std::fs::read_to_string(format!("/sys/dev/char/{major}:{minor}/uevent")).ok()?;
        let name = event.lines().find_map(|line| line.strip_prefix("DEVNAME="))?;
        let is_node = name.starts_with("video") || name.starts_with("v4l-subdev");
        let is_plain = name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-');
        (is_node && is_plain).then(|| Path::new("/dev").join(name))
    }

    fn now_ns(&self) -> u64 {
        crate::clock::monotonic_ns()
    }

    fn sleep(&mut self, duration: Duration) {
        std::thread::sleep(duration);
    }
}
