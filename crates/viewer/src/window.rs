//! The window: its state and everything that happens to it. Each frame collects the commands of script, keys, pointer and panels, performs them, and
//! brings the pictures closer to the state. Nothing is drawn while nothing changes.

mod files;

use crate::canvas::STREAMING_STEP;
use crate::command::{Command, Placing};
use crate::device::Device;
use crate::editing::Editing;
use crate::edits::{changes, edited};
use crate::exporting::Exporting;
use crate::handover::Handover;
use crate::history::History;
use crate::input_order::InputOrder;
use crate::keeping::{self, Keeper};
use crate::marks::{self, Marks, Over};
use crate::measuring::Measuring;
use crate::messages::{About, Messages};
use crate::navigation::moved;
use crate::opening::Openings;
use crate::pacing::Pacing;
use crate::panels;
use crate::panels::dialogs::{Dialog, DialogKind};
use crate::picking::Picked;
use crate::plane_view::PlaneView;
use crate::planes::Grid;
use crate::play::Play;
use crate::recent::Recent;
use crate::saving::Saving;
use crate::screenshots::Screenshots;
use crate::script::{Line, Script};
use crate::state::{Budgets, Layout, State, Theme, is_navigation};
use crate::value_curve::{CurveReader, ValueCurve};
use crate::views::Views;
use crate::volume_view::{Seen, VolumeView};
use crate::window::files::Next;
use crate::{WindowOptions, clicks::Clicks, keys, work_row};
use brickyard::overlay::{World, axis_units, unit};
use brickyard::session::{SessionError, VolumeSource};
use brickyard::unlike_sizes::unlike_sizes;
use brickyard::volume::Scene;
use brickyard::volume::scene::VolumePlace;
use eframe::egui::layers::GraphicLayers;
use eframe::egui::{self, Align2, Rect, TextWrapMode, Ui, UiBuilder, ViewportCommand, vec2};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Interval between checks on files being read or packed.
const OPENING_STEP: Duration = Duration::from_millis(100);
/// Interval at which a resting window checks stores for more time steps.
const FOLLOWING_STEP: Duration = Duration::from_secs(1);

/// Interval between retries after a failure: a disk may come back.
const FAILING_STEP: Duration = Duration::from_secs(1);

/// Longest wait of a script for a picture that cannot be drawn.
const HOPELESS: Duration = Duration::from_secs(5);

/// Distance of rows about background work from the pictures' lower end, where scale bars are, and their largest width, in points.
const WORK_ABOVE: f32 = 44.0;
const WORK_WIDTH: f32 = 420.0;

/// Largest share of the window's width for the panel beside the pictures.
const MOST_OF_WIDTH: f32 = 2.0 / 3.0;

/// Space between the pictures of a window, in points.
const GAP: f32 = 3.0;

/// The window: its document, its pictures, and everything beside them.
pub(crate) struct Window {
    state: State,
    history: History,
    views: Views,
    volume_view: VolumeView,
    plane_views: [PlaneView; 3],
    measuring: Measuring,
    curves: CurveReader,
    /// The last volume and voxel under the pointer.
    pointed: Option<(usize, [u32; 3])>,
    script: Script,
    /// The reason for the script's failure, if any.
    failure: Option<String>,
    keeper: Keeper,
    /// The shown volumes, and their progress.
    openings: Openings,
    /// Volumes to be shown instead of them or beside them.
    next: Option<Next>,
    exporting: Option<Exporting>,
    editing: Option<Editing>,
    /// Pictures being written, in their order of arrival.
    saving: Vec<Saving>,
    recent: Recent,
    dialog: Option<Dialog>,
    messages: Messages,
    /// Whether fullscreen was requested of the display.
    is_fullscreen: bool,
    started: Option<Instant>,
    screenshots: Screenshots,
    clicks: Clicks,
    order: InputOrder,
    pacing: Pacing,
    /// Start of opening the volumes.
    opened: Instant,
    /// A file for frame times; `None` writes none.
    stats: Option<PathBuf>,
    /// The handover, once the device is lost.
    left: Option<Handover>,
}

impl Window {
    /// Creates a window with a state. `message` is its first problem.
    pub(crate) fn new(
        state: State,
        views: Views,
        openings: Openings,
        mut recent: Recent,
        keeper: Keeper,
        message: Option<String>,
        options: WindowOptions,
    ) -> Self {
        let WindowOptions { script, opened, stats, .. } = options;
        // A window that plays a script leaves no trace.
        let paths = if script.is_over() { openings.paths() } else { Vec::new() };
        let noted = paths.iter().try_for_each(|path| recent.add(path));
        let mut messages = Messages::default();
        match message.or(noted.err()) {
            Some(message) => messages.say(About::Work, message),
            None => messages.warn(warning(&state.scene, views.volumes())),
        }
        let mut window = Self {
            openings,
            next: None,
            exporting: None,
            editing: None,
            saving: Vec::new(),
            recent,
            dialog: None,
            state,
            history: History::default(),
            views,
            volume_view: VolumeView::default(),
            plane_views: [0, 1, 2].map(PlaneView::across),
            measuring: Measuring::default(),
            curves: CurveReader::default(),
            pointed: None,
            script,
            failure: None,
            keeper,
            messages,
            is_fullscreen: false,
            started: None,
            screenshots: Screenshots::default(),
            clicks: Clicks::default(),
            order: InputOrder::default(),
            pacing: Pacing::default(),
            opened,
            stats,
            left: None,
        };
        if window.openings.are_none() {
            window.show_dialog(DialogKind::Open(Placing::Instead));
        }
        window
    }

    fn places(&self) -> Vec<VolumePlace> {
        self.views.volumes().iter().map(VolumeSource::place).collect()
    }

    /// Performs a command, and shows any problem with it.
    fn perform(&mut self, command: &Command, egui: &egui::Context) {
        tracing::debug!("{command}");
        self.messages.forget_note();
        if let Err(problem) = self.try_perform(command, egui) {
            if matches!(command, Command::Undo | Command::Redo) {
                return self.messages.remark(problem);
            }
            let is_work = command.takes_time() || command.file().is_some();
            let about = if is_work { About::Work } else { About::Scene };
            self.messages.say(about, command.failure(&problem));
        }
    }

    fn perform_line(&mut self, line: &Line, egui: &egui::Context) {
        tracing::debug!("{}", line.command);
        let done = self.try_perform(&line.command, egui);
        // Meshes alone are there at once.
        if done.is_err() || line.command.opens() && self.next.is_none() {
            self.script.ended(|command| *command == line.command);
        }
        if let Err(problem) = done {
            self.fail(line, &problem);
        }
    }

    /// Ends the script after its line has failed. The caller gets the failure when the window is closed.
    fn fail(&mut self, line: &Line, problem: &str) {
        let problem = line.failure(problem);
        self.script.stop();
        self.messages.say(About::Work, problem.clone());
        self.failure.get_or_insert(problem);
    }

    /// Shows why a picture cannot be drawn, until one can. A script waiting for it fails.
    fn take_failure(&mut self, drawn: Result<(), SessionError>) {
        match drawn {
            Ok(()) if self.views.are_failing() => {}
            Ok(()) => self.messages.end_failing(),
            Err(error) => self.messages.say_failing(error.to_string()),
        }
        if let Some((_, problem)) = self.messages.failing().filter(|(since, _)| *since > HOPELESS)
            && let Some(line) = self.script.waiting().cloned()
        {
            let problem = problem.to_string();
            self.fail(&line, &problem);
        }
    }

    /// Shows the result of work started by a command, unless it was stopped by hand.
    fn say_ended(&mut self, is_it: impl Fn(&Command) -> bool, ended: Result<String, String>, is_stopped: bool) {
        match (self.script.ended(is_it), ended) {
            (_, Ok(done)) => self.messages.note_done(done),
            (Some(line), Err(problem)) => self.fail(&line, &problem),
            (None, Err(problem)) if is_stopped => self.messages.remark(problem),
            (None, Err(problem)) => self.messages.say(About::Work, problem),
        }
    }

    fn try_perform(&mut self, command: &Command, egui: &egui::Context) -> Result<(), String> {
        match command {
            Command::Set(fields) => self.set(fields)?,
            Command::Clip(is_on) => {
                let whole = self.state.scene.world_box(&self.places()).map_err(|error| error.to_string())?;
                self.set(&[("clip".into(), if *is_on { json!([whole.0, whole.1]) } else { Value::Null })])?;
            }
            Command::Undo => self.history.undo(&mut self.state).then_some(()).ok_or("there is nothing to undo")?,
            Command::Redo => self.history.redo(&mut self.state).then_some(()).ok_or("there is nothing to redo")?,
            Command::SaveScene(path) => {
                keeping::write(path, &self.state)?;
                self.messages.note_done(wrote(path));
            }
            Command::SavePicture(path, form) => {
                let marks = form.marks.unwrap_or(Marks::shown(&self.state.window));
                let over = Over { marks, distances: self.state.window.distances.clone() };
                self.views.main.capture(self.state.scene.clone(), form.size_px, path.clone(), over);
            }
            Command::Screenshot(path) => self.screenshots.take(path.clone(), egui),
            Command::Click(place) => self.clicks.add(*place),
            Command::Quit => egui.send_viewport_cmd(ViewportCommand::Close),
            Command::LoseGpu => self.views.device().into_iter().for_each(Device::lose),
            Command::Open(paths, placing) => self.open(paths, *placing)?,
            Command::OpenAs(path, description, placing) => self.open_as(path, description, *placing)?,
            Command::Export(path, form) => self.export(path, form)?,
            Command::Mesh(path, form) => self.mesh(path, form)?,
            Command::Edit(changes) => self.edit(changes)?,
            _ => {
                let camera = moved(command, &self.state.scene, &self.places(), self.volume_view.size_px)?;
                let camera = camera.ok_or("this command has no effect here")?;
                let scene = Scene { camera: Some(camera), ..self.state.scene.clone() };
                self.check(&scene)?;
                self.state.scene = scene;
                if let Command::Center(point) = command {
                    self.state.window.planes.crosshair = Some(*point);
                }
            }
        }
        Ok(())
    }

    /// Sets fields of the state's document, as one undoable edit.
    fn set(&mut self, fields: &[(String, Value)]) -> Result<(), String> {
        let edited = edited(&self.state, self.views.volumes(), fields)?;
        self.check(&edited.scene)?;
        let edits: Vec<_> =
            fields.iter().map(|(field, _)| field.as_str()).filter(|field| !is_navigation(field)).collect();
        if !edits.is_empty() {
            self.history.edit(&self.state, &edits.join(" "));
            self.messages.end(About::Scene);
        }
        self.state = edited;
        Ok(())
    }

    fn check(&self, scene: &Scene) -> Result<(), String> {
        if let Some(camera) = scene.camera {
            let (width, height) = self.volume_view.size_px;
            camera.rays(width.max(1), height.max(1)).map_err(|error| error.to_string())?;
        }
        self.views.main.check(scene).map_err(|error| error.to_string())
    }

    /// Whether files are being read or written.
    fn is_busy(&self) -> bool {
        let is_writing = self.exporting.is_some() || self.editing.is_some() || !self.saving.is_empty();
        self.openings.are_busy() || self.next.is_some() || is_writing
    }

    /// Whether the pictures are complete until something changes; an empty window has none.
    fn has_final_pictures(&self) -> bool {
        self.openings.are_none() || self.views.are_final()
    }

    /// Whether the window stays as it is without new input.
    fn is_final(&self) -> bool {
        self.has_final_pictures() && !self.is_busy()
    }

    /// Plays the due lines of the script.
    fn play(&mut self, egui: &egui::Context) {
        let since_start = self.started.get_or_insert_with(Instant::now).elapsed();
        // A screenshot shows the frame after its request: nothing may change it.
        while !self.screenshots.are_awaited()
            && self.clicks.are_done()
            && let Some(line) = self.script.next(since_start, self.is_final())
        {
            self.perform_line(&line, egui);
            self.history.close();
            // The command's changes must be drawn before the next line that waits for them.
            if self.is_final() {
                break;
            }
        }
    }

    /// Shows the pictures, and takes the pointer's actions over them.
    fn pictures(&mut self, ui: &mut Ui, commands: &mut Vec<Command>) -> Result<(), SessionError> {
        self.views.suit(&self.state.window, self.pacing.between())?;
        self.measuring.suit(self.state.window.tool);
        let places = self.places();
        let is_anatomical = self.state.scene.is_anatomical(&places);
        let unit = unit(self.views.volumes(), is_anatomical).to_string();
        let axis_units = axis_units(self.views.volumes(), is_anatomical).map(str::to_owned);
        let axis_units = axis_units.each_ref().map(String::as_str);
        let corners = self.state.scene.world_box(&places).ok();
        let world = corners.map(|corners| World { corners, is_anatomical, unit: &unit, axis_units });
        let volumes = self.views.volumes().to_vec();
        let measuring = &mut self.measuring;
        let seen = Seen { state: &self.state, volumes: &volumes, world };
        let grid = Grid::of(&self.state.scene, &volumes).filter(|_| self.state.window.layout == Layout::Planes);
        let Some(grid) = grid else {
            return self.volume_view.show(ui, &mut self.views.main, &seen, measuring, commands);
        };
        // Across z, then the volume; across y and x below.
        let [upper_left, upper_right, lower_left, lower_right] = quarters(ui.max_rect());
        let mut shown = Ok(());
        for (axis, area) in [(2, upper_left), (1, lower_left), (0, lower_right)] {
            let mut part = ui.new_child(UiBuilder::new().max_rect(area).id_salt(axis));
            let canvas = &mut self.views.planes[axis];
            let drawn = self.plane_views[axis].show(&mut part, canvas, &grid, &seen, measuring, commands);
            shown = shown.and(drawn);
        }
        let mut part = ui.new_child(UiBuilder::new().max_rect(upper_right).id_salt("volume"));
        shown.and(self.volume_view.show(&mut part, &mut self.views.main, &seen, measuring, commands))
    }

    fn picked_label(&self) -> Option<i64> {
        self.volume_view.picking.picked.as_ref().and_then(|picked| picked.label)
    }

    /// The pick under the pointer, in any of the window's pictures.
    fn picked(&self) -> Option<&Picked> {
        let planes = self.plane_views.iter().filter(|_| !self.views.planes.is_empty());
        let pictures = planes.map(|view| &view.picking).chain([&self.volume_view.picking]);
        pictures.flat_map(|picking| &picking.picked).next()
    }

    /// The values over time of the voxel under the pointer, if the document shows them; of the last such voxel where there is none or pictures
    /// change.
    fn value_curve(&mut self, egui: &egui::Context, play: &Play) -> Option<ValueCurve> {
        // While pictures change below it, a resting pointer keeps its voxel.
        let is_new = !play.on || self.pointed.is_none();
        if let Some(values) = self.picked().filter(|_| is_new).and_then(|picked| picked.pick.values.first()) {
            self.pointed = Some((values.volume, values.probe.voxel));
        }
        if !play.curve {
            return None;
        }
        if let Some((index, voxel)) = self.pointed
            && let Some(volume) = self.views.volumes().get(index)
            && voxel.iter().zip(volume.source.pyramid().levels()[0].extent.to_array()).all(|(at, count)| *at < count)
        {
            self.curves.read(egui, index, volume, voxel);
        }
        self.curves.curve(self.views.volumes())
    }

    fn write_pictures(&mut self, egui: &egui::Context) {
        for (path, written) in self.screenshots.write() {
            let is_it = |command: &Command| matches!(command, Command::Screenshot(file) if *file == path);
            let written = written.map(|()| wrote(&path)).map_err(|error| error.to_string());
            self.say_ended(is_it, written, false);
        }
        while let Some(written) = self.saving.first_mut().and_then(Saving::poll) {
            let path = self.saving.remove(0).path().to_path_buf();
            self.say_saved(&path, written);
        }
        let size_px = self.volume_view.size_px;
        match self.views.main.captured(size_px) {
            Ok(None) => {}
            Ok(Some(captured)) => {
                let (of_picture, path) = ((captured.picture.width, captured.picture.height), captured.path.clone());
                let pixels_per_point = marks::pixels_per_point(of_picture, size_px, egui.pixels_per_point());
                let volumes = self.views.volumes().to_vec();
                match Saving::begin(captured, volumes, pixels_per_point, egui.clone()) {
                    Ok(saving) => self.saving.push(saving),
                    Err(error) => self.say_saved(&path, Err(error.to_string())),
                }
            }
            Err(error) => {
                let is_picture = |command: &Command| matches!(command, Command::SavePicture(..));
                self.say_ended(is_picture, Err(format!("the picture cannot be written: {error}")), false);
            }
        }
    }

    fn say_saved(&mut self, path: &Path, written: Result<(), String>) {
        let is_it = |command: &Command| matches!(command, Command::SavePicture(file, _) if file == path);
        self.say_ended(is_it, written.map(|()| wrote(path)), false);
    }

    /// Shows the panels around the pictures, which edit a copy of the state. Returns the room for the row of time steps, if any.
    fn panels(&mut self, ui: &mut Ui, state: &mut State, commands: &mut Vec<Command>) -> Option<Rect> {
        let budgets = self.views.budgets_bytes(&self.state.window);
        let budgets = Budgets { gpu: (budgets.0 >> 20) as u32, host: (budgets.1 >> 20) as u32 };
        let (mut wanted, has_volumes) = (None, !self.openings.are_none());
        // An empty window has nothing else to show.
        if has_volumes && !self.state.window.panels {
            self.over_pictures(ui, true);
            panels::help::show(ui, &mut state.window.help, ui.available_rect_before_wrap());
            return None;
        }
        egui::Panel::top("menu").show(ui, |ui| {
            let subject = panels::menu::Subject {
                recent: self.recent.paths(),
                has_volumes,
                is_patient: self.state.scene.is_anatomical(&self.places()),
                history: self.history.can(),
                budgets,
                wanted: &mut wanted,
            };
            panels::menu::show(ui, state, subject, commands);
        });
        if let Some(kind) = wanted {
            self.show_dialog(kind);
        }
        let below_menu = ui.available_rect_before_wrap();
        let picked = self.picked().map(|picked| picked.words.clone());
        let (views, messages) = (Some(&self.views).filter(|_| has_volumes), &mut self.messages);
        let status = egui::Panel::bottom("status");
        let is_long = status.show(ui, |ui| panels::status::show(ui, views, messages, picked.as_ref())).inner;
        let has_steps = has_volumes && VolumeSource::timeline(self.views.volumes(), &state.scene).steps() > 1;
        let room = has_steps
            .then(|| egui::Panel::bottom("playing").show(ui, |ui| panels::playing::room(ui, &state.window.play)).inner);
        if has_volumes {
            self.side_panels(ui, state, commands);
        }
        self.over_pictures(ui, is_long);
        panels::help::show(ui, &mut state.window.help, below_menu);
        room
    }

    /// Shows the row of time steps, for the pictures of this frame. It edits a copy of the state.
    fn steps_row(&mut self, ui: &mut Ui, state: &mut State, room: Rect) {
        let timeline = VolumeSource::timeline(self.views.volumes(), &state.scene);
        let curve = self.value_curve(ui.ctx(), &state.window.play);
        let main = &self.views.main;
        let (seen, coming) = (main.step_seen(), main.coming());
        let volume = curve.as_ref().and_then(|curve| self.views.volumes().get(curve.volume));
        let unit = volume.and_then(VolumeSource::common_unit).unwrap_or_default();
        let steps = panels::playing::Steps { timeline: &timeline, seen, coming, curve: curve.as_ref(), unit };
        let mut row = ui.new_child(UiBuilder::new().max_rect(room).id_salt("playing"));
        panels::playing::show(&mut row, &mut state.scene.time, &mut state.window.play, &steps);
    }

    /// Shows rows over the lower end of the pictures, in the free room of `ui`: files being read or written, and any problem too long for a line.
    /// They take no room from the pictures, which another height would force to be redrawn.
    fn over_pictures(&mut self, ui: &Ui, has_problem: bool) {
        let has_problem = has_problem && self.messages.problem().is_some();
        let capturing = self.views.main.capturing();
        if !has_problem && !self.is_busy() && capturing.is_none() {
            return;
        }
        let mut is_given_up = false;
        let frame = egui::Frame::popup(ui.style());
        let room = ui.available_rect_before_wrap();
        let width = WORK_WIDTH.min(room.width() - frame.total_margin().sum().x);
        let area = egui::Area::new(egui::Id::unique("work")).pivot(Align2::CENTER_BOTTOM);
        area.fixed_pos(room.center_bottom() - vec2(0.0, WORK_ABOVE)).show(ui.ctx(), |ui| {
            frame.show(ui, |ui| {
                ui.set_width(width);
                self.openings.show(ui);
                self.next.iter().for_each(|next| next.openings.show(ui));
                self.exporting.iter().for_each(|exporting| exporting.show(ui));
                self.editing.iter().for_each(|editing| editing.show(ui));
                self.saving.iter().for_each(|saving| work_row::show_writing(ui, saving.path()));
                if let Some((path, share)) = capturing {
                    is_given_up = work_row::show_share(ui, "drawing", path, share);
                }
                if has_problem {
                    panels::status::problem(ui, &mut self.messages, TextWrapMode::Wrap);
                }
            });
        });
        if is_given_up && let Some(path) = self.views.main.give_up_capture() {
            let is_it = |command: &Command| matches!(command, Command::SavePicture(file, _) if *file == path);
            self.say_ended(is_it, Err(format!("{} was not written: saving was stopped", path.display())), true);
        }
    }

    /// Shows the panels beside the pictures, which are about volumes.
    fn side_panels(&mut self, ui: &mut Ui, state: &mut State, commands: &mut Vec<Command>) {
        let mut saved = Vec::new();
        let most = MOST_OF_WIDTH * ui.available_width();
        egui::Panel::left("scene").default_size(324.0).max_size(most).show(ui, |ui| {
            panels::widgets::within(ui, |ui| {
                let is_playing = state.window.play.on;
                panels::view::show(ui, &mut state.scene, self.views.volumes(), is_playing, commands);
                ui.separator();
                panels::layers::show(ui, &mut state.scene, self.views.volumes(), self.picked_label(), &mut saved);
                panels::slices::show(ui, &mut state.window, &state.scene, self.views.volumes());
                panels::view::groups(ui, &mut state.scene, self.views.volumes());
            });
        });
        for (path, function) in saved {
            match keeping::write_json(&path, &function) {
                Ok(()) => self.messages.note_done(wrote(&path)),
                Err(problem) => self.messages.say(About::Work, problem),
            }
        }
        if state.window.diagnostics {
            egui::Panel::right("diagnostics").default_size(280.0).show(ui, |ui| {
                panels::widgets::within(ui, |ui| panels::diagnostics::show(ui, &self.views, &self.state.window));
            });
        }
    }

    /// Copies the picture's time step and the end of playback into the state, and into the panels' copy unless they have changed it there. Neither is
    /// an edit.
    fn follow_clock(&mut self, edited: &mut State) {
        if !self.state.window.play.on || self.openings.are_none() {
            return;
        }
        let before = (self.state.scene.time, self.state.window.play.on);
        self.state.scene.time = self.views.main.step_shown().unwrap_or(self.state.scene.time);
        self.state.window.play.on = self.views.main.is_playing();
        if (edited.scene.time, edited.window.play.on) == before {
            (edited.scene.time, edited.window.play.on) = (self.state.scene.time, self.state.window.play.on);
        }
    }

    /// Keeps the state for the next session. Returns the delay until the next attempt, if any.
    fn keep(&mut self) -> Option<Duration> {
        let kept = self.keeper.keep(&self.state);
        kept.unwrap_or_else(|problem| {
            self.messages.say(About::Work, format!("the window's state cannot be kept: {problem}"));
            None
        })
    }
}

/// A warning about volumes of one shape drawn at unlike sizes, if any, with the command that mends it.
fn warning(scene: &Scene, volumes: &[VolumeSource]) -> Option<String> {
    unlike_sizes(scene, volumes).map(|unlike| {
        let rows = unlike.numbers().map(|row| format!("[{}]", row.join(", "))).join(", ");
        format!("{unlike}; alike with: set layers.{}.world_from_volume [{rows}]", unlike.layer)
    })
}

/// The note on a written file, with its path.
fn wrote(path: &Path) -> String {
    format!("wrote {}", std::path::absolute(path).unwrap_or_else(|_| path.into()).display())
}

/// The quarters of an area, with a gap between them: upper left and right, lower left and right.
fn quarters(area: Rect) -> [Rect; 4] {
    let size = (area.size() - vec2(GAP, GAP)) * 0.5;
    let quarter =
        |right: f32, down: f32| Rect::from_min_size(area.min + (size + vec2(GAP, GAP)) * vec2(right, down), size);
    [quarter(0.0, 0.0), quarter(1.0, 0.0), quarter(0.0, 1.0), quarter(1.0, 1.0)]
}

/// The interface to the display.
impl Window {
    /// Adds the script's clicks to a frame's input, and defers later events to the next frame.
    pub(crate) fn take_input(&mut self, egui: &egui::Context, input: &mut egui::RawInput) {
        self.clicks.play(input);
        InputOrder::allow_slow_clicks(egui, input);
        self.order.split(input);
    }

    /// Draws a frame, unless the device is lost and the window about to be reopened.
    pub(crate) fn frame(&mut self, ui: &mut Ui) {
        let egui = ui.ctx().clone();
        if self.is_leaving(&egui) {
            return;
        }
        self.update(ui);
        // If the device was lost meanwhile, nobody sees the frame or its messages.
        if !self.is_leaving(&egui) {
            self.messages.log();
        }
    }

    pub(crate) fn paths(&self) -> Vec<PathBuf> {
        self.openings.paths()
    }

    pub(crate) fn has_begun(&self) -> bool {
        self.started.is_some()
    }

    /// The reason for the script's failure, if any, for the window's caller.
    pub(crate) fn failure(&self) -> Option<&str> {
        self.failure.as_deref()
    }

    /// Draws on a device from now on; `is_on_cpu` leaves the volumes to the CPU.
    ///
    /// # Errors
    /// If the device is unfit for the engine.
    pub(crate) fn draw_on(&mut self, device: Device, is_on_cpu: bool) -> Result<(), SessionError> {
        self.views.set_device(device, is_on_cpu)
    }

    /// Takes the handover if the device is lost.
    pub(crate) fn leave(&mut self) -> Option<Handover> {
        self.left.take()
    }

    /// Continues after the loss of the device, with a message for the user. Screenshots lost with the device are taken again.
    pub(crate) fn take_up(&mut self, message: &str) {
        for path in self.screenshots.give_up().into_iter().rev() {
            self.script.again(Command::Screenshot(path));
        }
        self.messages.say(About::Work, message);
    }

    /// Whether the device is lost. The window then closes and draws nothing more: egui panics with shapes but no device to draw them on.
    fn is_leaving(&mut self, egui: &egui::Context) -> bool {
        let Some(reason) = self.views.device().and_then(Device::lost) else { return false };
        let is_closing = egui.input(|input| input.viewport().close_requested());
        if self.left.is_none() && !is_closing {
            self.left = Some(Handover::of(reason, egui, &self.state.window.volumes));
        }
        egui.graphics_mut(|graphics| *graphics = GraphicLayers::default());
        egui.send_viewport_cmd(ViewportCommand::Close);
        egui.request_repaint();
        true
    }

    fn update(&mut self, ui: &mut Ui) {
        let begun = Instant::now();
        self.pacing.begin();
        let egui = ui.ctx().clone();
        self.write_pictures(&egui);
        if let Err(problem) = self.follow_files(&egui) {
            self.messages.say(About::Work, problem);
        }
        self.play(&egui);
        if self.failure.is_some() {
            egui.send_viewport_cmd(ViewportCommand::Close);
        }
        if self.state.window.fullscreen != self.is_fullscreen {
            self.is_fullscreen = self.state.window.fullscreen;
            egui.send_viewport_cmd(ViewportCommand::Fullscreen(self.is_fullscreen));
        }
        egui.set_theme(if self.state.window.theme == Theme::Dark { egui::Theme::Dark } else { egui::Theme::Light });
        let mut commands = Vec::new();
        let mut is_busy = false;
        for key in keys::pressed(&egui, &self.state) {
            if let Some(command) = key.command(&self.state) {
                self.perform(&command, &egui);
                is_busy = true;
            }
        }
        self.messages.end_remark(&egui);
        let mut panel_state = self.state.clone();
        let row = self.panels(ui, &mut panel_state, &mut commands);
        self.choose_files(&egui, &mut commands);
        let mut drawn = Ok(());
        egui::CentralPanel::default().frame(egui::Frame::NONE).show(ui, |ui| match self.openings.are_none() {
            true => self.welcome(ui, &mut commands),
            false => drawn = self.pictures(ui, &mut commands),
        });
        self.follow_clock(&mut panel_state);
        if let Some(room) = row {
            self.steps_row(ui, &mut panel_state, room);
        }
        if panel_state != self.state {
            match changes(&self.state, &panel_state) {
                Ok(fields) => commands.push(Command::Set(fields)),
                Err(problem) => self.messages.say(About::Scene, problem),
            }
        }
        self.take_failure(drawn);
        commands.iter().for_each(|command| self.perform(command, &egui));
        if !egui.input(|input| input.pointer.any_down()) {
            self.history.close();
        }
        let keep_after = self.keep();
        // A command shows in the next frame.
        if is_busy || !commands.is_empty() || self.order.is_waiting() {
            egui.request_repaint();
        } else if self.messages.failing().is_some() {
            egui.request_repaint_after(FAILING_STEP);
        } else if self.screenshots.are_awaited() || !self.clicks.are_done() {
            egui.request_repaint_after(STREAMING_STEP);
        } else if !self.has_final_pictures() || !self.script.is_over() {
            egui.request_repaint_after(self.views.look_after());
        } else if self.is_busy() {
            egui.request_repaint_after(OPENING_STEP);
        } else {
            keep_after.into_iter().for_each(|after| egui.request_repaint_after(after));
            if self.openings.are_followed() {
                egui.request_repaint_after(FOLLOWING_STEP);
            }
        }
        let spent = self.views.take_spent();
        self.pacing.answered(self.views.main.take_answers());
        self.pacing.note(begun.elapsed(), spent, self.views.main.quality());
        self.pacing.end(!self.has_final_pictures());
    }

    /// Keeps the state for the next session. Idempotent.
    pub(crate) fn end(&mut self) {
        // On another device the window continues with them.
        if self.left.is_none() {
            while let Some(path) = self.views.main.give_up_capture() {
                tracing::warn!("{} was not written: the window was closed", path.display());
            }
        }
        if let Err(problem) = self.keeper.write() {
            tracing::warn!("the window's state cannot be kept: {problem}");
        }
        if let Some(path) = &self.stats {
            let written = keeping::write_json(path, &self.pacing.stats(self.opened));
            written.unwrap_or_else(|problem| tracing::error!("{problem}"));
        }
    }
}
