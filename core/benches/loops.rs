//! Benchmarks of the hot loops: `cargo bench -p hemilux-core`.

#[path = "../tests/all/common/mod.rs"]
mod common;

use common::{bench_lens, dark, one_exposure, pixel_table};
use divan::{Bencher, black_box};
use hemilux_core::Levels;
use hemilux_core::format::{Format, Layout};
use hemilux_core::healpix::Domain;
use hemilux_core::internals;
use hemilux_core::internals::merge::{Channels, Codes};
use hemilux_core::polar::LatLongView;
use hemilux_core::response::{Curve, curve_len};
use hemilux_core::sampler::q2tree::Parameters;
use hemilux_core::sampler::{Map, Request, Sampler};
use hemilux_core::{Depth, Response};
use hemilux_core::{Exposure, Samples};

const ORDER: u8 = 6;

fn main() {
    divan::main();
}

/// Returns pseudo-random codes, none of which is saturated.
fn bytes(count: usize) -> Vec<u8> {
    (0..count as u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 25) as u8).collect()
}

/// Merges a chunk of three exposures, with a linear or a non-linear response.
#[divan::bench(args = [true, false])]
fn merge(bencher: Bencher<'_, '_>, linear: bool) {
    let response = if linear { Response::Linear } else { Response::Srgb };
    let curve = Curve::try_new(
        &response,
        Depth::U8,
        Levels { black: 0.0, white: 255.0 },
        vec![0; curve_len(Depth::U8)],
    );
    let exposures = [0.001, 0.006, 0.036].map(|seconds| Exposure { seconds, gain: 1.0 });
    let merge = common::merge(curve.expect("sound"), &exposures);
    let plane = bytes(384);
    let codes = if linear { Codes::Bytes(&plane) } else { Codes::Planes([&plane[..128]; 3]) };
    let mut counts = vec![0; 384];
    bencher.bench_local(|| merge.view().counts(black_box(&[codes; 3]), Channels::RGB, &mut counts));
}

/// Processes a burst of one exposure.
#[divan::bench]
fn burst(bencher: Bencher<'_, '_>) {
    let (pixel_table, merge, mut map) =
        (pixel_table(&bench_lens(), 640, 480, ORDER), one_exposure(), dark(Domain::Hemisphere, ORDER));
    let layout = Layout::tight(Format::Rgb48, 640, 480).expect("a sound size");
    let frame: Vec<u16> = bytes(3 * 640 * 480).into_iter().map(|v| 256 * u16::from(v)).collect();
    let frames = [Samples::U16(&frame)];
    bencher.bench_local(|| {
        internals::burst(&frames, &layout, &merge.view(), &pixel_table.view(), [1.0; 3], &mut map)
    });
}

/// Builds a pyramid from its texels.
#[divan::bench]
fn pyramid(bencher: Bencher<'_, '_>) {
    let mut map = common::lit(Domain::Hemisphere, ORDER, |ipix| [1.0 + (ipix % 7) as f32; 3]);
    bencher.bench_local(|| map.build());
}

/// Decomposes a pyramid into lights.
#[divan::bench(args = [64, 5_000])]
fn q2tree(bencher: Bencher<'_, '_>, lights: usize) {
    let map = common::lit(Domain::Hemisphere, ORDER, |ipix| [1.0 + (ipix % 7) as f32; 3]);
    let mut tree = common::q2tree(Parameters::CENTROID, Domain::Hemisphere, ORDER, lights);
    let polar = LatLongView::NONE;
    let map = Map { pyramid: map.view(), polar };
    bencher.bench_local(|| tree.update(&map, &Request::of_lights(lights)).lights.len());
}
