//! Settings that stores of this program keep beside OME-Zarr's metadata, as far as a source can tell it: calibration, orientation, times, units and the
//! value for no data. Anything that cannot be used is passed over.

use super::node::Group;
use crate::labels::SaidKind;
use crate::source::SourceInfo;
use brickyard_volume::units::{axis_unit, free_unit};
use brickyard_volume::{Orientation, TimeAxis};
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

/// A store's settings.
pub(super) struct Own<'a> {
    members: &'a Map<String, Value>,
}

impl<'a> Own<'a> {
    /// The settings of a group; `None` unless it is a store of this program.
    pub(super) fn of(group: &'a Group) -> Option<Self> {
        let members = group.attributes().get("brickyard")?.as_object()?;
        members.get("version")?.is_u64().then_some(Self { members })
    }

    fn get<T: DeserializeOwned>(&self, name: &str) -> Option<T> {
        serde_json::from_value(self.members.get(name)?.clone()).ok()
    }

    /// Time steps, where an interrupted append left more in the arrays.
    pub(super) fn times(&self) -> Option<u32> {
        self.get::<u32>("times").filter(|times| *times > 0)
    }

    /// The store's word on its values; `None` for an image.
    pub(super) fn kind(&self) -> Option<SaidKind> {
        (self.get::<String>("kind")? == "labels").then_some(SaidKind::Labels("the store"))
    }

    /// Adds all that is about the finest level as a whole.
    pub(super) fn describe(&self, info: &mut SourceInfo) {
        if let Some(calibrated) = self.get("calibrated") {
            info.calibrated = calibrated;
        }
        if let Some(units) = self.get::<[String; 3]>("axis_units")
            && units.iter().all(|unit| axis_unit(unit).is_ok())
        {
            (info.geometry.unit, info.geometry.axis_units) = (None, Some(units));
        }
        if let Some(orientation) = self.get::<[[f64; 4]; 3]>("orientation") {
            info.orientation = Orientation::new(orientation).ok();
        }
        if let Some(time) = self.get::<TimeAxis>("time").filter(|time| time.check(info.times).is_ok()) {
            info.time = Some(time);
        }
        let channels = self.get::<Vec<Value>>("channels").unwrap_or_default();
        for (channel, said) in channels.iter().take(info.channels as usize).enumerate() {
            // A name made for display is none.
            if let Some(look) = info.channel_looks.get_mut(channel)
                && said["name"].is_null()
                && look.name == Some(format!("channel {channel}"))
            {
                look.name = None;
            }
            if let Some(unit) = said["unit"].as_str().and_then(|unit| free_unit(unit).ok()) {
                info.looks_of_all()[channel].unit = Some(unit.to_owned());
            }
        }
    }
}
