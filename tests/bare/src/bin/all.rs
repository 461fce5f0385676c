//! Links the functions of the core that the other images do not run, so that `run --panics` can list their panics. Never run.
#![no_std]
#![no_main]

use core::convert::Infallible;
use core::hint::black_box;
use glam::Vec3;
use hemilux_bare as _;
use hemilux_core::harmonics;
use hemilux_core::healpix::Domain;
use hemilux_core::internals;
use hemilux_core::light::Light;
use hemilux_core::polar::{Grid, LatLong, PolarTable};
use hemilux_core::pyramid::Pyramid;
use hemilux_core::sampler::adaptive::{self, Adaptive};
use hemilux_core::sampler::hemigon::Hemigon;
use hemilux_core::sampler::hemigon::fir::{self, Fir};
use hemilux_core::sampler::hemigon::follow::Follow;
use hemilux_core::sampler::hemigon::inversion::Inversion;
use hemilux_core::sampler::hemigon::kalman::{self, Gated};
use hemilux_core::sampler::pharr::{self, Pharr};
use hemilux_core::sampler::q2tree::{Parameters, Q2Tree};
use hemilux_core::sampler::{Map, Request, Sampler};
use hemilux_core::wire::{self, BinarySet, LightSet};
use hemilux_core::{MapShape, Order};
use hemilux_core::{thin, tonemap};

#[cfg_attr(target_abi = "eabihf", cortex_m_rt::entry)]
#[cfg_attr(not(target_abi = "eabihf"), unsafe(no_mangle))]
fn main() -> ! {
    let _ = black_box(maps());
    semihosting::process::exit(0)
}

/// Returns a buffer whose length the compiler cannot determine.
fn lent<T>() -> &'static mut [T] {
    black_box(&mut [])
}

fn maps() -> Option<()> {
    let (domain, order) = black_box((Domain::Hemisphere, Order::saturating(5)));
    let grid = black_box(Grid::POLAR);
    let mut pyramid = Pyramid::try_new(lent(), domain, order).ok()?;
    internals::average(&mut pyramid, lent());
    let table = PolarTable::try_new(&grid, order, lent()).ok()?;
    let mut polar = LatLong::try_new(grid, lent()).ok()?;
    polar.fill(&table, &pyramid.view());
    let map = Map { pyramid: pyramid.view(), polar: polar.view() };
    let memory = pharr::Memory { conditional: lent(), marginal: lent(), lights: lent() };
    run(&map, Pharr::try_new(&grid, memory).ok()?);
    let (parameters, shape) = (black_box(Parameters::JITTER), MapShape { domain, order });
    run(&map, Q2Tree::try_new(parameters, shape, [lent(), lent()], lent(), lent(), lent()).ok()?);
    let memory = adaptive::Memory {
        interior: [lent(), lent()],
        leaves: lent(),
        lights: [lent(), lent()],
        tracks: [lent(), lent()],
        workspace: lent().first_mut()?,
    };
    run(&map, Adaptive::try_new(domain, order, memory).ok()?);
    hemigon(&map, &grid, Gated::try_new(kalman::Parameters::LIGHTS, black_box(9), lent()).ok()?)?;
    hemigon(&map, &grid, Fir::try_new(&fir::Parameters::default(), black_box(9), lent()).ok()?)
}

fn hemigon<F: Follow>(map: &Map<'_>, grid: &Grid, filter: F) -> Option<()> {
    let inversion = Inversion::try_new(grid, lent(), lent()).ok()?;
    run(map, Hemigon::try_new(inversion, filter, lent(), lent()).ok()?);
    Some(())
}

fn run(map: &Map<'_>, mut sampler: impl Sampler) {
    let request = black_box(Request { lights: 9, tolerance: Some(0.1), ambient: true, soft: true });
    let made = sampler.update(map, &request);
    let sh = made.ambient.unwrap_or_default();
    let set = LightSet { lights: made.lights, ambient_sh: Some(&sh), ..black_box(LightSet::EMPTY) };
    write(&set);
    sampler.reset();
}

#[inline(never)]
fn write(set: &LightSet<'_>) {
    let _ = (
        wire::json(set, &mut Sink),
        wire::text(set, &mut Sink),
        wire::xml(set, &mut Sink),
        wire::binary(set, &mut Sink),
    );
    let _ = black_box(wire::estimate(set));
    if let Ok(set) = BinarySet::try_new(lent()) {
        let _ = black_box((set.head(), set.ambient_sh()));
        set.lights().for_each(|l| _ = black_box(l));
    }
    let lights: &mut [Light] = lent();
    let _ = black_box(thin::merge(lights, black_box(9), &mut lent()));
    thin::facing(lights, black_box(Vec3::X), black_box(0.1)).for_each(|l| _ = black_box(*l));
    let _ = black_box((
        tonemap::sigmoid(black_box([1.0; 3]), black_box(1.0)),
        harmonics::basis(black_box(Vec3::X)),
    ));
}

/// A writer that discards its bytes.
struct Sink;

impl embedded_io::ErrorType for Sink {
    type Error = Infallible;
}

impl embedded_io::Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        Ok(bytes.len())
    }

    fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo<'_>) -> ! {
    semihosting::process::exit(101)
}
