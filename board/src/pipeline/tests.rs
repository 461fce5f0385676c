use super::*;
use crate::calibration::Pixels;
use crate::scene;
use crate::source::{Pace, SceneSource, Source};
use hemilux_core::wire::FrameFault;

#[test]
fn the_shortest_and_the_longest_exposure_are_always_read() {
    for (count, most) in (2..=12).flat_map(|count| (2..=count).map(move |most| (count, most))) {
        let read: Vec<_> = (0..count).filter(|index| is_read(*index, count, most)).collect();
        assert_eq!(read.len(), most, "{most} of {count}: {read:?}");
        assert!(read.contains(&0) && read.contains(&(count - 1)), "{most} of {count}: {read:?}");
    }
}

#[test]
fn a_wrong_shortest_exposure_holds_the_lights_for_four_bursts_and_then_no_longer() {
    let mut source = SceneSource::new(scene::by_name("room").expect("a scene"), Pace::Free);
    let pipeline = Pipeline::try_new(*source.calibration(), &source.exposures(), Settings::default());
    let (mut pipeline, mut burst) = (pipeline.expect("a pipeline"), Burst::default());
    let exposures = source.exposures().len();
    let mut left_out = |is_black: bool| {
        source.next(&mut burst).expect("a burst");
        if is_black {
            match &mut burst.frames[0].pixels {
                Pixels::U8(codes) => codes.fill(0),
                Pixels::U16(codes) => codes.fill(0),
            }
        }
        let processed = pipeline.process(&burst).expect("a frame");
        let faults: Vec<_> = processed.frames_left_out.iter().map(|frame| frame.fault).collect();
        (faults, processed.scalar_flux)
    };
    let held = [vec![FrameFault::Black], vec![FrameFault::Incomplete; exposures - 1]].concat();
    for round in 0..2 {
        let (faults, flux) = left_out(false);
        assert_eq!(faults, [], "round {round}");
        for burst in 0..4 {
            assert_eq!(left_out(true), (held.clone(), flux), "round {round}, burst {burst}");
        }
        for burst in 4..12 {
            assert_eq!(left_out(true).0, [FrameFault::Black], "round {round}, burst {burst}");
        }
    }
}

#[test]
fn the_stage_filter_takes_time_in_samplers_with_temporal_filters_and_none_in_others() {
    for sampler in SamplerKind::ALL {
        let mut source = SceneSource::new(scene::by_name("room").expect("a scene"), Pace::Free);
        let settings = Settings { sampler, ..Settings::default() };
        let pipeline = Pipeline::try_new(*source.calibration(), &source.exposures(), settings);
        let (mut pipeline, mut burst) = (pipeline.expect("a pipeline"), Burst::default());
        let mut filter = Duration::ZERO;
        for _ in 0..3 {
            source.next(&mut burst).expect("a burst");
            let times = pipeline.process(&burst).expect("a frame").times;
            filter += times.filter;
            let sum = times.front + times.pyramid + times.sample + times.filter;
            assert_eq!(times.latency().total, u32::try_from(sum.as_micros()).expect("seconds"), "{sampler}");
        }
        let has_filter =
            matches!(sampler, SamplerKind::Adaptive | SamplerKind::Hemigon | SamplerKind::HemigonFir);
        assert_eq!(!filter.is_zero(), has_filter, "{sampler}: {filter:?}");
    }
}
