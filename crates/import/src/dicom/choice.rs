//! Choice of one series among the files of a folder or list, and of one stack in it: by name, or where only localizers lie beside it.

use super::header::Header;
use super::stack::kinds;
use crate::error::{ImportError, Result};
use crate::files::name_of;
use crate::note::Note;
use brickyard_volume::counted;
use dicom_dictionary_std::tags;
use std::path::Path;

/// Longest list of series or stacks in a message.
const MOST_LISTED: usize = 40;

/// Files of one series.
pub(super) struct Chosen {
    pub(super) headers: Vec<Header>,
    /// Name of a part of it: a stack, or a segment.
    pub(super) part: Option<String>,
    pub(super) notes: Vec<Note>,
}

/// Chooses the files of one series: the only one, the one named by `variable` (as `SERIES`, or `SERIES/PART`), or in a folder the only one besides
/// localizers.
///
/// # Errors
/// If several remain, or none has that name.
pub(super) fn choose(headers: Vec<Header>, is_folder: bool, variable: Option<&str>) -> Result<Chosen> {
    let series = kinds(&headers, |a, b| a.series() == b.series());
    let firsts: Vec<usize> = series.iter().map(|(first, _)| *first).collect();
    let (named, part) = match variable {
        None => (firsts.clone(), None),
        Some(name) => named(&headers, &firsts, name),
    };
    let of_images = |first: &usize| {
        let series = headers[*first].series();
        !headers.iter().filter(|header| header.series() == series).all(Header::is_localizer)
    };
    let of_images: Vec<usize> = named.iter().copied().filter(of_images).collect();
    let first = match (&named[..], &of_images[..]) {
        ([one], _) => *one,
        (_, [one]) if is_folder => *one,
        _ => return Err(ambiguous(&headers, &series, named.len(), is_folder, variable)),
    };
    let series_uid = headers[first].series();
    let described: Vec<String> = if variable.is_none() {
        let others = series.iter().filter(|(other, _)| *other != first);
        others.map(|(other, count)| describe_series(&headers[*other], *count)).collect()
    } else {
        Vec::new()
    };
    let mut notes: Vec<Note> =
        described.iter().map(|other| Note::warning(format!("Localizers are left out: series {other}."))).collect();
    let chosen: Vec<Header> = headers.into_iter().filter(|header| header.series() == series_uid).collect();
    let has_others = is_folder && chosen.iter().any(|header| !header.is_localizer());
    let (left_out, headers): (Vec<Header>, Vec<Header>) =
        chosen.into_iter().partition(|header| has_others && header.is_localizer());
    if let Some(first) = left_out.first() {
        let files = counted(left_out.len() as u64, "localizer");
        let note = format!("{files} among the slices, such as {}, left out.", name_of(&first.path));
        notes.push(Note::warning(note));
    }
    Ok(Chosen { headers, part, notes })
}

/// Series of this name, and the part of them that it names.
fn named(headers: &[Header], firsts: &[usize], name: &str) -> (Vec<usize>, Option<String>) {
    let of = |name: &str| -> Vec<usize> { firsts.iter().copied().filter(|i| is_named(&headers[*i], name)).collect() };
    let whole = of(name);
    if !whole.is_empty() {
        return (whole, None);
    }
    if let Some((series, part)) = name.rsplit_once('/').filter(|(series, _)| !of(series).is_empty()) {
        return (of(series), Some(part.to_owned()));
    }
    match firsts {
        [one] => (vec![*one], Some(name.to_owned())),
        _ => (Vec::new(), None),
    }
}

/// Whether a series has this number, UID or description.
fn is_named(header: &Header, name: &str) -> bool {
    let texts = [tags::SERIES_NUMBER, tags::SERIES_INSTANCE_UID, tags::SERIES_DESCRIPTION];
    texts.into_iter().filter_map(|tag| header.text(tag)).any(|text| text.trim() == name.trim() && !text.is_empty())
}

fn ambiguous(
    headers: &[Header],
    series: &[(usize, usize)],
    named: usize,
    is_folder: bool,
    variable: Option<&str>,
) -> ImportError {
    let mut list: Vec<String> =
        series.iter().take(MOST_LISTED).map(|&(first, count)| describe_series(&headers[first], count)).collect();
    if series.len() > MOST_LISTED {
        list.push(format!("and {} more", series.len() - MOST_LISTED));
    }
    let path = headers.first().map_or(Path::new("input"), |first| &first.path);
    let place = path.parent().filter(|_| is_folder).unwrap_or(path);
    let found = match variable {
        None => "series are mixed".to_owned(),
        Some(name) => format!("series, and {named} are named '{name}'"),
    };
    let problem = format!(
        "{} {found}: {}. Choose one by `variable` (its number, UID or description), or name the files of one; a single \
         file stands for the slices of its series",
        series.len(),
        list.join("; ")
    );
    ImportError::options(place, problem)
}

fn describe_series(header: &Header, count: usize) -> String {
    let number = header.text(tags::SERIES_NUMBER).filter(|number| !number.is_empty());
    let number = number.map_or(String::new(), |number| format!("{number}: "));
    let what = header.text(tags::SERIES_DESCRIPTION).map_or(String::new(), |d| format!(" \"{d}\""));
    let modality = header.text(tags::MODALITY).map_or(String::new(), |modality| format!(" ({modality})"));
    let files = counted(count as u64, "file");
    format!("{number}{}{what}{modality} of {files}, such as {}", header.series(), name_of(&header.path))
}
