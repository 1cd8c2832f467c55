//! Division of the memory among threads, counted before anything is allocated.

use crate::error::ExportError;
use crate::job::Job;

/// The program, its stacks and its allocator.
const PROGRAM_BYTES: u64 = 16 << 20;

/// The shares of an export.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Shares {
    pub(crate) threads: usize,
    /// Voxels along x read by a thread at a time: whole blocks.
    pub(crate) width: u32,
    /// Planes held at a time.
    pub(crate) planes: u32,
}

/// Needs beside those of reading blocks.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Needs {
    /// Bytes of a thread's own work.
    pub(crate) thread_bytes: u64,
    /// Bytes of a plane, if planes are held whole.
    pub(crate) plane_bytes: u64,
}

/// The most planes up to a layer of blocks, then the most threads, then the widest bars along x, of whole blocks.
///
/// # Errors
/// If the memory is too little for one thread, with the least that is enough.
pub(crate) fn shares(job: &Job, needs: Needs) -> Result<Shares, ExportError> {
    let (info, edge) = (job.source.info(), u64::from(job.blocks.edge));
    let block_bytes = edge.pow(3) * info.voxel_type.bytes() as u64;
    let fixed = PROGRAM_BYTES.saturating_add(job.source.held_bytes());
    // Memory of a read, and of a bar of one block.
    let read_bytes = job.source.reader_bytes().saturating_add(needs.thread_bytes);
    let least = read_bytes.saturating_add(block_bytes);
    let needed_bytes = fixed.saturating_add(least).saturating_add(needs.plane_bytes);
    if job.memory_bytes < needed_bytes {
        return Err(ExportError::Memory { needed_bytes, given_bytes: job.memory_bytes });
    }
    let room = job.memory_bytes - fixed;
    let layer = edge.min(info.extent.z.into());
    let planes = (room - least).checked_div(needs.plane_bytes).map_or(layer, |fitting| layer.min(fitting));
    let room = room - planes * needs.plane_bytes;
    let threads = (rayon::current_num_threads() as u64).min(room / least).max(1);
    let blocks = (room / threads - read_bytes) / block_bytes;
    let whole = u64::from(info.extent.x).div_ceil(edge) + 1;
    let width = (blocks.min(whole) * edge).min(1 << 31);
    Ok(Shares { threads: threads as usize, width: width as u32, planes: planes as u32 })
}

/// Threads of the export's own.
///
/// # Errors
/// If the system does not start them.
pub(crate) fn pool(threads: usize) -> Result<rayon::ThreadPool, ExportError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.map_err(|error| ExportError::Threads(error.to_string()))
}
