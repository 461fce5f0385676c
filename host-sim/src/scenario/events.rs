//! Scenarios without motion: switched lamps, mains flicker, noise, changes of brightness and colour, faults of the exposures.

use super::Scenario;
use super::stage::{Stage, WARM, at, energy, repainted, with_disc};
use crate::burst::THESIS_EXPOSURES_S as EXPOSURES_S;
use crate::env::EnvMap;
use crate::metrics::stability::LightSource;
use rand::SeedableRng;
use rand_distr::{Distribution, StandardNormal, Uniform};
use rand_pcg::Pcg64;
use std::f64::consts::{PI, TAU};

/// Interval of bursts, seconds, of a camera with a nominal rate of 10 Hz. At exactly 10 Hz, flicker of 100 and of 120 Hz would be constant.
const BURST_S: f64 = 0.103;
/// Interval of the frames of a burst, seconds.
const FRAME_S: f64 = 1.0 / 30.0;
/// Standard deviation of the noise of a texel, relative to its radiance.
const NOISE: f64 = 0.02;

fn rng(stage: &Stage, stream: u64) -> Pcg64 {
    Pcg64::seed_from_u64(stage.setting.seed.wrapping_mul(0x9e37_79b9).wrapping_add(stream))
}

/// Returns the scenario `switch`: a lamp with the energy of the rest of the scene is on from one third to two thirds of the sequence.
pub(super) fn switch(stage: &Stage) -> Scenario {
    let lamp = LightSource { direction: at(50.0, 150.0), radius_deg: 4.0 };
    let flux = energy(&stage.room);
    let (on, off) = (stage.frames() / 3, 2 * stage.frames() / 3);
    let lit = with_disc(&stage.room, lamp, WARM, flux);
    let truth = stage.sequence(|t| if (on..off).contains(&t) { lit.clone() } else { stage.room.clone() });
    Scenario {
        sources: vec![vec![lamp]; stage.frames()],
        changes: vec![on, off],
        switched_energy: Some(flux),
        ..Scenario::of("switch", truth)
    }
}

/// Returns the mean of 2 sin^2(2 pi `mains_hz` t), whose long-term mean is 1, over an exposure.
fn mains(mains_hz: f64, start_s: f64, exposure_s: f64) -> f64 {
    let omega = 2.0 * TAU * mains_hz;
    1.0 - ((omega * (start_s + exposure_s)).sin() - (omega * start_s).sin()) / (omega * exposure_s)
}

/// Returns the scenario of a room whose light flickers with twice `mains_hz`. The texels of the ceiling lamp are valid in the shortest exposure
/// alone, all other texels in three exposures, whose sums the merge divides. The true map is the mean over time, as perceived by people.
pub(super) fn flicker(stage: &Stage, name: &'static str, mains_hz: f64) -> Scenario {
    let lamp = LightSource { direction: at(35.0, -120.0), radius_deg: 5.0 };
    let flux = energy(&stage.room);
    let steady = with_disc(&stage.room, lamp, WARM, flux);
    let truth = vec![steady; stage.frames()];
    let seen = stage.sequence(|t| {
        let start = |i: usize| t as f64 * BURST_S + i as f64 * FRAME_S;
        let of = |i: usize| mains(mains_hz, start(i), EXPOSURES_S[i]);
        let merged = (0..3).map(|i| EXPOSURES_S[i] * of(i)).sum::<f64>() / EXPOSURES_S.iter().sum::<f64>();
        let lit = repainted(&stage.room, |_, rgb| rgb.map(|v| (f64::from(v) * merged) as f32));
        with_disc(&lit, lamp, WARM, flux * of(0))
    });
    let sources = vec![vec![lamp]; stage.frames()];
    Scenario { sources, seen: Some(seen), ..Scenario::of(name, truth) }
}

/// Returns the scenario `noise`: the scene is static, and each texel has independent noise in every frame.
pub(super) fn noise(stage: &Stage) -> Scenario {
    let mut rng = rng(stage, 1);
    let seen = stage.sequence(|_| noisy(&stage.room, NOISE, &mut rng));
    let truth = vec![stage.room.clone(); stage.frames()];
    Scenario { seen: Some(seen), static_noise: true, ..Scenario::of("noise", truth) }
}

fn noisy(map: &EnvMap, sigma: f64, rng: &mut Pcg64) -> EnvMap {
    let texels = map.texels().iter().map(|rgb| {
        rgb.map(|v| {
            let normal: f64 = StandardNormal.sample(rng);
            (f64::from(v) * (1.0 + sigma * normal)).max(0.0) as f32
        })
    });
    EnvMap::new(map.width(), map.height(), texels.collect())
}

/// Returns the scenario `grid-of-lamps`: five by five lamps on the ceiling, whose equal energies drift by half a per cent.
pub(super) fn grid_of_lamps(stage: &Stage) -> Scenario {
    let mut rng = rng(stage, 2);
    let phase = Uniform::new(0.0, TAU).expect("an interval");
    let phases: [f64; 25] = std::array::from_fn(|_| phase.sample(&mut rng));
    let lamp = |k: usize| {
        let tile = |i: usize| 0.45 * (i as f64 - 2.0);
        let direction = [tile(k % 5) + 0.07, tile(k / 5) - 0.04, 1.0];
        let direction = crate::metrics::vector::unit(direction).unwrap_or([0.0, 0.0, 1.0]);
        LightSource { direction, radius_deg: 3.0 }
    };
    let flux = 2.0 * energy(&stage.room) / 25.0;
    let truth = stage.sequence(|t| {
        let drift = |k: usize| 1.0 + 0.005 * (phases[k] + TAU * 2.0 * stage.progress(t)).sin();
        (0..25).fold(stage.room.clone(), |map, k| with_disc(&map, lamp(k), WARM, flux * drift(k)))
    });
    let sources = vec![(0..25).map(lamp).collect(); stage.frames()];
    Scenario { sources, ..Scenario::of("grid-of-lamps", truth) }
}

/// Returns the scenario `dark-and-back`: the light falls to 1/50 and returns. It does not fall to 0, since flicker is relative to the light of its
/// frame.
pub(super) fn dark_and_back(stage: &Stage) -> Scenario {
    let dark = repainted(&stage.room, |_, rgb| rgb.map(|v| v * 0.02));
    let (off, on) = (stage.frames() / 3, 2 * stage.frames() / 3);
    let truth = stage.sequence(|t| if (off..on).contains(&t) { dark.clone() } else { stage.room.clone() });
    Scenario { changes: vec![off, on], ..Scenario::of("dark-and-back", truth) }
}

/// Returns the scenario `all-clipped`: from one third of the sequence on every texel has the largest radiance that the longest exposure can measure,
/// as in a burst whose frames are overexposed.
pub(super) fn all_clipped(stage: &Stage) -> Scenario {
    let change = stage.frames() / 3;
    let clipped = repainted(&stage.room, |_, _| [4.0; 3]);
    let truth = stage.sequence(|t| if t >= change { clipped.clone() } else { stage.room.clone() });
    Scenario { changes: vec![change], ..Scenario::of("all-clipped", truth) }
}

/// Returns the scenario `n-changes`: the scene is static, and a random number of lights, from N / 2 to N, is requested for every frame.
pub(super) fn n_changes(stage: &Stage) -> Scenario {
    let mut rng = rng(stage, 3);
    let share = Uniform::new_inclusive(0.5, 1.0).expect("an interval");
    let share = (0..stage.frames()).map(|_| share.sample(&mut rng)).collect();
    Scenario { share, ..Scenario::of("n-changes", vec![stage.room.clone(); stage.frames()]) }
}

/// Returns the scenario `exposure-faults`: faults of the capture change the radiance of the merge, which is the sum of the samples that do not
/// saturate over the sum of their times.
/// - the shortest exposure is missing: radiance above the clip value of the next exposure is limited to that value;
/// - the longest exposure replaces the middle exposure: radiance above the clip value of the longest exposure is measured in the shortest exposure
///   alone, with its noise;
/// - the first two exposures are exchanged: each sample is divided by the other exposure's time.
///
/// A fault is followed by two frames without a fault.
pub(super) fn exposure_faults(stage: &Stage) -> Scenario {
    let mut rng = rng(stage, 4);
    let brightest = stage.room.texels().iter().flatten().fold(0.0, |a: f32, b| a.max(*b));
    // The brightest texel reaches the clip value of the shortest exposure, from which the clip values of the other exposures follow.
    let clip = EXPOSURES_S.map(|s| f64::from(brightest) * EXPOSURES_S[0] / s);
    let seen = stage.sequence(|t| match t % 9 {
        2 => repainted(&stage.room, |_, rgb| rgb.map(|v| v.min(clip[1] as f32))),
        5 => doubled(&stage.room, clip, &mut rng),
        8 => repainted(&stage.room, |_, rgb| rgb.map(|v| swapped(f64::from(v), clip) as f32)),
        _ => stage.room.clone(),
    });
    let truth = vec![stage.room.clone(); stage.frames()];
    Scenario { seen: Some(seen), ..Scenario::of("exposure-faults", truth) }
}

/// Adds noise to `map` as if the longest exposure replaced the middle exposure: texels that are valid in the shortest exposure alone receive normal
/// noise with a standard deviation of 3 per mille of the radiance at which the shortest exposure clips.
fn doubled(map: &EnvMap, clip: [f64; 3], rng: &mut Pcg64) -> EnvMap {
    let texels = map.texels().iter().map(|rgb| {
        rgb.map(|v| {
            let normal: f64 = StandardNormal.sample(rng);
            let noise = if f64::from(v) > clip[2] { 0.003 * clip[0] * normal } else { 0.0 };
            (f64::from(v) + noise).max(0.0) as f32
        })
    });
    EnvMap::new(map.width(), map.height(), texels.collect())
}

/// Returns the radiance that the merge computes from `radiance` if the samples of the first two exposures are exchanged.
fn swapped(radiance: f64, clip: [f64; 3]) -> f64 {
    let times = [EXPOSURES_S[1], EXPOSURES_S[0], EXPOSURES_S[2]];
    let valid = |i: &usize| radiance <= clip[*i] * (1.0 + 1e-6);
    let sum = |of: [f64; 3]| (0..3).filter(valid).map(|i| of[i]).sum::<f64>();
    radiance * sum(EXPOSURES_S) / sum(times)
}

/// Returns the scenario `hue-shift`: the colours drift towards blue and back at constant luminance of each texel.
pub(super) fn hue_shift(stage: &Stage) -> Scenario {
    let truth = stage.sequence(|t| {
        let blue = (PI * stage.progress(t)).sin();
        let gain = [1.0 - 0.6 * blue, 1.0, 1.0 + 3.0 * blue];
        repainted(&stage.room, |_, rgb| {
            let old = rgb.map(f64::from);
            let new: [f64; 3] = std::array::from_fn(|i| old[i] * gain[i]);
            let ratio =
                crate::metrics::luminance(old) / crate::metrics::luminance(new).max(f64::MIN_POSITIVE);
            new.map(|v| (v * ratio) as f32)
        })
    });
    Scenario::of("hue-shift", truth)
}
