//! A window on volumes of any size: the picture of a live [session](brickyard::session) with panels beside it. The window's state is a scene, the one that
//! `brickyard render --scene` takes; panels, keys, pointer and scripts edit it by the same commands.

mod canvas;
mod command;
mod edits;
mod history;
mod navigation;
mod overlay;
mod panels;
mod picking;
mod screenshots;
mod script;
mod window;

use crate::canvas::Canvas;
use crate::command::Command;
pub use crate::script::Script;
use crate::window::Window;
use brickyard::render::Gpu;
use brickyard::session::{SessionOptions, VolumeSource};
use brickyard::volume::Scene;
use eframe::egui::ViewportBuilder;
use eframe::egui_wgpu::{WgpuConfiguration, WgpuSetup, WgpuSetupCreateNew};
use std::path::PathBuf;
use std::sync::Arc;

/// What a window shows at first, and what becomes of it.
#[derive(Clone, Debug)]
pub struct WindowOptions {
    /// The scene that is shown first.
    pub scene: Scene,
    /// The session's choices and limits. Its pictures are drawn on the window's own device unless they say the CPU, or leave the choice and that device is a
    /// software one.
    pub session: SessionOptions,
    /// The window's inner size in points: width and height.
    pub size: [f32; 2],
    /// Commands to play.
    pub script: Script,
    /// A file for what the window shows once the script is over and the picture is final; the window closes then. `None` leaves it open.
    pub screenshot: Option<PathBuf>,
}

/// The window could not be opened, or could not go on.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct WindowError(String);

/// Opens a window on volumes, and returns when it is closed.
///
/// # Errors
/// If there is no display, nothing that can draw on it, or the device lacks what the engine needs. The message says what to do.
pub fn run(volumes: Vec<VolumeSource>, options: WindowOptions) -> Result<(), WindowError> {
    let WindowOptions { mut scene, session, size, mut script, screenshot } = options;
    if let Some(path) = screenshot {
        script.then(Command::Screenshot(path));
        script.then(Command::Quit);
    }
    let setup = WgpuSetupCreateNew {
        device_descriptor: Arc::new(Gpu::required),
        ..WgpuSetupCreateNew::without_display_handle()
    };
    let names = volumes.iter().filter_map(|volume| Some(volume.store()?.path().file_stem()?.to_string_lossy()));
    let title = names.map(|name| format!("{name} - ")).next().unwrap_or_default() + "brickyard";
    let native = eframe::NativeOptions {
        viewport: ViewportBuilder::default().with_inner_size(size).with_title(title).with_app_id("brickyard"),
        wgpu_options: WgpuConfiguration { wgpu_setup: WgpuSetup::CreateNew(setup), ..WgpuConfiguration::default() },
        // Pixels of the picture are shown as they are.
        dithering: false,
        ..eframe::NativeOptions::default()
    };
    let places: Vec<_> = volumes.iter().map(VolumeSource::place).collect();
    let camera = scene.camera_for(&places, (size[0] as u32, size[1] as u32));
    scene.camera = Some(camera.map_err(|error| WindowError(error.to_string()))?);
    let opened = eframe::run_native(
        "brickyard",
        native,
        Box::new(move |creation| {
            let state = creation.wgpu_render_state.as_ref().ok_or("the window is not drawn with wgpu")?;
            let canvas = Canvas::new(volumes.clone(), &session, state)?;
            Ok(Box::new(Window::new(scene, volumes, canvas, script)))
        }),
    );
    opened.map_err(|error| WindowError(refusal(&error)))
}

/// What to tell a user whose window does not open.
fn refusal(error: &eframe::Error) -> String {
    let hint = match error {
        eframe::Error::Winit(_) | eframe::Error::WinitEventLoop(_) => {
            "is there a display? `brickyard render` writes pictures without one"
        }
        eframe::Error::Wgpu(_) => {
            "no Vulkan, Metal or DirectX 12 draws on this display; mesa's software Vulkan (lavapipe) will do"
        }
        eframe::Error::AppCreation(_) => "`brickyard doctor` says what this machine can do",
    };
    format!("cannot open a window: {error}: {hint}")
}
