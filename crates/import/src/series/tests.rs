//! Series of more files than may be open, of compressed ones, and of changing ones.

use super::one_type::Encoding;
use crate::open::open;
use crate::options::OpenOptions;
use crate::source::Source;
use crate::testing::{Field, alone_with, assert_boxes, is_warned, said};
use brickyard_volume::{Extent, VoxelType};
use flate2::Compression;
use flate2::write::GzEncoder;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Limit of open files in the tests' processes: far fewer than steps.
const MOST_OPEN_FILES: u64 = 64;

fn told(extent: Extent) -> OpenOptions {
    OpenOptions { shape: Some(extent), voxel_type: Some(VoxelType::U16.into()), ..OpenOptions::default() }
}

/// A NIfTI file of numbers of one type, by its code and bits.
fn nifti(extent: [u16; 3], [code, bits]: [u8; 2], voxels: &[u8]) -> Vec<u8> {
    let mut header = vec![0; 352];
    header[..4].copy_from_slice(&348i32.to_le_bytes());
    for (i, size) in [3].into_iter().chain(extent).enumerate() {
        header[40 + 2 * i..][..2].copy_from_slice(&u16::to_le_bytes(size));
    }
    (header[70], header[72]) = (code, bits);
    (1..4).for_each(|i| header[76 + 4 * i..][..4].copy_from_slice(&1f32.to_le_bytes()));
    header[108..112].copy_from_slice(&352f32.to_le_bytes());
    header[344..348].copy_from_slice(b"n+1\0");
    [header, voxels.to_vec()].concat()
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// Maps of this process whose lines contain these words.
fn maps(words: &[&str]) -> usize {
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap();
    maps.lines().filter(|line| words.iter().all(|word| line.contains(word))).count()
}

fn value(source: &dyn Source, time: u32) -> f64 {
    let full = source.info().extent.full_box();
    let mut out = vec![0; full.extent().volume() as usize * source.info().voxel_type.bytes()];
    source.read_box(time, 0, full, &mut out).unwrap();
    source.info().voxel_type.read(&out, 0)
}

fn refusal(source: &dyn Source, time: u32) -> String {
    let full = source.info().extent.full_box();
    let mut out = vec![0; full.extent().volume() as usize * source.info().voxel_type.bytes()];
    source.read_box(time, 0, full, &mut out).unwrap_err().to_string()
}

/// Runs in a process of its own with few files open.
fn with_few_files(name: &str, steps: u32, extension: &str, file: impl Fn(u32) -> Vec<u8>, options: &OpenOptions) {
    let write = |folder: &Path| {
        std::fs::create_dir(folder).unwrap();
        (0..steps).for_each(|i| std::fs::write(folder.join(format!("s_{i:04}.{extension}")), file(i)).unwrap());
    };
    let Some(folder) = alone_with(&format!("series::tests::{name}"), write) else { return };
    let limit = rustix::process::Rlimit { current: Some(MOST_OPEN_FILES), maximum: Some(MOST_OPEN_FILES) };
    rustix::process::setrlimit(rustix::process::Resource::Nofile, limit).unwrap();
    let source = open(std::slice::from_ref(&folder), options).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(source.info().times, steps);
    let here = folder.to_str().unwrap();
    assert_eq!(maps(&[here]), 0, "closed once they were looked at");
    for time in (0..steps).chain([0, steps - 1, 0, 7]) {
        assert_eq!(value(&*source, time), f64::from(time));
        assert!(maps(&[here]) <= super::OPEN_STEPS);
    }
}

#[test]
fn there_may_be_more_raw_steps_than_open_files() {
    let file = |i: u32| [i as u16; 24].iter().flat_map(|v| v.to_le_bytes()).collect();
    with_few_files("there_may_be_more_raw_steps_than_open_files", 1100, "raw", file, &told(Extent::new(4, 3, 2)));
}

#[cfg(feature = "tiff")]
#[test]
fn there_may_be_more_tiff_steps_than_open_files() {
    let file = |i: u32| {
        let mut bytes = std::io::Cursor::new(Vec::new());
        let mut encoder = tiff::encoder::TiffEncoder::new(&mut bytes).unwrap();
        for _ in 0..2 {
            encoder.write_image::<tiff::encoder::colortype::Gray16>(4, 3, &[i as u16; 12]).unwrap();
        }
        bytes.into_inner()
    };
    let options = OpenOptions::default();
    with_few_files("there_may_be_more_tiff_steps_than_open_files", 1100, "tif", file, &options);
}

#[test]
fn compressed_steps_are_inflated_when_they_are_read_and_their_scratch_goes() {
    const STEPS: u32 = 6;
    let [folder, scratch] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    let voxels = 32 * 16 * 16;
    let paths: Vec<PathBuf> = (0..STEPS).map(|i| folder.path().join(format!("s_{i}.nii.gz"))).collect();
    for (i, path) in paths.iter().enumerate() {
        std::fs::write(path, gzip(&nifti([32, 16, 16], [2, 8], &vec![i as u8; voxels]))).unwrap();
    }
    let options = OpenOptions { scratch_dir: Some(scratch.path().to_owned()), ..OpenOptions::default() };
    let source = open(&paths, &options).unwrap();
    let inflated = || maps(&["(deleted)", scratch.path().to_str().unwrap()]);
    assert_eq!(inflated(), 0, "nothing is inflated yet");
    let step_bytes = 352 + voxels as u64;
    assert_eq!(source.scratch_bytes(), super::OPEN_STEPS as u64 * step_bytes);
    for time in (0..STEPS).chain([1, 4, 1]) {
        assert_eq!(value(&*source, time), f64::from(time));
        assert!((1..=super::OPEN_STEPS).contains(&inflated()), "step {time}: {}", inflated());
    }
    drop(source);
    assert_eq!(inflated(), 0);
    // A single file is inflated on opening, and reports it.
    let single = open(&paths[..1], &options).unwrap();
    assert_eq!((inflated(), single.scratch_bytes()), (1, step_bytes));
}

#[test]
fn compressed_steps_that_are_damaged_are_named_in_time() {
    let folder = tempfile::tempdir().unwrap();
    let noise: Vec<u8> = (0..1000u32).map(|i| (i.wrapping_mul(2654435761) >> 13) as u8).collect();
    let whole = gzip(&nifti([10, 10, 10], [2, 8], &noise));
    let paths = ["s_1", "s_2", "s_3"].map(|name| folder.path().join(format!("{name}.nii.gz")));
    let write = |second: &[u8]| {
        paths.iter().for_each(|path| std::fs::write(path, &whole).unwrap());
        std::fs::write(&paths[1], second).unwrap();
    };
    let options = OpenOptions::default();
    // Cut short anywhere, or with too few voxels: before anything is read.
    let short = gzip(&nifti([10, 10, 10], [2, 8], &noise[..999]));
    for second in [&whole[..whole.len() - 200], &whole[..whole.len() - 1], &short] {
        write(second);
        let message = open(&paths, &options).err().unwrap().to_string();
        assert!(message.contains("s_2.nii.gz") && message.contains("cut short"), "{message}");
    }
    // Surplus bytes are ignored, with a note.
    write(&gzip(&nifti([10, 10, 10], [2, 8], &[&noise[..], &[1; 9]].concat())));
    let source = open(&paths, &options).unwrap();
    assert!(source.info().notes.iter().any(|note| note.contains("s_2.nii.gz: 9 bytes")), "{:?}", source.info().notes);
    assert!(is_warned(&said(&source.info().notes), "s_2.nii.gz: 9 bytes"));
    assert_eq!(value(&*source, 1), f64::from(noise[0]));
    // Visible only in the checksum: when the step is read.
    let mut flipped = whole.clone();
    let middle = flipped.len() / 2;
    flipped[middle] ^= 0x10;
    write(&flipped);
    let source = open(&paths, &options).unwrap();
    assert_eq!(value(&*source, 0), f64::from(noise[0]));
    let message = refusal(&*source, 1);
    assert!(message.contains("s_2.nii.gz") && message.contains("damaged"), "{message}");
    assert_eq!(value(&*source, 2), f64::from(noise[0]), "the others can be read");
}

#[test]
fn a_step_that_changes_after_the_series_was_opened_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let later = |path: &Path| {
        let file = std::fs::File::options().write(true).open(path).unwrap();
        file.set_modified(std::time::SystemTime::now() + std::time::Duration::from_secs(5)).unwrap();
    };
    // Written to and cut short, before it is reopened.
    for name in ["a_1.raw", "a_2.raw", "a_3.raw"] {
        std::fs::write(at(name), [1; 48]).unwrap();
    }
    let raw = ["a_1.raw", "a_2.raw", "a_3.raw"].map(at);
    let source = open(&raw, &told(Extent::new(4, 3, 2))).unwrap();
    std::fs::write(&raw[1], [2; 48]).unwrap();
    later(&raw[1]);
    std::fs::write(&raw[2], [1; 40]).unwrap();
    assert_eq!(value(&*source, 0), 257.0);
    for (time, name) in [(1, "a_2.raw"), (2, "a_3.raw")] {
        let message = refusal(&*source, time);
        assert!(message.contains(name) && message.contains("changed while it was read"), "{message}");
        let lent = source.lend(time, 0, source.info().extent.full_box(), &mut |_| panic!("lent what has changed"));
        assert!(lent.is_err());
    }
    assert_eq!(value(&*source, 0), 257.0);
    // The half of a pair with the voxels.
    for name in ["b_1", "b_2"] {
        let mut header = nifti([4, 3, 2], [2, 8], &[]);
        header[344..348].copy_from_slice(b"ni1\0");
        header[108..112].fill(0);
        std::fs::write(at(&format!("{name}.hdr")), &header[..348]).unwrap();
        std::fs::write(at(&format!("{name}.img")), [5; 24]).unwrap();
    }
    let source = open(&["b_1.hdr", "b_2.hdr"].map(at), &OpenOptions::default()).unwrap();
    std::fs::write(at("b_2.img"), [6; 24]).unwrap();
    later(&at("b_2.img"));
    assert_eq!(value(&*source, 0), 5.0);
    let message = refusal(&*source, 1);
    assert!(message.contains("b_2.hdr: changed since the series was opened"), "{message}");
}

#[test]
fn values_that_voxels_cannot_hold_are_counted_once() {
    let folder = tempfile::tempdir().unwrap();
    let f64s = |first: f64| -> Vec<u8> { (0..24).flat_map(|i| (first + f64::from(i)).to_le_bytes()).collect() };
    let paths = ["s_1", "s_2", "s_3"].map(|name| folder.path().join(format!("{name}.nii.gz")));
    for (path, first) in paths.iter().zip([0.0, 0.1, 5.0]) {
        std::fs::write(path, gzip(&nifti([4, 3, 2], [64, 64], &f64s(first)))).unwrap();
    }
    let message = open(&paths, &OpenOptions::default()).err().unwrap().to_string();
    assert!(message.contains("s_2.nii.gz") && message.contains("0.1"), "{message}");
    let source = open(&paths, &OpenOptions { allow_lossy: true, ..OpenOptions::default() }).unwrap();
    let notes = source.info().notes.iter().filter(|note| note.contains("of 24 values")).count();
    assert_eq!(notes, 1, "{:?}", source.info().notes);
    assert_eq!([0, 1, 2].map(|time| value(&*source, time)), [0.0, f64::from(0.1f32), 5.0]);
}

#[test]
fn steps_are_read_in_any_order_by_many_threads() {
    let field = Field { sizes: [7, 5, 4, 1, 9], voxel_type: VoxelType::U16 };
    let folder = tempfile::tempdir().unwrap();
    let bytes = field.bytes("tzyx", false);
    for (i, step) in bytes.chunks(bytes.len() / 9).enumerate() {
        std::fs::write(folder.path().join(format!("s_{i}.raw")), step).unwrap();
    }
    let source = open(&[folder.path().to_owned()], &told(Extent::new(7, 5, 4))).unwrap();
    std::thread::scope(|scope| {
        (0..4).for_each(|_| drop(scope.spawn(|| assert_boxes(&*source, field))));
    });
    assert!(maps(&[folder.path().to_str().unwrap()]) <= super::OPEN_STEPS);
}

/// A step of 4 x 3 x 2 voxels in OME-XML.
#[cfg(feature = "tiff")]
fn ome(pixels: &str, channels: [&str; 2]) -> Vec<u8> {
    let [first, second] = channels.map(|name| if name.is_empty() { String::new() } else { format!("Name='{name}'") });
    let xml = format!(
        "<OME><Image><Pixels DimensionOrder='XYZCT' SizeX='4' SizeY='3' SizeZ='2' SizeC='2' SizeT='1' {pixels}><Channel {first}/>\
         <Channel {second}/><TiffData/></Pixels></Image></OME>"
    );
    let mut bytes = std::io::Cursor::new(Vec::new());
    let mut encoder = tiff::encoder::TiffEncoder::new(&mut bytes).unwrap();
    for page in 0..4 {
        let mut image = encoder.new_image::<tiff::encoder::colortype::Gray16>(4, 3).unwrap();
        if page == 0 {
            image.encoder().write_tag(tiff::tags::Tag::ImageDescription, &*xml).unwrap();
        }
        image.write_data(&[page; 12]).unwrap();
    }
    bytes.into_inner()
}

/// Lengths and channels mean the same in all steps whose files describe them.
#[cfg(feature = "tiff")]
#[test]
fn steps_that_mean_something_else_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let size =
        |unit: &str| ["X", "Y", "Z"].map(|a| format!("PhysicalSize{a}='1' PhysicalSize{a}Unit='{unit}'")).join(" ");
    let files = |first: Vec<u8>, second: Vec<u8>| {
        let paths = ["s_1.ome.tif", "s_2.ome.tif"].map(|name| folder.path().join(name));
        paths.iter().zip([first, second]).for_each(|(path, bytes)| std::fs::write(path, bytes).unwrap());
        paths
    };
    let none = OpenOptions::default();
    let names = ["DAPI", "GFP"];
    let unit = OpenOptions { unit: Some("micrometer".into()), ..none.clone() };
    for (first, second, words, told) in [
        (ome(&size("mm"), names), ome(&size("nm"), names), "s_2.ome.tif: has lengths in nanometer, but", Some(&unit)),
        (ome("", names), ome(&size("nm"), names), "in no unit: write them in one unit, or give", Some(&unit)),
        (ome("", names), ome("", ["GFP", "DAPI"]), "has the channels GFP, DAPI, but", None),
        (ome("", ["DAPI", ""]), ome("", ["GFP", "DAPI"]), "has DAPI, (no name): write the steps", None),
    ] {
        let paths = files(first, second);
        let message = open(&paths, &none).err().expect(words).to_string();
        assert!(message.contains(words), "{message}");
        if let Some(told) = told {
            assert_eq!(open(&paths, told).unwrap().info().times, 2, "{words}");
        }
    }
    // One without names comes before those with names.
    let [first, second] = files(ome("", names), ome("", ["GFP", "DAPI"]));
    let before = folder.path().join("s_0.ome.tif");
    std::fs::write(&before, ome("", ["", ""])).unwrap();
    let message = open(&[before, first, second], &none).err().expect("channels").to_string();
    assert!(
        message.contains("s_2.ome.tif: has the channels GFP, DAPI") && message.contains("s_1.ome.tif has"),
        "{message}"
    );
    for (first, second) in [
        (ome(&size("mm"), names), ome(&size("mm"), names)),
        (ome("", names), ome("", ["", "GFP"])),
        (ome("", ["", ""]), ome("", names)),
    ] {
        assert_eq!(open(&files(first, second), &none).unwrap_or_else(|error| panic!("{error}")).info().times, 2);
    }
}

/// A window that moves with a simulation is no one place.
#[test]
fn steps_of_other_places_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let paths: Vec<PathBuf> = (0..2).map(|i| folder.path().join(format!("s{i}.vtk"))).collect();
    for (i, path) in paths.iter().enumerate() {
        let grid = format!("DATASET STRUCTURED_POINTS\nDIMENSIONS 2 1 1\nORIGIN {i} 0 0\nSPACING 1 1 1\n");
        let values = "POINT_DATA 2\nSCALARS a float\nLOOKUP_TABLE default\n0 1\n";
        std::fs::write(path, format!("# vtk DataFile Version 3.0\n\nASCII\n{grid}{values}")).unwrap();
    }
    let message = open(&paths, &OpenOptions::default()).err().unwrap().to_string();
    assert!(message.contains("s1.vtk: its first voxel lies at [1, 0, 0], but that of") && message.contains("`origin`"));
    let told = OpenOptions { origin: Some(glam::DVec3::ZERO), ..OpenOptions::default() };
    assert_eq!(open(&paths, &told).unwrap().info().times, 2);
}

/// A NIfTI file of one row of i16 with a scale of its own.
fn scaled(slope: f32, voxels: [i16; 3]) -> Vec<u8> {
    let mut file = nifti([3, 1, 1], [4, 16], &voxels.map(i16::to_le_bytes).concat());
    file[112..116].copy_from_slice(&slope.to_le_bytes());
    file
}

fn written(files: &[Vec<u8>], extension: &str) -> (tempfile::TempDir, Vec<PathBuf>) {
    let folder = tempfile::tempdir().unwrap();
    let paths: Vec<PathBuf> = (0..files.len()).map(|i| folder.path().join(format!("s_{i}.{extension}"))).collect();
    paths.iter().zip(files).for_each(|(path, bytes)| std::fs::write(path, bytes).unwrap());
    (folder, paths)
}

fn row(source: &dyn Source, time: u32) -> Vec<f64> {
    let full = source.info().extent.full_box();
    let mut out = vec![0; full.extent().volume() as usize * source.info().voxel_type.bytes()];
    source.read_box(time, 0, full, &mut out).unwrap();
    (0..full.extent().volume() as usize).map(|i| source.info().voxel_type.read(&out, i)).collect()
}

#[test]
fn steps_of_unlike_scales_become_one_type() {
    let none = OpenOptions::default();
    let unsigned = nifti([3, 1, 1], [0, 16], &[1u16, 2, 60000].map(u16::to_le_bytes).concat());
    let unsigned = [&unsigned[..70], &512i16.to_le_bytes(), &unsigned[72..]].concat();
    let (_folder, paths) = written(&[scaled(1.0, [1, -2, 3]), scaled(0.5, [1, -2, 3]), unsigned], "nii");
    let source = open(&paths, &none).unwrap();
    assert_eq!(source.info().voxel_type, VoxelType::F32);
    assert_eq!(row(&*source, 0), [1.0, -2.0, 3.0]);
    assert_eq!(row(&*source, 1), [0.5, -1.0, 1.5]);
    assert_eq!(row(&*source, 2), [1.0, 2.0, 60000.0]);
    let notes = said(&source.info().notes);
    assert!(notes.contains("The files' voxels are i16, f32, u16 and become f32."), "{notes}");
    // Of integers alone an integer; another type by the caller's word, without a loss or with its place.
    let integers = [paths[0].clone(), paths[2].clone()];
    let source = open(&integers, &none).unwrap();
    assert_eq!((source.info().voxel_type, row(&*source, 1)), (VoxelType::I32, vec![1.0, 2.0, 60000.0]));
    let to = |voxel_type| OpenOptions { to_voxel_type: Some(voxel_type), ..OpenOptions::default() };
    let message = open(&integers, &to(VoxelType::I16)).err().unwrap().to_string();
    assert!(message.contains("s_2.nii") && message.contains("60000 (voxel 2,0,0"), "{message}");
    let floats = open(&integers, &to(VoxelType::F32)).unwrap();
    assert_ne!(floats.info().identity, source.info().identity, "a resumed pack has one type");
    // Steps that are not taken may hold anything.
    let first = OpenOptions {
        take_time: Some(crate::choice::StepChoice { first: 0, end: Some(1), stride: 1 }),
        ..to(VoxelType::I16)
    };
    assert_eq!(row(&*open(&integers, &first).unwrap(), 0), [1.0, -2.0, 3.0]);
}

/// Files of a TIFF's tag for no data, each with its own, beside a caller's value.
#[test]
fn unlike_marks_become_nan_or_the_callers() {
    let alike = Encoding { voxel_type: VoxelType::I16, nodata: Some(-9.0), knows_nodata: false };
    let other = Encoding { nodata: Some(-8.0), ..alike };
    let paths = ["a", "b"].map(PathBuf::from);
    let of_all =
        |all: &[Encoding], options: &OpenOptions| Encoding::of_all(all, &paths, options).map_err(|e| e.to_string());
    let none = OpenOptions::default();
    assert_eq!(of_all(&[alike, alike], &none), Ok(None));
    let message = of_all(&[alike, other], &none).unwrap_err();
    assert!(
        message.contains("b: marks") && message.contains("`nodata`") && message.contains("`to_voxel_type` f32"),
        "{message}"
    );
    let floats = OpenOptions { to_voxel_type: Some(VoxelType::F32), ..none.clone() };
    let nan = Some(Encoding { voxel_type: VoxelType::F32, nodata: None, knows_nodata: true });
    assert_eq!(of_all(&[alike, other], &floats), Ok(nan));
    let float = Encoding { voxel_type: VoxelType::F32, nodata: Some(1e20), knows_nodata: false };
    assert_eq!(of_all(&[float, alike], &none), Ok(nan));
    let unsigned = Encoding { voxel_type: VoxelType::U32, nodata: None, knows_nodata: false };
    let signed = Encoding { voxel_type: VoxelType::I32, ..unsigned };
    assert!(of_all(&[unsigned, signed], &none).unwrap_err().contains("`to_voxel_type`"));
}
