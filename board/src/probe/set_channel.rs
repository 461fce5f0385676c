//! The channel of the newest light set, from the processing thread to all clients.

use crate::light_set::OwnedSet;
use std::sync::Arc;
use tokio::sync::{Notify, watch};

/// Holds the newest light set and notifies waiting clients of a new set. Publication does not wait for clients.
#[derive(Debug)]
pub struct SetChannel {
    latest: watch::Sender<Option<Arc<OwnedSet>>>,
    /// Notifies waiters of a new set in FIFO order.
    notify: Notify,
}

impl Default for SetChannel {
    fn default() -> Self {
        Self { latest: watch::Sender::new(None), notify: Notify::new() }
    }
}

impl SetChannel {
    /// Returns a receiver of the newest set, `None` before the first one. [`SetChannel::newer`] waits for the next set.
    #[must_use]
    pub fn subscribe(&self) -> watch::Receiver<Option<Arc<OwnedSet>>> {
        self.latest.subscribe()
    }

    /// Returns the newest light set; `None` before the first one.
    #[must_use]
    pub fn latest(&self) -> Option<Arc<OwnedSet>> {
        self.latest.borrow().clone()
    }

    /// Waits for a set newer than the last one that `seen` has read. Waiters are notified in FIFO order, so that many simultaneous requests
    /// do not delay clients that wait for every frame.
    pub async fn newer(&self, seen: &watch::Receiver<Option<Arc<OwnedSet>>>) {
        loop {
            let notified = self.notify.notified();
            tokio::pin!(notified);
            // The waiter is queued before the check, so that no set between check and wait is missed.
            notified.as_mut().enable();
            if seen.has_changed().unwrap_or(true) {
                return;
            }
            // The notification may belong to a set that was published before the check.
            notified.await;
        }
    }

    /// Replaces the newest light set by `set` and notifies the waiters.
    pub(super) fn publish(&self, set: Arc<OwnedSet>) {
        self.latest.send_replace(Some(set));
        self.notify.notify_waiters();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn waiters_are_notified_in_fifo_order_and_a_newer_set_returns_at_once() {
        let sets = Arc::new(SetChannel::default());
        let (woken, mut order) = tokio::sync::mpsc::unbounded_channel();
        // More waiters than one call of `Notify` wakes at a time.
        for i in 0..100 {
            let (sets, woken) = (Arc::clone(&sets), woken.clone());
            tokio::spawn(async move {
                sets.newer(&sets.subscribe()).await;
                woken.send(i).expect("a listener");
            });
            tokio::task::yield_now().await;
        }
        let seen = sets.subscribe();
        sets.publish(Arc::default());
        for i in 0..100 {
            assert_eq!(order.recv().await, Some(i));
        }
        sets.newer(&seen).await;
    }

    #[tokio::test]
    async fn stale_notification_does_not_wake_waiters() {
        let sets = Arc::new(SetChannel::default());
        sets.latest.send_replace(Some(Arc::default()));
        let waiting = tokio::spawn({
            let sets = Arc::clone(&sets);
            async move { sets.newer(&sets.subscribe()).await }
        });
        tokio::task::yield_now().await;
        sets.notify.notify_waiters();
        for _ in 0..3 {
            tokio::task::yield_now().await;
        }
        assert!(!waiting.is_finished(), "the set was there before it asked");
        sets.publish(Arc::default());
        waiting.await.expect("a newer set");
    }
}
