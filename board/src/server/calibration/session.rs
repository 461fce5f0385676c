//! The calibration in progress: its readings and its unsaved results.

use super::action::{Action, Part};
use crate::calibrate::{
    Calibrated, Circle, CircleLens, CodedPicture, FactorReading, FittedResponse, FittedVignetting, Grey,
    Guide, Kept, Method, Offer, Reading, Request, Stated, Unseen, circle_lens, exposed_frames, find_circle,
    fit_response, fit_vignetting, flat_field, grey_of, keep_reading, measure, screen, write, write_circle,
    write_response, write_vignetting,
};
use crate::calibration::{Burst, Calibration};
use crate::probe::BurstView;
use crate::recorded::{ANY_CLASS, radiometry};
use crate::source::{Source, SourceError};
use axum::http::StatusCode;
use glam::DVec2;
use hemilux_core::Exposure;
use hemilux_core::lens::Lens;
use std::path::Path;

/// Largest number of readings of one kind in a calibration.
const MOST_READINGS: usize = 400;

/// Relative standard deviation of the error that all readings of one luxmeter share: half of its error limit of
/// 5 %.
const METER: f64 = 0.025;

/// A refused action of a calibration: the field of the request at fault and the reason.
#[derive(Debug)]
pub(super) struct Refusal {
    pub field: &'static str,
    pub why: String,
    pub status: StatusCode,
}

impl Refusal {
    fn new(field: &'static str, why: impl std::fmt::Display) -> Self {
        Self { field, why: why.to_string(), status: StatusCode::BAD_REQUEST }
    }
}

/// A computed lens that is not saved yet.
#[derive(Clone, Debug)]
pub(super) enum Draft {
    Board(Box<Calibrated>),
    Circle(Box<CircleLens>),
}

/// A photometric reading that is not saved yet, with the class of its light source and the camera's name.
#[derive(Clone, Debug)]
pub(super) struct Measured {
    pub reading: FactorReading,
    pub class: String,
    camera: String,
}

/// An image circle and the field of view across it.
#[derive(Clone, Copy)]
pub(super) struct PlacedCircle {
    pub circle: Circle,
    /// Field of view across the image circle, degrees.
    pub field_deg: f64,
}

/// The readings and unsaved results of a calibration.
#[derive(Default)]
pub(super) struct Session {
    pub guide: Option<Guide>,
    pub offer: Option<Offer>,
    pub lens: Option<Draft>,
    pub circle: Option<PlacedCircle>,
    circles_before: Vec<Option<PlacedCircle>>,
    pub readings: Vec<Reading>,
    /// Number of vignetting readings before each addition, for the action `undo`.
    additions: Vec<usize>,
    pub vignetting: Option<FittedVignetting>,
    pub response: Option<FittedResponse>,
    pub measured: Vec<Measured>,
    /// Columns and rows of the camera's pictures.
    pub size: Option<[usize; 2]>,
}

impl Session {
    /// Returns true if the calibration has results that are not saved.
    pub(super) fn is_unsaved(&self) -> bool {
        self.lens.is_some()
            || self.vignetting.is_some()
            || self.response.is_some()
            || !self.measured.is_empty()
    }

    pub(super) fn act(
        &mut self,
        action: Action,
        view: Option<&BurstView>,
        file: Option<&Path>,
    ) -> Result<(), Refusal> {
        let view = || view.ok_or_else(|| Refusal::new("do", "found no picture, expected one"));
        match action {
            Action::Start(wish) => {
                let board = wish.printed().map_err(|e| Refusal::new("board", e))?;
                self.guide = Some(Guide::new(Request { board, any_colours: false }));
                self.offer = None;
                Ok(())
            }
            Action::Look => self.look(view()?),
            Action::Compute => self.compute(),
            Action::FindCircle { field_deg } => {
                let grey = self.picture(view()?)?;
                let circle = find_circle(&[grey]).map_err(|e| Refusal::new("circle", e))?;
                self.set_circle(circle, field_deg)
            }
            Action::Circle { centre, radius, field_deg } => {
                self.drag_circle(view()?, centre, radius, field_deg)
            }
            Action::Screen => self.screen(view()?),
            Action::Flat => self.flat(view()?),
            Action::FitVignetting => self.fit_vignetting(view()?),
            Action::Response => self.respond(view()?),
            Action::Direct { lux, class } => {
                self.measure(view()?, &Method::Direct { lux: positive(lux)?, unseen: Unseen::Rim }, class)
            }
            Action::Patch { outline, reflectance, lux, class } => {
                let outline = outline.into_iter().map(DVec2::from).collect();
                let reflectance = Some(reflectance).filter(|r| *r > 0.0 && *r <= 1.0);
                let reflectance = reflectance
                    .ok_or_else(|| Refusal::new("reflectance", "expected a share above 0, at most 1"))?;
                self.measure(view()?, &Method::Indirect { outline, reflectance, lux: positive(lux)? }, class)
            }
            Action::Undo { part } => {
                self.undo(part);
                Ok(())
            }
            Action::Reset => {
                *self = Self::default();
                Ok(())
            }
            Action::Save { force } => self.save(file, force),
        }
    }

    fn picture(&mut self, view: &BurstView) -> Result<Grey, Refusal> {
        let burst = Burst { frames: view.frames.clone(), ..Burst::default() };
        let grey = grey_of(&burst, &view.calibration);
        let grey =
            grey.ok_or_else(|| Refusal::new("do", "found an incomplete frame, expected a complete one"))?;
        self.size = Some(grey.size());
        Ok(grey)
    }

    fn look(&mut self, view: &BurstView) -> Result<(), Refusal> {
        let grey = self.picture(view)?;
        let guide = self.guide.as_mut();
        let guide =
            guide.ok_or_else(|| Refusal::new("do", "found no board, expected the action start first"))?;
        self.offer = Some(guide.offer(grey));
        Ok(())
    }

    fn compute(&mut self) -> Result<(), Refusal> {
        let guide = self.guide.as_ref();
        let guide =
            guide.ok_or_else(|| Refusal::new("do", "found no board, expected the action start first"))?;
        let calibrated = guide.calibrate().map_err(|e| Refusal::new("lens", e))?;
        self.lens = Some(Draft::Board(Box::new(calibrated)));
        Ok(())
    }

    /// Sets the image circle that a client has drawn; its assumed standard deviation is a hundredth of its
    /// radius.
    fn drag_circle(
        &mut self,
        view: &BurstView,
        centre: [f64; 2],
        radius: f64,
        field_deg: f64,
    ) -> Result<(), Refusal> {
        self.picture(view)?;
        let inside = centre.iter().all(|v| (-1e5..1e5).contains(v)) && (8.0..1e5).contains(&radius);
        if !inside {
            return Err(Refusal::new(
                "circle",
                "expected a centre in pixels and a radius of at least 8 pixels",
            ));
        }
        let deviation_px = 0.01 * radius;
        self.set_circle(Circle { centre: DVec2::from(centre), radius, deviation_px }, field_deg)
    }

    fn set_circle(&mut self, circle: Circle, field_deg: f64) -> Result<(), Refusal> {
        let lens = circle_lens(&circle, field_deg, self.size.unwrap_or_default());
        self.lens = Some(Draft::Circle(Box::new(lens.map_err(|e| Refusal::new("circle", e))?)));
        self.circles_before.push(self.circle.replace(PlacedCircle { circle, field_deg }));
        self.circles_before.drain(..self.circles_before.len().saturating_sub(100));
        Ok(())
    }

    /// Returns the lens that this calibration has computed last, or the probe's lens if it has computed none.
    fn newest_lens(&self, view: &BurstView) -> Lens {
        match &self.lens {
            Some(Draft::Board(calibrated)) => calibrated.lens,
            Some(Draft::Circle(circle)) => circle.lens,
            None => view.calibration.lens,
        }
    }

    /// Adds the reading of a lit screen to the vignetting readings, from the longest exposure in which the
    /// screen is not clipped.
    fn screen(&mut self, view: &BurstView) -> Result<(), Refusal> {
        let lens = self.newest_lens(view);
        for frame in view.frames.iter().rev() {
            let Some(grey) = plain(frame, &view.calibration) else { continue };
            self.size = Some(grey.size());
            if let Some(mut reading) =
                screen(&lens, &CodedPicture { grey: &grey, response: &view.calibration.response })
            {
                // The reading is converted to a radiance: readings of the same screen in different exposures
                // then agree.
                reading.light /= frame.exposure.seconds * frame.exposure.gain;
                return self.add(vec![reading]);
            }
        }
        let why = "found no screen that is lit and not clipped: darken the surroundings, or dim the screen";
        Err(Refusal::new("vignetting", why))
    }

    fn flat(&mut self, view: &BurstView) -> Result<(), Refusal> {
        let lens = self.newest_lens(view);
        let grey = view.frames.iter().rev().filter_map(|frame| plain(frame, &view.calibration));
        let unclipped =
            |grey: &Grey| grey.pixels().iter().filter(|v| **v >= 250).count() * 100 < grey.pixels().len();
        let Some(grey) = grey.into_iter().find(unclipped) else {
            return Err(Refusal::new("vignetting", "found clipped pictures, expected one exposure without"));
        };
        self.size = Some(grey.size());
        self.add(flat_field(&lens, &CodedPicture { grey: &grey, response: &view.calibration.response }))
    }

    fn add(&mut self, readings: Vec<Reading>) -> Result<(), Refusal> {
        if self.readings.len() + readings.len() > MOST_READINGS {
            return Err(Refusal::new(
                "vignetting",
                format!("found more than {MOST_READINGS} readings, expected fewer"),
            ));
        }
        self.additions.push(self.readings.len());
        self.readings.extend(readings);
        self.vignetting = None;
        Ok(())
    }

    fn fit_vignetting(&mut self, view: &BurstView) -> Result<(), Refusal> {
        let fitted = fit_vignetting(&self.newest_lens(view), &self.readings);
        self.vignetting = Some(fitted.map_err(|e| Refusal::new("vignetting", e))?);
        Ok(())
    }

    fn respond(&mut self, view: &BurstView) -> Result<(), Refusal> {
        let codes = exposed_frames(&view.calibration, &view.frames);
        let codes = codes.ok_or_else(|| {
            Refusal::new("response", "found raw frames, which are linear and need no response")
        })?;
        let fitted = fit_response(&codes.frames, codes.step).map_err(|e| Refusal::new("response", e))?;
        self.response = Some(fitted);
        Ok(())
    }

    fn measure(&mut self, view: &BurstView, method: &Method, class: Option<String>) -> Result<(), Refusal> {
        if self.vignetting.is_some() || self.response.is_some() {
            let why = "found a new vignetting or response, expected photometric readings with the one in use: save, start the probe again, then measure";
            return Err(Refusal::new("photometric", why));
        }
        if self.measured.len() >= MOST_READINGS {
            return Err(Refusal::new(
                "photometric",
                format!("found {MOST_READINGS} readings, expected fewer"),
            ));
        }
        let class = class.filter(|c| !c.is_empty()).unwrap_or_else(|| ANY_CLASS.into());
        let is_plain = class.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-');
        if class.len() > 32 || !is_plain {
            return Err(Refusal::new("class", "expected a name such as daylight, led or warm"));
        }
        let mut source = Still::of(view);
        let reading = measure(&mut source, method, 1, METER).map_err(|e| Refusal::new("photometric", e))?;
        self.measured.push(Measured { reading, class, camera: radiometry(source.calibration()) });
        Ok(())
    }

    fn undo(&mut self, part: Part) {
        match part {
            Part::Lens => {
                self.guide.as_mut().into_iter().for_each(Guide::undo);
                self.lens = None;
            }
            Part::Circle => {
                self.circle = self.circles_before.pop().flatten();
                let made = self
                    .circle
                    .and_then(|placed| circle_lens(&placed.circle, placed.field_deg, self.size?).ok());
                self.lens = made.map(|lens| Draft::Circle(Box::new(lens)));
            }
            Part::Vignetting => {
                self.readings.truncate(self.additions.pop().unwrap_or(0));
                self.vignetting = None;
            }
            Part::Response => self.response = None,
            Part::Photometric => drop(self.measured.pop()),
        }
    }

    /// Writes the unsaved results of the calibration to `file` and removes them from the session.
    fn save(&mut self, file: Option<&Path>, force: bool) -> Result<(), Refusal> {
        let path = file.ok_or_else(|| Refusal {
            status: StatusCode::CONFLICT,
            ..Refusal::new("save", "found no lens file, expected the probe to be started with --calibration FILE or a source with lens=FILE")
        })?;
        // Errors contain the name of the lens file without its folder, which is not disclosed to clients.
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let refused = |e: String| Refusal {
            status: StatusCode::CONFLICT,
            ..Refusal::new(
                "save",
                e.replace(&path.display().to_string(), &name).replace("use --force", "force"),
            )
        };
        match &self.lens {
            Some(Draft::Board(calibrated)) => {
                write(path, calibrated, &Stated::default(), force).map_err(|e| refused(e.to_string()))?;
            }
            Some(Draft::Circle(circle)) => {
                write_circle(path, circle, force).map_err(|e| refused(e.to_string()))?;
            }
            None => {}
        }
        (self.lens, self.circle, self.guide) = (None, None, None);
        if let Some(fitted) = &self.vignetting {
            write_vignetting(path, fitted, force).map_err(|e| refused(e.to_string()))?;
        }
        self.vignetting = None;
        if let Some(fitted) = &self.response {
            write_response(path, fitted, force).map_err(|e| refused(e.to_string()))?;
        }
        self.response = None;
        while let Some(Measured { reading, class, camera }) = self.measured.first() {
            let kept = Kept { reading, class, camera };
            keep_reading(path, &kept, force).map_err(|e| refused(e.to_string()))?;
            self.measured.remove(0);
        }
        *self = Self::default();
        Ok(())
    }
}

fn positive(lux: f64) -> Result<f64, Refusal> {
    if lux > 0.0 && lux.is_finite() {
        Ok(lux)
    } else {
        Err(Refusal::new("lux", "expected a positive number"))
    }
}

/// Returns the codes of a frame in eight bits, without a transfer function.
fn plain(frame: &crate::calibration::Frame, calibration: &Calibration) -> Option<Grey> {
    // The conversion to eight bits uses no curve, so that the response of the calibration applies to the codes.
    let mut as_is = *calibration;
    as_is.response = hemilux_core::Response::Srgb;
    crate::calibrate::grey(frame, &as_is)
}

/// A source of relative radiance that returns one given burst.
struct Still {
    calibration: Calibration,
    burst: Burst,
}

impl Still {
    fn of(view: &BurstView) -> Self {
        let mut calibration = view.calibration;
        calibration.scale /= view.lux.map_or(1.0, |lux| lux.factor);
        Self { calibration, burst: Burst { frames: view.frames.clone(), ..Burst::default() } }
    }
}

impl Source for Still {
    fn calibration(&self) -> &Calibration {
        &self.calibration
    }

    fn exposures(&self) -> Vec<Exposure> {
        self.burst.frames.iter().map(|frame| frame.exposure).collect()
    }

    fn next(&mut self, burst: &mut Burst) -> Result<(), SourceError> {
        burst.clone_from(&self.burst);
        Ok(())
    }
}
