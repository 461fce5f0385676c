//! The light of one cell of the map over the last bursts.

use super::fit::{Basis, Estimate, Fit, TERMS};
use super::window::{Past, WINDOW, Window};
use bytemuck::{Pod, Zeroable};

/// Strength of a modulation (F statistic) from which a cell counts as modulated, and below which it counts as steady again.
const MODULATED: f32 = 10.0;
const STEADY: f32 = 4.0;

/// A value is a step where it differs from its prediction by this many standard deviations and by this share of the mean.
const STEP_DEVIATIONS: f32 = 6.0;
const STEP_SHARE: f32 = 0.05;

/// Share by which a value may differ from the known modulation before the modulation counts as another one.
const OTHER_SHAPE: f32 = 0.2;

/// Least light of the known modulation, relative to the mean, from which a mean is computed.
const LEAST_LIGHT: f32 = 0.3;

/// Least light of the known modulation, relative to the mean, from which the first value after a step alone gives the mean. With less light
/// the step counts as a step of the mean.
const HALF_LIGHT: f32 = 0.5;

/// Strength from which a known modulation would be seen in the noise of a fit.
const SEEN: f32 = 40.0;

/// Least mean, relative to that of a modulation, which shows the same lamp.
const SAME_LIGHT: f32 = 0.5;

/// Factor of the mean's weight from burst to burst.
const FORGETTING: f32 = 0.99;

/// Number of harmonics' amplitudes.
const SHAPE: usize = TERMS - 1;

/// The light of a cell over the last bursts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Cell {
    /// Luminance energies of the last bursts.
    pub(super) past: Past,
    /// Amplitudes of the harmonics over the mean, from the last fit that found a modulation.
    pub(super) shape: [f32; SHAPE],
    /// Exponentially weighted sums of the energies; their colour is the colour of the mean.
    pub(super) colour: [f32; 3],
    /// The mean of that fit.
    pub(super) level: f32,
    /// Number of the last burst before the last step.
    pub(super) since: u32,
}

impl Cell {
    /// Whether a modulation is known.
    pub(super) fn has_shape(&self) -> bool {
        self.shape != [0.0; SHAPE]
    }

    /// Takes over the modulation that `found` shows, unless its light is only that of the surroundings of a lamp that is switched off.
    fn learn(&mut self, found: &Estimate) {
        self.level *= FORGETTING;
        if found.mean > (SAME_LIGHT * self.level).max(0.0) {
            self.shape = found.harmonics.map(|a| a / found.mean);
            self.level = found.mean;
        }
    }

    /// Discards the known modulation if `found` has a sufficient mean but no such modulation. With a smaller mean the lamp may be off, and the
    /// light comes from its surroundings.
    fn doubt(&mut self, found: &Estimate) {
        let squares: f32 = self.shape.iter().map(|a| a * a).sum();
        if found.mean > SAME_LIGHT * self.level
            && 0.5 * found.mean * found.mean * squares > SEEN * found.variance()
        {
            self.shape = [0.0; SHAPE];
        }
    }
}

/// The mean of a cell, as far as it is not the newest value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Level {
    /// Luminance energy without modulation.
    pub y: f32,
    /// Amplitude of the fundamental over the mean.
    pub depth: f32,
    /// Whether the cell is modulated by itself, not only as a part of its region.
    pub is_modulated: bool,
}

/// The fits to the last bursts, by the number of bursts.
pub(super) struct Fits {
    pub basis: Basis,
    fits: [Option<Fit>; WINDOW + 1],
    /// The number of bursts whose phases spread most evenly.
    best: usize,
    slots: [usize; WINDOW],
    window: Window,
}

impl Fits {
    /// The fits of `frequency`, whose phase in the newest burst is `phase`.
    pub fn new(window: &Window, phase: f64, frequency: f64) -> Self {
        let basis = Basis::new(window, phase, frequency);
        let fits = core::array::from_fn(|bursts| Fit::new(window, &basis, bursts));
        let best = most_even(window, &basis);
        let slots = core::array::from_fn(|back| window.slot(back));
        Self { basis, fits, best, slots, window: *window }
    }

    /// The fit for a cell of `age`; `None` if so few bursts do not determine a mean.
    fn of(&self, age: usize) -> Option<&Fit> {
        self.fits.get(age.min(self.best))?.as_ref()
    }

    /// The mean of a cell or region; `None` if it is steady, dark, or not determined yet. A cell of a modulated region (`in_region`) is
    /// freed of its modulation even if its own noise hides it.
    pub fn level(&self, cell: &mut Cell, in_region: bool) -> Option<Level> {
        let Some(fit) = self.of(self.window.age(cell.since)) else { return self.of_known_shape(cell) };
        let newest = self.slots[0];
        let found = fit.estimate(&self.basis, &cell.past, newest);
        let (y, strength, depth) = (cell.past[newest], found.strength(), found.depth());
        let without_wave = (y - found.wave).max(0.0);
        if found.is_step(STEP_DEVIATIONS, STEP_SHARE) {
            cell.since = self.window.number().wrapping_sub(1);
            if cell.has_shape() && self.light(cell, newest) < HALF_LIGHT {
                return Some(Level { y: without_wave, depth, is_modulated: true });
            }
            return self.of_known_shape(cell);
        }
        if strength > if cell.has_shape() { STEADY } else { MODULATED } {
            if strength > MODULATED {
                cell.learn(&found);
            }
            return Some(Level { y: found.mean.max(0.0), depth, is_modulated: true });
        }
        cell.doubt(&found);
        in_region.then_some(Level { y: without_wave, depth, is_modulated: false })
    }

    /// Light of the known modulation of `cell` at one burst, relative to its mean.
    fn light(&self, cell: &Cell, slot: usize) -> f32 {
        let [_, terms @ ..] = self.basis.at(slot);
        1.0 + cell.shape.iter().zip(terms).map(|(a, t)| a * t).sum::<f32>()
    }

    /// The mean of a cell since its last step, from the modulation that it had before; `None` if it had none, or is darkest now or as dark as
    /// without the lamp.
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
        let [cos, sin, ..] = cell.shape;
        Some(Level { y: mean.max(0.0), depth: libm::hypotf(cos, sin), is_modulated: true })
    }
}

/// The number of bursts, at least half of the window, over which the mean of the first four harmonics is closest to 0.
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
