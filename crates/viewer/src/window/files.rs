//! The window's work with files: opening volumes instead of others or beside them, exporting voxels and meshes, and editing metadata. It runs in the
//! background, polled once a frame.

use super::{Window, warning};
use crate::command::{Command, Placing};
use crate::editing::{self, Editing};
use crate::edits::with_more;
use crate::exporting::Exporting;
use crate::keeping::{self, Keeper};
use crate::marks::Marks;
use crate::opening::Openings;
use crate::panels::description::Description;
use crate::panels::dialogs::{Dialog, DialogKind};
use crate::panels::edit_form::MetadataEdit;
use crate::panels::export_form::ExportForm;
use crate::panels::mesh_form::{MeshForm, shown_surface};
use crate::part::{Part, first_store};
use brickyard::channels::default_layers;
use brickyard::first_look::set_first_look;
use brickyard::openable::is_mesh;
use brickyard::opening::{OpeningError, OpeningOptions};
use brickyard::session::VolumeSource;
use brickyard::volume::{MeshLook, Mode, Scene};
use eframe::egui::{self, Link, Rect, Ui, UiBuilder, ViewportCommand, pos2};
use glam::DVec3;
use std::path::{Path, PathBuf};

/// Volumes being opened, shown once there is a picture of each.
pub(super) struct Next {
    pub(super) openings: Openings,
    meshes: Vec<PathBuf>,
    placing: Placing,
    /// The user's description of the files.
    said: Description,
}

impl Window {
    /// Starts opening volumes and meshes, to be shown instead of the current ones or beside them. Meshes alone are always shown beside volumes.
    pub(super) fn open(&mut self, paths: &[PathBuf], placing: Placing) -> Result<(), String> {
        let (meshes, volumes): (Vec<_>, Vec<_>) = paths.iter().cloned().partition(|path| is_mesh(path));
        if volumes.is_empty() {
            return self.add_meshes(&meshes);
        }
        self.dialog.take_if(|dialog| dialog.is_about_opening());
        // The description of previous files does not apply to these.
        let options = OpeningOptions { store: None, ..self.openings.options().clone() };
        self.open_next(Openings::start(volumes, options), meshes, placing, Description::default());
        Ok(())
    }

    /// Starts opening a file with a description.
    pub(super) fn open_as(&mut self, path: &Path, said: &Description, placing: Placing) -> Result<(), String> {
        let openings = Openings::start(vec![path.to_owned()], said.options(self.openings.options())?);
        self.open_next(openings, Vec::new(), placing, said.clone());
        Ok(())
    }

    fn open_next(&mut self, openings: Openings, meshes: Vec<PathBuf>, placing: Placing, said: Description) {
        match &mut self.next {
            Some(next) if placing == Placing::Beside => {
                next.openings.add(openings);
                next.meshes.extend(meshes);
            }
            next => {
                let placing = if self.openings.are_none() { Placing::Instead } else { placing };
                *next = Some(Next { openings, meshes, placing, said });
            }
        }
    }

    /// Returns the message for a file that cannot be opened; files requested with it are still opened. A form requests missing metadata or a better
    /// description. There is none for folders: a form describes one file.
    fn ask_about(&mut self, path: &Path, error: &OpeningError) -> String {
        if let Some(next) = &self.next
            && is_asked_about(path, error, &next.said)
        {
            let (placing, said) = (next.placing, next.said.clone());
            self.show_dialog(DialogKind::Describe(placing));
            self.dialog.iter_mut().for_each(|dialog| dialog.ask_about(path, said.clone(), error.to_string()));
        }
        self.next.take_if(|next| next.openings.are_none());
        about(&path.display().to_string(), &error.to_string())
    }

    fn add_meshes(&mut self, paths: &[PathBuf]) -> Result<(), String> {
        if paths.is_empty() {
            return Ok(());
        }
        if self.openings.are_none() {
            return Err("a mesh is shown beside volumes: open a volume first".into());
        }
        let mut meshes = self.state.scene.meshes.clone();
        meshes.extend(paths.iter().map(MeshLook::new));
        let meshes = serde_json::to_value(meshes).map_err(|error| error.to_string())?;
        self.set(&[("meshes".into(), meshes)])
    }

    /// Shows newly opened volumes, and reports the end of an export or edit.
    pub(super) fn follow_files(&mut self, egui: &egui::Context) -> Result<(), String> {
        if let Some(ended) = self.exporting.as_mut().and_then(Exporting::poll) {
            let is_stopped = self.exporting.take().is_some_and(|exporting| exporting.is_stopped());
            self.say_ended(Command::exports, ended, is_stopped);
        }
        if let Some(ended) = self.editing.as_mut().and_then(Editing::poll) {
            self.editing = None;
            self.take_edited(ended, egui);
        }
        let changes = self.openings.poll();
        changes.messages.into_iter().last().into_iter().for_each(|text| self.messages.notice(text));
        if changes.has_volumes {
            let volumes = self.openings.volumes();
            if scale_crops(&mut self.state.scene, self.views.volumes(), &volumes) {
                // Undoable edits refer to the previous voxels.
                self.history.clear();
            }
            self.views.set_volumes(volumes).map_err(|error| error.to_string())?;
        } else if changes.has_steps {
            self.views.follow_volumes(self.openings.volumes());
        }
        if let Some((path, error)) = changes.stopped {
            let words = about(&path.display().to_string(), &error.to_string());
            if !error.is_cancelled() {
                return Err(words);
            }
            self.messages.remark(words);
        }
        let Some(next) = &mut self.next else { return Ok(()) };
        let changes = next.openings.poll();
        changes.messages.into_iter().last().into_iter().for_each(|text| self.messages.notice(text));
        if let Some((path, error)) = changes.stopped {
            let problem = self.ask_about(&path, &error);
            self.say_ended(Command::opens, Err(problem), error.is_cancelled());
            return Ok(());
        }
        let Some(next) = self.next.take_if(|next| next.openings.are_shown()) else { return Ok(()) };
        let shown = self.show_next(next, egui);
        match (self.script.ended(Command::opens), shown) {
            (Some(line), Err(problem)) => self.fail(&line, &problem),
            (_, shown) => return shown,
        }
        Ok(())
    }

    fn show_next(&mut self, next: Next, egui: &egui::Context) -> Result<(), String> {
        let Next { openings, meshes, placing, .. } = next;
        let paths = openings.paths();
        match placing {
            Placing::Instead => self.show_others(openings)?,
            Placing::Beside => self.show_more(openings)?,
        }
        egui.send_viewport_cmd(ViewportCommand::Title(crate::title(&self.state.window.volumes)));
        self.add_meshes(&meshes)?;
        paths.iter().try_for_each(|path| self.recent.add(path))
    }

    /// Shows volumes beside the current ones, whose looks and view stay.
    fn show_more(&mut self, openings: Openings) -> Result<(), String> {
        let before = self.views.volumes();
        let volumes = [before, &openings.volumes()].concat();
        let scene = with_more(&self.state.scene, &volumes, before.len())?;
        self.views.set_volumes(volumes).map_err(|error| error.to_string())?;
        self.openings.add(openings);
        self.history.edit(&self.state, "add");
        self.history.close();
        self.keep_as(self.openings.paths())?;
        if scene.mode == Mode::Isosurface {
            let added = scene.layers[self.state.scene.layers.len()..].iter();
            self.state.lent_surfaces.extend(added.flat_map(|layer| layer.isosurfaces.clone()));
        }
        self.state.scene = scene;
        self.messages.warn(warning(&self.state.scene, self.views.volumes()));
        Ok(())
    }

    /// Shows other volumes instead, as in a new window on them.
    fn show_others(&mut self, openings: Openings) -> Result<(), String> {
        let volumes = openings.volumes();
        let mut scene = Scene { layers: default_layers(&volumes), ..Scene::default() };
        set_first_look(&mut scene, &volumes);
        let places: Vec<_> = volumes.iter().map(VolumeSource::place).collect();
        let (width, height) = self.volume_view.size_px;
        let camera = scene.camera_for(&places, (width.max(1), height.max(1)));
        scene.camera = Some(camera.map_err(|error| error.to_string())?);
        self.views.set_volumes(volumes).map_err(|error| error.to_string())?;
        self.keep_as(openings.paths())?;
        self.state.scene = scene;
        self.state.window.distances.clear();
        self.history.clear();
        self.openings = openings;
        self.messages.warn(warning(&self.state.scene, self.views.volumes()));
        Ok(())
    }

    /// Keeps the state as a window on other volumes from now on.
    fn keep_as(&mut self, paths: Vec<PathBuf>) -> Result<(), String> {
        self.keeper.write()?;
        self.keeper = Keeper::new(keeping::file_of(&paths).filter(|_| self.script.is_over()), &self.state);
        self.state.window.volumes = paths;
        Ok(())
    }

    /// Starts exporting visible voxels of the first visible layer.
    pub(super) fn export(&mut self, path: &Path, form: &ExportForm) -> Result<(), String> {
        let part = self.part_to_export(form.level)?;
        if let Some(problem) = form.problem() {
            return Err(problem.into());
        }
        let request = form.request(&part);
        self.exporting = Some(Exporting::voxels(part.store, path, request));
        Ok(())
    }

    /// Starts writing a surface of the first visible layer.
    pub(super) fn mesh(&mut self, path: &Path, form: &MeshForm) -> Result<(), String> {
        let part = self.part_to_export(form.level)?;
        let request = form.request(&part, shown_surface(&self.state.scene, self.views.volumes())?);
        self.exporting = Some(Exporting::mesh(part.store, path, request));
        Ok(())
    }

    fn part_to_export(&self, level: u8) -> Result<Part, String> {
        if self.exporting.is_some() {
            return Err("another export is still running".into());
        }
        Part::of(&self.state.scene, self.views.volumes(), level)
    }

    /// Starts editing the metadata of the first visible layer's store.
    pub(super) fn edit(&mut self, changes: &MetadataEdit) -> Result<(), String> {
        if self.editing.is_some() {
            return Err("another edit is still running".into());
        }
        let (_, _, store) = first_store(&self.state.scene, self.views.volumes())?;
        self.editing = Some(Editing::start(store, changes)?);
        Ok(())
    }

    /// Goes on with an edited store, or tells the reason for its refusal, in the dialog if there is one.
    fn take_edited(&mut self, ended: Result<(String, VolumeSource), String>, egui: &egui::Context) {
        let is_edit = |command: &Command| matches!(command, Command::Edit(_));
        let dialog = self.dialog.as_mut().filter(|dialog| dialog.is_about_metadata());
        let ended = match (ended, dialog) {
            (Err(problem), Some(dialog)) if self.script.is_over() => return dialog.refuse(problem),
            (Err(problem), _) => Err(problem),
            (Ok((said, volume)), dialog) => {
                if dialog.is_some() {
                    self.dialog = None;
                }
                self.show_edited(&volume, egui).map(|()| said)
            }
        };
        self.say_ended(is_edit, ended, false);
    }

    /// Shows a store with its new metadata. The camera stays, unless the volume's place has changed: then it sees everything from its side.
    fn show_edited(&mut self, volume: &VolumeSource, egui: &egui::Context) -> Result<(), String> {
        let before = self.views.volumes().to_vec();
        self.openings.take_edited(volume);
        let after = self.openings.volumes();
        self.views.set_volumes(after.clone()).map_err(|error| error.to_string())?;
        if editing::take_up(&mut self.state, &before, &after) {
            // Undone, edits would bring back places of the former world.
            self.history.clear();
            self.try_perform(&Command::Fit, egui)?;
        }
        self.messages.warn(warning(&self.state.scene, self.views.volumes()));
        Ok(())
    }

    /// Shows a dialog instead of the current one.
    pub(super) fn show_dialog(&mut self, kind: DialogKind) {
        let beside = self.openings.paths().first().and_then(|path| path.parent().map(Path::to_path_buf));
        let marks = Marks::shown(&self.state.window);
        self.dialog = Some(Dialog::new(kind, &beside.unwrap_or_default(), self.volume_view.size_px, marks));
    }

    /// Shows the dialog, if any, and opens files dropped on the window.
    pub(super) fn choose_files(&mut self, egui: &egui::Context, commands: &mut Vec<Command>) {
        let (dropped, is_added) = egui.input(|input| (input.raw.dropped_files.clone(), input.modifiers.shift));
        let dropped: Vec<_> = dropped.iter().map(|file| file.path().to_path_buf()).collect();
        if !dropped.is_empty() {
            commands.push(Command::Open(dropped, if is_added { Placing::Beside } else { Placing::Instead }));
        }
        let Some(dialog) = &mut self.dialog else { return };
        let (stays, command) = dialog.show(egui, self.volume_view.size_px, &self.state.scene, self.views.volumes());
        if !stays {
            self.dialog = None;
        }
        commands.extend(command);
    }

    /// The page of an empty window, in the place of pictures.
    pub(super) fn welcome(&self, ui: &mut Ui, commands: &mut Vec<Command>) {
        // The other half is the dialog's.
        let area = ui.max_rect().shrink(40.0);
        let area = Rect::from_min_max(area.min, pos2(ui.max_rect().center().x - 140.0, area.max.y));
        let mut part = ui.new_child(UiBuilder::new().max_rect(area));
        part.heading("Open or drop a file");
        part.label("A store, an image, or a folder of planes or slices.");
        part.add_space(16.0);
        for path in self.recent.paths() {
            if part.add(Link::new(path.display().to_string())).clicked() {
                commands.push(Command::Open(vec![path.clone()], Placing::Instead));
            }
        }
    }
}

/// Whether a form can help to open a path: by missing metadata, or by a better description.
fn is_asked_about(path: &Path, error: &OpeningError, said: &Description) -> bool {
    let may_be_told = error.wants_options() || *said != Description::default() && !error.is_cancelled();
    may_be_told && !path.is_dir()
}

/// A problem prefixed with its subject, unless it names that itself, as file errors do.
pub(super) fn about(what: &str, problem: &str) -> String {
    if problem.contains(what) { problem.into() } else { format!("{what}: {problem}") }
}

/// Converts the layers' crops from the voxels of some volumes to those of their replacements: a store has more than its preview. Returns whether any
/// changed.
fn scale_crops(scene: &mut Scene, before: &[VolumeSource], after: &[VolumeSource]) -> bool {
    let mut is_scaled = false;
    for layer in 0..scene.layers.len() {
        let store = scene.store(layer);
        let (Some(before), Some(after)) = (before.get(store), after.get(store)) else { continue };
        let ratio = |axis| f64::from(before.stride()[axis]) / f64::from(after.stride()[axis]);
        let ratio = DVec3::new(ratio(0), ratio(1), ratio(2));
        let extent = after.source.pyramid().levels()[0].extent.to_array().map(f64::from);
        if let Some(crop) = scene.layers[layer].crop.as_mut().filter(|_| ratio != DVec3::ONE) {
            *crop = crop.map(|corner| (corner * ratio).min(DVec3::from_array(extent)));
            is_scaled = true;
        }
    }
    is_scaled
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard::volume::SceneLayer;

    #[test]
    fn what_a_problem_is_about_is_said_once() {
        assert_eq!(about("/a.nii", "/a.nii: no such file"), "/a.nii: no such file");
        assert_eq!(about("/a.nii", "cancelled"), "/a.nii: cancelled");
    }

    #[test]
    fn a_form_is_about_a_file_and_never_about_a_folder() {
        let folder = tempfile::tempdir().unwrap();
        let raw = folder.path().join("a.raw");
        for name in ["a.raw", "b.npy", "c.tif"] {
            std::fs::write(folder.path().join(name), [0; 24]).unwrap();
        }
        let is_asked = |path: &Path| {
            let error = Openings::start(vec![path.into()], OpeningOptions::default()).wait(|_, _| ()).unwrap_err();
            is_asked_about(path, &error, &Description::default())
        };
        assert!(is_asked(&raw) && !is_asked(folder.path()));
    }

    #[test]
    fn a_crop_stays_where_it_is_when_a_store_follows_its_preview() {
        let crop = Some([DVec3::ZERO, DVec3::new(0.5, 1.0, 1.0)]);
        let layers = vec![SceneLayer { source: Some(0), crop, ..SceneLayer::default() }; 2];
        let mut scene = Scene { layers, ..Scene::default() };
        scene.layers[1].crop = None;
        // The preview's one voxel stands for two by three by one; the store has a single one.
        let preview = [crate::nothing::volume().with_stride([2, 3, 1])];
        let store = [crate::nothing::volume()];
        assert!(scale_crops(&mut scene, &preview, &store));
        assert_eq!(scene.layers[0].crop, Some([DVec3::ZERO, DVec3::new(1.0, 1.0, 1.0)]));
        assert_eq!(scene.layers[1].crop, None);
        let before = scene.clone();
        assert!(!scale_crops(&mut scene, &store, &store) && scene == before);
    }
}
