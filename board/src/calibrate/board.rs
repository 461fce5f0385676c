//! Calibration boards: their size, pattern and markers.

use super::sighting::Sighting;
use calib_targets_aruco::{Dictionary, resolve_dictionary};
use std::str::FromStr;

/// A grid of corners on a board: for a chessboard, its inner corners.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Board {
    /// Number of corners of a row of the board.
    pub columns: u32,
    /// Number of rows of corners of the board.
    pub rows: u32,
}

/// Least and largest number of corners of a row or column of a board.
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
    /// Returns the total number of corners of the board.
    #[must_use]
    pub fn corners(self) -> usize {
        self.columns as usize * self.rows as usize
    }

    pub(super) fn size(self) -> [i32; 2] {
        [self.columns as i32, self.rows as i32]
    }

    /// Returns all columns and rows that corners of a board may have of which the corners `seen` were detected: in a partly visible board,
    /// it is unknown at which side columns are missing.
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

/// The pattern of a printed board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// Black and white squares without marks.
    Chessboard,
    /// Black and white squares, with a marker of a dictionary in each white square.
    Charuco(Charuco),
    /// Tags of the family 36h11, with black squares between their corners.
    AprilGrid {
        /// Width of the gap between two tags, in sides of a tag.
        gap: f64,
    },
}

/// Markers in the white squares of a ChArUco board.
#[derive(Clone, Copy, Debug)]
pub struct Charuco {
    /// Dictionary from which the markers of the board are taken.
    pub dictionary: Dictionary,
    /// Side of a marker, in sides of a square.
    pub marker: f64,
}

impl PartialEq for Charuco {
    fn eq(&self, other: &Self) -> bool {
        self.dictionary.name() == other.dictionary.name() && self.marker == other.marker
    }
}

impl Charuco {
    /// Returns the markers of an OpenCV dictionary such as `DICT_4X4_50`; `None` for an unknown name or a marker side outside of 0.4 to
    /// 0.95 squares.
    #[must_use]
    pub fn new(dictionary: &str, marker: f64) -> Option<Self> {
        let dictionary = resolve_dictionary(&dictionary.to_ascii_uppercase())?;
        (0.4..=0.95).contains(&marker).then_some(Self { dictionary, marker })
    }
}

/// A printed board: its corners and its pattern.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Printed {
    /// Corners of the board: inner corners of squares, or the four corners of each tag.
    pub corners: Board,
    /// Pattern of the printed board.
    pub kind: Kind,
}

impl From<Board> for Printed {
    fn from(corners: Board) -> Self {
        Self { corners, kind: Kind::Chessboard }
    }
}

impl Printed {
    /// Returns a board of tags with the columns and rows of `tags`; `None` for more tags than the family has.
    #[must_use]
    pub fn april_grid(tags: Board, gap: f64) -> Option<Self> {
        let fits = tags.columns.checked_mul(tags.rows).is_some_and(|count| count <= 587);
        let corners = Board { columns: 2 * tags.columns, rows: 2 * tags.rows };
        (fits && (0.1..=1.0).contains(&gap)).then_some(Self { corners, kind: Kind::AprilGrid { gap } })
    }

    /// Returns whether marks on the board identify each of its corners.
    pub(super) fn is_marked(&self) -> bool {
        self.kind != Kind::Chessboard
    }

    /// Returns the radius around a corner, in sides of a square or tag, within which the four fields that meet in the corner have no
    /// pattern.
    pub(super) fn plain(&self) -> f64 {
        match self.kind {
            Kind::Chessboard => 0.35,
            Kind::Charuco(Charuco { marker, .. }) => 0.3 * (1.0 - marker),
            Kind::AprilGrid { gap } => 0.35 * gap,
        }
    }

    /// Returns the position of the column or row of corners with the number `index`, in sides of a square or tag.
    pub(super) fn line(&self, index: i32) -> f64 {
        match self.kind {
            Kind::AprilGrid { gap } => {
                f64::from(index.div_euclid(2)) * (1.0 + gap) + f64::from(index.rem_euclid(2))
            }
            _ => f64::from(index),
        }
    }

    /// Returns all columns and rows that corners of this board may have, of which the corners `seen` were detected.
    pub(super) fn around(&self, seen: &[Sighting]) -> Vec<[i32; 2]> {
        if !self.is_marked() {
            return self.corners.around(seen);
        }
        let [columns, rows] = self.corners.size();
        (0..rows).flat_map(|j| (0..columns).map(move |i| [i, j])).collect()
    }

    /// Returns whether a mirrored picture of the board differs from every picture of it that is not mirrored.
    #[must_use]
    pub fn tells_mirror(&self) -> bool {
        let Board { columns, rows } = self.corners;
        self.is_marked() || (columns % 2 == 1 && rows % 2 == 1 && columns != rows)
    }
}

impl std::fmt::Display for Printed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Board { columns, rows } = self.corners;
        match self.kind {
            Kind::Chessboard => write!(f, "{}", self.corners),
            Kind::Charuco(Charuco { dictionary, .. }) => {
                write!(f, "{} (ChArUco, {})", self.corners, dictionary.name())
            }
            Kind::AprilGrid { .. } => write!(f, "{}x{} (AprilGrid)", columns / 2, rows / 2),
        }
    }
}
