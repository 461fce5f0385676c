//! Median cut [Debevec2005]: the region of greatest energy is cut in two of equal energy until there is one region for each light.

use super::cells::{Cells, Pitch};
use super::sat::{Axis, Rect, Region, Sat, cut_greedily};
use crate::env::EnvMap;
use crate::metrics::{Domain, Lit};

/// Decomposes a map by median cut into any number of lights.
///
/// The published method cuts all regions in each of n rounds, which makes 2^n lights. This implementation cuts the region of greatest
/// energy in each step, so that any number of lights is possible. The longer side is measured on the sphere (width times the sine of the
/// middle theta), the cut is placed where the two energies are nearest to equal, and the light of a region lies at its energy centroid. If
/// every cut of the longer side has a black part, the shorter side is cut.
///
/// # References
/// P. Debevec, "A median cut algorithm for light probe sampling", SIGGRAPH posters 2005.
pub(super) fn decompose(map: &EnvMap, domain: Domain, lights: usize) -> Vec<Lit> {
    let cells = Cells::texels(map, domain);
    let sat = Sat::new(&cells);
    let regions = cut_greedily(&sat, lights, |flux| flux.luminance, |region| halve(&cells, &sat, region));
    regions_to_lights(&cells, &regions)
}

/// Returns one light for each region, at the centroid of the region.
pub(super) fn regions_to_lights(cells: &Cells, regions: &[Region]) -> Vec<Lit> {
    let middle = |r: Rect| ((r.rows.0 + r.rows.1) / 2) * cells.width() + (r.columns.0 + r.columns.1) / 2;
    let lit =
        |(id, region): (usize, &Region)| region.flux.lit(cells.direction(middle(region.rect)), id as u32);
    regions.iter().enumerate().map(lit).collect()
}

fn halve(cells: &Cells, sat: &Sat, region: &Region) -> Option<(Rect, Rect)> {
    let axes =
        if is_wide(cells, region.rect) { [Axis::Columns, Axis::Rows] } else { [Axis::Rows, Axis::Columns] };
    axes.into_iter().find_map(|axis| halve_along(sat, region, axis))
}

/// Returns whether the columns of `rect` span more of the sphere than its rows, along the middle row.
fn is_wide(cells: &Cells, rect: Rect) -> bool {
    let Pitch { theta: theta_pitch, phi: phi_pitch } = cells.pitch();
    let theta = (rect.rows.0 + rect.rows.1) as f64 / 2.0 * theta_pitch;
    let width = (rect.columns.1 - rect.columns.0) as f64 * phi_pitch * theta.sin();
    width > (rect.rows.1 - rect.rows.0) as f64 * theta_pitch
}

/// Returns the two parts of a region, cut along `axis` nearest to half the energy so that neither part is black.
fn halve_along(sat: &Sat, region: &Region, axis: Axis) -> Option<(Rect, Rect)> {
    let half = region.flux.luminance / 2.0;
    let mut positions = region.rect.positions(axis);
    let first = |at: usize| sat.flux(region.rect.cut(axis, at).0).luminance;
    // The energy before the cut increases with the position, so a binary search finds the first position at or past the half.
    let (mut from, mut to) = (positions.start, positions.end);
    while from < to {
        let at = (from + to) / 2;
        if first(at) < half { from = at + 1 } else { to = at }
    }
    let balanced = |at: &usize| {
        let (a, b) = region.rect.cut(axis, *at);
        sat.is_lit(&sat.flux(a)) && sat.is_lit(&sat.flux(b))
    };
    let off = |at: usize| (first(at) - half).abs();
    let near = [from.wrapping_sub(1), from].into_iter().filter(|at| positions.contains(at)).filter(balanced);
    let best = near.min_by(|&a, &b| off(a).total_cmp(&off(b))).or_else(|| positions.find(balanced))?;
    Some(region.rect.cut(axis, best))
}
