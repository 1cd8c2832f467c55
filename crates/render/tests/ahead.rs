//! Pipelines compiled ahead: drawing meanwhile, and the end of the device or the renderer.

mod bricks;

use bricks::{Bricks, COMPOSITORS, MEMORY_BYTES, transfer};
use brickyard_pager::{DrawList, Layer, VolumeNeeds};
use brickyard_render::{Compositor, GpuError, GpuOptions, GpuRenderer};
use brickyard_volume::*;
use std::time::{Duration, Instant};

const LAYERS: usize = 3;

/// Three layers of the same volume, all its bricks, and a renderer.
struct Stage {
    bricks: Bricks,
    renderer: GpuRenderer,
    draw: DrawList,
}

impl Stage {
    /// `None`, with a loud message, without any adapter.
    fn new(compositor: Compositor) -> Option<Self> {
        let bricks = Bricks::new();
        let mut renderer = bricks.renderer(compositor, LAYERS)?;
        let draw = bricks.upload(&mut renderer);
        Some(Self { bricks, renderer, draw })
    }

    /// A look of all three layers, by a method and with light or without.
    fn look(&self, method: Method, model: LightingModel) -> Vec<VolumeFrame> {
        let frame = |i: usize| {
            let plain = self.bricks.frame(&transfer(0.4 * i as f64));
            let sampling = Sampling { method, ..Sampling::default() };
            VolumeFrame::alone(FrameSettings { sampling, lighting: Lighting { model, ..Lighting::default() }, ..plain })
        };
        (0..LAYERS).map(frame).collect()
    }

    fn with<T>(&mut self, frames: &[VolumeFrame], f: impl FnOnce(&mut GpuRenderer, &[Layer<'_>]) -> T) -> T {
        f(&mut self.renderer, &self.bricks.layers(frames, &self.draw))
    }

    fn render(&mut self, frames: &[VolumeFrame]) -> Result<Picture, GpuError> {
        self.with(frames, |renderer, layers| renderer.render(layers, None))
    }

    fn prepare(&mut self, frames: &[VolumeFrame]) {
        self.with(frames, |renderer, layers| renderer.prepare(layers, None));
    }

    fn is_prepared(&mut self, frames: &[VolumeFrame]) -> bool {
        self.with(frames, |renderer, layers| renderer.is_prepared(layers, None))
    }
}

#[test]
fn the_old_look_is_drawn_until_the_new_one_is_made() {
    for compositor in COMPOSITORS {
        let Some(mut stage) = Stage::new(compositor) else { return };
        let [old, new, other] = [
            stage.look(Method::Udvr, LightingModel::None),
            stage.look(Method::Lvs, LightingModel::Phong),
            stage.look(Method::Udvr, LightingModel::Tone),
        ];
        let first = stage.render(&old).expect("a picture");
        assert!(stage.is_prepared(&old) && !stage.is_prepared(&new));
        // Of two requests at once the thread serves the newer one.
        stage.prepare(&other);
        stage.prepare(&new);
        let (begun, mut frames) = (Instant::now(), Vec::new());
        while !stage.is_prepared(&new) {
            let frame = Instant::now();
            assert_eq!(stage.render(&old).expect("a picture"), first);
            frames.push(frame.elapsed());
            assert!(begun.elapsed() < Duration::from_secs(120), "a pipeline takes seconds");
        }
        let (made, drawing) = (begun.elapsed(), Instant::now());
        let picture = stage.render(&new).expect("a picture");
        let (drawn, longest) = (drawing.elapsed(), frames.iter().max().copied().unwrap_or_default());
        let Some(mut fresh) = Stage::new(compositor) else { return };
        let drawing = Instant::now();
        let at_once = fresh.render(&new).expect("a picture");
        eprintln!(
            "{compositor:?}: made ahead in {made:?}, meanwhile {} frames of at most {longest:?}, then one of {drawn:?}; at once {:?}",
            frames.len(),
            drawing.elapsed()
        );
        assert_eq!(picture, at_once);
        assert_ne!(picture, first);
        assert!(!stage.is_prepared(&stage.look(Method::Cvs, LightingModel::None)), "it was not asked for");
    }
}

#[test]
fn a_device_may_go_while_a_thread_makes_something_for_it() {
    let Some(mut stage) = Stage::new(Compositor::Raycast) else { return };
    let (old, new) = (stage.look(Method::Udvr, LightingModel::None), stage.look(Method::Cvs, LightingModel::Phong));
    let first = stage.render(&old).expect("a picture");
    stage.prepare(&new);
    stage.renderer.destroy_device();
    for frames in [&old, &new] {
        assert!(matches!(stage.render(frames), Err(GpuError::DeviceLost(_))));
    }
    stage.prepare(&new);
    stage.renderer.renew().expect("another device");
    stage.draw = stage.bricks.upload(&mut stage.renderer);
    assert!(!stage.is_prepared(&new), "what was made for the old device is gone");
    assert_eq!(stage.render(&old).expect("a picture"), first);
    // Drawn before it is compiled ahead.
    stage.prepare(&new);
    assert_ne!(stage.render(&new).expect("a picture"), first);
    assert!(stage.is_prepared(&new));
    // And the renderer may go.
    let last = stage.look(Method::Asm, LightingModel::Tone);
    stage.prepare(&last);
}

/// A renderer of larger pictures on the same device inherits the compiled pipelines, and one of stored gradients does
/// not.
#[test]
fn what_is_compiled_serves_the_next_renderer_of_the_device() {
    for compositor in COMPOSITORS {
        let Some(mut stage) = Stage::new(compositor) else { return };
        let look = stage.look(Method::Udvr, LightingModel::Phong);
        let first = stage.render(&look).expect("a picture");
        let Stage { bricks, renderer, .. } = stage;
        let options = GpuOptions { compositor, ..GpuOptions::default() };
        let on = |compiled, needs| {
            GpuRenderer::on(compiled, &options, &[needs; LAYERS], MEMORY_BYTES, (100, 80)).expect("room")
        };
        let mut renderer = on(renderer.into_compiled(false).expect("the device is there"), bricks.needs);
        let draw = bricks.upload(&mut renderer);
        let mut stage = Stage { bricks: Bricks::new(), renderer, draw };
        assert!(stage.is_prepared(&look));
        assert_eq!(stage.render(&look).expect("a picture"), first);
        let with_gradients = Needs { gradient_layers: 1, ..stage.bricks.needs.bricks };
        let needs = VolumeNeeds { bricks: with_gradients, ..stage.bricks.needs };
        let renderer = on(stage.renderer.into_compiled(false).expect("the device is there"), needs);
        assert!(!Stage { renderer, ..stage }.is_prepared(&look), "its shaders see other textures");
    }
}

#[test]
fn what_cannot_be_drawn_says_so_when_it_is() {
    let Some(mut stage) = Stage::new(Compositor::Raycast) else { return };
    let mut frames = stage.look(Method::Udvr, LightingModel::None);
    frames[0].settings.rays.width = 1000;
    stage.prepare(&frames);
    assert!(stage.is_prepared(&frames), "there is nothing to wait for");
    assert!(matches!(stage.render(&frames), Err(GpuError::PictureTooLarge { .. })));
}
