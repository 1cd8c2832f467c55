//! Single files are read as described: tifffile's axes, MetaMorph's planes, scales of tags, Orientation, GDAL's value.

use super::*;
use crate::testing::{is_warned, open_in, said};

fn field(z: u32, c: u32, t: u32) -> Field {
    Field { sizes: [7, 5, z, c, t], voxel_type: VoxelType::U16 }
}

/// Opens a field written with this layout.
fn read(field: Field, page_axes: &str, layout: &Layout) -> (tempfile::TempDir, Box<dyn Source>) {
    let (folder, path) = temp_file("a.tif", &written(field, page_axes, layout));
    let source = opened(&path).unwrap_or_else(|error| panic!("{error}"));
    (folder, source)
}

fn described(description: &str) -> Layout {
    Layout { description: description.into(), ..Layout::default() }
}

fn notes(source: &dyn Source) -> String {
    said(&source.info().notes)
}

#[test]
fn tifffiles_axes_are_steps_channels_and_slices() {
    for (axes, order, whole) in
        [("TZYX", "tz", field(4, 1, 3)), ("CZYX", "cz", field(4, 3, 1)), ("ZTCYX", "ztc", field(4, 2, 3))]
    {
        let whole_axes = |axis| match axis {
            't' => whole.sizes[4],
            'c' => whole.sizes[3],
            _ => whole.sizes[2],
        };
        let shape: Vec<u32> = order.chars().map(whole_axes).chain([5, 7]).collect();
        let layout = described(&format!(r#"{{"shape": {shape:?}, "axes": "{axes}"}}"#));
        assert_boxes(&*read(whole, order, &layout).1, whole);
        // All behind one directory.
        let text = format!(r#"{{"shape": {shape:?}, "axes": "{axes}", "truncated": true}}"#);
        let one = Layout { directories: Some(1), big_endian: true, ..described(&text) };
        assert_boxes(&*read(whole, order, &one).1, whole);
        // Axes without names are left to the user.
        let message = refusal(&written(whole, order, &described(&format!(r#"{{"shape": {shape:?}}}"#))), &options());
        assert!(message.contains("without axes") && message.contains("`axes`"), "{message}");
    }
    let told = OpenOptions { axes: Some("tzyx".parse().unwrap()), times: Some(3), ..options() };
    let bytes = written(field(4, 1, 3), "tz", &described(r#"{"shape": [3, 4, 5, 7]}"#));
    let (_folder, path) = temp_file("a.tif", &bytes);
    assert_boxes(&*open(&[path], &told).unwrap(), field(4, 1, 3));
}

#[test]
fn tifffiles_coloured_planes_in_one_directory_are_read() {
    for (planar, axes, shape) in [(false, "TYXS", "[3, 5, 7, 3]"), (true, "TSYX", "[3, 3, 5, 7]")] {
        let whole = field(1, 3, 3);
        for directories in [None, Some(1)] {
            let layout = Layout {
                samples: 3,
                photometric: 2,
                planar,
                directories,
                chunk: Err(5),
                ..described(&format!(r#"{{"shape": {shape}, "axes": "{axes}"}}"#))
            };
            if directories.is_some() && planar {
                // The writer here supports one strip for a single directory, and samples in planes have one each.
                continue;
            }
            assert_boxes(&*read(whole, "tc", &layout).1, whole);
        }
    }
}

#[test]
fn arrays_of_a_plane_each_are_a_stack_and_others_are_counted() {
    let (_folder, source) = read(field(6, 1, 1), "z", &described(r#"{"shape": [5, 7]}"#));
    assert_boxes(&*source, field(6, 1, 1));
    assert!(notes(&*source).contains("6 pages are arrays of their own"), "{}", notes(&*source));
    for shape in ["[4, 5, 7]", "[9, 5, 7]"] {
        let message =
            refusal(&written(field(6, 1, 1), "z", &described(&format!(r#"{{"shape": {shape}}}"#))), &options());
        assert!(message.contains("it holds 6 pages"), "{message}");
    }
}

/// A MetaMorph stack: distance of planes in tenths, and the millisecond of each.
fn metamorph(planes: &[(u64, u64)]) -> Vec<u8> {
    let numbers = planes.iter().flat_map(|&(z, ms)| [z, 10, 2_459_000, ms, 0, 0]).collect();
    let whole = field(planes.len() as u32, 1, 1);
    let lists = vec![(33628, 4, vec![4, 12]), (33629, 5, numbers)];
    let layout = Layout { directories: Some(1), lists, ..Layout::default() };
    let mut bytes = written(whole, "z", &layout);
    // MetaMorph's counts are of planes and of entries, not of numbers.
    for (tag, count) in [(33629u16, planes.len() as u32), (33628, 1)] {
        let at = bytes.windows(2).rposition(|w| w == tag.to_le_bytes()).unwrap();
        bytes[at + 4..at + 8].copy_from_slice(&count.to_le_bytes());
    }
    bytes
}

#[test]
fn metamorphs_planes_lie_behind_the_first() {
    let (_folder, path) = temp_file("a.stk", &metamorph(&[(5, 7); 4]));
    // The name is unknown; the first bytes are known.
    let source = opened(&path).unwrap();
    assert_boxes(&*source, field(4, 1, 1));
    assert_eq!((source.info().geometry.spacing.z, source.info().calibrated), (0.5, true));
    let (_folder, path) = temp_file("a.stk", &metamorph(&[(0, 7), (0, 1007), (0, 2007)]));
    let source = opened(&path).unwrap();
    assert_eq!((source.info().times, source.info().extent.z), (3, 1));
    assert_eq!(source.info().time.as_ref().map(|axis| axis.step), Some(1.0));
    // Times that go back are none, and a warning says so.
    let (_folder, path) = temp_file("a.stk", &metamorph(&[(0, 2007), (0, 1007), (0, 7)]));
    let source = opened(&path).unwrap();
    assert_eq!((source.info().times, source.info().time.is_none()), (3, true));
    let said = said(&source.info().notes);
    assert!(is_warned(&said, "MetaMorph's times are left out"), "{said}");
    let short = metamorph(&[(5, 7); 4]);
    let at = short.windows(2).rposition(|w| w == 33629u16.to_le_bytes()).unwrap();
    let mut more = short.clone();
    more[at + 4] = 200;
    let message = refusal(&more, &options());
    assert!(message.contains("STK") || message.contains("missing"), "{message}");
}

/// A list of files with a stack each is a series, even if each has a single directory.
#[test]
fn lists_of_stacks_behind_one_directory_are_series() {
    let series = field(4, 1, 2);
    let of_step = |step: usize, bytes: &[u8]| {
        let (mut bytes, all) = (bytes.to_vec(), series.bytes("tzyx", false));
        let stack = &all[step * all.len() / 2..][..all.len() / 2];
        bytes[8..8 + stack.len()].copy_from_slice(stack);
        bytes
    };
    let imagej = "ImageJ=1.54f\nimages=4\nslices=4\n";
    let one = |text: &str| Layout { directories: Some(1), chunk: Err(5), ..described(text) };
    let shaped = r#"{"shape": [4, 5, 7], "axes": "ZYX", "truncated": true}"#;
    for (bytes, is_metamorphs) in [
        (written(field(4, 1, 1), "z", &one(imagej)), false),
        (written(field(4, 1, 1), "z", &one(shaped)), false),
        (metamorph(&[(5, 7); 4]), true),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let paths = [0, 1].map(|step| folder.path().join(format!("s{step}.tif")));
        let of_step = |step| if is_metamorphs { bytes.clone() } else { of_step(step, &bytes) };
        paths.iter().enumerate().for_each(|(step, path)| std::fs::write(path, of_step(step)).unwrap());
        for inputs in [paths.to_vec(), vec![folder.path().to_owned()]] {
            let source = open(&inputs, &options()).unwrap();
            assert_eq!((source.info().extent.z, source.info().times), (4, 2));
            if !is_metamorphs {
                assert_boxes(&*source, series);
            }
        }
        let told = OpenOptions { axes: Some("zyx".parse().unwrap()), ..options() };
        assert_eq!(open(&paths, &told).unwrap().info().extent.z, 2);
    }
    // Where all are truncated, each is reported as if alone.
    let folder = tempfile::tempdir().unwrap();
    let cut = written(field(4, 1, 1), "z", &Layout { directory_first: true, ..one(imagej) });
    let paths = [0, 1].map(|step| folder.path().join(format!("s{step}.tif")));
    for missing in [1, 60] {
        paths.iter().for_each(|path| std::fs::write(path, &cut[..cut.len() - missing]).unwrap());
        for inputs in [paths.to_vec(), vec![folder.path().to_owned()]] {
            let message = open(&inputs, &options()).err().unwrap().to_string();
            assert!(message.contains("s0.tif") && message.contains(&format!("({missing} missing)")), "{message}");
        }
    }
    // A page cut out of a stack has the stack's description, and is a plane.
    let folder = tempfile::tempdir().unwrap();
    let paths: Vec<PathBuf> = (0..3).map(|z| folder.path().join(format!("s{z}.tif"))).collect();
    paths.iter().for_each(|path| std::fs::write(path, written(field(1, 1, 1), "z", &described(imagej))).unwrap());
    assert_eq!(open(&paths, &options()).unwrap().info().extent.z, 3);
}

#[test]
fn images_that_no_axes_are_of_are_refused() {
    for (keys, planes) in [("channels=2", 2), ("channels=2\nslices=4", 8), ("slices=4\nframes=3", 12)] {
        let text = format!("ImageJ=1.53t\nimages=24\n{keys}\n");
        for directories in [None, Some(1)] {
            let layout = Layout { directories, chunk: Err(5), ..described(&text) };
            let message = refusal(&written(field(24, 1, 1), "z", &layout), &options());
            assert!(message.contains("24") && message.contains(&planes.to_string()), "{message}");
        }
    }
}

#[test]
fn pages_of_one_file_that_say_unlike_things_are_refused() {
    let text = |text: &str| text.bytes().chain([0]).map(u64::from).collect::<Vec<u64>>();
    let pages = |first: &[(u16, u16, Vec<u64>)], others: &[(u16, u16, Vec<u64>)]| {
        let layout = Layout { lists: first.to_vec(), other_lists: others.to_vec(), ..Layout::default() };
        written(field(3, 1, 1), "z", &layout)
    };
    let nodata = |value: &str| vec![(42113, 2, text(value))];
    let of_x = |size: u64| vec![(282, 5, vec![size, 1]), (283, 5, vec![100, 1]), (296, 3, vec![3])];
    for (first, others, name) in [
        (nodata("7"), nodata("9"), "GDAL_NODATA"),
        (vec![], nodata("9"), "GDAL_NODATA"),
        (of_x(100), of_x(50), "pixels a unit"),
    ] {
        let message = refusal(&pages(&first, &others), &options());
        assert!(message.contains("page 2") && message.contains(name), "{message}");
        let told = OpenOptions { nodata: NoData::Value(9.0), spacing: Some(DVec3::ONE), ..options() };
        let (_folder, path) = temp_file("a.tif", &pages(&first, &others));
        assert_eq!(open(&[path], &told).unwrap().info().nodata, Some(9.0));
    }
    // With another no-data value, or NaN alone, the source knows that a number is data.
    for (value, knows) in [("nan", true), ("1e39", true), ("7", false), ("", false)] {
        let (_folder, path) = temp_file("a.tif", &pages(&nodata(value), &nodata(value)));
        assert_eq!(opened(&path).unwrap().info().knows_nodata, knows, "{value}");
    }
    // Some programs tag only the first page.
    for (first, others, expected) in [
        (nodata("7"), vec![], Some(7.0)),
        (nodata("7"), nodata("7.0"), Some(7.0)),
        (nodata("nan"), nodata("NaN"), None),
        (of_x(100), of_x(100), None),
    ] {
        let (_folder, path) = temp_file("a.tif", &pages(&first, &others));
        assert_eq!(opened(&path).unwrap().info().nodata, expected);
    }
}

fn gdal(items: &[(&str, &str)]) -> (u16, u16, Vec<u64>) {
    let items = items.iter().map(|(role, text)| format!("<Item name=\"A\" sample=\"0\" role=\"{role}\">{text}</Item>"));
    let text = format!("<GDALMetadata>{}</GDALMetadata>\n\0", items.collect::<String>());
    (42112, 2, text.bytes().map(u64::from).collect())
}

fn text_of(tag: u16, text: &str) -> (u16, u16, Vec<u64>) {
    (tag, 2, text.bytes().chain([0]).map(u64::from).collect())
}

#[test]
fn values_are_scaled_as_gdal_says() {
    let (_folder, plain) = read(field(2, 1, 1), "z", &Layout::default());
    let stored = values(&*plain);
    let scaled = |items: &[(&str, &str)], more: &[(u16, u16, Vec<u64>)], options: &OpenOptions| {
        let lists = [&[gdal(items)], more].concat();
        let layout = Layout { other_lists: lists.clone(), lists, ..Layout::default() };
        open_in(temp_file("a.tif", &written(field(2, 1, 1), "z", &layout)), options).unwrap()
    };
    let source = scaled(&[("scale", "0.01"), ("offset", "-273.15"), ("unittype", "degC")], &[], &options());
    assert_eq!(source.info().voxel_type, VoxelType::F32);
    for (found, stored) in values(&*source).iter().zip(&stored) {
        assert_eq!(*found, f64::from((stored * 0.01 - 273.15) as f32));
    }
    assert!(notes(&*source).contains("scaled by 0.01 and shifted by -273.15, as GDAL says"), "{}", notes(&*source));
    let unit = |source: &dyn Source| source.info().channel_looks.first().and_then(|look| look.unit.clone());
    assert_eq!(unit(&*source).as_deref(), Some("degC"));
    let whole = scaled(&[("offset", "-5")], &[], &options());
    assert_eq!(whole.info().voxel_type, VoxelType::I32);
    assert_eq!(values(&*whole), stored.iter().map(|n| n - 5.0).collect::<Vec<_>>());
    let unread = scaled(&[("scale", "x"), ("unittype", "m")], &[], &options());
    assert_eq!((values(&*unread), unit(&*unread)), (stored.clone(), None));
    assert!(is_warned(&notes(&*unread), "make no values, are not applied: values are kept as stored"));
    // A unit without a scale is that of the stored numbers.
    assert_eq!(unit(&*scaled(&[("unittype", "m")], &[], &options())).as_deref(), Some("m"));
    // The stored number without data becomes NaN; whole values keep one.
    let nodata = [text_of(42113, &stored[3].to_string())];
    let source = scaled(&[("scale", "0.5")], &nodata, &options());
    let is_absent = |(found, stored_now): (&f64, &f64)| found.is_nan() == (*stored_now == stored[3]);
    assert!(values(&*source).iter().zip(&stored).all(is_absent));
    assert_eq!((source.info().nodata, source.info().knows_nodata), (None, true));
    assert!(notes(&*source).contains("GDAL_NODATA): they become NaN"), "{}", notes(&*source));
    let none = OpenOptions { nodata: NoData::None, ..options() };
    assert!(values(&*scaled(&[("scale", "0.5")], &nodata, &none)).iter().all(|value| !value.is_nan()));
    let whole = scaled(&[("scale", "2")], &nodata, &options());
    assert_eq!(whole.info().nodata, Some(2.0 * stored[3]));
    let beyond = scaled(&[("scale", "0.5")], &[text_of(42113, "-9999")], &options());
    assert!(values(&*beyond).iter().all(|value| !value.is_nan()));
}

#[test]
fn pages_and_files_that_gdal_scales_unalike_are_refused() {
    let half = || vec![gdal(&[("scale", "0.5")])];
    for (first, others) in [(half(), vec![]), (vec![], half()), (half(), vec![gdal(&[("scale", "0.25")])])] {
        let layout = Layout { lists: first.clone(), other_lists: others.clone(), ..Layout::default() };
        let message = refusal(&written(field(2, 1, 1), "z", &layout), &options());
        assert!(message.contains("page 2 has another scale or unit of values than page 1"), "{message}");
        let folder = tempfile::tempdir().unwrap();
        for (name, lists) in [("a0.tif", first), ("a1.tif", others)] {
            let bytes = written(field(1, 1, 1), "z", &Layout { lists, ..Layout::default() });
            std::fs::write(folder.path().join(name), bytes).unwrap();
        }
        let message = opened(folder.path()).err().unwrap().to_string();
        assert!(message.contains("a1.tif: its values are calibrated") && message.contains("GDAL"), "{message}");
    }
    let layout = Layout { lists: vec![gdal(&[("scale", "2")])], ..described("ImageJ=1.53t\nc0=1\nc1=3\n") };
    let (_folder, source) = read(field(1, 1, 1), "z", &layout);
    assert!(is_warned(&notes(&*source), "GDAL's scale of values is not applied"));
    assert!(notes(&*source).contains("scaled by 3 and shifted by 1"));
}

#[test]
fn pixels_that_are_no_squares_are_turned_with_their_page() {
    let lists = vec![(282, 5, vec![100, 1]), (283, 5, vec![50, 1]), (296, 3, vec![3])];
    for (orientation, expected) in [(1, [0.01, 0.02]), (3, [0.01, 0.02]), (6, [0.02, 0.01]), (8, [0.02, 0.01])] {
        let layout = Layout { lists: lists.clone(), tags: vec![(274, orientation)], ..Layout::default() };
        let spacing = read(field(2, 1, 1), "z", &layout).1.info().geometry.spacing;
        assert_eq!([spacing.x, spacing.y], expected, "{orientation}");
    }
}

#[test]
fn planes_of_another_scale_or_unit_are_refused() {
    let imagej = |unit: &str, resolution| Layout { resolution, ..described(&format!("ImageJ=1.54f\nunit={unit}\n")) };
    let geo = |size: f64| Layout {
        lists: vec![(33550, 12, [size, size, 0.0].map(f64::to_bits).to_vec())],
        ..Layout::default()
    };
    let opened = |layouts: [Layout; 2], options: &OpenOptions| {
        let folder = tempfile::tempdir().unwrap();
        let paths = [0, 1].map(|z| folder.path().join(format!("s{z}.tif")));
        let each = paths.iter().zip(layouts);
        each.for_each(|(path, layout)| std::fs::write(path, written(field(1, 1, 1), "z", &layout)).unwrap());
        open(&paths, options).map(|source| source.info().geometry.clone()).map_err(|error| error.to_string())
    };
    for layouts in [
        [imagej("um", Some(1)), imagej("nm", Some(1))],
        [imagej("um", Some(1)), imagej("um", Some(4))],
        [geo(30.0), geo(10.0)],
        [geo(30.0), Layout::default()],
        [Layout::default(), geo(30.0)],
    ] {
        let message = opened(layouts.clone(), &options()).unwrap_err();
        assert!(message.contains("s1.tif: has pixels of") && message.contains("`spacing`"), "{message}");
        let told = OpenOptions { spacing: Some(DVec3::splat(2.0)), unit: Some("micrometer".into()), ..options() };
        assert_eq!(opened(layouts, &told).unwrap().spacing, DVec3::splat(2.0));
    }
    assert_eq!(opened([geo(30.0), geo(30.000_01)], &options()).unwrap().spacing.x, 30.0);
}

/// By increments that agree, or else by the times of the files' first planes; the user's times override both.
#[test]
fn files_of_one_step_each_say_when_they_were_taken() {
    let field = Field { sizes: [7, 5, 2, 1, 1], voxel_type: VoxelType::U8 };
    let ome = |increment: &str, stamp: f64| {
        format!(
            r#"<OME><Image ID="i"><Pixels DimensionOrder="XYZCT" Type="uint8" SizeX="7" SizeY="5" SizeZ="2" SizeC="1" SizeT="1" {increment}>
               <TiffData/><Plane TheT="0" TheZ="0" TheC="0" DeltaT="{stamp}" DeltaTUnit="ms"/></Pixels></Image></OME>"#
        )
    };
    let imagej = |step: &str| format!("ImageJ=1.53t\nimages=2\nslices=2\nfinterval={step}\n");
    let time = |descriptions: [String; 3], options: &OpenOptions| {
        let folder = tempfile::tempdir().unwrap();
        let paths: Vec<_> = descriptions
            .iter()
            .enumerate()
            .map(|(i, text)| {
                let path = folder.path().join(format!("s{i}.tif"));
                std::fs::write(&path, written(field, "z", &described(text))).unwrap();
                path
            })
            .collect();
        let source = open(&paths, options).unwrap();
        assert_eq!(source.info().times, 3);
        source.info().time.clone().map(|axis| (axis.step, axis.stamps, axis.unit.unwrap_or_default()))
    };
    let tifffile = |step: f64| format!(r#"{{"shape": [2, 5, 7], "finterval": {step}}}"#);
    let (none, told) = (OpenOptions::default(), OpenOptions { time_step: Some(2.0), ..OpenOptions::default() });
    let stamps = |increment: &str| [1.0, 2.0, 9.0].map(|stamp| ome(increment, stamp));
    let every = r#"TimeIncrement="0.5" TimeIncrementUnit="s""#;
    assert_eq!(time(stamps(every), &none), Some((0.5, vec![], "second".into())));
    assert_eq!(time(stamps(""), &none), Some((7.0, vec![1.0, 2.0, 9.0], "millisecond".into())));
    assert_eq!(time(stamps(every), &told).unwrap().0, 2.0);
    assert_eq!(time([0.25; 3].map(tifffile), &none), Some((0.25, vec![], "second".into())));
    assert_eq!(time([0.0; 3].map(|stamp| ome("", stamp)), &none), None);
    assert_eq!(time(["0.25"; 3].map(imagej), &none), Some((0.25, vec![], "second".into())));
    assert_eq!(time(["0.25", "0.25", "0.5"].map(imagej), &none), None);
}

#[test]
fn descriptions_of_other_programs_are_named() {
    let text = |text: &str| (270, 2, text.bytes().chain([0]).map(u64::from).collect::<Vec<u64>>());
    for (lists, name) in [
        (vec![(33471, 2, b"[Dimension]\r\nTime=2\0".map(u64::from).to_vec())], "Olympus SIS"),
        (
            vec![text("<?xml version=\"1.0\"?><PerkinElmer-QPI-ImageDescription></PerkinElmer-QPI-ImageDescription>")],
            "QPI",
        ),
        (vec![text("<indica><image/></indica>")], "Indica"),
        (vec![text("<?xml version=\"1.0\"?><scn xmlns=\"x\"></scn>")], "SCN"),
        (vec![(34362, 1, vec![0; 64])], "FluoView"),
        (vec![(34412, 1, vec![0; 64])], "Zeiss LSM"),
        (vec![(305, 2, b"SI.VERSION = 1\0".map(u64::from).to_vec())], "ScanImage"),
        (vec![(270, 2, b"state.acq=2\0".map(u64::from).to_vec())], "ScanImage"),
    ] {
        let layout = Layout { lists, ..Layout::default() };
        let bytes = written(field(4, 1, 1), "z", &layout);
        let message = refusal(&bytes, &options());
        assert!(message.contains(name) && message.contains("`axes`"), "{message}");
        let (_folder, path) = temp_file("a.tif", &bytes);
        let told = OpenOptions { axes: Some("zyx".parse().unwrap()), ..options() };
        assert_boxes(&*open(&[path], &told).unwrap(), field(4, 1, 1));
        // One page has no order.
        assert_boxes(&*read(field(1, 1, 1), "z", &layout).1, field(1, 1, 1));
    }
}

#[test]
fn packed_planes_in_one_directory_are_refused() {
    let lists = vec![(33629, 5, vec![5, 10, 2_459_000, 7, 0, 0])];
    let layout = Layout { lists, lzw: Some(1), ..Layout::default() };
    let mut bytes = written(field(1, 1, 1), "z", &layout);
    let at = bytes.windows(2).rposition(|w| w == 33629u16.to_le_bytes()).unwrap();
    let uic2 = u32::from_le_bytes(bytes[at + 8..at + 12].try_into().unwrap()) as usize;
    let planes = bytes[uic2..uic2 + 24].repeat(3);
    let end = bytes.len() as u32;
    bytes.extend(planes);
    bytes[at + 4..at + 8].copy_from_slice(&3u32.to_le_bytes());
    bytes[at + 8..at + 12].copy_from_slice(&end.to_le_bytes());
    let message = refusal(&bytes, &options());
    assert!(message.contains("in one directory") && message.contains("compressed"), "{message}");
}

#[test]
fn scales_of_tags_are_spacings_and_the_missing_one_is_told() {
    let with = |z, layout: Layout| {
        let (_folder, source) = read(field(z, 1, 1), "z", &layout);
        let geometry = &source.info().geometry;
        (geometry.spacing, geometry.unit.clone(), source.info().calibrated, notes(&*source))
    };
    let (spacing, unit, calibrated, said) =
        with(3, Layout { resolution: Some(50), tags: vec![(296, 3)], ..Layout::default() });
    assert_eq!((spacing, unit.as_deref(), calibrated), (DVec3::splat(0.02), Some("centimeter"), true));
    assert!(said.contains("0.02 centimeter is taken along z"), "{said}");
    let (_, _, _, said) = with(1, Layout { resolution: Some(50), tags: vec![(296, 3)], ..Layout::default() });
    assert!(!said.contains("along z"), "{said}");
    let (spacing, _, calibrated, said) =
        with(3, Layout { resolution: Some(72), tags: vec![(296, 2)], ..Layout::default() });
    assert_eq!((spacing, calibrated), (DVec3::ONE, false));
    assert!(said.contains("72 pixels per inch"), "{said}");
    let scale = vec![(33550, 12, [30.0f64, 15.0, 0.0].map(f64::to_bits).to_vec())];
    let (spacing, _, _, said) = with(3, Layout { lists: scale, ..Layout::default() });
    assert_eq!(spacing, DVec3::new(30.0, 15.0, 30.0));
    assert!(said.contains("GeoTIFF") && said.contains("30 is taken along z"), "{said}");
}

#[test]
fn pages_are_turned_as_they_are_meant() {
    for orientation in 2..=8 {
        for (samples, chunk) in [(1, Err(2)), (3, Ok([16, 16]))] {
            let whole = field(2, samples, 1);
            let photometric = if samples == 3 { 2 } else { 1 };
            let layout = Layout { samples, photometric, chunk, tags: vec![(274, orientation)], ..Layout::default() };
            let (_folder, source) = read(whole, "zc", &layout);
            let (_other, plain) = read(whole, "zc", &Layout { tags: vec![(274, 1)], ..layout.clone() });
            let is_transposed = orientation >= 5;
            let [columns, rows] = if is_transposed { [5, 7] } else { [7, 5] };
            assert_eq!(source.info().extent.to_array(), [columns, rows, 2]);
            assert!(notes(&*source).contains("Orientation"));
            for (channel, z) in (0..samples).flat_map(|c| [(c, 0), (c, 1)]) {
                let plane = |source: &dyn Source, [x, y]: [u32; 2]| {
                    let mut out = vec![0; 70];
                    source.read_box(0, channel, VoxelBox::new([0, 0, z], [x, y, z + 1]), &mut out).unwrap();
                    out
                };
                let (turned, stored) = (plane(&*source, [columns, rows]), plane(&*plain, [7, 5]));
                let mut part = vec![0; 12];
                source.read_box(0, channel, VoxelBox::new([1, 2, z], [4, 4, z + 1]), &mut part).unwrap();
                for (i, j) in (0..7usize).flat_map(|i| (0..5usize).map(move |j| (i, j))) {
                    // Destination of the stored column i and row j, by the standard's words.
                    let (right, below) = (6 - i, 4 - j);
                    let [x, y] = match orientation {
                        2 => [right, j],
                        3 => [right, below],
                        4 => [i, below],
                        5 => [j, i],
                        6 => [below, i],
                        7 => [below, right],
                        _ => [j, right],
                    };
                    let voxel = |bytes: &[u8], at: usize| [bytes[2 * at], bytes[2 * at + 1]];
                    let expected = voxel(&stored, j * 7 + i);
                    assert_eq!(voxel(&turned, y * columns as usize + x), expected, "{orientation}");
                    if (1..4).contains(&x) && (2..4).contains(&y) {
                        assert_eq!(voxel(&part, (y - 2) * 3 + x - 1), expected, "{orientation}, a part");
                    }
                }
            }
        }
    }
    let message =
        refusal(&written(field(1, 1, 1), "z", &Layout { tags: vec![(274, 9)], ..Layout::default() }), &options());
    assert!(message.contains("an Orientation of 9 is not supported"), "{message}");
    let layout = Layout { directories: Some(1), tags: vec![(274, 3)], ..described(r#"{"shape": [4, 5, 7]}"#) };
    let message = refusal(&written(field(4, 1, 1), "z", &layout), &options());
    assert!(message.contains("another Orientation than 1"), "{message}");
}

#[test]
fn values_without_data_are_those_that_the_type_holds() {
    let floats = Field { voxel_type: VoxelType::F32, ..field(2, 1, 1) };
    let nodata = |text: &str, lists_of: Field| {
        let digits = text.bytes().chain([0]).map(u64::from).collect();
        let layout = Layout { lists: vec![(42113, 2, digits)], ..Layout::default() };
        read(lists_of, "z", &layout).1.info().nodata
    };
    let least = Some(f32::MIN as f64);
    for text in ["-3.4028234663852886e+38", "-3.4028235e+38", "-3.40282347e+38", " -3.40282346638529e+38 "] {
        assert_eq!(nodata(text, floats), least, "{text}");
    }
    assert_eq!(nodata("3.4028235e+38", floats), Some(f32::MAX as f64));
    assert_eq!(nodata("-9999.9", floats), Some(-9999.9f32 as f64));
    assert_eq!((nodata("-3.41e38", floats), nodata("1e39", floats)), (None, None));
    assert_eq!(nodata("17", field(2, 1, 1)), Some(17.0));
    assert_eq!(nodata("17.5", field(2, 1, 1)), None);
}

#[test]
fn values_without_data_are_those_that_pixels_can_have() {
    let of_f32 = crate::element::Element::Voxel(brickyard_volume::VoxelType::F32);
    assert_eq!(super::super::description::nearest(0.1, of_f32), 0.1f32 as f64);
    assert_eq!(super::super::description::nearest(65504.01, crate::element::Element::F16), 65504.0);
    assert_eq!(super::super::description::nearest(f64::MIN, crate::element::Element::F64), f64::MIN);
}

proptest! {
    #![proptest_config(crate::testing::cases(400))]

    /// Damage leads to an error or wrong voxels, never to a panic.
    #[test]
    fn damaged_descriptions_do_not_panic(
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4),
        kind in 0..4usize,
    ) {
        let texts = [
            r#"{"shape": [3, 2, 5, 7], "axes": "TZYX", "spacing": 2.5, "unit": "um"}"#,
            "<OME UUID='a'><Image><Pixels DimensionOrder='XYZCT' SizeX='7' SizeY='5' SizeZ='2' SizeC='1' SizeT='3'>\
             <TiffData IFD='2' FirstT='1' PlaneCount='4'/><TiffData PlaneCount='2'><UUID FileName='a.tif'>a</UUID></TiffData></Pixels></Image></OME>",
            "ImageJ=1.53t\nimages=6\nslices=2\nframes=3\nunit=um\nspacing=2\n",
        ];
        let mut bytes = match texts.get(kind) {
            Some(text) => written(field(2, 1, 3), "tz", &described(text)),
            None => metamorph(&[(5, 7); 4]),
        };
        // Mostly in the description and the first directory.
        let first = u32::from_le_bytes(bytes[4..8].try_into().unwrap()) as usize;
        for (place, value) in damage {
            let place = first.saturating_sub(280) + place.index(480);
            if let Some(byte) = bytes.get_mut(place) {
                *byte = value;
            }
        }
        let (_folder, path) = temp_file("a.tif", &bytes);
        if let Ok(source) = opened(&path) {
            let e = source.info().extent;
            let region = VoxelBox::new([0, 0, 0], [e.x.min(50), e.y.min(50), e.z.min(2)]);
            let mut out = vec![0; region.extent().volume() as usize * source.info().voxel_type.bytes()];
            let _ = source.read_box(0, 0, region, &mut out);
        }
    }
}

#[test]
fn losses_of_a_description_are_warnings() {
    let pixels =
        "<Pixels DimensionOrder='XYZCT' SizeX='7' SizeY='5' SizeZ='4' SizeC='1' SizeT='1'><TiffData/></Pixels>";
    let modulo = "<A><Modulo><ModuloAlongZ Type='angle' Start='0' End='1'/></Modulo></A>";
    for (text, words) in [
        (format!("<OME><Image>{pixels}</Image>{modulo}</OME>"), "splits an axis once more (Modulo)"),
        ("<OME><Image/></OME>".into(), "has no Pixels"),
    ] {
        let said = notes(&*read(field(4, 1, 1), "z", &described(&text)).1);
        assert!(is_warned(&said, words), "{words}: {said}");
    }
}
