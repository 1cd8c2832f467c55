//! Supersampled pictures and overlays by the command: the same samples by every renderer, and the overlays on pictures.

use brickyard::volume::Picture;
use brickyard_tests::{Sandbox, leave_out, read_png};

/// A ball of 900 in 100, in a cube of 40 voxels, packed as `ball.zarr`; and its voxels as labels, `labels.zarr`.
fn sandbox() -> Sandbox {
    let sandbox = Sandbox::default();
    let away = |i: usize| {
        let at = [i % 40, i / 40 % 40, i / 1600].map(|c| c as f64);
        at.iter().map(|c| (c - 19.5).powi(2)).sum::<f64>().sqrt()
    };
    let voxels = |value: &dyn Fn(f64) -> u16| -> Vec<u8> {
        (0..40usize.pow(3)).flat_map(|i| value(away(i)).to_le_bytes()).collect()
    };
    sandbox.write("ball.raw", voxels(&|away| 100 + (800.0 * (12.5 - away).clamp(0.0, 1.0)) as u16));
    sandbox.write("labels.raw", voxels(&|away| u16::from(away < 12.0)));
    let flags = "--shape 40,40,40 --dtype u16 --unit mm --brick 16 --shard 32 --progress none";
    sandbox.run_ok(&format!("pack ball.raw ball.zarr {flags}"));
    sandbox.run_ok(&format!("pack labels.raw labels.zarr --kind labels {flags}"));
    sandbox
}

fn render(sandbox: &Sandbox, flags: &str) -> Picture {
    sandbox.run_ok(&format!("render ball.zarr -o o.png --overwrite {flags}"));
    read_png(&sandbox.path("o.png"))
}

/// The root mean square difference, in codes.
fn rms(a: &Picture, b: &Picture) -> f64 {
    255.0 / 10f64.powf(a.difference(b).psnr_db / 20.0)
}

#[test]
fn all_renderers_draw_the_same_samples() {
    let sandbox = sandbox();
    for look in [
        "--aa 4",
        "--aa 16 --mode isosurface --isovalue 500",
        "--aa 2 --mode mip",
        "--aa 8 --jitter white:7 --lighting none --transfer gray",
        "--aa 4 --stereo side-by-side",
        "--aa 4 --slice z=19.2",
    ] {
        let expected = render(&sandbox, &format!("--size 96x80 {look} --compositor reference"));
        for way in [
            "--backend cpu",
            "--backend cpu --exact",
            "--backend gpu",
            "--backend gpu --compositor sorted",
            "--backend gpu --compositor compute",
            "--backend gpu --exact",
        ] {
            let line = format!("render ball.zarr -o o.png --overwrite --size 96x80 {look} {way}");
            let (code, _, stderr) = sandbox.run(&line);
            if code == 1 && stderr.contains("--backend cpu") {
                leave_out("gpu", stderr);
                continue;
            }
            assert_eq!(code, 0, "{line}: {stderr}");
            let difference = read_png(&sandbox.path("o.png")).difference(&expected);
            // As for pictures of one sample; means are rounded once more.
            assert!(difference.max <= 3 || difference.psnr_db >= 45.0, "{line}: {difference:?}");
        }
    }
}

#[test]
fn more_samples_come_nearer_to_what_all_of_a_pixel_shows() {
    let sandbox = sandbox();
    for look in
        ["", "--mode isosurface --isovalue 500", "--mode isosurface --isovalue 500 --up 0,1,0.3 --eye 60,-30,20"]
    {
        let of = |samples: u32| render(&sandbox, &format!("--size 128x128 --backend cpu {look} --aa {samples}"));
        let finest = of(16);
        let [one, four] = [1, 4].map(|samples| rms(&of(samples), &finest));
        assert!(one > 2.0 * four && four > 0.0, "{look}: {one} with one sample, {four} with four");
    }
    // A first picture has four; modes that show plain values have one, and a scene's setting counts.
    let of = |flags: &str| render(&sandbox, &format!("--size 96x96 --backend cpu {flags}"));
    assert_eq!(of("").difference(&of("--aa 4")).max, 0);
    assert_eq!(of("--mode mip").difference(&of("--mode mip --aa 1")).max, 0);
    assert_eq!(of("--slice z=50%").difference(&of("--slice z=50% --aa 1")).max, 0);
    sandbox.write("scene.json", r#"{"pixel_samples": 2, "mode": "mip"}"#);
    assert_eq!(of("--scene scene.json").difference(&of("--mode mip --aa 2")).max, 0);
    // The file records it.
    of("--aa 8");
    let file = sandbox.read("o.png");
    assert!(file.windows(18).any(|bytes| bytes == br#""pixel_samples":8,"#));
    for wrong in ["--aa 3", "--aa 0", "--aa 32", "--aa many"] {
        let (code, _, stderr) = sandbox.run(&format!("render ball.zarr -o w.png {wrong}"));
        assert!(code == 2 && stderr.contains("1, 2, 4, 8 or 16"), "{wrong}: {code}: {stderr}");
    }
    sandbox.write("wrong.json", r#"{"pixel_samples": 5}"#);
    let (code, _, stderr) = sandbox.run("render ball.zarr -o w.png --scene wrong.json");
    assert!(code != 0 && stderr.contains("1, 2, 4, 8 or 16"), "{code}: {stderr}");
}

#[test]
fn overlays_are_drawn_beside_what_is_shown() {
    let sandbox = sandbox();
    let plain = render(&sandbox, "--size 300x240 --backend cpu");
    for flags in ["--scale-bar", "--color-bar", "--label ball", "--axes", "--scale-bar --color-bar --axes --label ball"]
    {
        let drawn = render(&sandbox, &format!("--size 300x240 --backend cpu {flags}"));
        let changed = |i: &usize| drawn.rgb[*i] != plain.rgb[*i];
        let count = (0..plain.rgb.len()).filter(changed).count();
        assert!(count > 60, "{flags}: {count} pixels");
        // Edges behind the ball show through its rim where it is almost clear; nothing else does.
        let least = if flags.contains("--axes") { 16 } else { 1 };
        let is_shown = |i: &usize| plain.rgb[*i].iter().any(|code| *code >= least);
        let over = (0..plain.rgb.len()).filter(is_shown).filter(changed).count();
        assert_eq!(over, 0, "{flags}: the ball is hidden");
    }
    let movie = "render ball.zarr --movie o.y4m --orbit 2 --size 96x96 --backend cpu";
    sandbox.run_ok(movie);
    let bare = std::fs::read(sandbox.path("o.y4m")).unwrap();
    sandbox.run_ok(&format!("{movie} --overwrite --scale-bar"));
    let barred = std::fs::read(sandbox.path("o.y4m")).unwrap();
    assert!(bare.len() == barred.len() && bare != barred);
}

#[test]
fn overlays_that_cannot_be_drawn_are_refused_before_anything_is_read() {
    let sandbox = sandbox();
    for (flags, said) in [
        ("--label \u{6f22}", "no letter for '\u{6f22}'"),
        ("--scale-bar --size 95x300", "96x96"),
        ("--axes --stereo anaglyph", "one eye"),
    ] {
        let (code, _, stderr) = sandbox.run(&format!("render ball.zarr -o w.png --backend cpu {flags}"));
        assert!(code == 2 && stderr.contains(said), "{flags}: {code}: {stderr}");
        assert!(!sandbox.path("w.png").exists());
    }
    let (code, _, stderr) = sandbox.run("render labels.zarr -o l.png --backend cpu --size 96x96 --color-bar");
    assert!(code == 0 && stderr.contains("no colour bar"), "{code}: {stderr}");
}
