//! A folder of PNG pictures, one for each plane of one channel and step, of 8 or 16 bits. They keep values alone. A layer of planes is read at a time,
//! and each of its pictures is compressed by a thread, row by row.

use crate::budget::{Needs, pool, shares};
use crate::error::ExportError;
use crate::job::Job;
use crate::plan::{Body, Plan};
use crate::planes::{Planes, for_each_layer};
use crate::volume::Volume;
use brickyard_volume::VoxelType;
use png::{BitDepth, ColorType, Compression, Encoder, EncodingError};
use rayon::prelude::*;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// Memory of a thread: rows, and the state and output of Deflate.
const THREAD_BYTES: u64 = 1 << 20;
/// Most pixels along an axis of a PNG.
const MOST_PX: u32 = i32::MAX as u32;
/// Fewest digits of a name: enough for most volumes.
const DIGITS: usize = 4;

pub(crate) fn plan(volume: &Volume) -> Result<Plan, ExportError> {
    volume.check_one_channel("A folder of PNG planes")?;
    volume.check_one_step("A folder of PNG planes")?;
    let (voxel_type, extent) = (volume.info.voxel_type, volume.info.extent);
    if !matches!(voxel_type, VoxelType::U8 | VoxelType::U16) {
        let problem =
            format!("PNG holds u8 and u16, not {voxel_type}: choose .tif, .nrrd, .nii, .mha, .vti, .npy or .raw");
        return Err(ExportError::unfit(volume.output, problem));
    }
    if extent.x.max(extent.y) > MOST_PX {
        let problem = format!("PNG has {MOST_PX} pixels along an axis at most: export a box, or choose .nrrd");
        return Err(ExportError::unfit(volume.output, problem));
    }
    Ok(Plan::new(volume, "PNG", &[], Body::Pictures))
}

/// Writes the pictures into a folder.
///
/// # Errors
/// If the memory is too little, a block cannot be read, a file cannot be written, or the export is cancelled.
pub(crate) fn write(job: &Job, folder: &Path) -> Result<(), ExportError> {
    let info = job.source.info();
    let plane_bytes = info.extent.x as u64 * info.extent.y as u64 * info.voxel_type.bytes() as u64;
    let shares = shares(job, Needs { thread_bytes: THREAD_BYTES, plane_bytes })?;
    let digits = (info.extent.z - 1).to_string().len().max(DIGITS);
    let write_layer = |layer: &Planes| {
        let planes = layer.planes.par_iter().enumerate();
        planes.try_for_each(|(i, plane)| {
            let name = format!("{:0digits$}.png", layer.z as usize + i);
            picture(job, &folder.join(name), plane).map_err(ExportError::io(job.output))?;
            job.advance(plane.len() as u64)
        })
    };
    pool(shares.threads)?.install(|| for_each_layer(job, shares, write_layer))
}

fn picture(job: &Job, path: &Path, plane: &[u8]) -> io::Result<()> {
    let info = job.source.info();
    let file = File::create_new(path)?;
    let mut out = BufWriter::new(&file);
    let mut encoder = Encoder::new(&mut out, info.extent.x, info.extent.y);
    let is_wide = info.voxel_type == VoxelType::U16;
    encoder.set_color(ColorType::Grayscale);
    encoder.set_depth(if is_wide { BitDepth::Sixteen } else { BitDepth::Eight });
    encoder.set_compression(Compression::Fast);
    let mut writer = encoder.write_header().map_err(without_words)?;
    let mut rows = writer.stream_writer().map_err(without_words)?;
    let mut swapped = Vec::new();
    for row in plane.chunks(info.extent.x as usize * info.voxel_type.bytes()) {
        if is_wide {
            // PNG's numbers begin with the highest byte.
            swapped.clear();
            swapped.extend(row.as_chunks::<2>().0.iter().flat_map(|[low, high]| [*high, *low]));
            rows.write_all(&swapped)?;
        } else {
            rows.write_all(row)?;
        }
    }
    rows.finish().map_err(without_words)?;
    writer.finish().map_err(without_words)?;
    out.flush()?;
    drop(out);
    file.sync_all()
}

/// The system's own error, if it is one.
fn without_words(error: EncodingError) -> io::Error {
    match error {
        EncodingError::IoError(error) => error,
        other => io::Error::other(other),
    }
}
