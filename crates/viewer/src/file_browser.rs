//! A list of the files and folders of a folder, to choose one that is opened: a store, a file, or a folder of planes or slices. A folder is read when it is entered. Files
//! that nothing opens, by their names, are left out unless they are asked for.

use crate::keys::SCENE_FILE;
use brickyard::openable::{has_known_name, is_store};
use eframe::egui::{self, Ui};
use std::path::{Path, PathBuf};

/// A folder, and what is in it.
pub(crate) struct FileBrowser {
    folder: PathBuf,
    /// Folders first, each by name; or why the folder cannot be read.
    entries: Result<Vec<Entry>, String>,
    /// The path that is typed.
    typed: String,
    /// Text to find in names.
    sought: String,
    /// Whether files are listed, too, that nothing opens by their names.
    has_all: bool,
}

#[derive(Debug, PartialEq)]
struct Entry {
    name: String,
    path: PathBuf,
    kind: EntryKind,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum EntryKind {
    Folder,
    Store,
    File,
}

impl FileBrowser {
    /// Shows a folder at first.
    pub(crate) fn new(folder: &Path) -> Self {
        let mut browser = Self {
            folder: PathBuf::new(),
            entries: Ok(Vec::new()),
            typed: String::new(),
            sought: String::new(),
            has_all: false,
        };
        browser.enter(folder);
        browser
    }

    fn enter(&mut self, folder: &Path) {
        // The folder beside a file without one is the working folder.
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        self.folder = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
        self.entries = entries(&self.folder).map_err(|error| format!("{}: {error}", self.folder.display()));
        self.typed = self.folder.display().to_string();
        self.sought.clear();
    }

    /// Goes to what was clicked or typed: into a folder, else it is chosen.
    fn go(&mut self, path: PathBuf) -> Option<PathBuf> {
        if path.is_dir() && !is_store(&path) {
            self.enter(&path);
            return None;
        }
        Some(path)
    }

    /// Whether an entry is among those that are asked for.
    fn lists(&self, entry: &Entry) -> bool {
        let is_known = entry.kind != EntryKind::File || has_known_name(&entry.path);
        (self.has_all || is_known) && entry.name.to_lowercase().contains(&self.sought.to_lowercase())
    }

    /// Shows the list. Returns what was chosen.
    pub(crate) fn show(&mut self, ui: &mut Ui) -> Option<PathBuf> {
        let mut target = None;
        let mut chosen = None;
        ui.horizontal(|ui| {
            if ui.button("Up").clicked() {
                target = self.folder.parent().map(Path::to_path_buf);
            }
            let field = ui.add(egui::TextEdit::singleline(&mut self.typed).desired_width(f32::INFINITY));
            if field.lost_focus() && ui.input(|input| input.key_pressed(egui::Key::Enter)) {
                target = Some(self.folder.join(&self.typed));
            }
        });
        ui.horizontal(|ui| {
            let field = egui::TextEdit::singleline(&mut self.sought).hint_text("find a name").desired_width(200.0);
            ui.add(field);
            let hint = "also those whose names are of no format that is read; a file of numbers may have any name";
            ui.checkbox(&mut self.has_all, "all files").on_hover_text(hint);
        });
        ui.separator();
        egui::ScrollArea::vertical().auto_shrink(false).max_height(360.0).show(ui, |ui| match &self.entries {
            Err(problem) => {
                ui.colored_label(ui.visuals().error_fg_color, problem);
            }
            Ok(entries) => {
                let shown: Vec<_> = entries.iter().filter(|entry| self.lists(entry)).collect();
                if shown.is_empty() {
                    ui.weak(if entries.is_empty() {
                        "an empty folder"
                    } else {
                        "none of such a name; see \"all files\""
                    });
                }
                for entry in shown {
                    let words = match entry.kind {
                        EntryKind::Folder => format!("{}/", entry.name),
                        EntryKind::Store => format!("{} (store)", entry.name),
                        EntryKind::File => entry.name.clone(),
                    };
                    if ui.selectable_label(false, words).clicked() {
                        target = Some(entry.path.clone());
                    }
                }
            }
        });
        ui.separator();
        if ui.button("Open this folder").on_hover_text("a folder of TIFF planes or DICOM slices").clicked() {
            chosen = Some(self.folder.clone());
        }
        chosen.or_else(|| self.go(target?))
    }
}

/// What is in a folder, but for what is hidden.
fn entries(folder: &Path) -> std::io::Result<Vec<Entry>> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        // A scene that a window saved stands beside what it shows, and is none of it.
        if name.starts_with('.') || name == SCENE_FILE {
            continue;
        }
        let kind = match (path.is_dir(), is_store(&path)) {
            (true, true) => EntryKind::Store,
            (true, false) => EntryKind::Folder,
            (false, _) => EntryKind::File,
        };
        found.push(Entry { name, path, kind });
    }
    found.sort_by(|a, b| (a.kind, &a.name).cmp(&(b.kind, &b.name)));
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_come_before_stores_before_files() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        for name in ["z-scans", "brain.zarr"] {
            std::fs::create_dir(root.join(name)).unwrap();
        }
        for name in ["brain.zarr/zarr.json", "a.tif", ".hidden", "brickyard.json"] {
            std::fs::write(root.join(name), "").unwrap();
        }
        let mut browser = FileBrowser::new(root);
        let names: Vec<_> = browser.entries.as_ref().unwrap().iter().map(|e| (&*e.name, e.kind)).collect();
        let expected = [("z-scans", EntryKind::Folder), ("brain.zarr", EntryKind::Store), ("a.tif", EntryKind::File)];
        assert_eq!(names, expected);
        let listed = |browser: &FileBrowser| {
            let entries = browser.entries.as_ref().unwrap().iter();
            entries.filter(|entry| browser.lists(entry)).map(|entry| entry.name.clone()).collect::<Vec<_>>()
        };
        std::fs::write(root.join("Notes.txt"), "").unwrap();
        browser.enter(root);
        assert_eq!(listed(&browser), ["z-scans", "brain.zarr", "a.tif"]);
        browser.has_all = true;
        browser.sought = "no".into();
        assert_eq!(listed(&browser), ["Notes.txt"]);
        browser.has_all = false;
        browser.sought = "BRAIN".into();
        assert_eq!(listed(&browser), ["brain.zarr"]);
        assert_eq!(browser.go(root.join("brain.zarr")), Some(root.join("brain.zarr")));
        assert_eq!(browser.go(root.join("z-scans")), None);
        assert_eq!((browser.folder.clone(), browser.entries.as_ref().unwrap().len()), (root.join("z-scans"), 0));
        browser.enter(Path::new(""));
        assert_eq!(browser.folder, std::env::current_dir().unwrap());
        browser.enter(&root.join("gone"));
        assert!(browser.entries.unwrap_err().contains("gone: No such file"));
    }
}
