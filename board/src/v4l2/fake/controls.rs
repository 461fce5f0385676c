//! The controls of the simulated camera, and the pictures that result from them.

use super::{Kind, Manner, Quirk, World};
use crate::v4l2::abi;
use hemilux_core::format::Format;
use rustix::io::Errno;

/// Largest number of control writes that the simulated camera stores.
const MOST_WRITTEN: usize = 10_000;

impl World {
    pub(super) fn set(&mut self, id: u32, value: i64) -> Result<(), Errno> {
        if id == abi::EXPOSURE_ABSOLUTE && self.controls[&abi::EXPOSURE_AUTO] == 3 {
            return Err(Errno::ACCESS);
        }
        let (low, high) = self.range(id).ok_or(Errno::INVAL)?;
        let least = if id == abi::SHARPNESS { self.script.least_sharpness } else { low };
        let mut value = value.clamp(low, high).max(least);
        if id == self.knob() {
            self.tried += 1;
            if self.spoil_write() {
                return Ok(());
            }
            let every = self.script.fail_write_every;
            let fails = every > 0 && self.streaming && self.tried.is_multiple_of(every);
            if fails {
                return Err(Errno::IO);
            }
            if let Some(list) = self.script.accepts.as_ref().filter(|list| !list.contains(&value)) {
                match self.script.manner {
                    Manner::Refuses => return Err(Errno::IO),
                    Manner::Ignores => return Ok(()),
                    Manner::RoundsDown => {
                        value = list.iter().copied().rfind(|v| *v < value).unwrap_or(list[0]);
                    }
                }
            }
        }
        let old = self.controls.insert(id, value);
        if self.written.len() < MOST_WRITTEN {
            self.written.push((id, value));
        }
        if id == self.knob() {
            self.old_value = old.unwrap_or_default();
            let jitter = u32::from(self.has(Quirk::Jitters) && self.chance() < 0.5);
            self.writes
                .push((if self.streaming { self.next + self.script.delay + jitter } else { 0 }, value));
        }
        Ok(())
    }

    /// Returns the value of control `id` of the simulated camera.
    pub(super) fn read(&self, id: u32) -> Result<i64, Errno> {
        let value = *self.controls.get(&id).ok_or(Errno::INVAL)?;
        if id != self.knob() {
            return Ok(value);
        }
        let quirk = self.script.quirks.iter().find_map(|quirk| match quirk {
            Quirk::ReadsAs(constant) => Some(Ok(*constant)),
            Quirk::ReadsOld => Some(Ok(self.old_value)),
            Quirk::Unreadable => Some(Err(Errno::IO)),
            _ => None,
        });
        quirk.unwrap_or(Ok(value))
    }

    /// Applies the resets of controls that some cameras make when a stream starts.
    pub(super) fn reset(&mut self) {
        for (id, value) in [
            (abi::AUTO_WHITE_BALANCE, 1),
            (abi::SHARPNESS, 3),
            (abi::DYNAMIC_FRAME_RATE, 1),
            (abi::EXPOSURE_ABSOLUTE, 156),
            (abi::EXPOSURE_AUTO, 3),
        ] {
            self.controls.insert(id, value);
        }
        self.writes = vec![(0, 156)];
    }

    /// Returns the range of control `id` if this kind of camera has it.
    fn range(&self, id: u32) -> Option<(i64, i64)> {
        let csi = self.script.kind == Kind::Csi;
        match id {
            abi::EXPOSURE_AUTO if self.script.kind == Kind::Uvc => Some((0, 3)),
            abi::AUTO_WHITE_BALANCE if self.script.kind == Kind::Uvc => Some((0, 1)),
            abi::SHARPNESS if self.script.kind == Kind::Uvc => Some((0, 7)),
            abi::DYNAMIC_FRAME_RATE if self.script.kind == Kind::Uvc => Some((0, 1)),
            abi::EXPOSURE_ABSOLUTE if self.script.kind == Kind::Uvc => Some(self.script.range),
            // The exposure of the sensor ends four lines before the end of the frame.
            abi::EXPOSURE if csi => {
                Some((4, i64::from(self.script.size.1) + self.controls[&abi::VBLANK] - 4))
            }
            abi::VBLANK if csi => Some((10, 4000)),
            abi::HBLANK if csi => Some((936, 936)),
            abi::PIXEL_RATE if csi => Some((10_000_000, 10_000_000)),
            abi::ANALOGUE_GAIN if csi => Some((0, 232)),
            abi::BRIGHTNESS => Some((0, 255)),
            _ => None,
        }
    }

    pub(super) fn describe(&self, d: &mut abi::ControlDescription) -> Result<(), Errno> {
        let id = if d.id & abi::NEXT_CONTROL == 0 {
            d.id
        } else {
            let after = d.id & !abi::NEXT_CONTROL;
            let next = self.controls.keys().find(|id| **id > after && self.range(**id).is_some());
            *next.ok_or(Errno::INVAL)?
        };
        let (minimum, maximum) = self.range(id).ok_or(Errno::INVAL)?;
        let kind = match id {
            abi::EXPOSURE_AUTO => abi::TYPE_MENU,
            abi::PIXEL_RATE => abi::TYPE_INTEGER64,
            // This number is a control type that the program does not support.
            abi::HBLANK => 0x7777,
            _ => abi::TYPE_INTEGER,
        };
        *d = abi::ControlDescription { id, kind, minimum, maximum, step: 1, ..Default::default() };
        let name: &[u8] = match id {
            abi::BRIGHTNESS => b"Brightness",
            abi::SHARPNESS => b"Sharpness",
            _ => b"\xff\xfecontrol",
        };
        d.name[..name.len()].copy_from_slice(name);
        Ok(())
    }

    /// Returns a frame of a scene whose radiance increases by a factor of 1000 from left to right, as a linear sensor records it.
    pub(super) fn expose(&self, value: i64) -> Vec<u8> {
        let layout = self.layout();
        let (width, most) = (layout.width(), f64::from(layout.format().max_code()));
        // A line of the sensor takes 100 us, which is also the unit of UVC.
        let seconds = value as f64 * 1e-4;
        let code = |x: u32, top: f64| {
            let radiance = self.script.light * 10f64.powf(3.0 * (f64::from(x) / f64::from(width) - 1.0));
            (top * radiance * seconds / 0.033).round().min(top) as u16
        };
        if self.is_jpeg() {
            let row: Vec<u8> = (0..width).flat_map(|x| [code(x, 255.0) as u8; 3]).collect();
            return jpeg(&row.repeat(layout.height() as usize), width, layout.height());
        }
        let luma = |x| 16 + code(x, 219.0) as u8;
        let mut row: Vec<u8> = match layout.format() {
            Format::Yuyv(_) => (0..width).flat_map(|x| [luma(x), CHROMA[x as usize % 2]]).collect(),
            Format::Nv12(_) => (0..width).map(luma).collect(),
            Format::Raw10(_) => (0..width).step_by(4).flat_map(|x| four(|i| code(x + i, most))).collect(),
            Format::Bayer16(..) => (0..width).flat_map(|x| code(x, most).to_le_bytes()).collect(),
            Format::Grey | Format::Bayer8(_) => (0..width).map(|x| code(x, most) as u8).collect(),
            other => unreachable!("{other:?} is not made here"),
        };
        row.resize(layout.bytes_per_line(), 0xee);
        let mut bytes = row.repeat(layout.height() as usize);
        if let Format::Nv12(_) = layout.format() {
            let mut chroma = CHROMA.repeat(width as usize / 2);
            chroma.resize(layout.bytes_per_line(), 0xee);
            bytes.extend(chroma.repeat(layout.height() as usize / 2));
        }
        bytes.truncate(layout.frame_bytes());
        bytes
    }
}

/// Compresses a picture as JPEG of quality 85.
fn jpeg(rgb: &[u8], width: u32, height: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 85);
    encoder.encode(rgb, width, height, image::ExtendedColorType::Rgb8).expect("a JPEG");
    bytes
}

/// Cb and Cr of every pixel of the picture, a warm colour.
const CHROMA: [u8; 2] = [100, 150];

/// Packs four pixels of ten bits into five bytes.
fn four(code: impl Fn(u32) -> u16) -> [u8; 5] {
    let [a, b, c, d] = [0, 1, 2, 3].map(code);
    let low = [a, b, c, d].iter().rev().fold(0, |low, v| low << 2 | (*v & 3) as u8);
    [(a >> 2) as u8, (b >> 2) as u8, (c >> 2) as u8, (d >> 2) as u8, low]
}
