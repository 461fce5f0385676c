//! Kinds of samplers and their names.

use crate::healpix::Domain;
use core::fmt;
use core::str::FromStr;

/// A sampler, identified by the name that commands, settings and light sets use.
///
/// The enum is exhaustive so that a `match` without a wildcard fails to compile when a sampler is added.
///
/// ```
/// use hemilux_core::SamplerKind;
/// assert_eq!("q2tree-jitter".parse(), Ok(SamplerKind::Q2TreeJitter));
/// assert_eq!(SamplerKind::Adaptive.to_string(), "adaptive");
/// assert!("guess".parse::<SamplerKind>().is_err());
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SamplerKind {
    /// The sampler of module [`super::adaptive`].
    #[default]
    Adaptive,
    /// The sampler of module [`super::q2tree`] with lights at energy centroids.
    Q2Tree,
    /// The sampler of module [`super::q2tree`] with lights at fixed pseudo-random points of their quads, as published.
    Q2TreeJitter,
    /// The sampler of module [`super::pharr`].
    Pharr,
    /// The sampler of module [`super::hemigon`] with the gated Kalman filter of [`super::hemigon::kalman`].
    Hemigon,
    /// The sampler of module [`super::hemigon`] with the published filters of [`super::hemigon::fir`].
    HemigonFir,
}

impl SamplerKind {
    /// All samplers, the default first.
    pub const ALL: [Self; 6] =
        [Self::Adaptive, Self::Q2Tree, Self::Q2TreeJitter, Self::Pharr, Self::Hemigon, Self::HemigonFir];

    /// The names of [`SamplerKind::ALL`], in the same order.
    pub const NAMES: [&str; Self::ALL.len()] = {
        let mut names = [""; Self::ALL.len()];
        let mut i = 0;
        while i < names.len() {
            names[i] = Self::ALL[i].name();
            i += 1;
        }
        names
    };

    /// Returns the name of the sampler in commands, settings and light sets.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Adaptive => "adaptive",
            Self::Q2Tree => "q2tree",
            Self::Q2TreeJitter => "q2tree-jitter",
            Self::Pharr => "pharr",
            Self::Hemigon => "hemigon",
            Self::HemigonFir => "hemigon-fir",
        }
    }

    /// Returns whether the sampler estimates its error; such a sampler reads the tolerance and the flags of a [`super::Request`].
    #[must_use]
    pub const fn estimates_error(self) -> bool {
        matches!(self, Self::Adaptive)
    }

    /// Returns whether the sampler is a spherical Q2-tree.
    #[must_use]
    pub const fn is_q2tree(self) -> bool {
        matches!(self, Self::Q2Tree | Self::Q2TreeJitter)
    }

    /// Returns the smallest number of lights for a map of `domain` that is lit everywhere: a Q2-tree has at least one light per base quad,
    /// 12 on a sphere and 8 on a hemisphere, and returns no lights for a lower request.
    #[must_use]
    pub const fn least_lights(self, domain: Domain) -> usize {
        if self.is_q2tree() { domain.faces() } else { 1 }
    }
}

impl fmt::Display for SamplerKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

/// The error of parsing a string that is not the name of a sampler.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct UnknownSampler;

impl fmt::Display for UnknownSampler {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an unknown sampler, expected one of")?;
        let separators = [" "].into_iter().chain(core::iter::repeat(", "));
        SamplerKind::NAMES
            .iter()
            .zip(separators)
            .try_for_each(|(name, separator)| write!(f, "{separator}{name}"))
    }
}

impl core::error::Error for UnknownSampler {}

impl FromStr for SamplerKind {
    type Err = UnknownSampler;

    fn from_str(name: &str) -> Result<Self, UnknownSampler> {
        Self::ALL.into_iter().find(|kind| kind.name() == name).ok_or(UnknownSampler)
    }
}
