//! The processing thread allocates nothing per frame after the first frames.

#![cfg(feature = "server")]
#![allow(unsafe_code, reason = "a global allocator cannot be written without it")]

use hemilux::pipeline::Settings;
use hemilux::probe::compare::Contender;
use hemilux::probe::{Config, Worker};
use hemilux::scene;
use hemilux::source::{Pace, ReplaySource, SceneSource, Source};
use hemilux_core::Extrapolation;
use hemilux_core::SamplerKind;
use hemilux_core::mains::Lamps;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

/// An allocator that forwards requests to the system's allocator and counts those of each thread.
struct Counting;

thread_local! {
    static REQUESTS: Cell<u64> = const { Cell::new(0) };
}

fn count() {
    // A thread that is ending has no counter and is not measured.
    let _ = REQUESTS.try_with(|n| n.set(n.get() + 1));
}

// SAFETY: every method passes its arguments to `System` unchanged; the counter is a thread-local number that needs no memory.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller fulfils the contract of `GlobalAlloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller fulfils the contract of `GlobalAlloc`.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        // SAFETY: the caller fulfils the contract of `GlobalAlloc`.
        unsafe { System.realloc(pointer, layout, size) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller fulfils the contract of `GlobalAlloc`.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Number of frames after which all memory is allocated: each of the four published sets has been used.
const WARM_UP: usize = 6;
const FRAMES: usize = 60;

/// Returns the number of allocations on this thread during [`FRAMES`] frames, while a client holds some sets and waits for others.
fn requests(source: Box<dyn Source>, sampler: SamplerKind, secondary: Option<SamplerKind>) -> u64 {
    // Without the removal of flicker, since the merge's tables are rebuilt once when the switching lamps of the scene are taken for flicker.
    let lamps = Lamps::Off;
    let pipeline = Settings { sampler, lamps, extrapolation: Extrapolation::Average, ..Settings::default() };
    let mut worker =
        Worker::try_new(source, "test".into(), Config { pipeline, ..Config::steady() }).expect("a worker");
    let link = worker.link();
    let mut client = link.sets().subscribe();
    let _permit = secondary.map(|sampler| {
        link.comparison().ask(Contender { sampler, lights: 48, soft: false }).expect("a permit")
    });
    let pairs = link.comparison().pairs();
    for _ in 0..WARM_UP {
        worker.step().expect("a frame");
    }
    let before = REQUESTS.get();
    let mut held = None;
    for frame in 0..FRAMES {
        worker.step().expect("a frame");
        if frame % 7 == 0 {
            held.clone_from(&client.borrow_and_update());
        }
    }
    let requests = REQUESTS.get() - before;
    let last = client.borrow().clone().expect("a set");
    assert_eq!(last.frame, (WARM_UP + FRAMES - 1) as u64, "every frame was published");
    assert!(!last.lights.is_empty() && held.is_some(), "with lights");
    let pair = pairs.borrow().clone();
    let pair = pair.as_ref().map(|p| (p.first.frame, p.second.set.frame, p.second.set.sampler.as_str()));
    let expected = secondary.map(|kind| (last.frame, last.frame, kind.name()));
    assert_eq!(pair, expected, "the requested pair of the last frame");
    requests
}

#[test]
fn the_allocator_counts_a_vector() {
    let before = REQUESTS.get();
    drop(std::hint::black_box(vec![1u8; 100]));
    assert!(REQUESTS.get() > before, "one vector, one request");
}

#[test]
fn no_sampler_allocates_per_frame() {
    for name in SamplerKind::ALL {
        let scene = scene::by_name("lamps").expect("a scene");
        let source = Box::new(SceneSource::new(scene, Pace::Free));
        assert_eq!(requests(source, name, None), 0, "{name}");
    }
}

#[test]
fn no_comparison_allocates_per_frame() {
    for name in SamplerKind::ALL {
        let scene = scene::by_name("lamps").expect("a scene");
        let source = Box::new(SceneSource::new(scene, Pace::Free));
        assert_eq!(requests(source, SamplerKind::Q2Tree, Some(name)), 0, "{name}");
    }
}

#[test]
fn a_replay_does_not_allocate_per_frame() {
    let folder = tempfile::tempdir().expect("a folder");
    for (file, code) in [("a.png", 60u8), ("b.png", 180)] {
        let image = image::RgbImage::from_pixel(64, 64, image::Rgb([code; 3]));
        image.save(folder.path().join(file)).expect("an image");
    }
    let manifest = "version = 1\n[lens]\nmodel = \"equidistant\"\ncentre = [31.5, 31.5]\nfocal = [22.0, 22.0]\n\
        max_angle_deg = 80.0\n[response]\nmodel = \"srgb\"\nscale = 1.0\n[[frame]]\nfile = \"a.png\"\nexposure_s = 0.01\n\
        [[frame]]\nfile = \"b.png\"\nexposure_s = 0.04\n";
    std::fs::write(folder.path().join("burst.toml"), manifest).expect("a manifest");
    let source = Box::new(ReplaySource::open(folder.path(), Pace::Free).expect("a recording"));
    assert_eq!(requests(source, SamplerKind::Q2Tree, None), 0, "replay");
}
