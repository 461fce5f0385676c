//! The probe: sources of bursts, the processing thread and the server.
//!
//! Data flow: [`source`] (bursts of a camera, a scene or a recording) -> [`pipeline`] (the core's stages with memory from the heap) -> `probe`
//! (the thread that runs the pipeline) -> `server`. `client` is the Rust client for renderers; it uses no other module.

#[cfg(feature = "server")]
pub mod allocator;
#[cfg(feature = "mdns")]
pub mod announce;
#[cfg(feature = "calibrate")]
pub mod calibrate;
#[cfg(feature = "pipeline")]
pub mod calibration;
#[cfg(feature = "pipeline")]
pub mod camera_status;
#[cfg(feature = "server")]
pub mod cli;
#[cfg(feature = "client")]
pub mod client;
#[cfg(feature = "pipeline")]
pub mod clock;
#[cfg(feature = "server")]
pub mod config_file;
#[cfg(feature = "pipeline")]
pub mod consistency;
#[cfg(feature = "export")]
pub mod export;
#[cfg(feature = "pipeline")]
pub mod exposure_plan;
#[cfg(feature = "pipeline")]
pub mod judge;
#[cfg(any(feature = "server", feature = "client"))]
pub mod light_set;
#[cfg(feature = "server")]
pub mod machine;
#[cfg(feature = "maps")]
pub mod maps;
#[cfg(feature = "server")]
pub mod memory;
#[cfg(all(target_os = "linux", target_arch = "arm", built_with_neon))]
mod neon;
#[cfg(feature = "pipeline")]
pub mod noise;
#[cfg(feature = "pipeline")]
pub mod picture;
#[cfg(feature = "pipeline")]
pub mod pipeline;
#[cfg(feature = "pipeline")]
mod polar;
#[cfg(feature = "server")]
pub mod probe;
#[cfg(feature = "pipeline")]
pub mod recorded;
#[cfg(feature = "calibrate")]
mod replacement;
#[cfg(feature = "pipeline")]
pub mod samplers;
#[cfg(feature = "pipeline")]
pub mod scene;
#[cfg(any(feature = "osc", feature = "mqtt"))]
pub mod senders;
#[cfg(feature = "server")]
pub mod server;
#[cfg(feature = "pipeline")]
pub mod source;
#[cfg(feature = "server")]
pub mod systemd;
#[cfg(feature = "pipeline")]
pub mod timing;
#[cfg(feature = "command-line")]
pub mod usage;
#[cfg(feature = "v4l2")]
pub mod v4l2;
