//! Steps by which a light set falls short of what the settings ask for, because a frame took longer than its budget.

/// A kind of step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Step {
    /// Fewer exposures of each burst are merged.
    Exposures,
    /// The map has a lower order.
    Order,
    /// The set has fewer lights.
    Lights,
    /// Bursts are left out.
    Rate,
}

impl Step {
    /// All kinds, in the order in which they are taken.
    pub const ALL: [Self; 4] = [Self::Exposures, Self::Order, Self::Lights, Self::Rate];

    /// The name in light sets and counters.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Exposures => "exposures",
            Self::Order => "order",
            Self::Lights => "lights",
            Self::Rate => "rate",
        }
    }
}

/// The number of steps of each kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Degraded([u8; Step::ALL.len()]);

impl Degraded {
    /// No step: the set is as the settings ask for.
    pub const NONE: Self = Self([0; Step::ALL.len()]);

    /// Adds a step of a kind.
    pub fn add(&mut self, step: Step) {
        if let Some(count) = self.0.get_mut(step as usize) {
            *count = count.saturating_add(1);
        }
    }

    /// The number of steps of a kind.
    #[must_use]
    pub fn count(&self, step: Step) -> u8 {
        self.0.get(step as usize).copied().unwrap_or(0)
    }

    /// Whether the set is as the settings ask for.
    #[must_use]
    pub fn is_none(&self) -> bool {
        *self == Self::NONE
    }

    /// The names of the steps, one for each step of a kind.
    pub fn names(&self) -> impl Iterator<Item = &'static str> + '_ {
        Step::ALL.into_iter().flat_map(|step| core::iter::repeat_n(step.name(), self.count(step).into()))
    }
}
