//! Numbers of controls from `linux/v4l2-controls.h`, and constants that sub-device pads and pixel formats share.

/// `V4L2_CTRL_FLAG_NEXT_CTRL`: requests the first control whose number is larger than `id`.
pub const NEXT_CONTROL: u32 = 0x8000_0000;
/// `V4L2_CTRL_FLAG_DISABLED`.
pub const CONTROL_DISABLED: u32 = 1;
/// `V4L2_CTRL_FLAG_READ_ONLY`.
pub const CONTROL_READ_ONLY: u32 = 4;
/// `V4L2_CTRL_FLAG_INACTIVE`.
pub const CONTROL_INACTIVE: u32 = 0x10;
/// `V4L2_CTRL_TYPE_INTEGER`.
pub const TYPE_INTEGER: u32 = 1;
/// `V4L2_CTRL_TYPE_BOOLEAN`.
pub const TYPE_BOOLEAN: u32 = 2;
/// `V4L2_CTRL_TYPE_MENU`.
pub const TYPE_MENU: u32 = 3;
/// `V4L2_CTRL_TYPE_INTEGER64`.
pub const TYPE_INTEGER64: u32 = 5;
/// `V4L2_CTRL_TYPE_INTEGER_MENU`.
pub const TYPE_INTEGER_MENU: u32 = 9;

/// `V4L2_CID_BRIGHTNESS`.
pub const BRIGHTNESS: u32 = 0x0098_0900;
/// `V4L2_CID_AUTO_WHITE_BALANCE`.
pub const AUTO_WHITE_BALANCE: u32 = 0x0098_090c;
/// `V4L2_CID_EXPOSURE`: lines of a sensor; an unspecified unit on some old webcams.
pub const EXPOSURE: u32 = 0x0098_0911;
/// `V4L2_CID_AUTOGAIN`.
pub const AUTOGAIN: u32 = 0x0098_0912;
/// `V4L2_CID_GAIN`.
pub const GAIN: u32 = 0x0098_0913;
/// `V4L2_CID_BACKLIGHT_COMPENSATION`.
pub const BACKLIGHT_COMPENSATION: u32 = 0x0098_091c;
/// `V4L2_CID_EXPOSURE_AUTO`, a menu.
pub const EXPOSURE_AUTO: u32 = 0x009a_0901;
/// `V4L2_CID_EXPOSURE_ABSOLUTE`, units of 100 us.
pub const EXPOSURE_ABSOLUTE: u32 = 0x009a_0902;
/// `V4L2_CID_EXPOSURE_AUTO_PRIORITY`: whether the camera may lower its frame rate.
pub const DYNAMIC_FRAME_RATE: u32 = 0x009a_0903;
/// `V4L2_CID_HUE_AUTO`.
pub const AUTO_HUE: u32 = 0x0098_0919;
/// `V4L2_CID_SHARPNESS`.
pub const SHARPNESS: u32 = 0x0098_091b;
/// `V4L2_CID_AUTOBRIGHTNESS`.
pub const AUTO_BRIGHTNESS: u32 = 0x0098_0920;
/// `V4L2_CID_FOCUS_AUTO`.
pub const AUTO_FOCUS: u32 = 0x009a_090c;
/// `V4L2_CID_AUTO_N_PRESET_WHITE_BALANCE`, a menu whose item 0 is manual.
pub const WHITE_BALANCE_PRESET: u32 = 0x009a_0914;
/// `V4L2_CID_WIDE_DYNAMIC_RANGE`.
pub const WIDE_DYNAMIC_RANGE: u32 = 0x009a_0915;
/// `V4L2_CID_ISO_SENSITIVITY_AUTO`, a menu whose item 0 is manual.
pub const AUTO_ISO: u32 = 0x009a_0918;

/// `V4L2_CID_VBLANK`, lines.
pub const VBLANK: u32 = 0x009e_0901;
/// `V4L2_CID_HBLANK`, pixels.
pub const HBLANK: u32 = 0x009e_0902;
/// `V4L2_CID_ANALOGUE_GAIN`.
pub const ANALOGUE_GAIN: u32 = 0x009e_0903;
/// `V4L2_CID_PIXEL_RATE`, pixels a second.
pub const PIXEL_RATE: u32 = 0x009f_0902;

/// `V4L2_EXPOSURE_MANUAL` and `V4L2_EXPOSURE_SHUTTER_PRIORITY`: the modes in which the exposure time can be set.
pub const MANUAL_MODES: [i64; 2] = [1, 2];

/// `V4L2_FIELD_NONE`.
pub const FIELD_NONE: u32 = 1;
/// `V4L2_SUBDEV_FORMAT_ACTIVE`.
pub const FORMAT_ACTIVE: u32 = 1;
