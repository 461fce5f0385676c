//! Light sets of tiers change as little from frame to frame as those of a probe that is set to their number of lights.

use hemilux::light_set::OwnedSet;
use hemilux::pipeline::Settings;
use hemilux::probe::tiers::{Selection, Served};
use hemilux::probe::{Config, Worker};
use hemilux::scene;
use hemilux::source::{Pace, SceneSource};
use hemilux_core::SamplerKind;
use std::collections::HashSet;
use std::sync::Arc;

const WARM_UP: usize = 10;
const FRAMES: usize = 60;

/// Change of light sets from frame to frame: the fraction of ids that stay, and the mean change of the irradiance of receivers with normals
/// along the axes, divided by the mean irradiance.
#[derive(Debug)]
struct Steadiness {
    kept: f64,
    change: f64,
}

fn irradiance(set: &OwnedSet) -> [f64; 5] {
    use glam::Vec3;
    let normals = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z];
    let of = |n: Vec3| {
        let each = set.lights.iter().map(|l| l.irradiance[1] * n.dot(l.direction).max(0.0));
        f64::from(each.sum::<f32>())
    };
    normals.map(of)
}

fn steadiness(sets: &[Arc<OwnedSet>]) -> Steadiness {
    let (mut kept, mut ids, mut change, mut mean) = (0, 0, 0.0, 0.0);
    for pair in sets.windows(2) {
        let before: HashSet<u32> = pair[0].lights.iter().map(|l| l.id).collect();
        kept += pair[1].lights.iter().filter(|l| before.contains(&l.id)).count();
        ids += pair[1].lights.len();
        for (a, b) in irradiance(&pair[0]).into_iter().zip(irradiance(&pair[1])) {
            change += (a - b).abs();
            mean += b;
        }
    }
    Steadiness { kept: kept as f64 / ids as f64, change: change / mean }
}

/// Returns the sets of `selection` from a probe of `sampler` with `lights` lights, on the built-in scene `room`.
fn sets(sampler: SamplerKind, lights: usize, selection: Selection) -> Vec<Arc<OwnedSet>> {
    let source = Box::new(SceneSource::new(scene::by_name("room").expect("a scene"), Pace::Free));
    let pipeline = Settings { sampler, lights, ..Settings::default() };
    let config = Config { pipeline, ..Config::steady() };
    let mut worker = Worker::try_new(source, "test".into(), config).expect("a worker");
    let link = worker.link();
    let mut frame = |_| {
        let _ = link.tiers().request(selection);
        worker.step().expect("a frame");
        match link.tiers().request(selection) {
            Served::Set(set) => set,
            Served::Own => link.sets().latest().expect("a set"),
            Served::NotYet(tier) => panic!("{tier:?} was requested before the frame"),
        }
    };
    (0..WARM_UP + FRAMES).map(&mut frame).skip(WARM_UP).collect()
}

#[test]
fn a_tier_is_as_steady_as_a_probe_set_to_its_lights() {
    for (sampler, alone) in [
        (SamplerKind::Adaptive, SamplerKind::Adaptive),
        // A tree over a hemisphere has at least eight lights: sets of four lights are those of `adaptive`.
        (SamplerKind::Q2Tree, SamplerKind::Q2Tree),
    ] {
        for lights in [4, 8] {
            let selection = Selection { lights: Some(lights), ambient: Some(false), soft: None };
            let tier = sets(sampler, 64, selection);
            let alone = if lights < 8 { SamplerKind::Adaptive } else { alone };
            let own = sets(alone, lights, Selection::OWN);
            assert!(
                tier.iter().all(|set| set.lights.len() <= lights && set.sampler == alone.name()),
                "{alone}"
            );
            let (tier, own) = (steadiness(&tier), steadiness(&own));
            println!("{sampler} {lights}: tier {tier:?}, own {own:?}");
            assert!(tier.kept >= 0.98, "{sampler} {lights}: {tier:?}");
            assert!(tier.change <= 1.1 * own.change, "{sampler} {lights}: {tier:?}, own {own:?}");
        }
    }
}
