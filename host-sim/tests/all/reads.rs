//! Light of the merge of needed exposures, compared with the light of the merge of all exposures.

use hemilux::recorded;
use hemilux::scene;
use hemilux_sim::bench::bursts::{calibration, make_of};
use hemilux_sim::bench::case;
use hemilux_sim::reads::compare;

/// Largest allowed open error between the lights of the two merge modes, a ratio.
const MOST: f64 = 0.001;

#[test]
fn light_of_needed_exposures_equals_light_of_all_in_every_format_and_scene() {
    for case in case::formats() {
        for scene in scene::NAMES.map(|name| scene::by_name(name).expect("a scene")) {
            let found = compare(&calibration(&case), &make_of(&case, scene, 1)).expect("fits");
            let what = format!("{} of {}: {found:?}", case.format_name(), scene.name());
            assert!(found.open <= MOST, "{what}");
            assert!((1.0..2.0).contains(&found.exposures_read), "{what}");
            assert!(found.open > 0.0, "the modes read the same samples: {what}");
        }
    }
}

/// The response curve of this burst is inexact: the radiance of a sample differs by about 5 % between neighbouring exposures, and the exposures that
/// are not read have a fifth of the weight.
#[test]
fn light_of_needed_exposures_of_a_real_office_differs_by_at_most_1_5_percent() {
    let Some(folder) = crate::common::shared("office-burst") else { return };
    let read = recorded::read_burst(&folder).expect("a burst");
    let found = compare(&read.calibration, &[read.burst]).expect("fits");
    assert!(found.open <= 0.015, "{found:?}");
    assert!(found.exposures_read < 6.0, "of nine exposures: {found:?}");
}
