//! The scene: a sky, a window and a lamp through an equidistant fisheye lens, with the sensor's noise.

use crate::memory::SIDE;
use core::f64::consts::FRAC_PI_2;
use glam::{DVec2, DVec3, Vec3};
use hemilux_core::Exposure;
use hemilux_core::color;
use hemilux_core::lens::{Intrinsics, Lens, Model};

/// A fisheye lens whose image circle of 180 degrees has the diameter of the image.
pub const LENS: Intrinsics = Intrinsics {
    model: Model::Equidistant,
    centre_px: DVec2::splat((SIDE as f64 - 1.0) / 2.0),
    focal_px: DVec2::splat((SIDE as f64 / 2.0 - 0.5) / FRAC_PI_2),
    skew_px: 0.0,
    max_theta: FRAC_PI_2,
    vignetting: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
};

/// Sensor code of a pixel without light.
pub const BLACK: f64 = 8.0;
/// Sensor code of a saturated pixel.
pub const WHITE: f64 = 255.0;

/// Radiance of full scale in the shortest exposure of the burst: 1.25 times the radiance of the lamp.
const FULL: f64 = 50.0;

/// Exposures of a burst: 1, 8 and 64 ms.
pub const EXPOSURES: [Exposure; 3] = [exposure(0.001), exposure(0.008), exposure(0.064)];

/// Radiance that gives relative exposure 1 in one second.
pub const SCALE: f64 = FULL * EXPOSURES[0].seconds;

const fn exposure(seconds: f64) -> Exposure {
    Exposure { seconds, gain: 1.0 }
}

/// Unit vector towards the lamp: 60 degrees up.
pub const LAMP: Vec3 = Vec3::new(0.433_012_7, 0.25, 0.866_025_4);

/// Cosine of the lamp's angular radius of 4 degrees, and its radiance.
const LAMP_COS: f64 = 0.997_564_05;
const LAMP_RGB: [f32; 3] = [40.0, 30.0, 18.0];

/// Unit vector towards the window, 35 degrees up; cosine of its angular radius of 12 degrees, and its radiance.
const WINDOW: DVec3 = DVec3::new(-0.769_751_1, -0.280_166_5, 0.573_576_44);
const WINDOW_COS: f64 = 0.978_147_6;
const WINDOW_RGB: [f32; 3] = [3.0, 3.2, 3.5];

/// Radiance of the sky at the horizon and at the zenith.
const HORIZON: [f32; 3] = [0.30, 0.35, 0.45];
const ZENITH: [f32; 3] = [0.15, 0.25, 0.55];

/// Returns the radiance of the scene from `direction`, red, green and blue.
fn radiance(direction: DVec3) -> [f32; 3] {
    if direction.dot(LAMP.as_dvec3()) > LAMP_COS {
        return LAMP_RGB;
    }
    if direction.dot(WINDOW) > WINDOW_COS {
        return WINDOW_RGB;
    }
    let up = direction.z as f32;
    core::array::from_fn(|c| HORIZON[c] + up * (ZENITH[c] - HORIZON[c]))
}

/// The energy and a hash of a burst that [`expose`] rendered.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Taken {
    /// Sum of radiance times solid angle over the pixels above the horizon.
    pub energy: [f32; 3],
    /// FNV-1a hash of all frames, equal on every machine.
    pub hash: u32,
}

/// Renders the burst to frames of red, green and blue bytes.
pub fn expose<const N: usize>(lens: &Lens, frames: &mut [[u8; N]]) -> Taken {
    let mut energy = [0.0; 3];
    let mut noise = Noise(0x9e37_79b9);
    for at in 0..SIDE * SIDE {
        let pixel = DVec2::new(f64::from(at % SIDE), f64::from(at / SIDE));
        let direction = lens.unproject(pixel);
        let rgb = direction.map_or([0.0; 3], radiance);
        if direction.is_some_and(|d| d.z > 0.0) {
            color::add(&mut energy, color::scaled(rgb, lens.solid_angle(pixel).unwrap_or(0.0) as f32));
        }
        for (frame, exposure) in frames.iter_mut().zip(EXPOSURES) {
            let own = frame.as_chunks_mut::<3>().0.get_mut(at as usize);
            own.into_iter().flatten().zip(rgb).for_each(|(code, v)| *code = noise.code(v, exposure.seconds));
        }
    }
    let hash =
        frames.iter().flatten().fold(0x811c_9dc5, |h, b| (h ^ u32::from(*b)).wrapping_mul(0x0100_0193));
    Taken { energy, hash }
}

/// The random number generator xorshift, \[Marsaglia2003\].
struct Noise(u32);

impl Noise {
    /// Returns the code of the sensor for `radiance` in an exposure of `seconds`, with noise of up to one code.
    fn code(&mut self, radiance: f32, seconds: f64) -> u8 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 17;
        self.0 ^= self.0 << 5;
        let noise = self.0 as f32 / 4_294_967_296.0;
        let range = ((WHITE - BLACK) * seconds / SCALE) as f32;
        // The code is rounded down, so noise from 0 to 1 rounds on average.
        (radiance * range + BLACK as f32 + noise) as u8
    }
}
