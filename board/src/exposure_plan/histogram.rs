//! Histogram of the logarithms of a burst's radiances.

use super::cover::{Limits, RadianceShare, TimeRange};
use crate::calibration::{Burst, Calibration};
use glam::DVec2;
use hemilux_core::{Layout, read_rgb_row};

/// Number of bins of the histogram per octave of radiance.
pub const BINS_PER_OCTAVE: usize = 4;

/// Binary logarithm of the lower edge of the histogram's first bin; radiance is in relative exposure per second.
const FIRST_OCTAVE: i32 = -24;

/// Number of octaves of the histogram.
const OCTAVES: usize = 56;

/// Step between sampled rows and between sampled columns, pixels.
const STEP: u32 = 4;

/// Numbers of pixels of a burst by radiance, and numbers of pixels above and below the measurable range.
#[derive(Clone, Debug)]
pub struct Histogram {
    counts: [u32; OCTAVES * BINS_PER_OCTAVE],
    /// Number of all pixels that were added, including those of unknown radiance.
    total: u32,
    /// Number of pixels that are saturated in the shortest exposure.
    above: Unmeasured,
    /// Number of pixels that are too dark in the longest exposure.
    below: Unmeasured,
}

/// Number of pixels whose radiance lies beyond a bound.
#[derive(Clone, Copy, Debug)]
struct Unmeasured {
    pixels: u32,
    /// Radiance above or below which the radiances of the pixels lie, relative exposure per second.
    bound: f64,
}

impl Unmeasured {
    const fn none(bound: f64) -> Self {
        Self { pixels: 0, bound }
    }
}

impl Default for Histogram {
    fn default() -> Self {
        Self { counts: [0; _], total: 0, above: Unmeasured::none(f64::MAX), below: Unmeasured::none(0.0) }
    }
}

/// Returns the radiance at the upper edge of bin `at`, relative exposure per second.
fn upper(at: usize) -> f64 {
    f64::from(FIRST_OCTAVE + (at as i32 + 1) / BINS_PER_OCTAVE as i32).exp2()
        * (((at + 1) % BINS_PER_OCTAVE) as f64 / BINS_PER_OCTAVE as f64).exp2()
}

/// Returns the index of the bin of `radiance`, in relative exposure per second.
fn bin(radiance: f64) -> usize {
    let at = (radiance.log2() - f64::from(FIRST_OCTAVE)) * BINS_PER_OCTAVE as f64;
    (at.max(0.0) as usize).min(OCTAVES * BINS_PER_OCTAVE - 1)
}

impl Histogram {
    /// Adds a pixel with a known `radiance`, in relative exposure per second.
    pub fn add(&mut self, radiance: f64) {
        self.counts[bin(radiance)] += 1;
        self.total += 1;
    }

    /// Adds a pixel that is saturated in the shortest exposure.
    fn add_above(&mut self) {
        self.above.pixels += 1;
        self.total += 1;
    }

    /// Adds a pixel that is too dark in the longest exposure.
    fn add_below(&mut self) {
        self.below.pixels += 1;
        self.total += 1;
    }

    /// Returns true if a pixel was added that is saturated in the shortest exposure.
    pub(super) fn has_unknown_above(&self) -> bool {
        self.above.pixels > 0
    }

    /// Removes all pixels. From now on, the shortest exposure is saturated from a radiance of `above`, and the longest one measures no
    /// radiance under `below`.
    fn clear(&mut self, above: f64, below: f64) {
        (self.counts, self.total) = ([0; _], 0);
        (self.above, self.below) = (Unmeasured::none(above), Unmeasured::none(below));
    }

    /// Returns the radiances with their fractions of the pixels, brightest first: each bin by its upper edge; pixels of unknown radiance in
    /// each bin of their possible radiances within `range`.
    #[must_use]
    pub fn light(&self, range: &TimeRange) -> Vec<RadianceShare> {
        let share = |count: u32| f64::from(count) / f64::from(self.total.max(1));
        // The first bin of each unknown part gets all pixels of the part, since the part must be covered as a whole.
        let bright = bin(self.above.bound)..=bin(1.0 / range.shortest_s);
        let dark = bin(1e-3 / range.longest_s)..=bin(self.below.bound);
        let (above, below) = (self.above.pixels, self.below.pixels);
        let light = (0..self.counts.len()).rev().filter_map(|at| {
            let known = share(self.counts[at]);
            let is_unknown = (above > 0 && bright.contains(&at)) || (below > 0 && dark.contains(&at));
            let unknown = match at {
                _ if above > 0 && at == *bright.start() => share(above),
                _ if below > 0 && at == *dark.start() => share(below),
                _ => 0.0,
            };
            (known > 0.0 || is_unknown).then(|| RadianceShare { radiance: upper(at), share: known + unknown })
        });
        light.collect()
    }
}

/// Computes the histograms of radiances of one camera's bursts.
#[derive(Clone, Debug)]
pub(super) struct RadianceReader {
    layout: Layout,
    /// Relative exposure for each code of the green channel.
    curve: Vec<f32>,
    /// Indices of the sampled rows, each with the indices of its sampled columns.
    columns: Vec<(u32, Vec<u32>)>,
    rows: Vec<Vec<[u16; 3]>>,
}

impl RadianceReader {
    pub(super) fn new(calibration: &Calibration) -> Option<Self> {
        let Calibration { layout, lens, levels, response, .. } = calibration;
        let codes = levels.white - levels.black;
        if codes.partial_cmp(&0.0) != Some(std::cmp::Ordering::Greater) {
            return None;
        }
        let curve = (0..=layout.format().max_code())
            .map(|code| response.exposure(1, (f64::from(code) - levels.black) / codes) as f32);
        let seen = |x: u32, y: u32| lens.unproject(DVec2::new(f64::from(x), f64::from(y))).is_some();
        let every = |n: u32| (0..n).step_by(STEP as usize);
        let columns = every(layout.height())
            .map(|y| (y, every(layout.width()).filter(|x| seen(*x, y)).collect::<Vec<_>>()))
            .filter(|(_, columns)| !columns.is_empty());
        Some(Self { layout: *layout, curve: curve.collect(), columns: columns.collect(), rows: Vec::new() })
    }

    /// Replaces the contents of `histogram` by the pixels of `burst`: the radiance of a pixel is that in the longest exposure in which the
    /// pixel is not saturated.
    pub(super) fn read(&mut self, burst: &Burst, limits: &Limits, histogram: &mut Histogram) {
        let (Some(first), Some(last)) = (burst.frames.first(), burst.frames.last()) else { return };
        // A pixel below a fifth of the limit gets no radiance: its noise is as large as its signal.
        let floor = limits.dark / 5.0;
        histogram.clear(limits.bright / first.exposure.seconds, floor / last.exposure.seconds);
        self.rows.resize_with(burst.frames.len(), Vec::new);
        for (y, columns) in &self.columns {
            for (row, frame) in self.rows.iter_mut().zip(&burst.frames) {
                row.resize(self.layout.width() as usize, [0; 3]);
                read_rgb_row(&self.layout, frame.pixels.samples(), *y, row);
            }
            for x in columns {
                let y_in = |row: &Vec<[u16; 3]>| {
                    let code = row.get(*x as usize).map_or(0, |rgb| rgb[0].max(rgb[1]).max(rgb[2]));
                    f64::from(self.curve.get(usize::from(code)).copied().unwrap_or(1.0))
                };
                let read = self.rows.iter().zip(&burst.frames).rev();
                let found =
                    read.map(|(row, f)| (y_in(row), f.exposure.seconds)).find(|(y, _)| *y < limits.bright);
                match found {
                    Some((y, _)) if y < floor => histogram.add_below(),
                    Some((y, seconds)) => histogram.add(y / seconds),
                    None => histogram.add_above(),
                }
            }
        }
    }
}
