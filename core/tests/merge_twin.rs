//! The merge against an `f64` twin with the same weights, written from the rules in the module docs.

mod common;

use common::{RngExt, off, seeded};
use hemilux_core::arena::TooSmall;
use hemilux_core::merge::{Exposure, MAX_EXPOSURES, Merge, MergeError, Radiance, Samples, reciprocals_len};
use hemilux_core::response::{Curve, Depth, Response, SATURATED, TRUSTED, curve_len};

/// A sensor as the twin knows it.
struct Sensor {
    response: Response,
    depth: Depth,
    black: f64,
    white: f64,
}

/// A response near gamma 2.2 whose channels differ, normalised to 1 at white.
fn polynomial() -> Response {
    Response::Polynomial([
        [0.2, 0.1, 0.65, 0.05, 0.0],
        [0.1, 0.2, 0.64, 0.06, 0.0],
        [0.3, 0.0, 0.63, 0.07, 0.0],
    ])
}

impl Sensor {
    fn code(&self, z: u32) -> f64 {
        (f64::from(z) - self.black) / (self.white - self.black)
    }

    /// y(x), from `formats.md` and IEC 61966-2-1.
    fn exposure(&self, channel: usize, z: u32) -> f64 {
        let x = self.code(z).min(1.0);
        match &self.response {
            Response::Linear => x,
            Response::Srgb if x <= 0.04045 => x.max(0.0) / 12.92,
            Response::Srgb => ((x + 0.055) / 1.055).powf(2.4),
            Response::Polynomial(c) => (0..5).map(|i| c[channel][i] * x.max(0.0).powi(4 - i as i32)).sum(),
        }
    }

    /// The code nearest to relative exposure `y`: the inverse of [`Sensor::exposure`] by bisection.
    fn expose(&self, channel: usize, y: f64) -> u32 {
        let (mut low, mut high) = (self.black.ceil() as u32, self.white as u32);
        while high - low > 1 {
            let middle = u32::midpoint(low, high);
            if self.exposure(channel, middle) <= y { low = middle } else { high = middle }
        }
        let nearer = y - self.exposure(channel, low) > self.exposure(channel, high) - y;
        if nearer { high } else { low }
    }

    /// Radiance of one channel in relative exposure per second and gain 1, and whether it is clipped.
    fn merge(&self, channel: usize, codes: &[u32], exposures: &[Exposure]) -> (f64, bool) {
        let linear = self.response == Response::Linear;
        let (mut sum, mut time, mut fallback) = (0.0, 0.0, None);
        for (&z, e) in codes.iter().zip(exposures).filter(|(z, _)| self.code(**z) < SATURATED) {
            let y = self.exposure(channel, z) / e.gain;
            fallback = Some(y / e.seconds);
            if linear || self.code(z) >= TRUSTED {
                sum += y;
                time += e.seconds;
            }
        }
        let shortest = self.exposure(channel, codes[0]) / exposures[0].gain / exposures[0].seconds;
        match fallback {
            _ if time > 0.0 => (sum / time, false),
            Some(radiance) => (radiance, false),
            None => (shortest, true),
        }
    }

    fn product(&self, exposures: &[Exposure]) -> Merge<Vec<i32>, Vec<u32>> {
        let table = vec![0; curve_len(self.depth)];
        let curve = Curve::try_new(&self.response, self.depth, self.black, self.white, table).expect("sound");
        let reciprocals = vec![0; reciprocals_len(exposures.len())];
        Merge::try_new(curve, exposures, 1.0, reciprocals).expect("sound exposures")
    }

    /// Merges pixels given as codes\[pixel\]\[channel\]\[exposure\].
    fn run(&self, pixels: &[[Vec<u32>; 3]], exposures: &[Exposure]) -> (Vec<Radiance>, f64) {
        let merge = self.product(exposures);
        let frames: Vec<Vec<u16>> = (0..exposures.len())
            .map(|i| pixels.iter().flatten().map(|codes| codes[i] as u16).collect())
            .collect();
        let bytes: Vec<Vec<u8>> = frames.iter().map(|f| f.iter().map(|v| *v as u8).collect()).collect();
        let samples: Vec<_> = match self.depth {
            Depth::U8 => bytes.iter().map(|f| Samples::U8(f)).collect(),
            Depth::U16 => frames.iter().map(|f| Samples::U16(f)).collect(),
        };
        let mut out = vec![Radiance::default(); pixels.len()];
        merge.merge_into(&samples, 0, &mut out);
        (out, merge.unit())
    }
}

fn sensors() -> [Sensor; 5] {
    let eight = |response| Sensor { response, depth: Depth::U8, black: 0.0, white: 255.0 };
    [
        eight(polynomial()),
        eight(Response::Srgb),
        eight(Response::Linear),
        Sensor { response: Response::Linear, depth: Depth::U16, black: 256.0, white: 4095.0 },
        Sensor { response: Response::Srgb, depth: Depth::U16, black: 0.0, white: 65535.0 },
    ]
}

fn times(seconds: &[f64]) -> Vec<Exposure> {
    seconds.iter().map(|s| Exposure { seconds: *s, gain: 1.0 }).collect()
}

/// Codes of every exposure of radiances that span seven decades, each channel on its own.
fn decades(sensor: &Sensor, exposures: &[Exposure], pixels: usize) -> Vec<[Vec<u32>; 3]> {
    let mut rng = seeded(3);
    let brightest = 1.0 / (exposures[0].seconds * exposures[0].gain);
    (0..pixels)
        .map(|_| {
            core::array::from_fn(|channel| {
                let radiance = brightest * 10f64.powf(rng.random_range(-7.0..0.0));
                let code = |e: &Exposure| sensor.expose(channel, radiance * e.seconds * e.gain);
                exposures.iter().map(code).collect()
            })
        })
        .collect()
}

/// RMS relative difference from the twin, over samples that it sees lit.
fn rms(sensor: &Sensor, exposures: &[Exposure]) -> f64 {
    let pixels = decades(sensor, exposures, 30_000);
    let (out, unit) = sensor.run(&pixels, exposures);
    let (mut sum, mut count) = (0.0, 0.0);
    for (codes, radiance) in pixels.iter().zip(&out) {
        let mut any_clipped = false;
        for (channel, (codes, found)) in codes.iter().zip(radiance.rgb).enumerate() {
            let (expected, clipped) = sensor.merge(channel, codes, exposures);
            any_clipped |= clipped;
            if expected > 0.0 {
                sum += off(f64::from(found) * unit, expected).powi(2);
                count += 1.0;
            }
        }
        assert_eq!(radiance.clipped == 1, any_clipped, "{codes:?}");
    }
    assert!(count > 20_000.0, "most samples are lit: {count}");
    f64::sqrt(sum / count)
}

#[test]
fn seven_decades_agree_with_the_twin() {
    let bursts = [
        times(&[1e-5, 1e-3, 1e-1, 10.0]),
        times(&[0.000_926, 0.005_555, 0.033_333]),
        times(&[1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0]),
        times(&[1e-4]),
        [(1e-4, 1.0), (1e-2, 1.0), (1e-2, 4.0), (1e-1, 16.0)]
            .map(|(seconds, gain)| Exposure { seconds, gain })
            .to_vec(),
        (0..12).map(|i| Exposure { seconds: 1e-5 * f64::from(3u32.pow(i)), gain: 2.0 }).collect(),
    ];
    let mut worst = 0.0f64;
    for sensor in sensors() {
        for exposures in &bursts {
            let found = rms(&sensor, exposures);
            assert!(found < 1e-3, "{:?} {exposures:?}: {found}", sensor.response);
            worst = worst.max(found);
        }
    }
    println!("worst RMS {worst:.1e}");
}

#[test]
fn a_pixel_that_clips_everywhere_keeps_its_clip_value_and_its_flag() {
    let exposures = times(&[1e-3, 1e-2, 1e-1]);
    for sensor in sensors() {
        let white = sensor.white as u32;
        let (out, unit) = sensor.run(&[[vec![white; 3], vec![white; 3], vec![white; 3]]], &exposures);
        for value in out[0].rgb {
            assert!(
                off(f64::from(value) * unit, 1e3) < 1e-3,
                "{:?}: {}",
                sensor.response,
                f64::from(value) * unit
            );
        }
        assert_eq!(out[0].clipped, 1);
    }
}

#[test]
fn each_channel_has_its_own_mask() {
    let exposures = times(&[1e-3, 1e-2]);
    let sensor = &sensors()[2];
    // Red clips in the long exposure, green in none, blue in both.
    let pixel = [vec![100, 255], vec![10, 102], vec![255, 255]];
    let (out, unit) = sensor.run(&[pixel], &exposures);
    let found = out[0].rgb.map(|v| f64::from(v) * unit);
    let expected = [100.0 / 255.0 / 1e-3, 112.0 / 255.0 / 11e-3, 1e3];
    for (f, e) in found.iter().zip(expected) {
        assert!(off(*f, e) < 1e-6, "{found:?} {expected:?}");
    }
    assert_eq!(out[0].clipped, 1);
}

#[test]
fn noise_round_black_keeps_its_mean() {
    let sensor = Sensor { response: Response::Linear, depth: Depth::U16, black: 256.0, white: 4095.0 };
    let exposures = times(&[1e-3, 1e-2, 1e-1]);
    let mut rng = seeded(9);
    // A sum of twelve uniforms less six is near normal; sigma 5 codes round 0.3 codes of light in the longest exposure.
    let mut noisy = |light: f64| {
        let noise: f64 = (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
        (256.0 + light + 5.0 * noise).round().max(0.0) as u32
    };
    let n = 200_000;
    let pixels: Vec<_> =
        (0..n).map(|_| core::array::from_fn(|_| vec![noisy(0.003), noisy(0.03), noisy(0.3)])).collect();
    let (out, unit) = sensor.run(&pixels, &exposures);
    let mean = out.iter().flat_map(|r| r.rgb).map(f64::from).sum::<f64>() * unit / f64::from(3 * n);
    let code = 1.0 / 3839.0;
    let expected = 0.333 * code / 0.111;
    let sigma = 5.0 * f64::sqrt(3.0) * code / 0.111 / f64::from(3 * n).sqrt();
    println!("mean {mean:.4e}, expected {expected:.4e}, sigma {sigma:.1e}");
    assert!((mean - expected).abs() < 4.0 * sigma, "{mean} {expected} {sigma}");
    assert!(out.iter().any(|r| r.rgb[0] < 0), "noise below black is kept");
}

#[test]
fn a_response_that_overshoots_white_is_not_cut() {
    // 1.04 at white: what a fit may give, and what the curve accepts.
    let rows = [[0.0, 0.0, 0.94, 0.1, 0.0]; 3];
    let sensor = Sensor { response: Response::Polynomial(rows), depth: Depth::U8, black: 0.0, white: 255.0 };
    let exposures = times(&[1e-3]);
    let (out, unit) = sensor.run(&[[vec![249], vec![249], vec![255]]], &exposures);
    let (expected, _) = sensor.merge(0, &[249], &exposures);
    assert!(off(f64::from(out[0].rgb[0]) * unit, expected) < 1e-6, "{expected}");
    assert!(off(f64::from(out[0].rgb[2]) * unit, 1.04e3) < 1e-6, "the clip value too");
}

#[test]
fn one_to_twelve_exposures_are_merged() {
    let curve = || Curve::try_new(&Response::Linear, Depth::U8, 0.0, 255.0, vec![0; curve_len(Depth::U8)]);
    let merge = |exposures: &[Exposure]| {
        Merge::try_new(curve().expect("sound"), exposures, 1.0, vec![0; 1 << 13]).map(|m| m.exposures())
    };
    for n in 1..=MAX_EXPOSURES {
        let seconds: Vec<f64> = (0..n).map(|i| 1e-3 * 2f64.powi(i as i32)).collect();
        assert_eq!(merge(&times(&seconds)), Ok(n));
    }
    assert_eq!(merge(&[]), Err(MergeError::BadCount { found: 0 }));
    assert_eq!(merge(&times(&[1.0; 13])), Err(MergeError::BadCount { found: 13 }));
    assert_eq!(merge(&times(&[1.0, 0.5])), Err(MergeError::NotAscending { index: 1 }));
    assert_eq!(merge(&times(&[1e-9, 1.0])), Err(MergeError::TooFarApart));
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert_eq!(merge(&times(&[bad, 1.0])), Err(MergeError::BadExposure { index: 0 }));
        let gain = [Exposure { seconds: 1.0, gain: 1.0 }, Exposure { seconds: 1.0, gain: bad }];
        assert_eq!(merge(&gain), Err(MergeError::BadExposure { index: 1 }));
    }
    let short = Merge::try_new(curve().expect("sound"), &times(&[1.0; 3]), 1.0, vec![0; 7]).map(|_| ());
    assert_eq!(short, Err(MergeError::TooSmall(TooSmall { needed: 8, lent: 7 })));
}

#[test]
fn a_scale_that_is_no_number_is_refused() {
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let curve = Curve::try_new(&Response::Linear, Depth::U8, 0.0, 255.0, vec![0; curve_len(Depth::U8)]);
        let merge = Merge::try_new(curve.expect("sound"), &times(&[1.0]), bad, vec![0; 2]).map(|_| ());
        assert_eq!(merge, Err(MergeError::BadScale), "{bad}");
    }
}

#[test]
fn no_code_of_any_frame_overflows() {
    // Black near white makes the darkest codes large negative numbers, twelve times over.
    for (depth, black, white) in
        [(Depth::U8, 200.0, 255.0), (Depth::U16, 1000.0, 1001.0), (Depth::U16, 65000.0, 65535.0)]
    {
        let sensor = Sensor { response: Response::Linear, depth, black, white };
        let exposures = times(&[1e-3; 12]);
        let pixels: Vec<_> =
            (0..=depth.max()).step_by(3).map(|z| core::array::from_fn(|_| vec![z; 12])).collect();
        let (out, _) = sensor.run(&pixels, &exposures);
        assert!(out.windows(2).all(|w| w[0].rgb[0] <= w[1].rgb[0]), "brighter codes are brighter");
    }
}

#[test]
fn frames_that_do_not_fit_are_dark_or_clipped_but_never_panic() {
    let merge = sensors()[0].product(&times(&[1e-3, 1e-2]));
    let mut out = [Radiance::default(); 4];
    merge.merge_into(&[], 0, &mut out);
    assert!(out.iter().all(|r| r.rgb == [0; 3]), "{out:?}");
    merge.merge_into(&[Samples::U8(&[255; 5]), Samples::U8(&[])], 1, &mut out);
    // Codes that this table does not have are white.
    merge.merge_into(&[Samples::U16(&[65535; 12]), Samples::U16(&[300; 12])], 0, &mut out);
    for r in out {
        assert_eq!(r.clipped, 1);
        assert!(r.rgb.iter().all(|v| off(f64::from(*v) * merge.unit(), 1e3) < 1e-3), "{r:?}");
    }
}
