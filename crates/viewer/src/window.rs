//! The window: the scene that is shown, and what happens to it. Each frame takes the commands of script, keys, pointer and panels, does them, and
//! brings the picture nearer to the scene. Nothing is drawn while nothing changes.

use crate::canvas::Canvas;
use crate::command::Command;
use crate::edits::edited;
use crate::history::History;
use crate::navigation::{orbited, panned, point_at_target, rolled, with_parallel_rays, zoomed};
use crate::overlay::{self, World};
use crate::panels;
use crate::panels::help::{PICTURE_FILE, SCENE_FILE};
use crate::picking::Picking;
use crate::screenshots::Screenshots;
use crate::script::Script;
use brickyard::picture_file::write_shown;
use brickyard::session::VolumeSource;
use brickyard::text_file::write_text;
use brickyard::volume::scene::VolumePlace;
use brickyard::volume::{Camera, Projection, Scene};
use eframe::egui::{self, PointerButton, Sense, Ui, ViewportCommand};
use glam::DVec3;
use std::path::Path;
use std::time::{Duration, Instant};

/// How far the volume turns while the pointer is dragged over the picture's height.
const TURN_DEG: f64 = 180.0;

/// How often the window looks whether bricks have come.
const STREAMING_STEP: Duration = Duration::from_millis(8);

/// How often the window tries again what has failed: a disk may come back.
const FAILING_STEP: Duration = Duration::from_secs(1);

/// The state of the window.
pub(crate) struct Window {
    pub(crate) scene: Scene,
    pub(crate) history: History,
    volumes: Vec<VolumeSource>,
    canvas: Canvas,
    script: Script,
    /// What the user is to be told.
    message: Option<String>,
    /// Whether the picture could not be brought on in the last frame.
    is_failing: bool,
    is_help_open: bool,
    /// Whether box, scale bar and axes are drawn over the picture.
    has_overlays: bool,
    picking: Picking,
    /// What is under the pointer.
    picked: Option<String>,
    /// The picture's size of the last frame.
    size_px: (u32, u32),
    /// The time of the first frame; `None` before it.
    started: Option<Instant>,
    screenshots: Screenshots,
}

impl Window {
    /// A window that shows a scene of volumes.
    pub(crate) fn new(scene: Scene, volumes: Vec<VolumeSource>, canvas: Canvas, script: Script) -> Self {
        Self {
            scene,
            history: History::default(),
            volumes,
            canvas,
            script,
            message: None,
            is_failing: false,
            is_help_open: false,
            has_overlays: true,
            picking: Picking::default(),
            picked: None,
            size_px: (1, 1),
            started: None,
            screenshots: Screenshots::new(),
        }
    }

    fn places(&self) -> Vec<VolumePlace> {
        self.volumes.iter().map(VolumeSource::place).collect()
    }

    /// Does a command. What is wrong with it is said in the window.
    fn perform(&mut self, command: &Command, egui: &egui::Context) {
        if let Err(problem) = self.try_perform(command, egui) {
            self.message = Some(format!("{command}: {problem}"));
        }
    }

    fn try_perform(&mut self, command: &Command, egui: &egui::Context) -> Result<(), String> {
        if let Some(kind) = command.edits() {
            let edited = edited(&self.scene, &self.volumes, command).ok_or("there is no such layer")?;
            self.canvas.check(&edited).map_err(|error| error.to_string())?;
            self.history.edit(&self.scene, &kind);
            self.scene = edited;
            self.message = None;
            return Ok(());
        }
        match command {
            Command::Undo => self.history.undo(&mut self.scene).then_some(()).ok_or("there is nothing to undo".into()),
            Command::Redo => self.history.redo(&mut self.scene).then_some(()).ok_or("there is nothing to redo".into()),
            Command::SaveScene(path) => self.save_scene(path),
            Command::SavePicture(path) => self.save_picture(path),
            Command::Screenshot(path) => {
                self.screenshots.take(path.clone(), egui);
                Ok(())
            }
            Command::Overlays(is_on) => {
                self.has_overlays = *is_on;
                Ok(())
            }
            Command::Quit => {
                egui.send_viewport_cmd(ViewportCommand::Close);
                Ok(())
            }
            _ => {
                self.scene.camera = Some(self.moved(command)?);
                Ok(())
            }
        }
    }

    /// The camera after a command that moves it.
    fn moved(&self, command: &Command) -> Result<Camera, String> {
        let places = self.places();
        let camera = self.scene.camera_for(&places, self.size_px).map_err(|error| error.to_string())?;
        let world_box = || self.scene.world_box(&places).map_err(|error| error.to_string());
        let from = |direction: DVec3, up: DVec3| -> Result<Camera, String> {
            let whole = Camera::looking_from(direction, up, world_box()?);
            let is_parallel = matches!(camera.projection, Projection::Orthographic { .. });
            Ok(with_parallel_rays(&whole, is_parallel))
        };
        Ok(match command {
            Command::Orbit { right_deg, up_deg } => orbited(&camera, camera.target, *right_deg, *up_deg),
            Command::Roll { angle_deg } => rolled(&camera, *angle_deg),
            Command::Pan { right, up } => panned(&camera, *right, *up),
            Command::Zoom { factor, at: None } => zoomed(&camera, camera.target, *factor),
            Command::Zoom { factor, at: Some([right, down]) } => {
                let (width, height) = self.size_px;
                let place_px = [right * f64::from(width), down * f64::from(height)];
                let towards = point_at_target(&camera, self.size_px, place_px).ok_or("there is no such place")?;
                zoomed(&camera, towards, *factor)
            }
            Command::Parallel(is_parallel) => with_parallel_rays(&camera, *is_parallel),
            Command::View(viewpoint) => {
                let direction = viewpoint.direction(self.scene.is_anatomical(&places));
                let (direction, up) = direction.ok_or("no store says how its volume lies in a patient: use +x, -y")?;
                from(direction, up)?
            }
            Command::Fit => from((camera.eye - camera.target).normalize_or_zero(), camera.up)?,
            _ => camera,
        })
    }

    fn save_scene(&mut self, path: &Path) -> Result<(), String> {
        let text = serde_json::to_string_pretty(&self.scene).map_err(|error| error.to_string())?;
        write_text(path, &(text + "\n")).map_err(|error| error.to_string())?;
        self.message = Some(format!("wrote {}", path.display()));
        Ok(())
    }

    fn save_picture(&mut self, path: &Path) -> Result<(), String> {
        let drawn = self.canvas.picture().map_err(|error| error.to_string())?;
        let (picture, scene, stats) = drawn.ok_or("there is no picture yet")?;
        write_shown(path, &picture, &scene, &stats).map_err(|error| error.to_string())?;
        self.message = Some(format!("wrote {}", path.display()));
        Ok(())
    }

    /// Plays what is due of the script.
    fn play(&mut self, egui: &egui::Context) {
        let since_start = self.started.get_or_insert_with(Instant::now).elapsed();
        // A screenshot shows the frame after it was asked for: nothing may change that.
        while !self.screenshots.are_awaited()
            && let Some(command) = self.script.next(since_start, self.canvas.is_final())
        {
            self.perform(&command, egui);
            self.history.close();
            // What the command changed is to be drawn before the next one that waits for it.
            if self.canvas.is_final() {
                break;
            }
        }
    }

    /// The picture, and what the pointer does over it.
    fn picture(&mut self, ui: &mut Ui, commands: &mut Vec<Command>) {
        let scale = f64::from(ui.ctx().pixels_per_point());
        let size = ui.available_size();
        let pixels = |points: f32| ((f64::from(points) * scale).floor() as u32).max(1);
        self.size_px = (pixels(size.x), pixels(size.y));
        let drawn = self.canvas.show(ui.ctx(), &self.scene, self.size_px);
        self.is_failing = drawn.is_err();
        if let Err(error) = drawn {
            self.message = Some(error.to_string());
        }
        let shown = egui::vec2((f64::from(self.size_px.0) / scale) as f32, (f64::from(self.size_px.1) / scale) as f32);
        let (area, response) = ui.allocate_exact_size(shown, Sense::click_and_drag());
        if let Some(texture) = self.canvas.texture() {
            let whole = egui::Rect::from_min_max(egui::pos2(0.0, 0.0), egui::pos2(1.0, 1.0));
            ui.painter().image(texture, area, whole, egui::Color32::WHITE);
        }
        if let Some(camera) = self.scene.camera.filter(|_| self.has_overlays)
            && let Ok(corners) = self.scene.world_box(&self.places())
        {
            let is_anatomical = self.scene.is_anatomical(&self.places());
            let world = World { corners, is_anatomical, unit: self.unit(is_anatomical) };
            overlay::show(ui.painter(), area, &camera, self.size_px, &world);
        }
        self.pick(response.hover_pos().map(|pointer| pointer - area.min), scale);
        self.drag(&response, commands);
        if response.hovered() {
            Self::scroll(ui, area, commands);
        }
        if response.double_clicked() {
            commands.push(Command::Fit);
        }
    }

    /// The unit of the world, as it is written beside a number; empty if that is not known.
    fn unit(&self, is_anatomical: bool) -> &str {
        let own = self.volumes.first().and_then(|volume| volume.source.geometry().unit.as_deref());
        match own {
            _ if is_anatomical => "mm",
            Some("micrometer") => "µm",
            Some("nanometer") => "nm",
            Some("millimeter") => "mm",
            Some("meter") => "m",
            Some(other) => other,
            None => "",
        }
    }

    /// Looks what is under the pointer, which is so far from the picture's corner, in points.
    fn pick(&mut self, pointer: Option<egui::Vec2>, scale: f64) {
        let place = pointer.map(|to| [f64::from(to.x) * scale, f64::from(to.y) * scale]);
        let found = place.and_then(|place| self.picking.at(&self.scene, &self.volumes, self.size_px, place));
        self.picked = found.map(str::to_string);
    }

    fn drag(&self, response: &egui::Response, commands: &mut Vec<Command>) {
        let by = response.drag_delta() / response.rect.height().max(1.0);
        if by == egui::Vec2::ZERO {
            return;
        }
        let (right, down) = (f64::from(by.x), f64::from(by.y));
        let is_shifted = response.ctx.input(|input| input.modifiers.shift);
        if response.dragged_by(PointerButton::Middle) || (response.dragged_by(PointerButton::Primary) && is_shifted) {
            commands.push(Command::Pan { right, up: -down });
        } else if response.dragged_by(PointerButton::Primary) {
            commands.push(Command::Orbit { right_deg: TURN_DEG * right, up_deg: -TURN_DEG * down });
        } else if response.dragged_by(PointerButton::Secondary) {
            commands.push(Command::Zoom { factor: (-2.0 * down).exp(), at: None });
        }
    }

    /// What the wheel does, and two fingers: they come nearer to what is under the pointer.
    fn scroll(ui: &Ui, area: egui::Rect, commands: &mut Vec<Command>) {
        let (wheel, pinch, pointer) =
            ui.input(|input| (input.smooth_scroll_delta().y, input.zoom_delta(), input.pointer.hover_pos()));
        let factor = f64::from(pinch) * (f64::from(wheel) / 200.0).exp();
        let Some(pointer) = pointer.filter(|_| factor != 1.0) else { return };
        let place = (pointer - area.min) / area.size();
        commands.push(Command::Zoom { factor, at: Some([f64::from(place.x), f64::from(place.y)]) });
    }

    fn menu(&mut self, ui: &mut Ui, commands: &mut Vec<Command>) {
        egui::MenuBar::new().ui(ui, |ui| {
            ui.menu_button("File", |ui| {
                if ui.button(format!("Save picture ({PICTURE_FILE})")).clicked() {
                    commands.push(Command::SavePicture(PICTURE_FILE.into()));
                }
                if ui.button(format!("Save scene ({SCENE_FILE})")).clicked() {
                    commands.push(Command::SaveScene(SCENE_FILE.into()));
                }
                if ui.button("Quit").clicked() {
                    commands.push(Command::Quit);
                }
            });
            ui.menu_button("Edit", |ui| {
                let (can_undo, can_redo) = self.history.can();
                if ui.add_enabled(can_undo, egui::Button::new("Undo")).clicked() {
                    commands.push(Command::Undo);
                }
                if ui.add_enabled(can_redo, egui::Button::new("Redo")).clicked() {
                    commands.push(Command::Redo);
                }
            });
            ui.menu_button("Window", |ui| {
                ui.checkbox(&mut self.canvas.is_adaptive, "coarser while it moves");
                ui.checkbox(&mut self.has_overlays, "box, scale bar and axes");
                egui::widgets::global_theme_preference_buttons(ui);
            });
            ui.toggle_value(&mut self.is_help_open, "Help");
        });
    }
}

impl eframe::App for Window {
    fn ui(&mut self, ui: &mut Ui, _frame: &mut eframe::Frame) {
        let egui = ui.ctx().clone();
        if let Err(error) = self.screenshots.write() {
            self.message = Some(error.to_string());
        }
        self.play(&egui);
        let mut commands = Vec::new();
        panels::help::pressed(&egui, &mut commands);
        egui::Panel::top("menu").show(ui, |ui| self.menu(ui, &mut commands));
        egui::Panel::bottom("status").show(ui, |ui| {
            panels::status::show(ui, &self.canvas, self.message.as_deref(), self.picked.as_deref());
        });
        egui::Panel::left("scene").default_size(260.0).show(ui, |ui| {
            egui::ScrollArea::vertical().show(ui, |ui| {
                let times = self.volumes.iter().map(|volume| volume.source.times()).max().unwrap_or(1);
                let is_anatomical = self.scene.is_anatomical(&self.places());
                panels::view::show(ui, &self.scene, (times, is_anatomical), &mut commands);
                ui.separator();
                panels::layers::show(ui, &self.scene, &self.volumes, &mut commands);
            });
        });
        egui::CentralPanel::default().frame(egui::Frame::NONE).show(ui, |ui| self.picture(ui, &mut commands));
        egui::Window::new("Help").open(&mut self.is_help_open).show(&egui, panels::help::show);
        commands.iter().for_each(|command| self.perform(command, &egui));
        if !egui.input(|input| input.pointer.any_down()) {
            self.history.close();
        }
        // A command shows in the next frame.
        if !commands.is_empty() {
            egui.request_repaint();
        } else if self.is_failing {
            egui.request_repaint_after(FAILING_STEP);
        } else if !self.canvas.is_final() || !self.script.is_over() || self.screenshots.are_awaited() {
            egui.request_repaint_after(STREAMING_STEP);
        }
    }
}
