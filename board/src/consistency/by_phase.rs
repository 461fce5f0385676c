//! Running statistics of bursts, of all of them and of those at each phase of the lamps that light the scene.
//!
//! Light that flickers differs from exposure to exposure, and it differs in the same way whenever a burst meets the same phase of the lamps; false
//! frames come at any phase.

/// Weight of the newest burst in the running means, 0 to 1, after the first bursts.
pub(super) const NEW: f32 = 1.0 / 8.0;

/// Number of standard deviations from the running mean beyond which a value is unusual.
pub(super) const DEVIATIONS: f32 = 4.0;

/// Factor of a running variance up to which the square of an unusual deviation counts. A phase of flickering light that was wrong once is then usual,
/// and wrong exposures in a tenth of the bursts, or a false frame that is no jump, do not hide the next ones.
pub(super) const OUTLIER: f32 = 8.0;

/// Running share of contradicting bursts, 0 to 1, from which contradictions are a property of the light or of the camera, not faults. Where
/// a tenth of all bursts is false, three of eight bursts contradict once an hour, and twelve of forty never.
const USUAL: f32 = 0.3;

/// Weights in the running share of contradictions: of each later burst, and of the first one.
const CONTRADICTION: f32 = 1.0 / 32.0;
const FIRST_CONTRADICTION: f32 = 1.0 / 8.0;

/// Largest running share of bursts with a fault of a whole frame that can be due to lamps: lamps are lit in a part of their period.
const DARK: f32 = 0.75;

/// Running share of the bursts with such a fault after one without it from which lamps are the cause. A camera that fails has one such burst. Random
/// false frames do not reach the share if a twentieth of the bursts has them; if a tenth has them, they exceed it in one of 1,400 bursts.
const RETURNS: f32 = 0.2;

/// Number of parts of the period of the lamps.
const PARTS: usize = 8;

/// Number of bursts from which the values of a part of the period are known.
const KNOWN_PART: u32 = 2;

/// Returns the index of the part of the period that contains `phase`, periods.
fn part(phase: f32) -> usize {
    ((phase * PARTS as f32) as usize).min(PARTS - 1)
}

/// Returns the index of the part of the period that contains `phase` and of the part next to it on the nearer side: an error of the frequency moves
/// a phase across the border of two parts.
fn parts(phase: f32) -> [usize; 2] {
    let part = part(phase);
    let is_upper_half = (phase * PARTS as f32).fract() >= 0.5;
    [part, (part + if is_upper_half { 1 } else { PARTS - 1 }) % PARTS]
}

/// Returns true if one of the parts at `phase`, `None` without lamps, has the property `has`.
fn any_at<T>(at: &[T; PARTS], phase: Option<f32>, has: impl Fn(&T) -> bool) -> bool {
    phase.is_some_and(|phase| parts(phase).into_iter().any(|part| has(&at[part])))
}

/// Running share of the bursts in which two exposures contradict each other.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Contradictions {
    share: f32,
    bursts: u32,
}

impl Contradictions {
    /// Adds a burst; returns true if contradictions are usual.
    pub fn add(&mut self, is_contradiction: bool) -> bool {
        let weight = CONTRADICTION.max(1.0 / (FIRST_CONTRADICTION.recip() + self.bursts as f32));
        self.bursts = self.bursts.saturating_add(1);
        self.share += weight * (f32::from(u8::from(is_contradiction)) - self.share);
        self.are_usual()
    }

    fn are_usual(self) -> bool {
        self.share >= USUAL
    }

    fn larger(self, other: Self) -> Self {
        if self.share < other.share { other } else { self }
    }
}

/// Running shares of the contradicting bursts: of all bursts, and of the bursts at each phase of the lamps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct PhaseContradictions {
    all: Contradictions,
    at: [Contradictions; PARTS],
}

impl PhaseContradictions {
    /// Adds a burst at `phase`, periods, 0 to 1; `None` while no lamps are found. Returns true if contradictions are usual, in all or at this phase.
    pub fn add(&mut self, phase: Option<f32>, is_contradiction: bool) -> bool {
        match phase {
            Some(phase) => _ = self.at[part(phase)].add(is_contradiction),
            None => self.at = Default::default(),
        }
        self.all.add(is_contradiction);
        self.are_usual(phase)
    }

    pub fn are_usual(&self, phase: Option<f32>) -> bool {
        self.all.are_usual() || self.are_usual_at(phase)
    }

    /// Returns true if contradictions are usual at this phase of the lamps.
    fn are_usual_at(&self, phase: Option<f32>) -> bool {
        any_at(&self.at, phase, |at| at.are_usual())
    }

    pub fn larger(self, other: Self) -> Self {
        let at = core::array::from_fn(|part| self.at[part].larger(other.at[part]));
        Self { all: self.all.larger(other.all), at }
    }
}

/// Bursts in which a frame is black or saturated as a whole.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct LevelFaults {
    counts: PhaseContradictions,
    /// Bursts with the fault after one without it.
    returns: Contradictions,
    was_fault: bool,
}

impl LevelFaults {
    /// Adds a burst at `phase`, as [`PhaseContradictions::add`]; returns true if the fault is due to lamps that are dark in a part of their period: it comes
    /// and goes, or it comes at this phase.
    pub fn add(&mut self, phase: Option<f32>, is_fault: bool) -> bool {
        let was_fault = std::mem::replace(&mut self.was_fault, is_fault);
        self.returns.add(is_fault && !was_fault);
        self.counts.add(phase, is_fault);
        self.counts.all.share < DARK && (self.returns.share >= RETURNS || self.counts.are_usual_at(phase))
    }
}

/// Running mean and variance of a value.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Running {
    bursts: u32,
    mean: f32,
    variance: f32,
}

impl Running {
    /// Adds `value`, with the weight [`NEW`] or, in the first bursts, with equal weights.
    fn add(&mut self, value: f32) {
        self.bursts = self.bursts.saturating_add(1);
        let new = NEW.max(1.0 / self.bursts as f32);
        let off = value - self.mean;
        self.mean += new * off;
        self.variance = (1.0 - new) * (self.variance + new * off * off);
    }

    /// Returns true if `value` differs from the mean by more than [`DEVIATIONS`] standard deviations and by more than `least`.
    fn is_unusual(&self, value: f32, least: f32) -> bool {
        (value - self.mean).abs() > least.max(DEVIATIONS * self.variance.sqrt())
    }

    fn joined(&self, other: &Self, join: impl Fn(f32, f32) -> f32) -> Self {
        Self {
            bursts: self.bursts.min(other.bursts),
            mean: join(self.mean, other.mean),
            variance: join(self.variance, other.variance),
        }
    }
}

/// Running mean and variance of a value: of all bursts, and of the bursts at each phase of the lamps.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct PhaseRunning {
    all: Running,
    at: [Running; PARTS],
}

impl PhaseRunning {
    pub fn mean(&self) -> f32 {
        self.all.mean
    }

    /// Returns the number of values that were added.
    pub fn bursts(&self) -> u32 {
        self.all.bursts
    }

    /// Adds a value at `phase`, as [`PhaseContradictions::add`].
    pub fn add(&mut self, value: f32, phase: Option<f32>) {
        self.all.add(value);
        match phase {
            Some(phase) => self.at[part(phase)].add(value),
            None => self.at = Default::default(),
        }
    }

    /// Returns true if `value` is unusual among all bursts, with a difference of at least `least`, and among those at `phase`.
    pub fn is_unusual(&self, value: f32, least: f32, phase: Option<f32>) -> bool {
        let is_usual = |at: &Running| at.bursts >= KNOWN_PART && !at.is_unusual(value, least);
        self.all.is_unusual(value, least) && !any_at(&self.at, phase, is_usual)
    }

    /// Adds an unusual value, whose difference was at least `least`, to the variance of all bursts, up to [`OUTLIER`].
    pub fn widen(&mut self, value: f32, least: f32) {
        let off = value - self.all.mean;
        let usual = self.all.variance.max((least / DEVIATIONS).powi(2));
        self.all.variance = usual + NEW * ((off * off).min(OUTLIER * usual) - usual);
    }

    pub fn joined(&self, other: &Self, join: impl Fn(f32, f32) -> f32 + Copy) -> Self {
        let at = core::array::from_fn(|part| self.at[part].joined(&other.at[part], join));
        Self { all: self.all.joined(&other.all, join), at }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Phase of a lamp of 100 Hz in burst `burst` of three frames at 28 per second: seven phases follow each other.
    fn phase(burst: usize) -> Option<f32> {
        Some((10.714_286 * burst as f32).fract())
    }

    #[test]
    fn contradictions_that_return_at_one_phase_become_usual_near_it_alone() {
        let mut counts = PhaseContradictions::default();
        let usual: Vec<_> = (0..70).map(|burst| counts.add(phase(burst), burst % 7 == 3)).collect();
        assert!((17..70).step_by(7).all(|burst| usual[burst]), "{usual:?}");
        // The phases of the others differ by more than a quarter of a period.
        assert!(
            (0..70).filter(|burst| matches!(burst % 7, 1 | 2 | 4 | 5)).all(|burst| !usual[burst]),
            "{usual:?}"
        );
        assert!(!counts.are_usual(None), "a seventh of all bursts");
        counts.add(None, false);
        assert!(!counts.are_usual(phase(3)), "the lamps were lost");
    }

    #[test]
    fn contradictions_in_a_tenth_of_the_bursts_become_usual_at_no_phase() {
        let mut counts = PhaseContradictions::default();
        for burst in 0..4000_usize {
            let is_contradiction = (burst as u32).wrapping_mul(2_654_435_761) >> 16 < 6554;
            assert!(!counts.add(phase(burst), is_contradiction) || burst < 30, "burst {burst}");
        }
    }

    #[test]
    fn values_that_return_at_one_phase_are_usual_there_alone() {
        let mut values = PhaseRunning::default();
        (0..70).for_each(|burst| values.add(if burst % 7 == 3 { 0.3 } else { 0.0 }, phase(burst)));
        // The phases of other bursts are known, so that the value is compared with them.
        values.all = Running { bursts: 70, ..Running::default() };
        let is_unusual = [3, 5].map(|burst| values.is_unusual(0.3, 0.2, phase(burst)));
        assert_eq!(is_unusual, [false, true]);
        assert!(values.is_unusual(0.3, 0.2, None), "no lamps are known");
    }

    #[test]
    fn a_frame_that_is_black_from_now_on_is_never_due_to_lamps() {
        for has_lamps in [false, true] {
            let mut faults = LevelFaults::default();
            for burst in 0..400 {
                let is_of_lamps = faults.add(phase(burst).filter(|_| has_lamps), burst >= 100);
                assert!(!is_of_lamps, "lamps {has_lamps}: burst {burst}");
            }
        }
    }

    #[test]
    fn frames_that_are_black_in_a_twentieth_of_the_bursts_are_not_due_to_lamps() {
        let (mut faults, mut random) = (LevelFaults::default(), 1u64);
        for burst in 0..20_000 {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let is_fault = burst >= 30 && random >> 32 < (1 << 32) / 20;
            assert!(!faults.add(None, is_fault), "burst {burst}");
        }
    }

    #[test]
    fn frames_that_are_black_in_a_part_of_the_period_are_due_to_lamps() {
        for has_lamps in [false, true] {
            let mut faults = LevelFaults::default();
            let mut add = |burst| {
                let at = phase(burst).unwrap_or_default();
                faults.add(Some(at).filter(|_| has_lamps), at < 0.5)
            };
            let found: Vec<_> = (0..60).map(&mut add).collect();
            assert!(
                !found[0] && found[12..].iter().all(|is_of_lamps| *is_of_lamps),
                "{has_lamps}: {found:?}"
            );
        }
    }
}
