//! The sampler `adaptive`: numbers of lights, energy, ids, invalid maps, and the response to motion.

use crate::common::{RngExt, adaptive, dark, grey, lit, seeded, update};
use glam::Vec3;
use hemilux_core::Order;
use hemilux_core::TooSmall;
use hemilux_core::healpix::{self, Domain};
use hemilux_core::light::Light;
use hemilux_core::pyramid::{Pyramid, Quad};
use hemilux_core::sampler::Sampler;
use hemilux_core::sampler::adaptive::{Adaptive, Leaf, LightFilter, Memory, Workspace, bits_len};
use std::collections::HashSet;

/// Returns a map with random energies from `seed`.
fn random(domain: Domain, order: u8, seed: u64) -> Pyramid<Vec<Quad>> {
    let mut rng = seeded(seed);
    lit(domain, order, |_| [(); 3].map(|()| 10f32.powf(rng.random_range(-3.0..1.0))))
}

/// Asserts the invariants of every light set: channel sums, unit directions, unique ids, no negative irradiance.
fn check(lights: &[Light], map: &Pyramid<Vec<Quad>>) {
    let total = map.view().total().rgb();
    for (c, total) in total.into_iter().enumerate() {
        let sum: f64 = lights.iter().map(|l| f64::from(l.irradiance[c])).sum();
        let off = (sum - f64::from(total)).abs();
        assert!(off <= 1e-6 * f64::from(total), "channel {c}: {sum}, expected {total}");
    }
    let ids: HashSet<u32> = lights.iter().map(|l| l.id).collect();
    assert_eq!(ids.len(), lights.len(), "ids are unique");
    for light in lights {
        assert!((light.direction.length() - 1.0).abs() < 1e-5 && light.id != 0, "{light:?}");
        assert!(light.irradiance.iter().all(|v| *v >= 0.0 && v.is_finite()), "{light:?}");
        assert!((0.0..=180.0).contains(&light.radius_deg), "{light:?}");
    }
}

#[test]
fn every_number_of_lights_is_reached() {
    for domain in [Domain::Sphere, Domain::Hemisphere] {
        let map = random(domain, 5, 1);
        let mut sampler = adaptive(domain, 5, 4096);
        for request in (1..=200).chain([256, 1000, 1001, 4096]) {
            let lights = update(&mut sampler, &map, request);
            assert_eq!(lights.len(), request, "{domain:?}");
            check(&lights, &map);
        }
        assert_eq!(update(&mut sampler, &map, 5000).len(), 4096, "the capacity");
        assert_eq!(update(&mut sampler, &map, 0), []);
    }
}

#[test]
fn a_map_of_few_lit_texels_gives_one_light_each() {
    for k in [1usize, 2, 5, 13] {
        let mut map = dark(Domain::Sphere, 4);
        for i in 0..k {
            let at = (i * 131 + 7) as u32;
            let direction = healpix::centre(4, at).as_vec3();
            map.texels_mut()[at as usize] = Quad::from_light([1.0, 2.0, 3.0], direction);
        }
        map.build();
        let lights = update(&mut adaptive(Domain::Sphere, 4, 64), &map, 64);
        assert_eq!(lights.len(), k);
        check(&lights, &map);
    }
}

#[test]
fn one_bright_texel_gives_one_light_at_its_direction() {
    let at = 1234u32;
    let direction = healpix::centre(5, at).as_vec3();
    let mut map = dark(Domain::Hemisphere, 5);
    map.texels_mut()[at as usize] = Quad::from_light([3.0, 2.0, 1.0], direction);
    map.build();
    for request in [1, 4, 16, 64, 300] {
        let lights = update(&mut adaptive(Domain::Hemisphere, 5, 300), &map, request);
        assert_eq!(lights.len(), 1, "{request}");
        assert!(lights[0].direction.distance(direction) < 1e-5, "{:?}", lights[0]);
        check(&lights, &map);
    }
}

#[test]
fn a_map_without_light_gives_no_lights_and_light_comes_back() {
    let mut sampler = adaptive(Domain::Sphere, 4, 16);
    let (black, even) = (dark(Domain::Sphere, 4), lit(Domain::Sphere, 4, |_| grey(1.0)));
    assert_eq!(update(&mut sampler, &black, 16), []);
    let lights = update(&mut sampler, &even, 16);
    assert_eq!(lights.len(), 16);
    check(&lights, &even);
    assert_eq!(update(&mut sampler, &black, 16), []);
    assert_eq!(update(&mut sampler, &even, 16)[0].age, 0, "ages restart at 0");
}

#[test]
fn a_map_of_one_texel_per_face_gives_twelve_lights() {
    let map = random(Domain::Sphere, 0, 9);
    let lights = update(&mut adaptive(Domain::Sphere, 0, 64), &map, 64);
    assert_eq!(lights.len(), 12);
    check(&lights, &map);
}

#[test]
fn invalid_texels_hold_no_light() {
    let mut map = random(Domain::Hemisphere, 3, 4);
    for (i, bad) in [f32::NAN, f32::INFINITY, -1.0].into_iter().enumerate() {
        map.texels_mut()[i].energy = [bad; 4];
        map.texels_mut()[i + 40].moment = [bad; 4];
    }
    map.build();
    let lights = update(&mut adaptive(Domain::Hemisphere, 3, 32), &map, 32);
    check(&lights, &map);
}

#[test]
fn one_more_light_keeps_the_other_lights() {
    let map = random(Domain::Hemisphere, 5, 3);
    for n in [1usize, 9, 30, 64, 200] {
        let ids = |n: usize| -> HashSet<u32> {
            update(&mut adaptive(Domain::Hemisphere, 5, 256), &map, n).iter().map(|l| l.id).collect()
        };
        let (fewer, more) = (ids(n), ids(n + 1));
        assert!(fewer.is_subset(&more), "{n} lights");
    }
}

#[test]
fn ages_increase_in_a_static_map_and_new_lights_have_parents() {
    let map = random(Domain::Sphere, 4, 5);
    let mut sampler = adaptive(Domain::Sphere, 4, 64);
    for age in 0..5 {
        assert!(update(&mut sampler, &map, 20).iter().all(|l| l.age == age), "age {age}");
    }
    let before: HashSet<u32> = update(&mut sampler, &map, 20).iter().map(|l| l.id).collect();
    for light in update(&mut sampler, &map, 21) {
        if !before.contains(&light.id) {
            let parent = light.parent.expect("a new light has a parent");
            assert!(before.contains(&parent) && light.age == 0, "{light:?}");
        }
    }
}

#[test]
fn equal_sequences_give_identical_lights() {
    let run = || {
        let mut sampler = adaptive(Domain::Sphere, 4, 64);
        (0..20).map(|seed| update(&mut sampler, &random(Domain::Sphere, 4, seed), 48)).collect::<Vec<_>>()
    };
    assert_eq!(run(), run());
}

#[test]
fn ten_thousand_random_frames_satisfy_every_invariant() {
    let mut rng = seeded(77);
    let mut sampler = adaptive(Domain::Hemisphere, 3, 128);
    for frame in 0..10_000u64 {
        let lamps = rng.random_range(0..4);
        let mut map = random(Domain::Hemisphere, 3, frame);
        for _ in 0..lamps {
            let at = rng.random_range(0..map.texels().len() as u32);
            let direction = healpix::centre(3, at).as_vec3();
            map.texels_mut()[at as usize] = Quad::from_light([1e4, 8e3, 5e3], direction);
        }
        map.build();
        let n = rng.random_range(1..=128);
        let lights = update(&mut sampler, &map, n);
        assert_eq!(lights.len(), n, "frame {frame}");
        check(&lights, &map);
    }
}

/// Returns the map of a grey room with a lamp of one texel width at `lamp`, with 2 % noise.
fn room(lamp: Option<Vec3>, noise: u64) -> Pyramid<Vec<Quad>> {
    let mut rng = seeded(noise);
    lit(Domain::Sphere, 5, |ipix| {
        let direction = healpix::centre(5, ipix).as_vec3();
        let bright = lamp.map_or(0.0, |l| if l.dot(direction) > 0.9985 { 500.0 } else { 0.0 });
        // The sum of twelve uniform numbers minus 6 is nearly normal.
        let normal = (0..12).map(|_| rng.random_range(0.0..1.0f32)).sum::<f32>() - 6.0;
        grey((1.0 + bright) * (1.0 + 0.02 * normal))
    })
}

#[test]
fn lights_are_at_a_lamp_in_its_first_frame() {
    let lamp = Vec3::new(0.3, 0.5, 0.81).normalize();
    let mut sampler = adaptive(Domain::Sphere, 5, 64);
    for frame in 0..6 {
        update(&mut sampler, &room(None, frame), 64);
    }
    let map = room(Some(lamp), 6);
    let near = |l: &&Light| l.direction.dot(lamp) > 10f32.to_radians().cos();
    let lights = update(&mut sampler, &map, 64);
    let mean: Vec3 = lights.iter().filter(near).map(|l| l.direction * l.irradiance[1]).sum();
    let truth: Vec3 = (0..map.texels().len() as u32)
        .map(|i| map.view().quad(5, i).first_moment())
        .filter(|m| m.normalize().dot(lamp) > 10f32.to_radians().cos())
        .sum();
    assert!(
        mean.angle_between(truth).to_degrees() < 0.5,
        "off by {}",
        mean.angle_between(truth).to_degrees()
    );
}

#[test]
fn noise_moves_lights_less_than_their_raw_centroids() {
    let lamp = Some(Vec3::new(-0.4, 0.2, 0.89).normalize());
    let mut sampler = adaptive(Domain::Sphere, 5, 64);
    let mut fresh = adaptive(Domain::Sphere, 5, 64);
    let (mut smooth, mut raw) = (0.0, 0.0);
    let (mut last, mut last_raw) = (Vec::new(), Vec::new());
    for frame in 0..40 {
        let map = room(lamp, 100 + frame);
        let lights = update(&mut sampler, &map, 64);
        fresh.reset();
        let unfiltered = update(&mut fresh, &map, 64);
        if frame > 10 {
            smooth += moved(&last, &lights);
            raw += moved(&last_raw, &unfiltered);
        }
        (last, last_raw) = (lights, unfiltered);
    }
    assert!(smooth < 0.35 * raw, "filtered {smooth}, raw {raw}");
}

/// Returns a map of 192 regions with independent random radiances over three decades, so that maps of different seeds have little in common.
fn patches(seed: u64) -> Pyramid<Vec<Quad>> {
    let mut rng = seeded(seed);
    let bright: Vec<f32> = (0..192).map(|_| 10f32.powf(rng.random_range(-1.5..1.5))).collect();
    lit(Domain::Sphere, 4, |ipix| grey(bright[(ipix >> 4) as usize]))
}

#[test]
fn a_cut_discards_the_state_of_earlier_frames() {
    let mut sampler = adaptive(Domain::Sphere, 4, 64);
    for seed in 0..20 {
        let map = patches(seed);
        assert_eq!(
            update(&mut sampler, &map, 48),
            update(&mut adaptive(Domain::Sphere, 4, 64), &map, 48),
            "{seed}"
        );
    }
}

#[test]
fn a_switched_lamp_and_a_dimmed_room_are_not_cuts() {
    let lamp = Some(Vec3::new(0.3, 0.5, 0.81).normalize());
    let mut sampler = adaptive(Domain::Sphere, 5, 64);
    update(&mut sampler, &room(None, 1), 64);
    assert!(update(&mut sampler, &room(lamp, 2), 64).iter().any(|l| l.age == 1), "a lamp is a local change");
    let mut dim = room(lamp, 3);
    for quad in dim.texels_mut() {
        quad.energy = quad.energy.map(|v| 0.02 * v);
        quad.moment = quad.moment.map(|v| 0.02 * v);
    }
    dim.build();
    assert!(update(&mut sampler, &dim, 64).iter().any(|l| l.age == 2), "a uniform factor is not a cut");
}

/// Returns the mean angle, radians, by which lights of the same id moved.
fn moved(before: &[Light], after: &[Light]) -> f32 {
    let angles = after
        .iter()
        .filter_map(|l| Some(before.iter().find(|b| b.id == l.id)?.direction.angle_between(l.direction)));
    let (sum, count) = angles.fold((0.0, 0), |(s, n), a| (s + a, n + 1));
    if count == 0 { 0.0 } else { sum / count as f32 }
}

#[test]
fn buffers_of_exactly_the_computed_length_are_accepted() {
    let order = 3;
    let made = |bits: usize| {
        let bits = || vec![0u8; bits];
        let room = || vec![Light::default(); 9];
        let tracks = || [vec![LightFilter::default(); 9], vec![LightFilter::default(); 8]];
        let memory = Memory {
            interior: [bits(), bits()],
            leaves: vec![Leaf::default(); 9],
            lights: [room(), room()],
            tracks: tracks(),
            workspace: Box::<Workspace>::default(),
        };
        Adaptive::try_new(Domain::Hemisphere, Order::saturating(order), memory)
    };
    // 2^(3 + 2 order) nodes above the texels, one bit each.
    assert_eq!(bits_len(Domain::Hemisphere, Order::saturating(order)), 64);
    assert_eq!(made(63).map(|_| ()), Err(TooSmall { needed: 64, lent: 63 }));
    let mut sampler = made(64).expect("bit sets of the computed length");
    // The shortest list determines the capacity.
    assert_eq!(sampler.capacity(), 8);
    let map = random(Domain::Hemisphere, order, 8);
    assert_eq!(update(&mut sampler, &map, 9).len(), 8, "the capacity");
    // A map finer than the bit sets gives no lights.
    assert_eq!(update(&mut sampler, &random(Domain::Hemisphere, 4, 8), 8), []);
}
