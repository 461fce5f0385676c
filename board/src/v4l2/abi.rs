//! The kernel's V4L2 structures and numbers, as `linux/videodev2.h` has them for this target.
//!
//! Times are 64 bits wide on 32-bit targets too: kernels from 5.6 on take that layout whatever their configuration, while the old one
//! needs `CONFIG_COMPAT_32BIT_TIME`. The sizes are asserted against what a C compiler gives for x86-64, AArch64 and ARMv7.

pub use super::ids::*;
use super::layout::POINTER;
pub use super::pads::*;

plain! {
    /// `struct v4l2_capability`.
    Capability(104, 104) {
        /// Name of the driver, ends with NUL.
        driver: [u8; 16],
        /// Name of the device.
        card: [u8; 32],
        /// Bus address of the device.
        bus_info: [u8; 32],
        /// Kernel version.
        version: u32,
        /// Of the physical device.
        capabilities: u32,
        /// Of this node; valid with [`CAP_DEVICE_CAPS`].
        device_caps: u32,
        /// Zero.
        reserved: [u32; 3],
    }
}

plain! {
    /// `struct v4l2_fmtdesc`.
    FormatDescription(64, 64) {
        /// Asked for.
        index: u32,
        /// Asked for: [`CAPTURE`].
        kind: u32 = CAPTURE,
        /// [`FORMAT_EMULATED`] and others.
        flags: u32,
        /// For people.
        description: [u8; 32],
        /// The four characters.
        fourcc: u32,
        /// Media bus code.
        mbus_code: u32,
        /// Zero.
        reserved: [u32; 3],
    }
}

plain! {
    /// `struct v4l2_frmsizeenum`.
    SizeDescription(44, 44) {
        /// Asked for.
        index: u32,
        /// Asked for.
        fourcc: u32,
        /// [`DISCRETE`] or not.
        kind: u32,
        /// Discrete: width, height. Else: least, largest, step of the width, then of the height.
        size: [u32; 6],
        /// Zero.
        reserved: [u32; 2],
    }
}

plain! {
    /// `struct v4l2_frmivalenum`.
    IntervalDescription(52, 52) {
        /// Asked for.
        index: u32,
        /// Asked for.
        fourcc: u32,
        /// Asked for.
        width: u32,
        /// Asked for.
        height: u32,
        /// [`DISCRETE`] or not.
        kind: u32,
        /// Discrete: one fraction in seconds. Else: least, largest, step.
        interval: [u32; 6],
        /// Zero.
        reserved: [u32; 2],
    }
}

plain! {
    /// `struct v4l2_pix_format`.
    PixelFormat(48, 48) {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// The four characters.
        fourcc: u32,
        /// [`FIELD_NONE`]: progressive.
        field: u32 = FIELD_NONE,
        /// Bytes from one row to the next.
        bytes_per_line: u32,
        /// Largest bytes of a frame.
        size_image: u32,
        /// Colour space.
        colorspace: u32,
        /// Zero.
        private: u32,
        /// Zero.
        flags: u32,
        /// [`YCBCR_709`] and others; 0 is the colour space's own.
        ycbcr: u32,
        /// [`FULL_RANGE`] and others; 0 is the colour space's own.
        quantization: u32,
        /// Transfer function.
        transfer: u32,
    }
}

plain! {
    /// `struct v4l2_format` of a single-planar capture.
    Format(208, 204) {
        /// Asked for: [`CAPTURE`].
        kind: u32 = CAPTURE,
        /// The kernel's union holds pointers: on 64 bits there is a gap before it.
        align: [usize; 0],
        /// The picture.
        pixel: PixelFormat = PixelFormat::default(),
        /// The rest of the union.
        rest: [u32; 38],
    }
}

plain! {
    /// `struct v4l2_streamparm` of a capture.
    Parameters(204, 204) {
        /// Asked for: [`CAPTURE`].
        kind: u32 = CAPTURE,
        /// [`TIME_PER_FRAME`] where the interval can be set.
        capability: u32,
        /// Zero.
        mode: u32,
        /// Seconds per frame, numerator and denominator.
        interval: [u32; 2],
        /// The rest of the union.
        rest: [u32; 46],
    }
}

plain! {
    /// `struct v4l2_query_ext_ctrl`.
    ControlDescription(232, 232) {
        /// Asked for, perhaps with [`NEXT_CONTROL`].
        id: u32,
        /// [`TYPE_INTEGER`] and others; new kernels have types that are not named here.
        kind: u32,
        /// For people.
        name: [u8; 32],
        /// Least value.
        minimum: i64,
        /// Largest value.
        maximum: i64,
        /// From value to value.
        step: u64,
        /// At power-on.
        default: i64,
        /// [`CONTROL_DISABLED`] and others.
        flags: u32,
        /// Bytes of an element.
        element_size: u32,
        /// Elements.
        elements: u32,
        /// Dimensions.
        dimensions: u32,
        /// Sizes of the dimensions.
        sizes: [u32; 4],
        /// Zero.
        reserved: [u32; 32],
    }
}

plain! {
    /// `struct v4l2_querymenu`.
    MenuItem(44, 44) {
        /// Asked for.
        id: u32,
        /// Asked for.
        index: u32,
        /// Name, or in its first eight bytes a number.
        name: [u8; 32],
        /// Zero.
        reserved: u32,
    }
}

plain! {
    /// `struct v4l2_ext_control` with a number.
    Control(20, 20) {
        /// Which.
        id: u32,
        /// 0: no pointer.
        size: u32,
        /// Zero.
        reserved: u32,
        /// The number's bytes: 32 bits in the first, or 64 in both.
        value: [u32; 2],
    }
}

plain! {
    /// `struct v4l2_requestbuffers`.
    BufferRequest(20, 20) {
        /// Asked for, then granted.
        count: u32,
        /// Asked for: [`CAPTURE`].
        kind: u32 = CAPTURE,
        /// Asked for: [`MMAP`].
        memory: u32 = MMAP,
        /// Of the queue.
        capabilities: u32,
        /// Zero.
        flags: u32,
    }
}

plain! {
    /// `struct v4l2_buffer`, with times of 64 bits.
    Buffer(88, 80) {
        /// Which.
        index: u32,
        /// Asked for: [`CAPTURE`].
        kind: u32 = CAPTURE,
        /// Bytes that hold something.
        bytes_used: u32,
        /// [`BUFFER_ERROR`] and others.
        flags: u32,
        /// Zero for progressive pictures in, [`FIELD_NONE`] out.
        field: u32,
        /// Seconds and microseconds.
        timestamp: [i64; 2],
        /// Unused.
        timecode: [u32; 4],
        /// Counts the frames of the sensor.
        sequence: u32,
        /// Asked for: [`MMAP`].
        memory: u32 = MMAP,
        /// What to map, in the first word.
        offset: [u32; POINTER / 4],
        /// Bytes to map.
        length: u32,
        /// Zero.
        reserved: u32,
        /// Zero.
        request: u32,
    }
}

plain! {
    /// `struct v4l2_event_subscription`.
    Subscription(32, 32) {
        /// [`EVENT_SOURCE_CHANGE`].
        kind: u32,
        /// Zero.
        id: u32,
        /// Zero.
        flags: u32,
        /// Zero.
        reserved: [u32; 5],
    }
}

plain! {
    /// `struct v4l2_event`, with times of 64 bits.
    Event(136, 136) {
        /// [`EVENT_SOURCE_CHANGE`].
        kind: u32,
        /// The union, eight bytes aligned.
        data: [u64; 8],
        /// Still to come.
        pending: u32,
        /// Counts events.
        sequence: u32,
        /// Seconds and nanoseconds.
        timestamp: [i64; 2],
        /// Zero.
        id: u32,
        /// Zero.
        reserved: [u32; 8],
    }
}

plain! {
    /// `struct v4l2_selection`.
    Selection(64, 64) {
        /// Asked for: [`CAPTURE`].
        kind: u32 = CAPTURE,
        /// Asked for: [`SELECT_CROP`] and others.
        target: u32,
        /// Zero.
        flags: u32,
        /// Left, top, width and height, pixels.
        area: [u32; 4],
        /// Zero.
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
/// `V4L2_CAP_IO_MC`: the node's formats are those of its media bus code.
pub const CAP_MEDIA: u32 = 0x2000_0000;
/// `V4L2_SEL_TGT_CROP`: the part of the sensor that a picture shows.
pub const SELECT_CROP: u32 = 0;
/// `V4L2_SEL_TGT_CROP_BOUNDS`: the largest part that can be shown.
pub const SELECT_BOUNDS: u32 = 2;
/// `V4L2_SEL_TGT_NATIVE_SIZE`: all pixels of the sensor.
pub const SELECT_NATIVE: u32 = 3;
