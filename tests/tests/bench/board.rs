//! A camera before which a calibration board is held still at one position after another.

use glam::{DMat3, DVec2, DVec3};
use hemilux::calibrate::{Board, Printed, ink, target_size};
use hemilux::calibration::{Burst, Calibration, Frame, Pixels};
use hemilux::source::{Source, SourceError};
use hemilux_core::lens::Lens;
use hemilux_core::{Exposure, Format, Response};
use std::f64::consts::{FRAC_PI_2, TAU};
use std::thread::sleep;
use std::time::{Duration, Instant};

const SIDE: usize = 480;

/// Number of positions at which the board is held.
const PLACES: usize = 16;

/// Number of samples per side of a square in the bitmap of the board.
const FINE: f64 = 24.0;

/// Returns the true lens of the camera, which is unknown to the probe.
pub fn true_lens() -> Lens {
    Lens::equidistant([243.3, 236.8], 145.0, 92f64.to_radians()).expect("a lens")
}

/// The calibration board before the camera.
pub const BOARD: Board = Board { columns: 9, rows: 7 };

/// A camera whose stated lens is an equidistant one of 180 degrees centred in the image; its true lens is [`true_lens`].
pub struct BoardCamera {
    calibration: Calibration,
    pictures: Vec<Vec<u8>>,
    every: Duration,
    hold: Duration,
    began: Option<Instant>,
    due: Instant,
}

impl BoardCamera {
    /// Creates a camera with a picture at intervals of `every`; the board is held at each position for `hold`.
    pub fn new(every: Duration, hold: Duration) -> Self {
        let middle = SIDE as f64 / 2.0 - 0.5;
        let lens =
            Lens::equidistant([middle; 2], 2.0 * middle / std::f64::consts::PI, FRAC_PI_2).expect("a lens");
        let mut calibration =
            Calibration::try_new(lens, Format::Rgb24, SIDE as u32, SIDE as u32).expect("a layout");
        calibration.response = Response::Srgb;
        let drawing = Drawing::of(&BOARD.into());
        let pictures = (0..PLACES).map(|i| drawing.picture(i)).collect();
        Self { calibration, pictures, every, hold, began: None, due: Instant::now() }
    }
}

impl Source for BoardCamera {
    fn calibration(&self) -> &Calibration {
        &self.calibration
    }

    fn exposures(&self) -> Vec<Exposure> {
        vec![Exposure { seconds: 0.01, gain: 1.0 }]
    }

    fn next(&mut self, burst: &mut Burst) -> Result<(), SourceError> {
        sleep(self.due.saturating_duration_since(Instant::now()));
        self.due = Instant::now() + self.every;
        let began = *self.began.get_or_insert_with(Instant::now);
        let place = began.elapsed().as_millis() / self.hold.as_millis();
        let pixels = Pixels::U8(self.pictures[place as usize % self.pictures.len()].clone());
        burst.frames = vec![Frame { exposure: self.exposures()[0], pixels }];
        burst.timestamp_ns = 0;
        Ok(())
    }
}

/// The board as a bitmap, with a margin of one square.
struct Drawing {
    size: [usize; 2],
    squares: [f64; 2],
    black: Vec<bool>,
}

impl Drawing {
    fn of(printed: &Printed) -> Self {
        let squares = target_size(printed);
        let size = squares.map(|n| ((n + 2.0) * FINE).round() as usize);
        let mut black = vec![false; size[0] * size[1]];
        for part in ink(printed) {
            let place = |v: f64| (v * FINE).round() as usize;
            let [left, top] = part.at.map(|v| place(v + 1.0));
            for y in top..top + place(part.size[1]) {
                black[y * size[0] + left..y * size[0] + left + place(part.size[0])].fill(true);
            }
        }
        Self { size, squares, black }
    }

    fn code(&self, place: DVec2) -> Option<f64> {
        let at = place * FINE + DVec2::new(self.size[0] as f64, self.size[1] as f64) * 0.5;
        let inside = at.x >= 0.0 && at.y >= 0.0 && at.x < self.size[0] as f64 && at.y < self.size[1] as f64;
        inside.then(|| if self.black[at.y as usize * self.size[0] + at.x as usize] { 25.0 } else { 210.0 })
    }

    /// Returns the picture of the board at position `i`, ordered from the centre of the view to its rim.
    fn picture(&self, i: usize) -> Vec<u8> {
        let lens = true_lens();
        let (theta, phi) = (1.2 * ((i as f64 + 0.2) / PLACES as f64).sqrt(), 2.399_963 * i as f64);
        let out = DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
        let distance = 0.6 * self.squares[0];
        let tilt = DMat3::from_axis_angle(out.any_orthonormal_vector(), 0.25 + 0.03 * (i % 5) as f64);
        let normal = DMat3::from_axis_angle(out, 1.7 * i as f64) * tilt * out;
        let columns =
            DMat3::from_axis_angle(normal, TAU * 0.381 * i as f64) * normal.any_orthonormal_vector();
        let rows = normal.cross(columns);
        let seen = |at: DVec2| {
            let Some(direction) = lens.unproject(at) else { return 0.0 };
            let reach = (out * distance).dot(normal) / direction.dot(normal);
            let place = direction * reach - out * distance;
            let code = self.code(DVec2::new(place.dot(columns), place.dot(rows))).filter(|_| reach > 0.0);
            code.unwrap_or(110.0 + 30.0 * (3.0 * direction.x).sin())
        };
        let pixel = |i: usize| {
            let at = DVec2::new((i % SIDE) as f64, (i / SIDE) as f64);
            let steps = [-0.45, -0.15, 0.15, 0.45];
            let sum: f64 = steps.iter().flat_map(|x| steps.map(|y| seen(at + DVec2::new(*x, y)))).sum();
            [(sum / 16.0).round() as u8; 3]
        };
        (0..SIDE * SIDE).flat_map(pixel).collect()
    }
}
