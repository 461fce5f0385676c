//! A light set that the client has received.

use crate::light_set::{self, OwnedSet};
use hemilux_core::light::Light;
use hemilux_core::wire::BinarySet;
use std::ops::Deref;

/// A light set with an index of its lights by id. It dereferences to the set.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Set {
    set: OwnedSet,
    /// Ids of the lights, sorted, with the indices of the lights in `lights`.
    places: Vec<(u32, u32)>,
}

impl Deref for Set {
    type Target = OwnedSet;

    fn deref(&self) -> &OwnedSet {
        &self.set
    }
}

impl Set {
    /// Replaces this set by the one that `bytes` encode. The memory of the lights is reused.
    pub(super) fn read(&mut self, bytes: &BinarySet<'_>) {
        light_set::copy(&bytes.head(), &mut self.set);
        self.set.lights.extend(bytes.lights());
        self.set.ambient_sh = bytes.ambient_sh();
        self.places.clear();
        self.places.extend(self.set.lights.iter().map(|l| l.id).zip(0..));
        self.places.sort_unstable();
    }

    /// Returns the light with the id `id`; `None` if the set has none.
    #[must_use]
    pub fn light(&self, id: u32) -> Option<&Light> {
        let at = self.places.binary_search_by_key(&id, |(id, _)| *id).ok()?;
        self.lights.get(self.places[at].1 as usize)
    }
}
