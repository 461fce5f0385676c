//! Messages to the service manager systemd: readiness, shutdown, and the watchdog of the processing thread.
//!
//! Without a service manager the functions of this module do nothing.

use crate::probe::Link;
use sd_notify::NotifyState;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

/// Number of watchdog messages within the watchdog timeout: one late message does not cause a restart.
const TIMES: u32 = 3;

/// Reports readiness and the `address` to the service manager, and then a watchdog message at intervals while the processing thread responds.
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

/// Reports to the service manager that the probe stops.
pub fn stopping() {
    tell(&[NotifyState::Stopping]);
}

fn tell(state: &[NotifyState<'_>]) {
    if let Err(error) = sd_notify::notify(state) {
        tracing::warn!("the service manager: found {error}, expected it to listen at $NOTIFY_SOCKET");
    }
}
