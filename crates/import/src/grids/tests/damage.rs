//! Damaged lists: an error or other voxels, never a panic.

use super::{Listed, place};
use crate::open::open;
use crate::options::OpenOptions;
use proptest::prelude::*;
use serde_json::{Value, json};

/// Places from the usual to the absurd.
fn number() -> impl Strategy<Value = f64> {
    let some = vec![
        0.0,
        0.5,
        1.0,
        2.0,
        -3.0,
        1e-3,
        1e9,
        4.3e9,
        1e15,
        1e300,
        -1e300,
        1e-30,
        1e-320,
        f64::MAX,
        f64::MIN_POSITIVE,
    ];
    prop_oneof![prop::sample::select(some), -10.0..10.0, any::<f64>().prop_filter("JSON", |n| n.is_finite())]
}

fn read(list: std::path::PathBuf) {
    let Ok(source) = open(&[list], &OpenOptions::default()) else { return };
    let (extent, bytes) = (source.info().extent, source.info().voxel_type.bytes());
    let mut full = extent.full_box();
    full.max = full.intersect(brickyard_volume::VoxelBox::new([0; 3], [64; 3])).max;
    let mut out = vec![0; full.extent().volume() as usize * bytes];
    source.announce(0, 0, full);
    let _ = source.constant_in(0, 0, full);
    let _ = source.read_box(0, 0, full, &mut out);
    assert!(source.reader_bytes() < 1 << 40);
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn damaged_lists_do_not_panic(damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..5)) {
        let listed = Listed::new()
            .with("a.raw", "u8", [2, 2, 2], &[1.0; 8], place(1.0, [0.0; 3]))
            .with("b.raw", "u8", [2, 1, 1], &[2.0; 2], place(2.0, [2.0, 0.5, 0.5]));
        let list = listed.written(&json!({"nodata": 0}));
        let mut text = std::fs::read(&list).unwrap();
        for (place, value) in damage {
            let at = place.index(text.len());
            text[at] = value;
        }
        std::fs::write(&list, text).unwrap();
        read(list);
    }

    #[test]
    fn absurd_places_do_not_panic(places in prop::collection::vec(prop::array::uniform6(number()), 2..5), nodata in number()) {
        let mut listed = Listed::new();
        for (i, [a, b, c, x, y, z]) in places.into_iter().enumerate() {
            let fields = json!({"spacing": [a.abs(), b.abs(), c.abs()], "origin": [x, y, z]});
            listed = listed.with(&format!("{i}.raw"), "f32", [2, 1, 3], &[1.0; 6], fields);
        }
        let more: Value = json!({"nodata": nodata});
        read(listed.written(&more));
    }
}
