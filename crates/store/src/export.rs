//! Export: one level, or a box of it, of one channel and one or more time steps, as one file.
//!
//! `.raw` holds only voxels, little-endian, x fastest; `.npy` is NumPy's format, shape (z, y, x), or (t, z, y, x) for a
//! range of steps. Bars of bricks along x are decoded on all threads and written in place, so each thread holds one
//! bar: a whole row of bricks, or as many as its share of the memory allows. The file has a temporary name in the same
//! folder until complete.

use crate::error::ExportError;
use crate::inside::check_outside;
use crate::pack::pool;
use crate::store::Store;
use brickyard_import::temporary::named_in;
use brickyard_volume::{Extent, Level, VoxelBox, VoxelType};
use rayon::prelude::*;
use std::fs::File;
use std::io::Write;
use std::ops::ControlFlow;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

/// The time steps to export.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExportTime {
    /// One step, as an array without a time axis.
    Step(u32),
    /// Consecutive steps, as an array with time as the slowest axis.
    Steps {
        /// The first step.
        first: u32,
        /// The end of the range, excluded.
        end: u32,
        /// Distance between exported steps; at least 1.
        stride: u32,
    },
}

impl Default for ExportTime {
    fn default() -> Self {
        Self::Step(0)
    }
}

impl ExportTime {
    fn steps(self) -> impl ExactSizeIterator<Item = u32> + DoubleEndedIterator {
        let (first, end, stride) = match self {
            Self::Step(step) => (step, step.saturating_add(1), 1),
            Self::Steps { first, end, stride } => (first, end, stride),
        };
        let stride = stride.max(1);
        (0..end.saturating_sub(first).div_ceil(stride)).map(move |i| first + i * stride)
    }
}

/// Part of a store to export, and policy for an existing file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ExportRequest {
    /// The level to export.
    pub level: Level,
    /// The time steps to export.
    pub time: ExportTime,
    /// The channel to export.
    pub channel: u32,
    /// The box to export, in the level's voxels; `None` exports the whole level.
    pub region: Option<VoxelBox>,
    /// Whether an existing file may be replaced.
    pub overwrite: bool,
    /// Most anonymous memory for the export, in bytes, including the open store's.
    pub memory_bytes: u64,
}

/// Level 0 of the first step and channel, whole, within 1 GiB.
impl Default for ExportRequest {
    fn default() -> Self {
        let (level, time, region) = Default::default();
        Self { level, time, channel: 0, region, overwrite: false, memory_bytes: 1 << 30 }
    }
}

/// Exports voxels to `output`, whose extension (`.raw` or `.npy`) selects the format. Calls `progress` with the bytes
/// written so far and in total after each bar of bricks; it may cancel. Returns the extent of each step.
///
/// # Errors
/// If the output exists and may not be replaced, its extension is unknown, the request is outside the store, a brick
/// cannot be read, the memory is too little for one thread, the file cannot be written, or `progress` cancels. Then
/// nothing new is left behind.
pub fn export(
    store: &Store,
    output: &Path,
    request: &ExportRequest,
    progress: impl Fn(u64, u64) -> ControlFlow<()> + Sync,
) -> Result<Extent, ExportError> {
    let region = checked_region(store, request)?;
    let extent = region.extent();
    let extension = output.extension().map(|extension| extension.to_ascii_lowercase());
    let header = match extension.as_ref().and_then(|extension| extension.to_str()) {
        Some("raw") => Vec::new(),
        Some("npy") => npy_header(store.voxel_type(), extent, request.time),
        _ => return Err(ExportError::Extension { path: output.into() }),
    };
    check_outside(output)?;
    if !request.overwrite && output.symlink_metadata().is_ok() {
        return Err(ExportError::Exists { path: output.into() });
    }
    let io = |error| ExportError::Io { path: output.into(), error };
    let folder = output.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if std::fs::metadata(output).is_ok_and(|found| !found.is_file()) {
        return Err(io(std::io::Error::other("is not a regular file, and is never replaced")));
    }
    let mut file = named_in(folder, ".brickyard-export", "").map_err(io)?;
    file.write_all(&header).map_err(io)?;
    write_voxels(store, request, region, file.as_file(), header.len() as u64, output, &progress)?;
    file.as_file().sync_all().map_err(io)?;
    let persisted = if request.overwrite { file.persist(output) } else { file.persist_noclobber(output) };
    persisted.map_err(|e| match e.error.kind() {
        std::io::ErrorKind::AlreadyExists => ExportError::Exists { path: output.into() },
        _ => io(e.error),
    })?;
    Ok(extent)
}

fn checked_region(store: &Store, request: &ExportRequest) -> Result<VoxelBox, ExportError> {
    let below = |what, found: u32, count: u32| match found < count {
        true => Ok(()),
        false => Err(ExportError::Outside { what, found: found.to_string(), expected: format!("0 to {}", count - 1) }),
    };
    below("level", request.level.0.into(), store.pyramid().levels().len() as u32)?;
    let last = request.time.steps().next_back().ok_or_else(|| {
        let found = format!("{:?}", request.time);
        ExportError::Outside { what: "time steps", found, expected: "at least one".into() }
    })?;
    below("time step", last, store.times())?;
    below("channel", request.channel, store.channels())?;
    let whole = store.pyramid().level(request.level).extent.full_box();
    let region = request.region.unwrap_or(whole);
    if region.is_empty() || region.intersect(whole) != region {
        let show = |b: VoxelBox| {
            let (min, max) = (b.min, b.max);
            format!("{}:{},{}:{},{}:{}", min.x, max.x, min.y, max.y, min.z, max.z)
        };
        let expected = format!("a box inside {} of level {}", show(whole), request.level);
        return Err(ExportError::Outside { what: "box", found: show(region), expected });
    }
    Ok(region)
}

/// Writes the voxels of `region` from byte `start` of the file.
fn write_voxels(
    store: &Store,
    request: &ExportRequest,
    region: VoxelBox,
    file: &File,
    start: u64,
    output: &Path,
    progress: &(impl Fn(u64, u64) -> ControlFlow<()> + Sync),
) -> Result<(), ExportError> {
    let edge = store.pyramid().edge();
    let voxel_bytes = store.voxel_type().bytes() as u64;
    let extent = region.extent();
    let step_bytes = extent.volume() * voxel_bytes;
    let total = step_bytes.saturating_mul(request.time.steps().len() as u64);
    let done = AtomicU64::new(0);
    let (width, threads) = bar_width(store, region, request.memory_bytes)?;
    let bars = move || {
        let planes = cuts(region.min.z, region.max.z, edge);
        let rows = planes.flat_map(move |z| cuts(region.min.y, region.max.y, edge).map(move |y| (y, z)));
        rows.flat_map(move |(y, z)| cuts(region.min.x, region.max.x, width).map(move |x| bar([x, y, z])))
    };
    let parts = (0..).zip(request.time.steps()).flat_map(|step| bars().map(move |bar| (step, bar)));
    let write = |buffer: &mut Vec<u8>, ((i, time), bar): ((u64, u32), VoxelBox)| {
        buffer.resize((bar.extent().volume() * voxel_bytes) as usize, 0);
        store.read_box(time, request.channel, request.level, bar, buffer)?;
        // Rows of one slice of the bar are adjacent in the file only if they are whole.
        let rows = if bar.extent().x == extent.x { bar.extent().y } else { 1 };
        let piece_bytes = bar.extent().x as usize * rows as usize * voxel_bytes as usize;
        let pieces =
            (bar.min.z..bar.max.z).flat_map(|z| (bar.min.y..bar.max.y).step_by(rows as usize).map(move |y| [y, z]));
        for ([y, z], piece) in pieces.zip(buffer.chunks_exact(piece_bytes)) {
            let at = extent.linear([bar.min.x - region.min.x, y - region.min.y, z - region.min.z]) * voxel_bytes;
            file.write_all_at(piece, start + i * step_bytes + at)
                .map_err(|error| ExportError::Io { path: output.into(), error })?;
        }
        let bytes = buffer.len() as u64;
        match progress(done.fetch_add(bytes, Ordering::Relaxed) + bytes, total) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(ExportError::Cancelled { path: output.into() }),
        }
    };
    let pool = pool(threads).map_err(ExportError::Threads)?;
    pool.install(|| parts.par_bridge().try_for_each_init(Vec::new, write))
}

/// The program, its stacks and its allocator.
const PROGRAM_BYTES: u64 = 16 << 20;

/// The widest bars along x, of whole bricks, then the most threads, within the memory.
fn bar_width(store: &Store, region: VoxelBox, memory_bytes: u64) -> Result<(u32, usize), ExportError> {
    let edge = store.pyramid().edge();
    let core = store.core_bytes() as u64;
    // An encoded, shuffled and decoded brick, and a bar of one.
    let least = 4 * core;
    let fixed = PROGRAM_BYTES + store.cache_bytes();
    let room = memory_bytes.saturating_sub(fixed);
    if room < least {
        let needed_bytes = fixed + least;
        return Err(ExportError::Memory { needed_bytes, given_bytes: memory_bytes });
    }
    let threads = (rayon::current_num_threads() as u64).min(room / least).max(1);
    let bricks = (room / threads - 3 * core) / core;
    let whole = region.extent().x.div_ceil(edge) as u64 + 1;
    Ok((bricks.min(whole) as u32 * edge, threads as usize))
}

/// The box with these ranges along x, y and z.
fn bar([x, y, z]: [(u32, u32); 3]) -> VoxelBox {
    VoxelBox::new([x.0, y.0, z.0], [x.1, y.1, z.1])
}

/// `[from, to)` cut at multiples of `edge`.
fn cuts(from: u32, to: u32, edge: u32) -> impl Iterator<Item = (u32, u32)> {
    (from / edge..to.div_ceil(edge)).map(move |i| (from.max(i * edge), to.min((i + 1).saturating_mul(edge))))
}

/// A version 1.0 `.npy` header: a Python dictionary, padded so the data start at a multiple of 64.
fn npy_header(voxel_type: VoxelType, extent: Extent, time: ExportTime) -> Vec<u8> {
    // Byte order, then the initial of "uint", "int" or "float", then bytes: such as "|u1" and "<f4".
    let order = if voxel_type.bytes() == 1 { '|' } else { '<' };
    let descr = format!("{order}{:.1}{}", voxel_type.zarr_name(), voxel_type.bytes());
    let Extent { x, y, z } = extent;
    let steps = match time {
        ExportTime::Step(_) => String::new(),
        ExportTime::Steps { .. } => format!("{}, ", time.steps().len()),
    };
    let dictionary = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({steps}{z}, {y}, {x}), }}");
    const MAGIC: &[u8] = b"\x93NUMPY\x01\x00";
    let bytes = (MAGIC.len() + 2 + dictionary.len() + 1).next_multiple_of(64);
    let padded = format!("{dictionary:width$}\n", width = bytes - MAGIC.len() - 3);
    [MAGIC, &(padded.len() as u16).to_le_bytes(), padded.as_bytes()].concat()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::Codec;
    use crate::test_store::{TestStore, bumps, voxels};
    use std::sync::atomic::AtomicBool;

    fn store(spec: &TestStore) -> (tempfile::TempDir, Store) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("s.zarr");
        std::fs::create_dir(&path).unwrap();
        spec.write(&path, bumps);
        let store = Store::open(&path).unwrap();
        (dir, store)
    }

    fn go_on(_: u64, _: u64) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    #[test]
    fn a_cancelled_export_leaves_what_was_there() {
        let (_dir, store) = store(&TestStore::default());
        let out = tempfile::tempdir().unwrap();
        let output = out.path().join("a.raw");
        for old in [None, Some("mine")] {
            if let Some(old) = old {
                std::fs::write(&output, old).unwrap();
            }
            let request = ExportRequest { overwrite: true, ..ExportRequest::default() };
            // At the first row, and when only the name is missing.
            for is_last in [false, true] {
                let watch = |done, total| match is_last && done < total {
                    true => ControlFlow::Continue(()),
                    false => ControlFlow::Break(()),
                };
                let error = export(&store, &output, &request, watch).unwrap_err();
                assert!(matches!(error, ExportError::Cancelled { .. }), "{error}");
                assert_eq!(std::fs::read_to_string(&output).ok().as_deref(), old);
                assert_eq!(std::fs::read_dir(out.path()).unwrap().count(), usize::from(old.is_some()));
            }
        }
    }

    #[test]
    fn a_store_that_is_replaced_meanwhile_is_not_exported() {
        let spec = TestStore { extent: [8 * 40, 8, 8 * 8], shard: 8, ..TestStore::default() };
        let (_dir, store) = store(&spec);
        let out = tempfile::tempdir().unwrap();
        let is_first = AtomicBool::new(true);
        let replace = |_, _| {
            if is_first.swap(false, Ordering::Relaxed) {
                std::fs::remove_dir_all(store.path()).unwrap();
                std::fs::create_dir(store.path()).unwrap();
                spec.write(store.path(), |t, c, v| bumps(t, c, v) + 100.0);
            }
            ControlFlow::Continue(())
        };
        // The rest is then read after the first bar.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let output = out.path().join("a.raw");
        let error = pool.install(|| export(&store, &output, &ExportRequest::default(), replace)).unwrap_err();
        assert!(matches!(error, ExportError::Read(crate::error::ReadError::Replaced { .. })), "{error}");
        assert_eq!(std::fs::read_dir(out.path()).unwrap().count(), 0);
    }

    /// Bars of partial rows give the same file; too little memory is refused with the actual minimum.
    #[test]
    fn the_file_is_the_same_within_any_memory() {
        let spec = TestStore { extent: [300, 20, 19], times: 2, ..TestStore::default() };
        let (dir, store) = store(&spec);
        let output = dir.path().join("out.raw");
        let region = Some(VoxelBox::new([3, 1, 2], [299, 20, 18]));
        let request = ExportRequest {
            region,
            overwrite: true,
            time: ExportTime::Steps { first: 0, end: 2, stride: 1 },
            ..ExportRequest::default()
        };
        export(&store, &output, &request, go_on).unwrap();
        let expected = std::fs::read(&output).unwrap();
        let least = match export(&store, &output, &ExportRequest { memory_bytes: 1, ..request }, go_on) {
            Err(ExportError::Memory { needed_bytes, .. }) => needed_bytes,
            other => panic!("{other:?}"),
        };
        for more in [0, 2, 5, 30].map(|cores| cores * store.core_bytes() as u64) {
            export(&store, &output, &ExportRequest { memory_bytes: least + more, ..request }, go_on).unwrap();
            assert!(std::fs::read(&output).unwrap() == expected, "{more} bytes more");
        }
        let short = ExportRequest { memory_bytes: least - 1, ..request };
        assert!(matches!(export(&store, &output, &short, go_on), Err(ExportError::Memory { .. })));
    }

    #[test]
    fn an_export_has_the_permissions_of_any_new_file() {
        use std::os::unix::fs::PermissionsExt;
        let (dir, store) = store(&TestStore::default());
        let [output, plain] = ["a.raw", "plain"].map(|name| dir.path().join(name));
        export(&store, &output, &ExportRequest::default(), go_on).unwrap();
        std::fs::write(&plain, "").unwrap();
        let mode = |path: &Path| path.metadata().unwrap().permissions().mode();
        assert_eq!(mode(&output), mode(&plain));
    }

    #[test]
    fn raw_is_the_voxels_alone() {
        let spec = TestStore { times: 2, channels: 2, ..TestStore::default() };
        let (dir, store) = store(&spec);
        let output = dir.path().join("out.raw");
        let whole = AtomicBool::new(false);
        for level in 0..store.pyramid().levels().len() {
            let request = ExportRequest {
                level: Level(level as u8),
                time: ExportTime::Step(1),
                channel: 1,
                overwrite: true,
                region: None,
                ..ExportRequest::default()
            };
            let watch = |done, total| {
                whole.store(done == total, Ordering::Relaxed);
                ControlFlow::Continue(())
            };
            export(&store, &output, &request, watch).unwrap();
            let expected = spec.levels(|v| bumps(1, 1, v)).swap_remove(level);
            let expected: Vec<u8> = expected.into_iter().flat_map(|v| spec.bytes_of(v)).collect();
            assert!(std::fs::read(&output).unwrap() == expected, "level {level}");
        }
        assert!(whole.into_inner());
    }

    #[test]
    fn npy_of_a_box_reads_back() {
        for voxel_type in VoxelType::ALL {
            let spec = TestStore { voxel_type, codec: Codec::default_for(voxel_type), ..TestStore::default() };
            let (dir, store) = store(&spec);
            let output = dir.path().join("out.npy");
            let region = VoxelBox::new([3, 8, 2], [36, 17, 19]);
            export(&store, &output, &ExportRequest { region: Some(region), ..Default::default() }, go_on).unwrap();
            let bytes = std::fs::read(&output).unwrap();
            let header = u16::from_le_bytes([bytes[8], bytes[9]]) as usize + 10;
            assert_eq!((header % 64, bytes[header - 1]), (0, b'\n'));
            let text = std::str::from_utf8(&bytes[10..header]).unwrap();
            assert!(text.contains("'shape': (17, 9, 33)"), "{text}");
            let expected: Vec<u8> = voxels(region).flat_map(|v| spec.bytes_of(bumps(0, 0, v))).collect();
            assert!(bytes[header..] == expected, "{voxel_type}");
        }
    }

    #[test]
    fn steps_follow_one_another() {
        let spec = TestStore { times: 6, ..TestStore::default() };
        let (dir, store) = store(&spec);
        let region = VoxelBox::new([3, 8, 2], [36, 17, 19]);
        for (first, end, stride, steps) in [(1, 6, 2, &[1, 3, 5][..]), (0, 6, 4, &[0, 4]), (2, 3, 1, &[2])] {
            let time = ExportTime::Steps { first, end, stride };
            let request = ExportRequest { time, region: Some(region), overwrite: true, ..ExportRequest::default() };
            let of_step = |&step: &u32| voxels(region).map(move |v| bumps(step, 0, v));
            let expected: Vec<u8> = steps.iter().flat_map(of_step).flat_map(|value| spec.bytes_of(value)).collect();
            let [raw, npy] = ["out.raw", "out.npy"].map(|name| {
                let whole = AtomicBool::new(false);
                let watch = |done, total| {
                    whole.fetch_or(done == total && total == expected.len() as u64, Ordering::Relaxed);
                    ControlFlow::Continue(())
                };
                export(&store, &dir.path().join(name), &request, watch).unwrap();
                assert!(whole.into_inner());
                std::fs::read(dir.path().join(name)).unwrap()
            });
            assert!(raw == expected, "{steps:?}");
            let header = u16::from_le_bytes([npy[8], npy[9]]) as usize + 10;
            assert!(npy[header..] == expected, "{steps:?}");
            let text = std::str::from_utf8(&npy[10..header]).unwrap();
            assert!(text.contains(&format!("'shape': ({}, 17, 9, 33)", steps.len())), "{text}");
        }
        for (first, end, stride, word) in
            [(0, 7, 1, "time step 6"), (0, 8, 3, "time step 6"), (3, 3, 1, "at least one")]
        {
            let request = ExportRequest { time: ExportTime::Steps { first, end, stride }, ..ExportRequest::default() };
            let message = export(&store, &dir.path().join("no.raw"), &request, go_on).unwrap_err().to_string();
            assert!(message.contains(word), "{message}");
        }
    }

    #[test]
    fn refusals_leave_nothing_behind() {
        let (_dir, store) = store(&TestStore::default());
        let out = tempfile::tempdir().unwrap();
        let attempt = |name: &str, request: ExportRequest| {
            export(&store, &out.path().join(name), &request, go_on).unwrap_err().to_string()
        };
        let request = ExportRequest::default();
        assert!(attempt("a.tif", request).contains(".raw or .npy"));
        assert!(attempt("a.raw", ExportRequest { level: Level(9), ..request }).contains("expected 0 to 3"));
        assert!(attempt("a.raw", ExportRequest { time: ExportTime::Step(1), ..request }).contains("time step 1"));
        assert!(attempt("a.raw", ExportRequest { channel: 1, ..request }).contains("channel 1"));
        let region = Some(VoxelBox::new([0, 0, 0], [38, 1, 1]));
        assert!(attempt("a.raw", ExportRequest { region, ..request }).contains("inside 0:37,0:20,0:19"));
        assert!(attempt("no/a.raw", request).contains("No such file"));
        std::fs::remove_file(store.path().join("0/c/1/1/1")).unwrap();
        assert!(attempt("a.raw", request).contains("missing shard"));
        assert_eq!(std::fs::read_dir(out.path()).unwrap().count(), 0);
        std::fs::write(out.path().join("a.raw"), "mine").unwrap();
        assert!(attempt("a.raw", request).contains("`overwrite`"));
        assert_eq!(std::fs::read(out.path().join("a.raw")).unwrap(), b"mine");
    }
}
