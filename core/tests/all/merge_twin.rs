//! The merge equals an `f64` implementation with the same weights, written from the rules in the module's documentation.

use crate::common::{RngExt, VecMerge, merge, merged, off, seeded};
use hemilux_core::Levels;
use hemilux_core::TooSmall;
use hemilux_core::internals::merge::{Channels, Codes, Merge, Reciprocal, merge_size};
use hemilux_core::response::{Curve, SATURATED, TRUSTED, curve_len};
use hemilux_core::{Depth, Response};
use hemilux_core::{Exposure, MAX_EXPOSURES, MergeError};

/// The merged radiance of one pixel, and whether it is clipped.
#[derive(Clone, Copy, Debug)]
struct Radiance {
    rgb: [f64; 3],
    clipped: bool,
}

/// The sensor model of the `f64` implementation: depth, levels and response.
#[derive(Clone)]
struct Sensor {
    response: Response,
    depth: Depth,
    black: f64,
    white: f64,
}

/// Returns a response near gamma 2.2 whose channels differ, normalised to 1 at white.
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

    /// Returns the relative exposure y(x) of code `z`, from `board/FORMATS.md` and IEC 61966-2-1.
    fn exposure(&self, channel: usize, z: u32) -> f64 {
        let x = self.code(z).min(1.0);
        match &self.response {
            Response::Linear => x,
            Response::Srgb if x <= 0.04045 => x.max(0.0) / 12.92,
            Response::Srgb => ((x + 0.055) / 1.055).powf(2.4),
            Response::Polynomial(c) => (0..5).map(|i| c[channel][i] * x.max(0.0).powi(4 - i as i32)).sum(),
            other => panic!("no twin of {other:?}"),
        }
    }

    /// Returns the code nearest to relative exposure `y`: the inverse of [`Sensor::exposure`] by bisection.
    fn expose(&self, channel: usize, y: f64) -> u32 {
        let (mut low, mut high) = (self.black.ceil() as u32, self.white as u32);
        while high - low > 1 {
            let middle = u32::midpoint(low, high);
            if self.exposure(channel, middle) <= y { low = middle } else { high = middle }
        }
        let nearer = y - self.exposure(channel, low) > self.exposure(channel, high) - y;
        if nearer { high } else { low }
    }

    /// Returns the radiance of one channel of a pixel, in relative exposure per second at gain 1, and whether the channel is clipped.
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

    fn product(&self, exposures: &[Exposure]) -> VecMerge {
        let table = vec![0; curve_len(self.depth)];
        let curve = Curve::try_new(
            &self.response,
            self.depth,
            Levels { black: self.black, white: self.white },
            table,
        );
        merge(curve.expect("sound"), exposures)
    }

    /// Merges pixels given as codes\[pixel\]\[channel\]\[exposure\].
    fn run(&self, pixels: &[[Vec<u32>; 3]], exposures: &[Exposure]) -> Vec<Radiance> {
        let merge = self.product(exposures);
        let frames: Vec<Vec<u16>> = (0..exposures.len())
            .map(|i| pixels.iter().flatten().map(|codes| codes[i] as u16).collect())
            .collect();
        let bytes: Vec<Vec<u8>> = frames.iter().map(|f| f.iter().map(|v| *v as u8).collect()).collect();
        let view = merge.view();
        let planes: Vec<_> = bytes.iter().map(|f| planes(f)).collect();
        let codes: Vec<_> = match self.depth {
            Depth::U8 if view.wants_planes() => planes.iter().map(codes_of).collect(),
            Depth::U8 => bytes.iter().map(|f| Codes::Bytes(f)).collect(),
            Depth::U16 => frames.iter().map(|f| Codes::Words(f)).collect(),
        };
        let mut counts = vec![0.0; 3 * pixels.len()];
        merged(&view, &codes, Channels::RGB, &mut counts);
        let radiance = |(i, rgb): (usize, &[f32; 3])| Radiance {
            rgb: rgb.map(|v| f64::from(v) * merge.view().unit()),
            clipped: (3 * i..3 * i + 3).any(|at| view.is_clipped(&codes, at)),
        };
        counts.as_chunks::<3>().0.iter().enumerate().map(radiance).collect()
    }
}

/// Splits interleaved bytes into red, green and blue planes.
fn planes(bytes: &[u8]) -> [Vec<u8>; 3] {
    [0, 1, 2].map(|c| bytes.iter().skip(c).step_by(3).copied().collect())
}

fn codes_of(planes: &[Vec<u8>; 3]) -> Codes<'_> {
    Codes::Planes(planes.each_ref().map(Vec::as_slice))
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

/// Returns the codes of every exposure for radiances over seven decades, independent per channel.
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

/// Returns the RMS relative difference from the `f64` implementation over samples that are not black.
fn rms(sensor: &Sensor, exposures: &[Exposure]) -> f64 {
    let pixels = decades(sensor, exposures, 30_000);
    let out = sensor.run(&pixels, exposures);
    let (mut sum, mut count) = (0.0, 0.0);
    for (codes, radiance) in pixels.iter().zip(&out) {
        let mut any_clipped = false;
        for (channel, (codes, found)) in codes.iter().zip(radiance.rgb).enumerate() {
            let (expected, clipped) = sensor.merge(channel, codes, exposures);
            any_clipped |= clipped;
            if expected > 0.0 {
                sum += off(found, expected).powi(2);
                count += 1.0;
            }
        }
        assert_eq!(radiance.clipped, any_clipped, "{codes:?}");
    }
    assert!(count > 20_000.0, "most samples are lit: {count}");
    f64::sqrt(sum / count)
}

#[test]
fn merge_matches_the_f64_twin_over_seven_decades() {
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
fn bursts_of_up_to_four_exposures_merge_to_integers() {
    let exposures = times(&[0.000_926, 0.005_555, 0.033_333]);
    for sensor in sensors().iter().take(4) {
        // The radiances span seven decades without the clipped range.
        let pixels: Vec<_> = decades(sensor, &exposures, 3000)
            .into_iter()
            .filter(|p| (0..3).all(|c| !sensor.merge(c, &p[c], &exposures).1))
            .collect();
        let frames: Vec<Vec<u16>> =
            (0..3).map(|i| pixels.iter().flatten().map(|codes| codes[i] as u16).collect()).collect();
        let bytes: Vec<Vec<u8>> = frames.iter().map(|f| f.iter().map(|v| *v as u8).collect()).collect();
        let planes: Vec<_> = bytes.iter().map(|f| planes(f)).collect();
        let merge = sensor.product(&exposures);
        let codes: Vec<_> = match sensor.depth {
            Depth::U8 if merge.view().wants_planes() => planes.iter().map(codes_of).collect(),
            Depth::U8 => bytes.iter().map(|f| Codes::Bytes(f)).collect(),
            Depth::U16 => frames.iter().map(|f| Codes::Words(f)).collect(),
        };
        let mut counts = vec![0.0; 3 * pixels.len()];
        let whole = merged(&merge.view(), &codes, Channels::RGB, &mut counts);
        assert!(whole as f64 > 0.95 * counts.len() as f64, "{:?}: {whole} whole", sensor.response);
    }
}

#[test]
fn pixel_clipped_in_every_exposure_keeps_its_lower_bound_and_counts_as_clipped() {
    let exposures = times(&[1e-3, 1e-2, 1e-1]);
    for sensor in sensors() {
        let white = sensor.white as u32;
        let out = sensor.run(&[[vec![white; 3], vec![white; 3], vec![white; 3]]], &exposures);
        for value in out[0].rgb {
            assert!(off(value, 1e3) < 1e-3, "{:?}: {value}", sensor.response);
        }
        assert!(out[0].clipped, "{:?}", sensor.response);
    }
}

#[test]
fn validity_is_decided_per_channel() {
    let exposures = times(&[1e-3, 1e-2]);
    let sensor = &sensors()[2];
    // Red clips in the long exposure, green in none, blue in both.
    let pixel = [vec![100, 255], vec![10, 102], vec![255, 255]];
    let out = sensor.run(&[pixel], &exposures);
    let found = out[0].rgb;
    let expected = [100.0 / 255.0 / 1e-3, 112.0 / 255.0 / 11e-3, 1e3];
    for (f, e) in found.iter().zip(expected) {
        assert!(off(*f, e) < 2e-4, "{found:?} {expected:?}");
    }
    assert!(out[0].clipped, "blue clips");
}

#[test]
fn noise_around_black_keeps_its_mean() {
    let sensor = Sensor { response: Response::Linear, depth: Depth::U16, black: 256.0, white: 4095.0 };
    let exposures = times(&[1e-3, 1e-2, 1e-1]);
    let mut rng = seeded(9);
    // The sum of twelve uniform numbers minus 6 is nearly normal; sigma is 5 codes around 0.3 codes of light in the longest exposure.
    let mut noisy = |light: f64| {
        let noise: f64 = (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
        (256.0 + light + 5.0 * noise).round().max(0.0) as u32
    };
    let n = 200_000;
    let pixels: Vec<_> =
        (0..n).map(|_| core::array::from_fn(|_| vec![noisy(0.003), noisy(0.03), noisy(0.3)])).collect();
    let out = sensor.run(&pixels, &exposures);
    let mean = out.iter().flat_map(|r| r.rgb).sum::<f64>() / f64::from(3 * n);
    let code = 1.0 / 3839.0;
    let expected = 0.333 * code / 0.111;
    let sigma = 5.0 * f64::sqrt(3.0) * code / 0.111 / f64::from(3 * n).sqrt();
    println!("mean {mean:.4e}, expected {expected:.4e}, sigma {sigma:.1e}");
    assert!((mean - expected).abs() < 4.0 * sigma, "{mean} {expected} {sigma}");
    assert!(out.iter().any(|r| r.rgb[0] < 0.0), "noise below black is kept");
}

#[test]
fn response_above_one_below_white_is_not_clamped() {
    // 1.04 at white: a fit may give this value, and the curve accepts it.
    let rows = [[0.0, 0.0, 0.94, 0.1, 0.0]; 3];
    let sensor = Sensor { response: Response::Polynomial(rows), depth: Depth::U8, black: 0.0, white: 255.0 };
    let exposures = times(&[1e-3]);
    let out = sensor.run(&[[vec![249], vec![249], vec![255]]], &exposures);
    let (expected, _) = sensor.merge(0, &[249], &exposures);
    assert!(off(out[0].rgb[0], expected) < 1e-6, "{expected}");
    assert!(off(out[0].rgb[2], 1.04e3) < 1e-6, "the clip value too");
}

#[test]
fn one_to_twelve_exposures_are_merged() {
    let curve = || {
        Curve::try_new(
            &Response::Linear,
            Depth::U8,
            Levels { black: 0.0, white: 255.0 },
            vec![0; curve_len(Depth::U8)],
        )
    };
    let merge = |exposures: &[Exposure]| {
        Merge::try_new(curve().expect("sound"), exposures, 1.0, vec![0; 12 * 768], room(1 << 12))
            .map(|m| m.view().exposures())
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
    // Linear 8-bit samples of equal gain need no tables; other samples need 768 entries per exposure.
    let build = |curve, exposures: &[Exposure], tables, reciprocals| {
        Merge::try_new(curve, exposures, 1.0, vec![0; tables], room(reciprocals)).map(|_| ())
    };
    let short = |needed| Err(MergeError::TooSmall(TooSmall { needed, lent: needed - 1 }));
    let three = times(&[1.0; 3]);
    assert_eq!(build(curve().expect("sound"), &three, 0, 8), Ok(()));
    assert_eq!(build(curve().expect("sound"), &three, 0, 7), short(8));
    let looked_up = || curve().expect("sound").looked_up();
    assert_eq!(build(looked_up(), &three, 2304, 8), Ok(()));
    assert_eq!(build(looked_up(), &three, 2303, 8), short(2304));
    let size = merge_size(&looked_up(), &three).expect("sound exposures");
    assert_eq!((size.tables, size.reciprocals), (2304, 8));
}

#[test]
fn scale_that_is_not_positive_and_finite_is_refused() {
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let curve = Curve::try_new(
            &Response::Linear,
            Depth::U8,
            Levels { black: 0.0, white: 255.0 },
            vec![0; curve_len(Depth::U8)],
        );
        let merge = Merge::try_new(curve.expect("sound"), &times(&[1.0]), bad, vec![0; 0], room(2));
        let merge = merge.map(|_| ());
        assert_eq!(merge, Err(MergeError::BadScale), "{bad}");
    }
}

#[test]
fn no_code_of_any_frame_overflows() {
    // Black near white makes the darkest codes large negative numbers, which are summed twelve times.
    for (depth, black, white) in
        [(Depth::U8, 200.0, 255.0), (Depth::U16, 1000.0, 1001.0), (Depth::U16, 65000.0, 65535.0)]
    {
        let sensor = Sensor { response: Response::Linear, depth, black, white };
        let exposures = times(&[1e-3; 12]);
        let pixels: Vec<_> =
            (0..=depth.max()).step_by(3).map(|z| core::array::from_fn(|_| vec![z; 12])).collect();
        let out = sensor.run(&pixels, &exposures);
        assert!(out.windows(2).all(|w| w[0].rgb[0] <= w[1].rgb[0]), "brighter codes are brighter");
    }
}

#[test]
fn codes_out_of_range_are_dark_or_clipped_and_never_panic() {
    let merge = sensors()[0].product(&times(&[1e-3, 1e-2]));
    let view = merge.view();
    let mut out = [0.0; 12];
    let mut run = |codes: &[Codes<'_>]| {
        view.samples(codes, Channels::RGB, &mut out);
        out
    };
    assert!(run(&[]).iter().all(|v| *v == 0.0), "no frames");
    run(&[Codes::Bytes(&[255; 5]), Codes::Bytes(&[])]);
    run(&[Codes::Bytes(&[255; 5])]);
    // Codes beyond the table count as white.
    let white = run(&[Codes::Words(&[65535; 12]), Codes::Words(&[300; 12])]);
    for value in white {
        assert!(off(f64::from(value) * merge.view().unit(), 1e3) < 1e-3, "{value}");
    }
    assert!(view.is_clipped(&[Codes::Words(&[65535; 12]), Codes::Words(&[300; 12])], 3), "white in both");
}

fn room(reciprocals: usize) -> Vec<Reciprocal> {
    vec![Reciprocal::default(); reciprocals]
}

/// Compares all loops for the same codes: interleaved, as planes, in blocks and parts of blocks, in any combination of saturated exposures.
#[test]
fn all_merge_loops_follow_the_same_rules() {
    let exposures = times(&[1e-3, 4e-3, 3e-2]);
    let mut rng = seeded(11);
    for sensor in sensors().iter().take(4) {
        let merge = sensor.product(&exposures);
        let view = merge.view();
        for len in [1, 2, 21, 22, 64, 100, 128] {
            // The codes contain runs of equal codes, so that whole blocks saturate or do not, and some codes that do not occur in a still
            // scene.
            let top = sensor.white as u32;
            let level: [u32; 3] = [(); 3].map(|()| rng.random_range(0..3));
            let code = |level: u32, rng: &mut crate::common::Pcg64Mcg| match level {
                0 => rng.random_range(0..top / 2),
                1 => rng.random_range(0..=top),
                _ => top,
            };
            let frames: Vec<Vec<u16>> =
                level.iter().map(|l| (0..3 * len).map(|_| code(*l, &mut rng) as u16).collect()).collect();
            let bytes: Vec<Vec<u8>> = frames.iter().map(|f| f.iter().map(|v| *v as u8).collect()).collect();
            let codes: Vec<_> = match sensor.depth {
                Depth::U8 => bytes.iter().map(|f| Codes::Bytes(f)).collect(),
                Depth::U16 => frames.iter().map(|f| Codes::Words(f)).collect(),
            };
            let mut out = vec![0.0; 3 * len];
            merged(&view, &codes, Channels::RGB, &mut out);
            for (at, found) in out.iter().enumerate() {
                let each: Vec<u32> = frames.iter().map(|f| u32::from(f[at])).collect();
                let (expected, _) = sensor.merge(at % 3, &each, &exposures);
                let found = f64::from(*found) * merge.view().unit();
                let scale = expected.abs().max(1e-3 * 1e3);
                assert!(
                    (found - expected).abs() < 1e-3 * scale,
                    "{:?} {each:?}: {found} {expected}",
                    sensor.response
                );
            }
            if sensor.depth == Depth::U8 {
                let planes: Vec<_> = bytes.iter().map(|f| planes(f)).collect();
                let codes: Vec<_> = planes.iter().map(codes_of).collect();
                let mut apart = vec![0.0; 3 * len];
                merged(&view, &codes, Channels::RGB, &mut apart);
                assert!(
                    apart.iter().zip(&out).all(|(a, b)| (a - b).abs() <= 2e-4 * b.abs() + 1.0),
                    "{:?}: as planes",
                    sensor.response
                );
            }
        }
    }
}

#[test]
fn merged_counts_do_not_depend_on_the_scale_and_are_always_finite() {
    let linear = Sensor { response: Response::Linear, depth: Depth::U8, black: 0.0, white: 255.0 };
    let curved = Sensor { response: polynomial(), ..linear };
    for sensor in [linear, curved] {
        let counts = |scale: f64, seconds: [f64; 2]| {
            let exposures = times(&seconds);
            let levels = Levels { black: sensor.black, white: sensor.white };
            let curve =
                Curve::try_new(&sensor.response, sensor.depth, levels, vec![0; curve_len(sensor.depth)])
                    .expect("sound");
            let size = merge_size(&curve, &exposures).expect("sound exposures");
            let merge =
                Merge::try_new(curve, &exposures, scale, vec![0; size.tables], room(size.reciprocals))
                    .expect("sound");
            let mut counts = [0.0; 6];
            // A dark, a medium and a clipped sample in each exposure.
            let codes = [[0u8, 90, 255, 0, 0, 255], [0, 200, 255, 255, 90, 0]];
            merge.view().samples(&codes.each_ref().map(|c| Codes::Bytes(c)), Channels::RGB, &mut counts);
            (counts, merge.view().unit())
        };
        let (usual, _) = counts(1.0, [0.001, 0.03]);
        assert!(usual.iter().all(|v| v.is_finite() && *v >= 0.0), "{usual:?}");
        for scale in [5e-324, f64::MIN_POSITIVE, 1e300] {
            assert_eq!(counts(scale, [0.001, 0.03]).0, usual, "{scale}");
        }
        for (scale, time) in [(1e300, 1e-300), (1e-300, 1e300), (5e-324, 1e300)] {
            let (found, unit) = counts(scale, [0.001 * time, 0.03 * time]);
            assert!(found.iter().all(|v| v.is_finite() && *v >= 0.0), "{scale}, {time}: {found:?}");
            assert!(unit.is_finite(), "{scale}, {time}: {unit}");
        }
    }
}
