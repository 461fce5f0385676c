//! Faults as a layer over any source: a seeded schedule damages bursts, for tests.
//!
//! The table "Faults" of `board/FORMATS.md` has the behaviour of the probe for each kind of fault.

mod damage;
mod random;
mod spec;
#[cfg(all(test, feature = "server"))]
mod tests;

pub use spec::{Fault, FaultSpec};

use super::{Adapter, Source, SourceError};
use crate::calibration::Burst;
use random::Random;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// Number of bursts that were damaged so far, for each kind of fault.
#[derive(Debug, Default)]
pub struct FaultCounts([AtomicU64; Fault::ALL.len()]);

impl FaultCounts {
    /// Returns the name of each kind of fault and the number of bursts that it has damaged.
    pub fn named(&self) -> impl Iterator<Item = (&'static str, u64)> {
        Fault::ALL.into_iter().zip(&self.0).map(|(fault, n)| (fault.name(), n.load(Ordering::Relaxed)))
    }

    fn add(&self, fault: Fault) {
        if let Some(at) = Fault::ALL.iter().position(|kind| *kind == fault) {
            self.0[at].fetch_add(1, Ordering::Relaxed);
        }
    }
}

/// A source that damages some bursts of an inner source.
pub struct FaultSource {
    inner: Box<dyn Source>,
    spec: FaultSpec,
    random: Random,
    /// True if the memory of the last burst was damaged and must not be reused by the inner source.
    damaged: bool,
    /// Time until which the device is missing; `None` while it is present.
    gone_until: Option<Instant>,
    counts: Arc<FaultCounts>,
}

impl FaultSource {
    /// Adds the faults of `spec` to the source `inner`.
    #[must_use]
    pub fn new(inner: Box<dyn Source>, spec: FaultSpec) -> Self {
        let random = Random(spec.seed);
        Self { inner, spec, random, damaged: false, gone_until: None, counts: Arc::default() }
    }

    /// Returns the counts of faults, which this source updates.
    #[must_use]
    pub fn counts(&self) -> Arc<FaultCounts> {
        Arc::clone(&self.counts)
    }

    fn injected(&mut self, fault: Fault, burst: &mut Burst) -> Result<(), SourceError> {
        self.counts.add(fault);
        match fault {
            Fault::Late => std::thread::sleep(self.spec.late),
            Fault::Hang => std::thread::sleep(self.spec.hang),
            Fault::Vanish => {
                self.gone_until = Some(Instant::now() + self.spec.gone);
                return Err(gone());
            }
            _ => {
                let largest = self.inner.calibration().layout.format().max_code();
                let largest = u16::try_from(largest).unwrap_or(u16::MAX);
                damage::damage(fault, burst, largest, &mut self.random);
                self.damaged = true;
            }
        }
        Ok(())
    }
}

fn gone() -> SourceError {
    SourceError::Gone("found no device, expected one (--faults vanish)".into())
}

impl Adapter for FaultSource {
    fn inner(&self) -> &dyn Source {
        self.inner.as_ref()
    }

    fn inner_mut(&mut self) -> &mut dyn Source {
        self.inner.as_mut()
    }

    fn set_sliding(&mut self, _is_sliding: bool) -> bool {
        self.inner.set_sliding(false);
        false
    }

    fn next_burst(&mut self, burst: &mut Burst) -> Result<(), SourceError> {
        if self.gone_until.is_some_and(|until| Instant::now() < until) {
            return Err(gone());
        }
        self.gone_until = None;
        if std::mem::take(&mut self.damaged) {
            *burst = Burst::default();
        }
        self.inner.next(burst)?;
        if self.spec.sound > 0 {
            self.spec.sound -= 1;
            return Ok(());
        }
        match self.spec.choose(self.random.part()) {
            Some(fault) => self.injected(fault, burst),
            None => Ok(()),
        }
    }
}
