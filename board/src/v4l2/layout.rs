//! Definition of structures that the kernel shares with programs, in the layout of a C compiler.

/// Size of a pointer of the target, bytes; some unions of the kernel contain pointers.
pub const POINTER: usize = size_of::<usize>();

/// Types of which a value with all bits zero is valid.
pub trait Zero {
    /// The value whose bits are all zero.
    const ZERO: Self;
}

macro_rules! zero {
    ($($number:ty)*) => { $(impl Zero for $number { const ZERO: Self = 0; })* };
}

zero! { u8 u16 u32 u64 i64 usize }

impl<T: Zero, const N: usize> Zero for [T; N] {
    const ZERO: Self = [T::ZERO; N];
}

/// Defines a kernel structure with its size in bytes on 64-bit and 32-bit targets (x86-64 and AArch64; ARMv7 with `_TIME_BITS=64`), which
/// is asserted at compile time. Fields default to zero unless a value is given.
macro_rules! plain {
    (@value $type:ty) => { <$type as $crate::v4l2::layout::Zero>::ZERO };
    (@value $type:ty, $value:expr) => { $value };
    ($(#[$doc:meta])* $name:ident($wide:literal, $narrow:literal) { $($(#[$field_doc:meta])* $field:ident: $type:ty $(= $value:expr)?,)* }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug)]
        #[repr(C)]
        pub struct $name { $($(#[$field_doc])* pub $field: $type,)* }
        impl Default for $name {
            fn default() -> Self {
                Self { $($field: plain!(@value $type $(, $value)?),)* }
            }
        }
        const _: () = assert!(size_of::<$name>() == if $crate::v4l2::layout::POINTER == 8 { $wide } else { $narrow }, "not the kernel's layout");
    };
}
