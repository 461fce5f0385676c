//! Senders push light sets to programs that do not request them: as OSC bundles ([`osc`]) and MQTT messages ([`mqtt`]).
//!
//! Each sender has a thread of its own that reads the newest set of a latest-value channel. A slow or absent peer makes the sender skip sets; the
//! processing thread and the server are not affected.

#[cfg(feature = "mqtt")]
mod colour;
#[cfg(feature = "mqtt")]
mod discovery;
#[cfg(feature = "mqtt")]
pub mod mqtt;
mod newest;
#[cfg(feature = "osc")]
pub mod osc;
#[cfg(feature = "osc")]
mod slots;

use std::future::Future;
use std::io;
use std::thread::JoinHandle;
use tokio::sync::watch;

/// A running sender; its thread stops on drop.
#[derive(Debug)]
pub struct Sender {
    stop: watch::Sender<bool>,
    thread: Option<JoinHandle<()>>,
}

impl Sender {
    /// Runs the future that `work` makes on a thread called `name`. The future must end when its channel contains true.
    fn spawn<F: Future<Output = ()>>(
        name: &str,
        work: impl FnOnce(watch::Receiver<bool>) -> F + Send + 'static,
    ) -> io::Result<Self> {
        let (stop, stopped) = watch::channel(false);
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let thread = std::thread::Builder::new().name(name.into());
        let thread = thread.spawn(move || {
            runtime.block_on(work(stopped));
            // The shutdown does not wait for a pending lookup of a host name.
            runtime.shutdown_background();
        })?;
        Ok(Self { stop, thread: Some(thread) })
    }
}

impl Drop for Sender {
    fn drop(&mut self) {
        self.stop.send_replace(true);
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
        {
            tracing::error!("a sender's thread panicked");
        }
    }
}

/// The last logged fault of a peer: a fault is logged when it changes, so that a permanent fault causes one line.
#[derive(Debug, Default)]
struct Changes(Option<String>);

impl Changes {
    /// Logs that the peer `name` does not accept sets because of `fault`.
    fn fault(&mut self, name: &str, fault: &str) {
        if self.0.as_deref() != Some(fault) {
            tracing::warn!("{name}: found {fault}; sets are skipped until the peer accepts them");
            self.0 = Some(fault.to_owned());
        }
    }

    /// Logs that the peer `name` accepts sets again, if it had a fault.
    fn well(&mut self, name: &str) {
        if self.0.take().is_some() {
            tracing::warn!("{name}: the peer accepts sets again");
        }
    }
}
