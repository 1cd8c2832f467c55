//! A session on an application's device: what it puts on the application's textures is its picture, nothing waits for the GPU, and what rays
//! saw is told of the frame that it was seen in, however late.

use brickyard::backend::{BackendChoice, BackendError, CompositorChoice};
use brickyard::frame_governor::Quality;
use brickyard::pager::Playback;
use brickyard::render::{Gpu, GpuError, Target, wgpu};
use brickyard::session::{Drawn, Frame, Session, SessionError, SessionOptions, VolumeSource};
use brickyard::volume::{
    Camera, Extent, Filter, Geometry, Lighting, LightingModel, Mesh, MeshLook, Mode, Picture, Placement, Projection,
    Sampling, Scene, SceneLayer, Stereo, StereoLayout, TransferFunction,
};
use brickyard_tests::{FunctionSource, TestStore, leave_out, oracle};
use glam::{DAffine3, DVec3};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};
use wgpu::TextureFormat;

const SIZE: (u32, u32) = (128, 96);
const EXTENT: Extent = Extent::new(90, 77, 83);
/// A colour that no picture has.
const UNTOUCHED: [u8; 4] = [7, 77, 177, 77];

/// Format of most textures here.
const FORMAT: TextureFormat = TextureFormat::Rgba8Unorm;

/// The whole of a texture of that format.
fn whole(view: &wgpu::TextureView) -> Target<'_> {
    Target { view, format: FORMAT, area_px: None }
}

/// A program that draws with wgpu, and counts what its handler for errors hears.
struct Application {
    adapter: wgpu::Adapter,
    device: wgpu::Device,
    queue: wgpu::Queue,
    errors: Arc<AtomicUsize>,
}

impl Application {
    fn new() -> Option<Self> {
        let new = || wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle_from_env());
        // While this one is there, drivers stay loaded. Tests run at once, and Mesa's software rasteriser is not made for devices that share it.
        static DRIVERS: OnceLock<wgpu::Instance> = OnceLock::new();
        DRIVERS.get_or_init(new);
        let adapters = pollster::block_on(new().enumerate_adapters(wgpu::Backends::all()));
        let Some(adapter) = adapters.into_iter().next() else {
            leave_out("gpu", "nothing was drawn on an application's device");
            return None;
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&Gpu::required(&adapter))).expect("a device");
        let errors = Arc::new(AtomicUsize::new(0));
        let heard = errors.clone();
        device.on_uncaptured_error(Arc::new(move |error| {
            eprintln!("the application hears: {error}");
            heard.fetch_add(1, Ordering::Relaxed);
        }));
        Some(Self { adapter, device, queue, errors })
    }

    /// The same, if its device has timestamps.
    fn with_timestamps() -> Option<Self> {
        let app = Self::new()?;
        if !app.device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
            leave_out("gpu", "no compositor was tried: the device has no timestamps");
            return None;
        }
        Some(app)
    }

    fn gpu(&self) -> Gpu {
        Gpu::from_device(&self.adapter, self.device.clone(), self.queue.clone()).expect("it has what is required")
    }

    fn session(&self, store: &TestStore, live: bool) -> Session {
        self.session_by(store, live, CompositorChoice::Auto)
    }

    fn session_by(&self, store: &TestStore, live: bool, compositor: CompositorChoice) -> Session {
        let options = SessionOptions {
            compositor,
            gpu_memory_bytes: 64 << 20,
            host_memory_bytes: 64 << 20,
            threads: 2,
            live,
            ..SessionOptions::default()
        };
        Session::on_gpu(vec![VolumeSource::of_store(&store.store)], options, self.gpu())
    }

    fn texture(&self, format: TextureFormat, (width, height): (u32, u32)) -> wgpu::Texture {
        let texture = self.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT
                | wgpu::TextureUsages::COPY_SRC
                | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(4 * width), rows_per_image: None };
        self.queue.write_texture(
            texture.as_image_copy(),
            &UNTOUCHED.repeat((width * height) as usize),
            layout,
            texture.size(),
        );
        texture
    }

    /// The texture's bytes, four a pixel.
    fn read(&self, texture: &wgpu::Texture) -> Vec<[u8; 4]> {
        let wgpu::Extent3d { width, height, .. } = texture.size();
        let row_bytes = (4 * width).next_multiple_of(256);
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: (row_bytes * height) as u64,
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        let layout = wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row_bytes), rows_per_image: None };
        encoder.copy_texture_to_buffer(
            texture.as_image_copy(),
            wgpu::TexelCopyBufferInfo { buffer: &buffer, layout },
            texture.size(),
        );
        self.queue.submit([encoder.finish()]);
        buffer.map_async(wgpu::MapMode::Read, .., |mapped| mapped.expect("mapped"));
        self.device.poll(wgpu::PollType::wait_indefinitely()).expect("done");
        let bytes = buffer.get_mapped_range(..).expect("mapped");
        let rows = bytes.chunks_exact(row_bytes as usize);
        rows.flat_map(|row| row[..4 * width as usize].chunks_exact(4).map(|p| [p[0], p[1], p[2], p[3]])).collect()
    }

    /// One frame of the application's: puts the session's on a texture. Whether it was this one.
    fn draw(&self, session: &mut Session, frame: &Frame, target: &Target<'_>) -> bool {
        let mut encoder = self.device.create_command_encoder(&Default::default());
        let is_this = session.draw_to(frame, target, &mut encoder).expect("drawn");
        self.queue.submit([encoder.finish()]);
        is_this
    }

    /// Frame by frame until there is a picture of the scene.
    fn show_next(&self, session: &mut Session, scene: &Scene, target: &Target<'_>) -> Frame {
        let begun = Instant::now();
        loop {
            let frame = session.step(scene, SIZE).expect("a step");
            if self.draw(session, &frame, target) {
                return frame;
            }
            assert!(begun.elapsed() < Duration::from_secs(120), "no picture: {:?}", frame.status);
            session.wait(Duration::from_millis(5));
        }
    }

    /// Frame by frame until nothing more comes and the picture is there.
    fn settle(&self, session: &mut Session, scene: &Scene, size_px: (u32, u32), target: &Target<'_>) -> Frame {
        let begun = Instant::now();
        loop {
            let frame = session.step(scene, size_px).expect("a step");
            if self.draw(session, &frame, target) && frame.status.settled {
                return frame;
            }
            assert!(begun.elapsed() < Duration::from_secs(120), "not settled: {:?}", frame.status);
            if !frame.status.awaits_feedback {
                session.wait(Duration::from_millis(5));
            }
        }
    }
}

/// Waves without a flat part.
fn store() -> TestStore {
    let waves = |[x, y, z]: [u32; 3]| {
        let [u, v, w] = [x, y, z].map(f64::from);
        (127.0 + 60.0 * (0.11 * u + 0.07 * v).sin() + 60.0 * (0.09 * v - 0.08 * w).cos()) as u8
    };
    TestStore::pack(&FunctionSource::new(EXTENT, Geometry::default(), move |_, _, v| waves(v)), 16)
}

fn transfer(opacity: f64) -> TransferFunction {
    TransferFunction {
        color: vec![[0.0, 0.9, 0.1, 0.4], [255.0, 0.3, 0.8, 0.2]],
        opacity: vec![[0.0, 0.2 * opacity], [255.0, opacity]],
        unit_distance: 4.0,
        ..TransferFunction::default()
    }
}

fn scene(opacity: f64, turn_deg: f64) -> Scene {
    let camera = Camera::looking_at_box(Geometry::default().world_box(EXTENT)).orbited(turn_deg);
    Scene { camera: Some(camera), ..Scene::of(transfer(opacity)) }
}

/// The same by a session on a device of its own, which waits for its pixels.
fn rendered(store: &TestStore, scene: &Scene, size_px: (u32, u32)) -> Picture {
    let options = SessionOptions {
        backend: BackendChoice::Gpu,
        gpu_memory_bytes: 64 << 20,
        host_memory_bytes: 64 << 20,
        threads: 2,
        ..SessionOptions::default()
    };
    let mut session = Session::new(vec![VolumeSource::of_store(&store.store)], options);
    session.render(scene, size_px).expect("a picture").picture
}

fn rgb(pixels: &[[u8; 4]]) -> Vec<[u8; 3]> {
    pixels.iter().map(|&[r, g, b, _]| [r, g, b]).collect()
}

/// The greatest difference of any value.
fn most(found: &[[u8; 3]], expected: &[[u8; 3]]) -> u8 {
    assert_eq!(found.len(), expected.len());
    let values = found.as_flattened().iter().zip(expected.as_flattened());
    values.map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0)
}

#[test]
fn what_an_application_shows_is_the_picture_in_every_format() {
    let (Some(app), store) = (Application::new(), store()) else { return };
    let scene = scene(0.5, 20.0);
    let expected = rendered(&store, &scene, SIZE);
    assert!(most(&expected.rgb, &oracle(&store.store, &scene, SIZE).rgb) <= 2);
    let formats = [TextureFormat::Rgba8Unorm, TextureFormat::Rgba8UnormSrgb, TextureFormat::Bgra8Unorm];
    for live in [false, true] {
        let mut session = app.session(&store, live);
        for format in formats {
            let texture = app.texture(format, SIZE);
            let view = texture.create_view(&Default::default());
            app.settle(&mut session, &scene, SIZE, &Target { view: &view, format, area_px: None });
            let mut found = rgb(&app.read(&texture));
            if format == TextureFormat::Bgra8Unorm {
                found.iter_mut().for_each(|p| p.reverse());
            }
            // Bricks may come to other slots, where texture coordinates are rounded otherwise.
            assert!(most(&found, &expected.rgb) <= 1, "{format:?}, live: {live}: {}", most(&found, &expected.rgb));
        }
    }
    assert_eq!(app.errors.load(Ordering::Relaxed), 0);
}

/// A picture of rows that are drawn part by part is the one that is drawn at once, whoever gathers it; until the last part the texture stays.
#[test]
fn rows_one_after_the_other_are_the_picture() {
    let (Some(app), store) = (Application::new(), store()) else { return };
    let fog = scene(0.3, 20.0);
    let layer = |opacity| SceneLayer { source: Some(0), ..transfer(opacity).into() };
    let layers = vec![layer(0.3), SceneLayer { opacity: 0.5, ..layer(0.6) }];
    let several = Scene { layers, ..fog.clone() };
    let projected = Scene { mode: Mode::Mip, ..several.clone() };
    let two_eyes = Scene { stereo: Some(Stereo::new(StereoLayout::SideBySide)), ..fog.clone() };
    for compositor in [CompositorChoice::Sorted, CompositorChoice::Raycast, CompositorChoice::Compute] {
        for (name, scene) in
            [("fog", &fog), ("two layers", &several), ("maxima of two layers", &projected), ("two eyes", &two_eyes)]
        {
            let mut session = app.session_by(&store, true, compositor);
            let texture = app.texture(FORMAT, SIZE);
            let view = texture.create_view(&Default::default());
            let frame = app.settle(&mut session, scene, SIZE, &whole(&view));
            // Another frame of the same picture.
            let frame = Quality::EXACT.frame(&frame);
            let all = frame.scene.rows();
            for rows in [0..8, 8..all * 3 / 5, all * 3 / 5..all] {
                let is_last = rows.end == all;
                let drawn = session.draw_rows(&frame, rows).expect("drawn");
                assert_eq!(drawn, if is_last { Drawn::Whole } else { Drawn::Partly }, "{compositor:?}, {name}");
                assert_eq!(session.shown().is_some_and(|shown| shown.is_copy_of(&frame)), is_last);
            }
            assert!(app.draw(&mut session, &frame, &whole(&view)));
            let (found, expected) = (rgb(&app.read(&texture)), rendered(&store, scene, SIZE).rgb);
            assert!(most(&found, &expected) <= 1, "{compositor:?}, {name}: {}", most(&found, &expected));
        }
    }
}

/// Where a look asks for slots of another format, the application's texture shows the picture before until the new one is whole; a camera
/// that moves meanwhile is followed at once.
#[test]
fn slots_change_behind_the_picture_before() {
    let Some(app) = Application::new() else { return };
    let value = |[x, y, z]: [u32; 3]| match [x, y, z] {
        [11, 9, 20] => 1e3f32,
        [30, 21, 7] => -1e3,
        _ => 0.5 + 0.2 * (0.3 * f64::from(x + y)).sin() as f32 + 0.2 * (0.2 * f64::from(y + z)).cos() as f32,
    };
    let store = TestStore::pack(&FunctionSource::new(EXTENT, Geometry::default(), move |_, _, v| value(v)), 16);
    let looking = |low: f64, high: f64, turn_deg: f64| {
        let color = vec![[low, 0.9, 0.1, 0.4], [high, 0.3, 0.8, 0.2]];
        let transfer = TransferFunction { color, opacity: vec![[low, 0.05], [high, 0.5]], ..transfer(0.5) };
        Scene { camera: scene(0.5, turn_deg).camera, ..Scene::of(transfer) }
    };
    let texture = app.texture(FORMAT, SIZE);
    let view = texture.create_view(&Default::default());
    for moves in [false, true] {
        let mut session = app.session(&store, true);
        app.settle(&mut session, &looking(-1e3, 1e3, 20.0), SIZE, &whole(&view));
        // The first picture of the window, from codes.
        let narrow = looking(0.2, 0.8, 20.0);
        app.show_next(&mut session, &narrow, &whole(&view));
        let before = rgb(&app.read(&texture));
        let (mut kept, mut begun) = (0, None);
        loop {
            let frame = session.step(&narrow, SIZE).expect("a step");
            let uploaded = frame.status.counters.uploaded;
            let is_this = app.draw(&mut session, &frame, &whole(&view));
            if is_this && frame.status.settled || moves && kept > 0 {
                break;
            }
            let is_changing = uploaded > *begun.get_or_insert(uploaded);
            let is_before = rgb(&app.read(&texture)) == before;
            assert!(is_before || !is_changing || is_this && frame.status.awaits_feedback, "{:?}", frame.status);
            kept += u32::from(is_changing && !is_this && is_before);
            session.wait(Duration::from_millis(5));
        }
        assert!(kept > 0, "slots were filled behind the picture");
        let last = looking(0.2, 0.8, if moves { 50.0 } else { 20.0 });
        if moves {
            app.show_next(&mut session, &last, &whole(&view));
            assert_ne!(rgb(&app.read(&texture)), before, "the camera has moved");
        }
        app.settle(&mut session, &last, SIZE, &whole(&view));
        let (found, expected) = (rgb(&app.read(&texture)), rendered(&store, &last, SIZE));
        assert!(most(&found, &expected.rgb) <= 1, "{}", most(&found, &expected.rgb));
    }
    assert_eq!(app.errors.load(Ordering::Relaxed), 0);
}

/// While steps are appended to a store, and whatever else makes slots anew, an application's texture shows the picture before until there is something of
/// the next one in every place; where there is none, as on another device, it stays as it was.
#[test]
fn the_picture_before_stays_while_a_store_grows() {
    let Some(app) = Application::new() else { return };
    let value = |step: u32| (30 * step + 40) as u8;
    let store = |steps| {
        let source = FunctionSource::series(EXTENT, Geometry::default(), steps, 1, move |step, _, _| value(step));
        TestStore::pack(&source, 16)
    };
    let stores: Vec<TestStore> = (2..7).map(store).collect();
    let inside =
        Camera { projection: Projection::Orthographic { height: 30.0 }, ..scene(0.5, 20.0).camera.expect("one") };
    let layer = SceneLayer { window: Some([0.0, 255.0]), ..SceneLayer::default() };
    let mut scene = Scene { mode: Mode::Mip, camera: Some(inside), layers: vec![layer], ..Scene::default() };
    let texture = app.texture(FORMAT, SIZE);
    let view = texture.create_view(&Default::default());
    let mut session = app.session(&stores[0], true);
    app.settle(&mut session, &scene, SIZE, &whole(&view));
    session.play(Some(Playback { steps_per_second: 20.0, ..Playback::default() }));
    let mut held = 0;
    for i in 0..160 {
        match i % 40 {
            0 => session.set_volumes(vec![VolumeSource::of_store(&stores[1 + i / 40].store)]),
            10 => scene.stereo = Some(Stereo::new(StereoLayout::TopBottom)),
            20 => drop(session.set_budgets(32 << 20, 32 << 20)),
            25 => drop(session.set_budgets(64 << 20, 64 << 20)),
            30 => scene.stereo = None,
            35 => session.set_gpu(app.gpu()),
            _ => {}
        }
        let before = app.read(&texture);
        let frame = session.step(&scene, SIZE).expect("a step");
        let is_this = app.draw(&mut session, &frame, &whole(&view));
        let found = app.read(&texture);
        held += u32::from(session.shows_before(&frame));
        match session.shown().map(|shown| shown.scene.time) {
            Some(step) => {
                let is_it = |pixel: &[u8; 4]| pixel[..3].iter().all(|code| code.abs_diff(value(step)) <= 1);
                assert!(found.iter().all(is_it), "frame {i}, step {step}: {:?}", found[0]);
            }
            None => assert!(!is_this && found == before, "frame {i}"),
        }
    }
    assert!(held > 5, "only {held} frames");
    assert_eq!(app.errors.load(Ordering::Relaxed), 0);
}

/// The copy beside it, of the same frame, costs no drawing; what is beside both stays as it was.
#[test]
fn a_frame_goes_where_the_application_wants_it() {
    let (Some(app), store) = (Application::new(), store()) else { return };
    let texture = app.texture(FORMAT, (300, 120));
    let view = texture.create_view(&Default::default());
    let mut session = app.session(&store, true);
    let (width, height) = SIZE;
    let target =
        |x, scale| Target { view: &view, format: FORMAT, area_px: Some([x, 10, width / scale, height / scale]) };
    let frame = app.settle(&mut session, &scene(0.5, 20.0), SIZE, &target(20, 1));
    assert!(app.draw(&mut session, &frame, &target(200, 2)));
    let pixels = app.read(&texture);
    let at = |x: u32, y: u32| pixels[(y * 300 + x) as usize];
    let expected = rendered(&store, &scene(0.5, 20.0), SIZE);
    for (y, x) in (0..120).flat_map(|y| (0..300).map(move |x| (y, x))) {
        let is_in =
            |left: u32, scale: u32| (left..left + width / scale).contains(&x) && (10..10 + height / scale).contains(&y);
        let [r, g, b, a] = at(x, y);
        if is_in(20, 1) {
            let own = expected.rgb[((y - 10) * width + x - 20) as usize];
            assert!(most(&[[r, g, b]], &[own]) <= 1 && a == 255);
        } else if is_in(200, 2) {
            // Half the size: the mean of four.
            let four = [(0, 0), (1, 0), (0, 1), (1, 1)]
                .map(|(i, j)| expected.rgb[((2 * (y - 10) + j) * width + 2 * (x - 200) + i) as usize]);
            let mean = [0, 1, 2].map(|c| (four.iter().map(|p| p[c] as u32).sum::<u32>() / 4) as u8);
            assert!(most(&[[r, g, b]], &[mean]) <= 2, "{x}, {y}: {:?} instead of {mean:?}", [r, g, b]);
        } else {
            assert_eq!(at(x, y), UNTOUCHED, "{x}, {y}");
        }
    }
}

#[test]
fn two_eyes_are_shown_in_every_layout() {
    let (Some(app), store) = (Application::new(), store()) else { return };
    let mut session = app.session(&store, true);
    for layout in StereoLayout::ALL {
        let texture = app.texture(FORMAT, SIZE);
        let view = texture.create_view(&Default::default());
        let scene = Scene { stereo: Some(Stereo::new(layout)), ..scene(0.5, 20.0) };
        app.settle(&mut session, &scene, SIZE, &whole(&view));
        let expected = rendered(&store, &scene, SIZE);
        let found = rgb(&app.read(&texture));
        // A code of either eye, by factors of up to 1.3 in light.
        let allowed = if layout == StereoLayout::Anaglyph { 4 } else { 1 };
        assert!(most(&found, &expected.rgb) <= allowed, "{layout:?}: {}", most(&found, &expected.rgb));
    }
}

/// Translucent layers are counted by answers that come later: a picture that had too few is drawn again.
#[test]
fn layers_of_meshes_are_all_there_in_the_end() {
    let (Some(app), store) = (Application::new(), store()) else { return };
    let (texture, mut session) = (app.texture(FORMAT, SIZE), app.session(&store, true));
    let view = texture.create_view(&Default::default());
    // Nine sheets, one behind the other.
    let (low, high) = Geometry::default().world_box(EXTENT);
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for i in 0..9u32 {
        let y = low.y + (high.y - low.y) * (i as f64 + 0.5) / 9.0;
        for (x, z) in [(low.x, low.z), (high.x, low.z), (high.x, high.z), (low.x, high.z)] {
            positions.push([x as f32, y as f32, z as f32]);
        }
        triangles.extend([[4 * i, 4 * i + 1, 4 * i + 2], [4 * i, 4 * i + 2, 4 * i + 3]]);
    }
    let mesh = Arc::new(Mesh::new(positions, triangles, vec![], vec![]).expect("a mesh"));
    let look = MeshLook { opacity: 0.2, mesh: Some(mesh), ..MeshLook::new("sheets") };
    let scene = Scene { meshes: vec![look], ..scene(0.05, 20.0) };
    app.settle(&mut session, &scene, SIZE, &whole(&view));
    let found = rgb(&app.read(&texture));
    let expected = rendered(&store, &scene, SIZE);
    assert!(most(&found, &expected.rgb) <= 1, "{}", most(&found, &expected.rgb));
}

/// However late the answers, a flight through opaque waves ends with the picture that a session shows which waits for each, and has not
/// fetched what is hidden. On the way the transfer function changes: what was seen through the one before says nothing any more.
#[test]
fn late_answers_are_of_the_frame_that_they_were_asked_of() {
    let (Some(app), store) = (Application::new(), store()) else { return };
    let texture = app.texture(FORMAT, SIZE);
    let view = texture.create_view(&Default::default());
    let target = whole(&view);
    // Waves that hide what is behind them, and fog.
    let dense = TransferFunction { unit_distance: 0.05, ..transfer(1.0) };
    let seen = |transfer: &TransferFunction, turn_deg| {
        let camera = scene(1.0, turn_deg).camera;
        Scene { camera, pixel_error: 0.25, ..Scene::of(transfer.clone()) }
    };
    let last = seen(&dense, 100.0);
    let expected = rendered(&store, &last, SIZE);
    let mut wanted = Vec::new();
    for late in [0, 1, 3] {
        let mut session = app.session(&store, true);
        app.settle(&mut session, &seen(&dense, 0.0), SIZE, &target);
        session.answer_late(late);
        for turn in 0..30 {
            let shown = if turn % 10 >= 5 { &dense } else { &transfer(0.01) };
            let moving = seen(shown, 3.0 * turn as f64);
            let frame = session.step(&moving, SIZE).expect("a step");
            app.draw(&mut session, &frame, &target);
            session.wait(Duration::from_millis(5));
        }
        let frame = app.settle(&mut session, &last, SIZE, &target);
        assert!(frame.status.covered && frame.status.wanted == frame.status.resident, "{:?}", frame.status);
        let found = rgb(&app.read(&texture));
        assert!(most(&found, &expected.rgb) <= 1, "late by {late}: {}", most(&found, &expected.rgb));
        wanted.push(frame.status.wanted);
    }
    let all = brickyard::volume::Pyramid::new(EXTENT, [1.0; 3], 16).level(brickyard::volume::Level(0)).bricks.volume();
    assert!(wanted.iter().all(|&wanted| (wanted as u64) < all / 2), "what is hidden is wanted: {wanted:?} of {all}");
}

/// A GPU's compositors are tried by the first frames, on their way, and the winner's later pictures are the same.
#[test]
fn both_compositors_are_tried_and_the_faster_one_is_kept() {
    let (Some(app), store) = (Application::with_timestamps(), store()) else { return };
    let texture = app.texture(FORMAT, SIZE);
    let view = texture.create_view(&Default::default());
    let target = whole(&view);
    let mut session = app.session(&store, true);
    session.try_compositors();
    let compositor = |session: &Session| session.backend().map_or("", |backend| backend.compositor());
    let is_said = |session: &Session| session.backend_line().contains(" times as long)");
    let mut frames = 0;
    for turn in 0.. {
        let frame = session.step(&scene(0.05, 3.0 * turn as f64), SIZE).expect("a step");
        app.draw(&mut session, &frame, &target);
        if is_said(&session) {
            break;
        }
        assert!(["", "sorted"].contains(&compositor(&session)), "`sorted` draws what is seen");
        frames += 1;
        assert!(frames < 2000, "the trial has no end");
        session.wait(Duration::from_millis(5));
    }
    assert!(frames >= 10, "{frames} frames are too few for a trial");
    let winner = compositor(&session);
    assert!(session.backend_line().contains(&format!(": {winner} (")), "{}", session.backend_line());
    // Later frames, and those of another fit, are the winner's.
    for size in [SIZE, (300, 300)] {
        let texture = app.texture(FORMAT, size);
        let view = texture.create_view(&Default::default());
        app.settle(&mut session, &scene(0.05, 40.0), size, &whole(&view));
        assert_eq!(compositor(&session), winner);
        assert!(is_said(&session));
        let (found, expected) = (rgb(&app.read(&texture)), rendered(&store, &scene(0.05, 40.0), size));
        assert!(most(&found, &expected.rgb) <= 1, "{}", most(&found, &expected.rgb));
    }
}

/// While `sorted` draws, scenes without an order for it are drawn by rays, and all of them settle, in any order.
#[test]
fn scenes_without_an_order_are_drawn_by_rays() {
    let (Some(app), store) = (Application::with_timestamps(), store()) else { return };
    let texture = app.texture(FORMAT, SIZE);
    let view = texture.create_view(&Default::default());
    let options = SessionOptions {
        gpu_memory_bytes: 64 << 20,
        host_memory_bytes: 64 << 20,
        threads: 2,
        live: true,
        ..SessionOptions::default()
    };
    let volumes = || vec![VolumeSource::of_store(&store.store), VolumeSource::of_store(&store.store)];
    let mut session = Session::on_gpu(volumes(), options, app.gpu());
    session.try_compositors();
    let one = scene(0.05, 20.0);
    let moved = Placement::new(DAffine3::from_translation(DVec3::splat(5.5))).expect("a placement");
    let mut two = one.clone();
    two.layers.push(SceneLayer { source: Some(1), world_from_volume: moved, ..two.layers[0].clone() });
    for (shown, by) in [(&one, "sorted"), (&two, "raycast"), (&one, "sorted"), (&two, "raycast")] {
        app.settle(&mut session, shown, SIZE, &whole(&view));
        // Many frames may have ended the trial.
        let by = if session.backend_line().contains(": raycast (") { "raycast" } else { by };
        assert_eq!(session.backend().map(|backend| backend.compositor()), Some(by));
    }
    let mut alone = Session::new(volumes(), SessionOptions { backend: BackendChoice::Gpu, live: false, ..options });
    let expected = alone.render(&two, SIZE).expect("a picture").picture;
    let found = rgb(&app.read(&texture));
    assert!(most(&found, &expected.rgb) <= 1, "{}", most(&found, &expected.rgb));
}

/// A flight, with pictures as large as a frame's budget makes felt, and little room for bricks: once it is under way nothing waits for
/// the GPU; and uploads keep to the staging memory that there is.
#[test]
fn nothing_waits_for_the_gpu() {
    let (Some(app), store) = (Application::new(), store()) else { return };
    let size = (400, 300);
    let texture = app.texture(FORMAT, size);
    let view = texture.create_view(&Default::default());
    let target = whole(&view);
    let mut session = app.session(&store, true);
    let frame = session.step(&scene(0.02, 0.0), size).expect("a step");
    app.draw(&mut session, &frame, &target);
    assert!(session.take_longest_gpu_wait().expect("a device") > Duration::ZERO, "slots are made, and waited for");
    for turn in 0..60 {
        let moving = Scene { pixel_error: 0.25, ..scene(0.02, 6.0 * turn as f64) };
        let frame = session.step(&moving, size).expect("a step");
        app.draw(&mut session, &frame, &target);
    }
    assert_eq!(session.take_longest_gpu_wait().expect("a device"), Duration::ZERO);
    // Who asks for pixels waits.
    let frame = session.step(&scene(0.02, 0.0), size).expect("a step");
    session.draw(&frame).expect("a picture");
    assert!(session.take_longest_gpu_wait().expect("a device") > Duration::ZERO);
}

#[test]
fn pixels_come_when_they_are_asked_for() {
    let (Some(app), store) = (Application::new(), store()) else { return };
    let texture = app.texture(FORMAT, SIZE);
    let view = texture.create_view(&Default::default());
    let target = whole(&view);
    let mut session = app.session(&store, true);
    app.settle(&mut session, &scene(0.5, 20.0), SIZE, &target);
    assert_eq!(session.picture().expect("a device"), None, "nobody has asked");
    assert!(session.read_back().expect("a device"));
    assert!(!session.read_back().expect("a device"), "one is on its way");
    let begun = Instant::now();
    let picture = loop {
        if let Some(picture) = session.picture().expect("a device") {
            break picture;
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "the pixels do not come");
    };
    assert_eq!(picture.rgb, rgb(&app.read(&texture)));
    // One that is on its way does not hinder a picture that is waited for.
    assert!(session.read_back().expect("a device"));
    let frame = session.step(&scene(0.5, 20.0), SIZE).expect("a step");
    assert!(session.draw(&frame).expect("drawn").difference(&picture).max <= 1);
    assert!(session.read_back().expect("a device"), "the later one counts");
    // A picture that is waited for is drawn over what is shown: the same frame is drawn again then.
    session.draw(&Quality { scale: 0.5, step: 2.0 }.frame(&frame)).expect("drawn");
    assert!(app.draw(&mut session, &frame, &target));
    assert!(most(&rgb(&app.read(&texture)), &picture.rgb) <= 1);
}

/// New slots keep the device, its compiled pipelines, and decoded bricks.
#[test]
fn scenes_that_ask_for_more_stay_on_the_device() {
    let (Some(app), store) = (Application::new(), store()) else { return };
    let texture = app.texture(FORMAT, SIZE);
    let view = texture.create_view(&Default::default());
    let target = whole(&view);
    let mut session = app.session(&store, true);
    let plain = scene(0.5, 20.0);
    let cubic = Scene { sampling: Sampling { filter: Filter::Tricubic, ..plain.sampling }, ..plain.clone() };
    let lit = Scene { lighting: Lighting { model: LightingModel::Phong, ..Lighting::default() }, ..plain.clone() };
    let mut decoded = 0;
    for scene in [plain.clone(), cubic, lit, Scene { mode: Mode::Mip, ..plain.clone() }, plain] {
        let frame = app.settle(&mut session, &scene, SIZE, &target);
        let found = rgb(&app.read(&texture));
        assert!(most(&found, &oracle(&store.store, &scene, SIZE).rgb) <= 2);
        let counters = frame.status.counters;
        assert!(decoded == 0 || counters.decoded == decoded, "{} decoded after {decoded}", counters.decoded);
        decoded = counters.decoded;
    }
}

/// It is an error of the next call and stays lost; with another device the session goes on, and decodes nothing again.
#[test]
fn a_lost_device_is_the_applications_to_make_anew() {
    let (Some(app), Some(next), store) = (Application::new(), Application::new(), store()) else { return };
    let (scene, texture) = (scene(0.5, 20.0), app.texture(FORMAT, SIZE));
    let view = texture.create_view(&Default::default());
    let mut session = app.session(&store, true);
    let settled = app.settle(&mut session, &scene, SIZE, &whole(&view));
    let expected = rgb(&app.read(&texture));
    app.device.destroy();
    let begun = Instant::now();
    let lost = loop {
        let drawn = session.step(&scene, SIZE).and_then(|frame| {
            let mut encoder = app.device.create_command_encoder(&Default::default());
            session.draw_to(&frame, &whole(&view), &mut encoder)
        });
        if let Err(error) = drawn {
            break error;
        }
        assert!(begun.elapsed() < Duration::from_secs(20), "the loss is never told");
    };
    assert!(matches!(lost, SessionError::Backend(BackendError::Gpu(GpuError::DeviceLost(_)))), "{lost}");
    assert!(session.step(&scene, SIZE).is_err() && session.device_losses() == 0, "it is not ours to make anew");

    session.set_gpu(next.gpu());
    let texture = next.texture(FORMAT, SIZE);
    let view = texture.create_view(&Default::default());
    let anew = next.settle(&mut session, &scene, SIZE, &whole(&view));
    assert!(most(&rgb(&next.read(&texture)), &expected) <= 1);
    assert_eq!(anew.status.counters.decoded, settled.status.counters.decoded);
}

/// Errors of a session's calls are returned, and never reach the application's handler.
#[test]
fn errors_are_the_calls_own() {
    let (Some(app), store) = (Application::new(), store()) else { return };
    let mut session = app.session(&store, true);
    let frame = session.step(&scene(0.5, 20.0), SIZE).expect("a step");
    let too_large = session.step(&scene(0.5, 20.0), (1 << 20, 64)).expect_err("no texture is so large");
    assert!(
        matches!(too_large, SessionError::Backend(BackendError::Gpu(GpuError::PictureTooLarge { .. }))),
        "{too_large}"
    );
    let texture = app.texture(FORMAT, SIZE);
    let view = texture.create_view(&Default::default());
    let mut encoder = app.device.create_command_encoder(&Default::default());
    let superseded = session.draw_to(&frame, &whole(&view), &mut encoder);
    assert!(superseded.is_err(), "the frame is of slots that are gone");
    // A depth format has no colours.
    let frame = app.show_next(&mut session, &scene(0.5, 20.0), &whole(&view));
    let (format, begun) = (TextureFormat::Depth32Float, Instant::now());
    let refused = loop {
        match session.draw_to(&frame, &Target { view: &view, format, area_px: None }, &mut encoder) {
            Ok(is_this) => assert!(!is_this && begun.elapsed() < Duration::from_secs(60), "drawn in a depth format"),
            Err(error) => break error,
        }
    };
    assert!(matches!(refused, SessionError::Backend(BackendError::Gpu(GpuError::Refused(_)))), "{refused}");
    assert_eq!(app.errors.load(Ordering::Relaxed), 0);
    // A session of its own has no texture of the application's to draw on.
    let mut own = Session::new(
        vec![VolumeSource::of_store(&store.store)],
        SessionOptions { backend: BackendChoice::Cpu, ..SessionOptions::default() },
    );
    let frame = own.step(&scene(0.5, 20.0), SIZE).expect("a step");
    let drawn = own.draw_to(&frame, &Target { view: &view, format, area_px: None }, &mut encoder);
    assert!(matches!(drawn, Err(SessionError::NoDevice)));
}

#[test]
fn a_device_that_lacks_what_shaders_need_is_refused_with_its_limits() {
    let Some(app) = Application::new() else { return };
    let mut wanted = Gpu::required(&app.adapter);
    wanted.required_limits.max_storage_buffers_per_shader_stage = 4;
    wanted.required_limits.max_texture_dimension_3d = 128;
    let (device, queue) = pollster::block_on(app.adapter.request_device(&wanted)).expect("a lesser device");
    let error = Gpu::from_device(&app.adapter, device, queue).expect_err("too little");
    let words = error.to_string();
    assert!(words.contains("max_storage_buffers_per_shader_stage is 4, at least 7 is needed"), "{words}");
    assert!(words.contains("max_texture_dimension_3d is 128"), "{words}");
}
