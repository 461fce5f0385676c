//! Buffers of exactly the required length are accepted; buffers that are one element shorter are refused with both lengths.
//!
//! The buffers of response and merge tables, polar maps and samplers are tested in the files of these modules.

use crate::common::{bench_lens, expose, pixel_table};
use hemilux_core::healpix::Domain;
use hemilux_core::internals::pixel_table::{Buffers, PixelTable, Run, Span, Texel, pixel_table_size};
use hemilux_core::light::{Light, cap_radius_deg};
use hemilux_core::pyramid::{Pyramid, Quad, pyramid_len};
use hemilux_core::tonemap::{sigmoid, srgb_code};
use hemilux_core::{ImageSize, Order, PixelTableError, TooSmall};

const SIZE: ImageSize = ImageSize { width: 320, height: 240 };

#[test]
fn pixel_table_needs_exactly_the_computed_sizes() {
    let lens = bench_lens();
    let size = pixel_table_size(&lens, SIZE, 3).expect("a sound image");
    let (s, w, r, t) = (size.spans, size.weights, size.runs, size.texels);
    let build = |s: usize, w: usize, r: usize, t: usize| {
        let buffers = Buffers {
            spans: vec![Span::default(); s],
            weights: vec![0; w],
            runs: vec![Run::default(); r],
            texels: vec![Texel::default(); t],
        };
        PixelTable::try_new(&lens, SIZE, 3, buffers).map(|p| p.size())
    };
    assert_eq!(build(s, w, r, t), Ok(size));
    let short = |needed: usize| Err(PixelTableError::TooSmall(TooSmall { needed, lent: needed - 1 }));
    assert_eq!(build(s - 1, w, r, t), short(s));
    assert_eq!(build(s, w - 1, r, t), short(w));
    assert_eq!(build(s, w, r - 1, t), short(r));
    assert_eq!(build(s, w, r, t - 1), short(t));
    // The map has eight faces of 64 texels.
    assert_eq!((s, t), (240, 512));
}

#[test]
fn longer_buffers_give_the_same_pixel_table() {
    let lens = bench_lens();
    let exact = pixel_table(&lens, 320, 240, 3);
    let size = pixel_table_size(&lens, SIZE, 3).expect("a sound image");
    let buffers = Buffers {
        spans: vec![Span { first: 0, len: 9 }; size.spans + 5],
        weights: vec![60_000; size.weights + 5],
        runs: vec![exact.view().runs[0]; size.runs + 5],
        texels: vec![Texel { direction: [9.0; 3], unseen_sr: 9.0 }; size.texels + 5],
    };
    let roomy = PixelTable::try_new(&lens, SIZE, 3, buffers).expect("room enough");
    let (a, b) = (roomy.view(), exact.view());
    assert_eq!((a.spans, a.weights, a.runs, a.texels), (b.spans, b.weights, b.runs, b.texels));
    let frame = vec![9_000; 3 * 320 * 240];
    let (a, b) = (expose(&exact, &frame), expose(&roomy, &frame));
    assert_eq!((a.0.view().total(), a.1), (b.0.view().total(), b.1));
}

#[test]
fn arrays_and_slices_are_buffers() {
    let needed = pyramid_len(Domain::Hemisphere, Order::saturating(1));
    let mut slice = [Quad::default(); 40];
    assert_eq!(slice.len(), needed);
    assert!(Pyramid::try_new(&mut slice[..], Domain::Hemisphere, Order::saturating(1)).is_ok());
    assert!(Pyramid::try_new(slice, Domain::Hemisphere, Order::saturating(1)).is_ok());
}

#[test]
fn a_cap_has_the_radius_of_its_mean_resultant_length() {
    // The mean resultant length R of a uniform cap is (1 + cos a) / 2; the three caps are a point, a hemisphere and a sphere.
    for (resultant, degrees) in
        [(1.0, 0.0), (0.75, 60.0), (0.5, 90.0), (0.0, 180.0), (1.1, 0.0), (-1.0, 180.0)]
    {
        assert!((cap_radius_deg(1.0 - resultant) - degrees).abs() < 1e-3, "{resultant}");
    }
    assert_eq!(Light::default().radius_deg, 0.0);
}

#[test]
fn display_codes_are_within_one_of_the_formulas() {
    let srgb = |v: f64| if v <= 0.003_130_8 { 12.92 * v } else { 1.055 * v.powf(1.0 / 2.4) - 0.055 };
    for i in 0..=100_000 {
        let v = f64::from(i) / 100_000.0;
        assert!((f64::from(srgb_code(v as f32)) - 255.0 * srgb(v)).abs() < 0.51, "{v}");
    }
    for i in 0..=1000 {
        let v = f64::from(i) / 1000.0;
        let y = 10f64.powf(8.0 * v - 4.0);
        let ratio = (y / 0.3).powf(0.8);
        let expected = 255.0 * srgb(ratio / (1.0 + ratio));
        let found = sigmoid([y as f32; 3], 0.3);
        assert!(found.iter().all(|c| (f64::from(*c) - expected).abs() < 1.0), "{y}: {found:?} {expected}");
    }
    for bad in [f32::NAN, -1.0, 0.0] {
        assert_eq!(sigmoid([bad; 3], 1.0), [0; 3]);
        assert_eq!(sigmoid([1.0; 3], bad), [0; 3]);
    }
    assert_eq!((srgb_code(f32::NAN), srgb_code(f32::INFINITY), srgb_code(-3.0)), (0, 255, 0));
    assert_eq!(sigmoid([f32::INFINITY; 3], 1.0).len(), 3);
}
