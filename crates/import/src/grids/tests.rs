//! Lists of grids of known values: every voxel of the result is compared with a search through all cells, in whole numbers.

mod damage;
mod planes;
mod random;
mod refused;

use crate::open::open;
use crate::options::{HeldAs, NoData, OpenOptions};
use crate::source::{Access, Source};
use crate::testing::{Opened, open_in, said};
use brickyard_volume::{Extent, VoxelBox, VoxelType, with_voxel_type};
use glam::DVec3;
use serde_json::{Value, json};
use std::path::PathBuf;

/// A folder with raw files and a list of them.
struct Listed {
    folder: tempfile::TempDir,
    grids: Vec<Value>,
}

impl Listed {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap(), grids: Vec::new() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Adds a raw file of these values, and its entry with more fields.
    fn with(mut self, name: &str, dtype: &str, shape: [u32; 3], values: &[f64], fields: Value) -> Self {
        let voxel_type: VoxelType = dtype.parse().unwrap();
        let bytes: Vec<u8> = values.iter().flat_map(|value| encoded(voxel_type, *value)).collect();
        std::fs::write(self.path(name), bytes).unwrap();
        let mut entry = json!({"file": name, "shape": shape, "dtype": dtype});
        entry.as_object_mut().unwrap().extend(fields.as_object().unwrap().clone());
        self.grids.push(entry);
        self
    }

    fn written(&self, more: &Value) -> PathBuf {
        let mut list = json!({"grids": self.grids});
        list.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
        std::fs::write(self.path("grids.json"), list.to_string()).unwrap();
        self.path("grids.json")
    }

    fn open(&self, more: &Value, options: &OpenOptions) -> Result<Box<dyn Source>, String> {
        open(&[self.written(more)], options).map_err(|error| error.to_string())
    }

    /// Opens the list, and keeps the files.
    fn kept(self, more: &Value, options: &OpenOptions) -> Opened {
        let list = self.written(more);
        open_in((self.folder, list), options).unwrap()
    }

    fn opened(self) -> Opened {
        self.kept(&json!({}), &OpenOptions::default())
    }

    fn refusal(&self, more: &Value) -> String {
        self.open(more, &OpenOptions::default()).err().unwrap()
    }
}

fn encoded(voxel_type: VoxelType, value: f64) -> Vec<u8> {
    with_voxel_type!(voxel_type, T => (value as T).to_le_bytes().to_vec())
}

fn place(spacing: f64, origin: [f64; 3]) -> Value {
    json!({"spacing": [spacing, spacing, spacing], "origin": origin})
}

fn values(source: &dyn Source, region: VoxelBox) -> Vec<f64> {
    let voxel_type = source.info().voxel_type;
    let count = region.extent().volume() as usize;
    let mut out = vec![0xa5; count * voxel_type.bytes()];
    source.read_box(0, 0, region, &mut out).unwrap();
    (0..count).map(|i| voxel_type.read(&out, i)).collect()
}

fn all(source: &dyn Source) -> Vec<f64> {
    values(source, source.info().extent.full_box())
}

/// A coarse grid of 2 cells of 2 along x, and a fine one of 2 voxels from x = 3 on; one row of both.
fn row(dtype: &str, coarse: [f64; 2], fine: [f64; 2], fields: [Value; 2]) -> Listed {
    let [mut first, mut second] = [json!({"spacing": [2, 1, 1], "origin": [0.5, 0, 0]}), place(1.0, [3.0, 0.0, 0.0])];
    for (own, more) in [&mut first, &mut second].into_iter().zip(fields) {
        own.as_object_mut().unwrap().extend(more.as_object().unwrap().clone());
    }
    let listed = Listed::new().with("coarse.raw", dtype, [2, 1, 1], &coarse, first);
    listed.with("fine.raw", dtype, [2, 1, 1], &fine, second)
}

fn plain() -> [Value; 2] {
    [json!({}), json!({})]
}

/// A fine grid in ENVI's form, of -1 for no data by its header, over a coarse one.
fn with_marks(dtype: &str, fine: [i16; 2]) -> Listed {
    let mut listed = row(dtype, [10.0, 20.0], [0.0, 0.0], plain());
    let header = "ENVI\nsamples = 2\nlines = 1\nbands = 1\ndata type = 2\nbyte order = 0\ninterleave = bsq\ndata ignore value = -1\n";
    std::fs::write(listed.path("fine.hdr"), header).unwrap();
    std::fs::write(listed.path("fine.raw"), fine.map(i16::to_le_bytes).as_flattened()).unwrap();
    listed.grids[1] = json!({"file": "fine.hdr", "spacing": [1, 1, 1], "origin": [3, 0, 0]});
    listed
}

#[test]
fn a_file_s_own_value_for_no_data_holds_beside_the_list_s() {
    let source = with_marks("i16", [-1, 4]).kept(&json!({"nodata": -7}), &OpenOptions::default());
    assert_eq!((all(&*source), source.info().nodata), (vec![10.0, 10.0, 20.0, 20.0, 4.0], Some(-7.0)));
    let source = with_marks("f32", [5, -1]).kept(&json!({"nodata": -7}), &OpenOptions::default());
    let found = all(&*source);
    assert!(found[..4] == [10.0, 10.0, 20.0, 5.0] && found[4].is_nan(), "{found:?}");
}

/// Without a way over the type of such numbers otherwise.
#[test]
fn wide_numbers_reach_the_type_asked_for() {
    let listed = Listed::new().with("a.raw", "u32", [2, 1, 1], &[1.0, 2.0], place(1.0, [1.0; 3]));
    std::fs::write(listed.path("a.raw"), [3_000_000_000i64, 5].map(i64::to_le_bytes).as_flattened()).unwrap();
    let list = listed.written(&json!({}));
    let text = std::fs::read_to_string(&list).unwrap().replace("u32", "i64");
    std::fs::write(&list, text).unwrap();
    let options = OpenOptions { to_voxel_type: Some(VoxelType::U32), ..OpenOptions::default() };
    assert_eq!(all(&*open(&[list], &options).unwrap()), [3e9, 5.0]);
}

#[test]
fn the_finest_grid_counts_and_cells_are_repeated() {
    let listed = row("u8", [10.0, 20.0], [3.0, 4.0], plain());
    // The coarse cells are the voxels 0 and 1, 2 and 3; the fine ones 3 and 4.
    let source = listed.opened();
    let info = source.info();
    assert_eq!((info.extent, info.voxel_type, source.access()), (Extent::new(5, 1, 1), VoxelType::U8, Access::Box));
    assert_eq!((info.geometry.spacing, info.geometry.origin), (DVec3::ONE, DVec3::ZERO));
    assert!(info.calibrated && info.says_origin && info.nodata.is_none());
    assert_eq!(all(&*source), [10.0, 10.0, 20.0, 3.0, 4.0]);
    let notes = said(&info.notes);
    assert!(notes.contains("Grid coarse.raw, 2,1,1 voxels of 2,1,1, gives 3 voxels of the result (60 %)."), "{notes}");
    assert!(notes.contains("Grid fine.raw, 2,1,1 voxels of 1,1,1, gives 2 voxels of the result (40 %)."), "{notes}");
    assert!(!notes.contains("lie in no grid"), "{notes}");
}

#[test]
fn holes_show_coarser_grids() {
    let fine = [f64::NAN, 4.0];
    let source = row("f32", [10.0, 20.0], fine, plain()).opened();
    assert_eq!(all(&*source), [10.0, 10.0, 20.0, 20.0, 4.0]);
    // An infinite value is none either, and outside of the coarse grid there is nothing to show.
    let source = row("f32", [f64::INFINITY, 20.0], [5.0, f64::NEG_INFINITY], plain()).opened();
    let found = all(&*source);
    assert!([0, 1, 4].iter().all(|i| found[*i].is_nan()), "{found:?}");
    assert_eq!(found[2..4], [20.0, 5.0]);
    // By a value of the fine grid alone, of integers and of floats.
    for dtype in ["i16", "f32"] {
        let source = row(dtype, [10.0, 20.0], [-7.0, 4.0], [json!({}), json!({"nodata": -7})]).opened();
        assert_eq!(all(&*source), [10.0, 10.0, 20.0, 20.0, 4.0]);
        assert_eq!(source.info().nodata, Some(-7.0));
    }
    // By the list's value, and the caller's, which comes first.
    let listed = row("i16", [10.0, -7.0], [-7.0, 4.0], plain());
    let found = |more: Value, nodata: NoData| {
        let source = listed.open(&more, &OpenOptions { nodata, ..OpenOptions::default() }).unwrap();
        (all(&*source), source.info().nodata)
    };
    assert_eq!(found(json!({"nodata": -7}), NoData::OfFile), (vec![10.0, 10.0, -7.0, -7.0, 4.0], Some(-7.0)));
    assert_eq!(found(json!({"nodata": -7}), NoData::Value(4.0)), (vec![10.0, 10.0, -7.0, -7.0, 4.0], Some(4.0)));
    assert_eq!(found(json!({"nodata": 10}), NoData::None), (vec![10.0, 10.0, -7.0, -7.0, 4.0], None));
}

#[test]
fn values_for_no_data_may_differ_and_become_one() {
    // 0 means nothing in the coarse grid, 9 in the fine one.
    let fields = [json!({"nodata": 0}), json!({"nodata": 9})];
    let source = row("u8", [0.0, 0.0], [9.0, 4.0], fields.clone()).opened();
    assert_eq!((all(&*source), source.info().nodata), (vec![0.0, 0.0, 0.0, 0.0, 4.0], Some(0.0)));
    let read = |listed: Listed| {
        let source = listed.opened();
        let mut out = [0; 5];
        source.read_box(0, 0, source.info().extent.full_box(), &mut out).map_err(|error| error.to_string())
    };
    let problem = read(row("u8", [1.0, 2.0], [0.0, 4.0], fields)).unwrap_err();
    assert!(problem.contains("fine.raw: voxel 0,0,0 (channel 0, time step 0) is 0, which means no data"), "{problem}");
    // A grid without a value has none to look for.
    let problem = read(row("u8", [1.0, 2.0], [0.0, 4.0], [json!({"nodata": 0}), json!({})])).unwrap_err();
    assert!(problem.contains("fine.raw"), "{problem}");
    let source = row("f32", [0.0, 9.0], [9.0, 0.0], [json!({"nodata": 0}), json!({"nodata": 9})]).opened();
    let found = all(&*source);
    assert!(found[0].is_nan() && found[1].is_nan() && found[2..] == [9.0, 9.0, 0.0], "{found:?}");
    assert_eq!((source.info().nodata, source.info().knows_nodata), (Some(0.0), true));
}

#[test]
fn places_in_no_grid_hold_no_data() {
    let apart = |dtype: &str| {
        let listed = Listed::new().with("a.raw", dtype, [1, 1, 1], &[1.0], place(1.0, [0.0; 3]));
        listed.with("b.raw", dtype, [1, 2, 1], &[2.0, 3.0], place(1.0, [2.0, 0.0, 0.0]))
    };
    let source = apart("f32").opened();
    let found = all(&*source);
    assert_eq!([found[0], found[2], found[5]], [1.0, 2.0, 3.0]);
    assert!([1, 3, 4].iter().all(|i| found[*i].is_nan()), "{found:?}");
    let notes = said(&source.info().notes);
    assert!(notes.contains("note: 3 voxels of the result (50 %) lie in no grid: no data."), "{notes}");
    let problem = apart("u16").refusal(&json!({}));
    assert!(problem.contains("grids.json") && problem.contains("\"nodata\""), "{problem}");
    let source = apart("u16").kept(&json!({"nodata": 7}), &OpenOptions::default());
    assert_eq!((all(&*source), source.info().nodata), (vec![1.0, 7.0, 2.0, 7.0, 7.0, 3.0], Some(7.0)));
    let outside = VoxelBox::new([0, 1, 0], [2, 2, 1]);
    assert_eq!(
        (source.constant_in(0, 0, outside), source.constant_in(0, 0, source.info().extent.full_box())),
        (Some(7.0), None)
    );
    // In a store with a value for no data it is this one.
    let held_as = Some(HeldAs { voxel_type: VoxelType::U16, nodata: Some(2.0), turned: [false; 3] });
    let source = apart("u16").kept(&json!({}), &OpenOptions { held_as, ..OpenOptions::default() });
    assert_eq!(all(&*source), [1.0, 2.0, 2.0, 2.0, 2.0, 3.0]);
}

#[test]
fn of_equally_fine_grids_the_first_listed_counts() {
    let both = |names: [&str; 2]| {
        let listed = Listed::new().with(names[0], "u8", [2, 1, 1], &[1.0, 2.0], place(1.0, [0.0; 3]));
        let shift = place(1.0, [1.0004, 0.0, 0.0]);
        listed.with(names[1], "u8", [2, 1, 1], &[3.0, 4.0], shift)
    };
    assert_eq!(all(&*both(["a.raw", "b.raw"]).opened()), [1.0, 2.0, 4.0]);
    let mut turned = both(["a.raw", "b.raw"]);
    turned.grids.reverse();
    assert_eq!(all(&*turned.opened()), [1.0, 3.0, 4.0]);
    // Cells of one volume, of unlike shapes.
    let listed = Listed::new()
        .with("a.raw", "u8", [2, 1, 1], &[1.0, 2.0], json!({"spacing": [1, 2, 1], "origin": [0, 0.5, 0]}))
        .with("b.raw", "u8", [1, 2, 1], &[3.0, 4.0], json!({"spacing": [2, 1, 1], "origin": [0.5, 0, 0]}));
    let source = listed.opened();
    assert_eq!(all(&*source), [1.0, 2.0, 1.0, 2.0]);
    assert_eq!((source.info().geometry.spacing, source.info().geometry.origin), (DVec3::ONE, DVec3::ZERO));
}

#[test]
fn a_centre_between_two_cells_is_in_the_upper_one() {
    // Nodes of the coarse grid are every second of the fine one's: the faces of its cells are fine centres.
    let listed = Listed::new()
        .with("coarse.raw", "u8", [3, 1, 1], &[10.0, 20.0, 30.0], json!({"spacing": [2, 1, 1], "origin": [0, 0, 0.0]}))
        .with("fine.raw", "u8", [1, 1, 1], &[7.0], place(1.0, [2.0, 0.0, 0.0]));
    let source = listed.opened();
    assert_eq!(all(&*source), [10.0, 10.0, 20.0, 7.0, 30.0, 30.0]);
    assert_eq!(source.info().geometry.origin.x, -1.0);
}

#[test]
fn lengths_are_in_the_unit_of_the_first_grid() {
    let fields = |spacing: f64, origin: f64, unit: &str| json!({"spacing": [spacing, spacing, spacing], "origin": [origin, spacing / 2.0, spacing / 2.0], "unit": unit});
    let listed = Listed::new().with("a.raw", "u8", [2, 1, 1], &[1.0, 2.0], fields(0.3, 0.15, "mm")).with(
        "b.raw",
        "u8",
        [3, 1, 1],
        &[7.0, 8.0, 9.0],
        fields(100.0, 350.0, "um"),
    );
    let source = listed.open(&json!({}), &OpenOptions::default()).unwrap();
    let info = source.info();
    assert_eq!((info.extent, info.geometry.unit.as_deref()), (Extent::new(6, 3, 3), Some("millimeter")));
    assert!(info.geometry.spacing == DVec3::splat(0.1) && (info.geometry.origin - 0.05).abs().max_element() < 1e-15);
    assert_eq!(values(&*source, VoxelBox::new([0, 0, 0], [6, 1, 1])), [1.0, 1.0, 1.0, 7.0, 8.0, 9.0]);
    assert_eq!(values(&*source, VoxelBox::new([0, 1, 0], [6, 2, 1])), [1.0, 1.0, 1.0, 2.0, 2.0, 2.0]);
    // The caller's unit is the result's.
    let told = OpenOptions { unit: Some("cm".into()), origin: Some(DVec3::ONE), ..OpenOptions::default() };
    let source = listed.open(&json!({}), &told).unwrap();
    let geometry = &source.info().geometry;
    assert_eq!((geometry.unit.as_deref(), geometry.spacing.x, geometry.origin), (Some("centimeter"), 0.1, DVec3::ONE));
}

/// NRRD files, whose grids lie obliquely in a patient.
#[test]
fn orientations_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    let in_unit = |unit: &str, size: u32, step: f64, origin: [f64; 3]| {
        let [x, y, z] = origin;
        let (a, b) = (0.6 * step, 0.8 * step);
        format!(
            "NRRD0004\ntype: uint8\ndimension: 3\nsizes: {size} 1 1\nencoding: raw\nspace: right-anterior-superior\n\
             space directions: ({a},{b},0) (-{b},{a},0) (0,0,{step})\nspace origin: ({x},{y},{z})\n\
             space units: \"{unit}\" \"{unit}\" \"{unit}\"\n\n"
        )
    };
    let header = |size: u32, step: f64, origin: [f64; 3]| in_unit("mm", size, step, origin);
    let write = |name: &str, header: String, voxels: &[u8]| {
        std::fs::write(folder.path().join(name), [header.as_bytes(), voxels].concat()).unwrap();
    };
    // The fine grid, in micrometres, begins 4 fine voxels along x, on the same line of centres.
    write("a.nrrd", header(3, 3.0, [5.0, 0.0, 0.0]), &[1, 2, 3]);
    write("b.nrrd", in_unit("um", 2, 1000.0, [5000.0 + 600.0 * 4.0, 800.0 * 4.0, 0.0]), &[7, 8]);
    let list = folder.path().join("g.json");
    let entries =
        |second: &str| format!("{{\"grids\": [{{\"file\": \"a.nrrd\"}}, {{\"file\": \"{second}\"}}], \"nodata\": 0}}");
    std::fs::write(&list, entries("b.nrrd")).unwrap();
    let source = open(std::slice::from_ref(&list), &OpenOptions::default()).unwrap();
    let info = source.info();
    assert_eq!((info.extent, info.geometry.unit.as_deref()), (Extent::new(9, 3, 3), Some("millimeter")));
    assert!((info.geometry.spacing - DVec3::ONE).length() < 1e-12, "{}", info.geometry.spacing);
    assert_eq!(values(&*source, VoxelBox::new([0, 1, 1], [9, 2, 2])), [1.0, 1.0, 1.0, 2.0, 2.0, 7.0, 8.0, 3.0, 3.0]);
    assert_eq!(values(&*source, VoxelBox::new([0, 0, 1], [9, 1, 2])), [1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 3.0, 3.0, 3.0]);
    // The first voxel is one fine voxel before the coarse centre along each axis.
    let first = info.orientation.unwrap().first_centre();
    assert!((first - DVec3::new(5.0 - 0.6 + 0.8, -0.8 - 0.6, -1.0)).length() < 1e-12, "{first}");
    assert!((info.orientation.unwrap().step(1) - DVec3::new(-0.8, 0.6, 0.0)).length() < 1e-12);
    let refusal = |header: String| {
        write("c.nrrd", header, &[7, 8]);
        std::fs::write(&list, entries("c.nrrd")).unwrap();
        open(std::slice::from_ref(&list), &OpenOptions::default()).err().unwrap().to_string()
    };
    let turned = header(2, 1.0, [0.0; 3]).replace("(0,0,1)", "(0,0,-1)");
    assert!(refusal(turned).contains("do not run along those of a.nrrd"));
    let skewed = header(2, 1.0, [0.0; 3]).replace("(0,0,1)", "(0,0.1,1)");
    assert!(refusal(skewed).contains("do not run along"));
    let plain = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 1 1\nencoding: raw\nspacings: 1 1 1\naxis mins: 5 5 5\nunits: \"mm\" \"mm\" \"mm\"\n\n";
    assert!(refusal(plain.into()).contains("has none, but a.nrrd has an orientation"));
}

#[test]
fn unlike_types_become_the_narrowest_that_holds_all() {
    let typed = |first: &str, second: &str| {
        let listed = Listed::new().with("a.raw", first, [1, 1, 1], &[1.0], place(1.0, [0.0; 3]));
        listed.with("b.raw", second, [1, 1, 1], &[2.0], place(1.0, [1.0, 0.0, 0.0]))
    };
    for (first, second, of_both) in [
        ("u8", "u16", "u16"),
        ("u16", "u8", "u16"),
        ("u8", "i8", "i16"),
        ("u16", "i8", "i32"),
        ("i16", "f32", "f32"),
        ("u32", "u8", "u32"),
    ] {
        let source = typed(first, second).opened();
        assert_eq!((source.info().voxel_type.name(), all(&*source)), (of_both, vec![1.0, 2.0]));
    }
    for (first, second) in [("u32", "i32"), ("i32", "f32"), ("u32", "i8")] {
        let problem = typed(first, second).refusal(&json!({}));
        assert!(problem.contains("b.raw") && problem.contains("`to_voxel_type`"), "{problem}");
        let told = OpenOptions { to_voxel_type: Some(VoxelType::F32), ..OpenOptions::default() };
        let source = typed(first, second).kept(&json!({}), &told);
        assert_eq!((source.info().voxel_type, all(&*source)), (VoxelType::F32, vec![1.0, 2.0]));
    }
    // A mark of an integer grid becomes NaN, which shows the coarser grid.
    let listed = Listed::new()
        .with("a.raw", "u8", [2, 1, 1], &[9.0, 4.0], json!({"spacing": [1, 1, 1], "origin": [0, 0, 0], "nodata": 9}))
        .with("b.raw", "f32", [1, 1, 1], &[0.5], json!({"spacing": [2, 1, 1], "origin": [0.5, 0, 0]}));
    assert_eq!(all(&*listed.opened()), [0.5, 4.0]);
}

#[test]
fn parts_flips_and_types_work_over_it() {
    let listed = row("u8", [10.0, 20.0], [3.0, 4.0], plain());
    let told = OpenOptions {
        roi: Some(VoxelBox::new([1, 0, 0], [5, 1, 1])),
        flip: Some([true, false, false]),
        to_voxel_type: Some(VoxelType::I32),
        ..OpenOptions::default()
    };
    let source = listed.open(&json!({}), &told).unwrap();
    assert_eq!((source.info().voxel_type, all(&*source)), (VoxelType::I32, vec![4.0, 3.0, 20.0, 10.0]));
    assert_eq!(source.info().geometry.origin.x, 1.0);
}

#[test]
fn what_the_list_and_its_files_say_is_the_identity() {
    let listed = row("u8", [10.0, 20.0], [3.0, 4.0], plain());
    let identity = |more: Value| listed.open(&more, &OpenOptions::default()).unwrap().info().identity.clone();
    let first = identity(json!({}));
    let again = open(&[listed.path("grids.json")], &OpenOptions::default()).unwrap();
    assert_eq!(first, again.info().identity);
    assert!(["grids.json", "coarse.raw", "fine.raw"].iter().all(|name| first.contains(name)), "{first}");
    let touched = std::fs::File::options().append(true).open(listed.path("fine.raw")).unwrap();
    touched.set_modified(std::time::SystemTime::UNIX_EPOCH).unwrap();
    let again = open(&[listed.path("grids.json")], &OpenOptions::default()).unwrap();
    assert_ne!(first, again.info().identity);
    assert_ne!(first, identity(json!({"nodata": 1})));
}

#[test]
fn arrays_are_named_in_entries_or_by_the_caller() {
    let folder = tempfile::tempdir().unwrap();
    let npy = |values: [u8; 2]| {
        let header = "{'descr': '|u1', 'fortran_order': False, 'shape': (1, 1, 2), }\n";
        [b"\x93NUMPY\x01\x00", &(header.len() as u16).to_le_bytes()[..], header.as_bytes(), &values].concat()
    };
    for (name, values) in [("a_T.npy", [1, 2]), ("b_T.npy", [3, 4]), ("a_q.npy", [5, 6]), ("b_q.npy", [7, 8])] {
        std::fs::write(folder.path().join(name), npy(values)).unwrap();
    }
    let list = |variable: &str| {
        let entry = |file: &str, spacing: u32, origin: f64| json!({"file": format!("{file}_{variable}.npy"), "spacing": [spacing, 1, 1], "origin": [origin, 0, 0]});
        let path = folder.path().join(format!("{variable}.json"));
        std::fs::write(&path, json!({"grids": [entry("a", 2, 0.5), entry("b", 1, 1.0)]}).to_string()).unwrap();
        path
    };
    let [t, q] = ["T", "q"].map(list);
    // Two lists as channels.
    let arrays = [("T", &t), ("q", &q)].map(|(name, path)| crate::options::ChannelArray {
        name: name.into(),
        place: crate::options::ArrayPlace::File(path.clone()),
    });
    let told = OpenOptions { channel_arrays: arrays.to_vec(), ..OpenOptions::default() };
    let source = open(std::slice::from_ref(&t), &told).unwrap();
    assert_eq!((source.info().channels, all(&*source)), (2, vec![1.0, 3.0, 4.0, 2.0]));
    let mut out = [0; 4];
    source.read_box(0, 1, source.info().extent.full_box(), &mut out).unwrap();
    assert_eq!(out, [5, 7, 8, 6]);
    // Files without arrays have none of the caller's.
    let named = OpenOptions { variable: Some("T".into()), ..OpenOptions::default() };
    assert!(open(&[t], &named).err().unwrap().to_string().contains("`variable`"));
}

/// A box larger than a piece.
#[test]
fn large_boxes_are_read_in_pieces() {
    let (x, y) = (1000, 601);
    let voxel = |i: u32| f64::from(i % 251);
    let fine: Vec<f64> = (0..x * y).map(voxel).collect();
    let listed = Listed::new()
        .with(
            "coarse.raw",
            "u8",
            [x / 2, 1, 3],
            &vec![255.0; x as usize / 2 * 3],
            json!({"spacing": [2, y, 1], "origin": [0.5, f64::from(y - 1) / 2.0, 0]}),
        )
        .with("fine.raw", "u8", [x, y, 1], &fine, place(1.0, [0.0, 0.0, 1.0]));
    let source = listed.opened();
    assert_eq!(source.info().extent, Extent::new(x, y, 3));
    let found = all(&*source);
    let plane = (x * y) as usize;
    assert!(found[..plane].iter().chain(&found[2 * plane..]).all(|value| *value == 255.0));
    assert!(found[plane..2 * plane] == fine);
    let part = VoxelBox::new([500, 300, 1], [503, 302, 2]);
    let expected: Vec<f64> = part.voxels().map(|[i, j, _]| voxel(j * x + i)).collect();
    assert_eq!(values(&*source, part), expected);
    // A piece's marks and cells, and the cells' numbers along the axes.
    assert_eq!(source.reader_bytes(), 2 * super::PIECE_VOXELS + 4 * u64::from(x + y + 3));
}

#[test]
fn fields_of_a_whole_volume_are_no_grid_s() {
    for (field, value) in
        [("time_start", json!(3)), ("time_stamps", json!([3])), ("time_since", json!("x")), ("labels", json!(true))]
    {
        let listed = row("u8", [1.0, 2.0], [3.0, 4.0], [json!({}), json!({field: value})]);
        let found = listed.refusal(&json!({}));
        assert!(found.contains(&format!("grid 2, fine.raw, has \"{field}\"")), "{found}");
    }
}
