//! Comparison of every `zarr.json` with one generated from the store's settings. Packed content must be unchanged;
//! additions by others are ignored. Others may edit names, colours and windows of channels: such edits are reported
//! separately.
//!
//! Settings, statistics and placement themselves come from the root document. To detect a changed byte there too, it
//! holds a checksum of its written form.

use crate::append::{FOREIGN_STEPS, foreign_steps};
use crate::error::OpenError;
use crate::json::read_json;
use crate::metadata::{root_document, voxel_documents};
use crate::ngff::Root;
use crate::shard_file::IoMode;
use crate::side::side_documents;
use crate::store::Store;
use crate::verify::{VerifyProblem, VerifyReport};
use brickyard_import::is_of_process;
use brickyard_volume::{Level, channel};
use serde_json::Value;
use std::ops::RangeInclusive;
use std::path::PathBuf;

/// Checks the main pyramid's root document, and the documents of these levels, each with its pyramid's store. Returns
/// their problems and edits.
///
/// # Errors
/// If the process may not read one of them.
pub(crate) fn check<'a>(
    main: &Store,
    levels: impl Iterator<Item = (&'a Store, Level)>,
) -> Result<VerifyReport, OpenError> {
    let mut documents = Vec::new();
    for (store, level) in levels {
        let (path, layout, info) = (store.path(), store.layout(), store.info());
        documents.extend(voxel_documents(path, layout, level, info));
        // In stores on disk without appended steps, opening has compared them.
        if info.times.is_some() || store.is_remote() {
            documents.extend(side_documents(path, layout, level, info));
        }
    }
    main.folder().look_ahead(&documents.iter().map(|(path, _)| path.clone()).collect::<Vec<_>>());
    let found = documents.iter().map(|(path, _)| unless_barred(read_json(main.folder(), path)));
    let found = found.collect::<Result<Vec<_>, _>>()?;
    // Read after the arrays, which so have at most one more step, of an interrupted or running commit.
    let (expected, root) = root_now(main);
    let mut root = unless_barred(root)?;
    let times = main.info().times.map(|times| times..=count_of(&root).unwrap_or(times).saturating_add(1));
    let path = main.path().join("zarr.json");
    let edits = root.as_mut().map_or_else(|_| Vec::new(), |root| take_edits(&expected, &mut root.document));
    let edits = edits.into_iter().map(|what| VerifyProblem { brick: None, path: path.clone(), what }).collect();
    let of_patient = root.as_ref().ok().and_then(|root| root.patient_change(&path));
    let of_patient = of_patient.map(|what| VerifyProblem { brick: None, path: path.clone(), what });
    let of_root = check_one(path.clone(), &expected, root.map(|root| root.document)).or(of_patient);
    let checked = documents.into_iter().zip(found).map(|((path, expected), found)| {
        let found = found.map(|found| with_committed_times(&expected, found, times.as_ref()));
        check_one(path, &expected, found)
    });
    let problems = of_root.into_iter().chain(checked.flatten()).chain(foreign(main)).collect();
    Ok(VerifyReport { problems, edits, ..VerifyReport::default() })
}

/// Fails if the process may not read the document.
fn unless_barred<T>(read: Result<T, OpenError>) -> Result<Result<T, OpenError>, OpenError> {
    match read {
        Err(OpenError::Io { path, error }) if is_of_process(&error) => Err(OpenError::Io { path, error }),
        read => Ok(read),
    }
}

/// Restores the packed names, colours and windows over usable edits; deleted ones count as packed. Returns the edits.
fn take_edits(expected: &Value, root: &mut Value) -> Vec<String> {
    const OMERO: &str = "/attributes/ome/omero";
    let channels = expected.pointer(OMERO).and_then(|omero| omero["channels"].as_array());
    let (Some(packed), Some(channels)) = (expected.pointer(OMERO), channels) else { return Vec::new() };
    let found = root.pointer(OMERO).cloned().unwrap_or_default();
    let mut edits = Vec::new();
    for (i, channel) in channels.iter().enumerate() {
        let theirs = &found["channels"][i];
        let end = |name: &str| theirs["window"][name].as_f64();
        let is_window = end("start").zip(end("end")).is_none_or(|(start, end)| start <= end);
        for field in ["/label", "/color", "/active", "/window/min", "/window/max", "/window/start", "/window/end"] {
            let (packed, theirs) = (channel.pointer(field), theirs.pointer(field).unwrap_or(&Value::Null));
            let Some(packed) = packed.filter(|packed| difference(packed, theirs, &mut String::new()).is_some()) else {
                continue;
            };
            let is_usable = match field {
                _ if theirs.is_null() => true,
                "/label" => theirs.is_string(),
                "/color" => theirs.as_str().and_then(channel::from_hex).is_some(),
                "/active" => theirs.is_boolean(),
                _ => theirs.is_number() && is_window,
            };
            if !is_usable {
                return Vec::new();
            }
            let name = field.replace('/', ".");
            let now = if theirs.is_null() { "gone".into() } else { short(theirs) };
            edits.push(format!("attributes.ome.omero.channels[{i}]{name}: {now}, packed as {packed}"));
        }
    }
    if let Some(ome) = root.pointer_mut("/attributes/ome").and_then(Value::as_object_mut) {
        ome.insert("omero".into(), packed.clone());
    }
    edits
}

/// The first change of the root document found, with the store it describes, since it was written; edits of channels' looks are none. `None` if there
/// is no change.
pub(crate) fn root_change(store: &Store, mut root: Root) -> Option<String> {
    let expected = root_document(store.layout(), store.geometry(), store.info());
    take_edits(&expected, &mut root.document);
    let of_patient = || root.patient_change(&store.path().join("zarr.json"));
    difference(&expected, &root.document, &mut String::new()).or_else(of_patient)
}

/// The first difference of an array's document from the expected one, in a store of so many steps, if counted: one more is permitted then.
pub(crate) fn array_change(expected: &Value, found: Value, times: Option<u32>) -> Option<String> {
    let times = times.map(|times| times..=times.saturating_add(1));
    difference(expected, &with_committed_times(expected, found, times.as_ref()), &mut String::new())
}

/// Steps appended by another program, unless the store grows meanwhile.
fn foreign(main: &Store) -> Option<VerifyProblem> {
    let problem = match foreign_steps(main) {
        Ok(found) => {
            let (path, found) = found?;
            let what = format!("shape[0]: expected {}, found {found}: {FOREIGN_STEPS}", main.times());
            VerifyProblem { brick: None, path, what }
        }
        Err(error) => VerifyProblem::of_file(main.path().into(), &error),
    };
    let has_grown = main.newer().is_ok_and(|newer| newer.is_some());
    (!has_grown).then_some(problem)
}

/// The expected and the actual root document. Since steps may have been appended, the expected one is generated from
/// the present text, if that is a store.
fn root_now(main: &Store) -> (Value, Result<Root, OpenError>) {
    let path = main.path().join("zarr.json");
    let document = |store: &Store| root_document(store.layout(), store.geometry(), store.info());
    let text = match main.folder().document(&path) {
        Ok(text) => text,
        Err(error) => return (document(main), Err(error)),
    };
    let has_grown = |now: &Store| main.info().times.is_none_or(|times| now.times() > times);
    let open = || Store::open_with_root(main.folder(), IoMode::default(), None, &text).ok().filter(has_grown);
    let now = if main.was_opened_with(&text) { None } else { open() };
    (document(now.as_ref().unwrap_or(main)), Root::parse(&path, &text))
}

/// The root document's number of time steps; `None` if absent or unreadable.
fn count_of(root: &Result<Root, OpenError>) -> Option<u32> {
    root.as_ref().ok()?.document["attributes"]["brickyard"]["times"].as_u64()?.try_into().ok()
}

/// An array's document with any permitted number of time steps replaced by the expected one.
fn with_committed_times(expected: &Value, mut found: Value, times: Option<&RangeInclusive<u32>>) -> Value {
    let may_be = |steps: u64| times.is_some_and(|times| u32::try_from(steps).is_ok_and(|steps| times.contains(&steps)));
    if let Some(steps) = found.pointer_mut("/shape/0")
        && steps.as_u64().is_some_and(may_be)
    {
        *steps = expected["shape"][0].clone();
    }
    found
}

fn check_one(path: PathBuf, expected: &Value, found: Result<Value, OpenError>) -> Option<VerifyProblem> {
    match found {
        Ok(found) => {
            let what = difference(expected, &found, &mut String::new())?;
            Some(VerifyProblem { brick: None, path, what })
        }
        Err(error) => Some(VerifyProblem::of_file(path, &error)),
    }
}

/// The first difference from the expected document. Unexpected keys belong to others.
fn difference(expected: &Value, found: &Value, at: &mut String) -> Option<String> {
    let length = at.len();
    let mut inner = |expected: &Value, found: Option<&Value>, step: &str| {
        at.push_str(step);
        let differs = match found {
            Some(found) => difference(expected, found, at),
            None => Some(format!("{at}: missing")),
        };
        at.truncate(length);
        differs
    };
    let is_same = match (expected, found) {
        (Value::Object(expected), Value::Object(found)) => {
            let dot = if length == 0 { "" } else { "." };
            return expected.iter().find_map(|(key, value)| inner(value, found.get(key), &format!("{dot}{key}")));
        }
        (Value::Array(expected), Value::Array(found)) if expected.len() == found.len() => {
            let pairs = expected.iter().zip(found).enumerate();
            return pairs.into_iter().find_map(|(i, (value, found))| inner(value, Some(found), &format!("[{i}]")));
        }
        // 1 and 1.0 are one number, and others may write either.
        (Value::Number(a), Value::Number(b)) => a == b || (a.is_f64() || b.is_f64()) && a.as_f64() == b.as_f64(),
        _ => expected == found,
    };
    (!is_same).then(|| format!("{at}: expected {}, found {}", short(expected), short(found)))
}

fn short(value: &Value) -> String {
    const MOST: usize = 200;
    let text = value.to_string();
    if text.chars().count() <= MOST { text } else { text.chars().take(MOST).chain(['…']).collect() }
}

#[cfg(test)]
mod tests {
    use crate::downsample::Downsample;
    use crate::metadata::document_bytes;
    use crate::store::Store;
    use crate::test_store::{TestStore, bumps};
    use crate::verify::verify;
    use brickyard_volume::TimeAxis;
    use serde_json::{Value, json};
    use std::path::{Path, PathBuf};

    fn documents(dir: &Path) -> Vec<PathBuf> {
        let mut found = Vec::new();
        for entry in std::fs::read_dir(dir).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                found.extend(documents(&path));
            } else if path.file_name().is_some_and(|name| name == "zarr.json") {
                found.push(path);
            }
        }
        found
    }

    /// Whether a flip has no effect for readers: numbers and keys are unchanged, except an array's empty attributes.
    fn is_neutral(sound: &[u8], flipped: &[u8]) -> bool {
        let parsed = |bytes: &[u8]| {
            let mut value = serde_json::from_slice::<Value>(bytes).ok()?;
            let object = value.as_object_mut()?;
            if object.get("attributes").is_none_or(|attributes| attributes == &json!({})) {
                object.remove("attributes");
                object.retain(|key, value| key.len() != "attributes".len() || value != &json!({}));
            }
            Some(value)
        };
        parsed(flipped).is_some_and(|flipped| Some(flipped) == parsed(sound))
    }

    fn check_flips(dir: &Path) {
        let mut found = 0;
        for path in documents(dir) {
            let sound = std::fs::read(&path).unwrap();
            // Only some of a histogram's lines, which are all alike.
            let counts =
                sound.windows(9).position(|word| word == b"\"counts\":").map_or(0..0, |at| at + 200..at + 5000);
            for i in (0..sound.len()).filter(|i| !counts.contains(i) || i % 17 == 0) {
                let mut bad = sound.clone();
                bad[i] ^= 1 << (i * 5 % 8);
                std::fs::write(&path, &bad).unwrap();
                let is_found =
                    verify(dir, |_, _| {}).is_ok_and(|report| report.problems.is_empty() && report.edits.is_empty());
                let around = String::from_utf8_lossy(&bad[i.saturating_sub(30)..(i + 30).min(bad.len())]).into_owned();
                assert!(!is_found || is_neutral(&sound, &bad), "{}: byte {i}: {around}", path.display());
                found += !is_found as u32;
            }
            std::fs::write(&path, &sound).unwrap();
        }
        assert!(found > 3000, "{found}");
    }

    #[test]
    fn every_flipped_byte_of_a_document_is_found() {
        let dir = tempfile::tempdir().unwrap();
        TestStore { extent: [12, 8, 8], shard: 8, ..TestStore::default() }.write(dir.path(), bumps);
        check_flips(dir.path());
    }

    /// Includes stores of one level, where no number appears twice.
    #[test]
    fn every_edit_of_what_was_written_is_found() {
        let time = TimeAxis::of_stamps(vec![0.25, 2.0, 2.5], Some("second".into())).unwrap();
        let series = TestStore { times: 3, time: Some(time), shard_times: 2, ..TestStore::default() };
        for (extent, spec) in
            [([8, 8, 8], TestStore::default()), ([20, 20, 20], TestStore::default()), ([20, 8, 8], series)]
        {
            let dir = tempfile::tempdir().unwrap();
            TestStore { extent, channels: 2, ..spec }.write(dir.path(), bumps);
            for path in documents(dir.path()) {
                let sound = std::fs::read(&path).unwrap();
                let document: Value = serde_json::from_slice(&sound).unwrap();
                let mut pointers = Vec::new();
                leaves(&document, String::new(), &mut pointers);
                for pointer in pointers {
                    if pointer.contains("/counts/") && !pointer.ends_with('7') {
                        continue;
                    }
                    let mut bad = document.clone();
                    let leaf = bad.pointer_mut(&pointer).unwrap();
                    *leaf = match &*leaf {
                        Value::Number(number) => json!(number.as_f64().unwrap() * 1.000001 + 1e-9),
                        Value::String(text) => json!(format!("{text}x")),
                        Value::Bool(flag) => json!(!flag),
                        _ => json!([1]),
                    };
                    std::fs::write(&path, document_bytes(&bad)).unwrap();
                    let report = verify(dir.path(), |_, _| {});
                    let is_found =
                        report.map_or(true, |report| !(report.problems.is_empty() && report.edits.is_empty()));
                    assert!(is_found || pointer == "/attributes", "{}: {pointer}", path.display());
                }
                std::fs::write(&path, &sound).unwrap();
            }
            assert_eq!(verify(dir.path(), |_, _| {}).unwrap().problems, []);
        }
    }

    fn leaves(value: &Value, at: String, found: &mut Vec<String>) {
        match value {
            Value::Object(object) if !object.is_empty() => {
                object.iter().for_each(|(key, value)| leaves(value, format!("{at}/{key}"), found));
            }
            Value::Array(array) if !array.is_empty() => {
                array.iter().enumerate().for_each(|(i, value)| leaves(value, format!("{at}/{i}"), found));
            }
            _ => found.push(at),
        }
    }

    #[test]
    fn edits_of_looks_are_told_apart_and_what_cannot_be_used_is_a_problem() {
        let dir = tempfile::tempdir().unwrap();
        TestStore { channels: 2, ..TestStore::default() }.write(dir.path(), bumps);
        let path = dir.path().join("zarr.json");
        let sound: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        let found = |edit: &dyn Fn(&mut Value)| {
            let mut root = sound.clone();
            edit(&mut root["attributes"]["ome"]["omero"]);
            std::fs::write(&path, document_bytes(&root)).unwrap();
            let report = verify(dir.path(), |_, _| {}).unwrap();
            let words =
                |list: &[crate::verify::VerifyProblem]| list.iter().map(|it| it.what.clone()).collect::<Vec<_>>();
            (words(&report.problems), words(&report.edits))
        };
        let channels = |omero: &Value| omero["channels"].as_array().unwrap().clone();
        let start = &sound["attributes"]["ome"]["omero"]["channels"][0]["window"]["start"];
        assert_eq!(found(&|_| ()), (vec![], vec![]));
        let (problems, edits) = found(&|omero| {
            omero["channels"][0]["color"] = json!("00ff7F");
            omero["channels"][0]["label"] = json!("actin");
            omero["channels"][1]["active"] = json!(false);
        });
        assert_eq!((problems, edits.len()), (vec![], 3), "{edits:?}");
        assert_eq!(edits[0], "attributes.ome.omero.channels[0].label: \"actin\", packed as \"channel 0\"");
        let (problems, edits) = found(&|omero| omero["channels"] = json!(channels(omero)[..1]));
        assert!(problems.is_empty() && edits.iter().all(|edit| edit.contains("channels[1]") && edit.contains("gone")));
        for (field, value) in [("/color", json!("red")), ("/active", json!(1)), ("/window/start", json!("low"))] {
            let (problems, edits) = found(&|omero| *omero["channels"][0].pointer_mut(field).unwrap() = value.clone());
            assert!(problems.len() == 1 && problems[0].contains("omero") && edits.is_empty(), "{field}: {problems:?}");
        }
        let (problems, _) =
            found(&|omero| omero["channels"][0]["window"]["end"] = json!(start.as_f64().unwrap() - 1.0));
        assert_eq!(problems.len(), 1);
    }

    #[test]
    fn what_others_add_is_theirs() {
        let dir = tempfile::tempdir().unwrap();
        TestStore::default().write(dir.path(), bumps);
        for path in documents(dir.path()) {
            let mut document: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
            document["consolidated_metadata"] = json!(null);
            document["attributes"]["theirs"] = json!({ "a": 1 });
            if path.parent() == Some(dir.path()) {
                document["attributes"]["ome"]["name"] = json!("head");
                document["attributes"]["ome"]["omero"]["rdefs"] = json!({ "model": "color" });
            }
            std::fs::write(&path, document_bytes(&document)).unwrap();
        }
        assert_eq!(verify(dir.path(), |_, _| {}).unwrap().problems, []);
        assert_eq!(Store::open(dir.path()).unwrap().downsample(), Downsample::Mean);
    }
}
