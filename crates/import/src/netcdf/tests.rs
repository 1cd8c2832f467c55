//! Files made by hand from the format's specification.

use super::open;
use crate::open::open as open_any;
use crate::options::{ArrayPlace, ChannelArray, NoData, OpenOptions};
use crate::testing::{Field, assert_boxes, said, temp_file};
use brickyard_volume::VoxelType;
use glam::DVec3;
use proptest::prelude::*;
use std::path::Path;

/// A value of an attribute.
#[derive(Clone)]
enum Value {
    Text(&'static str),
    Doubles(Vec<f64>),
}

/// A variable of a test file: the type's number, and the bytes of all its elements.
#[derive(Clone)]
struct Var {
    name: &'static str,
    dims: &'static [usize],
    kind: u32,
    attributes: Vec<(&'static str, Value)>,
    data: Vec<u8>,
}

/// A test file; a dimension of size 0 counts its records.
#[derive(Clone)]
struct Made {
    version: u8,
    dims: Vec<(&'static str, u64)>,
    records: u64,
    /// Whether the number of records is left unsaid.
    is_streamed: bool,
    vars: Vec<Var>,
}

const SIZES: [(u32, u64); 11] =
    [(1, 1), (2, 1), (3, 2), (4, 4), (5, 4), (6, 8), (7, 1), (8, 2), (9, 4), (10, 8), (11, 8)];

fn padded(mut bytes: Vec<u8>) -> Vec<u8> {
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    bytes
}

impl Made {
    fn count(&self, number: u64) -> Vec<u8> {
        if self.version == 5 { number.to_be_bytes().to_vec() } else { (number as u32).to_be_bytes().to_vec() }
    }

    fn name(&self, name: &str) -> Vec<u8> {
        [self.count(name.len() as u64), padded(name.into())].concat()
    }

    fn list(&self, tag: u32, entries: Vec<Vec<u8>>) -> Vec<u8> {
        let tag = if entries.is_empty() { 0 } else { tag };
        [tag.to_be_bytes().to_vec(), self.count(entries.len() as u64), entries.concat()].concat()
    }

    fn attributes(&self, attributes: &[(&'static str, Value)]) -> Vec<u8> {
        let entry = |(name, value): &(&'static str, Value)| {
            let (kind, count, bytes) = match value {
                Value::Text(text) => (2u32, text.len(), text.as_bytes().to_vec()),
                Value::Doubles(numbers) => {
                    (6, numbers.len(), numbers.iter().flat_map(|number| number.to_be_bytes()).collect())
                }
            };
            [self.name(name), kind.to_be_bytes().to_vec(), self.count(count as u64), padded(bytes)].concat()
        };
        self.list(12, attributes.iter().map(entry).collect())
    }

    fn is_record(&self, var: &Var) -> bool {
        var.dims.first().is_some_and(|dim| self.dims[*dim].1 == 0)
    }

    /// Bytes of a variable, or of one record.
    fn bytes_of(&self, var: &Var) -> u64 {
        let size = SIZES.iter().find(|(kind, _)| *kind == var.kind).map_or(1, |(_, size)| *size);
        var.dims.iter().map(|dim| self.dims[*dim].1.max(1)).product::<u64>() * size
    }

    fn header(&self, begins: &[u64]) -> Vec<u8> {
        let dims = self.dims.iter().map(|(name, size)| [self.name(name), self.count(*size)].concat());
        let vars = self.vars.iter().zip(begins).map(|(var, begin)| {
            let dims: Vec<u8> = var.dims.iter().flat_map(|dim| self.count(*dim as u64)).collect();
            let begin =
                if self.version == 1 { (*begin as u32).to_be_bytes().to_vec() } else { begin.to_be_bytes().to_vec() };
            [
                self.name(var.name),
                self.count(var.dims.len() as u64),
                dims,
                self.attributes(&var.attributes),
                var.kind.to_be_bytes().to_vec(),
                // Wrong on purpose.
                self.count(0xffff_ffff),
                begin,
            ]
            .concat()
        });
        let records = if self.is_streamed { u64::MAX } else { self.records };
        [
            vec![b'C', b'D', b'F', self.version],
            self.count(records),
            self.list(10, dims.collect()),
            self.list(12, Vec::new()),
            self.list(11, vars.collect()),
        ]
        .concat()
    }

    fn finish(&self) -> Vec<u8> {
        let mut at = self.header(&vec![0; self.vars.len()]).len() as u64;
        let (records, fixed): (Vec<usize>, Vec<usize>) =
            (0..self.vars.len()).partition(|v| self.is_record(&self.vars[*v]));
        let mut begins = vec![0; self.vars.len()];
        for v in fixed.iter().chain(&records) {
            begins[*v] = at;
            let bytes = self.bytes_of(&self.vars[*v]);
            at += if records.len() == 1 && records[0] == *v { bytes } else { bytes.next_multiple_of(4) };
        }
        let mut file = self.header(&begins);
        for v in fixed {
            file.extend(padded(self.vars[v].data.clone()));
        }
        for record in 0..self.records as usize {
            for v in &records {
                let bytes = self.bytes_of(&self.vars[*v]) as usize;
                let part = self.vars[*v].data[record * bytes..][..bytes].to_vec();
                // Padding is no zero, so that it would be seen.
                let padding = if records.len() == 1 { 0 } else { bytes.next_multiple_of(4) - bytes };
                file.extend([part, vec![0xee; padding]].concat());
            }
        }
        file
    }
}

fn kind_of(voxel_type: VoxelType) -> u32 {
    match voxel_type {
        VoxelType::I8 => 1,
        VoxelType::I16 => 3,
        VoxelType::I32 => 4,
        VoxelType::F32 => 5,
        VoxelType::U8 => 7,
        VoxelType::U16 => 8,
        VoxelType::U32 => 9,
    }
}

fn var(name: &'static str, dims: &'static [usize], kind: u32, data: Vec<u8>) -> Var {
    Var { name, dims, kind, attributes: Vec::new(), data }
}

fn doubles(numbers: &[f64]) -> Vec<u8> {
    numbers.iter().flat_map(|number| number.to_be_bytes()).collect()
}

fn opened(made: &Made) -> (tempfile::TempDir, Box<dyn crate::source::Source>) {
    let (folder, path) = temp_file("a.nc", &made.finish());
    let source = open_any(&[path], &OpenOptions::default()).unwrap();
    (folder, source)
}

fn refusal(bytes: &[u8], options: &OpenOptions) -> String {
    let (_folder, path) = temp_file("a.nc", bytes);
    open(&path, options).err().unwrap().to_string()
}

const DIMS: [(&str, u64); 4] = [("time", 0), ("z", 4), ("y", 5), ("x", 7)];

#[test]
fn every_version_type_and_kind_of_records_is_read() {
    for (version, voxel_type) in
        [1, 2, 5].into_iter().flat_map(|version| VoxelType::ALL.into_iter().map(move |of| (version, of)))
    {
        if version < 5 && kind_of(voxel_type) > 6 {
            continue;
        }
        let field = Field { sizes: [7, 5, 4, 1, 3], voxel_type };
        let of_field = var("a", &[0, 1, 2, 3], kind_of(voxel_type), field.bytes("tzyx", true));
        let beside = var("b", &[0], 3, vec![9; 6]);
        for (vars, is_streamed) in [
            (vec![of_field.clone()], false),
            (vec![of_field.clone()], true),
            (vec![beside.clone(), of_field.clone()], false),
            (vec![of_field.clone(), beside.clone()], true),
        ] {
            let made = Made { version, dims: DIMS.to_vec(), records: 3, is_streamed, vars };
            let (_folder, source) = opened(&made);
            assert_boxes(&*source, field);
            assert_eq!(said(&source.info().notes).contains("was never written"), is_streamed);
        }
        let flat = Field { sizes: [7, 5, 4, 1, 1], voxel_type };
        let fixed = var("a", &[1, 2, 3], kind_of(voxel_type), flat.bytes("zyx", true));
        let made = Made { version, dims: DIMS.to_vec(), records: 3, is_streamed: false, vars: vec![beside, fixed] };
        assert_boxes(&*opened(&made).1, flat);
    }
}

/// Three records of 3 bytes each lie without padding if alone, and with it beside others.
#[test]
fn padding_of_odd_records_depends_on_their_number() {
    let field = Field { sizes: [3, 1, 1, 1, 4], voxel_type: VoxelType::I8 };
    let dims = vec![("time", 0), ("y", 1), ("x", 3)];
    let odd = var("a", &[0, 1, 2], 1, field.bytes("tyx", true));
    for others in [vec![], vec![var("b", &[0], 1, vec![7; 4])]] {
        let vars = [vec![odd.clone()], others].concat();
        let made = Made { version: 1, dims: dims.clone(), records: 4, is_streamed: false, vars };
        assert_boxes(&*opened(&made).1, field);
    }
}

/// 64-bit numbers of records are searched for losses record by record.
#[test]
fn wide_numbers_between_others_are_checked() {
    let wide = var("a", &[0, 1, 2], 6, doubles(&[1.0, 2.0, 3.0, 4.0, 5.0, 0.5, 1e10, 8.0]));
    // Read as doubles of `a`, these would be lost.
    let beside = var("b", &[0], 6, doubles(&[0.1, 0.1]));
    let dims = vec![("time", 0), ("y", 2), ("x", 2)];
    let made = Made { version: 2, dims, records: 2, is_streamed: false, vars: vec![wide, beside] };
    let (_folder, source) = opened(&made);
    assert!(said(&source.info().notes).contains("no value is changed"));
    let mut out = [0; 16];
    source.read_box(1, 0, source.info().extent.full_box(), &mut out).unwrap();
    let found: Vec<f64> = (0..4).map(|i| VoxelType::F32.read(&out, i)).collect();
    assert_eq!(found, [5.0, 0.5, 1e10, 8.0]);
}

fn climate() -> Made {
    let text = |name, text| (name, Value::Text(text));
    let data: Vec<u8> = (0..24i16).flat_map(|n| n.to_be_bytes()).collect();
    let temperature = Var {
        attributes: vec![
            ("scale_factor", Value::Doubles(vec![0.5])),
            ("add_offset", Value::Doubles(vec![200.0])),
            ("missing_value", Value::Doubles(vec![3.0])),
            text("units", "K"),
        ],
        ..var("t2m", &[0, 1, 2], 3, data)
    };
    let hours =
        Var { attributes: vec![text("units", "hours since 2000-01-01")], ..var("when", &[0], 6, doubles(&[0.0, 6.0])) };
    let down =
        Var { attributes: vec![text("units", "degrees_north")], ..var("phi", &[1], 6, doubles(&[60.0, 57.5, 55.0])) };
    let along = Var {
        attributes: vec![text("units", "degrees_east")],
        ..var("lambda", &[2], 6, doubles(&[10.0, 12.5, 15.0, 17.5]))
    };
    let dims = vec![("when", 0), ("phi", 3), ("lambda", 4)];
    Made { version: 1, dims, records: 2, is_streamed: false, vars: vec![hours, temperature, down, along] }
}

/// Notes that ask for a place are stale once it is given.
#[test]
fn what_the_caller_gives_is_not_asked_for() {
    let mut made = climate();
    made.vars[3].data = doubles(&[10.0, 12.0, 15.0, 17.5]);
    let (_folder, path) = temp_file("a.nc", &made.finish());
    let told = |options: OpenOptions| said(&open_any(std::slice::from_ref(&path), &options).unwrap().info().notes);
    let has = |told: &str| {
        ["are not evenly spaced", "`spacing`, `origin` and `unit` give a place", "`flip` y", "hours since"]
            .map(|words| told.contains(words))
    };
    let (spacing, origin) = (Some(glam::DVec3::ONE), Some(glam::DVec3::ZERO));
    let plain = OpenOptions::default;
    assert_eq!(has(&told(plain())), [true; 4]);
    assert_eq!(has(&told(OpenOptions { spacing, ..plain() })), [false, true, true, true]);
    assert_eq!(has(&told(OpenOptions { spacing, origin, ..plain() })), [false, false, true, true]);
    let flip = [false, true, false];
    // The file's time of the first step holds beside another step.
    let all = OpenOptions { spacing, origin, flip: Some(flip), time_step: Some(6.0), ..plain() };
    assert_eq!(has(&told(all)), [false, false, false, true]);
    // Nor is anything said once for each channel of the file.
    made.vars.push(Var { name: "t3m", ..climate().vars.swap_remove(1) });
    std::fs::write(&path, made.finish()).unwrap();
    let array = |name: &str| ChannelArray { name: name.into(), place: ArrayPlace::Input(name.into()) };
    let both = told(OpenOptions { channel_arrays: ["t2m", "t3m"].map(array).to_vec(), ..plain() });
    assert_eq!(has(&both), [true; 4], "{both}");
    assert_eq!(both.matches("are not evenly spaced").count(), 1, "{both}");
}

/// Axes are known by units alone, and a latitude that descends is turned round.
#[test]
fn values_and_places_follow_cf() {
    let (_folder, source) = opened(&climate());
    let info = source.info();
    assert_eq!((info.extent.to_array(), info.times, info.voxel_type), ([4, 3, 1], 2, VoxelType::F32));
    assert_eq!(info.geometry.spacing.truncate().to_array(), [2.5, 2.5]);
    assert_eq!(info.geometry.origin, DVec3::new(10.0, 55.0, 0.0));
    assert!(info.calibrated && info.knows_nodata && info.nodata.is_none());
    assert!(said(&info.notes).contains("Voxels stored as 3 hold no data, according to the file (missing_value)"));
    let time = info.time.clone().unwrap();
    assert_eq!((time.step, time.unit.as_deref(), time.since.as_deref()), (6.0, Some("hour"), Some("2000-01-01")));
    assert!(said(&info.notes).contains("phi descend from 60 to 55: the volume is turned round along y"));
    let mut out = [0; 48];
    source.read_box(1, 0, info.extent.full_box(), &mut out).unwrap();
    // The first row is the last in the file: latitude 55.
    assert_eq!(VoxelType::F32.read(&out, 0), (12.0 + 8.0) * 0.5 + 200.0);
    assert_eq!(VoxelType::F32.read(&out, 11), (12.0 + 3.0) * 0.5 + 200.0);
}

/// One record, at its own time.
fn hour(number: f64, has_coordinates: bool) -> Vec<u8> {
    let mut made = climate();
    made.records = 1;
    made.vars[0].data = doubles(&[number]);
    if !has_coordinates {
        made.vars.truncate(2);
    }
    made.finish()
}

#[test]
fn the_times_of_single_records_are_those_of_their_series() {
    let (folder, first) = temp_file("a_0.nc", &hour(6.0, true));
    let second = folder.path().join("a_1.nc");
    std::fs::write(&second, hour(18.0, true)).unwrap();
    let one = open_any(std::slice::from_ref(&first), &OpenOptions::default()).unwrap();
    assert_eq!(one.step_time().stamp.unwrap().in_words(), "6 hour since 2000-01-01");
    let series = open_any(&[first.clone(), second.clone()], &OpenOptions::default()).unwrap();
    let time = series.info().time.clone().unwrap();
    assert_eq!((time.start, time.step, time.since.as_deref()), (6.0, 12.0, Some("2000-01-01")));
    // One without coordinates would lie upside down, whatever place is given.
    std::fs::write(&second, hour(18.0, false)).unwrap();
    let placed = OpenOptions { spacing: Some(DVec3::ONE), origin: Some(DVec3::ZERO), ..OpenOptions::default() };
    for paths in [[first.clone(), second.clone()], [second, first]] {
        let options = OpenOptions { order: Some(crate::options::FileOrder::Given), ..placed.clone() };
        let message = open_any(&paths, &options).err().unwrap().to_string();
        assert!(
            message.contains("turned round along y") && message.contains("give all files coordinates"),
            "{message}"
        );
    }
}

/// A step without a place of its own lies as those before; one with a place where it says.
#[test]
fn steps_are_turned_as_those_before() {
    use crate::options::HeldAs;
    let options = |turned| OpenOptions {
        held_as: Some(HeldAs { voxel_type: VoxelType::F32, nodata: None, turned }),
        ..OpenOptions::default()
    };
    let along_y = [false, true, false];
    let (_folder, path) = temp_file("a.nc", &hour(6.0, false));
    let (_other, placed) = temp_file("b.nc", &hour(6.0, true));
    let opened = |path: &Path, options: &OpenOptions| open_any(&[path.to_owned()], options).unwrap();
    // The fourth number of the first row is no data.
    let values = |source: &dyn crate::source::Source| {
        let found = values(source).into_iter().map(|value| if value.is_nan() { -1.0 } else { value });
        found.collect::<Vec<f64>>()
    };
    let plain = values(&*opened(&path, &options([false; 3])));
    let source = opened(&path, &options(along_y));
    assert_eq!(values(&*source), [&plain[8..], &plain[4..8], &plain[..4]].concat());
    assert_eq!(source.info().turned, along_y);
    assert!(said(&source.info().notes).contains("turned round along y as those are; `flip` none takes them"));
    let as_the_store = OpenOptions { flip: Some([false; 3]), ..options(along_y) };
    let source = opened(&path, &as_the_store);
    assert_eq!((values(&*source), source.info().turned), (plain.clone(), along_y));
    let flipped = OpenOptions { flip: Some(along_y), ..options(along_y) };
    assert_eq!(values(&*opened(&path, &flipped)), plain);
    assert_eq!(values(&*opened(&placed, &options(along_y))), values(&*opened(&placed, &options([false; 3]))));
    assert_eq!(opened(&placed, &options([false; 3])).info().turned, along_y);
    let told = OpenOptions { origin: Some(DVec3::ZERO), ..options(along_y) };
    let message = open_any(&[path], &told).err().unwrap().to_string();
    assert!(
        message.contains("turned round along y") && message.contains("without `spacing` and `origin`"),
        "{message}"
    );
}

/// Packed 64-bit numbers in a store's type: their fill value becomes that of the store, and no number does.
#[test]
fn fills_of_wide_numbers_become_that_of_the_steps_before() {
    use crate::options::HeldAs;
    let opened = |numbers: &[i64], nodata| {
        let data = numbers.iter().flat_map(|number| number.to_be_bytes()).collect();
        let fill = ("_FillValue", Value::Doubles(vec![-999.0]));
        let scale = ("scale_factor", Value::Doubles(vec![2.0]));
        let (_folder, path) = temp_file("a.nc", &with(&[fill, scale], 10, data).finish());
        let options = OpenOptions {
            held_as: Some(HeldAs { voxel_type: VoxelType::U16, nodata, turned: [false; 3] }),
            to_voxel_type: Some(VoxelType::U16),
            variable: Some("a".into()),
            ..OpenOptions::default()
        };
        open_any(&[path], &options).map(|source| (values(&*source), source.info().nodata)).map_err(|e| e.to_string())
    };
    assert_eq!(opened(&[1, -999, 300], Some(65534.0)), Ok((vec![2.0, 65534.0, 600.0], Some(65534.0))));
    assert!(opened(&[1, 32767], Some(65534.0)).unwrap_err().contains("beside 65534"));
    assert_eq!(opened(&[1, 32767], None), Ok((vec![2.0, 65534.0], None)));
    assert!(opened(&[1, -999], None).unwrap_err().contains("no data"));
}

/// Values of the first step, x fastest.
fn values(source: &dyn crate::source::Source) -> Vec<f64> {
    let info = source.info();
    let count = info.extent.volume() as usize;
    let mut out = vec![0; count * info.voxel_type.bytes()];
    source.read_box(0, 0, info.extent.full_box(), &mut out).unwrap();
    (0..count).map(|i| info.voxel_type.read(&out, i)).collect()
}

fn with(attributes: &[(&'static str, Value)], kind: u32, data: Vec<u8>) -> Made {
    let bytes = SIZES.iter().find(|(of, _)| *of == kind).map_or(1, |(_, bytes)| *bytes);
    let x = data.len() as u64 / bytes;
    let packed = Var { attributes: attributes.to_vec(), ..var("a", &[0, 1], kind, data) };
    Made { version: 5, dims: vec![("y", 1), ("x", x)], records: 0, is_streamed: false, vars: vec![packed] }
}

#[test]
fn scales_in_words_are_numbers_and_others_are_told() {
    let number = |number: f64| Value::Doubles(vec![number]);
    let units = ("units", Value::Text("K"));
    let told = OpenOptions { variable: Some("a".into()), ..OpenOptions::default() };
    let opened = |attributes: &[(&'static str, Value)]| {
        let (_folder, path) = temp_file("a.nc", &with(attributes, 7, vec![2, 4, 6]).finish());
        let source = open(&path, &told).unwrap();
        let unit = source.info().channel_looks.first().and_then(|look| look.unit.clone());
        (values(&*source), unit.is_some(), said(&source.info().notes))
    };
    let (found, has_unit, _) =
        opened(&[("scale_factor", Value::Text("0.5")), ("add_offset", number(1.0)), units.clone()]);
    assert_eq!((found, has_unit), (vec![2.0, 3.0, 4.0], true));
    for (scale, why) in [
        (Value::Text("half"), "scale_factor is no single number"),
        (Value::Doubles(vec![0.5, 0.5]), "scale_factor is no single number"),
        (number(0.0), "make no values"),
    ] {
        let (found, has_unit, notes) = opened(&[("scale_factor", scale), units.clone()]);
        assert_eq!((found, has_unit), (vec![2.0, 4.0, 6.0], false));
        assert!(notes.contains(why) && notes.contains("the stored numbers are kept"), "{notes}");
    }
    let (_, _, notes) = opened(&[("_FillValue", Value::Text("none")), ("missing_value", Value::Text("-"))]);
    assert!(notes.contains("_FillValue is no single number") && notes.contains("missing_value is no number"));
}

/// Marks of doubles that f32 does not hold: the stored number is no data, and its neighbours are data.
#[test]
fn marks_of_doubles_may_be_beyond_f32() {
    let numbers = |mark: f64| doubles(&[mark, 1.5, -2.0]);
    let number = |number: f64| Value::Doubles(vec![number]);
    for (name, mark) in [("_FillValue", 1e20), ("missing_value", -9999.9), ("_FillValue", 1e300)] {
        let (_folder, path) = temp_file("a.nc", &with(&[(name, number(mark))], 6, numbers(mark)).finish());
        let told = OpenOptions { variable: Some("a".into()), ..OpenOptions::default() };
        let source = open(&path, &told).unwrap();
        let found = values(&*source);
        assert!(found[0].is_nan() && found[1..] == [1.5, -2.0] && source.info().knows_nodata, "{found:?}");
        let nodata = NoData::None;
        let kept = open(&path, &OpenOptions { nodata, allow_lossy: true, ..told }).unwrap();
        assert_eq!(values(&*kept)[0], f64::from(mark as f32), "{mark}");
    }
}

/// A fill value stands for the same bits as the numbers, whatever their sign.
#[test]
fn the_sign_of_numbers_and_fills_may_be_told_apart_from_their_type() {
    let cases = [("true", 1, -1.0, 255.0, [1.0, 255.0, 128.0]), ("false", 7, 255.0, -1.0, [1.0, -1.0, -128.0])];
    for (sign, kind, fill, nodata, expected) in cases {
        let attributes = [("_Unsigned", Value::Text(sign)), ("_FillValue", Value::Doubles(vec![fill]))];
        let (_folder, path) = temp_file("a.nc", &with(&attributes, kind, vec![1, 255, 128]).finish());
        let source = open(&path, &OpenOptions { variable: Some("a".into()), ..OpenOptions::default() }).unwrap();
        assert_eq!((values(&*source), source.info().nodata), (expected.to_vec(), Some(nodata)), "{sign}");
    }
}

/// Files of a model's or a reanalysis' output each have a scale of their own, and so a fill value of another value.
#[test]
fn files_packed_by_scales_of_their_own_are_one_series() {
    let (folder, first) = temp_file("t0.nc", &[]);
    let second = folder.path().join("t1.nc");
    for (path, scale) in [(&first, 0.5), (&second, 0.25)] {
        let attributes =
            [("scale_factor", Value::Doubles(vec![scale])), ("_FillValue", Value::Doubles(vec![-32767.0]))];
        let data: Vec<u8> = [4i16, -32767, 8].iter().flat_map(|n| n.to_be_bytes()).collect();
        std::fs::write(path, with(&attributes, 3, data).finish()).unwrap();
    }
    let told = OpenOptions { variable: Some("a".into()), ..OpenOptions::default() };
    let source = open_any(&[first.clone(), second], &told).unwrap();
    let mut out = [0; 12];
    for (time, expected) in [(0, [2.0, 4.0]), (1, [1.0, 2.0])] {
        source.read_box(time, 0, source.info().extent.full_box(), &mut out).unwrap();
        let found: Vec<f64> = (0..3).map(|i| VoxelType::F32.read(&out, i)).collect();
        assert!(found[1].is_nan() && [found[0], found[2]] == expected, "{found:?}");
    }
    assert!(said(&source.info().notes).contains("Voxels stored as -32767 hold no data"));
    let kept = OpenOptions { nodata: NoData::None, ..told.clone() };
    assert_eq!(values(&*open_any(&[first], &kept).unwrap())[1], -16383.5);
    // NetCDF's own fill value of 64-bit integers is no loss, either.
    let data: Vec<u8> = [4i64, -9223372036854775806].iter().flat_map(|n| n.to_be_bytes()).collect();
    let (_folder, path) = temp_file("a.nc", &with(&[("scale_factor", Value::Doubles(vec![0.5]))], 10, data).finish());
    let found = values(&*open(&path, &told).unwrap());
    assert!(found[0] == 2.0 && found[1].is_nan(), "{found:?}");
}

fn minc(limits: &[f64], valid: [f64; 2]) -> Made {
    let ends = |offset: f64| doubles(&limits.iter().map(|limit| limit + offset).collect::<Vec<_>>());
    let image = Var {
        attributes: vec![("signtype", Value::Text("unsigned")), ("valid_range", Value::Doubles(valid.to_vec()))],
        ..var("image", &[0, 1, 2], 1, (0..24).map(|n| n * 10).collect())
    };
    let space = |name, step, start| Var {
        attributes: vec![
            ("step", Value::Doubles(vec![step])),
            ("start", Value::Doubles(vec![start])),
            ("units", Value::Text("mm")),
        ],
        ..var(name, &[], 4, vec![0; 4])
    };
    let vars = vec![
        image,
        var("image-max", &[0], 6, ends(255.0)),
        var("image-min", &[0], 6, ends(0.0)),
        space("xspace", 2.0, -3.0),
        space("yspace", -1.5, 7.0),
        space("zspace", 4.0, 0.5),
    ];
    let dims = vec![("zspace", 2), ("yspace", 3), ("xspace", 4)];
    Made { version: 1, dims, records: 0, is_streamed: false, vars }
}

#[test]
fn minc_is_scaled_slice_by_slice_and_placed() {
    let read = |made: &Made| {
        let (_folder, source) = opened(made);
        let info = source.info().clone();
        let mut out = vec![0; 24 * info.voxel_type.bytes()];
        source.read_box(0, 0, info.extent.full_box(), &mut out).unwrap();
        let values: Vec<f64> = (0..24).map(|i| info.voxel_type.read(&out, i)).collect();
        (info, values)
    };
    let (info, values) = read(&minc(&[100.0, 300.0], [0.0, 255.0]));
    assert_eq!(values[..2], [100.0, 110.0]);
    assert_eq!(values[12..14], [300.0 + 120.0, 300.0 + 130.0]);
    assert_eq!(
        (info.voxel_type, info.calibrated, info.geometry.unit.as_deref()),
        (VoxelType::F32, true, Some("millimeter"))
    );
    assert_eq!(info.geometry.spacing, DVec3::new(2.0, 1.5, 4.0));
    let orientation = info.orientation.unwrap();
    assert_eq!(
        (orientation.first_centre(), orientation.step(1)),
        (DVec3::new(-3.0, 7.0, 0.5), DVec3::new(0.0, -1.5, 0.0))
    );
    // Numbers beyond the valid ones are the nearest, as in nibabel.
    let (_, values) = read(&minc(&[0.0, 0.0], [0.0, 51.0]));
    assert_eq!((values[5], values[6]), (250.0, 255.0));
    // One scale that changes nothing leaves bytes, as of labels.
    let (info, values) = read(&minc(&[0.0, 0.0], [0.0, 255.0]));
    assert_eq!((info.voxel_type, values[23]), (VoxelType::U8, 230.0));
}

#[test]
fn variables_are_chosen_and_named() {
    let none = OpenOptions::default();
    let told = |name: &str| OpenOptions { variable: Some(name.into()), ..none.clone() };
    let made = climate();
    let mut twice = made.clone();
    twice.vars.push(Var { name: "t2m_error", ..made.vars[1].clone() });
    let message = refusal(&twice.finish(), &none);
    assert!(message.contains("holds 2 datasets") && message.contains("t2m (2 x 3 x 4, i16)"), "{message}");
    let (_folder, path) = temp_file("a.nc", &twice.finish());
    assert!(open(&path, &told("/t2m_error")).is_ok());
    assert!(refusal(&twice.finish(), &told("t2")).contains("of like names are t2m (2 x 3 x 4, i16), t2m_error"));
    assert!(refusal(&twice.finish(), &told("phi")).contains("of 1 axis"));
    let text = Made { vars: vec![var("names", &[1, 2], 2, vec![b'a'; 12])], ..made };
    assert!(refusal(&text.finish(), &none).contains("names (3 x 4, characters)"));
    assert!(refusal(&text.finish(), &told("names")).contains("characters of names is not supported"));
}

#[test]
fn cut_and_damaged_files_are_refused() {
    let none = OpenOptions::default();
    let whole = climate().finish();
    for length in [4, 7, 40, 200, whole.len() - 5] {
        let message = refusal(&whole[..length], &none);
        assert!(message.contains("cut short"), "{length}: {message}");
    }
    assert!(refusal(b"CDF\x03....", &none).contains("not a classic NetCDF file"));
    let mut empty = climate();
    (empty.records, empty.is_streamed) = (0, true);
    assert!(refusal(&empty.finish(), &OpenOptions { variable: Some("t2m".into()), ..none }).contains("axis of size 0"));
}

proptest! {
    #![proptest_config(crate::testing::cases(300))]

    /// Damage leads to an error or wrong voxels, never to a panic.
    #[test]
    fn damaged_files_do_not_panic(
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        version in prop::sample::select(vec![1u8, 2, 5]),
        is_minc in any::<bool>(),
        is_cut in any::<bool>(),
        length in any::<prop::sample::Index>(),
    ) {
        let made = if is_minc { minc(&[1.0, 2.0], [0.0, 200.0]) } else { climate() };
        let mut bytes = Made { version, ..made }.finish();
        for (place, value) in damage {
            let place = place.index(bytes.len());
            bytes[place] = value;
        }
        if is_cut {
            bytes.truncate(length.index(bytes.len()));
        }
        let (_folder, path) = temp_file("a.nc", &bytes);
        read_all(&path);
    }
}

fn read_all(path: &Path) {
    if let Ok(source) = open(path, &OpenOptions { allow_lossy: true, ..OpenOptions::default() }) {
        let full = source.info().extent.full_box();
        if full.extent().volume() < 1 << 20 {
            let mut out = vec![0; full.extent().volume() as usize * source.info().voxel_type.bytes()];
            let _ = source.read_box(source.info().times - 1, 0, full, &mut out);
        }
    }
}
