//! Types of option values: source of the exposure times, extrapolation, sampler.

use crate::replay::Exposures;
use hemilux_core::SamplerKind;

#[derive(clap::ValueEnum, Clone, Copy, Debug)]
pub(super) enum ExposuresArg {
    /// The exposure times are those that the manifest or the EXIF data state.
    Stated,
    /// The brightest frame has its stated exposure time; the times of the other frames follow from ratios measured in the pixels.
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
    /// Directions outside of the field of view are black.
    None,
    /// Directions outside of the field of view have the mean radiance of the field of view.
    Average,
}

/// Returns a parser of sampler names, which lists the names in the help.
pub(super) fn sampler_parser() -> impl clap::builder::TypedValueParser<Value = SamplerKind> {
    use clap::builder::{PossibleValuesParser, TypedValueParser};
    PossibleValuesParser::new(SamplerKind::NAMES).try_map(|name| name.parse::<SamplerKind>())
}
