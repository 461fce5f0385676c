//! Structured importance sampling [Agarwal2003]: threshold layers, farthest-first points, Voronoi strata.

use super::cells::{Cells, voronoi};
use crate::env::EnvMap;
use crate::metrics::vector::dot;
use crate::metrics::{Domain, Lit};

/// Number of threshold layers, each one standard deviation of the luminance wide; the last layer has no upper limit. More layers have little
/// effect, since a luminance of six standard deviations belongs to a light source.
const LAYERS: usize = 6;
/// Exponent b of the solid angle in the metric L^a dOmega^b (a = 1).
const SOLID_ANGLE_EXPONENT: f64 = 0.25;
/// Least solid angle in the metric, steradians, so that a lamp of a few texels receives lights.
const LEAST_SOLID_ANGLE: f64 = 0.01;
/// Largest number of columns of the map's cells.
const WIDTH: usize = 256;

/// Decomposes a map by structured importance sampling, reconstructed from the publication.
///
/// The layers are [i sigma, (i + 1) sigma) of luminance, where sigma is its standard deviation weighted by solid angle. The connected
/// components of each layer (four neighbours, across the seam) share the lights in proportion to E max(dOmega, 0.01)^(1/4), by largest
/// remainders. Points are then placed farthest-first inside the components, the brightest layer first, at the greatest distance from all
/// points placed before (Hochbaum and Shmoys). The region of a light is its Voronoi stratum among all points; the light lies at the
/// stratum's energy centroid. Other parts of the publication (its layer details, the order of shadow rays) are not reproduced.
///
/// # References
/// S. Agarwal, R. Ramamoorthi, S. Belongie, H. W. Jensen, "Structured importance sampling of environment
/// maps", SIGGRAPH 2003.
pub(super) fn decompose(map: &EnvMap, domain: Domain, lights: usize) -> Vec<Lit> {
    let cells = Cells::new(map, domain, WIDTH);
    let mut components = components(&cells, &layers(&cells));
    components.sort_by(|a, b| b.layer.cmp(&a.layer).then(b.metric.total_cmp(&a.metric)));
    let centres: Vec<[f64; 3]> =
        place(&cells, &components, lights).into_iter().map(|k| cells.direction(k)).collect();
    let strata = voronoi(&cells, &centres);
    strata.iter().zip(&centres).enumerate().map(|(id, (flux, &centre))| flux.lit(centre, id as u32)).collect()
}

/// Returns the layer of every cell; `None` for black cells.
fn layers(cells: &Cells) -> Vec<Option<usize>> {
    let solid_angle: f64 = (0..cells.len()).map(|k| cells.solid_angle(k)).sum();
    let mean = cells.total().luminance / solid_angle;
    let squares = (0..cells.len()).map(|k| (cells.radiance(k) - mean).powi(2) * cells.solid_angle(k));
    let sigma = (squares.sum::<f64>() / solid_angle).sqrt();
    let layer = |k: usize| {
        let lit = cells.flux(k).luminance > 0.0;
        // A sky without contrast is one layer, since its luminance divided by sigma is equal for all cells.
        lit.then(|| ((cells.radiance(k) / sigma.max(1e-9 * mean)) as usize).min(LAYERS - 1))
    };
    (0..cells.len()).map(layer).collect()
}

/// Connected cells of one layer.
struct Component {
    layer: usize,
    members: Vec<usize>,
    metric: f64,
}

fn components(cells: &Cells, layers: &[Option<usize>]) -> Vec<Component> {
    let mut seen = vec![false; cells.len()];
    let mut found = Vec::new();
    for start in 0..cells.len() {
        if let (false, Some(layer)) = (seen[start], layers[start]) {
            let members = flood(cells, layers, start, &mut seen);
            let energy: f64 = members.iter().map(|&k| cells.flux(k).luminance).sum();
            let solid_angle: f64 = members.iter().map(|&k| cells.solid_angle(k)).sum();
            let metric = energy * solid_angle.max(LEAST_SOLID_ANGLE).powf(SOLID_ANGLE_EXPONENT);
            found.push(Component { layer, members, metric });
        }
    }
    found
}

fn flood(cells: &Cells, layers: &[Option<usize>], start: usize, seen: &mut [bool]) -> Vec<usize> {
    let (width, count) = (cells.width(), cells.len());
    let mut members = vec![start];
    seen[start] = true;
    let mut next = 0;
    while let Some(&k) = members.get(next) {
        next += 1;
        let (row, column) = (k / width * width, k % width);
        let around = [
            row + (column + 1) % width,
            row + (column + width - 1) % width,
            k + width,
            k.wrapping_sub(width),
        ];
        for other in around {
            if other < count && !seen[other] && layers[other] == layers[start] {
                seen[other] = true;
                members.push(other);
            }
        }
    }
    members
}

/// Places the lights of all components, in their order; returns the index of the cell of each light.
fn place(cells: &Cells, components: &[Component], lights: usize) -> Vec<usize> {
    let mut placed = Vec::new();
    // `nearest` is the cosine of the angle from each cell to the nearest placed point.
    let mut nearest = vec![-2.0f64; cells.len()];
    for (component, count) in components.iter().zip(shares(components, lights)) {
        for _ in 0..count {
            let k = farthest(cells, &component.members, &nearest);
            placed.push(k);
            let point = cells.direction(k);
            (0..cells.len()).for_each(|at| nearest[at] = nearest[at].max(dot(cells.direction(at), point)));
            // Excludes the cell from further choices, independently of rounding errors.
            nearest[k] = f64::INFINITY;
        }
    }
    placed
}

/// Returns the cell of `members` that is farthest from all placed points; of equally far cells, and if no point is placed, the brightest
/// cell.
fn farthest(cells: &Cells, members: &[usize], nearest: &[f64]) -> usize {
    let rank = |&k: &usize| (-nearest[k], cells.radiance(k));
    let farther = |a: usize, b: usize| if rank(&b) > rank(&a) { b } else { a };
    members.iter().copied().reduce(farther).unwrap_or_default()
}

/// Returns the number of lights of each component: `lights` in total, and in each component at most the number of its cells.
fn shares(components: &[Component], lights: usize) -> Vec<usize> {
    let total: f64 = components.iter().map(|c| c.metric).sum();
    let ideal: Vec<f64> = components.iter().map(|c| lights as f64 * c.metric / total).collect();
    let mut shares: Vec<usize> =
        ideal.iter().zip(components).map(|(&share, c)| (share as usize).min(c.members.len())).collect();
    let mut left = lights.saturating_sub(shares.iter().sum());
    while left > 0 {
        let mut short: Vec<usize> =
            (0..components.len()).filter(|&i| shares[i] < components[i].members.len()).collect();
        if short.is_empty() {
            break;
        }
        short.sort_by(|&a, &b| (ideal[b] - shares[b] as f64).total_cmp(&(ideal[a] - shares[a] as f64)));
        short.truncate(left);
        short.iter().for_each(|&i| shares[i] += 1);
        left -= short.len();
    }
    shares
}
