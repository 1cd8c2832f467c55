//! Stores of OME-Zarr 0.6 beside those of 0.5: packed, changed by every command, upgraded, and upgrades stopped at every
//! change. The oracle is the same work in 0.5, and then an upgrade, byte for byte.

use super::*;
use crate::append::{AppendOptions, Appender};
use crate::downsample::Downsample;
use crate::edit::{Edit, edit};
use crate::kind::Kind;
use crate::layout::JOURNAL_NAME;
use crate::pack::tests::trial::Trial;
use crate::pack::tests::{Array, assert_same, files, mean_and_max, options, value};
use crate::pack::{Exists, PackOptions, pack, pack_on, rehearse};
use crate::repair::repair;
use crate::verify::verify;
use brickyard_volume::{Orientation, TimeAxis, VoxelType};
use glam::DVec3;
use std::ops::ControlFlow;

const EXTENT: [u32; 3] = [40, 33, 20];

fn turned() -> Orientation {
    Orientation::new([[0.0, -0.5, 0.0, 10.0], [0.25, 0.0, 0.0, -4.0], [0.0, 0.0, 2.0, 3.0]]).unwrap()
}

fn series(times: u32, channels: u32) -> Array<u8> {
    let mut array = Array::series(EXTENT, times, channels, |i, p| (value(p) as u32 + i) as u8);
    array.info.geometry.spacing = DVec3::new(0.1, 1.0 / 3.0, 2.0);
    array.info.geometry.origin = DVec3::new(-7.3, 0.1, 1e6);
    array.info.geometry.unit = Some("micrometer".into());
    array.info.calibrated = true;
    array.info.orientation = Some(turned());
    array.info.time = (times > 1).then(|| TimeAxis { step: 0.1, unit: Some("second".into()), ..TimeAxis::default() });
    array
}

fn in_0_6() -> PackOptions {
    PackOptions { ngff: Some(Ngff::V06), aprons: 1, downsample: mean_and_max(), ..options(VoxelType::U8) }
}

fn in_0_5() -> PackOptions {
    PackOptions { ngff: None, ..in_0_6() }
}

fn of_labels() -> PackOptions {
    PackOptions { kind: Kind::Labels, downsample: Downsample::Mode.into(), ..options(VoxelType::U8) }
}

fn document(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path.join("zarr.json")).unwrap()).unwrap()
}

fn write(path: &Path, document: &Value) {
    std::fs::create_dir_all(path).unwrap();
    std::fs::write(path.join("zarr.json"), document_bytes(document)).unwrap();
}

fn is_sound(path: &Path, ngff: Ngff) {
    let report = verify(path, |_, _| {}).unwrap();
    assert_eq!((report.problems, report.edits), (vec![], vec![]), "{}", path.display());
    assert_eq!(Store::open(path).unwrap().ngff(), Some(ngff));
    assert_eq!(document(path)["attributes"]["ome"]["version"], ngff.name());
}

/// An image of a version with two stores of labels, and one of another program.
fn image_in(dir: &Path, ngff: Ngff) -> PathBuf {
    let image = dir.join("image.zarr");
    pack(&series(1, 1), &image, &PackOptions { ngff: Some(ngff), ..in_0_6() }, &()).unwrap();
    for name in ["cells", "nuclei"] {
        pack(&series(1, 1), &image.join("labels").join(name), &of_labels(), &()).unwrap();
    }
    let axes = json!([{ "name": "y", "type": "space" }, { "name": "x", "type": "space" }]);
    let datasets = json!([{ "path": "s0", "coordinateTransformations": [{ "type": "scale", "scale": [2, 0.1] }] }]);
    let theirs =
        json!({ "version": "0.5", "image-label": {}, "multiscales": [{ "axes": axes, "datasets": datasets }] });
    let theirs = json!({ "zarr_format": 3, "node_type": "group", "attributes": { "ome": theirs, "other": 1 } });
    write(&image.join("labels/theirs"), &crate::ngff::in_version(Path::new("t"), &theirs, ngff).unwrap());
    image
}

#[test]
fn a_pack_in_0_6_is_a_pack_in_0_5_and_an_upgrade() {
    for (source, labels) in [(series(1, 1), false), (series(3, 2), false), (series(1, 1), true)] {
        let dir = tempfile::tempdir().unwrap();
        let [new, old] = ["new.zarr", "old.zarr"].map(|name| dir.path().join(name));
        let kind = |options: PackOptions| match labels {
            true => PackOptions { ngff: options.ngff, ..of_labels() },
            false => options,
        };
        pack(&source, &new, &kind(in_0_6()), &()).unwrap();
        pack(&source, &old, &kind(in_0_5()), &()).unwrap();
        let (of_new, of_old) = (files(&new), files(&old));
        is_sound(&new, Ngff::V06);
        is_sound(&old, Ngff::V05);
        let [of_new_store, of_old_store] = [&new, &old].map(|path| Store::open(path).unwrap());
        assert_eq!(of_new_store.info(), of_old_store.info());
        assert_eq!(of_new_store.geometry(), of_old_store.geometry());
        assert_eq!(of_new_store.placement().rows(), of_old_store.placement().rows());
        assert_eq!(of_new_store.time_axis(), of_old_store.time_axis());
        let said = rehearse_upgrade(&old, Ngff::V06).unwrap();
        assert_same(&files(&old), &of_old, "rehearsed");
        let report = upgrade(&old, Ngff::V06).unwrap();
        assert_eq!(report, said);
        assert_eq!(report.changed, [old.join("zarr.json")]);
        assert_same(&files(&old), &of_new, "upgraded");
        assert_eq!(upgrade(&old, Ngff::V06).unwrap().changed, [] as [PathBuf; 0], "again");
        upgrade(&new, Ngff::V05).unwrap();
        assert_same(&files(&new), &of_old, "and back");
    }
}

/// Each way to change a store, in 0.6 and in 0.5 with an upgrade after it.
#[test]
fn stores_of_0_6_take_every_change_and_keep_their_version() {
    let append = |path: &Path| {
        let mut appender = Appender::open(path, AppendOptions { memory_bytes: 1 << 30, threads: 2 }).unwrap();
        for step in 0..2 {
            let mut array = series(1, 2);
            array.info.identity = format!("step {step}");
            appender.append(&array, None, &()).unwrap();
        }
    };
    let place = |path: &Path| {
        let spacing = Some(DVec3::new(0.7, 0.3, 1.5));
        edit(path, &Edit { spacing, unit: Some("mm".into()), name: Some("head".into()), ..Edit::default() }).unwrap();
    };
    let orientation = |path: &Path| {
        let orientation = Orientation::new([[1.0, 0.5, 0.0, 1.0], [0.0, 1.0, 0.0, 2.0], [0.0, 0.0, 1.0, 3.0]]);
        edit(path, &Edit { orientation: Some(orientation.unwrap()), ..Edit::default() }).unwrap();
    };
    let levels = |path: &Path| {
        edit(path, &Edit { kind: Some(Kind::Labels), ..Edit::default() }).unwrap();
    };
    let mend = |path: &Path| {
        for name in ["0/zarr.json", "1/c/0/0/0/0/0", "0/.brickyard/ranges/zarr.json"] {
            std::fs::write(path.join(name), "damaged").unwrap();
        }
        let report = repair(path, &series(3, 2), 1 << 30, 2, |_, _| ControlFlow::Continue(())).unwrap();
        assert!(report.left.is_empty() && report.repaired.len() >= 3, "{report:?}");
    };
    let replace = |path: &Path| {
        pack(&series(2, 1), path, &PackOptions { exists: Exists::Overwrite, ..in_0_5() }, &()).unwrap();
    };
    let resume = |path: &Path| {
        let report = pack(&series(3, 2), path, &PackOptions { exists: Exists::Resume, ..in_0_5() }, &()).unwrap();
        assert!(report.was_complete);
    };
    type Change<'a> = (&'a str, &'a dyn Fn(&Path));
    let changes: [Change<'_>; 7] = [
        ("append", &append),
        ("spacing", &place),
        ("orientation", &orientation),
        ("labels", &levels),
        ("repair", &mend),
        ("overwrite", &replace),
        ("resume", &resume),
    ];
    for (what, change) in changes {
        let dir = tempfile::tempdir().unwrap();
        let [new, old] = [("new.zarr", in_0_6()), ("old.zarr", in_0_5())].map(|(name, options)| {
            let path = dir.path().join(name);
            pack(&series(3, 2), &path, &options, &()).unwrap();
            change(&path);
            path
        });
        is_sound(&new, Ngff::V06);
        upgrade(&old, Ngff::V06).unwrap();
        assert_same(&files(&new), &files(&old), what);
    }
}

#[test]
fn what_others_added_to_0_6_stays() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.zarr");
    pack(&series(3, 2), &path, &in_0_6(), &()).unwrap();
    let mut root = document(&path);
    let theirs = json!({ "name": "theirs", "axes": [], "note": 1 });
    let to_theirs = json!({ "type": "identity", "input": { "name": "physical" }, "output": { "name": "theirs" } });
    let multiscale = &mut root["attributes"]["ome"]["multiscales"][0];
    multiscale["coordinateSystems"].as_array_mut().unwrap().push(theirs.clone());
    multiscale["coordinateTransformations"].as_array_mut().unwrap().push(to_theirs.clone());
    multiscale["datasets"][1]["coordinateTransformations"][0]["name"] = json!("half");
    write(&path, &root);
    is_sound(&path, Ngff::V06);
    edit(&path, &Edit { spacing: Some(DVec3::ONE), ..Edit::default() }).unwrap();
    let mut appender = Appender::open(&path, AppendOptions { memory_bytes: 1 << 30, threads: 2 }).unwrap();
    let mut step = series(1, 2);
    step.info.calibrated = false;
    (step.info.geometry, step.info.orientation) = (Default::default(), None);
    appender.append(&step, None, &()).unwrap();
    drop(appender);
    upgrade(&path, Ngff::V05).unwrap();
    is_sound(&path, Ngff::V05);
    upgrade(&path, Ngff::V06).unwrap();
    is_sound(&path, Ngff::V06);
    let root = document(&path);
    let multiscale = &root["attributes"]["ome"]["multiscales"][0];
    assert_eq!(multiscale["coordinateSystems"][2], theirs);
    assert_eq!(multiscale["coordinateTransformations"][1], to_theirs);
    assert_eq!(multiscale["datasets"][1]["coordinateTransformations"][0]["name"], "half");
}

#[test]
fn a_changed_place_in_the_patient_is_reported_and_not_lost() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.zarr");
    pack(&series(1, 1), &path, &in_0_6(), &()).unwrap();
    let mut root = document(&path);
    root["attributes"]["ome"]["multiscales"][0]["coordinateTransformations"][0]["affine"][1][1] = json!(7.5);
    write(&path, &root);
    let problems = verify(&path, |_, _| {}).unwrap().problems;
    assert!(problems.len() == 1 && problems[0].what.contains("'patient'"), "{problems:?}");
    let error = upgrade(&path, Ngff::V05).unwrap_err();
    assert!(matches!(&error, UpgradeError::Altered { .. }) && error.to_string().contains("7.5"), "{error}");
    let error = edit(&path, &Edit { name: Some("head".into()), ..Edit::default() }).unwrap_err();
    assert!(matches!(error, crate::edit::EditError::Altered { .. }), "{error}");
}

#[test]
fn an_image_and_its_labels_have_one_version() {
    let dir = tempfile::tempdir().unwrap();
    let dirs = [Ngff::V05, Ngff::V06].map(|ngff| {
        let place = dir.path().join(ngff.name());
        std::fs::create_dir(&place).unwrap();
        image_in(&place, ngff)
    });
    let [old, new] = &dirs;
    for (image, ngff) in [(old, Ngff::V05), (new, Ngff::V06)] {
        for place in [image.clone(), image.join("labels/cells"), image.join("labels/nuclei")] {
            is_sound(&place, ngff);
        }
        let list = document(&image.join("labels"));
        assert_eq!(list["attributes"]["ome"], json!({ "version": ngff.name(), "labels": ["cells", "nuclei"] }));
        assert_eq!(Store::open(image).unwrap().label_names().unwrap(), ["cells", "nuclei"]);
        let other = if ngff == Ngff::V05 { Ngff::V06 } else { Ngff::V05 };
        let asked = PackOptions { ngff: Some(other), ..of_labels() };
        let more = image.join("labels/more");
        for error in [
            pack(&series(1, 1), &more, &asked, &()).map(drop).unwrap_err(),
            rehearse(&series(1, 1), &more, &asked, &()).map(drop).unwrap_err(),
        ] {
            let message = error.to_string();
            assert!(matches!(error, PackError::Labels { .. }) && message.contains(ngff.name()), "{message}");
        }
        assert!(!more.exists());
        let label = image.join("labels/cells");
        for error in [upgrade(&label, other).unwrap_err(), rehearse_upgrade(&label, other).unwrap_err()] {
            assert!(matches!(error, UpgradeError::Pack(PackError::Labels { .. })), "{error}");
        }
        assert_eq!(upgrade(&label, ngff).unwrap().changed, [] as [PathBuf; 0]);
    }
    let [of_old, of_new] = dirs.clone().map(|image| files(&image));
    let report = upgrade(old, Ngff::V06).unwrap();
    let names = ["labels/cells", "labels/nuclei", "labels/theirs", "labels", ""];
    assert_eq!(report.changed, names.map(|name| old.join(name).join("zarr.json")));
    assert_same(&files(old), &of_new, "upgraded");
    upgrade(new, Ngff::V05).unwrap();
    assert_same(&files(new), &of_old, "and back");
}

/// In each moment of an upgrade every document is a whole one of either version, and the next upgrade finishes it.
#[test]
fn an_upgrade_stopped_at_any_change_is_finished_by_the_next() {
    let dir = tempfile::tempdir().unwrap();
    let image = image_in(dir.path(), Ngff::V05);
    let old = files(&image);
    upgrade(&image, Ngff::V06).unwrap();
    let new = files(&image);
    let (mut partly, mut unchanged) = (0, 0);
    for syncs_each in [false, true] {
        for changes in 0.. {
            upgrade(&image, Ngff::V05).unwrap();
            assert_same(&files(&image), &old, "before");
            let fuse = Some(changes.into());
            let stopped = upgrade_on(&Trial { fuse, syncs_each, ..Trial::default() }.disk(), &image, Ngff::V06);
            let mut found = files(&image);
            found.retain(|path, _| path.extension().is_none_or(|extension| extension != "tmp"));
            let versions: Vec<bool> = found
                .iter()
                .filter(|(path, bytes)| old[*path] != **bytes)
                .map(|(path, bytes)| new[path] == *bytes)
                .collect();
            assert!(!versions.contains(&false), "{changes}: each document is whole");
            let is_new = found[Path::new("zarr.json")] == new[Path::new("zarr.json")];
            match stopped {
                Ok(_) => {
                    assert_same(&files(&image), &new, "done");
                    break;
                }
                Err(UpgradeError::Unsynced { .. }) => assert_same(&found, &new, "not synced"),
                Err(UpgradeError::Partly { .. }) => {
                    partly += 1;
                    assert!(!versions.is_empty() && !is_new, "{changes}: the image is the last");
                }
                Err(error) => {
                    unchanged += 1;
                    assert!(versions.is_empty(), "{changes}: {error}");
                }
            }
            for label in ["", "labels/cells", "labels/nuclei"] {
                assert_eq!(verify(&image.join(label), |_, _| {}).unwrap().problems, [], "{changes}");
            }
            let others: Vec<_> = files(&image).into_keys().filter(|path| !new.contains_key(path)).collect();
            assert!(others.iter().all(|path| path.ends_with("zarr.json.tmp")), "{changes}: {others:?}");
            upgrade(&image, Ngff::V06).unwrap();
            let mut again = files(&image);
            again.retain(|path, _| path.extension().is_none_or(|extension| extension != "tmp"));
            assert_same(&again, &new, "finished");
        }
        // Left-overs of the last round.
        for path in files(&image).into_keys().filter(|path| !new.contains_key(path)) {
            std::fs::remove_file(image.join(path)).unwrap();
        }
    }
    assert!(partly >= 4 && unchanged >= 10, "{partly} {unchanged}");
}

#[test]
fn upgrades_that_cannot_be_are_refused_before_any_change() {
    let dir = tempfile::tempdir().unwrap();
    let image = image_in(dir.path(), Ngff::V05);
    let before = files(&image);
    let refused = |words: &str| {
        for error in [upgrade(&image, Ngff::V06).unwrap_err(), rehearse_upgrade(&image, Ngff::V06).unwrap_err()] {
            assert!(error.to_string().contains(words), "{words}: {error}");
        }
    };
    let theirs = image.join("labels/theirs");
    let sound = document(&theirs);
    for (pointer, value, words) in [
        ("/attributes/ome/version", json!("0.9"), "attributes.ome.version"),
        ("/attributes/ome/multiscales/0/datasets/0/coordinateTransformations/0/type", json!("affine"), "datasets[0]"),
    ] {
        let mut bad = sound.clone();
        *bad.pointer_mut(pointer).unwrap() = value;
        write(&theirs, &bad);
        refused(words);
    }
    write(&theirs, &sound);
    let link = image.join("labels/link");
    std::os::unix::fs::symlink(&theirs, &link).unwrap();
    refused("symbolic link");
    std::fs::remove_file(&link).unwrap();
    for place in [image.clone(), image.join("labels/cells")] {
        let lock = DirLock::take(&Disk::default(), &place).unwrap();
        lock.declare(&Disk::default()).unwrap();
        refused("another process");
        drop(lock);
        std::fs::write(place.join(JOURNAL_NAME), "{}").unwrap();
        refused("unfinished pack");
        std::fs::remove_file(place.join(JOURNAL_NAME)).unwrap();
    }
    assert_same(&files(&image), &before, "refused");
    let error = upgrade(&dir.path().join("none.zarr"), Ngff::V06).unwrap_err();
    assert!(matches!(error, UpgradeError::Open(_)), "{error}");
    assert!(!dir.path().join("none.zarr").exists());
}

#[test]
fn an_interrupted_pack_keeps_its_version() {
    let dir = tempfile::tempdir().unwrap();
    let [path, whole] = ["s.zarr", "whole.zarr"].map(|name| dir.path().join(name));
    pack(&series(1, 1), &whole, &in_0_6(), &()).unwrap();
    let stop = |options: &PackOptions| {
        pack_on(&Trial::disk_of(12), &series(1, 1), &path, options, &()).unwrap_err();
        assert!(path.join(JOURNAL_NAME).exists(), "something is to be resumed");
    };
    let resume = |ngff| pack(&series(1, 1), &path, &PackOptions { exists: Exists::Resume, ngff, ..in_0_6() }, &());
    for asked in [None, Some(Ngff::V06)] {
        stop(&in_0_6());
        let error = resume(Some(Ngff::V05)).unwrap_err();
        assert!(matches!(&error, PackError::Mismatch { .. }) && error.to_string().contains("ngff"), "{error}");
        resume(asked).unwrap();
        assert_same(&files(&path), &files(&whole), "resumed");
        let error = resume(Some(Ngff::V05)).unwrap_err();
        assert!(matches!(&error, PackError::Mismatch { .. }) && error.to_string().contains("upgrade"), "{error}");
        std::fs::remove_dir_all(&path).unwrap();
    }
}

#[test]
fn copies_of_the_documents_are_changed_too() {
    let dir = tempfile::tempdir().unwrap();
    let image = image_in(dir.path(), Ngff::V05);
    let names = ["labels", "labels/cells", "labels/theirs", "0"];
    let gather = || {
        let copies: Value = names
            .iter()
            .map(|name| (name.to_string(), document(&image.join(name))))
            .collect::<serde_json::Map<_, _>>()
            .into();
        let mut root = document(&image);
        root["consolidated_metadata"] = json!({ "kind": "inline", "must_understand": false, "metadata": copies });
        root
    };
    write(&image, &gather());
    let before = files(&image);
    let group = json!({ "zarr_format": 3, "node_type": "group", "attributes": {},
        "consolidated_metadata": { "metadata": { "image.zarr": document(&image) } } });
    write(dir.path(), &group);
    let report = upgrade(&image, Ngff::V06).unwrap();
    assert_eq!(report.stale_groups.len(), 1);
    assert_eq!(document(&image), gather());
    upgrade(&image, Ngff::V05).unwrap();
    assert_same(&files(&image), &before, "and back");
}
