//! Fewer lights for a client that can draw no more.

use hemilux_core::color::{add, luminance};
use hemilux_core::light::Light;

/// Most light pairs that are compared; above it the darkest lights' places are not looked for, their energy goes to all alike.
const MOST_PAIRS: usize = 8_000_000;

/// `lights` thinned to at most `most`: the brightest stay, with their ids, and each other one's irradiance goes to the nearest that
/// stays, whose direction moves accordingly. The sum of irradiance is kept.
#[must_use]
pub fn thin(lights: &[Light], most: usize) -> Vec<Light> {
    let mut order: Vec<_> = lights.iter().collect();
    order.sort_by(|a, b| luminance(b.irradiance).total_cmp(&luminance(a.irradiance)).then(a.id.cmp(&b.id)));
    let (kept, rest) = order.split_at(most.min(order.len()));
    let mut thinned: Vec<Light> = kept.iter().map(|l| **l).collect();
    let mut moments: Vec<_> = kept.iter().map(|l| l.direction * luminance(l.irradiance)).collect();
    let near = (MOST_PAIRS / kept.len().max(1)).min(rest.len());
    for light in &rest[..near] {
        let closeness = |(_, k): &(usize, &&Light)| k.direction.dot(light.direction);
        let nearest = kept.iter().enumerate().max_by(|a, b| closeness(a).total_cmp(&closeness(b)));
        if let Some((i, _)) = nearest {
            add(&mut thinned[i].irradiance, light.irradiance);
            moments[i] += light.direction * luminance(light.irradiance);
        }
    }
    spread(&mut thinned, &rest[near..]);
    for (light, moment) in thinned.iter_mut().zip(moments) {
        light.direction = moment.try_normalize().unwrap_or(light.direction);
    }
    thinned
}

/// Raises all lights in proportion, by what `rest` has.
fn spread(lights: &mut [Light], rest: &[&Light]) {
    let sum = |mut all: [f32; 3], rgb: [f32; 3]| {
        add(&mut all, rgb);
        all
    };
    let extra = rest.iter().map(|l| l.irradiance).fold([0.0; 3], sum);
    let here = lights.iter().map(|l| l.irradiance).fold([0.0; 3], sum);
    for light in lights {
        for ((v, extra), here) in light.irradiance.iter_mut().zip(extra).zip(here) {
            *v += if here > 0.0 { *v * extra / here } else { 0.0 };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    fn light(id: u32, x: f32, e: f32) -> Light {
        Light { id, direction: Vec3::new(x, 0.0, 1.0).normalize(), irradiance: [e; 3], ..Light::default() }
    }

    fn energy(lights: &[Light]) -> f32 {
        lights.iter().map(|l| l.irradiance[1]).sum()
    }

    #[test]
    fn the_brightest_stay_and_the_energy_is_kept() {
        let lights = [light(1, 0.0, 1.0), light(2, 1.0, 8.0), light(3, 0.1, 9.0), light(4, 0.9, 2.0)];
        let thinned = thin(&lights, 2);
        assert_eq!(thinned.iter().map(|l| l.id).collect::<Vec<_>>(), [3, 2], "ids");
        assert_eq!((thinned[0].irradiance[0], thinned[1].irradiance[0]), (10.0, 10.0), "to the nearest");
        assert!(thinned[0].direction.x < lights[2].direction.x, "drawn to what it took in");
        assert_eq!(thin(&lights, 9).len(), 4, "no more than there are");
    }

    #[test]
    fn many_lights_keep_their_energy_within_bounded_work() {
        let lights: Vec<_> =
            (0..50_000).map(|i| light(i + 1, i as f32 / 5e4, 1.0 + (i % 7) as f32)).collect();
        let thinned = thin(&lights, 20_000);
        assert_eq!(thinned.len(), 20_000, "as asked");
        assert!((energy(&thinned) / energy(&lights) - 1.0).abs() < 1e-3, "energy");
    }
}
