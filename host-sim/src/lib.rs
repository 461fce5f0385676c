//! Simulator and judge: maps to bursts, replay, reference integrals, charts.

pub mod baseline;
pub mod env;
pub mod metrics;
pub mod score;
