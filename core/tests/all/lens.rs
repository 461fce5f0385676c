//! Lens models against closed forms.

use crate::common::{RngExt, off, plain, seeded};
use core::f64::consts::{PI, TAU};
use glam::{DVec2, DVec3};
use hemilux_core::lens::{Intrinsics, Lens, LensError, Model};

/// Coefficients of a 190-degree clip-on lens for phones, as OpenCV's fisheye calibration reports them.
const KANNALA_BRANDT: Model = Model::KannalaBrandt([-0.012, 0.006, -0.004, 0.000_6]);

/// Returns every lens model with its widest field of view, degrees off axis: the model of equation 4.1 increases up to 90 degrees only
/// without negative coefficients.
fn models() -> [(Model, f64); 6] {
    [
        (Model::Equidistant, 93.0),
        (Model::Equidistant, 180.0),
        (Model::Equisolid, 110.0),
        (KANNALA_BRANDT, 95.0),
        (Model::Radial([0.05, 0.002]), 70.0),
        (Model::Radial([-0.2, 0.05]), 75.0),
    ]
}

/// Returns a lens with skew, unequal focal lengths and a principal point off the centre.
fn awkward(model: Model, max_deg: f64) -> Lens {
    let p = plain(model, [467.3, 391.8], 1.0, max_deg);
    let p = Intrinsics { focal_px: DVec2::new(311.2, 298.7), skew_px: 4.5, ..p };
    Lens::try_new(p).expect("a sound lens")
}

/// Returns r(theta) of `model`, from the formulas of `board/FORMATS.md`.
fn law(model: &Model, theta: f64) -> f64 {
    match *model {
        Model::Equidistant => theta,
        Model::Equisolid => 2.0 * (theta / 2.0).sin(),
        Model::KannalaBrandt(k) => {
            theta * (1.0 + (0..4).map(|i| k[i] * theta.powi(2 * i as i32 + 2)).sum::<f64>())
        }
        Model::Radial([k0, k1]) => {
            let d = theta.tan().powi(2);
            theta.tan() * (1.0 + k0 * d + k1 * d * d)
        }
        other => panic!("no twin of {other:?}"),
    }
}

fn unit(theta: f64, phi: f64) -> DVec3 {
    DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos())
}

#[test]
fn projection_matches_the_formula_of_each_model() {
    for (model, max_deg) in models() {
        let lens = awkward(model, max_deg);
        for i in 0..2000 {
            let theta = max_deg.to_radians() * f64::from(i) / 2000.0;
            let phi = f64::from(i) * 0.7;
            let (r, n) = (law(&model, theta), DVec2::from_angle(phi));
            let expected = DVec2::new(467.3 + 311.2 * r * n.x + 4.5 * r * n.y, 391.8 + 298.7 * r * n.y);
            let found = lens.project(unit(theta, phi)).expect("inside the view");
            assert!((found - expected).length() < 1e-9 * (1.0 + expected.length()), "{model:?} {theta}");
        }
    }
}

#[test]
fn round_trips_stay_within_a_thousandth_of_a_pixel() {
    let mut worst = (0.0f64, 0.0f64);
    for (model, max_deg) in models() {
        let lens = awkward(model, max_deg);
        let mut rng = seeded(1);
        for i in 0..20_000 {
            let theta = max_deg.to_radians() * if i % 10 == 0 { 1.0 - 1e-9 } else { rng.random::<f64>() };
            let d = unit(theta, rng.random_range(-PI..PI));
            let pixel = lens.project(d).expect("inside the view");
            let back = lens.unproject(pixel).expect("inside the view");
            worst.0 = worst.0.max((back - d).length());
            assert!((back.length() - 1.0).abs() < 1e-12, "{model:?} gives a unit vector");
            // At the antipode of the axis, all pixels of a circle have the same direction.
            if theta < 3.1 {
                worst.1 = worst.1.max((lens.project(back).expect("inside") - pixel).length());
            }
        }
    }
    println!("worst round trip {:.1e} (direction), {:.1e} px", worst.0, worst.1);
    assert!(worst.0 < 1e-6 && worst.1 < 1e-3, "{worst:?}");
}

#[test]
fn solid_angles_of_all_pixels_add_up_to_the_cap() {
    for (model, max_deg) in models() {
        // Focal lengths for which the circle has a radius of about 400 pixels.
        let focal = 400.0 / law(&model, max_deg.to_radians());
        let p = plain(model, [420.3, 431.8], focal, max_deg);
        let p = Intrinsics { focal_px: DVec2::new(focal, 0.95 * focal), skew_px: 0.02 * focal, ..p };
        let lens = Lens::try_new(p).expect("a sound lens");
        let pixels = (0..900 * 900).map(|i| DVec2::new(f64::from(i % 900), f64::from(i / 900)));
        let sum: f64 = pixels.filter_map(|p| lens.solid_angle(p)).sum();
        let cap = TAU * (1.0 - max_deg.to_radians().cos());
        println!("{model:?} {max_deg}: {:.4} %", 100.0 * off(sum, cap));
        assert!(off(sum, cap) < 0.005, "{model:?} {sum} {cap}");
    }
}

#[test]
fn solid_angle_matches_finite_differences() {
    for (model, max_deg) in models() {
        let lens = awkward(model, max_deg);
        let mut rng = seeded(2);
        for i in 0..2000 {
            // The test uses the axis first, then random angles up to near the antipode.
            let theta =
                if i == 0 { 0.0 } else { max_deg.to_radians().min(3.0) * 0.999 * rng.random::<f64>() };
            let p = lens.project(unit(theta, rng.random_range(-PI..PI))).expect("inside the view");
            let h = 1e-3;
            let at = |x: f64, y: f64| lens.unproject(p + DVec2::new(x, y)).expect("inside the view");
            let across = (at(h, 0.0) - at(-h, 0.0)).cross(at(0.0, h) - at(0.0, -h));
            let expected = across.length() / (4.0 * h * h);
            let found = lens.solid_angle(p).expect("inside the view");
            assert!(off(found, expected) < 1e-5, "{model:?} at {theta}: {found} {expected}");
        }
    }
}

#[test]
fn the_axis_is_imaged_at_the_centre() {
    for (model, max_deg) in models() {
        let lens = awkward(model, max_deg);
        let centre = DVec2::new(467.3, 391.8);
        assert_eq!(lens.project(DVec3::Z), Some(centre));
        assert_eq!(lens.unproject(centre), Some(DVec3::Z));
        let on_axis = lens.solid_angle(centre).expect("inside the view");
        assert!(off(on_axis, 1.0 / (311.2 * 298.7)) < 1e-12, "{model:?}: r'(0) = 1");
    }
}

#[test]
fn project_and_unproject_return_none_outside_the_field_of_view() {
    for (model, max_deg) in models().into_iter().filter(|(_, max)| *max < 170.0) {
        let lens = awkward(model, max_deg);
        let beyond = (max_deg + 1e-6).to_radians();
        assert_eq!(lens.project(unit(beyond, 1.0)), None, "{model:?}");
        assert_eq!(lens.project(DVec3::NEG_Z), None, "{model:?}");
        let far = DVec2::new(467.3 + 311.2 * law(&model, max_deg.to_radians()) + 0.01, 391.8);
        assert_eq!(lens.unproject(far), None, "{model:?}");
        assert_eq!(lens.solid_angle(far), None, "{model:?}");
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert_eq!(lens.unproject(DVec2::new(bad, 3.0)), None, "{model:?} {bad}");
            assert_eq!(lens.unproject(DVec2::new(3.0, bad)), None, "{model:?} {bad}");
            assert_eq!(lens.project(DVec3::new(bad, 0.0, 1.0)), None, "{model:?} {bad}");
            assert_eq!(lens.project(DVec3::new(bad, f64::NAN, 1.0)), None, "{model:?} {bad}");
            assert_eq!(lens.project(DVec3::new(0.0, 0.1, bad)), None, "{model:?} {bad}");
        }
    }
}

#[test]
fn field_of_view_beyond_the_monotone_range_is_refused() {
    let refused = |model, max_deg| match Lens::try_new(plain(model, [0.0; 2], 100.0, max_deg)) {
        Err(LensError::NotMonotone { limit_degrees, .. }) => limit_degrees,
        other => panic!("{other:?} where {model:?} stops growing"),
    };
    // A pinhole lens never images 90 degrees.
    for max_deg in [90.0, 90.000_1, 120.0, 180.0] {
        let limit = refused(Model::Radial([0.0, 0.0]), max_deg);
        assert!((89.0..=90.0).contains(&limit), "{limit}");
    }
    // d/dx (x - 0.3 x^3) = 0 at x = 1/sqrt(0.9), which is the tangent of 46.508 degrees.
    let limit = refused(Model::Radial([-0.3, 0.0]), 60.0);
    assert!((46.3..46.51).contains(&limit), "{limit}");
    assert!(Lens::try_new(plain(Model::Radial([-0.3, 0.0]), [0.0; 2], 100.0, limit)).is_ok());
    // d/dt (t - 0.2 t^3) = 0 at t = 1/sqrt(0.6): 73.97 degrees.
    let limit = refused(Model::KannalaBrandt([-0.2, 0.0, 0.0, 0.0]), 90.0);
    assert!((73.7..73.98).contains(&limit), "{limit}");
}

#[test]
fn non_finite_or_non_positive_parameters_are_refused() {
    let sound = plain(Model::Equidistant, [1.0; 2], 100.0, 90.0);
    let refused = |p| Lens::try_new(p).expect_err("must be refused");
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let all = [
            Intrinsics { focal_px: DVec2::new(100.0, bad), ..sound },
            Intrinsics { focal_px: DVec2::new(bad, 100.0), ..sound },
            Intrinsics { centre_px: DVec2::new(bad, 1.0), ..sound },
            Intrinsics { skew_px: bad, ..sound },
            Intrinsics { model: Model::Radial([bad, 0.0]), ..sound },
            Intrinsics { model: Model::KannalaBrandt([0.0, 0.0, 0.0, bad]), ..sound },
            Intrinsics { vignetting: [1.0, bad, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], ..sound },
        ];
        for p in all {
            assert_eq!(refused(p), LensError::BadNumber, "{p:?}");
        }
        assert!(matches!(refused(Intrinsics { max_theta: bad, ..sound }), LensError::BadMaxAngle { .. }));
    }
    for focal in [0.0, -0.0, -3.0] {
        assert_eq!(refused(Intrinsics { focal_px: DVec2::new(focal, 100.0), ..sound }), LensError::BadNumber);
    }
    for max_theta in [0.0, -1.0, 3.2] {
        assert!(matches!(refused(Intrinsics { max_theta, ..sound }), LensError::BadMaxAngle { .. }));
    }
    let fading = [1.0, -0.8, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    assert_eq!(refused(Intrinsics { vignetting: fading, ..sound }), LensError::BadVignetting);
}

#[test]
fn illumination_is_the_polynomial_in_theta() {
    let vignetting = [1.0, 0.1, -0.2, 0.03, 0.0, 0.0, 0.0, 0.001];
    let p = Intrinsics { vignetting, ..plain(Model::Equidistant, [1.0; 2], 100.0, 90.0) };
    let lens = Lens::try_new(p).expect("a sound lens");
    for theta in [0.0, 0.3, 1.0, 1.5f64] {
        let expected: f64 = (0..8).map(|i| vignetting[i] * theta.powi(i as i32)).sum();
        assert!((lens.illumination(theta) - expected).abs() < 1e-14, "{theta}");
    }
}
