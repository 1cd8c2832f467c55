//! Budgets: under any of them the picture is whole, if coarser, with matching statistics; and a budget too small for
//! any picture is refused with the least sufficient one.

use brickyard_tests::{Sandbox, leave_out, read_png};
use serde_json::Value;

/// Opaque for all values: any hole would show the background.
const OPAQUE: &str = r#"{"color": [[0, 0, 0.2, 0.4], [255, 1, 0.8, 0]], "opacity": [[0, 1]], "unit_distance": 0.1}"#;
const VIEW: &str = "--size 200x150 --transfer opaque.json --background 1,0,1";
const MAGENTA: [u8; 3] = [255, 0, 255];
const MIB: u64 = 1 << 20;

/// 512 bricks of 32^3 at the finest level, 585 in all.
fn sandbox_with_ct() -> Sandbox {
    let sandbox = Sandbox::default();
    sandbox.write("opaque.json", OPAQUE);
    sandbox.run_ok("synth ct ct.zarr --shape 256,256,256 --brick 32 --shard 128 --progress none");
    sandbox
}

/// The available backends, with every compositor.
fn backends(sandbox: &Sandbox) -> Vec<&'static str> {
    let works = |backend: &&str| {
        let line = format!("render ct.zarr -o try.png --overwrite --size 8x8 --backend {backend}");
        let (code, _, stderr) = sandbox.run(&line);
        if code != 0 {
            assert!(backend.starts_with("gpu") && stderr.contains("--backend cpu"), "{stderr}");
            leave_out("gpu", stderr);
        }
        code == 0
    };
    ["cpu", "gpu --compositor sorted", "gpu --compositor raycast", "gpu --compositor compute"]
        .into_iter()
        .filter(works)
        .collect()
}

/// Renders within budgets: the picture's background mask, and the statistics.
fn render(sandbox: &Sandbox, backend: &str, gpu_bytes: u64, host_bytes: u64, flags: &str) -> (Vec<bool>, Value) {
    let (code, _, stderr) = sandbox.run(&format!(
        "render ct.zarr -o o.png --overwrite --stats o.json {VIEW} --backend {backend} --gpu-memory {gpu_bytes} \
         --host-memory {host_bytes} {flags}"
    ));
    assert_eq!(code, 0, "{backend} in {gpu_bytes} and {host_bytes}: {stderr}");
    let stats: Value = serde_json::from_slice(&sandbox.read("o.json")).expect("JSON");
    assert_eq!(stderr.contains("memory bound"), stats["memory_bound"] == true, "{stderr}");
    assert!(stats["gpu_bytes_peak"].as_u64().expect("bytes") <= gpu_bytes, "{backend}: {stats}");
    assert!(stats["host_bytes_peak"].as_u64().expect("bytes") <= host_bytes, "{backend}: {stats}");
    assert_eq!(stats["bricks"]["failed"], 0);
    assert_eq!(stats["compositor"], backend.rsplit_once(' ').map_or("raycast", |(_, compositor)| compositor));
    let picture = read_png(&sandbox.path("o.png"));
    (picture.rgb.iter().map(|p| *p == MAGENTA).collect(), stats)
}

#[test]
fn whatever_the_budget_the_picture_is_whole() {
    let sandbox = sandbox_with_ct();
    for backend in backends(&sandbox) {
        let (silhouette, ample) = render(&sandbox, backend, 512 * MIB, 256 * MIB, "--level 0");
        assert_eq!(ample["memory_bound"], false, "{ample}");
        assert!(silhouette.contains(&true) && silhouette.contains(&false), "the picture shows body and background");
        let mut last_error = 0.0;
        for gpu_mib in [24, 12, 6, 3] {
            let (mask, stats) = render(&sandbox, backend, gpu_mib * MIB, 32 * MIB, "--level 0");
            assert!(mask == silhouette, "{backend} within {gpu_mib} MiB: the picture has a hole");
            let error = stats["effective_pixel_error"].as_f64().expect("pixels");
            if gpu_mib <= 6 {
                assert_eq!(stats["memory_bound"], true, "{backend} within {gpu_mib} MiB: {stats}");
            }
            assert!(error >= last_error, "{backend} within {gpu_mib} MiB: {error} px, {last_error} px with more");
            last_error = error;
        }
        assert!(last_error > 2.0 * ample["effective_pixel_error"].as_f64().expect("pixels"), "{last_error} px");
    }
}

#[test]
fn an_eye_inside_a_coarse_brick_has_no_error_in_pixels() {
    let sandbox = sandbox_with_ct();
    let eye = "--eye 127,127,127 --target 20,127,127";
    let (_, _, stderr) = sandbox.run(&format!("render ct.zarr -o o.png {VIEW} --backend cpu {eye} --gpu-memory 4096"));
    // A brick or a level.
    for (gpu_bytes, level, memory_bound) in [(least_bytes(&stderr), "auto", true), (64 * MIB, "2", false)] {
        let (_, stats) = render(&sandbox, "cpu", gpu_bytes, 32 * MIB, &format!("{eye} --level {level}"));
        assert!(stats["memory_bound"] == memory_bound && stats["effective_pixel_error"].is_null(), "{stats}");
    }
}

#[test]
fn what_was_read_decoded_and_uploaded_is_counted_in_bytes() {
    let sandbox = Sandbox::default();
    // A single brick: its shard is its encoded bytes, an index entry of 16 and a checksum of 4.
    sandbox.run_ok("synth turbulence one.zarr --shape 32,32,32 --brick 32 --shard 32 --progress none");
    sandbox.run_ok("render one.zarr -o o.png --orbit 3 --stats o.json --backend cpu --size 40x30 --lighting none");
    let stats: Value = serde_json::from_slice(&sandbox.read("o.json")).expect("JSON");
    let read = sandbox.read("one.zarr/0/c/0/0/0").len() - 20;
    assert_eq!(stats["bytes"], serde_json::json!({"read": read, "decoded": 32 << 10, "uploaded": 34 * 34 * 34}));
}

#[test]
fn an_orbit_within_a_small_budget_stays_within_it() {
    let sandbox = sandbox_with_ct();
    for backend in backends(&sandbox) {
        let (code, _, stderr) = sandbox.run(&format!(
            "render ct.zarr -o turn.png --overwrite --stats turn.json {VIEW} --backend {backend} --orbit 6 \
             --pixel-error 0.5 --gpu-memory 6MiB --host-memory 8MiB"
        ));
        assert_eq!(code, 0, "{backend}: {stderr}");
        let stats: Value = serde_json::from_slice(&sandbox.read("turn.json")).expect("JSON");
        assert_eq!(stats["frames"], 6);
        assert_eq!(stats["memory_bound"], true, "{stats}");
        assert!(stats["gpu_bytes_peak"].as_u64().expect("bytes") <= 6 * MIB, "{stats}");
        assert!(stats["host_bytes_peak"].as_u64().expect("bytes") <= 8 * MIB, "{stats}");
        for i in 0..6 {
            let picture = read_png(&sandbox.path(format!("turn_{i:03}.png")));
            // The rays of one row through the middle of the body; all between its outermost pixels hit it.
            let row = &picture.rgb[75 * 200..76 * 200];
            let body: Vec<usize> = (0..200).filter(|x| row[*x] != MAGENTA).collect();
            let (first, last) = (body[0], body[body.len() - 1]);
            assert!(body.len() == last - first + 1 && body.len() > 60, "{backend} picture {i}: a hole");
        }
    }
}

#[test]
fn every_frame_of_a_random_flight_is_whole_and_within_its_budgets() {
    let sandbox = sandbox_with_ct();
    for backend in backends(&sandbox) {
        // A software GPU takes a tenth of a second per frame.
        let frames = if backend == "cpu" { 200 } else { 50 };
        let printed = sandbox.run_ok(&format!(
            "bench ct.zarr --scenario random,zoom --frames {frames} --size 48x36 --backend {backend} --gpu-memory 6MiB \
             --host-memory 8MiB --json"
        ));
        let flights: Value = serde_json::from_str(&printed).expect("JSON");
        for flight in flights.as_array().expect("two flights") {
            assert_eq!(flight["frames"], frames);
            assert_eq!([&flight["uncovered_frames"], &flight["frames_over_budget"]], [0, 0], "{backend}: {flight}");
            assert!(flight["gpu_bytes_peak"].as_u64().expect("bytes") <= 6 * MIB, "{backend}: {flight}");
            assert!(flight["host_bytes_peak"].as_u64().expect("bytes") <= 8 * MIB, "{backend}: {flight}");
        }
        assert!(flights[0]["bricks"]["uploaded"].as_u64().expect("bricks") > 50, "bricks must come and go: {flights}");
    }
}

/// The least sufficient amount, from a message.
fn least_bytes(stderr: &str) -> u64 {
    let after = stderr.split("at least ").nth(1).unwrap_or_else(|| panic!("no least amount in: {stderr}"));
    let mut words = after.split([' ', ';', ',', '\n']);
    let number: f64 = words.next().and_then(|w| w.parse().ok()).unwrap_or_else(|| panic!("no number in: {stderr}"));
    match words.next() {
        Some("MiB") => (number * MIB as f64) as u64,
        Some("KiB") => (number * 1024.0) as u64,
        _ => number as u64,
    }
}

#[test]
fn a_budget_too_small_for_anything_says_what_would_do() {
    let sandbox = sandbox_with_ct();
    for backend in backends(&sandbox) {
        let of_slots = if backend == "cpu" { "--cpu-memory" } else { "--gpu-memory" };
        for (small, least_flags) in [("--gpu-memory 4096", of_slots), ("--host-memory 4096", "--host-memory")] {
            let line = format!("render ct.zarr -o small.png {VIEW} --backend {backend}");
            let (code, _, stderr) = sandbox.run(&format!("{line} {small}"));
            assert_eq!(code, 2, "{backend} {small}: {stderr}");
            assert!(stderr.contains(least_flags), "{backend} {small}: {stderr}");
            assert!(!sandbox.path("small.png").exists());
            let least = least_bytes(&stderr);
            let (code, _, stderr) = sandbox.run(&format!("{line} {least_flags} {least}"));
            assert_eq!(code, 0, "{backend} {least_flags} {least}: {stderr}");
            std::fs::remove_file(sandbox.path("small.png")).expect("it was written");
            // It is given to a tenth.
            let tenth = if least < MIB { 103 } else { MIB / 10 + 1 };
            let (code, _, _) = sandbox.run(&format!("{line} {least_flags} {}", least - tenth));
            assert_eq!(code, 2, "{backend} {least_flags}: a tenth less than the least is refused");
        }
    }
}

#[test]
fn the_reference_refuses_what_it_cannot_hold() {
    let sandbox = sandbox_with_ct();
    let line = "render ct.zarr -o o.png --size 8x8 --level 0 --compositor reference --host-memory 1MiB";
    let (code, _, stderr) = sandbox.run(line);
    assert!(code == 2 && stderr.contains("--host-memory"), "exit {code}: {stderr}");
    assert!(!sandbox.path("o.png").exists());
}
