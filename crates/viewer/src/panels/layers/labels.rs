//! The look of a layer of labels: the visible ones, as a typed list or by the pointer, and their colours.

use crate::panels::widgets::{color, own_color, row, typed};
use brickyard::session::VolumeSource;
use brickyard::volume::labels::{BACKGROUND, color_index, hashed_color};
use brickyard::volume::{LabelCodes, LabelColor, SceneLayer};
use eframe::egui::{Button, RichText, Ui};
use std::ops::RangeInclusive;

/// Most swatches for a list.
const SWATCHES: usize = 24;

/// Shows a layer's labels, with `picked` under the pointer.
pub(crate) fn show(ui: &mut Ui, layer: &mut SceneLayer, volume: &VolumeSource, picked: Option<i64>) {
    row(ui, "labels", "which labels are shown; label 0 is the background", |ui, _| {
        let is_all = layer.show_labels.is_none();
        if ui.radio(is_all, "all").on_hover_text("all but the background").clicked() {
            layer.show_labels = None;
        }
        if ui.radio(!is_all, "some").on_hover_text("only those of a list").clicked() && is_all {
            layer.show_labels = Some(picked.into_iter().collect());
        }
    });
    if let Some(shown) = &mut layer.show_labels {
        typed(ui, "shown labels", "such as 3,7,10-12", 1, shown, |shown| listed(shown), parsed);
    }
    picking(ui, layer, volume, picked);
    row(ui, "tint", "one colour for all labels, or a colour for each", |ui, label| {
        own_color(ui, &mut layer.color, [0.8; 3], label);
    });
    if layer.color.is_none() {
        colors(ui, layer, volume, picked);
    }
}

fn picking(ui: &mut Ui, layer: &mut SceneLayer, volume: &VolumeSource, picked: Option<i64>) {
    let picked = picked.filter(|label| *label != BACKGROUND);
    let words = picked.map_or_else(|| "none".into(), |label| label.to_string());
    row(ui, "picked", "the label under the pointer, or the last one there", |ui, _| {
        ui.label(RichText::new(words).monospace());
        let isolate = ui.add_enabled(picked.is_some(), Button::new("isolate").small());
        if isolate.on_hover_text("shows this label alone").clicked() {
            layer.show_labels = picked.map(|label| vec![label]);
        }
        let without = picked.map(|label| without(layer, volume, label));
        let can_hide = matches!(without, Some(Some(_)));
        let hide = ui.add_enabled(can_hide, Button::new("hide").small()).on_hover_text("shows all others");
        let reason = match without {
            Some(None) => "too many labels to list all others: type the list of labels to show",
            _ => "point at a label in a slice first",
        };
        if hide.on_disabled_hover_text(reason).clicked() {
            layer.show_labels = without.flatten();
        }
    });
}

/// A layer's visible labels without one; `None` if too many to list.
fn without(layer: &SceneLayer, volume: &VolumeSource, hidden: i64) -> Option<Vec<i64>> {
    let is_other = |label: &i64| *label != hidden && *label != BACKGROUND;
    if let Some(shown) = &layer.show_labels {
        return Some(shown.iter().copied().filter(|label| *label != hidden).collect());
    }
    let (least, greatest) = volume.source.channel_range(layer.channel);
    let all = least.ceil() as i64..=greatest.floor() as i64;
    let has = |label: &i64| volume.store().is_none_or(|store| store.may_have_label(layer.channel, *label));
    let is_few = all.end().checked_sub(*all.start()).is_some_and(|count| count < LabelCodes::MOST as i64);
    is_few.then(|| all.filter(is_other).filter(has).collect())
}

/// Shows the colours of listed labels, and of the one under the pointer.
fn colors(ui: &mut Ui, layer: &mut SceneLayer, volume: &VolumeSource, picked: Option<i64>) {
    let Ok(function) = volume.function(layer) else { return };
    let mut named: Vec<i64> = layer.show_labels.iter().flatten().copied().take(SWATCHES).collect();
    named.extend(picked.filter(|label| !named.contains(label) && *label != BACKGROUND));
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        for label in named {
            let mut shown = function.rgb(label as f64);
            ui.label(RichText::new(label.to_string()).monospace());
            if color(ui, &mut shown).accessible_name(format!("colour of label {label}")).changed() {
                set_color(layer, volume, label, shown);
            }
        }
    });
    let has_own = layer.transfer.is_some();
    if has_own && ui.small_button("own colours for all").on_hover_text("resets all colours").clicked() {
        layer.transfer = None;
    }
}

/// Sets a label's colour. This writes out the layer's function; the choice of visible labels stays with the layer.
fn set_color(layer: &mut SceneLayer, volume: &VolumeSource, label: i64, color: [f64; 3]) {
    let bare = SceneLayer { show_labels: None, ..layer.clone() };
    let Ok(mut function) = volume.function(&bare) else { return };
    let colors = function.labels.get_or_insert_default().colors.get_or_insert_default();
    match colors.binary_search_by_key(&label, |entry| entry.label) {
        // A hashed colour needs no entry.
        Ok(place) if color == hashed_color(color_index(label)) => drop(colors.remove(place)),
        Ok(place) => colors[place].color = color,
        Err(place) => colors.insert(place, LabelColor { label, color }),
    }
    layer.transfer = Some(function.into());
}

/// A list of labels as text, with ranges for neighbours.
fn listed(labels: &[i64]) -> String {
    let mut sorted = labels.to_vec();
    sorted.sort_unstable();
    sorted.dedup();
    let runs = sorted.chunk_by(|a, b| a.checked_add(1) == Some(*b));
    let words = runs.map(|run| match run {
        [first, .., last] if run.len() > 2 => format!("{first}-{last}"),
        few => few.iter().map(i64::to_string).collect::<Vec<_>>().join(","),
    });
    words.collect::<Vec<_>>().join(",")
}

/// Parses a list of labels such as `3,7,10-12`.
fn parsed(text: &str) -> Result<Vec<i64>, String> {
    let mut labels = Vec::new();
    for word in text.split([',', ' ', ';']).filter(|word| !word.is_empty()) {
        let range = between(word).ok_or_else(|| format!("'{word}': expected a label, or two with '-' between"))?;
        if range.is_empty() {
            return Err(format!("'{word}' ends before it begins"));
        }
        let count = range.end().checked_sub(*range.start()).filter(|count| *count < LabelCodes::MOST as i64);
        if count.is_none_or(|count| labels.len() + count as usize >= LabelCodes::MOST) {
            return Err(format!("more than {} labels", LabelCodes::MOST));
        }
        labels.extend(range);
    }
    labels.sort_unstable();
    labels.dedup();
    Ok(labels)
}

/// Parses one word of a list.
fn between(word: &str) -> Option<RangeInclusive<i64>> {
    // The first sign may be a minus.
    let dash = word.char_indices().skip(1).find(|(_, letter)| *letter == '-');
    match dash {
        Some((place, _)) => Some(word[..place].parse().ok()?..=word[place + 1..].parse().ok()?),
        None => word.parse().ok().map(|label| label..=label),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::panels::fixture;
    use brickyard::volume::Scene;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable;
    use proptest::prelude::*;

    #[test]
    fn lists_are_read_as_people_write_them() {
        for (text, expected) in [("3,7,10-12", &[3, 7, 10, 11, 12][..]), ("", &[]), ("-3--1, 5 5;", &[-3, -2, -1, 5])] {
            assert_eq!(parsed(text).as_deref(), Ok(expected), "{text}");
        }
        for (text, expected) in [
            ("3,x", "'x'"),
            ("7-", "'7-'"),
            ("9-7", "ends before"),
            ("1-99999", "more than 32767"),
            ("-9223372036854775808-9223372036854775807", "more than"),
        ] {
            let error = parsed(text).expect_err(text);
            assert!(error.contains(expected), "{error}");
        }
    }

    proptest! {
        #[test]
        fn what_is_written_is_read(mut labels in prop::collection::vec(-40i64..40, 0..60)) {
            labels.sort_unstable();
            labels.dedup();
            prop_assert_eq!(parsed(&listed(&labels)), Ok(labels));
        }
    }

    fn clicked(layer: SceneLayer, name: &str) -> SceneLayer {
        let volumes = fixture::volumes();
        let volume = volumes[1].clone();
        let mut harness = Harness::new_ui_state(move |ui, layer| show(ui, layer, &volume, Some(5)), layer);
        harness.get_by_label(name).click();
        harness.run();
        let layer = harness.state().clone();
        fixture::check(&Scene::of(SceneLayer { source: Some(1), ..layer.clone() }), &volumes);
        layer
    }

    #[test]
    fn what_is_picked_is_isolated_or_hidden() {
        assert_eq!(clicked(SceneLayer::default(), "isolate").show_labels, Some(vec![5]));
        let hidden = clicked(SceneLayer::default(), "hide").show_labels.expect("all others");
        assert_eq!((hidden.len(), hidden.contains(&5), hidden.contains(&0)), (254, false, false));
        let some = SceneLayer { show_labels: Some(vec![3, 5]), ..SceneLayer::default() };
        assert_eq!(clicked(some.clone(), "hide").show_labels, Some(vec![3]));
        assert_eq!(clicked(some, "all").show_labels, None);
    }

    #[test]
    fn a_label_has_a_colour_of_its_own() {
        let volumes = fixture::volumes();
        let mut layer = SceneLayer { source: Some(1), show_labels: Some(vec![3]), ..SceneLayer::default() };
        let before = volumes[1].function(&layer).expect("a function");
        set_color(&mut layer, &volumes[1], 3, [1.0, 0.5, 0.0]);
        let after = volumes[1].function(&layer).expect("a function");
        assert_eq!((after.rgb(3.0), after.rgb(4.0)), ([1.0, 0.5, 0.0], before.rgb(4.0)));
        assert_eq!((after.alpha(3.0), after.alpha(4.0), &layer.show_labels), (1.0, 0.0, &Some(vec![3])));
        fixture::check(&Scene::of(layer), &volumes);
    }
}
