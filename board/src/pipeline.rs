//! The core's stages in one place, with memory from the heap: burst in, lights out.
//!
//! All memory is taken when the pipeline is made or its exposures change; a frame allocates nothing.

use crate::calibration::{Burst, Calibration};
use crate::samplers::{self, SamplerError, Shape};
use hemilux_core::fill::{self, Extrapolation};
use hemilux_core::front::{Front, FrontError, Seen, sums_len};
use hemilux_core::healpix::Domain;
use hemilux_core::light::Decomposition;
use hemilux_core::merge::{Exposure, MAX_EXPOSURES, Merge, MergeError, Samples, reciprocals_len};
use hemilux_core::plan::{Cell, Plan, PlanError, Span, Texel, plan_size};
use hemilux_core::polar::{Grid, LatLong, LatLongView, PolarPlan, Share, shares_len};
use hemilux_core::pyramid::{Pyramid, Quad, pyramid_len};
use hemilux_core::response::{Curve, ResponseError, curve_len};
use hemilux_core::sampler::{Map, Request, Sampler};
use hemilux_core::wire::Latency;
use std::time::Instant;

/// What a user chooses.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Name of the sampler.
    pub sampler: String,
    /// Most lights.
    pub lights: usize,
    /// The shadowed error that the fewest possible lights are to reach; `adaptive` alone.
    pub tolerance: Option<f32>,
    /// Spherical harmonics for what has no direction; `adaptive` alone.
    pub ambient: bool,
    /// What stands for the unseen part of the hemisphere.
    pub extrapolation: Extrapolation,
    /// Shape of the polar map.
    pub grid: Grid,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            sampler: "adaptive".into(),
            lights: 64,
            tolerance: None,
            ambient: false,
            extrapolation: Extrapolation::None,
            grid: Grid::POLAR,
        }
    }
}

impl Settings {
    /// What is asked of the sampler.
    #[must_use]
    pub fn request(&self) -> Request {
        Request { lights: self.lights, tolerance: self.tolerance, ambient: self.ambient }
    }
}

/// Why a pipeline could not be made or a burst not be processed.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum PipelineError {
    /// The response cannot be tabulated.
    #[error("response: found {0}, expected a rising curve and a white level above black")]
    Response(ResponseError),
    /// The exposures do not merge.
    #[error("exposures: found {0}, expected up to twelve positive times at most 2^24 apart")]
    Merge(MergeError),
    /// The lens does not fit the image.
    #[error("lens: found {0}, expected an image circle on the sensor whose pixels fill the map")]
    Plan(PlanError),
    /// No such sampler.
    #[error(transparent)]
    Sampler(#[from] SamplerError),
    /// Frames that do not fit.
    #[error("burst: found {0}, expected frames as calibrated")]
    Front(FrontError),
}

/// A hemisphere map and what samples it.
pub struct Pipeline {
    calibration: Calibration,
    settings: Settings,
    exposures: Vec<Exposure>,
    merge: Merge<Vec<i32>, Vec<u32>>,
    plan: Plan<Vec<Span>, Vec<Cell>, Vec<Texel>>,
    front: Front<Vec<[i64; 3]>>,
    pyramid: Pyramid<Vec<Quad>>,
    polar: LatLong<Vec<[f32; 3]>>,
    polar_plan: PolarPlan<Vec<Share>>,
    /// Whether `polar` holds the current frame.
    polar_fresh: bool,
    sampler: Box<dyn Sampler + Send>,
}

/// One processed burst.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Processed<'a> {
    /// The lights.
    pub decomposition: Decomposition<'a>,
    /// What the burst held besides.
    pub seen: Seen,
    /// Sum of L dOmega.
    pub scalar_flux: [f32; 3],
    /// Sum of L cos(theta) dOmega.
    pub horizontal_irradiance: [f32; 3],
    /// `front`, `pyramid`, `sample` and `total`; the rest is the caller's.
    pub latency: Latency,
}

impl Pipeline {
    /// Takes all memory and builds the plans.
    ///
    /// # Errors
    /// [`PipelineError`].
    pub fn try_new(
        calibration: Calibration,
        exposures: &[Exposure],
        settings: Settings,
    ) -> Result<Self, PipelineError> {
        let order = samplers::order_for(settings.lights);
        let shape = Shape { domain: Domain::Hemisphere, order, grid: settings.grid };
        samplers::check(&settings.sampler, Domain::Hemisphere, &settings.request())?;
        let sampler = samplers::make(&settings.sampler, &shape, settings.lights)?;
        let merge = merge(&calibration, exposures)?;
        let plan = plan(&calibration, order)?;
        let sums = vec![[0; 3]; sums_len(plan.source_order())];
        let front = Front::try_new(sums, plan.source_order()).expect("as many sums as the front names");
        let quads = vec![Quad::default(); pyramid_len(Domain::Hemisphere, order)];
        let pyramid =
            Pyramid::try_new(quads, Domain::Hemisphere, order).expect("as many quads as the pyramid names");
        let texels = vec![[0.0; 3]; settings.grid.len()];
        let polar = LatLong::try_new(settings.grid, texels).expect("as many texels as the grid has");
        let shares = vec![Share::default(); shares_len(&settings.grid, order)];
        let polar_plan =
            PolarPlan::try_new(&settings.grid, order, shares).expect("as many shares as the plan names");
        let exposures = exposures.to_vec();
        let polar_fresh = false;
        Ok(Self {
            calibration,
            settings,
            exposures,
            merge,
            plan,
            front,
            pyramid,
            polar,
            polar_plan,
            polar_fresh,
            sampler,
        })
    }

    /// Changes what the user chose, keeping what need not change; on an error the old settings stand.
    ///
    /// # Errors
    /// [`PipelineError`].
    pub fn configure(&mut self, settings: Settings) -> Result<(), PipelineError> {
        let same_maps = samplers::order_for(settings.lights) == self.pyramid.view().order()
            && settings.grid == self.settings.grid;
        if !same_maps {
            *self = Self::try_new(self.calibration.clone(), &self.exposures, settings)?;
            return Ok(());
        }
        samplers::check(&settings.sampler, Domain::Hemisphere, &settings.request())?;
        if settings.sampler != self.settings.sampler || settings.lights != self.settings.lights {
            self.sampler = samplers::make(&settings.sampler, &self.shape(), settings.lights)?;
        }
        self.settings = settings;
        Ok(())
    }

    fn shape(&self) -> Shape {
        let order = self.pyramid.view().order();
        Shape { domain: Domain::Hemisphere, order, grid: self.settings.grid }
    }

    /// Processes one burst.
    ///
    /// # Errors
    /// [`PipelineError`] when the frames do not fit the calibration; the last map stands.
    pub fn process(&mut self, burst: &Burst) -> Result<Processed<'_>, PipelineError> {
        let began = Instant::now();
        self.follow_exposures(burst)?;
        let mut frames = [Samples::U8(&[]); MAX_EXPOSURES];
        for (slot, frame) in frames.iter_mut().zip(&burst.frames) {
            *slot = frame.pixels.samples();
        }
        let frames = &frames[..burst.frames.len().min(MAX_EXPOSURES)];
        let balance = self.calibration.white_balance;
        let seen = self
            .front
            .burst(frames, &self.merge, &self.plan, balance, &mut self.pyramid)
            .map_err(PipelineError::Front)?;
        let front = began.elapsed();
        self.pyramid.build();
        if self.settings.extrapolation == Extrapolation::Average {
            fill::average(&mut self.pyramid, self.plan.texels());
        }
        self.polar_fresh = self.sampler.needs_polar();
        if self.polar_fresh {
            self.polar.fill(&self.polar_plan, &self.pyramid.view());
        }
        let summed = began.elapsed();
        let view = self.pyramid.view();
        let (total, horizontal_irradiance) = (view.total(), view.horizontal_irradiance());
        let polar = if self.polar_fresh { self.polar.view() } else { LatLongView::NONE };
        let map = Map { pyramid: view, polar };
        let decomposition = self.sampler.update(&map, &self.settings.request());
        let done = began.elapsed();
        let us = |d: std::time::Duration| u32::try_from(d.as_micros()).unwrap_or(u32::MAX);
        let latency = Latency {
            front: us(front),
            pyramid: us(summed - front),
            sample: us(done - summed),
            total: us(done),
            ..Latency::default()
        };
        Ok(Processed { decomposition, seen, scalar_flux: total.rgb(), horizontal_irradiance, latency })
    }

    /// Rebuilds the merge when a burst comes with other exposures.
    fn follow_exposures(&mut self, burst: &Burst) -> Result<(), PipelineError> {
        let same = self.exposures.iter().eq(burst.frames.iter().map(|f| &f.exposure));
        if !same {
            let exposures: Vec<_> = burst.frames.iter().map(|f| f.exposure).collect();
            self.merge = merge(&self.calibration, &exposures)?;
            self.exposures = exposures;
        }
        Ok(())
    }

    /// What the user chose.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// What is known of the camera.
    #[must_use]
    pub fn calibration(&self) -> &Calibration {
        &self.calibration
    }

    /// The merge of the current exposures.
    #[must_use]
    pub fn merge(&self) -> &Merge<Vec<i32>, Vec<u32>> {
        &self.merge
    }

    /// The plan of the current lens.
    #[must_use]
    pub fn plan(&self) -> &Plan<Vec<Span>, Vec<Cell>, Vec<Texel>> {
        &self.plan
    }

    /// The map of the last burst, before sampling.
    pub fn map(&mut self) -> Map<'_> {
        if !self.polar_fresh {
            self.polar.fill(&self.polar_plan, &self.pyramid.view());
            self.polar_fresh = true;
        }
        Map { pyramid: self.pyramid.view(), polar: self.polar.view() }
    }
}

fn merge(
    calibration: &Calibration,
    exposures: &[Exposure],
) -> Result<Merge<Vec<i32>, Vec<u32>>, PipelineError> {
    let c = calibration;
    let depth = c.format.depth();
    let table = vec![0; curve_len(depth)];
    let curve =
        Curve::try_new(&c.response, depth, c.black, c.white, table).map_err(PipelineError::Response)?;
    let reciprocals = vec![0; reciprocals_len(exposures.len().min(MAX_EXPOSURES))];
    Merge::try_new(curve, exposures, c.scale, reciprocals).map_err(PipelineError::Merge)
}

type HeapPlan = Plan<Vec<Span>, Vec<Cell>, Vec<Texel>>;

fn plan(calibration: &Calibration, order: u8) -> Result<HeapPlan, PipelineError> {
    let c = calibration;
    let size = plan_size(&c.lens, c.width, c.height, order).map_err(PipelineError::Plan)?;
    let buffers = (
        vec![Span::default(); size.spans],
        vec![Cell::default(); size.cells],
        vec![Texel::default(); size.texels],
    );
    Plan::try_new(&c.lens, c.width, c.height, order, buffers).map_err(PipelineError::Plan)
}
