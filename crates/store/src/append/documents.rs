//! Documents of a store after an append: only the step's changes are made, and other programs' content stays.

use crate::counts::Counts;
use crate::error::OpenError;
use crate::folder::Folder;
use crate::json::read_json;
use crate::pack::disk::temporary;
use crate::pack::output::parent;
use crate::side::array_documents;
use crate::store::Store;
use brickyard_volume::Level;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Folders of all arrays, in the order of gaining a step: coarse levels first, side data before its level.
pub(super) fn array_dirs(store: &Store) -> Vec<PathBuf> {
    let (main, info) = (store.layout(), store.info());
    let second = info.downsample.second().map(|method| main.of_second(method));
    let mut dirs = Vec::new();
    for level in main.levels().rev() {
        for layout in second.iter().filter(|_| level > Level(0)).chain([main]) {
            let documents = array_documents(store.path(), layout, level, info);
            dirs.extend(documents.iter().rev().map(|(path, _)| parent(path).to_path_buf()));
        }
    }
    dirs
}

/// A description of steps unknown to a store, with the remedy.
pub(crate) const FOREIGN_STEPS: &str = "another program has appended steps; pack the store anew, or remove these steps";

/// The finest level's document and number of steps, if another program has appended there. A commit first writes its
/// counts and all new documents under temporary names, and lengthens the finest level last: a longer one without these
/// is not from an interrupted commit.
pub(crate) fn foreign_steps(store: &Store) -> Result<Option<(PathBuf, u64)>, OpenError> {
    if store.layout().axes()[0] != "t" {
        return Ok(None);
    }
    let next = u64::from(store.times()) + 1;
    let steps = |path: &Path| -> Result<u64, OpenError> {
        Ok(read_json(store.folder(), path)?["shape"][0].as_u64().unwrap_or_default())
    };
    let is_there = |path: &Path| store.folder().file(path).is_ok();
    let mut documents: Vec<PathBuf> = array_dirs(store).iter().map(|dir| dir.join("zarr.json")).collect();
    let Some(finest) = documents.pop() else { return Ok(None) };
    let found = steps(&finest)?;
    if found < next {
        return Ok(None);
    }
    // The power may have failed before all names were durable.
    let is_renamed = |path: &PathBuf| Ok(is_there(&temporary(path)) || steps(path)? == next);
    let counts = Counts::of(store).dir(store.times().saturating_add(1));
    let is_cut_off = found == next && is_there(&counts) && !is_there(&temporary(&finest));
    let others: Vec<bool> = documents.iter().map(is_renamed).collect::<Result<_, OpenError>>()?;
    Ok((!is_cut_off || others.contains(&false)).then_some((finest, found)))
}

/// Sets the number of steps in array documents that another program gathered in the root document
/// (`consolidated_metadata`), which readers prefer.
pub(super) fn update_consolidated(store: &Path, dirs: &[PathBuf], times: u32, root: &mut Value) {
    let Some(documents) = root.pointer_mut("/consolidated_metadata/metadata") else { return };
    for dir in dirs {
        let name = dir.strip_prefix(store).unwrap_or(dir).to_string_lossy();
        if let Some(steps) = documents.get_mut(&*name).and_then(|document| document.pointer_mut("/shape/0")) {
            *steps = json!(times);
        }
    }
}

/// Root documents of surrounding groups in which another program gathered the store's documents: their readers see the
/// former steps.
pub(crate) fn stale_groups(store: &Path) -> Vec<PathBuf> {
    let Ok(store) = store.canonicalize() else { return Vec::new() };
    let groups = store.ancestors().skip(1).map(|group| (group, group.join("zarr.json")));
    let has_gathered = |(group, document): &(&Path, PathBuf)| {
        let name = store.strip_prefix(group).unwrap_or(&store).to_string_lossy();
        let root = Folder::open(group).ok().and_then(|folder| read_json(&folder, document).ok());
        root.is_some_and(|root| !root["consolidated_metadata"]["metadata"][&*name].is_null())
    };
    groups.take_while(|(_, document)| document.is_file()).filter(has_gathered).map(|(_, document)| document).collect()
}

/// Applies the changes from `old` to `new` to the root document found: everywhere in the store's own part, elsewhere
/// only to unedited values. Keys absent from both stay.
pub(crate) fn update_root(old: &Value, new: &Value, found: &mut Value) {
    update(old, new, found, false);
    let [old, new] = [old, new].map(|document| &document["attributes"]["brickyard"]);
    update(old, new, &mut found["attributes"]["brickyard"], true);
}

/// Applies changes to the store's own part (`is_ours`), or to one that other programs may edit.
fn update(old: &Value, new: &Value, found: &mut Value, is_ours: bool) {
    match (new, &mut *found) {
        (Value::Object(new), Value::Object(found)) => {
            if let Some(old) = old.as_object() {
                let is_theirs = |old: &Value, value: &Value| !is_ours && !is_same(old, value);
                found
                    .retain(|key, value| new.contains_key(key) || old.get(key).is_none_or(|old| is_theirs(old, value)));
            }
            for (key, new) in new {
                match found.get_mut(key) {
                    Some(found) => update(&old[key], new, found, is_ours),
                    None if is_ours || old.get(key).is_none() => {
                        found.insert(key.clone(), new.clone());
                    }
                    // Somebody deleted it.
                    None => {}
                }
            }
        }
        (Value::Array(new), Value::Array(found)) if new.len() == found.len() => {
            for (i, (new, found)) in new.iter().zip(found).enumerate() {
                update(&old[i], new, found, is_ours);
            }
        }
        (_, found) => {
            if is_ours || is_same(old, found) {
                *found = new.clone();
            }
        }
    }
}

/// Whether two values are the same; 1 and 1.0 are one number, and others may write either.
fn is_same(a: &Value, b: &Value) -> bool {
    match (a, b) {
        (Value::Number(x), Value::Number(y)) => x == y || x.as_f64() == y.as_f64(),
        (Value::Array(x), Value::Array(y)) => x.len() == y.len() && x.iter().zip(y).all(|(x, y)| is_same(x, y)),
        _ => a == b,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_others_wrote_stays_and_what_a_step_changes_is_changed() {
        let document = |end: f64, ours: Value| {
            let window = json!({ "min": 0.0, "max": end, "start": 0.0, "end": end });
            let omero = json!({ "channels": [{ "window": window, "color": "FFFFFF" }] });
            json!({ "attributes": { "ome": { "omero": omero }, "brickyard": ours } })
        };
        let old = document(3.0, json!({ "times": 1, "gone": 7, "channels": [{ "range": [0, 3] }] }));
        let new = document(4.0, json!({ "times": 2, "stamps": [1, 2], "channels": [{ "range": [0, 4] }] }));
        let mut found = old.clone();
        found["consolidated_metadata"] = json!(null);
        let ome = &mut found["attributes"]["ome"];
        ome["name"] = json!("flow");
        ome["omero"]["channels"][0]["window"]["end"] = json!(2.5);
        ome["omero"]["channels"][0]["label"] = json!("density");
        found["attributes"]["brickyard"]["theirs"] = json!([1]);
        found["attributes"]["brickyard"]["channels"][0]["note"] = json!("x");
        // A number in another tool's notation is still the written one.
        found["attributes"]["ome"]["omero"]["channels"][0]["window"]["max"] = json!(3);
        update_root(&old, &new, &mut found);
        let mut expected = new.clone();
        expected["consolidated_metadata"] = json!(null);
        let ome = &mut expected["attributes"]["ome"];
        ome["name"] = json!("flow");
        ome["omero"]["channels"][0]["window"]["end"] = json!(2.5);
        ome["omero"]["channels"][0]["label"] = json!("density");
        expected["attributes"]["brickyard"]["theirs"] = json!([1]);
        expected["attributes"]["brickyard"]["channels"][0]["note"] = json!("x");
        assert_eq!(found, expected);
    }

    #[test]
    fn what_others_took_away_stays_away() {
        let document =
            |n: u32| json!({ "attributes": { "ome": { "a": n, "b": [n, n] }, "brickyard": { "times": n } } });
        let mut found = document(1);
        found["attributes"]["ome"].as_object_mut().unwrap().remove("a");
        found["attributes"]["ome"]["b"] = json!([1]);
        found["attributes"]["brickyard"] = json!({});
        update_root(&document(1), &document(2), &mut found);
        assert_eq!(found, json!({ "attributes": { "ome": { "b": [1] }, "brickyard": { "times": 2 } } }));
    }
}
