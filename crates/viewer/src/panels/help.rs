//! The help: what keys and pointer do.

use crate::keys;
use eframe::egui::{Grid, ScrollArea, Ui};

/// What the pointer does over the scene's picture.
const POINTER: [(&str, &str); 9] = [
    ("drag", "turn around what is under the pointer"),
    ("shift + drag, or middle button", "move"),
    ("ctrl + drag", "roll"),
    ("right button, up and down", "nearer, farther"),
    ("wheel or pinch", "nearer, farther, at the pointer"),
    ("double click", "look at what is there, or at everything"),
    ("alt + click on a label", "show it alone, or all again"),
    ("drag a handle of the clip box", "move a face of it"),
    ("drag the dot of a clip plane, the tip of its arrow", "move the plane, turn it"),
];

/// What the pointer does over a slice.
const PLANES: [(&str, &str); 5] = [
    ("drag", "move the point in which the slices meet"),
    ("wheel", "next slice"),
    ("shift + drag, or middle button", "move"),
    ("right button, ctrl + wheel, or pinch", "nearer, farther"),
    ("double click", "all of the slice"),
];

/// Shows what keys and pointer do.
pub(crate) fn show(ui: &mut Ui) {
    ScrollArea::vertical().show(ui, |ui| {
        table(ui, "Pointer", POINTER.map(|(gesture, effect)| (gesture.to_string(), effect.to_string())).into());
        table(
            ui,
            "Pointer over a slice",
            PLANES.map(|(gesture, effect)| (gesture.to_string(), effect.to_string())).into(),
        );
        let keys = keys::all().into_iter().map(|shortcut| (ui.ctx().format_shortcut(&shortcut.keys), shortcut.effect));
        table(ui, "Keys", keys.collect());
    });
}

fn table(ui: &mut Ui, title: &str, rows: Vec<(String, String)>) {
    ui.strong(title);
    Grid::new(title).num_columns(2).striped(true).show(ui, |ui| {
        for (cause, effect) in rows {
            ui.label(cause);
            ui.label(effect);
            ui.end_row();
        }
    });
    ui.add_space(8.0);
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable;

    #[test]
    fn the_help_lists_every_key() {
        let harness = Harness::new_ui(show);
        for shortcut in keys::all() {
            assert!(harness.query_all_by_label(&shortcut.effect).next().is_some(), "{}", shortcut.effect);
        }
    }
}
