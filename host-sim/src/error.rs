//! What a command may end with: one line, and the exit code.

use std::fmt::Display;
use std::path::Path;

/// Why a command stopped.
#[derive(Debug, thiserror::Error)]
pub enum SimError {
    /// The command line asks for something that does not exist: exit 2.
    #[error("{0}")]
    Usage(String),
    /// The work failed: exit 1.
    #[error("{0}")]
    Failed(String),
}

impl SimError {
    /// A failure at a file.
    pub fn at(path: &Path, found: impl Display, expected: &str) -> Self {
        Self::Failed(format!("{}: found {found}, expected {expected}", path.display()))
    }

    /// Exit status.
    #[must_use]
    pub fn code(&self) -> u8 {
        match self {
            Self::Usage(_) => 2,
            Self::Failed(_) => 1,
        }
    }
}

impl From<crate::env::EnvError> for SimError {
    fn from(e: crate::env::EnvError) -> Self {
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
