//! Computes weights, runs and centroids from a lens, in `f64`, once per pixel table.

use super::{CHUNK, MAX_RUN, PixelTableError, Run, Span, Texel};
use crate::format::ImageSize;
use crate::healpix::{self, Domain};
use crate::lens::Lens;
use glam::{DVec2, DVec3};

/// Least ratio of the solid angle of a texel to the solid angle of the largest pixel. With 2.25, a texel is 1.5 pixels wide and contains the
/// centre of at least one pixel. A smaller ratio leaves texels without pixels; a larger one blurs the map.
const TEXEL_OVER_PIXEL: f64 = 2.25;

/// Number of sample points along each side of a texel by which its solid angle outside of the field of view is measured.
const SHARE_SAMPLES: u32 = 4;

/// Largest relative difference of a pixel's weight from the mean weight of its run, per radian of pixel width: 0.25 % at 640 x 480 pixels.
/// The light of a single bright pixel has at most this error; the light of a larger area has a far smaller one, since the sum of the weights
/// is exact. Weights of neighbouring pixels differ more in coarser images, so a limit per radian gives about the same number of runs per
/// texel at every resolution.
const WEIGHT_ERROR: f64 = 0.49;

/// Number of pixels inside of the image circle, and their largest solid angle and weight.
#[derive(Default)]
pub(super) struct Survey {
    count: usize,
    /// Largest solid angle of a pixel, steradians.
    largest: f64,
    /// Largest weight of a single pixel, steradians.
    pub(super) heaviest: f64,
}

/// Counts the pixels inside of the image circle and finds their largest solid angle and weight.
pub(super) fn survey(lens: &Lens, image: ImageSize) -> Result<Survey, PixelTableError> {
    let mut survey = Survey::default();
    for row in 0..image.height {
        visit(lens, row, span(lens, image.width, row), |pixel| {
            survey.count += 1;
            survey.largest = survey.largest.max(pixel.solid_angle);
            survey.heaviest = survey.heaviest.max(pixel.weight);
        });
    }
    if survey.count == 0 { Err(PixelTableError::NothingSeen) } else { Ok(survey) }
}

impl Survey {
    /// Returns the finest HEALPix order, at most `order`, whose texels are [`TEXEL_OVER_PIXEL`] times as large as the largest pixel.
    pub(super) fn source_order(&self, order: u8) -> Result<u8, PixelTableError> {
        let fits = |order: &u8| healpix::solid_angle(*order) >= TEXEL_OVER_PIXEL * self.largest;
        (0..=order).rev().find(fits).ok_or(PixelTableError::BadOrder)
    }
}

/// Returns the columns of `row` inside of the image circle; they are contiguous since a circle is convex.
pub(super) fn span(lens: &Lens, width: u32, row: u32) -> Span {
    let seen = |column: &u32| lens.unproject(DVec2::new(f64::from(*column), f64::from(row))).is_some();
    let first = (0..width).find(seen);
    let last = (0..width).rev().find(seen);
    match (first, last) {
        (Some(first), Some(last)) => Span { first, len: last + 1 - first },
        _ => Span::default(),
    }
}

/// Geometry of one pixel inside the image circle.
struct Pixel {
    direction: DVec3,
    solid_angle: f64,
    /// Solid angle of the pixel divided by relative illumination, steradians.
    weight: f64,
}

/// Calls `f` with the geometry of every pixel of `span` in `row`.
fn visit(lens: &Lens, row: u32, span: Span, mut f: impl FnMut(Pixel)) {
    for column in span.first..span.first + span.len {
        let at = DVec2::new(f64::from(column), f64::from(row));
        // All pixels of a span lie inside the image circle; a pixel that rounding places outside gets weight 0.
        let direction = lens.unproject(at).unwrap_or(DVec3::NEG_Z);
        let solid_angle = lens.solid_angle(at).unwrap_or(0.0);
        let theta = libm::atan2(libm::hypot(direction.x, direction.y), direction.z);
        f(Pixel { direction, solid_angle, weight: solid_angle / lens.illumination(theta) });
    }
}

/// A run to which further pixels may be appended.
#[derive(Clone, Copy)]
struct GrowingRun {
    texel: u32,
    len: usize,
    least: f64,
    most: f64,
    sum: f64,
}

impl GrowingRun {
    fn of(texel: u32, weight: f64) -> Self {
        Self { texel, len: 1, least: weight, most: weight, sum: weight }
    }

    /// Returns the run with one more pixel; `None` if the texel of the pixel differs, or its weight by too much.
    fn with(&self, texel: u32, &Pixel { weight, solid_angle, .. }: &Pixel) -> Option<Self> {
        let (least, most, sum) = (self.least.min(weight), self.most.max(weight), self.sum + weight);
        let mean = sum / (self.len + 1) as f64;
        let alike = (most - mean).max(mean - least) <= WEIGHT_ERROR * libm::sqrt(solid_angle) * mean;
        let fits = texel == self.texel && self.len < MAX_RUN && alike;
        fits.then_some(Self { len: self.len + 1, least, most, sum, ..*self })
    }
}

/// Calls `take` with every run and its mean weight, row by row.
pub(super) fn visit_runs(lens: &Lens, image: ImageSize, order: u8, mut take: impl FnMut(Run, f64)) {
    let below = Domain::Hemisphere.quads(order) as u32;
    let mut take = |run: GrowingRun| take(Run::new(run.texel, run.len), run.sum / run.len as f64);
    for row in 0..image.height {
        let (mut growing, mut place) = (None::<GrowingRun>, 0);
        visit(lens, row, span(lens, image.width, row), |pixel| {
            let above = pixel.direction.z > 0.0;
            let texel = if above { healpix::ipix(order, pixel.direction) } else { below };
            let longer = growing.filter(|_| place % CHUNK > 0).and_then(|run| run.with(texel, &pixel));
            if longer.is_none() {
                growing.into_iter().for_each(&mut take);
            }
            growing = longer.or(Some(GrowingRun::of(texel, pixel.weight)));
            place += 1;
        });
        growing.into_iter().for_each(&mut take);
    }
}

/// Measures the centroid and the unseen solid angle of texel `ipix` of the hemisphere.
pub(super) fn measure(lens: &Lens, image: ImageSize, order: u8, ipix: u32) -> Texel {
    let inside = |p: DVec2| {
        let within = |v: f64, n: u32| v >= -0.5 && v <= f64::from(n) - 0.5;
        within(p.x, image.width) && within(p.y, image.height)
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
