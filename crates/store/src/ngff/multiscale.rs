//! One multiscale of OME-Zarr in 0.5's form and in 0.6's.
//!
//! | | 0.5 | 0.6 |
//! | --- | --- | --- |
//! | axes | `axes` | `axes` of a named coordinate system |
//! | a level's place | a scale, and perhaps a translation | one transformation into this system: scale, or a sequence of both |
//! | other systems | none | `coordinateSystems`, `coordinateTransformations` |
//!
//! All keys in common stay as they are. For the rest of 0.6, other programs' systems and names, 0.5 has no place: it
//! waits in the key [`KEPT`] of the multiscale, which returns into its places.

use super::patient::{PATIENT, Patient};
use serde_json::{Map, Value, json};

/// Name of the system of spacing and origin.
pub(super) const PHYSICAL: &str = "physical";

/// The key of a multiscale of 0.5 for content of 0.6.
const KEPT: &str = "ngff_0_6";

/// The keys of 0.6 for other systems.
const SYSTEMS: &str = "coordinateSystems";
const TRANSFORMS: &str = "coordinateTransformations";

/// Something that is not known here, or not to the other version.
#[derive(Debug)]
pub(super) struct Strange {
    /// The field below the multiscale.
    pub(super) field: String,
    pub(super) expected: String,
    pub(super) found: Value,
}

fn strange(field: impl Into<String>, expected: impl Into<String>, found: &Value) -> Strange {
    Strange { field: field.into(), expected: expected.into(), found: found.clone() }
}

type Object = Map<String, Value>;

/// A multiscale of 0.6, from that of 0.5.
///
/// # Errors
/// If a level has other transformations than a scale and perhaps a translation, or the multiscale has keys to which 0.6
/// gives another meaning.
pub(super) fn to_0_6(of: &Value, patient: Option<&Patient>) -> Result<Value, Strange> {
    let mut new = of.as_object().cloned().unwrap_or_default();
    for key in [SYSTEMS, TRANSFORMS] {
        if let Some(found) = new.get(key) {
            return Err(strange(key, "none, as 0.6 gives it another meaning; remove it", found));
        }
    }
    let mut kept = new.remove(KEPT).unwrap_or_default();
    let mut taken = |key: &str| kept.as_object_mut().and_then(|kept| kept.remove(key)).unwrap_or_default();
    let name = taken("name").as_str().unwrap_or(PHYSICAL).to_owned();
    let axes = new.remove("axes").unwrap_or_default();
    let count = axes.as_array().map_or(0, Vec::len);
    let rests = taken("datasets");
    for (k, dataset) in datasets_of(&mut new).enumerate() {
        let list = dataset[TRANSFORMS].as_array().map_or(&[][..], |list| list);
        let is_whole = matches!(kinds(list)[..], ["scale"] | ["scale", "translation"]);
        if !is_whole || list.iter().any(|transform| vector(transform, count).is_none()) {
            let expected = format!("a scale, and perhaps a translation, of {count} numbers");
            return Err(strange(of_dataset(k), expected, &dataset[TRANSFORMS]));
        }
        let mut one = rests[k].as_object().cloned().unwrap_or_default();
        match list {
            [scale] => one.extend(scale.as_object().cloned().unwrap_or_default()),
            list => one.extend([("type".into(), json!("sequence")), ("transformations".into(), json!(list))]),
        }
        one.insert("input".into(), json!({ "path": dataset["path"] }));
        one.insert("output".into(), json!({ "name": name }));
        dataset[TRANSFORMS] = json!([one]);
    }
    let mut system = taken("system").as_object().cloned().unwrap_or_default();
    system.extend([("name".into(), json!(name)), ("axes".into(), axes.clone())]);
    let of_patient = patient.map(|patient| patient.system_and_transformation(&axes, &name)).into_iter();
    let (systems, transforms): (Vec<Value>, Vec<Value>) = of_patient.unzip();
    let others = [taken(SYSTEMS), taken(TRANSFORMS)].map(|list| list.as_array().cloned().unwrap_or_default());
    let [other_systems, other_transforms] = others;
    let own: Vec<Value> = std::iter::once(Value::Object(system)).chain(systems).collect();
    if let Some(clash) = other_systems.iter().find(|other| own.iter().any(|own| own["name"] == other["name"])) {
        return Err(strange(SYSTEMS, format!("no other system named {}; rename it", clash["name"]), clash));
    }
    new.insert(SYSTEMS.into(), own.into_iter().chain(other_systems).collect());
    let transforms: Vec<Value> = transforms.into_iter().chain(other_transforms).collect();
    if !transforms.is_empty() {
        new.insert(TRANSFORMS.into(), json!(transforms));
    }
    Ok(Value::Object(new))
}

/// A multiscale of 0.5, from that of 0.6: a store's `has_translations`, and perhaps a patient's system, made by [`to_0_6`].
///
/// # Errors
/// If a level has another transformation than scale, translation, identity and a sequence of them, or the levels are
/// not in one system.
pub(super) fn to_0_5(of: &Value, has_translations: bool, has_patient: bool) -> Result<Value, Strange> {
    let mut new = of.as_object().cloned().unwrap_or_default();
    let mut list = |key: &str| match new.remove(key) {
        Some(Value::Array(list)) => Ok(list),
        None if key == TRANSFORMS => Ok(Vec::new()),
        other => Err(strange(key, "a list", &other.unwrap_or_default())),
    };
    let (mut systems, mut transforms) = (list(SYSTEMS)?, list(TRANSFORMS)?);
    let name = of["datasets"][0][TRANSFORMS][0]["output"]["name"].clone();
    let place = systems.iter().position(|system| system["name"] == name && name.is_string());
    let Some(Value::Object(mut system)) = place.map(|place| systems.remove(place)) else {
        let expected = format!("the system {name} of the levels");
        return Err(strange(SYSTEMS, expected, &of[SYSTEMS]));
    };
    let axes = match system.remove("axes") {
        Some(axes @ Value::Array(_)) => axes,
        other => return Err(strange(format!("{SYSTEMS}: axes of {name}"), "a list", &other.unwrap_or_default())),
    };
    system.remove("name");
    let count = axes.as_array().map_or(0, Vec::len);
    new.insert("axes".into(), axes);
    let mut rests = Vec::new();
    for (k, dataset) in datasets_of(&mut new).enumerate() {
        let found = dataset[TRANSFORMS].clone();
        let field = || of_dataset(k);
        let Some([Value::Object(one)]) = found.as_array().map(Vec::as_slice) else {
            return Err(strange(field(), "one transformation", &found));
        };
        let mut one = one.clone();
        let (input, output) = (one.remove("input").unwrap_or_default(), one.remove("output").unwrap_or_default());
        if input["path"] != dataset["path"] {
            return Err(strange(format!("{}[0].input.path", field()), dataset["path"].to_string(), &input));
        }
        if output["name"] != name {
            return Err(strange(format!("{}[0].output.name", field()), format!("{name}, as of level 0"), &output));
        }
        let Some(list) = steps(&mut one, count, has_translations) else {
            let expected = format!("a scale, a translation or a sequence of them, of {count} numbers");
            return Err(strange(format!("{}[0]", field()), expected, &found[0]));
        };
        dataset[TRANSFORMS] = json!(list);
        rests.push(Value::Object(one));
    }
    if has_patient {
        systems.retain(|system| system["name"] != PATIENT);
        let is_ours = |transform: &Value| transform["input"]["name"] == name && transform["output"]["name"] == PATIENT;
        transforms.retain(|transform| !is_ours(transform));
    }
    let mut kept = Object::new();
    let mut keep = |key: &str, value: Value, is_any: bool| drop(is_any.then(|| kept.insert(key.into(), value)));
    keep("name", name.clone(), name != PHYSICAL);
    keep("system", json!(system), !system.is_empty());
    keep("datasets", json!(rests), rests.iter().any(|rest| *rest != json!({})));
    keep(SYSTEMS, json!(systems), !systems.is_empty());
    keep(TRANSFORMS, json!(transforms), !transforms.is_empty());
    if !kept.is_empty() {
        new.insert(KEPT.into(), Value::Object(kept));
    }
    Ok(Value::Object(new))
}

fn datasets_of(multiscale: &mut Object) -> impl Iterator<Item = &mut Value> {
    let datasets = multiscale.get_mut("datasets").and_then(Value::as_array_mut);
    // Others are no levels, and refused where levels are read.
    datasets.into_iter().flatten().filter(|dataset| dataset.is_object())
}

fn of_dataset(k: usize) -> String {
    format!("datasets[{k}].{TRANSFORMS}")
}

fn kinds(list: &[Value]) -> Vec<&str> {
    list.iter().map(|transform| transform["type"].as_str().unwrap_or_default()).collect()
}

/// A level's scale, and translation if it has one or must have one, taken out of its transformation; `None` for another
/// transformation.
fn steps(one: &mut Object, count: usize, has_translation: bool) -> Option<Vec<Value>> {
    let kind = one.remove("type")?;
    let kind = kind.as_str()?;
    let list = match kind {
        "sequence" => one.remove("transformations")?.as_array()?.clone(),
        "identity" => vec![json!({ "type": kind })],
        _ => vec![json!({ "type": kind, kind: one.remove(kind)? })],
    };
    let vectors = list.iter().map(|step| vector(step, count)).collect::<Option<Vec<_>>>()?;
    match kinds(&list)[..] {
        ["scale", "translation"] => return Some(list),
        ["scale"] if !has_translation => return Some(list),
        _ => {}
    }
    let (mut scale, mut translation) = (vec![1.0; count], vec![0.0; count]);
    for (kind, vector) in kinds(&list).into_iter().zip(vectors) {
        for (axis, number) in vector.into_iter().enumerate() {
            if kind == "scale" {
                scale[axis] *= number;
                translation[axis] *= number;
            } else {
                translation[axis] += number;
            }
        }
    }
    let [scale, translation] =
        [("scale", scale), ("translation", translation)].map(|(kind, vector)| json!({ "type": kind, kind: vector }));
    Some(vec![scale, translation])
}

/// The numbers of a scale or translation, none for an identity; `None` for anything else.
fn vector(transform: &Value, count: usize) -> Option<Vec<f64>> {
    let kind = transform["type"].as_str()?;
    if kind == "identity" {
        return Some(Vec::new());
    }
    if !["scale", "translation"].contains(&kind) {
        return None;
    }
    let numbers = transform[kind].as_array()?.iter().map(Value::as_f64).collect::<Option<Vec<f64>>>()?;
    (numbers.len() == count).then_some(numbers)
}
