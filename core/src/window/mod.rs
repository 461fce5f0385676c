//! The sliding window: after every frame of a camera, a map from the newest frame of each exposure.
//!
//! The window stores the energy of each texel in each exposure. For a new frame, only this frame is unpacked and added to the texels, and
//! one exposure is chosen for each texel; the earlier frames are not read again. In the map, each texel has its energy in one exposure: see
//! module `choice`.

mod choice;

use crate::buffer::{self, Buffer};
use crate::calibration::Calibration;
use crate::color::luminance;
use crate::error::FrontError;
use crate::format::{Format, Layout};
use crate::front::{self, BurstError, Coverage, Excluded, Mark};
use crate::healpix::Domain;
use crate::lanes::{Lanes, Pick};
use crate::merge::{
    Detached, Exposure, Limits, MAX_EXPOSURES, Merge, MergeError, MergeMode, MergeView, Reciprocal, Samples,
    Tables, merge_size,
};
use crate::pixel_table::{PixelTableView, Texel};
use crate::pyramid::{Quad, positive};
use crate::response::CURVE_BITS;
use crate::sizes;
use crate::stages::Stages;
use choice::{Frames, Level, Marks};

/// A new frame, which replaces the window's frame of the same exposure.
#[derive(Clone, Copy, Debug)]
pub struct NewFrame<'a> {
    /// Index of the frame's exposure in the list of exposures of the window, ascending.
    pub index: usize,
    /// Samples of the frame.
    pub samples: Samples<'a>,
}

/// Energy of each texel in the newest frame of each exposure. The buffer `W` holds it: a `Vec<u64>`, an array, or a mutable slice.
///
/// ```
/// use hemilux_core::{Calibration, Exposure, Format, FrontEnd, Lens, NewFrame, Sizes};
///
/// let lens = Lens::equidistant([15.5, 15.5], 9.0, 1.5)?;
/// let calibration = Calibration::try_new(lens, Format::Grey, 32, 32)?;
/// let exposures = [0.001, 0.01].map(|seconds| Exposure { seconds, gain: 1.0 });
/// let sizes = Sizes::of(&calibration, &exposures, 2.try_into()?)?;
/// let mut front = FrontEnd::try_new(calibration, &exposures, 2.try_into()?, vec![0; sizes.words()])?;
/// let words = front.window_words(&exposures)?;
/// let mut window = front.window(&exposures, vec![0; words])?;
/// for (index, code) in [(0, 5u8), (1, 51)] {
///     let samples = [code; 32 * 32];
///     front.slide(&mut window, NewFrame { index, samples: samples.as_slice().into() }, || {})?;
/// }
/// let bright = front.map().total().y();
/// // Half of the light, in the frame of the longer exposure alone.
/// let samples = [25u8; 32 * 32];
/// front.slide(&mut window, NewFrame { index: 1, samples: samples.as_slice().into() }, || {})?;
/// assert!((front.map().total().y() / bright - 25.0 / 51.0).abs() < 1e-3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Window<W> {
    state: State,
    memory: W,
}

#[derive(Clone, Debug)]
struct State {
    exposures: [Option<Single>; MAX_EXPOSURES],
    frames: Frames,
    sizes: WindowSizes,
    /// Clipped and unseen shares of the newest frame of the shortest exposure.
    coverage: Coverage,
}

/// Tables for the merge of one exposure without the others.
#[derive(Clone, Debug)]
struct Single {
    merge: Detached,
    limits: Limits,
}

/// Number of elements of each buffer in the memory of a window.
#[derive(Clone, Copy, Debug)]
struct WindowSizes {
    exposures: usize,
    texels: usize,
    /// Number of entries of the merge tables of one exposure.
    tables: usize,
}

/// Number of reciprocals in the merge of one exposure: one for each subset of the exposures.
const RECIPROCALS: usize = 2;

impl WindowSizes {
    fn words(&self) -> usize {
        let Self { exposures, texels, tables } = *self;
        let energies = 2 * exposures * texels;
        energies + 2 * texels.div_ceil(2) + exposures * (tables.div_ceil(2) + RECIPROCALS)
    }
}

/// The buffers of a window in lent memory.
struct Buffers<'m> {
    /// Red, green, blue and luminance energy of each texel in each exposure; the energies of a texel are adjacent.
    energies: &'m mut [[f32; 4]],
    /// Sum of the weights of the pixels of each texel, steradians.
    weights: &'m mut [f32],
    marks: &'m mut [Marks],
    tables: &'m mut [u32],
    reciprocals: &'m mut [Reciprocal],
}

impl<'m> Buffers<'m> {
    fn divide(mut memory: &'m mut [u64], sizes: &WindowSizes) -> Self {
        let WindowSizes { exposures, texels, tables } = *sizes;
        let memory = &mut memory;
        Self {
            energies: sizes::first(memory, exposures * texels),
            weights: sizes::first(memory, texels),
            marks: sizes::first(memory, texels),
            tables: sizes::first(memory, exposures * tables),
            reciprocals: sizes::first(memory, exposures * RECIPROCALS),
        }
    }
}

/// Returns the number of 64-bit words of memory that a window of `exposures` needs.
pub(crate) fn words(stages: &Stages<'_>, exposures: &[Exposure]) -> Result<usize, MergeError> {
    Ok(window_sizes(stages, exposures)?.words())
}

fn window_sizes(stages: &Stages<'_>, exposures: &[Exposure]) -> Result<WindowSizes, MergeError> {
    let curve = stages.merge.curve();
    merge_size(&curve, exposures)?;
    let tables = exposures.iter().try_fold(0, |most: usize, exposure| {
        merge_size(&curve, core::slice::from_ref(exposure)).map(|size| most.max(size.tables))
    })?;
    let texels = Domain::Hemisphere.quads(stages.pixel_table.source_order);
    Ok(WindowSizes { exposures: exposures.len(), texels, tables })
}

impl<W: Buffer<u64>> Window<W> {
    /// Creates the window that [`FrontEnd::window`](crate::FrontEnd::window) returns.
    pub(crate) fn try_new(
        calibration: &Calibration,
        stages: &Stages<'_>,
        exposures: &[Exposure],
        mut memory: W,
    ) -> Result<Self, FrontError> {
        let state = State::try_new(calibration, stages, exposures, memory.as_mut())?;
        Ok(Self { state, memory })
    }

    /// Returns true if there is a frame of each exposure of the window.
    #[must_use]
    pub fn is_complete(&self) -> bool {
        self.state.frames.count() == self.state.sizes.exposures
    }

    /// Returns the number of bytes of the lent memory that are in use.
    #[must_use]
    pub fn bytes(&self) -> usize {
        8 * self.state.sizes.words()
    }

    /// First stage for a new frame: adds the light of each pixel to the sum of its texel.
    pub(crate) fn add_up(
        &mut self,
        frame: NewFrame<'_>,
        layout: &Layout,
        stages: &mut Stages<'_>,
    ) -> Result<Excluded, BurstError> {
        let mut excluded = Excluded::default();
        let buffers = Buffers::divide(self.memory.as_mut(), &self.state.sizes);
        let expected = self.state.sizes.exposures;
        let found = frame.index.saturating_add(1);
        let Some(merge) = self.state.merge(frame.index, stages, &buffers) else {
            return Err(BurstError::FrameCount { found, expected });
        };
        if self.state.sizes.texels != Domain::Hemisphere.quads(stages.pixel_table.source_order) {
            return Err(BurstError::OtherMap);
        }
        let Stages { pixel_table, map, .. } = stages;
        front::accumulate(&[frame.samples], layout, &merge, pixel_table, map, &mut excluded)?;
        self.state.frames.push(frame.index);
        Ok(excluded)
    }

    /// Second stage for a new frame: chooses an exposure for each texel and builds the map.
    pub(crate) fn finish(
        &mut self,
        excluded: &Excluded,
        calibration: &Calibration,
        stages: &mut Stages<'_>,
    ) -> Coverage {
        let buffers = Buffers::divide(self.memory.as_mut(), &self.state.sizes);
        self.state.finish(excluded, calibration, stages, buffers)
    }
}

impl State {
    fn try_new(
        calibration: &Calibration,
        stages: &Stages<'_>,
        exposures: &[Exposure],
        memory: &mut [u64],
    ) -> Result<Self, FrontError> {
        let sizes = window_sizes(stages, exposures)?;
        buffer::check(&memory, sizes.words())?;
        let Buffers { energies, weights, marks, tables, reciprocals } = Buffers::divide(memory, &sizes);
        energies.fill([0.0; 4]);
        marks.fill(Marks::default());
        weigh(&stages.pixel_table, weights);
        let curve = stages.merge.curve();
        let mut singles = [const { None }; MAX_EXPOSURES];
        let (mut tables, mut reciprocals) =
            (tables.chunks_mut(sizes.tables.max(1)), reciprocals.chunks_mut(RECIPROCALS));
        for (index, (single, own)) in singles.iter_mut().zip(exposures).enumerate() {
            // The shortest exposure contributes a lower bound of the radiance of pixels in which it is saturated.
            let response = if index == 0 { curve } else { curve.unsaturated() };
            let (tables, reciprocals) =
                (tables.next().unwrap_or_default(), reciprocals.next().unwrap_or_default());
            let own = core::slice::from_ref(own);
            let merge = Merge::try_new(response, own, calibration.scale, tables, reciprocals)?.detached();
            *single = Some(Single { merge, limits: limits(&stages.merge, exposures, index) });
        }
        let levels = core::array::from_fn(|i| {
            exposures.get(i).map_or(Level::default(), |e| level(calibration, stages, e))
        });
        let frames = Frames::new(levels, mean_weight(&stages.pixel_table));
        Ok(Self { exposures: singles, frames, sizes, coverage: Coverage::default() })
    }

    /// Returns the merge of exposure `index` without the others; `None` if the window has no such exposure.
    fn merge<'m>(
        &'m self,
        index: usize,
        stages: &Stages<'m>,
        buffers: &'m Buffers<'_>,
    ) -> Option<MergeView<'m>> {
        let Single { merge, limits } = self.exposures.get(index)?.as_ref()?;
        let (tables, from) = (self.sizes.tables, RECIPROCALS * index);
        let tables = Tables {
            curve: stages.merge.curve().into_table(),
            exposures: buffers.tables.get(tables * index..tables * (index + 1))?,
            reciprocals: buffers.reciprocals.get(from..from + RECIPROCALS)?,
        };
        Some(merge.over(tables, MergeMode::Needed).marking(*limits))
    }

    #[inline(never)]
    fn finish(
        &mut self,
        excluded: &Excluded,
        calibration: &Calibration,
        stages: &mut Stages<'_>,
        buffers: Buffers<'_>,
    ) -> Coverage {
        let Calibration { layout, white_balance, .. } = calibration;
        let newest = self.frames.newest();
        let Some(merge) = self.merge(newest, stages, &buffers) else { return self.coverage };
        let lanes = front::lanes(layout, &merge, &stages.pixel_table, *white_balance);
        let Stages { pixel_table, map, .. } = stages;
        let Buffers { energies, marks, weights, .. } = buffers;
        let (quads, geometry) = (map.sums_mut(pixel_table.source_order), pixel_table.texels);
        let texels = Texels { quads, geometry, energies, marks, weights };
        // RGB, the usual format, has a loop without the choice of lanes by format.
        match (lanes.pick, &lanes.tally) {
            (Pick::Plain, Some(tally)) => self.choose(texels, |quad| {
                let [r, g, b, _] = tally.settled(quad).map(positive);
                lanes.scaled([r, g, b])
            }),
            _ => self.choose(texels, |quad| lanes.rgb(lanes.sums(quad).map(positive))),
        }
        if pixel_table.source_order == pixel_table.order {
            map.sum_up();
        } else {
            let plain = Lanes::of(Format::Rgb24, [1.0; 3]);
            map.finish(pixel_table.source_order, pixel_table.texels, &plain);
        }
        let seen = front::coverage(excluded, &lanes, pixel_table, map);
        if newest == 0 {
            self.coverage = seen;
        }
        self.coverage
    }

    /// Replaces the energies of the newest exposure by those of the sums in the quads, as `rgb` converts them, and each quad by energy and
    /// first moment of the chosen exposure. The first moments are valid if the quads are the texels of the map.
    #[inline]
    fn choose(&self, texels: Texels<'_>, rgb: impl Fn(&Quad) -> [f32; 3]) {
        let newest = self.frames.newest();
        let Texels { quads, geometry, energies, marks, weights } = texels;
        let stored = energies.chunks_exact_mut(self.sizes.exposures.max(1)).zip(marks).zip(weights);
        for ((quad, texel), ((energies, marks), weight)) in quads.iter_mut().zip(geometry).zip(stored) {
            if *weight == 0.0 {
                continue;
            }
            let mut own = *marks;
            own.set(newest, Mark::of(quad));
            *marks = own;
            if let Some(energy) = energies.get_mut(newest) {
                let [r, g, b] = rgb(quad);
                *energy = [r, g, b, luminance([r, g, b])];
            }
            let chosen = self.frames.choose(energies, own, *weight);
            let energy = *energies.get(chosen).unwrap_or(&[0.0; 4]);
            let [x, across, up] = texel.direction.map(|d| d * energy[3]);
            *quad = Quad { energy, moment: [x, across, up, 0.0] };
        }
    }
}

/// The texels of a window: their quads, centroids, energies in each exposure, marks and weights.
struct Texels<'m> {
    quads: &'m mut [Quad],
    geometry: &'m [Texel],
    energies: &'m mut [[f32; 4]],
    marks: &'m mut [Marks],
    weights: &'m [f32],
}

/// Writes the sum of the weights of the pixels of each texel to `weights`, steradians.
fn weigh(pixel_table: &PixelTableView<'_>, weights: &mut [f32]) {
    weights.fill(0.0);
    for (run, weight) in pixel_table.runs.iter().zip(pixel_table.weights) {
        if let Some(sum) = weights.get_mut(run.texel()) {
            *sum += (f64::from(*weight) * run.len() as f64 * pixel_table.weight_unit) as f32;
        }
    }
}

/// Returns the mean weight of a pixel, steradians.
fn mean_weight(pixel_table: &PixelTableView<'_>) -> f32 {
    let pixels: f64 = pixel_table.spans.iter().map(|span| f64::from(span.len)).sum();
    (pixel_table.weight_sum as f64 * pixel_table.weight_unit / pixels.max(1.0)) as f32
}

/// Returns the codes of exposure `index` from which a pixel counts as bright and as clipped.
fn limits(merge: &MergeView<'_>, exposures: &[Exposure], index: usize) -> Limits {
    let (curve, light) = (merge.curve(), |e: &Exposure| e.seconds * e.gain);
    let saturated = curve.saturated();
    let full = f64::from(curve.exposure_q27(1, saturated));
    let bright = match (exposures.get(index), exposures.get(index + 1)) {
        (Some(own), Some(next)) => {
            let most = full * light(own) / light(next);
            (0..=saturated).find(|code| f64::from(curve.exposure_q27(1, *code)) >= most).unwrap_or(saturated)
        }
        _ => u32::MAX,
    };
    Limits { bright, clipped: if index == 0 { u32::MAX } else { saturated }, saturated }
}

/// Returns the luminance of a pixel of `exposure` at full scale and at the least trusted code.
fn level(calibration: &Calibration, stages: &Stages<'_>, exposure: &Exposure) -> Level {
    let full = f64::from(luminance(calibration.white_balance)) * calibration.scale;
    let full = full / (exposure.seconds * exposure.gain);
    let curve = stages.merge.curve();
    let dark = curve.exposure_q27(1, curve.trusted()).max(0);
    Level { full: full as f32, dark: (full * f64::from(dark) / f64::from(1u32 << CURVE_BITS)) as f32 }
}
