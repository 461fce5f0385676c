//! Scores of light sets against the map of each frame: the errors of `hemilux-sim score` over part of its receivers, so that a board can compute
//! them while it processes frames.
//!
//! Every third of the 768 open receivers and every second of the 512 shadowed ones is used. The map is given as a sketch: the quads of one order
//! with their energy and centroid. With 2048 quads, the sketch has a hundred times as many directions as the scored sets have lights.

use glam::Vec3;
use hemilux_core::Order;
use hemilux_core::color::luminance;
use hemilux_core::harmonics::basis;
use hemilux_core::healpix::{self, Domain};
use hemilux_core::light::{Light, Sh9};
use hemilux_core::pyramid::Quad;
use hemilux_core::receiver::{self, OPEN, SHADOWED, Shadowed};

/// Number of receivers that are scored of each kind, open and shadowed.
const LOOKED_AT: usize = 256;

/// Largest number of points that replace a light which is read as a uniform disc.
const MOST_POINTS: usize = 48;

/// Largest number of points of all discs of a set together; each disc of a larger set gets fewer points.
const DISC_POINTS: usize = MOST_POINTS * 64;

/// The golden angle, by which the azimuths of successive points of a disc differ, radians.
const GOLDEN: f32 = 2.399_963;

/// A light set to be scored: lights and ambient radiance.
#[derive(Clone, Copy, Debug)]
pub struct Lit<'a> {
    /// Lights of the judged set.
    pub lights: &'a [Light],
    /// Ambient radiance of the set, as spherical harmonics.
    pub ambient: Option<&'a Sh9>,
}

/// Errors of a light set, all dimensionless ratios.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Score {
    /// RMS error of irradiance over the open receivers, divided by the mean irradiance.
    pub open: f32,
    /// RMS error of irradiance over the receivers with an occluding cone, divided by their mean irradiance.
    pub shadowed: f32,
    /// Like `open`, with the lights read as uniform discs of their radius.
    pub soft_open: f32,
    /// Like `shadowed`, with the lights read as uniform discs of their radius.
    pub soft_shadowed: f32,
    /// Difference between the total energies of the set and of the map, divided by the total energy of the map.
    pub energy: f32,
    /// RMS over the shadowed receivers of the difference between the changes of irradiance since the last frame by the set and by the map,
    /// divided by the mean irradiance; `None` in the first frame.
    pub flicker: Option<f32>,
}

/// A receiver: its normal, and the cone of directions that an occluder hides.
#[derive(Clone, Copy, Debug)]
struct Receiver {
    normal: Vec3,
    axis: Vec3,
    /// Cosine of the half-angle of the occluding cone; above 1 for a receiver without a cone.
    cos: f32,
}

/// Point lights, in one array per component so that sums run in vector registers.
#[derive(Clone, Debug, Default)]
struct Points {
    axes: [Vec<f32>; 3],
    energies: Vec<f32>,
}

/// Irradiance of each receiver by a map or a light set.
type Irradiances = Vec<f32>;

/// Scores `N` light sets of each frame against the map of the frame.
#[derive(Clone, Debug)]
pub struct Judge<const N: usize> {
    open: Vec<Receiver>,
    shadowed: Vec<Receiver>,
    points: Points,
    /// Number of the last scored frame, and the irradiances of the shadowed receivers in it: by the map, then by each set.
    last: Option<(u64, Vec<Irradiances>)>,
}

impl<const N: usize> Default for Judge<N> {
    fn default() -> Self {
        let open = |i| {
            let normal = receiver::open(i * OPEN / LOOKED_AT);
            Receiver { normal, axis: normal, cos: 2.0 }
        };
        let shadowed = |i| {
            let Shadowed { normal, axis, half_angle } = receiver::shadowed(i * SHADOWED / LOOKED_AT);
            Receiver { normal, axis, cos: half_angle.cos() as f32 }
        };
        Self {
            open: (0..LOOKED_AT).map(open).collect(),
            shadowed: (0..LOOKED_AT).map(shadowed).collect(),
            points: Points::default(),
            last: None,
        }
    }
}

impl<const N: usize> Judge<N> {
    /// Scores the light sets `sets` of frame `frame` against the map `sketch`. Over a dark map all scores are 0.
    pub fn judge(&mut self, frame: u64, sketch: &[Quad], sets: [Lit<'_>; N]) -> [Score; N] {
        self.points.of_map(sketch);
        let total: f32 = self.points.energies.iter().sum();
        let (open, shadowed) = (self.points.seen_by(&self.open), self.points.seen_by(&self.shadowed));
        let before = self.last.take().filter(|(last, _)| last + 1 == frame);
        let mut seen = vec![shadowed];
        let scores = std::array::from_fn(|i| {
            self.points.of_set(&sets[i], sketch.len(), Points::add_points);
            let energy: f32 = self.points.energies.iter().sum();
            let (lit, shaded) = (self.points.seen_by(&self.open), self.points.seen_by(&self.shadowed));
            self.points.of_set(&sets[i], sketch.len(), Points::add_discs);
            let (soft_lit, soft_shaded) =
                (self.points.seen_by(&self.open), self.points.seen_by(&self.shadowed));
            let map = &seen[0];
            let flicker = before.as_ref().map(|(_, old)| {
                let change = |k: usize| (shaded[k] - old[i + 1][k]) - (map[k] - old[0][k]);
                over(rms((0..map.len()).map(change)), mean(map))
            });
            let score = Score {
                open: error(&lit, &open),
                shadowed: error(&shaded, map),
                soft_open: error(&soft_lit, &open),
                soft_shadowed: error(&soft_shaded, map),
                energy: over((energy - total).abs(), total),
                flicker,
            };
            seen.push(shaded);
            score
        });
        self.last = Some((frame, seen));
        scores
    }
}

impl Points {
    fn of_map(&mut self, sketch: &[Quad]) {
        self.clear();
        let order = order_of(sketch.len());
        for (ipix, quad) in (0..).zip(sketch).filter(|(_, quad)| quad.y() > 0.0) {
            let light = Light::at_centroid(1, quad, || healpix::centre(order, ipix).as_vec3());
            self.push(light.direction, quad.y());
        }
    }

    /// Replaces the points by the lights of the set, which `add_lights` adds, and by its ambient light, as one point at the centre of each
    /// of `quads` quads.
    fn of_set(&mut self, set: &Lit<'_>, quads: usize, add_lights: impl Fn(&mut Self, &[Light])) {
        self.clear();
        add_lights(self, set.lights);
        let Some(sh) = set.ambient else { return };
        let order = order_of(quads);
        for ipix in 0..Domain::Hemisphere.quads(order) as u32 {
            let d = healpix::centre(order, ipix).as_vec3();
            let radiance: f32 = basis(d).iter().zip(sh).map(|(b, rgb)| b * luminance(*rgb)).sum();
            let omega = healpix::solid_angle(order) * Domain::Hemisphere.share(order, ipix);
            self.push(d, radiance * omega as f32);
        }
    }

    fn add_points(&mut self, lights: &[Light]) {
        for light in lights {
            self.push(light.direction, luminance(light.irradiance));
        }
    }

    /// Adds the lights as discs: each disc is a spiral of points of equal energy. Over the hemisphere, a disc whose centre is above the
    /// horizon counts whole.
    fn add_discs(&mut self, lights: &[Light]) {
        let each = (DISC_POINTS / lights.len().max(1)).clamp(1, MOST_POINTS);
        for light in lights {
            let (across, up) = light.direction.any_orthonormal_pair();
            let height = 1.0 - light.radius_deg.to_radians().cos();
            let energy = luminance(light.irradiance) / each as f32;
            for k in 0..each {
                let z = 1.0 - height * if each > 1 { (k as f32 + 0.5) / each as f32 } else { 0.0 };
                let (sin, cos) = (GOLDEN * k as f32).sin_cos();
                let r = (1.0 - z * z).max(0.0).sqrt();
                self.push(light.direction * z + (across * cos + up * sin) * r, energy);
            }
        }
    }

    fn clear(&mut self) {
        self.axes.iter_mut().for_each(Vec::clear);
        self.energies.clear();
    }

    fn push(&mut self, direction: Vec3, energy: f32) {
        self.axes.iter_mut().zip(direction.to_array()).for_each(|(axis, v)| axis.push(v));
        self.energies.push(energy);
    }

    fn seen_by(&self, receivers: &[Receiver]) -> Irradiances {
        let [x, y, z] = &self.axes;
        let seen = |r: &Receiver| {
            let (n, a) = (r.normal, r.axis);
            let points = x.iter().zip(y).zip(z).zip(&self.energies);
            let parts = points.map(|(((x, y), z), e)| {
                let part = e * (n.x * x + n.y * y + n.z * z).max(0.0);
                if a.x * x + a.y * y + a.z * z > r.cos { 0.0 } else { part }
            });
            parts.sum()
        };
        receivers.iter().map(seen).collect()
    }
}

/// Returns the least HEALPix order at which a hemisphere has at least `quads` quads; 0 if no order below `Order::MAX` has.
fn order_of(quads: usize) -> u8 {
    (0..Order::MAX.get()).find(|order| Domain::Hemisphere.quads(*order) >= quads).unwrap_or(0)
}

fn mean(values: &[f32]) -> f32 {
    values.iter().sum::<f32>() / values.len().max(1) as f32
}

/// Returns the RMS difference of `found` and `truth`, divided by the mean of `truth`.
fn error(found: &[f32], truth: &[f32]) -> f32 {
    over(rms(found.iter().zip(truth).map(|(a, b)| a - b)), mean(truth))
}

fn rms(values: impl ExactSizeIterator<Item = f32>) -> f32 {
    let count = values.len().max(1) as f32;
    (values.map(|v| v * v).sum::<f32>() / count).sqrt()
}

fn over(error: f32, scale: f32) -> f32 {
    if scale > 0.0 { error / scale } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quad(direction: Vec3, y: f32) -> Quad {
        Quad::from_light([y; 3], direction.normalize())
    }

    /// Returns a map with one lamp of luminance `y` at quad `ipix`, and the light that represents the lamp.
    fn lamp(ipix: u32, y: f32) -> (Vec<Quad>, Light) {
        let mut sketch = vec![Quad::default(); Domain::Hemisphere.quads(4)];
        let direction = healpix::centre(4, ipix).as_vec3();
        sketch[ipix as usize] = quad(direction, y);
        (sketch, Light { id: 1, direction, irradiance: [y; 3], ..Light::default() })
    }

    #[test]
    fn the_exact_light_scores_zero_and_an_empty_set_scores_the_whole_energy() {
        let (sketch, light) = lamp(100, 3.0);
        let (right, none) = (Lit { lights: &[light], ambient: None }, Lit { lights: &[], ambient: None });
        let [a, b] = Judge::default().judge(0, &sketch, [right, none]);
        assert!(a.open < 1e-5 && a.shadowed < 1e-5 && a.energy < 1e-6 && a.flicker.is_none(), "{a:?}");
        // Over normals of the whole sphere, the RMS of max(0, cos) divided by its mean is sqrt(1/6) / (1/4).
        assert!((b.open - 1.633).abs() < 0.02 && b.energy == 1.0, "{b:?}");
    }

    #[test]
    fn flicker_is_the_change_that_the_map_lacks_and_needs_an_earlier_frame() {
        let ((one, a), (other, b)) = (lamp(100, 3.0), lamp(700, 3.0));
        let mut judge = Judge::default();
        let lit = |light| Lit { lights: light, ambient: None };
        let (a, b) = ([a], [b]);
        judge.judge(7, &one, [lit(&a), lit(&b)]);
        let [follows, stays] = judge.judge(8, &other, [lit(&b), lit(&b)]);
        assert!(follows.flicker.is_some_and(|f| f < 1e-5), "{follows:?}");
        assert!(stays.flicker.is_some_and(|f| f > 0.5), "the map has moved, the light has not: {stays:?}");
        let [late, _] = judge.judge(10, &one, [lit(&a), lit(&b)]);
        assert_eq!(late.flicker, None, "a frame is missing");
    }

    #[test]
    fn a_uniform_sky_as_ambient_harmonics_has_no_error() {
        let quads = 0..Domain::Hemisphere.quads(4) as u32;
        let omega = |ipix| (healpix::solid_angle(4) * Domain::Hemisphere.share(4, ipix)) as f32;
        let sketch: Vec<_> = quads.map(|i| quad(healpix::centre(4, i).as_vec3(), 2.0 * omega(i))).collect();
        let mut sh = Sh9::default();
        sh[0] = [2.0 / 0.282_095; 3];
        let [score] = Judge::default().judge(0, &sketch, [Lit { lights: &[], ambient: Some(&sh) }]);
        assert!(score.open < 1e-3 && score.shadowed < 1e-3 && score.energy < 1e-4, "{score:?}");
    }

    #[test]
    fn a_wide_disc_scores_well_as_a_disc_and_badly_as_a_point() {
        let (axis, cos) = (Vec3::Z, 30f32.to_radians().cos());
        let quads = 0..Domain::Hemisphere.quads(4) as u32;
        let direction = |ipix| healpix::centre(4, ipix).as_vec3();
        let y = |ipix| f32::from(u8::from(direction(ipix).dot(axis) > cos));
        let sketch: Vec<_> = quads.clone().map(|i| quad(direction(i), y(i))).collect();
        let irradiance = [quads.map(y).sum(); 3];
        let light = Light { id: 1, direction: axis, irradiance, radius_deg: 30.0, ..Light::default() };
        let [score] = Judge::default().judge(0, &sketch, [Lit { lights: &[light], ambient: None }]);
        assert!(score.soft_open < 0.02 && score.soft_shadowed < 0.03, "quads of 4 degrees: {score:?}");
        assert!(score.open > 0.03 && score.shadowed > 0.1, "{score:?}");
    }

    #[test]
    fn a_dark_map_scores_zero() {
        let sketch = vec![Quad::default(); Domain::Hemisphere.quads(4)];
        let [score] = Judge::default().judge(0, &sketch, [Lit { lights: &[], ambient: None }]);
        assert_eq!(score, Score::default(), "all 0");
    }
}
