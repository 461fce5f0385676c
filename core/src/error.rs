//! The error of the front end's constructor and of its bursts.

use crate::buffer::TooSmall;
use crate::format::LayoutError;
use crate::front::BurstError;
use crate::healpix::BadOrder;
use crate::lens::LensError;
use crate::merge::MergeError;
use crate::pixel_table::PixelTableError;
use crate::response::ResponseError;

/// Why a front end was refused, or a burst.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum FrontError {
    /// The lens is none.
    Lens(LensError),
    /// Frames cannot lie as the layout says.
    Layout(LayoutError),
    /// There is no such order.
    Order(BadOrder),
    /// The response cannot be tabulated between the levels.
    Response(ResponseError),
    /// The exposures cannot be merged, or the scale is no number of radiance.
    Exposures(MergeError),
    /// The lens, the image size and the order do not go together.
    PixelTable(PixelTableError),
    /// A factor of the white balance that is not a positive finite number.
    BadWhiteBalance,
    /// The lent memory is too short; the numbers are words of 64 bits.
    Memory(TooSmall),
    /// Frames that do not fit the calibration and the exposures.
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
