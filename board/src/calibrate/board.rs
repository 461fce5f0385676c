//! The board that is shown to the camera.

use super::pose::Sighting;
use std::str::FromStr;

/// A chessboard by its inner corners.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Board {
    /// Corners of a row.
    pub columns: u32,
    /// Rows of corners.
    pub rows: u32,
}

/// Fewest and most corners of a row or column.
const SIDES: std::ops::RangeInclusive<u32> = 3..=60;

impl FromStr for Board {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let sides = text.split_once(['x', 'X']);
        let sides = sides.and_then(|(columns, rows)| Some((columns.parse().ok()?, rows.parse().ok()?)));
        let board = sides.map(|(columns, rows)| Self { columns, rows });
        let allowed = board.filter(|b| SIDES.contains(&b.columns) && SIDES.contains(&b.rows));
        allowed.ok_or_else(|| "expected COLUMNSxROWS of inner corners, each from 3 to 60, such as 8x6".into())
    }
}

impl std::fmt::Display for Board {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}x{}", self.columns, self.rows)
    }
}

impl Board {
    /// Number of inner corners.
    #[must_use]
    pub fn corners(self) -> usize {
        self.columns as usize * self.rows as usize
    }

    pub(super) fn size(self) -> [i32; 2] {
        [self.columns as i32, self.rows as i32]
    }

    /// All places that a corner may have on a board of which `seen` are known: a partly seen board does not tell which columns it lacks.
    pub(super) fn around(self, seen: &[Sighting]) -> Vec<[i32; 2]> {
        let bounds = |axis: usize| {
            let values = || seen.iter().map(|s| s.cell[axis]);
            let (low, high) = (values().min().unwrap_or(0), values().max().unwrap_or(0));
            let spare = (self.size()[axis] - (high - low + 1)).max(0);
            low - spare..=high + spare
        };
        bounds(1).flat_map(|j| bounds(0).map(move |i| [i, j])).collect()
    }
}
