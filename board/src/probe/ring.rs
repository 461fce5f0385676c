//! A ring of light sets, which reuses their memory.

use crate::light_set::OwnedSet;
use std::sync::Arc;

/// Number of light sets in a ring: one is published, one is being filled, two are being encoded.
pub(super) const SETS: usize = 4;

/// A ring of sets, of which one without a reader is filled next.
#[derive(Debug)]
pub(super) struct Ring<T> {
    sets: [Arc<T>; SETS],
}

impl<T: Default> Ring<T> {
    pub(super) fn new(make: impl Fn() -> T) -> Self {
        Self { sets: std::array::from_fn(|_| Arc::new(make())) }
    }

    /// Fills a set of the ring that has no reader and returns it; a new set is allocated only if every set has
    /// a reader.
    pub(super) fn fill(&mut self, fill: impl FnOnce(&mut T)) -> Arc<T> {
        let free = self.sets.iter_mut().position(|set| Arc::get_mut(set).is_some());
        let at = free.unwrap_or_else(|| {
            self.sets[0] = Arc::default();
            0
        });
        if let Some(set) = Arc::get_mut(&mut self.sets[at]) {
            fill(set);
        }
        Arc::clone(&self.sets[at])
    }
}

/// Initial capacity of each string of a light set, bytes: longer than a run identifier and than the name of a
/// sampler.
const TEXT: usize = 32;

/// Returns a light set without lights, with memory for `lights` lights and for the strings of the set.
fn empty(lights: usize) -> OwnedSet {
    OwnedSet {
        run: String::with_capacity(TEXT),
        sampler: String::with_capacity(TEXT),
        lights: Vec::with_capacity(lights),
        ..OwnedSet::default()
    }
}

impl Ring<OwnedSet> {
    /// Creates a ring of light sets with a capacity of `lights` lights each.
    pub(super) fn with_lights(lights: usize) -> Self {
        Self::new(|| empty(lights))
    }

    /// Raises the capacity of every set of the ring to `lights` lights. Sets that readers hold are replaced,
    /// not changed.
    pub(super) fn reserve(&mut self, lights: usize) {
        for set in &mut self.sets {
            if set.lights.capacity() < lights {
                *set = Arc::new(empty(lights));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_are_reused_and_a_held_one_is_not_overwritten() {
        let mut ring = Ring::with_lights(10);
        let held: Vec<_> = (0..SETS as u64).map(|n| ring.fill(|set| set.frame = n)).collect();
        let one_over = ring.fill(|set| set.frame = 99);
        let frames: Vec<_> = held.iter().map(|set| set.frame).collect();
        assert_eq!((frames, one_over.frame), (vec![0, 1, 2, 3], 99), "at capacity, and one over");
        let freed = Arc::as_ptr(&held[2]);
        drop(held);
        assert!(ring.sets.iter().any(|set| Arc::as_ptr(set) == freed), "it stays in the ring");
        let next = ring.fill(|set| set.frame = 100);
        assert!(ring.sets.iter().any(|set| Arc::ptr_eq(set, &next)), "memory goes round");
    }
}
