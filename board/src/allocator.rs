//! Settings of the allocator of the programs.

/// Makes glibc's allocator keep little memory that the program has freed.
///
/// - Blocks of 256 KB and more, such as answers of thousands of lights, return to the system when they are freed. By default, glibc raises its
///   threshold `M_MMAP_THRESHOLD` to the size of the largest freed block and keeps freed blocks below the threshold: with sets of 50,000
///   lights, the program keeps 14 MB.
/// - All threads allocate from one arena. By default, glibc creates up to eight arenas per processor (two on 32-bit systems), each of
///   which keeps blocks that its threads have freed. Threads seldom wait for each other, because no stage of the light path allocates.
#[allow(unsafe_code, reason = "the options have no safe wrapper")]
pub fn keep_little_memory() {
    // SAFETY: `mallopt` may be called at any time; it takes and returns integers.
    #[cfg(target_env = "gnu")]
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, 256 << 10);
        libc::mallopt(libc::M_ARENA_MAX, 1);
    };
}

/// Returns the free pages of the allocator's arenas to the system: on x86-64, a call takes 0.2 to 0.7 ms for 8 MB.
#[allow(unsafe_code, reason = "the function has no safe wrapper")]
pub fn return_free_pages() {
    // SAFETY: `malloc_trim` may be called at any time; it takes and returns integers.
    #[cfg(target_env = "gnu")]
    unsafe {
        libc::malloc_trim(0)
    };
}

/// Environment variable from which glibc reads options of the allocator at the start of a program.
const TUNABLES: &str = "GLIBC_TUNABLES";

/// Option with which glibc keeps no freed blocks for each thread. By default, a thread keeps up to seven blocks of each size up to 1 KB, 230 KB
/// in all, and fills them in the course of hours. A program cannot set the option after its start: the systemd unit sets it for the service.
const NO_THREAD_CACHES: &str = "glibc.malloc.tcache_count=0";

/// Restarts the program with its arguments and without caches of threads, as the service runs; returns if it runs so already or with another
/// allocator than glibc's.
///
/// # Errors
/// [`std::io::Error`] if the program cannot be started again; it may go on with the caches.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
pub fn restart_without_thread_caches() -> std::io::Result<()> {
    use std::os::unix::process::CommandExt;
    let present = std::env::var(TUNABLES).unwrap_or_default();
    if present.contains(NO_THREAD_CACHES) {
        return Ok(());
    }
    let tunables = [present.as_str(), NO_THREAD_CACHES].join(":");
    let mut again = std::process::Command::new(std::env::current_exe()?);
    Err(again.args(std::env::args_os().skip(1)).env(TUNABLES, tunables.trim_matches(':')).exec())
}

/// Does nothing: the allocator is not glibc's.
#[cfg(not(all(target_os = "linux", target_env = "gnu")))]
pub fn restart_without_thread_caches() -> std::io::Result<()> {
    Ok(())
}

#[cfg(all(test, target_os = "linux", target_env = "gnu"))]
pub(crate) mod tests {
    use super::*;
    use std::process::Command;

    /// Environment variable of the process of a single test.
    const ALONE: &str = "HEMILUX_TEST_ALONE";

    /// Runs `body` as the only test of another process, because all tests of this process share its resident memory. `test` is the path of the
    /// calling test in the crate.
    pub(crate) fn alone(test: &str, body: impl FnOnce()) {
        if std::env::var_os(ALONE).is_some() {
            return body();
        }
        let program = std::env::current_exe().expect("the program of the tests");
        let run = Command::new(program).args(["--exact", test]).env(ALONE, "1").output().expect("a process");
        let output = String::from_utf8_lossy(&run.stdout);
        assert!(run.status.success() && output.contains(" 1 passed"), "{output}");
    }

    /// 50 MB of freed memory below a used block.
    pub(crate) struct FreedMemory {
        _last: Option<Vec<u8>>,
        bytes_before: usize,
    }

    impl FreedMemory {
        pub(crate) fn new() -> Self {
            let mut blocks: Vec<_> = (0..500).map(|_| vec![1_u8; 100_000]).collect();
            let last = blocks.pop();
            drop(blocks);
            Self { _last: last, bytes_before: resident_bytes() }
        }

        pub(crate) fn is_returned(&self) -> bool {
            resident_bytes() + 40_000_000 < self.bytes_before
        }
    }

    fn resident_bytes() -> usize {
        let status = std::fs::read_to_string("/proc/self/status").expect("a file of the kernel");
        let size = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).expect("the resident size");
        1024 * size.trim().trim_end_matches(" kB").parse::<usize>().expect("a number")
    }

    #[test]
    fn the_service_runs_without_caches_of_threads() {
        let unit = include_str!("../debian/hemilux.service");
        let line = format!("Environment={TUNABLES}={NO_THREAD_CACHES}");
        assert!(unit.lines().any(|found| found == line), "expected the line {line}");
    }

    #[test]
    fn free_pages_below_a_used_block_return_to_the_system() {
        alone("allocator::tests::free_pages_below_a_used_block_return_to_the_system", || {
            let memory = FreedMemory::new();
            assert!(!memory.is_returned());
            return_free_pages();
            assert!(memory.is_returned());
        });
    }
}
