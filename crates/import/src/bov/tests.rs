use crate::options::OpenOptions;
use crate::testing::{Field, Opened, assert_boxes, is_warned, open_in, said, temp_file};
use brickyard_volume::VoxelType;
use glam::DVec3;
use proptest::prelude::*;

/// A description of 4 by 3 by 2 values, with further lines.
fn header(format: &str, more: &str) -> String {
    format!(
        "# a comment\nTIME: 1.5\nDATA_FILE: \"a b.values\"\nDATA SIZE: 4 3 2\nDATA_FORMAT: {format}\nVARIABLE: density\n\
         DATA_ENDIAN: LITTLE\nCENTERING: zonal\nBRICK_ORIGIN: 1. 2. 3.\nBRICK_SIZE: 8. 9. 10.\n{more}\n"
    )
}

fn open_named(name: &str, header: &str, body: &[u8]) -> Result<Opened, String> {
    let (folder, path) = temp_file(name, header.as_bytes());
    std::fs::write(path.with_file_name("a b.values"), body).unwrap();
    open_in((folder, path), &OpenOptions { allow_lossy: true, ..OpenOptions::default() })
}

fn open(header: &str, body: &[u8]) -> Result<Opened, String> {
    open_named("a.bov", header, body)
}

#[test]
fn every_type_and_order_gives_the_bytes_written() {
    use VoxelType::*;
    for (format, voxel_type) in [("BYTE", U8), ("SHORT", I16), ("INTS", I32), ("FLOAT", F32), ("REAL", F32)] {
        for (channels, components) in
            [(1, ""), (1, "DATA_COMPONENTS: 1"), (2, "DATA_COMPONENTS: COMPLEX"), (3, "DATA_COMPONENTS: 3")]
        {
            for (order, big) in [("LITTLE", false), ("BIG", true)] {
                let field = Field { sizes: [4, 3, 2, channels, 1], voxel_type };
                let text = header(format, components).replace("LITTLE", order);
                let source = open(&text, &field.bytes("zyxc", big)).unwrap();
                assert_boxes(&*source, field);
                let name = source.info().channel_looks[0].name.clone().unwrap();
                assert_eq!(name, ["density", "real", "x"][channels as usize - 1]);
            }
        }
    }
    assert!(open(&header("DOUBLE", ""), &[0; 192]).is_ok());
    let field = Field { sizes: [4, 3, 2, 1, 1], voxel_type: U8 };
    let body = [vec![9; 4], field.bytes("zyx", false)].concat();
    assert_boxes(&*open_named("a.xyz", &header("BYTE", "BYTE_OFFSET: 4"), &body).unwrap(), field);
}

#[test]
fn values_lie_in_zones_or_on_nodes() {
    let info = |text: &str| open(text, &[0; 24]).unwrap().info().clone();
    let zonal = info(&header("BYTE", ""));
    assert!(zonal.calibrated);
    assert_eq!(zonal.geometry.spacing, DVec3::new(2.0, 3.0, 5.0));
    assert_eq!(zonal.geometry.origin, DVec3::new(2.0, 3.5, 5.5));
    let nodal = info(&header("BYTE", "").replace("zonal", "nodal"));
    assert_eq!(nodal.geometry.spacing, DVec3::new(8.0 / 3.0, 4.5, 10.0));
    assert_eq!(nodal.geometry.origin, DVec3::new(1.0, 2.0, 3.0));
    let unsaid = info(&header("BYTE", "").replace("CENTERING: zonal", ""));
    assert_eq!(unsaid.geometry, nodal.geometry);
    assert!(is_warned(&said(&unsaid.notes), "no CENTERING"));
    assert!(!info(&header("BYTE", "").replace("BRICK_SIZE: 8. 9. 10.", "")).calibrated);
    let shorts = header("SHORT", "").replace("DATA_ENDIAN: LITTLE", "");
    assert!(is_warned(&said(&open(&shorts, &[0; 48]).unwrap().info().notes), "no DATA_ENDIAN"));
}

#[test]
fn several_files_have_their_times() {
    let (folder, first) = temp_file("s1.bov", header("BYTE", "").as_bytes());
    std::fs::write(folder.path().join("a b.values"), [7; 24]).unwrap();
    let second = folder.path().join("s2.bov");
    std::fs::write(&second, header("BYTE", "").replace("1.5", "4.25")).unwrap();
    let source = crate::open(&[first, second], &OpenOptions::default()).unwrap();
    assert_eq!(source.info().times, 2);
    let axis = source.info().time.clone().unwrap();
    assert_eq!((axis.at(0), axis.at(1)), (1.5, 4.25));
}

#[test]
fn what_is_missing_or_unknown_is_refused() {
    for (from, to, words) in [
        ("\"a b.values\"", "b.values", "b.values is missing"),
        ("\"a b.values\"", "b%04d.values", "a DATA_FILE of several files (b%04d.values) is not supported"),
        ("DATA_FILE: \"a b.values\"", "", "has no DATA_FILE"),
        ("DATA SIZE: 4 3 2", "", "has no DATA_SIZE"),
        ("4 3 2", "4 3", "expected three counts"),
        ("4 3 2", "4 3 0", "expected three counts"),
        ("4 3 2", "4 3 9", "cut short"),
        ("4 3 2", "4294967295 4294967295 4294967295", "2^63"),
        ("LITTLE", "MIDDLE", "DATA_ENDIAN is 'MIDDLE'"),
        ("zonal", "edge", "expected zonal or nodal"),
        ("8. 9. 10.", "8. 0 10.", "three sizes above 0"),
        ("1. 2. 3.", "1. 2. nan", "three numbers"),
        ("1.5", "now", "TIME is 'now'"),
        ("BYTE", "LONG", "DATA_FORMAT LONG is not supported"),
        ("VARIABLE:", "DIVIDE_BRICK: true\nVARIABLE:", "DIVIDE_BRICK true is not supported"),
        ("VARIABLE:", "DATA_BRICKLETS: 2 3 2\nVARIABLE:", "DATA_BRICKLETS 2 3 2 unlike DATA_SIZE is not supported"),
        ("VARIABLE:", "HAS_BOUNDARY: true\nVARIABLE:", "HAS_BOUNDARY true is not supported"),
        ("VARIABLE:", "BRICK_X_AXIS: 1 0 0\nVARIABLE:", "BRICK_X_AXIS 1 0 0 is not supported"),
        ("VARIABLE:", "VARIABLE_MIN: 1\nVARIABLE:", "VARIABLE_MIN of BYTE data, which scales them, is not supported"),
        ("VARIABLE:", "DATA_COMPONENTS: 0\nVARIABLE:", "DATA_COMPONENTS is '0'"),
        ("VARIABLE:", "BYTE_OFFSET: -4\nVARIABLE:", "BYTE_OFFSET is '-4'"),
    ] {
        let message = open(&header("BYTE", "").replace(from, to), &[0; 24]).err().unwrap();
        assert!(message.contains(words), "{to}: {message}");
    }
    let same = "DATA_BRICKLETS: 4 3 2\nDIVIDE_BRICK: false\nVARIABLE_BRICK_MIN: 0";
    assert!(open(&header("BYTE", same), &[0; 24]).is_ok());
    assert!(
        open("DATA_FILE: .\nDATA_SIZE: 1 1 1\nDATA_FORMAT: BYTE", &[0; 24]).err().unwrap().contains("is not a file")
    );
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    /// Damage leads to an error or wrong voxels, never to a panic.
    #[test]
    fn damaged_headers_do_not_panic(
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let mut bytes = header("DOUBLE", "DATA_COMPONENTS: 2\nBYTE_OFFSET: 4").into_bytes();
        for (place, value) in damage {
            let place = place.index(bytes.len());
            bytes[place] = value;
        }
        if let Ok(source) = open(&String::from_utf8_lossy(&bytes), &[9; 400]) {
            let full = source.info().extent.full_box();
            let mut out = vec![0; full.extent().volume() as usize * source.info().voxel_type.bytes()];
            source.read_box(0, 0, full, &mut out).unwrap();
        }
    }
}
