//! Damages a burst by one kind of fault.

use super::random::Random;
use super::spec::Fault;
use crate::calibration::{Burst, Frame, Pixels};

/// Ratio of the stated to the true exposure of a frame with the fault [`Fault::Label`].
const WRONG_LABEL: f64 = 4.0;

/// Largest backward step of the times of a burst, nanoseconds.
const STEP_NS: f64 = 60e9;

/// Applies `fault` to `burst`. Faults of the delivery leave the frames unchanged.
pub(super) fn damage(fault: Fault, burst: &mut Burst, largest_code: u16, random: &mut Random) {
    if burst.frames.is_empty() {
        return;
    }
    let at = random.below(burst.frames.len());
    let frame = &mut burst.frames[at];
    match fault {
        Fault::Drop => drop(burst.frames.remove(at)),
        Fault::Torn => tear(&mut burst.frames, at, random.part()),
        Fault::Black => fill(&mut frame.pixels, 0),
        Fault::Saturated => fill(&mut frame.pixels, largest_code),
        Fault::Swapped => swap(&mut burst.frames, at),
        Fault::Label => frame.exposure.seconds *= WRONG_LABEL,
        Fault::Size => halve(&mut frame.pixels),
        Fault::Clock => {
            let step = (random.part() * STEP_NS) as u64;
            for ns in [&mut burst.timestamp_ns, &mut burst.phase_ns] {
                *ns = ns.saturating_sub(step);
            }
        }
        Fault::Late | Fault::Vanish | Fault::Hang => {}
    }
}

/// Sets every sample of a frame to `code`; samples of bytes get the last eight bits of `code`.
fn fill(pixels: &mut Pixels, code: u16) {
    match pixels {
        Pixels::U8(bytes) => bytes.fill(code.to_le_bytes()[0]),
        Pixels::U16(words) => words.fill(code),
    }
}

fn halve(pixels: &mut Pixels) {
    match pixels {
        Pixels::U8(bytes) => bytes.truncate(bytes.len() / 2),
        Pixels::U16(words) => words.truncate(words.len() / 2),
    }
}

fn swap(frames: &mut [Frame], at: usize) {
    let other = (at + 1) % frames.len();
    if let Ok([one, two]) = frames.get_disjoint_mut([at, other]) {
        std::mem::swap(&mut one.pixels, &mut two.pixels);
    }
}

/// Replaces the samples of frame `at` after the fraction `part`, 0 to 1, by the samples of the next exposure.
fn tear(frames: &mut [Frame], at: usize, part: f64) {
    let other = (at + 1) % frames.len();
    let Ok([torn, next]) = frames.get_disjoint_mut([at, other]) else { return };
    let cut = |len: usize| (part * len as f64) as usize;
    match (&mut torn.pixels, &next.pixels) {
        (Pixels::U8(to), Pixels::U8(from)) if to.len() == from.len() => {
            let cut = cut(to.len());
            to[cut..].copy_from_slice(&from[cut..]);
        }
        (Pixels::U16(to), Pixels::U16(from)) if to.len() == from.len() => {
            let cut = cut(to.len());
            to[cut..].copy_from_slice(&from[cut..]);
        }
        _ => {}
    }
}
