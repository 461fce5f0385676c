//! Simulator and scoring of light probes: simulated bursts, replay of recorded bursts, reference integrals, charts.

pub mod baseline;
pub mod bench;
pub mod boards;
pub mod burst;
pub mod chart;
pub mod cli;
pub mod contender;
pub mod decompose;
pub mod discs;
pub mod draw;
pub mod env;
pub mod error;
pub mod export;
pub mod import;
pub mod maps;
pub mod metrics;
pub mod output;
pub mod progress;
pub mod reads;
pub mod render;
pub mod replay;
pub mod scenario;
pub mod score;
pub mod slowdown;
pub mod soak;
pub mod stress;
