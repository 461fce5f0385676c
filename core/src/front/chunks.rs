//! The loop over chunks of pixels of an image row: unpacking, merge, and addition of light to texels.

use super::Excluded;
use super::code_sums::CodeSums;
use super::gather::{self, Merged, MergedChunk, PrefixSums, Products, Radiance, RunLight, Runs};
use super::rows::{Part, Scratch};
use crate::format::{Format, Layout};
use crate::merge::{Channels, Codes, Limits, MAX_EXPOSURES, MergeView, Samples};
use crate::pixel_table::CHUNK;
use crate::pyramid::Quad;
use crate::tally::Tally;

/// The sums to which the light of chunks is added.
pub(super) struct Target<'t> {
    /// Runs and weights of the pixels whose light remains to be added.
    pub(super) runs: Runs<'t>,
    pub(super) quads: &'t mut [Quad],
    /// HEALPix order of the quads of the target.
    pub(super) order: u8,
    pub(super) excluded: &'t mut Excluded,
}

impl Target<'_> {
    /// Adds the light of the next `len` pixels, computed from their prefix sums, to the texels.
    fn add(&mut self, len: usize, samples: usize, sums: &PrefixSums, light: &mut RunLight) {
        let below = &mut self.excluded.below;
        self.runs.add_merged(len, samples, sums, light, self.quads, below);
    }

    /// Marks the texels of those of the next `len` pixels whose codes reach `limits`.
    fn mark(&mut self, codes: &Codes<'_>, samples: usize, len: usize, limits: Limits) {
        if !codes.are_below(limits.bright.min(limits.clipped)) {
            self.runs.mark(codes, samples, len, limits, self.quads);
        }
    }
}

/// The state of the loop over chunks.
pub(super) struct Chunks<'a, 'f, 's> {
    frames: &'a [Samples<'f>],
    layout: &'a Layout,
    scratch: Scratch<'s>,
    merger: Merger<'a, 's>,
    /// Conversion of sums of codes to light; `None` if no chunk is added as sums of codes.
    tally: Option<Tally>,
}

/// The merge of the codes of a chunk, and the buffers for its results.
struct Merger<'a, 's> {
    merge: &'a MergeView<'a>,
    channels: Channels,
    merged: MergedChunk<'s>,
    sums: PrefixSums,
    light: RunLight,
}

/// Returns the channel of each sample of a pixel in `format`, in the order of the lanes.
fn channels(format: Format) -> Channels {
    match (format, format.pattern()) {
        (_, Some(pattern)) => Channels::Four(pattern.channels()),
        (Format::Grey, _) => Channels::One([1]),
        (Format::Bgr24, _) => Channels::Three([2, 1, 0]),
        _ => Channels::RGB,
    }
}

impl<'a, 'f, 's> Chunks<'a, 'f, 's> {
    pub(super) fn new(
        frames: &'a [Samples<'f>],
        layout: &'a Layout,
        merge: &'a MergeView<'a>,
        scratch: Scratch<'s>,
        merged: MergedChunk<'s>,
        tally: Option<Tally>,
    ) -> Self {
        let (sums, light) = (PrefixSums::new(), [[0.0; 4]; CHUNK]);
        let merger = Merger { merge, channels: channels(layout.format()), merged, sums, light };
        Self { frames, layout, scratch, merger, tally }
    }

    /// Adds the light of a part of at most [`CHUNK`] pixels, whose runs are the next runs of `target`.
    pub(super) fn add(&mut self, part: Part, target: &mut Target<'_>) {
        target.excluded.pixels += part.len as u32;
        if self.add_codes(part, target) {
            target.excluded.read += part.len as u32;
            return;
        }
        let mut codes = [Codes::Unread; MAX_EXPOSURES];
        let codes = self.scratch.codes(self.frames, self.layout, part, self.merger.merge, &mut codes);
        let unread = codes.iter().take_while(|codes| !codes.is_read()).count();
        target.excluded.read += ((codes.len() - unread) * part.len) as u32;
        if let (Some(limits), Some(codes)) = (self.merger.merge.limits, codes.last()) {
            target.mark(codes, self.merger.channels.many(), part.len, limits);
        }
        self.merger.add(codes, part.len, target);
    }

    /// Adds a part as sums of codes if the longest exposure of the part suffices; otherwise returns `false` without a change.
    // Not inlined: its locals take no stack below the merge of other parts.
    #[inline(never)]
    fn add_codes(&mut self, part: Part, target: &mut Target<'_>) -> bool {
        let (Some(tally), Some((Samples::U8(longest), shorter))) = (&self.tally, self.frames.split_last())
        else {
            return false;
        };
        let at = part.row * self.layout.bytes_per_line() + 3 * part.first;
        let codes = longest.get(at..at + 3 * part.len).unwrap_or_default();
        let is_enough = self.merger.merge.suffices(shorter.len(), &Codes::Bytes(codes));
        if is_enough {
            if let Some(limits) = self.merger.merge.limits {
                target.mark(&Codes::Bytes(codes), 3, part.len, limits);
            }
            let mut code_sums = CodeSums::new(&mut self.merger.sums, &mut self.merger.light);
            code_sums.sum_up(codes, tally);
            let Target { runs, quads, excluded, .. } = target;
            code_sums.add(part.len, tally, runs, quads, &mut excluded.below);
        }
        is_enough
    }
}

impl Merger<'_, '_> {
    /// Merges `codes` of the next `len` pixels and adds the light of the pixels to `target`.
    fn add(&mut self, codes: &[Codes<'_>], len: usize, target: &mut Target<'_>) {
        let samples = self.channels.many();
        if let Some(unit) = self.merge.sums(codes, self.channels, self.sums.of_mut(len)) {
            self.sums.unit = unit;
            target.add(len, samples, &self.sums, &mut self.light);
            return;
        }
        let all = ..samples * len;
        let unit = match &mut self.merged {
            MergedChunk::Products(Products { sums, reciprocals }) => {
                match (sums.get_mut(all), reciprocals.get_mut(all)) {
                    (Some(a), Some(b)) => self.merge.products(codes, a, b),
                    _ => return,
                }
            }
            MergedChunk::Counts(counts) => match counts.get_mut(all) {
                Some(counts) => self.merge.counts(codes, self.channels, counts).then_some(1.0),
                None => return,
            },
        };
        if let Some(unit) = unit {
            self.sums.unit = unit;
            gather::sum_up(&self.merged, samples, len, &mut self.sums);
            target.add(len, samples, &self.sums, &mut self.light);
        } else {
            unusual(codes, self.merge, self.channels, len, target);
        }
    }
}

/// Adds a chunk of `len` pixels with the scalar merge. Not inlined, so that its buffer takes stack only when it is needed.
#[inline(never)]
fn unusual(
    codes: &[Codes<'_>],
    merge: &MergeView<'_>,
    channels: Channels,
    len: usize,
    target: &mut Target<'_>,
) {
    let samples = channels.many();
    let mut values: Radiance = [0.0; _];
    let Some(radiance) = values.get_mut(..samples * len) else { return };
    let Target { runs, quads, order, excluded } = target;
    if merge.samples(codes, channels, radiance) {
        let is_clipped = |j| (samples * j..samples * (j + 1)).any(|at| merge.is_clipped(codes, at));
        let clipped =
            runs.clipped(Merged { len, samples, radiance: &values }, *order, quads.len(), is_clipped);
        excluded.clipped += clipped.weight;
        excluded.clipped_light.iter_mut().zip(clipped.light).for_each(|(sum, light)| *sum += light);
    }
    runs.add_radiance(len, samples, &values, quads, &mut excluded.below);
}
