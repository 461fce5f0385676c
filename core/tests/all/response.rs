//! Tabulated responses against their formulas in `f64`.

use crate::common::off;
use hemilux_core::Levels;
use hemilux_core::TooSmall;
use hemilux_core::response::{CURVE_BITS, Curve, curve_len};
use hemilux_core::{Depth, Response, ResponseError};

fn curve(
    response: &Response,
    depth: Depth,
    black: f64,
    white: f64,
) -> Result<Curve<Vec<i32>>, ResponseError> {
    Curve::try_new(response, depth, Levels { black, white }, vec![0; curve_len(depth)])
}

/// Returns the relative exposure of relative code `x` by the transfer function of IEC 61966-2-1.
fn srgb(x: f64) -> f64 {
    if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
}

/// Returns the largest relative difference over codes from 1/16 of white to saturation, and the largest absolute difference over all codes
/// up to saturation; asserts that the value at white is within 2e-4.
fn worst(depth: Depth, black: f64, white: f64, response: &Response, y: impl Fn(f64) -> f64) -> (f64, f64) {
    let curve = curve(response, depth, black, white).expect("a sound response");
    let (mut relative, mut absolute) = (0.0f64, 0.0f64);
    for code in 0..=white as u32 {
        let x = (f64::from(code) - black) / (white - black);
        for channel in 0..3 {
            let found = f64::from(curve.exposure_q27(channel, code)) / f64::from(1u32 << CURVE_BITS);
            if curve.is_saturated(code) {
                assert!(off(found, y(x)) < 2e-4, "{depth:?} {white} {code}");
                continue;
            }
            absolute = absolute.max((found - y(x)).abs());
            if x > 1.0 / 16.0 {
                relative = relative.max(off(found, y(x)));
            }
        }
    }
    (relative, absolute)
}

#[test]
fn every_code_is_within_its_documented_error() {
    for (depth, black, white) in [
        (Depth::U8, 0.0, 255.0),
        (Depth::U8, 16.0, 235.0),
        (Depth::U16, 0.0, 65535.0),
        (Depth::U16, 256.0, 4095.0),
        (Depth::U16, 64.0, 1023.0),
        (Depth::U16, 1024.5, 16383.0),
    ] {
        let linear = worst(depth, black, white, &Response::Linear, |x| x.max(-1.0));
        let curved = worst(depth, black, white, &Response::Srgb, |x| srgb(x.max(0.0)));
        let cubic = Response::Polynomial([[0.0, 0.4, 0.5, 0.1, 0.0]; 3]);
        let polynomial = worst(depth, black, white, &cubic, |x| {
            let x = x.max(0.0);
            x * (0.1 + x * (0.5 + x * 0.4))
        });
        for (relative, absolute) in [linear, curved, polynomial] {
            assert!(relative < 3e-5 && absolute < 1e-5, "{depth:?} {white}: {relative} {absolute}");
        }
    }
}

#[test]
fn saturation_and_trust_begin_at_the_documented_codes() {
    let srgb = curve(&Response::Srgb, Depth::U8, 0.0, 255.0).expect("sound");
    // With white 255, the limits are the codes 0.98 x 255 = 249.9 and 16/255 x 255 = 16.
    assert!(!srgb.is_saturated(249) && srgb.is_saturated(250));
    assert!(!srgb.is_trusted(15) && srgb.is_trusted(16));
    let linear = curve(&Response::Linear, Depth::U16, 256.0, 4095.0).expect("sound");
    // With black 256 and white 4095, saturation begins at 256 + 0.98 x 3839 = 4018.22.
    assert!(!linear.is_saturated(4018) && linear.is_saturated(4019) && linear.is_trusted(0));
}

#[test]
fn levels_out_of_range_are_refused() {
    let bad = [(255.0, 255.0), (10.0, 5.0), (-1.0, 255.0), (0.0, 256.0), (f64::NAN, 255.0), (0.0, f64::NAN)];
    for (black, white) in bad {
        let refused = curve(&Response::Linear, Depth::U8, black, white).map(|_| ());
        assert_eq!(refused, Err(ResponseError::BadLevels), "{black} {white}");
    }
}

#[test]
fn curves_that_fall_or_leave_their_range_are_refused() {
    let sound = [0.0, 0.0, 0.0, 1.0, 0.0];
    let bad = [
        [0.0, 0.0, -1.0, 1.0, 0.0],
        [0.0, 0.0, 0.0, 1.2, 0.0],
        [0.0; 5],
        [0.0, 0.0, 0.0, f64::NAN, 0.0],
        [f64::INFINITY, 0.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, -1.0, 1.0],
    ];
    for row in bad {
        for channel in 0..3 {
            let mut rows = [sound; 3];
            rows[channel] = row;
            let refused = curve(&Response::Polynomial(rows), Depth::U8, 0.0, 255.0).map(|_| ());
            assert_eq!(refused, Err(ResponseError::BadCurve { channel }), "{row:?}");
        }
    }
}

#[test]
fn a_table_one_entry_short_is_refused() {
    for depth in [Depth::U8, Depth::U16] {
        let needed = curve_len(depth);
        let short = Curve::try_new(
            &Response::Linear,
            depth,
            Levels { black: 0.0, white: 200.0 },
            vec![0; needed - 1],
        )
        .map(|_| ());
        assert_eq!(short, Err(ResponseError::TooSmall(TooSmall { needed, lent: needed - 1 })));
    }
}
