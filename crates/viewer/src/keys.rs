//! The keys, in one list shared by the window and its help.

use crate::command::Command;
use crate::state::{Layout, State, Tool};
use brickyard::volume::{Mode, Projection};
use eframe::egui::{self, Event, Key, KeyboardShortcut, Modifiers};
use serde_json::Value;

/// The files for saved scenes and pictures, in the folder the window was opened from.
pub(crate) const SCENE_FILE: &str = "brickyard.json";
pub(crate) const PICTURE_FILE: &str = "brickyard.png";

/// Keys that move a focused control, or the focus. Buttons are pressed by Enter: Space plays, whatever was clicked last.
const MOVING_KEYS: [Key; 6] = [Key::ArrowLeft, Key::ArrowRight, Key::ArrowUp, Key::ArrowDown, Key::Tab, Key::Escape];

/// A key's command in a window of some state; `None` without an effect.
type Effect = dyn Fn(&State) -> Option<Command>;

/// A key and its command.
pub(crate) struct Shortcut {
    /// The key with its modifiers.
    pub(crate) keys: KeyboardShortcut,
    pub(crate) effect: String,
    effect_on: Box<Effect>,
}

/// All keys. A key with more modifiers comes before the same key with fewer, which would take it.
pub(crate) fn all() -> Vec<Shortcut> {
    let mut keys = files();
    keys.extend(navigation());
    keys.extend(switches());
    keys.extend(looks());
    keys
}

fn shortcut(
    modifiers: Modifiers,
    key: Key,
    effect: &str,
    command: impl Fn(&State) -> Option<Command> + 'static,
) -> Shortcut {
    Shortcut { keys: KeyboardShortcut::new(modifiers, key), effect: effect.into(), effect_on: Box::new(command) }
}

/// A key with the same command in every state.
fn plain(modifiers: Modifiers, key: Key, effect: &str, command: Command) -> Shortcut {
    shortcut(modifiers, key, effect, move |_| Some(command.clone()))
}

/// A key that sets a field to its next value.
fn switch<V: Into<Value> + 'static>(
    modifiers: Modifiers,
    key: Key,
    effect: &str,
    field: &'static str,
    next: fn(&State) -> V,
) -> Shortcut {
    shortcut(modifiers, key, effect, move |state| Some(Command::set(field, next(state))))
}

fn files() -> Vec<Shortcut> {
    let (command, redo) = (Modifiers::COMMAND, Modifiers::COMMAND | Modifiers::SHIFT);
    vec![
        plain(redo, Key::Z, "redo", Command::Redo),
        plain(command, Key::Z, "undo", Command::Undo),
        plain(command, Key::S, "save the scene", Command::SaveScene(SCENE_FILE.into())),
        plain(command, Key::P, "save the picture", Command::SavePicture(PICTURE_FILE.into(), Default::default())),
        plain(command, Key::Q, "quit", Command::Quit),
    ]
}

fn navigation() -> Vec<Shortcut> {
    let none = Modifiers::NONE;
    let nearer = |factor| Command::Zoom { factor, at: None };
    let step = |by: i64| {
        move |state: &State| {
            let time = (i64::from(state.scene.time) + by).max(0);
            Some(Command::set("time", time))
        }
    };
    vec![
        plain(Modifiers::COMMAND, Key::R, "show everything", Command::Fit),
        plain(none, Key::Home, "show everything", Command::Fit),
        plain(none, Key::F, "show everything", Command::Fit),
        plain(none, Key::ArrowLeft, "turn left", Command::orbit(-5.0, 0.0)),
        plain(none, Key::ArrowRight, "turn right", Command::orbit(5.0, 0.0)),
        plain(none, Key::ArrowUp, "turn up", Command::orbit(0.0, 5.0)),
        plain(none, Key::ArrowDown, "turn down", Command::orbit(0.0, -5.0)),
        plain(none, Key::PageUp, "nearer", nearer(1.1)),
        plain(none, Key::PageDown, "farther", nearer(1.0 / 1.1)),
        plain(none, Key::Comma, "roll left", Command::Roll { angle_deg: -5.0 }),
        plain(none, Key::Period, "roll right", Command::Roll { angle_deg: 5.0 }),
        switch(none, Key::Space, "play the time steps, or stop", "window.play.on", |state| !state.window.play.on),
        shortcut(none, Key::OpenBracket, "time step before", step(-1)),
        shortcut(none, Key::CloseBracket, "next time step", step(1)),
    ]
}

fn switches() -> Vec<Shortcut> {
    let none = Modifiers::NONE;
    let planes = |state: &State| if state.window.layout == Layout::Planes { "single" } else { "planes" };
    let other_tool = |state: &State, tool: Tool, name| if state.window.tool == tool { "turn" } else { name };
    vec![
        switch(none, Key::P, "three slices beside the volume", "window.layout", planes),
        switch(Modifiers::COMMAND, Key::Y, "three slices beside the volume", "window.layout", planes),
        shortcut(none, Key::O, "parallel rays, or perspective", |state| {
            let projection = state.scene.camera.map(|camera| camera.projection);
            Some(Command::Parallel(!matches!(projection, Some(Projection::Orthographic { .. }))))
        }),
        shortcut(none, Key::Tab, "fly: W A S D, E and Q, drag to look around", move |state| {
            Some(Command::set("window.tool", other_tool(state, Tool::Fly, "fly")))
        }),
        shortcut(none, Key::M, "measure a distance by two clicks", move |state| {
            Some(Command::set("window.tool", other_tool(state, Tool::Distance, "distance")))
        }),
        shortcut(none, Key::C, "clip box", |state| Some(Command::Clip(state.scene.clip.is_none()))),
        switch(none, Key::B, "scale bar", "window.overlays.scale_bar", |state| !state.window.overlays.scale_bar),
        switch(none, Key::A, "axes", "window.overlays.axes", |state| !state.window.overlays.axes),
        switch(none, Key::T, "ticks", "window.overlays.ticks", |state| !state.window.overlays.ticks),
        switch(none, Key::Backslash, "diagnostics", "window.diagnostics", |state| !state.window.diagnostics),
        switch(none, Key::F10, "panels around the pictures, or the pictures alone", "window.panels", |state| {
            !state.window.panels
        }),
        switch(none, Key::F11, "the whole screen", "window.fullscreen", |state| !state.window.fullscreen),
        switch(none, Key::H, "these keys", "window.help", |state| !state.window.help),
        switch(none, Key::F1, "these keys", "window.help", |state| !state.window.help),
    ]
}

fn looks() -> Vec<Shortcut> {
    let digits = [Key::Num1, Key::Num2, Key::Num3, Key::Num4, Key::Num5, Key::Num6, Key::Num7, Key::Num8, Key::Num9];
    let modes = digits
        .into_iter()
        .zip(Mode::ALL)
        .map(|(key, mode)| plain(Modifiers::ALT, key, mode.name(), Command::set("mode", mode.name())));
    let layers = digits.into_iter().enumerate().map(|(layer, key)| {
        shortcut(Modifiers::NONE, key, &format!("layer {} shown or hidden", layer + 1), move |state| {
            let is_visible = state.scene.layers.get(layer)?.visible;
            Some(Command::set(&format!("layers.{layer}.visible"), !is_visible))
        })
    });
    modes.chain(layers).collect()
}

impl Shortcut {
    /// The key's command in a window of this state; `None` without an effect.
    pub(crate) fn command(&self, state: &State) -> Option<Command> {
        (self.effect_on)(state)
    }
}

/// The key for an effect of [`all`], as in menus; empty if there is none.
pub(crate) fn shown(egui: &egui::Context, effect: &str) -> String {
    let known = all().into_iter().find(|shortcut| shortcut.effect == effect);
    known.map(|shortcut| egui.format_shortcut(&shortcut.keys)).unwrap_or_default()
}

/// The keys pressed since the last frame, in order. Each acts on the state left by the previous ones.
pub(crate) fn pressed(egui: &egui::Context, state: &State) -> Vec<Shortcut> {
    // A focused text field gets all keys but the one that quits; another focused control, such as a slider, those that move it.
    let is_typing = egui.text_edit_focused();
    let has_focus = egui.egui_wants_keyboard_input();
    let is_flying = state.window.tool == Tool::Fly;
    let mut hits = Vec::new();
    egui.input_mut(|input| {
        input.events.retain(|event| {
            let Event::Key { key, modifiers, pressed: true, .. } = event else { return true };
            let is_flight = is_flying && crate::volume_view::FLIGHT_KEYS.iter().any(|(known, _)| known == key);
            if is_flight && modifiers.is_none() || has_focus && MOVING_KEYS.contains(key) {
                return true;
            }
            let is_it = |shortcut: &Shortcut| {
                shortcut.keys.logical_key == *key && modifiers.matches_logically(shortcut.keys.modifiers)
            };
            let known = all().into_iter().find(is_it);
            let known = known.filter(|shortcut| !is_typing || shortcut.command(state) == Some(Command::Quit));
            let is_known = known.is_some();
            hits.extend(known);
            !is_known
        });
    });
    hits
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::edits::edited;
    use eframe::egui::{Slider, Ui};
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable;

    fn given(state: State, keys: &[(Modifiers, Key)]) -> Vec<Command> {
        let show = |ui: &mut Ui, (state, commands): &mut (State, Vec<Command>)| {
            for key in pressed(ui.ctx(), state) {
                let Some(command) = key.command(state) else { continue };
                if let Command::Set(fields) = &command {
                    *state = edited(state, &[], fields).unwrap();
                }
                commands.push(command);
            }
        };
        let mut harness = Harness::new_ui_state(show, (state, Vec::new()));
        for (modifiers, key) in keys {
            harness.key_press_modifiers(*modifiers, *key);
        }
        harness.run();
        harness.state().1.clone()
    }

    #[test]
    fn keys_are_taken_in_their_order() {
        let (none, command) = (Modifiers::NONE, Modifiers::COMMAND);
        let keys =
            [(Modifiers::ALT, Key::Num2), (command, Key::Z), (command | Modifiers::SHIFT, Key::Z), (none, Key::K)];
        assert_eq!(given(State::default(), &keys), [Command::set("mode", "mip"), Command::Undo, Command::Redo]);
    }

    #[test]
    fn keys_act_on_the_state() {
        let mut state = State::default();
        state.scene.time = 3;
        let keys = [Key::OpenBracket, Key::OpenBracket, Key::Num1, Key::Num2].map(|key| (Modifiers::NONE, key));
        assert_eq!(
            given(state.clone(), &keys),
            [Command::set("time", 2), Command::set("time", 1), Command::set("layers.0.visible", false)]
        );
        state.window.tool = Tool::Fly;
        assert_eq!(given(state, &[(Modifiers::NONE, Key::A)]), [], "it flies");
    }

    #[test]
    fn panels_and_screen_go_and_come() {
        let keys = [Key::F10, Key::F11, Key::F10].map(|key| (Modifiers::NONE, key));
        let set = Command::set;
        let expected = [set("window.panels", false), set("window.fullscreen", true), set("window.panels", true)];
        assert_eq!(given(State::default(), &keys), expected);
    }

    #[test]
    fn only_a_field_that_is_typed_into_keeps_keys() {
        let show = |ui: &mut Ui, (value, text, taken): &mut (f64, String, usize)| {
            *taken += pressed(ui.ctx(), &State::default()).len();
            ui.add(Slider::new(value, 0.0..=100.0).show_value(false)).accessible_name("slider");
            ui.text_edit_singleline(text).accessible_name("text");
        };
        let mut harness = Harness::new_ui_state(show, (50.0, String::new(), 0));
        for (name, expected) in [("slider", 4), ("text", 1)] {
            harness.get_by_label(name).focus();
            harness.run();
            harness.state_mut().2 = 0;
            harness.key_press_modifiers(Modifiers::COMMAND, Key::Z);
            harness.key_press_modifiers(Modifiers::COMMAND, Key::Q);
            harness.key_press(Key::B);
            harness.key_press(Key::Space);
            harness.key_press(Key::ArrowRight);
            harness.run();
            assert_eq!(harness.state().2, expected, "{name}");
        }
        assert!(harness.state().0 > 50.0, "the slider moves");
    }

    #[test]
    fn no_key_has_two_meanings() {
        let shortcuts: Vec<_> = all().iter().map(|shortcut| shortcut.keys).collect();
        let is_twice = |shortcut| shortcuts.iter().filter(|other| *other == shortcut).count() > 1;
        assert!(!shortcuts.iter().any(is_twice));
    }
}
