//! Behaviours of the simulated camera that contradict the documentation of V4L2 or the values that its driver reports.

use super::{Quirk, World};
use crate::v4l2::abi;
use rustix::io::Errno;

impl World {
    /// Adds uniform noise of up to [`Script::noise`] codes, and photon noise of [`Script::codes_per_electron`].
    pub(super) fn add_noise(&mut self, picture: &mut [u8]) {
        let (most, gain) = (self.script.noise, self.script.codes_per_electron);
        if most == 0 && gain == 0.0 {
            return;
        }
        for byte in picture {
            let code = f64::from(*byte);
            let noise = (self.chance() * f64::from(2 * most + 1)).floor() - f64::from(most);
            // A sum of twelve uniform deviates, nearly a normal deviate of variance 1, scaled to the variance gain x code.
            let deviate = if gain > 0.0 { (0..12).map(|_| self.chance()).sum::<f64>() - 6.0 } else { 0.0 };
            let photons = (gain * code).sqrt() * deviate;
            *byte = (code + noise + photons).round().clamp(0.0, 255.0) as u8;
        }
    }

    /// Applies the quirks of exposure writes; returns true if this write has no effect.
    pub(super) fn spoil_write(&mut self) -> bool {
        let mut is_lost = false;
        for quirk in self.script.quirks.clone() {
            match quirk {
                Quirk::SlowWrites(time) => self.advance(self.now_ns + time.as_nanos() as u64),
                Quirk::Forgets(every) => is_lost |= self.streaming && self.tried.is_multiple_of(every),
                Quirk::AutomaticAgain(write) if self.tried == write => {
                    self.controls.insert(abi::EXPOSURE_AUTO, 3);
                }
                _ => {}
            }
        }
        is_lost
    }

    /// Applies the quirks of a filled frame.
    pub(super) fn spoil_frame(
        &mut self,
        value: i64,
        picture: &mut Vec<u8>,
        used: &mut usize,
        number: &mut u32,
    ) {
        let frame = *number;
        for quirk in self.script.quirks.clone() {
            match quirk {
                Quirk::Oversized => *used = u32::MAX as usize,
                Quirk::Unnumbered => *number = 0,
                Quirk::EverySecond => *number *= 2,
                Quirk::JumpsAhead(every) => *number += frame / every * 1000,
                Quirk::Restarts(every) => *number = frame % every,
                Quirk::Slows => {
                    let most = 200_000 * value.cast_unsigned();
                    self.start_ns += most.saturating_sub(self.script.period.as_nanos() as u64);
                }
                Quirk::DarkStart(frames) if frame < frames => picture.fill(0),
                Quirk::RepeatsPicture(every) if frame.is_multiple_of(every) && !self.shown.is_empty() => {
                    picture.clone_from(&self.shown);
                }
                _ => {}
            }
        }
        self.shown.clone_from(picture);
    }

    /// Returns the error of a quirk at the start of the stream.
    pub(super) fn fail_start(&mut self) -> Result<(), Errno> {
        self.starts += 1;
        let fails = self.script.quirks.iter().find_map(|quirk| match quirk {
            Quirk::StartFails(times) if self.starts <= *times => Some(Errno::IO),
            Quirk::StartIsBusy(times) if self.starts <= *times => Some(Errno::BUSY),
            _ => None,
        });
        fails.map_or(Ok(()), Err)
    }

    /// Returns the error of a quirk when a frame is fetched; the frame is lost.
    pub(super) fn fail_fetch(&mut self) -> Result<(), Errno> {
        self.fetched += 1;
        let fails = |quirk: &Quirk| matches!(quirk, Quirk::DequeueFails(every) if self.fetched.is_multiple_of(*every));
        if self.script.quirks.iter().any(fails) { Err(Errno::IO) } else { Ok(()) }
    }
}
