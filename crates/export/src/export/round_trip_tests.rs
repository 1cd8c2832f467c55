//! Files of every format, opened again by `brickyard-import`: the same voxels in the same places, with all facts of the format; and a note
//! on the others.

use super::*;
use crate::frame::Frame;
use crate::testing::{Function, TestStore, bytes_of, info, value};
use brickyard_import::{NoData, SourceInfo, open};
use brickyard_volume::units::LengthUnit;
use brickyard_volume::{ChannelLook, Level, Orientation, TimeAxis, VoxelType};
use glam::{DMat3, DQuat, DVec3, EulerRot};

/// A name of each format but for pictures, which keep no place.
const NAMES: [&str; 11] =
    ["a.raw", "a.npy", "a.nii", "a.nii.gz", "a.nrrd", "a.mha", "m.mhd", "a.vti", "s.pvd", "a.tif", "a.ome.tif"];
/// Names of formats with axes of time by their own word.
const WITH_TIME: [&str; 9] = ["a.raw", "a.nii", "a.nii.gz", "a.nrrd", "a.mha", "m.mhd", "s.pvd", "a.tif", "a.ome.tif"];

const REGION: VoxelBox = VoxelBox::new([3, 8, 2], [36, 17, 19]);

/// A volume turned in a patient, of unlike spacings, mirrored along z where `sign` is -1.
fn oblique(sign: f64) -> SourceInfo {
    let spacing = DVec3::new(0.5, 0.65, 2.0);
    let turn = DMat3::from_quat(DQuat::from_euler(EulerRot::XYZ, 0.3, -0.7, 2.0));
    let steps = [turn.x_axis * spacing.x, turn.y_axis * spacing.y, turn.z_axis * (spacing.z * sign)];
    let rows = [0, 1, 2].map(|row| [steps[0][row], steps[1][row], steps[2][row], [-70.0, 12.5, 100.0][row]]);
    let mut info = placed();
    info.geometry.spacing = spacing;
    info.orientation = Some(Orientation::new(rows).unwrap());
    info
}

/// A volume with an origin of its own.
fn placed() -> SourceInfo {
    let mut info = SourceInfo { calibrated: true, ..info() };
    info.geometry.spacing = DVec3::new(0.5, 0.65, 2.0);
    info.geometry.origin = DVec3::new(-3.0, 0.1, 100.0);
    info.geometry.unit = Some("millimeter".into());
    info
}

/// Exports all channels and steps, and opens the file.
fn back(test: &TestStore, name: &str, request: ExportRequest) -> (Box<dyn Source>, Vec<String>) {
    let output = test.folder.path().join(name);
    let exported =
        export(&test.store, &output, &ExportRequest { overwrite: true, ..request }, |_, _| ControlFlow::Continue(()));
    let notes = exported.unwrap().notes;
    let scratch_dir = Some(test.folder.path().to_owned());
    (open(&[output], &OpenOptions { scratch_dir, ..OpenOptions::default() }).unwrap(), notes)
}

fn all(store: &Store) -> ExportRequest {
    let time = ExportTime::Steps { first: 0, end: store.times(), stride: 1 };
    let channels = if store.channels() > 1 { ExportChannels::All } else { ExportChannels::One(0) };
    ExportRequest { time, channels, ..ExportRequest::default() }
}

fn assert_voxels(source: &dyn Source, region: VoxelBox, name: &str) {
    let (info, whole) = (source.info(), source.info().extent.full_box());
    assert_eq!(info.extent, region.extent(), "{name}");
    for (t, c) in (0..info.times).flat_map(|t| (0..info.channels).map(move |c| (t, c))) {
        let mut found = vec![0; whole.extent().volume() as usize * info.voxel_type.bytes()];
        source.read_box(t, c, whole, &mut found).unwrap();
        let expected: Vec<u8> = region.voxels().flat_map(|at| bytes_of(info.voxel_type, value(t, c, at))).collect();
        assert!(found == expected, "{name}: step {t}, channel {c}");
    }
}

/// Places of three corners in a patient, in metres.
fn corners(info: &SourceInfo) -> [DVec3; 3] {
    let frame = Frame::of(info);
    let metres = info.geometry.unit.as_deref().map_or(1.0, |unit| LengthUnit::named(unit).unwrap().metres());
    let [x, y, z] = info.extent.to_array().map(|n| f64::from(n) - 1.0);
    let [a, b, c] = frame.steps;
    [frame.first, frame.first + a * x + c * z, frame.first + a * x + b * y + c * z].map(|at| at * metres)
}

fn assert_place(found: &SourceInfo, expected: &SourceInfo, name: &str) {
    let voxel = Frame::of(expected).spacing.min_element()
        * expected.geometry.unit.as_deref().map_or(1.0, |unit| LengthUnit::named(unit).unwrap().metres());
    for (found, expected) in corners(found).into_iter().zip(corners(expected)) {
        // NIfTI-1 has 32-bit numbers.
        assert!((found - expected).length() <= 1e-3 * voxel, "{name}: {found}, expected {expected}");
    }
}

/// A part of a level, as its source describes it.
fn described(test: &TestStore, request: &ExportRequest) -> SourceInfo {
    let region = request.checked_region(&test.store).unwrap();
    part_of(&test.store, Path::new("out"), request, region).unwrap().info().clone()
}

#[test]
fn voxels_of_every_type_come_back() {
    for voxel_type in VoxelType::ALL {
        let test = TestStore::of(SourceInfo { voxel_type, ..oblique(1.0) });
        for name in NAMES {
            let request = ExportRequest { region: Some(REGION), ..ExportRequest::default() };
            let (source, _) = back(&test, name, request);
            assert_eq!(source.info().voxel_type, voxel_type, "{name}");
            assert_voxels(&*source, REGION, name);
        }
    }
}

#[test]
fn pictures_come_back_plane_by_plane() {
    for voxel_type in [VoxelType::U8, VoxelType::U16] {
        let test = TestStore::of(SourceInfo { voxel_type, ..oblique(1.0) });
        let request = ExportRequest { region: Some(REGION), ..ExportRequest::default() };
        let (source, notes) = back(&test, "planes/", request);
        assert_eq!(source.info().voxel_type, voxel_type);
        assert_voxels(&*source, REGION, "planes/");
        assert!(
            notes[0].contains("PNG cannot keep the spacing, the orientation: left out.")
                || notes[0].contains("the spacing and the orientation"),
            "{notes:?}"
        );
    }
}

#[test]
fn parts_of_levels_lie_where_they_did() {
    for sign in [1.0, -1.0] {
        let test = TestStore::of(oblique(sign));
        for (level, region) in [(0, REGION), (1, VoxelBox::new([2, 0, 1], [9, 8, 10]))] {
            let request = ExportRequest { level: Level(level), region: Some(region), ..ExportRequest::default() };
            let expected = described(&test, &request);
            for name in ["a.raw", "a.nii", "a.nii.gz", "a.nrrd", "a.mha", "m.mhd", "a.vti"] {
                let (source, notes) = back(&test, name, request.clone());
                let mut found = source.info().clone();
                if name == "a.vti" {
                    found.geometry.unit = expected.geometry.unit.clone();
                }
                assert_place(&found, &expected, name);
                assert!(found.calibrated, "{name}");
                let lost: Vec<_> = notes.iter().filter(|note| note.contains("cannot keep")).collect();
                let unit = "A .vti file cannot keep the unit of lengths (millimeter): left out.";
                assert_eq!(lost, if name == "a.vti" { vec![unit] } else { vec![] }, "{name}");
            }
            for name in ["a.tif", "a.ome.tif", "a.npy"] {
                let (source, notes) = back(&test, name, request.clone());
                assert!(notes[0].contains("the orientation"), "{notes:?}");
                if name != "a.npy" {
                    let (found, expected) = (source.info().geometry.spacing, Frame::of(&expected).spacing);
                    assert!((found - expected).abs().max_element() < 1e-9, "{name}: {found} {expected}");
                    assert_eq!(source.info().geometry.unit.as_deref(), Some("millimeter"));
                }
            }
        }
    }
}

/// An orientation on a level's voxels is the finer ones': the middle of the first block.
#[test]
fn a_level_s_first_voxel_is_the_middle_of_finer_ones() {
    let test = TestStore::of(oblique(1.0));
    let fine = described(&test, &ExportRequest::default());
    let coarse = described(&test, &ExportRequest { level: Level(1), ..ExportRequest::default() });
    let factor = DVec3::from_array(test.store.pyramid().level(Level(1)).factor.map(f64::from));
    assert!(factor.max_element() > 1.0);
    let [fine, coarse] = [Frame::of(&fine), Frame::of(&coarse)];
    let middle = (factor - 1.0) * 0.5;
    let expected = fine.first + fine.steps[0] * middle.x + fine.steps[1] * middle.y + fine.steps[2] * middle.z;
    assert!((coarse.first - expected).length() < 1e-12);
    assert!((coarse.steps[0] - fine.steps[0] * factor.x).length() < 1e-12);
}

#[test]
fn volumes_without_a_patient_lie_where_they_did() {
    for unit in [Some("millimeter"), Some("micrometer"), Some("nanometer"), Some("inch"), None] {
        let mut volume = placed();
        volume.geometry.unit = unit.map(str::to_owned);
        let test = TestStore::of(volume);
        let expected = described(&test, &ExportRequest::default());
        for name in ["a.raw", "a.nii", "a.nrrd", "a.mha", "a.vti", "s.pvd"] {
            let (source, notes) = back(&test, name, ExportRequest::default());
            let mut found = source.info().clone();
            if ["a.vti", "s.pvd"].contains(&name) {
                found.geometry.unit = expected.geometry.unit.clone();
            }
            assert_place(&found, &expected, name);
            let is_given = notes.iter().any(|note| note.contains("x, y, z are written as right, front, head"));
            assert_eq!(is_given, ["a.nii", "a.mha"].contains(&name), "{name}: {notes:?}");
            if ["a.raw", "a.nrrd"].contains(&name) {
                assert_eq!((found.orientation, &found.geometry), (None, &expected.geometry), "{name}");
            }
        }
        for name in ["a.tif", "a.ome.tif"] {
            let (source, notes) = back(&test, name, ExportRequest::default());
            let (found, frame) = (source.info(), Frame::of(&expected));
            assert!(notes[0].contains("the origin"), "{notes:?}");
            if name == "a.tif" && unit.is_none() {
                assert!(notes[0].contains("the spacing") && !found.calibrated, "{notes:?}");
            } else {
                let metres = |unit: &Option<String>| {
                    unit.as_deref().map_or(1.0, |unit| LengthUnit::named(unit).unwrap().metres())
                };
                let (found, expected) = (
                    found.geometry.spacing * metres(&found.geometry.unit),
                    frame.spacing * metres(&expected.geometry.unit),
                );
                assert!((found - expected).abs().max_element() < 1e-9 * expected.max_element(), "{name} {unit:?}");
            }
        }
    }
}

#[test]
fn unknown_spacings_stay_unknown() {
    let test = TestStore::of(info());
    for name in NAMES {
        let (source, notes) = back(&test, name, ExportRequest::default());
        let info = source.info();
        assert!(info.orientation.is_none() && info.geometry == Default::default(), "{name}");
        // NIfTI has no spacing that is unknown.
        assert_eq!(info.calibrated, name.contains(".nii"), "{name}");
        assert_eq!(notes, Vec::<String>::new(), "{name}");
    }
}

/// A unit and an origin without a spacing: neither becomes a place in millimetres, nor is it lost in silence.
#[test]
fn an_unknown_spacing_has_no_unit_and_its_origin_is_told() {
    let mut volume = placed();
    volume.calibrated = false;
    volume.geometry.spacing = DVec3::ONE;
    let test = TestStore::of(volume.clone());
    for name in NAMES {
        let (source, notes) = back(&test, name, ExportRequest::default());
        let found = source.info();
        if name == "a.raw" {
            assert_eq!(found.geometry, volume.geometry);
            continue;
        }
        assert_eq!((found.geometry.unit.as_deref(), found.orientation), (None, None), "{name}");
        assert!(notes.iter().any(|note| note.contains("the origin")), "{name}: {notes:?}");
    }
    volume.geometry.axis_units = Some(["degree", "degree", "hPa"].map(str::to_owned));
    volume.geometry.unit = None;
    let (source, notes) = back(&TestStore::of(volume.clone()), "a.nrrd", ExportRequest::default());
    let found = source.info();
    assert_eq!((found.calibrated, &found.geometry.axis_units), (false, &volume.geometry.axis_units));
    assert!(notes[0].contains("the origin"), "{notes:?}");
}

/// MetaImage's times need a spacing of voxels beside them.
#[test]
fn times_of_an_unknown_spacing_bring_one_with_a_note() {
    let time = Some(TimeAxis { step: 0.5, start: 2.0, ..TimeAxis::default() });
    let test = TestStore::of(SourceInfo { times: 3, time, ..info() });
    for name in ["a.mha", "m.mhd"] {
        let (source, notes) = back(&test, name, all(&test.store));
        assert!(source.info().calibrated && notes[0].contains("which is unknown: 1 is written"), "{notes:?}");
    }
}

/// Converted lengths contradict nothing.
#[test]
fn units_that_a_format_lacks_are_converted_without_a_contradiction() {
    for mut volume in [placed(), oblique(1.0)] {
        volume.geometry.unit = Some("inch".into());
        let test = TestStore::of(volume);
        for name in ["a.nii", "a.nii.gz", "a.mha", "m.mhd"] {
            let (source, notes) = back(&test, name, ExportRequest::default());
            assert_eq!(source.info().geometry.unit.as_deref(), Some("millimeter"), "{name}");
            assert_place(source.info(), &described(&test, &ExportRequest::default()), name);
            assert!(!notes.iter().any(|note| note.contains("contradicts")), "{name}: {notes:?}");
        }
    }
}

/// ImageJ adds 32768 to signed numbers of 16 bits, and to the ends of their display range.
#[test]
fn windows_are_display_ranges_as_imagej_counts_them() {
    for (voxel_type, channels) in [(VoxelType::I16, 1), (VoxelType::I16, 2), (VoxelType::U16, 1), (VoxelType::I8, 1)] {
        let test = TestStore::of(SourceInfo { voxel_type, channels, ..info() });
        let (source, _) = back(&test, "a.tif", all(&test.store));
        let window = |c: usize| source.info().channel_looks.get(c).and_then(|look| look.window);
        for c in 0..channels as usize {
            let expected = <[f64; 2]>::from(test.store.channel_displays()[c].window);
            assert_eq!(window(c), (voxel_type != VoxelType::I8).then_some(expected), "{voxel_type} {c}");
        }
        let bytes = std::fs::read(test.folder.path().join("a.tif")).unwrap();
        if channels == 1 {
            let text = String::from_utf8_lossy(&bytes[..400]).into_owned();
            let low = test.store.channel_displays()[0].window.0;
            let line = match voxel_type {
                VoxelType::I16 => format!("\nmin={}\n", low + 32768.0),
                _ => format!("\nmin={low}\n"),
            };
            assert_eq!(text.contains(&line), voxel_type != VoxelType::I8, "{text}");
        }
    }
}

#[test]
fn units_of_axes_are_kept_or_told() {
    let mut volume = placed();
    volume.geometry.unit = None;
    volume.geometry.axis_units = Some(["degree", "degree", "hPa"].map(str::to_owned));
    let test = TestStore::of(volume);
    let expected = described(&test, &ExportRequest::default());
    for name in NAMES {
        let (source, notes) = back(&test, name, ExportRequest::default());
        if ["a.raw", "a.nrrd"].contains(&name) {
            assert_eq!(source.info().geometry, expected.geometry, "{name}");
        } else {
            assert!(notes.iter().any(|note| note.contains("cannot keep")), "{name}: {notes:?}");
        }
    }
}

#[test]
fn times_are_kept_or_told() {
    let axis = |start, unit: Option<&str>| TimeAxis {
        start,
        step: 0.25,
        unit: unit.map(str::to_owned),
        ..TimeAxis::default()
    };
    const OF_EVEN_TIMES: [&str; 8] = ["a.npy", "a.nii", "a.nii.gz", "a.nrrd", "a.mha", "m.mhd", "s.pvd", "a.tif"];
    let uneven = TimeAxis::of_stamps(vec![1.0, 2.0, 4.0], Some("second".into())).unwrap();
    let late = |start| TimeAxis { since: Some("1900-01-01 06:00 (noleap)".into()), ..axis(start, Some("hour")) };
    for (time, lost) in [
        (axis(0.0, Some("second")), &["a.npy", "a.mha", "m.mhd", "s.pvd"][..]),
        (axis(2.0, Some("millisecond")), &["a.npy", "a.mha", "m.mhd", "s.pvd", "a.tif"]),
        (axis(0.0, Some("hour")), &["a.npy", "a.mha", "m.mhd", "s.pvd"]),
        (axis(0.0, None), &["a.npy", "a.tif", "a.ome.tif"]),
        (late(0.0), &["a.npy", "a.nii", "a.nii.gz", "a.mha", "m.mhd", "s.pvd"]),
        (late(7.0), &["a.npy", "a.nii", "a.nii.gz", "a.mha", "m.mhd", "s.pvd", "a.tif"]),
        (TimeAxis { since: late(0.0).since, ..uneven.clone() }, &OF_EVEN_TIMES),
        (uneven, &OF_EVEN_TIMES),
    ] {
        let test = TestStore::of(SourceInfo { times: 3, time: Some(time.clone()), ..placed() });
        for name in WITH_TIME {
            let (source, notes) = back(&test, name, all(&test.store));
            assert_voxels(&*source, source.info().extent.full_box(), name);
            let found = source.info().time.clone();
            if lost.contains(&name) {
                assert!(notes.iter().any(|note| note.contains("time")), "{name} {time:?}: {notes:?}");
                continue;
            }
            assert!(!notes.iter().any(|note| note.contains("time")), "{name} {time:?}: {notes:?}");
            let found = found.unwrap();
            // NIfTI has no hours.
            let is_in_seconds = name.contains(".nii") && time.unit.as_deref() == Some("hour");
            let expected = match is_in_seconds {
                true => TimeAxis { step: 900.0, unit: Some("second".into()), ..time.clone() },
                false => time.clone(),
            };
            assert_eq!(found, expected, "{name}");
        }
    }
}

#[test]
fn channels_have_their_names_colours_and_units() {
    let look = |name: &str, color| ChannelLook {
        name: Some(name.into()),
        color: Some(color),
        window: None,
        unit: Some("K".into()),
    };
    let channel_looks = vec![look("DAPI <1>", [0, 0, 255]), look("caf\u{e9} & \"b\"", [255, 128, 0])];
    let test = TestStore::of(SourceInfo { channels: 2, times: 2, channel_looks, ..placed() });
    let expected = described(&test, &all(&test.store)).channel_looks;
    for name in ["a.raw", "a.nii", "a.nii.gz", "a.nrrd", "a.tif", "a.ome.tif"] {
        let (source, notes) = back(&test, name, all(&test.store));
        assert_voxels(&*source, source.info().extent.full_box(), name);
        let looks = &source.info().channel_looks;
        let (names, colors, units) = match name {
            "a.raw" => (true, false, true),
            "a.nrrd" => (false, false, true),
            "a.tif" => (false, true, true),
            "a.ome.tif" => (true, true, false),
            _ => (false, false, false),
        };
        let look = |i: usize| looks.get(i).cloned().unwrap_or_default();
        for i in 0..2 {
            assert_eq!(look(i).name.is_some(), names, "{name}");
            assert!(!names || look(i).name == expected[i].name, "{name}: {:?}", look(i));
            assert!(!colors || look(i).color == expected[i].color, "{name}: {:?}", look(i));
            assert!(!units || look(i).unit == expected[i].unit, "{name}: {:?}", look(i));
        }
        let told = notes.join(" ");
        for (is_kept, words) in
            [(names, "names of channels"), (colors, "colours of channels"), (units, "unit of values (K)")]
        {
            assert_eq!(!is_kept, told.contains(words), "{name}: {told}");
        }
    }
    // Arrays of one step, by their names.
    let request = ExportRequest { time: ExportTime::Step(1), ..all(&test.store) };
    let output = test.folder.path().join("a.vti");
    export(&test.store, &output, &request, |_, _| ControlFlow::Continue(())).unwrap();
    for (channel, look) in expected.iter().enumerate() {
        let options = OpenOptions { variable: look.name.clone(), ..OpenOptions::default() };
        let source = open(std::slice::from_ref(&output), &options).unwrap();
        let whole = source.info().extent.full_box();
        let mut found = vec![0; whole.extent().volume() as usize * 2];
        source.read_box(0, 0, whole, &mut found).unwrap();
        let voxels: Vec<u8> =
            whole.voxels().flat_map(|at| bytes_of(VoxelType::U16, value(1, channel as u32, at))).collect();
        assert!(found == voxels, "{look:?}");
    }
}

#[test]
fn no_data_and_labels_are_kept_or_told() {
    let mut volume = SourceInfo { nodata: Some(7.0), ..placed() };
    let test = TestStore::of(volume.clone());
    assert_eq!(test.store.nodata(), Some(7.0));
    for name in NAMES {
        let (source, notes) = back(&test, name, ExportRequest::default());
        let is_kept = ["a.raw", "a.tif", "a.ome.tif"].contains(&name);
        assert_eq!(source.info().nodata, is_kept.then_some(7.0), "{name}");
        assert_eq!(notes.iter().any(|note| note.contains("no data (7)")), !is_kept, "{name}: {notes:?}");
    }
    volume.nodata = None;
    let test = TestStore::of_kind(volume, Kind::Labels);
    for name in NAMES {
        let (_, notes) = back(&test, name, ExportRequest::default());
        let is_kept = open(&[test.folder.path().join(name)], &OpenOptions::default()).unwrap().info().kind.are_labels();
        assert_eq!(is_kept, ["a.raw", "a.nii", "a.nii.gz"].contains(&name), "{name}");
        assert_eq!(notes.iter().any(|note| note.contains("being labels")), !is_kept, "{name}: {notes:?}");
    }
}

/// The labels in a box, with their boxes in it, as 3D Slicer reads them.
#[test]
fn labels_become_segments_and_come_back_as_labels() {
    let nodata = Some(5.0);
    for voxel_type in VoxelType::ALL.into_iter().filter(|of| !of.is_float()) {
        let test = TestStore::of_kind(SourceInfo { voxel_type, nodata, ..oblique(1.0) }, Kind::Labels);
        let request = ExportRequest { region: Some(REGION), ..ExportRequest::default() };
        let expected = described(&test, &request);
        let (source, notes) = back(&test, "a.seg.nrrd", request);
        assert_voxels(&*source, REGION, "a.seg.nrrd");
        assert_eq!((source.info().voxel_type, source.info().kind.are_labels()), (voxel_type, true));
        assert_place(source.info(), &expected, "a.seg.nrrd");
        assert_eq!(notes, ["NRRD cannot keep the value of no data (5): left out."]);
        let bytes = std::fs::read(test.folder.path().join("a.seg.nrrd")).unwrap();
        let head = String::from_utf8_lossy(&bytes[..bytes.windows(2).position(|pair| pair == b"\n\n").unwrap()]);
        let keys = |key: &str| -> Vec<String> {
            let lines = head.lines().filter(|line| line.starts_with("Segment"));
            let values = lines.filter_map(|line| line.split_once(":=")).filter(|(name, _)| name.ends_with(key));
            values.map(|(_, value)| value.to_owned()).collect()
        };
        let labels: Vec<u32> = (1..120).filter(|label| *label != 5).collect();
        assert_eq!(keys("_LabelValue"), labels.iter().map(u32::to_string).collect::<Vec<_>>());
        let places = |label: u32| REGION.voxels().filter(move |at| value(0, 0, *at) == f64::from(label));
        let extents = labels.iter().map(|label| {
            let of = |axis: usize| {
                let along = || places(*label).map(move |at| at[axis] - REGION.min.to_array()[axis]);
                format!("{} {}", along().min().unwrap(), along().max().unwrap())
            };
            [0, 1, 2].map(of).join(" ")
        });
        assert_eq!(keys("_Extent"), extents.collect::<Vec<_>>());
        assert!(head.contains("kinds: domain domain domain"), "{head}");
    }
    let (_, notes) = back(&TestStore::of_kind(info(), Kind::Labels), "a.nrrd", ExportRequest::default());
    assert!(notes[1].contains("ending in .seg.nrrd keeps the labels"), "{notes:?}");
    let refused = |info: SourceInfo, value: fn(u32, u32, [u32; 3]) -> f64| {
        let test = TestStore::of_source(Function { info, value }, Kind::Labels);
        let output = test.folder.path().join("a.seg.nrrd");
        let error = export(&test.store, &output, &all(&test.store), |_, _| ControlFlow::Continue(())).unwrap_err();
        assert_eq!(std::fs::read_dir(test.folder.path()).unwrap().count(), 1);
        error.to_string()
    };
    let many = SourceInfo { extent: Extent::new(300, 300, 1), voxel_type: VoxelType::U32, ..info() };
    assert!(refused(SourceInfo { channels: 2, ..info() }, value).contains("one channel, not 2"));
    assert!(refused(SourceInfo { times: 2, ..info() }, value).contains("one time step, not 2"));
    assert!(refused(many.clone(), |_, _, [x, y, _]| f64::from(x + 300 * y)).contains("more than 65536 labels"));
    assert!(refused(many, |_, _, [x, ..]| if x == 9 { 3e9 } else { 0.0 }).contains("one is 3000000000: choose .nii"));
    // Nothing but background is a segmentation, too.
    let test = TestStore::of_source(Function { info: info(), value: |_, _, _| 0.0 }, Kind::Labels);
    assert!(back(&test, "a.seg.nrrd", ExportRequest::default()).0.info().kind.are_labels());
}

/// Each step of a collection is a file by itself, with its time.
#[test]
fn a_series_of_steps_is_a_collection() {
    let stamps = vec![-1.0, 0.5, 7.25];
    let time = TimeAxis::of_stamps(stamps.clone(), None).unwrap();
    let test = TestStore::of(SourceInfo { times: 4, time: None, channels: 2, ..placed() });
    let (source, notes) = back(&test, "n.pvd", all(&test.store));
    assert!(notes.iter().any(|note| note.contains("numbered from 0")), "{notes:?}");
    assert_eq!(source.info().time, Some(TimeAxis::default()));
    let test = TestStore::of(SourceInfo { times: 3, time: Some(time.clone()), channels: 2, ..placed() });
    let (source, _) = back(&test, "s.pvd", all(&test.store));
    assert_eq!(source.info().time, Some(time));
    for (step, time) in (0..).zip(stamps) {
        let path = test.folder.path().join(format!("s/s_000{step}.vti"));
        let text = std::fs::read(&path).unwrap();
        let text = String::from_utf8_lossy(&text[..2000]);
        assert!(text.contains(&format!(">{time}</DataArray>")), "{text}");
        let source =
            open(&[path], &OpenOptions { variable: Some("channel 1".into()), ..OpenOptions::default() }).unwrap();
        let whole = source.info().extent.full_box();
        let mut found = vec![0; whole.extent().volume() as usize * 2];
        source.read_box(0, 0, whole, &mut found).unwrap();
        let expected: Vec<u8> = whole.voxels().flat_map(|at| bytes_of(VoxelType::U16, value(step, 1, at))).collect();
        assert!(found == expected, "step {step}");
    }
}

/// Files of single steps keep their times where a series of them finds them.
#[test]
fn a_step_s_time_is_kept_with_its_file() {
    let since = Some("2000-01-01".to_owned());
    let axis = TimeAxis { start: 3.0, step: 2.0, unit: Some("second".into()), since, ..TimeAxis::default() };
    let test = TestStore::of(SourceInfo { times: 3, time: Some(axis.clone()), ..placed() });
    for (end, unit) in [("raw", Some("second")), ("vti", None), ("ome.tif", Some("second"))] {
        let paths: Vec<_> = (0..3).map(|step| test.folder.path().join(format!("s{step}.{end}"))).collect();
        for (step, path) in (0..).zip(&paths) {
            let request = ExportRequest { time: ExportTime::Step(step), ..ExportRequest::default() };
            export(&test.store, path, &request, |_, _| ControlFlow::Continue(())).unwrap();
        }
        let source = open(&paths, &OpenOptions { nodata: NoData::OfFile, ..OpenOptions::default() }).unwrap();
        assert_voxels(&*source, source.info().extent.full_box(), end);
        let found = source.info().time.clone().unwrap_or_else(|| panic!("{end}"));
        assert_eq!((found.start, found.step, found.unit.as_deref()), (3.0, 2.0, unit), "{end}");
        assert_eq!(found.since, unit.and(axis.since.clone()), "{end}");
    }
}
