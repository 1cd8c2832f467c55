//! Attributes in JSON as CF's conventions ask for them. Costs a copy of the value.

use crate::cf::Attributes;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Map, Value};

impl Attributes for Map<String, Value> {
    fn has(&self, name: &str) -> bool {
        self.contains_key(name)
    }

    fn text(&self, name: &str) -> Option<String> {
        let text = self.get(name)?.as_str()?.trim();
        // xarray writes fill values of floats as the bytes of one.
        let number = (name == "_FillValue").then(|| float_of(text)).flatten();
        let text = number.map_or_else(|| text.to_owned(), |number| number.to_string());
        (!text.is_empty()).then_some(text)
    }

    fn numbers(&self, name: &str) -> Option<Vec<f64>> {
        match self.get(name)? {
            Value::Array(items) => items.iter().map(Value::as_f64).collect::<Option<Vec<f64>>>(),
            one => one.as_f64().map(|number| vec![number]),
        }
        .filter(|numbers| !numbers.is_empty())
    }
}

/// The float of 64 bits, little-endian, in base 64.
fn float_of(text: &str) -> Option<f64> {
    let bytes = STANDARD.decode(text).ok()?;
    Some(f64::from_le_bytes(bytes.try_into().ok()?))
}
