//! The fused front end: a burst goes in, energy per texel comes out, without a full-size HDR image between.
//!
//! Rows are merged in chunks that stay in the nearest cache and added straight to 64-bit sums of their texels.

use crate::arena::{self, Buffer, TooSmall};
use crate::color::luminance;
use crate::healpix::Domain;
use crate::merge::{Merge, Radiance, Samples};
use crate::plan::{Cell, Plan, Span, Texel};
use crate::pyramid::{Pyramid, Quad};

/// Pixels merged at a time: 2 KB of radiance, small beside any first-level cache.
const CHUNK: usize = 128;

/// Sums of radiance x weight of one texel.
pub type Sum = [i64; 3];

/// What a burst held besides its lights.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Seen {
    /// Share of the hemisphere's solid angle that even the shortest exposure clips.
    pub clipped: f64,
    /// Share of the hemisphere's solid angle that the lens does not see.
    pub unseen: f64,
    /// Scalar flux from below the horizon, which is left out, over the flux above.
    pub below: f64,
}

/// Frames or a map that do not fit the plan or the merge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrontError {
    /// Another number of frames than the merge has exposures.
    FrameCount {
        /// Frames in the burst.
        found: usize,
        /// Exposures of the merge.
        expected: usize,
    },
    /// A frame of another size than the plan's image.
    FrameSize {
        /// Which one.
        index: usize,
        /// Samples in it.
        found: usize,
        /// Samples of the plan's image.
        expected: usize,
    },
    /// A frame whose samples are not of the depth that the merge knows.
    FrameDepth {
        /// Which one.
        index: usize,
    },
    /// A map that is not a hemisphere of the plan's order.
    OtherMap,
    /// Sums for a coarser plan.
    TooFewSums {
        /// Sums that were lent.
        found: usize,
        /// Sums that the plan needs.
        expected: usize,
    },
}

impl core::fmt::Display for FrontError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::FrameCount { found, expected } => write!(f, "{found} frames, expected {expected}"),
            Self::FrameSize { index, found, expected } => {
                write!(f, "frame {index} of {found} samples, expected {expected}")
            }
            Self::FrameDepth { index } => {
                write!(f, "frame {index} of another sample depth than the response")
            }
            Self::OtherMap => write!(f, "a map that is not a hemisphere of the plan's order"),
            Self::TooFewSums { found, expected } => write!(f, "{found} sums of texels, expected {expected}"),
        }
    }
}

impl core::error::Error for FrontError {}

/// Sums of the texels of one burst.
#[derive(Clone, Debug)]
pub struct Front<A> {
    sums: A,
}

/// Sums that a plan at `source_order` needs: its texels and one for what is below the horizon.
#[must_use]
pub const fn sums_len(source_order: u8) -> usize {
    Domain::Hemisphere.quads(source_order) + 1
}

impl<A: Buffer<Sum>> Front<A> {
    /// Takes [`sums_len`] sums.
    ///
    /// # Errors
    /// [`TooSmall`].
    pub fn try_new(sums: A, source_order: u8) -> Result<Self, TooSmall> {
        arena::check(&sums, sums_len(source_order))?;
        Ok(Self { sums })
    }

    /// Merges a burst into the texels of `map` (its finest order; the pyramid above is for the caller to build).
    ///
    /// `white_balance` multiplies the channels.
    ///
    /// # Errors
    /// [`FrontError`] when the frames do not fit; `map` is then unchanged.
    pub fn burst<S, C, T, M, R, Q>(
        &mut self,
        frames: &[Samples<'_>],
        merge: &Merge<M, R>,
        plan: &Plan<S, C, T>,
        white_balance: [f32; 3],
        map: &mut Pyramid<Q>,
    ) -> Result<Seen, FrontError>
    where
        S: Buffer<Span>,
        C: Buffer<Cell>,
        T: Buffer<Texel>,
        M: Buffer<i32>,
        R: Buffer<u32>,
        Q: Buffer<Quad>,
    {
        check_frames(frames, merge, plan.width() as usize * plan.height() as usize * 3)?;
        if map.view().domain() != Domain::Hemisphere || map.view().order() != plan.order() {
            return Err(FrontError::OtherMap);
        }
        arena::check(&self.sums, sums_len(plan.source_order()))
            .map_err(|e| FrontError::TooFewSums { found: e.lent, expected: e.needed })?;
        let clipped_weight = self.accumulate(frames, merge, plan);
        let unit = merge.unit() * plan.weight_unit();
        let scale = white_balance.map(|w| (f64::from(w) * unit) as f32);
        let texels = Domain::Hemisphere.quads(plan.source_order());
        let (sums, rest) = self.sums.as_ref().split_at(texels);
        map.fill(plan.source_order(), plan.texels(), |i| energy(sums.get(i).copied(), scale));
        let below = luminance(energy(rest.first().copied(), scale));
        // Most lenses see nothing of it: then no pass over the map is needed.
        let above = if below > 0.0 { map.texels().iter().map(Quad::y).sum() } else { 0.0f32 };
        Ok(Seen {
            clipped: (clipped_weight as f64 * plan.weight_unit() / Domain::Hemisphere.solid_angle()).min(1.0),
            unseen: plan.unseen(),
            below: if above > 0.0 { f64::from(below / above) } else { 0.0 },
        })
    }

    /// Adds every visited pixel to its texel; returns the weight of the clipped ones above the horizon.
    fn accumulate<S, C, T, M, R>(
        &mut self,
        frames: &[Samples<'_>],
        merge: &Merge<M, R>,
        plan: &Plan<S, C, T>,
    ) -> u64
    where
        S: Buffer<Span>,
        C: Buffer<Cell>,
        T: Buffer<Texel>,
        M: Buffer<i32>,
        R: Buffer<u32>,
    {
        let sums = self.sums.as_mut();
        sums.fill([0; 3]);
        let below = Domain::Hemisphere.quads(plan.source_order()) as u32;
        let mut chunk = [Radiance::default(); CHUNK];
        let mut cells = plan.cells();
        let mut clipped = 0;
        for (row, span) in plan.spans().iter().enumerate() {
            let (in_row, rest) = cells.split_at((span.len as usize).min(cells.len()));
            cells = rest;
            let first = row * plan.width() as usize + span.first as usize;
            for (i, part) in in_row.chunks(CHUNK).enumerate() {
                let merged = &mut chunk[..part.len()];
                merge.merge_into(frames, first + i * CHUNK, merged);
                clipped += add(sums, part, merged, below);
            }
        }
        clipped
    }
}

/// Adds merged pixels to their texels; returns the weight of the clipped ones above the horizon.
fn add(sums: &mut [Sum], cells: &[Cell], merged: &[Radiance], below: u32) -> u64 {
    let mut clipped = 0;
    for (cell, radiance) in cells.iter().zip(merged) {
        let Some(sum) = sums.get_mut(cell.texel as usize) else { continue };
        for (s, v) in sum.iter_mut().zip(radiance.rgb) {
            *s += i64::from(v) * i64::from(cell.weight);
        }
        clipped += u64::from(radiance.clipped * u32::from(cell.texel < below) * cell.weight);
    }
    clipped
}

/// Energy of a texel; sums that noise round black made negative hold no light.
fn energy(sum: Option<Sum>, scale: [f32; 3]) -> [f32; 3] {
    let sum = sum.unwrap_or_default();
    core::array::from_fn(|c| sum[c].max(0) as f32 * scale[c])
}

fn check_frames<M, R>(frames: &[Samples<'_>], merge: &Merge<M, R>, samples: usize) -> Result<(), FrontError>
where
    M: Buffer<i32>,
    R: Buffer<u32>,
{
    if frames.len() != merge.exposures() {
        return Err(FrontError::FrameCount { found: frames.len(), expected: merge.exposures() });
    }
    if let Some(index) = frames.iter().position(|f| f.len() != samples) {
        return Err(FrontError::FrameSize { index, found: frames[index].len(), expected: samples });
    }
    match frames.iter().position(|f| f.depth() != merge.depth()) {
        Some(index) => Err(FrontError::FrameDepth { index }),
        None => Ok(()),
    }
}
