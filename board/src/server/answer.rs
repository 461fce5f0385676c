//! The light set that answers a request, with its age.

use crate::light_set::OwnedSet;
use crate::probe::Link;
use crate::probe::tiers::{Selection, Served};
use hemilux_core::wire::Stale;
use std::sync::Arc;
use std::time::Duration;

/// Longest time that a request for lights waits for the next frame: below the two seconds after which clients
/// repeat a request.
pub(super) const LONGEST_WAIT: Duration = Duration::from_millis(1500);

/// The light set that answers a request, with its age if it is stale.
#[derive(Clone, Debug)]
pub(super) struct Answer {
    pub(super) set: Arc<OwnedSet>,
    pub(super) stale: Option<Stale<String>>,
}

impl Answer {
    /// Returns `set` with its present age, as stale if the set is older than [`LONGEST_WAIT`] or if `is_late`.
    pub(super) fn of(link: &Link, set: Arc<OwnedSet>, is_late: bool) -> Self {
        let age = link.staleness(&set);
        let stale = (is_late || u128::from(age.age_ms) > LONGEST_WAIT.as_millis()).then_some(age);
        Self { set, stale }
    }

    /// Returns the newest set of the tier that serves `selection`, or the probe's own set while that tier has none; `None`
    /// before the first frame.
    pub(super) fn newest(link: &Link, selection: Selection, is_late: bool) -> Option<Self> {
        let own = link.sets().latest()?;
        let set = match link.tiers().request(selection) {
            Served::Set(set) => set,
            Served::Own | Served::NotYet(_) => own,
        };
        Some(Self::of(link, set, is_late))
    }
}
