//! The file, FIFO or Unix socket that a pipe is read from, without blocking.

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::OFlags;
use std::fs::{File, OpenOptions};
use std::io::{self, Read, Seek};
use std::os::fd::AsFd;
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::Duration;

/// An open pipe.
#[derive(Debug)]
pub(super) enum Input {
    /// A regular file, which is read again from its start.
    File(File),
    Fifo(File),
    Socket(UnixStream),
}

impl Input {
    /// Opens what is at `path`.
    ///
    /// # Errors
    /// The error of the operating system.
    pub fn open(path: &Path) -> io::Result<Self> {
        let kind = std::fs::metadata(path)?.file_type();
        if kind.is_socket() {
            let socket = UnixStream::connect(path)?;
            socket.set_nonblocking(true)?;
            return Ok(Self::Socket(socket));
        }
        let flags = OFlags::NONBLOCK.bits().cast_signed();
        let file = OpenOptions::new().read(true).custom_flags(flags).open(path)?;
        if kind.is_fifo() {
            Ok(Self::Fifo(file))
        } else if kind.is_file() {
            Ok(Self::File(file))
        } else {
            Err(io::Error::new(io::ErrorKind::InvalidInput, "neither a file, a FIFO nor a Unix socket"))
        }
    }

    /// Reads what is there; `WouldBlock` where nothing is, 0 at the end.
    ///
    /// # Errors
    /// The error of the operating system.
    pub fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::File(file) | Self::Fifo(file) => file.read(into),
            Self::Socket(socket) => socket.read(into),
        }
    }

    /// Waits until something can be read, for `timeout` at most.
    pub fn wait(&self, timeout: Duration) {
        let fd = match self {
            Self::File(file) | Self::Fifo(file) => file.as_fd(),
            Self::Socket(socket) => socket.as_fd(),
        };
        let Ok(timeout) = Timespec::try_from(timeout) else { return };
        // After a signal the caller reads in vain once and waits again.
        let _ = poll(&mut [PollFd::new(&fd, PollFlags::IN)], Some(&timeout));
    }

    /// Goes back to the start of a regular file; false for others.
    pub fn rewind(&mut self) -> bool {
        if let Self::File(file) = self { file.rewind().is_ok() } else { false }
    }
}
