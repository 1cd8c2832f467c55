//! Edits of a finished store's metadata: place, units, times, name, and names and colours of channels.
//!
//! All of these are in the root document, in `attributes.ome` and again in `attributes.brickyard`. The store's
//! description, with the new values, passes the checks of packing; then both documents, of the former description and
//! of the new one, are generated, and their differences go into the document found. So other programs' keys, and their
//! edits of other looks, stay. Factors between levels stay, too, whatever the spacing.
//!
//! The document is replaced in one step, under the store's lock. An edit reads and writes nothing else, so it costs the
//! same at any size. Except for an image made labels, whose coarser levels are means: these are made again
//! (`edit/levels.rs`).
//!
//! A store edited to labels in an image's folder of labels is listed there, as by packing.

mod description;
mod error;
mod levels;
#[cfg(test)]
mod tests;

pub use error::EditError;

use crate::append::{AppendOptions, stale_groups};
use crate::folder::Folder;
use crate::held::{Held, find_finished};
use crate::kind::Kind;
use crate::metadata::root_document;
use crate::ngff::Root;
use crate::pack::disk::{Disk, DiskError, temporary};
use crate::pack::image_labels::{ImageLabels, TO_IMAGE};
use crate::pack::{PackError, Progress, lock, ours};
use crate::remake::Work;
use crate::shard_file::IoMode;
use crate::store::{Store, open_folder};
use crate::verify::documents::root_change;
use brickyard_import::{ChannelChoice, SourceInfo};
use brickyard_volume::Orientation;
use description::Description;
use glam::DVec3;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// New values of a store's metadata; `None` leaves the store's.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Edit {
    /// Voxel spacing of level 0 along x, y, z.
    pub spacing: Option<DVec3>,
    /// Position of the first voxel's centre.
    pub origin: Option<DVec3>,
    /// Unit of spacing and origin, or those of x, y and z with commas between, as for packing. No number is converted,
    /// unless these are lengths in several units.
    pub unit: Option<String>,
    /// Map from voxel indices to the patient's right, front and head; it has spacing and origin, too.
    pub orientation: Option<Orientation>,
    /// Unit of the values of all channels.
    pub value_unit: Option<String>,
    /// Time from one step to the next, for evenly spaced steps.
    pub time_step: Option<f64>,
    /// Unit of time.
    pub time_unit: Option<String>,
    /// File with the time of each step.
    pub time_stamps: Option<PathBuf>,
    /// Name of the volume.
    pub name: Option<String>,
    /// Meaning of the values. Means of labels are no labels, so levels made so are made again, by the mode.
    pub kind: Option<Kind>,
    /// New looks of channels.
    pub channels: Vec<ChannelEdit>,
}

/// New look of one channel, or of all.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ChannelEdit {
    /// The channel; `None` is every one.
    pub channel: Option<ChannelChoice>,
    /// The channel's name.
    pub name: Option<String>,
    /// The channel's colour: red, green and blue.
    pub color: Option<[u8; 3]>,
}

/// One changed value.
#[derive(Clone, Debug, PartialEq)]
pub struct EditChange {
    /// The value's name.
    pub field: String,
    /// The former value; null if it was unknown.
    pub old: Value,
    /// The new value.
    pub new: Value,
}

impl std::fmt::Display for EditChange {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let in_words = |value: &Value| match value {
            Value::Null => "none".into(),
            Value::String(text) => text.clone(),
            Value::Array(list) if list.len() > 3 && !list[0].is_array() => format!("{} times", list.len()),
            Value::Array(list) if !list.iter().any(Value::is_array) => {
                list.iter().map(Value::to_string).collect::<Vec<_>>().join(",")
            }
            value => value.to_string(),
        };
        write!(f, "{}: {} -> {}", self.field, in_words(&self.old), in_words(&self.new))
    }
}

/// Outcome of an edit.
#[derive(Clone, Debug, PartialEq)]
pub struct EditReport {
    /// The changed values, at least one.
    pub changes: Vec<EditChange>,
    /// Root documents of surrounding groups, in which another program gathered the former values.
    pub stale_groups: Vec<PathBuf>,
}

/// Edits a store's metadata, durably. An image made labels, whose coarser levels are means, is given new ones within
/// 2 GiB of memory, by all processors.
///
/// # Errors
/// If the store is missing, unfinished, in use by another writer or not writable, an edit does not fit it, nothing
/// would change, or the disk fails. Except for [`EditError::Unsynced`], [`EditError::Unlisted`] and
/// [`RemakeError::Unsynced`](crate::RemakeError::Unsynced), the store is then unchanged.
pub fn edit(store: &Path, edit: &Edit) -> Result<EditReport, EditError> {
    edit_on(&Disk::default(), store, edit, usual_work())
}

/// Like [`edit`], with levels made within `memory_bytes`, on `threads` threads. `progress` observes and may cancel that.
///
/// # Errors
/// As for [`edit`], or if the memory is too little, or `progress` cancels.
pub fn edit_within(
    store: &Path,
    edit: &Edit,
    memory_bytes: u64,
    threads: usize,
    progress: &dyn Progress,
) -> Result<EditReport, EditError> {
    edit_on(&Disk::default(), store, edit, Work { memory_bytes, threads, progress })
}

fn usual_work() -> Work<'static> {
    let AppendOptions { memory_bytes, threads } = AppendOptions::default();
    Work { memory_bytes, threads, progress: &() }
}

/// Makes all checks of [`edit_within`], and changes nothing.
///
/// # Errors
/// If [`edit_within`] would fail before its first change.
pub fn rehearse_edit(store: &Path, edit: &Edit, memory_bytes: u64, threads: usize) -> Result<EditReport, EditError> {
    let dir = find_finished(&Disk::default(), store)?;
    if let Some(holder) = lock::holder_of(&dir) {
        return Err(PackError::Busy { store: dir, holder: Some(holder) }.into());
    }
    if makes_levels(&Store::open_own(&dir)?, edit) {
        return levels::rehearse(&dir, edit, Work { memory_bytes, threads, progress: &() });
    }
    let edited = Edited::of(&Arc::new(open_folder(&dir)?), edit)?;
    Ok(edited.report(&dir))
}

/// Whether an edit is to labels of a store whose coarser levels mix them.
fn makes_levels(store: &Store, edit: &Edit) -> bool {
    edit.kind == Some(Kind::Labels) && levels::are_mixed(store)
}

fn edit_on(disk: &Disk, store: &Path, edit: &Edit, work: Work) -> Result<EditReport, EditError> {
    let dir = find_finished(disk, store)?;
    // A lock would make the folder of a store that is missing.
    if makes_levels(&Store::open_own(&dir)?, edit) {
        return levels::remake(disk, &dir, edit, work);
    }
    let held = Held::take(disk, &dir)?;
    let path = dir.join("zarr.json");
    let unchanged = |DiskError { path, error }: DiskError| EditError::Unchanged { path, error, store: dir.clone() };
    // An earlier edit, reported as not durable, may have made these changes.
    disk.sync_dir(&dir).map_err(unchanged)?;
    let edited = Edited::of(&held.folder, edit)?;
    if held.folder.is_replaced() {
        return Err(held.folder.replaced().into());
    }
    disk.write(&path, &edited.text).map_err(|error| {
        // Left-overs are harmless: the next change of the document replaces them.
        let _ = ours::remove_file(disk, &temporary(&path));
        unchanged(error)
    })?;
    disk.sync_dir(&dir).map_err(|DiskError { error, .. }| EditError::Unsynced { store: dir.clone(), error })?;
    if let Some(labels) = &edited.labels {
        let unlisted = |error| EditError::Unlisted { store: dir.clone(), error: Box::new(error) };
        labels.list(disk).map_err(unlisted)?;
    }
    Ok(edited.report(&dir))
}

/// A root document with its edits.
struct Edited {
    root: Root,
    /// The file content of the document.
    text: Vec<u8>,
    /// The place among an image's labels, to be listed there.
    labels: Option<ImageLabels>,
    /// The store's volume.
    info: SourceInfo,
    changes: Vec<EditChange>,
}

impl Edited {
    /// Applies edits to the root document in a store's folder.
    fn of(folder: &Arc<Folder>, edit: &Edit) -> Result<Self, EditError> {
        let path = folder.path().join("zarr.json");
        let text = folder.document(&path)?;
        let mut root = Root::parse(&path, &text)?;
        let open = |text: &[u8]| Store::open_with_root(folder, IoMode::default(), None, text);
        let store = open(&text)?;
        if let Some(change) = root_change(&store, root.clone()) {
            return Err(EditError::Altered { path, change });
        }
        let former = Description::of(&store);
        let new = former.edited(edit, &store)?;
        let mut changes = former.changes_to(&new);
        let labels = ImageLabels::around(folder.path()).map_err(PackError::from)?;
        let labels = labels.filter(|_| edit.kind.is_some());
        if let (Some(kind), Some(labels)) = (edit.kind, &labels) {
            labels.check(kind)?;
            if !labels.is_listed()? {
                let field = format!("listed in {}/labels", labels.image().display());
                changes.push(EditChange { field, old: json!(false), new: json!(true) });
            }
            if !has_image(&root.document) {
                let field = "image-label source".into();
                changes.push(EditChange { field, old: Value::Null, new: json!(TO_IMAGE) });
            }
        }
        if changes.is_empty() {
            return Err(EditError::Nothing { store: folder.path().into() });
        }
        let info = new.store_info(&former, store.info());
        let old_document = root_document(store.layout(), store.geometry(), store.info());
        let new_document = root_document(store.layout(), &new.info.geometry, &info);
        take_changes(&old_document, &new_document, &mut root.document);
        set_looks(&former, &new, &new_document, &mut root.document);
        if labels.is_some() && !has_image(&root.document) {
            root.document["attributes"]["ome"]["image-label"]["source"] = json!({ "image": TO_IMAGE });
        }
        let text = root.bytes(&path)?;
        let root = Root::parse(&path, &text)?;
        match root_change(&open(&text)?, root.clone()) {
            Some(change) => Err(EditError::Altered { path, change }),
            None => Ok(Self { root, text, labels, info: new.info, changes }),
        }
    }

    fn report(self, store: &Path) -> EditReport {
        EditReport { changes: self.changes, stale_groups: stale_groups(store) }
    }
}

/// Whether the metadata of labels name their image.
fn has_image(root: &Value) -> bool {
    root.pointer("/attributes/ome/image-label/source/image").is_some()
}

/// Makes the changes from `old` to `new` in `found`, whatever it holds there. All else stays.
fn take_changes(old: &Value, new: &Value, found: &mut Value) {
    match (old, new, &mut *found) {
        _ if old == new => {}
        (Value::Object(old), Value::Object(new), Value::Object(found)) => {
            found.retain(|key, _| new.contains_key(key) || !old.contains_key(key));
            for (key, new) in new {
                match (old.get(key), found.get_mut(key)) {
                    (Some(old), _) if old == new => {}
                    (Some(old), Some(found)) => take_changes(old, new, found),
                    // Another program has made it first.
                    (None, Some(found)) if new.is_object() && found.is_object() => {
                        take_changes(&json!({}), new, found);
                    }
                    _ => drop(found.insert(key.clone(), new.clone())),
                }
            }
        }
        (Value::Array(old), Value::Array(new), Value::Array(found))
            if old.len() == new.len() && new.len() == found.len() =>
        {
            for ((old, new), found) in old.iter().zip(new).zip(found) {
                take_changes(old, new, found);
            }
        }
        _ => *found = new.clone(),
    }
}

/// Sets the edited names and colours of channels, which another program may have edited before.
fn set_looks(former: &Description, new: &Description, document: &Value, root: &mut Value) {
    let Some(omero) = document.pointer("/attributes/ome/omero") else { return };
    let Some(ome) = root.pointer_mut("/attributes/ome").and_then(Value::as_object_mut) else { return };
    let count = |omero: &Value| omero["channels"].as_array().map_or(0, Vec::len);
    for (i, (former, new)) in former.looks().iter().zip(new.looks()).enumerate() {
        for (field, is_edited) in [("label", former.name != new.name), ("color", former.color != new.color)] {
            let Some(value) = omero["channels"][i].get(field).filter(|_| is_edited) else { continue };
            let found = ome.entry("omero").or_insert_with(|| json!(null));
            if count(found) != count(omero) {
                *found = omero.clone();
            }
            found["channels"][i][field] = value.clone();
        }
    }
}
