//! The first picture of a volume without any look of its own, and messages about pictures that show less than expected.

use brickyard_tests::{Sandbox, leave_out, read_png};

/// A ball of 900 in noise about 100, in a cube of 40 voxels, packed as `ball.zarr`; and a field without a background, `waves.zarr`.
fn sandbox() -> Sandbox {
    let sandbox = Sandbox::default();
    let voxels = |value: &dyn Fn([f64; 3]) -> f64| -> Vec<u8> {
        let at = |i: usize| [i % 40, i / 40 % 40, i / 1600].map(|c| c as f64);
        (0..40usize.pow(3)).flat_map(|i| (value(at(i)) as u16).to_le_bytes()).collect()
    };
    let noise = |[x, y, z]: [f64; 3]| 20.0 * (x * 12.9898 + y * 78.233 + z * 37.719).sin();
    let away = |p: [f64; 3]| p.iter().map(|c| (c - 19.5).powi(2)).sum::<f64>().sqrt();
    let inside = |p: [f64; 3]| (12.5 - away(p)).clamp(0.0, 1.0);
    sandbox.write("ball.raw", voxels(&|p| 100.0 + noise(p) + 800.0 * inside(p)));
    let wave = |[x, y, z]: [f64; 3]| {
        (x / 3.0).sin() + (y / 4.0).sin() + (z / 5.0).sin() + (x / 7.0 + y / 9.0 + z / 11.0).cos()
    };
    sandbox.write("waves.raw", voxels(&|p| 3000.0 + 500.0 * wave(p)));
    for name in ["ball", "waves"] {
        let flags = "--shape 40,40,40 --dtype u16 --brick 16 --shard 32 --progress none";
        sandbox.run_ok(&format!("pack {name}.raw {name}.zarr {flags}"));
    }
    sandbox
}

fn luminance(pixel: [u8; 3]) -> f64 {
    pixel.iter().zip([0.2126, 0.7152, 0.0722]).map(|(&part, weight)| f64::from(part) * weight).sum()
}

#[test]
fn a_body_is_bright_and_lit_and_its_background_is_clear() {
    let sandbox = sandbox();
    let mut expected = None;
    for way in ["--compositor reference", "--backend cpu", "--backend gpu", "--backend gpu --compositor sorted"] {
        let line = format!("render ball.zarr -o o.png --overwrite --size 96x96 {way}");
        let (code, _, stderr) = sandbox.run(&line);
        if code == 1 && stderr.contains("--backend cpu") {
            leave_out("gpu", stderr);
            continue;
        }
        assert!(code == 0 && !stderr.contains("note"), "{line}: exit {code}: {stderr}");
        let picture = read_png(&sandbox.path("o.png"));
        let at = |x: usize, y: usize| luminance(picture.rgb[y * 96 + x]);
        assert!(at(48, 48) > 150.0, "{line}: its middle is {}", at(48, 48));
        // Black up to the ball's edge, despite the noise there.
        let black = picture.rgb.iter().filter(|pixel| luminance(**pixel) < 3.0).count() as f64 / (96.0 * 96.0);
        assert!((0.5..0.95).contains(&black), "{line}: {black} of it is black");
        // A ball lit from the eye darkens towards its edge.
        let first = (0..48).find(|&x| at(x, 48) > 30.0).unwrap_or(48);
        assert!(at(first + 2, 48) < 0.9 * at(48, 48), "{line}: {} at {first}", at(first + 2, 48));
        let expected = expected.get_or_insert_with(|| picture.clone());
        let difference = picture.difference(expected);
        assert!(difference.max <= 2 || difference.psnr_db >= 45.0, "{line}: {difference:?}");
    }
    // Scene files and flags take precedence.
    let with = |flags: &str| {
        sandbox.run_ok(&format!("render ball.zarr -o o.png --overwrite --size 96x96 --backend cpu {flags}"));
        read_png(&sandbox.path("o.png"))
    };
    sandbox.write("scene.json", "{}");
    let plain = with("--transfer gray --lighting none --aa 1");
    assert_eq!(with("--scene scene.json").difference(&plain).max, 0);
    assert_eq!(with("--transfer auto").difference(&with("")).max, 0);
    assert_eq!(with("--mode mip").difference(&with("--mode mip --transfer gray")).max, 0);
    let red = with("--color red");
    assert!(red.rgb.iter().all(|[_, g, b]| *g < 60 && *b < 60) && red.rgb.iter().any(|[r, _, _]| *r > 150));
}

#[test]
fn what_is_shown_fills_the_picture_from_all_sides() {
    let sandbox = sandbox();
    // The box of the volume is white, as far as a mean that ends at 1 goes.
    let all = "--backend cpu --mode average --window -1,0 --size 120x200";
    let reach = |name: &str| {
        let picture = read_png(&sandbox.path(name));
        let shown = (0..200usize).flat_map(|y| (0..120).map(move |x| (x, y)));
        let shown = shown.filter(|&(x, y)| picture.rgb[y * 120 + x] != [0; 3]);
        shown.map(|(x, y)| ((x as f64 - 59.5).abs() / 60.0).max((y as f64 - 99.5).abs() / 100.0)).fold(0.0, f64::max)
    };
    for side in ["", "--view +x", "--view -z"] {
        sandbox.run_ok(&format!("render ball.zarr -o o.png --overwrite {all} {side}"));
        // 94 % of it, to a pixel.
        assert!((0.91..0.96).contains(&reach("o.png")), "{side}: {}", reach("o.png"));
    }
    // The orbit's largest picture fits as well, and no other is larger.
    sandbox.run_ok(&format!("render ball.zarr -o turn.png {all} --orbit 8"));
    let reaches: Vec<f64> = (0..8).map(|i| reach(&format!("turn_00{i}.png"))).collect();
    let most = reaches.iter().copied().fold(0.0, f64::max);
    assert!((0.91..0.96).contains(&most), "{reaches:?}");
}

#[test]
fn a_surface_alone_is_light() {
    let sandbox = sandbox();
    let brightest = |flags: &str| {
        sandbox.run_ok(&format!(
            "render ball.zarr -o o.png --overwrite --size 96x96 --backend cpu --mode isosurface {flags}"
        ));
        read_png(&sandbox.path("o.png")).rgb.iter().map(|pixel| luminance(*pixel)).fold(0.0, f64::max)
    };
    assert!(brightest("--isovalue 200") > 200.0, "{}", brightest("--isovalue 200"));
    // A given colour counts, except for highlights.
    assert!(brightest("--isovalue 200,color=0.1:0.1:0.1") < 140.0);
    assert!(brightest("--isovalue 200 --transfer gray") < 140.0);
    let (code, _, stderr) = sandbox.run("render ball.zarr -o none.png --mode isosurface");
    assert!(code == 2 && stderr.contains("--isovalue") && stderr.contains("from 8"), "{code}: {stderr}");
}

#[test]
fn a_field_without_a_background_shows_its_upper_half_in_colours() {
    let sandbox = sandbox();
    sandbox.run_ok("render waves.zarr -o o.png --size 96x96 --backend cpu");
    let picture = read_png(&sandbox.path("o.png"));
    let is_colored = |[r, g, b]: &[u8; 3]| r.abs_diff(*g).max(g.abs_diff(*b)) > 60;
    let colored = picture.rgb.iter().filter(|pixel| is_colored(pixel)).count();
    assert!(colored > 96 * 96 / 20, "{colored} pixels have colours");
    assert!(picture.rgb.iter().any(|pixel| luminance(*pixel) > 120.0));
}

#[test]
fn what_shows_less_than_one_may_expect_says_why() {
    let sandbox = sandbox();
    sandbox.write("clear.json", r#"{"color": [[0, 1, 1, 1]], "opacity": [[5000, 0], [6000, 1]]}"#);
    for (flags, words) in [
        ("--slice z=50", &["slice lies outside", "z = 50", "-0.5 to 39.5", "picture is empty"][..]),
        ("--slice 0,0,90:0,1,1", &["slice lies outside", "along its normal"]),
        ("--mode isosurface --isovalue 7000", &["no surface of 7000", "values of ball are from", "picture is empty"]),
        ("--mode dvr --isovalue 7000", &["no surface of 7000"]),
        ("--transfer ct-bone", &["ct-bone is for Hounsfield units", "--transfer auto"]),
        ("--transfer clear.json", &["picture is empty", "transparent at all values", "--transfer auto"]),
        ("--eye 500,500,500 --target 900,900,900", &["picture is empty", "--eye and --target"]),
    ] {
        let line = format!("render ball.zarr -o o.png --overwrite --size 32x32 --backend cpu {flags}");
        let (code, _, stderr) = sandbox.run(&line);
        assert!(code == 0 && words.iter().all(|word| stderr.contains(word)), "{line}: exit {code}: {stderr}");
        assert_eq!(sandbox.run(&format!("{line} -q")), (0, String::new(), String::new()), "{line} -q");
    }
    for flags in ["--slice z=50%", "--slice k=middle", "--slice z=19.5", "--mode isosurface --isovalue 500"] {
        let (_, _, stderr) =
            sandbox.run(&format!("render ball.zarr -o o.png --overwrite --size 32x32 --backend cpu {flags}"));
        assert!(!stderr.contains("note"), "{flags}: {stderr}");
    }
}

/// Stores of one shape with voxels of different sizes are drawn at different sizes: a note gives the flag for drawing them alike.
#[test]
fn stores_of_one_shape_and_unlike_voxels_are_named() {
    let sandbox = Sandbox::default();
    sandbox.write("a.raw", (0..1000).map(|i| (i % 251) as u8).collect::<Vec<_>>());
    for (store, spacing) in [("one", 1), ("two", 2)] {
        sandbox.run_ok(&format!(
            "pack a.raw {store}.zarr --shape 10,10,10 --dtype u8 --spacing {spacing},{spacing},{spacing} --progress none"
        ));
    }
    let render = "render one.zarr two.zarr -o o.png --overwrite --backend cpu --size 32x32";
    let (code, _, said) = sandbox.run(render);
    let flag = "--volume \"1:matrix=0.5 0 0 0  0 0.5 0 0  0 0 0.5 0\"";
    let words = ["one and two both have 10 x 10 x 10 voxels", "1 x 1 x 1", "2 x 2 x 2", "different sizes", flag];
    assert!(code == 0 && words.iter().all(|word| said.contains(word)), "{said}");
    let (code, _, said) = sandbox.run(&format!("{render} --volume 1:matrix=0.5,0,0,0,0,0.5,0,0,0,0,0.5,0"));
    assert!(code == 0 && !said.contains("different sizes"), "{said}");
}
