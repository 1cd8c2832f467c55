//! What the process holds, as the kernel counts it.

/// Resident memory of this process in bytes; zero where the system does not tell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ProcessMemory {
    /// Highest resident set so far, mapped files included.
    pub resident_peak_bytes: u64,
    /// Anonymous memory now: what the process itself holds, without mapped files.
    pub anonymous_bytes: u64,
}

impl ProcessMemory {
    /// Asks the kernel (Linux; elsewhere zeros).
    pub fn now() -> Self {
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let field = |name: &str| {
            let line = status.lines().find_map(|l| l.strip_prefix(name))?;
            line.split_whitespace().next()?.parse::<u64>().ok().map(|kib| kib * 1024)
        };
        Self { resident_peak_bytes: field("VmHWM:").unwrap_or(0), anonymous_bytes: field("RssAnon:").unwrap_or(0) }
    }
}
