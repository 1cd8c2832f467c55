//! Dialogs about files: which to open or to add; the name and form of a picture, scene, export or mesh to write; and the metadata of a store. A dialog
//! stays until it gives a command or is closed; that about metadata until these are edited, so that a refusal is read beside the values.

use crate::command::{Command, PictureForm, Placing};
use crate::file_browser::FileBrowser;
use crate::keys::{PICTURE_FILE, SCENE_FILE};
use crate::marks::Marks;
use crate::panels::description::Description;
use crate::panels::edit_form::{EditForm, MetadataEdit};
use crate::panels::export_form::ExportForm;
use crate::panels::mesh_form::{MeshForm, shown_surface};
use crate::panels::widgets::{group, row};
use crate::part::{Part, first_store};
use brickyard::export::paths_of;
use brickyard::extract::{MeshSurface, check_mesh};
use brickyard::session::VolumeSource;
use brickyard::volume::Scene;
use eframe::egui::{self, Button, DragValue, Key, RichText, TextEdit, Ui, pos2};
use std::path::{Path, PathBuf};

/// The file for exported voxels, in the folder the window was opened from: a format that keeps their place, which most programs read.
const VOXELS_FILE: &str = "brickyard.nrrd";

/// The file for a mesh of one object, and of several.
const MESH_FILE: &str = "brickyard.ply";
const MESHES_FILE: &str = "brickyard.glb";

/// Names of exports, by their formats.
const FORMATS: &str = "the name chooses the format, ending in .zarr, .nii, .nii.gz, .nrrd, .seg.nrrd (labels), .mha, .mhd, .vti, .pvd, .tif \
    (ImageJ), .ome.tif, .npy (NumPy), .raw or, for a folder of PNG planes, /";

/// Most pixels of a picture along an axis.
const MOST_PX: u32 = 16384;

const FILE_HINT: &str = "a name without a folder is in the folder where the window was opened";

/// A dialog's purpose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum DialogKind {
    /// Volumes to show instead of others, or volumes and meshes beside them.
    Open(Placing),
    /// The description of a file that did not open without one.
    Describe(Placing),
    SavePicture,
    SaveScene,
    Export,
    Mesh,
    Edit,
}

/// An open dialog.
pub(crate) struct Dialog {
    kind: DialogKind,
    browser: FileBrowser,
    /// The file to write, or to describe.
    path: String,
    /// The description of files to open.
    description: Description,
    /// The error of opening a file with it, or of editing metadata.
    problem: String,
    export: ExportForm,
    mesh: MeshForm,
    /// The form of the store's metadata, once it is shown.
    edit: Option<EditForm>,
    /// Whether the first field is to get the focus.
    wants_focus: bool,
    size_px: (u32, u32),
    marks: Marks,
}

impl Dialog {
    /// Creates a dialog about files of a folder, and a picture of this shown size and marks.
    pub(crate) fn new(kind: DialogKind, folder: &Path, shown_px: (u32, u32), marks: Marks) -> Self {
        let path = match kind {
            // A mesh's name follows from its surface.
            DialogKind::Open(_) | DialogKind::Describe(_) | DialogKind::Mesh | DialogKind::Edit => "",
            DialogKind::SavePicture => PICTURE_FILE,
            DialogKind::SaveScene => SCENE_FILE,
            DialogKind::Export => VOXELS_FILE,
        };
        Self {
            kind,
            browser: FileBrowser::new(folder),
            path: path.into(),
            description: Description::default(),
            problem: String::new(),
            export: ExportForm::default(),
            mesh: MeshForm::default(),
            edit: None,
            wants_focus: true,
            size_px: shown_px,
            marks,
        }
    }

    /// Requests a better description of a file that does not open with `said`.
    pub(crate) fn ask_about(&mut self, path: &Path, said: Description, problem: String) {
        (self.path, self.description, self.problem) = (path.display().to_string(), said, problem);
    }

    /// Whether the dialog is about files to open, and ends once some are.
    pub(crate) fn is_about_opening(&self) -> bool {
        matches!(self.kind, DialogKind::Open(_))
    }

    /// Whether the dialog is about a store's metadata, and ends once they are edited.
    pub(crate) fn is_about_metadata(&self) -> bool {
        self.kind == DialogKind::Edit
    }

    /// Shows the reason why metadata were not edited.
    pub(crate) fn refuse(&mut self, problem: String) {
        self.problem = problem;
    }

    /// Shows the dialog over a window. Returns whether it stays, and its command.
    pub(crate) fn show(
        &mut self,
        egui: &egui::Context,
        shown_px: (u32, u32),
        scene: &Scene,
        volumes: &[VolumeSource],
    ) -> (bool, Option<Command>) {
        let title = match self.kind {
            DialogKind::Open(Placing::Instead) => "Open",
            DialogKind::Open(Placing::Beside) => "Add",
            DialogKind::Describe(_) => "Describe this file",
            DialogKind::SavePicture => "Save picture",
            DialogKind::SaveScene => "Save scene",
            DialogKind::Export => "Export voxels",
            DialogKind::Mesh => "Export mesh",
            DialogKind::Edit => "Edit metadata",
        };
        let mut is_open = true;
        // Beside the text of an empty window, below the menu.
        let corner = pos2(egui.content_rect().center().x - 120.0, 60.0);
        let window = egui::Window::new(title).open(&mut is_open).collapsible(false);
        let window = window.default_pos(corner).default_width(460.0);
        let shown = window.show(egui, |ui| match self.kind {
            DialogKind::Open(placing) => self.choose(ui, placing),
            DialogKind::Describe(placing) => self.describe(ui, placing),
            DialogKind::SavePicture => {
                let places: Vec<_> = volumes.iter().map(VolumeSource::place).collect();
                self.save_picture(ui, shown_px, scene.is_anatomical(&places))
            }
            DialogKind::SaveScene => self.save(ui, "Save scene").map(Command::SaveScene),
            DialogKind::Export => {
                let part = Part::of(scene, volumes, self.export.level);
                if part.is_err() {
                    // Another layer's store may have no such level.
                    self.export.level = 0;
                }
                self.export(ui, part)
            }
            DialogKind::Mesh => self.mesh(ui, scene, volumes),
            DialogKind::Edit => self.edit(ui, scene, volumes).map(Command::Edit),
        });
        let command = shown.and_then(|shown| shown.inner).flatten();
        let is_left = !is_open || egui.input(|input| input.key_pressed(Key::Escape));
        (!is_left && (command.is_none() || self.is_about_metadata()), command)
    }

    /// Shows the list of files, and the description of the chosen one.
    fn choose(&mut self, ui: &mut Ui, placing: Placing) -> Option<Command> {
        let path = self.browser.show(ui);
        let hint = "voxel size, labels, the axes of an array, the shape of a raw file";
        group(ui, "missing from the file", hint, |ui| self.description.show(ui, None));
        let path = path?;
        Some(match self.description == Description::default() {
            true => Command::Open(vec![path], placing),
            false => Command::OpenAs(path, self.description.clone(), placing),
        })
    }

    /// Shows the form for a file that lacks metadata.
    fn describe(&mut self, ui: &mut Ui, placing: Placing) -> Option<Command> {
        let path = PathBuf::from(&self.path);
        ui.colored_label(ui.visuals().warn_fg_color, &self.problem);
        ui.separator();
        self.description.show(ui, std::fs::metadata(&path).ok().map(|metadata| metadata.len()));
        ui.separator();
        ui.button("Open").clicked().then(|| Command::OpenAs(path, self.description.clone(), placing))
    }

    fn save_picture(
        &mut self,
        ui: &mut Ui,
        (shown_width, shown_height): (u32, u32),
        is_patient: bool,
    ) -> Option<Command> {
        let (width, height) = &mut self.size_px;
        row(ui, "size", "in pixels", |ui, label| {
            for side in [&mut *width, &mut *height] {
                ui.add(DragValue::new(side).range(1..=MOST_PX).suffix(" px")).labelled_by(label);
            }
            for factor in [1, 2, 4] {
                let hint = "the size on screen, or twice or four times that";
                if ui.button(format!("{factor}x")).on_hover_text(hint).clicked() {
                    *width = (factor * shown_width).clamp(1, MOST_PX);
                    *height = (factor * shown_height).clamp(1, MOST_PX);
                }
            }
        });
        row(ui, "over it", "overlays drawn on the picture, as in the window", |ui, _| {
            ui.horizontal_wrapped(|ui| {
                let marks = self.marks.each();
                for (_, name, is_drawn) in marks.into_iter().filter(|(mark, ..)| is_patient || *mark != "letters") {
                    ui.checkbox(is_drawn, name);
                }
            })
        });
        let form = PictureForm { size_px: Some(self.size_px), marks: Some(self.marks) };
        self.save(ui, "Save picture").map(|path| Command::SavePicture(path, form))
    }

    /// Shows a replaceable file's name, and the button to write it.
    fn save(&mut self, ui: &mut Ui, name: &str) -> Option<PathBuf> {
        let (path, is_entered) = self.file(ui);
        if path.exists() {
            ui.colored_label(ui.visuals().warn_fg_color, "This file exists: it will be replaced.");
        }
        let is_clicked = ui.add_enabled(!self.path.is_empty(), Button::new(name)).clicked();
        (is_clicked || is_entered && !self.path.is_empty()).then_some(path)
    }

    fn export(&mut self, ui: &mut Ui, part: Result<Part, String>) -> Option<Command> {
        ui.label("Stored voxels of the first visible layer, within clip box and crop.");
        let (path, is_entered) = self.file(ui);
        let mut files = None;
        let problem = match &part {
            Err(problem) => Some(problem.as_str()),
            Ok(part) => {
                self.export.show(ui, part);
                let mib = self.export.bytes(part) as f64 / f64::from(1 << 20);
                ui.label(format!("{}: {mib:.1} MiB", part.in_words()));
                files = paths_of(&path);
                if files.is_some() {
                    ui.weak(FORMATS);
                }
                if files.is_none() { Some(FORMATS) } else { self.export.problem() }
            }
        };
        self.export.replaces = files.is_some_and(|files| files.iter().any(|file| file.symlink_metadata().is_ok()));
        let replaces = self.export.replaces;
        self.confirm(ui, problem, replaces, is_entered).then(|| Command::Export(path, self.export.clone()))
    }

    fn mesh(&mut self, ui: &mut Ui, scene: &Scene, volumes: &[VolumeSource]) -> Option<Command> {
        ui.label("A surface of the first visible layer, within clip box and crop, as triangles.");
        let shown = shown_surface(scene, volumes);
        if self.path.is_empty() && self.wants_focus {
            self.path = if shown == Ok(MeshSurface::Labels) { MESHES_FILE } else { MESH_FILE }.into();
        }
        let (path, is_entered) = self.file(ui);
        self.mesh.replaces = path.symlink_metadata().is_ok();
        let problem = shown.and_then(|shown| {
            // Another layer's store may have no such level.
            let part = Part::of(scene, volumes, self.mesh.level).inspect_err(|_| self.mesh.level = 0)?;
            let (_, volume, store) = first_store(scene, volumes)?;
            self.mesh.show(ui, &part, volume, shown);
            ui.label(part.in_words());
            let request = self.mesh.request(&part, shown);
            match self.mesh.problem(&part, shown) {
                Some(problem) => Err(problem),
                None => check_mesh(store, &path, &request).map_err(|error| error.to_string()),
            }
        });
        let replaces = self.mesh.replaces;
        let problem = problem.err();
        self.confirm(ui, problem.as_deref(), replaces, is_entered).then(|| Command::Mesh(path, self.mesh.clone()))
    }

    /// Shows the problem with an export, or the warning that its file exists, and the button. Returns whether to export: only the button replaces files.
    fn confirm(&self, ui: &mut Ui, problem: Option<&str>, replaces: bool, is_entered: bool) -> bool {
        let warning = replaces.then_some("This file exists: it will be replaced.");
        if let Some(text) = problem.or(warning) {
            ui.colored_label(ui.visuals().warn_fg_color, text);
        }
        let name = if replaces { "Replace" } else { "Export" };
        let is_clicked = ui.add_enabled(problem.is_none(), Button::new(name)).clicked();
        is_clicked || is_entered && problem.is_none() && !replaces
    }

    fn edit(&mut self, ui: &mut Ui, scene: &Scene, volumes: &[VolumeSource]) -> Option<MetadataEdit> {
        let store = match first_store(scene, volumes) {
            Ok((_, _, store)) => store,
            Err(problem) => {
                ui.colored_label(ui.visuals().warn_fg_color, problem);
                return None;
            }
        };
        ui.label("Metadata of the first visible layer's store. Voxels stay as they are.");
        ui.label(RichText::new(store.path().display().to_string()).weak());
        // The first visible layer may become another store's, to which these values do not belong.
        self.edit.take_if(|form| !form.is_about(store));
        let form = self.edit.get_or_insert_with(|| EditForm::of(store));
        let is_entered = form.show(ui, std::mem::take(&mut self.wants_focus));
        let changes = form.changes();
        let problem = changes.as_ref().err().unwrap_or(&self.problem);
        if !problem.is_empty() {
            ui.colored_label(ui.visuals().warn_fg_color, problem);
        }
        let changes = changes.ok().filter(|changes| *changes != MetadataEdit::default());
        let is_clicked = ui.add_enabled(changes.is_some(), Button::new("Apply")).clicked();
        let changes = changes.filter(|_| is_clicked || is_entered);
        if changes.is_some() {
            self.problem.clear();
        }
        changes
    }

    /// Shows a file's name and full path. Returns the path, and whether Enter ended it.
    fn file(&mut self, ui: &mut Ui) -> (PathBuf, bool) {
        let is_entered = row(ui, "file", FILE_HINT, |ui, label| {
            let field = TextEdit::singleline(&mut self.path).desired_width(f32::INFINITY);
            let field = ui.add(field).labelled_by(label);
            if std::mem::take(&mut self.wants_focus) {
                field.request_focus();
            }
            field.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter))
        });
        let path = PathBuf::from(&self.path);
        let there = std::path::absolute(&path).unwrap_or_else(|_| path.clone());
        ui.label(RichText::new(there.display().to_string()).weak());
        (path, is_entered)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::WindowState;
    use brickyard::import::{SynthKind, SynthSource};
    use brickyard::store::{PackOptions, pack};
    use brickyard::volume::{Extent, VoxelType};
    use eframe::egui::accesskit::Role;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable;
    use glam::DVec3;

    /// A dialog, and its result.
    struct Shown {
        dialog: Dialog,
        stays: bool,
        command: Option<Command>,
    }

    fn harness<'a>(kind: DialogKind, folder: &Path, scene: Scene, volumes: Vec<VolumeSource>) -> Harness<'a, Shown> {
        let mut dialog = Dialog::new(kind, folder, (300, 200), Marks::shown(&WindowState::default()));
        dialog.path = folder.join(&dialog.path).display().to_string();
        let shown = Shown { dialog, stays: true, command: None };
        let show = move |ui: &mut Ui, shown: &mut Shown| {
            let (stays, command) = shown.dialog.show(ui.ctx(), (300, 200), &scene, &volumes);
            shown.stays &= stays;
            shown.command = command.or(shown.command.take());
        };
        Harness::builder().with_size([640.0, 480.0]).build_ui_state(show, shown)
    }

    fn click(harness: &mut Harness<'_, Shown>, button: &str) {
        harness.get_by_role_and_label(Role::Button, button).click();
        harness.run();
    }

    #[test]
    fn a_picture_is_saved_in_the_size_that_is_chosen() {
        let folder = tempfile::tempdir().unwrap();
        let mut harness = harness(DialogKind::SavePicture, folder.path(), Scene::default(), Vec::new());
        harness.run();
        assert!(harness.query_by_label_contains("it will be replaced").is_none());
        std::fs::write(folder.path().join(PICTURE_FILE), "mine").unwrap();
        click(&mut harness, "4x");
        assert!(harness.query_by_label_contains("it will be replaced").is_some());
        assert!(harness.state().stays);
        for mark in ["box", "axes", "ticks"] {
            harness.get_by_role_and_label(Role::CheckBox, mark).click();
            harness.run();
        }
        click(&mut harness, "Save picture");
        let marks = "ticks,scale_bar,color_bar,letters,distances".parse().ok();
        let form = PictureForm { size_px: Some((1200, 800)), marks };
        let expected = Command::SavePicture(folder.path().join(PICTURE_FILE), form);
        assert_eq!((harness.state().stays, &harness.state().command), (false, &Some(expected)));
    }

    #[test]
    fn a_file_that_does_not_say_what_it_holds_is_described() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.raw");
        std::fs::write(&path, vec![0; 2 * 64 * 64 * 64]).unwrap();
        let kind = DialogKind::Describe(Placing::Beside);
        let mut harness = harness(kind, folder.path(), Scene::default(), Vec::new());
        harness.state_mut().dialog.ask_about(&path, Description::default(), "it does not say".into());
        harness.run();
        assert!(harness.query_by_label_contains("it does not say").is_some());
        click(&mut harness, "64 x 64 x 64 u16");
        assert!(harness.state().stays);
        click(&mut harness, "Open");
        let said = serde_json::from_str(r#"{"shape": [64, 64, 64], "voxel_type": "u16"}"#).unwrap();
        assert_eq!(harness.state().command, Some(Command::OpenAs(path, said, Placing::Beside)));
    }

    #[test]
    fn a_scene_is_saved_by_the_enter_key_and_a_dialog_is_left_by_escape() {
        let folder = tempfile::tempdir().unwrap();
        let mut saved = harness(DialogKind::SaveScene, folder.path(), Scene::default(), Vec::new());
        saved.run();
        saved.get_by_role(Role::TextInput).focus();
        saved.run();
        saved.key_press(Key::Enter);
        saved.run();
        assert_eq!(saved.state().command, Some(Command::SaveScene(folder.path().join(SCENE_FILE))));
        let mut left = harness(DialogKind::SaveScene, folder.path(), Scene::default(), Vec::new());
        left.run();
        left.key_press(Key::Escape);
        left.run();
        assert_eq!((left.state().stays, &left.state().command), (false, &None));
    }

    #[test]
    fn an_export_says_how_large_it_is_and_why_it_cannot_be() {
        let folder = tempfile::tempdir().unwrap();
        let source = SynthSource::new(SynthKind::Turbulence, Extent::new(30, 20, 10), VoxelType::U16, 1, 1).unwrap();
        let store = folder.path().join("a.zarr");
        pack(&source, &store, &PackOptions::new(VoxelType::U16), &()).unwrap();
        let volumes = vec![VolumeSource::open(&store).unwrap()];
        // From the centre of one voxel to that of another, including parts of both.
        let clip = Some([DVec3::new(2.0, 3.0, 4.0), DVec3::new(7.0, 19.0, 8.0)]);
        let scene = Scene { clip, ..Scene::default() };
        let mut with_store = harness(DialogKind::Export, folder.path(), scene, volumes);
        with_store.run();
        assert!(with_store.query_by_label_contains("6 x 17 x 5 voxels, u16").is_some());
        with_store.state_mut().dialog.path = folder.path().join("a.xyz").display().to_string();
        with_store.run();
        assert!(with_store.query_by_label_contains("ending in .zarr").is_some());
        click(&mut with_store, "Export");
        assert_eq!(with_store.state().command, None);
        with_store.state_mut().dialog.path = "b.raw".into();
        with_store.run();
        click(&mut with_store, "Export");
        assert_eq!(with_store.state().command, Some(Command::Export("b.raw".into(), ExportForm::default())));
        // A header is written beside it, so it is replaced, too.
        std::fs::write(folder.path().join("there.raw.json"), "mine").unwrap();
        let there = folder.path().join("there.raw");
        with_store.state_mut().dialog.path = there.display().to_string();
        with_store.run();
        assert!(with_store.query_by_label_contains("it will be replaced").is_some());
        click(&mut with_store, "Replace");
        let mut form = ExportForm::default();
        form.replaces = true;
        assert_eq!(with_store.state().command, Some(Command::Export(there, form)));
        let mut of_preview =
            harness(DialogKind::Export, folder.path(), Scene::default(), vec![crate::nothing::volume()]);
        of_preview.run();
        assert!(of_preview.query_by_label_contains("until this volume is packed").is_some());
    }
    fn series(folder: &Path) -> Vec<VolumeSource> {
        vec![crate::part::tests::store(folder)]
    }

    #[test]
    fn level_and_steps_of_an_export_are_chosen() {
        let folder = tempfile::tempdir().unwrap();
        let scene = Scene { time: 1, ..Scene::default() };
        let mut harness = harness(DialogKind::Export, folder.path(), scene, series(folder.path()));
        harness.run();
        click(&mut harness, "all");
        harness.state_mut().dialog.export.level = 1;
        harness.run();
        assert!(harness.query_by_label_contains("15 x 10 x 5 voxels, u16: 0.0 MiB").is_some());
        click(&mut harness, "Export");
        let expected = ExportForm::read("level=1 steps=0-2 x").unwrap().0;
        let path = folder.path().join(VOXELS_FILE);
        assert_eq!(harness.state().command, Some(Command::Export(path, expected)));
    }

    #[test]
    fn a_mesh_is_of_what_is_shown_and_says_why_it_cannot_be() {
        let folder = tempfile::tempdir().unwrap();
        let mut scene = Scene::default();
        scene.layers[0].window = Some([20000.0, 40000.0]);
        let mut harness = harness(DialogKind::Mesh, folder.path(), scene, series(folder.path()));
        let path = folder.path().join("a.stl");
        for (name, problem) in [("a.xyz", "choose a name ending in .stl"), ("a.zarr/a.stl", "inside")] {
            harness.state_mut().dialog.path = folder.path().join(name).display().to_string();
            harness.run();
            assert!(harness.query_by_label_contains(problem).is_some(), "{name}");
            click(&mut harness, "Export");
            assert_eq!(harness.state().command, None, "{name}");
        }
        harness.state_mut().dialog.path = path.display().to_string();
        harness.run();
        click(&mut harness, "Export");
        let expected = MeshForm::read("isovalue=30000 a.stl").unwrap().0;
        assert_eq!(harness.state().command, Some(Command::Mesh(path.clone(), expected)));
        harness.state_mut().command = None;
        for (typed, problem) in [("1e9", "no value is as high"), ("25000", "it will be replaced")] {
            std::fs::write(&path, "mine").unwrap();
            harness.get_by_role_and_label(Role::SpinButton, "isovalue").focus();
            harness.run();
            harness.get_by_role_and_label(Role::SpinButton, "isovalue").type_text(typed);
            harness.run();
            harness.key_press(Key::Enter);
            harness.run();
            assert!(harness.query_by_label_contains(problem).is_some(), "{typed}");
            click(&mut harness, "Replace");
            assert_eq!(harness.state().command.is_some(), typed == "25000", "{typed}");
        }
        let expected = MeshForm::read("isovalue=25000 replace=yes a.stl").unwrap().0;
        assert_eq!(harness.state().command, Some(Command::Mesh(path, expected)));
    }

    #[test]
    fn metadata_are_typed_and_a_refusal_is_shown_beside_them() {
        let folder = tempfile::tempdir().unwrap();
        let volumes = series(folder.path());
        let mut harness = harness(DialogKind::Edit, folder.path(), Scene::default(), volumes);
        harness.run();
        // Nothing is changed yet.
        click(&mut harness, "Apply");
        assert_eq!(harness.state().command, None);
        harness.get_by_role_and_label(Role::TextInput, "name").focus();
        harness.run();
        harness.get_by_role_and_label(Role::TextInput, "name").type_text("left eye");
        harness.run();
        harness.get_by_role_and_label(Role::TextInput, "unit").focus();
        harness.run();
        harness.get_by_role_and_label(Role::TextInput, "unit").type_text("parsnip");
        harness.run();
        harness.key_press(Key::Enter);
        harness.run();
        let expected = serde_json::from_str(r#"{"name": "left eye", "unit": "parsnip"}"#).unwrap();
        assert_eq!((harness.state().stays, &harness.state().command), (true, &Some(Command::Edit(expected))));
        harness.state_mut().dialog.refuse("there is no unit parsnip".into());
        harness.run();
        assert!(harness.query_by_label_contains("there is no unit parsnip").is_some());
        harness.key_press(Key::Escape);
        harness.run();
        assert!(!harness.state().stays);
    }
}
