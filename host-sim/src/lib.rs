//! Simulator and judge: maps to bursts, replay, reference integrals, charts.

pub mod env;
pub mod metrics;
