//! The core allocates no heap memory: a counting allocator stays at zero from burst to bytes for a hundred frames.
#![allow(unsafe_code, reason = "a global allocator cannot be written without")]

#[path = "all/common/mod.rs"]
mod common;

use common::{VecQ2Tree, bench_lens, dark, pixel_table};
use core::cell::Cell;
use hemilux_core::Order;
use hemilux_core::Samples;
use hemilux_core::format::{self, Format};
use hemilux_core::healpix::Domain;
use hemilux_core::internals;
use hemilux_core::light::Light;
use hemilux_core::polar::{Grid, LatLong, PolarTable, Share, shares_len};
use hemilux_core::sampler::pharr::{self, Pharr};
use hemilux_core::sampler::q2tree::Parameters;
use hemilux_core::sampler::{Map, Request, Sampler};
use hemilux_core::wire::{self, LightSet};
use std::alloc::{GlobalAlloc, Layout, System};

thread_local! {
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

/// The system allocator with a counter of allocations per thread.
struct Counting;

// SAFETY: every call goes to the system's allocator unchanged; the counter is a plain thread-local without a destructor.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: the caller's contract is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, p: *mut u8, layout: Layout) {
        // SAFETY: the caller's contract is passed on.
        unsafe { System.dealloc(p, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

const ORDER: u8 = 5;
const LIGHTS: usize = 64;

fn q2tree(parameters: Parameters) -> VecQ2Tree {
    common::q2tree(parameters, Domain::Hemisphere, ORDER, LIGHTS)
}

#[test]
fn a_hundred_frames_allocate_nothing() {
    let pixel_table = pixel_table(&bench_lens(), 640, 480, ORDER);
    let (merge, view) = (common::one_exposure(), pixel_table.view());
    let layout = format::Layout::tight(Format::Rgb48, 640, 480).expect("a sound size");
    let mut map = dark(Domain::Hemisphere, ORDER);
    let shares = vec![Share::default(); shares_len(&Grid::POLAR, Order::saturating(ORDER))];
    let polar_plan =
        PolarTable::try_new(&Grid::POLAR, Order::saturating(ORDER), shares).expect("room enough");
    let mut polar = LatLong::try_new(Grid::POLAR, vec![[0.0; 3]; Grid::POLAR.len()]).expect("room enough");
    let memory = pharr::Memory {
        conditional: vec![0.0; Grid::POLAR.len()],
        marginal: vec![0.0; Grid::POLAR.height],
        lights: vec![Light::default(); LIGHTS],
    };
    let mut pharr = Pharr::try_new(&Grid::POLAR, memory).expect("room");
    let mut trees = [q2tree(Parameters::CENTROID), q2tree(Parameters::JITTER)];
    let mut frame: Vec<u16> =
        (0..3 * 640 * 480u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 17) as u16).collect();
    let mut bytes = vec![0; 1 << 16];
    let request = Request::of_lights(LIGHTS);

    let mut written = 0;
    let before = ALLOCATIONS.get();
    for n in 0..100 {
        frame[n * 997..n * 997 + 3000].fill(60_000);
        let frames = [Samples::U16(&frame)];
        let seen = internals::burst(&frames, &layout, &merge.view(), &view, [1.0; 3], &mut map);
        let seen = seen.expect("a frame that fits");
        internals::average(&mut map, pixel_table.texels());
        polar.fill(&polar_plan, &map.view());
        let map = Map { pyramid: map.view(), polar: polar.view() };
        let samplers: [&mut dyn Sampler; 3] = {
            let [a, b] = &mut trees;
            [&mut pharr, a, b]
        };
        for sampler in samplers {
            let name = sampler.kind().name();
            let lights = sampler.update(&map, &request).lights;
            let set = LightSet { sampler: name, lights, unseen: seen.unseen as f32, ..LightSet::EMPTY };
            wire::json(&set, &mut &mut bytes[..]).expect("room enough");
            wire::text(&set, &mut &mut bytes[..]).expect("room enough");
            wire::xml(&set, &mut &mut bytes[..]).expect("room enough");
            written += lights.len();
        }
    }
    assert_eq!(ALLOCATIONS.get() - before, 0, "allocations in 100 frames");
    assert!(written >= 100 * 3 * (LIGHTS - 1), "{written}");
}

#[test]
fn allocation_counter_counts() {
    let before = ALLOCATIONS.get();
    drop(core::hint::black_box(vec![1u8; 100]));
    assert_eq!(ALLOCATIONS.get() - before, 1);
}
