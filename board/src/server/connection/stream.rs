//! The byte stream of a connection, with a write timeout, counters of progress, and a reset when the connection is cut.

use super::activity::Activity;
use super::tcp;
use socket2::SockRef;
use std::io;
use std::net::Shutdown;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll, ready};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;
use tokio::time::{Sleep, sleep};

/// The byte stream of a connection, which fails when the connection is cut, or when a write makes no progress for `stall`. After a failure, the
/// socket is reset on drop, so that the kernel keeps no unsent data.
pub(super) struct ClientStream {
    stream: Arc<TcpStream>,
    stall: Duration,
    activity: Arc<Activity>,
    /// Timeout of the write that is blocked; `None` while no write is blocked.
    timer: Option<Pin<Box<Sleep>>>,
    /// True if the connection must be reset instead of shut down in order.
    has_failed: bool,
}

impl ClientStream {
    pub(super) fn new(stream: Arc<TcpStream>, stall: Duration, activity: Arc<Activity>) -> Self {
        Self { stream, stall, activity, timer: None, has_failed: false }
    }

    fn fail<T>(&mut self, kind: io::ErrorKind) -> Poll<io::Result<T>> {
        self.has_failed = true;
        tcp::reset_on_close(&self.stream);
        Poll::Ready(Err(kind.into()))
    }

    /// Starts the timeout of a write when `progress` is pending and clears it otherwise.
    fn watch<T>(&mut self, cx: &mut Context<'_>, progress: Poll<io::Result<T>>) -> Poll<io::Result<T>> {
        if progress.is_ready() {
            self.timer = None;
            return progress;
        }
        self.activity.blocked();
        let stall = self.stall;
        let timer = self.timer.get_or_insert_with(|| Box::pin(sleep(stall)));
        ready!(timer.as_mut().poll(cx));
        self.fail(io::ErrorKind::TimedOut)
    }
}

/// Calls `attempt` when the socket is `ready`, until its result is another one than `WouldBlock`.
fn retry<T>(
    cx: &mut Context<'_>,
    ready: impl Fn(&mut Context<'_>) -> Poll<io::Result<()>>,
    mut attempt: impl FnMut() -> io::Result<T>,
) -> Poll<io::Result<T>> {
    loop {
        ready!(ready(cx))?;
        match attempt() {
            Err(e) if e.kind() == io::ErrorKind::WouldBlock => {}
            done => return Poll::Ready(done),
        }
    }
}

impl AsyncRead for ClientStream {
    fn poll_read(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buf: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        if self.activity.poll_cut(cx) {
            return self.fail(io::ErrorKind::ConnectionAborted);
        }
        let stream = &self.stream;
        let read = retry(cx, |cx| stream.poll_read_ready(cx), || stream.try_read(buf.initialize_unfilled()));
        buf.advance(ready!(read)?);
        Poll::Ready(Ok(()))
    }
}

impl AsyncWrite for ClientStream {
    fn poll_write(self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        self.poll_write_vectored(cx, &[io::IoSlice::new(bytes)])
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        parts: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        if self.activity.poll_cut(cx) {
            return self.fail(io::ErrorKind::ConnectionAborted);
        }
        let stream = &self.stream;
        let progress = retry(cx, |cx| stream.poll_write_ready(cx), || stream.try_write_vectored(parts));
        if let Poll::Ready(Ok(bytes)) = progress {
            self.activity.progress(bytes);
        }
        self.watch(cx, progress)
    }

    fn is_write_vectored(&self) -> bool {
        true
    }

    fn poll_flush(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        Poll::Ready(Ok(()))
    }

    fn poll_shutdown(self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<io::Result<()>> {
        if self.has_failed {
            return Poll::Ready(Ok(()));
        }
        Poll::Ready(SockRef::from(&*self.stream).shutdown(Shutdown::Write))
    }
}
