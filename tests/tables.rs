//! Transfer tables, read back code by code: every possible voxel code shows its own entry, in every way to draw. And the
//! files of transfer functions.

use brickyard::volume::{
    Camera, Extent, Geometry, LevelPolicy, Mode, Picture, Projection, Scene, TransferFunction, Voxel,
};
use brickyard_tests::{FunctionSource, Random, Sandbox, TestStore, WAYS, read_png, session, settled};
use glam::DVec3;

/// Voxels along a side of one code's square: rays through its middle meet this code alone, so that interpolation is only
/// between equals.
const SQUARE: u32 = 3;

/// A function with jumps of colour and opacity from each code to the next: any entry but a code's own would show.
fn noise(codes: u32) -> TransferFunction {
    let mut random = Random(codes as u64);
    let mut unit = || random.unit();
    TransferFunction {
        color: (0..codes).map(|code| [code as f64, unit(), unit(), unit()]).collect(),
        opacity: (0..codes).map(|code| [code as f64, unit()]).collect(),
        unit_distance: 1.0,
        ..TransferFunction::default()
    }
}

/// Draws a volume one voxel thick of all codes below `side` squared, and checks the pixel of each.
fn check<T: Voxel>(side: u32) {
    let codes = side * side;
    let extent = Extent::new(SQUARE * side, SQUARE * side, 1);
    let code_at = |[x, y, _]: [u32; 3]| x / SQUARE + y / SQUARE * side;
    let source = FunctionSource::new(extent, Geometry::default(), |_, _, v| T::from_f64_rounded(code_at(v) as f64));
    let test = TestStore::pack(&source, 64);
    let middle = DVec3::new(extent.x as f64 - 1.0, extent.y as f64 - 1.0, 0.0) / 2.0;
    let transfer = noise(codes);
    // A pixel for each square. In direct volume rendering a ray passes one unit distance of it, over black.
    let scene = |mode: Mode| Scene {
        camera: Some(Camera {
            eye: middle + DVec3::Z * 10.0,
            target: middle,
            up: DVec3::Y,
            projection: Projection::Orthographic { height: extent.y as f64 },
        }),
        mode,
        level: LevelPolicy::Locked(0),
        ..Scene::of(transfer.clone())
    };
    for mode in [Mode::Mip, Mode::Dvr] {
        for way in WAYS {
            let Some(mut session) = session(&test.store, way) else { continue };
            let (picture, _) = settled(&mut session, &scene(mode), (side, side));
            for code in 0..codes {
                let (column, row) = (code % side, side - 1 - code / side);
                let found = picture.rgb[(row * side + column) as usize];
                let light = if mode == Mode::Dvr { transfer.opacity[code as usize][1] } else { 1.0 };
                let [_, r, g, b] = transfer.color[code as usize];
                let expected = Picture::quantise([r, g, b].map(|c| (c * light) as f32));
                // 16-bit positions in a table are good to 2^-8 of an entry, and the next may be as far as black from white:
                // 255 / 256 of a step.
                let off = (0..3).map(|k| found[k].abs_diff(expected[k])).max();
                assert!(off <= Some(1), "{:?} {way:?} {mode:?}, code {code}: {found:?} {expected:?}", T::TYPE);
            }
        }
    }
}

#[test]
fn all_256_codes_of_8_bits() {
    check::<u8>(16);
}

/// 12-bit data are stored and drawn as 16-bit codes, with a table entry for each of the 4,096.
#[test]
fn all_4096_codes_of_12_bits() {
    check::<u16>(64);
}

#[test]
fn all_65536_codes_of_16_bits() {
    check::<u16>(256);
}

/// One function in the files of four programs.
#[test]
fn files_of_other_programs_draw_what_our_own_does() {
    let sandbox = Sandbox::default();
    sandbox.run_ok("synth turbulence a.zarr --shape 40,36,50 --brick 16 --shard 32 --progress none");
    sandbox.write(
        "own.json",
        r#"{"color": [[20, 0, 0.25, 1], [200, 1, 0.5, 0]], "opacity": [[60, 0], [220, 0.5]], "unit_distance": 1}"#,
    );
    // ParaView collects opacity over the length of a cell, 73.46 / 41.60 voxels here.
    sandbox.write(
        "scaled.json",
        r#"{"color": [[20, 0, 0.25, 1], [200, 1, 0.5, 0]], "opacity": [[60, 0], [220, 0.5]], "unit_distance": 1.76573}"#,
    );
    sandbox.write(
        "maps.json",
        r#"[{"Name": "Flat", "RGBPoints": [0, 1, 1, 1]},
            {"Name": "Two", "RGBPoints": [20, 0, 0.25, 1, 200, 1, 0.5, 0], "Points": [60, 0, 0.5, 0, 220, 0.5, 0.5, 0]}]"#,
    );
    sandbox.write("property.vp", "1\n1\n0.9\n0.1\n0.2\n10\n4 60 0 220 0.5\n4 0 0.3 255 1\n8 20 0 0.25 1 200 1 0.5 0\n");
    sandbox.write(
        "property.vp.json",
        r#"{"volumeProperties": [{"components": [{"scalarOpacityUnitDistance": 1,
            "rgbTransferFunction": {"points": [{"x": 20, "color": [0, 0.25, 1]}, {"x": 200, "color": [1, 0.5, 0]}]},
            "scalarOpacity": {"points": [{"x": 60, "y": 0}, {"x": 220, "y": 0.5}]}}]}]}"#,
    );
    let render = |transfer: &str| {
        let line = format!("render a.zarr -o o.png --overwrite --backend cpu --size 64x48 --transfer {transfer}");
        let (code, _, stderr) = sandbox.run(&line);
        assert_eq!(code, 0, "{transfer}: {stderr}");
        (read_png(&sandbox.path("o.png")), stderr)
    };
    let (own, notes) = render("own.json");
    assert!(own.rgb.iter().any(|p| p[2] > 60) && !notes.contains("note:"), "{notes}");
    // Gradient opacity of 1 everywhere is none.
    let (text, notes) = render("property.vp.json");
    assert!(text == own && !notes.contains("note:"), "{notes}");
    // Voxels are a world unit apart here, which puts Slicer's gradients in our units.
    let steep = render("own.json --gradient-opacity 0:0.3,255:1").0;
    assert!(steep != own && render("property.vp").0 == steep);
    let scaled = render("scaled.json").0;
    assert!(scaled != own && render("maps.json#Two").0.difference(&scaled).max <= 1);
    let (_, notes) = render("maps.json");
    assert!(notes.contains("note: maps.json: 'Flat' is the first of 2 colour maps"), "{notes}");
}
