//! Several stores in one picture: streamed by every backend against the oracle, 32 of them under the usual budgets, and all refusals.

use brickyard::backend::{BackendChoice, CompositorChoice};
use brickyard::offline::render_settled;
use brickyard::oracle::render_reference;
use brickyard::scene_file;
use brickyard::session::{ResolvedScene, Session, SessionError, SessionOptions, VolumeSource, resolve};
use brickyard::stats::RenderStats;
use brickyard::store::Store;
use brickyard::volume::{
    Blend, Camera, Extent, Filter, Geometry, Gradient, Isosurface, Jitter, LevelPolicy, Lighting, LightingModel,
    MAX_VOLUMES, Mode, Picture, Placement, Sampling, Scene, SceneExpression, SceneLayer, Stereo, StereoLayout,
    TransferChoice, TransferFunction, Voxel,
};
use brickyard_tests::{FunctionSource, Sandbox, TestStore, assert_same, open_session_of, options, read_png};
use glam::DVec3;
use std::time::{Duration, Instant};

const SIZE: (u32, u32) = (56, 44);

/// Ways to draw several volumes, each with its own order.
const WAYS: [(BackendChoice, CompositorChoice); 2] =
    [(BackendChoice::Cpu, CompositorChoice::Auto), (BackendChoice::Gpu, CompositorChoice::Raycast)];

fn store<T: Voxel>(extent: [u32; 3], spacing: [f64; 3], brick: u32, scale: f64) -> TestStore {
    let geometry = Geometry { spacing: spacing.into(), ..Geometry::default() };
    let value = move |_, _, v: [u32; 3]| {
        let p = DVec3::from_array(v.map(f64::from)) * scale;
        let wave = (p.x * 0.21).sin() + (p.y * 0.17 + 1.0).sin() + (p.z * 0.27 + p.x * 0.1).cos();
        T::from_f64_rounded((wave / 6.0 + 0.5).clamp(0.0, 1.0) * 255.0)
    };
    TestStore::pack(&FunctionSource::new(Extent::from_array(extent), geometry, value), brick)
}

fn volumes(stores: &[TestStore]) -> Vec<VolumeSource> {
    stores.iter().map(|test| VolumeSource::of_store(&test.store)).collect()
}

fn transfer(rgb: [f64; 3], alpha: f64) -> TransferFunction {
    TransferFunction {
        color: vec![[0.0, rgb[0], rgb[1], rgb[2]], [255.0, 1.0 - rgb[0], rgb[1], 1.0 - rgb[2]]],
        opacity: vec![[110.0, 0.0], [150.0, alpha], [200.0, 0.3 * alpha], [255.0, alpha]],
        unit_distance: 3.0,
        ..TransferFunction::default()
    }
}

fn two() -> Vec<TestStore> {
    vec![store::<u8>([61, 53, 47], [1.0, 1.0, 1.0], 16, 1.0), store::<u16>([40, 70, 33], [1.5, 0.75, 1.2], 16, 1.2)]
}

fn plain() -> SceneLayer {
    transfer([0.9, 0.3, 0.1], 0.4).into()
}

fn askew() -> SceneLayer {
    SceneLayer {
        world_from_volume: Placement::from_text("0.8 -0.6 0 20  0.6 0.8 0.1 -5  0 0 1.1 3").expect("a map"),
        ..transfer([0.1, 0.8, 0.9], 0.5).into()
    }
}

fn of(layers: Vec<SceneLayer>) -> Scene {
    Scene { background: [0.1, 0.05, 0.2], layers, ..Scene::default() }
}

fn scene() -> Scene {
    of(vec![plain(), askew()])
}

/// An expression over layers at these places, with values in the look of the first layer of [`scene`].
fn combined(text: &str, places: &[SceneLayer]) -> Scene {
    let bare = |layer: &SceneLayer| SceneLayer { world_from_volume: layer.world_from_volume, ..SceneLayer::default() };
    let expression = SceneExpression { text: text.into(), transfer: plain().transfer };
    Scene { expression: Some(expression), ..of(places.iter().map(bare).collect()) }
}

fn lit(gradient: Gradient, lights: &[[f64; 3]]) -> Lighting {
    Lighting { model: LightingModel::BlinnPhong, gradient, lights: lights.iter().map(|&light| light.into()).collect() }
}

/// A session; `None` (with a message) without a GPU.
fn open(volumes: &[VolumeSource], options: &SessionOptions) -> Option<Session> {
    open_session_of(volumes.to_vec(), *options)
}

fn settle(session: &mut Session, resolved: &ResolvedScene) -> (Picture, RenderStats) {
    let mut stats = RenderStats::default();
    let wait = Duration::from_secs(120);
    let picture = render_settled(session, resolved, wait, Instant::now(), &mut stats, &mut Vec::new());
    (picture.expect("the picture settles"), stats)
}

/// The settled picture of a way to draw; `None` (with a message) without a GPU.
fn draw(
    volumes: &[VolumeSource],
    resolved: &ResolvedScene,
    options: &SessionOptions,
) -> Option<(Picture, RenderStats)> {
    Some(settle(&mut open(volumes, options)?, resolved))
}

/// With prefetching, limited uploads and fades the final picture is the same.
#[test]
fn live_sessions_of_several_volumes_settle() {
    let stores = two();
    let volumes = volumes(&stores);
    // Otherwise hysteresis may keep finer bricks than the oracle's.
    let scene = Scene { level: LevelPolicy::Locked(0), ..scene() };
    let first = resolve(&volumes, &scene, SIZE).expect("the scene is possible");
    let at = |turn_deg: f64| Scene { camera: Some(first.camera.orbited(turn_deg)), ..scene.clone() };
    let shown: Vec<&Store> = stores.iter().map(|test| &*test.store).collect();
    for way in WAYS {
        let options = SessionOptions { live: true, ..options(way, 64 << 20, 64 << 20) };
        let Some(mut session) = open(&volumes, &options) else { continue };
        for turn_deg in [0.0, 4.0, 8.0] {
            let frame = session.step(&at(turn_deg), SIZE).expect("a step");
            let status = &frame.status;
            assert!(status.gpu_bytes <= 64 << 20 && status.host_bytes <= 64 << 20, "{status:?}");
            session.draw(&frame).expect("a picture");
        }
        let resolved = session.resolve(&at(12.0), SIZE).expect("the scene is possible");
        let (picture, stats) = settle(&mut session, &resolved);
        let expected = render_reference(&shown, &resolved, 1 << 30).expect("the oracle's picture");
        assert!(picture.difference(&expected).max <= 2 && stats.completeness == 1.0, "{way:?}: {stats:?}");
    }
}

/// Layers of one grid and another one, hidden and shown in turn: the picture is the oracle's, and a hidden layer keeps only its coarsest
/// bricks. Sessions of `sorted` have the layers of one grid.
#[test]
fn layers_come_and_go_in_a_live_session() {
    let stores = two();
    let volumes = volumes(&stores);
    let shown: Vec<&Store> = stores.iter().map(|test| &*test.store).collect();
    let emission = SceneLayer { blend: Some(Blend::Add), opacity: 0.5, ..transfer([0.1, 0.4, 0.9], 0.5).into() };
    let surface = Isosurface { value: 170.0, color: Some([0.9, 0.9, 0.2]), opacity: 0.5 };
    let solid = SceneLayer { isosurfaces: vec![surface], ..transfer([0.2, 0.9, 0.1], 0.1).into() };
    let all = |visible: [bool; 4], count: usize| {
        let layers = [plain(), solid.clone(), emission.clone(), SceneLayer { source: Some(1), ..askew() }];
        let layers = layers.into_iter().zip(visible).enumerate().map(|(i, (layer, visible))| SceneLayer {
            source: Some((i == 3) as usize),
            visible,
            ..layer
        });
        Scene { level: LevelPolicy::Locked(0), ..of(layers.take(count).collect()) }
    };
    let sorted = (BackendChoice::Gpu, CompositorChoice::Sorted);
    for (way, count) in [(WAYS[0], 4), (WAYS[1], 4), (sorted, 3)] {
        let first = resolve(&volumes, &all([true, false, false, false], count), SIZE).expect("the scene is possible");
        let options = SessionOptions { live: true, ..options(way, 64 << 20, 64 << 20) };
        let Some(mut session) = open(&volumes, &options) else { continue };
        for visible in [[true, false, false, false], [true; 4], [false, true, true, false], [true, false, true, true]] {
            let scene = Scene { camera: Some(first.camera), ..all(visible, count) };
            let resolved = session.resolve(&scene, SIZE).expect("the scene is possible");
            session.prepare_scene(&resolved);
            while !session.is_scene_prepared(&resolved) {
                std::thread::sleep(Duration::from_millis(20));
            }
            let (picture, _) = settle(&mut session, &resolved);
            let expected = render_reference(&shown, &resolved, 1 << 30).expect("the oracle's picture");
            let difference = picture.difference(&expected);
            assert!(difference.max <= 2, "{way:?} {visible:?}: {difference:?}");
            let cells: Vec<usize> = session.draw_lists().map(|list| list.cells.len()).collect();
            assert!(
                cells.iter().zip(visible).all(|(&cells, visible)| (cells > 1) == visible),
                "{visible:?}: {cells:?}"
            );
        }
    }
}

/// Hidden parts of a layer appear when the occluding layer becomes translucent or moves, or with another expression.
#[test]
fn what_another_layer_hid_comes_out() {
    let (large, small) = (store::<u8>([61, 53, 47], [1.0; 3], 8, 1.0), store::<u16>([50, 42, 38], [1.0; 3], 8, 1.2));
    let stores = [large, small];
    let volumes = volumes(&stores);
    let shown: Vec<&Store> = stores.iter().map(|test| &*test.store).collect();
    let opaque = |alpha: f64| TransferFunction { opacity: vec![[0.0, alpha]], ..transfer([0.9, 0.3, 0.1], 0.4) };
    let of_alpha = |alpha: f64, x: f64| {
        let place = Placement::from_text(&format!("1 0 0 {x} 0 1 0 0 0 0 1 0")).expect("a map");
        of(vec![SceneLayer { world_from_volume: place, ..opaque(alpha).into() }, plain()])
    };
    let of_expression = |text: &str, alpha: f64| {
        let expression = SceneExpression { text: text.into(), transfer: Some(opaque(alpha).into()) };
        Scene { expression: Some(expression), ..combined(text, &[plain(), plain()]) }
    };
    // As large as the second, and as close to its place as possible: from all sides it is in front.
    let scenes = [
        vec![of_alpha(1.0, 0.0), of_alpha(0.0, 0.0), of_alpha(1.0, 0.0), of_alpha(1.0, 40.0)],
        vec![of_expression("a + b", 1.0), of_expression("a + b", 0.03), of_expression("b - a * 0.5", 0.03)],
    ];
    for (way, scenes) in WAYS.into_iter().flat_map(|way| scenes.each_ref().map(|scenes| (way, scenes))) {
        let first = resolve(&volumes, &scenes[0], SIZE).expect("the scene is possible");
        let options = SessionOptions { live: true, ..options(way, 64 << 20, 64 << 20) };
        let Some(mut session) = open(&volumes, &options) else { continue };
        let mut before = None;
        for (i, scene) in scenes.iter().enumerate() {
            // Coarse while hidden: bricks once read stay.
            let level = LevelPolicy::Locked((i + 1) as u8 % 2);
            let scene = Scene { camera: Some(first.camera), level, ..scene.clone() };
            let resolved = session.resolve(&scene, SIZE).expect("the scene is possible");
            let told = resolved.layers[1].view.appearance;
            assert_ne!(before.replace(told), Some(told), "what was told of the second layer does not hold any more");
            let (picture, _) = settle(&mut session, &resolved);
            let expected = render_reference(&shown, &resolved, 1 << 30).expect("the oracle's picture");
            let difference = picture.difference(&expected);
            assert!(difference.max <= 2, "{way:?}, scene {i}: {difference:?}");
        }
    }
}

#[test]
fn an_expression_reads_no_brick_of_values_that_show_nothing() {
    let stores = two();
    let volumes = volumes(&stores);
    let ramp = TransferFunction { opacity: vec![[0.0, 0.0], [1.0, 0.5]], ..transfer([0.9, 0.3, 0.1], 0.4) };
    let wanted = |text: &str| {
        let expression = SceneExpression { text: text.into(), transfer: Some(ramp.clone().into()) };
        let scene = Scene { expression: Some(expression), ..combined(text, &[plain(), plain()]) };
        let resolved = resolve(&volumes, &scene, SIZE).expect("a possible scene");
        let shown: Vec<&Store> = stores.iter().map(|test| &*test.store).collect();
        let expected = render_reference(&shown, &resolved, 1 << 30).expect("the oracle's picture");
        let (picture, stats) =
            draw(&volumes, &resolved, &options(WAYS[0], 64 << 20, 64 << 20)).expect("the CPU is there");
        assert_same(&picture, &expected, text);
        stats.bricks.wanted
    };
    let [all, bright] = ["a + 1", "a - 240"].map(wanted);
    assert!(bright * 4 < all * 3, "{bright} of {all}");
}

#[test]
fn a_lost_device_is_started_anew_with_the_same_picture() {
    let (stores, scene) = (two(), scene());
    let volumes = volumes(&stores);
    let resolved = resolve(&volumes, &scene, SIZE).expect("the scene is possible");
    let options = options((BackendChoice::Gpu, CompositorChoice::Raycast), 64 << 20, 64 << 20);
    let Some((before, _)) = draw(&volumes, &resolved, &options) else { return };
    let mut session = open(&volumes, &options).expect("there is a GPU");
    session.fit(&resolved).expect("there is memory");
    // Detected by uploading, and by drawing the settled picture.
    session.backend().expect("it fits").destroy_device();
    let (picture, stats) = settle(&mut session, &resolved);
    assert_same(&picture, &before, "lost before it was filled");
    assert_eq!(stats.device_losses, 1);
    let frame = session.step_resolved(&resolved).expect("a step");
    session.backend().expect("it has drawn").destroy_device();
    assert_same(&session.draw(&frame).expect("drawn anew"), &before, "lost when it was settled");
    let mut session = open(&volumes, &options).expect("there is a GPU");
    // Uploads go out in batches, so not every step finds the device lost.
    let always_lost = (0..1000).find_map(|_| {
        session.backend().iter().for_each(|backend| backend.destroy_device());
        session.wait(Duration::from_millis(5));
        session.step_resolved(&resolved).err()
    });
    assert!(matches!(always_lost, Some(SessionError::LostAgain { times: 4, .. })), "{always_lost:?}");
}

#[test]
fn two_stores_equal_the_oracle_on_every_backend() {
    let stores = two();
    let volumes = volumes(&stores);
    let glowing = SceneLayer { blend: Some(Blend::Add), opacity: 0.5, ..askew() };
    let cropped = SceneLayer { crop: Some([DVec3::new(10.0, 4.5, -9.0), DVec3::new(50.0, 40.0, 33.0)]), ..plain() };
    let layered = vec![
        SceneLayer { isosurfaces: vec![Isosurface { opacity: 0.5, ..Isosurface::at(140.0) }], ..plain() },
        SceneLayer {
            isosurfaces: [90.0, 170.0].map(|v| Isosurface { opacity: 0.4, ..Isosurface::at(v) }).into(),
            ..askew()
        },
    ];
    let stereo = Some(Stereo::new(StereoLayout::SideBySide));
    let combined = |text: &str| combined(text, &[plain(), askew()]);
    let scenes = [
        ("an expression", combined("default(a, 0) * 0.7 + default(b, 0) * 0.5")),
        ("an expression of what both have", combined("a > b ? a : sqrt(b) * 12")),
        (
            "an expression, lit and jittered",
            Scene {
                lighting: lit(Gradient::Central, &[[-40.0, 10.0, 90.0]]),
                sampling: Sampling { jitter: Jitter::Blue, ..Sampling::default() },
                ..combined("default(a, 60) * 0.7 + default(b, 0) * 0.5")
            },
        ),
        (
            "an expression, lit by stored gradients",
            Scene { lighting: lit(Gradient::Stored, &[]), ..combined("a * b / 160") },
        ),
        ("both", scene()),
        ("coarse", Scene { pixel_error: 3.0, ..scene() }),
        ("one glows, the other is cropped", of(vec![cropped, glowing])),
        ("clipped", Scene { clip: Some([DVec3::splat(5.0), DVec3::new(48.0, 70.0, 40.0)]), ..scene() }),
        ("two eyes", Scene { stereo, level: LevelPolicy::Locked(1), ..scene() }),
        ("lit from the eye", Scene { lighting: lit(Gradient::Central, &[]), ..scene() }),
        ("two lights", Scene { lighting: lit(Gradient::Sobel, &[[-40.0, 10.0, 90.0], [80.0, 20.0, 30.0]]), ..scene() }),
        (
            "stored gradients",
            Scene { lighting: lit(Gradient::Stored, &[[9.0, -60.0, 50.0]]), pixel_error: 2.0, ..scene() },
        ),
        ("surfaces", of(layered.clone())),
        ("surfaces, lit", Scene { lighting: lit(Gradient::Sobel, &[[-40.0, 10.0, 90.0]]), ..of(layered) }),
        ("splines", Scene { sampling: Sampling { filter: Filter::Tricubic, ..Default::default() }, ..scene() }),
    ];
    let places: Vec<_> = volumes.iter().map(VolumeSource::place).collect();
    for (what, scene) in scenes {
        let camera = Some(Camera::looking_at_box(scene.world_box(&places).expect("places")));
        let scene = Scene { camera, ..scene };
        let resolved = resolve(&volumes, &scene, SIZE).expect("a possible scene");
        let shown: Vec<&Store> = stores.iter().map(|test| &*test.store).collect();
        let expected = render_reference(&shown, &resolved, 1 << 30).expect("the oracle's picture");
        for way in WAYS {
            let options = options(way, 256 << 20, 256 << 20);
            let Some((picture, stats)) = draw(&volumes, &resolved, &options) else { continue };
            assert!(!stats.memory_bound && stats.bricks.failed == 0, "{what}: {stats:?}");
            let difference = picture.difference(&expected);
            // As for one volume: rounding, twice; and rays that graze a surface.
            let is_off = |(a, b): &(&[u8; 3], &[u8; 3])| (0..3).any(|k| a[k].abs_diff(b[k]) > 2);
            let off = picture.rgb.iter().zip(&expected.rgb).filter(is_off).count();
            let grazing = if what.starts_with("surfaces") { 2 } else { 0 };
            assert!(off <= grazing, "{what} {way:?}: {off} pixels, {difference:?}");
            let background = Picture::quantise(scene.background.map(|c| c as f32));
            assert!(picture.rgb.iter().filter(|&&p| p != background).count() > 200, "{what}: nothing in view");
        }
    }
}

/// Two layers of one store show its channels like two stores of a channel each, each in its style; and the scene written into a picture's
/// file gives the same picture.
#[test]
fn the_channels_of_one_store_are_layers() {
    let extent = Extent::new(52, 47, 41);
    let value = |channel: u32, [x, y, z]: [u32; 3]| {
        let p = [x, y, z].map(|n| f64::from(n) * (0.2 + 0.05 * f64::from(channel)));
        u8::from_f64_rounded(127.0 + 60.0 * p[0].sin() + 60.0 * (p[1] + p[2]).cos())
    };
    let both = FunctionSource::series(extent, Geometry::default(), 1, 2, |_, channel, v| value(channel, v));
    let both = TestStore::pack(&both, 16);
    let apart = [0, 1].map(|channel| {
        TestStore::pack(&FunctionSource::new(extent, Geometry::default(), move |_, _, v| value(channel, v)), 16)
    });
    let styles = [
        SceneLayer { color: Some([1.0, 0.3, 0.0]), window: Some([100.0, 240.0]), gamma: 1.6, ..SceneLayer::default() },
        SceneLayer { transfer: Some(TransferChoice::preset("viridis")), opacity: 0.6, ..SceneLayer::default() },
    ];
    let of_channels = |source: Option<usize>| {
        let style = |(i, style): (usize, &SceneLayer)| {
            let channel = if source.is_some() { i as u32 } else { 0 };
            SceneLayer { source, channel, blend: Some(Blend::Add), ..style.clone() }
        };
        of(styles.iter().enumerate().map(style).collect())
    };
    for mode in [Mode::Dvr, Mode::Mip] {
        let one = Scene { mode, ..of_channels(Some(0)) };
        let two = Scene { mode, ..of_channels(None) };
        let sources = [vec![VolumeSource::of_store(&both.store)], volumes(&apart)];
        let [shown, expected] = [(&sources[0], one), (&sources[1], two)].map(|(sources, scene)| {
            let resolved = resolve(sources, &scene, SIZE).expect("a possible scene");
            let written = resolve(sources, &resolved.shown(&scene), SIZE).expect("a possible scene");
            for (found, expected) in written.layers.iter().zip(&resolved.layers) {
                assert_eq!(
                    (&found.transfer, found.frames[0].opacity),
                    (&expected.transfer, expected.frames[0].opacity)
                );
            }
            resolved
        });
        let stores: [&Store; 2] = apart.each_ref().map(|test| &*test.store);
        let oracle = render_reference(&stores, &expected, 1 << 30).expect("the oracle's picture");
        assert_eq!(render_reference(&[&both.store], &shown, 1 << 30).expect("the oracle's picture"), oracle);
        let sorted = (BackendChoice::Gpu, CompositorChoice::Sorted);
        for way in WAYS.into_iter().chain([sorted]) {
            let options = options(way, 64 << 20, 64 << 20);
            let Some((picture, _)) = draw(&sources[0], &shown, &options) else { continue };
            assert_same(&picture, &oracle, &format!("{mode:?} {way:?}"));
        }
    }
}

#[test]
fn many_volumes_live_within_the_budgets() {
    let small: Vec<TestStore> = (0..2).map(|i| store::<u8>([40, 37, 33], [1.0; 3], 16, 1.0 + i as f64 * 0.3)).collect();
    let place = |i: usize| {
        let at = [i % 4, i / 4 % 4, i / 16].map(|n| n as f64 * 30.0);
        Placement::from_text(&format!("1 0 0 {} 0 1 0 {} 0 0 1 {}", at[0], at[1], at[2])).expect("a map")
    };
    let volumes: Vec<VolumeSource> = (0..MAX_VOLUMES).flat_map(|i| volumes(&small[i % 2..i % 2 + 1])).collect();
    let scene = of((0..MAX_VOLUMES).map(|i| SceneLayer { world_from_volume: place(i), ..plain() }).collect());
    let resolved = resolve(&volumes, &scene, SIZE).expect("a possible scene");
    let shown: Vec<&Store> = (0..MAX_VOLUMES).map(|i| &*small[i % 2].store).collect();
    let expected = render_reference(&shown, &resolved, 1 << 30).expect("the oracle's picture");
    let budget = 96 << 20;
    let options = options(WAYS[0], budget, budget);
    let (picture, stats) = draw(&volumes, &resolved, &options).expect("the CPU is there");
    assert!(picture.difference(&expected).max <= 2);
    assert!(stats.gpu_bytes_peak <= budget && stats.host_bytes_peak <= budget, "{stats:?}");
}

#[test]
fn impossible_scenes_and_budgets_are_refused() {
    let stores = two();
    let volumes = volumes(&stores);
    // Errors of a scene alone, and of its requirements of stores; the check itself has tests of all reasons.
    for scene in [of(vec![]), of(vec![plain(); 3]), Scene { level: LevelPolicy::Locked(9), ..scene() }] {
        let error = resolve(&volumes, &scene, SIZE).expect_err("refused");
        assert!(matches!(error, SessionError::Scene(_)), "{error}");
    }
    let resolved = resolve(&volumes, &scene(), SIZE).expect("a possible scene");
    let way = (BackendChoice::Gpu, CompositorChoice::Sorted);
    let sorted = Session::new(volumes.clone(), options(way, 64 << 20, 64 << 20));
    let error = sorted.resolve(&scene(), SIZE).expect_err("refused");
    assert!(error.to_string().contains("raycast"), "{error}");
    for (gpu, host) in [(1 << 10, 64 << 20), (64 << 20, 1 << 10)] {
        let options = options(WAYS[0], gpu, host);
        let error =
            Session::new(volumes.clone(), options).step_resolved(&resolved).expect_err("a kibibyte is too little");
        assert!(error.to_string().contains("least"), "{error}");
    }
}

#[test]
fn the_command_shows_several_stores_and_says_what_is_wrong() {
    let sandbox = Sandbox::default();
    sandbox.run_ok("synth flow a.zarr --shape 40,36,50 --brick 16 --shard 32 --progress none");
    sandbox.run_ok("synth ct b.zarr --shape 30,30,30 --brick 16 --shard 32 --progress none");
    for (name, text) in [
        ("none.json", r#"{"layers": []}"#),
        ("store.json", r#"{"layers": [{}, {"source": 7}]}"#),
        ("missing.json", r#"{"layers": [{"transfer": {"file": "nothing.json"}}]}"#),
        ("words.json", r#"{"layers": [{"windw": [0, 1]}]}"#),
        ("hidden.json", r#"{"layers": [{}, {"visible": false}]}"#),
    ] {
        sandbox.write(name, text);
    }
    sandbox.write("shift.txt", "1 0 0 20\n0 1 0 3\n0 0 1 4\n0 0 0 1\n");
    sandbox.write("flat.txt", "1 0 0 20\n1 0 0 3\n0 0 1 4\n");
    sandbox.write("scene.json", r#"{"layers": [{}, {"world_from_volume": [[1,0,0,0],[1,0,0,0],[0,0,1,0]]}]}"#);
    sandbox.run_ok(
        "render a.zarr b.zarr -o two.png --size 32x32 --backend cpu --volume 1:matrix=shift.txt --volume 1:blend=add \
         --volume 0:transfer=viridis --volume 0:opacity=0.5",
    );
    sandbox.run_ok("render a.zarr -o one.png --size 32x32 --backend cpu --volume 0:matrix=shift.txt");
    sandbox.run_ok(
        "render a.zarr b.zarr -o max.png --size 32x32 --backend cpu --expr max(default(a,0),b*0.5) --transfer fire",
    );
    sandbox.run_ok("render a.zarr -o root.png --size 32x32 --backend cpu --expr sqrt(abs(a))");
    sandbox.run_ok(
        "render a.zarr b.zarr -o lit.png --size 32x32 --backend cpu --lighting tone --gradient sobel --light 9,-80,40 \
         --volume 1:matrix=shift.txt",
    );
    sandbox.run_ok(
        "render a.zarr b.zarr -o surfaces.png --size 32x32 --backend cpu --volume 0:isovalue=0.5,opacity=0.4,color=1:0:0 \
         --volume 1:isovalue=-300 --volume 1:isovalue=300,opacity=0.5 --light 9,-80,40",
    );
    // The scene file matches the flags; it names files relative to its folder.
    std::fs::create_dir(sandbox.path("deep")).expect("the sandbox is writable");
    let fire = r#"{"color": [[0, 1, 0, 0], [9, 1, 1, 0]], "opacity": [[0, 0], [9, 0.7]]}"#;
    sandbox.write("deep/function.json", fire);
    sandbox.write(
        "deep/scene.json",
        r#"{"layers": [{"transfer": {"preset": "viridis"}, "window": [-0.5, 0.9], "gamma": 0.6, "opacity": 0.5},
            {"transfer": {"file": "function.json"}, "window": [-900, 900], "blend": "add", "color": [0, 1, 0]}]}"#,
    );
    sandbox.run_ok("render a.zarr b.zarr -o file.png --size 32x32 --backend cpu --scene deep/scene.json");
    sandbox.run_ok(
        "render a.zarr b.zarr -o flags.png --size 32x32 --backend cpu --lighting none --aa 1 --transfer viridis --volume 0:window=-0.5:0.9 \
         --volume 0:gamma=0.6 --volume 0:opacity=0.5 --volume 1:transfer=deep/function.json --volume 1:window=-900:900 \
         --volume 1:blend=add --volume 1:color=0:1:0",
    );
    sandbox.run_ok("render a.zarr b.zarr -o plain.png --size 32x32 --backend cpu");
    assert_eq!(read_png(&sandbox.path("file.png")), read_png(&sandbox.path("flags.png")));
    assert_ne!(read_png(&sandbox.path("file.png")), read_png(&sandbox.path("plain.png")));
    // So does the library.
    let volumes = ["a.zarr", "b.zarr"].map(|store| VolumeSource::open(sandbox.path(store)).expect("a store")).to_vec();
    let (scene, remarks) = scene_file::open(sandbox.path("deep/scene.json"), &volumes).expect("a scene");
    assert_eq!(remarks, [""; 0]);
    let options = SessionOptions { backend: BackendChoice::Cpu, ..SessionOptions::default() };
    let mut session = Session::new(volumes, options);
    let rendered = session.render(&scene, (32, 32)).expect("a picture");
    assert_eq!(rendered.picture, read_png(&sandbox.path("file.png")));
    // A live flight over layers, and over an expression.
    sandbox.write("twice.json", r#"{"layers": [{}, {"source": 0, "blend": "add"}], "expression": null}"#);
    for flags in ["--scene twice.json", "--expr abs(a)"] {
        sandbox.run_ok(&format!("bench a.zarr --scenario sweep --frames 2 --size 32x32 --backend cpu {flags}"));
    }
    for (i, flags) in [
        "--mode mip --volume 1:blend=add",
        "--slice z=20 --thickness 4 --volume 1:opacity=0.5",
        "--method pcvs --jitter",
        "--gradient-opacity 0:0,1:1 --lighting phong",
        "--mode isosurface --volume 0:isovalue=0.5",
        "--isovalue 0.4,opacity=0.5",
    ]
    .into_iter()
    .enumerate()
    {
        sandbox.run_ok(&format!("render a.zarr b.zarr -o way{i}.png --size 32x32 --backend cpu {flags}"));
    }
    sandbox.run_ok("synth flow c.zarr --shape 40,36,50 --brick 8 --shard 32 --progress none");
    sandbox.run_ok("synth ct d.zarr --shape 30,30,30 --brick 8 --shard 32 --progress none");
    let two = "render c.zarr d.zarr --size 32x32 --backend cpu --level 0 --volume 1:matrix=shift.txt";
    sandbox.run_ok(&format!("{two} -o whole.png"));
    sandbox.run_ok(&format!("{two} -o tiles.png --exact --gpu-memory 2450KiB --stats tiles.json"));
    assert_eq!(read_png(&sandbox.path("whole.png")), read_png(&sandbox.path("tiles.png")));
    let stats: serde_json::Value = serde_json::from_slice(&sandbox.read("tiles.json")).expect("JSON");
    assert!(stats["tiles"].as_u64() > Some(2), "{stats}");
    let many = "a.zarr ".repeat(33);
    let nine = format!("render a.zarr b.zarr -o no.png {}", "--volume 1:isovalue=7 ".repeat(9));
    let too_many = format!("render {many} -o no.png --size 32x32");
    for (line, code, word) in [
        (&too_many[..], 2, "33 layers"),
        ("render a.zarr b.zarr -o no.png --volume 1:matrix=flat.txt", 3, "singular"),
        ("render a.zarr b.zarr -o no.png --volume 1:matrix=missing.txt", 3, "neither a file nor"),
        ("render a.zarr b.zarr -o no.png --volume 1:matrix=1,0,0,0,0,nan,0,0,0,0,1,0", 3, "finite"),
        ("render a.zarr b.zarr -o no.png --scene scene.json", 3, "singular"),
        ("render a.zarr -o no.png --scene none.json", 2, "0 layers"),
        ("render a.zarr -o no.png --scene store.json", 2, "layer 1: store 7"),
        ("render a.zarr -o no.png --scene missing.json", 3, "nothing.json"),
        ("render a.zarr -o no.png --scene words.json", 3, "unknown field `windw`"),
        ("render a.zarr b.zarr -o no.png --scene hidden.json --expr a+b", 2, "layer 1, which is hidden"),
        ("render a.zarr -o no.png --channel 3", 2, "no channel '3'"),
        ("render a.zarr b.zarr -o no.png --volume 2:blend=add", 2, "2 layers"),
        ("render a.zarr b.zarr -o no.png --volume 1:blend=under", 2, "mix, add or over"),
        ("render a.zarr b.zarr -o no.png --mode mip --expr a+b", 2, "mode dvr"),
        ("render a.zarr b.zarr -o no.png --mode isosurface", 2, "isovalue"),
        ("render a.zarr b.zarr -o no.png --lighting none --light 1,2,3", 2, "without lighting"),
        ("render a.zarr b.zarr -o no.png --lighting phong --light 1,2,nan", 2, "nan"),
        ("render a.zarr b.zarr -o no.png --volume 1:isovalue=nan", 2, "finite"),
        ("render a.zarr b.zarr -o no.png --volume 1:isovalue=7,opacity=2", 2, "0 to 1"),
        (&nine, 2, "at most 8"),
        ("render a.zarr b.zarr -o no.png --exact --compositor reference", 2, "leave --exact out"),
        ("render a.zarr b.zarr -o no.png --backend gpu --compositor sorted", 2, "raycast"),
        ("render a.zarr b.zarr -o no.png --gpu-memory 1KiB --backend cpu", 2, "least"),
        ("render a.zarr missing.zarr -o no.png", 3, "missing.zarr"),
        ("render a.zarr b.zarr -o no.png --expr max(a,*b)", 2, "\n  max(a,*b)\n        ^"),
        ("render a.zarr b.zarr -o no.png --transfer fire --expr a+c", 2, "\n  a+c\n    ^"),
        ("quality a.zarr -o no.png --expr a*2", 2, "leave --expr out"),
    ] {
        let (found, _, stderr) = sandbox.run(line);
        assert_eq!(found, code, "brickyard {line}: {stderr}");
        assert!(stderr.contains(word), "brickyard {line}: {word:?} is not in: {stderr}");
        assert!(!sandbox.path("no.png").exists());
    }
}

/// The codes of a channel's slots are for its own values: a channel of small values beside one of large ones is drawn as if alone.
#[test]
fn float_channels_of_unlike_ranges_equal_the_oracle() {
    let extent = Extent::new(40, 36, 33);
    let value = |channel: u32, [x, y, z]: [u32; 3]| {
        let wave = (f64::from(x) * 0.21).sin() + (f64::from(y) * 0.17).cos() + (f64::from(z) * 0.13).sin();
        (0.5 + wave / 6.0) as f32 * [1.0, 1e6][channel as usize]
    };
    let test = TestStore::pack(&FunctionSource::series(extent, Geometry::default(), 1, 2, |_, c, v| value(c, v)), 16);
    let fog = |channel: u32| {
        let top = [1.0, 1e6][channel as usize];
        let function = TransferFunction {
            color: vec![[0.2 * top, 0.1, 0.2, 0.9], [0.8 * top, 1.0, 0.6, 0.1]],
            opacity: vec![[0.4 * top, 0.0], [0.8 * top, 0.4]],
            unit_distance: 3.0,
            ..TransferFunction::default()
        };
        SceneLayer { source: Some(0), channel, ..function.into() }
    };
    let both = of(vec![fog(0), fog(1)]);
    for way in [WAYS[0], WAYS[1], (BackendChoice::Gpu, CompositorChoice::Sorted)] {
        // One session for all: one channel's slots are unsuitable for the other.
        let options = SessionOptions { threads: 2, ..options(way, 64 << 20, 64 << 20) };
        let Some(mut session) = open_session_of(volumes(std::slice::from_ref(&test)), options) else { continue };
        for scene in [of(vec![fog(0)]), of(vec![fog(1)]), both.clone(), of(vec![fog(0)])] {
            let resolved = session.resolve(&scene, SIZE).expect("a possible scene");
            let expected = render_reference(&[&test.store], &resolved, 1 << 30).expect("the oracle's picture");
            let rendered = session.render(&scene, SIZE).expect("a picture");
            let channels: Vec<u32> = scene.layers.iter().map(|layer| layer.channel).collect();
            assert_same(&rendered.picture, &expected, &format!("{way:?} {channels:?}"));
        }
    }
}
