//! Non-blocking input from the file, FIFO or Unix socket of a pipe.

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::OFlags;
use std::fs::{File, OpenOptions};
use std::io::{self, Read, Seek};
use std::os::fd::AsFd;
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::Duration;

/// The open file, FIFO or socket of a pipe.
#[derive(Debug)]
pub(super) enum Input {
    /// A regular file, which is read again from its start at its end.
    File(File),
    Fifo(File),
    Socket(UnixStream),
}

impl Input {
    /// Opens the file, FIFO or socket at `path`.
    ///
    /// # Errors
    /// The error of the operating system, or `InvalidInput` for a path of another kind.
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

    /// Reads the available bytes into `into`; `WouldBlock` if there are none, 0 at the end of the input.
    ///
    /// # Errors
    /// The error of the operating system for the read.
    pub fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::File(file) | Self::Fifo(file) => file.read(into),
            Self::Socket(socket) => socket.read(into),
        }
    }

    /// Waits until bytes can be read, for `timeout` at most.
    pub fn wait(&self, timeout: Duration) {
        let fd = match self {
            Self::File(file) | Self::Fifo(file) => file.as_fd(),
            Self::Socket(socket) => socket.as_fd(),
        };
        let Ok(timeout) = Timespec::try_from(timeout) else { return };
        // A signal ends the wait early: the caller then reads no bytes and waits again.
        let _ = poll(&mut [PollFd::new(&fd, PollFlags::IN)], Some(&timeout));
    }

    /// Moves the read position to the start of a regular file; returns false for FIFOs and sockets.
    pub fn rewind(&mut self) -> bool {
        if let Self::File(file) = self { file.rewind().is_ok() } else { false }
    }
}
