//! Frames that contradict their neighbours: black ones, overexposed ones, and ones taken after the camera moved.

use super::RecordedBurst;
use crate::calibration::{Calibration, Frame, Pixels};
use hemilux_core::format::Format;
use hemilux_core::response::{CURVE_BITS, Curve, curve_len};

/// Least relative exposure that predicts the neighbour's: below it quantisation and noise decide.
const LEAST: f64 = 1.0 / 32.0;

/// A sample contradicts a prediction where it is below or above it by this factor.
const DARKER: f64 = 8.0;

/// Samples whose radiance differs by more than this factor, beside the median ratio, show different things.
const DIFFERENT: f64 = 1.4;

/// Share of dark (or saturated) samples above which a frame is black (or overexposed).
const NEARLY_ALL: f64 = 0.9;

/// Share of different samples above which two frames show different scenes.
const MOVED: f64 = 0.2;

/// Fewest samples that a judgement rests on.
const ENOUGH: usize = 64;

/// A frame that was left out of a burst.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LeftOut {
    /// File of the frame.
    pub file: String,
    /// The contradiction.
    pub why: &'static str,
}

/// A contradiction between two frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Contradiction {
    /// The frame is dark where the other one predicts light.
    Dark,
    /// The frame is saturated where the other one predicts less.
    Bright,
    /// The two frames show different scenes.
    Different,
}

impl Contradiction {
    fn told(self) -> &'static str {
        match self {
            Self::Dark => "it is black where its neighbours see light",
            Self::Bright => "it is saturated where its neighbours are not",
            Self::Different => "it shows another scene than its neighbours",
        }
    }
}

/// Removes from a burst of red, green and blue samples the frames that contradict their neighbours, and names them. A frame goes
/// where its neighbours agree with each other or where it is dark or saturated against the only one; at least one frame stays.
pub fn leave_out(read: &mut RecordedBurst) -> Vec<LeftOut> {
    let Some(curve) = curve(&read.calibration) else { return Vec::new() };
    let mut left_out = Vec::new();
    while let Some((index, why)) = worst(&curve, &read.burst.frames) {
        read.burst.frames.remove(index);
        left_out.push(LeftOut { file: read.files.remove(index), why: why.told() });
    }
    left_out
}

/// Codes to relative exposure; none for frames that are not red, green and blue samples.
fn curve(c: &Calibration) -> Option<Curve<Vec<i32>>> {
    let format = c.layout.format();
    let depth = format.depth();
    let table = vec![0; curve_len(depth)];
    let is_rgb = matches!(format, Format::Rgb24 | Format::Rgb48);
    is_rgb.then(|| Curve::try_new(&c.response, depth, c.levels, table).ok())?
}

/// A frame that its neighbours contradict.
fn worst(curve: &Curve<Vec<i32>>, frames: &[Frame]) -> Option<(usize, Contradiction)> {
    let between = |of: usize, by: usize| {
        let seen_from = |of: usize, by: usize| contradiction(curve, &frames[of], &frames[by]);
        // That two frames show different scenes may be seen from either one.
        seen_from(of, by).or_else(|| seen_from(by, of).filter(|c| *c == Contradiction::Different))
    };
    let last = frames.len().checked_sub(1)?;
    for index in 0..=last {
        let neighbours = [index.checked_sub(1), Some(index + 1).filter(|i| *i <= last)];
        let found: Vec<_> = neighbours.iter().flatten().map(|by| between(index, *by)).collect();
        let Some(Some(first)) = found.first().copied() else { continue };
        if found.iter().any(Option::is_none) {
            continue;
        }
        // The neighbours of the neighbours tell which side of a contradiction is wrong.
        let others_agree = match neighbours {
            [Some(before), Some(after)] => between(after, before).is_none(),
            [Some(before), None] => before
                .checked_sub(1)
                .map_or(first != Contradiction::Different, |b| between(before, b).is_none()),
            [None, Some(after)] if after < last => between(after, after + 1).is_none(),
            [None, Some(_)] => first != Contradiction::Different,
            [None, None] => false,
        };
        if others_agree {
            return Some((index, first));
        }
    }
    None
}

/// The contradiction between the frames `of` and `by`; `None` if they agree.
fn contradiction(curve: &Curve<Vec<i32>>, of: &Frame, by: &Frame) -> Option<Contradiction> {
    let light = |f: &Frame| f.exposure.seconds * f.exposure.gain;
    let factor = light(of) / light(by);
    let full = f64::from(1u32 << CURVE_BITS);
    let exposure = |i: usize, code: u32| f64::from(curve.exposure_q27(i % 3, code)) / full;
    let (mut predicted, mut dark, mut unsaturated, mut bright) = (0usize, 0usize, 0usize, 0usize);
    let mut ratios = Vec::new();
    let samples = pixels(&of.pixels).zip(pixels(&by.pixels)).enumerate().step_by(step(&of.pixels));
    for (i, (a, b)) in samples {
        let known = exposure(i, b);
        if curve.is_saturated(b) || known < LEAST {
            continue;
        }
        let expected = (known * factor).min(1.0);
        let found = exposure(i, a);
        if expected >= LEAST / 2.0 {
            predicted += 1;
            dark += usize::from(found < expected / DARKER);
        }
        if expected < 1.0 / DARKER {
            unsaturated += 1;
            bright += usize::from(curve.is_saturated(a));
        }
        if !curve.is_saturated(a) && (found >= LEAST || expected >= 2.0 * LEAST) {
            ratios.push(found / known);
        }
    }
    let share = |part: usize, of: usize| of >= ENOUGH && part as f64 > NEARLY_ALL * of as f64;
    if share(dark, predicted) {
        return Some(Contradiction::Dark);
    }
    if share(bright, unsaturated) {
        return Some(Contradiction::Bright);
    }
    is_different(&mut ratios).then_some(Contradiction::Different)
}

/// Whether the ratios of radiance scatter round their median more than one scene allows.
fn is_different(ratios: &mut [f64]) -> bool {
    if ratios.len() < ENOUGH {
        return false;
    }
    let middle = ratios.len() / 2;
    let (_, median, _) = ratios.select_nth_unstable_by(middle, f64::total_cmp);
    let median = *median;
    let away = ratios.iter().filter(|r| !(median / DIFFERENT..median * DIFFERENT).contains(r)).count();
    away as f64 > MOVED * ratios.len() as f64
}

/// Distance between the samples that are compared, in samples: about 100,000 of a frame are compared, all channels in turn.
fn step(pixels: &Pixels) -> usize {
    let count = match pixels {
        Pixels::U8(v) => v.len(),
        Pixels::U16(v) => v.len(),
    };
    // Not a multiple of three.
    count / 100_000 / 3 * 3 + 1
}

fn pixels(pixels: &Pixels) -> Box<dyn Iterator<Item = u32> + '_> {
    match pixels {
        Pixels::U8(v) => Box::new(v.iter().map(|c| u32::from(*c))),
        Pixels::U16(v) => Box::new(v.iter().map(|c| u32::from(*c))),
    }
}
