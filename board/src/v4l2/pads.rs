//! The kernel's structures for sub-device pads, from `linux/v4l2-subdev.h`.

use super::ids::{FIELD_NONE, FORMAT_ACTIVE};

plain! {
    /// `struct v4l2_subdev_format`.
    PadFormat(88, 88) {
        /// Input: [`FORMAT_ACTIVE`].
        which: u32 = FORMAT_ACTIVE,
        /// Input: number of the pad; 0 is a sensor's output.
        pad: u32,
        /// Width of the frames, pixels.
        width: u32,
        /// Height of the frames, pixels.
        height: u32,
        /// Media bus code of the frames on the pad.
        code: u32,
        /// Field order; [`FIELD_NONE`] is progressive.
        field: u32 = FIELD_NONE,
        /// Colour space, `V4L2_COLORSPACE_...`.
        colorspace: u32,
        /// Matrix, quantisation, transfer function and flags; the remaining words are 0.
        rest: [u16; 14],
        /// Number of the stream; the remaining words are 0.
        reserved: [u32; 8],
    }
}

plain! {
    /// `struct v4l2_subdev_mbus_code_enum`.
    BusCode(48, 48) {
        /// Input: number of the pad, 0.
        pad: u32,
        /// Input: index of the requested code, from 0.
        index: u32,
        /// Output: media bus code that the pad supports.
        code: u32,
        /// Input: [`FORMAT_ACTIVE`].
        which: u32 = FORMAT_ACTIVE,
        /// Flags and number of the stream; the remaining words are 0.
        reserved: [u32; 8],
    }
}

plain! {
    /// `struct v4l2_subdev_selection`.
    PadSelection(64, 64) {
        /// Input: [`FORMAT_ACTIVE`].
        which: u32 = FORMAT_ACTIVE,
        /// Input: number of the pad; 0 is a sensor's output.
        pad: u32,
        /// Input: `SELECT_CROP` or another selection target.
        target: u32,
        /// Reserved by the kernel; always 0.
        flags: u32,
        /// Left edge, top edge, width and height of the rectangle, pixels.
        area: [u32; 4],
        /// Reserved by the kernel; always 0.
        reserved: [u32; 8],
    }
}

plain! {
    /// `struct v4l2_subdev_frame_size_enum`.
    PadSize(64, 64) {
        /// Input: index of the requested size, from 0.
        index: u32,
        /// Input: number of the pad; 0 is a sensor's output.
        pad: u32,
        /// Input: media bus code.
        code: u32,
        /// Output: least width, largest width, least height and largest height, pixels.
        size: [u32; 4],
        /// Input: [`FORMAT_ACTIVE`].
        which: u32 = FORMAT_ACTIVE,
        /// Reserved by the kernel; always 0.
        reserved: [u32; 8],
    }
}

plain! {
    /// `struct v4l2_subdev_route`: the path of a stream through an entity.
    PadRoute(40, 40) {
        /// Number of the pad where the stream enters.
        sink_pad: u32,
        /// Number of the stream at that pad.
        sink_stream: u32,
        /// Number of the pad where the stream leaves.
        source_pad: u32,
        /// Number of the stream at that pad.
        source_stream: u32,
        /// [`ROUTE_ACTIVE`] and other flags of the route.
        flags: u32,
        /// Reserved by the kernel; always 0.
        reserved: [u32; 5],
    }
}

plain! {
    /// `struct v4l2_subdev_routing`.
    PadRouting(64, 64) {
        /// Input: [`FORMAT_ACTIVE`].
        which: u32 = FORMAT_ACTIVE,
        /// Input: number of routes for which the array at `routes_at` has memory.
        length: u32,
        /// Input: address of the array of routes.
        routes_at: u64,
        /// Number of routes in the array.
        count: u32,
        /// Reserved by the kernel; always 0.
        reserved: [u32; 11],
    }
}

plain! {
    /// `struct v4l2_subdev_client_capability`.
    ClientCapability(8, 8) {
        /// [`CLIENT_STREAMS`].
        capabilities: u64,
    }
}

/// `V4L2_SUBDEV_ROUTE_FL_ACTIVE`.
pub const ROUTE_ACTIVE: u32 = 1;
/// `V4L2_SUBDEV_CLIENT_CAP_STREAMS`: declares that the program supports streams; without it, requests for routes fail with ENOTTY.
pub const CLIENT_STREAMS: u64 = 1;

/// Largest number of routes that are read from an entity.
pub const MOST_PAD_ROUTES: u32 = 64;
