//! The comparison of one frame with another one.

use super::samples::{ROWS, SATURATED, Sampled};
use hemilux_core::wire::FrameFault;

/// A sample contradicts a prediction where it is below or above it by this factor.
const DARKER: f32 = 8.0;

/// Samples whose radiance differs by more than this factor, beside the median ratio, show different things.
const DIFFERENT: f32 = 1.4;

/// Share of dark (or saturated) samples above which a frame is black (or overexposed), and of equal ones above which it is a copy.
const NEARLY_ALL: f64 = 0.9;

/// Fewest samples that a judgement rests on.
const ENOUGH: usize = 64;

/// Fewest samples of a row whose median is used.
const ENOUGH_IN_ROW: usize = 8;

/// Least factor between the two parts of a torn frame, and largest factor within a part.
const TORN: (f32, f32) = (1.5, 1.15);

/// Fewest rows of a part of a torn frame.
const TORN_ROWS: usize = 3;

/// Exposures that differ by less may have equal samples.
const SAME_EXPOSURE: f32 = 1.2;

/// What the samples of one frame show against those of another one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Comparison {
    dark: Share,
    bright: Share,
    /// Number of ratios.
    count: usize,
    /// Logarithm of the median ratio of radiances, 0 where both exposures are as stated; none where too few samples can be compared.
    pub log_ratio: Option<f32>,
    /// Share of the samples whose ratio differs from the median one.
    pub away: f32,
    /// Whether the ratio is one in the upper rows and another one in the lower rows.
    pub is_torn: bool,
    /// Whether the samples are equal although the exposures are not.
    pub is_copy: bool,
}

/// A number of samples out of another one.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Share {
    part: usize,
    of: usize,
}

impl Share {
    fn is_nearly_all(self) -> bool {
        self.of >= ENOUGH && self.part as f64 > NEARLY_ALL * self.of as f64
    }
}

/// The samples of one place in two frames.
#[derive(Clone, Copy)]
struct Samples {
    /// Relative exposure in the frame that is compared.
    a: f32,
    /// Relative exposure in the frame that predicts.
    b: f32,
    factor: f32,
    least: f32,
}

impl Comparison {
    /// Compares `of` with what `by` predicts; `factor` is the exposure of `of` over that of `by`, `least` the least
    /// relative exposure that is judged. `ratios` is scratch memory.
    pub fn new(of: &Sampled, by: &Sampled, factor: f32, least: f32, ratios: &mut Vec<f32>) -> Self {
        let mut found = Self::default();
        let mut equal = Share::default();
        let mut rows = Medians::default();
        ratios.clear();
        for (of, by) in of.rows().zip(by.rows()) {
            let before = ratios.len();
            for (a, b) in of.iter().copied().zip(by.iter().copied()) {
                found.add(Samples { a, b, factor, least }, ratios);
                let is_lit = a != SATURATED && a.max(b) >= least;
                equal.of += usize::from(is_lit);
                equal.part += usize::from(is_lit && a == b);
            }
            rows.add(&mut ratios[before..]);
        }
        found.is_copy = equal.is_nearly_all() && (factor > SAME_EXPOSURE || factor.recip() > SAME_EXPOSURE);
        if ratios.len() >= ENOUGH
            && let Some(median) = median(ratios)
        {
            found.count = ratios.len();
            found.log_ratio = Some(median.ln());
            let is_away = |r: &&f32| !(median / DIFFERENT..median * DIFFERENT).contains(*r);
            found.away = ratios.iter().filter(is_away).count() as f32 / ratios.len() as f32;
            found.is_torn = rows.are_two_parts();
        }
        found
    }

    fn add(&mut self, Samples { a, b, factor, least }: Samples, ratios: &mut Vec<f32>) {
        if !(least..=1.0).contains(&b) {
            return;
        }
        let expected = (b * factor).min(1.0);
        if expected >= least / 2.0 {
            self.dark.of += 1;
            self.dark.part += usize::from(a < expected / DARKER);
        }
        if expected < 1.0 / DARKER {
            self.bright.of += 1;
            self.bright.part += usize::from(a == SATURATED);
        }
        if a != SATURATED && b * factor >= least {
            // A black sample has the ratio of one below the finest code, so that logarithms are finite.
            ratios.push(a.max(1e-6) / (b * factor));
        }
    }

    /// What this comparison and that in the other direction show of the pair: a part of a frame may be seen in one direction alone.
    pub fn and(&self, other: &Self) -> Self {
        let log_ratio = if other.count > self.count { other.log_ratio.map(|r| -r) } else { self.log_ratio };
        Self {
            log_ratio,
            away: self.away.max(other.away),
            is_torn: self.is_torn || other.is_torn,
            is_copy: self.is_copy || other.is_copy,
            ..*self
        }
    }

    /// A frame that is black or saturated as a whole.
    pub fn level(&self) -> Option<FrameFault> {
        if self.dark.is_nearly_all() {
            return Some(FrameFault::Black);
        }
        self.bright.is_nearly_all().then_some(FrameFault::Saturated)
    }
}

/// Logarithms of the median ratios of the rows that have enough samples.
#[derive(Default)]
struct Medians {
    rows: [f32; ROWS],
    count: usize,
}

impl Medians {
    fn add(&mut self, ratios: &mut [f32]) {
        if ratios.len() < ENOUGH_IN_ROW {
            return;
        }
        if let (Some(slot), Some(median)) = (self.rows.get_mut(self.count), median(ratios)) {
            *slot = median.ln();
            self.count += 1;
        }
    }

    /// Whether the rows have one value down to some row and another one from there on.
    fn are_two_parts(&self) -> bool {
        let rows = &self.rows[..self.count];
        let spread = |part: &[f32]| {
            let most = part.iter().copied().fold(f32::MIN, f32::max);
            most - part.iter().copied().fold(f32::MAX, f32::min)
        };
        let mean = |part: &[f32]| part.iter().sum::<f32>() / part.len() as f32;
        (TORN_ROWS..(rows.len() + 1).saturating_sub(TORN_ROWS)).any(|at| {
            let (upper, lower) = rows.split_at(at);
            let is_even = spread(upper).max(spread(lower)) < 2.0 * TORN.1.ln();
            is_even && (mean(upper) - mean(lower)).abs() > TORN.0.ln()
        })
    }
}

fn median(ratios: &mut [f32]) -> Option<f32> {
    let middle = ratios.len() / 2;
    (!ratios.is_empty()).then(|| *ratios.select_nth_unstable_by(middle, f32::total_cmp).1)
}
