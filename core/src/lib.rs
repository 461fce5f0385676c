#![doc = include_str!("../README.md")]
#![no_std]

pub mod arena;
pub mod color;
pub mod lens;
pub mod response;

pub mod format;

pub mod merge;

pub mod harmonics;
pub mod healpix;
pub mod plan;

pub mod front;

pub mod pyramid;
mod root;

pub mod fill;
pub mod polar;

pub mod light;
pub mod receiver;
pub mod sampler;

pub mod thin;
pub mod tonemap;
pub mod wire;

pub use healpix::{BadOrder, Order};
