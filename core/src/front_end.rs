//! The front end of one camera: bursts of exposures in, a map of the light from above the horizon out.

use crate::arena::{self, Buffer, TooSmall};
use crate::calibration::Calibration;
use crate::error::FrontError;
use crate::fill::{self, Extrapolation};
use crate::front::{self, BurstError, Coverage, Excluded};
use crate::healpix::{Domain, Order};
use crate::light::Decomposition;
use crate::merge::{self, Exposure, Merge, MergeView, Samples};
use crate::plan::{self, Plan, PlanError, PlanView, Texel};
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
    plan: plan::Detached,
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
            Extrapolation::Average => Some(|map, texels| _ = fill::average(map, texels)),
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

    /// Part of the sphere and order of the map, as samplers take them.
    #[must_use]
    pub fn shape(&self) -> (Domain, Order) {
        (Domain::Hemisphere, self.state.order)
    }

    /// Order of the map.
    #[must_use]
    pub fn order(&self) -> Order {
        self.state.order
    }

    /// Order at which pixels are added up: that of the map, or the finest whose texels are larger than the pixels.
    #[must_use]
    pub fn source_order(&self) -> Order {
        Order::saturating(self.state.plan.source_order())
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
        let Some(plan) = lay_out(&calibration, order, &fixed, memory)? else {
            let needed = Sizes::of(&calibration, exposures, order)?.words();
            return Err(TooSmall { needed, lent: memory.len() }.into());
        };
        let sizes = fixed.with_plan(plan.size());
        let parts = Parts::divide(memory, &sizes);
        parts.quads.fill(Quad::default());
        let curve = calibration.curve(parts.curve)?;
        let tables = (parts.tables, parts.reciprocals);
        let merge = Merge::try_new(curve, exposures, calibration.scale, tables)?.detached();
        Ok(Self { calibration, order, extrapolate: None, merge, plan, sizes })
    }

    #[inline(never)]
    fn set_exposures(&mut self, exposures: &[Exposure], memory: &mut [u64]) -> Result<(), FrontError> {
        let sizes = self.sizes.with_merge(merge_sizes(&self.calibration, exposures)?);
        arena::check(&memory, sizes.words())?;
        let parts = Parts::divide(memory, &sizes);
        let curve = self.merge.curve.over(parts.curve);
        let tables = (parts.tables, parts.reciprocals);
        self.merge = Merge::try_new(curve, exposures, self.calibration.scale, tables)?.detached();
        self.sizes = sizes;
        Ok(())
    }

    /// The first half of a burst: every pixel is added to its texel.
    #[inline(never)]
    fn accumulate(&self, frames: &[Samples<'_>], memory: &mut [u64]) -> Result<Excluded, BurstError> {
        let (merge, plan, mut map) = self.parts(memory);
        front::accumulate(frames, &self.calibration.layout, &merge, &plan, &mut map)
    }

    /// The second half: sums become light, and the orders above the texels are built.
    #[inline(never)]
    fn finish(&self, excluded: &Excluded, memory: &mut [u64]) -> Coverage {
        let Calibration { layout, white_balance, .. } = &self.calibration;
        let (merge, plan, mut map) = self.parts(memory);
        let coverage = front::finish(excluded, layout, &merge, &plan, *white_balance, &mut map);
        if let Some(extrapolate) = self.extrapolate {
            extrapolate(&mut map, plan.texels);
        }
        coverage
    }

    /// What a frame runs through, in `memory`.
    fn parts<'m>(&'m self, memory: &'m mut [u64]) -> (MergeView<'m>, PlanView<'m>, Pyramid<&'m mut [Quad]>) {
        let parts = Parts::divide(memory, &self.sizes);
        let tables =
            merge::Tables { curve: parts.curve, exposures: parts.tables, reciprocals: parts.reciprocals };
        let merge = self.merge.over(tables);
        let Parts { spans, weights, runs, texels, quads, .. } = parts;
        let plan = self.plan.over(plan::Tables { spans, weights, runs, texels });
        (merge, plan, Pyramid::over(quads, Domain::Hemisphere, self.order))
    }
}

/// Builds the plan where [`Parts::divide`] finds it once its size is known; `None` where `words` are too few.
fn lay_out(
    calibration: &Calibration,
    order: Order,
    fixed: &Sizes,
    words: &mut [u64],
) -> Result<Option<plan::Detached>, PlanError> {
    if words.len() < fixed.words() {
        return Ok(None);
    }
    // How many runs there are shows only when they are laid out.
    let most = fixed.with_most_runs(words.len());
    let parts = Parts::divide(words, &most);
    let (width, height) = calibration.layout.places();
    let tables = (parts.spans, parts.weights, parts.runs, parts.texels);
    let plan = match Plan::try_new(&calibration.place_lens(), width, height, order.get(), tables) {
        Ok(plan) => plan.detached(),
        Err(PlanError::TooSmall(_)) => return Ok(None),
        Err(e) => return Err(e),
    };
    sizes::close_gap(words, &most, &fixed.with_plan(plan.size()));
    Ok(Some(plan))
}
