//! What a probe takes of memory, buffer by buffer.

use crate::calibration::Calibration;
use crate::pipeline::Pipeline;
use crate::probe::compare;
use crate::samplers::{self, NAMES, Shape, Tuning};
use hemilux_core::Order;
use hemilux_core::healpix::Domain;
use hemilux_core::light::Light;
use hemilux_core::merge::Reciprocal;
use hemilux_core::plan::{Run, Span, Texel};
use hemilux_core::polar::{Grid, Share, shares_len};
use hemilux_core::pyramid::{Quad, pyramid_len};
use hemilux_core::response::curve_len;
use hemilux_core::sampler::hemigon::inversion::{Ring, rings_len};
use hemilux_core::sampler::hemigon::{self, fir, kalman};
use hemilux_core::sampler::{adaptive, q2tree};
use std::fmt;

/// One buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Room {
    /// What it holds.
    pub name: &'static str,
    /// Elements.
    pub count: usize,
    /// Bytes of an element.
    pub size: usize,
}

impl Room {
    fn of<T>(name: &'static str, count: usize) -> Self {
        Self { name, count, size: size_of::<T>() }
    }

    /// Bytes of all elements.
    #[must_use]
    pub const fn bytes(&self) -> usize {
        self.count * self.size
    }
}

/// The buffers of a pipeline, and the numbers that they follow from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plan {
    width: u32,
    height: u32,
    exposures: usize,
    lights: usize,
    /// Order of the map.
    order: u8,
    /// Order at which pixels are added up.
    source_order: u8,
    rooms: Vec<Room>,
    /// What a comparison takes besides while a client asks for one, at most.
    comparison: usize,
}

/// Lights that every sampler can give: their state does not depend on them.
const SMALL: usize = 12;

impl Plan {
    /// The buffers of `pipeline` and its sampler.
    #[must_use]
    pub fn of(pipeline: &Pipeline) -> Self {
        let (c, s) = (pipeline.calibration(), pipeline.settings());
        let plan = pipeline.plan();
        let (size, merge) = (plan.size(), pipeline.merge().size());
        let (order, exposures) = (plan.order(), pipeline.merge().exposures());
        let mut rooms = vec![
            frames(c, exposures),
            Room::of::<i32>("response table", curve_len(pipeline.merge().depth())),
            Room::of::<u32>("exposure tables", merge.tables),
            Room::of::<Reciprocal>("reciprocals", merge.reciprocals),
            Room::of::<Span>("spans", size.spans),
            Room::of::<u16>("weights", size.weights),
            Room::of::<Run>("runs", size.runs),
            Room::of::<Texel>("texels", size.texels),
            Room::of::<Quad>("pyramid", pyramid_len(Domain::Hemisphere, Order::saturating(order))),
            Room::of::<Light>("published lights", 4 * s.lights),
        ];
        rooms.push(Room { name: "sampler: state", count: 1, size: pipeline.sampler_bytes() });
        rooms.extend(sampler(&s.sampler, order, &s.grid, s.lights, &s.tuning));
        if pipeline.needs_polar() {
            rooms.push(Room::of::<[f32; 3]>("polar map", s.grid.len()));
            rooms.push(Room::of::<Share>(
                "polar shares",
                shares_len(&s.grid, Order::saturating(samplers::polar_order(order))),
            ));
        }
        let source_order = plan.source_order();
        let comparison = comparison(&pipeline.shape(), &s.tuning, pipeline.needs_polar());
        let (width, height) = (c.width, c.height);
        Self { width, height, exposures, lights: s.lights, order, source_order, rooms, comparison }
    }

    /// The buffers, the frames first.
    #[must_use]
    pub fn rooms(&self) -> &[Room] {
        &self.rooms
    }

    /// Bytes of all buffers.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.rooms.iter().map(Room::bytes).sum()
    }
}

/// What `/v1/compare` takes at most: the sampler that takes most, its sets, and the polar map where the first sampler does without.
fn comparison(shape: &Shape, tuning: &Tuning, has_polar: bool) -> usize {
    let Shape { order, grid, .. } = shape;
    let state = |name: &str| samplers::make(name, shape, SMALL).map_or(0, |sampler| size_of_val(&*sampler));
    let of = |name: &&str| {
        let rooms = sampler(name, *order, grid, compare::MOST_LIGHTS, tuning);
        state(name) + rooms.iter().map(Room::bytes).sum::<usize>()
    };
    let polar = grid.len() * size_of::<[f32; 3]>()
        + shares_len(grid, Order::saturating(samplers::polar_order(*order))) * size_of::<Share>();
    NAMES.iter().map(of).max().unwrap_or(0) + compare::bytes(*order) + if has_polar { 0 } else { polar }
}

/// What [`crate::samplers::make_tuned`] takes.
fn sampler(name: &str, order: u8, grid: &Grid, lights: usize, tuning: &Tuning) -> Vec<Room> {
    let domain = Domain::Hemisphere;
    let few = lights.min(hemigon::MAX_LIGHTS);
    let inversion = || {
        vec![
            Room::of::<f32>("sampler: rows", grid.len()),
            Room::of::<Ring>("sampler: rings", rings_len(grid)),
            Room::of::<u32>("sampler: slots", 2 * few),
            Room::of::<Light>("sampler: lights", few),
        ]
    };
    match name {
        "pharr" => {
            vec![Room::of::<f32>("sampler: rows", grid.len()), Room::of::<Light>("sampler: lights", lights)]
        }
        "hemigon" => [inversion(), vec![Room::of::<kalman::Track>("sampler: tracks", 2 * few)]].concat(),
        "hemigon-fir" => {
            let taps = fir::Kernel::new(&tuning.fir()).weights().len();
            [inversion(), vec![Room::of::<glam::Vec3>("sampler: paths", 2 * few * taps)]].concat()
        }
        "adaptive" => vec![
            Room::of::<u8>("sampler: bits", 2 * adaptive::bits_len(domain, Order::saturating(order))),
            Room::of::<adaptive::Leaf>("sampler: heap", lights),
            Room::of::<Light>("sampler: lights", 2 * lights),
            Room::of::<adaptive::Track>("sampler: tracks", 2 * lights),
        ],
        _ => vec![
            Room::of::<u8>("sampler: bits", 2 * q2tree::interior_len(domain, Order::saturating(order))),
            Room::of::<q2tree::Leaf>("sampler: heap", lights),
            Room::of::<Light>("sampler: lights", lights),
            Room::of::<q2tree::Past>("sampler: past", lights),
        ],
    }
}

fn frames(c: &Calibration, exposures: usize) -> Room {
    let bytes = c.layout().map_or(0, |layout| layout.frame_bytes());
    Room::of::<u8>("frames", bytes * exposures)
}

impl fmt::Display for Plan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "image             {} x {}, {} exposures", self.width, self.height, self.exposures)?;
        writeln!(f, "map order         {} (pixels add up at order {})", self.order, self.source_order)?;
        writeln!(f, "lights            {}", self.lights)?;
        writeln!(f, "\n{:<17} {:>10} {:>6} {:>12}", "buffer", "elements", "bytes", "in all")?;
        for room in &self.rooms {
            writeln!(f, "{:<17} {:>10} {:>6} {:>12}", room.name, room.count, room.size, room.bytes())?;
        }
        writeln!(f, "{:<17} {:>30}", "sum, bytes", self.bytes())?;
        writeln!(f, "{:<17} {:>30}", "comparison", format!("at most {}", self.comparison))
    }
}
