//! Exact pictures: under any budget, every brick at the view's level.

use brickyard::backend::{BackendChoice, BackendError, CompositorChoice};
use brickyard::exact::{ExactPictureError, ExactRenderer};
use brickyard::offline::OfflineError;
use brickyard::render::GpuError;
use brickyard::session::{Session, SessionError, SessionOptions, VolumeSource};
use brickyard::software::SoftwareError;
use brickyard::stats::RenderStats;
use brickyard::store::Store;
use brickyard::tiles::render_exact;
use brickyard::volume::{Extent, Geometry, LevelPolicy, Mode, Picture, Scene, Stereo, StereoLayout, TransferFunction};
use brickyard_pager::encoding_of;
use brickyard_tests::{
    FunctionSource, Sandbox, TestStore, assert_same, assert_same_surface, in_mode, leave_out, oracle, read_png,
    resolved,
};
use serde_json::Value;
use std::sync::Arc;
use std::time::{Duration, Instant};

const SIZE: (u32, u32) = (97, 75);

/// 216 bricks of 16^3 at the finest level.
fn waves() -> TestStore {
    let source = FunctionSource::new(Extent::new(96, 96, 96), Geometry::default(), |_, _, [x, y, z]: [u32; 3]| {
        let [x, y, z] = [x, y, z].map(f64::from);
        let value =
            0.5 + 0.2 * (0.31 * x + 0.11 * y).sin() + 0.2 * (0.23 * y - 0.17 * z).cos() + 0.05 * (0.9 * z).sin();
        (value * 255.0) as u8
    });
    TestStore::pack(&source, 16)
}

/// Light passes through the whole volume, so every brick counts.
fn scene(mode: Mode, level: LevelPolicy) -> Scene {
    let transfer = TransferFunction {
        color: vec![[0.0, 0.1, 0.2, 0.9], [128.0, 0.2, 0.9, 0.3], [255.0, 1.0, 0.6, 0.1]],
        opacity: vec![[0.0, 0.001], [255.0, 0.03]],
        unit_distance: 1.0,
        ..TransferFunction::default()
    };
    let scene = Scene { level, pixel_error: 0.93, background: [0.1, 0.0, 0.2], ..Scene::of(transfer) };
    in_mode(scene, mode, 140.0)
}

/// Surfaces have the greatest requirements of bricks.
fn surfaces() -> Scene {
    scene(Mode::Isosurface, LevelPolicy::Locked(0))
}

fn options(gpu_memory_bytes: u64, host_memory_bytes: u64) -> SessionOptions {
    let (backend, compositor) = (BackendChoice::Auto, CompositorChoice::Auto);
    SessionOptions {
        backend,
        compositor,
        gpu_memory_bytes,
        cpu_memory_bytes: gpu_memory_bytes,
        host_memory_bytes,
        threads: 2,
        skips_empty: true,
        keeps_decoded: true,
        live: false,
    }
}

/// The least for a picture and two bricks; `None` (with a message on standard error) without a GPU.
fn least_gpu_bytes(store: &Arc<Store>) -> Option<u64> {
    match ExactRenderer::new(store.clone(), encoding_of(&**store, 0), surfaces().needs(), SIZE, &options(1000, 1 << 20))
        .err()
        .expect("1000 bytes hold nothing")
    {
        ExactPictureError::Backend(BackendError::Gpu(GpuError::Budget { least_bytes, .. })) => Some(least_bytes),
        ExactPictureError::Backend(BackendError::Gpu(error @ GpuError::NoAdapter { .. })) => {
            leave_out("gpu", error);
            None
        }
        other => panic!("{other}"),
    }
}

fn draw(exact: &mut ExactRenderer, store: &Arc<Store>, scene: &Scene) -> (Picture, RenderStats) {
    let resolved = resolved(store, scene, SIZE);
    let mut stats = RenderStats::default();
    let picture = exact.render(&resolved, Duration::from_secs(60), Instant::now(), &mut stats);
    (picture.expect("a picture"), stats)
}

#[test]
fn any_working_set_is_drawn_whole_within_any_budget() {
    let test = waves();
    let Some(least) = least_gpu_bytes(&test.store) else { return };
    const HOST_BYTES: u64 = 2 << 20;
    for (gpu_bytes, passes) in [(least, 108..=108), (2 * least, 4..=50)] {
        let mut exact = ExactRenderer::new(
            test.store.clone(),
            encoding_of(&*test.store, 0),
            surfaces().needs(),
            SIZE,
            &options(gpu_bytes, HOST_BYTES),
        )
        .expect("it fits");
        for mode in [Mode::Dvr, Mode::Mip, Mode::MinIp, Mode::Average] {
            let scene = scene(mode, LevelPolicy::Locked(0));
            let (picture, stats) = draw(&mut exact, &test.store, &scene);
            assert_same(&picture, &oracle(&test.store, &scene, SIZE), &format!("{mode:?} in {gpu_bytes} bytes"));
            assert!(passes.contains(&stats.passes.expect("passes")), "{gpu_bytes}: {stats:?}");
            assert_eq!((stats.bricks.wanted, stats.bricks.resident, stats.bricks.failed), (216, 216, 0));
            assert!(stats.gpu_bytes_peak <= gpu_bytes && stats.host_bytes_peak <= HOST_BYTES, "{stats:?}");
            assert_eq!((stats.level_cells[0], stats.completeness), (216, 1.0));
        }
        // A surface, from independent cells.
        let surface = scene(Mode::Isosurface, LevelPolicy::Locked(0));
        let (picture, stats) = draw(&mut exact, &test.store, &surface);
        assert_same_surface(&picture, &oracle(&test.store, &surface, SIZE), &format!("surface in {gpu_bytes} bytes"));
        assert!(passes.contains(&stats.passes.expect("passes")), "{stats:?}");
        // Levels as the view requires, with a lost device in between.
        let scene = scene(Mode::Dvr, LevelPolicy::Auto);
        let (picture, stats) = draw(&mut exact, &test.store, &scene);
        assert!(draw(&mut exact, &test.store, &scene).0 == picture, "not the same again");
        assert!(stats.level_cells[0] > 0 && stats.level_cells[1] > 0, "{stats:?}");
        assert_same(&picture, &oracle(&test.store, &scene, SIZE), &format!("levels in {gpu_bytes} bytes"));
        exact.renderer().destroy_device();
        let (again, stats) = draw(&mut exact, &test.store, &scene);
        assert!(again == picture && stats.device_losses == 1, "{stats:?}");
    }
}

/// Pictures by rays are exact in tiles: in every mode, with two eyes, by every renderer, within a budget of a quarter of the bricks; if
/// a pixel's bricks do not fit, an error reports it.
#[test]
fn tiles_are_exact_however_the_picture_is_drawn() {
    const HOST_BYTES: u64 = 16 << 20;
    let test = waves();
    let ways = [
        (BackendChoice::Cpu, CompositorChoice::Auto),
        (BackendChoice::Gpu, CompositorChoice::Raycast),
        (BackendChoice::Gpu, CompositorChoice::Compute),
    ];
    for way in ways {
        let open = |bytes: u64| {
            let (backend, compositor) = way;
            let options = SessionOptions { backend, compositor, ..options(bytes, HOST_BYTES) };
            let mut session = Session::new(vec![VolumeSource::of_store(&test.store)], options);
            session.resolve(&surfaces(), SIZE).and_then(|scene| session.fit(&scene)).map(|()| session)
        };
        let least = match open(1000).err() {
            Some(SessionError::Backend(BackendError::Gpu(GpuError::Budget { least_bytes, .. }))) => least_bytes,
            Some(SessionError::Backend(BackendError::Cpu(SoftwareError::Budget { least_bytes, .. }))) => least_bytes,
            Some(SessionError::Backend(BackendError::Gpu(error @ GpuError::NoAdapter { .. }))) => {
                leave_out("gpu", error);
                continue;
            }
            other => panic!("{other:?}"),
        };
        let bytes = (0..40).map(|i| least + (i << 16)).find(|&bytes| open(bytes).is_ok_and(|s| s.slots() >= 54));
        let bytes = bytes.expect("some budget is enough");
        let mut session = open(bytes).expect("opened before");
        assert!(session.slots() < 80, "{way:?}: {} slots", session.slots());
        let stereo = Some(Stereo::new(StereoLayout::Anaglyph));
        let scenes = [
            scene(Mode::Dvr, LevelPolicy::Locked(0)),
            scene(Mode::Mip, LevelPolicy::Locked(0)),
            scene(Mode::Average, LevelPolicy::Locked(0)),
            Scene { stereo, ..scene(Mode::Dvr, LevelPolicy::Locked(0)) },
            scene(Mode::Isosurface, LevelPolicy::Locked(0)),
        ];
        for scene in scenes {
            let resolved = session.resolve(&scene, SIZE).expect("the scene is possible");
            let mut stats = RenderStats::default();
            let wait = Duration::from_secs(60);
            let picture = render_exact(&mut session, &resolved, wait, Instant::now(), &mut stats).expect("a picture");
            let what = format!("{way:?} {:?} in {:?} tiles", scene.mode, stats.tiles);
            let expected = oracle(&test.store, &scene, SIZE);
            match scene.mode {
                Mode::Isosurface => assert_same_surface(&picture, &expected, &what),
                _ => assert_same(&picture, &expected, &what),
            }
            assert!(stats.tiles > Some(2) && stats.completeness == 1.0 && !stats.memory_bound, "{what}: {stats:?}");
            assert!(stats.gpu_bytes_peak <= bytes && stats.host_bytes_peak <= HOST_BYTES, "{what}: {stats:?}");
        }
        let mut few = open(least).expect("the least is enough");
        let resolved = few.resolve(&scene(Mode::Dvr, LevelPolicy::Locked(0)), SIZE).expect("the scene is possible");
        let (wait, mut stats) = (Duration::from_secs(60), RenderStats::default());
        let error = render_exact(&mut few, &resolved, wait, Instant::now(), &mut stats).expect_err("too few slots");
        assert!(matches!(error, OfflineError::Pixel { .. }), "{way:?}: {error}");
    }
}

#[test]
fn the_command_draws_exact_pictures_and_refuses_other_ways() {
    let sandbox = Sandbox::default();
    sandbox.run_ok("synth turbulence t.zarr --shape 64,64,64 --brick 16 --shard 64 --progress none");
    let view = "--size 97x75 --level 0 --transfer viridis --lighting none --overwrite";
    for (flags, words) in [
        ("--backend cpu --compositor sorted", "--compositor raycast"),
        ("--compositor reference", "leave --exact out"),
        ("--backend cpu --gpu-memory 1272KiB --host-memory 16MiB", "the pixel in column"),
        ("--host-memory 20KiB", "--host-memory"),
    ] {
        let (code, _, stderr) = sandbox.run(&format!("render t.zarr -o no.png {view} --exact {flags}"));
        if stderr.contains("no graphics adapter") {
            return leave_out("gpu", stderr);
        }
        assert!(code == 2 && stderr.contains(words), "{flags}: exit {code}: {stderr}");
        assert!(!sandbox.path("no.png").exists(), "{flags}");
    }
    sandbox.run_ok(&format!("render t.zarr -o reference.png {view} --compositor reference"));
    let line = format!("render t.zarr -o o.png {view} --exact --gpu-memory 740KiB --host-memory 1MiB --stats o.json");
    let (code, _, stderr) = sandbox.run(&line);
    assert!(code == 0 && stderr.contains("64 bricks in") && stderr.contains("passes"), "exit {code}: {stderr}");
    assert_same(&read_png(&sandbox.path("o.png")), &read_png(&sandbox.path("reference.png")), "the command's picture");
    let stats: Value = serde_json::from_slice(&sandbox.read("o.json")).expect("JSON");
    assert!(stats["passes"].as_u64() > Some(2), "{stats}");
    assert_eq!((&stats["memory_bound"], &stats["compositor"]), (&Value::from(false), &Value::from("sorted")));

    // Tiles, for want of passes.
    let (code, _, stderr) =
        sandbox.run(&line.replace("740KiB --host-memory 1MiB", "1400KiB --host-memory 16MiB --backend cpu"));
    assert!(code == 0 && stderr.contains("drawn in ") && stderr.contains(" tiles"), "exit {code}: {stderr}");
    assert_same(&read_png(&sandbox.path("o.png")), &read_png(&sandbox.path("reference.png")), "in tiles");
    let stats: Value = serde_json::from_slice(&sandbox.read("o.json")).expect("JSON");
    assert!(stats["tiles"].as_u64() > Some(2) && stats["gpu_bytes_peak"].as_u64() <= Some(1400 << 10), "{stats}");

    // A damaged brick is counted, and replaced by an ancestor.
    let mut shard = sandbox.read("t.zarr/0/c/0/0/0");
    shard[99] ^= 1;
    sandbox.write("t.zarr/0/c/0/0/0", shard);
    let (code, _, stderr) = sandbox.run(&line);
    assert!(code == 0 && stderr.contains("1 brick could not be read"), "exit {code}: {stderr}");
    let stats: Value = serde_json::from_slice(&sandbox.read("o.json")).expect("JSON");
    assert_eq!(stats["bricks"]["failed"], 1);
}
