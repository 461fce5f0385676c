//! Reductions of a light set relative to the settings, which keep a frame within its time budget.

/// A kind of reduction of a light set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Step {
    /// Fewer exposures of each burst are merged.
    Exposures,
    /// The map of the frame has a lower order.
    Order,
    /// The set has fewer lights than the settings request.
    Lights,
    /// Bursts between the processed ones are skipped.
    Rate,
}

impl Step {
    /// All kinds of reductions, in the order of their first step.
    pub const ALL: [Self; 4] = [Self::Exposures, Self::Order, Self::Lights, Self::Rate];

    /// Returns the name of the kind in light sets and counters.
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

/// The number of reductions of each kind in a light set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Degraded([u8; Step::ALL.len()]);

impl Degraded {
    /// The value without reductions: the set complies with the settings.
    pub const NONE: Self = Self([0; Step::ALL.len()]);

    /// Counts one more reduction of kind `step`.
    pub fn add(&mut self, step: Step) {
        if let Some(count) = self.0.get_mut(step as usize) {
            *count = count.saturating_add(1);
        }
    }

    /// Returns the number of reductions of kind `step`.
    #[must_use]
    pub fn count(&self, step: Step) -> u8 {
        self.0.get(step as usize).copied().unwrap_or(0)
    }

    /// Returns whether the light set has no reduction.
    #[must_use]
    pub fn is_none(&self) -> bool {
        *self == Self::NONE
    }

    /// Returns the names of the reductions; a kind that was applied n times appears n times.
    pub fn names(&self) -> impl Iterator<Item = &'static str> + '_ {
        Step::ALL.into_iter().flat_map(|step| core::iter::repeat_n(step.name(), self.count(step).into()))
    }
}
