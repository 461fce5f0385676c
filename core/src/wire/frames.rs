//! The frames of a burst that a light set does not contain.

use crate::merge::MAX_EXPOSURES;

/// The contradiction between a frame and the other frames of its burst, for which the frame was left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum FrameFault {
    /// The frame is dark where another frame predicts light.
    Black,
    /// The frame is saturated where another frame predicts less light.
    Saturated,
    /// The frame is of another scene: the camera or the light moved.
    OtherScene,
    /// All radiances differ by one factor from the radiances of the other frames, unlike in the bursts before.
    WrongExposure,
    /// One part of the frame, upper or lower, agrees with the other frames, and the other part does not.
    Torn,
    /// The frame holds the same samples as a frame of another exposure.
    Repeated,
    /// The frame has no fault, but the shortest exposure of its burst has: without that exposure the brightest radiance is unknown, so the light
    /// set of the previous burst is repeated.
    Incomplete,
}

impl FrameFault {
    /// All kinds of contradictions, in the order of [`FrameFault::index`].
    pub const ALL: [Self; 7] = [
        Self::Black,
        Self::Saturated,
        Self::OtherScene,
        Self::WrongExposure,
        Self::Torn,
        Self::Repeated,
        Self::Incomplete,
    ];

    /// Returns the name of the contradiction in light sets and counters.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Black => "black",
            Self::Saturated => "saturated",
            Self::OtherScene => "other-scene",
            Self::WrongExposure => "wrong-exposure",
            Self::Torn => "torn",
            Self::Repeated => "repeated",
            Self::Incomplete => "incomplete",
        }
    }

    /// Returns the position of the contradiction in [`FrameFault::ALL`].
    #[must_use]
    pub fn index(self) -> usize {
        self as usize
    }
}

/// The frames of a burst that were not merged. A frame is identified by its index in ascending order of exposure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FramesLeftOut([Option<FrameFault>; MAX_EXPOSURES]);

impl FramesLeftOut {
    /// The value for a burst of which all frames were merged.
    pub const NONE: Self = Self([None; MAX_EXPOSURES]);

    /// Adds the frame with index `index`; indices of [`MAX_EXPOSURES`] and above are ignored.
    pub fn insert(&mut self, index: usize, fault: FrameFault) {
        if let Some(slot) = self.0.get_mut(index) {
            *slot = Some(fault);
        }
    }

    /// Removes the frames whose index does not satisfy `is`.
    pub fn retain(&mut self, is: impl Fn(usize) -> bool) {
        let others = self.0.iter_mut().enumerate().filter(|(index, _)| !is(*index));
        others.for_each(|(_, slot)| *slot = None);
    }

    /// Returns whether the frame with index `index` was not merged.
    #[must_use]
    pub fn contains(&self, index: usize) -> bool {
        matches!(self.0.get(index), Some(Some(_)))
    }

    /// Returns whether all frames of the burst were merged.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.iter().all(Option::is_none)
    }

    /// Returns the frames that were not merged, in ascending order of their index.
    pub fn iter(&self) -> impl Iterator<Item = FrameLeftOut> + '_ {
        self.0.iter().enumerate().filter_map(|(index, fault)| Some(FrameLeftOut { index, fault: (*fault)? }))
    }
}

/// A frame of a burst that was not merged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameLeftOut {
    /// Index of the frame in the burst, in ascending order of exposure.
    pub index: usize,
    /// Reason for which the frame was not merged.
    pub fault: FrameFault,
}
