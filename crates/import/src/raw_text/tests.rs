//! Texts beside raw files of known bytes.

use crate::error::ImportError;
use crate::labels::SaidKind;
use crate::open::open;
use crate::options::{NoData, OpenOptions};
use crate::source::Source;
use crate::testing::{Field, assert_boxes, temp_file};
use brickyard_volume::{Extent, VoxelType};
use proptest::prelude::*;
use std::path::Path;

const FIELD: Field = Field { sizes: [4, 3, 2, 2, 3], voxel_type: VoxelType::I16 };
const TEXT: &str = r#"{"file": "a.raw", "shape": [4, 3, 2], "dtype": "i16", "endian": "big", "offset": 5, "axes": "tczyx",
    "times": 3, "channels": 2, "channel_names": ["p", "T"], "spacing": [0.5, 1, 2], "origin": [1, -2, 3], "unit": "um",
    "time_step": 0.25, "time_unit": "s", "nodata": -1}"#;

/// Writes a raw file and a text of this name beside it.
fn written(name: &str, text: &str) -> tempfile::TempDir {
    let (folder, _) = temp_file("a.raw", &[vec![9; 5], FIELD.bytes("tczyx", true)].concat());
    std::fs::write(folder.path().join(name), text).unwrap();
    folder
}

fn opened(path: &Path) -> Result<Box<dyn Source>, String> {
    open(&[path.to_owned()], &OpenOptions::default()).map_err(|error| error.to_string())
}

#[test]
fn a_text_describes_the_file_beside_it() {
    for (text, input) in [("a.json", "a.json"), ("b.JSON", "b.JSON"), ("a.json", "a.raw"), ("a.raw.json", "a.raw")] {
        let folder = written(text, TEXT);
        let source = opened(&folder.path().join(input)).unwrap();
        assert_boxes(&*source, FIELD);
        let info = source.info();
        let names: Vec<_> = info.channel_looks.iter().map(|look| look.name.as_deref().unwrap()).collect();
        assert_eq!((names, info.nodata, info.calibrated), (vec!["p", "T"], Some(-1.0), true));
        assert_eq!(
            (info.geometry.spacing.to_array(), info.geometry.origin.to_array()),
            ([0.5, 1.0, 2.0], [1.0, -2.0, 3.0])
        );
        assert_eq!(info.geometry.unit.as_deref(), Some("micrometer"));
        let time = info.time.clone().unwrap();
        assert_eq!((time.step, time.unit.as_deref()), (0.25, Some("second")));
        assert!(info.notes.iter().any(|note| note.contains("describes the voxels of a.raw")));
    }
    // The raw file's name is the text's own, or that of the only one beside it.
    for text in ["a.raw.json", "a.json"] {
        let folder = written(text, &TEXT.replace(r#""file": "a.raw","#, ""));
        assert_boxes(&*opened(&folder.path().join(text)).unwrap(), FIELD);
    }
}

#[test]
fn wide_numbers_follow_the_rules_of_losses() {
    let numbers = [3_000_000_000i64, -1].map(i64::to_le_bytes).concat();
    let (folder, path) = temp_file("a.raw", &numbers);
    let text = r#"{"shape": [2, 1, 1], "dtype": "int64", "nodata": -1}"#;
    std::fs::write(folder.path().join("a.json"), text).unwrap();
    let opened = |options: &OpenOptions| open(std::slice::from_ref(&path), options).map_err(|error| error.to_string());
    assert!(opened(&OpenOptions::default()).err().unwrap().contains("3000000000 cannot be held as it is in i32"));
    let to = |nodata| OpenOptions { to_voxel_type: Some(VoxelType::U32), nodata, ..OpenOptions::default() };
    assert!(opened(&to(NoData::OfFile)).err().unwrap().contains("beside -1"));
    let lossy = OpenOptions { allow_lossy: true, ..OpenOptions::default() };
    let source = opened(&lossy).unwrap();
    assert_eq!((source.info().voxel_type, source.info().nodata), (VoxelType::I32, Some(-1.0)));
}

#[test]
fn the_caller_s_options_come_first() {
    let folder = written("a.json", TEXT);
    let path = folder.path().join("a.raw");
    let told = OpenOptions { nodata: NoData::None, unit: Some("meter".into()), ..OpenOptions::default() };
    let source = open(std::slice::from_ref(&path), &told).unwrap();
    assert_eq!((source.info().nodata, source.info().geometry.unit.as_deref()), (None, Some("meter")));
    let shape = OpenOptions {
        shape: Some(Extent::new(293, 1, 1)),
        voxel_type: Some(VoxelType::U8.into()),
        ..OpenOptions::default()
    };
    assert_eq!(open(&[path], &shape).unwrap().info().channels, 1);
}

#[test]
fn texts_that_say_too_little_or_too_much_are_refused() {
    let refusal = |text: &str| {
        let folder = written("a.json", text);
        opened(&folder.path().join("a.json")).err().unwrap()
    };
    let with = |from: &str, to: &str| refusal(&TEXT.replace(from, to));
    assert!(with(r#""unit""#, r#""units""#).contains("unknown field 'units'"));
    assert!(with(r#""times": 3"#, r#""times": 3, "times": 3"#).contains("duplicate field"));
    assert!(with("[4, 3, 2]", "[4, 3]").contains("a.json: a mistake in this description of a raw file: "));
    assert!(with("i16", "i128").contains("dtype 'i128'"));
    assert!(with("big", "middle").contains("endian 'middle'"));
    assert!(with("tczyx", "tczy").contains("axes 'tczy'"));
    assert!(with(r#""T"]"#, r#""T", "u"]"#).contains("3 names for 2 channels"));
    assert!(with("0.5, 1, 2", "0.5, 0, 2").contains("`spacing`"));
    assert!(with(r#""shape": [4, 3, 2],"#, "").contains("no `shape`"));
    assert!(with("a.raw", "c.raw").contains("c.raw is missing"));
    let folder = written("a.json", &TEXT.replace(r#""file": "a.raw","#, ""));
    std::fs::write(folder.path().join("a.dat"), "another").unwrap();
    assert!(opened(&folder.path().join("a.json")).err().unwrap().contains("has no `file`"));
    assert!(with(r#""times": 3"#, r#""times": 4"#).contains("expected 389 bytes"));
    let folder = written("a.json", &TEXT.replace("[4, 3, 2]", "[4, 0, 2]"));
    let error = open(&[folder.path().join("a.json")], &OpenOptions::default()).err().unwrap();
    assert!(matches!(error, ImportError::Invalid { .. }) && error.to_string().contains("size 0"), "{error}");
    assert!(refusal("{").contains("a mistake in this description"));
    let folder = written("a.json", &TEXT.replace("a.raw", "c.raw"));
    assert!(opened(&folder.path().join("a.raw")).err().unwrap().contains("describes"));
    let folder = written("a.json", TEXT);
    let told = OpenOptions { voxel_type: Some(VoxelType::U8.into()), ..OpenOptions::default() };
    let message = open(&[folder.path().join("a.json")], &told).err().unwrap().to_string();
    assert!(message.contains("`voxel_type` is for raw files"), "{message}");
}

/// Text whose end is replaced by these fields.
fn text_with(more: &str) -> String {
    TEXT.replace(r#""time_step": 0.25, "time_unit": "s", "nodata": -1"#, more)
}

#[test]
fn a_place_in_a_patient_and_times_are_told() {
    let opened_with = |more: &str| {
        let folder = written("a.json", &text_with(more));
        let source = opened(&folder.path().join("a.raw"));
        source.map(|source| (source.info().clone(), folder))
    };
    let rows = [[0.0, -1.0, 0.0, 1.0], [0.5, 0.0, 0.0, -2.0], [0.0, 0.0, 2.0, 3.0]];
    let (info, _) = opened_with(&format!(r#""orientation": {rows:?}, "labels": true"#)).unwrap();
    assert_eq!((info.orientation.unwrap().rows(), info.geometry.origin.to_array()), (rows, [1.0, -2.0, 3.0]));
    assert_eq!(info.kind, SaidKind::Labels("the text beside the raw file"));
    let time = |more: &str| opened_with(more).unwrap().0.time.unwrap();
    let late = time(r#""time_step": 0.25, "time_start": -3, "time_unit": "ms""#);
    assert_eq!((late.start, late.step, late.unit.as_deref()), (-3.0, 0.25, Some("millisecond")));
    let since = time(r#""time_step": 6, "time_unit": "h", "time_since": "2000-01-01""#);
    assert_eq!((since.step, since.since.as_deref()), (6.0, Some("2000-01-01")));
    let uneven = time(r#""time_stamps": [1, 2, 4], "time_unit": "h""#);
    assert_eq!((uneven.stamps, uneven.unit.as_deref()), (vec![1.0, 2.0, 4.0], Some("hour")));
    for (more, words) in [
        (r#""time_start": 3"#, "has time_start, but no time_step"),
        (r#""time_start": 3, "time_unit": "s""#, "has time_start, but no time_step"),
        (r#""time_start": 3, "time_stamps": [1, 2, 4]"#, "give one of the two"),
        (r#""time_step": 3, "time_stamps": [1, 2, 4]"#, "give one of the two"),
        (r#""time_since": "2000-01-01""#, "has time_since, but no times"),
        (r#""time_step": 3, "time_since": " ""#, "time_since: expected a moment"),
        (r#""time_step": 3, "time_since": "a\nb""#, "time_since: expected a moment"),
        (r#""time_stamps": [1, 2]"#, "2 numbers for 3 time steps"),
        (r#""time_stamps": [1, 2, 2]"#, "ascending"),
        (r#""orientation": [[1, 1, 0, 0], [0, 0, 0, 0], [0, 0, 1, 0]]"#, "orientation: the matrix is singular"),
        (r#""orientation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]"#, "expected an array of length 4"),
    ] {
        let found = opened_with(more).err().unwrap();
        assert!(found.contains(words), "{more}: {found}");
    }
    let degrees = text_with(&format!(r#""orientation": {rows:?}"#)).replace(r#""um""#, r#""degree,degree,hPa""#);
    let folder = written("a.json", &degrees);
    assert!(opened(&folder.path().join("a.raw")).err().unwrap().contains("one unit of length"));
}

/// Labels are whole numbers; a text may also say that voxels are none.
#[test]
fn labels_are_told_of_whole_numbers() {
    let kind = |dtype: &str, labels: bool| {
        let text = format!(r#"{{"shape": [2, 2, 1], "dtype": "{dtype}", "labels": {labels}}}"#);
        let (folder, path) = temp_file("a.raw", &[0; 16]);
        std::fs::write(folder.path().join("a.raw.json"), text).unwrap();
        opened(&path).map(|source| source.info().kind)
    };
    const WORD: &str = "the text beside the raw file";
    assert_eq!(kind("u32", true), Ok(SaidKind::Labels(WORD)));
    assert_eq!((kind("u32", false), kind("f32", false)), (Ok(SaidKind::Image(WORD)), Ok(SaidKind::Image(WORD))));
    assert!(kind("f32", true).unwrap_err().contains("labels are whole numbers"));
}

proptest! {
    #![proptest_config(crate::testing::cases(300))]

    /// Damage leads to an error or other voxels, never to a panic.
    #[test]
    fn damaged_texts_do_not_panic(damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..5)) {
        let mut text = TEXT.as_bytes().to_vec();
        for (place, value) in damage {
            let at = place.index(text.len());
            text[at] = value;
        }
        let (folder, _) = temp_file("a.raw", &[vec![9; 5], FIELD.bytes("tczyx", true)].concat());
        let path = folder.path().join("a.json");
        std::fs::write(&path, text).unwrap();
        if let Ok(source) = opened(&path) {
            let full = source.info().extent.full_box();
            let mut out = vec![0; full.extent().volume() as usize * source.info().voxel_type.bytes()];
            source.read_box(0, 0, full, &mut out).unwrap();
        }
    }
}
