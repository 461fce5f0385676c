//! The kernel's structures for the pads of sub-devices, as `linux/v4l2-subdev.h` has them.

use super::ids::{FIELD_NONE, FORMAT_ACTIVE};

plain! {
    /// `struct v4l2_subdev_format`.
    PadFormat(88, 88) {
        /// Asked for: [`FORMAT_ACTIVE`].
        which: u32 = FORMAT_ACTIVE,
        /// Asked for: 0, a sensor's output.
        pad: u32,
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Media bus code.
        code: u32,
        /// [`FIELD_NONE`]: progressive.
        field: u32 = FIELD_NONE,
        /// Colour space.
        colorspace: u32,
        /// Encoding, quantisation, transfer function, flags, zero.
        rest: [u16; 14],
        /// Stream and zero.
        reserved: [u32; 8],
    }
}

plain! {
    /// `struct v4l2_subdev_mbus_code_enum`.
    BusCode(48, 48) {
        /// Asked for: 0.
        pad: u32,
        /// Asked for.
        index: u32,
        /// Media bus code.
        code: u32,
        /// Asked for: [`FORMAT_ACTIVE`].
        which: u32 = FORMAT_ACTIVE,
        /// Flags, stream and zero.
        reserved: [u32; 8],
    }
}

plain! {
    /// `struct v4l2_subdev_selection`.
    PadSelection(64, 64) {
        /// Asked for: [`FORMAT_ACTIVE`].
        which: u32 = FORMAT_ACTIVE,
        /// Asked for: 0, a sensor's output.
        pad: u32,
        /// Asked for: `SELECT_CROP` and others.
        target: u32,
        /// Zero.
        flags: u32,
        /// Left, top, width and height, pixels.
        area: [u32; 4],
        /// Zero.
        reserved: [u32; 8],
    }
}

plain! {
    /// `struct v4l2_subdev_frame_size_enum`.
    PadSize(64, 64) {
        /// Asked for.
        index: u32,
        /// Asked for: 0, a sensor's output.
        pad: u32,
        /// Asked for: media bus code.
        code: u32,
        /// Least width, largest width, least height, largest height.
        size: [u32; 4],
        /// Asked for: [`FORMAT_ACTIVE`].
        which: u32 = FORMAT_ACTIVE,
        /// Zero.
        reserved: [u32; 8],
    }
}
