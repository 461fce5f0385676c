//! Simulator and judge: maps to bursts, replay, reference integrals, charts.

pub mod baseline;
pub mod burst;
pub mod cli;
pub mod decompose;
pub mod env;
pub mod error;
pub mod maps;
pub mod metrics;
pub mod output;
pub mod replay;
pub mod score;
