//! Several slices at each position: channels, time steps, choices of series and stacks; leaning stacks.

use super::tests::{Folder, Written, enhanced, open_with, voxels};
use crate::options::{Gaps, OpenOptions};
use crate::source::Source;
use crate::testing::{is_warned, said, some_damage, spoil, try_to_read};
use dicom_core::{Tag, VR};
use dicom_dictionary_std::{tags, uids};
use dicom_object::InMemDicomObject;
use glam::DVec3;
use proptest::prelude::*;

/// First voxel of each slice of a volume.
fn firsts(source: &dyn Source, time: u32, channel: u32) -> Vec<f64> {
    let info = source.info();
    let mut bytes = vec![0; info.extent.volume() as usize * info.voxel_type.bytes()];
    source.read_box(time, channel, info.extent.full_box(), &mut bytes).unwrap();
    (0..info.extent.z as usize).map(|z| info.voxel_type.read(&bytes, 12 * z)).collect()
}

/// Slices at two heights, with each change once at each of them; slice `z` of change `i` holds values from `1000 i + 100 z`.
fn each_twice(changes: &[&[(Tag, VR, &str)]]) -> Vec<Written> {
    let slice = |z: u16, i: usize, change: &[(Tag, VR, &str)]| {
        let mut slice = Written::slice(f64::from(z) * 2.0, 1000 * i as u16 + 100 * z);
        change.iter().for_each(|(tag, vr, text)| _ = slice.text(*tag, *vr, text));
        slice
    };
    [1, 0].into_iter().flat_map(|z| changes.iter().enumerate().map(move |(i, change)| slice(z, i, change))).collect()
}

fn steps(source: &dyn Source) -> (u32, u32, Option<Vec<f64>>) {
    let info = source.info();
    let times = info.time.as_ref().map(|axis| (0..info.times).map(|step| axis.at(step)).collect());
    (info.times, info.channels, times)
}

#[test]
fn times_become_steps() {
    let is = |tag, vr, texts: [&str; 3], expected: Option<[f64; 3]>| {
        let [a, b, c] = texts;
        // The last first, so the files' order is no help.
        let (_folder, source) = Folder::opened(each_twice(&[&[(tag, vr, c)], &[(tag, vr, a)], &[(tag, vr, b)]]));
        assert_eq!(steps(&*source), (3, 1, expected.map(|times| times.to_vec())), "{tag}");
        for (time, i) in [(0, 1000.0), (1, 2000.0), (2, 0.0)] {
            assert_eq!(firsts(&*source, time, 0), [i, i + 100.0], "{tag}");
        }
    };
    is(tags::TEMPORAL_POSITION_IDENTIFIER, VR::IS, ["1", "2", "10"], None);
    is(tags::TRIGGER_TIME, VR::DS, ["0", "40.5", "81"], Some([0.0, 0.0405, 0.081]));
    is(tags::FRAME_REFERENCE_TIME, VR::DS, ["500", "1500", "3500"], Some([0.5, 1.5, 3.5]));
    is(tags::ACQUISITION_TIME, VR::TM, ["095958", "100000.5", "100003"], Some([0.0, 2.5, 5.0]));
    // Over midnight, by their dates.
    let is_dated = ["20240228235959", "20240229000001", "20240301000001"];
    is(tags::ACQUISITION_DATE_TIME, VR::DT, is_dated, Some([0.0, 2.0, 86402.0]));
    is(tags::CONTENT_TIME, VR::TM, ["10", "11", "12"], Some([0.0, 3600.0, 7200.0]));
    is(tags::ACQUISITION_NUMBER, VR::IS, ["2", "4", "11"], None);
}

/// Slices of one time step have different times, and beats of a heart different lengths.
#[test]
fn steps_of_different_positions_are_paired_beyond_doubt() {
    let folder = |tag, vr, texts: [[&str; 2]; 2]| {
        Folder::of([0, 1].into_iter().flat_map(move |z: usize| {
            texts[z].into_iter().enumerate().map(move |(i, text)| {
                let mut slice = Written::slice(z as f64, 1000 * i as u16 + 100 * z as u16);
                slice.text(tag, vr, text);
                slice
            })
        }))
    };
    let interleaved = folder(tags::ACQUISITION_TIME, VR::TM, [["100000", "100002"], ["100001", "100003"]]);
    let source = interleaved.open().unwrap();
    assert_eq!(steps(&*source), (2, 1, Some(vec![0.0, 2.0])));
    assert_eq!(firsts(&*source, 1, 0), [1000.0, 1100.0]);
    // One position after the other: these times pair nothing.
    folder(tags::ACQUISITION_TIME, VR::TM, [["100000", "100001"], ["100002", "100003"]]).refused(&[
        "has the position of",
        "4 slices at 2 positions",
        "AcquisitionTime",
        "TriggerTime",
        "InstanceNumber",
    ]);
    let beats = folder(tags::TRIGGER_TIME, VR::DS, [["0", "40"], ["5", "47"]]);
    assert_eq!(steps(&*beats.open().unwrap()), (2, 1, Some(vec![0.0, 0.04])));
    // The first step of one is missing, and the last of the other.
    folder(tags::TRIGGER_TIME, VR::DS, [["0", "40"], ["40", "80"]]).refused(&["has the position of"]);
    for texts in [[["1", "3"], ["2", "4"]], [["1", "2"], ["3", "4"]]] {
        let source = folder(tags::INSTANCE_NUMBER, VR::IS, texts);
        let source = source.open().unwrap();
        assert_eq!(steps(&*source), (2, 1, None));
        assert!(is_warned(&said(&source.info().notes), "have no times"));
    }
    folder(tags::INSTANCE_NUMBER, VR::IS, [["1", "5"], ["2", "9"]]).open().unwrap();
    folder(tags::INSTANCE_NUMBER, VR::IS, [["1", "5"], ["6", "9"]]).refused(&["has the position of"]);
    // Before or after midnight?
    folder(tags::ACQUISITION_TIME, VR::TM, [["000001", "235959"], ["000001", "235959"]]).refused(&["has the position"]);
}

#[test]
fn kinds_of_image_become_channels() {
    let is = |tag, vr, texts: [&str; 2], names: [&str; 2]| {
        let later = |text, time| [(tag, vr, text), (tags::ACQUISITION_TIME, VR::TM, time)];
        let changes = [later(texts[0], "10"), later(texts[1], "11")];
        let (_folder, source) = Folder::opened(each_twice(&[&changes[1], &changes[0]]));
        assert_eq!(steps(&*source), (1, 2, None), "{tag}");
        assert_eq!(firsts(&*source, 0, 0), [1000.0, 1100.0], "{tag}");
        assert_eq!(firsts(&*source, 0, 1), [0.0, 100.0], "{tag}");
        let found: Vec<_> = source.info().channel_looks.iter().map(|look| look.name.clone().unwrap()).collect();
        assert_eq!(found, names);
    };
    is(tags::ECHO_TIME, VR::DS, ["2.5", "10"], ["TE 2.5 ms", "TE 10 ms"]);
    is(tags::ECHO_NUMBERS, VR::IS, ["1", "2"], ["echo 1", "echo 2"]);
    is(tags::DIFFUSION_B_VALUE, VR::DS, ["0", "1000"], ["b 0", "b 1000"]);
    is(tags::IMAGE_TYPE, VR::CS, ["ORIGINAL\\PRIMARY\\M", "ORIGINAL\\PRIMARY\\P"], ["M", "P"]);
    is(tags::KVP, VR::DS, ["80", "140"], ["80 kV", "140 kV"]);
}

#[test]
fn numbers_among_texts_come_first() {
    let numbers = (1..=10).map(|n: u32| n.to_string());
    let mut texts: Vec<String> = (1..=10).flat_map(|n| [format!("{n}A"), format!("{n}B")]).collect();
    let changes: Vec<String> = texts.iter().cloned().chain(numbers.clone().rev()).collect();
    texts.sort();
    let changes: Vec<_> = changes.iter().map(|value| [(tags::ECHO_TIME, VR::DS, &**value)]).collect();
    let (_folder, source) = Folder::opened(each_twice(&changes.iter().map(|change| &change[..]).collect::<Vec<_>>()));
    let found: Vec<_> = source.info().channel_looks.iter().map(|look| look.name.clone().unwrap()).collect();
    assert_eq!(found, numbers.chain(texts).map(|value| format!("TE {value} ms")).collect::<Vec<_>>());
}

#[test]
fn channels_and_steps_go_together_if_they_are_regular() {
    let change = |te, step| [(tags::ECHO_TIME, VR::DS, te), (tags::TEMPORAL_POSITION_IDENTIFIER, VR::IS, step)];
    let all = [change("2", "1"), change("2", "2"), change("1", "1"), change("1", "2")];
    let (_folder, source) = Folder::opened(each_twice(&all.each_ref().map(|change| &change[..])));
    assert_eq!(steps(&*source), (2, 2, None));
    for (time, channel, i) in [(0, 0, 2000.0), (1, 0, 3000.0), (0, 1, 0.0), (1, 1, 1000.0)] {
        assert_eq!(firsts(&*source, time, channel), [i, i + 100.0]);
    }
    // Two images without diffusion, and one with.
    let change = |b, step| [(tags::DIFFUSION_B_VALUE, VR::DS, b), (tags::ACQUISITION_NUMBER, VR::IS, step)];
    let all = [change("0", "1"), change("500", "2"), change("0", "3")];
    let (_folder, source) = Folder::opened(each_twice(&all.each_ref().map(|change| &change[..])));
    let names: Vec<_> = source.info().channel_looks.iter().map(|look| look.name.clone().unwrap()).collect();
    assert_eq!((steps(&*source), names.join("; ").as_str()), ((1, 3, None), "b 0 (1); b 0 (2); b 500"));
    assert_eq!(firsts(&*source, 0, 1), [2000.0, 2100.0]);
}

#[test]
fn missing_and_double_slices_are_named() {
    let step = |z: f64, step: &str, first| {
        let mut slice = Written::slice(z, first);
        slice.text(tags::TEMPORAL_POSITION_IDENTIFIER, VR::IS, step);
        slice
    };
    let folder = Folder::of([
        step(0.0, "1", 0),
        step(0.0, "2", 1000),
        step(1.0, "2", 1100),
        step(2.0, "1", 200),
        step(2.0, "2", 1200),
    ]);
    folder.refused(&["IM2", "1 of 6 slices", "1 of 2 are there", "of time step 0", "`gaps` blank"]);
    let blank = OpenOptions { gaps: Gaps::Blank, ..OpenOptions::default() };
    let source = open_with(&folder, &blank).unwrap();
    assert_eq!(source.info().nodata, Some(-1.0));
    assert_eq!(firsts(&*source, 0, 0), [0.0, -1.0, 200.0]);
    assert_eq!(firsts(&*source, 1, 0), [1000.0, 1100.0, 1200.0]);
    let mut copies: Vec<Written> = (0..2).map(|_| step(0.0, "1", 0)).collect();
    copies.iter_mut().for_each(|slice| _ = slice.text(tags::SOP_INSTANCE_UID, VR::UI, "1.2.3.4"));
    Folder::of(copies).refused(&["IM1", "the same image as", "IM0", "SOPInstanceUID"]);
    // Values of one attribute that differ from position to position are no channels.
    let echoes = [(0.0, "1"), (0.0, "2"), (1.0, "3"), (1.0, "4"), (2.0, "5"), (2.0, "6")].map(|(z, te)| {
        let mut slice = Written::slice(z, 0);
        slice.text(tags::ECHO_TIME, VR::DS, te);
        slice
    });
    Folder::of(echoes).refused(&["differ in EchoTime", "6 values, all of them at 0 of 3 positions"]);
}

#[test]
fn leaning_stacks_are_sheared() {
    let slices = [2, 0, 1].map(|k: u16| {
        let mut slice = Written::slice(0.0, 100 * k);
        slice.text(tags::IMAGE_POSITION_PATIENT, VR::DS, &format!("5\\{}\\{}", 3 * k, 4 * k));
        slice
    });
    let (_folder, source) = Folder::opened(slices);
    let info = source.info();
    assert_eq!(firsts(&*source, 0, 0), [0.0, 100.0, 200.0]);
    assert_eq!(info.geometry.spacing, DVec3::new(0.5, 0.75, 5.0));
    let expected = [[-0.5, 0.0, 0.0, -5.0], [0.0, -0.75, -3.0, 0.0], [0.0, 0.0, 4.0, 0.0]];
    let found = info.orientation.unwrap().rows();
    for (f, e) in found.iter().flatten().zip(expected.iter().flatten()) {
        assert!((f - e).abs() < 1e-12, "{found:?}");
    }
    assert!(said(&info.notes).contains("leans by 36.87 degrees"), "{}", said(&info.notes));
}

#[test]
fn a_series_is_chosen_by_its_number_uid_or_name() {
    let of = |uid: &str, number: &str, name: &str, z: f64, first| {
        let mut slice = Written::slice(z, first);
        slice.text(tags::SERIES_INSTANCE_UID, VR::UI, uid).text(tags::SERIES_NUMBER, VR::IS, number);
        slice.text(tags::SERIES_DESCRIPTION, VR::LO, name);
        slice
    };
    let folder =
        Folder::of([of("1.2.3", "2", "T1", 0.0, 0), of("1.2.3", "2", "T1", 1.0, 100), of("1.2.4", "3", "T2", 0.0, 7)]);
    let open =
        |variable: &str| open_with(&folder, &OpenOptions { variable: Some(variable.into()), ..OpenOptions::default() });
    for (variable, first) in [("2", 0.0), ("1.2.4", 7.0), ("T2", 7.0), ("T1", 0.0)] {
        assert_eq!(voxels(&*open(variable).unwrap())[0], first);
    }
    folder.refused(&["2 series are mixed", "2: 1.2.3 \"T1\" of 2 files", "3: 1.2.4 \"T2\" of 1 file", "`variable`"]);
    let message = open("T3").err().unwrap().to_string();
    assert!(message.contains("0 are named 'T3'") && message.contains("\"T2\""), "{message}");
}

#[test]
fn localizers_are_left_out_of_folders() {
    let scout = |uid: &str| {
        let mut scout = Written::slice(0.0, 0);
        scout.text(tags::SERIES_INSTANCE_UID, VR::UI, uid).text(
            tags::IMAGE_TYPE,
            VR::CS,
            "ORIGINAL\\PRIMARY\\LOCALIZER",
        );
        scout.text(tags::IMAGE_ORIENTATION_PATIENT, VR::DS, "0\\1\\0\\0\\0\\-1").number(tags::ROWS, 2);
        scout
    };
    for uid in ["1.2.3", "1.2.9"] {
        let (folder, source) = Folder::opened([scout(uid), Written::slice(0.0, 0), Written::slice(1.0, 100)]);
        assert_eq!(firsts(&*source, 0, 0), [0.0, 100.0]);
        let notes = said(&source.info().notes);
        assert!(is_warned(&notes, "IM0"), "{notes}");
        // A list is the caller's choice.
        let list: Vec<_> = (0..3).map(|i| folder.file(i)).collect();
        assert!(crate::open::open(&list, &OpenOptions::default()).is_err());
    }
    assert_eq!(Folder::opened([scout("1.2.3")]).1.info().extent.z, 1);
}

/// An enhanced file of two frames, with an element of each frame's content.
fn enhanced_with(tag: Tag, vr: VR, texts: [&str; 2], heights: [&str; 2]) -> Written {
    let item = |tag, vr, text: &str| {
        let mut written = Written(InMemDicomObject::new_empty());
        written.text(tag, vr, text);
        written.0
    };
    let mut file = enhanced();
    let frame = |i: usize| {
        let mut group = Written(InMemDicomObject::new_empty());
        let position = item(tags::IMAGE_POSITION_PATIENT, VR::DS, &format!("1\\2\\{}", heights[i]));
        group.sequence(tags::PLANE_POSITION_SEQUENCE, vec![position]);
        group.sequence(tags::FRAME_CONTENT_SEQUENCE, vec![item(tag, vr, texts[i])]);
        group.0
    };
    file.sequence(tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE, vec![frame(0), frame(1)]);
    file
}

#[test]
fn frames_are_steps_or_stacks() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("enhanced");
    let open = |variable: Option<&str>| {
        let options = OpenOptions { variable: variable.map(str::to_owned), ..OpenOptions::default() };
        crate::open::open(std::slice::from_ref(&path), &options)
    };
    let save = |file: Written| file.save(&path, uids::EXPLICIT_VR_LITTLE_ENDIAN);
    let times = ["20240101000002", "20240101000000"];
    save(enhanced_with(tags::FRAME_ACQUISITION_DATE_TIME, VR::DT, times, ["5", "5"]));
    let source = open(None).unwrap();
    assert_eq!(steps(&*source), (2, 1, Some(vec![0.0, 2.0])));
    assert_eq!((firsts(&*source, 0, 0), firsts(&*source, 1, 0)), (vec![12.0], vec![0.0]));
    save(enhanced_with(tags::STACK_ID, VR::SH, ["A", "B"], ["5", "5"]));
    assert_eq!(firsts(&*open(Some("B")).unwrap(), 0, 0), [12.0]);
    let message = open(None).err().unwrap().to_string();
    assert!(message.contains("2 stacks") && message.contains("A of 1 frame, B of 1 frame"), "{message}");
    let message = open(Some("C")).err().unwrap().to_string();
    assert!(message.contains("'C' names no stack") && message.contains("A of 1 frame"), "{message}");
    // Parts of one volume need no choice.
    save(enhanced_with(tags::STACK_ID, VR::SH, ["A", "B"], ["5", "6"]));
    assert_eq!(firsts(&*open(None).unwrap(), 0, 0), [0.0, 12.0]);
}

proptest! {
    #![proptest_config(crate::testing::cases(100))]

    /// Damage of one slice or several leads to an error or other volumes, never to a panic.
    #[test]
    fn damaged_series_do_not_panic(damages in prop::collection::vec((0..8usize, some_damage()), 1..4)) {
        let steps = ["1", "2"].map(|step| [
            (tags::TEMPORAL_POSITION_IDENTIFIER, VR::IS, step),
            (tags::ACQUISITION_TIME, VR::TM, step),
            (tags::ECHO_TIME, VR::DS, "2.5"),
        ]);
        let echoes = steps.map(|[step, time, _]| [step, time, (tags::ECHO_TIME, VR::DS, "10")]);
        let folder = Folder::of(each_twice(&[&steps[0], &steps[1], &echoes[0], &echoes[1]]));
        for (file, damage) in damages {
            let mut bytes = std::fs::read(folder.file(file)).unwrap();
            spoil(&mut bytes[132..], &damage);
            std::fs::write(folder.file(file), bytes).unwrap();
        }
        try_to_read(&[folder.0.path().to_owned()]);
    }
}
