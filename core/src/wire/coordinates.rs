//! Axes that engines expect, from the probe's (x, y, z).

use crate::light::Sh9;
use glam::Vec3;

/// Named axes of the wire formats.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Coordinates {
    /// (x, y, z): +Z the lens axis. Also `blender` and `ros`.
    #[default]
    Probe,
    /// (x, z, -y): right-handed, +Y up. Also `gltf`, `three` and `webxr`.
    YUp,
    /// (x, z, y): left-handed, +Y up.
    Unity,
    /// (x, -y, z): left-handed, +Z up.
    Unreal,
}

/// The names a request may use, with what they mean.
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
    /// The axes called `name`.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        NAMES.iter().find(|(n, _)| *n == name).map(|(_, c)| *c)
    }

    /// Every name, aliases included.
    pub fn names() -> impl Iterator<Item = &'static str> {
        NAMES.iter().map(|(n, _)| *n)
    }

    /// Its name on the wire.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Probe => "probe",
            Self::YUp => "y-up",
            Self::Unity => "unity",
            Self::Unreal => "unreal",
        }
    }

    /// A direction in the probe's axes, in these.
    #[must_use]
    pub fn direction(self, d: Vec3) -> Vec3 {
        match self {
            Self::Probe => d,
            Self::YUp => Vec3::new(d.x, d.z, -d.y),
            Self::Unity => Vec3::new(d.x, d.z, d.y),
            Self::Unreal => Vec3::new(d.x, -d.y, d.z),
        }
    }

    /// Harmonics in the probe's axes, in these.
    ///
    /// With old axes (x, y, z) written in new ones (X, Y, Z), each basis polynomial xy, yz, 3z^2 - 1, xz, x^2 - y^2 becomes a sum
    /// of the new ones; for `y-up`: x = X, y = -Z, z = Y.
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

/// y becomes -y.
fn mirror_y(c: &Sh9) -> Sh9 {
    negated(c, [1, 4, 5])
}

/// z becomes -z.
fn mirror_z(c: &Sh9) -> Sh9 {
    negated(c, [2, 5, 7])
}

fn negated(c: &Sh9, which: [usize; 3]) -> Sh9 {
    core::array::from_fn(|i| if which.contains(&i) { c[i].map(|v| -v) } else { c[i] })
}

/// y and z change places: xy <-> xz, and 3z^2 - 1 and x^2 - y^2 mix.
///
/// With A = (3z^2 - 1)/2 and B = sqrt(3)/2 (x^2 - y^2) as the (equally normalised) pair, (3y^2 - 1)/2 = -A/2 - sqrt(3)/2 B and
/// sqrt(3)/2 (x^2 - z^2) = -sqrt(3)/2 A + B/2.
fn swap_y_z(c: &Sh9) -> Sh9 {
    let half = 0.5;
    let root = 0.866_025_4;
    let a: [f32; 3] = core::array::from_fn(|k| -half * c[6][k] - root * c[8][k]);
    let b: [f32; 3] = core::array::from_fn(|k| -root * c[6][k] + half * c[8][k]);
    [c[0], c[2], c[1], c[3], c[7], c[5], a, c[4], b]
}
