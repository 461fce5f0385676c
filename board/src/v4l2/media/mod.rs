//! Cameras of a media graph: sensors that are connected with a capture node through bridges.
//!
//! [`graph`] reads a media device, [`route`] finds the links from a sensor to a node independent of their names, `wiring` switches links,
//! sets the formats of the pads and restores both. Since node numbers change from boot to boot, a camera can be named by its sensor, by its
//! media device, or by a node that its sensor can reach.

pub mod abi;
pub mod bus;
pub mod graph;
mod locate;
pub mod route;
#[cfg(test)]
mod tests;
pub(super) mod wiring;

pub use graph::{Device, Graph, Topology};
pub(super) use locate::{Located, all, locate};
#[cfg(test)]
pub(crate) use tests::pi_4_script;
