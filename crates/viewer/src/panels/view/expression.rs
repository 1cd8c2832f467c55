//! An expression over the layers' values, shown in their place.

use crate::panels::color_map;
use crate::panels::mending::set_expression;
use crate::panels::widgets::{group, row, typed};
use brickyard::overlay::layer_name;
use brickyard::session::VolumeSource;
use brickyard::volume::{Expression, Scene, Subject};
use eframe::egui::{RichText, Ui};

const HINT: &str = "one value made of all layers' values, such as b - a or max(a, b), shown in their place";

pub(super) fn show(ui: &mut Ui, scene: &mut Scene, volumes: &[VolumeSource]) {
    group(ui, "expression", HINT, |ui| {
        let layers = scene.layers.len();
        let mut text = scene.expression.as_ref().map(|expression| expression.text.clone());
        let read = |text: &str| match text.trim() {
            "" => Ok(None),
            text => match Expression::parse(text, layers) {
                Ok(expression) if expression.volumes().is_empty() => Err("it reads no layer".into()),
                Ok(_) => Ok(Some(text.to_string())),
                Err(error) => Err(error.to_string()),
            },
        };
        let words = |text: &Option<String>| text.clone().unwrap_or_default();
        if typed(ui, "expression text", "a + b", 1, &mut text, words, read) {
            set_expression(scene, volumes, text);
        }
        names(ui, scene, volumes);
        transfer(ui, scene, volumes);
        if scene.expression.is_none() {
            let note = "It is shown in mode dvr, and replaces the layers' own colours and opacities.";
            ui.label(RichText::new(note).weak());
        } else if ui.small_button("clear").on_hover_text("shows the layers again").clicked() {
            set_expression(scene, volumes, None);
        }
    });
}

/// Shows the letters of the layers.
fn names(ui: &mut Ui, scene: &Scene, volumes: &[VolumeSource]) {
    let letter = |layer: usize| match u8::try_from(layer) {
        Ok(layer) if layer < 26 => char::from(b'a' + layer).to_string(),
        _ => format!("v{layer}"),
    };
    let known =
        (0..scene.layers.len()).map(|layer| format!("{} = {}", letter(layer), layer_name(scene, volumes, layer)));
    let known: Vec<_> = known.collect();
    let shown = match known.len() {
        0..=4 => known.join(", "),
        _ => format!("{}, ...", known[..4].join(", ")),
    };
    ui.label(RichText::new(shown).weak()).on_hover_text(known.join("\n"));
}

fn transfer(ui: &mut Ui, scene: &mut Scene, volumes: &[VolumeSource]) {
    let subjects = (0..scene.layers.len()).map(|layer| {
        let volume = volumes.get(scene.store(layer))?;
        Some(volume.subject(scene.layers[layer].channel))
    });
    let Some(subjects) = subjects.collect::<Option<Vec<Subject>>>() else { return };
    let Some(parsed) = scene.parsed_expression().ok().flatten() else { return };
    let window = parsed.window(subjects.iter().map(|subject| subject.window));
    let (Some(look), Some(first)) = (&mut scene.expression, subjects.first()) else { return };
    let Ok(function) = look.function(&Subject { is_labels: false, ..first.in_window(window) }) else { return };
    row(ui, "colours", "colours and opacities of the expression, over its range of values", |ui, label| {
        if let Some(chosen) = color_map::menu(ui, look.transfer.as_ref(), &function, label) {
            look.transfer = chosen;
        }
    });
}
