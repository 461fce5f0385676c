//! The probe: where bursts come from, the processing thread and the server.
//!
//! The way of the light: [`source`] (a scene or a recorded burst) -> [`pipeline`] (the core's stages in one place) -> `probe`
//! (the thread that runs them) -> `server`.

#[cfg(feature = "mdns")]
pub mod announce;
pub mod calibration;
#[cfg(feature = "server")]
pub mod cli;
pub mod clock;
pub mod memory;
pub mod picture;
pub mod pipeline;
#[cfg(feature = "server")]
pub mod probe;
pub mod recorded;
pub mod samplers;
pub mod scene;
#[cfg(feature = "server")]
pub mod server;
pub mod source;
#[cfg(feature = "server")]
pub mod systemd;
#[cfg(feature = "v4l2")]
pub mod v4l2;
