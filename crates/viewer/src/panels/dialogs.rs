//! Dialogs about files: which to open or to add, and the name and size of a picture, scene or export to write. A dialog stays until it gives a
//! command or is closed.

use crate::command::{Command, PictureForm, Placing};
use crate::exporting::Part;
use crate::file_browser::FileBrowser;
use crate::keys::{PICTURE_FILE, SCENE_FILE};
use crate::marks::Marks;
use crate::panels::description::Description;
use crate::panels::widgets::{group, row};
use brickyard::export::paths_of;
use brickyard::session::VolumeSource;
use brickyard::volume::{Extent, Scene};
use eframe::egui::{self, Button, DragValue, Key, RichText, TextEdit, Ui, pos2};
use std::path::{Path, PathBuf};

/// The file for exported voxels, in the folder the window was opened from.
const VOXELS_FILE: &str = "brickyard.npy";

/// Names of exports, by their formats.
const FORMATS: &str = "choose a name ending in .zarr, .nii, .nii.gz, .nrrd, .mha, .mhd, .vti, .tif (ImageJ), .ome.tif, .npy (NumPy), .raw or, for a \
    folder of PNG planes, /";

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
}

/// An open dialog.
pub(crate) struct Dialog {
    kind: DialogKind,
    browser: FileBrowser,
    /// The file to write, or to describe.
    path: String,
    /// The description of files to open.
    description: Description,
    /// The error of opening a file with it.
    problem: String,
    size_px: (u32, u32),
    marks: Marks,
}

impl Dialog {
    /// Creates a dialog about files of a folder, and a picture of this shown size and marks.
    pub(crate) fn new(kind: DialogKind, folder: &Path, shown_px: (u32, u32), marks: Marks) -> Self {
        let path = match kind {
            DialogKind::Open(_) | DialogKind::Describe(_) => "",
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
            DialogKind::Export => self.export(ui, Part::of(scene, volumes)),
        });
        let command = shown.and_then(|shown| shown.inner).flatten();
        let is_left = !is_open || egui.input(|input| input.key_pressed(Key::Escape));
        (!is_left && command.is_none(), command)
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
        let problem = match &part {
            Err(problem) => Some(problem.as_str()),
            Ok(_) => match paths_of(&path) {
                None => Some(FORMATS),
                Some(files) if files.iter().any(|file| file.exists()) => Some("this file exists: choose another name"),
                Some(_) => None,
            },
        };
        if let Ok(part) = &part {
            let Extent { x, y, z } = part.extent;
            let mib = part.bytes() as f64 / f64::from(1 << 20);
            ui.label(format!("{x} x {y} x {z} voxels, {}: {mib:.1} MiB", part.voxel_type()));
        }
        if let Some(problem) = problem {
            ui.colored_label(ui.visuals().warn_fg_color, problem);
        }
        let is_clicked = ui.add_enabled(problem.is_none(), Button::new("Export")).clicked();
        (is_clicked || is_entered && problem.is_none()).then_some(Command::Export(path))
    }

    /// Shows a file's name and full path. Returns the path, and whether Enter ended it.
    fn file(&mut self, ui: &mut Ui) -> (PathBuf, bool) {
        let is_entered = row(ui, "file", FILE_HINT, |ui, label| {
            let field = TextEdit::singleline(&mut self.path).desired_width(f32::INFINITY);
            let field = ui.add(field).labelled_by(label);
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
    use brickyard::volume::VoxelType;
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
        for (name, problem) in [("a.xyz", "ending in .zarr"), ("there.raw", "choose another name")] {
            std::fs::write(folder.path().join("there.raw"), "mine").unwrap();
            with_store.state_mut().dialog.path = folder.path().join(name).display().to_string();
            with_store.run();
            assert!(with_store.query_by_label_contains(problem).is_some(), "{name}");
            click(&mut with_store, "Export");
            assert_eq!(with_store.state().command, None, "{name}");
        }
        with_store.state_mut().dialog.path = "b.raw".into();
        with_store.run();
        click(&mut with_store, "Export");
        assert_eq!(with_store.state().command, Some(Command::Export("b.raw".into())));
        let mut of_preview =
            harness(DialogKind::Export, folder.path(), Scene::default(), vec![crate::nothing::volume()]);
        of_preview.run();
        assert!(of_preview.query_by_label_contains("until this volume is packed").is_some());
    }
}
