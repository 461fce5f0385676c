#![doc = include_str!("../README.md")]
#![no_std]

pub mod color;
pub mod format;
pub mod harmonics;
pub mod healpix;
pub mod lens;
pub mod light;
pub mod mains;
pub mod polar;
pub mod pyramid;
pub mod receiver;
pub mod response;
pub mod sampler;
pub mod thin;
pub mod tonemap;
pub mod wire;

mod buffer;
mod calibration;
mod error;
mod extrapolation;
mod front;
mod front_end;
mod lanes;
mod merge;
mod pixel_table;
mod quad;
mod root;
mod sizes;
mod stages;
mod tally;
mod unpack;
mod window;

pub use buffer::{Buffer, TooSmall};
pub use calibration::Calibration;
/// Re-export of the crate that defines the trait `Write`, to which the encoders of [`wire`] write.
pub use embedded_io;
pub use error::FrontError;
pub use extrapolation::Extrapolation;
pub use format::{Format, ImageSize, Layout, LayoutError};
pub use front::{BurstError, Coverage};
pub use front_end::FrontEnd;
/// Re-export of the crate of the vector types in this interface: directions are `glam::Vec3` and `glam::DVec3`, pixels `glam::DVec2`.
pub use glam;
pub use healpix::{BadOrder, Domain, MapShape, Order};
pub use lens::{Lens, LensError};
pub use light::{Decomposition, Light};
pub use merge::{Exposure, MAX_EXPOSURES, MergeError, MergeMode, Samples};
pub use pixel_table::PixelTableError;
pub use response::{Depth, Levels, Response, ResponseError};
pub use sampler::q2tree::Q2Tree;
pub use sampler::{Map, Request, Sampler, SamplerKind, UnknownSampler};
pub use sizes::{BufferSize, Sizes};
pub use unpack::{read_luma, read_rgb_row};
pub use window::{NewFrame, Window};

/// Stages of the front end, for the tests and benchmarks of this workspace. Unstable: not part of the public interface, changed or
/// removed without notice.
#[doc(hidden)]
pub mod internals {
    pub use crate::extrapolation::average;
    pub use crate::front::burst;
    pub use crate::lanes::Lanes;
    pub mod merge {
        pub use crate::merge::{
            COUNT_BITS, Channels, Codes, Merge, MergeSize, MergeView, Reciprocal, merge_size,
        };
    }
    pub mod pixel_table {
        pub use crate::pixel_table::{
            Buffers, PixelTable, PixelTableSize, PixelTableView, Run, Span, Texel, pixel_table_size,
        };
    }
}
