//! Form of an edit of a store's metadata: its controls begin with the store's values, and the changed ones are the edit, also as words of a command.

use crate::panels::widgets::{color, row, vector};
use brickyard::store::{ChannelEdit, Edit, Store};
use brickyard::volume::channel::{from_hex, hex};
use eframe::egui::{Key, Response, ScrollArea, TextEdit, Ui};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Greatest height of the list of channels, in points.
const CHANNELS_HEIGHT: f32 = 130.0;

/// Width of a unit's field, in points.
const UNIT_WIDTH: f32 = 160.0;

/// New values of a store's metadata; the rest stays.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct MetadataEdit {
    #[serde(skip_serializing_if = "Option::is_none")]
    name: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    spacing: Option<DVec3>,
    #[serde(skip_serializing_if = "Option::is_none")]
    origin: Option<DVec3>,
    #[serde(skip_serializing_if = "Option::is_none")]
    unit: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    value_unit: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    time_step: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    time_unit: Option<String>,
    /// Names by the channels' numbers.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    channel_names: BTreeMap<u32, String>,
    /// Colours by the channels' numbers, as six hexadecimal digits.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    channel_colors: BTreeMap<u32, String>,
}

impl MetadataEdit {
    /// The edit of a store.
    ///
    /// # Errors
    /// If a colour is malformed.
    pub(crate) fn edit(&self) -> Result<Edit, String> {
        let channel = |channel: &u32| channel.to_string().parse().map(Some);
        let named = |(number, name): (&u32, &String)| {
            Ok(ChannelEdit { channel: channel(number)?, name: Some(name.clone()), color: None })
        };
        let colored = |(number, text): (&u32, &String)| {
            let color = from_hex(text).ok_or_else(|| format!("no colour '{text}': expected RRGGBB"))?;
            Ok(ChannelEdit { channel: channel(number)?, name: None, color: Some(color) })
        };
        let channels = self.channel_names.iter().map(named).chain(self.channel_colors.iter().map(colored));
        Ok(Edit {
            name: self.name.clone(),
            spacing: self.spacing,
            origin: self.origin,
            unit: self.unit.clone(),
            value_unit: self.value_unit.clone(),
            time_step: self.time_step,
            time_unit: self.time_unit.clone(),
            channels: channels.collect::<Result<_, String>>()?,
            ..Edit::default()
        })
    }
}

/// The metadata in the form's fields.
#[derive(Clone, Debug, PartialEq)]
struct Fields {
    name: String,
    spacing: DVec3,
    origin: DVec3,
    unit: String,
    value_unit: String,
    /// The time between steps, as typed.
    time_step: String,
    time_unit: String,
    channels: Vec<(String, [f64; 3])>,
}

impl Fields {
    fn of(store: &Store) -> Self {
        let displays = store.channel_displays();
        let axis = store.time_axis();
        // Channels with units of their own have none in common.
        let units = displays.iter().map(|display| display.unit.clone().unwrap_or_default());
        let value_unit = units.reduce(|one, other| if one == other { one } else { String::new() });
        let step = axis.filter(|axis| axis.stamps.is_empty()).map(|axis| axis.step.to_string());
        let color = |color: [u8; 3]| color.map(|part| f64::from(part) / 255.0);
        Self {
            name: store.info().name.clone().unwrap_or_default(),
            spacing: store.geometry().spacing,
            origin: store.geometry().origin,
            unit: store.geometry().units_in_words().unwrap_or_default(),
            value_unit: value_unit.unwrap_or_default(),
            time_step: step.unwrap_or_default(),
            time_unit: axis.and_then(|axis| axis.unit.clone()).unwrap_or_default(),
            channels: displays.iter().map(|of| (of.name.clone().unwrap_or_default(), color(of.color))).collect(),
        }
    }
}

/// The form for a store.
pub(crate) struct EditForm {
    store: PathBuf,
    before: Fields,
    fields: Fields,
    /// Whether the store has an axis of time, and whether its voxels are labels, whose channels have no colours.
    has_time: bool,
    are_labels: bool,
}

impl EditForm {
    pub(crate) fn of(store: &Store) -> Self {
        let fields = Fields::of(store);
        let are_labels = store.info().kind == brickyard::store::Kind::Labels;
        let (store, has_time) = (store.path().to_owned(), store.can_grow());
        Self { store, before: fields.clone(), fields, has_time, are_labels }
    }

    /// Whether the form is about a store.
    pub(crate) fn is_about(&self, store: &Store) -> bool {
        self.store == store.path()
    }

    /// The changed values; the store has the others already.
    ///
    /// # Errors
    /// If the time between steps is no number.
    pub(crate) fn changes(&self) -> Result<MetadataEdit, String> {
        let (old, new) = (&self.before, &self.fields);
        let text = |old: &String, new: &String| (old != new).then(|| new.trim().to_owned());
        let time_step = text(&old.time_step, &new.time_step);
        let number = |text: String| {
            text.parse::<f64>().map_err(|_| format!("time step '{text}': expected a number, the time between steps"))
        };
        let channels = || (0..).zip(old.channels.iter().zip(&new.channels));
        let bytes = |color: [f64; 3]| color.map(|part| (part * 255.0).round() as u8);
        let recolored = channels().filter(|(_, (old, new))| bytes(old.1) != bytes(new.1));
        let renamed = channels().filter_map(|(i, (old, new))| Some((i, text(&old.0, &new.0)?)));
        Ok(MetadataEdit {
            name: text(&old.name, &new.name),
            spacing: (old.spacing != new.spacing).then_some(new.spacing),
            origin: (old.origin != new.origin).then_some(new.origin),
            unit: text(&old.unit, &new.unit),
            value_unit: text(&old.value_unit, &new.value_unit),
            time_step: time_step.map(number).transpose()?,
            time_unit: text(&old.time_unit, &new.time_unit),
            channel_names: renamed.collect(),
            channel_colors: recolored.map(|(i, (_, new))| (i, hex(bytes(new.1)))).collect(),
        })
    }

    /// Shows the form, with the focus on its first field if `wants_focus`. Returns whether Enter ended a text.
    pub(crate) fn show(&mut self, ui: &mut Ui, wants_focus: bool) -> bool {
        let fields = &mut self.fields;
        let name = text(ui, "name", "the volume's name in the store", &mut fields.name, f32::INFINITY);
        if wants_focus {
            name.request_focus();
        }
        let mut is_entered = is_ended_by_enter(ui, &name);
        let hint = "the distance between voxel centres of the finest level along x, y and z";
        vector(ui, "voxel size", hint, &mut fields.spacing, 1.0);
        let hint = "the place of the first voxel's centre";
        vector(ui, "origin", hint, &mut fields.origin, 100.0);
        let hint = "nm, um, mm, cm, m, or a UDUNITS name; or those of x, y and z with commas between. Numbers stay as they are";
        let field = text(ui, "unit", hint, &mut fields.unit, UNIT_WIDTH);
        is_entered |= is_ended_by_enter(ui, &field);
        let hint = "the unit of all channels' values, such as HU";
        let field = text(ui, "value unit", hint, &mut fields.value_unit, UNIT_WIDTH);
        is_entered |= is_ended_by_enter(ui, &field);
        if self.has_time {
            let hint = "the time between steps; empty where they are uneven";
            let field = text(ui, "time step", hint, &mut fields.time_step, UNIT_WIDTH);
            is_entered |= is_ended_by_enter(ui, &field);
            let hint = "s, ms, us, ns, min, h, d, or a UDUNITS name";
            let field = text(ui, "time unit", hint, &mut fields.time_unit, UNIT_WIDTH);
            is_entered |= is_ended_by_enter(ui, &field);
        }
        ui.add_space(4.0);
        ScrollArea::vertical().max_height(CHANNELS_HEIGHT).auto_shrink([false, true]).show(ui, |ui| {
            for (i, (name, own)) in fields.channels.iter_mut().enumerate() {
                ui.push_id(i, |ui| {
                    row(ui, &format!("channel {i}"), "name and colour of the channel", |ui, label| {
                        if !self.are_labels {
                            color(ui, own).labelled_by(label);
                        }
                        let field = ui.add(TextEdit::singleline(name).desired_width(f32::INFINITY)).labelled_by(label);
                        is_entered |= is_ended_by_enter(ui, &field);
                    });
                });
            }
        });
        is_entered
    }
}

/// Shows a line of text.
fn text(ui: &mut Ui, name: &str, hint: &str, value: &mut String, width: f32) -> Response {
    let field = TextEdit::singleline(value).desired_width(width);
    row(ui, name, hint, |ui, label| ui.add(field).labelled_by(label).on_hover_text(hint))
}

fn is_ended_by_enter(ui: &Ui, field: &Response) -> bool {
    field.lost_focus() && ui.input(|input| input.key_pressed(Key::Enter))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::part::tests::store;

    #[test]
    fn the_changed_fields_are_the_edit() {
        let folder = tempfile::tempdir().unwrap();
        let volume = store(folder.path());
        let mut form = EditForm::of(volume.store().unwrap());
        assert_eq!(form.changes(), Ok(MetadataEdit::default()));
        form.fields.name = " left eye ".into();
        form.fields.spacing.z = 2.5;
        form.fields.channels[0] = ("DAPI".into(), [0.0, 0.5, 1.0]);
        form.fields.time_step = "x".into();
        assert!(form.changes().unwrap_err().contains("'x': expected a number"));
        form.fields.time_step = "0.5".into();
        let changes = form.changes().unwrap();
        let expected = r#"{"name":"left eye","spacing":[1.0,1.0,2.5],"time_step":0.5,"channel_names":{"0":"DAPI"},"channel_colors":{"0":"0080FF"}}"#;
        assert_eq!(serde_json::to_string(&changes).unwrap(), expected);
        assert_eq!(serde_json::from_str::<MetadataEdit>(expected).unwrap(), changes);
        let edit = changes.edit().unwrap();
        assert_eq!((edit.channels.len(), edit.channels[1].color, edit.unit), (2, Some([0, 128, 255]), None));
        let wrong: MetadataEdit = serde_json::from_str(r#"{"channel_colors": {"1": "blu"}}"#).unwrap();
        assert!(wrong.edit().unwrap_err().contains("expected RRGGBB"));
        assert!(serde_json::from_str::<MetadataEdit>(r#"{"spacig": [1, 1, 1]}"#).is_err());
    }
}
