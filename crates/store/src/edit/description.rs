//! Description of a store's volume as its source would give it, with edits applied and checked by the code of packing.

use super::levels::are_mixed;
use super::{Edit, EditChange, EditError};
use crate::downsample::{Downsample, Reductions};
use crate::metadata::{Kind, StoreInfo};
use crate::pack::check_name;
use crate::pack::plan::check_input;
use crate::store::Store;
use brickyard_import::{ImportError, OpenOptions, SourceInfo, redescribe};
use brickyard_volume::{ChannelLook, Orientation, TimeAxis};
use glam::DVec3;
use serde_json::{Value, json};

/// A volume's name and description.
#[derive(Clone, PartialEq)]
pub(super) struct Description {
    name: Option<String>,
    kind: Kind,
    /// Whether OME-Zarr's metadata say that these are labels.
    image_label: bool,
    downsample: Reductions,
    pub(super) info: SourceInfo,
}

impl Description {
    /// A store's, with the looks in effect.
    pub(super) fn of(store: &Store) -> Self {
        let stored = store.info();
        let look = |display: &crate::metadata::ChannelDisplay| ChannelLook {
            name: display.name.clone(),
            color: Some(display.color),
            window: None,
            unit: display.unit.clone(),
        };
        let info = SourceInfo {
            channels: store.channels(),
            times: store.times(),
            time: store.time_axis().cloned(),
            geometry: store.geometry().clone(),
            calibrated: stored.calibrated,
            turned: stored.turned,
            flip: Some(stored.flipped),
            orientation: stored.orientation,
            channel_looks: store.channel_displays().iter().map(look).collect(),
            ..SourceInfo::of_volume(store.pyramid().levels()[0].extent, store.voxel_type())
        };
        let StoreInfo { kind, image_label, downsample, .. } = *stored;
        Self { name: stored.name.clone(), kind, image_label, downsample, info }
    }

    /// One look per channel.
    pub(super) fn looks(&self) -> &[ChannelLook] {
        &self.info.channel_looks
    }

    /// This description with edits.
    pub(super) fn edited(&self, edit: &Edit, store: &Store) -> Result<Self, EditError> {
        let path = store.path();
        let refuse = |problem: String| EditError::from(ImportError::Options { path: path.into(), problem });
        let mut new = self.clone();
        if let Some(orientation) = edit.orientation {
            if edit.spacing.is_some() || edit.origin.is_some() {
                return Err(refuse("a matrix has `spacing` and `origin`: leave these out".into()));
            }
            take_orientation(orientation, &mut new.info);
        }
        let is_of_time = edit.time_step.is_some() || edit.time_unit.is_some() || edit.time_stamps.is_some();
        if is_of_time && store.layout().axes()[0] != "t" {
            return Err(refuse("has no axis of time; pack it again with `time_step`".into()));
        }
        if let Some(kind) = edit.kind {
            (new.kind, new.image_label) = (kind, kind == Kind::Labels);
        }
        if new.kind == Kind::Labels && are_mixed(store) {
            new.downsample = Downsample::Mode.into();
        }
        let options = OpenOptions { are_labels: Some(new.kind == Kind::Labels), ..options(edit) };
        redescribe(&mut new.info, &options, path)?;
        let before = new.info.geometry.clone();
        let of_unit = OpenOptions { unit: edit.unit.clone(), ..OpenOptions::default() };
        redescribe(&mut new.info, &of_unit, path)?;
        let after = &new.info.geometry;
        let is_converted = after.spacing != before.spacing && edit.spacing.is_none()
            || after.origin != before.origin && edit.origin.is_none();
        if is_converted {
            let units = edit.unit.as_deref().unwrap_or_default();
            let problem = format!(
                "`unit` {units}: these lengths are converted to one unit, which the store's numbers have already: give \
                 `spacing` and `origin` in them, too"
            );
            return Err(refuse(problem));
        }
        if new.info.orientation.is_some() && new.info.geometry.axis_units.is_some() {
            return Err(refuse("an orientation in a patient needs one unit of length: give it with `unit`".into()));
        }
        if let Some(name) = &edit.name {
            check_name(name).map_err(|expected| refuse(format!("`name`: {expected}")))?;
            new.name = Some(name.clone());
        }
        self.take_looks(edit, new.kind, &mut new.info).map_err(refuse)?;
        check_input(&new.info)?;
        Ok(new)
    }

    /// Sets the edited looks of channels, which are named by this description's names.
    fn take_looks(&self, edit: &Edit, kind: Kind, info: &mut SourceInfo) -> Result<(), String> {
        let mut named = Vec::new();
        for channel in &edit.channels {
            let places = match &channel.channel {
                None => 0..info.channels,
                Some(choice) => {
                    let place = choice.place(&self.info).map_err(|problem| format!("channel {choice}: {problem}"))?;
                    place..place + 1
                }
            };
            if channel.color.is_some() && kind == Kind::Labels {
                return Err("labels have colours of their own: no channel takes one".into());
            }
            for place in places {
                let look = &mut info.channel_looks[place as usize];
                look.color = channel.color.or(look.color);
                if let Some(name) = &channel.name {
                    check_name(name).map_err(|expected| format!("the name of channel {place}: {expected}"))?;
                    look.name = Some(name.trim().to_owned());
                    named.push(place as usize);
                }
            }
        }
        let looks = &info.channel_looks;
        let is_taken =
            |place: &&usize| (0..looks.len()).any(|other| other != **place && looks[other].name == looks[**place].name);
        match named.iter().find(is_taken) {
            Some(place) => {
                let name = looks[*place].name.as_deref().unwrap_or_default();
                Err(format!("channel {place}: another channel is called {name}, too; give each its own name"))
            }
            None => Ok(()),
        }
    }

    /// The changed values.
    pub(super) fn changes_to(&self, new: &Self) -> Vec<EditChange> {
        let mut changes = Vec::new();
        let mut compare = |field: &str, old: Value, new: Value| {
            if old != new {
                changes.push(EditChange { field: field.into(), old, new });
            }
        };
        let [from, to] = [self, new].map(|of| &of.info);
        let triple = |v: DVec3| json!(v.to_array());
        compare("spacing", triple(from.geometry.spacing), triple(to.geometry.spacing));
        compare("calibrated", json!(from.calibrated), json!(to.calibrated));
        compare("origin", triple(from.geometry.origin), triple(to.geometry.origin));
        compare("unit", json!(from.geometry.units_in_words()), json!(to.geometry.units_in_words()));
        compare("orientation", json!(from.orientation), json!(to.orientation));
        let [old, now] = [from, to].map(|info| info.time.as_ref());
        compare("time step", json!(old.map(|axis| axis.step)), json!(now.map(|axis| axis.step)));
        compare("time of the first step", json!(old.map(|axis| axis.start)), json!(now.map(|axis| axis.start)));
        compare("time unit", json!(old.and_then(|a| a.unit.as_ref())), json!(now.and_then(|a| a.unit.as_ref())));
        let since = |axis: Option<&TimeAxis>| json!(axis.and_then(|axis| axis.since.as_ref()));
        compare("moment from which times count", since(old), since(now));
        let stamps = |axis: Option<&TimeAxis>| json!(axis.map(|axis| &axis.stamps).filter(|stamps| !stamps.is_empty()));
        compare("time stamps", stamps(old), stamps(now));
        compare("name", json!(self.name), json!(new.name));
        compare("kind", json!(self.kind), json!(new.kind));
        if self.kind == new.kind {
            compare("image-label", json!(self.image_label), json!(new.image_label));
        }
        compare("coarser levels", json!(self.downsample), json!(new.downsample));
        for (i, (old, new)) in self.looks().iter().zip(new.looks()).enumerate() {
            compare(&format!("channel {i} name"), json!(old.name), json!(new.name));
            let hex = |look: &ChannelLook| json!(look.color.map(brickyard_volume::channel::hex));
            compare(&format!("channel {i} color"), hex(old), hex(new));
            compare(&format!("channel {i} unit"), json!(old.unit), json!(new.unit));
        }
        changes
    }

    /// The store's settings with this description. Looks left as in the `former` one stay the store's own.
    pub(super) fn store_info(&self, former: &Self, stored: &StoreInfo) -> StoreInfo {
        let mut info = StoreInfo {
            name: self.name.clone(),
            kind: self.kind,
            image_label: self.image_label,
            downsample: self.downsample,
            axis_units: self.info.geometry.axis_units.clone(),
            calibrated: self.info.calibrated,
            orientation: self.info.orientation,
            time: self.info.time.clone(),
            ..stored.clone()
        };
        let looks = former.looks().iter().zip(self.looks());
        for (channel, (old, new)) in info.channels.iter_mut().zip(looks) {
            take(&mut channel.name, &old.name, &new.name);
            take(&mut channel.color, &old.color, &new.color);
            take(&mut channel.unit, &old.unit, &new.unit);
        }
        info
    }
}

/// Sets a value if it is edited.
fn take<T: Clone + PartialEq>(stored: &mut Option<T>, old: &Option<T>, new: &Option<T>) {
    if old != new {
        stored.clone_from(new);
    }
}

/// The options of packing with an edit's values.
fn options(edit: &Edit) -> OpenOptions {
    OpenOptions {
        spacing: edit.spacing,
        origin: edit.origin,
        value_unit: edit.value_unit.clone(),
        time_step: edit.time_step,
        time_unit: edit.time_unit.clone(),
        time_stamps: edit.time_stamps.clone(),
        ..OpenOptions::default()
    }
}

/// Sets orientation, spacing and origin from a map from voxel indices to a patient, as readers do with a header's.
fn take_orientation(orientation: Orientation, info: &mut SourceInfo) {
    info.geometry.spacing = DVec3::from_array([0, 1, 2].map(|axis| orientation.step(axis).length()));
    info.geometry.origin = if orientation.is_upright() { orientation.first_centre() } else { DVec3::ZERO };
    (info.orientation, info.calibrated) = (Some(orientation), true);
}
