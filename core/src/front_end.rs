//! The front end of one camera: converts bursts of exposures to a HEALPix map of the hemisphere above the horizon.

use crate::buffer::{self, Buffer, TooSmall};
use crate::calibration::Calibration;
use crate::error::FrontError;
use crate::extrapolation::{self, Extrapolation};
use crate::front::{self, BurstError, Coverage, Excluded};
use crate::healpix::{Domain, MapShape, Order};
use crate::light::Decomposition;
use crate::merge::{self, Exposure, Merge, MergeMode, MergeView, Samples};
use crate::pixel_table::{self, PixelTable, PixelTableError, Texel};
use crate::polar::LatLongView;
use crate::pyramid::{Pyramid, PyramidView, Quad};
use crate::sampler::{Map, Request, Sampler};
use crate::sizes::{self, Parts, Sizes, merge_sizes};
use crate::stages::Stages;
use crate::window::{self, NewFrame, Window};

/// Converts bursts of one camera to a hemisphere map. The buffer `B` holds all tables and the map: a `Vec<u64>`, an array, or a mutable
/// slice.
///
/// A new map is dark. After each [`FrontEnd::process`] it holds the light of that burst.
///
/// ```
/// use hemilux_core::{Calibration, Exposure, Format, FrontEnd, Lens, Sizes};
///
/// let lens = Lens::equidistant([15.5, 15.5], 9.0, 1.5)?;
/// let calibration = Calibration::try_new(lens, Format::Grey, 32, 32)?;
/// let exposures = [Exposure { seconds: 0.01, gain: 1.0 }];
/// let sizes = Sizes::of(&calibration, &exposures, 2.try_into()?)?;
/// let mut front = FrontEnd::try_new(calibration, &exposures, 2.try_into()?, vec![0; sizes.words()])?;
/// let coverage = front.process(&[[51u8; 32 * 32].as_slice().into()])?;
/// assert_eq!(coverage.clipped, 0.0);
// 51/255 of full scale in 0.01 s is a radiance of 20 over the whole field of view.
/// let seen = std::f32::consts::TAU * (1.0 - coverage.unseen as f32);
/// assert!((front.map().total().y() / (20.0 * seen) - 1.0).abs() < 0.05);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct FrontEnd<B> {
    state: FrontEndState,
    memory: B,
}

/// A function that fills the part of a map outside of the field of view.
type Extrapolate = fn(&mut Pyramid<&mut [Quad]>, &[Texel]);

/// The state of a front end without its buffer. The type is not generic, so that its functions are compiled once for all types of buffer.
#[derive(Clone, Debug)]
struct FrontEndState {
    calibration: Calibration,
    order: Order,
    /// A function pointer instead of an enum: programs that never choose an extrapolation do not link it.
    extrapolate: Option<Extrapolate>,
    mode: MergeMode,
    merge: merge::Detached,
    pixel_table: pixel_table::Detached,
    sizes: Sizes,
}

impl<B: Buffer<u64>> FrontEnd<B> {
    /// Creates a front end for bursts of `exposures`, which ascend by time x gain, and a map of `order`. `memory` needs [`Sizes::words`]
    /// elements.
    ///
    /// The time is proportional to the number of pixels and texels.
    ///
    /// # Errors
    /// [`FrontError`] for a calibration, exposures and order that do not fit together, and for memory that is too short.
    pub fn try_new(
        calibration: Calibration,
        exposures: &[Exposure],
        order: Order,
        mut memory: B,
    ) -> Result<Self, FrontError> {
        FrontEndState::try_new(calibration, exposures, order, memory.as_mut())
            .map(|state| Self { state, memory })
    }

    /// Replaces the exposures of later bursts. The map is unchanged.
    ///
    /// # Errors
    /// [`FrontError`] for exposures that cannot be merged or need more memory than was lent; the previous exposures then remain in use.
    pub fn set_exposures(&mut self, exposures: &[Exposure]) -> Result<(), FrontError> {
        self.state.set_exposures(exposures, self.memory.as_mut())
    }

    /// Selects the exposures that are read of later bursts; [`MergeMode::All`] by default.
    pub fn set_merge_mode(&mut self, mode: MergeMode) {
        self.state.mode = mode;
    }

    /// Selects the estimate of the light outside of the field of view; [`Extrapolation::None`] by default.
    pub fn set_extrapolation(&mut self, extrapolation: Extrapolation) {
        self.state.extrapolate = match extrapolation {
            Extrapolation::None => None,
            Extrapolation::Average => Some(|map, texels| _ = extrapolation::average(map, texels)),
        };
    }

    /// Merges the frames of one burst and replaces the map. `frames` has one element per exposure, in the order of the exposures; a slice
    /// of bytes or of words converts `into()` an element.
    ///
    /// # Errors
    /// [`FrontError::Burst`] for frames that do not match the calibration or the exposures; the map is then unchanged.
    pub fn process(&mut self, frames: &[Samples<'_>]) -> Result<Coverage, FrontError> {
        self.process_timed(frames, || {})
    }

    /// Processes a burst like [`FrontEnd::process`] and calls `added_up` between the two stages, after the merge and before the map is built,
    /// so that the caller can time each stage.
    ///
    /// # Errors
    /// The errors of [`FrontEnd::process`].
    pub fn process_timed(
        &mut self,
        frames: &[Samples<'_>],
        added_up: impl FnOnce(),
    ) -> Result<Coverage, FrontError> {
        let memory = self.memory.as_mut();
        let mut excluded = Excluded::default();
        self.state.accumulate(frames, memory, &mut excluded)?;
        added_up();
        Ok(self.state.finish(&excluded, memory))
    }

    /// Replaces one frame of `window` and the map, which is then that of the newest frame of each exposure; `added_up` is called as by
    /// [`FrontEnd::process_timed`].
    ///
    /// # Errors
    /// [`FrontError::Burst`] for a frame that does not match the calibration, an index that is not below the number of exposures, or a
    /// window of another front end; the map is then unchanged.
    pub fn slide<W: Buffer<u64>>(
        &mut self,
        window: &mut Window<W>,
        frame: NewFrame<'_>,
        added_up: impl FnOnce(),
    ) -> Result<Coverage, FrontError> {
        let mut stages = self.state.stages(self.memory.as_mut());
        let excluded = window.add_up(frame, &self.state.calibration.layout, &mut stages)?;
        added_up();
        let coverage = window.finish(&excluded, &self.state.calibration, &mut stages);
        if let Some(extrapolate) = self.state.extrapolate {
            extrapolate(&mut stages.map, stages.pixel_table.texels);
        }
        Ok(coverage)
    }

    /// Number of `u64` elements to lend to [`FrontEnd::window`]: 16 bytes for each exposure and 8 for each texel of the source order, and
    /// the tables of the exposures.
    ///
    /// # Errors
    /// [`FrontError::Exposures`] for exposures that cannot be merged.
    pub fn window_words(&mut self, exposures: &[Exposure]) -> Result<usize, FrontError> {
        Ok(window::words(&self.state.stages(self.memory.as_mut()), exposures)?)
    }

    /// Creates a window of `exposures`, which ascend by time x gain, for frames of this camera. `memory` needs
    /// [`FrontEnd::window_words`] elements.
    ///
    /// # Errors
    /// [`FrontError`] for exposures that cannot be merged and for memory that is too short.
    pub fn window<W: Buffer<u64>>(
        &mut self,
        exposures: &[Exposure],
        memory: W,
    ) -> Result<Window<W>, FrontError> {
        let stages = self.state.stages(self.memory.as_mut());
        Window::try_new(&self.state.calibration, &stages, exposures, memory)
    }

    /// Returns the map of the last burst.
    #[must_use]
    pub fn map(&self) -> PyramidView<'_> {
        let quads = sizes::quads(self.memory.as_ref(), &self.state.sizes);
        PyramidView::over(quads, Domain::Hemisphere, self.state.order)
    }

    /// Returns the map of the last burst, mutable for stages that change it, such as [`Mains`](crate::mains::Mains).
    #[must_use]
    pub fn map_mut(&mut self) -> Pyramid<&mut [Quad]> {
        let parts = Parts::divide(self.memory.as_mut(), &self.state.sizes);
        Pyramid::over(parts.quads, Domain::Hemisphere, self.state.order)
    }

    /// Decomposes the map of the last burst with `sampler`. The number of lights is limited by `request` and by the sampler's buffers.
    ///
    /// The sampler gets no latitude-longitude map: samplers that [need one](Sampler::needs_polar) return no lights; use
    /// [`Sampler::update`] for them.
    pub fn decompose<'s>(
        &self,
        sampler: &'s mut (impl Sampler + ?Sized),
        request: impl Into<Request>,
    ) -> Decomposition<'s> {
        sampler.update(&Map { pyramid: self.map(), polar: LatLongView::NONE }, &request.into())
    }

    /// Returns the calibration from which the front end was created.
    #[must_use]
    pub fn calibration(&self) -> &Calibration {
        &self.state.calibration
    }

    /// Returns the part of the sphere and the order of the map: the argument of the constructors of samplers.
    #[must_use]
    pub fn shape(&self) -> MapShape {
        MapShape { domain: Domain::Hemisphere, order: self.state.order }
    }

    /// Returns the HEALPix order of the map.
    #[must_use]
    pub fn order(&self) -> Order {
        self.state.order
    }

    /// Returns the order at which pixels are accumulated: the finest whose texels are at least 2.25 times as large as the largest pixel, at most
    /// the order of the map.
    #[must_use]
    pub fn source_order(&self) -> Order {
        Order::saturating(self.state.pixel_table.source_order())
    }

    /// Returns the number of elements in use of each buffer of the front end.
    #[must_use]
    pub fn sizes(&self) -> Sizes {
        self.state.sizes
    }

    /// Calls `f` with the merge of the exposures. Unstable: for the tests of this workspace.
    #[doc(hidden)]
    pub fn with_merge<R>(&mut self, f: impl FnOnce(&MergeView<'_>) -> R) -> R {
        let Parts { curve, tables, reciprocals, .. } = Parts::divide(self.memory.as_mut(), &self.state.sizes);
        f(&self.state.merge.over(merge::Tables { curve, exposures: tables, reciprocals }, self.state.mode))
    }
}

impl FrontEndState {
    #[inline(never)]
    fn try_new(
        calibration: Calibration,
        exposures: &[Exposure],
        order: Order,
        memory: &mut [u64],
    ) -> Result<Self, FrontError> {
        let is_factor = |w: &f32| *w > 0.0 && w.is_finite();
        if !calibration.white_balance.iter().all(is_factor) {
            return Err(FrontError::BadWhiteBalance);
        }
        let fixed = Sizes::fixed(&calibration, order)?.with_merge(merge_sizes(&calibration, exposures)?);
        let Some(pixel_table) = lay_out(&calibration, order, &fixed, memory)? else {
            let needed = Sizes::of(&calibration, exposures, order)?.words();
            return Err(TooSmall { needed, lent: memory.len() }.into());
        };
        let sizes = fixed.with_pixel_table(pixel_table.size());
        let parts = Parts::divide(memory, &sizes);
        parts.quads.fill(Quad::default());
        let curve = calibration.curve(parts.curve)?;
        let merge = Merge::try_new(curve, exposures, calibration.scale, parts.tables, parts.reciprocals)?;
        let merge = merge.detached();
        Ok(Self { calibration, order, extrapolate: None, mode: MergeMode::All, merge, pixel_table, sizes })
    }

    #[inline(never)]
    fn set_exposures(&mut self, exposures: &[Exposure], memory: &mut [u64]) -> Result<(), FrontError> {
        let sizes = self.sizes.with_merge(merge_sizes(&self.calibration, exposures)?);
        buffer::check(&memory, sizes.words())?;
        let parts = Parts::divide(memory, &sizes);
        let curve = self.merge.curve.over(parts.curve);
        let scale = self.calibration.scale;
        self.merge = Merge::try_new(curve, exposures, scale, parts.tables, parts.reciprocals)?.detached();
        self.sizes = sizes;
        Ok(())
    }

    /// Runs the first stage of a burst: adds the light of each pixel to its texel.
    #[inline(never)]
    fn accumulate(
        &self,
        frames: &[Samples<'_>],
        memory: &mut [u64],
        excluded: &mut Excluded,
    ) -> Result<(), BurstError> {
        let Stages { merge, pixel_table, mut map } = self.stages(memory);
        front::accumulate(frames, &self.calibration.layout, &merge, &pixel_table, &mut map, excluded)
    }

    /// Runs the second stage of a burst: converts sums to energy and builds the coarser orders.
    #[inline(never)]
    fn finish(&self, excluded: &Excluded, memory: &mut [u64]) -> Coverage {
        let Calibration { layout, white_balance, .. } = &self.calibration;
        let Stages { merge, pixel_table, mut map } = self.stages(memory);
        let coverage = front::finish(excluded, layout, &merge, &pixel_table, *white_balance, &mut map);
        if let Some(extrapolate) = self.extrapolate {
            extrapolate(&mut map, pixel_table.texels);
        }
        coverage
    }

    /// Returns the stages of a burst, which read and write `memory`.
    fn stages<'m>(&'m self, memory: &'m mut [u64]) -> Stages<'m> {
        let parts = Parts::divide(memory, &self.sizes);
        let tables =
            merge::Tables { curve: parts.curve, exposures: parts.tables, reciprocals: parts.reciprocals };
        let merge = self.merge.over(tables, self.mode);
        let Parts { spans, weights, runs, texels, quads, .. } = parts;
        let pixel_table = self.pixel_table.over(pixel_table::Buffers { spans, weights, runs, texels });
        Stages { merge, pixel_table, map: Pyramid::over(quads, Domain::Hemisphere, self.order) }
    }
}

/// Builds the pixel table at its final position in the memory that [`Parts::divide`] splits; `None` if `words` has too few elements.
fn lay_out(
    calibration: &Calibration,
    order: Order,
    fixed: &Sizes,
    words: &mut [u64],
) -> Result<Option<pixel_table::Detached>, PixelTableError> {
    if words.len() < fixed.words() {
        return Ok(None);
    }
    // The number of runs is available only after they are computed.
    let most = fixed.with_most_runs(words.len());
    let parts = Parts::divide(words, &most);
    let Parts { spans, weights, runs, texels, .. } = parts;
    let buffers = pixel_table::Buffers { spans, weights, runs, texels };
    let image = calibration.layout.merged_size();
    let pixel_table = match PixelTable::try_new(&calibration.merged_lens(), image, order.get(), buffers) {
        Ok(pixel_table) => pixel_table.detached(),
        Err(PixelTableError::TooSmall(_)) => return Ok(None),
        Err(e) => return Err(e),
    };
    sizes::close_gap(words, &most, &fixed.with_pixel_table(pixel_table.size()));
    Ok(Some(pixel_table))
}
