//! The allocator's handling of large blocks. Buffers of bricks and chunks come and go in several sizes by several threads; taken from the heap they leave
//! holes, which count against the memory budgets although nothing is in them.

/// Blocks of at least so many bytes are mapped alone, and go back to the system when they are freed. glibc raises its own limit to 32 MiB as blocks are
/// freed.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const MAPPED_BYTES: libc::c_int = 256 << 10;

/// Fixes the least size of a block mapped alone. Call it before threads start.
pub(crate) fn map_large_blocks() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: `mallopt` only sets a number, and no other thread runs yet. A refusal costs memory only.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, MAPPED_BYTES);
    }
}
