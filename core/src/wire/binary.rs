//! The binary form of a light set: 128 bytes plus 40 per light.
//!
//! All numbers are little-endian; floats are IEEE 754 single precision. The offset of every field is a multiple of its size.
//!
//! | offset | type | content |
//! |---|---|---|
//! | 0 | 4 bytes | `HMLX` |
//! | 4 | u16 | version, 1 |
//! | 6 | u16 | bytes before the first light: 128, 108 more with `ambient_sh`, 4 more with `unit_uncertainty` |
//! | 8 | u64 | frame |
//! | 16 | u64 | timestamp_ns |
//! | 24 | u64 | wall_ms |
//! | 32 | 8 bytes | run, ASCII, padded with 0 |
//! | 40 | u32 | requested |
//! | 44 | u32 | number of lights |
//! | 48 | u8 | flags: 1 valid, 2 stale, 4 the unit is lux, 8 `ambient_sh`, 16 `estimated_error` or 32 `unit_uncertainty` is present |
//! | 49 | u8 | coordinates: 0 probe, 1 y-up, 2 unity, 3 unreal |
//! | 50 | u16 | bytes per light, 40 |
//! | 52 | u16, u16 | bytes of the sampler's name, of the reason of `stale` |
//! | 56 | u64 | age_ms of `stale` |
//! | 64 | 3 f32 | scalar_flux |
//! | 76 | 3 f32 | horizontal_irradiance |
//! | 88 | 3 f32 | clipped, unseen, estimated_error |
//! | 100 | 7 u32 | latency_us: capture, front, pyramid, sample, filter, encode, total |
//! | 128 | 27 f32 | `ambient_sh` if present: nine rows of red, green, blue |
//! | next | f32 | `unit_uncertainty` if present |
//! | next | lights | each u32 id, u32 parent (0 for none), u32 age, f32 radius_deg, 3 f32 direction, 3 f32 irradiance |
//! | next | UTF-8 | the sampler's name, the reason |
//!
//! A reader must take the offset and the size of the lights from the header (offsets 6 and 50), since later versions may extend both.

use super::{Coordinates, Degraded, FramesLeftOut, Latency, LightSet, Overrun, Stale, Unit, number};
use crate::light::{Light, Sh9};
use crate::mains::Flicker;
use embedded_io::Write;
use glam::Vec3;

const MAGIC: &[u8; 4] = b"HMLX";
const VERSION: u16 = 1;
const HEAD: usize = 128;
const HARMONICS: usize = 27 * 4;
const UNCERTAINTY: usize = 4;
const LIGHT: usize = 40;

const VALID: u8 = 1;
const STALE: u8 = 2;
const LUX: u8 = 4;
const AMBIENT: u8 = 8;
const ERROR: u8 = 16;
const HAS_UNCERTAINTY: u8 = 32;

const AXES: [Coordinates; 4] =
    [Coordinates::Probe, Coordinates::YUp, Coordinates::Unity, Coordinates::Unreal];

/// Writes `set` in the binary form, which [`BinarySet`] reads; `board/FORMATS.md` lists the fields. The name of a sampler and a reason are
/// truncated to 65,535 bytes.
///
/// ```
/// use glam::Vec3;
/// use hemilux_core::Light;
/// use hemilux_core::wire::{BinarySet, LightSet, binary};
///
/// let lights = [Light { id: 7, direction: Vec3::Z, irradiance: [3.0, 2.0, 1.0], ..Light::default() }];
/// let mut bytes = [0; 256];
/// let mut rest = &mut bytes[..];
/// binary(&LightSet { frame: 5, lights: &lights, ..LightSet::EMPTY }, &mut rest)?;
/// let used = 256 - rest.len();
/// assert_eq!(used, 128 + 40);
/// let set = BinarySet::try_new(&bytes[..used])?;
/// assert_eq!((set.head().frame, set.lights().next()), (5, Some(lights[0])));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
/// # Errors
/// Errors of the writer `w`, such as a full buffer.
pub fn binary<W: Write>(set: &LightSet<'_>, w: &mut W) -> Result<(), W::Error> {
    let sampler = short(set.sampler);
    let reason = short(set.stale.map_or("", |s| s.reason));
    let mut head = Head { bytes: [0; HEAD] };
    head.put(0, *MAGIC);
    head.put(4, VERSION.to_le_bytes());
    let first = Extent::of(flags(set)).first;
    head.put(6, (first as u16).to_le_bytes());
    head.put(8, set.frame.to_le_bytes());
    head.put(16, set.timestamp_ns.to_le_bytes());
    head.put(24, set.wall_ms.to_le_bytes());
    let mut run = [0; 8];
    for (to, from) in run.iter_mut().zip(set.run.bytes()) {
        *to = if from.is_ascii() { from } else { b'?' };
    }
    head.put(32, run);
    head.put(40, set.requested.to_le_bytes());
    head.put(44, (set.lights.len() as u32).to_le_bytes());
    head.put(48, [flags(set), axes_code(set.coordinates)]);
    head.put(50, (LIGHT as u16).to_le_bytes());
    head.put(52, (sampler.len() as u16).to_le_bytes());
    head.put(54, (reason.len() as u16).to_le_bytes());
    head.put(56, set.stale.map_or(0, |s| s.age_ms).to_le_bytes());
    let [a, b, c] = set.scalar_flux;
    let [d, e, f] = set.horizontal_irradiance;
    let error = set.estimated_error.unwrap_or(0.0);
    for (i, v) in [a, b, c, d, e, f, set.clipped, set.unseen, error].into_iter().enumerate() {
        head.put(64 + 4 * i, number(v).to_le_bytes());
    }
    for (i, us) in set.latency.all().into_iter().enumerate() {
        head.put(100 + 4 * i, us.to_le_bytes());
    }
    w.write_all(&head.bytes)?;
    if let Some(sh) = set.ambient_sh {
        for v in set.coordinates.harmonics(sh).as_flattened() {
            w.write_all(&number(*v).to_le_bytes())?;
        }
    }
    if let Some(uncertainty) = set.unit_uncertainty {
        w.write_all(&number(uncertainty).to_le_bytes())?;
    }
    for light in set.lights {
        w.write_all(&encoded(light, set.coordinates))?;
    }
    w.write_all(sampler.as_bytes())?;
    w.write_all(reason.as_bytes())
}

/// The values in the header of a binary light set.
struct Head {
    bytes: [u8; HEAD],
}

/// The offsets in a binary light set that depend on the flags.
struct Extent {
    /// Offset of `unit_uncertainty` in the encoded set, bytes.
    uncertainty: usize,
    /// Least offset of the first light in the encoded set, bytes.
    first: usize,
}

impl Extent {
    const fn of(flags: u8) -> Self {
        let uncertainty = if flags & AMBIENT != 0 { HEAD + HARMONICS } else { HEAD };
        let first = if flags & HAS_UNCERTAINTY != 0 { uncertainty + UNCERTAINTY } else { uncertainty };
        Self { uncertainty, first }
    }
}

impl Head {
    fn put<const N: usize>(&mut self, at: usize, value: [u8; N]) {
        if let Some(place) = self.bytes.get_mut(at..at + N) {
            place.copy_from_slice(&value);
        }
    }
}

fn flags(set: &LightSet<'_>) -> u8 {
    let flag = |on: bool, bit: u8| if on { bit } else { 0 };
    flag(set.valid, VALID)
        | flag(set.stale.is_some(), STALE)
        | flag(set.unit == Unit::Lux, LUX)
        | flag(set.ambient_sh.is_some(), AMBIENT)
        | flag(set.estimated_error.is_some(), ERROR)
        | flag(set.unit_uncertainty.is_some(), HAS_UNCERTAINTY)
}

fn axes_code(c: Coordinates) -> u8 {
    AXES.iter().position(|a| *a == c).unwrap_or(0) as u8
}

fn encoded(light: &Light, axes: Coordinates) -> [u8; LIGHT] {
    let mut bytes = [0; LIGHT];
    let whole = [light.id, light.parent.unwrap_or(0), light.age].map(u32::to_le_bytes);
    let d = axes.direction(light.direction);
    let [r, g, b] = light.irradiance;
    let real = [light.radius_deg, d.x, d.y, d.z, r, g, b].map(|v| number(v).to_le_bytes());
    for (to, from) in bytes.chunks_exact_mut(4).zip(whole.iter().chain(&real)) {
        to.copy_from_slice(from);
    }
    bytes
}

/// Returns the longest prefix of `text` that consists of whole characters and whose length in bytes fits a `u16`.
fn short(text: &str) -> &str {
    let mut end = text.len().min(usize::from(u16::MAX));
    while !text.is_char_boundary(end) {
        end -= 1;
    }
    text.get(..end).unwrap_or_default()
}

/// The reason why bytes are not a binary light set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum DecodeError {
    /// The bytes do not begin with `HMLX`.
    NotALightSet,
    /// The version of the set is not 1.
    Version(u16),
    /// There are fewer bytes than the header requires.
    TooShort,
    /// The header is inconsistent, or a text is not UTF-8.
    Malformed,
}

impl core::fmt::Display for DecodeError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::NotALightSet => write!(f, "bytes that do not begin with HMLX"),
            Self::Version(v) => write!(f, "version {v} of the binary light set, expected 1"),
            Self::TooShort => write!(f, "a binary light set that ends too early"),
            Self::Malformed => write!(f, "a malformed binary light set"),
        }
    }
}

impl core::error::Error for DecodeError {}

/// A binary light set in borrowed bytes, checked by [`BinarySet::try_new`]. Directions and harmonics are in the coordinate system of the
/// set, which [`Self::head`] returns.
#[derive(Clone, Copy, Debug)]
pub struct BinarySet<'a> {
    head: &'a [u8],
    harmonics: Option<&'a [u8]>,
    unit_uncertainty: Option<f32>,
    lights: &'a [u8],
    stride: usize,
    sampler: &'a str,
    reason: &'a str,
    run: &'a str,
}

impl<'a> BinarySet<'a> {
    /// Creates a view of the set at the start of `bytes` after checking that the set is complete; further bytes are ignored.
    ///
    /// ```
    /// use hemilux_core::wire::{BinarySet, DecodeError};
    /// assert_eq!(BinarySet::try_new(b"GIF89a").map(|_| ()), Err(DecodeError::NotALightSet));
    /// assert_eq!(BinarySet::try_new(b"HMLX").map(|_| ()), Err(DecodeError::TooShort));
    /// ```
    ///
    /// # Errors
    /// [`DecodeError`] for bytes that are not a complete set of a known version.
    pub fn try_new(bytes: &'a [u8]) -> Result<Self, DecodeError> {
        if bytes.get(..4) != Some(MAGIC) {
            return Err(DecodeError::NotALightSet);
        }
        let head = bytes.get(..HEAD).ok_or(DecodeError::TooShort)?;
        let version = u16_at(head, 4);
        if version != VERSION {
            return Err(DecodeError::Version(version));
        }
        let (first, stride) = (usize::from(u16_at(head, 6)), usize::from(u16_at(head, 50)));
        let flags = byte_at(head, 48);
        let extent = Extent::of(flags);
        if first < extent.first || stride < LIGHT || usize::from(byte_at(head, 49)) >= AXES.len() {
            return Err(DecodeError::Malformed);
        }
        let at_uncertainty = bytes.get(extent.uncertainty..).unwrap_or_default();
        let harmonics =
            (flags & AMBIENT != 0).then(|| bytes.get(HEAD..HEAD + HARMONICS).ok_or(DecodeError::TooShort));
        let length = (u32_at(head, 44) as usize).checked_mul(stride).ok_or(DecodeError::TooShort)?;
        let rest = bytes.get(first..).ok_or(DecodeError::TooShort)?;
        let (lights, rest) = rest.split_at_checked(length).ok_or(DecodeError::TooShort)?;
        let (sampler, rest) = rest.split_at_checked(u16_at(head, 52).into()).ok_or(DecodeError::TooShort)?;
        let reason = rest.get(..u16_at(head, 54).into()).ok_or(DecodeError::TooShort)?;
        let text = |bytes| core::str::from_utf8(bytes).map_err(|_| DecodeError::Malformed);
        let run = head.get(32..40).unwrap_or_default();
        let run = run.split(|b| *b == 0).next().unwrap_or_default();
        let set = Self {
            head,
            harmonics: harmonics.transpose()?,
            unit_uncertainty: (flags & HAS_UNCERTAINTY != 0)
                .then(|| f32::from_le_bytes(at(at_uncertainty, 0))),
            lights,
            stride,
            sampler: text(sampler)?,
            reason: text(reason)?,
            run: text(run)?,
        };
        if set.is_in_range() { Ok(set) } else { Err(DecodeError::Malformed) }
    }

    /// Returns whether the directions of the set have unit length, all numbers are finite, and all but directions and harmonics are at
    /// least 0.
    fn is_in_range(&self) -> bool {
        let finite = |bytes: &[u8]| bytes.chunks_exact(4).all(|b| f32::from_le_bytes(at(b, 0)).is_finite());
        let positive = |bytes: &[u8]| finite(bytes) && bytes.chunks_exact(4).all(|b| f32_at(b, 0) >= 0.0);
        let light = |bytes: &[u8]| {
            let length = Vec3::new(f32_at(bytes, 16), f32_at(bytes, 20), f32_at(bytes, 24)).length();
            (length - 1.0).abs() < 1e-3
                && [12..16, 28..40].map(|at| bytes.get(at)).into_iter().flatten().all(positive)
        };
        self.head.get(64..100).is_some_and(positive)
            && self.harmonics.is_none_or(finite)
            && self.unit_uncertainty.is_none_or(|u| u.is_finite() && u >= 0.0)
            && self.lights.chunks_exact(self.stride).all(light)
    }

    /// Returns all fields of the set except the lights and `ambient_sh`, which [`Self::lights`] and [`Self::ambient_sh`] return.
    #[must_use]
    pub fn head(&self) -> LightSet<'a> {
        let flag = |bit| byte_at(self.head, 48) & bit != 0;
        let real = |at| f32_at(self.head, at);
        let us = |i: usize| u32_at(self.head, 100 + 4 * i);
        LightSet {
            run: self.run,
            frame: u64_at(self.head, 8),
            timestamp_ns: u64_at(self.head, 16),
            wall_ms: u64_at(self.head, 24),
            valid: flag(VALID),
            stale: flag(STALE).then(|| Stale { age_ms: u64_at(self.head, 56), reason: self.reason }),
            sampler: self.sampler,
            requested: u32_at(self.head, 40),
            unit: if flag(LUX) { Unit::Lux } else { Unit::Relative },
            unit_uncertainty: self.unit_uncertainty,
            coordinates: AXES.get(usize::from(byte_at(self.head, 49))).copied().unwrap_or_default(),
            lights: &[],
            ambient_sh: None,
            left_out: None,
            scalar_flux: [real(64), real(68), real(72)],
            horizontal_irradiance: [real(76), real(80), real(84)],
            clipped_irradiance_at_least: [0.0; 3],
            clipped: real(88),
            unseen: real(92),
            estimated_error: flag(ERROR).then(|| real(96)),
            latency: Latency {
                capture: us(0),
                front: us(1),
                pyramid: us(2),
                sample: us(3),
                filter: us(4),
                encode: us(5),
                total: us(6),
            },
            overrun: Overrun::NONE,
            frames_left_out: FramesLeftOut::NONE,
            degraded: Degraded::NONE,
            flicker: Flicker::NONE,
        }
    }

    /// Returns the lights of the set, in the order in which they were written.
    pub fn lights(&self) -> impl ExactSizeIterator<Item = Light> + 'a {
        self.lights.chunks_exact(self.stride).map(|bytes| Light {
            id: u32_at(bytes, 0),
            parent: Some(u32_at(bytes, 4)).filter(|id| *id != 0),
            age: u32_at(bytes, 8),
            radius_deg: f32_at(bytes, 12),
            direction: Vec3::new(f32_at(bytes, 16), f32_at(bytes, 20), f32_at(bytes, 24)),
            irradiance: [f32_at(bytes, 28), f32_at(bytes, 32), f32_at(bytes, 36)],
        })
    }

    /// Returns the radiance that the directional lights do not represent, as spherical harmonics; `None` if absent.
    #[must_use]
    pub fn ambient_sh(&self) -> Option<Sh9> {
        let bytes = self.harmonics?;
        Some(core::array::from_fn(|i| core::array::from_fn(|k| f32_at(bytes, 12 * i + 4 * k))))
    }
}

/// Returns `N` bytes from position `at`; zeros beyond the end, which `try_new` excludes.
fn at<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    bytes.get(at..at + N).and_then(|b| b.try_into().ok()).unwrap_or([0; N])
}

fn byte_at(bytes: &[u8], offset: usize) -> u8 {
    u8::from_le_bytes(at(bytes, offset))
}

fn u16_at(bytes: &[u8], offset: usize) -> u16 {
    u16::from_le_bytes(at(bytes, offset))
}

fn u32_at(bytes: &[u8], offset: usize) -> u32 {
    u32::from_le_bytes(at(bytes, offset))
}

fn u64_at(bytes: &[u8], offset: usize) -> u64 {
    u64::from_le_bytes(at(bytes, offset))
}

/// Returns the float at `offset`; 0 for a float that is not finite, as in the other forms.
fn f32_at(bytes: &[u8], offset: usize) -> f32 {
    number(f32::from_le_bytes(at(bytes, offset)))
}
