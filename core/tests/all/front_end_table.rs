//! Bursts of every supported format give the map and the lights of a committed table, bit for bit on every machine.
//!
//! Run with `HEMILUX_ACCEPT=1` to replace the table by the results of the current code, and state in the commit why the light changed.

use core::f64::consts::PI;
use glam::DVec2;
use hemilux_core::format::{Matrix, Pattern, Yuv};
use hemilux_core::lens::{Intrinsics, Model};
use hemilux_core::polar::LatLongView;
use hemilux_core::pyramid::PyramidView;
use hemilux_core::sampler::q2tree::Parameters;
use hemilux_core::{
    Calibration, Domain, Exposure, Extrapolation, Format, FrontEnd, Layout, Lens, Levels, Light, Map, Order,
    Request, Response, Sampler, Samples, Sizes,
};
use std::fmt::Write as _;

const TABLE: &str = "tests/all/front_end_table.txt";
const LIGHTS: usize = 64;

/// One row of the table: a camera, its bursts and the sampler.
struct Case {
    name: String,
    format: Format,
    response: Response,
    exposures: Vec<Exposure>,
    /// Number of padding bytes at the end of each row of a frame.
    padding: usize,
    order: u8,
    extrapolated: bool,
}

impl Case {
    fn new(format: Format) -> Self {
        Self {
            name: format!("{format:?}"),
            format,
            response: Response::Linear,
            exposures: exposures(&[0.001, 0.008, 0.064], 1.0),
            padding: 0,
            order: 4,
            extrapolated: false,
        }
    }

    fn named(self, what: &str) -> Self {
        Self { name: format!("{}, {what}", self.name), ..self }
    }
}

fn exposures(seconds: &[f64], gain: f64) -> Vec<Exposure> {
    seconds.iter().map(|seconds| Exposure { seconds: *seconds, gain }).collect()
}

fn formats() -> Vec<Format> {
    let patterns = [Pattern::Rggb, Pattern::Grbg, Pattern::Gbrg, Pattern::Bggr];
    let yuvs = [Matrix::Bt601, Matrix::Bt709]
        .into_iter()
        .flat_map(|matrix| [false, true].map(|limited| Yuv { limited, matrix }));
    let mut formats = vec![Format::Rgb24, Format::Bgr24, Format::Rgb48, Format::Grey];
    formats.extend(yuvs.flat_map(|yuv| [Format::Yuyv(yuv), Format::Nv12(yuv)]));
    formats.extend(patterns.into_iter().flat_map(|p| {
        let words = [10, 12, 14, 16].map(|bits| Format::Bayer16(p, bits));
        [Format::Bayer8(p), Format::Raw10(p), Format::Raw12(p)].into_iter().chain(words)
    }));
    formats
}

fn cases() -> Vec<Case> {
    let polynomial = Response::Polynomial([
        [0.1, 0.2, 0.3, 0.38, 0.0],
        [0.0, 0.3, 0.3, 0.4, 0.0],
        [0.2, 0.2, 0.2, 0.37, 0.01],
    ]);
    let gains = [1.0, 4.0, 8.0].map(|gain| Exposure { seconds: 0.004, gain }).to_vec();
    let twelve: Vec<f64> = (0..12).map(|i| 0.000_5 * 1.7f64.powi(i)).collect();
    formats()
        .into_iter()
        .flat_map(|format| {
            let case = || Case::new(format);
            [
                case().named("linear"),
                Case { padding: 6, order: 5, ..case() }.named("padded rows, order 5"),
                Case { response: Response::Srgb, ..case() }.named("sRGB"),
                Case { response: polynomial, extrapolated: true, ..case() }
                    .named("polynomials, extrapolated"),
                Case { exposures: exposures(&[0.01], 2.0), ..case() }.named("one exposure"),
                Case { exposures: gains.clone(), ..case() }.named("three gains"),
                Case { exposures: exposures(&twelve, 1.0), response: Response::Srgb, ..case() }
                    .named("twelve exposures, sRGB"),
            ]
        })
        .collect()
}

const WIDTH: u32 = 212;
const HEIGHT: u32 = 160;

/// Returns a lens with skew and vignetting, a field of view that extends below the horizon, and an image circle larger than the sensor.
fn lens() -> Lens {
    Lens::try_new(Intrinsics {
        model: Model::KannalaBrandt([0.01, -0.002, 0.0, 0.0]),
        centre_px: DVec2::new(104.3, 80.7),
        focal_px: DVec2::new(56.0, 55.0),
        skew_px: 0.4,
        max_theta: 95.0 / 180.0 * PI,
        vignetting: [1.0, 0.0, -0.1, 0.0, 0.01, 0.0, 0.0, 0.0],
    })
    .expect("a sound lens")
}

/// Returns bytes that increase with the exposure up to saturation: a pattern with noise.
fn bytes(layout: &Layout, exposure: usize) -> Vec<u8> {
    let mut state = 0x9e37_79b9u32.wrapping_mul(exposure as u32 + 1);
    let line = layout.bytes_per_line() as u32;
    let mut byte = |at: u32| {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        let (row, column) = (at / line, at % line);
        // The frame shows a lamp that saturates in every exposure, a lamp that saturates in the longer exposures, and a gradient.
        let lamp = (row.abs_diff(60) + column.abs_diff(line / 2)) < 9;
        let window = (row.abs_diff(100) + column.abs_diff(line / 3)) < 30;
        let base = if lamp {
            4000
        } else if window {
            90
        } else {
            4 + (row + 3 * column / (line / WIDTH).max(1)) % 23
        };
        let code =
            6 + base * (1 << (3 * exposure.min(4))) / (1 << exposure.saturating_sub(4).min(3)) + state % 5;
        code.min(255) as u8
    };
    let Format::Bayer16(_, bits) = layout.format() else {
        return (0..layout.frame_bytes() as u32).map(byte).collect();
    };
    let word = |at: u32| (u16::from(byte(2 * at)) << (bits - 8) | (at % 4) as u16).to_le_bytes();
    (0..layout.frame_bytes() as u32 / 2).flat_map(word).collect()
}

/// An FNV-1a hash of 32-bit words.
struct Hash(u64);

impl Hash {
    fn add(&mut self, word: u32) {
        for byte in word.to_le_bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }

    fn add_f64(&mut self, v: f64) {
        let bits = v.to_bits();
        self.add(bits as u32);
        self.add((bits >> 32) as u32);
    }
}

/// Returns hashes of a burst's pixels, map and lights, and sums in decimal numbers.
fn row(case: &Case) -> String {
    let layout = Layout::try_new(case.format, WIDTH, HEIGHT, case.format.line_bytes(WIDTH) + case.padding)
        .expect("a layout");
    let frames: Vec<Vec<u8>> = (0..case.exposures.len()).map(|i| bytes(&layout, i)).collect();
    let words: Vec<Vec<u16>> =
        frames.iter().map(|f| f.as_chunks().0.iter().map(|b| u16::from_le_bytes(*b)).collect()).collect();
    let is_words = case.format == Format::Rgb48;
    let samples: Vec<Samples<'_>> = frames
        .iter()
        .zip(&words)
        .map(|(b, w)| if is_words { Samples::U16(w) } else { Samples::U8(b) })
        .collect();
    let white = f64::from(case.format.max_code());
    let black = if white > 255.0 { white / 32.0 } else { 6.0 };

    let mut calibration = Calibration::new(lens(), layout);
    calibration.response = case.response;
    calibration.levels = Levels { black, white };
    calibration.scale = 0.05;
    calibration.white_balance = [1.1, 1.0, 0.9];
    let order = Order::saturating(case.order);
    let sizes = Sizes::of(&calibration, &case.exposures, order).expect("sizes");
    let mut front =
        FrontEnd::try_new(calibration, &case.exposures, order, vec![0; sizes.words()]).expect("a front end");
    assert_eq!(front.sizes(), sizes, "{}", case.name);
    if case.extrapolated {
        front.set_extrapolation(Extrapolation::Average);
    }
    let seen = front.process(&samples).expect("a burst");
    let report = [seen.clipped, seen.unseen, seen.below];

    let mut hash = Hash(0xcbf2_9ce4_8422_2325);
    frames.iter().flatten().for_each(|b| hash.add(u32::from(*b)));
    let burst = hash.0;
    let view = front.map();
    for order in 0..=case.order {
        for quad in view.quads_of(order) {
            quad.energy.iter().chain(&quad.moment).for_each(|v| hash.add(v.to_bits()));
        }
    }
    report.into_iter().for_each(|v| hash.add_f64(v));
    let light = hash.0;
    for light in lights(&view, case.order) {
        hash.add(light.id);
        light.direction.to_array().into_iter().chain(light.irradiance).for_each(|v| hash.add(v.to_bits()));
    }
    let y = view.total().y();
    format!("{} | {burst:016x} | {y:.6e} | {:.4} | {light:016x} | {:016x}", case.name, report[0], hash.0)
}

fn lights(view: &PyramidView<'_>, order: u8) -> Vec<Light> {
    let mut tree = crate::common::q2tree(Parameters::CENTROID, Domain::Hemisphere, order, LIGHTS);
    let map = Map { pyramid: *view, polar: LatLongView::NONE };
    tree.update(&map, &Request::of_lights(LIGHTS)).lights.to_vec()
}

#[test]
fn every_format_gives_the_light_of_the_table() {
    let mut found = String::from(
        "format, response and exposures | frames | luminance | clipped | map | map and lights\n",
    );
    cases().iter().for_each(|case| writeln!(found, "{}", row(case)).expect("a string grows"));
    if std::env::var_os("HEMILUX_ACCEPT").is_some() {
        std::fs::write(TABLE, &found).expect("a table that can be written");
    }
    let expected = std::fs::read_to_string(TABLE).expect("a table");
    let differs = found.lines().zip(expected.lines()).find(|(a, b)| a != b);
    assert_eq!(differs, None, "found, expected");
    assert_eq!(found.lines().count(), expected.lines().count(), "rows");
}
