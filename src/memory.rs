//! Available memory.

/// Bytes that a program can allocate before the system swaps or kills it; `None` if the system does not report them.
///
/// Reads `MemAvailable` of `proc_meminfo(5)`, and the limits of the program's container.
#[must_use]
pub fn available_bytes() -> Option<u64> {
    let system = available_in(&std::fs::read_to_string("/proc/meminfo").ok()?)?;
    let groups = std::fs::read_to_string("/proc/self/cgroup").unwrap_or_default();
    Some(system.min(left_in_groups(&groups, |path| std::fs::read_to_string(path).ok())))
}

/// Bytes that the control groups of a program leave it; `u64::MAX` without a limit. `groups` is its `/proc/self/cgroup`, and
/// `read` reads a file. Both versions of `cgroups(7)`: a limit holds for a group and for those above it. Pages of files that
/// were not used lately are given back first, so they count as free.
fn left_in_groups(groups: &str, read: impl Fn(&str) -> Option<String>) -> u64 {
    let mut left = u64::MAX;
    for line in groups.lines() {
        let mut parts = line.splitn(3, ':');
        let (Some(_), Some(kinds), Some(path)) = (parts.next(), parts.next(), parts.next()) else { continue };
        let (root, limit, used, unused) = match kinds {
            "" => ("/sys/fs/cgroup", "memory.max", "memory.current", "inactive_file "),
            kinds if kinds.split(',').any(|kind| kind == "memory") => {
                ("/sys/fs/cgroup/memory", "memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file ")
            }
            _ => continue,
        };
        // A container may see its own group as the root.
        let path = path.trim_end_matches('/');
        let above = path.char_indices().filter(|&(_, letter)| letter == '/').map(|(at, _)| &path[..at]);
        for group in above.chain([path]) {
            let number = |file: &str| read(&format!("{root}{group}/{file}"))?.trim().parse::<u64>().ok();
            let (Some(limit), Some(used)) = (number(limit), number(used)) else { continue };
            let statistics = read(&format!("{root}{group}/memory.stat")).unwrap_or_default();
            let unused = statistics.lines().find_map(|line| line.strip_prefix(unused)?.trim().parse::<u64>().ok());
            left = left.min(limit.saturating_sub(used.saturating_sub(unused.unwrap_or(0))));
        }
    }
    left
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

/// From now on, blocks of 128 KiB and more go back to the operating system as soon as they are freed. By itself, glibc raises
/// this threshold up to 32 MiB with every such block that is freed, and keeps the later ones in the heaps of the threads.
/// Bricks that come and go then took a third more memory than they need.
#[cfg_attr(all(target_os = "linux", target_env = "gnu"), expect(unsafe_code, reason = "a function of the C library"))]
pub fn give_back_large_blocks() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        /// `M_MMAP_THRESHOLD` of `mallopt(3)`.
        const THRESHOLD: std::ffi::c_int = -3;
        unsafe extern "C" {
            /// `mallopt(3)`.
            fn mallopt(parameter: std::ffi::c_int, value: std::ffi::c_int) -> std::ffi::c_int;
        }
        // SAFETY: a glibc function with this signature. It locks the main heap while it sets a number.
        unsafe { mallopt(THRESHOLD, 1 << 17) };
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

    #[test]
    fn the_least_of_the_limits_of_a_container_holds() {
        let files = [
            ("/sys/fs/cgroup/memory.max", "max\n"),
            ("/sys/fs/cgroup/memory.current", "900\n"),
            ("/sys/fs/cgroup/slice/memory.max", "1000\n"),
            ("/sys/fs/cgroup/slice/memory.current", "700\n"),
            ("/sys/fs/cgroup/slice/memory.stat", "anon 5\ninactive_file 200\n"),
            ("/sys/fs/cgroup/slice/job/memory.max", "2000\n"),
            ("/sys/fs/cgroup/slice/job/memory.current", "300\n"),
            ("/sys/fs/cgroup/memory/old/memory.limit_in_bytes", "400\n"),
            ("/sys/fs/cgroup/memory/old/memory.usage_in_bytes", "500\n"),
            ("/sys/fs/cgroup/memory/old/memory.stat", "inactive_file 1\ntotal_inactive_file 150\n"),
        ];
        let read = |path: &str| files.iter().find(|(name, _)| *name == path).map(|(_, text)| (*text).to_owned());
        assert_eq!(left_in_groups("0::/slice/job\n", read), 500, "of the group above");
        assert_eq!(left_in_groups("5:cpu:/\n4:hugetlb,memory:/old\n0::/slice\n", read), 50);
        assert_eq!(left_in_groups("0::/\n", read), u64::MAX, "without a limit");
        assert_eq!(left_in_groups("4:memory:/elsewhere\n\nrubbish\n", read), u64::MAX);
    }
}
