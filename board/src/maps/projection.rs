//! Resampling of maps in other projections to latitude-longitude; the energy of every source texel is kept.
//!
//! The centre of an angular map, of a mirror ball and of the front face of a cross is the centre of the latitude-longitude map (azimuth 0,
//! horizon), with the zenith upwards. Angular maps and crosses are seen from inside, like latitude-longitude maps. A mirror ball is a photograph
//! of the ball, in which the reflection exchanges left and right. Strips of six faces are OpenEXR cube maps: +X, -X, +Y, -Y, +Z, -Z from the top,
//! with OpenEXR's axes x, y, z along azimuth 90 degrees, the zenith and azimuth 0; the outermost texels are centred on the edges of the faces.

use super::{Raster, Refusal};
use std::f64::consts::{PI, TAU};

/// The projection of a map file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Projection {
    /// Azimuth along columns, polar angle along rows.
    LatLong,
    /// A disc in which the distance from the centre is proportional to the angle from the middle direction; the rim is the opposite
    /// direction.
    Angular,
    /// The orthographic picture of a mirroring ball that fills the square image.
    MirrorBall,
    /// Six faces: a vertical cross of 3 x 4, a horizontal one of 4 x 3, or a strip of 1 x 6.
    Cube,
}

/// Number of samples along each side of a texel of the latitude-longitude map.
const SAMPLES: usize = 4;

/// Mapping between directions and texels of a projection.
trait TexelMapping {
    /// Returns column and row of the texel that contains a unit direction, whose components are forward, left, up.
    fn texel(&self, direction: [f64; 3]) -> [f64; 2];
    /// Returns the unit direction of the centre of a texel, with the components forward, left, up.
    fn direction(&self, column: usize, row: usize) -> [f64; 3];
    /// Returns the solid angle of a texel, steradians.
    fn solid_angle(&self, column: usize, row: usize) -> f64;
    /// Returns the number of columns of a latitude-longitude map of about the same resolution.
    fn columns(&self) -> usize;
}

/// Resamples `raster` from `projection` to latitude-longitude; the sum of radiance times solid angle is kept.
pub(super) fn to_lat_long(raster: Raster, projection: Projection) -> Result<Raster, Refusal> {
    let (width, height) = (raster.width, raster.height);
    let square = || {
        let found = format!("{width} x {height} texels");
        if width == height {
            Ok(width as f64)
        } else {
            Err(Refusal::new(found, "a square map for this projection"))
        }
    };
    match projection {
        Projection::LatLong => Ok(raster),
        Projection::Angular => resample(&raster, &Angular { side: square()? }),
        Projection::MirrorBall => resample(&raster, &MirrorBall { side: square()? }),
        Projection::Cube => resample(&raster, &Cube::new(width, height)?),
    }
}

fn resample(from: &Raster, source: &impl TexelMapping) -> Result<Raster, Refusal> {
    let width = source.columns().max(2);
    let height = width / 2;
    let too_large = |_| {
        Refusal::new(format!("{width} x {height} texels after projection"), "a map that fits into memory")
    };
    let mut weights: Vec<f32> = Vec::new();
    weights.try_reserve_exact(from.texels.len()).map_err(too_large)?;
    weights.resize(from.texels.len(), 0.0);
    let mut texels: Vec<[f32; 3]> = Vec::new();
    texels.try_reserve_exact(width * height).map_err(too_large)?;
    let target = LatLongTarget { width, height };
    target.for_each_sample(|_, direction, omega| weights[index(from, source, direction)] += omega as f32);
    texels.resize(width * height, [0.0; 3]);
    // The energy of each source texel is distributed to the samples that lie in the texel. If no sample does, the energy is added to the
    // target texel at its centre.
    for (k, weight) in weights.iter_mut().enumerate() {
        let (column, row) = (k % from.width, k / from.width);
        let omega = source.solid_angle(column, row);
        if *weight > 0.0 {
            *weight = omega as f32 / *weight;
        } else if omega > 0.0 {
            let at = target.index(source.direction(column, row));
            let share = (omega / target.solid_angle(at / width)) as f32;
            texels[at].iter_mut().zip(from.texels[k]).for_each(|(sum, v)| *sum += v * share);
        }
    }
    target.for_each_sample(|at, direction, omega| {
        let k = index(from, source, direction);
        let share = weights[k] * (omega / target.solid_angle(at / width)) as f32;
        texels[at].iter_mut().zip(from.texels[k]).for_each(|(sum, v)| *sum += v * share);
    });
    Ok(Raster { width, height, texels })
}

fn index(from: &Raster, source: &impl TexelMapping, direction: [f64; 3]) -> usize {
    let [column, row] = source.texel(direction);
    let within = |v: f64, count: usize| (v.max(0.0) as usize).min(count - 1);
    within(row, from.height) * from.width + within(column, from.width)
}

/// Size of the latitude-longitude map that is computed.
struct LatLongTarget {
    width: usize,
    height: usize,
}

impl LatLongTarget {
    fn solid_angle(&self, row: usize) -> f64 {
        let edge = |i: usize| (i as f64 * PI / self.height as f64).cos();
        (edge(row) - edge(row + 1)) * TAU / self.width as f64
    }

    /// Returns the index of the target texel that contains a unit direction.
    fn index(&self, [forward, left, up]: [f64; 3]) -> usize {
        let row = up.clamp(-1.0, 1.0).acos() / PI * self.height as f64;
        let column = (PI - left.atan2(forward)) / TAU * self.width as f64;
        (row as usize).min(self.height - 1) * self.width + (column as usize).min(self.width - 1)
    }

    /// Calls `visit(texel, direction, solid angle)` for every sample of the latitude-longitude map.
    fn for_each_sample(&self, mut visit: impl FnMut(usize, [f64; 3], f64)) {
        let fraction = |k: usize, n: usize| (k as f64 + 0.5) / (n * SAMPLES) as f64;
        for i in 0..self.height * SAMPLES {
            let theta = fraction(i, self.height) * PI;
            let (sin, cos) = theta.sin_cos();
            let row = i / SAMPLES;
            let omega = self.solid_angle(row) / (SAMPLES * SAMPLES) as f64;
            for j in 0..self.width * SAMPLES {
                let (s, c) = (PI - fraction(j, self.width) * TAU).sin_cos();
                visit(row * self.width + j / SAMPLES, [sin * c, sin * s, cos], omega);
            }
        }
    }
}

struct Angular {
    side: f64,
}

impl TexelMapping for Angular {
    fn texel(&self, [forward, left, up]: [f64; 3]) -> [f64; 2] {
        let across = left.hypot(up);
        let radius = across.atan2(forward) / PI;
        disc(self.side, if across > 0.0 { [-left * radius / across, up * radius / across] } else { [0.0; 2] })
    }

    fn direction(&self, column: usize, row: usize) -> [f64; 3] {
        let [x, y] = point(self.side, column, row);
        let radius = x.hypot(y).max(1e-12);
        let (sin, cos) = (radius.min(1.0) * PI).sin_cos();
        [cos, -x / radius * sin, y / radius * sin]
    }

    fn solid_angle(&self, column: usize, row: usize) -> f64 {
        let [x, y] = point(self.side, column, row);
        let radius = x.hypot(y);
        let slope = if radius > 0.0 { PI * (PI * radius).sin() / radius } else { PI * PI };
        if radius < 1.0 { slope * 4.0 / (self.side * self.side) } else { 0.0 }
    }

    fn columns(&self) -> usize {
        self.side as usize
    }
}

struct MirrorBall {
    side: f64,
}

impl TexelMapping for MirrorBall {
    fn texel(&self, [forward, left, up]: [f64; 3]) -> [f64; 2] {
        // The normal of the ball halves the angle between the direction and the viewer.
        let length = (2.0 * (1.0 + forward)).max(1e-12).sqrt();
        disc(self.side, [left / length, up / length])
    }

    fn direction(&self, column: usize, row: usize) -> [f64; 3] {
        // The direction is the reflection of the viewer's direction at the normal (x, y, z) of the ball.
        let [x, y] = point(self.side, column, row);
        let z = (1.0 - x * x - y * y).max(0.0).sqrt();
        [2.0 * z * z - 1.0, 2.0 * z * x, 2.0 * z * y]
    }

    fn solid_angle(&self, column: usize, row: usize) -> f64 {
        // The ratio of sin(theta) dtheta dphi to r dr dphi with r = sin(theta / 2) is 4.
        let [x, y] = point(self.side, column, row);
        if x.hypot(y) < 1.0 { 16.0 / (self.side * self.side) } else { 0.0 }
    }

    fn columns(&self) -> usize {
        2 * self.side as usize
    }
}

/// Returns column and row of a point of the unit disc, x to the right and y up.
fn disc(side: f64, [x, y]: [f64; 2]) -> [f64; 2] {
    [(x + 1.0) / 2.0 * side, (1.0 - y) / 2.0 * side]
}

/// Returns the centre of a texel in the square from -1 to 1, x to the right and y up.
fn point(side: f64, column: usize, row: usize) -> [f64; 2] {
    let at = |k: usize| (2.0 * k as f64 + 1.0) / side - 1.0;
    [at(column), -at(row)]
}

/// A face of a cube map: its position in the image in units of faces, and the directions of its centre, of its right edge and of its upper
/// edge.
struct Face {
    place: [usize; 2],
    centre: [f64; 3],
    right: [f64; 3],
    up: [f64; 3],
}

struct Cube {
    side: usize,
    faces: [Face; 6],
    /// True if the outermost texels of a face are centred on the face's edges, as OpenEXR defines it, and extend beyond the edges by half a
    /// texel.
    has_texels_on_edges: bool,
}

const FORWARD: [f64; 3] = [1.0, 0.0, 0.0];
const BACK: [f64; 3] = [-1.0, 0.0, 0.0];
const LEFT: [f64; 3] = [0.0, 1.0, 0.0];
const RIGHT: [f64; 3] = [0.0, -1.0, 0.0];
const UP: [f64; 3] = [0.0, 0.0, 1.0];
const DOWN: [f64; 3] = [0.0, 0.0, -1.0];

impl Cube {
    fn new(width: usize, height: usize) -> Result<Self, Refusal> {
        let face = |column, row, centre, right, up| Face { place: [column, row], centre, right, up };
        let middle = |row| {
            [face(0, row, LEFT, FORWARD, UP), face(1, row, FORWARD, RIGHT, UP), face(2, row, RIGHT, BACK, UP)]
        };
        let caps = [face(1, 0, UP, RIGHT, BACK), face(1, 2, DOWN, RIGHT, FORWARD)];
        let [left, front, right] = middle(1);
        let [top, bottom] = caps;
        let cross = |side, back| Self {
            side,
            faces: [left, front, right, top, bottom, back],
            has_texels_on_edges: false,
        };
        if width.is_multiple_of(3) && 4 * width == 3 * height {
            // The back face is below the bottom face in the image, rotated by half a turn.
            let back = face(1, 3, BACK, RIGHT, DOWN);
            return Ok(cross(width / 3, back));
        }
        if height.is_multiple_of(3) && 3 * width == 4 * height {
            let back = face(3, 1, BACK, LEFT, UP);
            return Ok(cross(height / 3, back));
        }
        if 6 * width == height {
            let faces = [
                face(0, 0, LEFT, FORWARD, UP),
                face(0, 1, RIGHT, BACK, UP),
                face(0, 2, UP, LEFT, FORWARD),
                face(0, 3, DOWN, LEFT, BACK),
                face(0, 4, FORWARD, RIGHT, UP),
                face(0, 5, BACK, LEFT, UP),
            ];
            return Ok(Self { side: width, faces, has_texels_on_edges: width > 1 });
        }
        Err(Refusal::new(format!("{width} x {height} texels"), "a cube map of 3:4, 4:3 or 1:6"))
    }

    /// Returns the position in texels, from the first texel of a face, of the face coordinate `v` from -1 to 1; the fractional part is the
    /// position within the texel.
    fn place(&self, v: f64) -> f64 {
        let side = self.side as f64;
        let at = if self.has_texels_on_edges {
            (v + 1.0) / 2.0 * (side - 1.0) + 0.5
        } else {
            (v + 1.0) / 2.0 * side
        };
        at.clamp(0.0, side - 1e-6)
    }

    /// Inverts [`Self::place`]: returns the face coordinate of a position in texels, not clamped.
    fn position(&self, place: f64) -> f64 {
        let side = self.side as f64;
        if self.has_texels_on_edges {
            2.0 * (place - 0.5) / (side - 1.0) - 1.0
        } else {
            2.0 * place / side - 1.0
        }
    }
}

impl TexelMapping for Cube {
    fn texel(&self, direction: [f64; 3]) -> [f64; 2] {
        let along = |axis: [f64; 3]| direction[0] * axis[0] + direction[1] * axis[1] + direction[2] * axis[2];
        let best = self.faces.iter().max_by(|a, b| along(a.centre).total_cmp(&along(b.centre)));
        let face = best.unwrap_or(&self.faces[0]);
        let depth = along(face.centre).max(1e-9);
        let within = |v: f64| self.place(v / depth);
        let origin = face.place.map(|k| (k * self.side) as f64);
        [origin[0] + within(along(face.right)), origin[1] + within(-along(face.up))]
    }

    fn direction(&self, column: usize, row: usize) -> [f64; 3] {
        let place = [column / self.side, row / self.side];
        let Some(face) = self.faces.iter().find(|f| f.place == place) else { return FORWARD };
        let centre = |k: usize| self.position((k % self.side) as f64 + 0.5);
        let [x, y] = [centre(column), -centre(row)];
        let d = [0, 1, 2].map(|i| face.centre[i] + face.right[i] * x + face.up[i] * y);
        let length = (1.0 + x * x + y * y).sqrt();
        d.map(|v| v / length)
    }

    fn solid_angle(&self, column: usize, row: usize) -> f64 {
        let place = [column / self.side, row / self.side];
        if self.faces.iter().all(|f| f.place != place) {
            return 0.0;
        }
        let corner = |k: usize| self.position(k as f64).clamp(-1.0, 1.0);
        let area = |x: f64, y: f64| (x * y).atan2((x * x + y * y + 1.0).sqrt());
        let (i, j) = (column % self.side, row % self.side);
        let (x, y) = ([corner(i), corner(i + 1)], [corner(j), corner(j + 1)]);
        area(x[1], y[1]) - area(x[0], y[1]) - area(x[1], y[0]) + area(x[0], y[0])
    }

    fn columns(&self) -> usize {
        4 * self.side
    }
}
