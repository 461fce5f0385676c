//! Tests of the renderer against closed forms of the radiance.

use super::scene::{Hit, Ray};
use super::*;
use crate::metrics::Lit;
use crate::metrics::vector::unit;

fn room(width: usize) -> EnvMap {
    EnvMap::from_fn(width, width / 2, crate::scenario::stage::room)
}

fn below(x: f64, y: f64) -> Hit {
    let ray = Ray { origin: [x, y, 0.005], direction: [0.0, 0.0, -1.0] };
    Scene::STANDARD.hit(&ray).expect("the ray hits the ground")
}

#[test]
fn one_light_per_texel_renders_like_the_reference() {
    let env = room(64);
    let grid = TexelGrid::new(&env, Domain::Sphere);
    let lights = grid.fluxes(&env).enumerate();
    let lit = |(k, (direction, irradiance))| Lit { direction, irradiance, radius_deg: 0.0, id: k as u32 };
    let set = LitSet::from(lights.map(lit).collect::<Vec<_>>());
    let camera = PinholeCamera::new([24, 16]);
    let [a, b] = [of_map(&env), of_set(&set)].map(|l| shoot(&Scene::STANDARD, &camera, &l, &env, "test"));
    assert!(picture::relative_rms(&a, &b) < 1e-12);
    assert!(
        a.surface.iter().any(|s| *s) && a.surface.iter().any(|s| !*s),
        "the picture has surfaces and sky"
    );
}

#[test]
fn quads_of_a_large_map_render_like_its_texels() {
    let (large, small) = (room(256), room(64));
    assert_eq!(of_map(&small).len(), 64 * 32);
    assert_eq!(of_map(&large).len(), 3072);
    let energy = |lights: &[Directional]| lights.iter().map(|l| luminance(l.irradiance)).sum::<f64>();
    let truth: f64 = TexelGrid::new(&large, Domain::Sphere).luminous(&large).map(|(_, y)| y).sum();
    assert!((energy(&of_map(&large)) / truth - 1.0).abs() < 1e-4);
}

#[test]
fn the_shadow_of_the_sphere_has_its_analytic_shape() {
    // For the ball of radius 1 around (-1.75, 0.1, 1), the ground at p is dark if the line p + s l passes within 1 of its centre.
    let centre = [-1.75, 0.1, 1.0];
    let l = unit([-0.7, -0.2, 0.9]).unwrap();
    let (mut dark, mut wrong) = (0, 0);
    for k in 0..1600 {
        let (x, y) = (-3.5 + 0.06 * f64::from(k % 40), -1.2 + 0.06 * f64::from(k / 40));
        let off = [centre[0] - x, centre[1] - y, centre[2]];
        let along: f64 = (0..3).map(|i| off[i] * l[i]).sum();
        let distance2 = (0..3).map(|i| off[i] * off[i]).sum::<f64>() - along * along;
        let shadow = distance2 < 1.0;
        let hit = below(x, y);
        // Ground points at the rim of the shadow and in the shadows of the box and the torus are not compared.
        if (distance2 - 1.0).abs() > 0.01 && hit.ground && x < -0.6 {
            dark += usize::from(shadow);
            wrong += usize::from(Scene::STANDARD.sees(&hit, l) == shadow);
        }
    }
    assert!(dark > 100 && wrong == 0, "{wrong} wrong, {dark} dark");
}

#[test]
fn open_ground_has_the_radiance_of_lamberts_law() {
    let light = Directional { direction: unit([0.3, -0.4, 0.8]).unwrap(), irradiance: [2.0, 1.0, 0.5] };
    let hit = below(5.0, -5.0);
    let seen = shade::radiance(&Scene::EMPTY, &hit, [0.0, 0.0, -1.0], &[light]);
    for (value, irradiance) in seen.into_iter().zip(light.irradiance) {
        assert!((value - 0.5 * irradiance * light.direction[2] / PI).abs() < 1e-12);
    }
    let from_below = Directional { direction: [0.0, 0.6, -0.8], ..light };
    assert_eq!(shade::radiance(&Scene::EMPTY, &hit, [0.0, 0.0, -1.0], &[from_below]), [0.0; 3]);
}

#[test]
fn ambient_light_of_a_constant_sky_renders_like_the_sky() {
    // c00 = 2 sqrt(pi) L for radiance L; on open ground E = pi L, so that the ground of albedo 1/2 has L / 2.
    let mut rows = [[0.0; 3]; 9];
    rows[0] = [3.0 * 2.0 * PI.sqrt(); 3];
    let lights = of_set(&LitSet { lights: Vec::new(), ambient_sh: Some(rows) });
    let seen = shade::radiance(&Scene::EMPTY, &below(5.0, -5.0), [0.0, 0.0, -1.0], &lights);
    assert!((seen[0] / 1.5 - 1.0).abs() < 0.01, "{seen:?}");
}

#[test]
fn photographs_change_only_at_objects_and_their_shadows() {
    let photo = image::RgbImage::from_pixel(60, 40, image::Rgb([120, 110, 100]));
    assert_eq!(over::composite(&photo, &[]).get_pixel(59, 39), photo.get_pixel(59, 39));
    let light = Directional { direction: unit([-0.3, -0.3, 0.9]).unwrap(), irradiance: [3.0; 3] };
    let made = over::composite(&photo, &[light]);
    assert_eq!(made.get_pixel(0, 0), photo.get_pixel(0, 0), "the sky is unchanged");
    assert_eq!(made.get_pixel(2, 38), photo.get_pixel(2, 38), "unshadowed ground is unchanged");
    assert!(made.pixels().zip(photo.pixels()).filter(|(a, b)| a != b).count() > 200);
}

#[test]
fn hostile_inputs_are_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::write(path("set.json"), r#"{"version": 1, "lights": []}"#).unwrap();
    std::fs::write(path("junk"), b"\x89PNG\r\n\x1a\nnothing\n\nmore").unwrap();
    exr::prelude::write_rgb_file(path("dark.exr"), 8, 4, |_, _| (0.0f32, 0.0, 0.0)).unwrap();
    let job = |env: &str, set: &str, over: Option<&str>| {
        run(&RenderJob {
            env: path(env),
            options: ReadOptions::default(),
            set: path(set),
            out: path("out.png"),
            over: over.map(path),
        })
    };
    for refused in [
        job("none.exr", "set.json", None),
        job("dark.exr", "junk", None),
        job("junk", "set.json", None),
        job("dark.exr", "set.json", Some("junk")),
        job("dark.exr", "set.json", Some("none.png")),
    ] {
        let error = refused.unwrap_err();
        assert!(error.code() == 1 && !error.to_string().contains('\n'), "{error}");
    }
    job("dark.exr", "set.json", None).unwrap();
    let picture = image::open(path("out.png")).unwrap();
    assert_eq!((picture.width(), picture.height()), (1928, 448), "a black map has a picture");
}
