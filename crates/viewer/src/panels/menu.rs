//! The menu: files, edits, and the look of the window.

use crate::command::{Command, PictureForm, Placing};
use crate::keys::{self, PICTURE_FILE, SCENE_FILE};
use crate::panels::dialogs::DialogKind;
use crate::state::{Budgets, Layout, PlaneFilter, State, Theme, Tool};
use brickyard::addresses::is_address;
use eframe::egui::{Button, DragValue, MenuBar, Slider, Ui};
use std::path::PathBuf;

/// The menu's data.
pub(crate) struct Subject<'a> {
    /// Recently opened paths, newest first.
    pub(crate) recent: &'a [PathBuf],
    /// Whether there is something to add to, and to save.
    pub(crate) has_volumes: bool,
    pub(crate) is_patient: bool,
    /// Whether an edit can be undone, and one redone.
    pub(crate) history: (bool, bool),
    pub(crate) budgets: Budgets,
    pub(crate) wanted: &'a mut Option<DialogKind>,
}

/// Shows an entry with its shortcut key, and takes its command.
fn entry(ui: &mut Ui, can: bool, text: &str, effect: &str, command: Command, commands: &mut Vec<Command>) {
    let entry = Button::new(text).shortcut_text(keys::shown(ui.ctx(), effect));
    if ui.add_enabled(can, entry).clicked() {
        commands.push(command);
    }
}

/// The name of a switch with its key.
fn switch(ui: &Ui, name: &str, effect: &str) -> String {
    format!("{name} ({})", keys::shown(ui.ctx(), effect))
}

pub(crate) fn show(ui: &mut Ui, state: &mut State, subject: Subject<'_>, commands: &mut Vec<Command>) {
    let Subject { is_patient, history: (can_undo, can_redo), budgets, .. } = subject;
    MenuBar::new().ui(ui, |ui| {
        ui.menu_button("File", |ui| files(ui, subject, commands));
        ui.menu_button("Edit", |ui| {
            entry(ui, can_undo, "Undo", "undo", Command::Undo, commands);
            entry(ui, can_redo, "Redo", "redo", Command::Redo, commands);
            if ui.add_enabled(!state.window.distances.is_empty(), Button::new("Remove distances")).clicked() {
                state.window.distances.clear();
            }
        });
        ui.menu_button("View", |ui| view(ui, state, is_patient));
        ui.menu_button("Window", |ui| window(ui, state, budgets));
        ui.separator();
        let turn = "dragging turns the view around the point under the pointer".into();
        let fly = "W A S D, E and Q move the eye, dragging looks around";
        let fly = switch(ui, fly, "fly: W A S D, E and Q, drag to look around");
        let measure = switch(ui, "two clicks measure a distance", "measure a distance by two clicks");
        for (tool, name, effect) in
            [(Tool::Turn, "turn", turn), (Tool::Fly, "fly", fly), (Tool::Distance, "measure", measure)]
        {
            ui.selectable_value(&mut state.window.tool, tool, name).on_hover_text(effect);
        }
        ui.separator();
        let hint = switch(ui, "all keys and pointer actions", "these keys");
        ui.toggle_value(&mut state.window.help, "help").on_hover_text(hint);
    });
}

fn files(ui: &mut Ui, subject: Subject<'_>, commands: &mut Vec<Command>) {
    let Subject { recent, has_volumes, wanted, .. } = subject;
    if ui.button("Open...").clicked() {
        *wanted = Some(DialogKind::Open(Placing::Instead));
    }
    let hint = "volumes and meshes, in addition to the present ones; dropping files with Shift held adds them, too";
    if ui.add_enabled(has_volumes, Button::new("Add...")).on_hover_text(hint).clicked() {
        *wanted = Some(DialogKind::Open(Placing::Beside));
    }
    ui.menu_button("Open again", |ui| {
        for path in recent {
            // A missing path is greyed out: its disk may come back.
            let button = Button::new(path.display().to_string());
            if ui.add_enabled(is_address(path) || path.exists(), button).clicked() {
                commands.push(Command::Open(vec![path.clone()], Placing::Instead));
            }
        }
    });
    ui.separator();
    ui.add_enabled_ui(has_volumes, |ui| {
        let picture = format!("Save picture ({PICTURE_FILE})");
        let save_picture = Command::SavePicture(PICTURE_FILE.into(), PictureForm::default());
        entry(ui, true, &picture, "save the picture", save_picture, commands);
        let scene = format!("Save scene ({SCENE_FILE})");
        entry(ui, true, &scene, "save the scene", Command::SaveScene(SCENE_FILE.into()), commands);
        for (text, kind) in [
            ("Save picture...", DialogKind::SavePicture),
            ("Save scene as...", DialogKind::SaveScene),
            ("Export voxels...", DialogKind::Export),
            ("Export mesh...", DialogKind::Mesh),
            ("Edit metadata...", DialogKind::Edit),
        ] {
            if ui.button(text).clicked() {
                *wanted = Some(kind);
            }
        }
    });
    ui.separator();
    entry(ui, true, "Quit", "quit", Command::Quit, commands);
}

fn view(ui: &mut Ui, state: &mut State, is_patient: bool) {
    let window = &mut state.window;
    ui.radio_value(&mut window.layout, Layout::Single, "the volume alone");
    let planes = switch(ui, "three slices beside it", "three slices beside the volume");
    ui.radio_value(&mut window.layout, Layout::Planes, planes);
    ui.add_enabled_ui(window.layout == Layout::Planes, |ui| {
        ui.checkbox(&mut window.planes.gray, "slices in gray");
        ui.label("voxels of slices");
        ui.radio_value(&mut window.planes.filter, PlaneFilter::Auto, "squares where they are large");
        ui.radio_value(&mut window.planes.filter, PlaneFilter::Nearest, "squares");
        ui.radio_value(&mut window.planes.filter, PlaneFilter::Linear, "smooth");
    });
    ui.separator();
    let overlays = &mut window.overlays;
    for (is_shown, name, has_key) in [
        (&mut overlays.outline, "box", false),
        (&mut overlays.ticks, "ticks", true),
        (&mut overlays.axes, "axes", true),
        (&mut overlays.scale_bar, "scale bar", true),
        (&mut overlays.color_bar, "colour bar", false),
        (&mut overlays.clip_handles, "handles of clip box and planes", false),
        (&mut overlays.bricks, "bricks", false),
    ] {
        let name = if has_key { switch(ui, name, name) } else { name.into() };
        ui.checkbox(is_shown, name);
    }
    if is_patient {
        ui.checkbox(&mut overlays.letters, "letters of the patient's sides on slices");
    }
}

fn window(ui: &mut Ui, state: &mut State, budgets: Budgets) {
    let window = &mut state.window;
    ui.checkbox(&mut window.motion.adaptive, "coarser while it moves");
    ui.add_enabled(
        window.motion.adaptive,
        Slider::new(&mut window.motion.frame_goal_ms, 5.0..=500.0).logarithmic(true).text("ms a frame"),
    );
    ui.separator();
    let mut edited = budgets;
    ui.add(DragValue::new(&mut edited.gpu).range(64..=1 << 20).suffix(" MiB of slots"));
    ui.add(DragValue::new(&mut edited.host).range(64..=1 << 20).suffix(" MiB of bricks"));
    if edited != budgets {
        window.budgets_mib = Some(edited);
    }
    ui.separator();
    let panels = switch(ui, "panels", "panels around the pictures, or the pictures alone");
    ui.checkbox(&mut window.panels, panels)
        .on_hover_text("panels around the pictures; F10 hides them and brings them back");
    let fullscreen = switch(ui, "the whole screen", "the whole screen");
    ui.checkbox(&mut window.fullscreen, fullscreen);
    let diagnostics = switch(ui, "diagnostics", "diagnostics");
    ui.checkbox(&mut window.diagnostics, diagnostics);
    ui.radio_value(&mut window.theme, Theme::Dark, "dark");
    ui.radio_value(&mut window.theme, Theme::Light, "light");
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui_kittest::Harness;
    use egui_kittest::kittest::{NodeT, Queryable};

    fn clicked(labels: &[&str]) -> (State, Vec<Command>) {
        let show = |ui: &mut Ui, (state, commands): &mut (State, Vec<Command>)| {
            let subject = Subject {
                recent: &["/no/such.zarr".into(), "/".into()],
                has_volumes: true,
                is_patient: false,
                history: (true, false),
                budgets: Budgets { gpu: 1024, host: 2048 },
                wanted: &mut None,
            };
            super::show(ui, state, subject, commands);
        };
        let mut harness = Harness::new_ui_state(show, (State::default(), Vec::new()));
        for label in labels {
            let find = |node: &egui_kittest::Node<'_>| {
                let name = node.accesskit_node().label().unwrap_or_default();
                name == *label || name.strip_prefix(label).is_some_and(|key| key.starts_with([' ', '(']))
            };
            harness.get_all_by(|_| true).find(find).unwrap_or_else(|| panic!("no {label}")).click();
            harness.run();
        }
        harness.state().clone()
    }

    #[test]
    fn every_entry_does_what_it_says() {
        assert_eq!(clicked(&["Edit", "Undo"]).1, [Command::Undo]);
        assert_eq!(clicked(&["File", "Quit"]).1, [Command::Quit]);
        assert_eq!(clicked(&["File", "Open again", "/"]).1, [Command::Open(vec!["/".into()], Placing::Instead)]);
        assert_eq!(clicked(&["File", "Open again", "/no/such.zarr"]).1, []);
        let (state, commands) = clicked(&["View", "three slices beside it"]);
        assert_eq!((state.window.layout, commands), (Layout::Planes, Vec::new()));
        assert!(clicked(&["View", "bricks"]).0.window.overlays.bricks);
        assert_eq!(clicked(&["Window", "light"]).0.window.theme, Theme::Light);
        let window = clicked(&["Window", "panels (F10)"]).0.window;
        assert!(!window.panels && !window.fullscreen);
        assert!(clicked(&["Window", "the whole screen (F11)"]).0.window.fullscreen);
        assert_eq!(clicked(&["fly"]).0.window.tool, Tool::Fly);
        assert!(clicked(&["help"]).0.window.help);
    }

    #[test]
    fn what_is_not_to_be_had_is_not_clicked() {
        assert_eq!(clicked(&["Edit", "Redo"]).1, []);
        assert_eq!(clicked(&["Window"]).0.window.budgets_mib, None);
    }
}
