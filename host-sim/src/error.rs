//! The error of a command: one line of text and an exit status.

use std::fmt::Display;
use std::path::Path;

/// Reasons for which a command fails.
#[derive(Debug, thiserror::Error)]
pub enum SimError {
    /// The command line is wrong; the exit status is 2.
    #[error("{0}")]
    Usage(String),
    /// The command failed; the exit status is 1.
    #[error("{0}")]
    Failed(String),
}

impl SimError {
    /// Creates a [`SimError::Failed`] of the form "PATH: found FOUND, expected EXPECTED".
    pub fn at(path: &Path, found: impl Display, expected: &str) -> Self {
        Self::Failed(format!("{}: found {found}, expected {expected}", path.display()))
    }

    /// Returns the exit status of the process: 2 for [`SimError::Usage`], 1 for [`SimError::Failed`].
    #[must_use]
    pub fn code(&self) -> u8 {
        match self {
            Self::Usage(_) => 2,
            Self::Failed(_) => 1,
        }
    }
}

impl From<hemilux::maps::MapError> for SimError {
    fn from(e: hemilux::maps::MapError) -> Self {
        Self::Failed(e.to_string())
    }
}

impl From<hemilux::recorded::RecordedError> for SimError {
    fn from(e: hemilux::recorded::RecordedError) -> Self {
        Self::Failed(e.to_string())
    }
}

impl From<hemilux::pipeline::PipelineError> for SimError {
    fn from(e: hemilux::pipeline::PipelineError) -> Self {
        match e {
            hemilux::pipeline::PipelineError::Sampler(e) => e.into(),
            e => Self::Failed(e.to_string()),
        }
    }
}

impl From<hemilux::samplers::SamplerError> for SimError {
    fn from(e: hemilux::samplers::SamplerError) -> Self {
        Self::Usage(format!("--sampler, --lights: found {e}"))
    }
}

impl From<crate::score::ScoreError> for SimError {
    fn from(e: crate::score::ScoreError) -> Self {
        Self::Failed(e.to_string())
    }
}
