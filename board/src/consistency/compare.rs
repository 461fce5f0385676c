//! Comparison of the samples of two frames of one burst, which have different exposures.

use super::samples::{ROWS, RowSet, SATURATED, Sampled};
use hemilux_core::wire::FrameFault;

/// Factor above or below the prediction from the other frame from which a sample contradicts the prediction.
const DARKER: f32 = 8.0;

/// Factor between a sample's ratio of radiances (shorter frame divided by longer frame) and the median ratio from which the two frames show
/// different objects at the sample.
const DIFFERENT: f32 = 1.4;

/// Share of a frame's samples that are too dark or saturated, 0 to 1, above which the frame is black or overexposed, and share of equal
/// samples above which it is a copy.
const NEARLY_ALL: f64 = 0.9;

/// Least number of compared samples for a verdict on two frames.
const ENOUGH: usize = 16;

/// Least number of samples for which [`Comparison::away`] is computed.
const ENOUGH_FOR_SHARE: usize = 64;

/// Least number of compared samples in a row of the grid for the row's median, and of samples that confirm the row.
const ENOUGH_IN_ROW: usize = 4;

/// Least factor between the mean ratios of the two parts of a torn frame, and the factor whose square is the largest one between two rows
/// within a part.
const TORN: (f32, f32) = (1.5, 1.15);

/// Least number of grid rows in a part of a torn frame, unless the factor is [`TORN_FAR`]: bands of flickering light have smaller factors.
const TORN_ROWS: usize = 3;

/// Least factor between the two parts of a torn frame if one of them has fewer rows than [`TORN_ROWS`].
const TORN_FAR: f32 = 2.5;

/// Ratio of the longer to the shorter exposure time below which equal samples are no sign of a copied frame.
const SAME_EXPOSURE: f32 = 1.2;

/// Share of the samples that show different objects, 0 to 1, from which a frame is tested for tearing.
const TORN_SHARE: f32 = 0.04;

/// Least number of codes of the shorter exposure in [`ENOUGH`] samples, measured or predicted by the longer exposure, from which the other frame is
/// black if all its samples are 0: in dark light, hardly a sample is bright enough for a comparison one by one.
const FAINT_CODES: f32 = 4.0;

/// Result of the comparison of two frames of different exposure.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Comparison {
    /// Deviations of the shorter exposure from the prediction of the longer one, and of the longer one from the prediction of the shorter
    /// one.
    levels: [Deviating; 2],
    /// Natural logarithm of the median ratio of the frames' radiances, 0 if both exposures are as stated; `None` if too few samples can be
    /// compared.
    pub log_ratio: Option<f32>,
    /// Rows in which enough samples have the median ratio.
    pub rows: RowSet,
    /// Share of the samples whose ratio of radiances differs from the median by [`DIFFERENT`], 0 to 1; `None` if too few samples can be compared.
    pub away: Option<f32>,
    /// True if the ratio of radiances has one value in the upper rows and another value in the lower rows.
    pub is_torn: bool,
    /// Natural logarithm of the largest factor between the mean ratios of the rows above and below some row; 0 if few samples differ.
    pub parts: f32,
    /// True if nearly all samples of the two frames are equal although the exposures differ.
    pub is_copy: bool,
    /// For the shorter and the longer frame: true if all its samples are 0 although the other frame has light in enough of them.
    are_blank: [bool; 2],
}

/// Numbers of samples of one frame that are darker or brighter than predicted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Deviating {
    dark: SampleShare,
    bright: SampleShare,
}

impl Deviating {
    /// Counts the sample `found` as darker, brighter or neither, against its prediction `expected`; `least` is the least relative exposure
    /// that is compared.
    fn add(&mut self, found: f32, expected: f32, least: f32) {
        if expected >= least / 2.0 {
            self.dark.add(found < expected.min(1.0) / DARKER);
        }
        if expected < 1.0 / DARKER {
            self.bright.add(found == SATURATED);
        }
    }

    /// Returns the fault of the frame if nearly all of its samples are too dark or saturated.
    fn fault(&self) -> Option<FrameFault> {
        if self.dark.is_nearly_all() {
            return Some(FrameFault::Black);
        }
        self.bright.is_nearly_all().then_some(FrameFault::Saturated)
    }
}

/// Number of samples with a property, and number of samples that were tested for it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct SampleShare {
    part: usize,
    of: usize,
}

impl SampleShare {
    fn add(&mut self, belongs: bool) {
        self.of += 1;
        self.part += usize::from(belongs);
    }

    fn is_nearly_all(self) -> bool {
        self.of >= ENOUGH && self.part as f64 > NEARLY_ALL * self.of as f64
    }
}

/// The samples of two frames that are compared.
#[derive(Clone, Copy)]
pub(super) struct Pair<'a> {
    /// Samples of the frame of shorter exposure.
    pub short: &'a Sampled,
    /// Samples of the frame of longer exposure.
    pub long: &'a Sampled,
    /// Exposure of the shorter frame divided by the exposure of the longer frame, below 1.
    pub factor: f32,
    /// Least relative exposure of a sample that is compared, 0 to 1.
    pub least: f32,
    /// Relative exposure of one code.
    pub code: f32,
}

/// Working memory for the ratios of the samples: in the order of the rows, and for the median of all.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    by_row: Vec<f32>,
    by_size: Vec<f32>,
}

impl Scratch {
    pub fn with_capacity(samples: usize) -> Self {
        Self { by_row: Vec::with_capacity(samples), by_size: Vec::with_capacity(samples) }
    }

    pub fn bytes(&self) -> usize {
        size_of::<f32>() * (self.by_row.capacity() + self.by_size.capacity())
    }
}

impl Comparison {
    /// Compares the two frames of `pair`.
    pub fn new(pair: Pair<'_>, scratch: &mut Scratch) -> Self {
        let mut found = Self::default();
        let mut equal = SampleShare::default();
        let mut ends = [0; ROWS];
        let Scratch { by_row, by_size } = scratch;
        by_row.clear();
        for ((short, long), end) in pair.short.rows().zip(pair.long.rows()).zip(&mut ends) {
            for (a, b) in short.iter().copied().zip(long.iter().copied()) {
                found.add(a, b, &pair, &mut equal, by_row);
            }
            *end = by_row.len();
        }
        found.are_blank = are_blank(&pair);
        found.is_copy = equal.is_nearly_all() && pair.factor.recip() > SAME_EXPOSURE;
        by_size.clone_from(by_row);
        let Some(median) = median(by_size).filter(|_| by_row.len() >= ENOUGH) else { return found };
        found.log_ratio = Some(median.ln());
        let same = median / DIFFERENT..median * DIFFERENT;
        let (mut start, mut away) = (0, by_row.len());
        for (row, end) in found.rows.iter_mut().zip(&ends) {
            let ratios = by_row.get(start..*end).unwrap_or_default();
            let equal = ratios.iter().filter(|ratio| same.contains(*ratio)).count();
            (*row, away, start) = (equal >= ENOUGH_IN_ROW, away - equal, *end);
        }
        if by_row.len() < ENOUGH_FOR_SHARE {
            return found;
        }
        let away = away as f32 / by_row.len() as f32;
        found.away = Some(away);
        if away > TORN_SHARE {
            let medians = Medians::of(by_row, &ends);
            (found.is_torn, found.parts) = (medians.are_two_parts(), medians.parts());
        }
        found
    }

    /// Adds the samples `short` and `long` of the two frames at one position of the grid.
    fn add(
        &mut self,
        short: f32,
        long: f32,
        pair: &Pair<'_>,
        equal: &mut SampleShare,
        ratios: &mut Vec<f32>,
    ) {
        let Pair { factor, least, .. } = *pair;
        if short.max(long) < least {
            return;
        }
        let judged = least..=1.0;
        if judged.contains(&long) {
            self.levels[0].add(short, long * factor, least);
        }
        if judged.contains(&short) {
            self.levels[1].add(long, short / factor, least);
        }
        if short != SATURATED && long != SATURATED {
            equal.add(short == long);
            let predicted = long * factor;
            if short.max(predicted) >= least {
                // A black sample gets the ratio of half of the finest code or less, so that logarithms are finite.
                ratios.push(short.max(1e-6) / predicted.max(1e-6));
            }
        }
    }

    /// Returns the faults of the shorter and of the longer frame that is black or saturated as a whole.
    pub fn level_faults(&self) -> [Option<FrameFault>; 2] {
        let blank = self.are_blank.map(|is_blank| is_blank.then_some(FrameFault::Black));
        let [short, long] = self.levels.map(|levels| levels.fault());
        [short.or(blank[0]), long.or(blank[1])]
    }
}

/// Returns, for the shorter and the longer frame, whether all its samples are 0 although the other frame has light in enough of them.
fn are_blank(pair: &Pair<'_>) -> [bool; 2] {
    let faint = FAINT_CODES * pair.code;
    let is_zero = |frame: &Sampled| frame.rows().flatten().all(|sample| *sample == 0.0);
    let is_lit = |frame: &Sampled, least: f32| {
        let lit = frame.rows().flatten().filter(|sample| **sample >= least && **sample != SATURATED);
        lit.count() >= ENOUGH
    };
    [
        is_zero(pair.short) && is_lit(pair.long, faint / pair.factor),
        is_zero(pair.long) && is_lit(pair.short, faint),
    ]
}

/// Natural logarithms of the median ratios of the rows with enough samples.
#[derive(Default)]
struct Medians {
    rows: [f32; ROWS],
    count: usize,
}

impl Medians {
    /// Computes the medians of `ratios`, whose rows end at `ends`; the elements of each row are reordered.
    fn of(ratios: &mut [f32], ends: &[usize; ROWS]) -> Self {
        let mut medians = Self::default();
        let mut start = 0;
        for end in ends {
            let row = ratios.get_mut(start..*end).unwrap_or_default();
            start = *end;
            if row.len() < ENOUGH_IN_ROW {
                continue;
            }
            if let (Some(slot), Some(median)) = (medians.rows.get_mut(medians.count), median(row)) {
                *slot = median.ln();
                medians.count += 1;
            }
        }
        medians
    }

    /// Returns the largest difference between the means of the medians above and below a row.
    fn parts(&self) -> f32 {
        let rows = &self.rows[..self.count];
        let differences = (1..rows.len()).map(|at| {
            let (upper, lower) = rows.split_at(at);
            (mean(upper) - mean(lower)).abs()
        });
        differences.fold(0.0, f32::max)
    }

    /// Returns true if the medians have one value down to some row and another value below that row.
    fn are_two_parts(&self) -> bool {
        let rows = &self.rows[..self.count];
        let spread = |part: &[f32]| {
            let most = part.iter().copied().fold(f32::MIN, f32::max);
            most - part.iter().copied().fold(f32::MAX, f32::min)
        };
        (1..rows.len()).any(|at| {
            let (upper, lower) = rows.split_at(at);
            let least = if upper.len().min(lower.len()) < TORN_ROWS { TORN_FAR } else { TORN.0 };
            let is_even = spread(upper).max(spread(lower)) < 2.0 * TORN.1.ln();
            is_even && (mean(upper) - mean(lower)).abs() > least.ln()
        })
    }
}

fn mean(values: &[f32]) -> f32 {
    values.iter().sum::<f32>() / values.len() as f32
}

/// Returns the median, of an even number of values the greater one of the middle two; reorders `values`.
pub(super) fn median(values: &mut [f32]) -> Option<f32> {
    let middle = values.len() / 2;
    (!values.is_empty()).then(|| *values.select_nth_unstable_by(middle, f32::total_cmp).1)
}
