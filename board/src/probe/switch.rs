//! A change of the source while the probe runs.

use super::lock;
use crate::source::Source;
use std::fmt;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

/// An opened source on its way to the processing thread, and the name of the one in use.
pub(super) struct SourceSwitch {
    name: Mutex<String>,
    next: Mutex<Option<NextSource>>,
    is_waiting: AtomicBool,
}

/// A source that is to replace the one in use.
pub(super) struct NextSource {
    pub source: Box<dyn Source>,
    pub name: String,
}

impl SourceSwitch {
    pub fn new(name: String) -> Self {
        Self { name: Mutex::new(name), next: Mutex::new(None), is_waiting: AtomicBool::new(false) }
    }

    /// The name of the source in use.
    pub fn name(&self) -> String {
        lock(&self.name).clone()
    }

    /// Leaves a source for the processing thread; one that was left before and not taken is dropped.
    pub fn post(&self, next: NextSource) {
        *lock(&self.next) = Some(next);
        self.is_waiting.store(true, Ordering::Release);
    }

    /// Returns the requested source once, and makes its name the name of the source in use. Without a request this is one atomic load.
    pub fn take(&self) -> Option<Box<dyn Source>> {
        if !self.is_waiting.swap(false, Ordering::Acquire) {
            return None;
        }
        let NextSource { source, name } = lock(&self.next).take()?;
        *lock(&self.name) = name;
        Some(source)
    }
}

impl fmt::Debug for SourceSwitch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SourceSwitch").field("name", &self.name).finish_non_exhaustive()
    }
}
