//! Replacement of the source while the probe runs.

use super::lock;
use crate::source::Source;
use std::fmt;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};

/// A slot for an opened source that replaces the source in use, and the name of the source in use.
pub(super) struct SourceSwitch {
    name: Mutex<String>,
    next: Mutex<Option<NextSource>>,
    is_waiting: AtomicBool,
}

/// An opened source that replaces the source in use, and its name for clients.
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

    /// Stores `next` until the processing thread takes it; an earlier source that the thread has not taken is
    /// dropped.
    pub fn post(&self, next: NextSource) {
        *lock(&self.next) = Some(next);
        self.is_waiting.store(true, Ordering::Release);
    }

    /// Returns the source that replaces the one in use, once, and makes its name the name in use; `None` without a request, at the
    /// cost of one atomic load.
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
