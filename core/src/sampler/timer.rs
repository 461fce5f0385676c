//! The measurement of the time that a sampler spends in its temporal filters.

/// Measures the time that a sampler spends in its temporal filters, with the clock that the caller provides.
///
/// ```
/// use hemilux_core::sampler::Timer;
/// # let mut ticks = 0;
/// let mut clock = || {
///     // Nanoseconds since any fixed time.
/// #   ticks += 5;
/// #   ticks
/// };
/// let timer = Timer::new(&mut clock);
/// // `sampler.update_timed(&map, &request, &mut timer)` adds to it.
/// assert_eq!(timer.ns(), 0);
/// ```
pub struct Timer<'a> {
    clock: Option<&'a mut dyn FnMut() -> u64>,
    ns: u64,
}

impl<'a> Timer<'a> {
    /// Creates a timer without a clock, which measures no duration.
    #[must_use]
    pub const fn none() -> Self {
        Self { clock: None, ns: 0 }
    }

    /// Creates a timer over `clock`, which returns nanoseconds since a fixed time.
    pub fn new(clock: &'a mut dyn FnMut() -> u64) -> Self {
        Self { clock: Some(clock), ns: 0 }
    }

    /// Returns the sum of the measured durations, nanoseconds.
    #[must_use]
    pub const fn ns(&self) -> u64 {
        self.ns
    }

    /// Runs `filter`, adds its duration to the sum and returns its result.
    pub(crate) fn measure<R>(&mut self, filter: impl FnOnce() -> R) -> R {
        let Some(clock) = &mut self.clock else { return filter() };
        let began = clock();
        let result = filter();
        self.ns = self.ns.saturating_add(clock().saturating_sub(began));
        result
    }
}

impl core::fmt::Debug for Timer<'_> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Timer").field("ns", &self.ns).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::Timer;

    #[test]
    fn durations_add_up_and_a_clock_that_goes_back_adds_nothing() {
        let mut times = [100, 130, 200, 201, 500, 400].into_iter();
        let mut clock = || times.next().expect("two readings for each duration");
        let mut timer = Timer::new(&mut clock);
        let results = [1, 2, 3].map(|i| timer.measure(|| i));
        assert_eq!((results, timer.ns()), ([1, 2, 3], 31));
        let mut none = Timer::none();
        assert_eq!((none.measure(|| 7), none.ns()), (7, 0));
    }
}
