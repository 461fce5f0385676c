//! Searches and follows the frequency at which the light of a map varies.

use super::cell::Cell;
use super::fit::{Basis, Estimate, Fit, dot, fraction};
use super::window::{WINDOW, Window};

/// Frequencies at which the light of lamps on the mains varies, hertz: twice the frequency of the mains.
pub(super) const LAMPS_HZ: [f64; 2] = [100.0, 120.0];

/// Step of the frequencies that are searched, hertz, and number of steps to each side of a nominal frequency.
const STEP_HZ: f64 = 0.1;
const STEPS: i32 = 4;

/// Distance, in steps, of the frequencies that are tried first, and the explained fraction of the variance above which the frequencies
/// between them are tried.
const COARSE: i32 = 3;
const PROMISING: f32 = 0.25;

/// Number of bursts between two searches: a search takes as many instructions as the rest of the stage.
const SEARCH_EVERY: u32 = 4;

/// Fraction of the variance, per step from the nominal frequency, by which another frequency must explain more than the nominal one.
const OFF_NOMINAL: f32 = 0.01;

/// Step and range of the frequencies that are searched in bursts without times, periods per burst.
const STEP_PER_BURST: f64 = 0.02;
const PER_BURST: [f64; 2] = [0.06, 0.5];

/// Least number of bursts for a search: in fewer bursts, a period of a slow alias cannot be distinguished from a lamp that is switched
/// once.
const FEWEST: usize = 8;

/// Least fraction of the variance that a frequency must explain to be locked with fewer than [`MANY`] bursts and with more, and the
/// fraction below which a locked frequency is lost.
const FOUND: [f32; 2] = [0.8, 0.75];
const MANY: usize = 12;
const LOST: f32 = 0.35;

/// Least fraction of the variance that a waveform of three harmonics must explain to be locked with [`MANY`] bursts if the fundamental
/// explains less: for example a rectangle, or a lamp that is clipped at some phases; and the least fraction that the fundamental must then
/// explain.
const FOUND_WAVEFORM: f32 = 0.9;
const LEAST_FUNDAMENTAL: f32 = 0.5;

/// Least fraction of the variance of the sum of all regions that a frequency must explain to be locked with a full window if it does not explain
/// the variance of the single regions. Independent values reach this fraction by chance in one of a million windows.
const FOUND_IN_SUM: f32 = 0.9;

/// Largest fraction of the variance that a single burst may cause if a frequency is to be locked. In eight bursts of a sinusoid it is a
/// quarter on average; in eight steady bursts and a false one, seven eighths.
const MOST_OF_ONE: f32 = 0.7;

/// Fraction of the measured deviation by which the frequency is corrected in each burst: the deviation of a rectangular modulation is inexact.
const DAMPING: f64 = 0.25;

/// Number of bursts without varying light whose effect equals that of one burst that the frequency explains badly.
const UNKNOWN: u32 = 8;

/// Least change of the modulation's phase from burst to burst, periods: a slower modulation may be a change of the light itself.
const LEAST_ADVANCE: f64 = 0.12;

/// Least ratios of standard deviation to mean for which a frequency is searched: in one region, and in all regions together.
const VARYING: f32 = 0.002;
const VARYING_IN_ALL: f32 = 0.0005;

/// Least ratio of standard deviation to mean of all regions together from which light without a known frequency varies widely.
const VARYING_WIDELY: f32 = 0.03;

/// The lamps whose frequency is searched.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum Lamps {
    /// Lamps on mains of 50 or 60 Hz.
    #[default]
    Auto,
    /// Lamps on mains of 50 Hz, which vary at 100 Hz.
    Mains50,
    /// Lamps on mains of 60 Hz, which vary at 120 Hz.
    Mains60,
    /// No lamps: no map is changed.
    Off,
}

impl Lamps {
    /// All choices of lamps, in the order of [`Lamps::NAMES`].
    pub const ALL: [Self; 4] = [Self::Auto, Self::Mains50, Self::Mains60, Self::Off];

    /// Names of [`Lamps::ALL`]: the frequency of the mains, hertz, or a word.
    pub const NAMES: [&str; 4] = ["auto", "50", "60", "off"];

    /// Returns the name of these lamps, an element of [`Lamps::NAMES`].
    #[must_use]
    pub fn name(self) -> &'static str {
        Self::NAMES[self as usize]
    }

    /// Returns the lamps with the name `name`; `None` for an unknown name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|lamps| lamps.name() == name)
    }

    /// Returns the frequencies at which the light of these lamps varies, hertz.
    pub(super) fn frequencies_hz(self) -> impl Iterator<Item = f64> {
        LAMPS_HZ.into_iter().enumerate().filter(move |(index, _)| self.allows(*index)).map(|(_, hz)| hz)
    }

    /// Returns whether element `index` of [`LAMPS_HZ`] is a frequency of these lamps.
    fn allows(self, index: usize) -> bool {
        match self {
            Self::Auto => true,
            Self::Mains50 => index == 0,
            Self::Mains60 => index == 1,
            Self::Off => false,
        }
    }
}

/// The frequency of a modulation, followed from burst to burst.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lock {
    /// Frequency of the modulation, hertz; in bursts without times, periods per burst.
    pub frequency: f64,
    /// Phase of the modulation in the newest burst, periods.
    pub phase: f64,
    /// Least and largest frequency to which a drift of the modulation is followed.
    range: [f64; 2],
    step: f64,
    /// Number of successive bursts that the frequency explained badly, each counted [`UNKNOWN`] times, plus bursts without varying light.
    poor: u32,
}

impl Lock {
    fn new(frequency: f64, range: [f64; 2], step: f64) -> Self {
        Self { frequency, phase: 0.0, range, step, poor: 0 }
    }

    /// Advances the phase to the newest burst of `window`.
    pub fn advance(&mut self, window: &Window) {
        self.phase = fraction(self.phase + self.frequency * window.since(1));
    }

    /// Follows the drift of the frequency; returns `None` once the frequency no longer explains the light.
    pub fn follow(mut self, window: &Window, regions: &[Cell]) -> Option<Self> {
        let score_of = |regions: &[Cell], offset: f64| {
            explained(window, regions, self.frequency + offset * self.step, Fit::fundamental)
        };
        let sum = [sum(regions)];
        let [of_regions, of_sum] = [regions, &sum].map(|regions| score_of(regions, 0.0));
        let is_of_sum = of_sum > of_regions && of_sum > Some(FOUND[1]);
        let (found, regions) = if is_of_sum { (of_sum, &sum[..]) } else { (of_regions, regions) };
        let score = |offset: f64| score_of(regions, offset);
        let here = found.unwrap_or(0.0);
        // Light that is off or has just changed is not evidence against the frequency.
        let doubt = if found.is_some() { UNKNOWN } else { 1 };
        self.poor = if here < LOST { self.poor + doubt } else { 0 };
        if here > LEAST_FUNDAMENTAL && window.count() >= MANY {
            let (below, above) = (score(-1.0).unwrap_or(0.0), score(1.0).unwrap_or(0.0));
            let curvature = below + above - 2.0 * here;
            let offset = if curvature < -1e-6 { 0.5 * (below - above) / curvature } else { above - below };
            let moved = self.frequency + DAMPING * self.step * f64::from(offset.clamp(-0.5, 0.5));
            self.frequency = moved.clamp(self.range[0], self.range[1]);
        }
        (self.poor < UNKNOWN * WINDOW as u32).then_some(self)
    }
}

/// Returns the frequency that explains the variance of the regions best, if it explains enough; otherwise the frequency that explains nearly all
/// of the variance of their sum: light that moves from region to region hides the modulation of each, but not of the sum. `has_times` states
/// whether the times of `window` are in seconds.
pub(super) fn find(window: &Window, regions: &[Cell], lamps: Lamps, has_times: bool) -> Option<Lock> {
    let is_due = window.count() >= FEWEST && window.number().is_multiple_of(SEARCH_EVERY);
    if lamps == Lamps::Off || !is_due || !varies(window, regions) {
        return None;
    }
    let sum = [sum(regions)];
    if is_of_one_burst(window, &sum[0]) {
        return None;
    }
    let has_many = window.count() >= MANY;
    let is_waveform = |lock: &Lock| {
        explained(window, regions, lock.frequency, Fit::new).is_some_and(|share| share > FOUND_WAVEFORM)
    };
    let is_found = |(score, lock): &(f32, Lock)| {
        *score > FOUND[usize::from(has_many)] || (has_many && *score > LEAST_FUNDAMENTAL && is_waveform(lock))
    };
    let of_sum = || best(window, &sum, lamps, has_times).filter(|(score, _)| *score > FOUND_IN_SUM);
    let found = best(window, regions, lamps, has_times).filter(is_found);
    let found = found.or_else(|| if window.count() >= WINDOW { of_sum() } else { None });
    found.map(|(_, lock)| lock)
}

/// Returns the frequency whose fundamental explains the variance of the regions best, and the explained fraction, which is less for frequencies
/// off the nominal ones.
fn best(window: &Window, regions: &[Cell], lamps: Lamps, has_times: bool) -> Option<(f32, Lock)> {
    let mut best: Option<(f32, Lock)> = None;
    let mut consider = |lock: Lock, off: i32| {
        if has_times && !advances(window, lock.frequency) {
            return 0.0;
        }
        let score = explained(window, regions, lock.frequency, Fit::fundamental).unwrap_or(0.0)
            - OFF_NOMINAL * off.abs() as f32;
        if best.as_ref().is_none_or(|(most, _)| score > *most) {
            best = Some((score, lock));
        }
        score
    };
    if has_times {
        for base in lamps.frequencies_hz() {
            let range = [base - 6.0 * STEP_HZ, base + 6.0 * STEP_HZ];
            let lock = |step: i32| Lock::new(base + f64::from(step) * STEP_HZ, range, STEP_HZ);
            let coarse = [-COARSE, 0, COARSE];
            let promising =
                coarse.map(|step| consider(lock(step), step)).into_iter().any(|score| score > PROMISING);
            if promising {
                (-STEPS..=STEPS).filter(|step| !coarse.contains(step)).for_each(|step| {
                    consider(lock(step), step);
                });
            }
        }
    } else {
        let count = ((PER_BURST[1] - PER_BURST[0]) / STEP_PER_BURST + 0.5) as u32;
        let steps = (0..=count).map(|step| PER_BURST[0] + f64::from(step) * STEP_PER_BURST);
        steps.for_each(|frequency| {
            consider(Lock::new(frequency, PER_BURST, 0.5 * STEP_PER_BURST), 0);
        });
    }
    best
}

/// Returns a region with the energies of all regions together.
fn sum(regions: &[Cell]) -> Cell {
    let mut sum = Cell::default();
    for region in regions {
        sum.past.iter_mut().zip(region.past).for_each(|(sum, energy)| *sum += energy);
    }
    sum
}

/// Returns whether `sum`, the light of all regions together, varies in a single burst alone, which no waveform explains better than a fault.
fn is_of_one_burst(window: &Window, sum: &Cell) -> bool {
    let bursts = window.count();
    let Variation { mean, squares } = Variation::of(sum, bursts);
    let square = |back: usize| (sum.past[window.slot(back)] - mean) * (sum.past[window.slot(back)] - mean);
    (0..bursts).any(|back| square(back) > MOST_OF_ONE * squares)
}

/// Returns whether the phase of `frequency` changes by at least [`LEAST_ADVANCE`] from burst to burst.
fn advances(window: &Window, frequency: f64) -> bool {
    let intervals = window.count().saturating_sub(1).max(1);
    let periods = frequency * window.since(intervals) / intervals as f64;
    libm::fabs(periods - libm::round(periods)) >= LEAST_ADVANCE
}

/// Returns the amplitude that an exposure of `periods` periods records of a sinusoid of amplitude 1.
pub(super) fn response(periods: f64) -> f64 {
    let angle = core::f64::consts::PI * periods;
    if angle > 1e-6 { libm::fabs(libm::sin(angle)) / angle } else { 1.0 }
}

/// Mean and sum of the squared deviations of a region's energy over the window.
struct Variation {
    mean: f32,
    squares: f32,
}

impl Variation {
    fn of(region: &Cell, bursts: usize) -> Self {
        let n = bursts.max(1) as f32;
        let ones = [1.0; WINDOW];
        let mean = dot(&region.past, &ones) / n;
        // Slots beyond the window hold 0.
        let unused = (WINDOW - bursts.min(WINDOW)) as f32 * mean * mean;
        let off = region.past.map(|v| v - mean);
        Self { mean, squares: (dot(&off, &off) - unused).max(0.0) }
    }

    /// Returns the standard deviation of the region's energy over `bursts` bursts.
    fn deviation(&self, bursts: usize) -> f32 {
        libm::sqrtf(self.squares / bursts.max(1) as f32)
    }
}

/// Returns whether the light of the regions varies enough for a search. For steady light, only the last two bursts are compared.
fn varies(window: &Window, regions: &[Cell]) -> bool {
    let [now, before] = [0, 1].map(|back| window.slot(back));
    let (mut sum, mut change) = (0.0, 0.0);
    for region in regions {
        sum += region.past[now];
        change += (region.past[now] - region.past[before]).abs();
    }
    if change <= VARYING_IN_ALL * sum {
        return false;
    }
    varying_share(window, regions) > VARYING_IN_ALL
}

/// Returns the ratio of standard deviation to mean over the regions that vary.
fn varying_share(window: &Window, regions: &[Cell]) -> f32 {
    let (mut all, mut varying) = (f32::MIN_POSITIVE, 0.0);
    for region in regions {
        let variation = Variation::of(region, window.count());
        let deviation = variation.deviation(window.count());
        all += variation.mean;
        varying += if deviation > VARYING * variation.mean { deviation } else { 0.0 };
    }
    varying / all
}

/// Returns whether the light varies widely over [`MANY`] bursts.
pub(super) fn varies_widely(window: &Window, regions: &[Cell]) -> bool {
    window.count() >= MANY
        && window.number().is_multiple_of(SEARCH_EVERY)
        && varying_share(window, regions) > VARYING_WIDELY
}

/// Returns the fraction of the variance of the regions that the fit `of` `frequency` explains, corrected for the degrees of freedom; `None`
/// if the times of the window do not determine a mean at `frequency`.
fn explained(
    window: &Window,
    regions: &[Cell],
    frequency: f64,
    of: fn(&Window, &Basis, usize) -> Option<Fit>,
) -> Option<f32> {
    let bursts = window.count();
    let basis = Basis::new(window, 0.0, frequency);
    let fit = of(window, &basis, bursts)?;
    let correction = (bursts - 1) as f32 / fit.freedom().max(1) as f32;
    let (mut sum, mut weights) = (0.0, 0.0);
    for region in regions.iter().filter(|region| window.age(region.since) >= bursts) {
        let variation = Variation::of(region, bursts);
        let deviation = variation.deviation(bursts);
        if deviation > VARYING * variation.mean && variation.squares > 0.0 {
            let estimate: Estimate = fit.estimate(&basis, &region.past, window.slot(0));
            sum += deviation * (1.0 - correction * estimate.squares() / variation.squares);
            weights += deviation;
        }
    }
    (weights > 0.0).then(|| sum / weights)
}
