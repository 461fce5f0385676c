//! The frames of a burst that a light set does not contain.

use crate::merge::MAX_EXPOSURES;

/// The contradiction between a frame and the other frames of its burst.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum FrameFault {
    /// The frame is dark where another one predicts light.
    Black,
    /// The frame is saturated where another one predicts less.
    Saturated,
    /// The frame shows another scene: the camera or the light moved.
    OtherScene,
    /// All radiances differ by one factor from those of the other frames, unlike in the bursts before.
    WrongExposure,
    /// The upper part of the frame agrees with the other frames, the lower part does not, or the other way round.
    Torn,
    /// The frame holds the same samples as a frame of another exposure.
    Repeated,
    /// The frame is sound, but the shortest exposure of its burst is not: without it the brightest light is unknown, and the light set
    /// repeats that of the burst before.
    Incomplete,
}

impl FrameFault {
    /// All kinds, in the order of [`FrameFault::index`].
    pub const ALL: [Self; 7] = [
        Self::Black,
        Self::Saturated,
        Self::OtherScene,
        Self::WrongExposure,
        Self::Torn,
        Self::Repeated,
        Self::Incomplete,
    ];

    /// The name in light sets and counters.
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

    /// Position in [`FrameFault::ALL`].
    #[must_use]
    pub fn index(self) -> usize {
        self as usize
    }
}

/// The frames of a burst that were not merged. A frame is identified by its index in ascending order of exposure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FramesLeftOut([Option<FrameFault>; MAX_EXPOSURES]);

impl FramesLeftOut {
    /// No frame.
    pub const NONE: Self = Self([None; MAX_EXPOSURES]);

    /// Adds the frame with this index; indices of [`MAX_EXPOSURES`] and above are ignored.
    pub fn insert(&mut self, index: usize, fault: FrameFault) {
        if let Some(slot) = self.0.get_mut(index) {
            *slot = Some(fault);
        }
    }

    /// Whether the frame with this index was left out.
    #[must_use]
    pub fn contains(&self, index: usize) -> bool {
        matches!(self.0.get(index), Some(Some(_)))
    }

    /// Whether all frames were merged.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.iter().all(Option::is_none)
    }

    /// The frames that were left out, in ascending order of their index.
    pub fn iter(&self) -> impl Iterator<Item = FrameLeftOut> + '_ {
        self.0.iter().enumerate().filter_map(|(index, fault)| Some(FrameLeftOut { index, fault: (*fault)? }))
    }
}

/// A frame that was not merged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameLeftOut {
    /// Index of the frame in ascending order of exposure.
    pub index: usize,
    /// Reason for which the frame was left out.
    pub fault: FrameFault,
}
