//! A list of a folder's files and folders, to open one: a store, a file, or a folder of planes or slices. A folder is read on entering it. Files
//! whose names fit no format are hidden unless requested.

use crate::keys::SCENE_FILE;
use brickyard::addresses::{is_address, local_path};
use brickyard::background::{Background, check_folder, list_choices};
use brickyard::import::ImportError;
use brickyard::import::zarr::Choice;
use brickyard::openable::{has_known_name, is_store};
use brickyard::store::is_foreign;
use eframe::egui::{self, Button, Key, Label, Modifiers, RichText, Ui};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Interval between polls of the check on the folder.
const CHECK_STEP: Duration = Duration::from_millis(50);

/// A folder and its entries.
pub(crate) struct FileBrowser {
    folder: PathBuf,
    /// Folders first, each by name; or the error of reading the folder.
    entries: Result<Vec<Entry>, String>,
    typed: String,
    /// Text to find in names.
    sought: String,
    /// Whether files whose names fit no format are listed, too.
    has_all: bool,
    /// Index of the entry opened by Enter, among the listed ones.
    marked: usize,
    /// Whether the name field is to get the focus.
    wants_focus: bool,
    /// The running check whether the folder itself can be opened.
    check: Option<Background<(), ImportError>>,
    /// The reason it cannot.
    refusal: Option<String>,
    /// Another program's Zarr, asked for, whose images are being listed.
    asked: Option<(PathBuf, Background<Vec<Choice>, ImportError>)>,
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
    /// One of several images of another program's Zarr.
    Image,
    File,
}

impl FileBrowser {
    pub(crate) fn new(folder: &Path) -> Self {
        // The parent of a bare file name is the working folder.
        let folder = if folder.as_os_str().is_empty() || is_address(folder) { Path::new(".") } else { folder };
        let folder = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
        Self {
            entries: entries(&folder).map_err(|error| format!("{}: {error}", folder.display())),
            typed: folder.display().to_string(),
            sought: String::new(),
            has_all: false,
            marked: 0,
            wants_focus: true,
            check: Some(check_folder(folder.clone())),
            refusal: None,
            asked: None,
            folder,
        }
    }

    fn enter(&mut self, folder: &Path) {
        *self = Self { has_all: self.has_all, ..Self::new(folder) };
    }

    /// Takes the result of the check, once there is one.
    fn follow_check(&mut self, ui: &Ui) {
        match self.check.as_mut().map(Background::poll) {
            None => {}
            Some(None) => ui.ctx().request_repaint_after(CHECK_STEP),
            Some(Some(checked)) => {
                let before = format!("{}: ", self.folder.display());
                self.refusal = checked.err().map(|error| error.to_string().replacen(&before, "", 1));
                self.check = None;
            }
        }
    }

    /// Lists the images of another program's Zarr, or returns its path as chosen if there is no choice: its opening tells of any damage.
    fn follow_asked(&mut self, ui: &Ui) -> Option<PathBuf> {
        let (path, images) = self.asked.as_mut()?;
        let Some(listed) = images.poll() else {
            ui.ctx().request_repaint_after(CHECK_STEP);
            return None;
        };
        let path = std::mem::take(path);
        self.asked = None;
        let images = listed.unwrap_or_default();
        if images.is_empty() {
            return Some(path);
        }
        let entry = |image: Choice| Entry { name: image.words, path: image.path, kind: EntryKind::Image };
        *self = Self {
            entries: Ok(images.into_iter().map(entry).collect()),
            check: None,
            refusal: Some("choose an image".into()),
            has_all: self.has_all,
            ..Self::new(&path)
        };
        None
    }

    /// The place for a text: an address, or a path from the folder on.
    fn place_of(&self, typed: &str) -> PathBuf {
        let typed = local_path(Path::new(typed.trim())).into_owned();
        if is_address(&typed) { typed } else { self.folder.join(typed) }
    }

    /// Enters a folder, or else returns the path as chosen, unless it is another program's Zarr, of maybe several images.
    fn go(&mut self, path: PathBuf) -> Option<PathBuf> {
        let is_image = |entry: &Entry| entry.kind == EntryKind::Image && entry.path == path;
        let is_chosen = self.entries.iter().flatten().any(is_image);
        // A server may take its time, so the list is made elsewhere.
        if !is_chosen && (is_address(&path) || path.is_dir() && is_foreign(&path)) {
            self.asked = Some((path.clone(), list_choices(path)));
            return None;
        }
        if path.is_dir() && !is_store(&path) {
            self.enter(&path);
            return None;
        }
        Some(path)
    }

    /// Whether an entry passes the filters.
    fn lists(&self, entry: &Entry) -> bool {
        let is_known = entry.kind != EntryKind::File || has_known_name(&entry.path);
        (self.has_all || is_known) && entry.name.to_lowercase().contains(&self.sought.to_lowercase())
    }

    /// Shows the list. Returns the chosen path.
    pub(crate) fn show(&mut self, ui: &mut Ui) -> Option<PathBuf> {
        let mut target = None;
        let mut chosen = None;
        ui.horizontal(|ui| {
            if ui.button("Up").clicked() {
                target = self.folder.parent().map(Path::to_path_buf);
            }
            let field = ui.add(egui::TextEdit::singleline(&mut self.typed).desired_width(f32::INFINITY));
            let field = field.accessible_name("folder");
            let field =
                field.on_hover_text("a folder, or a store's address: https://, s3://, gs://, az://; Enter goes there");
            if field.lost_focus() && ui.input(|input| input.key_pressed(egui::Key::Enter)) {
                target = Some(self.place_of(&self.typed));
            }
        });
        let (listed, is_moved) = self.search(ui, &mut target);
        ui.separator();
        egui::ScrollArea::vertical().auto_shrink(false).max_height(360.0).show(ui, |ui| match &self.entries {
            Err(problem) => {
                ui.colored_label(ui.visuals().error_fg_color, problem);
            }
            Ok(entries) => {
                if listed.is_empty() {
                    ui.weak(if entries.is_empty() {
                        "an empty folder"
                    } else {
                        "no such file here; see \"all files\""
                    });
                }
                for (place, entry) in listed.iter().map(|&i| &entries[i]).enumerate() {
                    let line = ui.selectable_label(place == self.marked, entry.words());
                    if place == self.marked && is_moved {
                        line.scroll_to_me(None);
                    }
                    if line.clicked() {
                        target = Some(entry.path.clone());
                    }
                }
            }
        });
        ui.separator();
        self.follow_check(ui);
        ui.horizontal(|ui| {
            let button = ui.add_enabled(self.refusal.is_none(), Button::new("Open this folder"));
            let refusal = self.refusal.as_deref().unwrap_or_default();
            let button = button.on_hover_text("a folder of TIFF planes, DICOM slices, or files of one time step each");
            if button.on_disabled_hover_text(refusal).clicked() {
                chosen = Some(self.folder.clone());
            }
            ui.add(Label::new(RichText::new(refusal).weak()).truncate());
        });
        if let Some((path, _)) = &self.asked {
            ui.horizontal(|ui| {
                ui.spinner();
                ui.weak(format!("looking at {}", path.display()));
            });
        }
        let asked = self.follow_asked(ui);
        chosen.or(asked).or_else(|| self.go(target?))
    }

    /// Shows the field for a part of names, focused at first: arrows mark an entry, Enter opens it. Returns the listed entries, and
    /// whether the mark has moved.
    fn search(&mut self, ui: &mut Ui, target: &mut Option<PathBuf>) -> (Vec<usize>, bool) {
        let id = ui.scope_id().with("sought");
        let mut steps = 0;
        if ui.memory(|memory| memory.has_focus(id)) {
            let count = |key| ui.input_mut(|input| input.count_and_consume_key(Modifiers::NONE, key)) as isize;
            steps = count(Key::ArrowDown) - count(Key::ArrowUp);
        }
        let mut is_entered = false;
        ui.horizontal(|ui| {
            let field = egui::TextEdit::singleline(&mut self.sought).hint_text("find a name").desired_width(200.0);
            let field = ui.add(field.id(id));
            is_entered = field.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter));
            if std::mem::take(&mut self.wants_focus) {
                field.request_focus();
            }
            if field.changed() {
                self.marked = 0;
            }
            let hint = "shows files with any name, such as raw files of numbers";
            ui.checkbox(&mut self.has_all, "all files").on_hover_text(hint);
        });
        let entries = self.entries.as_deref().unwrap_or_default();
        let indices: Vec<_> = (0..entries.len()).filter(|&i| self.lists(&entries[i])).collect();
        self.marked = self.marked.saturating_add_signed(steps).min(indices.len().saturating_sub(1));
        if is_entered {
            *target = indices.get(self.marked).map(|&i| entries[i].path.clone());
        }
        (indices, steps != 0)
    }
}

impl Entry {
    fn words(&self) -> String {
        match self.kind {
            EntryKind::Folder => format!("{}/", self.name),
            EntryKind::Store => format!("{} (store)", self.name),
            EntryKind::Image | EntryKind::File => self.name.clone(),
        }
    }
}

/// A folder's entries, without hidden ones.
fn entries(folder: &Path) -> std::io::Result<Vec<Entry>> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        // A scene saved by a window lies beside its volumes, but is none of them.
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
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable;

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
        std::fs::write(root.join("brain.zarr/zarr.json"), r#"{"attributes": {"brickyard": {}}}"#).unwrap();
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

    #[test]
    fn addresses_are_no_paths_of_the_folder() {
        let folder = tempfile::tempdir().unwrap();
        let browser = FileBrowser::new(folder.path());
        let place = |typed: &str| browser.place_of(typed).display().to_string();
        assert_eq!(place(" https://a.org/b.zarr "), "https://a.org/b.zarr");
        assert_eq!(place("file:///scans/b.zarr"), "/scans/b.zarr");
        assert_eq!(browser.place_of("b.zarr"), folder.path().join("b.zarr"));
    }

    /// A group of Zarr with arrays of these names.
    fn zarr_of(folder: &Path, names: &[&str]) {
        std::fs::create_dir_all(folder).unwrap();
        std::fs::write(folder.join("zarr.json"), r#"{"zarr_format": 3, "node_type": "group"}"#).unwrap();
        let array = r#"{"zarr_format": 3, "node_type": "array", "shape": [4, 5, 6], "data_type": "uint8", "fill_value": 0,
            "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [4, 5, 6]}}, "codecs": [{"name": "bytes"}],
            "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}}}"#;
        for name in names {
            std::fs::create_dir(folder.join(name)).unwrap();
            std::fs::write(folder.join(name).join("zarr.json"), array).unwrap();
        }
    }

    #[test]
    fn one_of_several_images_of_a_zarr_is_chosen() {
        let folder = tempfile::tempdir().unwrap();
        zarr_of(&folder.path().join("several.zarr"), &["left", "right"]);
        zarr_of(&folder.path().join("single.zarr"), &["only"]);
        let mut harness = harness(folder.path(), &[]);
        harness.get_by_label("single.zarr (store)").click();
        let is_chosen = |harness: &mut Harness<'_, (FileBrowser, Option<PathBuf>)>| {
            harness.step();
            harness.state().1.clone()
        };
        let wait = |harness: &mut Harness<'_, (FileBrowser, Option<PathBuf>)>, done: &dyn Fn(&FileBrowser) -> bool| {
            for _ in 0..1000 {
                if is_chosen(harness).is_some() || done(&harness.state().0) {
                    return;
                }
                std::thread::sleep(Duration::from_millis(10));
            }
            panic!("no image within ten seconds");
        };
        wait(&mut harness, &|_| false);
        assert_eq!(harness.state_mut().1.take(), Some(folder.path().join("single.zarr")));
        harness.get_by_label("several.zarr (store)").click();
        wait(&mut harness, &|browser| browser.refusal.as_deref() == Some("choose an image"));
        harness.step();
        harness.get_by_label("right (4 x 5 x 6, u8)").click();
        wait(&mut harness, &|_| false);
        let path = format!("{}::right", folder.path().join("several.zarr").display());
        assert_eq!(harness.state().1, Some(PathBuf::from(path)));
        harness.get_by_label("Up").click();
        harness.step();
        harness.step();
        assert!(harness.query_by_label("single.zarr (store)").is_some());
    }

    fn harness<'a>(folder: &Path, names: &[&str]) -> Harness<'a, (FileBrowser, Option<PathBuf>)> {
        names.iter().for_each(|name| std::fs::write(folder.join(name), "x").unwrap());
        let show = |ui: &mut Ui, (browser, chosen): &mut (FileBrowser, Option<PathBuf>)| {
            *chosen = chosen.take().or(browser.show(ui));
        };
        Harness::new_ui_state(show, (FileBrowser::new(folder), None))
    }

    #[test]
    fn names_are_found_and_opened_by_keys() {
        let folder = tempfile::tempdir().unwrap();
        let mut harness = harness(folder.path(), &["a1.npy", "b1.npy", "b2.npy", "b3.npy"]);
        harness.run();
        // Typing goes to the focused field.
        harness.event(egui::Event::Text("b".into()));
        harness.run();
        for key in [Key::ArrowDown, Key::ArrowDown, Key::ArrowDown, Key::ArrowUp, Key::Enter] {
            harness.key_press(key);
            harness.run();
        }
        assert_eq!(harness.state().1, Some(folder.path().join("b2.npy")));
    }

    #[test]
    fn a_folder_of_several_formats_is_not_opened_as_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let mut harness = harness(folder.path(), &["a.npy", "b.npy", "c.tif"]);
        while harness.state().0.check.is_some() {
            harness.run();
        }
        harness.run();
        let refusal =
            "holds 1 TIFF and 2 .npy files: choose one of them, or those of one format by a pattern of their names";
        assert!(harness.query_by_label(refusal).is_some());
        harness.get_by_label("Open this folder").click();
        harness.run();
        assert_eq!(harness.state().1, None);
        std::fs::remove_file(folder.path().join("c.tif")).unwrap();
        harness.state_mut().0.enter(folder.path());
        harness.run();
        harness.get_by_label("Open this folder").click();
        harness.run();
        assert_eq!(harness.state().1, Some(folder.path().to_owned()));
    }
}
