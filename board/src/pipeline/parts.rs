//! The parts of a pipeline, with memory from the heap, and the choice of frames.

use super::settings::{PipelineError, Settings};
use crate::calibration::Calibration;
use hemilux_core::mains::{Cell, Mains, mains_len};
use hemilux_core::{Exposure, FrontEnd, FrontError, Order, Sizes};
use std::time::{Duration, Instant};

/// Creates the removal of flicker for maps of the order in `settings`.
pub(super) fn mains(settings: &Settings) -> Result<Mains<Vec<Cell>>, PipelineError> {
    let order = Order::saturating(settings.order());
    let cells = vec![Cell::default(); mains_len(order)];
    Mains::try_new(order, settings.lamps, cells).map_err(|e| FrontError::Memory(e).into())
}

/// Creates a front end with memory from the heap.
pub(super) fn front_end(
    calibration: &Calibration,
    exposures: &[Exposure],
    settings: &Settings,
) -> Result<FrontEnd<Vec<u64>>, PipelineError> {
    let order = Order::saturating(settings.order());
    let sizes = Sizes::of(calibration, exposures, order)?;
    let mut front = FrontEnd::try_new(*calibration, exposures, order, vec![0; sizes.words()])?;
    front.set_extrapolation(settings.extrapolation);
    front.set_merge_mode(settings.merge);
    Ok(front)
}

/// Beginning of the processing of a burst, and the time from there to the end of the sum over its frames.
#[derive(Clone, Copy)]
pub(super) struct Span {
    pub(super) began: Instant,
    pub(super) front: Duration,
}

/// Returns true if the frame `index` of `count` is among the at most `most` frames that are merged.
pub(super) fn is_read(index: usize, count: usize, most: usize) -> bool {
    match most {
        _ if most >= count => true,
        0 | 1 => index == 0,
        _ => (0..most).any(|k| k * (count - 1) / (most - 1) == index),
    }
}
