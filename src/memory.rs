//! Available memory.

/// Bytes that a program can allocate before the system swaps or kills it; `None` if the system does not report them.
///
/// Reads `MemAvailable` of `proc_meminfo(5)`, which ignores the limits of a container.
#[must_use]
pub fn available_bytes() -> Option<u64> {
    available_in(&std::fs::read_to_string("/proc/meminfo").ok()?)
}

/// `MemAvailable` (in "kB" of 1024 bytes), in bytes.
fn available_in(meminfo: &str) -> Option<u64> {
    let kibibytes = meminfo.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?.trim().strip_suffix("kB")?;
    kibibytes.trim().parse::<u64>().ok()?.checked_mul(1024)
}

/// Returns freed heap memory to the operating system. glibc does not do this by itself: each thread has its own heap,
/// which keeps its freed pages. A software device compiles its shaders in these heaps, too.
#[cfg_attr(all(target_os = "linux", target_env = "gnu"), expect(unsafe_code, reason = "a function of the C library"))]
pub fn give_back_freed() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        unsafe extern "C" {
            /// `malloc_trim(3)`.
            fn malloc_trim(keep: usize) -> std::ffi::c_int;
        }
        // SAFETY: a glibc function with this signature. It locks the heaps that it scans and moves no block that is in
        // use.
        unsafe { malloc_trim(0) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn available_memory_is_read_as_the_system_writes_it() {
        let text = "MemTotal:       16384 kB\nMemFree:            7 kB\nMemAvailable:   2 kB\n";
        assert_eq!(available_in(text), Some(2048));
        assert_eq!(available_in("MemTotal: 1 kB\n"), None);
    }
}
