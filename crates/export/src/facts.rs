//! Facts of a volume beside its voxels, and the note on those lost in a format. A format lists the kept ones, so a new fact is told to be missing
//! until a writer learns it.

use crate::volume::Volume;
use brickyard_volume::numbers::exact;

/// A fact for a file to keep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Fact {
    /// Distances of voxels.
    Spacing,
    /// The unit of lengths, or of each axis.
    LengthUnit,
    /// The first voxel's place, in a volume without an orientation.
    Origin,
    /// The matrix of a volume in a patient.
    Orientation,
    /// Times of all steps.
    Times,
    /// Time of the only step.
    StepTime,
    /// The unit of times.
    TimeUnit,
    /// The moment from which times count.
    Since,
    /// The channels' names.
    ChannelNames,
    /// The channels' colours, where the source gave them.
    ChannelColors,
    /// The unit of values, one or several.
    ValueUnit,
    /// The value of voxels without data.
    NoData,
    /// Values are labels.
    Labels,
    /// The volume's name.
    Name,
}

impl Fact {
    /// All facts.
    pub(crate) const ALL: [Self; 14] = [
        Self::Spacing,
        Self::LengthUnit,
        Self::Origin,
        Self::Orientation,
        Self::Times,
        Self::StepTime,
        Self::TimeUnit,
        Self::Since,
        Self::ChannelNames,
        Self::ChannelColors,
        Self::ValueUnit,
        Self::NoData,
        Self::Labels,
        Self::Name,
    ];

    /// The fact in words; `None` if the volume lacks it.
    fn of(self, volume: &Volume) -> Option<String> {
        let info = volume.info;
        let is_there = |condition: bool, words: &str| condition.then(|| words.to_owned());
        match self {
            Self::Spacing => is_there(info.calibrated, "the spacing"),
            Self::LengthUnit => {
                let units = info.geometry.units_in_words().filter(|_| info.calibrated);
                units.map(|units| format!("the unit of lengths ({units})"))
            }
            Self::Origin => {
                let is_elsewhere = info.geometry.origin.to_array() != [0.0; 3];
                is_there(is_elsewhere && info.orientation.is_none(), "the origin")
            }
            Self::Orientation => is_there(info.orientation.is_some(), "the orientation"),
            Self::Times => is_there(info.time.is_some() && info.times > 1, "the times of the steps"),
            Self::StepTime => is_there(info.time.is_some() && info.times == 1, "the time of the step"),
            Self::TimeUnit => {
                let unit = info.time.as_ref().and_then(|time| time.unit.as_ref());
                unit.map(|unit| format!("the unit of times ({unit})"))
            }
            Self::Since => {
                let since = info.time.as_ref().and_then(|time| time.since.as_ref());
                since.map(|since| format!("the moment from which times count ({since})"))
            }
            Self::ChannelNames => {
                is_there(info.channel_looks.iter().any(|look| look.name.is_some()), "names of channels")
            }
            Self::ChannelColors => {
                is_there(info.channel_looks.iter().any(|look| look.color.is_some()), "colours of channels")
            }
            Self::ValueUnit => {
                let unit = info.channel_looks.iter().find_map(|look| look.unit.as_ref())?;
                Some(format!("the unit of values ({unit})"))
            }
            Self::NoData => {
                info.nodata.map(|value| format!("the value of no data ({})", exact(value, info.voxel_type.is_float())))
            }
            Self::Labels => is_there(volume.is_labels, "the voxels being labels"),
            Self::Name => volume.name.map(|name| format!("the volume's name ({name})")),
        }
    }

    /// The fact without which this one says nothing.
    fn of_what(self) -> Option<[Self; 2]> {
        match self {
            Self::LengthUnit => Some([Self::Spacing; 2]),
            Self::TimeUnit | Self::Since => Some([Self::Times, Self::StepTime]),
            _ => None,
        }
    }
}

/// A sentence on the volume's facts left out by a format; `None` if there are none.
pub(crate) fn lost(volume: &Volume, format: &str, kept: &[Fact]) -> Option<String> {
    lost_in_words(volume, kept).map(|list| format!("{format} cannot keep {list}: left out."))
}

/// The volume's facts besides the kept ones, as a list in words; `None` if there are none.
pub(crate) fn lost_in_words(volume: &Volume, kept: &[Fact]) -> Option<String> {
    let is_said = |fact: &Fact| {
        let has_part = fact.of_what().is_none_or(|wholes| wholes.iter().any(|whole| kept.contains(whole)));
        !kept.contains(fact) && has_part
    };
    let lost: Vec<String> = Fact::ALL.iter().filter(|fact| is_said(fact)).filter_map(|fact| fact.of(volume)).collect();
    match &lost[..] {
        [] => None,
        [one] => Some(one.clone()),
        [first @ .., last] => Some(format!("{} and {last}", first.join(", "))),
    }
}

/// Most bytes of a moment that readers take.
const LONGEST_MOMENT: usize = 64;

/// The moment from which times count, if every format can write it as it is: a short line without marks of their own.
pub(crate) fn moment<'a>(volume: &Volume<'a>) -> Option<&'a str> {
    let since = volume.info.time.as_ref()?.since.as_deref()?;
    let is_plain = |letter: char| !letter.is_control() && !['"', '\\', '&', '<', '>'].contains(&letter);
    let is_short = (1..=LONGEST_MOMENT).contains(&since.len()) && since.trim() == since;
    (is_short && since.chars().all(is_plain)).then_some(since)
}

/// The one unit of all channels' values; `None` if they have none, or several.
pub(crate) fn value_unit<'a>(volume: &Volume<'a>) -> Option<&'a str> {
    let mut units = volume.info.channel_looks.iter().map(|look| look.unit.as_deref());
    let first = units.next()??;
    units.all(|unit| unit == Some(first)).then_some(first)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{info, volume};
    use brickyard_volume::{ChannelLook, TimeAxis};
    use glam::DVec3;

    #[test]
    fn the_note_lists_what_is_there_and_is_lost() {
        let mut info = info();
        assert_eq!(lost(&volume(&info), "x", &[]), None);
        info.calibrated = true;
        info.geometry.unit = Some("millimeter".into());
        info.geometry.origin = DVec3::X;
        info.time = Some(TimeAxis { unit: Some("second".into()), ..TimeAxis::default() });
        info.channel_looks = vec![ChannelLook { unit: Some("K".into()), ..ChannelLook::default() }];
        info.nodata = Some(7.0);
        assert_eq!(
            lost(&volume(&info), "A .npy file", &[]).unwrap(),
            "A .npy file cannot keep the spacing, the origin, the time of the step, the unit of values (K) and the value of no data (7): left out."
        );
        let kept = [Fact::Spacing, Fact::Origin, Fact::StepTime, Fact::ValueUnit, Fact::NoData];
        assert_eq!(
            lost(&volume(&info), "NRRD", &kept).unwrap(),
            "NRRD cannot keep the unit of lengths (millimeter) and the unit of times (second): left out."
        );
        assert_eq!(lost(&volume(&info), "NRRD", &Fact::ALL), None);
    }

    #[test]
    fn a_unit_of_values_is_that_of_all_channels() {
        let mut info = info();
        let look = |unit: Option<&str>| ChannelLook { unit: unit.map(str::to_owned), ..ChannelLook::default() };
        for (units, expected) in [
            (vec![], None),
            (vec![Some("K")], Some("K")),
            (vec![Some("K"), Some("K")], Some("K")),
            (vec![Some("K"), None], None),
            (vec![None, Some("K")], None),
            (vec![Some("K"), Some("Pa")], None),
        ] {
            info.channel_looks = units.into_iter().map(look).collect();
            assert_eq!(value_unit(&volume(&info)), expected);
        }
    }
}
