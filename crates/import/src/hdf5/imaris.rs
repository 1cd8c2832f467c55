//! Imaris files (.ims): a dataset for each step and channel of the finest level, padded to whole chunks, and properties of the image as
//! texts of single characters.

use super::attributes::text;
use super::file::File;
use super::layout::{Elements, elements_of};
use super::source::Opening;
use super::tree::{Entry, Tree};
use super::types::Stored;
use crate::array_choice::last_of;
use crate::axes::{Axis, Sizes};
use crate::element::Decode;
use crate::error::{ImportError, Result};
use crate::note::{Note, Setting};
use crate::options::OpenOptions;
use crate::raw::identity;
use crate::source::{Source, SourceInfo};
use brickyard_volume::{ChannelLook, Extent, TimeAxis, counted};
use std::collections::BTreeSet;

const LEVEL: &str = "/DataSet/ResolutionLevel 0";
const IMAGE: &str = "/DataSetInfo/Image";

/// Whether the file has the groups of Imaris.
pub(super) fn is_imaris(tree: &Tree) -> bool {
    tree.group(LEVEL).is_some() && tree.group(IMAGE).is_some()
}

fn path_of(time: u32, channel: u32) -> String {
    format!("{LEVEL}/TimePoint {time}/Channel {channel}")
}

/// Opens the finest level.
pub(super) fn open(file: &File, tree: &Tree, options: &OpenOptions) -> Result<Box<dyn Source>> {
    if options.axes.is_some() {
        let problem = "`axes`: those of an Imaris file are known; leave it out, or name a dataset with `variable`";
        return Err(ImportError::options(&file.path, problem));
    }
    if !tree.is_whole() {
        let advice = "name one dataset with `variable`";
        return Err(ImportError::unsupported_but(
            &file.path,
            "an Imaris file of more objects than are looked at",
            advice,
        ));
    }
    let times = count_of(file, tree, LEVEL, "TimePoint ")?;
    let channels = count_of(file, tree, &format!("{LEVEL}/TimePoint 0"), "Channel ")?;
    for time in 1..times {
        let step = format!("{LEVEL}/TimePoint {time}");
        let found = count_of(file, tree, &step, "Channel ")?;
        if found != channels {
            return Err(
                file.damaged(&step, &format!("it has {}, the first step {channels}", counted(found.into(), "channel")))
            );
        }
    }
    let set = |time: u32, channel: u32| {
        let path = format!("{}/Data", path_of(time, channel));
        tree.set(&path).ok_or_else(|| file.damaged(&path, "it is missing"))
    };
    let first = set(0, 0)?;
    let stored = first.stored.clone();
    let stored = stored.map_err(|name| ImportError::unsupported(&file.path, format!("{name} of {}", first.path)))?;
    let extent = extent_of(file, tree, first)?;
    let mut arrays = Vec::new();
    for (time, channel) in (0..times).flat_map(|time| (0..channels).map(move |channel| (time, channel))) {
        let entry = set(time, channel)?;
        let unlike = || file.damaged(&entry.path, "it differs from that of the first step and channel in size or type");
        if entry.set.shape() != first.set.shape()
            || entry.stored.as_ref() != Ok(&stored)
            || extent_of(file, tree, entry)? != extent
        {
            return Err(unlike());
        }
        let id = arrays.len() as u64;
        match elements_of(file, &entry.set, &stored, &entry.path, id)? {
            Elements::Chunks(chunks) if chunks.known.is_none() => arrays.push(chunks),
            _ => {
                let feature = format!("{} without chunks", entry.path);
                return Err(ImportError::unsupported_but(&file.path, feature, "name one dataset with `variable`"));
            }
        }
    }
    // Elements beyond the image are padding, of any value.
    for array in &mut arrays {
        array.clip(&[extent.z.into(), extent.y.into(), extent.x.into()]);
    }
    let sizes = Sizes { extent, channels, times };
    sizes.checked_bytes(stored.bytes).map_err(|problem| ImportError::invalid(&file.path, problem))?;
    let decode = Decode { element: stored.element, endian: stored.endian, scale: None };
    let mut info = SourceInfo::plain(sizes, decode.voxel_type());
    info.identity = identity("hdf5 imaris", &[&file.path])?;
    describe(&mut info, tree, &stored);
    let axes = vec![Axis::Z, Axis::Y, Axis::X];
    Ok(Box::new(Opening { file, info, axes, decode, has_members: false }.chunks(arrays, options)?))
}

/// The number of groups with this start of their names in a group. They are counted from 0 without gaps.
fn count_of(file: &File, tree: &Tree, group: &str, start: &str) -> Result<u32> {
    let number = |path: &str| last_of(path).strip_prefix(start)?.parse::<u32>().ok();
    let numbers: BTreeSet<u32> = tree.groups_in(group).filter_map(number).collect();
    match (0..).zip(&numbers).find(|(place, number)| place != *number) {
        Some((place, _)) => {
            let feature = format!("{group} without {start}{place}, but with later ones,");
            Err(ImportError::unsupported_but(&file.path, feature, "name one dataset with `variable`"))
        }
        None => Ok(numbers.len() as u32),
    }
}

/// Sizes of the image in a channel, without the padding of its dataset.
fn extent_of(file: &File, tree: &Tree, entry: &Entry) -> Result<Extent> {
    let group = tree.group(super::tree::parent_of(&entry.path));
    let stored = entry.set.shape();
    let size = |name: &str, axis: usize| {
        let said = group.and_then(|group| text(&group.attributes, name)).and_then(|text| text.parse::<u32>().ok());
        let most = stored.get(axis).copied().unwrap_or(0);
        match said {
            Some(said) if said > 0 && u64::from(said) <= most => Ok(said),
            said => Err(file.damaged(&entry.path, &format!("{name} is {said:?}, of {most} stored"))),
        }
    };
    if stored.len() != 3 {
        return Err(file.damaged(&entry.path, &format!("it has {}", counted(stored.len() as u64, "axis"))));
    }
    Ok(Extent::new(size("ImageSizeX", 2)?, size("ImageSizeY", 1)?, size("ImageSizeZ", 0)?))
}

/// Sets spacing and origin, looks of channels, and times.
fn describe(info: &mut SourceInfo, tree: &Tree, stored: &Stored) {
    let said = |group: &str, name: &str| text(&tree.group(group)?.attributes, name);
    let number = |group: &str, name: &str| said(group, name)?.parse::<f64>().ok().filter(|number| number.is_finite());
    let extent = info.extent.to_array();
    let ends = |a: usize| Some((number(IMAGE, &format!("ExtMin{a}"))?, number(IMAGE, &format!("ExtMax{a}"))?));
    if let [Some(x), Some(y), Some(z)] = [ends(0), ends(1), ends(2)] {
        let ends = [x, y, z];
        // A volume of one slice may have no thickness.
        let spacing = (0..3).map(|a| match ((ends[a].1 - ends[a].0) / f64::from(extent[a]), extent[a]) {
            (0.0, 1) => 1.0,
            (spacing, _) => spacing,
        });
        let spacing: Vec<f64> = spacing.collect();
        if spacing.iter().all(|step| step.is_finite() && *step > 0.0) {
            for a in 0..3 {
                info.geometry.spacing[a] = spacing[a];
                // The extents are the outer faces of the first and last voxel.
                info.geometry.origin[a] = ends[a].0 + spacing[a] / 2.0;
            }
            info.calibrated = true;
            match said(IMAGE, "Unit").as_deref().unwrap_or("um") {
                "um" | "µm" | "μm" => info.geometry.unit = Some("micrometer".into()),
                "nm" => info.geometry.unit = Some("nanometer".into()),
                "mm" => info.geometry.unit = Some("millimeter".into()),
                "m" => info.geometry.unit = Some("meter".into()),
                other => info.notes.push(
                    Note::warning(format!("The unit {other} is not known: it is left out.")).settled_by(Setting::Unit),
                ),
            }
        } else {
            info.notes.push(
                Note::warning("ExtMin and ExtMax give no voxel size: the volume is not calibrated.")
                    .settled_by(Setting::Spacing),
            );
        }
    }
    let looks: Vec<ChannelLook> = (0..info.channels)
        .map(|channel| {
            let group = format!("/DataSetInfo/Channel {channel}");
            let numbers = |name: &str| -> Option<Vec<f64>> {
                said(&group, name)?
                    .split_whitespace()
                    .map(|word| word.parse().ok().filter(|n: &f64| n.is_finite()))
                    .collect()
            };
            let color = numbers("Color").and_then(|parts| <[f64; 3]>::try_from(parts).ok());
            let window = numbers("ColorRange").and_then(|ends| <[f64; 2]>::try_from(ends).ok());
            ChannelLook {
                name: said(&group, "Name"),
                color: color.map(|parts| parts.map(|part| (part.clamp(0.0, 1.0) * 255.0).round() as u8)),
                window: window.filter(|[low, high]| low < high && stored.members.is_empty()),
                unit: None,
            }
        })
        .collect();
    if looks.iter().any(|look| *look != ChannelLook::default()) {
        info.channel_looks = looks;
    }
    let told = |time: u32| said("/DataSetInfo/TimeInfo", &format!("TimePoint{time}"));
    let stamps: Option<Vec<f64>> = (1..=info.times).map(|time| seconds(&told(time)?)).collect();
    if stamps.is_none() && info.times > 1 && (1..=info.times).any(|time| told(time).is_some()) {
        info.notes
            .push(Note::warning("The file's times are left out: not every step has one.").settled_by(Setting::Times));
    }
    if let Some(stamps) = stamps.filter(|stamps| stamps.len() > 1) {
        let start = stamps[0];
        let stamps = stamps.into_iter().map(|stamp| stamp - start).collect();
        match TimeAxis::of_stamps(stamps, Some("second".into())) {
            Ok(axis) => info.time = Some(axis),
            Err(problem) => info
                .notes
                .push(Note::warning(format!("The file's times are left out: {problem}.")).settled_by(Setting::Times)),
        }
    }
}

/// Seconds of a time such as `2018-05-30 14:13:43.250`, from any fixed day.
fn seconds(text: &str) -> Option<f64> {
    let (date, clock) = text.trim().split_once([' ', 'T'])?;
    let date: Option<Vec<i64>> = date.split('-').map(|part| part.parse().ok()).collect();
    let clock: Option<Vec<f64>> = clock.split(':').map(|part| part.parse().ok()).collect();
    let ([year, month, day], [hours, minutes, seconds]) = (date?.try_into().ok()?, clock?.try_into().ok()?);
    if !(0..=9999).contains(&year) || !(1..=12).contains(&month) || !(1..=31).contains(&day) {
        return None;
    }
    // Days of the civil calendar, from March on, so that the 29th of February is the year's last.
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let days =
        365 * year + year.div_euclid(4) - year.div_euclid(100) + year.div_euclid(400) + (153 * month + 2) / 5 + day;
    Some(days as f64 * 86400.0 + hours * 3600.0 + minutes * 60.0 + seconds).filter(|seconds| seconds.is_finite())
}

#[cfg(test)]
mod tests {
    use super::seconds;

    #[test]
    fn times_are_counted_over_months_and_the_29th_of_february() {
        let between = |a, b| seconds(b).unwrap() - seconds(a).unwrap();
        assert_eq!(between("2018-05-30 14:13:43.250", "2018-05-30 14:13:45.750"), 2.5);
        assert_eq!(between("2020-02-28 23:59:59.000", "2020-03-01 00:00:00.000"), 86401.0);
        assert_eq!(between("2019-12-31 00:00:00", "2020-01-01 00:00:00"), 86400.0);
        for bad in ["", "2018-05-30", "2018-13-01 00:00:00", "a-b-c 1:2:3", "2018-05-30 1:2"] {
            assert_eq!(seconds(bad), None, "{bad}");
        }
    }
}
