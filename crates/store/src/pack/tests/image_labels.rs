//! Labels among those of an image: the list of their names, the image beside it, and refusals.

use super::rehearsal::{Told, tree};
use super::*;
use crate::append::{AppendOptions, Appender};
use crate::edit::{Edit, edit};
use crate::metadata::StoreInfo;
use crate::verify::verify;
use glam::DVec3;

fn numbers() -> Array<u8> {
    let mut array = Array::series([40, 33, 20], 1, 1, |_, [x, y, z]| (x / 8 + y / 8 + z / 8) as u8);
    array.info.geometry.spacing = DVec3::new(1.0, 1.0, 2.0);
    array.info.calibrated = true;
    array
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

fn image_label(path: &Path) -> Value {
    document(path)["attributes"]["ome"]["image-label"].clone()
}

fn listed(image: &Path) -> Value {
    document(&image.join("labels"))["attributes"]["ome"]["labels"].clone()
}

fn is_sound(path: &Path) {
    let report = verify(path, |_, _| {}).unwrap();
    assert_eq!((report.problems, report.edits), (vec![], vec![]));
}

/// An image of the labels' shape and place.
fn image_in(dir: &Path) -> PathBuf {
    let image = dir.join("image.zarr");
    pack(&numbers(), &image, &options(VoxelType::U8), &()).unwrap();
    image
}

/// Writes a store's root document as older versions did.
fn make_old(path: &Path) {
    let store = Store::open(path).unwrap();
    let info = StoreInfo { image_label: false, ..store.info().clone() };
    write(path, &root_document(store.layout(), store.geometry(), &info));
    is_sound(path);
}

fn of_kind(kind: Kind) -> Edit {
    Edit { kind: Some(kind), ..Edit::default() }
}

#[test]
fn labels_say_so_to_other_programs() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("l.zarr");
    assert!(image_label(&image_in(dir.path())).is_null());
    pack(&numbers(), &path, &of_labels(), &()).unwrap();
    assert_eq!(image_label(&path), json!({}), "no image, no colours");
    is_sound(&path);
    edit(&path, &of_kind(Kind::Image)).unwrap();
    assert!(image_label(&path).is_null());
    is_sound(&path);
}

#[test]
fn older_labels_open_and_are_told_by_an_edit() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("l.zarr");
    pack(&numbers(), &path, &of_labels(), &()).unwrap();
    let new = files(&path);
    make_old(&path);
    assert!(image_label(&path).is_null());
    assert_eq!(Store::open(&path).unwrap().info().kind, Kind::Labels);
    edit(&path, &Edit { name: Some("cells".into()), ..Edit::default() }).unwrap();
    assert!(image_label(&path).is_null(), "not asked for");
    make_old(&path);
    let report = edit(&path, &of_kind(Kind::Labels)).unwrap();
    assert_eq!(report.changes[0].to_string(), "image-label: false -> true");
    assert!(matches!(edit(&path, &of_kind(Kind::Labels)), Err(crate::edit::EditError::Nothing { .. })));
    is_sound(&path);
    // Colours of another program were there before.
    make_old(&path);
    let mut root = document(&path);
    let colors = json!([{ "label-value": 3, "rgba": [255, 0, 0, 255] }]);
    root["attributes"]["ome"]["image-label"] = json!({ "colors": colors });
    write(&path, &root);
    edit(&path, &of_kind(Kind::Labels)).unwrap();
    assert_eq!(image_label(&path), json!({ "colors": colors }));
    assert_eq!(Store::open(&path).unwrap().label_colors().len(), 1);
    is_sound(&path);
    assert_eq!(new.len(), files(&path).len());
}

#[test]
fn labels_packed_into_an_image_are_listed_there() {
    let dir = tempfile::tempdir().unwrap();
    let image = image_in(dir.path());
    let before = files(&image);
    let [cells, nuclei] = ["cells", "nuclei"].map(|name| image.join("labels").join(name));
    pack(&numbers(), &nuclei, &of_labels(), &()).unwrap();
    let group = json!({
        "zarr_format": 3, "node_type": "group", "attributes": { "ome": { "version": "0.5", "labels": ["nuclei"] } }
    });
    assert_eq!(document(&image.join("labels")), group);
    assert_eq!(image_label(&nuclei), json!({ "source": { "image": "../../" } }));
    // What others list and say stays.
    let mut theirs = group.clone();
    theirs["attributes"]["ome"]["labels"] = json!(["theirs", "nuclei"]);
    theirs["attributes"]["mine"] = json!(7);
    write(&image.join("labels"), &theirs);
    pack(&numbers(), &cells, &of_labels(), &()).unwrap();
    theirs["attributes"]["ome"]["labels"] = json!(["theirs", "nuclei", "cells"]);
    assert_eq!(document(&image.join("labels")), theirs);
    // Once, also of a store that replaces a listed one.
    let other = PackOptions { exists: Exists::Overwrite, edge: 8, shard_edge: 16, ..of_labels() };
    pack(&numbers(), &nuclei, &other, &()).unwrap();
    assert_eq!(document(&image.join("labels")), theirs);
    for path in [&image, &cells, &nuclei] {
        is_sound(path);
        assert_eq!(Store::open(path).unwrap().path(), path);
    }
    assert_eq!(Store::open(&image).unwrap().label_names().unwrap(), ["theirs", "nuclei", "cells"]);
    assert_eq!(Store::open(&nuclei).unwrap().label_names().unwrap(), [""; 0]);
    // The image is edited, and nothing else of it changes; a pack never deletes its labels.
    let name = Edit { name: Some("head".into()), ..Edit::default() };
    edit(&image, &name).unwrap();
    edit(&nuclei, &name).unwrap();
    is_sound(&nuclei);
    let all = tree(&image);
    for exists in [Exists::Overwrite, Exists::Resume] {
        let again = PackOptions { exists, edge: 8, shard_edge: 16, ..options(VoxelType::U8) };
        let error = pack(&numbers(), &image, &again, &()).unwrap_err();
        let is_right = match exists {
            Exists::Overwrite => {
                matches!(&error, PackError::Foreign { found, .. } if found.starts_with(image.join("labels")))
            }
            _ => matches!(&error, PackError::Mismatch { .. }),
        };
        assert!(is_right, "{error}");
    }
    assert_eq!(tree(&image), all);
    let own =
        files(&image).into_iter().filter(|(name, _)| !name.starts_with("labels") && name != Path::new("zarr.json"));
    assert!(own.eq(before.into_iter().filter(|(name, _)| name != Path::new("zarr.json"))));
}

#[test]
fn steps_are_appended_to_an_image_and_its_labels() {
    let dir = tempfile::tempdir().unwrap();
    let image = dir.path().join("image.zarr");
    let labels = image.join("labels/l");
    let resources = AppendOptions { memory_bytes: 1 << 30, threads: 2 };
    Appender::create(&image, &numbers(), Some(0.0), &options(VoxelType::U8), &()).unwrap();
    Appender::create(&labels, &numbers(), Some(0.0), &of_labels(), &()).unwrap();
    assert_eq!(listed(&image), json!(["l"]));
    for path in [&image, &labels] {
        Appender::open(path, resources).unwrap().append(&numbers(), None, &()).unwrap();
        is_sound(path);
        assert_eq!(Store::open(path).unwrap().times(), 2);
    }
    assert_eq!(image_label(&labels), json!({ "source": { "image": "../../" } }));
}

#[test]
fn what_cannot_be_listed_is_refused_before_anything_is_made() {
    let dir = tempfile::tempdir().unwrap();
    let image = image_in(dir.path());
    let path = image.join("labels/l");
    let refusal = |path: &Path, options: &PackOptions| {
        let before = tree(dir.path());
        let error = rehearse(&numbers(), path, options, &()).unwrap_err().to_string();
        assert_eq!(pack(&numbers(), path, options, &()).unwrap_err().to_string(), error);
        assert_eq!(tree(dir.path()), before);
        error
    };
    let message = refusal(&path, &options(VoxelType::U8));
    assert!(message.contains("labels/l: lies among the labels of") && message.contains("`kind` labels"), "{message}");
    for (name, list, words) in [
        ("no group", json!({ "zarr_format": 3, "node_type": "array", "attributes": {} }), "node_type"),
        ("no object", json!({ "zarr_format": 3, "node_type": "group", "attributes": [] }), "attributes"),
        (
            "no list",
            json!({ "zarr_format": 3, "node_type": "group", "attributes": { "ome": { "labels": "l" } } }),
            "attributes.ome.labels",
        ),
        (
            "no names",
            json!({ "zarr_format": 3, "node_type": "group", "attributes": { "ome": { "labels": [1] } } }),
            "labels",
        ),
        ("no ome", json!({ "zarr_format": 3, "node_type": "group", "attributes": { "ome": 3 } }), "attributes.ome"),
    ] {
        write(&image.join("labels"), &list);
        let message = refusal(&path, &of_labels());
        assert!(message.contains("cannot be listed") && message.contains(words), "{name}: {message}");
    }
    std::fs::remove_dir_all(image.join("labels")).unwrap();
    // Labels have no labels, nor is any other place in a store free.
    pack(&numbers(), &path, &of_labels(), &()).unwrap();
    for inner in ["labels/l/labels/m", "labels/l/m", "labels/a/b", "other/l"] {
        assert!(refusal(&image.join(inner), &of_labels()).contains("lies inside the store"), "{inner}");
    }
    make_old(&path);
    assert!(refusal(&path.join("labels/m"), &of_labels()).contains("lies inside the store"));
}

#[test]
fn a_stopped_pack_lists_nothing_and_is_finished_with_its_name() {
    let dir = tempfile::tempdir().unwrap();
    let image = image_in(dir.path());
    let (labels, path) = (image.join("labels"), image.join("labels/l"));
    pack(&numbers(), &path, &of_labels(), &()).unwrap();
    let whole = files(&labels);
    let resume = PackOptions { exists: Exists::Resume, ..of_labels() };
    let (mut stopped, mut unlisted, mut is_listed) = (0, 0, false);
    for changes in 0.. {
        std::fs::remove_dir_all(&labels).unwrap();
        let packed = pack_on(&Trial::disk_of(changes), &numbers(), &path, &of_labels(), &());
        is_listed = labels.join("zarr.json").exists();
        let is_whole = Store::open(&path).is_ok();
        assert!(is_whole || !is_listed, "{changes}: listed before it is whole");
        unlisted += u32::from(is_whole && !is_listed);
        if packed.is_ok() {
            break;
        }
        stopped += 1;
        pack(&numbers(), &path, &resume, &()).unwrap();
        assert_eq!(files(&labels), whole, "{changes}");
    }
    assert!(is_listed && stopped > 20 && unlisted > 2, "{stopped} {unlisted}");
    // A store moved there is listed as it is resumed.
    std::fs::remove_file(labels.join("zarr.json")).unwrap();
    assert!(pack(&numbers(), &path, &resume, &()).unwrap().was_complete);
    assert_eq!(files(&labels), whole);
}

/// A folder of labels without any would stand in the way of a new image.
#[test]
fn labels_without_a_shard_leave_no_folder() {
    let dir = tempfile::tempdir().unwrap();
    let image = image_in(dir.path());
    let path = image.join("labels/l");
    let before = tree(dir.path());
    let cancelled = pack(&numbers(), &path, &of_labels(), &CancelledAtOnce).unwrap_err();
    assert!(matches!(cancelled, PackError::Cancelled { done: 0, .. }), "{cancelled}");
    assert!(cancelled.to_string().contains("nothing is left"), "{cancelled}");
    assert_eq!(tree(dir.path()), before);
    let failing = Array { fuse: AtomicI64::new(0), ..numbers() };
    let failed = pack(&failing, &path, &of_labels(), &()).unwrap_err();
    assert!(matches!(failed, PackError::Source { done: 0, .. }), "{failed}");
    assert_eq!(tree(dir.path()), before);
    // Killed between two of its first steps, a pack may leave the empty folder.
    std::fs::create_dir(image.join("labels")).unwrap();
    let overwrite = PackOptions { exists: Exists::Overwrite, ..options(VoxelType::U8) };
    pack(&numbers(), &image, &overwrite, &()).unwrap();
    assert_eq!(tree(dir.path()), before);
}

#[test]
fn an_edit_to_labels_lists_them_and_one_to_an_image_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let image = image_in(dir.path());
    let path = image.join("labels/l");
    let outside = dir.path().join("l.zarr");
    pack(&numbers(), &outside, &of_labels(), &()).unwrap();
    std::fs::create_dir(image.join("labels")).unwrap();
    std::fs::rename(&outside, &path).unwrap();
    let report = edit(&path, &of_kind(Kind::Labels)).unwrap();
    let fields: Vec<_> = report.changes.iter().map(|change| change.field.clone()).collect();
    assert!(fields[0].starts_with("listed in") && fields[1] == "image-label source", "{fields:?}");
    assert_eq!(listed(&image), json!(["l"]));
    assert_eq!(image_label(&path), json!({ "source": { "image": "../../" } }));
    is_sound(&path);
    assert!(matches!(edit(&path, &of_kind(Kind::Labels)), Err(crate::edit::EditError::Nothing { .. })));
    let message = edit(&path, &of_kind(Kind::Image)).unwrap_err().to_string();
    assert!(message.contains("lies among the labels of"), "{message}");
}

/// The remarks of a pack, which is not made.
fn remarks(source: &Array<u8>, path: &Path) -> Vec<String> {
    let told = Told::default();
    rehearse(source, path, &of_labels(), &told).unwrap();
    told.notes.into_inner().unwrap()
}

#[test]
fn another_grid_than_the_image_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let path = image_in(dir.path()).join("labels/l");
    assert_eq!(remarks(&numbers(), &path), [""; 0]);
    let mut other = Array::<u8>::series([20, 33, 20], 1, 1, |_, _| 1);
    other.info.geometry = Geometry {
        spacing: DVec3::new(2.0, 1.0, 2.0),
        origin: DVec3::new(0.5, 0.0, 0.0),
        unit: Some("millimeter".into()),
        axis_units: None,
    };
    let found = remarks(&other, &path);
    for words in [
        "voxels 20 x 33 x 20, and the image 40 x 33 x 20",
        "spacing 2 x 1 x 2, and the image 1 x 1 x 2",
        "first voxel centre 0.5 x 0 x 0, and the image 0 x 0 x 0",
        "units millimeter x millimeter x millimeter, and the image none x none x none",
    ] {
        assert!(found.len() == 1 && found[0].contains(words), "{words}: {found:?}");
    }
    let mut turned = numbers();
    let rows = [[0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 2.0, 0.0]];
    turned.info.orientation = Some(Orientation::new(rows).unwrap());
    let found = remarks(&turned, &path);
    assert!(found.len() == 1 && found[0].contains("orientation in a patient"), "{found:?}");
}

#[test]
fn images_of_other_programs_have_labels_if_their_version_is_ours() {
    let dir = tempfile::tempdir().unwrap();
    let (image, path) = (dir.path().join("i.zarr"), dir.path().join("i.zarr/labels/l"));
    let axes = ["t", "z", "y", "x"].map(|name| json!({ "name": name }));
    let scale = |scale: Value| json!({ "type": "scale", "scale": scale });
    let root = |version: &str| {
        // Half as large by the array's own, and twice by that of all levels.
        let dataset = json!({ "path": "s0", "coordinateTransformations": [
            scale(json!([1, 1, 0.5, 0.5])), { "type": "translation", "translation": [0, 0, 4, 0] },
        ] });
        let multiscale = json!({
            "axes": axes, "datasets": [dataset], "coordinateTransformations": [scale(json!([1, 2, 2, 2]))],
        });
        json!({ "zarr_format": 3, "node_type": "group",
            "attributes": { "ome": { "version": version, "multiscales": [multiscale] } } })
    };
    write(&image.join("s0"), &json!({ "shape": [3, 20, 33, 40] }));
    write(&image, &root("0.7"));
    let found = remarks(&numbers(), &path);
    assert!(found.len() == 1 && found[0].contains("is not listed") && found[0].contains("version 0.7"), "{found:?}");
    pack(&numbers(), &path, &of_labels(), &()).unwrap();
    assert!(!image.join("labels/zarr.json").exists() && image_label(&path) == json!({}));
    std::fs::remove_dir_all(image.join("labels")).unwrap();
    write(&image, &root("0.5"));
    let found = remarks(&numbers(), &path);
    assert!(found.len() == 1, "{found:?}");
    let [times, centre] = ["time steps 1, and the image 3", "first voxel centre 0 x 0 x 0, and the image 0 x 8 x 0"]
        .map(|w| found[0].contains(w));
    assert!(times && centre && !found[0].contains("spacing") && !found[0].contains("voxels 40"), "{found:?}");
    pack(&numbers(), &path, &of_labels(), &()).unwrap();
    assert_eq!(listed(&image), json!(["l"]));
    let mut gathered = root("0.5");
    gathered["consolidated_metadata"] = json!({ "metadata": {} });
    write(&image, &gathered);
    let found = remarks(&numbers(), &image.join("labels/m"));
    assert!(found.iter().any(|remark| remark.contains("consolidate it anew")), "{found:?}");
    // No image: an ordinary folder.
    for root in [json!({ "zarr_format": 3 }), json!([])] {
        std::fs::remove_dir_all(&image).unwrap();
        write(&image, &root);
        assert_eq!(remarks(&numbers(), &path), [""; 0]);
        pack(&numbers(), &path, &options(VoxelType::U8), &()).unwrap();
        assert!(!image.join("labels/zarr.json").exists());
    }
}
