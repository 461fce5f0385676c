//! The V4L2 structures and constants of the kernel header `linux/videodev2.h`, in the layout of the compilation target.
//!
//! Timestamps are 64 bits wide on 32-bit targets too: kernels from 5.6 on accept that layout in every configuration, while the 32-bit
//! layout needs `CONFIG_COMPAT_32BIT_TIME`. Compile-time assertions compare the sizes with those that a C compiler gives for x86-64,
//! AArch64 and ARMv7.

pub use super::ids::*;
use super::layout::POINTER;
pub use super::pads::*;

plain! {
    /// `struct v4l2_capability`.
    Capability(104, 104) {
        /// Name of the driver, terminated by NUL.
        driver: [u8; 16],
        /// Name of the device, terminated by NUL.
        card: [u8; 32],
        /// Bus address of the device.
        bus_info: [u8; 32],
        /// Version of the kernel.
        version: u32,
        /// Capabilities of the physical device, over all of its nodes.
        capabilities: u32,
        /// Capabilities of the opened node; valid with [`CAP_DEVICE_CAPS`].
        device_caps: u32,
        /// Reserved by the kernel; always 0.
        reserved: [u32; 3],
    }
}

plain! {
    /// `struct v4l2_fmtdesc`.
    FormatDescription(64, 64) {
        /// Input: index of the requested format, from 0.
        index: u32,
        /// Input: [`CAPTURE`].
        kind: u32 = CAPTURE,
        /// [`FORMAT_EMULATED`] and other flags of the format.
        flags: u32,
        /// Description of the format for people.
        description: [u8; 32],
        /// FourCC of the format.
        fourcc: u32,
        /// Input: media bus code to which the list is limited; 0 for all formats.
        mbus_code: u32,
        /// Reserved by the kernel; always 0.
        reserved: [u32; 3],
    }
}

plain! {
    /// `struct v4l2_frmsizeenum`.
    SizeDescription(44, 44) {
        /// Input: index of the requested frame size, from 0.
        index: u32,
        /// Input: FourCC of the format.
        fourcc: u32,
        /// [`DISCRETE`] for one frame size; another value for a range.
        kind: u32,
        /// Discrete: width and height. Range: least, largest and step of the width, then of the height, in pixels.
        size: [u32; 6],
        /// Reserved by the kernel; always 0.
        reserved: [u32; 2],
    }
}

plain! {
    /// `struct v4l2_frmivalenum`.
    IntervalDescription(52, 52) {
        /// Input: index of the requested frame interval, from 0.
        index: u32,
        /// Input: FourCC of the format.
        fourcc: u32,
        /// Input: width of the frame, pixels.
        width: u32,
        /// Input: height of the frame, pixels.
        height: u32,
        /// [`DISCRETE`] for one interval; another value for a range.
        kind: u32,
        /// Discrete: one fraction (numerator, denominator) in seconds. Range: fractions of the least interval, the largest interval and the
        /// step.
        interval: [u32; 6],
        /// Reserved by the kernel; always 0.
        reserved: [u32; 2],
    }
}

plain! {
    /// `struct v4l2_pix_format`.
    PixelFormat(48, 48) {
        /// Width of the picture, pixels.
        width: u32,
        /// Height of the picture, pixels.
        height: u32,
        /// FourCC of the format.
        fourcc: u32,
        /// Field order; [`FIELD_NONE`] is progressive.
        field: u32 = FIELD_NONE,
        /// Bytes from the start of one row to the start of the next.
        bytes_per_line: u32,
        /// Largest number of bytes of a frame.
        size_image: u32,
        /// Colour space, `V4L2_COLORSPACE_...`.
        colorspace: u32,
        /// Reserved by the kernel; always 0.
        private: u32,
        /// Reserved by the kernel; always 0.
        flags: u32,
        /// [`YCBCR_709`] or another matrix; 0 selects the default of the colour space.
        ycbcr: u32,
        /// [`FULL_RANGE`] or another range; 0 selects the default of the colour space.
        quantization: u32,
        /// Transfer function, `V4L2_XFER_FUNC_...`.
        transfer: u32,
    }
}

plain! {
    /// `struct v4l2_format` of a single-planar capture.
    Format(208, 204) {
        /// Input: [`CAPTURE`].
        kind: u32 = CAPTURE,
        /// Alignment of the kernel's union, which holds pointers: on 64-bit targets it leaves a gap of four bytes in front.
        align: [usize; 0],
        /// Format of the captured pictures.
        pixel: PixelFormat = PixelFormat::default(),
        /// Bytes of the kernel's union that this program does not use.
        rest: [u32; 38],
    }
}

plain! {
    /// `struct v4l2_streamparm` of a capture.
    Parameters(204, 204) {
        /// Input: [`CAPTURE`].
        kind: u32 = CAPTURE,
        /// Output: [`TIME_PER_FRAME`] if the frame interval can be set.
        capability: u32,
        /// Reserved by the kernel; always 0.
        mode: u32,
        /// Frame interval in seconds, numerator and denominator.
        interval: [u32; 2],
        /// Bytes of the kernel's union that this program does not use.
        rest: [u32; 46],
    }
}

plain! {
    /// `struct v4l2_query_ext_ctrl`.
    ControlDescription(232, 232) {
        /// Input: number of the control; with [`NEXT_CONTROL`], of the control before the requested one.
        id: u32,
        /// [`TYPE_INTEGER`] or another type; kernels may return types that have no constant here.
        kind: u32,
        /// Name of the control for people.
        name: [u8; 32],
        /// Least value of the control.
        minimum: i64,
        /// Largest value of the control.
        maximum: i64,
        /// Step between two values of the control.
        step: u64,
        /// Value of the control at power-on.
        default: i64,
        /// [`CONTROL_DISABLED`] and other flags of the control.
        flags: u32,
        /// Bytes of one element of the control's value.
        element_size: u32,
        /// Number of elements of the control's value.
        elements: u32,
        /// Number of dimensions of the control's value.
        dimensions: u32,
        /// Number of elements along each dimension.
        sizes: [u32; 4],
        /// Reserved by the kernel; always 0.
        reserved: [u32; 32],
    }
}

plain! {
    /// `struct v4l2_querymenu`.
    MenuItem(44, 44) {
        /// Input: number of the menu control.
        id: u32,
        /// Input: index of the menu item.
        index: u32,
        /// Name of the item; integer menus store an `i64` in its first eight bytes.
        name: [u8; 32],
        /// Reserved by the kernel; always 0.
        reserved: u32,
    }
}

plain! {
    /// `struct v4l2_ext_control` with a number.
    Control(20, 20) {
        /// Number of the control.
        id: u32,
        /// Bytes of the value behind a pointer; 0 for a number.
        size: u32,
        /// Reserved by the kernel; always 0.
        reserved: u32,
        /// Value of the control in native byte order: an `i32` in the first word, or an `i64` in both.
        value: [u32; 2],
    }
}

plain! {
    /// `struct v4l2_requestbuffers`.
    BufferRequest(20, 20) {
        /// Input: requested number of buffers; output: allocated number.
        count: u32,
        /// Input: [`CAPTURE`].
        kind: u32 = CAPTURE,
        /// Input: [`MMAP`].
        memory: u32 = MMAP,
        /// Output: capabilities of the buffer queue.
        capabilities: u32,
        /// Reserved by the kernel; always 0.
        flags: u32,
    }
}

plain! {
    /// `struct v4l2_buffer`, with times of 64 bits.
    Buffer(88, 80) {
        /// Index of the buffer.
        index: u32,
        /// Input: [`CAPTURE`].
        kind: u32 = CAPTURE,
        /// Bytes of the buffer that hold frame data.
        bytes_used: u32,
        /// [`BUFFER_ERROR`] and other flags of the buffer.
        flags: u32,
        /// Input: 0 for progressive pictures; output: [`FIELD_NONE`].
        field: u32,
        /// Timestamp of the frame, seconds and microseconds.
        timestamp: [i64; 2],
        /// Timecode, not used.
        timecode: [u32; 4],
        /// Sequence number of the sensor's frame.
        sequence: u32,
        /// Input: [`MMAP`].
        memory: u32 = MMAP,
        /// Offset for `mmap`, in the first word of the kernel's union.
        offset: [u32; POINTER / 4],
        /// Length of the buffer for `mmap`, bytes.
        length: u32,
        /// Reserved by the kernel; always 0.
        reserved: u32,
        /// Reserved by the kernel; always 0.
        request: u32,
    }
}

plain! {
    /// `struct v4l2_event_subscription`.
    Subscription(32, 32) {
        /// Type of the event; [`EVENT_SOURCE_CHANGE`] is the one in use.
        kind: u32,
        /// Reserved by the kernel; always 0.
        id: u32,
        /// Reserved by the kernel; always 0.
        flags: u32,
        /// Reserved by the kernel; always 0.
        reserved: [u32; 5],
    }
}

plain! {
    /// `struct v4l2_event`, with times of 64 bits.
    Event(136, 136) {
        /// Type of the event, as in [`Subscription`].
        kind: u32,
        /// Payload of the event: the kernel's union, aligned to eight bytes.
        data: [u64; 8],
        /// Number of events that wait in the queue after this one.
        pending: u32,
        /// Sequence number of the event.
        sequence: u32,
        /// Timestamp of the event, seconds and nanoseconds.
        timestamp: [i64; 2],
        /// Reserved by the kernel; always 0.
        id: u32,
        /// Reserved by the kernel; always 0.
        reserved: [u32; 8],
    }
}

plain! {
    /// `struct v4l2_selection`.
    Selection(64, 64) {
        /// Input: [`CAPTURE`].
        kind: u32 = CAPTURE,
        /// Input: [`SELECT_CROP`] or another selection target.
        target: u32,
        /// Reserved by the kernel; always 0.
        flags: u32,
        /// Left edge, top edge, width and height of the rectangle, pixels.
        area: [u32; 4],
        /// Reserved by the kernel; always 0.
        reserved: [u32; 9],
    }
}

/// `V4L2_BUF_TYPE_VIDEO_CAPTURE`.
pub const CAPTURE: u32 = 1;
/// `V4L2_MEMORY_MMAP`.
pub const MMAP: u32 = 1;
/// `V4L2_FRMSIZE_TYPE_DISCRETE` and `V4L2_FRMIVAL_TYPE_DISCRETE`.
pub const DISCRETE: u32 = 1;
/// `V4L2_CAP_VIDEO_CAPTURE`.
pub const CAP_CAPTURE: u32 = 1;
/// `V4L2_CAP_STREAMING`.
pub const CAP_STREAMING: u32 = 0x0400_0000;
/// `V4L2_CAP_DEVICE_CAPS`.
pub const CAP_DEVICE_CAPS: u32 = 0x8000_0000;
/// `V4L2_FMT_FLAG_EMULATED`.
pub const FORMAT_EMULATED: u32 = 2;
/// `V4L2_CAP_TIMEPERFRAME`.
pub const TIME_PER_FRAME: u32 = 0x1000;
/// `V4L2_COLORSPACE_REC709`.
pub const COLORSPACE_709: u32 = 3;
/// `V4L2_COLORSPACE_JPEG`, whose range is full.
pub const COLORSPACE_JPEG: u32 = 7;
/// `V4L2_YCBCR_ENC_709`.
pub const YCBCR_709: u32 = 2;
/// `V4L2_QUANTIZATION_FULL_RANGE`.
pub const FULL_RANGE: u32 = 1;
/// `V4L2_BUF_FLAG_ERROR`.
pub const BUFFER_ERROR: u32 = 0x40;
/// `V4L2_EVENT_SOURCE_CHANGE`.
pub const EVENT_SOURCE_CHANGE: u32 = 5;
/// `V4L2_CAP_IO_MC`: the node lists its formats for one media bus code at a time.
pub const CAP_MEDIA: u32 = 0x2000_0000;
/// `V4L2_SEL_TGT_CROP`: the rectangle of the sensor that a picture shows.
pub const SELECT_CROP: u32 = 0;
/// `V4L2_SEL_TGT_CROP_BOUNDS`: the largest rectangle that a picture can show.
pub const SELECT_BOUNDS: u32 = 2;
/// `V4L2_SEL_TGT_NATIVE_SIZE`: the rectangle of all pixels of the sensor.
pub const SELECT_NATIVE: u32 = 3;
