//! HEALPix in NESTED order: directions to quad indices and back.
//!
//! A quad is a pixel of the HEALPix grid. Quad `ipix` of `order` lies in base face `ipix >> (2 * order)`; the remaining bits interleave
//! its column (even bits) and row (odd bits) inside the face. The children of quad p are 4p..=4p+3 of the next order. The formulas follow
//! \[Gorski2005\], section 5 and appendix A.
//!
//! Functions of an index take the order as a number and never panic: orders above [`Order::MAX`] are limited to it, and an index beyond the
//! last quad gives an arbitrary value. Constructors and length functions take an [`Order`].

use core::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};
use glam::DVec3;

/// The order of a HEALPix map: each of the twelve base faces holds 4^order quads. Values above [`Order::MAX`] cannot be constructed.
///
/// ```
/// use hemilux_core::Order;
///
/// let order: Order = 5.try_into()?;
/// assert_eq!(order.get(), 5);
/// assert!(Order::try_new(40).is_err());
/// # Ok::<(), hemilux_core::BadOrder>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Order(u8);

/// The error of an order above [`Order::MAX`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BadOrder {
    /// The number that was refused as an order.
    pub found: u8,
}

impl core::fmt::Display for BadOrder {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "a map of order {}, expected at most {}", self.found, Order::MAX)
    }
}

impl core::error::Error for BadOrder {}

impl Order {
    /// Order 0: the base faces themselves.
    pub const ZERO: Self = Self(0);

    /// Order 13, the highest: 12 * 4^13 quads still fit a `u32`.
    pub const MAX: Self = Self(13);

    /// Creates an order after checking that `order` is at most [`Order::MAX`].
    ///
    /// # Errors
    /// [`BadOrder`] for an order above [`Order::MAX`].
    pub const fn try_new(order: u8) -> Result<Self, BadOrder> {
        if order > Self::MAX.0 { Err(BadOrder { found: order }) } else { Ok(Self(order)) }
    }

    /// Creates the order `order`, limited to [`Order::MAX`].
    #[must_use]
    pub const fn saturating(order: u8) -> Self {
        if order > Self::MAX.0 { Self::MAX } else { Self(order) }
    }

    /// Returns this order as a number.
    #[must_use]
    pub const fn get(self) -> u8 {
        self.0
    }
}

impl TryFrom<u8> for Order {
    type Error = BadOrder;

    fn try_from(order: u8) -> Result<Self, BadOrder> {
        Self::try_new(order)
    }
}

impl From<Order> for u8 {
    fn from(order: Order) -> Self {
        order.0
    }
}

impl core::fmt::Display for Order {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        self.0.fmt(f)
    }
}

/// Returns the number of bits of a quad's index inside a base face: twice the order.
const fn inner_bits(order: u8) -> u32 {
    2 * Order::saturating(order).0 as u32
}

/// Returns the number of quads of `order` along a side of a base face.
const fn side(order: u8) -> u32 {
    1 << Order::saturating(order).0
}

/// The part of the sphere that a HEALPix map covers, and its resolution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MapShape {
    /// Part of the sphere that the map covers.
    pub domain: Domain,
    /// HEALPix order of the map's texels.
    pub order: Order,
}

/// The part of the sphere that a map covers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Domain {
    /// The whole sphere: all twelve base faces.
    Sphere,
    /// The hemisphere above the horizon, z > 0: faces 0 to 3 and the upper halves of faces 4 to 7.
    Hemisphere,
}

impl Domain {
    /// Returns the number of base faces that a map of this domain stores, counted from face 0.
    #[must_use]
    pub const fn faces(self) -> usize {
        match self {
            Self::Sphere => 12,
            Self::Hemisphere => 8,
        }
    }

    /// Returns the number of quads of `order` that a map of this domain stores.
    #[must_use]
    pub const fn quads(self, order: u8) -> usize {
        self.faces() << inner_bits(order)
    }

    /// Returns the solid angle of the domain, steradians.
    #[must_use]
    pub const fn solid_angle(self) -> f64 {
        match self {
            Self::Sphere => 4.0 * PI,
            Self::Hemisphere => TAU,
        }
    }

    /// Returns the fraction of quad `ipix` that lies inside this domain: 0, 1/2 or 1.
    #[must_use]
    pub fn share(self, order: u8, ipix: u32) -> f64 {
        if self == Self::Sphere {
            return 1.0;
        }
        let FaceCell { face, x, y } = split(order, ipix);
        match face {
            0..=3 => 1.0,
            4..=7 => match (x + y + 1).cmp(&side(order)) {
                core::cmp::Ordering::Less => 0.0,
                core::cmp::Ordering::Equal => 0.5,
                core::cmp::Ordering::Greater => 1.0,
            },
            _ => 0.0,
        }
    }
}

/// Returns the solid angle of a quad of `order`: 4 pi / (12 * 4^order) steradians.
#[must_use]
pub fn solid_angle(order: u8) -> f64 {
    PI / 3.0 / f64::from(1u32 << inner_bits(order))
}

/// The position of a quad: its base face, and its column and row in the grid of 2^order x 2^order quads of that face.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FaceCell {
    /// Base face of the quad, 0..=11.
    pub face: u32,
    /// Column of the quad in the face, counted towards north-east.
    pub x: u32,
    /// Row of the quad in the face, counted towards north-west.
    pub y: u32,
}

/// Splits the NESTED index `ipix` of a quad of `order` into face, column and row.
///
/// ```
/// use hemilux_core::healpix::{FaceCell, join, split};
///
/// let cell = split(1, 6);
/// assert_eq!(cell, FaceCell { face: 1, x: 0, y: 1 });
/// assert_eq!(join(1, cell), 6);
/// ```
#[must_use]
pub fn split(order: u8, ipix: u32) -> FaceCell {
    let inner = ipix & ((1 << inner_bits(order)) - 1);
    FaceCell { face: ipix >> inner_bits(order), x: even_bits(inner), y: even_bits(inner >> 1) }
}

/// Returns the NESTED index of the quad of `order` at `cell`: the inverse of [`split`].
#[must_use]
pub fn join(order: u8, cell: FaceCell) -> u32 {
    (cell.face << inner_bits(order)) | spread_bits(cell.x) | (spread_bits(cell.y) << 1)
}

/// Returns the index of the quad of `order` that contains the unit vector `direction`.
#[must_use]
pub fn ipix(order: u8, direction: DVec3) -> u32 {
    let order = Order::saturating(order).0;
    let nside = f64::from(side(order));
    let last = side(order) - 1;
    let z = direction.z;
    let za = libm::fabs(z);
    let phi = libm::atan2(direction.y, direction.x);
    // Quarter turns in 0..4.
    let turns = libm::fmod(phi / FRAC_PI_2 + 4.0, 4.0);
    let cell = |v: f64| (v as u32).min(last);
    if za <= 2.0 / 3.0 {
        // In the equatorial belt, the ascending and the descending edge lines are counted.
        let descending = (nside * (0.5 + turns - 0.75 * z)) as u32;
        let ascending = (nside * (0.5 + turns + 0.75 * z)) as u32;
        let (fd, fa) = (descending >> order, ascending >> order);
        let face = match fd.cmp(&fa) {
            core::cmp::Ordering::Equal => (fd & 3) | 4,
            core::cmp::Ordering::Less => fd & 3,
            core::cmp::Ordering::Greater => (fa & 3) + 8,
        };
        return join(order, FaceCell { face, x: ascending & last, y: last - (descending & last) });
    }
    let quarter = (turns as u32).min(3);
    let within = turns - f64::from(quarter);
    // sqrt(3 (1 - |z|)) in a form that is exact near the poles.
    let sin_theta2 = direction.x * direction.x + direction.y * direction.y;
    let ring = nside * libm::sqrt(3.0 * sin_theta2 / (1.0 + za));
    let (down, up) = (cell(within * ring), cell((1.0 - within) * ring));
    let cell = if z > 0.0 {
        FaceCell { face: quarter, x: last - up, y: last - down }
    } else {
        FaceCell { face: quarter + 8, x: down, y: up }
    };
    join(order, cell)
}

/// Returns the unit vector to a point of quad `ipix`: (`x`, `y`) are its coordinates along the column and row axis, 0..=1; (1/2, 1/2) is
/// the centre.
#[must_use]
pub fn point(order: u8, ipix: u32, x: f64, y: f64) -> DVec3 {
    let FaceCell { face, x: column, y: row } = split(order, ipix);
    let nside = f64::from(side(order));
    let (u, v) = ((f64::from(column) + x) / nside, (f64::from(row) + y) / nside);
    let circle = Circle::new(face, u + v);
    let phi = circle.phi(face, u - v);
    DVec3::new(circle.sin_theta * libm::cos(phi), circle.sin_theta * libm::sin(phi), circle.z)
}

/// A circle of latitude within a base face: the points whose face coordinates have equal sums.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Circle {
    /// z coordinate of the circle on the unit sphere.
    pub(crate) z: f64,
    /// Distance of the circle from the z axis.
    pub(crate) sin_theta: f64,
    /// Half the length of the circle's arc within a face, as a fraction of the face's half diagonal.
    half: f64,
}

impl Circle {
    /// Returns the circle on which the face coordinates u and v, both 0..=1, of `face` add up to `sum`.
    pub(crate) fn new(face: u32, sum: f64) -> Self {
        // Ring coordinate from the north pole, in units of the face's diagonal.
        let ring = f64::from(2 + face / 4) - sum;
        let (half, z, sin_theta2) = if ring < 1.0 {
            let cap = ring * ring / 3.0;
            (ring, 1.0 - cap, cap * (2.0 - cap))
        } else if ring > 3.0 {
            let n = 4.0 - ring;
            let cap = n * n / 3.0;
            (n, cap - 1.0, cap * (2.0 - cap))
        } else {
            let z = (2.0 - ring) * 2.0 / 3.0;
            (1.0, z, 1.0 - z * z)
        };
        Self { z, sin_theta: libm::sqrt(sin_theta2), half }
    }

    /// Returns the azimuth, radians, of the circle's point in `face` with u - v = `difference`.
    pub(crate) fn phi(&self, face: u32, difference: f64) -> f64 {
        let offset = match face {
            0..=3 | 8..=11 => 2 * (face & 3) + 1,
            _ => 2 * (face & 3),
        };
        if self.half > 0.0 { FRAC_PI_4 * (f64::from(offset) + difference / self.half) } else { 0.0 }
    }
}

/// Returns the unit vector to the centre of quad `ipix`.
#[must_use]
pub fn centre(order: u8, ipix: u32) -> DVec3 {
    point(order, ipix, 0.5, 0.5)
}

/// Compacts the even bits of `v` into the lower 16 bits.
fn even_bits(v: u32) -> u32 {
    let v = v & 0x5555_5555;
    let v = (v | (v >> 1)) & 0x3333_3333;
    let v = (v | (v >> 2)) & 0x0f0f_0f0f;
    let v = (v | (v >> 4)) & 0x00ff_00ff;
    (v | (v >> 8)) & 0x0000_ffff
}

/// Spreads the lower 16 bits of `v` to the even bits; the inverse of [`even_bits`].
fn spread_bits(v: u32) -> u32 {
    let v = v & 0x0000_ffff;
    let v = (v | (v << 8)) & 0x00ff_00ff;
    let v = (v | (v << 4)) & 0x0f0f_0f0f;
    let v = (v | (v << 2)) & 0x3333_3333;
    (v | (v << 1)) & 0x5555_5555
}
