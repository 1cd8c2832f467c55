//! Tests of the adapters of a source, alone and together: a box, channels and steps, an order, a type. Every voxel of the source is a
//! formula of its place, so every voxel of an adapter has a known value and place.

use crate::axes::Sizes;
use crate::choice::{ChannelChoice, StepChoice};
use crate::error::ImportError;
use crate::open::open;
use crate::options::{HeldAs, NoData, OpenOptions};
use crate::source::{Access, Lent, Source, SourceInfo, Take};
use crate::taken::take;
use crate::testing::{said, temp_file};
use brickyard_volume::{ChannelLook, Extent, Orientation, TimeAxis, VoxelBox, VoxelType, with_voxel_type};
use glam::DVec3;
use proptest::prelude::*;
use std::path::Path;
use std::sync::{Arc, Mutex};

/// The value of a voxel: different for all voxels of these small volumes.
fn formula(x: u32, y: u32, z: u32, c: u32, t: u32) -> f64 {
    f64::from(x) + 20.0 * f64::from(y) + 300.0 * f64::from(z) + 4000.0 * f64::from(c) + 10000.0 * f64::from(t)
}

type Value = fn(u32, u32, u32, u32, u32) -> f64;

/// A source of a formula, which keeps a list of the boxes read.
struct Formula {
    info: SourceInfo,
    access: Access,
    lends: bool,
    value: Value,
    reads: Arc<Mutex<Vec<VoxelBox>>>,
}

impl Formula {
    fn new(voxel_type: VoxelType) -> Self {
        let sizes = Sizes { extent: Extent::new(9, 7, 5), channels: 3, times: 6 };
        let mut info = SourceInfo::plain(sizes, voxel_type);
        info.geometry.spacing = DVec3::new(0.5, 1.0, 2.0);
        info.geometry.origin = DVec3::new(10.0, 20.0, 30.0);
        info.identity = "formula".into();
        let look = |name: &str| ChannelLook { name: Some(name.into()), ..ChannelLook::default() };
        info.channel_looks = ["DAPI", "488", "red"].map(look).to_vec();
        info.time = Some(TimeAxis { start: 3.0, step: 0.5, ..TimeAxis::default() });
        Self { info, access: Access::Box, lends: false, value: formula, reads: Arc::default() }
    }

    fn of(value: Value) -> Self {
        Self { value, ..Self::new(VoxelType::F32) }
    }

    fn bytes(&self, time: u32, channel: u32, region: VoxelBox) -> Vec<u8> {
        let value = |[x, y, z]: [u32; 3]| (self.value)(x, y, z, channel, time);
        region.voxels().flat_map(|at| encoded(self.info.voxel_type, value(at))).collect()
    }

    fn take(self, options: &OpenOptions) -> Result<Box<dyn Source>, String> {
        take(Box::new(self), options, Path::new("in.npy")).map_err(|error| error.to_string())
    }
}

fn encoded(voxel_type: VoxelType, value: f64) -> Vec<u8> {
    with_voxel_type!(voxel_type, T => (value as T).to_le_bytes().to_vec())
}

impl Source for Formula {
    fn info(&self) -> &SourceInfo {
        &self.info
    }
    fn access(&self) -> Access {
        self.access
    }
    fn reader_bytes(&self) -> u64 {
        1000
    }
    fn held_bytes(&self) -> u64 {
        200
    }
    fn scratch_bytes(&self) -> u64 {
        30
    }
    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.info.check_box(time, channel, region, out);
        self.reads.lock().unwrap().push(region);
        out.copy_from_slice(&self.bytes(time, channel, region));
        Ok(())
    }
    fn lend(&self, time: u32, channel: u32, region: VoxelBox, take: Take<'_>) -> Result<bool, ImportError> {
        if self.lends {
            let (bytes, row) = (self.bytes(time, channel, region), region.extent().x as usize);
            let row_bytes = row * self.info.voxel_type.bytes();
            let slice_bytes = row_bytes * region.extent().y as usize;
            for (z, bytes) in bytes.chunks_exact(slice_bytes).enumerate() {
                take(Lent { slices: z..z + 1, bytes, row_bytes, slice_bytes });
            }
        }
        Ok(self.lends)
    }
    fn constant_in(&self, _: u32, channel: u32, region: VoxelBox) -> Option<f64> {
        (channel == 2 && region.min.x >= 4).then_some(77.0)
    }
}

fn read(source: &dyn Source, time: u32, channel: u32, region: VoxelBox) -> Vec<f64> {
    let voxel_type = source.info().voxel_type;
    let mut out = vec![0; region.extent().volume() as usize * voxel_type.bytes()];
    source.read_box(time, channel, region, &mut out).unwrap();
    (0..region.extent().volume() as usize).map(|i| voxel_type.read(&out, i)).collect()
}

fn roi() -> OpenOptions {
    OpenOptions { roi: Some(VoxelBox::new([2, 1, 1], [8, 6, 4])), ..OpenOptions::default() }
}

fn all_together() -> OpenOptions {
    OpenOptions {
        flip: Some([true, false, true]),
        take_channel: vec![ChannelChoice::name("red"), "0".parse().unwrap()],
        take_time: Some(StepChoice { first: 1, end: Some(6), stride: 2 }),
        to_voxel_type: Some(VoxelType::I32),
        ..roi()
    }
}

/// Every voxel of `source`, whole and in boxes, is the formula's at the place `from` it.
fn assert_is(source: &dyn Source, from: impl Fn([u32; 3], u32, u32) -> f64) {
    let info = source.info();
    let full = info.extent.full_box();
    let [x, y, z] = info.extent.to_array();
    let some = VoxelBox::new([x / 3, y / 4, 0], [x, y / 4 + 1, z]);
    for (time, channel) in (0..info.times).flat_map(|t| (0..info.channels).map(move |c| (t, c))) {
        for region in [full, some, VoxelBox::new([x - 1, y - 1, z - 1], [x, y, z])] {
            let expected: Vec<f64> = region.voxels().map(|at| from(at, channel, time)).collect();
            assert_eq!(read(source, time, channel, region), expected, "t{time} c{channel} {region:?}");
        }
    }
}

#[test]
fn a_box_has_its_voxels_and_its_place() {
    for access in [Access::Box, Access::Planes] {
        let source = Formula { access, lends: true, ..Formula::new(VoxelType::U16) }.take(&roi()).unwrap();
        let info = source.info();
        assert_eq!((info.extent, source.access()), (Extent::new(6, 5, 3), access));
        assert_eq!(info.geometry.origin, DVec3::new(11.0, 21.0, 32.0));
        assert_eq!(info.geometry.spacing, DVec3::new(0.5, 1.0, 2.0));
        assert_is(&*source, |[x, y, z], c, t| formula(x + 2, y + 1, z + 1, c, t));
        let mut lent = Vec::new();
        let region = VoxelBox::new([1, 2, 0], [3, 3, 1]);
        assert!(source.lend(0, 1, region, &mut |voxels| lent = voxels.bytes.to_vec()).unwrap());
        assert_eq!(VoxelType::U16.read(&lent, 1), formula(4, 3, 1, 1, 0));
        assert_eq!([source.reader_bytes(), source.held_bytes(), source.scratch_bytes()], [1000, 200, 30]);
        // Known without reading from x = 4 of the input on.
        let at = |x| VoxelBox::new([x, 0, 0], [6, 5, 3]);
        assert_eq!([1, 2].map(|x| source.constant_in(0, 2, at(x))), [None, Some(77.0)]);
    }
}

#[test]
fn an_order_is_reversed_along_each_axis() {
    for axes in 0..8u32 {
        let flip = [0, 1, 2].map(|axis| axes >> axis & 1 == 1);
        for voxel_type in [VoxelType::U16, VoxelType::F32] {
            let source =
                Formula::new(voxel_type).take(&OpenOptions { flip: Some(flip), ..OpenOptions::default() }).unwrap();
            let at = |axis: usize, at: u32, size: u32| if flip[axis] { size - 1 - at } else { at };
            assert_is(&*source, |[x, y, z], c, t| formula(at(0, x, 9), at(1, y, 7), at(2, z, 5), c, t));
            // A mirror image in the same place.
            assert_eq!(source.info().geometry, Formula::new(voxel_type).info.geometry);
        }
    }
    // Bytes, of which an odd number is in a row.
    let small = Formula { value: |x, y, _, _, _| f64::from(x + 10 * y), ..Formula::new(VoxelType::U8) };
    let source = small.take(&OpenOptions { flip: Some([true, true, false]), ..OpenOptions::default() }).unwrap();
    assert_is(&*source, |[x, y, _], _, _| f64::from(8 - x + 10 * (6 - y)));
    let beyond = VoxelBox::new([0, 0, 0], [5, 1, 1]);
    assert_eq!(source.constant_in(0, 2, beyond), Some(77.0));
    assert_eq!(source.constant_in(0, 2, VoxelBox::new([0, 0, 0], [6, 1, 1])), None);
}

#[test]
fn channels_keep_their_names_and_steps_their_times() {
    let options = OpenOptions {
        take_channel: ["red", "0"].map(|text| text.parse().unwrap()).to_vec(),
        take_time: Some(StepChoice { first: 1, end: None, stride: 2 }),
        ..OpenOptions::default()
    };
    let source = Formula { lends: true, ..Formula::new(VoxelType::U16) }.take(&options).unwrap();
    let info = source.info();
    assert_eq!((info.channels, info.times), (2, 3));
    assert_eq!(info.channel_looks.iter().map(|l| l.name.clone().unwrap()).collect::<Vec<_>>(), ["red", "DAPI"]);
    assert_eq!((0..3).map(|step| info.time.as_ref().unwrap().at(step)).collect::<Vec<_>>(), [3.5, 4.5, 5.5]);
    assert_is(&*source, |[x, y, z], c, t| formula(x, y, z, [2, 0][c as usize], 1 + 2 * t));
    assert_eq!(source.constant_in(0, 0, VoxelBox::new([4, 0, 0], [9, 7, 5])), Some(77.0));
    assert_eq!(source.constant_in(0, 1, VoxelBox::new([4, 0, 0], [9, 7, 5])), None);
    let mut lent = 0.0;
    source
        .lend(2, 1, info.extent.full_box(), &mut |it| {
            lent = if it.slices.start == 0 { VoxelType::U16.read(it.bytes, 1) } else { lent };
        })
        .unwrap();
    assert_eq!(lent, formula(1, 0, 0, 0, 5));
    // Uneven times.
    let mut uneven = Formula::new(VoxelType::U16);
    uneven.info.time = Some(TimeAxis::of_stamps(vec![0.0, 1.0, 5.0, 6.0, 7.5, 9.0], None).unwrap());
    let source = uneven.take(&options).unwrap();
    assert_eq!((0..3).map(|step| source.info().time.as_ref().unwrap().at(step)).collect::<Vec<_>>(), [1.0, 6.0, 9.0]);
}

#[test]
fn all_adapters_work_together() {
    for access in [Access::Box, Access::Planes] {
        let formula_source = Formula { access, ..Formula::new(VoxelType::U16) };
        let source = formula_source.take(&all_together()).unwrap();
        assert_eq!((source.info().voxel_type, source.info().extent), (VoxelType::I32, Extent::new(6, 5, 3)));
        assert_is(&*source, |[x, y, z], c, t| formula(7 - x, y + 1, 3 - z, [2, 0][c as usize], 1 + 2 * t));
    }
    // The options are part of the identity, each by itself.
    let plain = OpenOptions::default();
    let options = [
        plain.clone(),
        roi(),
        OpenOptions { roi: Some(VoxelBox::new([2, 1, 1], [8, 6, 5])), ..plain.clone() },
        OpenOptions { flip: Some([true, false, false]), ..plain.clone() },
        OpenOptions { flip: Some([false, true, false]), ..plain.clone() },
        OpenOptions { take_channel: vec![ChannelChoice::number(0)], ..plain.clone() },
        OpenOptions { take_channel: vec![ChannelChoice::number(1)], ..plain.clone() },
        OpenOptions { take_time: Some(StepChoice { first: 0, end: Some(2), stride: 1 }), ..plain.clone() },
        OpenOptions { take_time: Some(StepChoice { first: 0, end: Some(3), stride: 2 }), ..plain.clone() },
        OpenOptions { to_voxel_type: Some(VoxelType::I32), ..plain.clone() },
        OpenOptions { to_voxel_type: Some(VoxelType::U32), ..plain },
        all_together(),
    ];
    let identity = |options| Formula::new(VoxelType::U16).take(options).unwrap().info().identity.clone();
    let identities: std::collections::BTreeSet<String> = options.iter().map(identity).collect();
    assert_eq!(identities.len(), options.len());
}

/// Every plane of a source that decodes planes is asked for once, whatever is taken of it; and no other.
#[test]
fn planes_are_read_once() {
    for (options, planes) in [
        (roi(), 1..4),
        (OpenOptions { flip: Some([true; 3]), ..OpenOptions::default() }, 0..5),
        (OpenOptions { to_voxel_type: Some(VoxelType::U32), ..OpenOptions::default() }, 0..5),
        (OpenOptions { take_time: None, take_channel: vec![ChannelChoice::number(0)], ..all_together() }, 1..4),
    ] {
        let formula_source = Formula { access: Access::Planes, ..Formula::new(VoxelType::U16) };
        let reads = formula_source.reads.clone();
        let source = formula_source.take(&options).unwrap();
        reads.lock().unwrap().clear();
        let Extent { x, y, z } = source.info().extent;
        for z in 0..z {
            read(&*source, 0, 0, VoxelBox::new([0, 0, z], [x, y, z + 1]));
        }
        let mut found: Vec<u32> = reads.lock().unwrap().iter().flat_map(|read| read.min.z..read.max.z).collect();
        found.sort_unstable();
        assert_eq!(found, planes.collect::<Vec<_>>());
    }
    // The search for losses reads only the part, and each plane once.
    let formula_source = Formula { access: Access::Planes, ..Formula::new(VoxelType::U16) };
    let reads = formula_source.reads.clone();
    let lossy = OpenOptions { to_voxel_type: Some(VoxelType::U8), allow_lossy: true, ..all_together() };
    formula_source.take(&lossy).unwrap();
    let found: Vec<u32> = reads.lock().unwrap().iter().flat_map(|read| read.min.z..read.max.z).collect();
    // Three planes of three steps and two channels.
    assert_eq!(found, [1, 2, 3].repeat(6));
}

#[test]
fn parts_that_are_not_there_are_refused() {
    let refusal = |options: OpenOptions, words: &[&str]| {
        let message = Formula::new(VoxelType::U16).take(&options).err().unwrap();
        assert!(words.iter().all(|word| message.contains(word)), "{message}");
    };
    let plain = OpenOptions::default();
    for (low, high) in
        [([0, 0, 0], [10, 7, 5]), ([3, 3, 3], [3, 4, 4]), ([5, 0, 0], [4, 7, 5]), ([9, 0, 0], [11, 7, 5])]
    {
        let roi = Some(VoxelBox::new(low, high));
        refusal(OpenOptions { roi, ..plain.clone() }, &["in.npy", "`roi`", "0:9,0:7,0:5"]);
    }
    for (first, end, stride) in [(6, None, 1), (0, Some(7), 1), (3, Some(3), 1), (0, None, 0), (u32::MAX, None, 1)] {
        let take_time = Some(StepChoice { first, end, stride });
        refusal(OpenOptions { take_time, ..plain.clone() }, &["`take_time`", "6 time steps"]);
    }
    for (choice, words) in [
        ("3", &["`take_channel` 3", "3 channels", "DAPI, 488, red"][..]),
        ("dap", &["did you mean 'DAPI'?"]),
        ("name=1", &["3 channels"]),
        ("number=488", &["3 channels"]),
    ] {
        refusal(OpenOptions { take_channel: vec![choice.parse().unwrap()], ..plain.clone() }, words);
    }
    let twice = ["DAPI", "0"].map(|text| text.parse().unwrap()).to_vec();
    refusal(OpenOptions { take_channel: twice, ..plain.clone() }, &["channel 0 is named twice"]);
    // Names that are numbers of other channels, and equal names.
    let with_names = |names: [&str; 3], choice: &str| {
        let mut source = Formula::new(VoxelType::U16);
        source.info.channel_looks.iter_mut().zip(names).for_each(|(look, name)| look.name = Some(name.into()));
        let options = OpenOptions { take_channel: vec![choice.parse().unwrap()], ..OpenOptions::default() };
        source.take(&options).map(|source| source.info().channel_looks[0].name.clone().unwrap())
    };
    assert!(with_names(["1", "2", "3"], "1").unwrap_err().contains("number=1 or name=1"));
    assert_eq!(with_names(["1", "2", "3"], "name=1"), Ok("1".into()));
    assert_eq!(with_names(["1", "2", "3"], "number=1"), Ok("2".into()));
    assert_eq!(with_names(["1", "2", "3"], "3"), Ok("3".into()));
    assert_eq!(with_names(["0", "2", "3"], "0"), Ok("0".into()));
    assert_eq!(with_names(["b", "A", "a"], "B"), Ok("b".into()));
    assert!(with_names(["a", "a", "b"], "a").unwrap_err().contains("channels 0, 1: give the number"));
}

fn to(voxel_type: VoxelType) -> OpenOptions {
    OpenOptions { to_voxel_type: Some(voxel_type), ..OpenOptions::default() }
}

fn lossy(voxel_type: VoxelType) -> OpenOptions {
    OpenOptions { allow_lossy: true, ..to(voxel_type) }
}

#[test]
fn exact_values_are_converted_without_a_word() {
    use VoxelType::*;
    for (from, to_type) in [(U8, U16), (U8, I16), (U16, F32), (I8, I32), (F32, U16), (F32, I32), (U16, U32), (I32, F32)]
    {
        let value: Value = |x, y, z, c, t| formula(x, y, z, c, t) % 120.0;
        let source = Formula { value, ..Formula::new(from) }.take(&to(to_type)).unwrap();
        assert_eq!(source.info().voxel_type, to_type);
        assert_is(&*source, |[x, y, z], c, t| formula(x, y, z, c, t) % 120.0);
        let said = said(&source.info().notes);
        assert!(said.contains(&format!("note: Voxels are {from} and become {to_type}: no value is changed")), "{said}");
    }
    // The same type is left alone.
    assert_eq!(Formula::new(U16).take(&to(U16)).unwrap().info().identity, "formula");
}

#[test]
fn losses_are_refused_with_their_place_or_counted() {
    // One value of each kind, in the third step.
    let value: Value = |x, y, z, c, t| match (x, y, z, c, t) {
        (3, 2, 1, 1, 2) => 300.0,
        (4, 2, 1, 1, 2) => -7.6,
        (5, 2, 1, 1, 2) => 2.5,
        (6, 2, 1, 1, 2) => 3.5,
        (7, 2, 1, 1, 2) => 255.4,
        _ => f64::from(x),
    };
    let message = Formula::of(value).take(&to(VoxelType::U8)).err().unwrap();
    for words in [
        "in.npy",
        "f32",
        "the value 300 (voxel 3",
        "voxel 3,2,1, channel 1, time step 2",
        "in u8",
        "`allow_lossy`",
        "clamped",
    ] {
        assert!(message.contains(words), "{words}: {message}");
    }
    let source = Formula::of(value).take(&lossy(VoxelType::U8)).unwrap();
    let told = said(&source.info().notes);
    let words = "warning: Voxels are f32 and become u8: of 5670 values, 2 clamped to its limits, 3 rounded to the \
                 nearest (such as 300 of voxel 3,2,1, channel 1, time step 2).";
    assert!(told.contains(words), "{told}");
    assert_eq!(read(&*source, 2, 1, VoxelBox::new([2, 2, 1], [8, 3, 2])), [2.0, 255.0, 0.0, 2.0, 4.0, 255.0]);
    // Places are the input's, whatever is taken and turned; and other parts lose nothing.
    let part =
        OpenOptions { flip: Some([true; 3]), take_time: Some(StepChoice { first: 2, end: None, stride: 1 }), ..roi() };
    let message = Formula::of(value).take(&OpenOptions { to_voxel_type: Some(VoxelType::U8), ..part.clone() });
    assert!(message.err().unwrap().contains("voxel 3,2,1, channel 1, time step 2"));
    let elsewhere = OpenOptions { take_channel: vec![ChannelChoice::number(0)], ..to(VoxelType::U8) };
    assert!(Formula::of(value).take(&elsewhere).is_ok());
    // Labels are never rounded.
    let labels = OpenOptions { are_labels: Some(true), ..lossy(VoxelType::U8) };
    assert!(Formula::of(value).take(&labels).err().unwrap().contains("labels become others"));
    // Beyond f32's whole numbers.
    let value: Value = |x, _, _, _, _| 16777216.0 + f64::from(x);
    let wide = |options: &OpenOptions| Formula { value, ..Formula::new(VoxelType::I32) }.take(options);
    assert!(wide(&to(VoxelType::F32)).err().unwrap().contains("16777217 (voxel"));
    assert!(said(&wide(&lossy(VoxelType::F32)).unwrap().info().notes).contains("2520 rounded"));
    assert!(wide(&to(VoxelType::U32)).is_ok());
}

/// A value that is lossy only where nobody looked is an error, never a wrong voxel.
#[test]
fn a_file_that_changes_meanwhile_is_no_wrong_voxel() {
    let options = OpenOptions { is_looked_at: true, ..to(VoxelType::U8) };
    let source = Formula::new(VoxelType::U16).take(&options).unwrap();
    let mut out = vec![0; 9 * 7 * 5];
    let found = source.read_box(0, 0, source.info().extent.full_box(), &mut out).unwrap_err();
    assert!(found.to_string().contains("300 (voxel 0,0,1, channel 0, time step 0)"), "{found}");
}

#[test]
fn voxels_without_data_stay_so() {
    let holed: Value = |x, y, _, _, _| match (x, y) {
        (0, 0) => f64::NAN,
        (1, 0) => f64::INFINITY,
        (2, 0) => -9.0,
        _ => f64::from(x),
    };
    let with = |nodata: Option<f64>, knows_nodata| {
        let mut source = Formula::of(holed);
        (source.info.nodata, source.info.knows_nodata) = (nodata, knows_nodata);
        source
    };
    let row = |source: &dyn Source| read(source, 0, 0, VoxelBox::new([0, 0, 0], [4, 1, 1]));
    // No value for no data.
    let message = with(None, false).take(&lossy(VoxelType::I16)).err().unwrap();
    assert!(
        message.contains("NaN (voxel 0,0,0") && message.contains("i16 has no value") && message.contains("`nodata`")
    );
    // The user's, or the file's.
    let source = with(Some(-9.0), false).take(&to(VoxelType::I16)).unwrap();
    assert_eq!(row(&*source), [-9.0, -9.0, -9.0, 3.0]);
    assert_eq!((source.info().nodata, source.info().knows_nodata), (Some(-9.0), false));
    let message = with(Some(-9.0), false).take(&lossy(VoxelType::U8)).err().unwrap();
    assert!(message.contains("voxels of -9 hold no data, a value that u8 cannot hold"), "{message}");
    // Where floats mark such voxels by NaN, that number is data, and may not become no data.
    let message = with(Some(-9.0), true).take(&lossy(VoxelType::I16)).err().unwrap();
    assert!(message.contains("-9 (voxel 2,0,0") && message.contains("beside"), "{message}");
    // Of the steps before.
    let held_as = Some(HeldAs { voxel_type: VoxelType::I16, nodata: Some(-9.0), turned: [false; 3] });
    let source = with(None, false).take(&OpenOptions { held_as, ..to(VoxelType::I16) }).unwrap();
    assert_eq!((row(&*source), source.info().nodata), (vec![-9.0, -9.0, -9.0, 3.0], Some(-9.0)));
    // Which replaces the file's own where the type cannot hold that, but stands for no number beside it.
    let held_as = Some(HeldAs { voxel_type: VoxelType::U8, nodata: Some(255.0), turned: [false; 3] });
    let of_i16 = |value: Value| {
        let mut source = Formula { value, ..Formula::new(VoxelType::I16) };
        source.info.nodata = Some(-9.0);
        source.take(&OpenOptions { held_as, ..to(VoxelType::U8) })
    };
    let source = of_i16(|x, _, _, _, _| [0.0, 1.0, -9.0, 254.0].get(x as usize).copied().unwrap_or(7.0)).unwrap();
    assert_eq!((row(&*source), source.info().nodata), (vec![0.0, 1.0, 255.0, 254.0], Some(255.0)));
    let message =
        of_i16(|x, _, _, _, _| [0.0, 1.0, -9.0, 255.0].get(x as usize).copied().unwrap_or(7.0)).err().unwrap();
    assert!(message.contains("255 (voxel 3,0,0") && message.contains("beside"), "{message}");
    let held_as = Some(HeldAs { voxel_type: VoxelType::I16, nodata: Some(-9.0), turned: [false; 3] });
    let none = OpenOptions { held_as, nodata: NoData::None, ..to(VoxelType::I16) };
    assert!(with(None, false).take(&none).is_err());
    // No lossy value becomes no data.
    let value: Value = |x, y, _, _, _| if (x, y) == (5, 1) { 300.0 } else { f64::from(x) };
    let mut source = Formula { value, ..Formula::new(VoxelType::I16) };
    source.info.nodata = Some(255.0);
    let message = source.take(&lossy(VoxelType::U8)).err().unwrap();
    assert!(message.contains("300 (voxel 5,1,0") && message.contains("beside 255"), "{message}");
    // Integers to floats: NaN, and the number itself is free again.
    let value: Value = |x, _, _, _, _| if x == 2 { -9.0 } else { f64::from(x) };
    let mut source = Formula { value, ..Formula::new(VoxelType::I16) };
    source.info.nodata = Some(-9.0);
    let source = source.take(&to(VoxelType::F32)).unwrap();
    let found = row(&*source);
    assert!(found[2].is_nan() && found[3] == 3.0);
    assert_eq!((source.info().nodata, source.info().sought_nodata()), (Some(-9.0), None));
}

/// Header and voxels of an oblique NIfTI volume of 4 x 3 x 2 bytes, each its number.
fn oblique_nifti(rows: [[f32; 4]; 3]) -> Vec<u8> {
    let mut bytes = vec![0; 352];
    bytes[..4].copy_from_slice(&348i32.to_le_bytes());
    for (i, n) in [3i16, 4, 3, 2, 1, 1, 1, 1].iter().enumerate() {
        bytes[40 + 2 * i..][..2].copy_from_slice(&n.to_le_bytes());
    }
    bytes[70..74].copy_from_slice(&[2, 0, 8, 0]);
    let step = |a: usize| rows.iter().map(|row| row[a] * row[a]).sum::<f32>().sqrt();
    for (i, n) in [1.0, step(0), step(1), step(2)].iter().enumerate() {
        bytes[76 + 4 * i..][..4].copy_from_slice(&n.to_le_bytes());
    }
    bytes[108..112].copy_from_slice(&352f32.to_le_bytes());
    bytes[123] = 2;
    bytes[254..256].copy_from_slice(&2i16.to_le_bytes());
    for (i, n) in rows.iter().flatten().enumerate() {
        bytes[280 + 4 * i..][..4].copy_from_slice(&n.to_le_bytes());
    }
    bytes[344..348].copy_from_slice(b"n+1\0");
    bytes.extend(0..24);
    bytes
}

/// The world place of each voxel's centre in millimetres, by value: every voxel has a value of its own.
fn places(source: &dyn Source) -> Vec<Option<DVec3>> {
    let (info, mut places) = (source.info(), vec![None; 24]);
    let placement = info.orientation.unwrap().placement(&info.geometry).unwrap();
    for at in info.extent.full_box().voxels() {
        let value = read(source, 0, 0, VoxelBox::new(at, at.map(|i| i + 1)))[0];
        let own = info.geometry.world_from_voxel(DVec3::from_array(at.map(|i| f64::from(i) + 0.5)));
        places[value as usize] = Some(placement.world_from_volume(own));
    }
    places
}

#[test]
fn voxels_of_an_oriented_volume_keep_their_places() {
    let oblique = [[0.8f32, -0.6, 0.0, 20.0], [0.6, 0.8, 0.3, -7.0], [0.0, 0.1, 2.0, 3.0]];
    let upright = [[0.5f32, 0.0, 0.0, 20.0], [0.0, 1.5, 0.0, -7.0], [0.0, 0.0, 2.0, 3.0]];
    let lps = [[-0.5f32, 0.0, 0.0, 20.0], [0.0, -1.5, 0.0, -7.0], [0.0, 0.0, 2.0, 3.0]];
    for rows in [oblique, upright, lps] {
        let (_folder, path) = temp_file("a.nii", &oblique_nifti(rows));
        let opened = |options: &OpenOptions| open(std::slice::from_ref(&path), options).unwrap();
        let whole = places(&*opened(&OpenOptions::default()));
        let [a, b] = [0, 23].map(|i: usize| whole[i].unwrap());
        let expected = rows.map(|row| f64::from(row[3] + 3.0 * row[0] + 2.0 * row[1] + row[2]));
        assert!((a - DVec3::from_array(rows.map(|row| row[3].into()))).length() < 1e-5);
        assert!((b - DVec3::from_array(expected)).length() < 1e-5);
        for flip in [[true, false, false], [true, true, false], [false, false, true], [true; 3], [false; 3]] {
            for roi in [None, Some(VoxelBox::new([1, 0, 1], [4, 2, 2]))] {
                for origin in [None, Some(DVec3::new(-5.0, 6.0, 100.0))] {
                    let told = OpenOptions { origin, ..OpenOptions::default() };
                    let expected = places(&*opened(&told));
                    let source = opened(&OpenOptions { flip: Some(flip), roi, ..told });
                    for (found, expected) in places(&*source).iter().zip(&expected) {
                        let Some(found) = found else { continue };
                        assert!((*found - expected.unwrap()).length() < 1e-4, "{flip:?} {roi:?}: {found} {expected:?}");
                    }
                    assert_eq!(places(&*source).iter().flatten().count(), if roi.is_some() { 6 } else { 24 });
                }
            }
        }
        // The first voxel is another one, and LPS turned about two axes is upright.
        let turned = opened(&OpenOptions { flip: Some([true, true, false]), ..OpenOptions::default() });
        let orientation: Orientation = turned.info().orientation.unwrap();
        assert_eq!(orientation.is_upright(), rows == lps);
        assert!((orientation.first_centre() - whole[11].unwrap()).length() < 1e-5);
        assert_eq!(read(&*turned, 0, 0, VoxelBox::new([0; 3], [1; 3])), [11.0]);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]

    /// Any options give the formula's voxels or an error, never a panic.
    #[test]
    fn any_part_is_right_or_refused(
        corners in prop::array::uniform3((0u32..12, 0u32..12)),
        flip in prop::array::uniform3(any::<bool>()),
        channels in prop::collection::vec(0u32..4, 0..3),
        steps in (0u32..7, prop::option::of(0u32..8), 0u32..4),
        to_type in prop::option::of(0usize..7),
        lends in any::<bool>(),
    ) {
        let (low, high) = (corners.map(|c| c.0), corners.map(|c| c.1));
        let options = OpenOptions {
            roi: Some(VoxelBox::new(low, high)),
            flip: Some(flip),
            take_channel: channels.iter().map(|n| ChannelChoice::number(*n)).collect(),
            take_time: Some(StepChoice { first: steps.0, end: steps.1, stride: steps.2 }),
            to_voxel_type: to_type.map(|i| VoxelType::ALL[i]),
            ..OpenOptions::default()
        };
        let source = Formula { lends, ..Formula::new(VoxelType::I32) };
        if let Ok(source) = source.take(&options) {
            let [x1, y1, z1] = high;
            let channels = if channels.is_empty() { vec![0, 1, 2] } else { channels };
            let at = |axis: usize, at: u32, end: u32| if flip[axis] { end - 1 - at } else { low[axis] + at };
            assert_is(&*source, |[x, y, z], c, t| {
                formula(at(0, x, x1), at(1, y, y1), at(2, z, z1), channels[c as usize], steps.0 + t * steps.2)
            });
        }
    }
}
