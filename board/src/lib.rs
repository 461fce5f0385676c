//! The probe: where bursts come from, the processing thread and the server.
//!
//! The way of the light: [`source`] (a scene or a recorded burst) -> [`pipeline`] (the core's stages in one place) -> [`probe`]
//! (the thread that runs them) -> `server`.

pub mod calibration;
pub mod clock;
pub mod picture;
pub mod pipeline;
pub mod recorded;
pub mod samplers;
pub mod scene;
pub mod source;
