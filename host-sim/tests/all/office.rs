//! Real burst of an office: the merge against independent merges in `f64`, and the mean direction of the lights.

use glam::{DVec2, DVec3};
use hemilux::calibration::{Burst, Calibration, Frame, Pixels};
use hemilux::pipeline::{Pipeline, Settings};
use hemilux::recorded;
use hemilux_core::SamplerKind;
use hemilux_core::internals::merge::{Channels, Codes};
use hemilux_core::{FrontEnd, Order, Sizes};

fn load() -> Option<(Calibration, Burst)> {
    let read = recorded::read_burst(&crate::common::shared("office-burst")?).expect("a burst");
    Some((read.calibration, read.burst))
}

fn pipeline(calibration: &Calibration, burst: &Burst, settings: Settings) -> Pipeline {
    let exposures: Vec<_> = burst.frames.iter().map(|f| f.exposure).collect();
    Pipeline::try_new(*calibration, &exposures, settings).expect("a pipeline")
}

/// Returns the merged radiance of every sample of the burst, and whether the sample is clipped.
fn merged<'a>(calibration: &Calibration, burst: &'a Burst) -> Vec<(f64, bool)> {
    let exposures: Vec<_> = burst.frames.iter().map(|f| f.exposure).collect();
    let order = Order::ZERO;
    let sizes = Sizes::of(calibration, &exposures, order).expect("sizes");
    let memory = vec![0; sizes.words()];
    let mut front = FrontEnd::try_new(*calibration, &exposures, order, memory).expect("a front end");
    let codes = |frame: &'a Frame| match &frame.pixels {
        Pixels::U8(bytes) => Codes::Bytes(bytes),
        Pixels::U16(words) => Codes::Words(words),
    };
    let codes: Vec<_> = burst.frames.iter().map(codes).collect();
    let mut out = vec![0.0; 3 * (calibration.layout.width() * calibration.layout.height()) as usize];
    front.with_merge(|merge| {
        merge.samples(&codes, Channels::RGB, &mut out);
        let clipped = |at: usize| (at / 3 * 3..at / 3 * 3 + 3).any(|i| merge.is_clipped(&codes, i));
        out.iter().enumerate().map(|(at, v)| (f64::from(*v) * merge.unit(), clipped(at))).collect()
    })
}

/// Returns the relative exposure of a code by the response that `burst.toml` states.
fn response(channel: usize, code: u8) -> f64 {
    const C: [[f64; 5]; 3] = [
        [2.483637, -2.579117, 1.008328, 0.085240, 0.001911],
        [2.608240, -2.752853, 1.065764, 0.076901, 0.001950],
        [3.174483, -3.613317, 1.403803, 0.032150, 0.002880],
    ];
    let x = f64::from(code) / 255.0;
    let [a, b, c, d, e] = C[channel];
    (((a * x + b) * x + c) * x + d) * x + e
}

/// Returns the codes of sample `i` with the exposure times in seconds, shortest exposure first.
fn samples(burst: &Burst, i: usize) -> impl Iterator<Item = (u8, f64)> + '_ {
    burst.frames.iter().map(move |f| match &f.pixels {
        Pixels::U8(v) => (v[i], f.exposure.seconds),
        Pixels::U16(_) => unreachable!("the frames of the burst have 8 bits"),
    })
}

/// Returns the radiance of sample `i`: sum y / sum t over the exposures with codes from 16 to 249; without such codes, the radiance of the longest
/// exposure that is not saturated, else of the shortest.
fn twin(burst: &Burst, i: usize) -> f64 {
    let (mut y, mut t) = (0.0, 0.0);
    for (code, seconds) in samples(burst, i).filter(|(c, _)| (16..250).contains(c)) {
        y += response(i % 3, code);
        t += seconds;
    }
    if t > 0.0 {
        return y / t;
    }
    let fallback = samples(burst, i).filter(|(c, _)| *c < 250).last();
    let (code, seconds) = fallback.or_else(|| samples(burst, i).next()).expect("a frame");
    response(i % 3, code) / seconds
}

/// Returns the radiance of sample `i` by the merge of P. Debevec and J. Malik (1997), whose weight is a triangle over the codes.
fn hat(burst: &Burst, i: usize) -> Option<f64> {
    let (mut sum, mut weights) = (0.0, 0.0);
    for (code, seconds) in samples(burst, i).filter(|(c, _)| (1..255).contains(c)) {
        let weight = f64::from(code.min(255 - code));
        sum += weight * response(i % 3, code) / seconds;
        weights += weight;
    }
    (weights > 0.0).then(|| sum / weights)
}

fn inside(calibration: &Calibration) -> Vec<Option<DVec3>> {
    let (w, h) = (calibration.layout.width(), calibration.layout.height());
    let pixels = (0..h).flat_map(|y| (0..w).map(move |x| DVec2::new(x.into(), y.into())));
    pixels.map(|p| calibration.lens.unproject(p)).collect()
}

fn rms(pairs: impl Iterator<Item = (f64, f64)>) -> f64 {
    let (mut sum, mut count) = (0.0, 0usize);
    for (value, truth) in pairs.filter(|(_, truth)| *truth > 0.0) {
        sum += (value / truth - 1.0).powi(2);
        count += 1;
    }
    assert!(count > 1_000_000, "only {count} samples were compared");
    (sum / count as f64).sqrt()
}

/// Returns the relative RMS difference between the merge and `truth`, over the samples inside of the image circle that are not clipped.
fn merge_error(truth: impl Fn(&Burst, usize) -> Option<f64>) -> Option<f64> {
    let (calibration, burst) = load()?;
    let ours = merged(&calibration, &burst);
    let seen = inside(&calibration);
    let lit = (0..ours.len()).filter(|i| seen[i / 3].is_some() && !ours[*i].1);
    Some(rms(lit.filter_map(|i| Some((ours[i].0, truth(&burst, i)?)))))
}

#[test]
fn merge_equals_an_independent_merge_with_equal_weights() {
    let Some(error) = merge_error(|burst, i| Some(twin(burst, i))) else { return };
    println!("RMS against the f64 twin: {:.5} %", 100.0 * error);
    assert!(error < 1e-3, "RMS {error}");
}

#[test]
fn merge_agrees_with_a_merge_of_hat_weights() {
    let Some(error) = merge_error(hat) else { return };
    println!("RMS against hat weights: {:.2} %", 100.0 * error);
    assert!(error < 0.10, "RMS {error}");
}

#[test]
fn mean_direction_of_the_lights_is_that_of_the_pixels() {
    let Some((calibration, burst)) = load() else { return };
    let ours = merged(&calibration, &burst);
    let mut sum = DVec3::ZERO;
    for (p, direction) in inside(&calibration).iter().enumerate() {
        let at = DVec2::new(
            (p % calibration.layout.width() as usize) as f64,
            (p / calibration.layout.width() as usize) as f64,
        );
        if let (Some(d), Some(omega)) = (direction.filter(|d| d.z > 0.0), calibration.lens.solid_angle(at)) {
            let y = 0.2126 * ours[3 * p].0 + 0.7152 * ours[3 * p + 1].0 + 0.0722 * ours[3 * p + 2].0;
            sum += d * y * omega;
        }
    }
    for sampler in [SamplerKind::Q2Tree, SamplerKind::Adaptive] {
        let settings = Settings { sampler, ..Settings::default() };
        let mut pipeline = pipeline(&calibration, &burst, settings);
        let processed = pipeline.process(&burst).expect("lights");
        let lights = processed.decomposition.lights.iter();
        let mean: DVec3 = lights
            .map(|l| l.direction.as_dvec3() * f64::from(hemilux_core::color::luminance(l.irradiance)))
            .sum();
        let off = mean.normalize().dot(sum.normalize()).clamp(-1.0, 1.0).acos().to_degrees();
        println!("{sampler}: mean direction off by {off:.3} degrees");
        assert!(off < 1.0, "{sampler}: {off} degrees");
    }
}
