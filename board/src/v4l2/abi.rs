//! The kernel's V4L2 structures and numbers, as `linux/videodev2.h` has them for this target.
//!
//! Times are 64 bits wide on 32-bit targets too: kernels from 5.6 on take that layout whatever their configuration, while the old one
//! needs `CONFIG_COMPAT_32BIT_TIME`. The sizes are asserted against what a C compiler gives for x86-64, AArch64 and ARMv7.

pub use super::ids::*;

/// Bytes of a pointer, which some unions hold.
const POINTER: usize = size_of::<usize>();

macro_rules! plain {
    ($(#[$doc:meta])* $name:ident { $($(#[$field_doc:meta])* $field:ident: $type:ty = $zero:expr,)* }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug)]
        #[repr(C)]
        pub struct $name { $($(#[$field_doc])* pub $field: $type,)* }
        impl Default for $name {
            fn default() -> Self {
                Self { $($field: $zero,)* }
            }
        }
    };
}

plain! {
    /// `struct v4l2_capability`.
    Capability {
        /// Name of the driver, ends with NUL.
        driver: [u8; 16] = [0; 16],
        /// Name of the device.
        card: [u8; 32] = [0; 32],
        /// Where it is plugged in.
        bus_info: [u8; 32] = [0; 32],
        /// Kernel version.
        version: u32 = 0,
        /// Of the physical device.
        capabilities: u32 = 0,
        /// Of this node; valid with [`CAP_DEVICE_CAPS`].
        device_caps: u32 = 0,
        /// Zero.
        reserved: [u32; 3] = [0; 3],
    }
}

plain! {
    /// `struct v4l2_fmtdesc`.
    FormatDescription {
        /// Asked for.
        index: u32 = 0,
        /// Asked for: [`CAPTURE`].
        kind: u32 = CAPTURE,
        /// [`FORMAT_EMULATED`] and others.
        flags: u32 = 0,
        /// For people.
        description: [u8; 32] = [0; 32],
        /// The four characters.
        fourcc: u32 = 0,
        /// Media bus code.
        mbus_code: u32 = 0,
        /// Zero.
        reserved: [u32; 3] = [0; 3],
    }
}

plain! {
    /// `struct v4l2_frmsizeenum`.
    SizeDescription {
        /// Asked for.
        index: u32 = 0,
        /// Asked for.
        fourcc: u32 = 0,
        /// [`DISCRETE`] or not.
        kind: u32 = 0,
        /// Discrete: width, height. Else: least, largest, step of the width, then of the height.
        size: [u32; 6] = [0; 6],
        /// Zero.
        reserved: [u32; 2] = [0; 2],
    }
}

plain! {
    /// `struct v4l2_frmivalenum`.
    IntervalDescription {
        /// Asked for.
        index: u32 = 0,
        /// Asked for.
        fourcc: u32 = 0,
        /// Asked for.
        width: u32 = 0,
        /// Asked for.
        height: u32 = 0,
        /// [`DISCRETE`] or not.
        kind: u32 = 0,
        /// Discrete: one fraction in seconds. Else: least, largest, step.
        interval: [u32; 6] = [0; 6],
        /// Zero.
        reserved: [u32; 2] = [0; 2],
    }
}

plain! {
    /// `struct v4l2_pix_format`.
    PixelFormat {
        /// Columns.
        width: u32 = 0,
        /// Rows.
        height: u32 = 0,
        /// The four characters.
        fourcc: u32 = 0,
        /// [`FIELD_NONE`]: progressive.
        field: u32 = FIELD_NONE,
        /// Bytes from one row to the next.
        bytes_per_line: u32 = 0,
        /// Largest bytes of a frame.
        size_image: u32 = 0,
        /// Colour space.
        colorspace: u32 = 0,
        /// Zero.
        private: u32 = 0,
        /// Zero.
        flags: u32 = 0,
        /// [`YCBCR_709`] and others; 0 is the colour space's own.
        ycbcr: u32 = 0,
        /// [`FULL_RANGE`] and others; 0 is the colour space's own.
        quantization: u32 = 0,
        /// Transfer function.
        transfer: u32 = 0,
    }
}

plain! {
    /// `struct v4l2_format` of a single-planar capture.
    Format {
        /// Asked for: [`CAPTURE`].
        kind: u32 = CAPTURE,
        /// The kernel's union holds pointers: on 64 bits there is a gap before it.
        align: [usize; 0] = [],
        /// The picture.
        pixel: PixelFormat = PixelFormat::default(),
        /// The rest of the union.
        rest: [u32; 38] = [0; 38],
    }
}

plain! {
    /// `struct v4l2_streamparm` of a capture.
    Parameters {
        /// Asked for: [`CAPTURE`].
        kind: u32 = CAPTURE,
        /// [`TIME_PER_FRAME`] where the interval can be set.
        capability: u32 = 0,
        /// Zero.
        mode: u32 = 0,
        /// Seconds per frame, numerator and denominator.
        interval: [u32; 2] = [0; 2],
        /// The rest of the union.
        rest: [u32; 46] = [0; 46],
    }
}

plain! {
    /// `struct v4l2_query_ext_ctrl`.
    ControlDescription {
        /// Asked for, perhaps with [`NEXT_CONTROL`].
        id: u32 = 0,
        /// [`TYPE_INTEGER`] and others; new kernels have types that are not named here.
        kind: u32 = 0,
        /// For people.
        name: [u8; 32] = [0; 32],
        /// Least value.
        minimum: i64 = 0,
        /// Largest value.
        maximum: i64 = 0,
        /// From value to value.
        step: u64 = 0,
        /// At power-on.
        default: i64 = 0,
        /// [`CONTROL_DISABLED`] and others.
        flags: u32 = 0,
        /// Bytes of an element.
        element_size: u32 = 0,
        /// Elements.
        elements: u32 = 0,
        /// Dimensions.
        dimensions: u32 = 0,
        /// Sizes of the dimensions.
        sizes: [u32; 4] = [0; 4],
        /// Zero.
        reserved: [u32; 32] = [0; 32],
    }
}

plain! {
    /// `struct v4l2_querymenu`.
    MenuItem {
        /// Asked for.
        id: u32 = 0,
        /// Asked for.
        index: u32 = 0,
        /// Name, or in its first eight bytes a number.
        name: [u8; 32] = [0; 32],
        /// Zero.
        reserved: u32 = 0,
    }
}

plain! {
    /// `struct v4l2_ext_control` with a number.
    Control {
        /// Which.
        id: u32 = 0,
        /// 0: no pointer.
        size: u32 = 0,
        /// Zero.
        reserved: u32 = 0,
        /// The number's bytes: 32 bits in the first, or 64 in both.
        value: [u32; 2] = [0; 2],
    }
}

plain! {
    /// `struct v4l2_requestbuffers`.
    BufferRequest {
        /// Asked for, then granted.
        count: u32 = 0,
        /// Asked for: [`CAPTURE`].
        kind: u32 = CAPTURE,
        /// Asked for: [`MMAP`].
        memory: u32 = MMAP,
        /// Of the queue.
        capabilities: u32 = 0,
        /// Zero.
        flags: u32 = 0,
    }
}

plain! {
    /// `struct v4l2_buffer`, with times of 64 bits.
    Buffer {
        /// Which.
        index: u32 = 0,
        /// Asked for: [`CAPTURE`].
        kind: u32 = CAPTURE,
        /// Bytes that hold something.
        bytes_used: u32 = 0,
        /// [`BUFFER_ERROR`] and others.
        flags: u32 = 0,
        /// Zero for progressive pictures in, [`FIELD_NONE`] out.
        field: u32 = 0,
        /// Seconds and microseconds.
        timestamp: [i64; 2] = [0; 2],
        /// Unused.
        timecode: [u32; 4] = [0; 4],
        /// Counts the frames of the sensor.
        sequence: u32 = 0,
        /// Asked for: [`MMAP`].
        memory: u32 = MMAP,
        /// What to map, in the first word.
        offset: [u32; POINTER / 4] = [0; POINTER / 4],
        /// Bytes to map.
        length: u32 = 0,
        /// Zero.
        reserved: u32 = 0,
        /// Zero.
        request: u32 = 0,
    }
}

plain! {
    /// `struct v4l2_event_subscription`.
    Subscription {
        /// [`EVENT_SOURCE_CHANGE`].
        kind: u32 = 0,
        /// Zero.
        id: u32 = 0,
        /// Zero.
        flags: u32 = 0,
        /// Zero.
        reserved: [u32; 5] = [0; 5],
    }
}

plain! {
    /// `struct v4l2_event`, with times of 64 bits.
    Event {
        /// [`EVENT_SOURCE_CHANGE`].
        kind: u32 = 0,
        /// The union, eight bytes aligned.
        data: [u64; 8] = [0; 8],
        /// Still to come.
        pending: u32 = 0,
        /// Counts events.
        sequence: u32 = 0,
        /// Seconds and nanoseconds.
        timestamp: [i64; 2] = [0; 2],
        /// Zero.
        id: u32 = 0,
        /// Zero.
        reserved: [u32; 8] = [0; 8],
    }
}

plain! {
    /// `struct v4l2_subdev_format`.
    PadFormat {
        /// Asked for: [`FORMAT_ACTIVE`].
        which: u32 = FORMAT_ACTIVE,
        /// Asked for: 0, a sensor's output.
        pad: u32 = 0,
        /// Columns.
        width: u32 = 0,
        /// Rows.
        height: u32 = 0,
        /// Media bus code.
        code: u32 = 0,
        /// [`FIELD_NONE`]: progressive.
        field: u32 = FIELD_NONE,
        /// Colour space.
        colorspace: u32 = 0,
        /// Encoding, quantisation, transfer function, flags, zero.
        rest: [u16; 14] = [0; 14],
        /// Stream and zero.
        reserved: [u32; 8] = [0; 8],
    }
}

plain! {
    /// `struct v4l2_subdev_mbus_code_enum`.
    BusCode {
        /// Asked for: 0.
        pad: u32 = 0,
        /// Asked for.
        index: u32 = 0,
        /// Media bus code.
        code: u32 = 0,
        /// Asked for: [`FORMAT_ACTIVE`].
        which: u32 = FORMAT_ACTIVE,
        /// Flags, stream and zero.
        reserved: [u32; 8] = [0; 8],
    }
}

/// What `linux/videodev2.h` gives with a C compiler: x86-64 and AArch64 first, ARMv7 with `_TIME_BITS=64` second.
const fn sized<T>(wide: usize, narrow: usize) {
    assert!(size_of::<T>() == if POINTER == 8 { wide } else { narrow }, "not the kernel's layout");
}
const _: () = {
    sized::<Capability>(104, 104);
    sized::<FormatDescription>(64, 64);
    sized::<SizeDescription>(44, 44);
    sized::<IntervalDescription>(52, 52);
    sized::<Format>(208, 204);
    sized::<Parameters>(204, 204);
    sized::<ControlDescription>(232, 232);
    sized::<MenuItem>(44, 44);
    sized::<Control>(20, 20);
    sized::<BufferRequest>(20, 20);
    sized::<Buffer>(88, 80);
    sized::<Subscription>(32, 32);
    sized::<Event>(136, 136);
    sized::<PadFormat>(88, 88);
    sized::<BusCode>(48, 48);
};

/// `V4L2_BUF_TYPE_VIDEO_CAPTURE`.
pub const CAPTURE: u32 = 1;
/// `V4L2_MEMORY_MMAP`.
pub const MMAP: u32 = 1;
/// `V4L2_FIELD_NONE`.
pub const FIELD_NONE: u32 = 1;
/// `V4L2_FRMSIZE_TYPE_DISCRETE` and `V4L2_FRMIVAL_TYPE_DISCRETE`.
pub const DISCRETE: u32 = 1;
/// `V4L2_SUBDEV_FORMAT_ACTIVE`.
pub const FORMAT_ACTIVE: u32 = 1;
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
