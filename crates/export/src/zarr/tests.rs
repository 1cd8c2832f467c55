//! Folders of every version: voxels and places of all levels against a formula, names and times, labels, and what may be replaced.

use super::*;
use crate::export::{Exported, export};
use crate::request::{ExportChannels, ExportRequest, ExportTime};
use crate::testing::{Function, TestStore, bytes_of, info, value};
use brickyard_import::SourceInfo;
use brickyard_store::{Kind, verify};
use brickyard_volume::{ChannelLook, Extent, Orientation, TimeAxis, VoxelBox, VoxelType};
use glam::{DMat3, DQuat, DVec3, EulerRot};
use std::io::Read;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;

fn try_export(test: &TestStore, name: &str, request: &ExportRequest) -> Result<(PathBuf, Exported), ExportError> {
    let output = test.folder.path().join(name);
    let exported = export(&test.store, &output, request, |_, _| ControlFlow::Continue(()))?;
    Ok((output, exported))
}

/// Exports as a version; returns the folder.
fn exported(test: &TestStore, version: Ngff, request: &ExportRequest) -> PathBuf {
    let request = ExportRequest { ngff: Some(version), overwrite: true, ..request.clone() };
    try_export(test, &format!("{}.zarr", version.name()), &request).unwrap().0
}

fn document(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

/// The metadata of OME-Zarr in a folder of any version.
fn ome(folder: &Path) -> Value {
    match folder.join("zarr.json") {
        root if root.exists() => document(&root)["attributes"]["ome"].clone(),
        _ => document(&folder.join(".zattrs")),
    }
}

fn numbers(value: &Value) -> Vec<f64> {
    serde_json::from_value(value.clone()).unwrap()
}

/// Scale and translation of a level.
fn placement(ome: &Value, level: usize) -> [Vec<f64>; 2] {
    let transforms = &ome["multiscales"][0]["datasets"][level]["coordinateTransformations"];
    let pair = if transforms[0]["type"] == "sequence" { &transforms[0]["transformations"] } else { transforms };
    assert_eq!((&pair[0]["type"], &pair[1]["type"]), (&"scale".into(), &"translation".into()));
    [numbers(&pair[0]["scale"]), numbers(&pair[1]["translation"])]
}

/// An array of Zarr 2, read from its documents alone: its shape, and its voxels in C order.
fn old_array(folder: &Path) -> (Vec<usize>, Vec<u8>) {
    let array = document(&folder.join(".zarray"));
    let sizes = |field: &str| -> Vec<usize> { serde_json::from_value(array[field].clone()).unwrap() };
    let (shape, chunks) = (sizes("shape"), sizes("chunks"));
    let voxel_bytes: usize = array["dtype"].as_str().unwrap()[2..].parse().unwrap();
    let mut voxels = vec![0; shape.iter().product::<usize>() * voxel_bytes];
    let counts: Vec<usize> = shape.iter().zip(&chunks).map(|(n, of)| n.div_ceil(*of)).collect();
    let split = |mut i: usize, sizes: &[usize]| {
        let mut at = vec![0; sizes.len()];
        for (place, size) in at.iter_mut().zip(sizes).rev() {
            (*place, i) = (i % size, i / size);
        }
        at
    };
    for chunk in 0..counts.iter().product() {
        let corner = split(chunk, &counts);
        let mut path = folder.to_path_buf();
        path.extend(corner.iter().map(usize::to_string));
        let Ok(file) = std::fs::File::open(path) else { continue };
        let mut decoded = Vec::new();
        flate2::read::ZlibDecoder::new(file).read_to_end(&mut decoded).unwrap();
        assert_eq!(decoded.len(), chunks.iter().product::<usize>() * voxel_bytes);
        for (i, voxel) in decoded.chunks_exact(voxel_bytes).enumerate() {
            let inner = split(i, &chunks);
            let at: Vec<usize> = (0..shape.len()).map(|a| corner[a] * chunks[a] + inner[a]).collect();
            if at.iter().zip(&shape).all(|(at, n)| at < n) {
                let place = at.iter().zip(&shape).fold(0, |place, (at, n)| place * n + at) * voxel_bytes;
                voxels[place..place + voxel_bytes].copy_from_slice(voxel);
            }
        }
    }
    (shape, voxels)
}

/// A store whose coarser means are known: twice x and y, of cubes.
fn ramp(voxel_type: VoxelType) -> TestStore {
    let mut info = SourceInfo { extent: Extent::new(32, 16, 16), voxel_type, calibrated: true, ..info() };
    info.geometry.spacing = DVec3::splat(0.5);
    info.geometry.origin = DVec3::new(-3.0, 0.25, 100.0);
    info.geometry.unit = Some("micrometer".into());
    TestStore::of_source(Function { info, value: |_, _, [x, y, _]: [u32; 3]| f64::from(2 * (x + y)) }, Kind::Image)
}

#[test]
fn every_level_is_the_mean_of_its_voxels_and_lies_in_their_middle() {
    for voxel_type in VoxelType::ALL {
        let test = ramp(voxel_type);
        let region = VoxelBox::new([8, 0, 0], [32, 16, 16]);
        let request = ExportRequest { region: Some(region), ..ExportRequest::default() };
        let [old, own, new] = Ngff::ALL.map(|version| exported(&test, version, &request));
        let stored = Store::open(&own).unwrap();
        assert_eq!(stored.pyramid().levels().len(), 3);
        for (level, factor) in [(0, 1), (1, 2), (2, 4)] {
            let size = [24 / factor, 16 / factor, 16 / factor];
            let whole = VoxelBox::new([0; 3], size);
            let expected: Vec<u8> = whole
                .voxels()
                .flat_map(|[x, y, _]| {
                    let middle = |first: u32, i: u32| f64::from(first + i * factor) + f64::from(factor - 1) / 2.0;
                    bytes_of(voxel_type, 2.0 * (middle(8, x) + middle(0, y)))
                })
                .collect();
            let mut found = vec![0; expected.len()];
            stored.read_box(0, 0, Level(level), whole, &mut found).unwrap();
            assert!(found == expected, "{voxel_type}, level {level}");
            let (shape, found) = old_array(&old.join(level.to_string()));
            assert_eq!(shape, [size[2], size[1], size[0]].map(|n| n as usize));
            assert!(found == expected, "{voxel_type}, level {level} of 0.4");
            // The voxels of 0.6 are the bytes of 0.5.
            for file in ["zarr.json", "c/0/0/0"].map(|file| format!("{level}/{file}")) {
                assert_eq!(std::fs::read(own.join(&file)).unwrap(), std::fs::read(new.join(&file)).unwrap(), "{file}");
            }
            assert!(!new.join(format!("{level}/.brickyard")).exists());
            let scale = 0.5 * f64::from(factor);
            let half = (scale - 0.5) / 2.0;
            for folder in [&old, &own, &new] {
                let [scales, translations] = placement(&ome(folder), level as usize);
                assert_eq!(scales, [scale; 3]);
                assert_eq!(translations, [100.0 + half, 0.25 + half, 1.0 + half]);
            }
        }
        for (folder, version) in [(&own, "0.5"), (&new, "0.6")] {
            assert_eq!(ome(folder)["version"], version);
        }
        assert_eq!(ome(&old)["multiscales"][0]["version"], "0.4");
        assert_eq!(ome(&old)["multiscales"][0]["axes"][2]["unit"], "micrometer");
        assert_eq!(verify(&own, |_, _| ()).unwrap().problems, []);
    }
}

/// A volume turned in a patient, of unlike spacings.
fn oblique(sign: f64) -> SourceInfo {
    let spacing = DVec3::new(0.5, 0.65, 2.0);
    let turn = DMat3::from_quat(DQuat::from_euler(EulerRot::XYZ, 0.3, -0.7, 2.0));
    let steps = [turn.x_axis * spacing.x, turn.y_axis * spacing.y, turn.z_axis * (spacing.z * sign)];
    let rows = [0, 1, 2].map(|row| [steps[0][row], steps[1][row], steps[2][row], [-70.0, 12.5, 100.0][row]]);
    let mut info = SourceInfo { calibrated: true, orientation: Some(Orientation::new(rows).unwrap()), ..info() };
    info.geometry.spacing = spacing;
    info.geometry.unit = Some("millimeter".into());
    info
}

#[test]
fn an_oblique_box_lies_in_the_patient_where_it_did() {
    for (sign, level) in [(1.0, 0), (-1.0, 0), (1.0, 1)] {
        let info = oblique(sign);
        let test = TestStore::of(SourceInfo { times: 2, ..info.clone() });
        let low = [3, 8, 2];
        let region = Some(VoxelBox::new(low, [18, 10, 9]));
        let time = ExportTime::Steps { first: 0, end: 2, stride: 1 };
        let request = ExportRequest { level: Level(level), region, time, ..ExportRequest::default() };
        let ome = ome(&exported(&test, Ngff::V06, &request));
        let multiscale = &ome["multiscales"][0];
        let systems = multiscale["coordinateSystems"].as_array().unwrap();
        assert_eq!([&systems[0]["name"], &systems[1]["name"]], ["physical", "patient"]);
        assert_eq!(systems[1]["axes"][3]["orientation"]["value"], "left-to-right");
        let transform = &multiscale["coordinateTransformations"][0];
        assert_eq!(
            (&transform["input"]["name"], &transform["output"]["name"]),
            (&"physical".into(), &"patient".into())
        );
        let affine: Vec<Vec<f64>> = serde_json::from_value(transform["affine"].clone()).unwrap();
        let exported_level = |k: usize, voxel: [f64; 3]| {
            let [scale, translation] = placement(&ome, k);
            let [x, y, z] = voxel;
            let index = [1.0, z, y, x];
            let mut physical: Vec<f64> = (0..4).map(|a| index[a] * scale[a] + translation[a]).collect();
            physical.push(1.0);
            let place: Vec<f64> =
                affine.iter().map(|row| row.iter().zip(&physical).map(|(a, b)| a * b).sum()).collect();
            assert_eq!(place[0], 1.0);
            DVec3::new(place[3], place[2], place[1])
        };
        let factor = DVec3::from_array(test.store.pyramid().level(Level(level)).factor.map(f64::from));
        let map = info.orientation.unwrap();
        let low = DVec3::from_array(low.map(f64::from));
        for corner in [[0.0; 3], [14.0, 0.0, 6.0], [14.0, 1.0, 6.0]] {
            let fine = (low + DVec3::from_array(corner)) * factor + (factor - 1.0) * 0.5;
            let expected = map.first_centre() + map.step(0) * fine.x + map.step(1) * fine.y + map.step(2) * fine.z;
            let found = exported_level(0, corner);
            assert!((found - expected).length() < 1e-9, "{found} {expected}");
        }
        // A coarse first voxel is between the fine ones.
        let coarse = exported_level(1, [0.0; 3]);
        let between = [0.0, 1.0].map(|n| {
            exported_level(0, [n, n, if placement(&ome, 1)[0][1] == placement(&ome, 0)[0][1] { 0.0 } else { n }])
        });
        assert!((coarse - (between[0] + between[1]) / 2.0).length() < 1e-9);
    }
}

#[test]
fn chosen_channels_and_steps_keep_names_colours_and_times() {
    let mut volume = SourceInfo { channels: 3, times: 5, calibrated: true, ..info() };
    volume.time = Some(TimeAxis { start: 2.0, step: 0.25, unit: Some("second".into()), ..TimeAxis::default() });
    let look =
        |name: &str, color| ChannelLook { name: Some(name.into()), color: Some(color), ..ChannelLook::default() };
    volume.channel_looks = vec![look("DAPI", [0, 0, 255]), look("GFP", [0, 255, 0]), look("\"<é>", [255, 0, 1])];
    let test = TestStore::of(volume);
    let channels = ExportChannels::Several(vec![2, 0]);
    let time = ExportTime::Steps { first: 1, end: 5, stride: 2 };
    let request = ExportRequest { channels, time, ..ExportRequest::default() };
    for version in Ngff::ALL {
        let folder = exported(&test, version, &request);
        let ome = ome(&folder);
        let [scale, translation] = placement(&ome, 0);
        assert_eq!((&scale[..2], &translation[..2]), (&[0.5, 1.0][..], &[2.25, 0.0][..]));
        let multiscale = &ome["multiscales"][0];
        let axes = multiscale.get("axes").unwrap_or(&multiscale["coordinateSystems"][0]["axes"]);
        let names: Vec<&str> = axes.as_array().unwrap().iter().filter_map(|axis| axis["name"].as_str()).collect();
        assert_eq!((names, &axes[0]["unit"]), (vec!["t", "c", "z", "y", "x"], &"second".into()));
        let said: Vec<_> =
            ome["omero"]["channels"].as_array().unwrap().iter().map(|c| (&c["label"], &c["color"])).collect();
        assert_eq!(said, [(&"\"<é>".into(), &"FF0001".into()), (&"DAPI".into(), &"0000FF".into())]);
        assert!(ome["omero"]["channels"][0]["window"]["end"].is_number());
    }
    let (shape, found) = old_array(&test.folder.path().join("0.4.zarr/0"));
    assert_eq!(shape, [2, 2, 19, 20, 37]);
    let whole = VoxelBox::new([0; 3], [37, 20, 19]);
    let volumes = [(1, 2), (1, 0), (3, 2), (3, 0)];
    let expected: Vec<u8> = volumes
        .into_iter()
        .flat_map(|(t, c)| whole.voxels().flat_map(move |at| bytes_of(VoxelType::U16, value(t, c, at))))
        .collect();
    assert!(found == expected);
}

#[test]
fn labels_are_marked_and_never_mixed() {
    let mut volume = SourceInfo { extent: Extent::new(30, 20, 10), voxel_type: VoxelType::I32, ..info() };
    volume.nodata = None;
    let label = |_, _, [x, y, _]: [u32; 3]| if (x / 7 + y / 7) % 2 == 0 { 0.0 } else { 100_000.0 };
    let test = TestStore::of_source(Function { info: volume, value: label }, Kind::Labels);
    for version in Ngff::ALL {
        let folder = exported(&test, version, &ExportRequest::default());
        let ome = ome(&folder);
        assert!(ome["image-label"].is_object() && ome.get("omero").is_none(), "{ome}");
        assert_eq!(ome["multiscales"][0]["type"], "mode");
        assert!(ome["image-label"].get("colors").is_none());
    }
    for level in ["0", "1", "2"] {
        let (_, voxels) = old_array(&test.folder.path().join("0.4.zarr").join(level));
        let (known, _) = voxels.as_chunks::<4>();
        assert!(known.iter().all(|voxel| [0, 100_000].contains(&i32::from_le_bytes(*voxel))));
        assert!(known.iter().any(|voxel| i32::from_le_bytes(*voxel) > 0));
    }
    assert_eq!(verify(&test.folder.path().join("0.5.zarr"), |_, _| ()).unwrap().problems, []);
    // Colours given by others.
    let root = test.store.path().join("zarr.json");
    let mut edited = document(&root);
    edited["attributes"]["ome"]["image-label"] =
        serde_json::json!({ "colors": [{ "label-value": 100_000, "rgba": [1, 128, 255, 255] }] });
    std::fs::write(&root, edited.to_string()).unwrap();
    let test = TestStore { store: Arc::new(Store::open(test.store.path()).unwrap()), ..test };
    for version in Ngff::ALL {
        let colors = ome(&exported(&test, version, &ExportRequest::default()))["image-label"]["colors"].clone();
        assert_eq!(colors, edited["attributes"]["ome"]["image-label"]["colors"]);
    }
}

#[test]
fn facts_without_a_place_are_told() {
    let mut volume = oblique(1.0);
    volume.channel_looks = vec![ChannelLook { unit: Some("HU".into()), ..ChannelLook::default() }];
    volume.times = 3;
    volume.time = Some(TimeAxis::of_stamps(vec![0.0, 1.0, 5.0], Some("second".into())).unwrap());
    let test = TestStore::of(volume);
    let time = ExportTime::Steps { first: 0, end: 3, stride: 1 };
    for (version, told) in [
        (
            Ngff::V04,
            "OME-Zarr 0.4 cannot keep the orientation, the times of the steps and the unit of values (HU): left out.",
        ),
        (
            Ngff::V05,
            "OME-Zarr 0.5 cannot keep the orientation, the times of the steps and the unit of values (HU): only brickyard reads it there.",
        ),
        (Ngff::V06, "OME-Zarr 0.6 cannot keep the times of the steps and the unit of values (HU): left out."),
    ] {
        let request = ExportRequest { time, ngff: Some(version), ..ExportRequest::default() };
        let (_, Exported { notes, .. }) = try_export(&test, &format!("{}.zarr", version.name()), &request).unwrap();
        assert_eq!(notes[0], told);
        assert_eq!(notes.len(), if version == Ngff::V06 { 2 } else { 3 });
        assert!(notes[1].contains("median"));
    }
    // A store of the default version has them all the same.
    let own = Store::open(test.folder.path().join("0.5.zarr")).unwrap();
    assert_eq!(own.info().orientation, test.store.info().orientation);
    assert_eq!(own.time_axis(), test.store.time_axis());
}

#[test]
fn exports_replace_one_another_but_nothing_else() {
    let test = ramp(VoxelType::U8);
    let again = |name: &str, version, overwrite| {
        try_export(&test, name, &ExportRequest { ngff: Some(version), overwrite, ..ExportRequest::default() })
    };
    for first in Ngff::ALL {
        for second in Ngff::ALL {
            again("a.zarr", first, true).unwrap();
            let error = again("a.zarr", second, false).unwrap_err();
            assert!(matches!(error, ExportError::Exists { .. }), "{error}");
            again("a.zarr/", second, true).unwrap();
            assert_eq!(test.folder.path().join("a.zarr/.zgroup").exists(), second == Ngff::V04);
            let path = test.folder.path().join("a.zarr/labels");
            std::fs::create_dir_all(path.join("l")).unwrap();
            let error = again("a.zarr", first, true).unwrap_err();
            assert!(error.to_string().contains("is not part of the store"), "{error}");
            std::fs::remove_dir_all(path).unwrap();
        }
    }
    let error = again("s.zarr", Ngff::V05, true).unwrap_err();
    assert!(error.to_string().contains("is the exported store itself"), "{error}");
    let error = again("a.npy", Ngff::V04, true).unwrap_err();
    assert!(error.to_string().contains("`ngff` is for names ending in .zarr"), "{error}");
    std::fs::remove_dir_all(test.folder.path().join("a.zarr")).unwrap();
    assert_eq!(std::fs::read_dir(test.folder.path()).unwrap().count(), 1);
}

/// The pack and the chunk files are each half of the work, and count it once.
#[test]
fn progress_goes_to_the_end_once() {
    let test = ramp(VoxelType::U16);
    for ngff in Ngff::ALL.map(Some) {
        let counts = std::sync::Mutex::new(Vec::new());
        let output = test.folder.path().join("a.zarr");
        let request = ExportRequest { ngff, overwrite: true, ..ExportRequest::default() };
        let watch = |done, total| {
            counts.lock().unwrap().push((done, total));
            ControlFlow::Continue(())
        };
        export(&test.store, &output, &request, watch).unwrap();
        let counts = counts.into_inner().unwrap();
        assert!(counts.iter().all(|(done, total)| done <= total && *total == 32 * 16 * 16 * 2), "{counts:?}");
        assert_eq!(counts.last().unwrap().0, 32 * 16 * 16 * 2);
    }
}

/// Cancelled among the chunk files, nothing is left.
#[test]
fn a_late_cancellation_leaves_nothing() {
    let test = ramp(VoxelType::U16);
    let watch = |done: u64, total: u64| match done * 4 > total * 3 {
        true => ControlFlow::Break(()),
        false => ControlFlow::Continue(()),
    };
    let request = ExportRequest { ngff: Some(Ngff::V04), ..ExportRequest::default() };
    let error = export(&test.store, &test.folder.path().join("a.zarr"), &request, watch).unwrap_err();
    assert!(matches!(error, ExportError::Cancelled { .. }), "{error}");
    assert_eq!(std::fs::read_dir(test.folder.path()).unwrap().count(), 1);
}
