use crate::options::OpenOptions;
use crate::testing::{Field, Opened, assert_boxes, is_warned, open_in, said, temp_file};
use brickyard_volume::VoxelType;
use flate2::Crc;
use proptest::prelude::*;
use std::io::Write;

/// A zip archive of files, with what its headers say of each.
#[derive(Clone)]
struct File {
    name: &'static str,
    stored: Vec<u8>,
    bytes: u32,
    checksum: u32,
    method: u16,
    flags: u16,
}

impl File {
    fn stored(name: &'static str, content: &[u8]) -> Self {
        let mut crc = Crc::new();
        crc.update(content);
        let bytes = content.len() as u32;
        Self { name, stored: content.to_vec(), bytes, checksum: crc.sum(), method: 0, flags: 0 }
    }

    fn deflated(name: &'static str, content: &[u8]) -> Self {
        let mut encoder = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::fast());
        encoder.write_all(content).unwrap();
        Self { stored: encoder.finish().unwrap(), method: 8, ..Self::stored(name, content) }
    }

    /// The fields that local and central headers share.
    fn head(&self, zip64: bool) -> Vec<u8> {
        let short = |n: usize| (n as u16).to_le_bytes();
        let size = |n: u32| if zip64 { u32::MAX } else { n }.to_le_bytes();
        [
            &[45, 0][..],
            &self.flags.to_le_bytes(),
            &self.method.to_le_bytes(),
            &[0, 0, 0x21, 0],
            &self.checksum.to_le_bytes(),
            &size(self.stored.len() as u32),
            &size(self.bytes),
            &short(self.name.len()),
            &short(if zip64 { 20 } else { 0 }),
        ]
        .concat()
    }

    fn extra(&self, zip64: bool) -> Vec<u8> {
        if !zip64 {
            return Vec::new();
        }
        let sizes = [u64::from(self.bytes), self.stored.len() as u64].map(u64::to_le_bytes).concat();
        [&[1, 0, 16, 0][..], &sizes].concat()
    }
}

fn archive(files: &[File], zip64: bool) -> Vec<u8> {
    let (mut all, mut directory) = (Vec::new(), Vec::new());
    for file in files {
        let at = (all.len() as u32).to_le_bytes();
        all.extend(
            [b"PK\x03\x04", &file.head(zip64)[..], file.name.as_bytes(), &file.extra(zip64), &file.stored].concat(),
        );
        let central = [b"PK\x01\x02", &[45, 0][..], &file.head(zip64), &[0; 10], &at, file.name.as_bytes()].concat();
        directory.extend([central, file.extra(zip64)].concat());
    }
    let (at, size) = ((all.len() as u32).to_le_bytes(), (directory.len() as u32).to_le_bytes());
    let count = (files.len() as u16).to_le_bytes();
    [&all[..], &directory, b"PK\x05\x06\0\0\0\0", &count, &count, &size, &at, &[0, 0]].concat()
}

fn npy(descr: &str, shape: &str, body: &[u8]) -> Vec<u8> {
    let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}");
    [b"\x93NUMPY\x01\x00", &(header.len() as u16).to_le_bytes()[..], header.as_bytes(), body].concat()
}

fn field() -> Field {
    Field { sizes: [4, 3, 2, 1, 1], voxel_type: VoxelType::I16 }
}

fn array() -> Vec<u8> {
    npy("<i2", "(2, 3, 4)", &field().bytes("zyx", false))
}

fn open_with(bytes: &[u8], options: &OpenOptions) -> Result<Opened, String> {
    open_in(temp_file("a.npz", bytes), options)
}

fn open(files: &[File]) -> Result<Opened, String> {
    open_with(&archive(files, false), &OpenOptions::default())
}

#[test]
fn stored_and_deflated_arrays_give_the_bytes_written() {
    for zip64 in [false, true] {
        for file in [File::stored("a.npy", &array()), File::deflated("a.npy", &array())] {
            let is_stored = file.method == 0;
            let other = File::stored("readme.txt", b"text");
            let source = open_with(&archive(&[other, file], zip64), &OpenOptions::default()).unwrap();
            assert_boxes(&*source, field());
            assert_eq!(source.scratch_bytes() == 0, is_stored);
            assert_eq!(said(&source.info().notes).contains("scratch"), !is_stored);
        }
    }
}

#[test]
fn one_of_several_arrays_has_to_be_named() {
    let other = npy("<f8", "(2, 2)", &[0; 32]);
    let objects = npy("|O", "(3,)", b"pickle");
    let files = [File::stored("a.npy", &array()), File::deflated("b.npy", &other), File::stored("c.npy", &objects)];
    let message = open(&files).err().unwrap();
    assert!(
        message.contains(
            "3 arrays, a [2, 3, 4] i16, b [2, 2] f64, c (dtype '|O' (pickled objects)): choose one with `variable`"
        ),
        "{message}"
    );
    let named = |name: &str| OpenOptions { variable: Some(name.into()), ..OpenOptions::default() };
    let bytes = archive(&files, false);
    assert_boxes(&*open_with(&bytes, &named("a")).unwrap(), field());
    assert_boxes(&*open_with(&bytes, &named("a.npy")).unwrap(), field());
    assert!(open_with(&bytes, &named("b")).is_ok());
    assert!(
        open_with(&bytes, &named("c")).err().unwrap().contains("c.npy: dtype '|O' (pickled objects) is not supported")
    );
    let message = open_with(&bytes, &named("d")).err().unwrap();
    assert!(message.contains("no array 'd' but a [2, 3, 4] i16") && message.contains("`variable`"), "{message}");
    let four = File::stored("a.npy", &npy("|u1", "(1, 2, 3, 4)", &[0; 24]));
    assert!(open(std::slice::from_ref(&four)).err().unwrap().contains("`axes`"));
    let axes = OpenOptions { axes: Some("tzyx".parse().unwrap()), ..OpenOptions::default() };
    assert!(open_with(&archive(&[four], false), &axes).is_ok());
}

#[test]
fn damaged_and_foreign_archives_are_refused() {
    let refusal = |file: File| open(&[file]).err().unwrap();
    let packed = File::deflated("a.npy", &array());
    assert!(refusal(File { checksum: 1, ..packed.clone() }).contains("cut short or damaged"));
    // More bytes than the archive says: none of them is written.
    assert!(refusal(File { bytes: 20, ..packed.clone() }).contains("cut short"));
    assert!(refusal(File { bytes: 1000, ..packed.clone() }).contains("of 1000 bytes"));
    let cut = File { stored: packed.stored[..60].to_vec(), ..packed.clone() };
    assert!(refusal(cut).contains("cut short"));
    assert!(refusal(File { flags: 1, ..packed.clone() }).contains("the encrypted file a.npy is not supported"));
    assert!(refusal(File { method: 12, ..packed.clone() }).contains("compressed by bzip2, is not supported"));
    assert!(refusal(File { bytes: 3, ..File::stored("a.npy", &array()) }).contains("damaged zip archive"));
    let short = &array()[..array().len() - 5];
    for file in [File::stored("a.npy", short), File::deflated("a.npy", short)] {
        assert!(refusal(file).contains("(5 missing)"));
    }
    let longer = [array(), vec![0; 3]].concat();
    let source = open(&[File::deflated("a.npy", &longer)]).unwrap();
    assert!(is_warned(&said(&source.info().notes), "3 bytes after the voxels"));
    assert!(refusal(File::stored("a.txt", b"text")).contains("without .npy files"));
    let whole = archive(&[packed], false);
    assert!(
        open_with(&whole[..whole.len() - 30], &OpenOptions::default())
            .err()
            .unwrap()
            .contains("not a whole zip archive")
    );
}

#[test]
fn archives_are_found_by_their_files() {
    let bytes = archive(&[File::stored("a.npy", &array())], false);
    let open = |name: &str, bytes: &[u8]| open_in(temp_file(name, bytes), &OpenOptions::default());
    for name in ["a.npz", "a.zip", "a.dat"] {
        assert_boxes(&*open(name, &bytes).unwrap(), field());
    }
    let other = archive(&[File::stored("a.txt", b"text")], false);
    assert!(open("a.zip", &other).err().unwrap().contains("a zip archive is not supported"));
    let (_folder, path) = temp_file("a.npy", &array());
    let named = OpenOptions { variable: Some("a".into()), ..OpenOptions::default() };
    assert!(
        crate::open(&[path], &named).err().unwrap().to_string().contains("`variable` is for files of several arrays")
    );
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// Damage leads to an error or wrong voxels, never to a panic.
    #[test]
    fn damaged_archives_do_not_panic(
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        is_stored in any::<bool>(),
        zip64 in any::<bool>(),
    ) {
        let file = if is_stored { File::stored("a.npy", &array()) } else { File::deflated("a.npy", &array()) };
        let mut bytes = archive(&[file], zip64);
        for (place, value) in damage {
            let place = place.index(bytes.len());
            bytes[place] = value;
        }
        let (_folder, path) = temp_file("a.npz", &bytes);
        let told = OpenOptions { allow_lossy: true, ..OpenOptions::default() };
        if let Ok(source) = crate::open(&[path], &told) {
            let full = source.info().extent.full_box();
            let mut out = vec![0; full.extent().volume() as usize * source.info().voxel_type.bytes()];
            source.read_box(0, 0, full, &mut out).unwrap();
        }
    }
}
