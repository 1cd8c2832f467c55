//! Fields of a JSON document by their paths, as in `layers.0.window`: the differences of two documents, and setting a field. So every edit of a panel
//! has a name for scripts. Costs a walk through both documents.

use brickyard::volume::near_name;
use serde_json::Value;

/// The fields of `after` unlike those of `before`. A list is one field unless it is a list of objects of unchanged length.
pub(crate) fn differences(before: &Value, after: &Value) -> Vec<(String, Value)> {
    let mut found = Vec::new();
    compare("", before, after, &mut found);
    found
}

fn compare(path: &str, before: &Value, after: &Value, found: &mut Vec<(String, Value)>) {
    let inner = |name: &str| if path.is_empty() { name.to_string() } else { format!("{path}.{name}") };
    match (before, after) {
        _ if before == after => {}
        (Value::Object(old), Value::Object(new)) if old.keys().eq(new.keys()) || path.is_empty() => {
            for (name, value) in new {
                compare(&inner(name), old.get(name).unwrap_or(&Value::Null), value, found);
            }
            for name in old.keys().filter(|name| !new.contains_key(*name)) {
                found.push((inner(name), Value::Null));
            }
        }
        (Value::Array(old), Value::Array(new)) if old.len() == new.len() && new.iter().all(Value::is_object) => {
            for (i, (old, new)) in old.iter().zip(new).enumerate() {
                compare(&inner(&i.to_string()), old, new, found);
            }
        }
        _ => found.push((path.to_string(), after.clone())),
    }
}

/// Sets a field of a document, adding it to its parent object if necessary; the document's reader refuses unknown fields.
///
/// # Errors
/// If there is no such parent. The message lists the names there are.
pub(crate) fn set(document: &mut Value, path: &str, value: Value) -> Result<(), String> {
    let mut place = document;
    let names: Vec<&str> = path.split('.').collect();
    for (depth, name) in names.iter().enumerate() {
        let is_last = depth + 1 == names.len();
        let above = || if depth == 0 { "the scene".to_string() } else { names[..depth].join(".") };
        place = match place {
            Value::Object(fields) if is_last => {
                fields.insert(name.to_string(), value);
                return Ok(());
            }
            Value::Object(fields) => {
                let known: Vec<&str> = fields.keys().map(String::as_str).collect();
                if !known.contains(name) {
                    let near = near_name::hint(name, known.iter().copied());
                    return Err(format!("{} has no '{name}'{near}: expected one of {}", above(), known.join(", ")));
                }
                &mut fields[*name]
            }
            Value::Array(items) => {
                let count = items.len();
                let item = name.parse().ok().and_then(|index: usize| items.get_mut(index));
                item.ok_or_else(|| format!("{} has no '{name}': it has {count} entries, from 0", above()))?
            }
            _ => return Err(format!("{} has no '{name}': it is not an object", above())),
        };
    }
    *place = value;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use serde_json::json;

    #[test]
    fn fields_that_differ_are_named() {
        let before =
            json!({"mode": "dvr", "layers": [{"window": [0, 1], "gamma": 1.0}, {"window": null, "gamma": 1.0}]});
        let mut after = before.clone();
        after["layers"][1]["window"] = json!([2, 3]);
        after["mode"] = json!("mip");
        let found = differences(&before, &after);
        assert_eq!(found, [("layers.1.window".into(), json!([2, 3])), ("mode".into(), json!("mip"))]);
        after["layers"] = json!([]);
        assert!(differences(&before, &after).contains(&("layers".into(), json!([]))), "another number of layers");
    }

    #[test]
    fn what_cannot_be_set_is_said() {
        let mut document = json!({"lighting": {"model": "none"}, "layers": [{}], "step": 1.0});
        let mut error = |path: &str| set(&mut document, path, json!(1)).unwrap_err();
        assert!(error("lightning.model").contains("did you mean 'lighting'?"));
        assert!(error("layers.3.gamma").contains("1 entries"));
        assert!(error("step.size").contains("not an object"));
        assert_eq!(set(&mut document, "lighting.model", json!("phong")), Ok(()));
        assert_eq!(document["lighting"]["model"], "phong");
    }

    proptest! {
        #[test]
        fn setting_what_differs_gives_the_other_document(
            a in prop::collection::vec((any::<i8>(), prop::option::of(0..9)), 0..4),
            b in prop::collection::vec((any::<i8>(), prop::option::of(0..9)), 0..4),
        ) {
            let document = |values: &[(i8, Option<i32>)]| json!({
                "first": values.first().map(|v| v.0),
                "items": values.iter().map(|(number, other)| json!({"number": number, "other": {"it": other}})).collect::<Vec<_>>(),
            });
            let (mut before, after) = (document(&a), document(&b));
            for (path, value) in differences(&before.clone(), &after) {
                set(&mut before, &path, value).unwrap();
            }
            prop_assert_eq!(before, after);
        }

        #[test]
        fn no_path_is_a_panic(path in "[a-c.0-9]{0,9}") {
            let _ = set(&mut json!({"a": [{"b": 1}], "c": {"a": 2}}), &path, Value::Null);
        }
    }
}
