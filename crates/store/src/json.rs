//! Metadata documents as JSON values.

use crate::error::OpenError;
use crate::folder::Folder;
use serde_json::Value;
use std::path::Path;

/// Reads a metadata document of at most 64 MiB.
pub(crate) fn read_json(folder: &Folder, path: &Path) -> Result<Value, OpenError> {
    parse_json(path, &folder.document(path)?)
}

/// Most values in a metadata document: parsed, each takes up to a hundred times the bytes of its text.
const MOST_VALUES: usize = 1 << 21;

/// Parses a metadata document read from `path`.
pub(crate) fn parse_json(path: &Path, text: &[u8]) -> Result<Value, OpenError> {
    if has_more_values(text, MOST_VALUES) {
        return Err(OpenError::invalid(path, "document", format!("at most {MOST_VALUES} values"), "more"));
    }
    serde_json::from_slice(text).map_err(|error| OpenError::invalid(path, "document", "JSON", not_json(&error)))
}

/// A description of text of the wrong form, to follow "found".
pub(crate) fn not_json(error: &serde_json::Error) -> String {
    format!("unreadable text ({}); restore the file, or pack the store again", error.to_string().replace('`', "'"))
}

/// Whether a JSON text has more than `most` values: each is preceded by one of these characters, outside strings.
fn has_more_values(text: &[u8], most: usize) -> bool {
    let (mut values, mut is_text, mut is_escaped) = (0, false, false);
    for &byte in text {
        match byte {
            _ if is_escaped => is_escaped = false,
            b'\\' => is_escaped = is_text,
            b'"' => is_text = !is_text,
            b',' | b'[' | b'{' => values += usize::from(!is_text),
            _ => {}
        }
    }
    values > most
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn documents_of_too_many_values_are_not_parsed() {
        let nested = "[".repeat(40) + &"]".repeat(40);
        for (text, values) in [(r#"{"a,[{": "b,\",[", "c": [1, 2]}"#, 4), ("[]", 1), ("1", 0), (nested.as_str(), 40)] {
            assert!(!has_more_values(text.as_bytes(), values), "{text}");
            assert!(values == 0 || has_more_values(text.as_bytes(), values - 1), "{text}");
        }
        let many = format!("[{}0]", "[],".repeat(MOST_VALUES));
        let message = parse_json(Path::new("a/zarr.json"), many.as_bytes()).unwrap_err().to_string();
        assert!(message.contains("a/zarr.json") && message.contains("values"), "{message}");
    }
}
