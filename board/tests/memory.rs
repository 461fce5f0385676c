//! The memory that `--plan` prints equals the memory that a probe allocates.

#![cfg(feature = "server")]
#![allow(unsafe_code, reason = "a global allocator cannot be written without it")]

use hemilux::memory::MemoryPlan;
use hemilux::pipeline::{Pipeline, Settings};
use hemilux::probe::{Config, Worker};
use hemilux::samplers::buffers;
use hemilux::scene;
use hemilux::source::{Pace, ReplaySource, SceneSource, Source};
use hemilux_core::SamplerKind;
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// An allocator that forwards requests to the system's allocator, sums the bytes that each thread holds, and stores the largest sum.
struct Counting;

thread_local! {
    static BYTES: Cell<isize> = const { Cell::new(0) };
    static MOST: Cell<isize> = const { Cell::new(0) };
}

fn count(bytes: isize) {
    // A thread that is ending has no counter and is not measured.
    let _ = BYTES.try_with(|n| {
        n.set(n.get() + bytes);
        MOST.try_with(|most| most.set(most.get().max(n.get())))
    });
}

// SAFETY: every method passes its arguments to `System` unchanged; the counter is a thread-local number that needs no memory. The methods of the
// trait that are not defined here call these two.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size().cast_signed());
        // SAFETY: the caller fulfils the contract of `GlobalAlloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count(-layout.size().cast_signed());
        // SAFETY: the caller fulfils the contract of `GlobalAlloc`.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Largest memory that a probe allocates in addition to its buffers, bytes: names, settings, histograms of its stages, channels.
const REST: usize = 12 << 10;

/// Number of frames after which all memory is allocated: each of the four published sets has been used.
const WARM_UP: usize = 6;

fn room() -> Box<dyn Source> {
    Box::new(SceneSource::new(scene::by_name("room").expect("a scene"), Pace::Free))
}

fn settings(sampler: SamplerKind, lights: usize) -> Settings {
    Settings { sampler, lights, ..Settings::default() }
}

fn plan(source: &dyn Source, settings: Settings) -> MemoryPlan {
    let pipeline = Pipeline::try_new(*source.calibration(), &source.exposures(), settings);
    MemoryPlan::of(&pipeline.expect("a pipeline"))
}

/// Locks out the other tests: probes of one process share the table of their polar maps.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Asserts that a probe allocates the memory of its plan.
fn check(source: Box<dyn Source>, settings: &Settings) {
    let plan = plan(&*source, settings.clone());
    let planned = plan.bytes();
    let before = BYTES.get();
    let config = Config { pipeline: settings.clone(), ..Config::steady() };
    let mut worker = Worker::try_new(source, "test".into(), config).expect("a worker");
    for _ in 0..WARM_UP {
        worker.step().expect("a frame");
    }
    let taken = usize::try_from(BYTES.get() - before).expect("more than before");
    println!("{}, {} lights: {planned} bytes planned, {taken} taken", settings.sampler, settings.lights);
    let what = format!("{settings:?}: found {taken} bytes taken, expected\n{plan}");
    assert!((planned..=planned + REST).contains(&taken), "{what}");
}

#[test]
fn the_allocator_sums_a_vector() {
    let before = BYTES.get();
    let mut held = vec![1u8; 1000];
    assert_eq!(BYTES.get() - before, 1000, "a vector");
    held.reserve_exact(2000);
    assert_eq!(BYTES.get() - before, 3000, "a larger one");
    drop(std::hint::black_box(held));
    assert_eq!(BYTES.get() - before, 0, "none");
}

#[test]
fn every_sampler_allocates_the_planned_memory() {
    let _alone = alone();
    for name in SamplerKind::ALL {
        check(room(), &settings(name, 200));
    }
    check(room(), &settings(SamplerKind::Adaptive, 4096));
    // The map has a finer order from 256 lights.
    check(room(), &settings(SamplerKind::Q2Tree, 20_000));
}

#[test]
fn recordings_allocate_the_planned_memory() {
    let _alone = alone();
    let manifest = |response: &str, white: u32| {
        format!(
            "version = 1\n[lens]\nmodel = \"equidistant\"\ncentre = [99.5, 99.5]\nfocal = [60.0, 60.0]\nmax_angle_deg = 80.0\n\
             [response]\nmodel = \"{response}\"\nscale = 1.0\n[sensor]\nblack = 0\nwhite = {white}\n\
             [[frame]]\nfile = \"a.png\"\nexposure_s = 0.01\n[[frame]]\nfile = \"b.png\"\nexposure_s = 0.04\n"
        )
    };
    for (response, words) in [("linear", false), ("srgb", false), ("linear", true), ("srgb", true)] {
        let folder = tempfile::tempdir().expect("a folder");
        for (file, code) in [("a.png", 60u8), ("b.png", 180)] {
            let path = folder.path().join(file);
            let bytes =
                image::DynamicImage::from(image::RgbImage::from_pixel(200, 200, image::Rgb([code; 3])));
            let image = if words { bytes.to_rgb16().into() } else { bytes };
            image.save(path).expect("an image");
        }
        let text = manifest(response, if words { 65535 } else { 255 });
        std::fs::write(folder.path().join("burst.toml"), text).expect("a manifest");
        let source = ReplaySource::open(folder.path(), Pace::Free).expect("a recording");
        check(Box::new(source), &settings(SamplerKind::Q2Tree, 64));
    }
}

#[test]
fn four_thousand_lights_at_order_6_need_8_mb_without_the_frames() {
    let _alone = alone();
    let source = room();
    let c = source.calibration();
    assert_eq!((c.layout.width(), c.layout.height()), (640, 480), "the size that is promised for");
    for name in SamplerKind::ALL {
        let settings = Settings { order: Some(6), ..settings(name, 4096) };
        let plan = plan(&*source, settings);
        let frames = &plan.buffers()[0];
        assert_eq!((frames.name, frames.bytes()), ("frames", 3 * 640 * 480 * source.exposures().len()));
        let besides = plan.bytes() - frames.bytes();
        assert!(
            besides <= 8 << 20,
            "{name}: found {besides} bytes besides the frames, expected 8 MB\n{plan}"
        );
    }
}

#[test]
fn a_map_of_another_order_needs_no_second_sampler() {
    let _alone = alone();
    let (source, many) = (room(), settings(SamplerKind::Adaptive, 50_000));
    let pipeline = Pipeline::try_new(*source.calibration(), &source.exposures(), many.clone());
    let mut pipeline = pipeline.expect("a pipeline");
    let buffers = buffers(SamplerKind::Adaptive, &pipeline.shape(), 50_000, &many.tuning);
    let sampler: usize = buffers.iter().map(|buffer| buffer.bytes()).sum();
    let before = BYTES.get();
    MOST.set(before);
    pipeline.configure(Settings { order: Some(6), ..many }).expect("settings");
    let most = MOST.get() - before;
    println!("a sampler of {sampler} bytes, {most} bytes more during the change of the map");
    assert_eq!(pipeline.shape().order, 6);
    assert!(most.unsigned_abs() < sampler / 2, "found {most} bytes more, a sampler has {sampler}");
}
