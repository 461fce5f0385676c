//! Sums of the pyramid against `f64`, and the extrapolation of light outside of the field of view.

use crate::common::{RngExt, above, dark, expose, full_circle, grey, lit, off, pixel_table, plain, seeded};
use core::f64::consts::{FRAC_PI_2, PI, TAU};
use glam::{DVec2, DVec3, Vec3};
use hemilux_core::Order;
use hemilux_core::TooSmall;
use hemilux_core::format::Format;
use hemilux_core::healpix::{self, Domain};
use hemilux_core::internals;
use hemilux_core::internals::Lanes;
use hemilux_core::internals::pixel_table::Texel;
use hemilux_core::lens::{Lens, Model};
use hemilux_core::pyramid::{Pyramid, Quad, pyramid_len};

#[test]
fn parents_are_the_sums_of_their_children() {
    for (domain, order) in [(Domain::Sphere, 4), (Domain::Hemisphere, 5), (Domain::Sphere, 0)] {
        let mut rng = seeded(6);
        let map = lit(domain, order, |_| [(); 3].map(|()| 10f32.powf(rng.random_range(-4.0..4.0))));
        let view = map.view();
        let texels: Vec<_> = view.quads_of(order).to_vec();
        for coarse in 0..=order {
            let below = 1 << (2 * (order - coarse));
            for (quad, part) in view.quads_of(coarse).iter().zip(texels.chunks(below)) {
                for i in 0..4 {
                    let energy: f64 = part.iter().map(|q| f64::from(q.energy[i])).sum();
                    let moment: f64 = part.iter().map(|q| f64::from(q.moment[i])).sum();
                    assert!((f64::from(quad.energy[i]) - energy).abs() <= 1e-6 * energy, "order {coarse}");
                    let scale: f64 = part.iter().map(|q| f64::from(q.y())).sum();
                    assert!((f64::from(quad.moment[i]) - moment).abs() <= 1e-6 * scale, "order {coarse}");
                }
            }
        }
        let total: f64 = texels.iter().map(|q| f64::from(q.y())).sum();
        assert!(off(f64::from(view.total().y()), total) < 1e-6);
    }
}

#[test]
fn first_moments_point_towards_the_light() {
    let lamp = Vec3::new(1.0, 2.0, 3.0).normalize();
    let quad = Quad::from_light([2.0, 3.0, 4.0], lamp);
    let y = 0.2126 * 2.0 + 0.7152 * 3.0 + 0.0722 * 4.0;
    assert!((quad.y() - y).abs() < 1e-6 && (quad.first_moment() - y * lamp).length() < 1e-6);
    assert!((quad.variance()).abs() < 1e-6);
    let mut both = quad;
    both.add(&Quad::from_light([2.0, 3.0, 4.0], -lamp));
    assert!(both.variance() > 1.0 - 1e-6 && (both.y() - 2.0 * y).abs() < 1e-5);
    assert_eq!(Quad::default().variance(), 0.0);
}

#[test]
fn horizontal_irradiance_of_a_constant_sky_is_pi() {
    let order = 5;
    let omega = healpix::solid_angle(order);
    let share = |i| Domain::Hemisphere.share(order, i);
    let map = lit(Domain::Hemisphere, order, |i| [1.0, 2.0, 3.0].map(|l| l * (omega * share(i)) as f32));
    let found = map.view().horizontal_irradiance();
    for (f, l) in found.iter().zip([1.0, 2.0, 3.0]) {
        assert!(off(f64::from(*f), l * PI) < 1e-3, "{found:?}");
    }
    for ipix in [0, 900, 5000] {
        let radiance = map.view().radiance(order, ipix);
        let expected = if share(ipix) > 0.0 { [1.0, 2.0, 3.0] } else { [0.0; 3] };
        assert!(radiance.iter().zip(expected).all(|(r, e)| (r - e).abs() < 1e-4), "{ipix}: {radiance:?}");
    }
}

#[test]
fn finer_texels_divide_their_ancestors_energy_by_solid_angle() {
    let order = 4;
    let geometry: Vec<_> = (0..Domain::Hemisphere.quads(order) as u32)
        .map(|i| Texel { direction: above(Domain::Hemisphere, order, i).to_array(), unseen_sr: 0.0 })
        .collect();
    for source in 0..=order {
        let mut map = dark(Domain::Hemisphere, order);
        let mut rng = seeded(8);
        let energies: Vec<[f32; 3]> = (0..Domain::Hemisphere.quads(source) as u32)
            .map(|i| if Domain::Hemisphere.share(source, i) > 0.0 { grey(rng.random()) } else { grey(0.0) })
            .collect();
        let sums = map.accumulators(source);
        sums.iter_mut().zip(&energies).for_each(|(q, [r, g, b])| q.energy = [*r, *g, *b, 7.0]);
        map.finish(source, &geometry, &Lanes::of(Format::Rgb24, [1.0; 3]));
        for (quad, rgb) in map.view().quads_of(source).iter().zip(&energies) {
            assert!((quad.energy[0] - rgb[0]).abs() <= 1e-6 * rgb[0], "order {source}: {quad:?} {rgb:?}");
        }
    }
}

#[test]
fn negative_and_non_finite_energy_counts_as_zero() {
    for bad in [f32::NAN, -1.0, f32::NEG_INFINITY] {
        assert_eq!(Quad::from_light([bad, 1.0, 0.0], Vec3::X), Quad::from_light([0.0, 1.0, 0.0], Vec3::X));
    }
    let bright = Quad::from_light([f32::INFINITY; 3], Vec3::Z);
    assert!(bright.energy.iter().chain(&bright.moment).all(|v| v.is_finite()), "{bright:?}");
    let mut map = lit(Domain::Sphere, 3, |_| grey(1.0));
    map.texels_mut()[5].energy[1] = f32::NAN;
    map.texels_mut()[99].moment[2] = f32::INFINITY;
    map.texels_mut()[300].energy = [-1.0; 4];
    map.build();
    // The whole texel is cleared, since its sums are inconsistent.
    assert!(off(f64::from(map.view().total().y()), 768.0 - 3.0) < 1e-6, "{:?}", map.view().total());
    assert_eq!(map.texels()[5], Quad::default());
}

#[test]
fn hemisphere_map_clears_light_below_the_horizon() {
    for order in 0..6 {
        let mut map = dark(Domain::Hemisphere, order);
        map.texels_mut().fill(Quad::from_light(grey(1.0), Vec3::Z));
        map.build();
        for (ipix, quad) in map.texels().iter().enumerate() {
            let inside = Domain::Hemisphere.share(order, ipix as u32) > 0.0;
            assert_eq!(quad.y() > 0.0, inside, "order {order}: {ipix}");
        }
    }
}

#[test]
fn a_pyramid_one_quad_short_is_refused() {
    // The lengths are 8 (1 + 4 + 16) for the hemisphere and 12 (1 + 4 + 16) for the sphere.
    assert_eq!(pyramid_len(Domain::Hemisphere, Order::saturating(2)), 168);
    assert_eq!(pyramid_len(Domain::Sphere, Order::saturating(2)), 252);
    assert!(Pyramid::try_new(vec![Quad::default(); 252], Domain::Sphere, Order::saturating(2)).is_ok());
    let short =
        Pyramid::try_new(vec![Quad::default(); 251], Domain::Sphere, Order::saturating(2)).map(|_| ());
    assert_eq!(short, Err(TooSmall { needed: 252, lent: 251 }));
}

/// Returns the standard lens, whose field of view does not reach the horizon.
fn narrow() -> Lens {
    Lens::try_new(plain(Model::Equidistant, [319.5, 239.5], 196.4, 80.0)).expect("a sound lens")
}

#[test]
fn extrapolation_of_a_uniform_sky_has_its_radiance() {
    let pixel_table = pixel_table(&narrow(), 640, 480, 5);
    let (mut map, _) = expose(&pixel_table, &[20_000; 3 * 640 * 480]);
    let radiance = internals::average(&mut map, pixel_table.texels());
    let expected = crate::common::radiance_of(20_000);
    println!("average off by {:.1e}", off(f64::from(radiance[1]), expected));
    assert!(off(f64::from(radiance[1]), expected) < 5e-3, "{radiance:?} {expected}");
    let total = f64::from(map.view().total().y());
    assert!(off(total, TAU * expected) < 5e-3, "{total}");
}

#[test]
fn single_lamp_does_not_raise_the_extrapolated_radiance() {
    let pixel_table = pixel_table(&narrow(), 640, 480, 5);
    let mut frame = vec![20u16; 3 * 640 * 480];
    let (mut dim, _) = expose(&pixel_table, &frame);
    // The frame has a disc of 5 degrees radius, three thousand times as bright as the rest: 70 % of the plain mean.
    for (i, rgb) in frame.as_chunks_mut::<3>().0.iter_mut().enumerate() {
        let at = DVec2::new((i % 640) as f64, (i / 640) as f64);
        if at.distance(DVec2::new(380.0, 200.0)) < 17.0 {
            *rgb = [60_000; 3];
        }
    }
    let (mut lamp, _) = expose(&pixel_table, &frame);
    let rim = |map: &mut Pyramid<_>| f64::from(internals::average(map, pixel_table.texels())[0]);
    let (without, with) = (rim(&mut dim), rim(&mut lamp));
    assert!(off(with, without) < 0.01, "{with} {without}");
}

#[test]
fn extrapolation_changes_neither_full_nor_coarse_maps() {
    let lens = full_circle(Model::Equidistant, 301, 90.0);
    let pixel_table = pixel_table(&lens, 301, 301, 5);
    let (mut map, _) = expose(&pixel_table, &vec![20_000; 3 * 301 * 301]);
    let before = map.view().total();
    internals::average(&mut map, pixel_table.texels());
    assert_eq!(map.view().total(), before);
    let coarse = crate::common::pixel_table(&narrow(), 640, 480, 2);
    let (mut map, _) = expose(&coarse, &[20_000; 3 * 640 * 480]);
    let before = map.view().total();
    assert_eq!(internals::average(&mut map, coarse.texels()), [0.0; 3]);
    assert_eq!(map.view().total(), before);
    assert_eq!(internals::average(&mut lit(Domain::Sphere, 4, |_| grey(1.0)), &[]), [0.0; 3]);
}

#[test]
fn extrapolated_light_comes_from_outside_the_field_of_view() {
    let pixel_table = pixel_table(&narrow(), 640, 480, 5);
    let (mut map, _) = expose(&pixel_table, &[20_000; 3 * 640 * 480]);
    let before = map.view().total().first_moment();
    internals::average(&mut map, pixel_table.texels());
    let rim = (map.view().total().first_moment() - before).as_dvec3();
    // The mean direction of a constant sky is the zenith with half the length: pi L.
    let whole = map.view().total().first_moment().as_dvec3() / (PI * crate::common::radiance_of(20_000));
    assert!((whole - DVec3::Z).length() < 5e-3, "{whole}");
    assert!(rim.z > 0.0 && rim.angle_between(DVec3::Z) < FRAC_PI_2, "{rim}");
}
