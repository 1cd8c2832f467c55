//! The time axis of a store, in its root document. OME-Zarr's metadata, editable by other tools, are authoritative for
//! a regular axis: `scale` and `translation` of axis t, the same at all levels, and its unit. Times per step, which
//! OME-Zarr cannot express, are in `attributes.brickyard.time.stamps`.

use crate::error::OpenError;
use crate::layout::Layout;
use brickyard_volume::TimeAxis;
use serde_json::Value;
use std::path::Path;

/// Other tools may round to about seven digits.
const TOLERANCE: f64 = 1e-5;

/// Step and start in OME-Zarr's metadata if unknown.
const UNKNOWN: (f64, f64) = (1.0, 0.0);

/// Step and start for OME-Zarr's metadata.
pub(crate) fn step_and_start(time: Option<&TimeAxis>) -> (f64, f64) {
    time.map_or(UNKNOWN, |axis| (axis.step, axis.start))
}

/// The unit of axis t for OME-Zarr's metadata.
pub(crate) fn unit(time: Option<&TimeAxis>) -> Option<&str> {
    time?.unit.as_deref()
}

/// Reads the time axis from the pyramid's multiscale and the settings, and checks it; `None` if time is not described.
pub(crate) fn parse_time(
    path: &Path,
    root: &Value,
    layout: &Layout,
    said: Option<&TimeAxis>,
) -> Result<Option<TimeAxis>, OpenError> {
    if let Some(Err(problem)) = said.map(|axis| axis.check(layout.times)) {
        let field = format!("attributes.brickyard.time.{}", problem.field);
        return Err(OpenError::invalid(path, field, problem.expected, problem.found));
    }
    if layout.axes()[0] != "t" {
        return Ok(said.cloned());
    }
    let owner = if layout.second().is_some() { "brickyard" } else { "ome" };
    let multiscale = &root["attributes"][owner]["multiscales"][0];
    let mut first: Option<(f64, f64)> = None;
    for (k, dataset) in multiscale["datasets"].as_array().into_iter().flatten().enumerate() {
        let transforms = &dataset["coordinateTransformations"];
        let field = |kind: &str| {
            format!("attributes.{owner}.multiscales[0].datasets[{k}].coordinateTransformations: {kind} of t")
        };
        let number = |kind: &str, expected: &str, fits: fn(f64) -> bool| {
            let found = of_t(transforms, kind);
            let sound = found.and_then(Value::as_f64).filter(|number| number.is_finite() && fits(*number));
            sound.ok_or_else(|| OpenError::invalid(path, field(kind), expected, found.unwrap_or(&Value::Null)))
        };
        let step = number("scale", "a positive number", |step| step > 0.0)?;
        let start = number("translation", "a number", |_| true)?;
        let (first_step, first_start) = *first.get_or_insert((step, start));
        let is_near = |a: f64, b: f64| (a - b).abs() <= TOLERANCE * first_step.max(a.abs()).max(b.abs());
        for (kind, found, of_first) in [("scale", step, first_step), ("translation", start, first_start)] {
            if !is_near(found, of_first) {
                return Err(OpenError::invalid(path, field(kind), format!("{of_first}, as of level 0"), found));
            }
        }
    }
    let (step, start) = first.unwrap_or(UNKNOWN);
    let unit = multiscale["axes"][0]["unit"].as_str().map(str::to_owned);
    // Times in another tool's unit count from a moment of its own.
    let since = said.filter(|axis| axis.unit == unit).and_then(|axis| axis.since.clone());
    if let Some(irregular) = said.cloned().filter(|axis| !axis.stamps.is_empty()) {
        return Ok(Some(TimeAxis { unit, since, ..irregular }));
    }
    if said.is_none() && unit.is_none() && (step, start) == UNKNOWN {
        return Ok(None);
    }
    let axis = TimeAxis { start, step, stamps: Vec::new(), unit, since };
    axis.check(layout.times).map_err(|problem| {
        let field = format!("attributes.{owner}.multiscales[0]: scale and translation of t");
        OpenError::invalid(path, field, problem.expected, problem.found)
    })?;
    Ok(Some(axis))
}

/// The number of axis t, the first one, in the first transformation of this kind.
fn of_t<'a>(transforms: &'a Value, kind: &str) -> Option<&'a Value> {
    let transform = transforms.as_array()?.iter().find(|transform| transform["type"] == kind)?;
    transform[kind].as_array()?.first()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::Store;
    use crate::test_store::{TestStore, bumps};
    use crate::verify::verify;
    use serde_json::json;

    fn seconds(start: f64, step: f64) -> TimeAxis {
        TimeAxis { start, step, unit: Some("second".into()), ..TimeAxis::default() }
    }

    fn written(time: Option<TimeAxis>) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        TestStore { extent: [20, 8, 8], times: 3, time, ..TestStore::default() }.write(dir.path(), bumps);
        dir
    }

    /// Edits the root document and returns its former text.
    fn edited(dir: &Path, edit: impl FnOnce(&mut Value)) -> Vec<u8> {
        let path = dir.join("zarr.json");
        let sound = std::fs::read(&path).unwrap();
        let mut document: Value = serde_json::from_slice(&sound).unwrap();
        edit(&mut document);
        std::fs::write(&path, document.to_string()).unwrap();
        sound
    }

    #[test]
    fn a_store_keeps_its_time_axis() {
        let irregular = TimeAxis::of_stamps(vec![-1.0, 0.5, 9.25], Some("day".into())).unwrap();
        assert!(!irregular.stamps.is_empty());
        let since = |axis: TimeAxis| Some(TimeAxis { since: Some("1900-01-01".into()), ..axis });
        for time in
            [None, Some(seconds(0.25, 0.1)), Some(TimeAxis::default()), since(seconds(6.0, 3.0)), since(irregular)]
        {
            let dir = written(time.clone());
            let store = Store::open(dir.path()).unwrap();
            assert_eq!(store.time_axis(), time.as_ref());
            assert_eq!(verify(dir.path(), |_, _| {}).unwrap().problems, []);
            let document: Value =
                serde_json::from_slice(&std::fs::read(dir.path().join("zarr.json")).unwrap()).unwrap();
            let multiscale = &document["attributes"]["ome"]["multiscales"][0];
            let axis = time.unwrap_or_default();
            assert_eq!(multiscale["axes"][0]["unit"], json!(axis.unit));
            for dataset in multiscale["datasets"].as_array().unwrap() {
                let transforms = &dataset["coordinateTransformations"];
                assert_eq!(transforms[0]["scale"][0], json!(axis.step));
                assert_eq!(transforms[1]["translation"][0], json!(axis.start));
            }
        }
    }

    #[test]
    fn what_other_tools_write_of_time_counts() {
        fn set(document: &mut Value, step: f64, unit: &str) {
            let multiscale = &mut document["attributes"]["ome"]["multiscales"][0];
            multiscale["axes"][0]["unit"] = json!(unit);
            for dataset in multiscale["datasets"].as_array_mut().unwrap() {
                dataset["coordinateTransformations"][0]["scale"][0] = json!(step);
            }
        }
        for time in [None, Some(TimeAxis { since: Some("1900-01-01".into()), ..seconds(0.0, 2.0) })] {
            let dir = written(time);
            edited(dir.path(), |document| set(document, 7.5, "minute"));
            let found = Store::open(dir.path()).unwrap().time_axis().cloned().unwrap();
            assert_eq!((found.step, found.unit.as_deref(), found.since), (7.5, Some("minute"), None));
            let problems = verify(dir.path(), |_, _| {}).unwrap().problems;
            assert!(problems.len() == 1, "{problems:?}");
        }
        let stamps = vec![0.0, 1.0, 5.0];
        let dir = written(Some(TimeAxis::of_stamps(stamps.clone(), None).unwrap()));
        edited(dir.path(), |document| set(document, 7.5, "minute"));
        let found = Store::open(dir.path()).unwrap().time_axis().cloned().unwrap();
        assert_eq!((found.stamps, found.unit.as_deref()), (stamps, Some("minute")));
    }

    #[test]
    fn times_that_cannot_be_are_named() {
        let dir = written(Some(TimeAxis::of_stamps(vec![0.0, 1.0, 5.0], None).unwrap()));
        let transforms = |k: usize| format!("/attributes/ome/multiscales/0/datasets/{k}/coordinateTransformations");
        let cases = [
            ("/attributes/brickyard/time/stamps".into(), json!([0.0, 1.0]), ["time.stamps", "found 2"]),
            (
                "/attributes/brickyard/time/stamps".into(),
                json!([0.0, 1.0, 1.0]),
                ["time.stamps", "1 of step 2 after 1"],
            ),
            ("/attributes/brickyard/time/stamps/1".into(), json!("x"), ["attributes.brickyard", "\"x\""]),
            ("/attributes/brickyard/time/step".into(), json!(0), ["time.step", "found 0"]),
            (
                transforms(0) + "/0/scale/0",
                json!(-0.5),
                ["datasets[0].coordinateTransformations: scale of t", "found -0.5"],
            ),
            (transforms(1) + "/0/scale/0", json!("1"), ["datasets[1].coordinateTransformations", "positive"]),
            (transforms(1) + "/0/scale/0", json!(4.5), ["datasets[1]", "as of level 0, found 4.5"]),
            (transforms(1) + "/1/translation/0", json!(4.5), ["translation of t", "as of level 0, found 4.5"]),
        ];
        for (pointer, value, words) in cases {
            let sound = edited(dir.path(), |document| *document.pointer_mut(&pointer).unwrap() = value.clone());
            let message = Store::open(dir.path()).err().unwrap().to_string();
            assert!(words.iter().all(|word| message.contains(word)), "{pointer}: {message}");
            std::fs::write(dir.path().join("zarr.json"), sound).unwrap();
        }
        Store::open(dir.path()).unwrap();
    }
}
