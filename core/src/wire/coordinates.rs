//! Coordinate systems of rendering engines, converted from the probe's axes (x, y, z).

use crate::light::Sh9;
use glam::Vec3;

/// A coordinate system of the wire formats. `Probe` has the axes of this crate: +Z is the lens axis, +X the image columns, +Y the image
/// rows.
///
/// ```
/// use glam::Vec3;
/// use hemilux_core::wire::Coordinates;
///
/// let unity = Coordinates::from_name("unity").expect("a known name");
/// // The lens axis of a probe that points to the zenith is Unity's +Y.
/// assert_eq!(unity.direction(Vec3::Z), Vec3::Y);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Coordinates {
    /// The probe's axes (x, y, z): +Z is the lens axis. Also named `blender` and `ros`.
    #[default]
    Probe,
    /// The probe's (x, z, -y): right-handed, +Y up. Also named `gltf`, `three` and `webxr`.
    YUp,
    /// The probe's (x, z, y): left-handed, +Y up.
    Unity,
    /// The probe's (x, -y, z): left-handed, +Z up.
    Unreal,
}

/// The names of coordinate systems that requests accept, aliases included.
const NAMES: [(&str, Coordinates); 9] = [
    ("probe", Coordinates::Probe),
    ("blender", Coordinates::Probe),
    ("ros", Coordinates::Probe),
    ("y-up", Coordinates::YUp),
    ("gltf", Coordinates::YUp),
    ("three", Coordinates::YUp),
    ("webxr", Coordinates::YUp),
    ("unity", Coordinates::Unity),
    ("unreal", Coordinates::Unreal),
];

impl Coordinates {
    /// Returns the coordinate system with the given name or alias; `None` for an unknown name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        NAMES.iter().find(|(n, _)| *n == name).map(|(_, c)| *c)
    }

    /// Returns all names of coordinate systems, aliases included.
    pub fn names() -> impl Iterator<Item = &'static str> {
        NAMES.iter().map(|(n, _)| *n)
    }

    /// Returns the name of the coordinate system in light sets.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Probe => "probe",
            Self::YUp => "y-up",
            Self::Unity => "unity",
            Self::Unreal => "unreal",
        }
    }

    /// Converts the unit vector `d` from the probe's axes to these coordinates.
    #[must_use]
    pub fn direction(self, d: Vec3) -> Vec3 {
        match self {
            Self::Probe => d,
            Self::YUp => Vec3::new(d.x, d.z, -d.y),
            Self::Unity => Vec3::new(d.x, d.z, d.y),
            Self::Unreal => Vec3::new(d.x, -d.y, d.z),
        }
    }

    /// Converts the coefficients `c` of spherical harmonics from the probe's axes to these coordinates.
    ///
    /// If the probe's coordinates (x, y, z) are written as functions of these coordinates (X, Y, Z), each basis polynomial xy, yz, 3z^2 - 1, xz,
    /// x^2 - y^2 becomes a linear combination of the same polynomials in (X, Y, Z); for `y-up`: x = X, y = -Z, z = Y.
    #[must_use]
    pub fn harmonics(self, c: &Sh9) -> Sh9 {
        match self {
            Self::Probe => *c,
            Self::Unreal => mirror_y(c),
            Self::Unity => swap_y_z(c),
            Self::YUp => mirror_z(&swap_y_z(c)),
        }
    }
}

/// Returns the harmonics `c` after the substitution of -y for y.
fn mirror_y(c: &Sh9) -> Sh9 {
    negated(c, [1, 4, 5])
}

/// Returns the harmonics `c` after the substitution of -z for z.
fn mirror_z(c: &Sh9) -> Sh9 {
    negated(c, [2, 5, 7])
}

/// Returns the harmonics `c` with the coefficients of the three indices `which` negated.
fn negated(c: &Sh9, which: [usize; 3]) -> Sh9 {
    core::array::from_fn(|i| if which.contains(&i) { c[i].map(|v| -v) } else { c[i] })
}

/// Returns the harmonics `c` after the exchange of y and z: xy and xz are exchanged; 3z^2 - 1 and x^2 - y^2 are mixed.
///
/// With A = (3z^2 - 1)/2 and B = sqrt(3)/2 (x^2 - y^2) as the (equally normalised) pair, (3y^2 - 1)/2 = -A/2 - sqrt(3)/2 B and sqrt(3)/2
/// (x^2 - z^2) = -sqrt(3)/2 A + B/2.
fn swap_y_z(c: &Sh9) -> Sh9 {
    let half = 0.5;
    let root = 0.866_025_4;
    let a: [f32; 3] = core::array::from_fn(|k| -half * c[6][k] - root * c[8][k]);
    let b: [f32; 3] = core::array::from_fn(|k| -root * c[6][k] + half * c[8][k]);
    [c[0], c[2], c[1], c[3], c[7], c[5], a, c[4], b]
}
