//! Calibration from a running camera: selects pictures and reports the parts of the field of view without a board.

use super::found::Found;
use super::request::{Picture, Request};
use super::sighting::Sighting;
use super::{Calibrated, Grey, LensRefusal, detect, lens};
use std::f64::consts::TAU;

/// Largest number of pictures that the guide stores.
pub const MOST_VIEWS: usize = 40;

/// Largest number of bytes of the stored pictures in total.
const MOST_BYTES: usize = 160 << 20;

/// Number of rings into which the field of view is divided; boards must be spread over all of them.
pub const RINGS: usize = 3;
/// Number of sectors into which each ring of the field of view is divided.
pub const SECTORS: usize = 8;

/// Largest motion of a board between two pictures at which the board counts as still, in picture widths.
const STILL: f64 = 0.0015;

/// Least motion of a board from its position in each stored picture at which the position counts as new, in picture widths.
const NEW: f64 = 0.05;

/// Least slope of the edges in a sharp picture, in edge contrasts per pixel.
const SHARP: f64 = 0.12;

/// Result of offering a picture to the guide.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Offer {
    /// The picture shows no board.
    Nothing,
    /// The board moved between the last two pictures.
    Moving,
    /// The picture of the board is blurred.
    Blurred,
    /// The board is at the position that it has in a stored picture.
    Known,
    /// The size of the picture differs from that of the earlier pictures.
    OtherSize,
    /// The largest number of pictures is stored already.
    Full,
    /// The picture was stored for the calibration.
    Taken,
}

impl Offer {
    /// Returns the advice for the user on this result, one sentence.
    #[must_use]
    pub fn advice(self) -> &'static str {
        match self {
            Self::Nothing => "no board in view: show it, lit evenly, without glare",
            Self::Moving => "hold the board still",
            Self::Blurred => "the picture is blurred: hold the board still and farther away, or add light",
            Self::Known => "move the board to another place or turn it",
            Self::OtherSize => "the camera changed its mode: start again",
            Self::Full => "enough pictures: compute the lens",
            Self::Taken => "taken",
        }
    }
}

/// Numbers of board corners in each part of the field of view.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ViewCoverage {
    /// Number of corners by ring, from the centre to the rim, and by sector, clockwise from the right.
    pub corners: [[usize; SECTORS]; RINGS],
}

/// Least number of corners in a part of the field of view that counts as covered.
const FEWEST_CORNERS: usize = 6;

impl ViewCoverage {
    /// Returns whether the part in `ring` and `sector` is covered.
    #[must_use]
    pub fn has(&self, ring: usize, sector: usize) -> bool {
        // The sectors of the innermost ring are small and are counted together.
        let own = self.corners[ring][sector];
        let inner = || self.corners[0].iter().sum::<usize>() >= 2 * FEWEST_CORNERS;
        own >= FEWEST_CORNERS || (ring == 0 && inner())
    }

    /// Returns the fraction of the parts that are covered, 0 to 1.
    #[must_use]
    pub fn share(&self) -> f64 {
        let parts = (0..RINGS).flat_map(|ring| (0..SECTORS).map(move |sector| (ring, sector)));
        parts.filter(|(ring, sector)| self.has(*ring, *sector)).count() as f64 / (RINGS * SECTORS) as f64
    }

    /// Returns the name of the part of the field of view with the fewest corners; `None` if all parts are covered.
    #[must_use]
    pub fn lacking(&self) -> Option<String> {
        const PLACES: [&str; SECTORS] = [
            "right",
            "lower right",
            "lower side",
            "lower left",
            "left",
            "upper left",
            "upper side",
            "upper right",
        ];
        if !self.has(0, 0) {
            return Some("the middle of the view".into());
        }
        for ring in [2, 1] {
            let missing = (0..SECTORS).filter(|sector| !self.has(ring, *sector));
            if let Some(sector) = missing.min_by_key(|sector| self.corners[ring][*sector]) {
                let place = if ring == 2 { "the rim of the view" } else { "half way to the rim" };
                return Some(format!("{place}, {}", PLACES[sector]));
            }
        }
        None
    }
}

/// Selects pictures of a board from a stream for the calibration of a lens.
#[derive(Clone, Debug)]
pub struct Guide {
    request: Request,
    size: Option<[usize; 2]>,
    pictures: Vec<Picture>,
    found: Vec<Found>,
    /// Corners of the board in the picture that was offered last.
    last: Vec<Sighting>,
    /// Number of pictures that were offered to the guide.
    offered: usize,
}

impl Guide {
    /// Creates a guide for `request` without pictures.
    #[must_use]
    pub fn new(request: Request) -> Self {
        Self { request, size: None, pictures: Vec::new(), found: Vec::new(), last: Vec::new(), offered: 0 }
    }

    /// Returns the number of pictures that the guide has accepted.
    #[must_use]
    pub fn views(&self) -> usize {
        self.pictures.len()
    }

    /// Returns the pixels of the detected corners of each stored picture.
    #[must_use]
    pub fn corners(&self) -> Vec<Vec<[f64; 2]>> {
        self.found.iter().map(|found| found.seen.iter().map(|s| [s.at.x, s.at.y]).collect()).collect()
    }

    /// Returns the pixels of the detected corners of the picture that was offered last.
    #[must_use]
    pub fn last(&self) -> Vec<[f64; 2]> {
        self.last.iter().map(|s| [s.at.x, s.at.y]).collect()
    }

    /// Stores the picture if its board is sharp, still and at a new position.
    pub fn offer(&mut self, grey: Grey) -> Offer {
        self.offered += 1;
        if self.size.is_some_and(|size| size != grey.size()) {
            return Offer::OtherSize;
        }
        let found = detect::board(&grey, &self.request.board).unwrap_or_default();
        let before = std::mem::replace(&mut self.last, found.seen.clone());
        let offer = self.judge(&grey, &found, &before);
        if offer == Offer::Taken {
            self.size = Some(grey.size());
            self.pictures.push(Picture { name: format!("picture {}", self.offered), grey });
            self.found.push(found);
        }
        offer
    }

    fn judge(&self, grey: &Grey, found: &Found, before: &[Sighting]) -> Offer {
        let width = grey.size()[0] as f64;
        if found.seen.is_empty() {
            return Offer::Nothing;
        }
        if motion(&found.seen, before).is_none_or(|moved| moved > STILL * width) {
            return Offer::Moving;
        }
        if sharpness(grey, &found.seen) < SHARP {
            return Offer::Blurred;
        }
        let known = |other: &Found| motion(&found.seen, &other.seen).is_some_and(|moved| moved < NEW * width);
        if self.found.iter().any(known) {
            return Offer::Known;
        }
        let bytes = (self.pictures.len() + 1) * grey.pixels().len();
        if self.pictures.len() >= MOST_VIEWS || bytes > MOST_BYTES { Offer::Full } else { Offer::Taken }
    }

    /// Removes the picture that was stored last.
    pub fn undo(&mut self) {
        self.pictures.pop();
        self.found.pop();
    }

    /// Returns the number of corners in each part of the field of view over all stored pictures.
    #[must_use]
    pub fn coverage(&self) -> ViewCoverage {
        let mut coverage = ViewCoverage::default();
        let Some([width, height]) = self.size else { return coverage };
        let middle = [0.5 * (width as f64 - 1.0), 0.5 * (height as f64 - 1.0)];
        // The image circle is assumed to fill the shorter side of the picture.
        let radius = 0.5 * width.min(height) as f64;
        for s in self.found.iter().flat_map(|found| &found.seen) {
            let (x, y) = (s.at.x - middle[0], s.at.y - middle[1]);
            let ring = (x.hypot(y) / radius * RINGS as f64) as usize;
            let sector = (y.atan2(x).rem_euclid(TAU) / TAU * SECTORS as f64 + 0.5) as usize;
            coverage.corners[ring.min(RINGS - 1)][sector % SECTORS] += 1;
        }
        coverage
    }

    /// Computes the lens from the stored pictures.
    ///
    /// # Errors
    /// [`LensRefusal`] if the pictures determine no lens.
    pub fn calibrate(&self) -> Result<Calibrated, LensRefusal> {
        let Some(size) = self.size.filter(|_| self.pictures.len() >= 3) else {
            return Err(LensRefusal::FewPictures(self.pictures.len()));
        };
        lens::fitted(&self.pictures, &self.found, &self.request, size)
    }
}

/// Returns the mean motion between two pictures of the corners that both have, pixels; `None` if fewer than half of the corners are in both,
/// since they may then be numbered differently.
fn motion(now: &[Sighting], before: &[Sighting]) -> Option<f64> {
    let way =
        |s: &Sighting| before.iter().find(|other| other.cell == s.cell).map(|other| (other.at - s.at).norm());
    let ways: Vec<f64> = now.iter().filter_map(way).collect();
    (2 * ways.len() >= now.len().max(1)).then(|| ways.iter().sum::<f64>() / ways.len() as f64)
}

/// Returns the median slope of the edges between neighbouring corners, in edge contrasts per pixel.
fn sharpness(grey: &Grey, seen: &[Sighting]) -> f64 {
    let right = |s: &Sighting| seen.iter().find(|other| other.cell == [s.cell[0] + 1, s.cell[1]]).copied();
    let slope = |s: &Sighting| {
        let other = right(s)?;
        let (middle, along) = (0.5 * (s.at + other.at), other.at - s.at);
        let across = nalgebra::Vector2::new(-along.y, along.x).normalize();
        let reach = (0.3 * along.norm()).clamp(2.0, 8.0);
        let code = |t: f64| grey.sample(middle + across * t);
        let contrast = (code(reach) - code(-reach)).abs();
        let steps = (-8..8).map(|i| f64::from(i) * 0.5).filter(|t| t.abs() < reach);
        let steepest = steps.map(|t| (code(t + 0.5) - code(t - 0.5)).abs()).fold(0.0, f64::max);
        (contrast > 12.0).then(|| steepest / contrast)
    };
    let mut slopes: Vec<f64> = seen.iter().filter_map(slope).collect();
    slopes.sort_by(f64::total_cmp);
    slopes.get(slopes.len() / 2).copied().unwrap_or(0.0)
}
