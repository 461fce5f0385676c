//! The newest light set of a selection, for a sender that waits for sets.

use crate::light_set::OwnedSet;
use crate::probe::Link;
use crate::probe::tiers::{Selection, Served};
use hemilux_core::wire::Stale;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::watch;

/// Time without a new light set after which the last one is reported as stale.
const LONGEST_WAIT: Duration = Duration::from_millis(1500);

/// An update of the light sets for a sender.
#[derive(Clone, Debug)]
pub(super) enum SetUpdate {
    /// A light set that is newer than the last one.
    Fresh(Arc<OwnedSet>),
    /// The last light set, and the reason why there is no newer one.
    Stale(Arc<OwnedSet>, Stale<String>),
    /// There is no light set yet, for the contained reason.
    None(String),
}

/// Waits for the light sets of one selection.
#[derive(Debug)]
pub(super) struct Newest {
    pub(super) link: Arc<Link>,
    selection: Selection,
    seen: watch::Receiver<Option<Arc<OwnedSet>>>,
    frame: Option<u64>,
}

impl Newest {
    pub(super) fn new(link: Arc<Link>, selection: Selection) -> Self {
        let seen = link.sets().subscribe();
        Self { link, selection, seen, frame: None }
    }

    /// Returns the next light set, or after 1.5 s the state of the last one. Sets that were published in between are skipped.
    pub(super) async fn next(&mut self) -> SetUpdate {
        let until = tokio::time::Instant::now() + LONGEST_WAIT;
        loop {
            match self.now() {
                Some(set) if self.frame != Some(set.frame) => {
                    self.frame = Some(set.frame);
                    return SetUpdate::Fresh(set);
                }
                last => {
                    if tokio::time::timeout_at(until, self.link.sets().newer(&self.seen)).await.is_err() {
                        return self.late(last);
                    }
                }
            }
        }
    }

    /// Returns the newest light set of the selection; `None` before the first one.
    fn now(&mut self) -> Option<Arc<OwnedSet>> {
        let own = self.seen.borrow_and_update().clone();
        match self.link.tiers().request(self.selection) {
            Served::Own => own,
            Served::Set(set) => Some(set),
            Served::NotYet(_) => None,
        }
    }

    fn late(&self, last: Option<Arc<OwnedSet>>) -> SetUpdate {
        match last {
            Some(set) => {
                let staleness = self.link.staleness(&set);
                SetUpdate::Stale(set, staleness)
            }
            None => SetUpdate::None(
                self.link.status().failure().unwrap_or_else(|| "the source has not delivered a burst".into()),
            ),
        }
    }
}
