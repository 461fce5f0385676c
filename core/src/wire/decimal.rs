//! Writes decimal numbers without an exponent: the text equals that of `{}` of `core::fmt`, but the code cannot panic and is faster.

use super::{number, put};
use embedded_io::Write;

/// Largest number of significant digits that an `f32` needs.
const DIGITS: usize = 9;

/// Writes the unsigned integer `n`.
pub(super) fn whole<W: Write>(w: &mut W, n: u64) -> Result<(), W::Error> {
    let mut digits = [b'0'; 20];
    let (mut high, mut used) = (n, 0);
    for digit in digits.iter_mut().rev() {
        // 32-bit processors divide 64-bit numbers by a library call.
        let (rest, last) = match u32::try_from(high) {
            Ok(low) => (u64::from(low / 10), (low % 10) as u8),
            Err(_) => (high / 10, (high % 10) as u8),
        };
        *digit += last;
        (high, used) = (rest, used + 1);
        if rest == 0 {
            break;
        }
    }
    w.write_all(digits.get(20 - used..).unwrap_or_default())
}

/// Writes the shortest decimal that parses to `v`; a non-finite number is written as 0.
pub(super) fn decimal<W: Write>(w: &mut W, v: f32) -> Result<(), W::Error> {
    let mut buffer = zmij::Buffer::new();
    let text = buffer.format_finite(number(v));
    let Some(at) = text.bytes().position(|b| b == b'e') else {
        return put(w, text.strip_suffix(".0").unwrap_or(text));
    };
    let (mantissa, exponent) = text.split_at_checked(at).unwrap_or_default();
    if mantissa.starts_with('-') {
        put(w, "-")?;
    }
    // The mantissa has one digit before the point.
    let mut digits = [0; DIGITS];
    let used =
        digits.iter_mut().zip(mantissa.bytes().filter(u8::is_ascii_digit)).map(|(to, b)| *to = b).count();
    let digits = digits.get(..used).unwrap_or_default();
    let power = exponent.bytes().filter(u8::is_ascii_digit).fold(0, |n, b| 10 * n + usize::from(b - b'0'));
    if exponent.contains('-') {
        put(w, "0.")?;
        zeros(w, power.saturating_sub(1))?;
        return w.write_all(digits);
    }
    // A positive exponent exceeds the number of digits after the point.
    w.write_all(digits)?;
    zeros(w, (power + 1).saturating_sub(used))
}

/// Writes `count` zeros as text.
fn zeros<W: Write>(w: &mut W, count: usize) -> Result<(), W::Error> {
    (0..count).try_for_each(|_| put(w, "0"))
}
