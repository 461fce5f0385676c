//! The front end of one camera: bursts of exposures in, a map of the light from above the horizon out.

use crate::buffer::{self, Buffer, TooSmall};
use crate::calibration::Calibration;
use crate::error::FrontError;
use crate::extrapolation::{self, Extrapolation};
use crate::front::{self, BurstError, Coverage, Excluded};
use crate::healpix::{Domain, MapShape, Order};
use crate::light::Decomposition;
use crate::merge::{self, Exposure, Merge, MergeView, Samples};
use crate::pixel_table::{self, PixelTable, PixelTableError, PixelTableView, Texel};
use crate::polar::LatLongView;
use crate::pyramid::{Pyramid, PyramidView, Quad};
use crate::sampler::{Map, Request, Sampler};
use crate::sizes::{self, Parts, Sizes, merge_sizes};

/// Turns the bursts of one camera into a hemisphere map, in memory that the caller lends: a `Vec<u64>`, an array, or a slice of either.
///
/// The map is dark at first and stays the last burst's until the next one is processed.
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
/// // A radiance of 20: code 51 of 255 in a hundredth of a second, over all that the lens sees.
/// let seen = std::f32::consts::TAU * (1.0 - coverage.unseen as f32);
/// assert!((front.map().total().y() / (20.0 * seen) - 1.0).abs() < 0.05);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct FrontEnd<B> {
    state: State,
    memory: B,
}

/// Fills the unseen part of a map.
type Extrapolate = fn(&mut Pyramid<&mut [Quad]>, &[Texel]);

/// All but the memory: compiled once, whatever memory is lent.
#[derive(Clone, Debug)]
struct State {
    calibration: Calibration,
    order: Order,
    /// Not an enum, so that programs that never ask for an extrapolation do not link it.
    extrapolate: Option<Extrapolate>,
    merge: merge::Detached,
    pixel_table: pixel_table::Detached,
    sizes: Sizes,
}

impl<B: Buffer<u64>> FrontEnd<B> {
    /// Prepares bursts of `exposures`, which ascend by time x gain, for a map of `order`. [`Sizes::words`] says how much memory
    /// that takes.
    ///
    /// # Errors
    /// [`FrontError`].
    pub fn try_new(
        calibration: Calibration,
        exposures: &[Exposure],
        order: Order,
        mut memory: B,
    ) -> Result<Self, FrontError> {
        State::try_new(calibration, exposures, order, memory.as_mut()).map(|state| Self { state, memory })
    }

    /// Prepares bursts of other exposures; the map stays.
    ///
    /// # Errors
    /// [`FrontError`]: exposures that cannot be merged, or that need more memory than was lent; the old ones then stay.
    pub fn set_exposures(&mut self, exposures: &[Exposure]) -> Result<(), FrontError> {
        self.state.set_exposures(exposures, self.memory.as_mut())
    }

    /// Chooses what stands for the part of the hemisphere that the lens does not see; nothing at first.
    pub fn set_extrapolation(&mut self, extrapolation: Extrapolation) {
        self.state.extrapolate = match extrapolation {
            Extrapolation::None => None,
            Extrapolation::Average => Some(|map, texels| _ = extrapolation::average(map, texels)),
        };
    }

    /// Merges the frames of one burst, in the order of the exposures, and builds the map.
    ///
    /// # Errors
    /// [`FrontError::Burst`] for frames that do not fit; the last map then stays.
    pub fn process(&mut self, frames: &[Samples<'_>]) -> Result<Coverage, FrontError> {
        self.process_timed(frames, || {})
    }

    /// [`FrontEnd::process`], which calls `added_up` between its stages: when all pixels are added up, before the map is built.
    ///
    /// # Errors
    /// Those of [`FrontEnd::process`].
    pub fn process_timed(
        &mut self,
        frames: &[Samples<'_>],
        added_up: impl FnOnce(),
    ) -> Result<Coverage, FrontError> {
        let memory = self.memory.as_mut();
        let excluded = self.state.accumulate(frames, memory)?;
        added_up();
        Ok(self.state.finish(&excluded, memory))
    }

    /// The map of the last burst.
    #[must_use]
    pub fn map(&self) -> PyramidView<'_> {
        let quads = sizes::quads(self.memory.as_ref(), &self.state.sizes);
        PyramidView::over(quads, Domain::Hemisphere, self.state.order)
    }

    /// Lets `sampler` decompose the last map, at most into as many lights as it was given memory for. For samplers that
    /// [need no polar map](Sampler::needs_polar): others find it empty and give no lights.
    pub fn decompose<'s>(
        &self,
        sampler: &'s mut (impl Sampler + ?Sized),
        request: impl Into<Request>,
    ) -> Decomposition<'s> {
        sampler.update(&Map { pyramid: self.map(), polar: LatLongView::NONE }, &request.into())
    }

    /// What is known of the camera.
    #[must_use]
    pub fn calibration(&self) -> &Calibration {
        &self.state.calibration
    }

    /// Part of the sphere and order of the map: the argument that constructors of samplers take.
    #[must_use]
    pub fn shape(&self) -> MapShape {
        MapShape { domain: Domain::Hemisphere, order: self.state.order }
    }

    /// Order of the map.
    #[must_use]
    pub fn order(&self) -> Order {
        self.state.order
    }

    /// Order at which pixels are added up: that of the map, or the finest whose texels are larger than the pixels.
    #[must_use]
    pub fn source_order(&self) -> Order {
        Order::saturating(self.state.pixel_table.source_order())
    }

    /// Elements of the buffers in use.
    #[must_use]
    pub fn sizes(&self) -> Sizes {
        self.state.sizes
    }

    /// Calls `f` with the merge of the exposures, for tests of the parts.
    #[doc(hidden)]
    pub fn with_merge<R>(&mut self, f: impl FnOnce(&MergeView<'_>) -> R) -> R {
        let Parts { curve, tables, reciprocals, .. } = Parts::divide(self.memory.as_mut(), &self.state.sizes);
        f(&self.state.merge.over(merge::Tables { curve, exposures: tables, reciprocals }))
    }
}

/// The stages of a burst, over the buffers of a front end.
struct Stages<'m> {
    merge: MergeView<'m>,
    pixel_table: PixelTableView<'m>,
    map: Pyramid<&'m mut [Quad]>,
}

impl State {
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
        Ok(Self { calibration, order, extrapolate: None, merge, pixel_table, sizes })
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

    /// The first half of a burst: every pixel is added to its texel.
    #[inline(never)]
    fn accumulate(&self, frames: &[Samples<'_>], memory: &mut [u64]) -> Result<Excluded, BurstError> {
        let Stages { merge, pixel_table, mut map } = self.stages(memory);
        front::accumulate(frames, &self.calibration.layout, &merge, &pixel_table, &mut map)
    }

    /// The second half: sums become light, and the orders above the texels are built.
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

    /// The stages of a burst over their buffers in `memory`.
    fn stages<'m>(&'m self, memory: &'m mut [u64]) -> Stages<'m> {
        let parts = Parts::divide(memory, &self.sizes);
        let tables =
            merge::Tables { curve: parts.curve, exposures: parts.tables, reciprocals: parts.reciprocals };
        let merge = self.merge.over(tables);
        let Parts { spans, weights, runs, texels, quads, .. } = parts;
        let pixel_table = self.pixel_table.over(pixel_table::Buffers { spans, weights, runs, texels });
        Stages { merge, pixel_table, map: Pyramid::over(quads, Domain::Hemisphere, self.order) }
    }
}

/// Builds the pixel table where [`Parts::divide`] finds it once its size is known; `None` where `words` are too few.
fn lay_out(
    calibration: &Calibration,
    order: Order,
    fixed: &Sizes,
    words: &mut [u64],
) -> Result<Option<pixel_table::Detached>, PixelTableError> {
    if words.len() < fixed.words() {
        return Ok(None);
    }
    // How many runs there are shows only when they are laid out.
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
