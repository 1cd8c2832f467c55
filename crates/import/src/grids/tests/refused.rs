//! Lists that are no lists, and grids that do not fit together.

use super::{Listed, place, plain, row};
use crate::format_of::READ;
use crate::open::open;
use crate::options::OpenOptions;
use crate::testing::{said, temp_file};
use brickyard_volume::{Extent, VoxelType};
use serde_json::{Value, json};

/// The message about two grids of one voxel, with more fields.
fn pair(fields: [Value; 2]) -> String {
    let listed = Listed::new().with("a.raw", "u8", [1, 1, 1], &[1.0], fields[0].clone());
    listed.with("b.raw", "u8", [1, 1, 1], &[2.0], fields[1].clone()).refusal(&json!({}))
}

fn assert_says(message: &str, words: &[&str]) {
    assert!(words.iter().all(|word| message.contains(word)), "{message}");
}

#[test]
fn texts_are_refused_by_name() {
    let refusal = |text: &str| {
        let (_folder, path) = temp_file("g.json", text.as_bytes());
        open(&[path], &OpenOptions::default()).err().unwrap().to_string()
    };
    assert_says(&refusal("{\"grids\": []}"), &["g.json", "lists no grid"]);
    assert_says(&refusal("{\"grids\": [{\"shape\": [1, 1, 1]}]}"), &["grid 1 has no \"file\""]);
    assert_says(&refusal("{\"grids\": [\"a.raw\"]}"), &["g.json: a mistake in this list of grids: grid 1: "]);
    assert_says(&refusal("{\"grids\": 3}"), &["list of grids: invalid type", "a list of grids, as in"]);
    assert_says(&refusal("{\"grids\": [], \"fill\": 3}"), &["unknown field 'fill'"]);
    assert_says(
        &refusal("{\"grids\": [{\"file\": \"a\"},\n {\"file\": \"b\", \"spacin\": [1, 1, 1]}]}"),
        &[
            "list of grids: grid 2: unknown field 'spacin', expected one of 'file', 'shape', ",
            " at line 2 column 23: correct it there",
        ],
    );
    assert_says(&refusal("{\"grids\": [], \"grids\": []}"), &["duplicate field 'grids' at line 1 column 21"]);
    assert_says(&refusal("{\"grids\": [{\"file\": \"a.raw\"}"), &["list of grids: ", "EOF while parsing"]);
    assert_says(&refusal("{\"grids\": [{\"file\": \"a.raw\", \"spacing\": [1, 1]}]}"), &["grid 1: ", "length 3"]);
    assert_says(
        &refusal("{\"grids\": [{\"file\": \"a.raw\", \"nodata\": NaN}]}"),
        &["list of grids: grid 1: expected value at line 1 column 40"],
    );
    assert_says(&refusal("{\"grids\": [{\"file\": \"no.raw\"}]}"), &["no.raw: No such file"]);
    let many = format!("{{\"grids\": [{}{{}}]}}", "{},".repeat(1024));
    assert_says(&refusal(&many), &["1024 grids are the most"]);
    // Others are texts of raw files, as before.
    assert_says(
        &refusal("{\"grid\": []}"),
        &["description of a raw file: unknown field 'grid'", "list of grids has them in \"grids\""],
    );
    assert!(READ.contains("lists of grids"));
}

#[test]
fn lists_are_no_grids_of_lists_nor_steps_beside_others() {
    let listed = row("u8", [10.0, 20.0], [3.0, 4.0], plain());
    let list = listed.written(&json!({}));
    for file in ["grids.json", "./grids.json", "gr?ds.json"] {
        let outer = listed.path("outer.json");
        std::fs::write(&outer, json!({"grids": [{"file": file}]}).to_string()).unwrap();
        let message = open(&[outer], &OpenOptions::default()).err().unwrap().to_string();
        assert_says(&message, &["grids.json: is a list of grids, which is one input by itself"]);
    }
    let other = listed.path("other.json");
    std::fs::copy(&list, &other).unwrap();
    let message = open(&[list.clone(), other], &OpenOptions::default()).err().unwrap().to_string();
    assert_says(&message, &["append such lists one by one"]);
    let with_array = std::path::PathBuf::from(format!("{}::T", list.display()));
    let message = open(&[with_array], &OpenOptions::default()).err().unwrap().to_string();
    assert_says(&message, &["is a list of grids", "`variable`"]);
    let message = |options: OpenOptions| open(std::slice::from_ref(&list), &options).err().unwrap().to_string();
    assert_says(
        &message(OpenOptions { voxel_type: Some(VoxelType::U8.into()), ..OpenOptions::default() }),
        &["`voxel_type` is for raw"],
    );
    assert_says(&message(OpenOptions { times: Some(2), ..OpenOptions::default() }), &["`times` is for raw"]);
    // With a shape any file is raw.
    let shape = Some(Extent::new(4, 1, 1));
    let raw = OpenOptions { shape, voxel_type: Some(VoxelType::U8.into()), offset: Some(0), ..OpenOptions::default() };
    assert_eq!(open(&[list], &raw).unwrap().info().extent, Extent::new(4, 1, 1));
}

#[cfg(unix)]
#[test]
fn pipes_are_no_grids() {
    let (folder, path) = temp_file("g.json", b"{\"grids\": [{\"file\": \"pipe\"}]}");
    let made = std::process::Command::new("mkfifo").arg(folder.path().join("pipe")).status();
    assert!(made.is_ok_and(|status| status.success()));
    assert_says(&open(&[path], &OpenOptions::default()).err().unwrap().to_string(), &["grid 1", "is a pipe"]);
}

#[test]
fn places_must_be_known_and_of_one_kind() {
    let at = |x: f64| place(1.0, [x, 0.0, 0.0]);
    assert_says(&pair([json!({}), at(1.0)]), &["a.raw", "\"spacing\" and \"origin\""]);
    assert_says(&pair([at(1.0), json!({"spacing": [1, 1, 1]})]), &["b.raw", "\"origin\""]);
    let unit = |x: f64, unit: &str| json!({"spacing": [1, 1, 1], "origin": [x, 0, 0], "unit": unit});
    assert_says(
        &pair([unit(0.0, "mm"), at(1.0)]),
        &["b.raw", "along x are in no unit", "a.raw in millimeter", "\"unit\""],
    );
    assert_says(&pair([unit(0.0, "mm"), unit(1.0, "degree")]), &["in degree, but those of a.raw in millimeter"]);
    assert_says(&pair([unit(0.0, "degree,degree,m"), unit(1.0, "degree,degree,hPa")]), &["along z are in hPa"]);
    let listed = Listed::new().with("a.raw", "u8", [1, 1, 1], &[1.0], unit(0.0, "degree,degree,m")).with(
        "b.raw",
        "u8",
        [1, 1, 1],
        &[2.0],
        json!({"spacing": [1, 1, 0.001], "origin": [1, 0, 0], "unit": "degree,degree,km"}),
    );
    let kept = listed.opened().info().geometry.axis_units.clone();
    assert_eq!(kept, Some(["degree", "degree", "meter"].map(String::from)));
}

#[test]
fn equally_fine_grids_between_each_other_are_refused_with_figures() {
    let at = |x: f64| place(1.0, [x, 0.0, 0.0]);
    assert_says(
        &pair([at(0.0), at(2.37)]),
        &["b.raw", "2.3700 voxels from that of a.raw along x", "share one lattice"],
    );
    assert_says(&pair([at(0.0), at(0.5)]), &["0.5000 voxels"]);
    assert_says(&pair([at(0.0), at(1.002)]), &["1.0020 voxels"]);
    // Coarser ones may lie anywhere.
    let listed = Listed::new().with("a.raw", "u8", [1, 1, 1], &[1.0], at(0.0));
    let source = listed.with("b.raw", "u8", [1, 1, 1], &[2.0], place(1.7, [1.37, 0.0, 0.0])).opened();
    assert_eq!(source.info().extent.x, 3);
}

#[test]
fn hostile_places_are_refused_without_overflow() {
    for (spacing, origin) in
        [(1.0, 1e300), (1.0, -1e300), (1e-30, 1.0), (1e30, 0.0), (1e-300, 0.0), (1e300, 1.0), (1.0, 3e18)]
    {
        for turned in [false, true] {
            let mut fields = [place(1.0, [0.0; 3]), place(spacing, [origin, 1.0, 2.0])];
            if turned {
                fields.reverse();
            }
            let message = pair(fields);
            assert!(message.contains(".raw: ") || message.contains("grids.json: "), "{message}");
            assert!(message.contains("correct the spacing"), "{message}");
        }
    }
    let far = pair([place(1.0, [0.0; 3]), place(1.0, [5e9, 0.0, 0.0])]);
    assert_says(&far, &["grids.json: its grids reach over 5000000001,1,1 voxels of 1,1,1, too many for a volume"]);
    let empty = pair([place(1.0, [0.0; 3]), place(1.0, [1e6, 0.0, 0.0])]);
    assert_says(
        &empty,
        &["grids.json: its grids fill 2 of the 1000001,1,1 voxels", "0.0002 %", "show them in one scene"],
    );
    let listed = Listed::new().with("a.raw", "f32", [1, 1, 1], &[1.0], place(1.0, [0.0; 3])).with(
        "b.raw",
        "f32",
        [1, 1, 1],
        &[2.0],
        place(1.0, [99.0, 0.0, 0.0]),
    );
    let notes = said(&listed.opened().info().notes);
    assert!(notes.contains("warning: 98 voxels of the result (98 %) lie in no grid"), "{notes}");
}

#[test]
fn grids_share_channels_steps_and_times() {
    let fields = |more: Value| {
        let mut fields = place(1.0, [0.0; 3]);
        fields.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        fields
    };
    let four = |first: Value, second: Value| {
        let listed = Listed::new().with("a.raw", "u8", [1, 1, 1], &[1.0, 2.0, 3.0, 4.0], fields(first));
        listed.with("b.raw", "u8", [1, 1, 1], &[5.0, 6.0, 7.0, 8.0], fields(second))
    };
    let refusal = |first: Value, second: Value| four(first, second).refusal(&json!({}));
    let steps = |times: u32, channels: u32| json!({"times": times, "channels": channels});
    assert_says(&refusal(steps(4, 1), steps(2, 2)), &["b.raw: has 2 channels, but a.raw has 1 channel"]);
    assert_says(&refusal(steps(4, 1), json!({"times": 2, "shape": [2, 1, 1]})), &["has 2 time steps, but a.raw has 4"]);
    let timed = |step: f64| json!({"times": 4, "time_step": step, "time_unit": "s"});
    assert_says(
        &refusal(timed(1.0), timed(2.0)),
        &["b.raw: its steps have other times than those of a.raw", "`time_step`"],
    );
    let told = OpenOptions { time_step: Some(3.0), ..OpenOptions::default() };
    let source = four(timed(1.0), timed(2.0)).kept(&json!({}), &told);
    assert_eq!(source.info().time.as_ref().unwrap().step, 3.0);
    let names = |names: [&str; 2]| json!({"times": 2, "channels": 2, "channel_names": names});
    assert_says(&refusal(names(["p", "T"]), names(["T", "p"])), &["channel 0 has the name T, but that of a.raw has p"]);
    let source = four(steps(2, 2), names(["p", "T"])).opened();
    assert_eq!(source.info().channel_looks[1].name.as_deref(), Some("T"));
    assert_says(
        &refusal(json!({"times": 4, "value_unit": "K"}), json!({"times": 4, "value_unit": "m"})),
        &["channel 0 has the unit m, but that of a.raw has K", "value_unit"],
    );
    // Every step and channel is that of the first grid, which lies over the other.
    let source = four(steps(2, 2), steps(2, 2)).opened();
    let voxel = |time, channel| {
        let mut out = [0];
        source.read_box(time, channel, source.info().extent.full_box(), &mut out).unwrap();
        out[0]
    };
    assert_eq!([voxel(0, 0), voxel(0, 1), voxel(1, 0), voxel(1, 1)], [1, 2, 3, 4]);
    let notes = said(&source.info().notes);
    assert!(notes.contains("Grid b.raw, 1,1,1 voxels of 1,1,1, gives no voxel of the result"), "{notes}");
}
