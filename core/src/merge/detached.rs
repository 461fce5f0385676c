//! The state of a merge between bursts, without references to the memory of its tables.

use super::{MergeMode, MergeView, Parameters, Reciprocal};
use crate::response::Curve;

/// The tables of a merge in borrowed memory.
#[derive(Clone, Copy)]
pub(crate) struct Tables<'a> {
    /// Relative exposure of each code, for three channels, in units of 2^-27.
    pub(crate) curve: &'a [i32],
    /// Relative exposure divided by gain, of each code in each exposure.
    pub(crate) exposures: &'a [u32],
    pub(crate) reciprocals: &'a [Reciprocal],
}

/// The parameters of a merge, without its tables.
#[derive(Clone, Debug)]
pub(crate) struct Detached {
    pub(crate) curve: Curve<()>,
    pub(super) parameters: Parameters,
}

impl Detached {
    /// Combines the parameters with `tables`, which must be the tables that were filled together with these parameters.
    pub(crate) fn over<'a>(&'a self, tables: Tables<'a>, mode: MergeMode) -> MergeView<'a> {
        MergeView {
            mode,
            limits: None,
            curve: self.curve.over(tables.curve),
            tables: tables.exposures,
            reciprocals: tables.reciprocals,
            parameters: &self.parameters,
        }
    }
}
