//! Playing time steps: every frame of a playing, jumping and turning session shows one whole step, namely the reported one; layers of different steps
//! are shown by their times; playback stays within its budgets.

use brickyard::backend::{BackendChoice, CompositorChoice};
use brickyard::pager::{BrickError, BrickSource, Ending, Playback, Policy};
use brickyard::session::{Frame, Session, SessionOptions, VolumeSource};
use brickyard::volume::{
    Blend, BrickId, Camera, Extent, Filter, Geometry, Mode, Picture, Projection, Pyramid, Scene, SceneLayer, Stereo,
    StereoLayout, TimeAxis, VoxelType,
};
use brickyard_tests::{Random, open_session_of, options};
use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

const SIZE: (u32, u32) = (64, 64);
const STEPS: u32 = 60;
const EXTENT: Extent = Extent::new(48, 48, 48);

/// Frames per way to draw and number of channels; `BRICKYARD_PLAYED_FRAMES` overrides it.
fn frames() -> u32 {
    std::env::var("BRICKYARD_PLAYED_FRAMES").map_or(300, |text| text.parse().expect("a number of frames"))
}

/// Steps with a uniform value, a code of the step's number per channel; bricks take a given time.
struct Coded {
    pyramid: Pyramid,
    geometry: Geometry,
    steps: u32,
    channels: u32,
    /// The longest time of a brick, in microseconds.
    longest_us: u64,
    reads: AtomicU64,
    /// Steps without readable bricks.
    damaged: Range<u32>,
}

fn code(step: u32, channel: u32) -> u8 {
    [4 * step + 8, 250 - 4 * step, 20 + step * 37 % 200][channel as usize] as u8
}

impl Coded {
    fn new(steps: u32, channels: u32, longest_us: u64) -> Arc<Self> {
        let pyramid = Pyramid::new(EXTENT, [1.0; 3], 16);
        let reads = AtomicU64::new(0);
        Arc::new(Self { pyramid, geometry: Geometry::default(), steps, channels, longest_us, reads, damaged: 0..0 })
    }
}

impl BrickSource for Coded {
    fn pyramid(&self) -> &Pyramid {
        &self.pyramid
    }
    fn geometry(&self) -> &Geometry {
        &self.geometry
    }
    fn voxel_type(&self) -> VoxelType {
        VoxelType::U8
    }
    fn value_range(&self) -> (f64, f64) {
        (0.0, 255.0)
    }
    fn times(&self) -> u32 {
        self.steps
    }
    fn channels(&self) -> u32 {
        self.channels
    }
    fn read_core(&self, id: BrickId, out: &mut [u8]) -> Result<(), BrickError> {
        let number = self.reads.fetch_add(1, Ordering::Relaxed);
        std::thread::sleep(Duration::from_micros(number.wrapping_mul(7919) % self.longest_us));
        if self.damaged.contains(&id.time) {
            return Err(BrickError { id, reason: "damaged".into(), is_passing: false });
        }
        out.fill(code(id.time, id.channel));
        Ok(())
    }
}

/// A layer of a channel, additive, in red, green or blue, or alone in gray.
fn layer(source: usize, channel: u32, color: [f64; 3]) -> SceneLayer {
    let window = Some([0.0, 255.0]);
    SceneLayer {
        source: Some(source),
        channel,
        color: Some(color),
        window,
        blend: Some(Blend::Add),
        ..SceneLayer::default()
    }
}

fn scene(channels: u32) -> Scene {
    let layers = match channels {
        1 => vec![layer(0, 0, [1.0; 3])],
        _ => (0..3).map(|c| layer(0, c, std::array::from_fn(|i| (i == c as usize) as u8 as f64))).collect(),
    };
    Scene { mode: Mode::Mip, layers, camera: Some(camera(0.0)), ..Scene::default() }
}

/// A camera turned about the volume, which always fills its picture.
fn camera(turn_deg: f64) -> Camera {
    let inside = Camera::looking_at_box(Geometry::default().world_box(EXTENT)).orbited(turn_deg);
    Camera { projection: Projection::Orthographic { height: 30.0 }, ..inside }
}

/// Asserts that every pixel shows the frame's step.
fn assert_one_step(session: &mut Session, frame: &Frame, channels: u32) {
    let picture = session.draw(frame).expect("it draws");
    let expected: [u8; 3] = std::array::from_fn(|i| code(frame.scene.time, if channels == 1 { 0 } else { i as u32 }));
    for (i, pixel) in picture.rgb.iter().enumerate() {
        // A code's colour is rounded twice, in the table and in the picture.
        let is_it = pixel.iter().zip(expected).all(|(found, code)| found.abs_diff(code) <= 1);
        assert!(is_it, "pixel {i} is {pixel:?}, step {} is {expected:?}", frame.scene.time);
    }
}

fn live(gpu_memory_bytes: u64, backend: BackendChoice) -> SessionOptions {
    SessionOptions { live: true, ..options((backend, CompositorChoice::Auto), gpu_memory_bytes, 64 << 20) }
}

#[test]
fn no_picture_mixes_steps_or_has_a_hole() {
    for (backend, channels) in [BackendChoice::Cpu, BackendChoice::Gpu].into_iter().flat_map(|b| [(b, 1), (b, 3)]) {
        let source = Coded::new(STEPS, channels, 2000);
        let volume = VolumeSource::new(source);
        // Little memory: levels drop, or it holds only some steps.
        let Some(mut session) = open_session_of(vec![volume], live(24 << 20, backend)) else { continue };
        let mut dice = Random(7 + u64::from(channels));
        let mut scene = scene(channels);
        let mut frame = session.step(&scene, SIZE).unwrap();
        while !frame.status.covered {
            session.wait(Duration::from_millis(50));
            frame = session.step(&scene, SIZE).unwrap();
        }
        let mut shown = std::collections::BTreeSet::new();
        for _ in 0..frames() {
            match dice.bits() % 40 {
                0 => scene.time = (dice.bits() % u64::from(STEPS)) as u32,
                1 => session.play(None),
                2..=4 => session.play(Some(playback(&mut dice))),
                5 => scene.camera = Some(camera(360.0 * dice.unit())),
                _ => {}
            }
            if dice.bits().is_multiple_of(2) {
                session.wait(Duration::from_millis(dice.bits() % 20));
            }
            frame = session.step(&scene, SIZE).unwrap();
            assert!(frame.status.covered, "{:?}", frame.status);
            assert_one_step(&mut session, &frame, channels);
            shown.insert(frame.scene.time);
        }
        assert!(shown.len() > 10, "{backend:?}: only {shown:?}");
        // It comes to rest at the latest request, as fine as possible.
        session.play(None);
        // Only a step other than the latest request is a jump.
        let after = |steps: u32| (frame.scene.time + steps) % STEPS;
        scene.time = if after(7) == scene.time { after(8) } else { after(7) };
        let frame = until(&mut session, &scene, |frame| frame.status.settled);
        assert_eq!(frame.scene.time, scene.time);
        assert_one_step(&mut session, &frame, channels);
    }
}

/// Two volumes of this many steps, without common slots.
fn growing(steps: u32) -> Vec<VolumeSource> {
    let slow = Coded::new(steps, 3, 6000);
    let slow =
        Coded { pyramid: Pyramid::new(EXTENT, [1.0; 3], 32), ..Arc::into_inner(slow).expect("nobody else has it") };
    vec![VolumeSource::new(Coded::new(steps, 3, 2000)), VolumeSource::new(Arc::new(slow))]
}

/// This many layers of both volumes, each in its own colour.
fn coloured(count: usize) -> Vec<SceneLayer> {
    let axis = |i: usize| std::array::from_fn(|c| f64::from(u8::from(c == i)));
    (0..count).map(|i| layer(i % 2, i as u32, axis(i))).collect()
}

/// Randomly changes a session or its scene, of `steps` steps, so that slots, pagers or volumes are recreated, or bricks are missing.
fn change(session: &mut Session, scene: &mut Scene, (steps, size): (&mut u32, &mut (u32, u32)), dice: &mut Random) {
    let number = dice.bits();
    match dice.bits() % 24 {
        0 | 1 => {
            *steps += 1;
            session.set_volumes(growing(*steps));
        }
        2 => drop(session.set_budgets((32 + number % 32) << 20, (32 + number % 32) << 20)),
        3 => scene.layers = coloured(1 + number as usize % 3),
        4 => scene.layers[0].channel = (number % 3) as u32,
        5 => scene.sampling.filter = [Filter::Trilinear, Filter::Tricubic][number as usize % 2],
        6 => scene.stereo = [None, Some(Stereo::new(StereoLayout::SideBySide))][number as usize % 2],
        7 => *size = [SIZE, (64, 300)][number as usize % 2],
        8 => scene.time = (number % u64::from(*steps)) as u32,
        9 => session.play([None, Some(playback(dice))][number as usize % 2]),
        10 => scene.camera = Some(camera(360.0 * dice.unit())),
        // Consecutive losses are an error.
        11 if number.is_multiple_of(3) => session.backend().into_iter().for_each(|backend| backend.destroy_device()),
        _ => {}
    }
}

/// Asserts that every pixel shows the steps of the reported frame, of all its layers.
fn assert_whole(session: &Session, picture: &Picture, what: &str) {
    let scene = &session.shown().expect("a picture was drawn").scene;
    let mut expected = [0; 3];
    scene.layers.iter().for_each(|layer| expected[layer.place] = code(layer.view.time, layer.view.channel));
    for (i, pixel) in picture.rgb.iter().enumerate() {
        let is_it = pixel.iter().zip(expected).all(|(found, code)| found.abs_diff(code) <= 1);
        assert!(is_it, "{what}: pixel {i} is {pixel:?}, expected {expected:?}");
    }
}

/// Through all changes of a live session's volumes, slots and looks, the previous picture stays until the next one has something in every place: of
/// all layers, for both eyes.
#[test]
fn no_change_shows_a_hole() {
    for backend in [BackendChoice::Cpu, BackendChoice::Gpu] {
        let (mut steps, mut size, mut dice) = (12, SIZE, Random(11));
        let Some(mut session) = open_session_of(growing(steps), live(48 << 20, backend)) else { continue };
        let mut scene = Scene { layers: coloured(2), ..scene(1) };
        let first = until(&mut session, &scene, |frame| frame.status.covered);
        session.draw(&first).unwrap();
        let mut held = 0;
        for i in 0..frames() {
            change(&mut session, &mut scene, (&mut steps, &mut size), &mut dice);
            if dice.bits().is_multiple_of(2) {
                session.wait(Duration::from_millis(dice.bits() % 20));
            }
            let frame = session.step(&scene, size).unwrap();
            let picture = session.draw(&frame).unwrap();
            assert_whole(&session, &picture, &format!("{backend:?}, frame {i}"));
            held += u32::from(session.shows_before(&frame));
        }
        assert!(steps > 15 && held > 10, "{backend:?}: {steps} steps, {held} frames");
        // It comes to rest at the latest request.
        session.play(None);
        scene.time = if scene.time == 0 { 1 } else { 0 };
        let frame = until(&mut session, &scene, |frame| frame.status.settled);
        let picture = session.draw(&frame).unwrap();
        assert_whole(&session, &picture, "at rest");
        assert_eq!(session.shown().map(|shown| shown.scene.time), Some(scene.time));
    }
}

fn playback(dice: &mut Random) -> Playback {
    let of = |n: u64, dice: &mut Random| (dice.bits() % n) as usize;
    Playback {
        steps_per_second: [5.0, 20.0, 100.0, 500.0][of(4, dice)],
        is_backward: of(2, dice) == 1,
        ending: [Ending::Stop, Ending::Loop, Ending::Bounce][of(3, dice)],
        policy: [Policy::HoldRate, Policy::HoldQuality, Policy::EveryStep][of(3, dice)],
    }
}

fn until(session: &mut Session, scene: &Scene, done: impl Fn(&Frame) -> bool) -> Frame {
    let deadline = Instant::now() + Duration::from_secs(60);
    loop {
        let frame = session.step(scene, SIZE).unwrap();
        if done(&frame) {
            return frame;
        }
        assert!(Instant::now() < deadline, "{:?}, {:?}", frame.status, frame.coming);
        if frame.status.awaits_feedback {
            session.draw(&frame).unwrap();
        } else {
            session.wait(Duration::from_millis(50));
        }
    }
}

#[test]
fn every_step_is_played_in_order_and_whole() {
    let volume = VolumeSource::new(Coded::new(STEPS, 1, 1000));
    let mut session = open_session_of(vec![volume], live(64 << 20, BackendChoice::Cpu)).unwrap();
    let scene = scene(1);
    let first = until(&mut session, &scene, |frame| frame.status.covered);
    let policy = Policy::EveryStep;
    session.play(Some(Playback { steps_per_second: 1000.0, policy, ending: Ending::Stop, ..Playback::default() }));
    let mut shown = vec![first.scene.time];
    while *shown.last().unwrap() < STEPS - 1 {
        let last = *shown.last().unwrap();
        let frame = until(&mut session, &scene, |frame| frame.scene.time != last);
        // At the view's level.
        let status = &frame.status;
        assert!(status.resident == status.wanted && status.effective_error_px <= 1.0, "{status:?}, {:?}", frame.coming);
        shown.push(frame.scene.time);
    }
    assert!(shown.iter().copied().eq(0..STEPS), "{shown:?}");
    let tally = session.playback_tally();
    assert_eq!((tally.shown, tally.dropped), (u64::from(STEPS) - 1, 0));
    // There it ends.
    until(&mut session, &scene, |frame| frame.status.settled);
    assert_eq!((session.playback(), session.next_due()), (None, None));
}

/// Steps without even a readable coarsest level are errors while shown, and nothing worse, even if there are more of them than are planned ahead.
#[test]
fn steps_that_cannot_be_read_are_said_and_played_past() {
    for policy in [Policy::HoldRate, Policy::HoldQuality, Policy::EveryStep] {
        let (steps, damaged) = (24, 5..17);
        let source = Coded::new(steps, 1, 3000);
        let source = Coded { damaged: damaged.clone(), ..Arc::into_inner(source).expect("nobody else has it") };
        let mut session =
            open_session_of(vec![VolumeSource::new(Arc::new(source))], live(64 << 20, BackendChoice::Cpu)).unwrap();
        let scene = scene(1);
        until(&mut session, &scene, |frame| frame.status.settled);
        session.play(Some(Playback { steps_per_second: 50.0, policy, ending: Ending::Stop, ..Playback::default() }));
        let (mut shown, mut errors) = (0, 0);
        let deadline = Instant::now() + Duration::from_secs(20);
        while shown < steps - 1 {
            assert!(Instant::now() < deadline, "{policy:?}: it stays at step {shown}, after {errors} errors");
            match session.step(&scene, SIZE) {
                Ok(frame) => {
                    assert!(frame.status.covered, "{policy:?}: {:?}", frame.status);
                    assert_one_step(&mut session, &frame, 1);
                    assert!(!damaged.contains(&frame.scene.time), "{policy:?}: {}", frame.scene.time);
                    shown = frame.scene.time;
                }
                Err(error) => {
                    assert!(error.to_string().contains("damaged") && shown < damaged.start, "{policy:?}: {error}");
                    errors += 1;
                }
            }
            session.wait(Duration::from_millis(20));
        }
        assert!(errors > 0 || policy != Policy::EveryStep, "{policy:?}");
    }
}

#[test]
fn volumes_of_unlike_steps_are_shown_by_their_times() {
    let axis = |step: f64, unit: &str| TimeAxis { step, unit: Some(unit.into()), ..TimeAxis::default() };
    let fast = VolumeSource::new(Coded::new(12, 1, 100)).taken_at(axis(500.0, "millisecond"));
    let slow = VolumeSource::new(Coded::new(4, 1, 100)).taken_at(axis(2.0, "second"));
    for is_live in [false, true] {
        let options = SessionOptions { live: is_live, ..live(64 << 20, BackendChoice::Cpu) };
        let mut session = open_session_of(vec![fast.clone(), slow.clone()], options).unwrap();
        let layers = vec![layer(0, 0, [1.0, 0.0, 0.0]), layer(1, 0, [0.0, 1.0, 0.0])];
        for time in [0, 3, 4, 11, 8] {
            let scene = Scene { time, ..Scene { layers: layers.clone(), ..scene(1) } };
            let frame = until(&mut session, &scene, |frame| frame.status.settled);
            let picture = session.draw(&frame).unwrap();
            let expected = [code(time, 0), code(time / 4, 0)];
            let middle = picture.rgb[32 * 64 + 32];
            assert!(middle.iter().zip(expected).all(|(found, code)| found.abs_diff(code) <= 1), "{time}: {middle:?}");
        }
        let beyond = Scene { time: 12, layers: layers.clone(), ..scene(1) };
        assert!(session.step(&beyond, SIZE).unwrap_err().to_string().contains("the store has 12"));
    }
}
