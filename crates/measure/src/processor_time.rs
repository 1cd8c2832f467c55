//! Clock of processor time.

/// Processor time of all threads of this process, milliseconds; zero where the system does not report it.
pub(crate) fn processor_ms() -> f64 {
    #[cfg(unix)]
    {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
        time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
    }
    #[cfg(not(unix))]
    0.0
}
