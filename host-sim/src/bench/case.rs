//! Benchmark cases: a pixel format, a size, a sampler and a number of lights.

use hemilux::pipeline::WindowMode;
use hemilux::samplers::MAX_LIGHTS;
use hemilux_core::format::{Format, Layout, Pattern, Yuv};
use hemilux_core::{MergeMode, SamplerKind};
use std::fmt;
use std::str::FromStr;

/// Names of the pixel formats in benchmark cases. Bayer mosaics have the pattern RGGB, chroma is BT.601 with full range.
const FORMATS: [(&str, Format); 8] = [
    ("rgb24", Format::Rgb24),
    ("yuyv", Format::Yuyv(FULL)),
    ("raw10", Format::Raw10(Pattern::Rggb)),
    ("nv12", Format::Nv12(FULL)),
    ("grey", Format::Grey),
    ("bayer8", Format::Bayer8(Pattern::Rggb)),
    ("raw12", Format::Raw12(Pattern::Rggb)),
    ("bayer16", Format::Bayer16(Pattern::Rggb, 12)),
];

const FULL: Yuv = Yuv { limited: false, matrix: hemilux_core::format::Matrix::Bt601 };

/// Suffix of the sampler's name in cases whose lights are fitted as discs.
const SOFT: &str = "+soft";

/// Suffix of the format's name in cases with [`MergeMode::All`].
const ALL: &str = "+all";

/// Suffix of the format's name in cases with a set for every frame.
const SLIDING: &str = "+sliding";

/// Suffix of the format's name in cases of a scene whose light flickers at 100 Hz.
const MAINS: &str = "+mains";

/// Largest width or height of the frames of a benchmark case, pixels.
const MAX_SIDE: u32 = 4096;

/// A benchmark case; its text form is `FORMAT:WIDTHxHEIGHT:SAMPLER:LIGHTS`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Case {
    /// Pixel format of the frames.
    pub format: Format,
    /// Mode by which the merge selects the exposures that it reads.
    pub merge: MergeMode,
    /// The frames that a set is computed from.
    pub window: WindowMode,
    /// Whether all light flickers at 100 Hz, in place of a scene that moves.
    pub mains: bool,
    /// Columns and rows of the frames, pixels.
    pub size: (u32, u32),
    /// Number of mosaic cells along each side of a merged pixel: 1, 2, 4 or 8.
    pub bin: u32,
    /// Sampler that decomposes the maps.
    pub sampler: SamplerKind,
    /// Whether lights are fitted as discs.
    pub soft: bool,
    /// Largest number of lights of a set.
    pub lights: usize,
}

impl Case {
    /// Returns the name of the pixel format; an empty string for formats without a name in cases.
    #[must_use]
    pub fn format_name(&self) -> &'static str {
        FORMATS.iter().find(|(_, f)| *f == self.format).map_or("", |(name, _)| name)
    }
}

impl fmt::Display for Case {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (w, h) = self.size;
        let bin = if self.bin > 1 { format!("/{}", self.bin) } else { String::new() };
        let soft = if self.soft { SOFT } else { "" };
        let mode = match (self.merge, self.window) {
            (_, WindowMode::Sliding) => SLIDING,
            (MergeMode::All, _) => ALL,
            _ => "",
        };
        let mains = if self.mains { MAINS } else { "" };
        write!(f, "{}{mode}{mains}{bin}:{w}x{h}:{}{soft}:{}", self.format_name(), self.sampler, self.lights)
    }
}

impl FromStr for Case {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let shape =
            || "expected FORMAT:WIDTHxHEIGHT:SAMPLER:LIGHTS, such as rgb24:640x480:q2tree:64".to_string();
        let parts: Vec<_> = text.split(':').collect();
        let [format, size_text, sampler, lights] = parts[..] else { return Err(shape()) };
        let (format, bin) = format.split_once('/').unwrap_or((format, "1"));
        let (format, mains) = format.strip_suffix(MAINS).map_or((format, false), |name| (name, true));
        let all = format.strip_suffix(ALL);
        let (format, merge) = all.map_or((format, MergeMode::Needed), |name| (name, MergeMode::All));
        let sliding = format.strip_suffix(SLIDING);
        let (format, window) =
            sliding.map_or((format, WindowMode::Burst), |name| (name, WindowMode::Sliding));
        let bin = bin.parse().map_err(|_| format!("bin '{bin}', expected 1, 2, 4 or 8"))?;
        let names = FORMATS.map(|(name, _)| name).join(", ");
        let known = FORMATS.iter().find(|(name, _)| *name == format);
        let format = known.ok_or_else(|| format!("format '{format}', expected one of {names}"))?.1;
        let side = |v: &str| v.parse().ok().filter(|n| (16..=MAX_SIDE).contains(n) && n % 2 == 0);
        let size = size_text.split_once('x').and_then(|(w, h)| Some((side(w)?, side(h)?)));
        let size = size.ok_or_else(|| {
            format!("size '{size_text}', expected even sides from 16 to {MAX_SIDE}, such as 640x480")
        })?;
        let (sampler, soft) = sampler.strip_suffix(SOFT).map_or((sampler, false), |name| (name, true));
        let sampler = sampler.parse().map_err(|unknown| format!("sampler '{sampler}': {unknown}"))?;
        let lights = lights.parse().ok().filter(|n| (1..=MAX_LIGHTS).contains(n)).ok_or_else(shape)?;
        let layout = Layout::tight(format, size.0, size.1).and_then(|layout| layout.binned(bin));
        layout.map_err(|_| format!("bin '{bin}', expected 1, or 2, 4 or 8 for a Bayer mosaic"))?;
        Ok(Self { format, merge, window, mains, size, bin, sampler, soft, lights })
    }
}

impl Case {
    /// Returns the case for frames of `format` with the standard size (640x480), sampler (`q2tree`) and number of lights (64).
    #[must_use]
    pub const fn of_format(format: Format) -> Self {
        Self {
            format,
            merge: MergeMode::Needed,
            window: WindowMode::Burst,
            mains: false,
            size: (640, 480),
            bin: 1,
            sampler: SamplerKind::Q2Tree,
            soft: false,
            lights: 64,
        }
    }
}

/// Returns one benchmark case of the standard size, sampler and number of lights for each pixel format.
#[must_use]
pub fn formats() -> Vec<Case> {
    FORMATS.into_iter().map(|(_, format)| Case::of_format(format)).collect()
}

/// Returns the cases of a report without `--case`: every sampler on RGB frames of 640x480, the other formats, larger frames, more lights, light
/// that flickers.
#[must_use]
pub fn standard() -> Vec<Case> {
    let case = |format: usize, size, sampler, lights| Case {
        size,
        sampler,
        lights,
        ..Case::of_format(FORMATS[format].1)
    };
    let vga = (640, 480);
    let mut cases = Vec::new();
    for lights in [64, 200] {
        cases.extend(SamplerKind::ALL.map(|sampler| case(0, vga, sampler, lights)));
        cases.push(Case { soft: true, ..case(0, vga, SamplerKind::Adaptive, lights) });
        cases.extend([1, 2].map(|format| case(format, vga, SamplerKind::Q2Tree, lights)));
    }
    cases.extend((3..FORMATS.len()).map(|format| case(format, vga, SamplerKind::Q2Tree, 64)));
    cases.extend([(1280, 960), (2592, 1944)].map(|size| case(0, size, SamplerKind::Q2Tree, 64)));
    cases.extend([5_000, 50_000].map(|lights| case(0, vga, SamplerKind::Q2Tree, lights)));
    cases.push(Case { mains: true, ..case(0, vga, SamplerKind::Q2Tree, 64) });
    cases
}
