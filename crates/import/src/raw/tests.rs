//! Raw files against arrays made by hand.

use super::*;
use crate::testing::{Field, assert_boxes, said, temp_file};
use brickyard_volume::VoxelType;
use proptest::prelude::*;

fn layout(field: Field, axes: &str, endian: Endian) -> RawLayout {
    let [x, y, z, channels, times] = field.sizes;
    RawLayout {
        endian,
        channels,
        times,
        axes: axes.parse().unwrap(),
        ..RawLayout::new(Extent::new(x, y, z), field.voxel_type)
    }
}

#[test]
fn every_type_and_byte_order_gives_the_bytes_written() {
    for voxel_type in VoxelType::ALL {
        for endian in [Endian::Little, Endian::Big] {
            let field = Field { sizes: [13, 7, 5, 1, 1], voxel_type };
            let (_folder, path) = temp_file("a b.raw", &field.bytes("zyx", endian == Endian::Big));
            let source = RawSource::open(&path, &layout(field, "zyx", endian)).unwrap();
            assert_boxes(&source, field);
            let is_lent = source.lend(0, 0, source.info().extent.full_box(), &mut |_| ()).unwrap();
            assert_eq!(is_lent, endian == Endian::Little || voxel_type.bytes() == 1);
        }
    }
}

#[test]
fn any_order_of_axes_is_unravelled() {
    let field = Field { sizes: [7, 5, 6, 2, 3], voxel_type: VoxelType::U16 };
    for axes in ["tczyx", "xyzct", "ctzyx", "tzcyx", "zyxct", "ytxcz"] {
        let (_folder, path) = temp_file("a.raw", &field.bytes(axes, false));
        assert_boxes(&RawSource::open(&path, &layout(field, axes, Endian::Little)).unwrap(), field);
    }
}

#[test]
fn offset_skips_a_header() {
    let field = Field { sizes: [4, 3, 2, 1, 1], voxel_type: VoxelType::I32 };
    let (_folder, path) = temp_file("a.raw", &[vec![9; 17], field.bytes("zyx", false)].concat());
    let layout = RawLayout { offset: 17, ..layout(field, "zyx", Endian::Little) };
    assert_boxes(&RawSource::open(&path, &layout).unwrap(), field);
}

fn refusal(bytes: usize, layout: &RawLayout) -> String {
    let (_folder, path) = temp_file("a.raw", &vec![0; bytes]);
    RawSource::open(&path, layout).err().unwrap().to_string()
}

#[test]
fn a_size_that_does_not_fit_says_what_would() {
    let layout = |x, y, z, t| RawLayout::new(Extent::new(x, y, z), t);
    let message = refusal(16 * 16 * 16, &layout(16, 16, 8, VoxelType::U8));
    for part in
        ["expected 2048 bytes", "found 4096", "2048 too many", "16,16,16 u8", "16,16,8 u16 or i16", "2 time steps"]
    {
        assert!(message.contains(part), "{part}: {message}");
    }
    let message = refusal(1000, &layout(16, 16, 8, VoxelType::U8));
    assert!(message.contains("1048 too few") && message.contains("10,10,10 u8"), "{message}");
    assert!(!message.contains("`offset`"), "{message}");
    let message = refusal(2048 + 352, &layout(16, 16, 8, VoxelType::U8));
    assert!(message.contains("352 too many") && message.contains("`offset` 352"), "{message}");
    assert!(refusal(0, &layout(16, 16, 8, VoxelType::U8)).contains("2048 too few"));
    let offset = RawLayout { offset: 100, ..layout(4, 4, 4, VoxelType::U8) };
    assert!(refusal(64, &offset).contains("expected 164 bytes"));
}

#[test]
fn impossible_shapes_are_refused() {
    assert!(refusal(8, &RawLayout::new(Extent::new(4, 0, 2), VoxelType::U8)).contains("axis of size 0"));
    let huge = Extent::new(u32::MAX, u32::MAX, u32::MAX);
    assert!(refusal(8, &RawLayout::new(huge, VoxelType::U8)).contains("2^63"));
    let two = RawLayout { channels: 2, ..RawLayout::new(Extent::new(2, 2, 1), VoxelType::U8) };
    assert!(refusal(8, &RawLayout { axes: "zyx".parse().unwrap(), ..two }).contains("no 'c'"));
    let missing =
        RawSource::open(Path::new("/nowhere/at all.raw"), &RawLayout::new(Extent::new(1, 1, 1), VoxelType::U8));
    assert!(matches!(missing, Err(ImportError::Io { .. })));
}

#[test]
fn identity_follows_file_and_layout() {
    let (_folder, path) = temp_file("a.raw", &[1; 8]);
    let of = |extent| RawSource::open(&path, &RawLayout::new(extent, VoxelType::U8)).unwrap().info().identity.clone();
    let before = of(Extent::new(2, 2, 2));
    assert_eq!(before, of(Extent::new(2, 2, 2)));
    assert_ne!(before, of(Extent::new(8, 1, 1)));
    let file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
    file.set_modified(std::time::UNIX_EPOCH + std::time::Duration::from_secs(1)).unwrap();
    assert_ne!(before, of(Extent::new(2, 2, 2)));
}

/// Checks that all reads of a source now fail, lent and copied.
fn all_is_refused(source: &RawSource, what: &str) {
    let full = source.info().extent.full_box();
    let mut out = vec![0; full.extent().volume() as usize * source.info().voxel_type.bytes()];
    let message = source.read_box(0, 0, full, &mut out).unwrap_err().to_string();
    assert!(message.contains("changed while it was read") && message.contains(what), "{message}");
    let mut sum = 0;
    let lent = source.lend(0, 0, full, &mut |lent| sum = lent.bytes.iter().map(|&b| u64::from(b)).sum());
    assert!(lent.is_err(), "{what}: {sum}");
}

#[test]
fn a_file_that_changes_while_it_is_mapped_is_an_error_and_not_zeros() {
    let bytes = vec![7; 64 * 64 * 16];
    let layout = RawLayout::new(Extent::new(64, 64, 16), VoxelType::U8);
    let write = |path: &Path| std::fs::OpenOptions::new().write(true).open(path).unwrap();
    // Cut short by whole pages, which faults, and within the last page, which does not.
    for left in [0, 100, bytes.len() as u64 - 1] {
        let (_folder, path) = temp_file("a.raw", &bytes);
        let source = RawSource::open(&path, &layout).unwrap();
        write(&path).set_len(left).unwrap();
        all_is_refused(&source, &format!("found {left}"));
    }
    let (_folder, path) = temp_file("a.raw", &bytes);
    let source = RawSource::open(&path, &layout).unwrap();
    write(&path).set_modified(std::time::UNIX_EPOCH).unwrap();
    all_is_refused(&source, "written to or replaced");
    let (folder, path) = temp_file("a.raw", &bytes);
    let source = RawSource::open(&path, &layout).unwrap();
    let other = folder.path().join("b.raw");
    std::fs::write(&other, &bytes[1..]).unwrap();
    std::fs::rename(other, &path).unwrap();
    all_is_refused(&source, "found 65535");
}

#[test]
fn bytes_behind_the_voxels_are_left_out_where_an_offset_is_given() {
    let field = Field { sizes: [4, 3, 2, 1, 1], voxel_type: VoxelType::U8 };
    let bytes = [field.bytes("zyx", false), vec![9; 24]].concat();
    let (_folder, path) = temp_file("a.raw", &bytes);
    let plain = layout(field, "zyx", Endian::Little);
    let source = RawSource::open(&path, &RawLayout { may_trail: true, ..plain.clone() }).unwrap();
    assert_boxes(&source, field);
    let note = &source.info().notes[0];
    assert!(note.is_warning() && note.contains("24 bytes after") && note.contains("`offset` 24"), "{}", &**note);
    let second = RawLayout { may_trail: true, offset: 24, ..plain.clone() };
    let second = RawSource::open(&path, &second).unwrap();
    let mut out = [0; 24];
    second.read_box(0, 0, plain.extent.full_box(), &mut out).unwrap();
    assert!(out == [9; 24] && second.info().notes.is_empty());
    assert!(refusal(48, &plain).contains("to leave out all behind the voxels, pass `offset` 0"));
    assert!(refusal(30, &RawLayout { may_trail: true, offset: 7, ..plain }).contains("1 too few"));
}

/// Fortran's records: each with its length before and after.
#[test]
fn steps_and_channels_may_lie_apart() {
    let field = Field { sizes: [4, 3, 2, 3, 2], voxel_type: VoxelType::I16 };
    let records = |axes: &str, count: usize| -> Vec<u8> {
        let bytes = field.bytes(axes, false);
        bytes.chunks(bytes.len() / count).flat_map(|record| [&[1; 4], record, &[2; 4]].concat()).collect()
    };
    let plain = |axes: &str| RawLayout { offset: 4, may_trail: true, ..layout(field, axes, Endian::Little) };
    let opened = |bytes: &[u8], layout: &RawLayout| {
        let (folder, path) = temp_file("a.raw", bytes);
        let source = RawSource::open(&path, layout).unwrap();
        assert_boxes(&source, field);
        (folder, source)
    };
    let steps = RawLayout { step_bytes: Some(3 * 48 + 8), ..plain("tczyx") };
    let (_folder, source) = opened(&records("tczyx", 2), &steps);
    assert!(!source.info().notes[0].is_warning() && source.info().notes[0].contains("4 bytes"));
    opened(&records("tzyxc", 2), &RawLayout { axes: "tzyxc".parse().unwrap(), ..steps.clone() });
    let channels = RawLayout { channel_bytes: Some(56), ..plain("tczyx") };
    opened(&records("tczyx", 6), &channels);
    opened(&records("ctzyx", 6), &RawLayout { channel_bytes: Some(112), step_bytes: Some(56), ..plain("ctzyx") });
    // A tail behind each step but the last, or also the last.
    let tails: Vec<u8> = field.bytes("tczyx", false).chunks(144).flat_map(|step| [step, &[3; 5]].concat()).collect();
    let tailed = RawLayout { step_bytes: Some(149), offset: 0, may_trail: false, ..plain("tczyx") };
    opened(&tails, &tailed);
    opened(&tails[..293], &tailed);
    for bytes in [292, 294, 297, 299] {
        assert!(refusal(bytes, &tailed).contains("expected 293 bytes"), "{bytes}");
    }
}

#[test]
fn impossible_distances_are_refused() {
    let field = Field { sizes: [4, 3, 2, 3, 2], voxel_type: VoxelType::U8 };
    let of = |axes: &str, step_bytes, channel_bytes| {
        refusal(1000, &RawLayout { step_bytes, channel_bytes, may_trail: true, ..layout(field, axes, Endian::Little) })
    };
    assert!(of("tczyx", Some(71), None).contains("`step_bytes` 71: the voxels in between have 72 bytes"));
    assert!(of("tczyx", None, Some(23)).contains("`channel_bytes` 23"));
    assert!(of("tczyx", Some(72), Some(25)).contains("`step_bytes` 72: the voxels in between have 74 bytes"));
    assert!(of("tzyxc", None, Some(30)).contains("c lies within the volume"));
    assert!(of("tczyx", Some(u64::MAX), None).contains("2^63"));
    let one = RawLayout { step_bytes: Some(99), ..RawLayout::new(Extent::new(4, 3, 2), VoxelType::U8) };
    assert!(refusal(24, &one).contains("no effect"));
    let far = RawLayout { offset: u64::MAX, ..RawLayout::new(Extent::new(4, 3, 2), VoxelType::U8) };
    assert!(refusal(24, &far).contains("no file is so long"));
}

/// Values of all channels and steps, and the notes.
fn numbers(bytes: &[u8], layout: &RawLayout, options: &OpenOptions) -> Result<(VoxelType, Vec<f64>, String), String> {
    let (_folder, path) = temp_file("a.raw", bytes);
    let source = RawSource::mapped(&path, layout).and_then(|source| source.with_losses(None, options));
    let source = source.map_err(|error| error.to_string())?;
    let SourceInfo { extent, voxel_type, channels, times, ref notes, .. } = *source.info();
    let mut values = Vec::new();
    for (time, channel) in (0..times).flat_map(|time| (0..channels).map(move |channel| (time, channel))) {
        let mut out = vec![0; extent.volume() as usize * voxel_type.bytes()];
        source.read_box(time, channel, extent.full_box(), &mut out).unwrap();
        values.extend((0..extent.volume() as usize).map(|i| voxel_type.read(&out, i)));
    }
    Ok((voxel_type, values, said(notes)))
}

#[test]
fn wide_numbers_are_held_where_they_fit() {
    let layout = |element| RawLayout { endian: Endian::Big, ..RawLayout::new(Extent::new(3, 1, 1), element) };
    let plain = OpenOptions::default();
    let i64s = |numbers: [i64; 3]| numbers.map(i64::to_be_bytes).concat();
    let (voxel_type, values, notes) = numbers(&i64s([-7, 0, 1 << 30]), &layout(Element::I64), &plain).unwrap();
    assert_eq!((voxel_type, &values[..]), (VoxelType::I32, &[-7.0, 0.0, 1073741824.0][..]));
    assert!(notes.contains("Voxels are i64 and are held as i32: no value is changed"), "{notes}");
    let message = numbers(&i64s([-7, 0, 1 << 31]), &layout(Element::I64), &plain).unwrap_err();
    assert!(message.contains("2147483648 cannot be held") && message.contains("`allow_lossy`"), "{message}");
    let f64s = [0.5f64, -1e300, 0.1].map(f64::to_be_bytes).concat();
    assert!(numbers(&f64s, &layout(Element::F64), &plain).is_err());
    let lossy = OpenOptions { allow_lossy: true, ..plain.clone() };
    let (voxel_type, values, notes) = numbers(&f64s, &layout(Element::F64), &lossy).unwrap();
    assert_eq!((voxel_type, &values[..]), (VoxelType::F32, &[0.5, f64::NEG_INFINITY, f64::from(0.1f32)][..]));
    assert!(notes.contains("1 infinite, 1 rounded"), "{notes}");
    let f16s = [1.5f32, -2.0, 65504.0].map(|n| half::f16::from_f32(n).to_be_bytes()).concat();
    assert_eq!(numbers(&f16s, &layout(Element::F16), &plain).unwrap().1, [1.5, -2.0, 65504.0]);
    // Not looked through by this function's caller.
    let (_folder, path) = temp_file("a.raw", &i64s([1 << 40, 0, 0]));
    assert!(RawSource::open(&path, &layout(Element::I64)).is_err());
}

/// Bytes between steps and channels are no numbers.
#[test]
fn losses_are_those_of_the_voxels_alone() {
    let far = f64::MAX.to_le_bytes();
    let mut bytes = Vec::new();
    for number in [1.0f64, 2.0, 3.0, 4.0] {
        bytes.extend(number.to_le_bytes());
        bytes.extend(far);
    }
    let apart = RawLayout {
        times: 2,
        channels: 2,
        channel_bytes: Some(16),
        may_trail: true,
        ..RawLayout::new(Extent::new(1, 1, 1), Element::F64)
    };
    assert_eq!(numbers(&bytes, &apart, &OpenOptions::default()).unwrap().1, [1.0, 2.0, 3.0, 4.0]);
    let steps = RawLayout { channels: 1, channel_bytes: None, step_bytes: Some(32), ..apart };
    assert_eq!(numbers(&bytes, &steps, &OpenOptions::default()).unwrap().1, [1.0, 3.0]);
    bytes[32..40].copy_from_slice(&far);
    assert!(numbers(&bytes, &steps, &OpenOptions::default()).unwrap_err().contains("cannot be held"));
}

#[test]
fn sizes_that_fit_other_numbers_are_named() {
    let plain = RawLayout::new(Extent::new(16, 16, 8), VoxelType::F32);
    assert!(refusal(8 * 2048, &plain).contains("16,16,8 i64 or u64 or f64"));
    let steps = RawLayout { times: 2, ..plain };
    assert!(refusal(4 * 2048 * 4, &steps).contains("with 4 time steps"));
    let message = refusal(4 * 2048 * 2 + 24, &steps);
    assert!(message.contains("`step_bytes` 8204"), "{message}");
}

proptest! {
    #![proptest_config(crate::testing::cases(300))]

    /// Any layout over any file is refused, or gives the bytes at the places it tells.
    #[test]
    fn layouts_give_the_bytes_they_tell_or_none(
        [x, y, z, channels, times] in prop::array::uniform5(1u32..4),
        axes in prop::sample::select(vec!["tczyx", "ctzyx", "tzyxc"]),
        step_bytes in prop::option::of(prop_oneof![0u64..120, Just(u64::MAX), Just(1 << 62)]),
        channel_bytes in prop::option::of(prop_oneof![0u64..60, Just(u64::MAX)]),
        offset in prop_oneof![0u64..9, Just(u64::MAX)],
        length in 0usize..400,
    ) {
        let bytes: Vec<u8> = (0..length).map(|i| (i * 7 % 251) as u8).collect();
        let (_folder, path) = temp_file("a.raw", &bytes);
        let layout = RawLayout {
            offset, may_trail: true, step_bytes, channel_bytes, channels, times, axes: axes.parse().unwrap(),
            ..RawLayout::new(Extent::new(x, y, z), VoxelType::U8)
        };
        if let Ok(source) = RawSource::open(&path, &layout) {
            let volume = u64::from(x * y * z);
            let (c, t) = (u64::from(channels), u64::from(times));
            let [step, channel, voxel] = match axes {
                "tczyx" => {
                    let channel = channel_bytes.unwrap_or(volume);
                    [step_bytes.unwrap_or(channel * c), channel, 1]
                }
                "ctzyx" => {
                    let step = step_bytes.unwrap_or(volume);
                    [step, channel_bytes.unwrap_or(step * t), 1]
                }
                _ => [step_bytes.unwrap_or(volume * c), 1, c],
            };
            for (time, own) in (0..times).flat_map(|time| (0..channels).map(move |own| (time, own))) {
                let mut out = vec![0; volume as usize];
                source.read_box(time, own, layout.extent.full_box(), &mut out).unwrap();
                let start = offset + u64::from(time) * step + u64::from(own) * channel;
                let told: Vec<u8> = (0..volume).map(|i| bytes[(start + i * voxel) as usize]).collect();
                prop_assert_eq!(out, told);
            }
        }
    }
}
