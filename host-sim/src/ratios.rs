//! Ratios of the exposures of a burst, measured in the pixels of its frames.

use hemilux::calibration::{Burst, Calibration, Frame, Pixels};
use hemilux::recorded::RecordedBurst;
use hemilux_core::format::Format;
use hemilux_core::response::{Curve, curve_len};

/// Least number of samples with which a measured ratio replaces the ratio of the stated exposure times.
const LEAST_SAMPLES: usize = 1000;

/// Least usable ratio of two exposures; two frames with a smaller ratio count as copies of one exposure.
const LEAST_RATIO: f64 = 1.05;

/// Sets the exposure times by the measured ratios and sorts the frames by exposure; prints the ratios if `prints`. The brightest frame keeps
/// its stated time; if another frame states a longer time, all measured times are scaled by the median of stated over measured times. A frame
/// without a usable ratio, such as a black frame, keeps its stated time.
pub fn measure(read: &mut RecordedBurst, prints: bool) {
    sort(read, |frame| codes(frame).map(f64::from).sum());
    let ratios = of(&read.calibration, &read.burst);
    if prints {
        print(&ratios);
    }
    let frames = &mut read.burst.frames;
    let stated: Vec<f64> = frames.iter().map(Frame::light).collect();
    apply(&ratios, frames);
    let longest = stated.iter().copied().fold(0.0, f64::max);
    let scale =
        if stated.last().is_some_and(|v| *v < longest) { scale(&ratios, &stated, frames) } else { 1.0 };
    for (index, frame) in frames.iter_mut().enumerate() {
        if has_ratio(&ratios, index) {
            frame.exposure.seconds *= scale;
        }
    }
    sort(read, Frame::light);
}

/// Sorts the frames of the burst and the paths of their files by a key of the frame, ascending.
fn sort(read: &mut RecordedBurst, key: impl Fn(&Frame) -> f64) {
    let frames = std::mem::take(&mut read.burst.frames).into_iter();
    let mut keyed: Vec<_> =
        frames.zip(std::mem::take(&mut read.files)).map(|pair| (key(&pair.0), pair)).collect();
    keyed.sort_by(|a, b| a.0.total_cmp(&b.0));
    (read.burst.frames, read.files) = keyed.into_iter().map(|(_, pair)| pair).unzip();
}

/// Sets the exposure times by the measured ratios, from the last frame to the first.
fn apply(ratios: &[Ratio], frames: &mut [Frame]) {
    for (i, ratio) in ratios.iter().enumerate().rev().filter(|(_, ratio)| ratio.is_usable()) {
        let longer = frames[i + 1].light();
        let exposure = &mut frames[i].exposure;
        exposure.seconds = longer / ratio.measured / exposure.gain;
    }
}

/// Returns the median of stated over measured exposures, over the frames with a usable ratio; 1 if there is none.
fn scale(ratios: &[Ratio], stated: &[f64], frames: &[Frame]) -> f64 {
    let measured = frames.iter().map(Frame::light);
    let of_frame =
        std::iter::zip(stated, measured).enumerate().filter(|(index, _)| has_ratio(ratios, *index));
    let mut scales: Vec<_> = of_frame.map(|(_, (stated, measured))| stated / measured).collect();
    scales.sort_by(f64::total_cmp);
    scales.get(scales.len() / 2).copied().unwrap_or(1.0)
}

/// Returns whether a frame has a usable ratio to the next darker or the next brighter frame.
fn has_ratio(ratios: &[Ratio], frame: usize) -> bool {
    let with = |index: Option<usize>| index.and_then(|i| ratios.get(i)).is_some_and(Ratio::is_usable);
    with(frame.checked_sub(1)) || with(Some(frame))
}

impl Ratio {
    fn is_usable(&self) -> bool {
        self.samples >= LEAST_SAMPLES && self.measured.is_finite() && self.measured >= LEAST_RATIO
    }
}

/// Largest number of samples of a frame on which a ratio is measured; it bounds the memory. In larger frames every n-th pixel is a sample.
const MOST_SAMPLES: usize = 3 << 20;

/// Stated and measured exposure ratio of two frames with neighbouring exposures: longer divided by shorter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ratio {
    /// Stated exposure times of the shorter and the longer frame, seconds.
    pub seconds: [f64; 2],
    /// Ratio of the stated exposures (time times gain).
    pub nominal: f64,
    /// Median ratio over the samples that are above the noise and not saturated in both frames; NaN if there are no such samples.
    pub measured: f64,
    /// Number of samples over which the median is taken.
    pub samples: usize,
}

/// Measures the ratios of neighbouring exposures in the pixels, since the exposure times that cameras report have errors of up to a fifth. The
/// list is empty for frames in other formats than RGB24 and RGB48.
#[must_use]
pub fn of(calibration: &Calibration, burst: &Burst) -> Vec<Ratio> {
    let c = calibration;
    if !matches!(c.layout.format(), Format::Rgb24 | Format::Rgb48) {
        return Vec::new();
    }
    let depth = c.layout.format().depth();
    let table = vec![0; curve_len(depth)];
    let Ok(curve) = Curve::try_new(&c.response, depth, c.levels, table) else { return Vec::new() };
    burst.frames.windows(2).map(|pair| ratio(&curve, pair)).collect()
}

fn ratio(curve: &Curve<Vec<i32>>, pair: &[Frame]) -> Ratio {
    // The least value is 1/32 of full scale, below which quantisation dominates.
    let least = 1 << (hemilux_core::response::CURVE_BITS - 5);
    let step = sample_count(&pair[0]).div_ceil(MOST_SAMPLES);
    let [short, long] = [codes(&pair[0]), codes(&pair[1])];
    let mut found: Vec<f32> = std::iter::zip(short, long)
        .enumerate()
        .filter(|(i, _)| (i / 3) % step == 0)
        .filter(|(_, (a, b))| !curve.is_saturated(*b) && curve.is_trusted(*a))
        .map(|(i, (a, b))| (curve.exposure_q27(i % 3, a), curve.exposure_q27(i % 3, b)))
        .filter(|(a, _)| *a > least)
        .map(|(a, b)| (f64::from(b) / f64::from(a)) as f32)
        .collect();
    found.sort_by(f32::total_cmp);
    Ratio {
        seconds: [pair[0].exposure.seconds, pair[1].exposure.seconds],
        nominal: pair[1].light() / pair[0].light(),
        measured: found.get(found.len() / 2).map_or(f64::NAN, |ratio| f64::from(*ratio)),
        samples: found.len(),
    }
}

fn sample_count(frame: &Frame) -> usize {
    match &frame.pixels {
        Pixels::U8(v) => v.len(),
        Pixels::U16(v) => v.len(),
    }
}

fn codes(frame: &Frame) -> Box<dyn Iterator<Item = u32> + '_> {
    match &frame.pixels {
        Pixels::U8(v) => Box::new(v.iter().map(|c| u32::from(*c))),
        Pixels::U16(v) => Box::new(v.iter().map(|c| u32::from(*c))),
    }
}

/// Relative deviation of a measured ratio from the stated ratio above which [`print`] adds a note.
const CONTRADICTION: f64 = 0.1;

/// Prints the ratios on standard error, with a note about `--exposures measured` if they contradict the stated exposure times.
pub fn print(ratios: &[Ratio]) {
    if ratios.is_empty() {
        return;
    }
    eprintln!(
        "hemilux-sim: ratios of neighbouring exposures, as the files state them and as measured in the pixels"
    );
    eprintln!("    shorter s     longer s    nominal   measured   off by   samples");
    for r in ratios {
        let [a, b] = r.seconds;
        let off = 100.0 * (r.measured / r.nominal - 1.0);
        eprintln!("{a:>13.6}{b:>13.6}{:>11.3}{:>11.3}{off:>+8.1} %{:>10}", r.nominal, r.measured, r.samples);
    }
    if ratios.iter().any(|r| (r.measured / r.nominal - 1.0).abs() > CONTRADICTION) {
        eprintln!(
            "hemilux-sim: the exposure times contradict the pixels by more than {:.0} %: if nothing in the scene moved, use --exposures \
             measured, which sets the times by the measured ratios",
            100.0 * CONTRADICTION
        );
    }
}
