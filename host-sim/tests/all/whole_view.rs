//! Lights of a sensor's binned full-size frames, compared with the lights of its 640 x 480 mode.

use hemilux::pipeline::{Pipeline, Settings};
use hemilux_core::SamplerKind;
use hemilux_core::format::{Format, Pattern};
use hemilux_sim::bench::{Case, bursts};
use hemilux_sim::contender::judged;
use hemilux_sim::env::EnvMap;
use hemilux_sim::metrics::{Domain, LitSet, Reading, Reference};

fn lights(size: (u32, u32), bin: u32) -> LitSet {
    let format = Format::Raw10(Pattern::Rggb);
    let case = Case { size, bin, lights: 200, ..Case::of_format(format) };
    let (calibration, burst) = (bursts::calibration(&case), &bursts::make(&case)[0]);
    let exposures: Vec<_> = burst.frames.iter().map(|f| f.exposure).collect();
    let settings = Settings { sampler: SamplerKind::Q2Tree, soft: false, lights: 200, ..Settings::default() };
    let mut pipeline = Pipeline::try_new(calibration, &exposures, settings).expect("a pipeline");
    judged(&pipeline.process(burst).expect("lights").decomposition)
}

#[test]
fn binned_full_size_frames_have_the_open_irradiance_of_640_by_480_within_half_a_percent() {
    let reference = Reference::new(&EnvMap::from_fn(64, 32, |_| [1.0; 3]), Domain::Hemisphere);
    let open = |set: &LitSet| reference.open_of(set, Reading::Points);
    let (small, whole) = (open(&lights((640, 480), 1)), open(&lights((1640, 1232), 2)));
    let squares = |values: &mut dyn Iterator<Item = f64>| values.map(|v| v * v).sum::<f64>().sqrt();
    let off =
        squares(&mut whole.iter().zip(&small).map(|(w, s)| w - s)) / squares(&mut small.iter().copied());
    println!("open {:.3} %", 100.0 * off);
    assert!(off <= 0.005, "{off}");
}
