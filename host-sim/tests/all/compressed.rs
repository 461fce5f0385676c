//! Lights of a camera's JPEG frames, compared with the lights of its uncompressed frames.

use hemilux::calibration::{Burst, Calibration, Frame, Pixels};
use hemilux::pipeline::{Pipeline, Settings};
use hemilux::v4l2::Size;
use hemilux::v4l2::jpeg::Jpeg;
use hemilux_core::format::{Format, Layout, Matrix, Yuv};
use hemilux_core::{SamplerKind, Samples, read_rgb_row};
use hemilux_sim::bench::{Case, bursts};
use hemilux_sim::contender::judged;
use hemilux_sim::env::EnvMap;
use hemilux_sim::metrics::{Domain, LitSet, Reading, Reference};
use image::codecs::jpeg::JpegEncoder;

const LIGHTS: usize = 64;

fn lights(calibration: &Calibration, burst: &Burst) -> LitSet {
    let exposures: Vec<_> = burst.frames.iter().map(|f| f.exposure).collect();
    let settings =
        Settings { sampler: SamplerKind::Q2Tree, soft: false, lights: LIGHTS, ..Settings::default() };
    let mut pipeline = Pipeline::try_new(*calibration, &exposures, settings).expect("a pipeline");
    judged(&pipeline.process(burst).expect("lights").decomposition)
}

/// Returns the RMS difference between `found` and `expected`, divided by the RMS of `expected`.
fn difference(found: &[f64], expected: &[f64]) -> f64 {
    let rms = |values: Vec<f64>| (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt();
    rms(found.iter().zip(expected).map(|(f, e)| f - e).collect()) / rms(expected.to_vec())
}

/// Compresses a frame as JPEG and decodes it with the probe's decoder.
fn through_jpeg(layout: &Layout, bytes: &[u8], quality: u8) -> (Jpeg, Vec<u8>) {
    let (width, height) = (layout.width(), layout.height());
    let mut rgb = Vec::new();
    let mut row = vec![[0u16; 3]; width as usize];
    for y in 0..height {
        read_rgb_row(layout, Samples::U8(bytes), y, &mut row);
        rgb.extend(row.iter().flatten().map(|code| *code as u8));
    }
    let mut encoded = Vec::new();
    let mut encoder = JpegEncoder::new_with_quality(&mut encoded, quality);
    encoder.encode(&rgb, width, height, image::ExtendedColorType::Rgb8).expect("a JPEG");
    let (jpeg, mut decoded) = (Jpeg::of(width, height), Vec::new());
    assert!(jpeg.decode(&encoded, &mut decoded), "a complete frame");
    (jpeg, decoded)
}

fn compressed(calibration: &Calibration, burst: &Burst, quality: u8) -> (Calibration, Burst) {
    let layout = calibration.layout;
    let jpeg = Jpeg::of(layout.width(), layout.height());
    let Size { width, height } = jpeg.decoded();
    let decoded = Layout::tight(Format::Rgb24, width, height).expect("a layout");
    let lens = (0..jpeg.shrink.ilog2()).fold(calibration.lens, |lens, _| lens.halved());
    let mut of_jpeg = Calibration::new(lens, decoded);
    of_jpeg.response = calibration.response;
    of_jpeg.scale = calibration.scale;
    of_jpeg.compressed = true;
    let frame = |frame: &Frame| {
        let Pixels::U8(bytes) = &frame.pixels else { panic!("bytes") };
        Frame { exposure: frame.exposure, pixels: Pixels::U8(through_jpeg(&layout, bytes, quality).1) }
    };
    (of_jpeg, Burst { frames: burst.frames.iter().map(frame).collect(), ..Burst::default() })
}

/// The differences of shadowed and open irradiance between the lights of JPEG frames of quality 85 and of YUYV frames of one scene are at most
/// 1.5 %.
#[test]
fn jpeg_frames_of_quality_85_give_the_lights_of_yuyv_frames_within_1_5_percent() {
    let yuv = Yuv { limited: false, matrix: Matrix::Bt601 };
    let reference = Reference::new(&EnvMap::from_fn(64, 32, |_| [1.0; 3]), Domain::Hemisphere);
    for size in [(640, 480), (1280, 720), (1920, 1080)] {
        let case = Case { size, lights: LIGHTS, ..Case::of_format(Format::Yuyv(yuv)) };
        let (calibration, burst) = (bursts::calibration(&case), &bursts::make(&case)[0]);
        let plain = lights(&calibration, burst);
        let (calibration, burst) = compressed(&calibration, burst, 85);
        let jpeg = lights(&calibration, &burst);
        let shadowed = difference(
            &reference.shadowed_of(&jpeg, Reading::Points),
            &reference.shadowed_of(&plain, Reading::Points),
        );
        let open = difference(
            &reference.open_of(&jpeg, Reading::Points),
            &reference.open_of(&plain, Reading::Points),
        );
        println!("{size:?}: shadowed {:.2} %, open {:.2} %", 100.0 * shadowed, 100.0 * open);
        assert!(shadowed <= 0.015, "{size:?}: {shadowed}");
        assert!(open <= 0.015, "{size:?}: {open}");
    }
}
