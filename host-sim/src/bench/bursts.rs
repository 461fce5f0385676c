//! Bursts for benchmarks: simulated frames of a built-in scene through an equidistant lens, in any size and format.

use super::case::Case;
use super::pack::pack;
use glam::DVec2;
use hemilux::calibration::{Burst, Calibration, Frame, Pixels};
use hemilux::scene::{self, Scene};
use hemilux_core::Exposure;
use hemilux_core::format::Format;
use hemilux_core::lens::{Intrinsics, Lens, Model};
use hemilux_core::{Levels, Response};
use std::f64::consts::PI;

/// Number of bursts that are processed in rotation; together they exceed a second-level cache.
pub const BURSTS: usize = 8;

/// Exposure times of \[Nikodym2012\], seconds.
const SECONDS: [f64; 3] = crate::burst::THESIS_EXPOSURES_S;

/// Radiance that reaches the largest code in the shortest exposure; it is above the radiance of every built-in scene.
const FULL: f64 = 60.0;

/// Ratio of the focal length to the image width of the lens in benchmarks.
const FOCAL: f64 = 196.4 / 640.0;

/// Returns the calibration of the camera of `case`: formats of luma and chroma have the sRGB response, all others a linear response.
#[must_use]
pub fn calibration(case: &Case) -> Calibration {
    let (width, height) = case.size;
    let centre = |n: u32| (f64::from(n) - 1.0) / 2.0;
    let lens = Lens::try_new(Intrinsics {
        model: Model::Equidistant,
        centre_px: DVec2::new(centre(width), centre(height)),
        focal_px: DVec2::splat(FOCAL * f64::from(width)),
        skew_px: 0.0,
        max_theta: 80f64.to_radians(),
        vignetting: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    });
    let gamma = matches!(case.format, Format::Yuyv(_) | Format::Nv12(_));
    let white = f64::from(case.format.max_code());
    let lens = lens.expect("the intrinsics are legal");
    let mut calibration = Calibration::try_new(lens, case.format, width, height)
        .expect("the case's size is legal for its format");
    calibration.layout =
        calibration.layout.binned(case.bin).expect("the case's bin is legal for its format and size");
    calibration.response = if gamma { Response::Srgb } else { Response::Linear };
    calibration.levels = Levels { black: if gamma { 0.0 } else { (white / 32.0).round() }, white };
    calibration.scale = FULL * SECONDS[0];
    calibration
}

/// Returns [`BURSTS`] bursts of the scene `room` at intervals of a tenth of a second; the bytes are the same in every run.
#[must_use]
pub fn make(case: &Case) -> Vec<Burst> {
    make_of(case, scene::by_name("room").expect("a built-in scene"), BURSTS)
}

/// Interval of bursts, nanoseconds: three exposures at 28.2 frames per second. Successive bursts record [`BURSTS`] phases of a lamp of 100 Hz.
const INTERVAL_NS: u64 = 106_250_000;

/// Frequency and depth of the light of cases with [`Case::mains`].
const LAMP_HZ: f64 = 100.0;
const LAMP_DEPTH: f64 = 0.4;

/// Returns the mean light of a lamp in frame `frame` of an exposure of `seconds`, relative to the mean over a period; frames are counted from the
/// first of all bursts.
fn light(frame: usize, seconds: f64) -> f64 {
    let end = (1.0 + frame as f64 / SECONDS.len() as f64) * INTERVAL_NS as f64 * 1e-9;
    let half = PI * LAMP_HZ * seconds;
    1.0 + LAMP_DEPTH * half.sin() / half * (2.0 * PI * LAMP_HZ * end - half).cos()
}

/// Returns the burst for frame `frame`, in rotation, with the capture time of that frame.
pub fn timed(bursts: &mut [Burst], frame: usize) -> &Burst {
    let burst = &mut bursts[frame % BURSTS];
    burst.phase_ns = (frame as u64 + 1) * INTERVAL_NS;
    burst
}

/// Returns `count` bursts of `scene`, which moves by a tenth of a second from burst to burst, or flickers in cases with
/// [`Case::mains`]; capture times follow at intervals of 106.25 ms. The bytes are the same in
/// every run.
#[must_use]
pub fn make_of(case: &Case, scene: Scene, count: usize) -> Vec<Burst> {
    let c = calibration(case);
    let directions: Vec<_> = (0..c.layout.width() * c.layout.height())
        .map(|i| {
            c.lens.unproject(DVec2::new(f64::from(i % c.layout.width()), f64::from(i / c.layout.width())))
        })
        .map(|d| d.map(|d| d.as_vec3().to_array()))
        .collect();
    let still: Vec<_> = directions.iter().map(|d| d.map_or([0.0; 3], |d| scene.still(d))).collect();
    let burst = |n: usize| {
        let light = |frame, seconds| if case.mains { light(frame, seconds) } else { 1.0 };
        let patches = scene.patches(if case.mains { 0.0 } else { 0.1 * n as f32 });
        let over = |(rgb, d): (&[f32; 3], &Option<[f32; 3]>)| match d {
            Some(d) => patches.as_slice().iter().fold(*rgb, |behind, p| p.over(behind, *d)),
            None => *rgb,
        };
        let image: Vec<_> = still.iter().zip(&directions).map(over).collect();
        let frame = |(i, seconds): (usize, f64)| {
            let frame = n * SECONDS.len() + i;
            let codes = expose(&c, &image, seconds * light(frame, seconds), frame as u32);
            let pixels = Pixels::U8(pack(case.format, c.layout.width() as usize, &codes));
            Frame { exposure: Exposure { seconds, gain: 1.0 }, pixels }
        };
        let frames = SECONDS.into_iter().enumerate().map(frame).collect();
        Burst { frames, phase_ns: (n as u64 + 1) * INTERVAL_NS, ..Burst::default() }
    };
    (0..count).map(burst).collect()
}

/// Returns the RGB codes of an exposure of `seconds` to the radiance `image`, with read and photon noise whose seed is `seed`.
fn expose(c: &Calibration, image: &[[f32; 3]], seconds: f64, seed: u32) -> Vec<[u16; 3]> {
    let (gain, range) = ((seconds / c.scale) as f32, (c.levels.white - c.levels.black) as f32);
    let gamma = c.response != Response::Linear;
    let mut state = seed.wrapping_mul(0x9e37_79b9) | 1;
    let mut noise = || {
        // Random generator: Xorshift, \[Marsaglia2003\].
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        state as f32 / 4_294_967_296.0 - 0.5
    };
    let mut code = |radiance: f32| {
        let y = radiance * gain;
        let y = (y + noise() * (0.03 * y.max(0.0).sqrt() + 0.004)).max(0.0);
        let x = if gamma { srgb(y.min(1.0)) } else { y };
        (x * range + c.levels.black as f32 + 0.5).clamp(0.0, c.levels.white as f32) as u16
    };
    image.iter().map(|rgb| rgb.map(&mut code)).collect()
}

/// Returns the sRGB code (IEC 61966-2-1) of a linear value.
fn srgb(y: f32) -> f32 {
    if y <= 0.003_130_8 { 12.92 * y } else { 1.055 * y.powf(1.0 / 2.4) - 0.055 }
}
