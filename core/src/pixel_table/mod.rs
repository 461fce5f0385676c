//! The pixel table: for each image pixel, the HEALPix texel that receives its light and the weight of that light.
//!
//! The table is computed once per calibration; the front end walks through it for each burst. The solid angle of every pixel whose centre
//! lies inside the image circle of the lens goes to exactly one texel, so the sum over the texels equals the sum over the pixels.
//! Neighbouring pixels of a row with the same texel form a run and share their mean weight, as long as no weight differs by more than 0.25
//! % from that mean. Light is accumulated at the source order: the finest HEALPix order whose texels are at least 2.25 times as large as
//! the largest pixel. A map of a finer order divides each sum among the descendants of the texel.

mod visit;

use crate::buffer::{self, Buffer, TooSmall};
use crate::format::ImageSize;
use crate::healpix::Domain;
use crate::lens::Lens;
use bytemuck::{Pod, Zeroable};
use visit::{measure, span, survey, visit_runs};

/// The columns of one image row that lie inside the image circle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Span {
    /// Index of the first column inside of the image circle.
    pub first: u32,
    /// Number of columns inside of the image circle.
    pub len: u32,
}

/// Largest number of pixels in one call of the merge: their codes and radiances take a few KB, less than any first-level cache.
pub(crate) const CHUNK: usize = 192;

/// Largest number of pixels in a run: the sum of 16 counts of [`crate::merge::COUNT_BITS`] bits fits 32 bits.
pub(crate) const MAX_RUN: usize = 16;

/// A run: adjacent pixels of one row whose light is added to one texel of the source order. The texel index one past the last texel
/// collects light from below the horizon. A run never crosses from one block of 192 pixels of its span to the next.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(transparent)]
pub struct Run(u32);

impl Run {
    pub(crate) fn new(texel: u32, len: usize) -> Self {
        Self(texel << 8 | len as u32)
    }

    /// Returns the index of the run's texel, below 2^24.
    #[must_use]
    pub const fn texel(self) -> usize {
        (self.0 >> 8) as usize
    }

    /// Returns the number of pixels of the run, at most 16.
    #[must_use]
    pub const fn len(self) -> usize {
        (self.0 & 255) as usize
    }

    /// Returns whether the run has no pixels.
    #[must_use]
    pub const fn is_empty(self) -> bool {
        self.len() == 0
    }
}

/// Geometry of one texel of the map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Texel {
    /// Unit vector towards the centroid of the part of the texel that lies in the hemisphere.
    pub direction: [f32; 3],
    /// Solid angle, steradians, of the part of the texel that lies in the hemisphere and outside of the field of view.
    pub unseen_sr: f32,
}

/// The reason why a pixel table cannot be built.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum PixelTableError {
    /// The image has no pixels, or more than 2^26.
    BadSize,
    /// No pixel of the image lies inside the image circle of the lens.
    NothingSeen,
    /// An order above 10, or pixels that are larger than the texels of order 0.
    BadOrder,
    /// A lent buffer has too few elements.
    TooSmall(TooSmall),
}

impl core::fmt::Display for PixelTableError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::BadSize => write!(f, "an image without pixels or with more than 67108864"),
            Self::NothingSeen => write!(f, "a lens whose image circle has no pixel on the sensor"),
            Self::BadOrder => write!(f, "a map order that the image cannot fill"),
            Self::TooSmall(e) => e.fmt(f),
        }
    }
}

impl core::error::Error for PixelTableError {}

/// The pixel table of one lens, image size and map order, in buffers that the caller lends.
#[derive(Clone, Debug)]
pub struct PixelTable<S, W, R, T> {
    buffers: Buffers<S, W, R, T>,
    numbers: Numbers,
}

/// The scalar values of a pixel table, such as sizes and sums.
#[derive(Clone, Copy, Debug)]
struct Numbers {
    image: ImageSize,
    order: u8,
    source_order: u8,
    weight_unit: f64,
    weight_sum: u64,
    heaviest_texel: u32,
    unseen: f64,
    size: PixelTableSize,
}

/// The buffers of a pixel table; their lengths are in [`PixelTableSize`].
#[derive(Clone, Copy, Debug)]
pub struct Buffers<S, W, R, T> {
    /// One [`Span`] per image row.
    pub spans: S,
    /// One weight per run.
    pub weights: W,
    /// One [`Run`] per run.
    pub runs: R,
    /// One [`Texel`] per texel of the map.
    pub texels: T,
}

/// The buffers of a pixel table in borrowed memory.
pub(crate) type BorrowedBuffers<'a> = Buffers<&'a [Span], &'a [u16], &'a [Run], &'a [Texel]>;

/// The scalar values of a pixel table, without its buffers.
#[derive(Clone, Debug)]
pub(crate) struct Detached {
    numbers: Numbers,
}

impl Detached {
    /// Combines the scalar values with `buffers`, which must be the buffers of the table from which they were taken.
    pub(crate) fn over<'a>(&self, buffers: BorrowedBuffers<'a>) -> PixelTableView<'a> {
        let Numbers { image, order, source_order, weight_unit, weight_sum, heaviest_texel, unseen, size } =
            self.numbers;
        PixelTableView {
            image,
            order,
            source_order,
            spans: buffers.spans.get(..size.spans).unwrap_or_default(),
            weights: buffers.weights.get(..size.weights).unwrap_or_default(),
            runs: buffers.runs.get(..size.runs).unwrap_or_default(),
            texels: buffers.texels.get(..size.texels).unwrap_or_default(),
            weight_unit,
            weight_sum,
            heaviest_texel,
            unseen,
        }
    }

    pub(crate) fn size(&self) -> PixelTableSize {
        self.numbers.size
    }

    pub(crate) fn source_order(&self) -> u8 {
        self.numbers.source_order
    }
}

/// A borrowed pixel table: the input of the front end for each burst.
#[derive(Clone, Copy, Debug)]
pub struct PixelTableView<'a> {
    /// Size of the merged image.
    pub image: ImageSize,
    /// HEALPix order of the map.
    pub order: u8,
    /// Source order: the order at which light is accumulated, at most `order`.
    pub source_order: u8,
    /// The columns inside of the image circle, one span per image row.
    pub spans: &'a [Span],
    /// Weight of each run: mean solid angle of its pixels divided by relative illumination, in units of `weight_unit`.
    pub weights: &'a [u16],
    /// Texel and length of each run, in the order in which its pixels lie in memory.
    pub runs: &'a [Run],
    /// Geometry of each texel of the map, at `order`.
    pub texels: &'a [Texel],
    /// Solid angle per unit of weight, steradians.
    pub weight_unit: f64,
    /// Sum of the weights of all pixels, in units of `weight_unit`.
    pub weight_sum: u64,
    /// Largest sum of the pixel weights of one texel, in units of `weight_unit`.
    pub heaviest_texel: u32,
    /// Fraction of the hemisphere's solid angle outside of the field of view, 0..=1.
    pub unseen: f64,
}

/// Number of elements of each buffer of a pixel table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PixelTableSize {
    /// Number of image rows.
    pub spans: usize,
    /// Number of weights: one per run.
    pub weights: usize,
    /// Number of runs of adjacent pixels with a common texel and weight.
    pub runs: usize,
    /// Number of texels of the map.
    pub texels: usize,
}

/// Computes the buffer lengths of [`PixelTable::try_new`]. Takes as long as building the table.
///
/// # Errors
/// [`PixelTableError`] if no pixel is inside the image circle, or the image size or `order` is out of range.
pub fn pixel_table_size(lens: &Lens, image: ImageSize, order: u8) -> Result<PixelTableSize, PixelTableError> {
    check(image, order)?;
    let survey = survey(lens, image)?;
    let source_order = survey.source_order(order)?;
    let mut runs = 0;
    visit_runs(lens, image, source_order, |_, _| runs += 1);
    let texels = Domain::Hemisphere.quads(order);
    Ok(PixelTableSize { spans: image.height as usize, weights: runs, runs, texels })
}

/// Checks the number of pixels of `image` and the range of `order`.
pub(crate) fn check(image: ImageSize, order: u8) -> Result<(), PixelTableError> {
    let pixels = u64::from(image.width) * u64::from(image.height);
    if pixels == 0 || pixels > 1 << 26 {
        return Err(PixelTableError::BadSize);
    }
    if order > 10 { Err(PixelTableError::BadOrder) } else { Ok(()) }
}

impl<S: Buffer<Span>, W: Buffer<u16>, R: Buffer<Run>, T: Buffer<Texel>> PixelTable<S, W, R, T> {
    /// Builds the pixel table of an image of size `image`, formed by `lens`, for a hemisphere map of `order`.
    ///
    /// # Errors
    /// [`PixelTableError`]; [`pixel_table_size`] returns the length of each buffer.
    pub fn try_new(
        lens: &Lens,
        image: ImageSize,
        order: u8,
        buffers: Buffers<S, W, R, T>,
    ) -> Result<Self, PixelTableError> {
        check(image, order)?;
        let survey = survey(lens, image)?;
        let texel_count = Domain::Hemisphere.quads(order);
        buffer::check(&buffers.spans, image.height as usize).map_err(PixelTableError::TooSmall)?;
        buffer::check(&buffers.texels, texel_count).map_err(PixelTableError::TooSmall)?;
        let size = PixelTableSize { spans: image.height as usize, weights: 0, runs: 0, texels: texel_count };
        let numbers = Numbers {
            image,
            order,
            source_order: survey.source_order(order)?,
            weight_unit: survey.heaviest / f64::from(u16::MAX),
            weight_sum: 0,
            heaviest_texel: 0,
            unseen: 0.0,
            size,
        };
        let mut pixel_table = Self { buffers, numbers };
        pixel_table.lay_out(lens);
        let size = pixel_table.numbers.size;
        buffer::check(&pixel_table.buffers.weights, size.weights).map_err(PixelTableError::TooSmall)?;
        buffer::check(&pixel_table.buffers.runs, size.runs).map_err(PixelTableError::TooSmall)?;
        pixel_table.weigh_texels();
        pixel_table.measure_texels(lens);
        Ok(pixel_table)
    }

    /// Writes the spans, runs and weights of the table, and counts the runs.
    fn lay_out(&mut self, lens: &Lens) {
        let Numbers { image, source_order, weight_unit: unit, .. } = self.numbers;
        for (row, slot) in (0..image.height).zip(self.buffers.spans.as_mut()) {
            *slot = span(lens, image.width, row);
        }
        let mut runs = self.buffers.runs.as_mut().iter_mut();
        let mut weights = self.buffers.weights.as_mut().iter_mut();
        let (sum, size) = (&mut self.numbers.weight_sum, &mut self.numbers.size);
        visit_runs(lens, image, source_order, |run, weight| {
            let weight = libm::round(weight / unit) as u16;
            *sum += u64::from(weight) * run.len() as u64;
            runs.next().into_iter().for_each(|slot| *slot = run);
            weights.next().into_iter().for_each(|slot| *slot = weight);
            (size.runs, size.weights) = (size.runs + 1, size.weights + 1);
        });
    }

    /// Computes the largest sum of weights of a texel; the sums are stored in the texels' geometry, which is computed later.
    fn weigh_texels(&mut self) {
        let Buffers { weights, runs, texels, .. } = &mut self.buffers;
        let texels = texels.as_mut();
        texels.iter_mut().for_each(|texel| texel.unseen_sr = 0.0);
        let size = self.numbers.size;
        for (run, weight) in runs.as_ref().iter().zip(weights.as_ref()).take(size.runs) {
            if let Some(texel) = texels.get_mut(run.texel()) {
                texel.unseen_sr += f32::from(*weight) * run.len() as f32;
            }
        }
        // The sums were rounded to 24 bits.
        let heaviest = texels.iter().fold(0.0f32, |most, texel| most.max(texel.unseen_sr));
        self.numbers.heaviest_texel = (1.001 * heaviest) as u32;
    }

    /// Computes the geometry of the texels, and the fraction of the hemisphere outside of the field of view.
    fn measure_texels(&mut self, lens: &Lens) {
        let mut unseen = 0.0;
        let texels = self.buffers.texels.as_mut().get_mut(..self.numbers.size.texels).unwrap_or_default();
        for (ipix, texel) in texels.iter_mut().enumerate() {
            *texel = measure(lens, self.numbers.image, self.numbers.order, ipix as u32);
            unseen += f64::from(texel.unseen_sr);
        }
        self.numbers.unseen = unseen / Domain::Hemisphere.solid_angle();
    }

    /// Borrows the table for the front end.
    #[must_use]
    pub fn view(&self) -> PixelTableView<'_> {
        let Buffers { spans, weights, runs, texels } = &self.buffers;
        let (spans, weights) = (spans.as_ref(), weights.as_ref());
        let (runs, texels) = (runs.as_ref(), texels.as_ref());
        self.detached().over(Buffers { spans, weights, runs, texels })
    }

    /// Returns the scalar values of the table without its buffers.
    pub(crate) fn detached(&self) -> Detached {
        Detached { numbers: self.numbers }
    }

    /// Returns the geometry of the texels of the map, at [`PixelTable::order`].
    #[must_use]
    pub fn texels(&self) -> &[Texel] {
        self.buffers.texels.as_ref().get(..self.numbers.size.texels).unwrap_or_default()
    }

    /// Returns the number of elements in use of each buffer of the table.
    #[must_use]
    pub fn size(&self) -> PixelTableSize {
        self.numbers.size
    }

    /// Returns the number of columns of the merged image.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.numbers.image.width
    }

    /// Returns the number of rows of the merged image.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.numbers.image.height
    }

    /// Returns the HEALPix order of the map.
    #[must_use]
    pub fn order(&self) -> u8 {
        self.numbers.order
    }

    /// Returns the source order: the order at which light is accumulated, at most the order of the map.
    #[must_use]
    pub fn source_order(&self) -> u8 {
        self.numbers.source_order
    }

    /// Returns the fraction of the hemisphere's solid angle outside of the field of view, 0..=1.
    #[must_use]
    pub fn unseen(&self) -> f64 {
        self.numbers.unseen
    }
}
