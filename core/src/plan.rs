//! The plan pixel -> texel: built once per calibration, run through by every frame.
//!
//! Every pixel whose centre lies inside the lens circle carries its own solid angle to one HEALPix texel, so no light is lost
//! between pixels and texels. Accumulation happens at the finest order whose texels are still clearly larger than the largest
//! pixel; finer orders are filled from it with the energy kept ([`crate::front`]).

use crate::arena::{self, Buffer, TooSmall};
use crate::healpix::{self, Domain};
use crate::lens::Lens;
use glam::{DVec2, DVec3};

/// Least solid angle of a texel over that of the largest pixel: with 2.25 a texel is 1.5 pixels wide, so that each holds at least
/// one pixel's centre. Less leaves holes; more blurs.
const TEXEL_OVER_PIXEL: f64 = 2.25;

/// Sub-samples a side with which a texel's unseen share is measured.
const SHARE_SAMPLES: u32 = 4;

/// Pixels of one image row that a plan visits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Span {
    /// First column.
    pub first: u32,
    /// Columns.
    pub len: u32,
}

/// Most pixels that are merged at a time: a few KB of codes and radiance, small beside any first-level cache.
pub const CHUNK: usize = 128;

/// Pixels side by side in a row whose light goes to one texel at the plan's accumulation order; the texel after the last collects
/// what is below the horizon. None crosses from one [`CHUNK`] of its span to the next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Run(u32);

impl Run {
    fn new(texel: u32, len: usize) -> Self {
        Self(texel << 8 | len as u32)
    }

    /// The texel, below 2^24.
    #[must_use]
    pub const fn texel(self) -> usize {
        (self.0 >> 8) as usize
    }

    /// Pixels, at most [`CHUNK`].
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
#[derive(Clone, Copy, Debug, Default, PartialEq)]
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
    width: u32,
    height: u32,
    order: u8,
    source_order: u8,
    weight_unit: f64,
    weight_sum: u64,
    unseen: f64,
    size: PlanSize,
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
    /// Solid angle over relative illumination of each visited pixel, in units of `weight_unit`.
    pub weights: &'a [u16],
    /// Where they go, in memory order.
    pub runs: &'a [Run],
    /// Texels of the map, at `order`.
    pub texels: &'a [Texel],
    /// Steradians of one count of weight.
    pub weight_unit: f64,
    /// Sum of all weights.
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
    /// Pixels inside the lens circle.
    pub weights: usize,
    /// Runs of pixels that share a texel.
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
    visit_runs(lens, width, height, source_order, |_| runs += 1, |_| ());
    let texels = Domain::Hemisphere.quads(order);
    Ok(PlanSize { spans: height as usize, weights: survey.count, runs, texels })
}

fn check(width: u32, height: u32, order: u8) -> Result<(), PlanError> {
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 || pixels > 1 << 26 {
        return Err(PlanError::BadSize);
    }
    if order > 10 { Err(PlanError::BadOrder) } else { Ok(()) }
}

/// What all pixels together say.
#[derive(Default)]
struct Survey {
    count: usize,
    /// Largest solid angle.
    largest: f64,
    /// Largest weight.
    heaviest: f64,
}

fn survey(lens: &Lens, width: u32, height: u32) -> Result<Survey, PlanError> {
    let mut survey = Survey::default();
    for row in 0..height {
        visit(lens, row, span(lens, width, row), |pixel| {
            survey.count += 1;
            survey.largest = survey.largest.max(pixel.solid_angle);
            survey.heaviest = survey.heaviest.max(pixel.weight);
        });
    }
    if survey.count == 0 { Err(PlanError::NothingSeen) } else { Ok(survey) }
}

impl Survey {
    fn source_order(&self, order: u8) -> Result<u8, PlanError> {
        let fits = |order: &u8| healpix::solid_angle(*order) >= TEXEL_OVER_PIXEL * self.largest;
        (0..=order).rev().find(fits).ok_or(PlanError::BadOrder)
    }
}

/// The columns of `row` that see something: an image circle is convex, so it is one run.
fn span(lens: &Lens, width: u32, row: u32) -> Span {
    let seen = |column: &u32| lens.unproject(DVec2::new(f64::from(*column), f64::from(row))).is_some();
    let first = (0..width).find(seen);
    let last = (0..width).rev().find(seen);
    match (first, last) {
        (Some(first), Some(last)) => Span { first, len: last + 1 - first },
        _ => Span::default(),
    }
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
        arena::check(&weights, survey.count).map_err(PlanError::TooSmall)?;
        arena::check(&texels, texel_count).map_err(PlanError::TooSmall)?;
        let size = PlanSize { spans: height as usize, weights: survey.count, runs: 0, texels: texel_count };
        let mut plan = Self {
            spans,
            weights,
            runs,
            texels,
            width,
            height,
            order,
            source_order: survey.source_order(order)?,
            weight_unit: survey.heaviest / f64::from(u16::MAX),
            weight_sum: 0,
            unseen: 0.0,
            size,
        };
        plan.lay_out(lens);
        arena::check(&plan.runs, plan.size.runs).map_err(PlanError::TooSmall)?;
        plan.measure_texels(lens);
        Ok(plan)
    }

    fn lay_out(&mut self, lens: &Lens) {
        for (row, slot) in (0..self.height).zip(self.spans.as_mut()) {
            *slot = span(lens, self.width, row);
        }
        let mut runs = self.runs.as_mut().iter_mut();
        let mut weights = self.weights.as_mut().iter_mut();
        let (unit, sum, count) = (self.weight_unit, &mut self.weight_sum, &mut self.size.runs);
        let take = |run| {
            *count += 1;
            runs.next().into_iter().for_each(|slot| *slot = run);
        };
        visit_runs(lens, self.width, self.height, self.source_order, take, |weight| {
            let weight = libm::round(weight / unit) as u16;
            *sum += u64::from(weight);
            weights.next().into_iter().for_each(|slot| *slot = weight);
        });
    }

    fn measure_texels(&mut self, lens: &Lens) {
        let mut unseen = 0.0;
        let texels = self.texels.as_mut().get_mut(..self.size.texels).unwrap_or_default();
        for (ipix, texel) in texels.iter_mut().enumerate() {
            *texel = measure(lens, (self.width, self.height), self.order, ipix as u32);
            unseen += f64::from(texel.unseen_sr);
        }
        self.unseen = unseen / Domain::Hemisphere.solid_angle();
    }

    /// What a frame runs through.
    #[must_use]
    pub fn view(&self) -> PlanView<'_> {
        PlanView {
            width: self.width,
            height: self.height,
            order: self.order,
            source_order: self.source_order,
            spans: self.spans.as_ref().get(..self.size.spans).unwrap_or_default(),
            weights: self.weights.as_ref().get(..self.size.weights).unwrap_or_default(),
            runs: self.runs.as_ref().get(..self.size.runs).unwrap_or_default(),
            texels: self.texels(),
            weight_unit: self.weight_unit,
            weight_sum: self.weight_sum,
            unseen: self.unseen,
        }
    }

    /// Texels of the map, at [`Plan::order`].
    #[must_use]
    pub fn texels(&self) -> &[Texel] {
        self.texels.as_ref().get(..self.size.texels).unwrap_or_default()
    }

    /// Its sizes.
    #[must_use]
    pub fn size(&self) -> PlanSize {
        self.size
    }

    /// Image columns.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Image rows.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Order of the map.
    #[must_use]
    pub fn order(&self) -> u8 {
        self.order
    }

    /// Order at which pixels are accumulated: that of the map, or the finest that the pixels can fill.
    #[must_use]
    pub fn source_order(&self) -> u8 {
        self.source_order
    }

    /// The share of the hemisphere that the lens does not see.
    #[must_use]
    pub fn unseen(&self) -> f64 {
        self.unseen
    }
}

/// Geometry of one visited pixel.
struct Pixel {
    direction: DVec3,
    solid_angle: f64,
    /// Solid angle over relative illumination.
    weight: f64,
}

/// Calls `f` with the geometry of every pixel of `span` in `row`.
fn visit(lens: &Lens, row: u32, span: Span, mut f: impl FnMut(Pixel)) {
    for column in span.first..span.first + span.len {
        let at = DVec2::new(f64::from(column), f64::from(row));
        // A pixel between two seen ones is seen; a rounding slip at the rim weighs nothing.
        let direction = lens.unproject(at).unwrap_or(DVec3::NEG_Z);
        let solid_angle = lens.solid_angle(at).unwrap_or(0.0);
        let theta = libm::atan2(libm::hypot(direction.x, direction.y), direction.z);
        f(Pixel { direction, solid_angle, weight: solid_angle / lens.illumination(theta) });
    }
}

/// Calls `run` with every run of pixels and `weight` with every pixel's weight, both in memory order.
fn visit_runs(
    lens: &Lens,
    width: u32,
    height: u32,
    order: u8,
    mut run: impl FnMut(Run),
    mut weight: impl FnMut(f64),
) {
    let below = Domain::Hemisphere.quads(order) as u32;
    for row in 0..height {
        let (mut texel, mut len, mut place) = (below, 0, 0);
        visit(lens, row, span(lens, width, row), |pixel| {
            let above = pixel.direction.z > 0.0;
            let own = if above { healpix::ipix(order, pixel.direction) } else { below };
            if len > 0 && (own != texel || place % CHUNK == 0) {
                run(Run::new(texel, len));
                len = 0;
            }
            (texel, len, place) = (own, len + 1, place + 1);
            weight(pixel.weight);
        });
        if len > 0 {
            run(Run::new(texel, len));
        }
    }
}

/// Centroid and unseen solid angle of one texel of the hemisphere.
fn measure(lens: &Lens, size: (u32, u32), order: u8, ipix: u32) -> Texel {
    let inside = |p: DVec2| {
        let within = |v: f64, n: u32| v >= -0.5 && v <= f64::from(n) - 0.5;
        within(p.x, size.0) && within(p.y, size.1)
    };
    let (mut sum, mut above, mut seen) = (DVec3::ZERO, 0u32, 0u32);
    for i in 0..SHARE_SAMPLES * SHARE_SAMPLES {
        let at = |k: u32| (f64::from(k) + 0.5) / f64::from(SHARE_SAMPLES);
        let direction = healpix::point(order, ipix, at(i % SHARE_SAMPLES), at(i / SHARE_SAMPLES));
        if direction.z > 0.0 {
            sum += direction;
            above += 1;
            seen += u32::from(lens.project(direction).is_some_and(inside));
        }
    }
    if above == 0 {
        return Texel { direction: [1.0, 0.0, 0.0], unseen_sr: 0.0 };
    }
    let solid_angle = healpix::solid_angle(order) * Domain::Hemisphere.share(order, ipix);
    let share = f64::from(above - seen) / f64::from(above);
    Texel { direction: sum.normalize().as_vec3().to_array(), unseen_sr: (solid_angle * share) as f32 }
}
