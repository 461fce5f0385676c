//! The results of a frame, and their checks.

use crate::scene::{LAMP, Taken};
use hemilux_core::wire::LightSet;
use hemilux_core::{BadOrder, FrontError, LayoutError, LensError, Light, Sizes, TooSmall, color};

/// The reason why a frame has no lights, or wrong lights.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(target_os = "none", derive(defmt::Format))]
pub enum Wrong {
    /// The camera, the front end or the frames caused an error.
    Front(FrontError),
    /// A buffer of the program is too short.
    Memory(TooSmall),
    /// The writer of the output returned an error.
    Output,
    /// A check failed: the checked quantity, its value and its largest permitted value.
    Check(&'static str, f32, f32),
}

macro_rules! from {
    ($($error:ident),*) => {
        $(impl From<$error> for Wrong {
            fn from(e: $error) -> Self {
                Self::Front(e.into())
            }
        })*
    };
}
from!(FrontError, LensError, LayoutError, BadOrder);

impl From<TooSmall> for Wrong {
    fn from(e: TooSmall) -> Self {
        Self::Memory(e)
    }
}

/// Results of the decomposition of one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Report {
    /// Energy and hash of the rendered frames.
    pub taken: Taken,
    /// Number of lights of the frame.
    pub lights: usize,
    /// Sum of the irradiances of the lights, red, green and blue.
    pub energy: [f32; 3],
    /// Energy of the map, red, green and blue.
    pub map: [f32; 3],
    /// Largest difference from 1 of the length of a light's direction.
    pub length: f32,
    /// Angle between the brightest light and the lamp, degrees.
    pub lamp_deg: f32,
    /// Fraction of the hemisphere's solid angle in which the shortest exposure is clipped, 0..=1.
    pub clipped: f32,
    /// Numbers of elements of the front end's buffers.
    pub sizes: Sizes,
    /// Readings of the clock before the front end, and after front end, pyramid, sampler and encoding.
    pub ticks: [u32; 5],
}

impl Report {
    pub(crate) fn of(set: &LightSet<'_>, sizes: Sizes, ticks: [u32; 5]) -> Self {
        let mut energy = [0.0; 3];
        set.lights.iter().for_each(|l| color::add(&mut energy, l.irradiance));
        let length = |l: &Light| (l.direction.length() - 1.0).abs();
        let y = |l: &Light| color::luminance(l.irradiance);
        let brightest = set.lights.iter().max_by(|a, b| y(a).total_cmp(&y(b)));
        Self {
            taken: Taken::default(),
            lights: set.lights.len(),
            energy,
            map: set.scalar_flux,
            length: set.lights.iter().map(length).fold(0.0, f32::max),
            lamp_deg: brightest.map_or(180.0, |l| l.direction.angle_between(LAMP).to_degrees()),
            clipped: set.clipped,
            sizes,
            ticks,
        }
    }

    /// Checks that the lights are those of the scene.
    ///
    /// # Errors
    /// [`Wrong::Check`] with the first check that failed.
    pub fn check(&self) -> Result<(), Wrong> {
        let off = |a: [f32; 3], b: [f32; 3]| {
            a.iter()
                .zip(b)
                .map(|(a, b)| (a - b).abs() / b)
                .fold(0.0, |most: f32, v| if v <= most { most } else { v })
        };
        // The tree has 256 leaves with one light each, minus up to two that a split on the horizon cannot use.
        let missing = crate::LIGHTS.abs_diff(self.lights) as f32;
        let checks = [
            ("lights missing", missing, 2.0),
            ("energy of the lights against the map's, ratio", off(self.energy, self.map), 1e-5),
            // The noise adds half a code on average, which matters in dark pixels.
            ("energy of the map against the scene's, ratio", off(self.map, self.taken.energy), 0.01),
            ("length of a direction", self.length, 1e-6),
            ("from the brightest light to the lamp, degrees", self.lamp_deg, 4.0),
            ("clipped share", self.clipped, 0.0),
        ];
        match checks.into_iter().find(|(_, found, most)| found.is_nan() || found > most) {
            Some((what, found, most)) => Err(Wrong::Check(what, found, most)),
            None => Ok(()),
        }
    }
}
