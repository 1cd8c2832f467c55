//! A window on volumes of any size: the picture of a live [session](brickyard::session) with panels beside it. The window's state is a scene, as for
//! `brickyard render --scene`; panels, keys, pointer and scripts edit it by the same commands.

mod canvas;
mod clicks;
mod clip_handles;
mod command;
mod device;
mod drag;
mod editing;
mod edits;
mod exporting;
mod fields;
mod file_browser;
mod guard;
mod handover;
mod history;
mod input_order;
mod keeping;
mod keys;
mod marks;
mod measuring;
mod messages;
mod navigation;
mod newest;
mod nothing;
mod opening;
mod overlay;
mod pacing;
mod paint;
mod panels;
mod part;
mod picking;
mod plane_handles;
mod plane_view;
mod planes;
mod play;
mod read_out;
mod recent;
mod running;
mod saving;
mod screen;
mod screenshots;
mod script;
mod state;
mod value_curve;
mod views;
mod volume_view;
mod window;
mod work_row;

use crate::command::Command;
use crate::keeping::Keeper;
pub use crate::keeping::volumes_of;
pub use crate::opening::Openings;
use crate::recent::Recent;
pub use crate::script::Script;
use crate::state::State;
use crate::views::Views;
use crate::window::Window;
use brickyard::scene_file::read_named_files;
use brickyard::session::{SessionOptions, VolumeSource, check};
use brickyard::volume::Scene;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Initial contents and settings of a window.
#[derive(Clone, Debug)]
pub struct WindowOptions {
    /// The first scene.
    pub scene: Scene,
    /// The file of the scene, if any; may hold settings of the window, too.
    pub scene_file: Option<PathBuf>,
    /// Whether to restore the window's last state on these volumes instead of showing the scene.
    pub restores: bool,
    /// The session's choices and limits. Pictures are drawn on the window's device, unless these choose the CPU, or leave the choice and that device
    /// is a software one.
    pub session: SessionOptions,
    /// The window's inner size in points: width and height.
    pub size: [f32; 2],
    /// Commands to play. A window that plays some is neither restored nor kept.
    pub script: Script,
    /// A file for a screenshot after the script, once the picture is final; then the window closes. `None` leaves it open.
    pub screenshot: Option<PathBuf>,
    /// Start of opening the volumes, and of the time to the first picture.
    pub opened: Instant,
    /// A JSON file for frame times, written when the window is closed.
    pub stats: Option<PathBuf>,
}

/// Failure to open or continue the window.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct WindowError(String);

/// Opens a window on volumes, and returns when it is closed. There must be a picture of each: see [`Openings::wait`]. Without volumes the window is
/// empty, for files to be opened in it.
///
/// # Errors
/// If there is no display, nothing can draw on it, or the device is unfit for the engine or lost without another one: the message contains advice. If
/// a command of the script fails: the message names its line.
pub fn run(openings: Openings, mut options: WindowOptions) -> Result<(), WindowError> {
    if let Some(path) = options.screenshot.take() {
        options.script.then(Command::Screenshot(path));
        options.script.then(Command::Quit);
    }
    let volumes = openings.volumes();
    let (state, keeper, problem) = first_state(&volumes, openings.paths(), &options).map_err(WindowError)?;
    let size = options.size;
    let views = Views::new(volumes, options.session).map_err(|error| WindowError(error.to_string()))?;
    let recent = Recent::read(keeping::state_folder().map(|folder| folder.join("recent.json")));
    let mut window = Window::new(state, views, openings, recent, keeper, problem, options);
    running::run(&mut window, size)?;
    window.failure().map_or(Ok(()), |failure| Err(WindowError(failure.into())))
}

pub(crate) fn title(paths: &[PathBuf]) -> String {
    let name = paths.first().and_then(|path| path.file_stem());
    name.map_or_else(String::new, |name| format!("{} - ", name.to_string_lossy())) + "brickyard"
}

/// A window's initial state, its keeper, and a message for the user.
fn first_state(
    volumes: &[VolumeSource],
    paths: Vec<PathBuf>,
    options: &WindowOptions,
) -> Result<(State, Keeper, Option<String>), String> {
    let is_kept = options.script.is_over();
    let file = keeping::file_of(&paths).filter(|_| is_kept);
    let known = file.as_deref().filter(|_| options.restores);
    let (restored, problem) = match known.map_or(Ok(None), |path| restored(path, volumes)) {
        Ok(restored) => (restored, None),
        Err(problem) => (None, Some(format!("the last window could not be restored: {problem}"))),
    };
    let window = options.scene_file.as_deref().map_or(Ok(None), keeping::read)?.map(|state| state.window);
    let mut state = restored.unwrap_or_else(|| State {
        scene: options.scene.clone(),
        window: window.unwrap_or_default(),
        ..State::default()
    });
    state.window.volumes = paths;
    let places: Vec<_> = volumes.iter().map(VolumeSource::place).collect();
    let size_px = (options.size[0] as u32, options.size[1] as u32);
    state.scene.camera = Some(state.scene.camera_for(&places, size_px).map_err(|error| error.to_string())?);
    let keeper = Keeper::new(file, &state);
    Ok((state, keeper, problem))
}

/// The last state of a window on these volumes; `None` the first time.
///
/// # Errors
/// If the state cannot be read, or cannot be shown any more.
fn restored(path: &Path, volumes: &[VolumeSource]) -> Result<Option<State>, String> {
    let Some(mut state) = keeping::read(path)? else { return Ok(None) };
    // Users who do not know the keys would miss the panels.
    (state.window.panels, state.window.fullscreen) = (true, false);
    read_named_files(&mut state.scene, volumes).map_err(|error| error.to_string())?;
    check(volumes, &state.scene).map_err(|error| error.to_string())?;
    Ok(Some(state))
}
