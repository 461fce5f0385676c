//! The error type of the front end.

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
    /// Invalid lens parameters.
    Lens(LensError),
    /// An invalid frame layout.
    Layout(LayoutError),
    /// A map order that does not exist.
    Order(BadOrder),
    /// A response that is not monotone between the levels, or invalid levels.
    Response(ResponseError),
    /// Exposures that cannot be merged, or an invalid radiance scale.
    Exposures(MergeError),
    /// A lens, an image size and a map order that do not fit together.
    PixelTable(PixelTableError),
    /// A factor of the white balance that is not a positive finite number.
    BadWhiteBalance,
    /// Lent memory that is too short; both numbers are 64-bit words.
    Memory(TooSmall),
    /// Frames that do not match the calibration or the exposures.
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
