//! A merge apart from the memory of its tables.

use super::{MergeView, Own, Reciprocal};
use crate::response::Curve;

/// The tables of a merge, which lie in memory that something else holds.
#[derive(Clone, Copy)]
pub(crate) struct Tables<'a> {
    /// Relative exposure of each code.
    pub(crate) curve: &'a [i32],
    /// Light of each code in each exposure.
    pub(crate) exposures: &'a [u32],
    pub(crate) reciprocals: &'a [Reciprocal],
}

/// A merge apart from its tables.
#[derive(Clone, Debug)]
pub(crate) struct Detached {
    pub(crate) curve: Curve<()>,
    pub(super) own: Own,
}

impl Detached {
    /// The merge that runs through `tables`, which it was made with.
    pub(crate) fn over<'a>(&'a self, tables: Tables<'a>) -> MergeView<'a> {
        MergeView {
            curve: self.curve.over(tables.curve),
            tables: tables.exposures,
            reciprocals: tables.reciprocals,
            own: &self.own,
        }
    }
}
