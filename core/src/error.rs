//! The error type of the front end: reasons why it cannot be created or cannot process a burst.

use crate::buffer::TooSmall;
use crate::format::LayoutError;
use crate::front::BurstError;
use crate::healpix::BadOrder;
use crate::lens::LensError;
use crate::merge::MergeError;
use crate::pixel_table::PixelTableError;
use crate::response::ResponseError;

/// The reason why a front end cannot be created or a burst cannot be processed.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum FrontError {
    /// The lens parameters of the calibration are invalid.
    Lens(LensError),
    /// The frame layout of the calibration is invalid.
    Layout(LayoutError),
    /// The order of the map does not exist.
    Order(BadOrder),
    /// The response is not monotone between the levels, or the levels are invalid.
    Response(ResponseError),
    /// The exposures cannot be merged, or the radiance scale is invalid.
    Exposures(MergeError),
    /// The lens, the image size and the map order do not fit together.
    PixelTable(PixelTableError),
    /// A factor of the white balance is not a positive finite number.
    BadWhiteBalance,
    /// The lent memory is too short; both numbers are 64-bit words.
    Memory(TooSmall),
    /// The frames do not match the calibration or the exposures.
    Burst(BurstError),
}

impl core::fmt::Display for FrontError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Lens(e) => e.fmt(f),
            Self::Layout(e) => e.fmt(f),
            Self::Order(e) => e.fmt(f),
            Self::Response(e) => e.fmt(f),
            Self::Exposures(e) => e.fmt(f),
            Self::PixelTable(e) => e.fmt(f),
            Self::BadWhiteBalance => write!(f, "a white balance that is not of positive numbers"),
            Self::Memory(e) => e.fmt(f),
            Self::Burst(e) => e.fmt(f),
        }
    }
}

impl core::error::Error for FrontError {}

macro_rules! from {
    ($($error:ident => $variant:ident),*) => {
        $(impl From<$error> for FrontError {
            fn from(e: $error) -> Self {
                Self::$variant(e)
            }
        })*
    };
}
from!(LensError => Lens, LayoutError => Layout, BadOrder => Order, ResponseError => Response, MergeError => Exposures,
      PixelTableError => PixelTable, TooSmall => Memory, BurstError => Burst);
