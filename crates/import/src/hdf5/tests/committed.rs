//! Attributes of a committed datatype are values like others; what of them cannot be read is told.

use super::*;
use crate::testing::is_warned;

/// An attribute of version 3 whose datatype is an object of its own.
fn committed(name: &str, kind: u64, data: &[u8]) -> Vec<u8> {
    let (name, space) = ([name.as_bytes(), &[0]].concat(), space(&[1]));
    let shared = [&[2, 2][..], &kind.to_le_bytes()].concat();
    let sizes: Vec<u8> = [&name, &shared, &space].iter().flat_map(|part| (part.len() as u16).to_le_bytes()).collect();
    message(12, &[&[3, 1][..], &sizes, &[0], &name, &shared, &space, data].concat())
}

/// A file of 16-bit numbers with these attributes, given the address of the committed type of doubles.
fn file(attributes: &dyn Fn(u64) -> Vec<Vec<u8>>) -> Vec<u8> {
    const DOUBLE: [u8; 20] = [0x11, 0x20, 63, 0, 8, 0, 0, 0, 0, 0, 64, 0, 52, 11, 0, 52, 0xff, 3, 0, 0];
    let mut builder = Builder::new();
    let kind = builder.put(&header(&[message(3, &DOUBLE)]));
    builder.attributes = attributes(kind);
    let bytes: Vec<u8> = (0..24u16).flat_map(u16::to_le_bytes).collect();
    builder.set("data", &datatype(VoxelType::U16, false), &[2, 3, 4], &bytes, Place::Piece).finish()
}

#[test]
fn attributes_of_a_committed_type_are_read() {
    let bytes = file(&|kind| {
        let doubles = committed("scale_factor", kind, &0.5f64.to_le_bytes());
        vec![text_attribute("units", "K"), doubles, number_attribute("add_offset", &[1.0])]
    });
    let (_folder, path) = temp_file("a.h5", &bytes);
    let source = open(&path, &OpenOptions::default()).unwrap();
    let mut out = [0; 96];
    source.read_box(0, 0, source.info().extent.full_box(), &mut out).unwrap();
    let found = out.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect::<Vec<_>>();
    assert_eq!(found, (0..24).map(|i| 1.0 + i as f32 / 2.0).collect::<Vec<_>>());
    assert_eq!(source.info().channel_looks[0].unit.as_deref(), Some("K"));
}

#[test]
fn attributes_whose_type_is_lost_are_told_unless_values_depend_on_them() {
    // No datatype is there.
    let lost = |name: &'static str| file(&|_| vec![committed(name, 8, &[0; 8]), text_attribute("units", "K")]);
    let (_folder, path) = temp_file("a.h5", &lost("remark"));
    let source = open(&path, &OpenOptions::default()).unwrap();
    let notes = said(&source.info().notes);
    assert!(is_warned(&notes, "Attributes of a committed datatype are passed over: remark"), "{notes}");
    assert_eq!(source.info().channel_looks[0].unit.as_deref(), Some("K"));
    let (_folder, path) = temp_file("a.h5", &lost("scale_factor"));
    let message = open(&path, &OpenOptions::default()).err().unwrap().to_string();
    assert!(message.contains("the attribute scale_factor of /data, of a committed datatype"), "{message}");
}

proptest! {
    #![proptest_config(crate::testing::cases(300))]

    /// Damage leads to an error or wrong voxels, never to a panic.
    #[test]
    fn damaged_types_do_not_panic(damage in some_damage()) {
        let mut bytes = file(&|kind| vec![committed("scale_factor", kind, &0.5f64.to_le_bytes())]);
        spoil(&mut bytes, &damage);
        mend_checksums(&mut bytes);
        let (_folder, path) = temp_file("a.h5", &bytes);
        try_to_read(&[path]);
    }
}
