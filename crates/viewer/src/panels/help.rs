//! The help on keys and pointer.

use crate::keys;
use eframe::egui::{Grid, Rect, ScrollArea, Ui, WidgetText, Window, vec2};

/// Space around the window, in points: its edges can be grasped slightly outside, too.
const MARGIN: f32 = 8.0;

/// The pointer's gestures over the scene's picture.
const POINTER: [(&str, &str); 9] = [
    ("drag", "turn around the point under the pointer"),
    ("shift + drag, or middle button", "move"),
    ("ctrl + drag", "roll"),
    ("right button, up and down", "nearer, farther"),
    ("wheel or pinch", "nearer, farther, at the pointer"),
    ("double click", "look at the thing there, or at everything"),
    ("alt + click on a label", "show it alone, or all again"),
    ("drag a handle of the clip box", "move a face of it"),
    ("drag the dot of a clip plane, the tip of its arrow", "move the plane, turn it"),
];

/// The pointer's gestures over a slice.
const PLANES: [(&str, &str); 7] = [
    ("drag", "move the point where the slices meet"),
    ("wheel", "next slice"),
    ("shift + drag, or middle button", "move"),
    ("ctrl + wheel, or pinch", "nearer, farther"),
    ("right button", "change the values of black and white"),
    ("double click", "all of the slice"),
    ("alt + click on a label", "show it alone, or all again"),
];

/// Shows the help, if open: at first over the pictures, in the free room of `ui`, and always below the menu.
pub(crate) fn show(ui: &Ui, is_open: &mut bool, below_menu: Rect) {
    let within = below_menu.shrink(MARGIN);
    let size = vec2(560.0, 520.0).min(within.size());
    let help = Window::new("Help").open(is_open).constrain_to(within).default_size(size);
    help.default_pos(ui.available_rect_before_wrap().min + vec2(MARGIN, MARGIN)).show(ui.ctx(), words);
}

fn words(ui: &mut Ui) {
    ScrollArea::both().show(ui, |ui| {
        table(ui, "Pointer", POINTER);
        table(ui, "Pointer over a slice", PLANES);
        let egui = ui.ctx().clone();
        let keys = keys::all().into_iter().map(|shortcut| (egui.format_shortcut(&shortcut.keys), shortcut.effect));
        table(ui, "Keys", keys);
    });
}

fn table<T: Into<WidgetText>>(ui: &mut Ui, title: &str, rows: impl IntoIterator<Item = (T, T)>) {
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
    use eframe::egui::accesskit::Role;
    use eframe::egui::{UiBuilder, pos2};
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable;

    #[test]
    fn the_help_lies_over_the_pictures_below_the_menu() {
        for (size, expected) in [(vec2(1000.0, 800.0), pos2(308.0, 38.0)), (vec2(300.0, 200.0), pos2(8.0, 38.0))] {
            let show = |ui: &mut Ui| {
                let below_menu = Rect::from_min_max(pos2(0.0, 30.0), ui.max_rect().max);
                let pictures = below_menu.with_min_x(300.0f32.min(0.6 * ui.max_rect().width()));
                let room = ui.new_child(UiBuilder::new().max_rect(pictures));
                super::show(&room, &mut true, below_menu);
            };
            let mut harness = Harness::builder().with_size(size).build_ui(show);
            harness.run();
            let help = harness.get_by_role_and_label(Role::Window, "Help").rect();
            assert!(help.min.distance(expected) < 2.0 && help.max.x < size.x && help.max.y < size.y, "{help:?}");
        }
    }

    #[test]
    fn the_help_lists_every_key() {
        let harness = Harness::new_ui(words);
        for shortcut in keys::all() {
            assert!(harness.query_all_by_label(&shortcut.effect).next().is_some(), "{}", shortcut.effect);
        }
    }
}
