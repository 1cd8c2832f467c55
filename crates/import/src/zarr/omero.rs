//! Looks of channels by `omero`: names, colours and windows. They are hints, so damaged ones are left out, with a note. Costs a look for each
//! channel.

use super::field::{Field, Ome};
use crate::note::Note;
use brickyard_volume::{ChannelLook, channel, counted};

/// Most letters of a channel's name.
const LONGEST_NAME: usize = 256;

/// Looks of an image's channels; none if the document has none.
pub(super) fn looks(ome: &Ome<'_>, channels: u32, notes: &mut Vec<Note>) -> Vec<ChannelLook> {
    let Some(list) = ome.get("omero").and_then(|omero| omero.get("channels")) else { return Vec::new() };
    let Ok(items) = list.items("a list of channels") else {
        notes.push(Note::warning(format!("{} is no list: names, colours and windows are left out.", list.at())));
        return Vec::new();
    };
    if items.len() != channels as usize {
        let note = format!(
            "{} tells of {}, but the image has {}: the first are taken.",
            list.at(),
            counted(items.len() as u64, "channel"),
            counted(channels.into(), "channel")
        );
        notes.push(Note::warning(note));
    }
    let mut damaged = Vec::new();
    let mut looks: Vec<ChannelLook> =
        items.iter().take(channels as usize).map(|item| look(item, &mut damaged)).collect();
    if !damaged.is_empty() {
        let note = format!("{} cannot be used, and left out.", damaged.join(", "));
        notes.push(Note::warning(note));
    }
    if looks.iter().all(|look| *look == ChannelLook::default()) {
        return Vec::new();
    }
    looks.resize(channels as usize, ChannelLook::default());
    looks
}

/// The look of a channel. Places of what cannot be used go to `damaged`.
fn look(item: &Field<'_>, damaged: &mut Vec<String>) -> ChannelLook {
    let mut used = |field: &Field<'_>, is_used: bool| {
        if !is_used {
            damaged.push(field.at().to_owned());
        }
    };
    let mut look = ChannelLook::default();
    if let Some(label) = item.get("label") {
        look.name = label.as_text().and_then(name_of);
        used(&label, look.name.is_some() || label.as_text().is_some_and(|text| text.trim().is_empty()));
    }
    if let Some(color) = item.get("color") {
        look.color = color.as_text().and_then(color_of);
        used(&color, look.color.is_some());
    }
    if let Some(window) = item.get("window") {
        let end = |name: &str| window.get(name);
        let (start, stop) = (end("start"), end("end"));
        look.window = match (&start, &stop) {
            (Some(start), Some(stop)) => {
                start.as_number().zip(stop.as_number()).filter(|(start, stop)| start < stop).map(|(a, b)| [a, b])
            }
            _ => None,
        };
        // A constant channel has a window of no width, which is no damage.
        let is_flat = start
            .zip(stop)
            .is_none_or(|(start, stop)| start.as_number().is_some() && start.as_number() == stop.as_number());
        used(&window, look.window.is_some() || is_flat);
    }
    look
}

fn name_of(text: &str) -> Option<String> {
    let text = text.trim();
    let is_name = !text.is_empty() && text.chars().count() <= LONGEST_NAME && !text.chars().any(char::is_control);
    is_name.then(|| text.to_owned())
}

/// Red, green and blue, in six digits, or eight with an opacity behind; some write a hash before.
fn color_of(text: &str) -> Option<[u8; 3]> {
    let digits = text.trim().trim_start_matches('#');
    channel::from_hex(match digits.len() {
        8 if digits.bytes().all(|digit| digit.is_ascii_hexdigit()) => &digits[..6],
        _ => digits,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::said;
    use serde_json::{Value, json};

    fn read(channels: Value, count: u32) -> (Vec<ChannelLook>, String) {
        let (document, mut notes) = (json!({ "omero": { "channels": channels } }), Vec::new());
        (looks(&Ome::in_test(&document), count, &mut notes), said(&notes))
    }

    #[test]
    fn names_colours_and_windows_are_taken() {
        let (found, notes) = read(
            json!([
                { "active": true, "label": " LaminB1 ", "color": "0000FF", "window": { "min": 0, "max": 65535, "start": 0, "end": 1500 } },
                { "color": "#00ff0080", "label": "" },
                {},
            ]),
            3,
        );
        let look = |name: Option<&str>, color, window| ChannelLook {
            name: name.map(str::to_owned),
            color,
            window,
            unit: None,
        };
        assert_eq!(
            found,
            [
                look(Some("LaminB1"), Some([0, 0, 255]), Some([0.0, 1500.0])),
                look(None, Some([0, 255, 0]), None),
                look(None, None, None)
            ]
        );
        assert_eq!(notes, "");
        assert_eq!(read(json!([{ "active": true }]), 1), (Vec::new(), String::new()));
        // A constant channel.
        assert_eq!(read(json!([{ "label": "a", "window": { "start": 7, "end": 7 } }]), 1).1, "");
    }

    #[test]
    fn damaged_looks_are_left_out_with_a_note() {
        let (found, notes) =
            read(json!([{ "color": "red", "window": { "start": 5, "end": 1 }, "label": "a" }, 7, {}]), 2);
        assert_eq!(
            (found.len(), found[0].name.as_deref(), found[0].color, found[0].window),
            (2, Some("a"), None, None)
        );
        assert!(notes.contains("tells of 3 channels, but the image has 2 channels"), "{notes}");
        let places = "attributes.ome.omero.channels[0].color, attributes.ome.omero.channels[0].window cannot be used";
        assert!(notes.contains(places), "{notes}");
        assert!(read(json!("all"), 2).1.contains("omero.channels is no list"));
    }
}
