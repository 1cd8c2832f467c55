//! Channels joined from arrays made by hand.

use super::*;
use crate::open::open;
use crate::options::{ArrayPlace, ChannelArray, NoData, OpenOptions};
use crate::testing::{Field, assert_boxes, said, temp_file};
use brickyard_volume::VoxelType;
use glam::DVec3;
use std::path::Path;

/// Options for raw files of a field's volumes.
fn raw(field: Field, channels: u32) -> OpenOptions {
    let [x, y, z, _, t] = field.sizes;
    OpenOptions {
        shape: Some(Extent::new(x, y, z)),
        voxel_type: Some(field.voxel_type.into()),
        times: Some(t),
        channels: Some(channels),
        ..OpenOptions::default()
    }
}

fn channels_of(parts: Vec<NamedArray>) -> Result<Channels> {
    Channels::new(parts, &OpenOptions::default())
}

fn file(name: &str, path: &Path) -> ChannelArray {
    ChannelArray { name: name.into(), place: ArrayPlace::File(path.into()) }
}

/// Bytes of a `.npy` file of `values`, in an array of this shape.
fn npy(element: &str, shape: &str, values: &[u8]) -> Vec<u8> {
    let header = format!("{{'descr': '{element}', 'fortran_order': False, 'shape': {shape}, }}");
    [b"\x93NUMPY\x01\x00", &(header.len() as u16).to_le_bytes()[..], header.as_bytes(), values].concat()
}

/// Opens `.npy` files as channels `a`, `b`, ... They last as long as their folder's guard.
fn opened(files: &[Vec<u8>], options: &OpenOptions) -> Result<(tempfile::TempDir, Box<dyn Source>), String> {
    let folder = tempfile::tempdir().unwrap();
    let arrays = files.iter().zip(["a", "b", "c"]).map(|(bytes, name)| {
        let path = folder.path().join(format!("{name}.npy"));
        std::fs::write(&path, bytes).unwrap();
        file(name, &path)
    });
    let options = OpenOptions { channel_arrays: arrays.collect(), ..options.clone() };
    let source = open(&[], &options).map_err(|error| error.to_string())?;
    Ok((folder, source))
}

fn joined(files: &[Vec<u8>], options: &OpenOptions) -> Result<SourceInfo, String> {
    opened(files, options).map(|(_folder, source)| source.info().clone())
}

#[test]
fn files_are_channels_in_their_order() {
    let field = Field { sizes: [7, 5, 4, 3, 2], voxel_type: VoxelType::U16 };
    let bytes = field.bytes("ctzyx", false);
    let (folder, one) = temp_file("one.raw", &bytes[..bytes.len() / 3]);
    let two = folder.path().join("two.raw");
    std::fs::write(&two, &bytes[bytes.len() / 3..]).unwrap();
    let options = OpenOptions { axes: Some("ctzyx".parse().unwrap()), ..raw(field, 1) };
    let opened = |path: &PathBuf, channels| {
        open(std::slice::from_ref(path), &OpenOptions { channels: Some(channels), ..options.clone() }).unwrap()
    };
    let part = |name: &str, path: &PathBuf, channels| NamedArray {
        name: name.into(),
        path: path.clone(),
        source: opened(path, channels),
    };
    let channels = channels_of(vec![part("p", &one, 1), part("v", &two, 2)]).unwrap();
    assert_boxes(&channels, field);
    let names: Vec<_> = channels.info().channel_looks.iter().map(|look| look.name.clone().unwrap()).collect();
    assert_eq!(names, ["p", "v.0", "v.1"]);
    let other = channels_of(vec![part("q", &one, 1), part("v", &two, 2)]).unwrap();
    assert_ne!(channels.info().identity, other.info().identity);
    let twice = channels_of(vec![part("p", &one, 1), part("p", &one, 1)]).err().unwrap().to_string();
    assert!(twice.contains("'p' is named twice"), "{twice}");
    assert!(channels_of(Vec::new()).is_err());
}

#[test]
fn unlike_arrays_are_refused_by_their_names() {
    let (plain, cube) = (OpenOptions::default(), "(2, 2, 2)");
    let bytes = npy("|u1", cube, &[1; 8]);
    assert_eq!(joined(&[bytes.clone(), bytes.clone()], &plain).unwrap().channels, 2);
    let cases: [(Vec<u8>, &[&str]); 2] = [
        (npy("|u1", "(2, 2, 3)", &[1; 12]), &["b is 3,2,2", "is 2,2,2", "resample"]),
        (npy("|u1", "(2, 2, 2, 2)", &[1; 16]), &["axes"]),
    ];
    for (other, words) in cases {
        let message = joined(&[bytes.clone(), other], &plain).err().unwrap();
        assert!(words.iter().all(|word| message.contains(word)), "{message}");
    }
    let steps = OpenOptions { axes: Some("tzyx".parse().unwrap()), ..plain };
    let message =
        joined(&[npy("|u1", "(3, 1, 2, 2)", &[1; 12]), npy("|u1", "(1, 1, 2, 2)", &[1; 4])], &steps).err().unwrap();
    assert!(message.contains("b is 1 time step") && message.contains("is 3 time steps"), "{message}");
}

/// The type, all values of all channels, and the notes.
fn values_of(files: &[Vec<u8>], options: &OpenOptions) -> (VoxelType, Vec<f64>, String) {
    let (_folder, source) = opened(files, options).unwrap();
    let SourceInfo { voxel_type, channels, extent, notes, .. } = source.info();
    let mut values = Vec::new();
    for channel in 0..*channels {
        let mut out = vec![0; extent.volume() as usize * voxel_type.bytes()];
        source.read_box(0, channel, extent.full_box(), &mut out).unwrap();
        values.extend((0..extent.volume() as usize).map(|i| voxel_type.read(&out, i)));
    }
    (*voxel_type, values, notes.iter().map(|note| note.to_string() + "\n").collect())
}

/// A row of two numbers.
fn pair<const N: usize>(element: &str, values: [[u8; N]; 2]) -> Vec<u8> {
    npy(element, "(1, 1, 2)", values.as_flattened())
}

#[test]
fn unlike_types_become_the_smallest_that_holds_all() {
    use VoxelType::*;
    let byte = pair("|u1", [[255], [1]]);
    let sbyte = pair("|i1", [[128], [1]]);
    let short = pair("<i2", [i16::MIN, i16::MAX].map(i16::to_le_bytes));
    let ushort = pair("<u2", [u16::MAX, 0].map(u16::to_le_bytes));
    let long = pair("<i4", [i32::MIN, 1 << 24].map(i32::to_le_bytes));
    let ulong = pair("<u4", [u32::MAX, 0].map(u32::to_le_bytes));
    let float = pair("<f4", [-0.5, f32::MAX].map(f32::to_le_bytes));
    let (lows, floats) = ([-32768.0, 32767.0], [-0.5, f64::from(f32::MAX)]);
    let check = |files: [&Vec<u8>; 2], to: VoxelType, expected: [[f64; 2]; 2]| {
        let (voxel_type, values, notes) = values_of(&files.map(Vec::clone), &OpenOptions::default());
        assert_eq!((voxel_type, &values[..]), (to, expected.as_flattened()), "{notes}");
        assert!(notes.contains(&format!("become {to}: no value is changed")), "{notes}");
    };
    check([&byte, &short], I16, [[255.0, 1.0], lows]);
    check([&byte, &sbyte], I16, [[255.0, 1.0], [-128.0, 1.0]]);
    check([&ushort, &short], I32, [[65535.0, 0.0], lows]);
    check([&ushort, &byte], U16, [[65535.0, 0.0], [255.0, 1.0]]);
    check([&ulong, &ushort], U32, [[4294967295.0, 0.0], [65535.0, 0.0]]);
    check([&float, &ushort], F32, [floats, [65535.0, 0.0]]);
    check([&long, &float], F32, [[-2147483648.0, 16777216.0], floats]);
    assert_eq!(joined(&[byte, short.clone(), ushort], &OpenOptions::default()).unwrap().voxel_type, I32);
    let message = joined(&[ulong, short], &OpenOptions::default()).err().unwrap();
    assert!(message.contains("u32 of a (") && message.contains("of b is i16") && message.contains("`to_voxel_type`"));
}

#[test]
fn values_lost_in_the_common_type_are_refused_or_counted() {
    let files = [pair("<i4", [5i32, 16777217].map(i32::to_le_bytes)), pair("<f4", [0.5f32, 1.0].map(f32::to_le_bytes))];
    let message = joined(&files, &OpenOptions::default()).err().unwrap();
    assert!(
        message.contains("a.npy (a)") && message.contains("16777217") && message.contains("`allow_lossy`"),
        "{message}"
    );
    let lossy = OpenOptions { allow_lossy: true, ..OpenOptions::default() };
    let (_, values, notes) = values_of(&files, &lossy);
    assert_eq!(values, [5.0, 16777216.0, 0.5, 1.0]);
    assert!(notes.contains("a: Voxels are i32 and become f32: of 2 values, 1 rounded"), "{notes}");
    let labels = OpenOptions { are_labels: Some(true), ..lossy.clone() };
    assert!(joined(&files, &labels).err().unwrap().contains("become others"));
    // Only the voxels taken count.
    let roi = Some(VoxelBox::new([0, 0, 0], [1, 1, 1]));
    assert_eq!(values_of(&files, &OpenOptions { roi, ..OpenOptions::default() }).1, [5.0, 0.5]);
    let take_channel = vec!["b".parse().unwrap()];
    assert_eq!(values_of(&files, &OpenOptions { take_channel, ..OpenOptions::default() }).1, [0.5, 1.0]);
}

#[test]
fn a_told_type_converts_each_channel_by_itself() {
    let to = |voxel_type| OpenOptions { to_voxel_type: Some(voxel_type), ..OpenOptions::default() };
    let files = [pair("<u4", [9u32, 70000].map(u32::to_le_bytes)), pair("<i2", [-9i16, 3].map(i16::to_le_bytes))];
    let (voxel_type, values, _) = values_of(&files, &to(VoxelType::I32));
    assert_eq!((voxel_type, &values[..]), (VoxelType::I32, &[9.0, 70000.0, -9.0, 3.0][..]));
    let message = joined(&files, &to(VoxelType::U16)).err().unwrap();
    assert!(message.contains("(a)") && message.contains("70000"), "{message}");
    let lossy = OpenOptions { allow_lossy: true, ..to(VoxelType::U16) };
    assert_eq!(values_of(&files, &lossy).1, [9.0, 65535.0, 0.0, 3.0]);
    // The magnitude is of the values, not of converted ones.
    let magnitude = OpenOptions { component: Some("magnitude".into()), ..to(VoxelType::F32) };
    let files = [pair("|u1", [[3], [0]]), pair("<i2", [-4i16, 300].map(i16::to_le_bytes))];
    assert_eq!(values_of(&files, &magnitude).1, [5.0, 300.0]);
}

#[test]
fn voxels_without_data_stay_so_in_one_type() {
    let told = OpenOptions { nodata: NoData::Value(7.0), ..OpenOptions::default() };
    let files = [pair("|u1", [[7], [1]]), pair("<f4", [7.0f32, 2.5].map(f32::to_le_bytes))];
    let (_, values, _) = values_of(&files, &told);
    assert!(values[0].is_nan() && values[2].is_nan() && (values[1], values[3]) == (1.0, 2.5), "{values:?}");
    let info = joined(&files, &told).unwrap();
    assert_eq!((info.nodata, info.sought_nodata()), (Some(7.0), None));
    let files = [pair("|u1", [[7], [1]]), pair("<i2", [7i16, -1].map(i16::to_le_bytes))];
    assert_eq!(values_of(&files, &told).1, [7.0, 1.0, 7.0, -1.0]);
    assert_eq!(joined(&files, &told).unwrap().sought_nodata(), Some(7.0));
}

/// A source of one channel with another description.
fn described_as(path: &Path, name: &str, describe: impl FnOnce(&mut SourceInfo)) -> NamedArray {
    let options = OpenOptions {
        shape: Some(Extent::new(4, 2, 1)),
        voxel_type: Some(VoxelType::U8.into()),
        ..OpenOptions::default()
    };
    let source = open(&[path.to_owned()], &options).unwrap();
    let mut info = source.info().clone();
    describe(&mut info);
    NamedArray {
        name: name.into(),
        path: path.into(),
        source: Box::new(crate::described::Described { info, source, first: 0 }),
    }
}

#[test]
fn places_must_agree_and_may_be_said_once() {
    let (_folder, path) = temp_file("a.raw", &[3; 8]);
    let placed = |name: &str, spacing: f64, origin: f64, unit: &str| {
        described_as(&path, name, |info| {
            info.geometry = Geometry {
                spacing: DVec3::splat(spacing),
                origin: DVec3::splat(origin),
                unit: Some(unit.into()),
                axis_units: None,
            };
            info.calibrated = true;
        })
    };
    let plain = |name: &str| described_as(&path, name, |_| ());
    let joined = channels_of(vec![plain("a"), placed("b", 0.5, 2.0, "meter"), plain("c")]).unwrap();
    let info = joined.info();
    assert!(info.calibrated);
    assert_eq!((info.geometry.spacing.x, info.geometry.origin.x), (0.5, 2.0));
    let notes: Vec<&str> = info.notes.iter().map(|note| &**note).collect();
    assert_eq!(notes.iter().filter(|note| note.contains("takes those of b")).count(), 2, "{notes:?}");
    let refusal = |other| channels_of(vec![placed("a", 0.5, 2.0, "meter"), other]).err().unwrap().to_string();
    assert!(refusal(placed("b", 0.501, 2.0, "meter")).contains("`spacing`"));
    assert!(refusal(placed("b", 0.5, 2.25, "meter")).contains("`origin`"));
    assert!(refusal(placed("b", 0.5, 2.0, "millimeter")).contains("`unit`"));
    let near = placed("b", 0.5 + 1e-9, 2.0 - 1e-9, "meter");
    assert!(channels_of(vec![placed("a", 0.5, 2.0, "meter"), near]).is_ok());
}

/// Coordinates that descend turn their own array, and those that have none.
#[test]
fn arrays_without_a_place_are_turned_as_that_which_gives_it() {
    let (_folder, path) = temp_file("a.raw", &[0, 1, 2, 3, 4, 5, 6, 7]);
    let turned = |name: &str, turned: [bool; 3]| {
        described_as(&path, name, |info| (info.calibrated, info.turned) = (true, turned))
    };
    let parts = || vec![turned("a", [true, true, false]), described_as(&path, "b", |_| ())];
    let joined = channels_of(parts()).unwrap();
    let mut out = [0; 8];
    joined.read_box(0, 1, Extent::new(4, 2, 1).full_box(), &mut out).unwrap();
    assert_eq!(out, [7, 6, 5, 4, 3, 2, 1, 0]);
    assert!(said(&joined.info().notes).contains("b has no voxel size or place of its own"));
    assert!(said(&joined.info().notes).contains("takes those of a, and is turned round as that is"));
    let both = parts().into_iter().chain([turned("c", [false; 3])]).collect();
    assert!(channels_of(both).err().unwrap().to_string().contains("run in unlike orders"));
    let placed = OpenOptions { spacing: Some(DVec3::ONE), ..OpenOptions::default() };
    let message = Channels::new(parts(), &placed).err().unwrap().to_string();
    assert!(message.contains("without `spacing` and `origin`"), "{message}");
}

#[test]
fn one_value_for_no_data_holds_in_all_channels() {
    let (_folder, path) = temp_file("a.raw", &[3; 8]);
    let marked = described_as(&path, "b", |info| info.nodata = Some(3.0));
    let message = channels_of(vec![described_as(&path, "a", |_| ()), marked]).err().unwrap().to_string();
    assert!(message.contains("`nodata`") && message.contains("b is 3") && message.contains("is none"), "{message}");
    let told = OpenOptions { nodata: NoData::Value(7.0), ..OpenOptions::default() };
    let bytes = npy("|u1", "(2, 2, 2)", &[1; 8]);
    assert_eq!(joined(&[bytes.clone(), bytes], &told).unwrap().nodata, Some(7.0));
}

/// Floats of unlike fill values, as in files of reanalyses: each array's own becomes NaN, and no other number.
#[test]
fn unlike_marks_become_nan_in_floats() {
    let floats = |values: [f32; 8]| temp_file("a.raw", &values.map(f32::to_le_bytes).concat());
    let ((_one, a), (_two, b)) =
        (floats([1.0, -9.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]), floats([-9.0, 3.0, f32::NAN, 4.0, 1.0, 1.0, 1.0, 1.0]));
    let part = |name: &str, path: &Path, nodata: Option<f64>, knows_nodata| {
        let options = OpenOptions {
            shape: Some(Extent::new(4, 2, 1)),
            voxel_type: Some(VoxelType::F32.into()),
            ..OpenOptions::default()
        };
        let source = open(&[path.to_owned()], &options).unwrap();
        let info = SourceInfo { nodata, knows_nodata, ..source.info().clone() };
        let source = Box::new(crate::described::Described { info, source, first: 0 });
        NamedArray { name: name.into(), path: path.into(), source }
    };
    for (first, second) in [((Some(-9.0), false), (None, true)), ((Some(-9.0), false), (Some(3.0), false))] {
        let joined = channels_of(vec![part("a", &a, first.0, first.1), part("b", &b, second.0, second.1)]).unwrap();
        assert_eq!(
            (joined.info().voxel_type, joined.info().nodata, joined.info().knows_nodata),
            (VoxelType::F32, None, true)
        );
        let values = |channel| {
            let mut out = [0; 32];
            joined.read_box(0, channel, Extent::new(4, 2, 1).full_box(), &mut out).unwrap();
            (0..4).map(|i| VoxelType::F32.read(&out, i)).collect::<Vec<_>>()
        };
        let found = values(0);
        assert!(found[1].is_nan() && (found[0], found[2], found[3]) == (1.0, 3.0, 4.0), "{found:?}");
        let found = values(1);
        assert_eq!((found[0], found[3]), (-9.0, 4.0), "data there: {found:?}");
        assert!(found[2].is_nan() && found[1].is_nan() == (second.0 == Some(3.0)), "{found:?}");
    }
    // Bytes with a mark of their own become floats beside floats; beside other bytes, by the caller's word.
    let (_folder, path) = temp_file("a.raw", &[3, 0, 1, 2, 4, 5, 6, 7]);
    let bytes = || described_as(&path, "c", |info| info.nodata = Some(3.0));
    let joined = channels_of(vec![bytes(), part("a", &a, Some(-9.0), false)]).unwrap();
    let mut out = [0; 32];
    joined.read_box(0, 0, Extent::new(4, 2, 1).full_box(), &mut out).unwrap();
    assert!(VoxelType::F32.read(&out, 0).is_nan() && VoxelType::F32.read(&out, 1) == 0.0);
    let others = || vec![bytes(), described_as(&path, "d", |_| ())];
    assert!(channels_of(others()).err().unwrap().to_string().contains("NaN with `to_voxel_type` f32"));
    let told = OpenOptions { to_voxel_type: Some(VoxelType::F32), ..OpenOptions::default() };
    assert_eq!(Channels::new(others(), &told).unwrap().info().nodata, None);
    assert!(Channels::new(others(), &OpenOptions { to_voxel_type: Some(VoxelType::U16), ..told }).is_err());
}

#[test]
fn times_and_notes_keep_their_names() {
    let (_folder, path) = temp_file("a.raw", &[3; 8]);
    let axis = |step: f64| Some(brickyard_volume::TimeAxis { step, ..Default::default() });
    let timed = |name: &str, step| {
        described_as(&path, name, |info| {
            info.time = axis(step);
            info.notes.push(Note::warning("odd."));
        })
    };
    let joined = channels_of(vec![described_as(&path, "a", |_| ()), timed("b", 2.0)]).unwrap();
    assert_eq!(joined.info().time, axis(2.0));
    assert!(joined.info().notes.iter().any(|note| &**note == "b: odd." && note.is_warning()));
    // What holds for all is said once, and of nobody.
    let said = |parts| channels_of(parts).map(|joined| said(&joined.info().notes)).unwrap();
    assert_eq!(said(vec![timed("a", 2.0), timed("b", 2.0)]), "warning: odd. ");
    let most = vec![timed("a", 2.0), described_as(&path, "b", |_| ()), timed("c", 2.0)];
    assert_eq!(said(most), "warning: a and 1 more of 3 channels: odd. ");
    let message = channels_of(vec![timed("a", 1.0), timed("b", 2.0)]).err().unwrap().to_string();
    assert!(message.contains("other times") && message.contains("`time_step`"), "{message}");
}

/// An input of its own beside files would not be read.
#[test]
fn inputs_beside_files_are_refused() {
    let (_folder, path) = temp_file("a.npy", &npy("|u1", "(2, 2, 2)", &[1; 8]));
    let options = OpenOptions { channel_arrays: vec![file("a", &path), file("b", &path)], ..OpenOptions::default() };
    assert!(open(&[], &options).is_ok() && open(std::slice::from_ref(&path), &options).is_ok());
    for inputs in [vec![PathBuf::from("other.npy")], vec![path.clone(), path.clone()]] {
        assert!(open(&inputs, &options).err().unwrap().to_string().contains("an input beside channels"));
    }
    let named = ["x", "y"].map(|name| ChannelArray { name: name.into(), place: ArrayPlace::Input(name.into()) });
    let of_input = OpenOptions { channel_arrays: named.to_vec(), ..OpenOptions::default() };
    assert!(open(&[path], &of_input).err().unwrap().to_string().contains("`variable` is for files of several arrays"));
}
