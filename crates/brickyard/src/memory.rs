//! Memory used by and available to this process, as counted by the kernel.

use std::path::Path;

/// Resident memory of this process in bytes; zero where the system does not report it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ProcessMemory {
    /// Highest resident set so far, mapped files included.
    pub resident_peak_bytes: u64,
    /// Anonymous memory now: the process's own, without mapped files.
    pub anonymous_bytes: u64,
}

impl ProcessMemory {
    /// Reads the memory of this process from the kernel. All fields are 0 on systems other than Linux.
    pub fn now() -> Self {
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let field = |name: &str| bytes_of(&status, name).unwrap_or(0);
        Self { resident_peak_bytes: field("VmHWM:"), anonymous_bytes: field("RssAnon:") }
    }
}

/// Bytes of a field that the kernel gives in KiB.
fn bytes_of(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    line.split_whitespace().next()?.parse::<u64>().ok()?.checked_mul(1024)
}

/// Main memory available to this process in bytes: the machine's, or its control group's if lower. `None` where the
/// system does not report it (Linux does).
pub fn available_bytes() -> Option<u64> {
    available_in(Path::new("/"))
}

/// [`available_bytes`] of a machine whose file system begins at `root`.
fn available_in(root: &Path) -> Option<u64> {
    let total = bytes_of(&std::fs::read_to_string(root.join("proc/meminfo")).ok()?, "MemTotal:")?;
    let groups = std::fs::read_to_string(root.join("proc/self/cgroup")).unwrap_or_default();
    let limits = groups.lines().filter_map(|line| {
        let (_, rest) = line.split_once(':')?;
        let (controllers, group) = rest.split_once(':')?;
        // Version 2 names no controllers; version 1 has a tree for memory.
        let (tree, file) = match controllers {
            "" => ("sys/fs/cgroup", "memory.max"),
            _ if controllers.split(',').any(|name| name == "memory") => {
                ("sys/fs/cgroup/memory", "memory.limit_in_bytes")
            }
            _ => return None,
        };
        let tree = root.join(tree);
        // The limits of all enclosing groups apply. "max" is no number.
        let group = tree.join(group.trim_start_matches('/'));
        let groups = group.ancestors().take_while(|folder| folder.starts_with(&tree));
        groups.filter_map(|folder| std::fs::read_to_string(folder.join(file)).ok()?.trim().parse::<u64>().ok()).min()
    });
    Some(limits.fold(total, u64::min))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tightest_control_group_limits_the_memory() {
        let root = tempfile::tempdir().unwrap();
        let write = |file: &str, text: &str| {
            let path = root.path().join(file);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        };
        assert_eq!(available_in(root.path()), None);
        write("proc/meminfo", "MemTotal:       16000 kB\nMemFree:  1 kB\n");
        assert_eq!(available_in(root.path()), Some(16_384_000));
        write("proc/self/cgroup", "1:name=systemd:/a\n0::/slice/task\n");
        write("sys/fs/cgroup/slice/memory.max", "5000000\n");
        write("sys/fs/cgroup/slice/task/memory.max", "max\n");
        assert_eq!(available_in(root.path()), Some(5_000_000));
        write("proc/self/cgroup", "4:cpu,memory:/docker\n");
        write("sys/fs/cgroup/memory/memory.limit_in_bytes", "9223372036854771712");
        assert_eq!(available_in(root.path()), Some(16_384_000));
        write("sys/fs/cgroup/memory/docker/memory.limit_in_bytes", "7000000");
        assert_eq!(available_in(root.path()), Some(7_000_000));
    }
}
