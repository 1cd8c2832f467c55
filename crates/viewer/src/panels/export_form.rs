//! Form of an export: level, channels and steps of the visible voxels' store, as controls and as words of a command.

use crate::panels::widgets::{count, row};
use crate::part::Part;
use brickyard::export::{ExportChannels, ExportRequest, ExportTime};
use eframe::egui::{DragValue, ScrollArea, Ui};
use std::fmt;

/// Greatest height of the list of channels, in points.
const CHANNELS_HEIGHT: f32 = 66.0;

/// The form of an export.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct ExportForm {
    pub(crate) level: u8,
    /// Channels, ascending; `None` is the layer's.
    channels: Option<Vec<u32>>,
    /// First and last step; `None` is the shown one.
    steps: Option<[u32; 2]>,
    /// Whether an existing file is replaced.
    pub(crate) replaces: bool,
}

impl ExportForm {
    /// The request for a part.
    pub(crate) fn request(&self, part: &Part) -> ExportRequest {
        let channels = match self.channels.as_deref() {
            None => ExportChannels::One(part.channel),
            Some([one]) => ExportChannels::One(*one),
            Some(several) => ExportChannels::Several(several.to_vec()),
        };
        let time = match self.steps {
            None => ExportTime::Step(part.step),
            Some([first, last]) if first == last => ExportTime::Step(first),
            Some([first, last]) => ExportTime::Steps { first, end: last.saturating_add(1), stride: 1 },
        };
        let (level, region, overwrite) = (part.level, Some(part.region), self.replaces);
        ExportRequest { level, time, channels, region, overwrite, ..ExportRequest::default() }
    }

    /// Bytes of the requested voxels of a part.
    pub(crate) fn bytes(&self, part: &Part) -> u64 {
        let channels = self.channels.as_ref().map_or(1, |channels| channels.len() as u64);
        let steps = self.steps.map_or(1, |[first, last]| u64::from(last.saturating_sub(first)) + 1);
        let voxels = part.region.extent().volume().saturating_mul(channels.saturating_mul(steps));
        voxels.saturating_mul(part.store.voxel_type().bytes() as u64)
    }

    /// The reason for no export, if any.
    pub(crate) fn problem(&self) -> Option<&'static str> {
        self.channels.as_ref().is_some_and(Vec::is_empty).then_some("choose a channel")
    }

    /// Shows the form, for the part at its level. Choices that another store lacks are dropped: the first visible layer may become another.
    pub(crate) fn show(&mut self, ui: &mut Ui, part: &Part) {
        let (channels, times) = (part.store.channels(), part.store.times());
        self.channels.take_if(|chosen| chosen.iter().any(|channel| *channel >= channels));
        self.steps.take_if(|[_, last]| *last >= times);
        level(ui, &mut self.level, part.coarsest());
        self.show_channels(ui, part);
        self.show_steps(ui, part);
    }

    fn show_channels(&mut self, ui: &mut Ui, part: &Part) {
        let displays = part.store.channel_displays();
        if displays.len() < 2 {
            return;
        }
        let mut chosen = self.channels.clone().unwrap_or_else(|| vec![part.channel]);
        let before = chosen.clone();
        row(ui, "channels", "several are an axis of the array, or files' own channels", |ui, _| {
            let list = ScrollArea::vertical().max_height(CHANNELS_HEIGHT).auto_shrink([false, true]);
            list.show(ui, |ui| {
                ui.horizontal_wrapped(|ui| {
                    for (channel, display) in (0..).zip(displays) {
                        let mut is_chosen = chosen.contains(&channel);
                        let name = display.name.clone().filter(|name| !name.is_empty());
                        if ui.checkbox(&mut is_chosen, name.unwrap_or_else(|| channel.to_string())).changed() {
                            chosen.retain(|other| *other != channel);
                            chosen.extend(is_chosen.then_some(channel));
                            chosen.sort_unstable();
                        }
                    }
                });
            });
        });
        if chosen != before {
            self.channels = Some(chosen);
        }
    }

    fn show_steps(&mut self, ui: &mut Ui, part: &Part) {
        let Some(last_step) = part.store.times().checked_sub(1).filter(|last| *last > 0) else { return };
        let hint = "the first and the last time step; several are an axis of the array, or files' own times";
        row(ui, "steps", hint, |ui, label| {
            let mut steps = self.steps.unwrap_or([part.step; 2]);
            let [first, last] = &mut steps;
            ui.add(DragValue::new(first).range(0..=last_step)).labelled_by(label).on_hover_text("the first step");
            ui.label("to");
            ui.add(DragValue::new(last).range(*first..=last_step)).labelled_by(label).on_hover_text("the last step");
            if ui.button("all").clicked() {
                steps = [0, last_step];
            }
            if steps != self.steps.unwrap_or([part.step; 2]) {
                self.steps = Some(steps);
            }
        });
    }
}

/// Shows a level of a pyramid, unless there is one alone.
pub(super) fn level(ui: &mut Ui, level: &mut u8, coarsest: u8) {
    if coarsest > 0 {
        let mut chosen = u32::from(*level);
        count(
            ui,
            "level",
            "0 is the finest; each next one has half the voxels along an axis",
            &mut chosen,
            0..=coarsest.into(),
        );
        *level = u8::try_from(chosen).unwrap_or(coarsest);
    }
}

impl fmt::Display for ExportForm {
    /// Writes the form's words, each with a space behind it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.level > 0 {
            write!(f, "level={} ", self.level)?;
        }
        if let Some(channels) = &self.channels {
            let channels: Vec<String> = channels.iter().map(u32::to_string).collect();
            write!(f, "channels={} ", channels.join(","))?;
        }
        if let Some([first, last]) = self.steps {
            write!(f, "steps={first}-{last} ")?;
        }
        if self.replaces { f.write_str("replace=yes ") } else { Ok(()) }
    }
}

impl ExportForm {
    /// Reads the words before a file's name, and returns the name; `None` for a wrong value.
    pub(crate) fn read(text: &str) -> Option<(Self, &str)> {
        let mut form = Self::default();
        let file = words(text, |name, value| {
            match name {
                "level" => form.level = value.parse().ok()?,
                "channels" => {
                    let mut channels = value.split(',').map(|one| one.parse().ok()).collect::<Option<Vec<u32>>>()?;
                    channels.sort_unstable();
                    channels.dedup();
                    form.channels = Some(channels);
                }
                "steps" => {
                    let (first, last) = value.split_once('-').unwrap_or((value, value));
                    let steps = [first.parse().ok()?, last.parse().ok()?];
                    form.steps = Some(steps).filter(|[first, last]| first <= last);
                    form.steps?;
                }
                "replace" => form.replaces = is_yes(value)?,
                _ => return Some(false),
            }
            Some(true)
        })?;
        Some((form, file))
    }
}

/// Reads words `NAME=VALUE`, as far as `take` knows their names. Returns the rest, a file's name; `None` if there is none, or `take` refuses a value.
pub(super) fn words(text: &str, mut take: impl FnMut(&str, &str) -> Option<bool>) -> Option<&str> {
    let mut rest = text.trim();
    while let Some((word, after)) = rest.split_once(' ')
        && let Some((name, value)) = word.split_once('=')
        && take(name, value)?
    {
        rest = after.trim();
    }
    (!rest.is_empty()).then_some(rest)
}

pub(super) fn is_yes(value: &str) -> Option<bool> {
    match value {
        "yes" => Some(true),
        "no" => Some(false),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::part::tests::store;
    use brickyard::volume::Scene;

    #[test]
    fn the_request_is_what_the_form_says() {
        let folder = tempfile::tempdir().unwrap();
        let volumes = [store(folder.path())];
        let part = |form: &ExportForm| Part::of(&Scene { time: 2, ..Scene::default() }, &volumes, form.level).unwrap();
        let shown = ExportForm::default();
        let request = shown.request(&part(&shown));
        assert_eq!((request.time, request.channels), (ExportTime::Step(2), ExportChannels::One(0)));
        assert_eq!(shown.bytes(&part(&shown)), 12_000);
        let (form, file) = ExportForm::read("level=1 channels=2,0 steps=0-1 replace=yes my file=1.raw").unwrap();
        assert_eq!(file, "my file=1.raw");
        let request = form.request(&part(&form));
        assert_eq!(request.channels, ExportChannels::Several(vec![0, 2]));
        assert_eq!((request.time, request.level.0), (ExportTime::Steps { first: 0, end: 2, stride: 1 }, 1));
        assert_eq!((request.overwrite, request.region), (true, Some(part(&form).region)));
        assert_eq!(form.bytes(&part(&form)), 2 * 2 * 2 * 15 * 10 * 5);
        for bad in ["level=300 a.raw", "steps=2-1 a.raw", "channels=x a.raw", "replace=1 a.raw", "level=1", ""] {
            let read = ExportForm::read(bad);
            assert!(read.is_none() || bad == "level=1", "{bad}: {read:?}");
        }
        // Without a file behind it a word is the file.
        assert_eq!(ExportForm::read("level=1").unwrap().1, "level=1");
        assert_eq!(ExportForm { channels: Some(Vec::new()), ..shown }.problem(), Some("choose a channel"));
    }
}
