//! Colour maps as pictures: a strip of a transfer function's colours, and the menu of presets with their strips. A strip costs a mesh of some hundred
//! vertices per frame.

use crate::panels::widgets::color32;
use brickyard::volume::{TransferChoice, TransferFunction};
use eframe::egui::{
    Align2, Color32, FontSelection, Mesh, Popup, Pos2, Rect, Response, Role, Sense, Shape, StrokeKind, Ui, WidgetInfo,
    pos2, vec2,
};

const COLUMNS: u32 = 64;

/// Hints on presets.
const HINTS: [(&str, &str); 14] = [
    ("auto", "for lit fog: everything but the background"),
    ("gray", "black to white"),
    ("viridis", "even steps of brightness, also for colour-blind eyes"),
    ("magma", "even steps of brightness: black, purple, pale yellow"),
    ("inferno", "even steps of brightness: black, red, yellow"),
    ("plasma", "even steps of brightness: blue, pink, yellow"),
    ("turbo", "a rainbow without the rainbow's false edges"),
    ("fire", "black, red, yellow, white"),
    ("ct-bone", "CT in Hounsfield units: bone"),
    ("ct-skin", "CT in Hounsfield units: the skin"),
    ("ct-angio", "CT in Hounsfield units: vessels with contrast medium"),
    ("ct-lung", "CT in Hounsfield units: lungs and airways"),
    ("ct-soft", "CT in Hounsfield units: fat, muscle and bone"),
    ("mr-default", "magnetic resonance: air is clear, tissue red-brown to ivory"),
];

/// Fills an area from left to right; `color` takes the share of the width.
pub(crate) fn strip(ui: &Ui, area: Rect, color: impl Fn(f64) -> Color32) {
    let columns = (0..=COLUMNS).map(|column| {
        let share = f64::from(column) / f64::from(COLUMNS);
        let x = area.left() + area.width() * share as f32;
        ([pos2(x, area.top()), pos2(x, area.bottom())], color(share))
    });
    let painter = ui.painter_at(area.expand(1.0));
    painter.add(ribbon(columns));
    painter.rect_stroke(area, 0.0, ui.visuals().widgets.noninteractive.bg_stroke, StrokeKind::Outside);
}

/// A shape from column to column, each of an upper and a lower end and a colour.
pub(crate) fn ribbon(columns: impl Iterator<Item = ([Pos2; 2], Color32)>) -> Shape {
    let mut mesh = Mesh::default();
    for ([top, bottom], color) in columns {
        let next = mesh.vertices.len() as u32;
        mesh.colored_vertex(top, color);
        mesh.colored_vertex(bottom, color);
        if let Some(first) = next.checked_sub(2) {
            mesh.add_triangle(first, first + 1, first + 2);
            mesh.add_triangle(first + 1, first + 2, first + 3);
        }
    }
    Shape::mesh(mesh)
}

/// The colours of a function from its first point to its last.
fn whole(function: &TransferFunction) -> impl Fn(f64) -> Color32 {
    let values = || function.color.iter().map(|point| point[0]);
    let low = values().next().unwrap_or(0.0);
    let high = values().next_back().unwrap_or(1.0);
    move |share| color32(function.rgb(low + (high - low) * share))
}

/// Shows the menu of colour maps, with the current function `shown`. Returns the chosen preset; `None` in it is the gray ramp.
pub(crate) fn menu(
    ui: &mut Ui,
    choice: Option<&TransferChoice>,
    shown: &TransferFunction,
    label: eframe::egui::Id,
) -> Option<Option<TransferChoice>> {
    let name = match choice {
        None => "gray".into(),
        Some(TransferChoice::Preset(preset)) => preset.preset.clone(),
        Some(TransferChoice::Function(_)) => "of its own".into(),
        Some(TransferChoice::File(file)) => file.path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
    };
    let width = ui.available_width();
    let button = entry(ui, width, Role::ComboBox, &name, &name, whole(shown));
    let button = button.labelled_by(label).on_hover_text("how values become colours and opacities");
    let mut chosen = None;
    Popup::menu(&button).show(|ui| {
        for preset in TransferFunction::PRESETS {
            let Ok(function) = TransferFunction::preset(preset, (0.0, 1.0), 1.0) else { continue };
            let hint = HINTS.iter().find(|(known, _)| *known == preset).map_or("", |(_, hint)| *hint);
            let row = entry(ui, 200.0, Role::Button, preset, &name, whole(&function));
            if row.on_hover_text(hint).clicked() {
                chosen = Some((preset != "gray").then(|| TransferChoice::preset(preset)));
            }
        }
    });
    chosen
}

/// Shows a clickable line with a strip and a name, marked if selected.
fn entry(ui: &mut Ui, width: f32, kind: Role, name: &str, selected: &str, color: impl Fn(f64) -> Color32) -> Response {
    let (area, response) = ui.allocate_exact_size(vec2(width, ui.spacing().interact_size.y), Sense::click());
    let is_selected = name == selected && kind == Role::Button;
    response.widget_info(|| match kind {
        Role::Button => WidgetInfo::selected(kind, ui.is_enabled(), is_selected, name),
        _ => WidgetInfo { current_text_value: Some(name.to_string()), ..WidgetInfo::new(kind) },
    });
    let visuals = ui.style().interact_selectable(&response, is_selected);
    let is_button = kind == Role::ComboBox;
    if is_button || is_selected || response.hovered() || response.has_focus() {
        ui.painter().rect(area, visuals.corner_radius, visuals.weak_bg_fill, visuals.bg_stroke, StrokeKind::Inside);
    }
    let inner = area.shrink2(vec2(5.0, 4.0));
    let half = inner.with_max_x(inner.left() + 0.52 * inner.width());
    strip(ui, half, color);
    let font = FontSelection::Default.resolve(ui.style());
    let text = Rect::from_min_max(pos2(half.right() + 7.0, area.top()), area.max);
    let painter = ui.painter().with_clip_rect(text.intersect(ui.clip_rect()));
    painter.text(text.left_center(), Align2::LEFT_CENTER, name, font, visuals.text_color());
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_preset_is_explained() {
        let explained = HINTS.map(|(name, _)| name);
        assert_eq!(explained, TransferFunction::PRESETS);
    }

    #[test]
    fn a_strip_goes_from_the_first_colour_to_the_last() {
        let function = TransferFunction::preset("gray", (-5.0, 20.0), 1.0).expect("a preset");
        let color = whole(&function);
        assert_eq!([color(0.0), color(1.0)], [Color32::BLACK, Color32::WHITE]);
    }
}
