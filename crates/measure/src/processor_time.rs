//! The clock of processor time.

/// Processor time that all threads of this process have taken, milliseconds; zero where the system does not tell.
pub(crate) fn processor_ms() -> f64 {
    #[cfg(unix)]
    {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
        time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
    }
    #[cfg(not(unix))]
    0.0
}
