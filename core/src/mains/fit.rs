//! Least-squares fits of a mean and three harmonics to the energies of a cell in the last bursts.
//!
//! All cells have the same times of the bursts, so that a fit is computed once for each number of bursts and applied to a cell as a few
//! scalar products.

use super::window::Window;
use super::window::{PastValues, WINDOW};
use core::f64::consts::TAU;
use core::ops::Range;

/// Number of terms of a fit: the mean, then cosine and sine of one, two and three times the frequency.
pub(super) const TERMS: usize = 7;

/// Number of terms of a fit with two harmonics, and with one.
const TWO_HARMONICS: usize = 5;
const FUNDAMENTAL: usize = 3;

/// Number of degrees of freedom at which a variance is doubled for the comparison with steps.
const FEW: f32 = 12.0;

/// Number that is added per burst to the diagonal of the normal equations, so that harmonics that have equal phases in all bursts have
/// equal amplitudes.
const RIDGE: f64 = 1e-3;

/// Largest variance of the mean of a fit, relative to the variance of the mean of as many independent samples. Phases that do not spread
/// over the period exceed this limit and do not determine the mean.
const MOST_VARIANCE: f64 = 3.0;

/// The values of the terms of a fit in the bursts of a window, by slot.
#[derive(Clone, Copy, Debug)]
pub(super) struct Basis(pub [PastValues; TERMS]);

impl Basis {
    /// Computes the terms of a modulation of `frequency` at the times of `window`; `phase` is the phase of the newest burst, periods.
    pub fn new(window: &Window, phase: f64, frequency: f64) -> Self {
        let mut terms = [[0.0; WINDOW]; TERMS];
        for back in 0..window.count() {
            let (sin, cos) = libm::sincos(TAU * fraction(phase - frequency * window.since(back)));
            let slot = window.slot(back);
            terms.iter_mut().zip(terms_of(cos, sin)).for_each(|(term, value)| term[slot] = value as f32);
        }
        Self(terms)
    }

    /// Returns the values of the terms in the burst at `slot`.
    pub fn at(&self, slot: usize) -> [f32; TERMS] {
        self.0.map(|term| term[slot % WINDOW])
    }
}

/// Returns the terms of a fit at the phase with the cosine `cos` and the sine `sin`.
fn terms_of(cos: f64, sin: f64) -> [f64; TERMS] {
    let [cos2, sin2] = [cos * cos - sin * sin, 2.0 * sin * cos];
    [1.0, cos, sin, cos2, sin2, cos2 * cos - sin2 * sin, sin2 * cos + cos2 * sin]
}

/// Returns the fractional part of `turns`, 0..1.
pub(super) fn fraction(turns: f64) -> f64 {
    turns - libm::floor(turns)
}

/// The fit to the newest bursts of a window.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fit {
    /// Number of bursts to which the model is fitted.
    pub bursts: usize,
    terms: usize,
    /// Coefficients of each term: the amplitude of the term is the scalar product of its row and the values.
    rows: [PastValues; TERMS],
    /// 1 for the bursts of the fit, 0 for older ones.
    mask: PastValues,
    /// Weight of the newest value in the fit's prediction of this value.
    leverage: f32,
    /// Variance of the mean of the fit, divided by the variance of the residuals.
    of_mean: f32,
}

impl Fit {
    /// Computes the fit to the newest `bursts` bursts of `window` with as many terms as they determine; `None` if they do not determine the
    /// mean.
    pub fn new(window: &Window, basis: &Basis, bursts: usize) -> Option<Self> {
        [TERMS, TWO_HARMONICS, FUNDAMENTAL]
            .into_iter()
            .find_map(|terms| Self::of_terms(window, basis, bursts, terms))
    }

    /// Computes the fit of the mean and the fundamental to the newest `bursts` bursts; `None` if the bursts do not determine the mean.
    pub fn fundamental(window: &Window, basis: &Basis, bursts: usize) -> Option<Self> {
        Self::of_terms(window, basis, bursts, FUNDAMENTAL)
    }

    /// Computes the fit of the first `terms` terms to the newest `bursts` bursts; `None` if the bursts do not determine the mean.
    fn of_terms(window: &Window, basis: &Basis, bursts: usize, terms: usize) -> Option<Self> {
        Self::of_range(window, basis, 0..bursts, terms).map(|(fit, _)| fit)
    }

    /// Computes the fit of the first `terms` terms to the bursts of `range`, of which burst 0 is the newest of the window, and the inverse of the
    /// normal equations; `None` if the bursts do not determine the mean.
    fn of_range(window: &Window, basis: &Basis, range: Range<usize>, terms: usize) -> Option<(Self, Square)> {
        let bursts = range.len();
        if bursts < terms + 2 || range.end > window.count() {
            return None;
        }
        let normal = normal_equations(window, basis, range.clone());
        let inverse = inverse(normal, terms);
        let variance = inverse[0][0] * bursts as f64;
        if variance.is_nan() || variance > MOST_VARIANCE {
            return None;
        }
        let (mut rows, mut mask) = ([[0.0; WINDOW]; TERMS], [0.0; WINDOW]);
        for slot in range.map(|back| window.slot(back)) {
            let at = basis.at(slot);
            rows.iter_mut().zip(inverse).for_each(|(row, inverse)| row[slot] = product(&inverse, &at));
            mask[slot] = 1.0;
        }
        let newest = window.slot(0);
        let leverage = rows.iter().zip(basis.at(newest)).map(|(row, term)| row[newest] * term).sum();
        Some((Self { bursts, terms, rows, mask, leverage, of_mean: inverse[0][0] as f32 }, inverse))
    }

    /// Returns the number of degrees of freedom of the residuals.
    pub fn freedom(&self) -> usize {
        self.bursts.saturating_sub(self.terms)
    }

    /// Fits the values `past` of a cell; `newest` is the slot of the newest burst.
    pub fn estimate(&self, basis: &Basis, past: &PastValues, newest: usize) -> Estimate {
        let mut amplitudes = [0.0; TERMS];
        let used = amplitudes.iter_mut().zip(&self.rows).take(self.terms);
        used.for_each(|(a, row)| *a = dot(row, past));
        let [mean, harmonics @ ..] = amplitudes;
        // Loops over the bursts of one term at a time use vector instructions.
        let (mut wave, mut rest) = ([0.0; WINDOW], *past);
        let [_, terms @ ..] = &basis.0;
        for (amplitude, term) in harmonics.iter().zip(terms).take(self.terms - 1) {
            wave.iter_mut().zip(term).for_each(|(wave, term)| *wave += amplitude * term);
        }
        wave.iter_mut().zip(&self.mask).for_each(|(wave, mask)| *wave *= mask);
        rest.iter_mut().zip(&self.mask).for_each(|(rest, mask)| *rest = mask * (*rest - mean));
        rest.iter_mut().zip(&wave).for_each(|(rest, wave)| *rest -= wave);
        let left = (1.0 - self.leverage).max(0.05);
        let (residual, squares) = (rest[newest % WINDOW], dot(&rest, &rest));
        Estimate {
            mean,
            harmonics,
            wave: wave[newest % WINDOW],
            surprise: residual / left,
            left,
            noise: (squares - residual * residual / left).max(0.0),
            squares,
            waves: dot(&wave, &wave),
            of_mean: self.of_mean,
            freedom: self.freedom() as f32,
            used: (self.terms - 1) as f32,
        }
    }
}

/// Differences of phases, periods, at which a modulation has values that are no step. A rectangle that is recorded at seven phases changes from
/// full to no light in one of them if its phase changes a little.
const NEAR: [f64; 5] = [-1.0 / 7.0, -1.0 / 14.0, 0.0, 1.0 / 14.0, 1.0 / 7.0];

/// The prediction of the newest value of a cell from all values of a full window but the newest two.
#[derive(Clone, Copy, Debug)]
pub(super) struct Prediction {
    fit: Fit,
    /// The terms of the fit at the phases [`NEAR`] the phase of the newest burst.
    near: [[f32; TERMS]; NEAR.len()],
    /// Variance of the difference between a value and its prediction, divided by the variance of the residuals.
    variance: f32,
}

impl Prediction {
    /// Computes the prediction in a full `window`; `None` if the window is not full, or if its bursts do not determine the mean.
    pub fn new(window: &Window, basis: &Basis) -> Option<Self> {
        let (fit, inverse) = Fit::of_range(window, basis, 2..WINDOW, TERMS)?;
        let at = basis.at(window.slot(0));
        let own = inverse.iter().zip(at).map(|(row, term)| product(row, &at) * term).sum::<f32>();
        let [_, cos, sin, ..] = at.map(f64::from);
        let near = NEAR.map(|turns| {
            let (s, c) = libm::sincos(TAU * turns);
            terms_of(cos * c - sin * s, sin * c + cos * s).map(|term| term as f32)
        });
        Some(Self { fit, near, variance: 1.0 + own.max(0.0) })
    }

    /// Returns whether the value `past[newest]` differs from all predictions of near phases by more than `deviations` standard deviations of such a
    /// difference and by more than the fraction `least` of the amplitude of the modulation.
    pub fn is_missed(
        &self,
        basis: &Basis,
        past: &PastValues,
        newest: usize,
        deviations: f32,
        least: f32,
    ) -> bool {
        let found = self.fit.estimate(basis, past, newest);
        let (mut low, mut high) = (f32::INFINITY, f32::NEG_INFINITY);
        for [_, terms @ ..] in &self.near {
            let wave = found.harmonics.iter().zip(terms).map(|(a, t)| a * t).sum::<f32>();
            let y = found.mean + wave;
            // `f32::min` calls a function on ARMv7.
            low = if y < low { y } else { low };
            high = if y > high { y } else { high };
        }
        let y = past[newest % WINDOW];
        let off = (low - y).max(y - high).max(0.0);
        let variance = found.variance() * self.variance;
        let squares = found.harmonics.iter().map(|a| a * a).sum::<f32>();
        off * off > (deviations * deviations * variance).max(least * least * squares)
    }
}

/// Mean and modulation of a cell over the bursts of a fit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Estimate {
    /// Mean of the fitted values over a period.
    pub mean: f32,
    /// Amplitudes of the harmonics: cosine and sine of each.
    pub harmonics: [f32; TERMS - 1],
    /// Fitted modulation in the newest burst: the fitted value minus the mean.
    pub wave: f32,
    /// Difference between the newest value and its prediction from the other values.
    pub surprise: f32,
    /// Variance of the residuals divided by the variance of [`Estimate::surprise`].
    left: f32,
    /// Sum of the squared residuals of all values but the newest.
    noise: f32,
    /// Sum of the squared residuals of all values.
    squares: f32,
    /// Sum of the squares of the fitted modulation over the bursts.
    waves: f32,
    /// Variance of the mean, divided by the variance of the residuals.
    of_mean: f32,
    /// Number of degrees of freedom of the residuals, and of the modulation.
    freedom: f32,
    used: f32,
}

impl Estimate {
    /// Returns the ratio of the variance of the modulation to the variance of the residuals (the F statistic).
    pub fn strength(&self) -> f32 {
        let floor = 1e-12 * self.mean * self.mean + f32::MIN_POSITIVE;
        (self.waves / self.used) / (self.squares / self.freedom + floor)
    }

    /// Returns whether the newest value differs from its prediction by more than `deviations` standard deviations of such a difference and by
    /// more than the fraction `least` of the mean.
    pub fn is_step(&self, deviations: f32, least: f32) -> bool {
        let freedom = (self.freedom - 1.0).max(1.0);
        // The variance of few residuals is an underestimate.
        let variance = self.noise / freedom * (1.0 + FEW / freedom) / self.left;
        let squared = self.surprise * self.surprise;
        squared > deviations * deviations * variance && squared > (least * self.mean) * (least * self.mean)
    }

    /// Returns the amplitude of the fundamental, relative to the mean.
    pub fn depth(&self) -> f32 {
        let [cos, sin, ..] = self.harmonics;
        if self.mean > 0.0 { libm::sqrtf(cos * cos + sin * sin) / self.mean } else { 0.0 }
    }

    /// Returns the variance of the residuals of the fit.
    pub fn variance(&self) -> f32 {
        self.squares / self.freedom.max(1.0)
    }

    /// Returns the standard deviation of the mean that the residuals imply.
    pub fn error_of_mean(&self) -> f32 {
        libm::sqrtf(self.variance() * self.of_mean)
    }

    /// Returns the sum of the squared residuals.
    pub fn squares(&self) -> f32 {
        self.squares
    }
}

/// A matrix with a row and a column for each term of a fit.
type Square = [[f64; TERMS]; TERMS];

/// Returns the sums of the products of the terms over the bursts of `range`, with the ridge on the diagonal.
fn normal_equations(window: &Window, basis: &Basis, range: Range<usize>) -> Square {
    let mut sums = [[0.0; TERMS]; TERMS];
    let bursts = range.len();
    for back in range {
        let at = basis.at(window.slot(back)).map(f64::from);
        for (row, a) in sums.iter_mut().zip(at) {
            row.iter_mut().zip(at).for_each(|(sum, b)| *sum += a * b);
        }
    }
    for (i, row) in sums.iter_mut().enumerate().skip(1) {
        row[i] += RIDGE * bursts as f64;
    }
    sums
}

/// Returns the inverse of the leading `terms` rows and columns of a positive definite matrix by Gauss-Jordan elimination; the other
/// elements are 0.
fn inverse(mut a: Square, terms: usize) -> Square {
    let mut inverse = [[0.0; TERMS]; TERMS];
    (0..terms).for_each(|i| inverse[i][i] = 1.0);
    for pivot in 0..terms {
        let scale = 1.0 / a[pivot][pivot];
        (0..terms).for_each(|j| {
            (a[pivot][j], inverse[pivot][j]) = (a[pivot][j] * scale, inverse[pivot][j] * scale);
        });
        let (of, own) = (a[pivot], inverse[pivot]);
        for row in (0..terms).filter(|row| *row != pivot) {
            let factor = a[row][pivot];
            for j in 0..terms {
                a[row][j] -= factor * of[j];
                inverse[row][j] -= factor * own[j];
            }
        }
    }
    inverse
}

fn product(a: &[f64; TERMS], b: &[f32; TERMS]) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * f64::from(*b)).sum::<f64>() as f32
}

/// Returns the scalar product of the values `a` and `b`, summed in four lanes.
pub(super) fn dot(a: &PastValues, b: &PastValues) -> f32 {
    let mut lanes = [0.0f32; 4];
    for (a, b) in a.as_chunks::<4>().0.iter().zip(b.as_chunks::<4>().0) {
        lanes.iter_mut().zip(a.iter().zip(b)).for_each(|(lane, (a, b))| *lane += a * b);
    }
    (lanes[0] + lanes[1]) + (lanes[2] + lanes[3])
}
