//! Times of the last bursts.

/// Number of bursts that a fit spans at most: about one and a half seconds at ten bursts a second.
pub(super) const WINDOW: usize = 16;

/// Values of the last bursts, a ring: the element of each burst is that of [`Window::slot`].
pub(super) type Past = [f32; WINDOW];

/// Times of the last bursts, seconds, as a ring.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Window {
    times: [f64; WINDOW],
    newest: usize,
    count: usize,
    /// Number of all bursts.
    number: u32,
}

impl Window {
    /// Adds the time of a burst.
    pub fn push(&mut self, at: f64) {
        self.newest = (self.newest + 1) % WINDOW;
        self.times[self.newest] = at;
        self.count = (self.count + 1).min(WINDOW);
        self.number = self.number.wrapping_add(1);
    }

    /// Number of bursts in the window.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Number of all bursts.
    pub fn number(&self) -> u32 {
        self.number
    }

    /// Number of bursts after burst number `since`, at most the length of the window.
    pub fn age(&self, since: u32) -> usize {
        (self.number.wrapping_sub(since) as usize).min(WINDOW)
    }

    /// Position in the ring of the burst that is `back` bursts older than the newest one.
    pub fn slot(&self, back: usize) -> usize {
        (self.newest + WINDOW - back % WINDOW) % WINDOW
    }

    /// Seconds from the burst that is `back` bursts older than the newest one to the newest one.
    pub fn since(&self, back: usize) -> f64 {
        self.times[self.newest] - self.times[self.slot(back)]
    }

    /// Time of the newest burst; `None` for an empty window.
    pub fn last(&self) -> Option<f64> {
        (self.count > 0).then(|| self.times[self.newest])
    }
}
