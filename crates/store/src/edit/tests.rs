//! Edited stores against packed ones, edits stopped at every change, and refusals.

use super::*;
use crate::append::{AppendOptions, Appender};
use crate::layout::JOURNAL_NAME;
use crate::metadata::{Kind, document_bytes};
use crate::pack::tests::CancelledAtOnce;
use crate::pack::tests::trial::Trial;
use crate::pack::tests::{Array, files, mean_and_max, options, value};
use crate::pack::{PackOptions, pack};
use crate::remake::RemakeError;
use crate::verify::verify;
use brickyard_volume::{Geometry, Level, TimeAxis, VoxelType};

const EXTENT: [u32; 3] = [40, 33, 20];

fn source(times: u32, channels: u32) -> Array<u8> {
    let mut array = Array::series(EXTENT, times, channels, |i, p| (value(p) as u32 + i) as u8);
    array.info.geometry.spacing = DVec3::new(1.0, 1.0, 2.0);
    array.info.calibrated = true;
    array
}

fn packed(dir: &Path, source: &Array<u8>) -> PathBuf {
    let path = dir.join("s.zarr");
    let options = PackOptions { downsample: mean_and_max(), aprons: 1, ..options(VoxelType::U8) };
    pack(source, &path, &options, &()).unwrap();
    path
}

fn root_of(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path.join("zarr.json")).unwrap()).unwrap()
}

fn change_root(path: &Path, change: impl FnOnce(&mut Value)) {
    let mut root = root_of(path);
    change(&mut root);
    std::fs::write(path.join("zarr.json"), document_bytes(&root)).unwrap();
}

fn is_sound(path: &Path) {
    let report = verify(path, |_, _| {}).unwrap();
    assert_eq!((report.problems, report.edits), (vec![], vec![]));
}

fn rehearsed(path: &Path, change: &Edit) -> Result<EditReport, EditError> {
    let Work { memory_bytes, threads, .. } = usual_work();
    rehearse_edit(path, change, memory_bytes, threads)
}

fn refusal(path: &Path, change: &Edit) -> String {
    let before = files(path);
    let error = edit(path, change).unwrap_err();
    assert_eq!(rehearsed(path, change).unwrap_err().to_string(), error.to_string());
    assert_eq!(files(path), before);
    error.to_string()
}

fn channel(number: u32) -> ChannelEdit {
    ChannelEdit { channel: Some(ChannelChoice::number(number)), ..ChannelEdit::default() }
}

fn spacing(x: f64) -> Edit {
    Edit { spacing: Some(DVec3::new(x, x, 2.0 * x)), ..Edit::default() }
}

/// The document of a store packed with the values, apart from the settings of the pack itself.
#[test]
fn an_edited_store_has_the_metadata_of_one_packed_so() {
    let dirs = [0, 1].map(|_| tempfile::tempdir().unwrap());
    let path = packed(dirs[0].path(), &source(3, 2));
    let before = files(&path);
    let all = Edit {
        spacing: Some(DVec3::new(0.25, 0.25, 0.5)),
        origin: Some(DVec3::new(-3.5, 0.1, 7.0)),
        unit: Some("um".into()),
        value_unit: Some("HU".into()),
        time_step: Some(0.5),
        time_unit: Some("s".into()),
        name: Some("head".into()),
        channels: vec![
            ChannelEdit { name: Some("DAPI".into()), color: Some([1, 2, 3]), ..channel(0) },
            ChannelEdit { name: Some("actin".into()), ..channel(1) },
        ],
        ..Edit::default()
    };
    let said = rehearsed(&path, &all).unwrap();
    assert_eq!(files(&path), before);
    let report = edit(&path, &all).unwrap();
    assert_eq!(said, report);
    let lines: Vec<String> = report.changes.iter().map(EditChange::to_string).collect();
    for line in [
        "spacing: 1.0,1.0,2.0 -> 0.25,0.25,0.5",
        "unit: none -> micrometer",
        "time step: none -> 0.5",
        "name: none -> head",
        "channel 0 name: channel 0 -> DAPI",
        "channel 0 color: 00FF00 -> 010203",
        "channel 1 unit: none -> HU",
    ] {
        assert!(lines.iter().any(|found| found == line), "{line}: {lines:#?}");
    }
    is_sound(&path);
    let mut told = source(3, 2);
    told.info.geometry = Geometry {
        spacing: all.spacing.unwrap(),
        origin: all.origin.unwrap(),
        unit: Some("micrometer".into()),
        axis_units: None,
    };
    told.info.time = Some(TimeAxis { step: 0.5, unit: Some("second".into()), ..TimeAxis::default() });
    let look = |name: &str, color| brickyard_volume::ChannelLook {
        name: Some(name.into()),
        color,
        unit: Some("HU".into()),
        window: None,
    };
    told.info.channel_looks = vec![look("DAPI", Some([1, 2, 3])), look("actin", None)];
    let other = dirs[1].path().join("s.zarr");
    let options =
        PackOptions { downsample: mean_and_max(), aprons: 1, name: Some("head".into()), ..options(VoxelType::U8) };
    pack(&told, &other, &options, &()).unwrap();
    let [edited, expected] = [&path, &other].map(|path| root_of(path)["attributes"].clone());
    assert_eq!(edited["ome"], expected["ome"]);
    for (key, expected) in expected["brickyard"].as_object().unwrap() {
        // The levels' factors follow from the packed spacing.
        if !["spacing", "settings_fingerprint", "checksum"].contains(&key.as_str()) {
            assert_eq!(&edited["brickyard"][key], expected, "{key}");
        }
    }
    let mut after = files(&path);
    after.insert("zarr.json".into(), before[Path::new("zarr.json")].clone());
    assert_eq!(after, before);
    let message = refusal(&path, &all);
    assert!(message.contains("nothing to change"), "{message}");
}

/// Any spacing is taken with the factors of the packed one.
#[test]
fn levels_keep_their_factors() {
    let dir = tempfile::tempdir().unwrap();
    let path = packed(dir.path(), &source(1, 1));
    let factors = |path: &Path| Store::open(path).unwrap().pyramid().clone();
    let before = factors(&path);
    edit(&path, &Edit { spacing: Some(DVec3::new(8.0, 0.1, 1e-3)), ..Edit::default() }).unwrap();
    is_sound(&path);
    assert_eq!(factors(&path), before);
    let store = Store::open(&path).unwrap();
    assert_eq!(store.geometry().spacing, DVec3::new(8.0, 0.1, 1e-3));
    let scale =
        &root_of(&path)["attributes"]["ome"]["multiscales"][0]["datasets"][1]["coordinateTransformations"][0]["scale"];
    let factor = store.pyramid().level(Level(1)).factor;
    let expected = [2, 1, 0].map(|a| store.geometry().spacing[a] * f64::from(factor[a]));
    assert_eq!(*scale, json!(expected));
    assert_eq!(store.reduced(crate::downsample::Downsample::Max).unwrap().geometry(), store.geometry());
}

#[test]
fn a_matrix_has_spacing_and_origin() {
    let dir = tempfile::tempdir().unwrap();
    let path = packed(dir.path(), &source(1, 1));
    let lps = Orientation::new([[-0.5, 0.0, 0.0, 90.0], [0.0, -0.5, 0.0, 120.0], [0.0, 0.0, 2.0, -30.0]]).unwrap();
    edit(&path, &Edit { orientation: Some(lps), unit: Some("mm".into()), ..Edit::default() }).unwrap();
    is_sound(&path);
    let store = Store::open(&path).unwrap();
    assert_eq!((store.geometry().spacing, store.geometry().origin), (DVec3::new(0.5, 0.5, 2.0), DVec3::ZERO));
    assert_eq!(store.info().orientation, Some(lps));
    let first = store.placement().world_from_volume(store.geometry().world_from_voxel(DVec3::splat(0.5)));
    assert!((first - DVec3::new(90.0, 120.0, -30.0)).length() < 1e-9, "{first}");
    // A new spacing stretches it, as in packing.
    edit(&path, &Edit { spacing: Some(DVec3::new(1.0, 0.5, 2.0)), ..Edit::default() }).unwrap();
    is_sound(&path);
    assert_eq!(Store::open(&path).unwrap().info().orientation.unwrap().step(0), DVec3::new(-1.0, 0.0, 0.0));
    let both = Edit { orientation: Some(lps), ..spacing(1.0) };
    assert!(refusal(&path, &both).contains("leave these out"));
    let units = Edit { unit: Some("degree,degree,hPa".into()), ..Edit::default() };
    assert!(refusal(&path, &units).contains("one unit of length"));
}

/// Times told by the user count from no known moment, as in packing, and the report says so.
#[test]
fn a_moment_goes_with_the_times_that_count_from_it() {
    let moment = "moment from which times count: 2000-01-01 -> none";
    let timed = || {
        let dir = tempfile::tempdir().unwrap();
        let mut source = source(3, 1);
        source.info.time = Some(TimeAxis {
            start: 7.0,
            step: 6.0,
            unit: Some("hour".into()),
            since: Some("2000-01-01".into()),
            ..TimeAxis::default()
        });
        let path = packed(dir.path(), &source);
        (dir, path)
    };
    let since = |path: &Path| Store::open(path).unwrap().time_axis().unwrap().since.clone();
    let is_told = |path: &Path, change: &Edit| {
        let lines: Vec<String> = edit(path, change).unwrap().changes.iter().map(EditChange::to_string).collect();
        is_sound(path);
        lines.iter().any(|line| line == moment)
    };
    let (_dir, path) = timed();
    assert!(!is_told(&path, &spacing(3.0)));
    assert_eq!(since(&path).as_deref(), Some("2000-01-01"));
    assert!(is_told(&path, &Edit { time_step: Some(0.5), ..Edit::default() }));
    let axis = Store::open(&path).unwrap().time_axis().cloned().unwrap();
    assert_eq!((axis.start, axis.step, axis.unit.as_deref(), axis.since), (7.0, 0.5, Some("hour"), None));
    let (_dir, path) = timed();
    assert!(is_told(&path, &Edit { time_unit: Some("d".into()), ..Edit::default() }));
    assert_eq!(since(&path), None);
}

/// Voxels stay where they are in the store, so that later steps come in the order of the first one, whatever its edited place.
#[test]
fn the_order_of_voxels_stays_for_later_steps() {
    let (along_y, along_x) = ([false, true, false], [true, false, false]);
    let lps = Orientation::new([[-0.5, 0.0, 0.0, 90.0], [0.0, -0.5, 0.0, 120.0], [0.0, 0.0, 2.0, -30.0]]).unwrap();
    for change in [
        Edit { origin: Some(DVec3::new(5.0, 6.0, 7.0)), ..spacing(3.0) },
        Edit { orientation: Some(lps), unit: Some("mm".into()), ..Edit::default() },
    ] {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("s.zarr");
        let step = || {
            let mut step = source(1, 1);
            (step.info.turned, step.info.flip) = (along_y, Some(along_x));
            step
        };
        let packing = PackOptions { downsample: mean_and_max(), ..options(VoxelType::U8) };
        drop(Appender::create(&path, &step(), Some(0.0), &packing, &()).unwrap());
        edit(&path, &change).unwrap();
        is_sound(&path);
        let order = |path: &Path| {
            let store = Store::open(path).unwrap();
            (store.info().turned, store.info().flipped)
        };
        assert_eq!(order(&path), (along_y, along_x));
        let append = |change: &dyn Fn(&mut brickyard_import::SourceInfo)| {
            let mut step = step();
            step.info.calibrated = false;
            step.info.geometry = Geometry::default();
            change(&mut step.info);
            let appender = Appender::open(&path, AppendOptions { memory_bytes: 1 << 30, threads: 2 });
            appender.unwrap().append(&step, None, &()).map_err(|error| error.to_string())
        };
        // Its own former place is another one now.
        let former = |info: &mut brickyard_import::SourceInfo| {
            (info.calibrated, info.geometry) = (true, source(1, 1).info.geometry);
        };
        assert!(append(&former).unwrap_err().contains("voxel spacing"));
        assert!(append(&|info| info.turned = [false; 3]).unwrap_err().contains("order of voxels"));
        assert!(append(&|info| info.flip = None).unwrap_err().contains("`flip` x"));
        append(&|_| ()).unwrap();
        let placed = Store::open(&path).unwrap();
        append(&|info| {
            info.calibrated = true;
            info.geometry = placed.geometry().clone();
            info.orientation = placed.info().orientation;
        })
        .unwrap();
        is_sound(&path);
        assert_eq!((Store::open(&path).unwrap().times(), order(&path)), (3, (along_y, along_x)));
    }
}

#[test]
fn what_does_not_fit_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = packed(dir.path(), &source(1, 2));
    let stamps = dir.path().join("stamps");
    std::fs::write(&stamps, "1\n2\n").unwrap();
    let named = |name: &str, number| Edit {
        channels: vec![ChannelEdit { name: Some(name.into()), ..channel(number) }],
        ..Edit::default()
    };
    for (change, words) in [
        (Edit { spacing: Some(DVec3::new(0.0, 1.0, 1.0)), ..Edit::default() }, "every spacing must be above 0"),
        (Edit { spacing: Some(DVec3::splat(1e308)), ..Edit::default() }, "positive, finite numbers"),
        (Edit { origin: Some(DVec3::NAN), ..Edit::default() }, "not a position"),
        (Edit { unit: Some("a,b".into()), ..Edit::default() }, "expected one, or those of x, y and z"),
        (Edit { unit: Some("um,um,mm".into()), ..Edit::default() }, "give `spacing` and `origin` in them"),
        (Edit { time_step: Some(1.0), ..Edit::default() }, "no axis of time"),
        (Edit { time_stamps: Some(stamps.clone()), ..Edit::default() }, "no axis of time"),
        (Edit { name: Some(" ".into()), ..Edit::default() }, "`name`: expected 1 to"),
        (Edit { value_unit: Some("x".repeat(99)), ..Edit::default() }, "`value_unit`"),
        (named("b\n", 0), "the name of channel 0: expected 1 to"),
        (named("channel 1", 0), "channel 0: another channel is called channel 1"),
        (named("x", 2), "channel number=2"),
        (Edit::default(), "nothing to change"),
    ] {
        let message = refusal(&path, &change);
        assert!(message.contains(words) && !message.contains("zarr.json"), "{message}");
    }
    // Names may change places.
    let swap = [named("channel 1", 0), named("channel 0", 1)].map(|edit| edit.channels).concat();
    edit(&path, &Edit { channels: swap, ..Edit::default() }).unwrap();
    is_sound(&path);
    let several = tempfile::tempdir().unwrap();
    let series = packed(several.path(), &source(3, 1));
    let message = refusal(&series, &Edit { time_stamps: Some(stamps), ..Edit::default() });
    assert!(message.contains("holds 2 numbers"), "{message}");
    let missing = dir.path().join("missing");
    assert!(edit(&missing, &spacing(3.0)).is_err() && !missing.exists());
}

#[test]
fn labels_take_no_colour_and_no_unit_of_values() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("l.zarr");
    let labels = PackOptions {
        kind: Kind::Labels,
        downsample: crate::downsample::Downsample::Mode.into(),
        ..options(VoxelType::U8)
    };
    pack(&source(1, 1), &path, &labels, &()).unwrap();
    let color = ChannelEdit { color: Some([1, 2, 3]), ..ChannelEdit::default() };
    assert!(refusal(&path, &Edit { channels: vec![color], ..Edit::default() }).contains("colours of their own"));
    assert!(refusal(&path, &Edit { value_unit: Some("HU".into()), ..Edit::default() }).contains("labels have no unit"));
    let name = ChannelEdit { name: Some("cells".into()), ..ChannelEdit::default() };
    edit(&path, &Edit { channels: vec![name], ..spacing(3.0) }).unwrap();
    is_sound(&path);
    assert_eq!(Store::open(&path).unwrap().channel_displays()[0].name.as_deref(), Some("cells"));
}

/// As if packed so, unless levels are means.
#[test]
fn the_kind_is_edited_where_levels_allow_it() {
    let dirs = [0, 1].map(|_| tempfile::tempdir().unwrap());
    let labels = Edit { kind: Some(Kind::Labels), ..Edit::default() };
    let by_mode = PackOptions { downsample: crate::downsample::Downsample::Mode.into(), ..options(VoxelType::U8) };
    let [image, told] = dirs.each_ref().map(|dir| dir.path().join("l.zarr"));
    pack(&source(1, 1), &image, &by_mode, &()).unwrap();
    pack(&source(1, 1), &told, &PackOptions { kind: Kind::Labels, ..by_mode }, &()).unwrap();
    let before = files(&image);
    edit(&image, &labels).unwrap();
    is_sound(&image);
    assert_eq!(root_of(&image)["attributes"]["ome"], root_of(&told)["attributes"]["ome"]);
    assert_eq!(Store::open(&image).unwrap().info().kind, Kind::Labels);
    edit(&image, &Edit { kind: Some(Kind::Image), ..Edit::default() }).unwrap();
    assert_eq!(files(&image), before);
}

/// Other programs' windows, visibility and keys stay; a name of theirs is replaced, also by the packed one.
#[test]
fn what_others_wrote_stays() {
    let dir = tempfile::tempdir().unwrap();
    let path = packed(dir.path(), &source(1, 2));
    change_root(&path, |root| {
        let ome = &mut root["attributes"]["ome"];
        ome["omero"]["channels"][0]["window"]["end"] = json!(55.0);
        ome["omero"]["channels"][0]["label"] = json!("theirs");
        ome["omero"]["channels"][1]["color"] = json!("ABCDEF");
        ome["omero"]["rdefs"] = json!({ "model": "color" });
        root["attributes"]["theirs"] = json!([1]);
        root["consolidated_metadata"] = json!(null);
    });
    edit(&path, &spacing(5.0)).unwrap();
    let named = ChannelEdit { name: Some("channel 0".into()), ..channel(0) };
    let report = edit(&path, &Edit { channels: vec![named], ..Edit::default() }).unwrap();
    assert_eq!(report.changes[0].to_string(), "channel 0 name: theirs -> channel 0");
    let root = root_of(&path);
    let omero = &root["attributes"]["ome"]["omero"];
    assert_eq!(
        (&omero["channels"][0]["window"]["end"], &omero["channels"][0]["label"]),
        (&json!(55.0), &json!("channel 0"))
    );
    assert_eq!((&omero["channels"][1]["color"], &omero["rdefs"]["model"]), (&json!("ABCDEF"), &json!("color")));
    assert_eq!((&root["attributes"]["theirs"], root.get("consolidated_metadata")), (&json!([1]), Some(&json!(null))));
    let report = verify(&path, |_, _| {}).unwrap();
    assert_eq!((report.problems, report.edits.len()), (vec![], 2));
    // Without any looks there, those of the store are written again with the new one.
    change_root(&path, |root| drop(root["attributes"]["ome"].as_object_mut().unwrap().remove("omero")));
    let colored = ChannelEdit { color: Some([9, 9, 9]), ..channel(1) };
    edit(&path, &Edit { channels: vec![colored], ..Edit::default() }).unwrap();
    is_sound(&path);
    assert_eq!(Store::open(&path).unwrap().channel_displays()[1].color, [9; 3]);
}

/// An edit vouches for the whole document.
#[test]
fn a_changed_document_is_not_edited() {
    let dir = tempfile::tempdir().unwrap();
    let path = packed(dir.path(), &source(1, 1));
    let sound = std::fs::read(path.join("zarr.json")).unwrap();
    for pointer in ["/attributes/brickyard/channels/0/mean", "/attributes/brickyard/checksum"] {
        change_root(&path, |root| {
            let value = root.pointer_mut(pointer).unwrap();
            *value = if value.is_string() { json!("0") } else { json!(1.25) };
        });
        let message = refusal(&path, &spacing(3.0));
        assert!(message.contains("zarr.json: was changed since it was packed"), "{message}");
        std::fs::write(path.join("zarr.json"), &sound).unwrap();
    }
    edit(&path, &spacing(3.0)).unwrap();
}

#[test]
fn an_unfinished_store_and_one_in_use_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.zarr");
    let step = |stamp| (source(1, 1), Some(stamp));
    let (first, stamp) = step(0.0);
    let packing = PackOptions { downsample: mean_and_max(), ..options(VoxelType::U8) };
    let mut appender = Appender::create(&path, &first, stamp, &packing, &()).unwrap();
    assert!(matches!(edit(&path, &spacing(3.0)), Err(EditError::Pack(PackError::Busy { .. }))));
    assert!(matches!(rehearsed(&path, &spacing(3.0)), Err(EditError::Pack(PackError::Busy { .. }))));
    appender.append(&source(1, 1), None, &()).unwrap();
    drop(appender);
    // Steps appended later join the edited store.
    edit(&path, &Edit { time_step: Some(0.25), ..spacing(3.0) }).unwrap();
    is_sound(&path);
    let mut told = source(1, 1);
    let append = |source: &Array<u8>| {
        Appender::open(&path, AppendOptions { memory_bytes: 1 << 30, threads: 2 })?.append(source, None, &())
    };
    assert!(append(&told).unwrap_err().to_string().contains("voxel spacing"));
    told.info.geometry.spacing = DVec3::new(3.0, 3.0, 6.0);
    append(&told).unwrap();
    is_sound(&path);
    let store = Store::open(&path).unwrap();
    assert_eq!((store.times(), store.time_axis().unwrap().at(2), store.geometry().spacing.z), (3, 0.5, 6.0));
    for unfinished in [path.clone(), dir.path().join("s.zarr.packing")] {
        std::fs::create_dir_all(&unfinished).unwrap();
        std::fs::write(unfinished.join(JOURNAL_NAME), "{}\n").unwrap();
        assert!(refusal(&path, &spacing(4.0)).contains("is an unfinished pack"));
        std::fs::remove_file(unfinished.join(JOURNAL_NAME)).unwrap();
    }
    edit(&path, &spacing(4.0)).unwrap();
}

/// A full disk or a crash at any change leaves the old document or the new one.
#[test]
fn an_edit_stopped_anywhere_is_done_or_not() {
    let dir = tempfile::tempdir().unwrap();
    let path = packed(dir.path(), &source(1, 1));
    let before = files(&path);
    edit(&path, &spacing(3.0)).unwrap();
    let after = files(&path);
    for syncs_each in [false, true] {
        for changes in 0.. {
            std::fs::write(path.join("zarr.json"), &before[Path::new("zarr.json")]).unwrap();
            let disk = Trial { syncs_each, fuse: Some(changes.into()), ..Trial::default() }.disk();
            let edited = edit_on(&disk, &path, &spacing(3.0), usual_work());
            let mut found = files(&path);
            found.remove(Path::new("zarr.json.tmp"));
            match edited {
                Ok(_) => {
                    assert!(found == after && changes > 4, "{changes}");
                    break;
                }
                Err(EditError::Unsynced { .. }) => assert!(found == after, "{changes}"),
                Err(_) => assert!(found == before, "{changes}"),
            }
            match edit(&path, &spacing(3.0)) {
                Err(EditError::Nothing { .. }) => assert!(found == after),
                edited => assert!(edited.is_ok() && found == before),
            }
            assert_eq!(files(&path), after);
        }
    }
}

#[test]
fn a_surrounding_group_with_the_former_values_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = packed(dir.path(), &source(1, 1));
    let group = json!({ "consolidated_metadata": { "metadata": { "s.zarr": {} } } });
    std::fs::write(dir.path().join("zarr.json"), group.to_string()).unwrap();
    let report = edit(&path, &spacing(3.0)).unwrap();
    assert_eq!(report.stale_groups.len(), 1);
}

fn labels() -> Edit {
    Edit { kind: Some(Kind::Labels), ..Edit::default() }
}

/// The options of a pack as labels.
fn as_labels() -> PackOptions {
    let by_mode = crate::downsample::Downsample::Mode.into();
    PackOptions { kind: Kind::Labels, downsample: by_mode, aprons: 1, ..options(VoxelType::U8) }
}

/// Files of a store but its root document, and the latter without the marks of its settings.
fn without_settings(path: &Path) -> (std::collections::BTreeMap<PathBuf, Vec<u8>>, Value) {
    let (mut files, mut root) = (files(path), root_of(path));
    files.remove(Path::new("zarr.json"));
    for key in ["checksum", "settings_fingerprint"] {
        root["attributes"]["brickyard"].as_object_mut().unwrap().remove(key);
    }
    (files, root)
}

#[test]
fn means_are_made_again_for_labels_and_level_0_stays() {
    use std::os::unix::fs::MetadataExt;
    let dirs = [0, 1].map(|_| tempfile::tempdir().unwrap());
    for (times, channels) in [(1, 1), (3, 2)] {
        let source = source(times, channels);
        let image = packed(dirs[0].path(), &source);
        let told = dirs[1].path().join("s.zarr");
        pack(&source, &told, &as_labels(), &()).unwrap();
        change_root(&image, |root| root["attributes"]["theirs"] = json!([1]));
        let before = files(&image);
        rehearsed(&image, &labels()).unwrap();
        assert_eq!(files(&image), before);
        let shard = image.join(if times == 1 { "0/c/0/0/0" } else { "0/c/1/1/0/0/0" });
        let number = shard.metadata().unwrap().ino();
        let report = edit(&image, &labels()).unwrap();
        let changes: Vec<_> = report.changes.iter().map(EditChange::to_string).collect();
        assert_eq!(changes, ["kind: image -> labels", "coarser levels: mean,max -> mode"]);
        is_sound(&image);
        change_root(&image, |root| {
            assert_eq!(root["attributes"].as_object_mut().unwrap().remove("theirs"), Some(json!([1])));
        });
        let [found, expected] = [&image, &told].map(|path| without_settings(path));
        assert!(found.0 == expected.0, "{:?}", found.0.keys().collect::<Vec<_>>());
        assert_eq!(found.1, expected.1);
        assert_eq!(
            (shard.metadata().unwrap().ino(), shard.metadata().unwrap().nlink()),
            (number, 1),
            "level 0 is not written"
        );
        assert_eq!(std::fs::read_dir(dirs[0].path()).unwrap().count(), 1, "nothing is left beside it");
        dirs.iter().for_each(|dir| std::fs::remove_dir_all(dir.path().join("s.zarr")).unwrap());
    }
}

/// Placement edited before stays, and so do the factors of levels; steps are appended before and after.
#[test]
fn levels_of_an_edited_and_appended_store_are_made_again() {
    let dir = tempfile::tempdir().unwrap();
    let [path, told] = ["s.zarr", "t.zarr"].map(|name| dir.path().join(name));
    let packing = PackOptions { downsample: mean_and_max(), aprons: 1, ..options(VoxelType::U8) };
    let mut step = source(1, 1);
    let resources = AppendOptions { memory_bytes: 1 << 30, threads: 2 };
    for (path, packing) in [(&path, &packing), (&told, &as_labels())] {
        let mut appender = Appender::create(path, &step, Some(0.0), packing, &()).unwrap();
        appender.append(&step, None, &()).unwrap();
        drop(appender);
        edit(path, &spacing(9.0)).unwrap();
    }
    edit(&path, &labels()).unwrap();
    step.info.geometry.spacing = DVec3::new(9.0, 9.0, 18.0);
    for path in [&path, &told] {
        is_sound(path);
        Appender::open(path, resources).unwrap().append(&step, None, &()).unwrap();
        is_sound(path);
    }
    let [found, expected] = [&path, &told].map(|path| without_settings(path));
    assert!(found.0 == expected.0);
    assert_eq!(found.1, expected.1);
}

#[test]
fn levels_that_cannot_be_made_leave_the_store() {
    let dir = tempfile::tempdir().unwrap();
    let path = packed(dir.path(), &source(1, 1));
    let before = files(dir.path());
    let Work { memory_bytes, threads, .. } = usual_work();
    let stopped = edit_within(&path, &labels(), memory_bytes, threads, &CancelledAtOnce).unwrap_err();
    assert!(
        matches!(&stopped, EditError::Levels(error) if matches!(**error, RemakeError::Cancelled { .. })),
        "{stopped}"
    );
    assert_eq!(files(dir.path()), before);
    let little = edit_within(&path, &labels(), 1 << 20, threads, &()).unwrap_err().to_string();
    assert!(little.contains("`memory`"), "{little}");
    assert_eq!(rehearse_edit(&path, &labels(), 1 << 20, threads).unwrap_err().to_string(), little);
    assert_eq!(files(dir.path()), before);
    std::fs::create_dir_all(path.join("labels/l")).unwrap();
    assert!(refusal(&path, &labels()).contains("labels/l is not part of the store"));
    std::fs::remove_dir_all(path.join("labels")).unwrap();
    // A damaged brick of level 0.
    let shard = path.join("0/c/0/0/0");
    let mut bytes = std::fs::read(&shard).unwrap();
    bytes[5] ^= 1;
    std::fs::write(&shard, &bytes).unwrap();
    let damaged = files(dir.path());
    let message = edit(&path, &labels()).unwrap_err().to_string();
    assert!(message.contains("levels cannot be made again") && message.contains("0/c/0/0/0"), "{message}");
    assert_eq!(files(dir.path()), damaged);
}

/// A full disk or a crash at any change leaves the old store or the new one, and the next edit ends it.
#[test]
fn levels_stopped_anywhere_are_made_or_not() {
    let dir = tempfile::tempdir().unwrap();
    let small = Array::<u8>::series([20, 17, 12], 1, 1, |_, p| 1 + value(p) as u8);
    let path = packed(dir.path(), &small);
    let before = files(&path);
    edit(&path, &labels()).unwrap();
    let after = files(&path);
    for (i, (syncs_each, cannot_exchange)) in [(false, false), (true, false), (false, true)].into_iter().enumerate() {
        let fresh = |fuse: i64| {
            std::fs::remove_dir_all(&path).unwrap();
            packed(dir.path(), &small);
            Trial { syncs_each, cannot_exchange, fuse: Some(fuse.into()), ..Trial::default() }.disk()
        };
        let disk = fresh(i64::MAX);
        edit_on(&disk, &path, &labels(), usual_work()).unwrap();
        let log = disk.trial.log.into_inner().unwrap();
        let commit = log.iter().position(|(what, _)| *what == if cannot_exchange { "rename_dir" } else { "exchange" });
        let commit = commit.expect("the new levels take the old ones' place");
        // Changes long before the commit are much alike, and so are those after it.
        let moments = (0..=log.len()).filter(|n| n % 8 == i || n.abs_diff(commit) < 10 || *n + 4 > log.len());
        let (mut olds, mut news) = (0, 0);
        for changes in moments {
            let disk = fresh(changes as i64);
            let edited = edit_on(&disk, &path, &labels(), usual_work());
            let is_there = path.exists();
            assert!(is_there || cannot_exchange, "{changes}");
            let mut found = if is_there { files(&path) } else { after.clone() };
            let is_new = !is_there || Store::open(&path).unwrap().info().kind == Kind::Labels;
            found.remove(Path::new(JOURNAL_NAME));
            assert!(if is_new { found == after } else { found == before }, "{changes}");
            (olds, news) = (olds + i32::from(!is_new), news + i32::from(is_new));
            match &edited {
                Ok(_) => assert!(is_new),
                Err(EditError::Levels(error)) if matches!(**error, RemakeError::Unsynced { .. }) => {
                    assert!(is_new, "{changes}");
                }
                Err(error) => assert!(!is_new || cannot_exchange, "{changes}: {error}"),
            }
            // Any edit ends it first.
            match edit(&path, &labels()) {
                Err(EditError::Nothing { .. }) => assert!(is_new, "{changes}"),
                again => assert!(again.is_ok() && !is_new, "{changes}: {again:?}"),
            }
            assert_eq!(files(&path), after);
            assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1, "{changes}");
            if edited.is_ok() {
                break;
            }
        }
        assert!(olds > 20 && news > 3, "{olds} {news}");
    }
}
