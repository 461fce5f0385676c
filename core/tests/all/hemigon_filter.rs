//! The filters of `hemigon` and `hemigon-fir` in one dimension: noise, steps and ramps against measured figures and f64 implementations.

use crate::common::{RngExt, off, seeded};
use core::f64::consts::PI;
use glam::Vec3;
use hemilux_core::sampler::hemigon::fir::{self, Kernel};
use hemilux_core::sampler::hemigon::follow::{Follow, PathPoint};
use hemilux_core::sampler::hemigon::kalman::{Gated, Kalman, Parameters, PathFilter};

/// Returns `count` normally distributed numbers of standard deviation 1.
fn noise(count: usize) -> Vec<f64> {
    let mut rng = seeded(71);
    let mut one = || -> f64 { (1.0 - rng.random::<f64>()).ln() };
    (0..count)
        .map(|i| (-2.0 * one()).sqrt() * (PI * 2.0 * (i as f64 * 0.618_033_988_7 + one()).fract()).cos())
        .collect()
}

/// A filter as a function from a signal to the filtered signal.
type Filter<'a> = &'a dyn Fn(&[f64]) -> Vec<f64>;

/// A name, a filter at a frame rate, and its expected figures at two rates.
type Row = (&'static str, fn(f64, &[f64]) -> Vec<f64>, [[f64; 3]; 2]);

/// Returns the figures of a filter that are the columns of the table below: RMS on noise, number of frames to 90 % of a step of 20, and
/// mean lag on a ramp of 2 per second.
fn figures(filter: Filter<'_>, rate: f64) -> [f64; 3] {
    let still = filter(&noise(100_000));
    let jitter = (still[100..].iter().map(|x| x * x).sum::<f64>() / 99_900.0).sqrt();
    let signal = noise(400 * 200);
    let mut frames = 0.0;
    for run in signal.chunks(200) {
        let stepped: Vec<f64> =
            run.iter().enumerate().map(|(i, x)| x + if i >= 100 { 20.0 } else { 0.0 }).collect();
        frames += filter(&stepped)[100..].iter().position(|x| *x >= 18.0).expect("the filter reaches 90 %")
            as f64
            + 1.0;
    }
    let truth: Vec<f64> = (0..100_000).map(|i| f64::from(i) * 2.0 / rate).collect();
    let ramp: Vec<f64> = truth.iter().zip(noise(100_000)).map(|(a, b)| a + b).collect();
    let lag = truth.iter().zip(filter(&ramp)).skip(100).map(|(t, x)| t - x).sum::<f64>() / 99_900.0;
    [jitter, frames / 400.0, lag]
}

/// Returns the parameters of the filter in the table: variance 0.5 per second, gate 16.
fn table(rate: f64, confirm: bool) -> Parameters {
    let alarm = if confirm { 5.0 } else { f32::INFINITY };
    Parameters { frame_rate_hz: rate as f32, drift_hz: 0.5, gate: 16.0, confirm, alarm }
}

fn kalman(parameters: Parameters, signal: &[f64]) -> Vec<f64> {
    let (mut filter, mut x) = (Kalman::at(1.0), signal[0]);
    let step = |z: &f64| {
        x += f64::from(filter.gain(&parameters, Vec3::X * (z - x) as f32, 1.0)) * (z - x);
        x
    };
    signal.iter().map(step).collect()
}

/// Filters one-dimensional steps by the rules of the module's documentation in f64, with the two-sided CUSUM by Crosier's recursion.
fn kalman_twin(p: &Parameters, signal: &[f64]) -> Vec<f64> {
    let q = f64::from(p.drift_hz) / f64::from(p.frame_rate_hz);
    let (mut x, mut variance, mut sum, mut suspect, mut jumped) = (signal[0], 1.0, 0.0f64, 0.0f64, false);
    let mut out = Vec::new();
    for z in signal {
        variance += q;
        let nu = z - x;
        let w: f64 = nu / (variance + 1.0).sqrt();
        sum += w.clamp(-3.0, 3.0);
        sum = sum.signum() * (sum.abs() - 0.5).max(0.0);
        let exceeds = w * w > f64::from(p.gate);
        if exceeds && (!p.confirm || jumped || suspect * w > 0.0) || sum.abs() > f64::from(p.alarm) {
            (x, variance, sum, suspect, jumped) = (*z, 1.0, 0.0, 0.0, true);
        } else if exceeds {
            (suspect, jumped) = (w, false);
        } else {
            (suspect, jumped) = (0.0, false);
            x += variance / (variance + 1.0) * nu;
            variance /= variance + 1.0;
        }
        out.push(x);
    }
    out
}

/// Filters `signal` with the finite impulse response; the first frame fills the history.
fn fir(taps: usize, rate: f64, signal: &[f64]) -> Vec<f64> {
    let kernel = Kernel::new(&fir::Parameters { taps, cutoff_hz: 1.0, frame_rate_hz: rate });
    (0..signal.len())
        .map(|i| kernel.weights().iter().enumerate().map(|(k, w)| w * signal[i.saturating_sub(k)]).sum())
        .collect()
}

#[test]
fn filter_figures_match_the_recorded_ones() {
    // The figures are those of a prototype in NumPy: jitter, frames to 90 %, ramp lag, at 6.7 and at 30 frames per second.
    let rows: [Row; 4] = [
        ("fir 7", |rate, s| fir(7, rate, s), [[0.52, 5.1, 0.88], [0.47, 5.7, 0.19]]),
        ("fir 15", |rate, s| fir(15, rate, s), [[0.49, 9.7, 2.08], [0.32, 11.6, 0.45]]),
        ("kalman at once", |rate, s| kalman(table(rate, false), s), [[0.37, 1.1, 0.94], [0.26, 1.1, 0.47]]),
        ("kalman confirmed", |rate, s| kalman(table(rate, true), s), [[0.37, 2.0, 0.49], [0.26, 2.0, 0.34]]),
    ];
    for (name, filter, expected) in rows {
        for (rate, expected) in [6.7, 30.0].into_iter().zip(expected) {
            let found = figures(&|s| filter(rate, s), rate);
            println!("{name} {rate}: {found:.3?}, design {expected:?}");
            for (i, within) in [0.02, 0.3, 0.1].into_iter().enumerate() {
                assert!((found[i] - expected[i]).abs() <= within, "{name} {rate}: {found:?} {expected:?}");
            }
        }
    }
}

#[test]
fn filter_matches_an_f64_implementation() {
    let mut signal = noise(5000);
    for (i, x) in signal.iter_mut().enumerate() {
        *x += if i % 400 > 200 { 15.0 } else { 0.0 } + if i % 97 == 0 { 30.0 } else { 0.0 };
    }
    for parameters in [table(10.0, false), table(10.0, true), Parameters::LIGHTS] {
        let (found, twin) = (kalman(parameters, &signal), kalman_twin(&parameters, &signal));
        // A step at the gate may be judged differently in f32 and f64; the effect ends after some frames.
        let far = found.iter().zip(&twin).filter(|(a, b)| (*a - *b).abs() > 1e-4).count();
        assert!(far < 25, "{far} of 5000 differ under {parameters:?}");
    }
}

#[test]
fn kalman_smooths_better_than_the_fir_and_follows_sooner() {
    let found = figures(&|s| kalman(Parameters::LIGHTS, s), 10.0);
    let published = figures(&|s| fir(7, 10.0, s), 10.0);
    println!("kalman {found:.3?}, fir {published:.3?}");
    assert!(found[0] < published[0] && found[1] < 2.3 && published[1] > 4.5, "{found:?} {published:?}");
}

#[test]
fn fir_kernels_are_windowed_sincs_of_sum_one() {
    for (taps, cutoff_hz, frame_rate_hz) in [(7, 1.0, 10.0), (15, 1.0, 6.7), (8, 2.0, 30.0), (63, 5.0, 30.0)]
    {
        let kernel = Kernel::new(&fir::Parameters { taps, cutoff_hz, frame_rate_hz });
        let w = kernel.weights();
        assert_eq!(w.len(), taps);
        assert!(off(w.iter().sum(), 1.0) < 1e-12);
        assert!((0..taps).all(|k| (w[k] - w[taps - 1 - k]).abs() < 1e-12), "{w:?}");
    }
    // Computed by hand: the Hamming window of 3 is 0.08, 1, 0.08; sinc(1/2) = 2 / pi.
    let kernel = Kernel::new(&fir::Parameters { taps: 3, cutoff_hz: 1.0, frame_rate_hz: 4.0 });
    let side = 0.08 * 2.0 / PI;
    assert!(off(kernel.weights()[0], side / (1.0 + 2.0 * side)) < 1e-12);
    // Invalid parameters give a filter with one coefficient of 1.
    for (taps, cutoff_hz, frame_rate_hz) in
        [(0, 1.0, 10.0), (1, 1.0, 10.0), (9, f64::NAN, 10.0), (9, 1.0, 0.0), (2, 10.0, 10.0)]
    {
        let kernel = Kernel::new(&fir::Parameters { taps, cutoff_hz, frame_rate_hz });
        let sum: f64 = kernel.weights().iter().sum();
        assert!(off(sum, 1.0) < 1e-12, "{taps} {cutoff_hz} {frame_rate_hz}");
    }
    assert_eq!(
        Kernel::new(&fir::Parameters { taps: 1000, ..fir::Parameters::default() }).weights().len(),
        63
    );
}

#[test]
fn single_outlier_is_ignored_if_jumps_need_confirmation() {
    let mut signal = vec![0.0; 50];
    signal[30] = 40.0;
    let confirmed = kalman(Parameters::LIGHTS, &signal);
    assert!(confirmed.iter().all(|x| x.abs() < 1e-6), "{confirmed:?}");
    assert_eq!(kalman(Parameters { confirm: false, ..Parameters::LIGHTS }, &signal)[30], 40.0);
}

#[test]
fn continued_motion_is_confirmed_only_once() {
    // At rest, then 10 standard deviations per frame: the first step is not taken, the next steps are.
    let signal: Vec<f64> = (0..40).map(|i| f64::from((i - 20).max(0)) * 10.0).collect();
    let found = kalman(Parameters::LIGHTS, &signal);
    assert_eq!((found[21], &found[22..]), (0.0, &signal[22..]));
}

#[test]
fn non_finite_step_is_taken_whole() {
    let mut filter = Kalman::at(1.0);
    assert_eq!(filter.gain(&Parameters::LIGHTS, Vec3::NAN, 1.0), 1.0);
    // Without variance and noise, the gain is 1.
    assert_eq!(Kalman::at(0.0).gain(&Parameters::LIGHTS, Vec3::X, 0.0), 1.0);
    assert_eq!(Kalman::at(0.0).gain(&Parameters::LIGHTS, Vec3::ZERO, 0.0), 1.0);
}

#[test]
fn oscillating_light_is_followed_and_noise_is_smoothed() {
    // The lamp moves 35 degrees to either side in eight frames, as on a cord; then it rests, with 1 degree of noise.
    let at = |a: f64| Vec3::new(a.sin() as f32, 0.3, a.cos() as f32).normalize();
    let seen = |a: f64| PathPoint { direction: at(a), colour: [1.0; 3] };
    let mut filter =
        Gated::try_new(Parameters::LIGHTS, 1, [PathFilter::default(); 2]).expect("buffers for one light");
    let noise = noise(60);
    let (mut lag, mut jitter) = (Vec::new(), Vec::new());
    for (t, n) in noise.iter().enumerate() {
        let swings = t < 24;
        let truth = if swings { 35f64.to_radians() * (PI * t as f64 / 4.0).sin() } else { 0.0 };
        let given = filter.follow(0, t == 0, seen(truth + if swings { 0.1 } else { 1.0 } * n.to_radians()));
        let off = given.direction.angle_between(at(truth)).to_degrees();
        match t {
            8..24 => lag.push(off),
            36.. => jitter.push(off),
            _ => {}
        }
    }
    let mean = |v: &[f32]| v.iter().sum::<f32>() / v.len() as f32;
    println!("swinging: {:.2} degrees behind; at rest: {:.2} off", mean(&lag), mean(&jitter));
    // The light moves up to 14 degrees per frame; the mean size of the noise is 0.8 degrees.
    assert!(mean(&lag) < 3.0 && mean(&jitter) < 0.6, "{lag:.1?} {jitter:.2?}");
}
