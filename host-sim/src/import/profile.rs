//! Reader of the transfer function of an ICC profile with the primaries of Rec. 709.

use super::function::Transfer;
use moxcms::{ColorProfile, DataColorSpace, ProfileText, ToneReprCurve, Xyzd};

/// Colorants of Rec. 709 adapted to D50, as in sRGB profiles: XYZ of red, green and blue.
const REC_709: [[f64; 3]; 3] = [[0.4360, 0.2225, 0.0139], [0.3851, 0.7169, 0.0971], [0.1431, 0.0606, 0.7139]];

/// Largest accepted difference of a colorant from [`REC_709`]: rounding to 16 bits and other adaptations of white cause less, Display P3 differs by
/// 0.08.
const COLORANT_TOLERANCE: f64 = 0.01;

/// Largest accepted difference of a relative exposure from a known transfer function; sRGB and a power of 2.2 differ by 0.0083.
const CURVE_TOLERANCE: f64 = 0.004;

/// Returns the transfer function of an ICC profile.
///
/// # Errors
/// Text with the name of the profile, if the profile is no matrix profile, has other primaries, or has a transfer function that is neither linear
/// nor sRGB.
pub(super) fn transfer(icc: &[u8]) -> Result<Transfer, String> {
    let profile =
        ColorProfile::new_from_slice(icc).map_err(|e| format!("an ICC profile that is broken ({e})"))?;
    let name = name(&profile);
    let curves: Vec<&ToneReprCurve> = match profile.color_space {
        DataColorSpace::Gray => profile.gray_trc.iter().collect(),
        DataColorSpace::Rgb if has_rec_709(&profile) => {
            [&profile.red_trc, &profile.green_trc, &profile.blue_trc].into_iter().flatten().collect()
        }
        DataColorSpace::Rgb => return Err(format!("the ICC profile {name} with other primaries")),
        other => return Err(format!("the ICC profile {name} of the colour space {other:?}")),
    };
    let is = |f: fn(f32) -> f64| !curves.is_empty() && curves.iter().all(|curve| follows(curve, f));
    match (is(f64::from), is(srgb)) {
        (true, _) => Ok(Transfer::Linear),
        (_, true) => Ok(Transfer::Srgb),
        _ => Err(format!("the ICC profile {name} with another transfer function")),
    }
}

fn has_rec_709(profile: &ColorProfile) -> bool {
    let found = [profile.red_colorant, profile.green_colorant, profile.blue_colorant];
    let is_close = |Xyzd { x, y, z }: Xyzd, expected: [f64; 3]| {
        [x, y, z].iter().zip(expected).all(|(a, b)| (a - b).abs() < COLORANT_TOLERANCE)
    };
    found.into_iter().zip(REC_709).all(|(found, expected)| is_close(found, expected))
}

/// Returns whether a tone curve agrees with `function` at the 256 codes of 8 bits.
fn follows(curve: &ToneReprCurve, function: fn(f32) -> f64) -> bool {
    let Ok(curve) = curve.make_linear_evaluator() else { return false };
    (0..=255u8).all(|code| {
        let code = f32::from(code) / 255.0;
        (f64::from(curve.evaluate_value(code)) - function(code)).abs() < CURVE_TOLERANCE
    })
}

fn srgb(code: f32) -> f64 {
    let code = f64::from(code);
    if code <= 0.04045 { code / 12.92 } else { ((code + 0.055) / 1.055).powf(2.4) }
}

/// Returns the description of an ICC profile in quotation marks.
fn name(profile: &ColorProfile) -> String {
    let text = match &profile.description {
        Some(ProfileText::PlainString(text)) => text.as_str(),
        Some(ProfileText::Localizable(texts)) => texts.first().map_or("", |t| t.value.as_str()),
        Some(ProfileText::Description(text)) => text.ascii_string.as_str(),
        None => "",
    };
    format!("{:?}", text.chars().filter(|c| !c.is_control()).take(80).collect::<String>())
}
