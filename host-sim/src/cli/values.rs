//! Values of options.

use crate::replay::Exposures;
use hemilux_core::SamplerKind;

#[derive(clap::ValueEnum, Clone, Copy, Debug)]
pub(super) enum ExposuresArg {
    /// Exposure times of the manifest or of the EXIF data.
    Stated,
    /// Stated time of the brightest frame, and the others by measured ratios.
    Measured,
}

impl From<ExposuresArg> for Exposures {
    fn from(argument: ExposuresArg) -> Self {
        match argument {
            ExposuresArg::Stated => Self::Stated,
            ExposuresArg::Measured => Self::Measured,
        }
    }
}

#[derive(clap::ValueEnum, Clone, Copy, Debug)]
pub(super) enum ExtrapolationArg {
    /// Directions that the lens does not see are black.
    None,
    /// The mean radiance of the visible part.
    Average,
}

/// Parses the name of a sampler and lists the names in the help.
pub(super) fn sampler_parser() -> impl clap::builder::TypedValueParser<Value = SamplerKind> {
    use clap::builder::{PossibleValuesParser, TypedValueParser};
    PossibleValuesParser::new(SamplerKind::NAMES).try_map(|name| name.parse::<SamplerKind>())
}
