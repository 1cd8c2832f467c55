//! Shared parts of the readers' tests: a field whose neighbouring voxels all differ, written in any axis and byte
//! order, and the check that a source delivers it whole and in random boxes.

use crate::note::Note;
use crate::open::open;
use crate::options::OpenOptions;
use crate::source::Source;
use brickyard_volume::{Extent, VoxelBox, VoxelType, with_voxel_type};
use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};
use std::path::{Path, PathBuf};

/// A test array: sizes along x, y, z, c, t.
#[derive(Clone, Copy)]
pub(crate) struct Field {
    pub(crate) sizes: [u32; 5],
    pub(crate) voxel_type: VoxelType,
}

impl Field {
    /// A hash of the position: neighbours, axes and bytes all differ.
    fn value(self, [x, y, z, c, t]: [u32; 5]) -> u64 {
        let mut key = x as u64;
        for i in [y, z, c, t] {
            key = key.wrapping_mul(1009).wrapping_add(i as u64 + 1);
        }
        key.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32
    }

    fn put(self, position: [u32; 5], big: bool, out: &mut Vec<u8>) {
        let value = self.value(position);
        with_voxel_type!(self.voxel_type, T => {
            let value = value as T;
            out.extend(if big { value.to_be_bytes() } else { value.to_le_bytes() });
        });
    }

    /// Returns the array's bytes with its axes in the given order, slowest first, in either byte order.
    pub(crate) fn bytes(self, axes: &str, big: bool) -> Vec<u8> {
        let order: Vec<usize> = axes.chars().map(|a| "xyzct".find(a).unwrap()).collect();
        let mut out = Vec::new();
        let total: u32 = order.iter().map(|&a| self.sizes[a]).product();
        for index in 0..total {
            let (mut position, mut rest) = ([0; 5], index);
            for &a in order.iter().rev() {
                position[a] = rest % self.sizes[a];
                rest /= self.sizes[a];
            }
            self.put(position, big, &mut out);
        }
        out
    }

    fn box_bytes(self, time: u32, channel: u32, region: VoxelBox) -> Vec<u8> {
        let mut out = Vec::new();
        for z in region.min.z..region.max.z {
            for y in region.min.y..region.max.y {
                for x in region.min.x..region.max.x {
                    self.put([x, y, z, channel, time], false, &mut out);
                }
            }
        }
        out
    }
}

/// Checks that a source delivers a field: its description, every whole volume, and random boxes.
pub(crate) fn assert_boxes(source: &dyn Source, field: Field) {
    let [x, y, z, c, t] = field.sizes;
    let info = source.info();
    assert_eq!(([x, y, z], c, t), (info.extent.to_array(), info.channels, info.times));
    assert_eq!(info.voxel_type, field.voxel_type);
    let read = |time, channel, region: VoxelBox| {
        let mut out = vec![0xa5; region.extent().volume() as usize * info.voxel_type.bytes()];
        source.read_box(time, channel, region, &mut out).unwrap();
        out
    };
    for (time, channel) in (0..t).flat_map(|t| (0..c).map(move |c| (t, c))) {
        let full = info.extent.full_box();
        assert!(read(time, channel, full) == field.box_bytes(time, channel, full), "t{time} c{channel}");
    }
    let axis = |n: u32| (0..n).prop_flat_map(move |lo| (Just(lo), lo + 1..=n));
    let mut runner = TestRunner::new(Config { failure_persistence: None, cases: 40, ..Config::default() });
    runner
        .run(&(axis(x), axis(y), axis(z), 0..c, 0..t), |(x, y, z, channel, time)| {
            let region = VoxelBox::new([x.0, y.0, z.0], [x.1, y.1, z.1]);
            let expected = field.box_bytes(time, channel, region);
            prop_assert!(read(time, channel, region) == expected);
            let mut lent_slices = 0;
            let lend = source.lend(time, channel, region, &mut |lent| {
                let (extent, row_bytes) = (region.extent(), (x.1 - x.0) as usize * info.voxel_type.bytes());
                assert_eq!(lent.slices.start, lent_slices);
                lent_slices = lent.slices.end;
                let rows = expected.chunks_exact(row_bytes).enumerate();
                for (i, row) in rows.filter(|(i, _)| lent.slices.contains(&(i / extent.y as usize))) {
                    let [y, z] = [i % extent.y as usize, i / extent.y as usize - lent.slices.start];
                    let start = z * lent.slice_bytes + y * lent.row_bytes;
                    assert!(&lent.bytes[start..start + row_bytes] == row, "lent");
                }
            });
            prop_assert_eq!(lent_slices, if lend.unwrap() { region.extent().z as usize } else { 0 });
            source.announce(time, channel, region);
            Ok(())
        })
        .unwrap();
}

/// Writes a file in a temporary folder of its own, removed when the returned guard is dropped.
pub(crate) fn temp_file(name: &str, bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

/// Settings of a test with so many cases, or with those of `PROPTEST_CASES`.
pub(crate) fn cases(usual: u32) -> Config {
    let told = Config::default().cases;
    let cases = if std::env::var_os("PROPTEST_CASES").is_some() { told } else { usual };
    Config { cases, failure_persistence: None, ..Config::default() }
}

/// Changed bytes of a damaged file: their places and new values.
pub(crate) type Damage = Vec<(prop::sample::Index, u8)>;

/// One to five changed bytes.
pub(crate) fn some_damage() -> impl Strategy<Value = Damage> {
    prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6)
}

/// Changes these bytes.
pub(crate) fn spoil(bytes: &mut [u8], damage: &Damage) {
    for (place, value) in damage {
        bytes[place.index(bytes.len())] = *value;
    }
}

/// Reads the last step and channel of a damaged input, if it can still be opened and is small. Errors are expected, panics are not.
pub(crate) fn try_to_read(inputs: &[PathBuf]) {
    let Ok(source) = open(inputs, &OpenOptions { allow_lossy: true, ..OpenOptions::default() }) else { return };
    let info = source.info();
    let full = info.extent.full_box();
    if full.extent().volume() < 1 << 20 {
        let mut out = vec![0; full.extent().volume() as usize * info.voxel_type.bytes()];
        let _ = source.read_box(info.times - 1, info.channels - 1, full, &mut out);
    }
}

/// Reruns the test of this name in a process of its own, to measure its memory, on a file made by `write`. Returns
/// the file in the new process, and `None` in the parent.
pub(crate) fn alone_with(name: &str, write: impl FnOnce(&Path)) -> Option<PathBuf> {
    const ALONE: &str = "BRICKYARD_TEST_ALONE";
    if let Some(path) = std::env::var_os(ALONE) {
        return Some(path.into());
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("alone");
    write(&path);
    let test = std::env::current_exe().unwrap();
    let child =
        std::process::Command::new(test).args(["--exact", name, "--nocapture"]).env(ALONE, path).output().unwrap();
    let said = String::from_utf8_lossy(&child.stdout) + String::from_utf8_lossy(&child.stderr);
    assert!(child.status.success() && said.contains("1 passed"), "{said}");
    None
}

/// A figure of the kernel's on this process's resident memory, in bytes.
fn resident_bytes(field: &str) -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let kilobytes = status.lines().find_map(|line| line.strip_prefix(field)).unwrap();
    kilobytes.trim().trim_end_matches("kB").trim().parse::<u64>().unwrap() << 10
}

/// Most memory in bytes a reader takes in a process of its own, and its result. Pages of the program's own code, loaded
/// meanwhile, are not the reader's: some 5 MB of an unoptimized build.
pub(crate) fn memory_taken<T>(read: impl FnOnce() -> T) -> (u64, T) {
    let [peak, files] = ["VmHWM:", "RssFile:"].map(resident_bytes);
    let result = read();
    let code_bytes = resident_bytes("RssFile:").saturating_sub(files);
    (resident_bytes("VmHWM:").saturating_sub(peak + code_bytes), result)
}

/// Checks that opening and reading a source of one plane take about [`Source::reader_bytes`] of memory, beside the
/// plane itself.
pub(crate) fn assert_takes_what_it_says(open: impl FnOnce() -> Box<dyn Source>, plane_bytes: usize) {
    // The allocator's own, and small buffers; a copy of the plane would be 8 MiB.
    const SLACK_BYTES: u64 = 3 << 20;
    let mut plane = vec![1; plane_bytes];
    let (taken, source) = memory_taken(|| {
        let source = open();
        let info = source.info();
        // Without a column, since whole planes may be decoded in place.
        let Extent { x, y, z } = info.extent;
        let region = VoxelBox::new([0; 3], [x - 1, y, z]);
        let bytes = region.extent().volume() as usize * info.voxel_type.bytes();
        source.read_box(0, 0, region, &mut plane[..bytes]).unwrap();
        source
    });
    let said = source.reader_bytes();
    assert!(taken <= said + SLACK_BYTES && said <= taken + SLACK_BYTES, "took {taken}, said {said}");
    assert!(said >= plane_bytes as u64, "a plane is decoded at once");
}

/// Joins a source's remarks in one text, each behind its kind.
pub(crate) fn said(notes: &[Note]) -> String {
    let kind = |is_warning| if is_warning { "warning" } else { "note" };
    notes.iter().map(|note| format!("{}: {} ", kind(note.is_warning()), &**note)).collect()
}

/// Whether these words of a [`said`] text belong to a warning.
pub(crate) fn is_warned(said: &str, words: &str) -> bool {
    let Some((before, _)) = said.split_once(words) else { return false };
    before.rfind("warning: ") > before.rfind("note: ")
}

/// A source, and the temporary folder of its file.
pub(crate) struct Opened {
    source: Box<dyn Source>,
    _folder: tempfile::TempDir,
}

impl std::ops::Deref for Opened {
    type Target = dyn Source;

    fn deref(&self) -> &Self::Target {
        &*self.source
    }
}

/// Opens a file written by [`temp_file`], or gives the error's message.
pub(crate) fn open_in((folder, path): (tempfile::TempDir, PathBuf), options: &OpenOptions) -> Result<Opened, String> {
    let source = open(&[path], options).map_err(|error| error.to_string())?;
    Ok(Opened { source, _folder: folder })
}
