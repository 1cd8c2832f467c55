//! Streams of known bytes.

use super::*;
use crate::source::Source;
use crate::testing::{Field, assert_boxes, temp_file};
use brickyard_volume::{Extent, VoxelType};
use proptest::prelude::*;

/// A stream that hands out a few bytes at a time, with interruptions.
struct Slow<'a>(&'a [u8], bool);

impl Read for Slow<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        self.1 = !self.1;
        if self.1 {
            return Err(ErrorKind::Interrupted.into());
        }
        let n = buffer.len().min(7);
        self.0.read(&mut buffer[..n])
    }
}

const FIELD: Field = Field { sizes: [5, 4, 3, 1, 2], voxel_type: VoxelType::U16 };

fn layout() -> RawLayout {
    RawLayout { times: 2, ..RawLayout::new(Extent::new(5, 4, 3), VoxelType::U16) }
}

fn read(bytes: &[u8], layout: &RawLayout, options: &OpenOptions) -> Result<RawSource, String> {
    spooled(Slow(bytes, false), Path::new("standard input"), layout, options).map_err(|error| error.to_string())
}

#[test]
fn streams_are_read_as_files_are() {
    let plain = OpenOptions::default();
    let source = read(&FIELD.bytes("tczyx", false), &layout(), &plain).unwrap();
    assert_boxes(&source, FIELD);
    assert_eq!(source.scratch_bytes(), 240);
    let again = read(&FIELD.bytes("tczyx", false), &layout(), &plain).unwrap();
    assert_ne!(source.info().identity, again.info().identity);
    let headed = RawLayout { offset: 3, may_trail: true, ..layout() };
    assert_boxes(&read(&[&[9; 3], &FIELD.bytes("tczyx", false)[..]].concat(), &headed, &plain).unwrap(), FIELD);
}

#[test]
fn streams_of_other_lengths_are_refused() {
    let (bytes, plain) = (FIELD.bytes("tczyx", false), OpenOptions::default());
    let message = read(&bytes[1..], &layout(), &plain).err().unwrap();
    assert!(message.contains("standard input: ended after 239 bytes, expected 240"), "{message}");
    let message = read(&[&bytes[..], &[0]].concat(), &layout(), &plain).err().unwrap();
    assert!(message.contains("goes on after the 240 bytes"), "{message}");
    let nowhere = OpenOptions { scratch_dir: Some("/no such folder".into()), ..plain.clone() };
    assert!(read(&bytes, &layout(), &nowhere).err().unwrap().contains("/no such folder"));
    let huge = RawLayout::new(Extent::new(1 << 20, 1 << 20, 1 << 18), VoxelType::U8);
    assert!(read(&bytes, &huge, &plain).err().unwrap().contains("`scratch_dir`"));
}

/// A pipe that another program fills while it is read.
#[cfg(unix)]
#[test]
fn named_pipes_are_read_once() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pipe");
    assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
    assert!(is_pipe(&path) && is_pipe(Path::new("-")) && !is_pipe(folder.path()));
    let array = |file: &Path| ChannelArray { name: "a".into(), place: ArrayPlace::File(file.into()) };
    let arrays = [array(folder.path()), array(&path)];
    assert_eq!(stream_among(&[], &arrays), Some(&*path));
    assert_eq!(stream_among(&["x".into(), "-".into()], &arrays[..1]), Some(Path::new("-")));
    assert_eq!(stream_among(&["x".into()], &arrays[..1]), None);
    let options = OpenOptions {
        shape: Some(Extent::new(5, 4, 3)),
        voxel_type: Some(VoxelType::U16.into()),
        times: Some(2),
        ..OpenOptions::default()
    };
    let inputs = [path.clone()];
    let refusal = |options: &OpenOptions| crate::open::open(&inputs, options).err().unwrap().to_string();
    assert!(refusal(&OpenOptions::default()).contains("`shape`"));
    assert!(refusal(&OpenOptions { is_step: true, ..options.clone() }).contains("by itself"));
    let writer = std::thread::spawn(move || std::fs::write(path, FIELD.bytes("tczyx", false)).unwrap());
    assert_boxes(&*crate::open::open(&inputs, &options).unwrap(), FIELD);
    writer.join().unwrap();
}

proptest! {
    #![proptest_config(crate::testing::cases(300))]

    /// Any layout over any stream is refused, or gives the voxels that a file of the same bytes gives.
    #[test]
    fn streams_are_refused_or_read_as_files(
        [x, y, z, channels, times] in prop::array::uniform5(1u32..4),
        step_bytes in prop::option::of(prop_oneof![0u64..120, Just(u64::MAX), Just(1 << 62)]),
        offset in prop_oneof![0u64..9, Just(u64::MAX), Just(1 << 50)],
        is_fit in any::<bool>(),
        length in 0usize..400,
    ) {
        let layout = RawLayout {
            offset, may_trail: true, step_bytes, channels, times, ..RawLayout::new(Extent::new(x, y, z), VoxelType::U8)
        };
        let fit = layout.end_bytes(Path::new("-")).ok().filter(|bytes| is_fit && *bytes < 1000);
        let bytes: Vec<u8> = (0..fit.map_or(length, |fit| fit as usize)).map(|i| (i * 7 % 251) as u8).collect();
        let read_all = |source: &RawSource| -> Vec<u8> {
            let full = source.info().extent.full_box();
            let mut out = vec![0; full.extent().volume() as usize];
            source.read_box(times - 1, channels - 1, full, &mut out).unwrap();
            out
        };
        let (_folder, path) = temp_file("a.raw", &bytes);
        match (read(&bytes, &layout, &OpenOptions::default()), RawSource::open(&path, &layout)) {
            (Ok(stream), Ok(file)) => prop_assert_eq!(read_all(&stream), read_all(&file)),
            (stream, _) => prop_assert!(stream.is_err() && fit.is_none()),
        }
    }
}
