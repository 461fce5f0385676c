//! Summed-area tables and rectangles of cells, for the baselines that cut rectangles.

use super::cells::{Cells, Flux};

/// A rectangle of a map's cells, given by rows and columns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rect {
    /// First row of the rectangle, and the row after its last.
    pub rows: (usize, usize),
    /// First column of the rectangle, and the column after its last.
    pub columns: (usize, usize),
}

/// Axis along which a rectangle of cells is cut in two.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// The cut runs between two rows of cells.
    Rows,
    /// The cut runs between two columns of cells.
    Columns,
}

impl Rect {
    /// Returns the two parts of the rectangle if it is cut before row or column `at`.
    #[must_use]
    pub fn cut(self, axis: Axis, at: usize) -> (Self, Self) {
        match axis {
            Axis::Rows => {
                (Self { rows: (self.rows.0, at), ..self }, Self { rows: (at, self.rows.1), ..self })
            }
            Axis::Columns => (
                Self { columns: (self.columns.0, at), ..self },
                Self { columns: (at, self.columns.1), ..self },
            ),
        }
    }

    /// Returns the rows or columns before which the rectangle can be cut.
    #[must_use]
    pub fn positions(self, axis: Axis) -> std::ops::Range<usize> {
        let (from, to) = match axis {
            Axis::Rows => self.rows,
            Axis::Columns => self.columns,
        };
        from + 1..to
    }
}

/// Summed-area table of [`Flux`].
///
/// # Accuracy
/// Sums are differences of f64 prefix sums, with an error of about 1e-15 of the map's total. [`Sat::is_lit`] accounts for this error.
#[derive(Debug)]
pub struct Sat {
    width: usize,
    height: usize,
    sums: Vec<Flux>,
}

impl Sat {
    /// Builds the table of the prefix sums of `cells`.
    #[must_use]
    pub fn new(cells: &Cells) -> Self {
        let (width, height) = (cells.width(), cells.height());
        let mut sums = vec![Flux::default(); (width + 1) * (height + 1)];
        for row in 0..height {
            let mut along = Flux::default();
            for column in 0..width {
                along += *cells.flux(row * width + column);
                sums[(row + 1) * (width + 1) + column + 1] = sums[row * (width + 1) + column + 1] + along;
            }
        }
        Self { width, height, sums }
    }

    /// Returns the rectangle of all cells of the map.
    #[must_use]
    pub fn whole(&self) -> Rect {
        Rect { rows: (0, self.height), columns: (0, self.width) }
    }

    /// Returns the sum of the fluxes of the cells in a rectangle; negative rounding errors are set to 0.
    #[must_use]
    pub fn flux(&self, rect: Rect) -> Flux {
        let at = |row: usize, column: usize| &self.sums[row * (self.width + 1) + column];
        let [a, b] = [at(rect.rows.0, rect.columns.0), at(rect.rows.0, rect.columns.1)];
        let [c, d] = [at(rect.rows.1, rect.columns.0), at(rect.rows.1, rect.columns.1)];
        let over =
            |of: fn(&Flux) -> [f64; 3]| std::array::from_fn(|i| of(d)[i] - of(c)[i] - (of(b)[i] - of(a)[i]));
        Flux {
            rgb: over(|f| f.rgb).map(|v: f64| v.max(0.0)),
            luminance: (d.luminance - c.luminance - (b.luminance - a.luminance)).max(0.0),
            moment: over(|f| f.moment),
        }
    }

    /// Returns whether a flux of this table is larger than its rounding error.
    #[must_use]
    pub fn is_lit(&self, flux: &Flux) -> bool {
        flux.luminance > 1e-13 * self.sums[self.sums.len() - 1].luminance
    }
}

/// A rectangle with its sums and its priority for the next cut.
#[derive(Clone, Copy, Debug)]
pub struct Region {
    /// Rectangle of cells that the region covers.
    pub rect: Rect,
    /// Sums over the cells of the rectangle.
    pub flux: Flux,
    /// Priority of the region: the one of the largest priority is cut next; a negative priority marks a region that cannot be cut.
    pub priority: f64,
}

/// Cuts the map greedily: `cut` divides the region of highest priority until there are `count` regions or no region can be cut. The list is empty
/// for a black map.
pub fn cut_greedily(
    sat: &Sat,
    count: usize,
    priority: impl Fn(&Flux) -> f64,
    cut: impl Fn(&Region) -> Option<(Rect, Rect)>,
) -> Vec<Region> {
    let region = |rect: Rect| {
        let flux = sat.flux(rect);
        Region { rect, flux, priority: priority(&flux) }
    };
    let mut regions = vec![region(sat.whole())];
    regions.retain(|region| count > 0 && region.flux.luminance > 0.0);
    while regions.len() < count {
        // Of several regions with equal priority the first is cut, so that the result is deterministic.
        let urgent =
            |best: usize, k: usize| if regions[k].priority > regions[best].priority { k } else { best };
        let Some(best) = (0..regions.len()).reduce(urgent) else { break };
        if regions[best].priority < 0.0 {
            break;
        }
        match cut(&regions[best]) {
            Some((kept, new)) => {
                regions[best] = region(kept);
                regions.push(region(new));
            }
            None => regions[best].priority = -1.0,
        }
    }
    regions
}
