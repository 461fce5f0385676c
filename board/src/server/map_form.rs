//! The form of the map that a client requests: the part of the sphere, the width, and the marks of the lights.

use crate::maps::Covers;
use crate::probe::MapView;
use crate::probe::settings::short;
use axum::extract::Query;
use axum::http::Uri;
use hemilux_core::polar::Grid;
use std::f64::consts::TAU;

/// Widths of a map that a request can choose, texels; the default is the width of the polar map.
pub(super) const WIDTHS: [u16; 6] = [64, 128, 256, 512, 1024, 2048];

/// Query parameters of a map: part of the sphere, width, marks.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub(super) struct MapForm {
    /// True if the requested map ends at the horizon; false if it covers the sphere.
    pub(super) hemisphere: bool,
    /// The width of the requested map, texels; `None` for the width of the polar map.
    pub(super) width: Option<u16>,
    /// True if the lights are drawn on the map.
    pub(super) marks: bool,
}

impl MapForm {
    /// Parses the query of a request for a map. `marks` is true if lights can be drawn on it; the default part
    /// is the sphere unless `hemisphere`.
    ///
    /// # Errors
    /// The parameter that was found, and the accepted parameters with their values, one per line.
    pub(super) fn of(uri: &Uri, hemisphere: bool, marks: bool) -> Result<Self, String> {
        let refused = |found: &str| format!("found {found}. Accepted:\n{}", accepted(marks));
        let Ok(Query(pairs)) = Query::<Vec<(String, String)>>::try_from_uri(uri) else {
            return Err(refused("a query that cannot be parsed"));
        };
        let mut form = Self { hemisphere, ..Self::default() };
        for (i, (name, value)) in pairs.iter().enumerate() {
            if pairs[..i].iter().any(|(n, _)| n == name) {
                return Err(refused(&format!("parameter '{}' twice", short(name))));
            }
            let width = || WIDTHS.into_iter().find(|w| value.parse() == Ok(*w));
            match (name.as_str(), value.as_str()) {
                ("covers", "sphere") => form.hemisphere = false,
                ("covers", "hemisphere") => form.hemisphere = true,
                ("width", _) if width().is_some() => form.width = width(),
                ("marks", "0") if marks => {}
                ("marks", "1") if marks => form.marks = true,
                _ => return Err(refused(&format!("'{}={}'", short(name), short(value)))),
            }
        }
        Ok(form)
    }

    /// Returns the part of the sphere that a map over `grid` covers in this form, and its number of rows.
    pub(super) fn extent(self, grid: &Grid) -> (Covers, usize) {
        if self.hemisphere { (Covers::Hemisphere, grid.height) } else { (Covers::Sphere, 2 * grid.height) }
    }

    /// Returns the map `view`, resampled to the width of this form.
    pub(super) fn sized(self, view: &MapView) -> MapView {
        let width = self.width.map_or(view.grid.width, usize::from);
        if width == view.grid.width { view.clone() } else { resized(view, width) }
    }
}

/// Lists the query parameters of a map and their values, one per line; the parameter `marks` only if `marks`.
fn accepted(marks: bool) -> String {
    let widths = WIDTHS.map(|w| w.to_string()).join("|");
    format!("covers=sphere|hemisphere\nwidth={widths}{}", if marks { "\nmarks=0|1" } else { "" })
}

/// Resamples the map `view` to a grid of `width` columns. A texel larger than those of `view` has the summed energy of the texels that it
/// covers, a smaller one its share of the energy of one texel.
fn resized(view: &MapView, width: usize) -> MapView {
    let from = view.grid;
    let grid = Grid { width, height: (width / 4).max(1), ..from };
    let rows = shares(from.height, grid.height, |grid_rows, at| {
        let last = if grid_rows == from.height { &from } else { &grid };
        1.0 - last.theta(at).cos()
    });
    let columns = shares(from.width, width, |count, at| TAU * at as f64 / count as f64);
    let mut texels = vec![[0.0f32; 3]; grid.len()];
    for TexelOverlap { from: i, to: row, part: high } in &rows {
        for TexelOverlap { from: j, to: column, part: wide } in &columns {
            let energy = view.texels.get(i * from.width + j).copied().unwrap_or_default();
            let part = (high * wide) as f32;
            texels[row * width + column].iter_mut().zip(energy).for_each(|(sum, v)| *sum += v * part);
        }
    }
    MapView { grid, texels, frame: view.frame, lights: view.lights.clone() }
}

/// The part of a texel's extent along a row or column that overlaps a texel of another resolution.
struct TexelOverlap {
    from: usize,
    to: usize,
    part: f64,
}

/// Returns the overlaps of `count` texels along a row or column with `others` texels of the same total extent; `edge(n, i)` is
/// the start of texel i of n.
fn shares(count: usize, others: usize, edge: impl Fn(usize, usize) -> f64) -> Vec<TexelOverlap> {
    let mut shares = Vec::with_capacity(count + others);
    let mut to = 0;
    for from in 0..count {
        let (begin, end) = (edge(count, from), edge(count, from + 1));
        loop {
            let (first, last) = (edge(others, to), edge(others, to + 1));
            let part = (end.min(last) - begin.max(first)) / (end - begin);
            if part > 0.0 {
                shares.push(TexelOverlap { from, to, part });
            }
            if last >= end || to + 1 == others {
                break;
            }
            to += 1;
        }
    }
    shares
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view() -> MapView {
        let grid = Grid::POLAR;
        let texels = (0..grid.len()).map(|i| [i as f32 % 7.0, i as f32 % 11.0 + 1.0, 0.5]).collect();
        MapView { grid, texels, frame: 3, lights: Vec::new() }
    }

    fn sum(view: &MapView) -> [f64; 3] {
        std::array::from_fn(|c| view.texels.iter().map(|t| f64::from(t[c])).sum())
    }

    #[test]
    fn every_width_keeps_the_energy() {
        let view = view();
        for width in WIDTHS {
            let form = MapForm { width: Some(width), ..MapForm::default() };
            let sized = form.sized(&view);
            assert_eq!(
                (sized.grid.width, sized.grid.height),
                (width.into(), usize::from(width) / 4),
                "shape"
            );
            for (found, expected) in sum(&sized).into_iter().zip(sum(&view)) {
                assert!((found / expected - 1.0).abs() < 1e-4, "{width}: {found}, expected {expected}");
            }
        }
    }

    #[test]
    fn uniform_radiance_stays_uniform() {
        let grid = Grid::POLAR;
        let texels = (0..grid.len()).map(|i| [2.0 * grid.solid_angle(i / grid.width) as f32; 3]).collect();
        let view = MapView { grid, texels, frame: 0, lights: Vec::new() };
        for width in WIDTHS {
            let sized = MapForm { width: Some(width), ..MapForm::default() }.sized(&view);
            for (i, texel) in sized.texels.iter().enumerate() {
                let radiance = f64::from(texel[0]) / sized.grid.solid_angle(i / sized.grid.width);
                assert!((radiance - 2.0).abs() < 1e-3, "{width}: {radiance} in texel {i}");
            }
        }
    }

    #[test]
    fn other_parameters_are_refused_with_the_accepted_ones() {
        let of = |query: &str| MapForm::of(&query.parse().expect("a URI"), false, false);
        assert_eq!(
            of("/x?covers=hemisphere&width=512").map(|f| (f.hemisphere, f.width)),
            Ok((true, Some(512)))
        );
        for query in
            ["/x?width=500", "/x?width=-1", "/x?covers=all", "/x?marks=1", "/x?width=64&width=64", "/x?y"]
        {
            let refused = of(query).expect_err(query);
            assert!(refused.contains("Accepted:\ncovers=sphere|hemisphere\nwidth=64|128"), "{refused}");
        }
    }
}
