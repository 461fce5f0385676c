//! Wishes on their way to the processing thread, and its answers.

use super::{Change, Config, Refusal, lock};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use tokio::sync::watch;

/// The configuration in effect, and the number of the last change that was processed.
#[derive(Clone, Debug, PartialEq)]
pub struct Applied {
    /// Number of the last wish that was looked at.
    pub serial: u64,
    /// What is in effect.
    pub config: Config,
    /// Why that wish was refused, if it was.
    pub refused: Option<Refusal>,
}

#[derive(Debug)]
struct Wanted {
    config: Config,
    serial: u64,
}

/// The requested configuration: changes that arrive between two frames are applied together.
#[derive(Debug)]
pub(super) struct Mailbox {
    wanted: Mutex<Wanted>,
    waiting: AtomicBool,
    applied: watch::Sender<Applied>,
}

impl Mailbox {
    pub(super) fn new(config: Config) -> Self {
        let applied = watch::Sender::new(Applied { serial: 0, config: config.clone(), refused: None });
        Self { wanted: Mutex::new(Wanted { config, serial: 0 }), waiting: AtomicBool::new(false), applied }
    }

    pub(super) fn applied(&self) -> watch::Receiver<Applied> {
        self.applied.subscribe()
    }

    /// Takes a wish that can come true: one client's mistake must not spoil another's change.
    pub(super) fn post(&self, change: &Change) -> Result<u64, Refusal> {
        let mut wanted = lock(&self.wanted);
        let mut config = wanted.config.clone();
        change.apply(&mut config);
        config.check()?;
        wanted.config = config;
        wanted.serial += 1;
        self.waiting.store(true, Ordering::Release);
        Ok(wanted.serial)
    }

    /// The newest wish with its number, once.
    pub(super) fn take(&self) -> Option<(u64, Config)> {
        if !self.waiting.swap(false, Ordering::Acquire) {
            return None;
        }
        let wanted = lock(&self.wanted);
        Some((wanted.serial, wanted.config.clone()))
    }

    /// Answers wish `serial`: `in_effect` is what stands now.
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
    fn wishes_add_up_and_a_refusal_takes_them_back() {
        let mailbox = Mailbox::new(Config::default());
        assert_eq!(mailbox.take(), None, "nothing wished");
        let change = |name, value: Value| {
            let object = [(String::from(name), value)].into_iter().collect();
            wish_of(&object).expect("a value within the range")
        };
        let post = |change| mailbox.post(&change).expect("a wish that can come true");
        post(change("lights", 20.into()));
        assert!(mailbox.post(&change("lights", 0.into())).is_err(), "no light at all");
        let serial = post(change("gui", true.into()));
        let (taken, config) = mailbox.take().expect("a wish");
        assert_eq!((taken, config.pipeline.lights, config.gui), (serial, 20, true), "both");
        assert_eq!(mailbox.take(), None, "taken once");
        mailbox.answer(serial, Config::default(), Some(Refusal { setting: "lights", why: "no".into() }));
        post(change("gui", true.into()));
        let (_, config) = mailbox.take().expect("a wish");
        assert_eq!((config.pipeline.lights, config.gui), (64, true), "the refused wish is gone");
    }
}
