use super::history::Contradiction;
use super::*;
use crate::calibration::Pixels;
use hemilux_core::format::{Format, Pattern};
use hemilux_core::{Exposure, Lens};

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

/// Returns a frame in whose longest exposure hardly a sample reaches 1/128 of the full scale; fractions of codes are dithered.
fn dark(stated: f64, actual: f64, scene: impl Fn(usize, usize) -> f64) -> Frame {
    let samples = (0..SIZE).flat_map(|y| (0..SIZE).map(move |x| (y, x))).enumerate();
    let code = |(at, (y, x)): (usize, (usize, usize))| {
        let dither = (at as f64 * 0.618_033_988_749_894_9).fract();
        [(scene(x, y) * actual * 300.0 + dither).min(65535.0) as u16; 3]
    };
    let pixels = Pixels::U16(samples.flat_map(code).collect());
    Frame { exposure: Exposure { seconds: stated, gain: 1.0 }, pixels }
}

/// Returns the radiance of a room without a window at pixel (`x`, `y`).
fn dim(x: usize, y: usize) -> f64 {
    6.0 + x as f64 / 8.0 + y as f64 / 16.0
}

/// Returns an inspector that has seen sound bursts of the dim room, exposed for `times` seconds.
fn dark_inspector(times: &[f64]) -> Inspector {
    let mut camera = calibration(Format::Rgb48);
    camera.levels = hemilux_core::Levels { black: 0.0, white: 65_535.0 };
    let mut inspector = Inspector::try_new(&camera, times.len()).expect("an inspector");
    for burst in 0..8 {
        assert!(inspector.inspect(&dark_burst(times, dim)).is_empty(), "sound burst {burst}");
        assert!(!inspector.is_uncertain(), "sound burst {burst}");
    }
    inspector
}

fn dark_burst(times: &[f64], scene: impl Fn(usize, usize) -> f64 + Copy) -> Burst {
    Burst { frames: times.iter().map(|t| dark(*t, *t, scene)).collect(), ..Burst::default() }
}

#[test]
fn each_fault_of_a_dark_scene_is_found_and_named() {
    for index in [1, 2] {
        let t = TIMES[index];
        let torn = |x: usize, y: usize| dim(x, y) * if y < 30 { 1.0 } else { 1.0 / 6.0 };
        let last_rows = |x: usize, y: usize| dim(x, y) * if y < 62 { 1.0 } else { 1.0 / 36.0 };
        for (fault, bad) in [
            (FrameFault::Black, dark(t, 0.0, dim)),
            (FrameFault::Saturated, dark(t, 1e6, dim)),
            (FrameFault::WrongExposure, dark(4.0 * t, t, dim)),
            (FrameFault::Torn, dark(t, t, torn)),
            (FrameFault::Torn, dark(t, t, last_rows)),
        ] {
            let mut inspector = dark_inspector(&TIMES);
            let mut burst = dark_burst(&TIMES, dim);
            burst.frames[index] = bad;
            assert_eq!(faults(&mut inspector, &burst), [(index, fault)], "frame {index}");
            assert_eq!(faults(&mut inspector, &dark_burst(&TIMES, dim)), [], "the burst after {fault:?}");
            assert!(!inspector.is_uncertain(), "the burst after {fault:?}");
        }
    }
}

/// A bulb fills six samples of the grid and saturates the longest exposure. Without the shortest exposure the bulb would be lost.
#[test]
fn a_black_shortest_exposure_is_found_in_a_dark_room_with_a_bulb() {
    let lit = |x: usize, y: usize| {
        let is_bulb = (30..33).contains(&x) && (24..32).contains(&y);
        if is_bulb { 1e4 } else { dim(x, y) }
    };
    let mut inspector = dark_inspector(&TIMES);
    for burst in 0..8 {
        assert_eq!(faults(&mut inspector, &dark_burst(&TIMES, lit)), [], "sound burst {burst}");
    }
    let mut burst = dark_burst(&TIMES, lit);
    burst.frames[0] = dark(TIMES[0], 0.0, lit);
    assert_eq!(faults(&mut inspector, &burst), [(0, FrameFault::Black)]);
}

#[test]
fn swapped_frames_of_a_dark_scene_make_the_burst_uncertain() {
    let mut inspector = dark_inspector(&TIMES);
    let mut burst = dark_burst(&TIMES, dim);
    let (first, rest) = burst.frames.split_at_mut(2);
    std::mem::swap(&mut first[1].pixels, &mut rest[0].pixels);
    inspector.inspect(&burst);
    assert!(inspector.is_uncertain());
}

/// Without a third exposure, the frame that remains may be the wrong one: in a swapped burst, the sound frame looks black.
#[test]
fn a_burst_of_two_exposures_with_a_false_frame_is_uncertain() {
    let times = [0.000926, 0.033333];
    for level in [3.0, 30.0] {
        let lit = move |x: usize, y: usize| level * dim(x, y);
        let mut inspector = dark_inspector(&times);
        for _ in 0..8 {
            inspector.inspect(&dark_burst(&times, lit));
        }
        assert!(!inspector.is_uncertain(), "sound bursts at level {level}");
        let mut burst = dark_burst(&times, lit);
        let (first, rest) = burst.frames.split_at_mut(1);
        std::mem::swap(&mut first[0].pixels, &mut rest[0].pixels);
        inspector.inspect(&burst);
        assert!(inspector.is_uncertain(), "swapped at level {level}");
        let mut burst = dark_burst(&times, lit);
        burst.frames[1] = dark(times[1], 0.0, lit);
        assert_eq!(faults(&mut inspector, &burst), [(1, FrameFault::Black)], "black at level {level}");
        assert!(inspector.is_uncertain(), "black at level {level}");
    }
}

/// Returns whether an inspector that has seen eight bursts of `scene` doubts a burst whose longer exposure has the samples of the shorter one in the
/// lower rows.
fn doubts_a_tear(calibration: &Calibration, take: impl Fn(f64, f64) -> Frame) -> bool {
    let times = [0.000926, 0.033333];
    let burst = || Burst { frames: times.map(|t| take(t, t)).to_vec(), ..Burst::default() };
    let mut inspector = Inspector::try_new(calibration, 2).expect("an inspector");
    for number in 0..8 {
        assert!(inspector.inspect(&burst()).is_empty(), "sound burst {number}");
        assert!(!inspector.is_uncertain(), "sound burst {number}");
    }
    let mut torn = burst();
    let [short, long] = &mut torn.frames[..] else { unreachable!() };
    match (&short.pixels, &mut long.pixels) {
        (Pixels::U8(from), Pixels::U8(to)) => to[from.len() / 2..].copy_from_slice(&from[from.len() / 2..]),
        (Pixels::U16(from), Pixels::U16(to)) => to[from.len() / 2..].copy_from_slice(&from[from.len() / 2..]),
        _ => unreachable!(),
    }
    inspector.inspect(&torn);
    inspector.is_uncertain()
}

/// The shorter exposure confirms the upper rows alone: by the sums of dark samples, or sample by sample.
#[test]
fn a_tear_below_the_rows_that_the_shorter_exposure_measures_makes_the_burst_uncertain() {
    let mut sixteen = calibration(Format::Rgb48);
    sixteen.levels = hemilux_core::Levels { black: 0.0, white: 65_535.0 };
    for upper in [30.0, 1000.0, 3000.0] {
        let scene = move |x: usize, y: usize| dim(x, y) * if y < 24 { upper } else { 1.0 };
        assert!(doubts_a_tear(&sixteen, |stated, actual| dark(stated, actual, scene)), "16 bits, {upper}");
    }
    for lower in [0.5, 1.0, 2.0] {
        let scene = move |_, y: usize| if y < 24 { 100.0 } else { lower };
        let camera = calibration(Format::Rgb24);
        assert!(doubts_a_tear(&camera, |stated, actual| frame(stated, actual, scene)), "8 bits, {lower}");
    }
}

#[test]
fn light_that_changes_in_all_exposures_of_a_dark_scene_is_no_fault() {
    let mut inspector = dark_inspector(&TIMES);
    for (burst, level) in [3.0, 3.0, 0.5, 1.5, 4.0, 1.0].into_iter().enumerate() {
        // A person, whose radiance is a third of the room's, covers another half of the lower rows in each burst.
        let covered = move |x: usize, y: usize| y > 40 && (x + 20 * burst) % SIZE < SIZE / 2;
        let scene = move |x: usize, y: usize| dim(x, y) * level * if covered(x, y) { 0.3 } else { 1.0 };
        assert_eq!(faults(&mut inspector, &dark_burst(&TIMES, scene)), [], "burst {burst}");
        assert!(!inspector.is_uncertain(), "burst {burst}");
    }
}

/// In a sliding window, one frame is new and the others are older.
#[test]
fn light_that_grows_in_one_part_is_no_fault_in_a_sliding_window() {
    let mut inspector = dark_inspector(&TIMES);
    let mut burst = dark_burst(&TIMES, dim);
    for frame in 0..12 {
        let index = frame % TIMES.len();
        let level = 1.2f64.powi((frame as i32 - 5).clamp(0, 4));
        let scene = move |x: usize, y: usize| dim(x, y) * if y < SIZE / 2 { level } else { 1.0 };
        burst.frames[index] = dark(TIMES[index], TIMES[index], scene);
        burst.stale = !(1 << index);
        assert_eq!(faults(&mut inspector, &burst), [], "frame {frame}");
        assert!(!inspector.is_uncertain(), "frame {frame}");
    }
}

/// An object enters two of the sixteen rows between two frames; later, the lower half of a frame is of another exposure.
#[test]
fn in_a_sliding_window_an_object_at_the_edge_is_no_fault_and_a_tear_is_one() {
    for index in [1, 2] {
        let mut inspector = dark_inspector(&TIMES);
        let mut burst = dark_burst(&TIMES, dim);
        for frame in 0..24 {
            let new = frame % TIMES.len();
            let object = if frame >= 9 + index { 4.0 } else { 1.0 };
            let is_torn = frame == 18 + index;
            let scene = move |x: usize, y: usize| {
                let part = if is_torn && y >= SIZE / 2 { 1.0 / 6.0 } else { 1.0 };
                dim(x, y) * if y < SIZE / 8 { object } else { part }
            };
            burst.frames[new] = dark(TIMES[new], TIMES[new], scene);
            burst.stale = !(1 << new);
            let found = faults(&mut inspector, &burst);
            if is_torn {
                assert_eq!(found, [(index, FrameFault::Torn)], "frame {frame}");
            } else if !(18..18 + index + TIMES.len()).contains(&frame) {
                assert_eq!(found, [], "frame {frame}");
            }
        }
    }
}

#[test]
fn a_change_that_no_other_exposure_can_confirm_is_uncertain_for_two_bursts() {
    let times = [0.0001, 0.036];
    let mut inspector = dark_inspector(&times);
    for (burst, is_uncertain) in [true, true, false].into_iter().enumerate() {
        let lit = |x: usize, y: usize| 3.0 * dim(x, y);
        assert_eq!(faults(&mut inspector, &dark_burst(&times, lit)), [], "burst {burst}");
        assert_eq!(inspector.is_uncertain(), is_uncertain, "burst {burst}");
    }
}

/// Faults are rarely alone where they are frequent: two black frames in a row are no change of the light.
#[test]
fn two_equal_false_bursts_of_a_dark_scene_are_uncertain() {
    let times = [0.0001, 0.036];
    let mut inspector = dark_inspector(&times);
    for burst in 0..2 {
        let mut black = dark_burst(&times, dim);
        black.frames[1] = dark(times[1], 0.0, dim);
        inspector.inspect(&black);
        assert!(inspector.is_uncertain(), "black burst {burst}");
    }
    assert_eq!(faults(&mut inspector, &dark_burst(&times, dim)), [], "the burst after them");
    assert!(!inspector.is_uncertain(), "the burst after them");
}

#[test]
fn an_exposure_that_the_source_does_not_state_is_uncertain_until_it_repeats() {
    for index in 0..2 {
        let times = [0.0001, 0.036];
        let mut inspector = dark_inspector(&times);
        inspector.expect(&times.map(|seconds| Exposure { seconds, gain: 1.0 }));
        for (burst, is_uncertain) in [true, true, false].into_iter().enumerate() {
            let mut mislabelled = dark_burst(&times, dim);
            mislabelled.frames[index].exposure.seconds *= 4.0;
            inspector.inspect(&mislabelled);
            assert_eq!(inspector.is_uncertain(), is_uncertain, "frame {index}, burst {burst}");
        }
    }
}

#[test]
fn a_false_frame_in_the_first_burst_of_new_exposures_is_uncertain() {
    let times = [0.0009, 0.036];
    for fault in 0..3 {
        let mut inspector = dark_inspector(&TIMES);
        inspector.expect(&times.map(|seconds| Exposure { seconds, gain: 1.0 }));
        let mut burst = dark_burst(&times, dim);
        match fault {
            0 => burst.frames[1] = dark(times[1], 0.0, dim),
            1 => burst.frames[1] = dark(times[1], 1e6, dim),
            _ => burst.frames[1].exposure.seconds *= 4.0,
        }
        inspector.inspect(&burst);
        assert!(inspector.is_uncertain(), "fault {fault}");
    }
}

#[test]
fn a_false_frame_after_a_wrong_label_in_the_first_burst_of_new_exposures_is_left_out() {
    let lit = |x: usize, y: usize| 80.0 * dim(x, y);
    let times = [TIMES[0], TIMES[2]];
    let mut inspector = dark_inspector(&TIMES);
    for _ in 0..8 {
        inspector.inspect(&dark_burst(&TIMES, lit));
    }
    inspector.expect(&times.map(|seconds| Exposure { seconds, gain: 1.0 }));
    let mut mislabelled = dark_burst(&times, lit);
    mislabelled.frames[0].exposure.seconds *= 4.0;
    inspector.inspect(&mislabelled);
    assert!(inspector.is_uncertain(), "a wrong label");
    let mut torn = dark_burst(&times, lit);
    torn.frames[1] = dark(times[1], times[1], |x, y| lit(x, y) * if y < 30 { 1.0 } else { 1.0 / 36.0 });
    assert_eq!(faults(&mut inspector, &torn), [(1, FrameFault::Torn)]);
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
        assert_eq!(history.judge(&seen(Some(0.0))), Contradiction::None, "sound burst {burst}");
    }
    for burst in 0..100 {
        assert_eq!(history.judge(&seen(None)), Contradiction::None, "dark burst {burst}");
        let fault = history.judge(&seen(Some(-4f32.ln())));
        assert_eq!(fault, Contradiction::Unusual(FrameFault::WrongExposure), "false burst {burst}");
    }
    // Two successive false bursts in ten.
    for burst in 0..100 {
        for _ in 0..8 {
            assert_eq!(history.judge(&seen(None)), Contradiction::None, "dark burst {burst}");
        }
        for second in [false, true] {
            let fault = history.judge(&seen(Some(-4f32.ln())));
            let expected = Contradiction::Unusual(FrameFault::WrongExposure);
            assert_eq!(fault, expected, "false burst {burst}, second: {second}");
        }
    }
}
