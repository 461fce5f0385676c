//! The window of the last bursts: their times.

/// Largest number of bursts in a fit: about one and a half seconds at ten bursts per second.
pub(super) const WINDOW: usize = 16;

/// Values in the last bursts, a ring: [`Window::slot`] returns the index of each burst.
pub(super) type PastValues = [f32; WINDOW];

/// Times of the last bursts, seconds, as a ring.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Window {
    times: [f64; WINDOW],
    newest: usize,
    count: usize,
    /// Number of bursts since the start, modulo 2^32.
    number: u32,
}

impl Window {
    /// Appends the time of a burst, seconds.
    pub fn push(&mut self, at: f64) {
        self.newest = (self.newest + 1) % WINDOW;
        self.times[self.newest] = at;
        self.count = (self.count + 1).min(WINDOW);
        self.number = self.number.wrapping_add(1);
    }

    /// Returns the number of bursts in the window.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Returns the number of bursts since the start, modulo 2^32.
    pub fn number(&self) -> u32 {
        self.number
    }

    /// Returns the number of bursts after burst number `since`, at most the length of the window.
    pub fn age(&self, since: u32) -> usize {
        (self.number.wrapping_sub(since) as usize).min(WINDOW)
    }

    /// Returns the position in the ring of the burst that is `back` bursts older than the newest.
    pub fn slot(&self, back: usize) -> usize {
        (self.newest + WINDOW - back % WINDOW) % WINDOW
    }

    /// Returns the seconds from the burst that is `back` bursts older than the newest to the newest.
    pub fn since(&self, back: usize) -> f64 {
        self.times[self.newest] - self.times[self.slot(back)]
    }

    /// Returns the time of the newest burst, seconds; `None` for an empty window.
    pub fn last(&self) -> Option<f64> {
        (self.count > 0).then(|| self.times[self.newest])
    }
}
