//! Volumes of a single value, and of a single voxel: all renderers show them alike, with a message about the look.

use brickyard_tests::{Sandbox, leave_out, read_png};

/// Name, type, shape, and voxels.
fn volumes() -> Vec<(&'static str, &'static str, [usize; 3], Vec<u8>)> {
    let floats = |n: usize, value: &dyn Fn(usize) -> f32| (0..n).flat_map(|i| value(i).to_le_bytes()).collect();
    let mut volumes = vec![
        ("zeros", "u8", [12, 10, 8], vec![0; 960]),
        ("sevens", "u8", [12, 10, 8], vec![7; 960]),
        ("negative", "i16", [12, 10, 8], [-5i16; 960].iter().flat_map(|v| v.to_le_bytes()).collect()),
        ("wide", "i32", [12, 10, 8], [i32::MIN; 960].iter().flat_map(|v| v.to_le_bytes()).collect()),
        ("huge", "f32", [12, 10, 8], floats(960, &|_| 1e30)),
        ("one", "u16", [1, 1, 1], vec![9, 0]),
        ("real_one", "f32", [1, 1, 1], floats(1, &|_| -2.5)),
    ];
    let inside = |i: usize| (2..10).contains(&(i % 12)) && (2..8).contains(&(i / 12 % 10));
    let framed = floats(960, &|i| if inside(i) { 7.0 } else { f32::NAN });
    volumes.push(("framed", "f32", [12, 10, 8], framed));
    volumes
}

#[test]
fn volumes_of_one_value_are_shown_alike_by_all() {
    let sandbox = Sandbox::default();
    for (name, voxel_type, [x, y, z], bytes) in volumes() {
        sandbox.write(format!("{name}.raw"), bytes);
        sandbox.run_ok(&format!(
            "pack {name}.raw {name}.zarr --shape {x},{y},{z} --dtype {voxel_type} --brick 8 --shard 16 --progress none"
        ));
        for flags in ["", "--transfer viridis", "--mode mip", "--mode mip --transfer viridis"] {
            let mut expected = None;
            for way in ["--compositor reference", "--backend cpu", "--backend gpu", "--backend gpu --compositor sorted"]
            {
                let line = format!("render {name}.zarr -o o.png --overwrite --size 40x30 {flags} {way}");
                let (code, _, stderr) = sandbox.run(&line);
                if code == 1 && stderr.contains("--backend cpu") {
                    leave_out("gpu", stderr);
                    continue;
                }
                assert_eq!(code, 0, "{line}: {stderr}");
                assert!(
                    stderr.contains("note: ") && stderr.contains("every value of channel 0 is"),
                    "{line}: {stderr}"
                );
                let picture = read_png(&sandbox.path("o.png"));
                let middle = picture.rgb[15 * 40 + 20];
                assert!(middle.iter().any(|&c| c > 20), "{line}: the middle is {middle:?}");
                let expected = expected.get_or_insert_with(|| picture.clone());
                let difference = picture.difference(expected);
                assert!(difference.max <= 1 || difference.psnr_db >= 50.0, "{line}: {difference:?}");
            }
        }
    }
}

/// The value is reported without the digits of 32-bit rounding.
#[test]
fn the_one_value_has_few_digits() {
    let sandbox = Sandbox::default();
    sandbox.write("a.raw", [0.1f32; 512].iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>());
    sandbox.run_ok("pack a.raw a.zarr --shape 8,8,8 --dtype f32 --spacing 0.1,0.1,0.1 --progress none");
    let (code, _, said) = sandbox.run("render a.zarr -o o.png --size 20x20 --backend cpu");
    assert!(code == 0 && said.contains("every value of channel 0 is 0.1:"), "exit {code}: {said}");
    let (_, _, said) = sandbox.run("render a.zarr -o p.png --size 20x20 --backend cpu --slice z=2.3");
    assert!(said.contains("it is at z = 2.3, and the scene reaches from -0.05 to 0.75"), "{said}");
}

#[test]
fn a_volume_without_any_value_is_empty_and_says_so() {
    let sandbox = Sandbox::default();
    sandbox.write("nan.raw", [f32::NAN; 512].iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>());
    sandbox.run_ok("pack nan.raw nan.zarr --shape 8,8,8 --dtype f32 --brick 8 --shard 16 --progress none");
    for (voxel_type, bytes) in
        [("u8", vec![7; 512]), ("i16", [-2000i16; 512].iter().flat_map(|v| v.to_le_bytes()).collect())]
    {
        let nodata = if voxel_type == "u8" { 7 } else { -2000 };
        let flags = format!("--shape 8,8,8 --dtype {voxel_type} --brick 8 --shard 16 --nodata {nodata}");
        sandbox.write("marked.raw", bytes);
        sandbox.run_ok(&format!("pack marked.raw {voxel_type}.zarr {flags} --progress none"));
    }
    for store in ["nan", "u8", "i16"] {
        for way in ["--compositor reference", "--backend cpu", "--mode mip --backend cpu"] {
            let (code, _, stderr) =
                sandbox.run(&format!("render {store}.zarr -o o.png --overwrite --size 20x20 {way}"));
            assert!(code == 0 && stderr.contains("nothing to show"), "{store} {way}: exit {code}: {stderr}");
            assert!(read_png(&sandbox.path("o.png")).rgb.iter().all(|p| *p == [0; 3]), "{store} {way}");
        }
    }
}
