//! Voxels plane by plane, in order, for formats that compress them. A layer of planes is read by all threads, then given on whole: as deep as a block,
//! so that each is decoded once, or as many planes as the memory holds, which decodes blocks again for the next ones.

use crate::budget::Shares;
use crate::error::ExportError;
use crate::job::Job;
use brickyard_volume::VoxelBox;
use rayon::prelude::*;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Planes of one channel and step.
pub(crate) struct Planes {
    /// Place of the first plane along z.
    pub(crate) z: u32,
    pub(crate) planes: Vec<Vec<u8>>,
}

/// Reads all planes in order, channels slowest, then steps, then z; `write` takes each layer. Runs on the current threads.
///
/// # Errors
/// If a block cannot be read, or by `write`.
pub(crate) fn for_each_layer(
    job: &Job,
    shares: Shares,
    mut write: impl FnMut(&Planes) -> Result<(), ExportError>,
) -> Result<(), ExportError> {
    let info = job.source.info();
    let [x, y, z] = info.extent.to_array();
    let plane_bytes = job.bytes_of(VoxelBox::new([0; 3], [x, y, 1]));
    let layers = job.blocks.cuts(2, (0, z), job.blocks.edge);
    let parts = layers.flat_map(|(from, to)| {
        (from..to).step_by(shares.planes as usize).map(move |z| (z, to.min(z.saturating_add(shares.planes))))
    });
    let volumes = (0..info.channels).flat_map(|channel| (0..info.times).map(move |time| (time, channel)));
    // Reused, so that no layer waits for the system's memory.
    let mut kept: Vec<Mutex<Vec<u8>>> = Vec::new();
    for (time, channel) in volumes {
        for (from, to) in parts.clone() {
            kept.resize_with((to - from) as usize, || Mutex::new(vec![0; plane_bytes]));
            let region = VoxelBox::new([0, 0, from], [x, y, to]);
            let read = |buffer: &mut Vec<u8>, bar: VoxelBox| -> Result<(), ExportError> {
                buffer.resize(job.bytes_of(bar), 0);
                job.source.read_box(time, channel, bar, buffer)?;
                place(job, bar, buffer, &kept[(bar.min.z - from) as usize..]);
                Ok(())
            };
            let bars = job.blocks.bars(region, shares.width);
            bars.par_bridge().try_for_each_init(Vec::new, read)?;
            let planes = kept.drain(..).map(|plane| plane.into_inner().unwrap_or_else(PoisonError::into_inner));
            let layer = Planes { z: from, planes: planes.collect() };
            write(&layer)?;
            kept.extend(layer.planes.into_iter().map(Mutex::new));
        }
    }
    Ok(())
}

/// Copies a bar's rows into the planes from its first one on.
fn place(job: &Job, bar: VoxelBox, voxels: &[u8], planes: &[Mutex<Vec<u8>>]) {
    let voxel_bytes = job.source.info().voxel_type.bytes();
    let (extent, whole_row) = (bar.extent(), job.source.info().extent.x as usize * voxel_bytes);
    let row_bytes = extent.x as usize * voxel_bytes;
    for (plane, rows) in planes.iter().zip(voxels.chunks_exact(row_bytes * extent.y as usize)) {
        let mut plane: MutexGuard<Vec<u8>> = plane.lock().unwrap_or_else(PoisonError::into_inner);
        let start = bar.min.y as usize * whole_row + bar.min.x as usize * voxel_bytes;
        let places = plane[start..].chunks_mut(whole_row);
        places.zip(rows.chunks_exact(row_bytes)).for_each(|(place, row)| place[..row_bytes].copy_from_slice(row));
    }
}
