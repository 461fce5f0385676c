//! Judges the samples of a burst that are too dark for a comparison one by one: the sums of the rows of each frame are compared with those
//! of the burst before.
//!
//! Where the scene changes, the sum of a row changes by one factor in all exposures; in a false frame, the sum changes by another factor
//! than in the frame of the next exposure. Samples that [`Comparison`](super::compare::Comparison) judges are not part of the sums. Where no
//! other exposure confirms the rows of a frame, because it is too dark there or no frame of the burst before has its exposure, the frame is
//! judged by its own change alone, with all samples: if the change is of the kind of a false frame, the frame is doubtful until
//! [`Recent`](super::recent::Recent) finds it repeated.

use super::history::KNOWN;
use super::jump::{ENOUGH_ROWS, JUMP, Jump, Rule, Usual, measured};
use super::samples::{ROWS, RowSet, SATURATED, Sampled, unite};
use hemilux_core::MAX_EXPOSURES;
use hemilux_core::wire::FrameFault;

/// Least number of samples of a row for a sum.
const ENOUGH_IN_ROW: u16 = 16;

/// Largest factor between the radiances of a row in two exposures if the row is measured in both: noise that is cut off at black adds to
/// the radiance of the darker one.
const SAME: f32 = 1.25;

/// Relative difference up to which two exposures are equal.
const SAME_LIGHT: f64 = 0.01;

/// Judgement of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Judgement {
    /// The frame is too dark, or too few earlier bursts are known.
    Unknown,
    /// The light of the frame changes as in the neighbouring exposures, or by a usual change.
    Sound,
    /// The light of the frame changes otherwise than in the neighbouring exposures.
    False(FrameFault),
    /// The light of the frame changes as in a false frame, or its stated exposure is an unexpected one, and no other frame is bright enough
    /// for a comparison.
    Doubtful,
}

/// The frames of a burst, by their index in ascending order of exposure.
pub(super) struct Seen<'a> {
    /// Exposure time of each frame times its gain, seconds.
    pub lights: &'a [f64],
    /// Samples of each frame on the grid.
    pub sampled: &'a [Sampled],
    /// Indices of the frames that are judged, ascending.
    pub kept: &'a [usize],
    /// Whether the frames are those of a sliding window, taken one after the other.
    pub is_window: bool,
}

/// Samples of the frames of the burst before, and the usual changes of rows.
#[derive(Debug)]
pub(super) struct Levels {
    /// Least mean relative exposure of the summed samples of a measured row, 0 to 1.
    pub floor: f32,
    /// Relative exposure from which samples are compared one by one, 0 to 1.
    least: f32,
    before: Vec<Before>,
    /// Exposure times gain of each frame of a whole burst, seconds; none if the source does not state them.
    expected: Vec<f64>,
    /// Memory for the entries of `before` that [`Levels::keep`] makes from the present burst.
    next: Vec<Before>,
    /// Usual difference between the change of each frame and the change of the frame of the next longer exposure, by the index of the
    /// shorter one.
    apart: [Usual; MAX_EXPOSURES],
    /// Usual change of each frame, by its index.
    own: [Usual; MAX_EXPOSURES],
    /// Number of bursts that were compared with the burst before.
    bursts: u32,
}

/// A frame of the burst before, or of the last one in which it was sound.
#[derive(Clone, Debug)]
struct Before {
    light: f64,
    sampled: Sampled,
}

/// A frame of the present burst and the frame of the same exposure in the burst before.
#[derive(Clone, Copy)]
struct Known<'a> {
    now: &'a Sampled,
    before: &'a Sampled,
    /// Exposure time times gain of the frame of the present burst and of that of the burst before, seconds.
    lights: [f64; 2],
}

impl Levels {
    /// Creates a judge without an earlier burst. `code` is the relative exposure of one code, `least` the relative exposure from which
    /// samples are compared one by one.
    pub fn new(code: f32, least: f32) -> Self {
        let (apart, own) = ([Usual::default(); MAX_EXPOSURES], [Usual::default(); MAX_EXPOSURES]);
        let entries = || Vec::with_capacity(MAX_EXPOSURES);
        Self {
            floor: code.max(1.0 / 16384.0),
            least,
            before: entries(),
            expected: Vec::with_capacity(MAX_EXPOSURES),
            next: entries(),
            apart,
            own,
            bursts: 0,
        }
    }

    /// Sets the exposures, times gain, of the frames of the next whole bursts, seconds.
    pub fn expect(&mut self, lights: impl Iterator<Item = f64>) {
        self.expected.clear();
        self.expected.extend(lights.take(MAX_EXPOSURES));
    }

    /// Judges the frames of a burst; `agreeing` returns the rows in which a comparison of single samples confirms a frame, `None` for a frame that
    /// no comparison confirms.
    pub fn judge(
        &mut self,
        seen: &Seen<'_>,
        agreeing: impl Fn(usize) -> Option<RowSet>,
    ) -> [Judgement; MAX_EXPOSURES] {
        let mut judged = [Judgement::Unknown; MAX_EXPOSURES];
        if self.before.is_empty() {
            return judged;
        }
        self.bursts = self.bursts.saturating_add(1);
        let mut confirmed = [[false; ROWS]; MAX_EXPOSURES];
        for pair in seen.kept.windows(2) {
            let pair = [pair[0], pair[1]];
            let rows = self.judge_pair(seen, pair, &mut judged);
            pair.into_iter().zip(rows).for_each(|(index, rows)| unite(&mut confirmed[index], &rows));
        }
        for index in seen.kept.iter().copied() {
            let (found, jump) = self.judge_alone(seen, index);
            let agreeing = agreeing(index);
            unite(&mut confirmed[index], &agreeing.unwrap_or_default());
            let is_doubtful = jump.is_some_and(|jump| !jump.is_confirmed(&confirmed[index]));
            judged[index] = match judged[index] {
                Judgement::Unknown if agreeing.is_none() => found,
                Judgement::Unknown | Judgement::Sound if is_doubtful => Judgement::Doubtful,
                judged => judged,
            };
        }
        judged
    }

    fn rule(&self, seen: &Seen<'_>) -> Rule {
        Rule { is_known: self.bursts > KNOWN, is_window: seen.is_window }
    }

    /// Judges the frame `index` by its own change since the burst before; returns an unusual jump of its rows as well.
    fn judge_alone(&mut self, seen: &Seen<'_>, index: usize) -> (Judgement, Option<Jump>) {
        let rows = self.alone(self.known(seen, index));
        let changes = rows.map(|row| row.filter(|change| !change.is_dark()).map(Change::least));
        let is_dark = measured(&changes) < ENOUGH_ROWS;
        let found = self.own[index].judge(&changes, measured(&rows), self.rule(seen));
        let judgement = match found {
            Some(Some(_)) => Judgement::Doubtful,
            _ if self.is_mislabelled(seen.lights, index) => Judgement::Doubtful,
            Some(None) if !is_dark => Judgement::Sound,
            Some(None) if !self.is_known(seen.lights[index]) => Judgement::Doubtful,
            _ => Judgement::Unknown,
        };
        (judgement, found.flatten())
    }

    /// Returns true if a frame of the burst before has the exposure `light`.
    fn is_known(&self, light: f64) -> bool {
        self.before.iter().any(|before| is_same(before.light, light))
    }

    /// Returns true if the frame `index` is the only one with an unexpected exposure: one that differs from all exposures that the source
    /// states or, if it states none, from those of the burst before.
    fn is_mislabelled(&self, lights: &[f64], index: usize) -> bool {
        let (expected, before) = (&self.expected, &self.before);
        let is_odd = |light: &f64| {
            if expected.is_empty() {
                lights.len() == before.len() && !self.is_known(*light)
            } else {
                !expected.iter().any(|expected| is_same(*expected, *light))
            }
        };
        is_odd(&lights[index]) && lights.iter().filter(|light| is_odd(light)).count() == 1
    }

    /// Compares the changes of two frames of neighbouring exposure and writes the judgements of both to `judged`; returns, for each of them, the
    /// rows whose changes the other one confirms.
    fn judge_pair(
        &mut self,
        seen: &Seen<'_>,
        pair: [usize; 2],
        judged: &mut [Judgement; MAX_EXPOSURES],
    ) -> [RowSet; 2] {
        let rows = self.pair(pair.map(|index| self.known(seen, index)), seen.is_window);
        let is_bright = |changes: &[Change; 2]| !changes.iter().any(|change| change.is_dark());
        let differences = rows.map(|row| row.filter(is_bright).map(|[short, long]| short.less(long)));
        let found = self.apart[pair[0]].judge(&differences, measured(&rows), self.rule(seen));
        let confirmed = [
            rows.map(|row| row.is_some_and(|[short, long]| short.is_confirmed_by(long))),
            rows.map(|row| row.is_some_and(|[short, long]| long.is_confirmed_by(short))),
        ];
        let Some(found) = found else { return confirmed };
        let Some(jump) = found else {
            // The changes are those of the light only if both exposures are as before.
            let is_known = pair.iter().all(|index| self.is_known(seen.lights[*index]));
            let is_dark = measured(&differences) < ENOUGH_ROWS;
            for index in pair.into_iter().filter(|_| is_known && !is_dark) {
                if judged[index] == Judgement::Unknown {
                    judged[index] = Judgement::Sound;
                }
            }
            return confirmed;
        };
        let sizes = [0, 1].map(|at| jump.size(&rows.map(|row| row.map(|changes| changes[at].log))));
        let ([index, other], size) =
            if sizes[0] > sizes[1] { (pair, sizes[1]) } else { ([pair[1], pair[0]], sizes[0]) };
        judged[index] = Judgement::False(jump.fault(&seen.sampled[index]));
        // Two frames were exchanged, or the scene changes as well.
        if size > JUMP.ln() && !matches!(judged[other], Judgement::False(_)) {
            judged[other] = Judgement::Doubtful;
        }
        confirmed
    }

    /// Stores the frames of a burst for the comparison with the next burst; for frames that are not sound or that the burst lacks, the
    /// earlier frame stays stored.
    pub fn keep(&mut self, seen: &Seen<'_>, is_sound: impl Fn(usize) -> bool) {
        if seen.lights.len() < self.expected.len() && self.before.len() == self.expected.len() {
            return self.keep_part(seen, is_sound);
        }
        // The stated exposure of a frame with a wrong label has another earlier frame.
        let has_expected = self.expected.len() == seen.lights.len();
        let lights = if has_expected { &self.expected } else { seen.lights };
        self.next.truncate(seen.lights.len());
        for (index, (light, sampled)) in seen.lights.iter().zip(seen.sampled).enumerate() {
            let slot = self.counterpart(lights, index);
            let kept = self.before.get(slot).filter(|_| !is_sound(index));
            let (light, sampled) = kept.map_or((*light, sampled), |before| (before.light, &before.sampled));
            match self.next.get_mut(index) {
                Some(next) => {
                    next.light = light;
                    next.sampled.copy_from(sampled);
                }
                None => self.next.push(Before { light, sampled: sampled.clone() }),
            }
        }
        std::mem::swap(&mut self.before, &mut self.next);
    }

    /// Stores the sound frames of a burst that lacks frames.
    fn keep_part(&mut self, seen: &Seen<'_>, is_sound: impl Fn(usize) -> bool) {
        let frames = seen.lights.iter().zip(seen.sampled).enumerate().filter(|(index, _)| is_sound(*index));
        for (_, (light, sampled)) in frames {
            let slot = self.before.iter_mut().find(|before| is_same(before.light, *light));
            slot.into_iter().for_each(|before| before.sampled.copy_from(sampled));
        }
    }

    /// Returns the index of the stored frame of the same exposure; of the nearest exposure if the burst before had another number of
    /// frames.
    fn counterpart(&self, lights: &[f64], index: usize) -> usize {
        if lights.len() == self.before.len() {
            return index;
        }
        let off = |before: &Before| (before.light / lights[index]).ln().abs();
        let nearest = self.before.iter().enumerate().min_by(|a, b| off(a.1).total_cmp(&off(b.1)));
        nearest.map_or(0, |(slot, _)| slot)
    }

    fn known<'a>(&'a self, seen: &Seen<'a>, index: usize) -> Known<'a> {
        let before = &self.before[self.counterpart(seen.lights, index)];
        Known {
            now: &seen.sampled[index],
            before: &before.sampled,
            lights: [seen.lights[index], before.light],
        }
    }

    /// Returns the changes of each row of a frame and of the frame of the next exposure; `None` for rows that are not measured in both.
    fn pair(&self, [short, long]: [Known<'_>; 2], is_window: bool) -> [Option<[Change; 2]>; ROWS] {
        // The light may change between the frames of a window.
        let same = if is_window { JUMP } else { SAME };
        let factor = (short.lights[1] / long.lights[1]) as f32;
        let mut rows = [None; ROWS];
        let samples = short.rows().zip(long.rows());
        for (found, ((short_now, short_before), (long_now, long_before))) in rows.iter_mut().zip(samples) {
            let mut sums = [Sums::default(); 2];
            let samples = short_now.iter().zip(short_before).zip(long_now.iter().zip(long_before));
            for ((a, a_before), (b, b_before)) in samples {
                if a_before.max(b_before * factor) < self.least && *b_before <= 1.0 {
                    sums[0].add(*a, *a_before);
                    sums[1].add(*b, *b_before);
                }
            }
            let radiance = |at: usize, known: &Known<'_>| sums[at].before / known.lights[1] as f32;
            let ratio = radiance(0, &short) / radiance(1, &long);
            *found = (same.recip()..same).contains(&ratio).then_some(()).and_then(|()| {
                Some([sums[0].change(self.floor, &short)?, sums[1].change(self.floor, &long)?])
            });
        }
        rows
    }

    /// Returns the change of each row of a frame; `None` for rows that are not measured.
    fn alone(&self, known: Known<'_>) -> [Option<Change>; ROWS] {
        let mut rows = [None; ROWS];
        for (found, (now, before)) in rows.iter_mut().zip(known.rows()) {
            let mut sums = Sums::default();
            let valid = now.iter().zip(before).filter(|(_, before)| **before <= 1.0);
            valid.for_each(|(now, before)| sums.add(*now, *before));
            *found = sums.change(self.floor, &known);
        }
        rows
    }
}

/// Returns true if two exposures are equal.
pub(super) fn is_same(a: f64, b: f64) -> bool {
    (a / b - 1.0).abs() < SAME_LIGHT
}

impl<'a> Known<'a> {
    /// Returns the rows of samples of both frames, present and before.
    fn rows(&self) -> impl Iterator<Item = (&'a [f32], &'a [f32])> + use<'a> {
        self.now.rows().zip(self.before.rows())
    }
}

/// Sums of the relative exposures of samples of a row, in the present burst and in the burst before.
#[derive(Clone, Copy, Default)]
struct Sums {
    now: f32,
    before: f32,
    count: u16,
    is_saturated: bool,
}

impl Sums {
    fn add(&mut self, now: f32, before: f32) {
        self.now += now;
        self.before += before;
        self.count += 1;
        self.is_saturated |= now == SATURATED;
    }

    /// The change of radiance; none for too few samples.
    fn change(&self, floor: f32, known: &Known<'_>) -> Option<Change> {
        let least = floor * f32::from(self.count);
        if self.count < ENOUGH_IN_ROW {
            return None;
        }
        let light = (known.lights[1] / known.lights[0]) as f32;
        let log = (self.now.max(least) / self.before.max(least) * light).ln();
        let is_at_least = self.is_saturated || self.before < least;
        Some(Change { log, is_at_most: self.now < least, is_at_least })
    }
}

/// Natural logarithm of the factor by which the radiance of a row changed since the burst before, or a bound of it.
#[derive(Clone, Copy, Debug)]
struct Change {
    log: f32,
    is_at_most: bool,
    is_at_least: bool,
}

impl Change {
    const NONE: Self = Self { log: 0.0, is_at_most: false, is_at_least: false };

    /// Returns true if the row is too dark for a measurement in both bursts.
    fn is_dark(self) -> bool {
        self.is_at_most && self.is_at_least
    }

    /// Returns true if the change differs by less than [`JUMP`] from the change that is certain in another exposure.
    fn is_confirmed_by(self, other: Self) -> bool {
        let certain = Self { log: other.least(), ..Self::NONE };
        !other.is_dark() && self.less(certain).abs() < JUMP.ln()
    }

    /// Logarithm of the smallest change within the bounds.
    fn least(self) -> f32 {
        self.less(Self::NONE)
    }

    /// The difference to another change; 0 where the bounds allow it.
    fn less(self, other: Self) -> f32 {
        let difference = self.log - other.log;
        let may_be_more = self.is_at_least || other.is_at_most;
        let may_be_less = self.is_at_most || other.is_at_least;
        if (difference < 0.0 && may_be_more) || (difference > 0.0 && may_be_less) { 0.0 } else { difference }
    }
}
