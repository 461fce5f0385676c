//! Conservation of light between pixels and texels: the pixel table and the front end against sums over pixels in `f64`.

use crate::common::{
    RngExt, VecPixelTable, bench_lens, burst, dark, expose, full_circle, off, pixel_table, plain,
    radiance_of, seeded,
};
use core::f64::consts::TAU;
use glam::{DVec2, DVec3};
use hemilux_core::BurstError;
use hemilux_core::ImageSize;
use hemilux_core::PixelTableError;
use hemilux_core::Samples;
use hemilux_core::format::{Format, Layout};
use hemilux_core::healpix::{self, Domain};
use hemilux_core::internals;
use hemilux_core::internals::pixel_table::pixel_table_size;
use hemilux_core::lens::{Intrinsics, Lens, Model};

/// Returns lenses, each with the width and height of an image and the order of a map.
fn views() -> Vec<(Lens, u32, u32, u8)> {
    let vignetting = [1.0, 0.0, -0.2, 0.0, 0.01, 0.0, 0.0, 0.0];
    let fading = Intrinsics { vignetting, ..plain(Model::Equidistant, [160.2, 119.1], 98.0, 80.0) };
    let radial = Intrinsics {
        focal_px: DVec2::new(60.0, 55.0),
        skew_px: 1.5,
        ..plain(Model::Radial([0.0, 0.0]), [180.0, 130.0], 60.0, 75.0)
    };
    vec![
        (bench_lens(), 640, 480, 5),
        (Lens::try_new(fading).expect("a sound lens"), 320, 240, 4),
        (Lens::try_new(radial).expect("a sound lens"), 333, 251, 4),
        (full_circle(Model::Equisolid, 501, 93.0), 501, 501, 5),
        (full_circle(Model::Equidistant, 300, 120.0), 300, 300, 7),
        (full_circle(Model::Equisolid, 301, 90.0), 301, 301, 6),
        (full_circle(Model::Equidistant, 21, 90.0), 21, 21, 3),
    ]
}

/// Returns, for every pixel, the solid angle divided by the illumination above and below the horizon; 0 outside of the field of view.
fn weights(lens: &Lens, width: u32, height: u32) -> Vec<(f64, f64)> {
    let pixels = (0..width * height).map(|i| DVec2::new(f64::from(i % width), f64::from(i / width)));
    pixels
        .map(|p| match (lens.unproject(p), lens.solid_angle(p)) {
            (Some(d), Some(omega)) => {
                let weight = omega / lens.illumination(d.z.acos());
                if d.z > 0.0 { (weight, 0.0) } else { (0.0, weight) }
            }
            _ => (0.0, 0.0),
        })
        .collect()
}

fn constant(pixel_table: &VecPixelTable, code: u16) -> Vec<u16> {
    vec![code; 3 * (pixel_table.width() * pixel_table.height()) as usize]
}

#[test]
fn energy_of_the_map_equals_that_of_the_pixels() {
    let mut worst = 0.0f64;
    for (lens, width, height, order) in views() {
        let pixel_table = pixel_table(&lens, width, height, order);
        let mut rng = seeded(4);
        // The codes have a range of three and a half decades, which fits one 16-bit exposure.
        let frame: Vec<u16> =
            (0..3 * width * height).map(|_| 10f64.powf(rng.random_range(1.0..4.5)) as u16).collect();
        let (map, seen) = expose(&pixel_table, &frame);
        let (mut above, mut below) = ([0.0; 3], [0.0; 3]);
        for (weight, rgb) in weights(&lens, width, height).iter().zip(frame.as_chunks::<3>().0) {
            for c in 0..3 {
                above[c] += radiance_of(rgb[c]) * weight.0;
                below[c] += radiance_of(rgb[c]) * weight.1;
            }
        }
        for (found, expected) in map.view().total().rgb().into_iter().zip(above) {
            let error = off(f64::from(found), expected);
            worst = worst.max(error);
            // Random codes per pixel are the worst case for a common weight per run, above all in small images.
            assert!(error < if width < 100 { 1e-3 } else { 1e-4 }, "{width} x {height}: {error}");
        }
        let y = |rgb: [f64; 3]| 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
        assert!((seen.below - y(below) / y(above)).abs() < 1e-4, "{width} x {height}: {seen:?}");
        assert_eq!(seen.clipped, 0.0);
    }
    println!("worst energy {worst:.1e}");
}

#[test]
fn uniform_scene_gives_its_radiance_times_the_field_of_view() {
    for (lens, width, height, order) in views() {
        let pixel_table = pixel_table(&lens, width, height, order);
        // An image of uniform radiance through a lens with vignetting.
        let pixels = (0..width * height).map(|i| DVec2::new(f64::from(i % width), f64::from(i / width)));
        let illumination = |p| lens.unproject(p).map_or(0.0, |d| lens.illumination(d.z.acos()));
        let frame: Vec<u16> = pixels.flat_map(|p| [(30_000.0 * illumination(p)).round() as u16; 3]).collect();
        let (map, _) = expose(&pixel_table, &frame);
        let expected = radiance_of(30_000) * TAU * (1.0 - pixel_table.unseen());
        let error = off(f64::from(map.view().total().energy[1]), expected);
        // The error is caused by the pixels at the rim: for a circle of 21 pixels it is larger.
        assert!(error < if width > 200 { 2e-3 } else { 3e-2 }, "{width} x {height}: {error}");
    }
}

#[test]
fn seen_and_unseen_solid_angles_add_up_to_the_hemisphere() {
    for (lens, width, height, order) in views() {
        let pixel_table = pixel_table(&lens, width, height, order);
        let p = *lens.intrinsics();
        let plain = Lens::try_new(Intrinsics { vignetting: [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], ..p });
        let seen: f64 = weights(&plain.expect("sound"), width, height).iter().map(|w| w.0).sum();
        let sum = seen / TAU + pixel_table.unseen();
        assert!((sum - 1.0).abs() < if width > 200 { 2e-3 } else { 3e-2 }, "{width} x {height}: {sum}");
        for (ipix, texel) in pixel_table.texels().iter().enumerate() {
            let own = healpix::solid_angle(order) * Domain::Hemisphere.share(order, ipix as u32);
            assert!((0.0..=own * 1.000_001).contains(&f64::from(texel.unseen_sr)), "{texel:?}");
            let length = DVec3::from_array(texel.direction.map(f64::from)).length();
            assert!((length - 1.0).abs() < 1e-6 && texel.direction[2] >= 0.0, "{texel:?}");
        }
    }
}

#[test]
fn light_below_the_horizon_is_excluded_and_reported() {
    let pixel_table = pixel_table(&full_circle(Model::Equisolid, 936, 93.0), 936, 936, 5);
    let (map, seen) = expose(&pixel_table, &constant(&pixel_table, 20_000));
    // The expected ratio is (cos 90 - cos 93) / (1 - cos 90), angles in degrees.
    let expected = -(93f64.to_radians().cos());
    assert!(off(seen.below, expected) < 5e-3, "{seen:?}");
    assert!(off(f64::from(map.view().total().energy[0]), TAU * radiance_of(20_000)) < 1e-3);
    assert_eq!(pixel_table.unseen(), 0.0);
}

#[test]
fn sun_of_two_pixels_keeps_its_energy_and_direction() {
    for (lens, width, height, order) in views().into_iter().filter(|v| v.1 > 200) {
        let pixel_table = pixel_table(&lens, width, height, order);
        let mut frame = constant(&pixel_table, 0);
        let at = DVec2::new(f64::from(width / 2 + 40), f64::from(height / 2 - 30));
        let first = ((height / 2 - 30) * width + width / 2 + 40) as usize;
        frame[3 * first..3 * first + 6].fill(60_000);
        let (map, _) = expose(&pixel_table, &frame);
        let omega = |p: DVec2| {
            let d = lens.unproject(p).expect("inside the view");
            lens.solid_angle(p).expect("inside the view") / lens.illumination(d.z.acos())
        };
        let expected = radiance_of(60_000) * (omega(at) + omega(at + DVec2::X));
        let total = map.view().total();
        // The two pixels are weighted with the mean weights of their runs.
        assert!(off(f64::from(total.energy[2]), expected) < 1e-3, "{width}: {total:?} {expected}");
        let d = lens.unproject(at + 0.5 * DVec2::X).expect("inside the view");
        let found = total.first_moment().as_dvec3().normalize();
        // The tolerance is half the diagonal of the texels that receive the light.
        assert!(found.distance(d) < healpix::solid_angle(pixel_table.source_order()).sqrt(), "{found} {d}");
    }
}

#[test]
fn every_texel_inside_the_field_of_view_receives_light() {
    let coarse = (full_circle(Model::Equidistant, 63, 90.0), 64, 63, 7);
    let narrow = Intrinsics {
        focal_px: DVec2::new(80.0, 130.0),
        ..plain(Model::Equidistant, [159.5, 119.5], 1.0, 88.0)
    };
    let narrow = (Lens::try_new(narrow).expect("a sound lens"), 320, 240, 6);
    for (lens, width, height, order) in views().into_iter().chain([coarse, narrow]) {
        let pixel_table = pixel_table(&lens, width, height, order);
        let (map, _) = expose(&pixel_table, &constant(&pixel_table, 20_000));
        let expected: f64 = weights(&lens, width, height).iter().map(|w| w.0).sum();
        assert!(off(f64::from(map.view().total().y()), expected * radiance_of(20_000)) < 1e-4);
        let inside =
            pixel_table.texels().iter().zip(map.texels()).enumerate().filter(|(ipix, (texel, _))| {
                Domain::Hemisphere.share(order, *ipix as u32) > 0.0 && texel.unseen_sr == 0.0
            });
        let empty = inside.clone().filter(|(_, (_, quad))| quad.y() <= 0.0).count();
        let source = pixel_table.source_order();
        assert_eq!(empty, 0, "{:?} {width} x {height}, order {source} of {order}, {}", lens, inside.count());
    }
}

#[test]
fn a_white_frame_of_a_large_image_does_not_overflow() {
    for (max_deg, order) in [(90.0, 0), (178.0, 2)] {
        let pixel_table = pixel_table(&full_circle(Model::Equidistant, 1600, max_deg), 1600, 1600, order);
        let (map, seen) = expose(&pixel_table, &constant(&pixel_table, 65_535));
        let total = f64::from(map.view().total().y());
        assert!(off(total, TAU * 100.0) < 2e-3, "{total}");
        let below = -max_deg.to_radians().cos();
        assert!((seen.below - below).abs() < 2e-3, "{seen:?} {below}");
        assert!(off(seen.clipped, 1.0) < 2e-3, "{seen:?}");
    }
}

#[test]
fn clipping_is_reported_and_white_balance_applied() {
    let (width, height) = (640, 480);
    let pixel_table = pixel_table(&bench_lens(), width, height, 4);
    let mut frame = constant(&pixel_table, 10_000);
    let half = frame.len() / 2;
    frame[..half].fill(65_535);
    let mut map = dark(Domain::Hemisphere, 4);
    let balance = [2.0, 1.0, 0.5];
    let seen = burst(&pixel_table, &[Samples::U16(&frame)], balance, &mut map).expect("fits");
    let weights = weights(&bench_lens(), width, height);
    let clipped: f64 = weights[..weights.len() / 2].iter().map(|w| w.0).sum();
    assert!((seen.clipped - clipped / TAU).abs() < 1e-4, "{seen:?}");
    let [r, g, b] = map.view().total().rgb();
    assert!((r / g - 2.0).abs() < 1e-5 && (b / g - 0.5).abs() < 1e-5, "{r} {g} {b}");
}

/// In a frame in which every pixel is clipped, the clipped irradiance equals the irradiance of the map.
#[test]
fn clipped_light_is_reported_as_irradiance() {
    let pixel_table = pixel_table(&bench_lens(), 640, 480, 5);
    let mut frame = constant(&pixel_table, 10_000);
    let mut map = dark(Domain::Hemisphere, 5);
    let balance = [2.0, 1.0, 0.5];
    let none = burst(&pixel_table, &[Samples::U16(&frame)], balance, &mut map).expect("fits");
    assert_eq!(none.clipped_irradiance, [0.0; 3], "no pixel is clipped");
    frame.fill(65_535);
    let all = burst(&pixel_table, &[Samples::U16(&frame)], balance, &mut map).expect("fits");
    for (found, expected) in all.clipped_irradiance.into_iter().zip(map.view().horizontal_irradiance()) {
        assert!((found / expected - 1.0).abs() < 2e-3, "{all:?}, expected {expected}");
    }
}

#[test]
fn mismatched_frames_and_maps_are_refused() {
    let pixel_table = pixel_table(&bench_lens(), 640, 480, 3);
    let frame = constant(&pixel_table, 7);
    let bytes = vec![7u8; frame.len()];
    let mut map = dark(Domain::Hemisphere, 3);
    let run = |frames: &[Samples<'_>], map: &mut _| {
        burst(&pixel_table, frames, [1.0; 3], map).expect_err("must be refused")
    };
    assert_eq!(run(&[], &mut map), BurstError::FrameCount { found: 0, expected: 1 });
    let short = [Samples::U16(&frame[1..])];
    let refused = BurstError::FrameSize { index: 0, found: frame.len() - 1, expected: frame.len() };
    assert_eq!(run(&short, &mut map), refused);
    assert_eq!(run(&[Samples::U8(&bytes)], &mut map), BurstError::FrameDepth { index: 0 });
    for mut other in [dark(Domain::Hemisphere, 2), dark(Domain::Hemisphere, 4), dark(Domain::Sphere, 3)] {
        assert_eq!(run(&[Samples::U16(&frame)], &mut other), BurstError::OtherMap);
    }
    let finer = crate::common::pixel_table(&bench_lens(), 640, 480, 5);
    let refused = burst(&finer, &[Samples::U16(&frame)], [1.0; 3], &mut map);
    assert_eq!(refused, Err(BurstError::OtherMap));
    let layout = Layout::tight(Format::Rgb48, 320, 240).expect("a sound size");
    let merge = crate::common::one_exposure();
    let refused = internals::burst(
        &[Samples::U16(&frame)],
        &layout,
        &merge.view(),
        &pixel_table.view(),
        [1.0; 3],
        &mut map,
    );
    assert_eq!(refused, Err(BurstError::OtherSize));
}

#[test]
fn images_without_a_pixel_table_are_refused() {
    let lens = bench_lens();
    assert_eq!(
        pixel_table_size(&lens, ImageSize { width: 0, height: 480 }, 5),
        Err(PixelTableError::BadSize)
    );
    assert_eq!(
        pixel_table_size(&lens, ImageSize { width: 1 << 14, height: (1 << 12) + 1 }, 5),
        Err(PixelTableError::BadSize)
    );
    assert_eq!(
        pixel_table_size(&lens, ImageSize { width: 640, height: 480 }, 11),
        Err(PixelTableError::BadOrder)
    );
    let aside = Lens::try_new(plain(Model::Equidistant, [-5000.0; 2], 100.0, 80.0)).expect("a sound lens");
    assert_eq!(
        pixel_table_size(&aside, ImageSize { width: 640, height: 480 }, 5),
        Err(PixelTableError::NothingSeen)
    );
    // The pixels of this lens are larger than the texels of order 0.
    let huge = full_circle(Model::Equidistant, 3, 90.0);
    assert_eq!(pixel_table_size(&huge, ImageSize { width: 3, height: 3 }, 0), Err(PixelTableError::BadOrder));
}

#[test]
fn runs_have_the_texels_of_their_pixels() {
    for (lens, width, height, order) in views() {
        let pixel_table = pixel_table(&lens, width, height, order);
        let view = pixel_table.view();
        let own = view.runs.iter().zip(view.weights);
        let mut cells = own.flat_map(|(run, w)| std::iter::repeat_n((run.texel() as u32, *w), run.len()));
        let below = Domain::Hemisphere.quads(pixel_table.source_order()) as u32;
        for (row, span) in view.spans.iter().enumerate() {
            for column in 0..width {
                let at = DVec2::new(f64::from(column), row as f64);
                let seen = lens.unproject(at);
                let visited = (span.first..span.first + span.len).contains(&column);
                assert_eq!(seen.is_some(), visited, "{column} {row}");
                let Some(d) = seen else { continue };
                let (texel, weight) = cells.next().expect("a texel for every seen pixel");
                let expected = if d.z > 0.0 { healpix::ipix(pixel_table.source_order(), d) } else { below };
                assert_eq!(texel, expected, "{column} {row}");
                let pixel_sr = lens.solid_angle(at).expect("seen");
                let own = pixel_sr / lens.illumination(d.z.acos());
                let error = (f64::from(weight) * view.weight_unit - own).abs();
                // The tolerance is half a pixel's width in radians, since the widths of neighbouring pixels of a run differ by little.
                let most = 0.55 * pixel_sr.sqrt() * own + view.weight_unit;
                assert!(error <= most, "{column} {row}: {weight} {own}");
            }
        }
        assert_eq!(cells.next(), None, "no further run");
    }
}
