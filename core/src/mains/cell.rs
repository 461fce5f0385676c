//! The energies of one cell of the map in the last bursts, and the modulation that is fitted to them.

use super::fit::{Basis, Estimate, Fit, Prediction, TERMS};
use super::window::{PastValues, WINDOW, Window};
use bytemuck::{Pod, Zeroable};

/// Strength of a modulation (F statistic) from which a cell counts as modulated, and below which the cell counts as steady again.
const MODULATED: f32 = 10.0;
const STEADY: f32 = 4.0;

/// Number of standard deviations, and fraction of the mean, by both of which a value must differ from its prediction to count as a step.
const STEP_DEVIATIONS: f32 = 6.0;
const STEP_SHARE: f32 = 0.05;

/// Fraction of the amplitude of a modulation by which a value must differ from its [`Prediction`] to count as a step: the standard deviation that
/// seven degrees of freedom imply is inexact.
const STEP_AMPLITUDE: f32 = 0.5;

/// Fraction of the amplitude of the modulation of the last fit by which a value must differ from this modulation for a comparison with its
/// [`Prediction`]: half of [`STEP_AMPLITUDE`], because the modulations of both fits differ.
const OFF_SHAPE: f32 = 0.25;

/// Difference between a value and the modulation of the last fit, relative to the mean, above which that modulation is discarded.
const OTHER_SHAPE: f32 = 0.2;

/// Difference between a value and the modulation of the last fit, divided by the amplitude of the second and third harmonics together, up to which
/// the value is no step: three harmonics differ so much from a rectangle at its edges.
const AT_EDGES: f32 = 1.5;

/// Least light of the last fit's modulation in a burst, relative to its mean, from which a mean is computed.
const LEAST_LIGHT: f32 = 0.3;

/// Least light of the last fit's modulation in a burst, relative to its mean, with which a single value after a step determines the mean.
/// With less light, the mean is taken from the fit that includes the step.
const HALF_LIGHT: f32 = 0.5;

/// Strength (F statistic) of a modulation that is distinguishable from the noise of a fit.
const SEEN: f32 = 40.0;

/// Ratio of a mean to the mean of the last modulated fit above which both means are of the same lamp.
const SAME_LIGHT: f32 = 0.5;

/// Factor per fit by which the mean of the last modulated fit is reduced, so that an old mean loses its effect.
const FORGETTING: f32 = 0.97;

/// Number of bursts from one fit of a cell to the next while the values of the cell are those of its last fit.
pub(super) const FIT_EVERY: usize = 4;

/// Number of amplitudes of the harmonics in a fit: cosine and sine of each.
const SHAPE: usize = TERMS - 1;

/// Weight of the newest fit in the mean of the means of successive fits.
const NEW_LEVEL: f32 = 1.0 / 4.0;

/// The energies of a cell in the last bursts, and its modulation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Cell {
    /// Luminance energies of the cell in the last bursts.
    pub(super) past: PastValues,
    /// Amplitudes of the harmonics, relative to the mean, from the last fit with a significant modulation; all 0 without one.
    pub(super) shape: [f32; SHAPE],
    /// Exponentially weighted means of the cell's red, green and blue energy; their ratio is the colour of the cell's mean.
    pub(super) colour: [f32; 3],
    /// Mean luminance energy of the last fits with a significant modulation ([`Cell::smoothed`]).
    pub(super) level: f32,
    /// Mean luminance energy of the last fit; 0 if that fit had no significant modulation.
    pub(super) fitted: f32,
    /// Number of the last burst before the cell's last step.
    pub(super) since: u32,
}

impl Cell {
    /// Returns whether the cell has a modulation from an earlier fit.
    pub(super) fn has_shape(&self) -> bool {
        self.shape != [0.0; SHAPE]
    }

    /// Returns the amplitude of the fundamental of the stored modulation, relative to the mean.
    fn depth(&self) -> f32 {
        let [cos, sin, ..] = self.shape;
        libm::sqrtf(cos * cos + sin * sin)
    }

    /// Returns the mean of the fits of successive bursts, of which `found` is the newest. It differs from the mean of `found` by at
    /// most the standard deviation that the residuals imply: three harmonics leave residuals of a rectangle, by which the means of successive
    /// fits differ; the residuals of a sinusoid are noise, so that its mean is hardly smoothed.
    fn smoothed(&self, found: &Estimate) -> f32 {
        let smoothed = self.level + NEW_LEVEL * (found.mean - self.level);
        let error = found.error_of_mean();
        smoothed.max(found.mean - error).min(found.mean + error)
    }

    /// Stores the modulation of the fit `found` and its smoothed mean `level`, unless the mean is so small that the lamp is off and the light
    /// comes from its surroundings.
    fn learn(&mut self, found: &Estimate, level: f32) {
        self.level *= FORGETTING;
        if found.mean > (SAME_LIGHT * self.level).max(0.0) {
            self.shape = found.harmonics.map(|a| a / found.mean);
            self.level = level;
        }
    }

    /// Discards the stored modulation if the fit `found` has a sufficient mean but no such modulation. With a smaller mean, the lamp may be off
    /// and the light may come from its surroundings.
    fn doubt(&mut self, found: &Estimate) {
        let squares: f32 = self.shape.iter().map(|a| a * a).sum();
        if found.mean > SAME_LIGHT * self.level
            && 0.5 * found.mean * found.mean * squares > SEEN * found.variance()
        {
            self.shape = [0.0; SHAPE];
        }
    }
}

/// The energy of a cell without its modulation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Level {
    /// Luminance energy of the cell without modulation.
    pub y: f32,
    /// Amplitude of the fundamental, relative to the mean.
    pub depth: f32,
    /// Whether the cell itself is modulated; `false` for a cell that is corrected because its region is modulated.
    pub is_modulated: bool,
}

/// The fits to the last bursts, one for each number of bursts.
pub(super) struct Fits {
    pub basis: Basis,
    fits: [Option<Fit>; WINDOW + 1],
    /// The number of last bursts whose phases are spread most evenly.
    best: usize,
    /// The prediction of the newest values from the values before the last; `None` if the window is not full.
    prediction: Option<Prediction>,
    slots: [usize; WINDOW],
    window: Window,
    /// Whether the window has bursts of other merged exposures.
    is_reselected: bool,
}

impl Fits {
    /// Computes the fits of a modulation of `frequency`, whose phase in the newest burst is `phase` periods. `is_reselected` states whether bursts of
    /// other merged exposures are in the window.
    pub fn new(window: &Window, phase: f64, frequency: f64, is_reselected: bool) -> Self {
        let basis = Basis::new(window, phase, frequency);
        let fits = core::array::from_fn(|bursts| Fit::new(window, &basis, bursts));
        let best = most_even(window, &basis);
        let prediction = Prediction::new(window, &basis);
        let slots = core::array::from_fn(|back| window.slot(back));
        Self { basis, fits, best, prediction, slots, window: *window, is_reselected }
    }

    /// Returns the fit to the last `age` bursts of a cell; `None` if so few bursts do not determine a mean.
    fn of(&self, age: usize) -> Option<&Fit> {
        self.fits.get(age.min(self.best))?.as_ref()
    }

    /// Returns the energy without modulation of a cell or region; `None` if it is steady, dark, or not determined yet. A cell of a
    /// modulated region (`in_region`) is corrected even if its modulation is below the noise.
    ///
    /// A cell that is not `due` for a fit, and whose newest value is that of its last fit, has the mean of that fit.
    pub fn level(&self, cell: &mut Cell, in_region: bool, due: bool) -> Option<Level> {
        if !due && self.keeps_fit(cell) {
            return Some(Level { y: cell.fitted, depth: cell.depth(), is_modulated: true });
        }
        let found = self.fit_level(cell, in_region);
        cell.fitted = found.filter(|level| level.is_modulated).map_or(0.0, |level| level.y);
        found
    }

    /// Returns whether the newest value of `cell` is that of its last fit.
    fn keeps_fit(&self, cell: &Cell) -> bool {
        let is_of_full_window = self.window.age(cell.since) == WINDOW && !self.is_reselected;
        is_of_full_window && cell.fitted > 0.0 && cell.has_shape() && !self.is_off(cell, cell.fitted)
    }

    /// Returns [`Fits::level`] from a fit to the last bursts.
    fn fit_level(&self, cell: &mut Cell, in_region: bool) -> Option<Level> {
        let Some(fit) = self.of(self.window.age(cell.since)) else { return self.of_known_shape(cell) };
        let newest = self.slots[0];
        let found = fit.estimate(&self.basis, &cell.past, newest);
        let (y, strength, depth) = (cell.past[newest], found.strength(), found.depth());
        let without_wave = (y - found.wave).max(0.0);
        let is_step = found.is_step(STEP_DEVIATIONS, STEP_SHARE) && !self.is_of_shape(cell);
        if is_step || self.departs(cell) {
            cell.since = self.window.number().wrapping_sub(1);
            if self.is_reselected {
                cell.shape = [0.0; SHAPE];
                return None;
            }
            if cell.has_shape() && self.light(cell, newest) < HALF_LIGHT {
                return Some(Level { y: without_wave, depth, is_modulated: true });
            }
            return self.of_known_shape(cell);
        }
        if strength > if cell.has_shape() { STEADY } else { MODULATED } {
            // Fits to few bursts, or to bursts of several merged exposures, have other means than the following fits.
            let is_like_the_next = self.window.age(cell.since) == WINDOW && !self.is_reselected;
            let is_smoothed = cell.has_shape() && is_like_the_next;
            let y = if is_smoothed { cell.smoothed(&found) } else { found.mean };
            if strength > MODULATED {
                cell.learn(&found, y);
            }
            return Some(Level { y: y.max(0.0), depth, is_modulated: true });
        }
        cell.doubt(&found);
        in_region.then_some(Level { y: without_wave, depth, is_modulated: false })
    }

    /// Returns whether the newest value of `cell` is that of its stored modulation.
    fn is_of_shape(&self, cell: &Cell) -> bool {
        let newest = self.slots[0];
        let off = cell.past[newest] - cell.level * self.light(cell, newest);
        let [_, _, harmonics @ ..] = cell.shape;
        let harmonics = libm::sqrtf(harmonics.iter().map(|a| a * a).sum());
        cell.has_shape() && off.abs() <= AT_EDGES * harmonics * cell.level
    }

    /// Returns whether the newest value of `cell` differs from the modulation in the bursts before the last one: the light may have begun to change
    /// in the last burst. The prediction takes more work than a fit and is computed for values that differ from the stored modulation.
    fn departs(&self, cell: &Cell) -> bool {
        let is_full = cell.has_shape() && self.window.age(cell.since) == WINDOW;
        is_full
            && self.is_off(cell, cell.level)
            && self.prediction.as_ref().is_some_and(|prediction| {
                let newest = self.slots[0];
                prediction.is_missed(&self.basis, &cell.past, newest, STEP_DEVIATIONS, STEP_AMPLITUDE)
            })
    }

    /// Returns whether the newest value of `cell` differs from the stored modulation of the mean `mean` by more than [`OFF_SHAPE`] of its
    /// amplitude.
    fn is_off(&self, cell: &Cell, mean: f32) -> bool {
        let newest = self.slots[0];
        let off = cell.past[newest] - mean * self.light(cell, newest);
        let squares = cell.shape.iter().map(|a| a * a).sum::<f32>();
        off * off > OFF_SHAPE * OFF_SHAPE * squares * mean * mean
    }

    /// Returns the light of the stored modulation of `cell` in the burst at `slot`, relative to the mean of the modulation.
    fn light(&self, cell: &Cell, slot: usize) -> f32 {
        let [_, terms @ ..] = self.basis.at(slot);
        1.0 + cell.shape.iter().zip(terms).map(|(a, t)| a * t).sum::<f32>()
    }

    /// Returns the mean energy of a cell since its last step, computed from the modulation before the step; `None` if the cell had none, or if
    /// the light is too low to compute a mean.
    fn of_known_shape(&self, cell: &mut Cell) -> Option<Level> {
        if !cell.has_shape() {
            return None;
        }
        let expected = |slot: usize| self.light(cell, slot);
        let (mut product, mut squares) = (0.0, 0.0);
        let age = self.window.age(cell.since);
        for slot in self.slots.iter().take(age) {
            let light = expected(*slot);
            product += light * cell.past[*slot];
            squares += light * light;
        }
        if squares < LEAST_LIGHT * LEAST_LIGHT * age as f32 {
            return None;
        }
        let mean = product / squares;
        if mean < SAME_LIGHT * LEAST_LIGHT * cell.level {
            return None;
        }
        let off = cell.past[self.slots[0]] - mean * expected(self.slots[0]);
        if off.abs() > OTHER_SHAPE * mean {
            cell.shape = [0.0; SHAPE];
            cell.since = self.window.number().wrapping_sub(1);
            return None;
        }
        Some(Level { y: mean.max(0.0), depth: cell.depth(), is_modulated: true })
    }
}

/// Returns the number of bursts, at least half of the window, over which the mean of the first four harmonics is closest to 0.
fn most_even(window: &Window, basis: &Basis) -> usize {
    let mut sums = [[0.0f32; 2]; 4];
    let mut best = (f32::INFINITY, 0);
    for bursts in 1..=window.count() {
        let [_, cos, sin, cos2, sin2, cos3, sin3] = basis.at(window.slot(bursts - 1));
        let fourth = [cos2 * cos2 - sin2 * sin2, 2.0 * sin2 * cos2];
        for (sum, at) in sums.iter_mut().zip([[cos, sin], [cos2, sin2], [cos3, sin3], fourth]) {
            sum.iter_mut().zip(at).for_each(|(sum, at)| *sum += at);
        }
        let uneven = sums.iter().flatten().map(|v| v * v).sum::<f32>() / (bursts * bursts) as f32;
        if bursts >= WINDOW / 2 && uneven <= best.0 + 1e-6 {
            best = (uneven, bursts);
        }
    }
    if best.1 > 0 { best.1 } else { window.count() }
}
