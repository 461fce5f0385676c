//! The plan pixel -> texel: built once per calibration, run through by every frame.
//!
//! Every pixel whose centre lies inside the lens circle carries its solid angle to one HEALPix texel, so no light is lost between
//! pixels and texels. Neighbours in a row that share a texel share their mean weight too, as long as that is within 0.25 % of theirs.
//! Accumulation happens at the finest order whose texels are still clearly larger than the largest
//! pixel; finer orders are filled from it with the energy kept ([`crate::front`]).

mod visit;

use crate::arena::{self, Buffer, TooSmall};
use crate::healpix::Domain;
use crate::lens::Lens;
use bytemuck::{Pod, Zeroable};
use visit::{measure, span, survey, visit_runs};

/// Pixels of one image row that a plan visits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Span {
    /// First column.
    pub first: u32,
    /// Columns.
    pub len: u32,
}

/// Most pixels that are merged at a time: a few KB of codes and radiance, small beside any first-level cache.
pub const CHUNK: usize = 192;

/// Most pixels of a run: that many counts of light of [`crate::merge::COUNT_BITS`] add up in 32 bits.
pub const MAX_RUN: usize = 16;

/// Pixels side by side in a row whose light goes to one texel at the plan's accumulation order; the texel after the last collects
/// what is below the horizon. None crosses from one [`CHUNK`] of its span to the next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(transparent)]
pub struct Run(u32);

impl Run {
    pub(crate) fn new(texel: u32, len: usize) -> Self {
        Self(texel << 8 | len as u32)
    }

    /// The texel, below 2^24.
    #[must_use]
    pub const fn texel(self) -> usize {
        (self.0 >> 8) as usize
    }

    /// Pixels, at most [`MAX_RUN`].
    #[must_use]
    pub const fn len(self) -> usize {
        (self.0 & 255) as usize
    }

    /// Whether it has none.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.len() == 0
    }
}

/// What the plan knows of a texel of the map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Texel {
    /// Unit direction of the centroid of its part of the domain.
    pub direction: [f32; 3],
    /// Solid angle inside the domain that the lens does not see, steradians.
    pub unseen_sr: f32,
}

/// Why a plan was refused.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum PlanError {
    /// The image has no pixels, or more than 2^26.
    BadSize,
    /// The lens circle has no pixel on the sensor.
    NothingSeen,
    /// Order above 10, or pixels larger than the texels of order 0.
    BadOrder,
    /// A lent buffer is too short.
    TooSmall(TooSmall),
}

impl core::fmt::Display for PlanError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::BadSize => write!(f, "an image without pixels or with more than 67108864"),
            Self::NothingSeen => write!(f, "a lens whose image circle has no pixel on the sensor"),
            Self::BadOrder => write!(f, "a map order that the image cannot fill"),
            Self::TooSmall(e) => e.fmt(f),
        }
    }
}

impl core::error::Error for PlanError {}

/// The plan of one lens and image size, in memory the caller lends.
#[derive(Clone, Debug)]
pub struct Plan<S, W, R, T> {
    spans: S,
    weights: W,
    runs: R,
    texels: T,
    numbers: Numbers,
}

/// The numbers of a plan.
#[derive(Clone, Copy, Debug)]
struct Numbers {
    width: u32,
    height: u32,
    order: u8,
    source_order: u8,
    weight_unit: f64,
    weight_sum: u64,
    unseen: f64,
    size: PlanSize,
}

/// The tables of a plan, which lie in memory that something else holds.
#[derive(Clone, Copy)]
pub(crate) struct Tables<'a> {
    pub(crate) spans: &'a [Span],
    pub(crate) weights: &'a [u16],
    pub(crate) runs: &'a [Run],
    pub(crate) texels: &'a [Texel],
}

/// A plan apart from its tables.
#[derive(Clone, Debug)]
pub(crate) struct Detached {
    numbers: Numbers,
}

impl Detached {
    /// The plan that runs through `tables`, which it was made with.
    pub(crate) fn over<'a>(&self, tables: Tables<'a>) -> PlanView<'a> {
        let Numbers { width, height, order, source_order, weight_unit, weight_sum, unseen, size } =
            self.numbers;
        PlanView {
            width,
            height,
            order,
            source_order,
            spans: tables.spans.get(..size.spans).unwrap_or_default(),
            weights: tables.weights.get(..size.weights).unwrap_or_default(),
            runs: tables.runs.get(..size.runs).unwrap_or_default(),
            texels: tables.texels.get(..size.texels).unwrap_or_default(),
            weight_unit,
            weight_sum,
            unseen,
        }
    }

    pub(crate) fn size(&self) -> PlanSize {
        self.numbers.size
    }

    pub(crate) fn source_order(&self) -> u8 {
        self.numbers.source_order
    }
}

/// What a frame runs through.
#[derive(Clone, Copy, Debug)]
pub struct PlanView<'a> {
    /// Image columns.
    pub width: u32,
    /// Image rows.
    pub height: u32,
    /// Order of the map.
    pub order: u8,
    /// Order at which pixels are accumulated: that of the map, or the finest that the pixels can fill.
    pub source_order: u8,
    /// The columns of each image row that are visited.
    pub spans: &'a [Span],
    /// Mean solid angle over relative illumination of each run's pixels, in units of `weight_unit`.
    pub weights: &'a [u16],
    /// Where the visited pixels go, in memory order.
    pub runs: &'a [Run],
    /// Texels of the map, at `order`.
    pub texels: &'a [Texel],
    /// Steradians of one count of weight.
    pub weight_unit: f64,
    /// Sum of all pixels' weights.
    pub weight_sum: u64,
    /// The share of the hemisphere that the lens does not see.
    pub unseen: f64,
}

/// Elements that a plan needs of each buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PlanSize {
    /// Image rows.
    pub spans: usize,
    /// Weights of runs.
    pub weights: usize,
    /// Runs of pixels that share a texel and a weight.
    pub runs: usize,
    /// Texels of the map.
    pub texels: usize,
}

/// Counts what [`Plan::try_new`] needs.
///
/// # Errors
/// [`PlanError`]: nothing seen, or sizes out of range.
pub fn plan_size(lens: &Lens, width: u32, height: u32, order: u8) -> Result<PlanSize, PlanError> {
    check(width, height, order)?;
    let survey = survey(lens, width, height)?;
    let source_order = survey.source_order(order)?;
    let mut runs = 0;
    visit_runs(lens, width, height, source_order, |_, _| runs += 1);
    let texels = Domain::Hemisphere.quads(order);
    Ok(PlanSize { spans: height as usize, weights: runs, runs, texels })
}

pub(crate) fn check(width: u32, height: u32, order: u8) -> Result<(), PlanError> {
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 || pixels > 1 << 26 {
        return Err(PlanError::BadSize);
    }
    if order > 10 { Err(PlanError::BadOrder) } else { Ok(()) }
}

impl<S: Buffer<Span>, W: Buffer<u16>, R: Buffer<Run>, T: Buffer<Texel>> Plan<S, W, R, T> {
    /// Builds the plan of an image of `width` x `height` pixels seen through `lens`, for a hemisphere map of `order`.
    ///
    /// # Errors
    /// [`PlanError`]; the sizes are those of [`plan_size`].
    pub fn try_new(
        lens: &Lens,
        width: u32,
        height: u32,
        order: u8,
        (spans, weights, runs, texels): (S, W, R, T),
    ) -> Result<Self, PlanError> {
        check(width, height, order)?;
        let survey = survey(lens, width, height)?;
        let texel_count = Domain::Hemisphere.quads(order);
        arena::check(&spans, height as usize).map_err(PlanError::TooSmall)?;
        arena::check(&texels, texel_count).map_err(PlanError::TooSmall)?;
        let size = PlanSize { spans: height as usize, weights: 0, runs: 0, texels: texel_count };
        let numbers = Numbers {
            width,
            height,
            order,
            source_order: survey.source_order(order)?,
            weight_unit: survey.heaviest / f64::from(u16::MAX),
            weight_sum: 0,
            unseen: 0.0,
            size,
        };
        let mut plan = Self { spans, weights, runs, texels, numbers };
        plan.lay_out(lens);
        let size = plan.numbers.size;
        arena::check(&plan.weights, size.weights).map_err(PlanError::TooSmall)?;
        arena::check(&plan.runs, size.runs).map_err(PlanError::TooSmall)?;
        plan.measure_texels(lens);
        Ok(plan)
    }

    fn lay_out(&mut self, lens: &Lens) {
        let Numbers { width, height, source_order, weight_unit: unit, .. } = self.numbers;
        for (row, slot) in (0..height).zip(self.spans.as_mut()) {
            *slot = span(lens, width, row);
        }
        let mut runs = self.runs.as_mut().iter_mut();
        let mut weights = self.weights.as_mut().iter_mut();
        let (sum, size) = (&mut self.numbers.weight_sum, &mut self.numbers.size);
        visit_runs(lens, width, height, source_order, |run, weight| {
            let weight = libm::round(weight / unit) as u16;
            *sum += u64::from(weight) * run.len() as u64;
            runs.next().into_iter().for_each(|slot| *slot = run);
            weights.next().into_iter().for_each(|slot| *slot = weight);
            (size.runs, size.weights) = (size.runs + 1, size.weights + 1);
        });
    }

    fn measure_texels(&mut self, lens: &Lens) {
        let mut unseen = 0.0;
        let texels = self.texels.as_mut().get_mut(..self.numbers.size.texels).unwrap_or_default();
        for (ipix, texel) in texels.iter_mut().enumerate() {
            *texel =
                measure(lens, (self.numbers.width, self.numbers.height), self.numbers.order, ipix as u32);
            unseen += f64::from(texel.unseen_sr);
        }
        self.numbers.unseen = unseen / Domain::Hemisphere.solid_angle();
    }

    /// What a frame runs through.
    #[must_use]
    pub fn view(&self) -> PlanView<'_> {
        let tables = Tables {
            spans: self.spans.as_ref(),
            weights: self.weights.as_ref(),
            runs: self.runs.as_ref(),
            texels: self.texels.as_ref(),
        };
        self.detached().over(tables)
    }

    /// The plan without its tables, which stay where they are.
    pub(crate) fn detached(&self) -> Detached {
        Detached { numbers: self.numbers }
    }

    /// Texels of the map, at [`Plan::order`].
    #[must_use]
    pub fn texels(&self) -> &[Texel] {
        self.texels.as_ref().get(..self.numbers.size.texels).unwrap_or_default()
    }

    /// Its sizes.
    #[must_use]
    pub fn size(&self) -> PlanSize {
        self.numbers.size
    }

    /// Image columns.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.numbers.width
    }

    /// Image rows.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.numbers.height
    }

    /// Order of the map.
    #[must_use]
    pub fn order(&self) -> u8 {
        self.numbers.order
    }

    /// Order at which pixels are accumulated: that of the map, or the finest that the pixels can fill.
    #[must_use]
    pub fn source_order(&self) -> u8 {
        self.numbers.source_order
    }

    /// The share of the hemisphere that the lens does not see.
    #[must_use]
    pub fn unseen(&self) -> f64 {
        self.numbers.unseen
    }
}
