//! Words of an image's documents on its picture, which no source keeps: its name, hidden channels, colours of labels, and labels beside it.
//! Hints, so damaged ones are passed over. Costs the document of the image's labels.

use super::collection::labels_of;
use super::field::{Field, Ome};
use super::image_label::{FOLDER, MARK};
use super::node::Group;
use super::paths::in_words;
use crate::image::Presentation;
use brickyard_volume::LabelColor;
use std::collections::BTreeMap;

/// Reads the documents of an image with so many channels.
pub(super) fn presentation(group: &Group, channels: u32) -> Presentation {
    let labels = labels_of(group).unwrap_or_default();
    let label_names = labels.iter().filter_map(|path| Some(in_words(path.strip_prefix(FOLDER).ok()?))).collect();
    Presentation { label_names, ..in_document(&Ome::of(group), channels) }
}

/// The words of the image's own document.
fn in_document(ome: &Ome<'_>, channels: u32) -> Presentation {
    let name = ome.get("multiscales").and_then(|list| {
        let images = list.items("").ok()?;
        Some(images.first()?.get("name")?.as_text()?.trim().to_owned())
    });
    let channel_list = ome.get("omero").and_then(|omero| omero.get("channels"));
    let shown = channel_list.as_ref().and_then(|list| list.items("").ok()).unwrap_or_default();
    let is_hidden = |item: &Field<'_>| item.get("active").is_some_and(|active| active.as_bool() == Some(false));
    let hidden = (0..channels).zip(&shown).filter(|(_, item)| is_hidden(item)).map(|(number, _)| number);
    let color_list = ome.get(MARK).and_then(|mark| mark.get("colors"));
    let colors = color_list.as_ref().and_then(|list| list.items("").ok()).unwrap_or_default();
    let colors: BTreeMap<i64, [f64; 3]> = colors.iter().filter_map(color_of).collect();
    Presentation {
        name: name.filter(|name| !name.is_empty()),
        hidden_channels: hidden.collect(),
        label_colors: colors.into_iter().map(|(label, color)| LabelColor { label, color }).collect(),
        label_names: Vec::new(),
    }
}

/// A label and its colour.
fn color_of(entry: &Field<'_>) -> Option<(i64, [f64; 3])> {
    let label = entry.get("label-value")?.as_number().filter(|label| label.fract() == 0.0)?;
    let rgba = entry.get("rgba")?.numbers(None).ok()?;
    let [red, green, blue, ..] = rgba[..] else { return None };
    let color = [red, green, blue].map(|part| part / 255.0);
    color.iter().all(|part| (0.0..=1.0).contains(part)).then_some((label as i64, color))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn names_hidden_channels_and_colours_are_found() {
        let document = json!({
            "multiscales": [{ "name": " cell " }],
            "omero": { "channels": [{ "active": true }, { "active": false }, {}, { "active": false }] },
            "image-label": { "colors": [
                { "label-value": 4, "rgba": [255, 0, 51, 255] }, { "label-value": 1, "rgba": [0, 0, 0] }, { "label-value": 2 },
                { "label-value": 3, "rgba": [300, 0, 0, 0] }, { "label-value": 1.5, "rgba": [0, 0, 0, 0] },
            ] },
        });
        let found = in_document(&Ome::in_test(&document), 3);
        let colors = [(1, [0.0; 3]), (4, [1.0, 0.0, 0.2])].map(|(label, color)| LabelColor { label, color });
        let expected = Presentation {
            name: Some("cell".into()),
            hidden_channels: vec![1],
            label_colors: colors.to_vec(),
            label_names: Vec::new(),
        };
        assert_eq!(found, expected);
        for document in [json!({}), json!({ "omero": 7, "image-label": [], "multiscales": "a" })] {
            assert_eq!(in_document(&Ome::in_test(&document), 3), Presentation::default());
        }
    }
}
