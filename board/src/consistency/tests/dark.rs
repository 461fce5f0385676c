//! Scenes of which few rows can be compared between the exposures.

use super::*;

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

/// A lamp on the mains is switched on: its bulb flickers in the shortest exposure, and the other exposures repeat.
#[test]
fn a_switched_lamp_counts_as_repeated_while_it_flickers_in_the_shortest_exposure() {
    let mut inspector = dark_inspector(&TIMES);
    for _ in 0..8 {
        inspector.inspect(&dark_burst(&TIMES, |x, y| 0.1 * dim(x, y)));
    }
    let uncertain = [1.0, 0.1, 1.5].map(|phase| {
        let lit = |bulb: f64| {
            move |x: usize, y: usize| {
                let is_bulb = (30..33).contains(&x) && (24..32).contains(&y);
                if is_bulb { 1e4 * bulb } else { dim(x, y) }
            }
        };
        let mut burst = dark_burst(&TIMES, lit(1.0));
        burst.frames[0] = dark(TIMES[0], TIMES[0], lit(phase));
        inspector.inspect(&burst);
        inspector.is_uncertain()
    });
    assert_eq!(uncertain, [true, true, false]);
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
