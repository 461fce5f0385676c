//! Flicker of lamps in maps of known light: the expected map holds the mean of the light.

use hemilux_core::mains::{Cell, Flicker, Lamps, Mains, best_rate, mains_len};
use hemilux_core::pyramid::{Pyramid, Quad, pyramid_len};
use hemilux_core::{Domain, Order, healpix};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

const ORDER: u8 = 4;
const LAMP: usize = 700;

/// Energy of each steady texel, and mean energy of the lamp's texel, which is among them.
const STEADY: f32 = 0.01;
const FULL: f64 = 4.0;

struct Sequence {
    map: Pyramid<Vec<Quad>>,
    mains: Mains<Vec<Cell>>,
}

impl Sequence {
    fn new(lamps: Lamps) -> Self {
        let order = Order::saturating(ORDER);
        let quads = vec![Quad::default(); pyramid_len(Domain::Hemisphere, order)];
        let map = Pyramid::try_new(quads, Domain::Hemisphere, order).expect("as many quads as needed");
        let cells = vec![Cell::default(); mains_len(order)];
        Self { map, mains: Mains::try_new(order, lamps, cells).expect("as many cells as needed") }
    }

    /// Processes a burst at `seconds` in which the lamp's texel has the energy `lamp`; returns the texel's corrected energy and the modulation.
    fn burst(&mut self, seconds: f64, lamp: f64) -> (f64, Flicker) {
        self.fill(lamp);
        let found = self.mains.update(&mut self.map, Some(seconds));
        (f64::from(self.map.texels()[LAMP].y()), found)
    }

    fn fill(&mut self, lamp: f64) {
        for (index, quad) in self.map.texels_mut().iter_mut().enumerate() {
            let y = if index == LAMP { lamp as f32 } else { STEADY };
            *quad = Quad::from_light([y; 3], healpix::centre(ORDER, index as u32).as_vec3());
        }
        self.map.build();
    }
}

fn lamp(hz: f64, seconds: f64) -> f64 {
    FULL * (1.0 + (TAU * hz * seconds + 0.7).cos())
}

#[test]
fn a_sinusoid_is_replaced_by_its_mean_and_other_texels_are_unchanged() {
    for hz in [100.0, 120.0, 99.85] {
        let mut sequence = Sequence::new(Lamps::Auto);
        for burst in 0..40 {
            let seconds = 7.0 + f64::from(burst) * 3.0 / 28.0;
            let (y, found) = sequence.burst(seconds, lamp(hz, seconds));
            if burst >= 20 {
                assert!((y / FULL - 1.0).abs() < 0.02, "{hz} Hz, burst {burst}: {y}");
                assert!((f64::from(found.frequency_hz.expect("a frequency")) - hz).abs() < 0.1, "{hz} Hz");
                assert!((found.depth - 1.0).abs() < 0.02 && found.share > 0.1, "{hz} Hz: {found:?}");
            }
            let total = f64::from(sequence.map.view().total().y());
            let texels = sequence.map.texels().iter().map(|quad| f64::from(quad.y())).sum::<f64>();
            assert!((total / texels - 1.0).abs() < 1e-5, "sums of {hz} Hz");
        }
        let neighbour = sequence.map.texels()[LAMP + 1].y();
        assert!((neighbour / STEADY - 1.0).abs() < 1e-4, "{hz} Hz: {neighbour}");
    }
}

/// Returns the mean light, from `seconds` on for an exposure of 0.926 ms, of a lamp that is on in the fraction `duty` of each period.
fn rectangle(hz: f64, duty: f64, seconds: f64) -> f64 {
    let on = |turns: f64| turns.floor() + (turns - turns.floor()).min(duty) / duty;
    let turns = hz * 0.926e-3;
    FULL * (on(hz * seconds + turns) - on(hz * seconds)) / turns
}

#[test]
fn edges_of_a_rectangular_wave_are_not_taken_for_switches() {
    for (hz, rate_hz) in [(120.0, 58.3), (100.0, 29.1)] {
        let mut sequence = Sequence::new(Lamps::Auto);
        for burst in 0..120 {
            let seconds = f64::from(burst) * 3.0 / rate_hz;
            let (y, _) = sequence.burst(seconds, rectangle(hz, 0.7, seconds));
            assert!(burst < 32 || (y / FULL - 1.0).abs() < 0.1, "{hz} Hz at {rate_hz}, burst {burst}: {y}");
        }
    }
}

/// Three harmonics leave residuals of a rectangle, by which the means of single fits differ by 1 to 3 % from burst to burst.
#[test]
fn mean_of_a_rectangular_lamp_is_near_its_mean_and_steady() {
    for most_hz in [25.0, 30.0, 60.0] {
        let rate_hz = best_rate(most_hz, 3, Lamps::Auto);
        for (hz, duty) in [(100.0, 0.5), (120.0, 0.5), (100.0, 0.7), (120.0, 0.7)] {
            let mut sequence = Sequence::new(Lamps::Auto);
            let found: Vec<f64> = (0..120)
                .map(|burst| {
                    let seconds = f64::from(burst) * 3.0 / rate_hz;
                    sequence.burst(seconds, rectangle(hz, duty, seconds)).0 / FULL
                })
                .skip(40)
                .collect();
            let off = found.iter().map(|y| (y - 1.0).abs()).sum::<f64>() / found.len() as f64;
            let change = found.windows(2).map(|pair| (pair[1] - pair[0]).abs()).fold(0.0, f64::max);
            assert!(
                off < 0.025 && change < 0.012,
                "{hz} Hz, duty {duty}, at {rate_hz}: {off}, changes up to {change}"
            );
        }
    }
}

/// A steady lamp in the region of a flickering one is switched off and has no energy from then on.
#[test]
fn a_steady_lamp_that_is_switched_off_beside_a_flickering_one_is_dark_at_once() {
    const OTHER: usize = LAMP - LAMP % 16;
    let mut sequence = Sequence::new(Lamps::Auto);
    for burst in 0..60 {
        let seconds = f64::from(burst) * 3.0 / 28.0;
        sequence.fill(lamp(100.0, seconds));
        let level = if burst < 30 { 1.0 } else { 0.0 };
        let towards = healpix::centre(ORDER, OTHER as u32).as_vec3();
        sequence.map.texels_mut()[OTHER] = Quad::from_light([level; 3], towards);
        sequence.map.build();
        sequence.mains.update(&mut sequence.map, Some(seconds));
        let y = sequence.map.texels()[OTHER].y();
        assert!(burst < 20 || (y - level).abs() < 0.02, "burst {burst}: {y}");
    }
}

/// A lamp of no frequency varies by 80 %.
#[test]
fn exposures_are_left_out_of_some_bursts_of_light_that_no_frequency_explains() {
    let left_out = |level: fn(u32) -> f64| -> Vec<u32> {
        let mut sequence = Sequence::new(Lamps::Auto);
        let bursts = 0..200u32;
        let is_left_out = |burst: &u32| {
            let (_, found) = sequence.burst(f64::from(*burst) * 3.0 / 28.0, FULL * level(*burst));
            assert_eq!(found, Flicker::default(), "burst {burst}");
            assert!(sequence.mains.keeps(0.03), "burst {burst}");
            !sequence.mains.keeps(0.0055)
        };
        bursts.filter(is_left_out).collect()
    };
    assert_eq!(left_out(|_| 1.0), [0u32; 0]);
    let found = left_out(|burst| if burst.wrapping_mul(2_654_435_761) >> 13 & 1 == 0 { 1.8 } else { 0.2 });
    let begin = found.first().copied().expect("exposures are left out");
    assert!(begin < 20, "{found:?}");
    assert_eq!(found.iter().filter(|burst| **burst < begin + 100).count(), 16, "{found:?}");
}

#[test]
fn phases_of_bursts_at_the_best_rate_leave_no_interval_over_a_ninth_of_the_period() {
    for (most_hz, frames) in
        [(60.0, 3), (50.0, 2), (30.0, 1), (30.0, 3), (30.0, 4), (28.0, 3), (25.0, 3), (20.0, 6)]
    {
        let rate = best_rate(most_hz, frames, Lamps::Auto);
        for hz in [100.0, 120.0] {
            let mut phases: Vec<_> =
                (0..16).map(|burst| (f64::from(burst) * hz * frames as f64 / rate).fract()).collect();
            phases.sort_by(f64::total_cmp);
            phases.push(1.0 + phases[0]);
            let longest = phases.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max);
            assert!(longest < 0.1122, "{hz} Hz, {frames} frames at {rate} per second: {longest}");
        }
    }
}

/// Below 10.5 frames per second, no rate spreads the phases of bursts of four frames at both frequencies.
#[test]
fn where_no_rate_spreads_the_phases_the_phases_of_successive_bursts_differ() {
    let rate = best_rate(10.5, 4, Lamps::Auto);
    for periods in [100.0, 120.0].map(|hz| hz * 4.0 / rate) {
        assert!((periods - f64::round(periods)).abs() > 0.139, "{rate} per second: {periods} periods");
    }
}

#[test]
fn a_lamp_that_is_switched_in_flickering_light_is_followed_in_two_bursts() {
    let mut sequence = Sequence::new(Lamps::Auto);
    for burst in 0..60 {
        let seconds = f64::from(burst) * 3.0 / 28.0;
        let level = match burst {
            25..35 => 0.0,
            45.. => 0.5,
            _ => 1.0,
        };
        let (y, _) = sequence.burst(seconds, level * lamp(100.0, seconds));
        let is_change = [25, 35, 45].contains(&burst);
        assert!(burst < 20 || is_change || (y - level * FULL).abs() < 0.05 * FULL, "burst {burst}: {y}");
    }
}

/// A burst without its longest exposure records a lamp with another amplitude and phase: here with none, and 70 % above the mean.
#[test]
fn a_burst_that_lacks_exposures_does_not_change_the_later_bursts() {
    for has_times in [true, false] {
        let mut sequence = Sequence::new(Lamps::Auto);
        for burst in 0..80 {
            let seconds = f64::from(burst) * 3.0 / 28.0;
            let is_apart = burst >= 25 && burst % 9 == 0;
            sequence.fill(if is_apart { 1.7 * FULL } else { lamp(100.0, seconds) });
            let found = if is_apart {
                sequence.mains.update_apart(&mut sequence.map)
            } else {
                sequence.mains.update(&mut sequence.map, has_times.then_some(seconds))
            };
            let y = f64::from(sequence.map.texels()[LAMP].y());
            assert!(burst < 20 || found.share > 0.1, "burst {burst}: {found:?}");
            assert!(burst < 20 || (y / FULL - 1.0).abs() < 0.02, "burst {burst}: {y}, {found:?}");
        }
    }
}

/// With other exposures, a lamp is recorded with three tenths of the amplitude, half a period later.
#[test]
fn after_a_change_of_exposures_the_modulation_is_fitted_again_at_the_known_frequency() {
    let mut sequence = Sequence::new(Lamps::Auto);
    for burst in 0..60 {
        let seconds = f64::from(burst) * 3.0 / 28.0;
        let (full, other) = (lamp(100.0, seconds), FULL - 0.3 * (lamp(100.0, seconds) - FULL));
        if burst == 30 {
            sequence.mains.refit();
        }
        let (y, found) = sequence.burst(seconds, if burst < 30 { full } else { other });
        let expected = if (30..34).contains(&burst) { other } else { FULL };
        assert!(burst < 20 || found.frequency_hz.is_some(), "burst {burst}: {found:?}");
        let is_known = (20..34).contains(&burst) || burst >= 36;
        assert!(!is_known || (y / expected - 1.0).abs() < 0.02, "burst {burst}: {y}, expected {expected}");
    }
}

#[test]
fn steady_light_and_lamps_of_other_frequencies_are_not_changed() {
    for (lamps, hz) in [(Lamps::Auto, 0.0), (Lamps::Off, 100.0), (Lamps::Mains60, 100.0)] {
        let mut sequence = Sequence::new(lamps);
        for burst in 0..30 {
            let seconds = f64::from(burst) * 3.0 / 28.0;
            let expected = lamp(hz, seconds) as f32;
            let (y, found) = sequence.burst(seconds, expected.into());
            assert_eq!(
                y as f32,
                Quad::from_light([expected; 3], glam::Vec3::Z).y(),
                "{lamps:?}, burst {burst}"
            );
            assert_eq!(found, Flicker::default(), "{lamps:?}, burst {burst}");
        }
    }
}

/// Three frames per burst at 30 Hz always record 100 Hz at one phase, which is indistinguishable from steady light.
#[test]
fn bursts_at_equal_phases_give_no_frequency() {
    let mut sequence = Sequence::new(Lamps::Mains50);
    for burst in 0..30 {
        let seconds = f64::from(burst) / 10.0;
        // A slow change of the light itself, without modulation.
        let (_, found) = sequence.burst(seconds, FULL * (1.0 + 0.5 * seconds.sin()));
        assert_eq!(found, Flicker::default(), "burst {burst}");
    }
}

/// Kinds of light that varies without a period: independent levels, a random walk, switches at random bursts, and a fall to a tenth.
const APERIODIC: [fn(&mut Noise, u32, f64) -> f64; 4] = [
    |noise, _, _| FULL * (1.0 + 0.5 * noise.next()),
    |noise, _, level| (level * (0.3 * noise.next()).exp()).clamp(0.1, 100.0),
    |noise, _, level| if noise.next() > 0.8 { FULL + 0.1 - level } else { level },
    |_, burst, _| FULL * (-0.04 * f64::from(burst)).exp(),
];

/// Uniform deviates from -1 to 1.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        // The generator MMIX of [Knuth1997].
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as f64 / f64::from(1u32 << 30) - 1.0
    }
}

/// Of 100 sequences of eight seconds in which one region varies without a period, so many at most have a burst that is corrected. A random
/// walk with steps of up to 30 % often equals a period over the one and a half seconds of the window; more regions would contradict it.
#[test]
fn light_without_a_period_is_taken_for_flicker_in_few_sequences() {
    for (kind, next) in APERIODIC.into_iter().enumerate() {
        let taken = (0..100).filter(|seed| {
            let (mut sequence, mut noise, mut level) = (Sequence::new(Lamps::Auto), Noise(*seed), FULL);
            (0..80).fold(false, |taken, burst| {
                level = next(&mut noise, burst, level);
                let (_, found) = sequence.burst(f64::from(burst) * 3.0 / 28.0, level);
                taken || found.frequency_hz.is_some()
            })
        });
        let (taken, most) = (taken.count(), [10, 30, 3, 0][kind]);
        assert!(taken <= most, "kind {kind}: {taken} of 100 sequences, expected at most {most}");
    }
}

/// Twenty patches have new places in each burst, so that the light of most regions does not have the waveform of the lamp that lights them; the
/// sum of all light has it.
#[test]
fn a_lamp_whose_light_moves_from_region_to_region_is_found_in_the_sum() {
    for (hz, depth) in [(100.0, 0.3), (100.0, 0.6), (120.0, 0.3), (120.0, 0.6)] {
        let (mut sequence, mut noise) = (Sequence::new(Lamps::Auto), Noise(7));
        let mut found = Flicker::NONE;
        for burst in 0..40 {
            let seconds = f64::from(burst) * 3.0 / 28.2;
            let light = (1.0 + depth * (TAU * hz * seconds).cos()) as f32;
            sequence.fill(f64::from(STEADY * light));
            let texels = sequence.map.texels_mut();
            texels
                .iter_mut()
                .for_each(|quad| *quad = Quad::from_light([STEADY * light; 3], quad.mean_direction()));
            for _ in 0..20 {
                let index = ((0.5 + 0.499 * noise.next()) * texels.len() as f64) as usize;
                texels[index] = Quad::from_light([light; 3], texels[index].mean_direction());
            }
            sequence.map.build();
            found = sequence.mains.update(&mut sequence.map, Some(seconds));
            let is_found = found.frequency_hz.is_some_and(|found| (f64::from(found) - hz).abs() < 0.5);
            assert!(burst < 20 || is_found, "{hz} Hz, depth {depth}, burst {burst}: {found:?}");
        }
        eprintln!("{hz} Hz, depth {depth}: {found:?}");
    }
}

/// Three tenths of the bursts are missing, so that the phases of some windows are unevenly distributed.
#[test]
fn a_single_false_burst_is_not_taken_for_flicker() {
    let (mut noise, mut locks) = (Noise(3), 0);
    for _ in 0..1000 {
        let mut sequence = Sequence::new(Lamps::Auto);
        let wrong = 13 + (7.0 * noise.next()) as u32;
        for burst in 0..24 {
            if burst == wrong || noise.next() > -0.4 {
                let level = if burst == wrong { 0.25 * FULL } else { FULL };
                let (_, found) = sequence.burst(f64::from(burst) * 3.0 / 28.0, level);
                locks += u32::from(found.frequency_hz.is_some());
            }
        }
    }
    assert_eq!(locks, 0, "bursts with a frequency");
}

/// Errors, averaged over twelve phases, in the bursts after the one in which a lamp is switched off, relative to the lamp's mean light; `part` is
/// the fraction of the lamp's light in that burst, and `day` the steady light, relative to the lamp's mean light.
fn left_after_switch(rate_hz: f64, wave: impl Fn(f64) -> f64, day: f64, part: f64) -> [f64; 12] {
    let mut left = [0.0; 12];
    for start in 40..52 {
        let mut sequence = Sequence::new(Lamps::Auto);
        for burst in 0..=start + left.len() {
            let seconds = burst as f64 * 3.0 / rate_hz;
            let on = [1.0, part, 0.0][(burst + 1).saturating_sub(start).min(2)];
            let (y, _) = sequence.burst(seconds, day * FULL + on * wave(seconds));
            if let Some(left) = burst.checked_sub(start + 1).and_then(|after| left.get_mut(after)) {
                *left += (y / FULL - day).abs() / 12.0;
            }
        }
    }
    left
}

#[test]
fn most_light_of_a_lamp_that_is_switched_off_at_any_phase_is_gone_after_four_bursts() {
    for (rate_hz, hz) in
        [23.4, 28.2, 29.1, 58.2].into_iter().flat_map(|rate_hz| [(rate_hz, 100.0), (rate_hz, 120.0)])
    {
        let rectified = |seconds: f64| FULL * FRAC_PI_2 * (PI * hz * seconds + 0.3).sin().abs();
        let sinusoid = |seconds| lamp(hz, seconds);
        for (day, part) in [(0.0, 0.0), (0.0, 0.8), (1.0, 0.0), (1.0, 0.5)] {
            for left in [
                left_after_switch(rate_hz, rectified, day, part),
                left_after_switch(rate_hz, sinusoid, day, part),
            ] {
                let late = left[4..].iter().copied().fold(0.0, f64::max);
                assert!(
                    late < 0.15 && left[11] < 0.01,
                    "{hz} Hz at {rate_hz}, steady {day}, part {part}: {left:.3?}"
                );
            }
        }
    }
}
