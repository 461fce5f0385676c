//! `hemilux calibrate lens --live`: takes pictures from a running source.

use super::super::Failure;
use crate::calibrate::{Calibrated, Guide, Offer, Request, grey_of};
use crate::calibration::Burst;
use crate::source::{self, SourceError, Spec};
use std::io::Write;
use std::time::{Duration, Instant};

/// Number of pictures after which no more are taken if the field of view is covered.
const ENOUGH: usize = 12;

/// Longest time without a burst of the source, after which the command fails.
const PATIENCE: Duration = Duration::from_secs(20);

/// Takes pictures from the source until the field of view is covered, `most` are taken or the time has passed, and computes the lens.
pub(super) fn live(
    spec: &Spec,
    request: Request,
    most: usize,
    time: Duration,
) -> Result<Calibrated, Failure> {
    let mut source = source::open(spec).map_err(Failure::new)?;
    let (mut guide, mut burst) = (Guide::new(request), Burst::default());
    let (began, mut last, mut told) = (Instant::now(), Instant::now(), String::new());
    tell(&mut told, "show the board to the camera, first in the middle of the view".into());
    while guide.views() < most && began.elapsed() < time {
        match source.next(&mut burst) {
            Ok(()) => last = Instant::now(),
            Err(SourceError::NotYet | SourceError::Broken(_)) if last.elapsed() < PATIENCE => continue,
            Err(error) => return Err(Failure::new(format!("{spec}: {error}"))),
        }
        let Some(grey) = grey_of(&burst, source.calibration()) else { continue };
        let offer = guide.offer(grey);
        let lacking = guide.coverage().lacking();
        if guide.views() >= ENOUGH && lacking.is_none() {
            break;
        }
        tell(&mut told, advice(&guide, offer, lacking));
    }
    tell(&mut told, format!("{} pictures taken, computing", guide.views()));
    guide.calibrate().map_err(Failure::new)
}

fn advice(guide: &Guide, offer: Offer, lacking: Option<String>) -> String {
    match offer {
        Offer::Taken => {
            let next =
                lacking.map_or("now turn and tilt it".into(), |place| format!("now show it at {place}"));
            format!("picture {} taken: {next}", guide.views())
        }
        other => other.advice().into(),
    }
}

/// Writes `line` to stderr if it differs from `told`, the line that was written last.
fn tell(told: &mut String, line: String) {
    if *told != line {
        let _ = writeln!(std::io::stderr(), "hemilux: {line}");
        *told = line;
    }
}
