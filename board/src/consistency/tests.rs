use super::history::Contradiction;
use super::*;
use crate::calibration::Pixels;
use hemilux_core::format::{Format, Pattern};
use hemilux_core::{Exposure, Lens};

mod dark;

const SIZE: usize = 64;
const TIMES: [f64; 3] = [0.001, 0.006, 0.036];

/// Returns the radiance of a room with a bright window at pixel (`x`, `y`).
fn radiance(x: usize, y: usize) -> f64 {
    let window = if (40..56).contains(&x) && (8..24).contains(&y) { 300.0 } else { 0.0 };
    1.0 + x as f64 / 2.0 + y as f64 / 8.0 + window
}

fn calibration(format: Format) -> Calibration {
    let lens = Lens::equidistant([31.5, 31.5], 20.0, 1.4).expect("a lens");
    Calibration::try_new(lens, format, SIZE as u32, SIZE as u32).expect("a camera")
}

/// Returns a frame of `scene`, exposed for `actual` seconds and labelled with `stated` seconds.
fn frame(stated: f64, actual: f64, scene: impl Fn(usize, usize) -> f64) -> Frame {
    let mut codes = Vec::new();
    for (y, x) in (0..SIZE).flat_map(|y| (0..SIZE).map(move |x| (y, x))) {
        let code = (scene(x, y) * actual * 700.0).round().min(255.0) as u8;
        codes.extend([code; 3]);
    }
    Frame { exposure: Exposure { seconds: stated, gain: 1.0 }, pixels: Pixels::U8(codes) }
}

fn sound() -> Burst {
    Burst { frames: TIMES.map(|t| frame(t, t, radiance)).to_vec(), ..Burst::default() }
}

fn inspector() -> Inspector {
    let mut inspector = Inspector::try_new(&calibration(Format::Rgb24), 3).expect("an inspector");
    for burst in 0..8 {
        assert!(inspector.inspect(&sound()).is_empty(), "sound burst {burst}");
    }
    inspector
}

fn faults(inspector: &mut Inspector, burst: &Burst) -> Vec<(usize, FrameFault)> {
    inspector.inspect(burst).iter().map(|f| (f.index, f.fault)).collect()
}

#[test]
fn each_fault_is_detected_in_each_frame_and_named() {
    for (index, t) in TIMES.into_iter().enumerate() {
        let other =
            |x: usize, y: usize| radiance(SIZE - 1 - x, SIZE - 1 - y) * if x % 16 < 8 { 3.0 } else { 0.4 };
        let torn = |x: usize, y: usize| radiance(x, y) * if y < 30 { 1.0 } else { 0.25 };
        for (fault, bad) in [
            (FrameFault::Black, frame(t, 0.0, radiance)),
            (FrameFault::WrongExposure, frame(t, 0.5 * t, radiance)),
            (FrameFault::OtherScene, frame(t, t, other)),
            (FrameFault::Torn, frame(t, t, torn)),
        ] {
            let mut burst = sound();
            burst.frames[index] = bad;
            let found = faults(&mut inspector(), &burst);
            assert_eq!(found, [(index, fault)], "frame {index}, {fault:?}");
        }
    }
    for (index, t) in TIMES.into_iter().enumerate().take(2) {
        let mut burst = sound();
        burst.frames[index] = frame(t, 1e3, radiance);
        assert_eq!(faults(&mut inspector(), &burst), [(index, FrameFault::Saturated)], "frame {index}");
    }
}

#[test]
fn a_copy_of_another_exposure_is_left_out() {
    let mut burst = sound();
    burst.frames[1].pixels = burst.frames[2].pixels.clone();
    let found = faults(&mut inspector(), &burst);
    assert!(matches!(found[..], [(1, _)]), "{found:?}");
    burst = sound();
    burst.frames[0].pixels = burst.frames[1].pixels.clone();
    assert_eq!(faults(&mut inspector(), &burst), [(0, FrameFault::Repeated)]);
}

#[test]
fn swapped_frames_do_not_leave_the_burst_empty() {
    let mut burst = sound();
    let (first, rest) = burst.frames.split_at_mut(1);
    std::mem::swap(&mut first[0].pixels, &mut rest[1].pixels);
    let found = faults(&mut inspector(), &burst);
    assert!(!found.is_empty() && found.len() < 3, "{found:?}");
}

#[test]
fn permanent_flicker_is_not_a_fault() {
    let mut inspector = Inspector::try_new(&calibration(Format::Rgb24), 3).expect("an inspector");
    let mut wrong = 0;
    for burst in 0..40 {
        // A lamp of 100 Hz at 28 bursts a second; the longest exposure averages over several of its periods.
        let phase = f64::from(burst) * 100.0 / 28.0 * std::f64::consts::TAU;
        let level = [1.0 + 0.95 * phase.sin(), 1.0 + 0.4 * (phase + 1.0).sin(), 1.0];
        let frames = (0..3).map(|i| frame(TIMES[i], TIMES[i] * level[i], radiance)).collect();
        let found = inspector.inspect(&Burst { frames, ..Burst::default() });
        wrong += usize::from(burst >= 10 && !found.is_empty());
    }
    assert_eq!(wrong, 0, "bursts with frames left out");
}

/// A lamp in the lower rows varies: in one of seven bursts by more than a tear of the least size, in most others by less.
#[test]
fn light_of_a_lamp_that_varies_in_a_part_of_the_rows_is_no_tear() {
    let mut inspector = Inspector::try_new(&calibration(Format::Rgb24), 3).expect("an inspector");
    let lit = |burst: usize| {
        let level = [1.0, 1.45, 0.68, 1.0, 2.2, 0.68, 1.45][burst % 7];
        let lamp = |x: usize, y: usize, level: f64| if y < 52 { radiance(x, y) } else { 30.0 * level };
        let mut burst = sound();
        burst.frames = TIMES.map(|t| frame(t, t, |x, y| lamp(x, y, 1.0))).to_vec();
        burst.frames[0] = frame(TIMES[0], TIMES[0], |x, y| lamp(x, y, level));
        burst
    };
    for burst in 0..60 {
        let found = faults(&mut inspector, &lit(burst));
        assert!(burst < 21 || found.is_empty(), "burst {burst}: {found:?}");
    }
    let mut torn = lit(63);
    torn.frames[0] = frame(TIMES[0], TIMES[0], |x, y| radiance(x, y) * if y < 40 { 1.0 } else { 6.0 });
    assert_eq!(faults(&mut inspector, &torn), [(0, FrameFault::Torn)]);
}

#[test]
fn a_wrong_label_makes_a_burst_uncertain_although_bands_of_flicker_are_usual() {
    let mut inspector = Inspector::try_new(&calibration(Format::Rgb24), 2).expect("an inspector");
    // In the shorter exposure, the lower rows are those of the dark phase of a lamp.
    let lit = |burst: usize| {
        let band = |x: usize, y: usize| radiance(x, y) * if y < 20 + 12 * (burst % 3) { 1.0 } else { 0.5 };
        let frames = vec![frame(TIMES[1], TIMES[1], band), frame(TIMES[2], TIMES[2], radiance)];
        Burst { frames, ..Burst::default() }
    };
    for burst in 0..60 {
        let found = faults(&mut inspector, &lit(burst));
        assert!(burst < 30 || (found.is_empty() && !inspector.is_uncertain()), "burst {burst}: {found:?}");
    }
    for index in [0, 1] {
        let mut wrong = lit(60);
        wrong.frames[index].exposure.seconds *= 4.0;
        let found = faults(&mut inspector, &wrong);
        assert!(inspector.is_uncertain(), "the label of frame {index}: {found:?}");
        assert_eq!(faults(&mut inspector, &lit(61)), [], "after the label of frame {index}");
    }
}

#[test]
fn exposure_times_with_a_constant_error_are_not_a_fault() {
    let mut inspector = Inspector::try_new(&calibration(Format::Rgb24), 3).expect("an inspector");
    for burst in 0..20 {
        let frames = vec![frame(TIMES[0], 2.0 * TIMES[0], radiance), frame(TIMES[1], TIMES[1], radiance)];
        assert!(inspector.inspect(&Burst { frames, ..Burst::default() }).is_empty(), "burst {burst}");
    }
}

#[test]
fn black_frames_of_a_mosaic_are_detected() {
    let camera = calibration(Format::Raw10(Pattern::Rggb));
    let mut inspector = Inspector::try_new(&camera, 3).expect("an inspector");
    let packed = |seconds: f64| {
        let code = |x: usize, y: usize| (radiance(x, y) * seconds * 700.0 * 4.0).round().min(1023.0) as u16;
        let group = |y: usize, x: usize| {
            let codes = [0, 1, 2, 3].map(|i| code(x + i, y));
            let low = (0..4).map(|i| (codes[i] as u8 & 3) << (2 * i)).sum();
            [codes.map(|c| (c >> 2) as u8).as_slice(), &[low]].concat()
        };
        (0..SIZE).flat_map(|y| (0..SIZE / 4).flat_map(move |x| group(y, 4 * x))).collect::<Vec<u8>>()
    };
    let frame = |stated: f64, actual: f64| Frame {
        exposure: Exposure { seconds: stated, gain: 1.0 },
        pixels: Pixels::U8(packed(actual)),
    };
    let frames = vec![frame(0.001, 0.001), frame(0.006, 0.006), frame(0.036, 0.0)];
    let mut burst = Burst { frames, ..Burst::default() };
    assert_eq!(faults(&mut inspector, &burst), [(2, FrameFault::Black)]);
    burst.frames[2] = frame(0.036, 0.036);
    assert_eq!(faults(&mut inspector, &burst), []);
}

#[test]
fn contradictions_of_frames_that_seldom_can_be_compared_do_not_become_usual() {
    let mut history = History::default();
    let seen = |log_ratio| {
        let mut seen = Comparison::default();
        seen.log_ratio = log_ratio;
        seen
    };
    for burst in 0..8 {
        assert_eq!(history.judge(&seen(Some(0.0)), None), Contradiction::None, "sound burst {burst}");
    }
    for burst in 0..100 {
        assert_eq!(history.judge(&seen(None), None), Contradiction::None, "dark burst {burst}");
        let fault = history.judge(&seen(Some(-4f32.ln())), None);
        assert_eq!(fault, Contradiction::Unusual(FrameFault::WrongExposure), "false burst {burst}");
    }
    // Two successive false bursts in ten.
    for burst in 0..100 {
        for _ in 0..8 {
            assert_eq!(history.judge(&seen(None), None), Contradiction::None, "dark burst {burst}");
        }
        for second in [false, true] {
            let fault = history.judge(&seen(Some(-4f32.ln())), None);
            let expected = Contradiction::Unusual(FrameFault::WrongExposure);
            assert_eq!(fault, expected, "false burst {burst}, second: {second}");
        }
    }
}
