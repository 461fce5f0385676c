//! Options and state of TCP sockets. Buffers are small, so that slow clients use little kernel memory and get recent data.

use socket2::SockRef;
use std::io;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd};
use std::sync::atomic::{AtomicU32, AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, Weak};
use std::time::Duration;
use tokio::net::TcpStream;

/// Size of the send buffer of a socket, bytes. Linux doubles it and counts its own overhead: about 32 KB of
/// data fit.
const SEND_BYTES: usize = 32 << 10;

/// Size of the send buffer of a socket with a large answer, bytes: a small buffer would send the answer in many small
/// steps.
const LARGE_SEND_BYTES: usize = 192 << 10;

/// Length of an answer above which the answer counts as large, bytes.
const LARGE_BYTES: u64 = 48 << 10;

/// Largest number of connections with large send buffers.
const LARGE_BUFFERS: usize = 12;

/// Number of connections with large send buffers.
static LARGE: AtomicUsize = AtomicUsize::new(0);

/// Size of the receive buffer of a socket, bytes: requests are at most 16 KB of head and 16 KB of body.
const RECEIVE_BYTES: usize = 16 << 10;

/// Largest TCP segment, bytes. The loopback interface has segments of 64 KB; a receiver acknowledges at once after two segments, and after 40 ms
/// otherwise, and a small send buffer cannot hold two segments of 64 KB.
const SEGMENT_BYTES: u32 = 8 << 10;

/// Sets the sizes of the send and receive buffers of the sockets that `listener` accepts.
pub(super) fn prepare_listener(listener: &impl AsFd) -> io::Result<()> {
    let listener = SockRef::from(listener);
    listener.set_send_buffer_size(SEND_BYTES)?;
    listener.set_recv_buffer_size(RECEIVE_BYTES)?;
    listener.set_tcp_mss(SEGMENT_BYTES)
}

/// Disables Nagle's algorithm on a socket, and sets to `stall` the kernel's timeout for a peer that acknowledges nothing, which also applies
/// after the program has closed the socket.
pub(super) fn prepare(stream: &TcpStream, stall: Duration) {
    // With Nagle's algorithm, the end of an answer may wait 40 ms for the client's acknowledgement.
    let _ = stream.set_nodelay(true);
    let _ = SockRef::from(stream).set_tcp_user_timeout(Some(stall));
}

/// Makes the kernel discard unsent data and reset the connection when the socket is closed.
pub(super) fn reset_on_close(stream: &TcpStream) {
    let _ = SockRef::from(stream).set_linger(Some(Duration::ZERO));
}

/// The queues of a connection's socket, while the socket is open.
#[derive(Debug)]
pub(in crate::server) struct Queues {
    stream: Weak<TcpStream>,
    /// Largest receive window that the client has advertised so far, bytes.
    widest: AtomicU32,
}

impl Queues {
    pub(super) fn of(stream: &Arc<TcpStream>) -> Self {
        Self { stream: Arc::downgrade(stream), widest: AtomicU32::new(0) }
    }

    /// Enlarges the connection's send buffer for an answer of `length` bytes until the returned value is dropped; `None` if the answer is
    /// small or [`LARGE_BUFFERS`] send buffers are enlarged.
    pub(in crate::server) fn enlarge(&self, length: u64) -> Option<Enlarged> {
        let stream = (length > LARGE_BYTES).then(|| self.stream.upgrade())??;
        let enlarged = Enlarged(Weak::clone(&self.stream));
        if LARGE.fetch_add(1, Relaxed) >= LARGE_BUFFERS {
            return None;
        }
        SockRef::from(&*stream).set_send_buffer_size(LARGE_SEND_BYTES).ok()?;
        Some(enlarged)
    }

    /// Returns true if the client is slow: data is unsent, more than `allowed` bytes are unacknowledged, or more than half of the
    /// client's receive window is full.
    pub(in crate::server) fn is_backlogged(&self, allowed: usize) -> bool {
        let Some(info) = self.stream.upgrade().and_then(|stream| tcp_info(stream.as_fd())) else {
            return false;
        };
        let widest = self.widest.fetch_max(info.tcpi_snd_wnd, Relaxed).max(info.tcpi_snd_wnd);
        let in_flight = u64::from(info.tcpi_unacked) * u64::from(info.tcpi_snd_mss.max(1));
        info.tcpi_notsent_bytes > 0
            || in_flight > (allowed as u64).max(2 * u64::from(info.tcpi_snd_mss))
            || info.tcpi_snd_wnd < widest / 2
    }
}

/// A connection whose send buffer is enlarged until the value is dropped.
#[derive(Debug)]
pub(in crate::server) struct Enlarged(Weak<TcpStream>);

impl Drop for Enlarged {
    fn drop(&mut self) {
        LARGE.fetch_sub(1, Relaxed);
        if let Some(stream) = self.0.upgrade() {
            let _ = SockRef::from(&*stream).set_send_buffer_size(SEND_BYTES);
        }
    }
}

/// Returns the kernel's state of a TCP connection; fields that an old kernel does not fill are 0.
#[allow(unsafe_code, reason = "no safe wrapper returns struct tcp_info")]
fn tcp_info(socket: BorrowedFd<'_>) -> Option<libc::tcp_info> {
    let mut info = std::mem::MaybeUninit::<libc::tcp_info>::zeroed();
    let mut length = size_of::<libc::tcp_info>() as libc::socklen_t;
    // SAFETY: the descriptor is open, the buffer has `length` bytes, and any bytes are a valid `tcp_info`, which has only integers.
    unsafe {
        let failed = libc::getsockopt(
            socket.as_raw_fd(),
            libc::IPPROTO_TCP,
            libc::TCP_INFO,
            info.as_mut_ptr().cast(),
            &raw mut length,
        );
        (failed == 0).then(|| info.assume_init())
    }
}
