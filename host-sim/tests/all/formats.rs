//! Light of one scene in every pixel format of a camera, from memory and from files.

use hemilux::calibration::{Burst, Calibration, Pixels};
use hemilux::pipeline::{Pipeline, Settings};
use hemilux::recorded::{self, RecordedBurst};
use hemilux_core::SamplerKind;
use hemilux_core::format::{Format, Layout, LayoutError, Matrix, Pattern, Yuv};
use hemilux_sim::bench::{Case, bursts};

/// Returns the scalar flux (red, green, blue) and the mean direction of the lights of a burst.
fn light(calibration: &Calibration, burst: &Burst) -> ([f64; 3], glam::Vec3) {
    let exposures: Vec<_> = burst.frames.iter().map(|f| f.exposure).collect();
    let settings = Settings { sampler: SamplerKind::Q2Tree, ..Settings::default() };
    let mut pipeline = Pipeline::try_new(*calibration, &exposures, settings).expect("a pipeline");
    let processed = pipeline.process(burst).expect("lights");
    let lights = processed.decomposition.lights.iter();
    let mean: glam::Vec3 = lights.map(|l| l.direction * l.irradiance[1]).sum();
    (processed.scalar_flux.map(f64::from), mean.normalize())
}

const LIMITED: Yuv = Yuv { limited: true, matrix: Matrix::Bt709 };
const FULL: Yuv = Yuv { limited: false, matrix: Matrix::Bt601 };

fn formats() -> Vec<(Format, f64)> {
    use Format::{Bayer8, Bayer16, Bgr24, Grey, Nv12, Raw10, Raw12, Yuyv};
    // The tolerances allow for mosaics, which shift colours by half a pixel and lack part of the rim, and for the quantisation of 8-bit gamma codes.
    let mut all = vec![(Bgr24, 1e-3), (Grey, 1e-3), (Bayer16(Pattern::Rggb, 12), 0.02)];
    for pattern in [Pattern::Rggb, Pattern::Grbg, Pattern::Gbrg, Pattern::Bggr] {
        all.extend([Bayer8(pattern), Raw10(pattern), Raw12(pattern)].map(|f| (f, 0.02)));
    }
    for yuv in [FULL, LIMITED] {
        all.extend([Yuyv(yuv), Nv12(yuv)].map(|f| (f, 0.03)));
    }
    all
}

#[test]
fn flux_and_mean_direction_agree_between_pixel_formats() {
    let rgb = Case::of_format(Format::Rgb24);
    let (flux, direction) = light(&bursts::calibration(&rgb), &bursts::make(&rgb)[0]);
    for (format, within) in formats() {
        let case = Case::of_format(format);
        let (found, towards) = light(&bursts::calibration(&case), &bursts::make(&case)[0]);
        // Grey frames contain the green channel alone.
        let expected = if format == Format::Grey { [flux[1]; 3] } else { flux };
        for (f, e) in found.iter().zip(expected) {
            assert!((f / e - 1.0).abs() < within, "{format:?}: {found:?}, expected {expected:?}");
        }
        let off = towards.angle_between(direction).to_degrees();
        assert!(off < 1.0, "{format:?}: mean direction off by {off} degrees");
    }
}

#[test]
fn raw_frames_in_files_have_the_lights_of_frames_in_memory() {
    for (format, fourcc, trailer) in [
        (Format::Raw10(Pattern::Bggr), "pBAA", 0),
        (Format::Yuyv(LIMITED), "YUYV", 4096),
        (Format::Nv12(FULL), "NV12", 0),
    ] {
        let case = Case::of_format(format);
        let calibration = bursts::calibration(&case);
        let burst = &bursts::make(&case)[0];
        let folder = tempfile::tempdir().expect("a folder");
        let c = &calibration;
        let model = if matches!(format, Format::Raw10(_)) { "linear" } else { "srgb" };
        let yuv =
            if format == Format::Yuyv(LIMITED) { "range = \"limited\"\nmatrix = \"bt709\"\n" } else { "" };
        let mut manifest = format!(
            "version = 1\n[lens]\nmodel = \"equidistant\"\ncentre = [319.5, 239.5]\nfocal = [196.4, 196.4]\nmax_angle_deg = 80.0\n\
             [response]\nmodel = \"{model}\"\nscale = {}\n[sensor]\nblack = {}\nwhite = {}\n\
             [format]\nwidth = 640\nheight = 480\nfourcc = \"{fourcc}\"\n{yuv}",
            c.scale, c.levels.black, c.levels.white
        );
        for (i, frame) in burst.frames.iter().enumerate() {
            let Pixels::U8(bytes) = &frame.pixels else { panic!("packed bytes") };
            let padded = [bytes.as_slice(), &vec![0; trailer]].concat();
            std::fs::write(folder.path().join(format!("{i}.raw")), padded).expect("a frame");
            manifest += &format!("[[frame]]\nfile = \"{i}.raw\"\nexposure_s = {}\n", frame.exposure.seconds);
        }
        std::fs::write(folder.path().join("burst.toml"), &manifest).expect("a manifest");
        let RecordedBurst { calibration: read, burst: recorded, .. } =
            recorded::read_burst(folder.path()).expect("a burst");
        assert_eq!(light(&read, &recorded), light(c, burst), "{fourcc}");
        std::fs::write(folder.path().join("1.raw"), [0; 1000]).expect("a short frame");
        let error = recorded::read_burst(folder.path()).expect_err("too short").to_string();
        assert!(error.contains("1.raw: found 1000 bytes") && !error.contains('\n'), "{error}");
        std::fs::write(folder.path().join("burst.toml"), manifest.replace(fourcc, "MJPG"))
            .expect("a manifest");
        let error = recorded::read_burst(folder.path()).expect_err("no raw format").to_string();
        assert!(error.contains("fourcc = \"MJPG\"") && !error.contains('\n'), "{error}");
    }
}

#[test]
fn layouts_that_do_not_fit_are_refused() {
    let yuyv = Format::Yuyv(FULL);
    assert!(Layout::tight(yuyv, 640, 480).is_ok());
    assert_eq!(Layout::tight(yuyv, 641, 480), Err(LayoutError::OddSize));
    assert_eq!(Layout::tight(Format::Nv12(FULL), 640, 481), Err(LayoutError::OddSize));
    assert_eq!(Layout::tight(yuyv, 0, 480), Err(LayoutError::BadSize));
    let short = LayoutError::BadLine { found: 1279, expected: 1280 };
    assert_eq!(Layout::try_new(yuyv, 640, 480, 1279), Err(short));
    let padded = Layout::try_new(yuyv, 640, 480, 1300).expect("padded lines");
    // Files without the padding of the last line are accepted.
    assert_eq!(padded.frame_bytes(), 479 * 1300 + 1280);
}
