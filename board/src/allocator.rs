//! Settings of the allocator of the programs.

/// Makes the allocator return blocks of 256 KB and more, such as answers of thousands of lights, to the system when they are freed. By
/// default, glibc raises its threshold M_MMAP_THRESHOLD to the size of the largest freed block and keeps freed blocks below the threshold:
/// with sets of 50,000 lights, the program keeps 14 MB.
#[allow(unsafe_code, reason = "the option has no safe wrapper")]
pub fn return_large_blocks() {
    // SAFETY: `mallopt` may be called at any time; it takes and returns integers.
    #[cfg(target_env = "gnu")]
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, 256 << 10)
    };
}
