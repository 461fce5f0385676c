//! Transfer functions of photographs.

/// A transfer function from codes to relative exposure, both 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Transfer {
    Linear,
    Srgb,
}

impl Transfer {
    /// Returns the name of the model in a `[response]` table.
    pub fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Srgb => "srgb",
        }
    }
}
