//! A part of an object to be read, and the checks of its answer.

use crate::fault::Fault;
use crate::objects::{Object, Version};
use chrono::{DateTime, TimeDelta, Utc};
use object_store::{GetOptions, GetRange, GetResult, ObjectMeta};

/// Beginning of a tag that is a time, in seconds of Unix.
const MODIFIED: &str = "modified ";

/// A part of an object to be read.
#[derive(Clone)]
pub(super) struct Wanted<'a> {
    /// All without one.
    pub(super) range: Option<GetRange>,
    /// State in which the object must be.
    pub(super) version: Option<&'a Version>,
    /// The part kept here: in its state the object is not wanted.
    pub(super) unless: Option<&'a Object>,
    pub(super) most_bytes: u64,
}

/// A state is settled so long after the last change: servers tell whole seconds, by clocks of their own.
const SETTLED_AFTER: TimeDelta = TimeDelta::seconds(5);

/// An object's state, by its tag or else the time of its last change.
pub(super) fn version_of(meta: &ObjectMeta) -> Version {
    let modified = Some(meta.last_modified).filter(|time| time.timestamp() > 0);
    let is_old = modified.is_some_and(|time| Utc::now() - time >= SETTLED_AFTER);
    let is_settled = is_old || meta.e_tag.as_ref().is_some_and(|tag| !tag.starts_with("W/"));
    let tag = meta.e_tag.clone().or_else(|| modified.map(|time| format!("{MODIFIED}{}", time.timestamp())));
    Version { bytes: meta.size, tag, is_settled }
}

impl Wanted<'_> {
    /// All of an object of at most so many bytes; its state alone if there are to be none.
    pub(super) fn whole(most_bytes: u64) -> Self {
        Self { range: None, version: None, unless: None, most_bytes }
    }

    /// Names the part, if it is kept on disk.
    pub(super) fn place(&self) -> Option<String> {
        match &self.range {
            None if self.is_head() => None,
            None => Some("whole".into()),
            Some(GetRange::Bounded(range)) => Some(format!("{}-{}", range.start, range.end)),
            Some(GetRange::Suffix(bytes)) => Some(format!("last-{bytes}")),
            Some(GetRange::Offset(first)) => Some(format!("from-{first}")),
        }
    }

    /// Whether the object's state alone is asked for.
    pub(super) fn is_head(&self) -> bool {
        self.range.is_none() && self.most_bytes == 0
    }

    pub(super) fn options(&self) -> GetOptions {
        let tag = |version: Option<&Version>| version.and_then(|version| version.tag.clone());
        let time = |tag: &Option<String>| {
            let seconds = tag.as_ref()?.strip_prefix(MODIFIED)?.parse().ok()?;
            DateTime::from_timestamp(seconds, 0)
        };
        let (wanted, unless) = (tag(self.version), tag(self.unless.map(|kept| &kept.version)));
        let of_server = |tag: &String| !tag.starts_with(MODIFIED);
        GetOptions {
            if_unmodified_since: time(&wanted),
            if_modified_since: time(&unless),
            // Weak tags match nothing.
            if_match: wanted.filter(of_server).filter(|tag| !tag.starts_with("W/")),
            if_none_match: unless.filter(of_server),
            range: self.range.clone(),
            head: self.is_head(),
            ..GetOptions::default()
        }
    }

    /// Checks an answer before its bytes are read.
    pub(super) fn check(&self, answer: &GetResult, found: &Version) -> Result<(), Fault> {
        let bytes = answer.range.end.saturating_sub(answer.range.start);
        let is_all = self.version.is_none() && answer.range == (0..found.bytes);
        if let Some(GetRange::Bounded(range)) = &self.range
            && *range != answer.range
            && !(is_all && range.start == 0)
        {
            let problem = format!("bytes {:?} instead of {range:?}", answer.range);
            return Err(if found.bytes < range.end { Fault::Changed } else { Fault::Lying { problem } });
        }
        if self.version.is_some_and(|known| known.bytes != found.bytes || known.tag != found.tag) {
            return Err(Fault::Changed);
        }
        if bytes > self.most_bytes {
            return Err(Fault::Large { most_bytes: self.most_bytes });
        }
        Ok(())
    }
}
