//! Plane-to-page maps from OME-XML: in one file, in several, and in a separate file.

use super::*;
use crate::FileOrder;

const OWN: &str = "urn:uuid:00000000-0000-0000-0000-00000000000a";
const OTHER: &str = "urn:uuid:00000000-0000-0000-0000-00000000000b";

/// Steps, channels and slices of the tests.
const WHOLE: Field = Field { sizes: [7, 5, 3, 2, 2], voxel_type: VoxelType::U16 };

fn xml(uuid: &str, order: &str, tiff_data: &str) -> String {
    format!(
        "<?xml version=\"1.0\"?><OME UUID='{uuid}'><Image><Pixels DimensionOrder=\"{order}\" SizeX=\"7\" SizeY=\"5\" SizeZ=\"3\" \
         SizeC=\"2\" SizeT=\"2\"><Channel Name='first'/><Channel/>{tiff_data}</Pixels></Image></OME>"
    )
}

/// The place of a plane, in a file if named.
fn data(plane: [u32; 3], ifd: u32, file: Option<(&str, &str)>) -> String {
    let [t, c, z] = plane;
    let file = file.map_or(String::new(), |(name, uuid)| format!("<UUID FileName='{name}'>{uuid}</UUID>"));
    format!("<TiffData IFD='{ifd}' FirstT='{t}' FirstC='{c}' FirstZ='{z}' PlaneCount='1'>{file}</TiffData>")
}

fn planes() -> impl Iterator<Item = [u32; 3]> {
    (0..2).flat_map(|t| (0..2).flat_map(move |c| (0..3).map(move |z| [t, c, z])))
}

/// Pages run along z, t, c, slowest first, whatever `DimensionOrder` says.
fn page([t, c, z]: [u32; 3]) -> u32 {
    (z * 2 + t) * 2 + c
}

fn file(description: &str) -> Vec<u8> {
    written(WHOLE, "ztc", &Layout { description: description.into(), ..Layout::default() })
}

fn why(bytes: &[u8]) -> String {
    refusal(bytes, &options())
}

#[test]
fn planes_are_in_any_order() {
    for order in ["XYZCT", "XYTCZ", "XYCTZ"] {
        let each = planes().map(|plane| data(plane, page(plane), None)).collect::<String>();
        let (_folder, path) = temp_file("a.ome.tif", &file(&xml(OWN, order, &each)));
        let source = opened(&path).unwrap();
        assert_boxes(&*source, WHOLE);
        assert_eq!(source.info().channel_looks[0].name.as_deref(), Some("first"));
    }
    // Runs of planes, each from its own start; the second comes first.
    let runs = "<TiffData IFD='6' FirstT='0' FirstC='1' FirstZ='1' PlaneCount='6'/><TiffData PlaneCount='6'/>";
    let text = xml(OWN, "XYCTZ", runs);
    let (_folder, path) =
        temp_file("a.ome.tif", &file(&text.replace("FirstC='1'", "FirstC='0'").replace("FirstT='0'", "FirstT='1'")));
    assert_boxes(&*opened(&path).unwrap(), WHOLE);
    for all in ["<TiffData/>", "<TiffData IFD='0' PlaneCount='12'/>", ""] {
        let (_folder, path) = temp_file("a.ome.tif", &file(&xml(OWN, "XYCTZ", all)));
        assert_boxes(&*opened(&path).unwrap(), WHOLE);
    }
}

#[test]
fn planes_without_a_page_or_with_two_are_named() {
    let each = |change: &dyn Fn([u32; 3]) -> String| xml(OWN, "XYZCT", &planes().map(change).collect::<String>());
    let missing = each(&|plane| if plane == [1, 0, 2] { String::new() } else { data(plane, page(plane), None) });
    assert!(
        why(&file(&missing)).contains("no page for the plane of step 1, channel 0, slice 2"),
        "{}",
        why(&file(&missing))
    );
    let twice = each(&|plane| data(if plane == [1, 0, 2] { [1, 1, 0] } else { plane }, page(plane), None));
    let message = why(&file(&twice));
    assert!(
        message.contains("two pages for the plane of step 1, channel 1, slice 0: directory 10 of a.tif"),
        "{message}"
    );
    let far = each(&|plane| data(plane, page(plane) + 40, None));
    assert!(why(&file(&far)).contains("directory 40 of a.tif, which has 12 (0 to 11)"), "{}", why(&file(&far)));
    let beyond = each(&|[t, c, z]| data([t, c, z + 1], page([t, c, z]), None));
    assert!(why(&file(&beyond)).contains("slice 3, which is outside of its sizes"), "{}", why(&file(&beyond)));
    let long = xml(OWN, "XYZCT", "<TiffData IFD='0' FirstT='1' PlaneCount='9'/>");
    assert!(why(&file(&long)).contains("name 15 pages"), "{}", why(&file(&long)));
    let few = xml(OWN, "XYZCT", "<TiffData/>").replace("SizeT=\"2\"", "SizeT=\"1\"");
    assert!(why(&file(&few)).contains("declares 6 planes"), "{}", why(&file(&few)));
    let wide = xml(OWN, "XYZCT", "<TiffData/>").replace("SizeX=\"7\"", "SizeX=\"8\"");
    assert!(why(&file(&wide)).contains("planes of 8x5 pixels"), "{}", why(&file(&wide)));
    // The user may override all of it.
    let (_folder, path) = temp_file("a.tif", &file(&missing));
    let told = OpenOptions { axes: Some("zyx".parse().unwrap()), ..options() };
    assert_eq!(open(&[path], &told).unwrap().info().extent.z, 12);
}

#[test]
fn pages_of_no_plane_are_left_out_and_told() {
    let some: Vec<[u32; 3]> = planes().filter(|plane| plane[2] > 0).collect();
    let text: String = some.iter().map(|&[t, c, z]| data([t, c, z - 1], page([t, c, z]), None)).collect();
    let mut bytes = file(&xml(OWN, "XYZCT", &text).replace("SizeZ=\"3\"", "SizeZ=\"2\""));
    let read = |bytes: &[u8]| {
        let (folder, path) = temp_file("a.tif", bytes);
        (folder, opened(&path))
    };
    let check = |source: &dyn Source| {
        assert_eq!((source.info().extent.z, source.info().channels, source.info().times), (2, 2, 2));
        let mut found = vec![0; 7 * 5 * 2];
        source.read_box(1, 0, VoxelBox::new([0, 0, 1], [7, 5, 2]), &mut found).unwrap();
        let all = WHOLE.bytes("tczyx", false);
        assert!(found == all[70 * (6 + 2)..][..70]);
        assert!(
            source.info().notes.iter().any(|note| note.contains("4 pages are of no plane")),
            "{:?}",
            source.info().notes
        );
    };
    check(&*read(&bytes).1.unwrap());
    // An unused page of another size does not matter; a plane's page does.
    let widths: Vec<usize> =
        bytes.windows(8).enumerate().filter(|w| w.1 == [0, 1, 4, 0, 1, 0, 0, 0]).map(|w| w.0 + 8).collect();
    assert_eq!(widths.len(), 12);
    bytes[widths[0]] = 6;
    check(&*read(&bytes).1.unwrap());
    bytes[widths[7]] = 6;
    let message = read(&bytes).1.err().unwrap().to_string();
    assert!(message.contains("page 8 is 6x5"), "{message}");
}

/// Two files of a step each, whose XML covers both; the second is named a-second.ome.tif.
fn two_files(tell: impl Fn(&str, &str) -> String) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let step = |t: usize, uuid: &str, name: &str| {
        let layout = Layout { description: tell(uuid, name), ..Layout::default() };
        let mut bytes = written(WHOLE, "tcz", &layout);
        keep_pages(&mut bytes, t * 6, 6);
        std::fs::write(folder.path().join(name), bytes).unwrap();
    };
    step(0, OWN, "first.ome.tif");
    step(1, OTHER, "a-second.ome.tif");
    folder
}

/// Leaves some pages of a file in their order, the first with the description.
fn keep_pages(bytes: &mut [u8], first: usize, count: usize) {
    let long = |bytes: &[u8], at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    let mut links = vec![4];
    loop {
        let at = long(bytes, links[links.len() - 1]);
        if at == 0 {
            break;
        }
        let entries = u16::from_le_bytes([bytes[at], bytes[at + 1]]) as usize;
        links.push(at + 2 + 12 * entries);
    }
    let start = long(bytes, links[first]);
    bytes[4..8].copy_from_slice(&(start as u32).to_le_bytes());
    let end = links[first + count];
    bytes[end..end + 4].copy_from_slice(&[0; 4]);
}

fn in_two(name: &str, uuid: &str) -> String {
    planes()
        .map(|plane| {
            let [t, c, z] = plane;
            let file = if t == 0 { ("first.ome.tif", OWN) } else { (name, uuid) };
            data(plane, c * 3 + z, Some(file))
        })
        .collect()
}

#[test]
fn files_of_a_set_are_read_together() {
    let folder = two_files(|uuid, _| xml(uuid, "XYZCT", &in_two("a-second.ome.tif", OTHER)));
    let paths = ["first.ome.tif", "a-second.ome.tif"].map(|name| folder.path().join(name));
    for path in &paths {
        let source = opened(path).unwrap();
        assert_boxes(&*source, WHOLE);
        assert!(source.info().notes.iter().any(|note| note.contains("set of 2 files")));
    }
    // A renamed file is identified by its UUID.
    let renamed = folder.path().join("renamed.tif");
    std::fs::copy(&paths[0], &renamed).unwrap();
    assert_boxes(&*opened(&renamed).unwrap(), WHOLE);
    std::fs::remove_file(&renamed).unwrap();
    // All of them are the set, too.
    for inputs in [paths.to_vec(), vec![paths[1].clone(), paths[0].clone()], vec![folder.path().to_owned()]] {
        let source = open(&inputs, &options()).unwrap();
        assert_boxes(&*source, WHOLE);
        assert!(source.info().notes.iter().any(|note| note.contains("2 files are one set")));
    }
    // Beside others each would stand for it.
    let stranger = folder.path().join("z.tif");
    std::fs::write(&stranger, file("")).unwrap();
    for inputs in [vec![paths[0].clone(), stranger.clone()], vec![folder.path().to_owned()]] {
        let natural = OpenOptions { order: Some(FileOrder::Natural), ..options() };
        let message = open(&inputs, &natural).err().unwrap().to_string();
        assert!(message.contains("one of a set of 2 files") && message.contains("`axes`"), "{message}");
    }
    std::fs::remove_file(&stranger).unwrap();
    let told = OpenOptions { axes: Some("czyx".parse().unwrap()), channels: Some(2), ..options() };
    assert_eq!(open(&paths, &told).unwrap().info().times, 2);
    std::fs::rename(&paths[1], folder.path().join("elsewhere")).unwrap();
    let message = opened(&paths[0]).err().unwrap().to_string();
    assert!(message.contains("'a-second.ome.tif', which is missing"), "{message}");
    let other = Field { sizes: [5, 7, 3, 2, 1], ..WHOLE };
    let layout = Layout { description: xml(OTHER, "XYZCT", ""), ..Layout::default() };
    std::fs::write(&paths[1], written(other, "tcz", &layout)).unwrap();
    let message = opened(&paths[0]).err().unwrap().to_string();
    assert!(message.contains("a-second.ome.tif: page 1 is 5x7"), "{message}");
}

#[test]
fn a_file_of_another_set_is_not_taken() {
    let folder = two_files(|uuid, _| xml(uuid, "XYZCT", &in_two("a-second.ome.tif", "urn:uuid:other")));
    let message = opened(&folder.path().join("first.ome.tif")).err().unwrap().to_string();
    assert!(
        message.contains("a-second.ome.tif: is not the file named by") && message.contains("expected 'urn:uuid:other'"),
        "{message}"
    );
}

#[test]
fn names_do_not_lead_out_of_the_folder() {
    let outside = tempfile::tempdir().unwrap();
    let target = outside.path().join("there.tif");
    std::fs::write(&target, file("")).unwrap();
    for name in ["../a.tif", "/etc/passwd", "x/../../a.tif", "", ".", "link.tif", "linked/there.tif"] {
        let folder = two_files(|uuid, _| xml(uuid, "XYZCT", &in_two(name, OTHER)));
        std::os::unix::fs::symlink(&target, folder.path().join("link.tif")).unwrap();
        std::os::unix::fs::symlink(outside.path(), folder.path().join("linked")).unwrap();
        let message = opened(&folder.path().join("first.ome.tif")).err().unwrap().to_string();
        assert!(message.contains("not in its folder or below"), "{name}: {message}");
    }
    // But into folders below it.
    let folder = two_files(|uuid, _| xml(uuid, "XYZCT", &in_two("below/a.tif", OTHER)));
    std::fs::create_dir(folder.path().join("below")).unwrap();
    std::fs::rename(folder.path().join("a-second.ome.tif"), folder.path().join("below/a.tif")).unwrap();
    assert_boxes(&*opened(&folder.path().join("first.ome.tif")).unwrap(), WHOLE);
    // A folder is no file.
    let folder = two_files(|uuid, _| xml(uuid, "XYZCT", &in_two("below", OTHER)));
    std::fs::create_dir(folder.path().join("below")).unwrap();
    let message = opened(&folder.path().join("first.ome.tif")).err().unwrap().to_string();
    assert!(message.contains("it is not a file"), "{message}");
}

#[test]
fn a_companion_describes_files_that_have_pixels_only() {
    const THEIRS: &str = "urn:uuid:00000000-0000-0000-0000-0000000000cc";
    let binary_only = |uuid: &str, of: &str| {
        format!("<OME UUID='{uuid}'><BinaryOnly MetadataFile='set.companion.ome' UUID='{of}'/></OME>")
    };
    let folder = two_files(|uuid, _| binary_only(uuid, THEIRS));
    let paths = ["first.ome.tif", "a-second.ome.tif", "set.companion.ome"].map(|name| folder.path().join(name));
    let message = opened(&paths[0]).err().unwrap().to_string();
    assert!(message.contains("BinaryOnly") && message.contains("'set.companion.ome', which is missing"), "{message}");
    let companion = xml(THEIRS, "XYZCT", &in_two("a-second.ome.tif", OTHER));
    std::fs::write(&paths[2], &companion).unwrap();
    for path in &paths {
        assert_boxes(&*opened(path).unwrap(), WHOLE);
    }
    let told = OpenOptions { axes: Some("zyx".parse().unwrap()), ..options() };
    assert_eq!(open(&paths[..1], &told).unwrap().info().extent.z, 6);
    assert!(open(&paths[2..], &told).err().unwrap().to_string().contains("leave `axes` out"));
    for (text, words) in [
        (companion.replace(THEIRS, "urn:x"), "is not the file named by"),
        (binary_only(THEIRS, OWN), "is BinaryOnly, too"),
        (
            xml(THEIRS, "XYZCT", &planes().map(|p| data(p, 0, Some(("a-second.ome.tif", OTHER)))).collect::<String>()),
            "no pages in it",
        ),
        (xml(THEIRS, "XYZCT", "<TiffData/>"), "describes no pages in it"),
        ("<svg/>".into(), "is not OME-XML"),
        (companion[..200].into(), "cut short"),
    ] {
        std::fs::write(&paths[2], text).unwrap();
        let message = opened(&paths[0]).err().unwrap().to_string();
        assert!(message.contains(words), "{words}: {message}");
    }
    std::fs::write(&paths[2], xml(THEIRS, "XYZCT", "<TiffData/>")).unwrap();
    assert!(opened(&paths[2]).err().unwrap().to_string().contains("names none"));
    // Files combined from two sets.
    let strange = xml(THEIRS, "XYZCT", &in_two("a-second.ome.tif", "urn:uuid:strange"));
    std::fs::write(&paths[2], strange).unwrap();
    for path in &paths {
        let message = opened(path).err().unwrap().to_string();
        assert!(message.contains("a-second.ome.tif: is not the file named by"), "{message}");
    }
}

/// Files of a page each are planes of the set, by its XML, not slices.
#[test]
fn pages_of_a_set_are_no_slices() {
    let whole = Field { sizes: [7, 5, 1, 2, 1], ..WHOLE };
    let names = ["a_c0.ome.tif", "a_c1.ome.tif"];
    let text = |uuid: &str| {
        let each: String =
            (0..2).map(|c| data([0, c, 0], 0, Some((names[c as usize], [OWN, OTHER][c as usize])))).collect();
        xml(uuid, "XYZCT", &each).replace("SizeZ=\"3\"", "SizeZ=\"1\"").replace("SizeT=\"2\"", "SizeT=\"1\"")
    };
    let binary_only = |uuid: &str| format!("<OME UUID='{uuid}'><BinaryOnly MetadataFile='x.companion.ome'/></OME>");
    for is_described_elsewhere in [false, true] {
        let folder = tempfile::tempdir().unwrap();
        let paths = names.map(|name| folder.path().join(name));
        for (c, (path, uuid)) in paths.iter().zip([OWN, OTHER]).enumerate() {
            let description = if is_described_elsewhere { binary_only(uuid) } else { text(uuid) };
            let mut bytes = written(whole, "c", &Layout { description, ..Layout::default() });
            keep_pages(&mut bytes, c, 1);
            std::fs::write(path, bytes).unwrap();
        }
        if is_described_elsewhere {
            std::fs::write(folder.path().join("x.companion.ome"), text("urn:uuid:cc")).unwrap();
        }
        for inputs in [vec![paths[0].clone()], paths.to_vec(), vec![folder.path().to_owned()]] {
            assert_boxes(&*open(&inputs, &options()).unwrap(), whole);
        }
        let step = OpenOptions { is_step: true, order: Some(FileOrder::Given), ..options() };
        assert_boxes(&*open(&[folder.path().to_owned()], &step).unwrap(), whole);
        // Options can make pages slices.
        for told in [
            OpenOptions { axes: Some("zyx".parse().unwrap()), ..options() },
            OpenOptions { order: Some(FileOrder::Natural), ..options() },
        ] {
            assert_eq!(open(&paths, &told).unwrap().info().extent.z, 2);
        }
        let stranger = folder.path().join("a_c2.ome.tif");
        std::fs::write(&stranger, written(Field { sizes: [7, 5, 1, 1, 1], ..WHOLE }, "z", &Layout::default())).unwrap();
        for inputs in [vec![stranger, paths[0].clone()], vec![folder.path().to_owned()]] {
            let message = open(&inputs, &options()).err().unwrap().to_string();
            assert!(message.contains("one of a set of files") && message.contains("`axes`"), "{message}");
        }
    }
}

/// As one of several steps a file would stand for all of the set.
#[test]
fn a_file_of_a_set_is_no_step() {
    let folder = two_files(|uuid, _| xml(uuid, "XYZCT", &in_two("a-second.ome.tif", OTHER)));
    let path = folder.path().join("first.ome.tif");
    assert_boxes(&*opened(&path).unwrap(), WHOLE);
    let step = OpenOptions { is_step: true, ..options() };
    let message = open(std::slice::from_ref(&path), &step).err().unwrap().to_string();
    assert!(message.contains("one of a set of 2 files") && message.contains("`axes` zyx"), "{message}");
}

/// A description of many megabytes must not take as much memory.
#[cfg(target_os = "linux")]
#[test]
fn long_descriptions_are_read_as_a_stream() {
    let long = alone_with("tiff_stack::tests::sets::long_descriptions_are_read_as_a_stream", |path| {
        let inside = format!(
            "<TiffData/></Pixels></Image><A>{}</A></OME>",
            "<a b='0123456789 0123456789 01234567'/>".repeat(1 << 20)
        );
        let text = xml(OWN, "XYCTZ", "").replace("</Pixels></Image></OME>", &inside);
        std::fs::write(path, file(&text)).unwrap();
    });
    if let Some(path) = long {
        let (taken, ()) = crate::testing::memory_taken(|| assert_boxes(&*opened(&path).unwrap(), WHOLE));
        assert!(taken < 8 << 20, "{taken} bytes for a description of 40 MiB");
    }
}
