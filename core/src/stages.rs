//! The stages of a burst over borrowed buffers.

use crate::merge::MergeView;
use crate::pixel_table::PixelTableView;
use crate::pyramid::{Pyramid, Quad};

/// The stages of a burst over the buffers of a front end.
pub(crate) struct Stages<'m> {
    pub(crate) merge: MergeView<'m>,
    pub(crate) pixel_table: PixelTableView<'m>,
    pub(crate) map: Pyramid<&'m mut [Quad]>,
}
