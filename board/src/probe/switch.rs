//! Replacement of the source while the probe runs.

use super::lock;
use crate::source::Source;
use std::fmt;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

/// A slot for an opened source that the processing thread takes, and the name of the source in use.
pub(super) struct SourceSwitch {
    name: Mutex<String>,
    next: Mutex<Option<NextSource>>,
    is_waiting: AtomicBool,
}

/// An opened source that replaces the one in use, and its name.
pub(super) struct NextSource {
    pub source: Box<dyn Source>,
    pub name: String,
}

impl SourceSwitch {
    pub fn new(name: String) -> Self {
        Self { name: Mutex::new(name), next: Mutex::new(None), is_waiting: AtomicBool::new(false) }
    }

    /// Returns the name of the source in use.
    pub fn name(&self) -> String {
        lock(&self.name).clone()
    }

    /// Stores a source for the processing thread; an earlier one that the thread has not taken is dropped.
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
