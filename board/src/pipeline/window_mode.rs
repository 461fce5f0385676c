//! The frames of a set: those of one burst, or the newest frame of each exposure.

/// Names that `--window` and `change?window=` accept.
pub const WINDOWS: [(&str, WindowMode); 2] = [("burst", WindowMode::Burst), ("sliding", WindowMode::Sliding)];

/// The frames that a set is computed from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum WindowMode {
    /// The frames of one burst: a set for every burst.
    #[default]
    Burst,
    /// The newest frame of each exposure: a set for every frame.
    Sliding,
}

impl WindowMode {
    /// The name, of [`WINDOWS`].
    #[must_use]
    pub fn name(self) -> &'static str {
        WINDOWS.iter().find(|(_, mode)| *mode == self).map_or("", |(name, _)| name)
    }

    /// The mode with this name; `None` for an unknown name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        WINDOWS.iter().find(|(known, _)| *known == name).map(|(_, mode)| *mode)
    }
}
