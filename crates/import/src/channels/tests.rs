//! Channels joined from arrays made by hand.

use super::*;
use crate::open::open;
use crate::options::{ArrayPlace, ChannelArray, NoData, OpenOptions};
use crate::testing::{Field, assert_boxes, temp_file};
use brickyard_volume::VoxelType;
use glam::DVec3;
use std::path::Path;

/// Options for raw files of a field's volumes.
fn raw(field: Field, channels: u32) -> OpenOptions {
    let [x, y, z, _, t] = field.sizes;
    OpenOptions {
        shape: Some(Extent::new(x, y, z)),
        voxel_type: Some(field.voxel_type),
        times: Some(t),
        channels: Some(channels),
        ..OpenOptions::default()
    }
}

fn file(name: &str, path: &Path) -> ChannelArray {
    ChannelArray { name: name.into(), place: ArrayPlace::File(path.into()) }
}

/// Bytes of a `.npy` file of `values`, in an array of this shape.
fn npy(element: &str, shape: &str, values: &[u8]) -> Vec<u8> {
    let header = format!("{{'descr': '{element}', 'fortran_order': False, 'shape': {shape}, }}");
    [b"\x93NUMPY\x01\x00", &(header.len() as u16).to_le_bytes()[..], header.as_bytes(), values].concat()
}

/// Opens `.npy` files as channels `a`, `b`, ...
fn joined(files: &[Vec<u8>], options: &OpenOptions) -> Result<Box<dyn Source>, String> {
    let folder = tempfile::tempdir().unwrap();
    let arrays = files.iter().zip(["a", "b", "c"]).map(|(bytes, name)| {
        let path = folder.path().join(format!("{name}.npy"));
        std::fs::write(&path, bytes).unwrap();
        file(name, &path)
    });
    open(&[], &OpenOptions { channel_arrays: arrays.collect(), ..options.clone() }).map_err(|error| error.to_string())
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
    let channels = Channels::new(vec![part("p", &one, 1), part("v", &two, 2)]).unwrap();
    assert_boxes(&channels, field);
    let names: Vec<_> = channels.info().channel_looks.iter().map(|look| look.name.clone().unwrap()).collect();
    assert_eq!(names, ["p", "v.0", "v.1"]);
    let other = Channels::new(vec![part("q", &one, 1), part("v", &two, 2)]).unwrap();
    assert_ne!(channels.info().identity, other.info().identity);
    let twice = Channels::new(vec![part("p", &one, 1), part("p", &one, 1)]).err().unwrap().to_string();
    assert!(twice.contains("'p' is named twice"), "{twice}");
    assert!(Channels::new(Vec::new()).is_err());
}

#[test]
fn unlike_arrays_are_refused_by_their_names() {
    let (plain, cube) = (OpenOptions::default(), "(2, 2, 2)");
    let bytes = npy("|u1", cube, &[1; 8]);
    assert_eq!(joined(&[bytes.clone(), bytes.clone()], &plain).unwrap().info().channels, 2);
    let cases: [(Vec<u8>, &[&str]); 3] = [
        (npy("<u2", cube, &[1; 16]), &["b is u16", "a (", "is u8", "astype"]),
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

/// A source of one channel with another description.
fn described_as(path: &Path, name: &str, describe: impl FnOnce(&mut SourceInfo)) -> NamedArray {
    let options =
        OpenOptions { shape: Some(Extent::new(4, 2, 1)), voxel_type: Some(VoxelType::U8), ..OpenOptions::default() };
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
    let joined = Channels::new(vec![plain("a"), placed("b", 0.5, 2.0, "meter"), plain("c")]).unwrap();
    let info = joined.info();
    assert!(info.calibrated);
    assert_eq!((info.geometry.spacing.x, info.geometry.origin.x), (0.5, 2.0));
    let notes: Vec<&str> = info.notes.iter().map(|note| &**note).collect();
    assert_eq!(notes.iter().filter(|note| note.contains("takes those of b")).count(), 2, "{notes:?}");
    let refusal = |other| Channels::new(vec![placed("a", 0.5, 2.0, "meter"), other]).err().unwrap().to_string();
    assert!(refusal(placed("b", 0.501, 2.0, "meter")).contains("`spacing`"));
    assert!(refusal(placed("b", 0.5, 2.25, "meter")).contains("`origin`"));
    assert!(refusal(placed("b", 0.5, 2.0, "millimeter")).contains("`unit`"));
    let near = placed("b", 0.5 + 1e-9, 2.0 - 1e-9, "meter");
    assert!(Channels::new(vec![placed("a", 0.5, 2.0, "meter"), near]).is_ok());
}

#[test]
fn one_value_for_no_data_holds_in_all_channels() {
    let (_folder, path) = temp_file("a.raw", &[3; 8]);
    let marked = described_as(&path, "b", |info| info.nodata = Some(3.0));
    let message = Channels::new(vec![described_as(&path, "a", |_| ()), marked]).err().unwrap().to_string();
    assert!(message.contains("`nodata`") && message.contains("b is 3") && message.contains("is none"), "{message}");
    let told = OpenOptions { nodata: NoData::Value(7.0), ..OpenOptions::default() };
    let bytes = npy("|u1", "(2, 2, 2)", &[1; 8]);
    assert_eq!(joined(&[bytes.clone(), bytes], &told).unwrap().info().nodata, Some(7.0));
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
    let joined = Channels::new(vec![described_as(&path, "a", |_| ()), timed("b", 2.0)]).unwrap();
    assert_eq!(joined.info().time, axis(2.0));
    assert!(joined.info().notes.iter().any(|note| &**note == "b: odd." && note.is_warning()));
    let message = Channels::new(vec![timed("a", 1.0), timed("b", 2.0)]).err().unwrap().to_string();
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
