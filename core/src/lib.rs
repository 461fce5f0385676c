#![doc = include_str!("../README.md")]
#![no_std]

pub mod color;
pub mod format;
pub mod harmonics;
pub mod healpix;
pub mod lens;
pub mod light;
pub mod polar;
pub mod pyramid;
pub mod receiver;
pub mod sampler;
pub mod thin;
pub mod tonemap;
pub mod wire;

mod arena;
mod calibration;
mod error;
mod fill;
mod front;
mod front_end;
mod merge;
mod plan;
mod quad;
mod response;
mod root;
mod sizes;
mod unpack;

pub use arena::{Buffer, TooSmall};
pub use calibration::Calibration;
pub use error::FrontError;
pub use fill::Extrapolation;
pub use format::{Format, Layout, LayoutError};
pub use front::{BurstError, Coverage};
pub use front_end::FrontEnd;
pub use healpix::{BadOrder, Domain, Order};
pub use lens::{Lens, LensError};
pub use light::{Decomposition, Light};
pub use merge::{Exposure, MAX_EXPOSURES, MergeError, Samples};
pub use plan::PlanError;
pub use response::{Depth, Levels, Response, ResponseError};
pub use sampler::q2tree::Q2Tree;
pub use sampler::{Map, Request, Sampler, SamplerKind, UnknownSampler};
pub use sizes::{BufferSize, Sizes};
pub use unpack::{read_luma, read_rgb_row};

/// The parts that [`FrontEnd`] is made of, for this workspace's tests of each. No part of the interface: anything may change.
#[doc(hidden)]
pub mod internals {
    pub mod fill {
        pub use crate::fill::*;
    }
    pub mod front {
        pub use crate::front::*;
    }
    pub mod merge {
        pub use crate::merge::*;
    }
    pub mod plan {
        pub use crate::plan::*;
    }
    pub mod pyramid {
        pub use crate::pyramid::*;
    }
    pub mod response {
        pub use crate::response::*;
    }
}
