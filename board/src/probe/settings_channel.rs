//! The channel of the settings: requests of clients to the processing thread, and the thread's answers.

use super::{Change, Config, Refusal, lock};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use tokio::sync::watch;

/// The configuration in effect, and the number of the last settings request that the processing thread has
/// processed.
#[derive(Clone, Debug, PartialEq)]
pub struct Applied {
    /// Number of the last settings request that the processing thread has processed.
    pub serial: u64,
    /// The configuration in effect after that request.
    pub config: Config,
    /// The reason of the refusal of request `serial`; `None` if it was accepted.
    pub refused: Option<Refusal>,
}

/// A configuration that a client requests, and the serial number of the request.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct SettingsRequest {
    pub(super) config: Config,
    /// Number of the settings request; later requests have greater numbers.
    pub(super) serial: u64,
}

/// The exposure times of the source, and whether clients can change them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Exposures {
    /// Exposure times of the source in effect, seconds, ascending.
    pub seconds: Vec<f64>,
    /// The reason why the exposures cannot be changed; `None` if they can.
    pub fixed: Option<&'static str>,
}

/// The requested configuration and the one in effect: changes that arrive between two frames are applied together.
#[derive(Debug)]
pub struct SettingsChannel {
    wanted: Mutex<SettingsRequest>,
    waiting: AtomicBool,
    applied: watch::Sender<Applied>,
    exposures: Mutex<Exposures>,
}

impl SettingsChannel {
    pub(super) fn new(config: Config, exposures: Exposures) -> Self {
        let applied = watch::Sender::new(Applied { serial: 0, config: config.clone(), refused: None });
        Self {
            wanted: Mutex::new(SettingsRequest { config, serial: 0 }),
            waiting: AtomicBool::new(false),
            applied,
            exposures: Mutex::new(exposures),
        }
    }

    /// Returns a receiver of the settings in effect.
    #[must_use]
    pub fn applied(&self) -> watch::Receiver<Applied> {
        self.applied.subscribe()
    }

    /// Returns the exposure times of the source in effect, and whether clients can change them.
    #[must_use]
    pub fn exposures(&self) -> Exposures {
        lock(&self.exposures).clone()
    }

    pub(super) fn set_exposures(&self, exposures: Exposures) {
        *lock(&self.exposures) = exposures;
    }

    /// Requests a change of the settings; returns the number of the [`Applied`] that answers it. The change is checked on the caller's
    /// thread, so that an invalid one does not discard valid changes of other clients.
    ///
    /// # Errors
    /// [`Refusal`] of a value out of range; no setting is changed then.
    pub fn change(&self, change: &Change) -> Result<u64, Refusal> {
        let mut wanted = lock(&self.wanted);
        let mut config = wanted.config.clone();
        change.apply(&mut config);
        config.check()?;
        wanted.config = config;
        wanted.serial += 1;
        self.waiting.store(true, Ordering::Release);
        Ok(wanted.serial)
    }

    /// Returns the newest settings request, if the processing thread has not taken it yet.
    pub(super) fn take(&self) -> Option<SettingsRequest> {
        if !self.waiting.swap(false, Ordering::Acquire) {
            return None;
        }
        let wanted = lock(&self.wanted);
        Some(wanted.clone())
    }

    /// Answers the settings request `serial`: `in_effect` is the configuration from the present frame on,
    /// `refused` the reason of a refusal.
    pub(super) fn answer(&self, serial: u64, in_effect: Config, refused: Option<Refusal>) {
        let mut wanted = lock(&self.wanted);
        if refused.is_some() && wanted.serial == serial {
            wanted.config = in_effect.clone();
        }
        self.applied.send_replace(Applied { serial, config: in_effect, refused });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::probe::settings::wish_of;
    use serde_json::Value;

    #[test]
    fn requests_accumulate_and_a_refusal_discards_them() {
        let channel = SettingsChannel::new(Config::default(), Exposures::default());
        assert_eq!(channel.take(), None, "no request");
        let change = |name, value: Value| {
            let object = [(String::from(name), value)].into_iter().collect();
            wish_of(&object).expect("a value within the range")
        };
        let post = |change| channel.change(&change).expect("a valid request");
        post(change("lights", 20.into()));
        assert!(channel.change(&change("lights", 0.into())).is_err(), "out of range");
        let serial = post(change("gui", true.into()));
        let SettingsRequest { serial: taken, config } = channel.take().expect("a request");
        assert_eq!((taken, config.pipeline.lights, config.gui), (serial, 20, true), "both");
        assert_eq!(channel.take(), None, "taken once");
        channel.answer(serial, Config::default(), Some(Refusal { setting: "lights", why: "no".into() }));
        post(change("gui", true.into()));
        let SettingsRequest { config, .. } = channel.take().expect("a request");
        assert_eq!((config.pipeline.lights, config.gui), (64, true), "the refused request is discarded");
    }
}
