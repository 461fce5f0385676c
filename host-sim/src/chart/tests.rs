//! Tests of the chart's JSON, drawings and numbers of lights on small maps.

use super::*;
use hemilux_core::SamplerKind;

fn two_maps() -> Vec<EnvMap> {
    let lamp = |d: [f64; 3]| if d[2] > 0.9 { [40.0f32, 30.0, 20.0] } else { [0.3, 0.2, 0.2] };
    vec![EnvMap::from_fn(32, 16, lamp), EnvMap::from_fn(32, 16, |d| [1.0 + d[0] as f32; 3])]
}

fn two_methods() -> Vec<Method> {
    methods().into_iter().filter(|m| ["q2tree", "median-cut"].contains(&m.name)).collect()
}

#[test]
fn json_has_the_keys_of_the_format_and_one_point_per_count() {
    let methods = two_methods();
    let mut points = points(&two_maps(), &methods, 4, 1);
    assert_eq!(points.len(), methods.iter().map(|m| counts(m, 4).len()).sum::<usize>());
    measure::bursts(&two_maps()[0], &mut points, 1).unwrap();
    let parsed: serde_json::Value = serde_json::from_str(&json(&points)).unwrap();
    for point in parsed["points"].as_array().unwrap() {
        for key in ["sample_ms", "open", "shadowed", "worst_shadowed", "energy"] {
            assert!(point[key].as_f64().is_some_and(|v| v >= 0.0), "{key}: {point}");
        }
        assert_eq!(point["maps"], 2);
        assert!(point["worst_shadowed"].as_f64() >= point["shadowed"].as_f64());
        assert!(point["energy"].as_f64().unwrap() < 1e-3, "{point}");
        assert_eq!(point["burst_ms"].is_null(), point["sampler"] == "median-cut");
    }
    let (time, lights) = (figure::time(&points), figure::lights(&points));
    assert!(time.contains("</svg>") && lights.contains("median-cut"));
    assert!(fewest(&points, "median-cut", 0.05).is_some_and(|n| n <= 256));
}

#[test]
fn lights_that_are_fitted_as_discs_are_charted_as_discs() {
    let methods: Vec<_> =
        methods().into_iter().filter(|m| ["adaptive", "adaptive+soft"].contains(&m.name)).collect();
    for point in points(&two_maps(), &methods, 4, 1) {
        let [points, discs] = [[point.open, point.shadowed], [point.soft_open, point.soft_shadowed]];
        let expected = if point.sampler == "adaptive" { points } else { discs };
        assert_eq!([point.drawn_open(), point.drawn_shadowed()], expected, "{point:?}");
        assert!(![16, 64].contains(&point.lights) || points != discs, "the two readings differ: {point:?}");
    }
}

#[test]
fn counts_ascend_from_the_least_supported_number_to_1024() {
    for method in methods().iter().filter(|m| m.kind == MethodKind::Core) {
        let least = method.least(Domain::Sphere);
        for step in [2, 4] {
            let counts = counts(method, step);
            assert_eq!((counts[0], counts[counts.len() - 1]), (least, MOST));
            assert!(counts.windows(2).all(|pair| pair[0] < pair[1]));
        }
    }
}

#[test]
fn counted_frames_refuse_a_number_of_lights_that_the_sampler_does_not_support() {
    assert!(counted::sample_frames(SamplerKind::Q2Tree, 16, 2).is_ok());
    let refused = counted::sample_frames(SamplerKind::Q2Tree, 1, 2).unwrap_err();
    assert_eq!(refused.code(), 2);
}
