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

/// Asks the system for large pages behind the zeros of `block`, which nothing has touched yet. On its first write, Linux then
/// provides 2 MiB at once in place of 4 KiB; by itself it often does so only where it is asked to
/// (`/sys/kernel/mm/transparent_hugepage/enabled`). Blocks below 4 MiB gain nothing. Without large pages all stays as it was.
#[cfg_attr(target_os = "linux", expect(unsafe_code, reason = "a system call that takes a pointer"))]
pub fn prefer_large_pages<T>(block: &mut [T]) {
    #[cfg(target_os = "linux")]
    {
        /// Bytes of a large page of most processors; a multiple of the others' small pages.
        const LARGE: usize = 1 << 21;
        let before = block.as_mut_ptr().cast::<u8>().align_offset(LARGE);
        let length = size_of_val(block).saturating_sub(before) / LARGE * LARGE;
        if size_of_val(block) < 2 * LARGE || length == 0 {
            return;
        }
        let first = block.as_mut_ptr().cast::<u8>().wrapping_add(before).cast();
        // SAFETY: the pages from `first` on lie within `block`, which is borrowed alone, and the advice keeps their contents.
        let advised = unsafe { rustix::mm::madvise(first, length, rustix::mm::Advice::LinuxHugepage) };
        // A kernel without large pages refuses; the pages are small then.
        advised.unwrap_or_default();
    }
    #[cfg(not(target_os = "linux"))]
    let _ = block;
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

    /// Flags of the mapping that holds `address`.
    #[cfg(target_os = "linux")]
    fn flags_at(address: usize) -> String {
        let maps = std::fs::read_to_string("/proc/self/smaps").unwrap_or_default();
        let mut holds = false;
        for line in maps.lines() {
            let first = line.split_whitespace().next().unwrap_or_default();
            if let Some((low, high)) = first.split_once('-') {
                let ends = [low, high].map(|end| usize::from_str_radix(end, 16).unwrap_or(0));
                holds = (ends[0]..ends[1]).contains(&address);
            } else if holds && first == "VmFlags:" {
                return line.to_owned();
            }
        }
        String::new()
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn large_pages_are_preferred_for_large_blocks_only() {
        let mut large = vec![0_u16; 8 << 20];
        prefer_large_pages(&mut large);
        if std::path::Path::new("/sys/kernel/mm/transparent_hugepage").exists() {
            let flags = flags_at(large.as_ptr() as usize + (8 << 20));
            assert!(flags.split(' ').any(|flag| flag == "hg"), "{flags}");
        }
        large.fill(7);
        assert!(large.iter().all(|&voxel| voxel == 7), "the block is written as before");
        let mut small = vec![1_u8; 100];
        prefer_large_pages(&mut small);
        prefer_large_pages::<u8>(&mut []);
        assert_eq!(small, vec![1; 100]);
    }
}
