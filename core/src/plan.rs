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

/// Where one pixel's light goes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Cell {
    /// Texel at the plan's accumulation order; the last one collects what is below the horizon.
    pub texel: u32,
    /// Solid angle over relative illumination, in units of [`Plan::weight_unit`].
    pub weight: u32,
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
pub struct Plan<S, C, T> {
    spans: S,
    cells: C,
    texels: T,
    width: u32,
    height: u32,
    order: u8,
    source_order: u8,
    weight_unit: f64,
    unseen: f64,
    seen_pixels: usize,
}

/// Elements that a plan needs of each buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlanSize {
    /// Image rows.
    pub spans: usize,
    /// Pixels inside the lens circle.
    pub cells: usize,
    /// Texels of the map.
    pub texels: usize,
}

/// Counts what [`Plan::try_new`] needs.
///
/// # Errors
/// [`PlanError`]: nothing seen, or sizes out of range.
pub fn plan_size(lens: &Lens, width: u32, height: u32, order: u8) -> Result<PlanSize, PlanError> {
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 || pixels > 1 << 26 {
        return Err(PlanError::BadSize);
    }
    if order > 10 {
        return Err(PlanError::BadOrder);
    }
    let cells = (0..height).map(|row| span(lens, width, row).len as usize).sum();
    if cells == 0 {
        return Err(PlanError::NothingSeen);
    }
    Ok(PlanSize { spans: height as usize, cells, texels: Domain::Hemisphere.quads(order) })
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

impl<S: Buffer<Span>, C: Buffer<Cell>, T: Buffer<Texel>> Plan<S, C, T> {
    /// Builds the plan of an image of `width` x `height` pixels seen through `lens`, for a hemisphere map of `order`.
    ///
    /// # Errors
    /// [`PlanError`]; the sizes are those of [`plan_size`].
    pub fn try_new(
        lens: &Lens,
        width: u32,
        height: u32,
        order: u8,
        (spans, cells, texels): (S, C, T),
    ) -> Result<Self, PlanError> {
        let size = plan_size(lens, width, height, order)?;
        arena::check(&spans, size.spans).map_err(PlanError::TooSmall)?;
        arena::check(&cells, size.cells).map_err(PlanError::TooSmall)?;
        arena::check(&texels, size.texels).map_err(PlanError::TooSmall)?;
        let mut plan = Self {
            spans,
            cells,
            texels,
            width,
            height,
            order,
            source_order: order,
            weight_unit: 1.0,
            unseen: 0.0,
            seen_pixels: size.cells,
        };
        plan.lay_out(lens)?;
        plan.measure_texels(lens);
        Ok(plan)
    }

    fn lay_out(&mut self, lens: &Lens) -> Result<(), PlanError> {
        for (row, slot) in (0..self.height).zip(self.spans.as_mut()) {
            *slot = span(lens, self.width, row);
        }
        let spans = &self.spans.as_ref()[..self.height as usize];
        let (mut largest, mut heaviest, mut densest, mut below) = (0.0f64, 0.0f64, 0.0f64, 0.0f64);
        visit(spans, lens, |_, pixel| {
            largest = largest.max(pixel.solid_angle);
            heaviest = heaviest.max(pixel.weight);
            densest = densest.max(pixel.weight / pixel.solid_angle);
            below += if pixel.direction.z > 0.0 { 0.0 } else { pixel.weight };
        });
        let fits = |order: &u8| healpix::solid_angle(*order) >= TEXEL_OVER_PIXEL * largest;
        self.source_order = (0..=self.order).rev().find(fits).ok_or(PlanError::BadOrder)?;
        let fullest = below.max(healpix::solid_angle(self.source_order) * densest);
        self.weight_unit = heaviest / heaviest_count(fullest / heaviest);
        let below = Domain::Hemisphere.quads(self.source_order) as u32;
        let cells = self.cells.as_mut();
        visit(spans, lens, |index, pixel| {
            let above = pixel.direction.z > 0.0;
            let texel = if above { healpix::ipix(self.source_order, pixel.direction) } else { below };
            cells[index] = Cell { texel, weight: libm::round(pixel.weight / self.weight_unit) as u32 };
        });
        Ok(())
    }

    fn measure_texels(&mut self, lens: &Lens) {
        let mut unseen = 0.0;
        let texels = &mut self.texels.as_mut()[..Domain::Hemisphere.quads(self.order)];
        for (ipix, texel) in texels.iter_mut().enumerate() {
            *texel = measure(lens, (self.width, self.height), self.order, ipix as u32);
            unseen += f64::from(texel.unseen_sr);
        }
        self.unseen = unseen / Domain::Hemisphere.solid_angle();
    }

    /// The columns of each image row that are visited.
    #[must_use]
    pub fn spans(&self) -> &[Span] {
        &self.spans.as_ref()[..self.height as usize]
    }

    /// Cells of the visited pixels, in memory order.
    #[must_use]
    pub fn cells(&self) -> &[Cell] {
        &self.cells.as_ref()[..self.seen_pixels]
    }

    /// Texels of the map, at [`Plan::order`].
    #[must_use]
    pub fn texels(&self) -> &[Texel] {
        &self.texels.as_ref()[..Domain::Hemisphere.quads(self.order)]
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

    /// Steradians of one count of [`Cell::weight`].
    #[must_use]
    pub fn weight_unit(&self) -> f64 {
        self.weight_unit
    }

    /// The share of the hemisphere that the lens does not see.
    #[must_use]
    pub fn unseen(&self) -> f64 {
        self.unseen
    }
}

/// Counts of the heaviest pixel's weight, when the fullest sum holds the light of `crowd` such pixels.
///
/// 16 bits, or as many as keep twice the sum of radiance (31 bits) x weight inside an `i64`: the rounding of weights and the pixels
/// that overhang a texel's edge stay far below the other half.
fn heaviest_count(crowd: f64) -> f64 {
    libm::floor(f64::from(1u32 << 31) / crowd).clamp(1.0, f64::from(u16::MAX))
}

/// Geometry of one visited pixel.
struct Pixel {
    direction: DVec3,
    solid_angle: f64,
    /// Solid angle over relative illumination.
    weight: f64,
}

/// Calls `f` with the running index and geometry of every pixel in the spans.
fn visit(spans: &[Span], lens: &Lens, mut f: impl FnMut(usize, Pixel)) {
    let mut index = 0;
    for (row, span) in spans.iter().enumerate() {
        for column in span.first..span.first + span.len {
            let at = DVec2::new(f64::from(column), row as f64);
            // A pixel between two seen ones is seen; a rounding slip at the rim weighs nothing.
            let direction = lens.unproject(at).unwrap_or(DVec3::NEG_Z);
            let solid_angle = lens.solid_angle(at).unwrap_or(0.0);
            let theta = libm::atan2(libm::hypot(direction.x, direction.y), direction.z);
            f(index, Pixel { direction, solid_angle, weight: solid_angle / lens.illumination(theta) });
            index += 1;
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
