//! The correlated colour temperature of an irradiance.

use hemilux_core::color::luminance;

/// Range of colour temperatures in which the approximation is valid, kelvins.
const RANGE: std::ops::RangeInclusive<f32> = 1_500.0..=25_000.0;

/// Largest distance from the Planckian locus, CIE 1960 (u, v), at which a colour has a temperature (CIE 15).
const FURTHEST: f32 = 0.05;

/// Returns the correlated colour temperature of linear Rec. 709 `rgb`, kelvins, by McCamy's cubic; `None` for black and for colours far from the
/// Planckian locus.
pub(super) fn temperature(rgb: [f32; 3]) -> Option<f32> {
    let [r, g, b] = rgb;
    let x = 0.412_39 * r + 0.357_58 * g + 0.180_48 * b;
    let z = 0.019_33 * r + 0.119_19 * g + 0.950_53 * b;
    let y = luminance(rgb);
    let sum = x + y + z;
    if !(sum > 0.0 && sum.is_finite()) {
        return None;
    }
    let (x, y) = (x / sum, y / sum);
    let n = (x - 0.3320) / (0.1858 - y);
    let kelvins = ((449.0 * n + 3525.0) * n + 6823.3) * n + 5520.33;
    let scale = -2.0 * x + 12.0 * y + 3.0;
    let body = locus(kelvins);
    let distance = (4.0 * x / scale - body.u).hypot(6.0 * y / scale - body.v);
    Some(kelvins).filter(|k| RANGE.contains(k) && distance <= FURTHEST)
}

/// Chromaticity (u, v) in the CIE 1960 uniform colour space.
struct Chromaticity {
    u: f32,
    v: f32,
}

/// Returns the chromaticity of a black body of temperature `t`, kelvins, by Krystek's quotients of polynomials.
fn locus(t: f32) -> Chromaticity {
    let u = (0.860_117_8 + t * (1.541_182_5e-4 + t * 1.286_412e-7))
        / (1.0 + t * (8.424_202e-4 + t * 7.081_451_6e-7));
    let v = (0.317_398_73 + t * (4.228_062_5e-5 + t * 4.204_817e-8))
        / (1.0 + t * (-2.897_418_2e-5 + t * 1.614_560_5e-7));
    Chromaticity { u, v }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn standard_illuminants_have_their_temperatures() {
        // CIE 15: D65 6504 K (white of Rec. 709), illuminant A 2856 K, D50 5003 K; as linear Rec. 709 without adaptation.
        for (rgb, expected) in [
            ([1.0, 1.0, 1.0], 6504.0),
            ([1.845_2, 0.826_2, 0.233_2], 2856.0),
            ([1.176_2, 0.975_7, 0.721_9], 5003.0),
        ] {
            let found = temperature(rgb).expect("a temperature");
            assert!((found - expected).abs() < 0.02 * expected, "{rgb:?}: {found} K, expected {expected} K");
        }
    }

    #[test]
    fn darkness_and_saturated_colours_have_no_temperature() {
        for rgb in [[0.0; 3], [f32::NAN; 3], [0.0, 0.0, 1.0], [f32::INFINITY, 1.0, 1.0]] {
            assert_eq!(temperature(rgb), None, "{rgb:?}");
        }
    }
}
