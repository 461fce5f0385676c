//! Checks of the pictures of a calibration, and the reasons why no lens can be computed.

use super::detect;
use super::fit::{Fit, root_mean_square};
use super::found::Found;
use super::pose::from_directions;
use super::request::{Picture, Request};
use super::sighting::Sighting;
use super::solve::{Free, View, solve};
use super::{Board, Printed};

/// Least number of pictures that show a board.
pub(super) const FEWEST_BOARDS: usize = 3;

/// Reasons why no lens is computed; the text is one line with the remedy.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LensRefusal {
    /// There are fewer than three pictures of a board.
    #[error(
        "found {0} picture(s), expected at least 3, better 15 to 30: show the board at other places of the view and at other angles"
    )]
    FewPictures(usize),
    /// The pictures do not all have the same size.
    #[error("{name}: found {} x {} pixels, expected {} x {} as the first picture: take all pictures in one mode of one camera", size[0], size[1], expected[0], expected[1])]
    Sizes {
        /// Name of a picture with another size than the first.
        name: String,
        /// Columns and rows of that picture.
        size: [usize; 2],
        /// Columns and rows of the first picture.
        expected: [usize; 2],
    },
    /// Fewer than three pictures show the board.
    #[error(
        "found a board of {board} in {found} of {pictures} pictures, expected it in at least 3: count the inner corners where four \
         squares meet (of an AprilGrid, the tags), light the board evenly, and hold it still and sharp"
    )]
    FewBoards {
        /// Board that the calibration request states.
        board: Printed,
        /// Number of pictures in which a board was detected.
        found: usize,
        /// Number of all pictures of the calibration.
        pictures: usize,
    },
    /// The board has more corners than stated.
    #[error(
        "found a board of more than {board} inner corners in {found} pictures, expected {board}: count its corners again and state them as --board"
    )]
    LargerBoard {
        /// Board that the calibration request states.
        board: Board,
        /// Number of pictures that show more corners.
        found: usize,
    },
    /// The board has fewer corners than stated.
    #[error(
        "found boards of at most {found} inner corners, expected {board}: give --board {found}, or show the whole board"
    )]
    SmallerBoard {
        /// Board that the calibration request states.
        board: Board,
        /// Largest board that was detected in the pictures.
        found: Board,
    },
    /// One of the pictures shows two boards.
    #[error(
        "{name}: found two boards in view, expected one: cover or remove the other, or leave this picture out"
    )]
    TwoBoards {
        /// Name of the picture with two boards.
        name: String,
    },
    /// The boards cover a small part of the view.
    #[error(
        "found all boards in the {place} of the view, expected them all over it up to the rim: take more pictures with the board elsewhere"
    )]
    OnePlace {
        /// Name of the part of the view with all boards, such as `left part`.
        place: String,
    },
    /// Left and right are exchanged in one picture.
    #[error(
        "{name}: found a mirrored picture, expected all pictures the same way round: switch mirroring off in the camera, or flip the picture back"
    )]
    Mirrored {
        /// Name of the picture with a mirrored board.
        name: String,
    },
    /// The boards of all pictures are mirrored.
    #[error(
        "found all boards mirrored ({found} of {pictures} pictures), expected a black upper left square, or marks that can be read: switch mirroring off in the \
         camera; for a board that has another colour there, give --any-colours"
    )]
    AllMirrored {
        /// Number of pictures with a mirrored board.
        found: usize,
        /// Number of all pictures of the calibration.
        pictures: usize,
    },
    /// The least-squares fit found no lens that explains the corners.
    #[error(
        "found corners that fit no lens (error {rms_px:.1} px), expected at most {most_px:.1} px: keep the board flat, and take all pictures with one zoom and focus"
    )]
    NoFit {
        /// Root mean square error of the fit, pixels.
        rms_px: f64,
        /// Largest accepted root mean square error, pixels.
        most_px: f64,
    },
    /// The corner detector returned an error for a picture.
    #[error("{name}: found {found}, expected a picture in which corners can be searched")]
    Detector {
        /// Name of the refused picture.
        name: String,
        /// Error message of the corner detector.
        found: String,
    },
}

/// Checks that there are enough pictures and that all of them have the size of the first.
pub(super) fn pictures(pictures: &[Picture]) -> Result<[usize; 2], LensRefusal> {
    let few = LensRefusal::FewPictures(pictures.len());
    let expected = pictures.first().ok_or_else(|| few.clone())?.grey.size();
    if let Some(other) = pictures.iter().find(|p| p.grey.size() != expected) {
        return Err(LensRefusal::Sizes { name: other.name.clone(), size: other.grey.size(), expected });
    }
    if pictures.len() < FEWEST_BOARDS { Err(few) } else { Ok(expected) }
}

/// Refuses pictures with two boards, too few boards, and boards that cover a small part of the view.
pub(super) fn found(
    pictures: &[Picture],
    found: &[Found],
    request: &Request,
    size: [usize; 2],
) -> Result<(), LensRefusal> {
    let Printed { corners: board, .. } = request.board;
    let two = found.iter().position(|f| f.second >= board.corners() / 2 && f.second >= 9);
    if let Some(i) = two {
        return Err(LensRefusal::TwoBoards { name: pictures[i].name.clone() });
    }
    all_mirrored(pictures, found, request)?;
    let boards = found.iter().filter(|f| !f.seen.is_empty()).count();
    if boards < FEWEST_BOARDS {
        return Err(LensRefusal::FewBoards { board: request.board, found: boards, pictures: pictures.len() });
    }
    if !request.board.is_marked() {
        smaller(found, board)?;
    }
    one_place(found, size)
}

/// Refuses pictures whose marks or squares are mirrored: one picture among others, or all of them.
fn all_mirrored(pictures: &[Picture], found: &[Found], request: &Request) -> Result<(), LensRefusal> {
    let is_mirrored = |f: &Found| f.mirror > 0;
    let (mirrored, upright) =
        (found.iter().filter(|f| is_mirrored(f)).count(), found.iter().filter(|f| f.mirror < 0).count());
    let odd = if upright >= mirrored { found.iter().position(is_mirrored) } else { None };
    match odd {
        Some(i) => Err(LensRefusal::Mirrored { name: pictures[i].name.clone() }),
        None if mirrored >= 2 && !(request.any_colours && upright == 0) => {
            Err(LensRefusal::AllMirrored { found: mirrored, pictures: pictures.len() })
        }
        None => Ok(()),
    }
}

/// Refuses a stated board that is larger than all boards found, if many pictures agree on their size.
fn smaller(found: &[Found], board: Board) -> Result<(), LensRefusal> {
    // One or two corners are more likely an error of the search than a column of corners.
    let span = |f: &Found, axis: usize| {
        let filled = |line: &i32| f.seen.iter().filter(|s| s.cell[axis] == *line).count() > 2;
        (0..board.size()[axis]).filter(filled).count() as u32
    };
    let spans: Vec<[u32; 2]> = found.iter().map(|f| [span(f, 0), span(f, 1)]).collect();
    let agreeing = |one: [u32; 2]| spans.iter().filter(|other| **other == one).count();
    let Some([columns, rows]) = spans.iter().copied().max_by_key(|one| agreeing(*one)) else { return Ok(()) };
    let whole = agreeing([board.columns, board.rows]);
    if 2 * agreeing([columns, rows]) < found.len() || 6 * whole > found.len() {
        return Ok(());
    }
    Err(LensRefusal::SmallerBoard { board, found: Board { columns, rows } })
}

/// Fraction of the picture's width or height that the corners of all boards must span.
const SPANNED: f64 = 0.55;

fn one_place(found: &[Found], size: [usize; 2]) -> Result<(), LensRefusal> {
    let along = |axis: usize| {
        let values = || found.iter().flat_map(|f| &f.seen).map(|s| s.at[axis] / size[axis] as f64);
        (values().fold(1.0, f64::min), values().fold(0.0, f64::max))
    };
    let [(left, right), (top, bottom)] = [along(0), along(1)];
    if right - left > SPANNED || bottom - top > SPANNED {
        return Ok(());
    }
    let part = |low: f64, high: f64, names: [&'static str; 3]| match 0.5 * (low + high) {
        middle if middle < 0.42 => names[0],
        middle if middle > 0.58 => names[2],
        _ => names[1],
    };
    let place = [part(top, bottom, ["upper", "", "lower"]), part(left, right, ["left", "", "right"])];
    let place = place.into_iter().filter(|word| !word.is_empty()).collect::<Vec<_>>().join(" ");
    Err(LensRefusal::OnePlace {
        place: if place.is_empty() { "middle".into() } else { format!("{place} part") },
    })
}

/// Refuses boards with corners beyond the stated size.
pub(super) fn larger(pictures: &[Picture], fit: &Fit, board: Board) -> Result<(), LensRefusal> {
    let shows_more = |(view, picture): (&View, &usize)| {
        let sides = detect::beyond(&pictures[*picture].grey, &fit.model, view, board);
        sides.iter().any(|[found, places]| *places >= 3 && 3 * found >= 2 * places)
    };
    let found = fit.views.iter().zip(&fit.pictures).filter(|pair| shows_more(*pair)).count();
    if 3 * found >= fit.views.len() { Err(LensRefusal::LargerBoard { board, found }) } else { Ok(()) }
}

/// Refuses a picture in which the fit kept few corners and which fits better with left and right exchanged.
pub(super) fn mirrored(
    pictures: &[Picture],
    found: &[Found],
    fit: &Fit,
    board: Board,
    width: usize,
) -> Result<(), LensRefusal> {
    for (i, found) in found.iter().enumerate() {
        let kept = fit.pictures.iter().position(|p| *p == i).map_or(0, |k| fit.views[k].seen.len());
        if found.seen.len() < board.corners() / 2 || 2 * kept > found.seen.len() {
            continue;
        }
        let flipped: Vec<Sighting> = found.seen.iter().map(|s| flip(s, board, width)).collect();
        let (as_is, exchanged) = (posed(fit, &found.seen), posed(fit, &flipped));
        if exchanged < 2.0 && 2.0 * exchanged < as_is {
            return Err(LensRefusal::Mirrored { name: pictures[i].name.clone() });
        }
    }
    Ok(())
}

fn flip(s: &Sighting, board: Board, width: usize) -> Sighting {
    let mut at = s.at;
    at.x = width as f64 - 1.0 - at.x;
    Sighting { cell: [board.size()[0] - 1 - s.cell[0], s.cell[1]], at }
}

/// Returns the root mean square error of a board, pixels, when only the pose of the board is fitted.
fn posed(fit: &Fit, seen: &[Sighting]) -> f64 {
    let Some(pose) = from_directions(&fit.model.camera, &fit.model.shape, seen) else { return f64::INFINITY };
    let mut views = [View { seen: seen.to_vec(), pose }];
    let mut model = fit.model;
    solve(&mut model, &mut views, 1e4, Free::Poses, 30);
    root_mean_square(views[0].residuals(&model))
}
