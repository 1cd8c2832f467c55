//! Volumes past every 32-bit product: more than 2^33 voxels, mostly empty, with a known voxel at the far corner, read and
//! drawn.

use brickyard_tests::{Sandbox, leave_out, python, read_png};
use std::process::Command;

const EXTENT: [u64; 3] = [2048, 2048, 2100];
/// The last voxel's value in `synth sparse`.
const LAST: u8 = 199;

#[test]
fn the_far_corner_of_nine_billion_voxels_is_read_and_seen() {
    assert!(EXTENT.iter().product::<u64>() > 1 << 33);
    let sandbox = Sandbox::default();
    sandbox.run_ok("synth sparse huge.zarr --shape 2048,2048,2100 --progress none");
    let info = sandbox.json("info huge.zarr --json");
    assert_eq!(info["store"]["channels"][0]["count"], 2048u64 * 2048 * 2100, "every voxel is counted");

    sandbox.run_ok("export huge.zarr corner.raw --roi 2045:2048,2044:2048,2098:2100");
    let mut expected = [0u8; 3 * 4 * 2];
    expected[23] = LAST;
    assert_eq!(sandbox.read("corner.raw"), expected);

    sees_the_corner(&sandbox, "cpu");
    sees_the_corner(&sandbox, "gpu");
    tensorstore_reads_the_corner(&sandbox);
}

/// An orthographic look along -z at the corner, eight pixels per voxel: the last voxel's centre, (2047, 2047, 2099), is
/// 2.5 voxels right of and 1.5 above the picture's centre, at column 60.0 and row 18.0 of 80 x 60 pixels.
fn sees_the_corner(sandbox: &Sandbox, backend: &str) {
    sandbox.write("white.json", r#"{"color": [[0, 0, 0, 0], [199, 1, 1, 1]], "opacity": [[0, 1]]}"#);
    let (code, _, stderr) = sandbox.run(&format!(
        "render huge.zarr -o {backend}.png --size 80x60 --eye 2044.5,2045.5,2110 --target 2044.5,2045.5,0 --up 0,1,0 \
         --ortho 7.5 --mode mip --step 0.25 --transfer white.json --backend {backend} --gpu-memory 64MiB"
    ));
    if code == 1 && stderr.contains("--backend cpu") {
        return leave_out("gpu", stderr);
    }
    assert_eq!(code, 0, "{stderr}");
    let picture = read_png(&sandbox.path(format!("{backend}.png")));
    // Towards its neighbours the voxel fades linearly; on the other side it is replicated, and ends half a voxel out.
    // Depth is alike: the half voxel before its centre shows it whole.
    let weight = |voxels: f64| match voxels {
        v if v > 0.5 => 0.0,
        v => (1.0 + v.min(0.0)).max(0.0),
    };
    for (x, y) in (0..60).flat_map(|y| (0..80).map(move |x| (x, y))) {
        let (right, up) = ((x as f64 + 0.5 - 60.0) / 8.0, (18.0 - (y as f64 + 0.5)) / 8.0);
        let (found, expected) = (picture.pixel(x, y)[0] as f64, 255.0 * weight(right) * weight(up));
        // Half a code from the picture's rounding, half from the table's steps of 255/199.
        assert!((found - expected).abs() <= 1.0, "{backend} at {x},{y}: {found}, expected {expected}");
    }
}

fn tensorstore_reads_the_corner(sandbox: &Sandbox) {
    let Some(python) = python() else { return };
    let script = "import sys, tensorstore as ts
a = ts.open({'driver': 'zarr3', 'kvstore': {'driver': 'file', 'path': sys.argv[1]}}).result()
assert a.shape == (2100, 2048, 2048), a.shape
print(a[2099, 2047, 2047].read().result(), a[2098:, 2046:, 2046:].read().result().sum())";
    let output = Command::new(python).args(["-c", script]).arg(sandbox.path("huge.zarr/0")).output().expect("Python");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert_eq!(text(&output.stdout).trim(), format!("{LAST} {LAST}"));
}
