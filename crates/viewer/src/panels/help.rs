//! The keys and what the pointer does, in one list: the window acts by it, and the help shows it.

use crate::command::Command;
use brickyard::volume::Mode;
use eframe::egui::{self, Event, Key, KeyboardShortcut, Modifiers, Ui};

/// The files, in the folder that the window was opened from, that scene and picture are saved to.
pub(crate) const SCENE_FILE: &str = "brickyard.json";
pub(crate) const PICTURE_FILE: &str = "brickyard.png";

/// What the pointer does over the picture.
const POINTER: [(&str, &str); 5] = [
    ("drag", "turn"),
    ("shift + drag, or middle button", "move"),
    ("right button, up and down", "nearer, farther"),
    ("wheel or pinch", "nearer, farther, at the pointer"),
    ("double click", "show everything"),
];

/// The keys, what they do in words, and as a command.
fn keys() -> Vec<(KeyboardShortcut, &'static str, Command)> {
    let plain = |key| KeyboardShortcut::new(Modifiers::NONE, key);
    let turn = |right_deg, up_deg| Command::Orbit { right_deg, up_deg };
    let nearer = |factor| Command::Zoom { factor, at: None };
    let mut keys = vec![
        // The longer shortcut first: the shorter one would take its key.
        (KeyboardShortcut::new(Modifiers::COMMAND | Modifiers::SHIFT, Key::Z), "redo", Command::Redo),
        (KeyboardShortcut::new(Modifiers::COMMAND, Key::Z), "undo", Command::Undo),
        (KeyboardShortcut::new(Modifiers::COMMAND, Key::S), "save the scene", Command::SaveScene(SCENE_FILE.into())),
        (
            KeyboardShortcut::new(Modifiers::COMMAND, Key::P),
            "save the picture",
            Command::SavePicture(PICTURE_FILE.into()),
        ),
        (KeyboardShortcut::new(Modifiers::COMMAND, Key::Q), "quit", Command::Quit),
        (plain(Key::Home), "show everything", Command::Fit),
        (plain(Key::ArrowLeft), "turn left", turn(-5.0, 0.0)),
        (plain(Key::ArrowRight), "turn right", turn(5.0, 0.0)),
        (plain(Key::ArrowUp), "turn up", turn(0.0, 5.0)),
        (plain(Key::ArrowDown), "turn down", turn(0.0, -5.0)),
        (plain(Key::PageUp), "nearer", nearer(1.1)),
        (plain(Key::PageDown), "farther", nearer(1.0 / 1.1)),
        (plain(Key::Comma), "roll left", Command::Roll { angle_deg: -5.0 }),
        (plain(Key::Period), "roll right", Command::Roll { angle_deg: 5.0 }),
    ];
    let modes = [Key::Num1, Key::Num2, Key::Num3, Key::Num4, Key::Num5].into_iter().zip(Mode::ALL);
    keys.extend(modes.map(|(key, mode)| (plain(key), crate::command::mode_name(mode), Command::Mode(mode))));
    keys
}

/// The commands of the keys that were pressed since the last frame.
pub(crate) fn pressed(egui: &egui::Context, commands: &mut Vec<Command>) {
    // A field that is typed into has the keys.
    if egui.egui_wants_keyboard_input() {
        return;
    }
    // In the order in which they were pressed, which a look for each key by itself would lose.
    let shortcuts = keys();
    egui.input_mut(|input| {
        input.events.retain(|event| {
            let Event::Key { key, modifiers, pressed: true, .. } = event else { return true };
            let is_it = |(shortcut, _, _): &&(KeyboardShortcut, &str, Command)| {
                shortcut.logical_key == *key && modifiers.matches_logically(shortcut.modifiers)
            };
            let known = shortcuts.iter().find(is_it);
            commands.extend(known.map(|(_, _, command)| command.clone()));
            known.is_none()
        });
    });
}

/// Shows what keys and pointer do.
pub(crate) fn show(ui: &mut Ui) {
    egui::Grid::new("help").num_columns(2).striped(true).show(ui, |ui| {
        for (gesture, effect) in POINTER {
            ui.label(gesture);
            ui.label(effect);
            ui.end_row();
        }
        for (shortcut, effect, _) in keys() {
            ui.label(ui.ctx().format_shortcut(&shortcut));
            ui.label(effect);
            ui.end_row();
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui_kittest::Harness;

    #[test]
    fn keys_are_taken_in_their_order() {
        let show = |ui: &mut Ui, commands: &mut Vec<Command>| pressed(ui.ctx(), commands);
        let mut harness = Harness::new_ui_state(show, Vec::new());
        harness.key_press(Key::Num2);
        harness.key_press_modifiers(Modifiers::COMMAND, Key::Z);
        harness.key_press_modifiers(Modifiers::COMMAND | Modifiers::SHIFT, Key::Z);
        harness.key_press(Key::K);
        harness.run();
        assert_eq!(harness.state(), &[Command::Mode(Mode::Mip), Command::Undo, Command::Redo]);
    }

    #[test]
    fn no_key_has_two_meanings() {
        let shortcuts: Vec<_> = keys().iter().map(|(shortcut, _, _)| *shortcut).collect();
        let is_twice = |shortcut| shortcuts.iter().filter(|other| *other == shortcut).count() > 1;
        assert!(!shortcuts.iter().any(is_twice));
    }
}
