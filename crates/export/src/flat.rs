//! Voxels as they are, at their places in the file. Bars of blocks along x are decoded on all threads and written in place, so each thread holds one
//! bar: a whole row of blocks, or as many as its share of the memory allows.

use crate::budget::{Needs, pool, shares};
use crate::error::ExportError;
use crate::job::Job;
use crate::plan::Layout;
use brickyard_volume::VoxelBox;
use rayon::prelude::*;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::ops::Range;
use std::os::unix::fs::FileExt;

/// A bar of a channel of a step.
#[derive(Clone, Copy)]
struct Part {
    time: u32,
    channel: u32,
    bar: VoxelBox,
}

/// Writes header and voxels of these steps.
///
/// # Errors
/// If the memory is too little, a block cannot be read, the file cannot be written, or the export is cancelled.
pub(crate) fn write(job: &Job, layout: &Layout, steps: Range<u32>, file: &File) -> Result<(), ExportError> {
    let shares = shares(job, Needs::default())?;
    let io = ExportError::io(job.output);
    let mut head = BufWriter::new(file);
    (layout.head)(&mut head).and_then(|()| head.flush()).map_err(&io)?;
    for (place, bytes) in &layout.others {
        file.write_all_at(bytes, *place).map_err(&io)?;
    }
    let info = job.source.info();
    let first = steps.start;
    let volumes = steps.flat_map(|time| (0..info.channels).map(move |channel| (time, channel)));
    let bars = || job.blocks.bars(info.extent.full_box(), shares.width);
    let parts = volumes.flat_map(|(time, channel)| bars().map(move |bar| Part { time, channel, bar }));
    let work = |buffer: &mut Vec<u8>, part: Part| {
        buffer.resize(job.bytes_of(part.bar), 0);
        job.source.read_box(part.time, part.channel, part.bar, buffer)?;
        let place = layout.place(part.time - first, part.channel);
        write_bar(job, layout, Placed { place, bar: part.bar }, buffer, file).map_err(&io)?;
        job.advance(buffer.len() as u64)
    };
    pool(shares.threads)?.install(|| parts.par_bridge().try_for_each_init(Vec::new, work))
}

/// A bar of the volume at a place of the file.
#[derive(Clone, Copy)]
struct Placed {
    place: u64,
    bar: VoxelBox,
}

fn write_bar(job: &Job, layout: &Layout, placed: Placed, voxels: &[u8], file: &File) -> std::io::Result<()> {
    let (extent, Placed { place, bar }) = (job.source.info().extent, placed);
    let voxel_bytes = job.source.info().voxel_type.bytes() as u64;
    // Rows of one plane of the bar are adjacent in the file only if they are whole.
    let rows = if bar.extent().x == extent.x { bar.extent().y } else { 1 };
    let piece_bytes = u64::from(bar.extent().x) * u64::from(rows) * voxel_bytes;
    let places =
        (bar.min.z..bar.max.z).flat_map(|z| (bar.min.y..bar.max.y).step_by(rows as usize).map(move |y| (y, z)));
    for ((y, z), piece) in places.zip(voxels.chunks_exact(piece_bytes as usize)) {
        let in_plane = (u64::from(y) * u64::from(extent.x) + u64::from(bar.min.x)) * voxel_bytes;
        file.write_all_at(piece, place + u64::from(z) * layout.plane_bytes + in_plane)?;
    }
    Ok(())
}
