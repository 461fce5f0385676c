//! Simulator and judge: maps to bursts, replay, reference integrals, charts.

pub mod burst;
pub mod cli;
pub mod decompose;
pub mod env;
pub mod error;
pub mod maps;
pub mod output;
pub mod replay;
