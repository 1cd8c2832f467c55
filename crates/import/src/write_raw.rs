//! Raw file writer: all threads make pieces, and write each at its offset as soon as it is done. The file takes its
//! name only when complete.

use crate::error::ImportError;
use crate::files::folder_of;
use crate::source::{Access, Source};
use crate::temporary::named_in;
use brickyard_volume::{Extent, VoxelBox};
use std::fs::File;
use std::io::{Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Bytes made at a time by one thread.
const PIECE_BYTES: u64 = 8 << 20;

/// Writes all voxels of a source to a headerless file: little-endian, x fastest, then y, z, channel, time. `progress`
/// is called with the bytes written so far and in all, from any thread but never from two at once.
///
/// # Errors
/// If the file exists and `overwrite` is false, the source fails, or the file cannot be written. Existing content at
/// `path` is then unchanged.
pub fn write_raw(
    source: &dyn Source,
    path: &Path,
    overwrite: bool,
    progress: &mut (dyn FnMut(u64, u64) + Send),
) -> Result<(), ImportError> {
    if !overwrite && path.exists() {
        return Err(ImportError::options(path, "exists already; choose another name, or remove it"));
    }
    let folder = folder_of(path);
    let partial = named_in(folder, ".", ".partial").map_err(ImportError::io(folder))?;
    let pieces = Pieces::new(source);
    partial.as_file().set_len(pieces.total_bytes()).map_err(ImportError::io(path))?;
    let sink = Mutex::new(Sink { file: partial.as_file(), written: 0, progress });
    let (next, failed) = (AtomicU64::new(0), AtomicBool::new(false));
    let work = || {
        let mut buffer = Vec::new();
        while !failed.load(Ordering::Relaxed) {
            let Some(piece) = pieces.get(next.fetch_add(1, Ordering::Relaxed)) else { break };
            buffer.resize(piece.bytes as usize, 0);
            let made = source.read_box(piece.time, piece.channel, piece.region, &mut buffer).and_then(|()| {
                let mut sink = sink.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
                sink.write(piece.offset, &buffer, pieces.total_bytes()).map_err(ImportError::io(path))
            });
            if made.is_err() {
                failed.store(true, Ordering::Relaxed);
                return made;
            }
        }
        Ok(())
    };
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        workers.into_iter().try_for_each(|worker| match worker.join() {
            Ok(result) => result,
            Err(panic) => std::panic::resume_unwind(panic),
        })
    })?;
    partial.as_file().sync_all().map_err(ImportError::io(path))?;
    let persisted = if overwrite { partial.persist(path) } else { partial.persist_noclobber(path) };
    persisted.map_err(|e| ImportError::io(path)(e.error))?;
    Ok(())
}

struct Sink<'a> {
    file: &'a File,
    written: u64,
    progress: &'a mut (dyn FnMut(u64, u64) + Send),
}

impl Sink<'_> {
    fn write(&mut self, offset: u64, bytes: &[u8], total: u64) -> std::io::Result<()> {
        self.file.seek(SeekFrom::Start(offset))?;
        self.file.write_all(bytes)?;
        self.written += bytes.len() as u64;
        (self.progress)(self.written, total);
        Ok(())
    }
}

/// The volume cut into runs of rows or planes that are contiguous in the file.
struct Pieces {
    extent: Extent,
    voxel_bytes: u64,
    channels: u64,
    volumes: u64,
    /// Rows (within one plane) and planes of a piece.
    rows: u32,
    planes: u32,
}

struct Piece {
    time: u32,
    channel: u32,
    region: VoxelBox,
    offset: u64,
    bytes: u64,
}

impl Pieces {
    fn new(source: &dyn Source) -> Self {
        let info = source.info();
        let (extent, voxel_bytes) = (info.extent, info.voxel_type.bytes() as u64);
        let row_bytes = extent.x as u64 * voxel_bytes;
        let plane_bytes = row_bytes * extent.y as u64;
        let planes = (PIECE_BYTES / plane_bytes).clamp(1, extent.z as u64) as u32;
        let whole_planes = planes > 1 || source.access() == Access::Planes;
        let rows = if whole_planes { extent.y } else { (PIECE_BYTES / row_bytes).clamp(1, extent.y as u64) as u32 };
        let volumes = info.channels as u64 * info.times as u64;
        Self { extent, voxel_bytes, channels: info.channels as u64, volumes, rows, planes }
    }

    fn total_bytes(&self) -> u64 {
        self.extent.volume() * self.volumes * self.voxel_bytes
    }

    fn get(&self, index: u64) -> Option<Piece> {
        let (down, deep) = (self.extent.y.div_ceil(self.rows) as u64, self.extent.z.div_ceil(self.planes) as u64);
        let volume = index / (down * deep);
        if volume >= self.volumes {
            return None;
        }
        let y = (index % down) as u32 * self.rows;
        let z = (index / down % deep) as u32 * self.planes;
        let end = [self.extent.x, (y + self.rows).min(self.extent.y), (z + self.planes).min(self.extent.z)];
        let region = VoxelBox::new([0, y, z], end);
        Some(Piece {
            time: (volume / self.channels) as u32,
            channel: (volume % self.channels) as u32,
            region,
            offset: (volume * self.extent.volume() + self.extent.linear([0, y, z])) * self.voxel_bytes,
            bytes: region.extent().volume() * self.voxel_bytes,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::SourceInfo;
    use crate::synth::{SynthKind, SynthSource};
    use brickyard_volume::VoxelType;

    fn assert_written(kind: SynthKind, extent: Extent, voxel_type: VoxelType, steps: u32) {
        let source = SynthSource::new(kind, extent, voxel_type, steps, 5).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.raw");
        let mut seen = (0, 0);
        write_raw(&source, &path, false, &mut |done, total| {
            assert!(done > seen.0);
            seen = (done, total);
        })
        .unwrap();
        let written = std::fs::read(&path).unwrap();
        let step = extent.volume() as usize * voxel_type.bytes();
        assert_eq!(seen, (written.len() as u64, step as u64 * steps as u64));
        for (time, bytes) in (0..).zip(written.chunks(step)) {
            let mut expected = vec![0; step];
            source.read_box(time, 0, extent.full_box(), &mut expected).unwrap();
            assert!(bytes == expected, "time step {time}");
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left beside the file");
        let again = write_raw(&source, &path, false, &mut |_, _| ());
        assert!(again.unwrap_err().to_string().contains("exists already"));
    }

    #[test]
    fn files_hold_what_the_source_gives() {
        // Pieces of several planes; of rows within a plane; of several steps.
        assert_written(SynthKind::Ramp, Extent::new(301, 299, 201), VoxelType::U8, 1);
        assert_written(SynthKind::Ramp, Extent::new(4096, 2500, 2), VoxelType::U8, 1);
        assert_written(SynthKind::Flow, Extent::new(31, 17, 20), VoxelType::U16, 3);
    }

    /// A source that fails past the first rows.
    struct Failing(SourceInfo);

    impl Source for Failing {
        fn info(&self) -> &SourceInfo {
            &self.0
        }
        fn read_box(&self, _: u32, _: u32, region: VoxelBox, _: &mut [u8]) -> Result<(), ImportError> {
            if region.min.z > 0 { Err(ImportError::invalid(Path::new("there"), "damaged")) } else { Ok(()) }
        }
    }

    #[test]
    fn a_failure_leaves_nothing() {
        let extent = Extent::new(512, 512, 100);
        let info = SynthSource::new(SynthKind::Ramp, extent, VoxelType::U8, 1, 0).unwrap().info().clone();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.raw");
        for before in [None, Some("precious")] {
            before.inspect(|text| std::fs::write(&path, text).unwrap());
            let error = write_raw(&Failing(info.clone()), &path, before.is_some(), &mut |_, _| ()).unwrap_err();
            assert!(error.to_string().contains("damaged"));
            assert_eq!(std::fs::read_to_string(&path).ok().as_deref(), before);
            assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), before.iter().count());
        }
    }
}
