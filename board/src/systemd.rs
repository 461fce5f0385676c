//! Messages to the service manager: readiness, shutdown, and the watchdog of the processing thread.
//!
//! Without a service manager the functions of this module do nothing.

use crate::probe::Link;
use sd_notify::NotifyState;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

/// Times that the manager is told within the time after which it would restart us: one may come late.
const TIMES: u32 = 3;

/// Tells that the probe serves at `address`, and from then on that it is alive, as long as its processing thread is.
pub fn serving(address: &str, link: &Arc<Link>) -> Option<JoinHandle<()>> {
    tell(&[NotifyState::Ready, NotifyState::Status(&format!("serving http://{address}/"))]);
    let limit = sd_notify::watchdog_enabled()?;
    let link = Arc::downgrade(link);
    let thread = std::thread::Builder::new().name("hemilux-watchdog".into());
    let watch = move || {
        let mut before = None;
        while let Some(link) = link.upgrade() {
            let now = Some(link.status().turns());
            drop(link);
            if now != before {
                tell(&[NotifyState::Watchdog]);
            }
            before = now;
            std::thread::sleep((limit / TIMES).max(Duration::from_millis(1)));
        }
    };
    thread.spawn(watch).ok()
}

/// Tells that the probe stops.
pub fn stopping() {
    tell(&[NotifyState::Stopping]);
}

fn tell(state: &[NotifyState<'_>]) {
    if let Err(error) = sd_notify::notify(state) {
        tracing::warn!("the service manager: found {error}, expected it to listen at $NOTIFY_SOCKET");
    }
}
