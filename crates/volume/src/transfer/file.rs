//! Files of transfer functions, in several forms, recognised by content and not by name.
//!
//! | form | writer | recognised by |
//! | --- | --- | --- |
//! | JSON of [`TransferFunction`](super::TransferFunction) | brickyard | an object that is none of the others |
//! | colour maps (`paraview`) | ParaView, and much else | a list of objects, or one with `RGBPoints` |
//! | volume property, `.vp.json` (`slicer`) | 3D Slicer | an object with `volumeProperties` |
//! | volume property, `.vp` (`slicer`) | 3D Slicer | text that begins with a number |

use super::imported::{Imported, Subject};
use super::{TransferError, paraview, slicer};
use serde_json::Value;

/// Parses a transfer function from a file's text: of several functions the one called `name`, or the first if this
/// is `None`. `subject` supplies settings missing in the file.
///
/// # Errors
/// If the text has none of the forms, is damaged, or has no function of this name.
pub fn read(text: &str, name: Option<&str>, subject: &Subject) -> Result<Imported, TransferError> {
    let text = text.trim_start_matches('\u{feff}');
    let unnamed = |read: Result<Imported, TransferError>| match name {
        Some(name) => Err(unknown_name(name)),
        None => read,
    };
    match text.trim_start().chars().next() {
        Some('{' | '[') => match json(text)? {
            Value::Array(maps) => paraview::read(&maps, name, subject),
            map if map.get("RGBPoints").is_some() => paraview::read(&[map], name, subject),
            file if file.get("volumeProperties").is_some() => unnamed(slicer::read_json(file, subject)),
            _ => unnamed(own(text)),
        },
        _ if slicer::is_text(text) => unnamed(slicer::read_text(text, subject)),
        _ => Err(TransferError::UnknownForm),
    }
}

fn unknown_name(name: &str) -> TransferError {
    let known = "a file of this format holds no names: leave '#' and the name out".to_string();
    TransferError::UnknownName { name: name.to_string(), hint: String::new(), known }
}

fn own(text: &str) -> Result<Imported, TransferError> {
    Imported::checked(serde_json::from_str(text)?, Vec::new())
}

/// Parses JSON. Python, among others, writes `NaN` and `Infinity` into it, which a parser treats as damage.
fn json(text: &str) -> Result<Value, TransferError> {
    serde_json::from_str(text).map_err(|error| not_finite(text, error.line(), error.column()).unwrap_or(error.into()))
}

/// The error for a word in place of a number, if parsing ended at one (both from 1).
fn not_finite(text: &str, line: usize, column: usize) -> Option<TransferError> {
    let bytes = text.lines().nth(line.checked_sub(1)?)?.as_bytes();
    let is_letter = |i: &usize| bytes.get(*i).is_some_and(|b| b.is_ascii_alphabetic() || b"+-".contains(b));
    // The parser may stop at the word's first letter, or behind its sign.
    let at = [column.wrapping_sub(1), column].into_iter().find(is_letter)?;
    let start = (0..=at).rev().take_while(is_letter).last()?;
    let word: String = (start..).take_while(is_letter).map(|i| bytes[i] as char).collect();
    let known = ["nan", "inf", "infinity"].contains(&word.to_lowercase().trim_start_matches(['+', '-']));
    known.then_some(TransferError::NotFinite { line, column: start + 1, word })
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A window of -100 to 300, unit distance 5, cells of 1.5, a mean spacing of 2.
    pub(in crate::transfer) const SUBJECT: Subject = Subject {
        window: (-100.0, 300.0),
        unit_distance: 5.0,
        cell_length: 1.5,
        mean_spacing: 2.0,
        is_labels: false,
        foreground: None,
    };

    fn bad(text: &str) -> String {
        read(text, None, &SUBJECT).unwrap_err().to_string()
    }

    #[test]
    fn each_form_is_told_by_its_content() {
        let imported = |text: &str| read(text, None, &SUBJECT).unwrap().transfer;
        let own = r#"{"color": [[0, 1, 0, 0]], "opacity": [[0, 0.5]], "unit_distance": 3}"#;
        assert_eq!(imported(own).unit_distance, 3.0);
        assert_eq!(imported(&format!("\u{feff}\n {own}")).unit_distance, 3.0, "a byte order mark says nothing");
        let map = r#"{"RGBPoints": [7, 1, 0, 0, 9, 1, 1, 1]}"#;
        assert_eq!(imported(map), imported(&format!("[{map}]")));
        assert_eq!(imported(map).color[0], [7.0, 1.0, 0.0, 0.0]);
        let json = r#"{"volumeProperties": [{"components": [{
            "rgbTransferFunction": {"points": [{"x": 1, "color": [0.5, 0, 0]}]},
            "scalarOpacity": {"points": [{"x": 2, "y": 0.25}]}}]}]}"#;
        let text = "1\n1\n0.9\n0.1\n0.2\n10\n2 2 0.25\n4 0 1 255 1\n4 1 0.5 0 0\n";
        assert_eq!(imported(json), imported(text));
        for text in ["not JSON", "", "<MRML/>", "\"text\""] {
            assert!(bad(text).starts_with("not a transfer function: expected JSON"), "{text}");
        }
    }

    #[test]
    fn own_files_are_checked_and_the_place_is_named() {
        assert!(bad("{").contains("not a transfer function: EOF while parsing an object at line 1"));
        assert!(bad(r#"{"colour": []}"#).contains("unknown field `colour`"));
        assert!(bad(r#"{"color": [], "opacity": [[0,1]]}"#).contains("'color' has no points"));
        assert!(bad(r#"{"color": [[0,1,1,1]], "opacity": [[5,0],[1,1]]}"#).contains("'opacity' point 1"));
        assert!(bad(r#"{"color": [[0,1,1,2]], "opacity": [[5,0]]}"#).contains("outside 0..1"));
        let by_gradient = |list: &str| bad(&format!(r#"{{"color": [[0,1,1,1]], "opacity": [[5,0]], {list}}}"#));
        assert!(by_gradient(r#""gradient_opacity": [[9,0],[5,1]]"#).contains("'gradient_opacity' point 1"));
        assert!(by_gradient(r#""gradient_opacity": [[-3,0],[5,1]]"#).contains("magnitude -3 is negative"));
        assert!(by_gradient(r#""gradient_opacity": [[0,2]]"#).contains("outside 0..1"));
        assert!(by_gradient(r#""gradient_opacity": []"#).contains("'gradient_opacity' has no points at line 1"));
        let region = r#"{"shape": "rectangle", "value": [3, 2], "gradient": [0, 1], "color": [1, 1, 1], "opacity": 1}"#;
        assert!(by_gradient(&format!(r#""regions": [{region}]"#)).contains("'regions' point 0: 'value' ends at 2"));
        let circle = region.replace("rectangle", "circle");
        assert!(
            by_gradient(&format!(r#""regions": [{circle}]"#)).contains("unknown variant `circle`, expected one of")
        );
        assert!(bad(r#"{"color": [[0,1,1,1]], "opacity": [[5,0]], "unit_distance": 0}"#).contains("unit_distance"));
        let named =
            read(r#"{"color": [[0,1,1,1]], "opacity": [[5,0]]}"#, Some("Jet"), &SUBJECT).unwrap_err().to_string();
        assert!(named.contains("'Jet'") && named.contains("no names"), "{named}");
    }

    #[test]
    fn words_for_numbers_are_named_where_they_stand() {
        for (word, written) in [("NaN", "NaN"), ("-Infinity", "-Infinity"), ("Infinity", "Infinity"), ("-inf", "-inf")]
        {
            let text = format!("{{\"color\": [[0,1,1,1]],\n \"opacity\": [[5,0],[7, {written}]]}}");
            assert_eq!(bad(&text), format!("line 2, column 24: found {word}, expected a finite number"));
        }
        assert!(bad("{\"opacity\": [[null, 1]]}").contains("null"));
        assert!(bad("{\"opacity\": [[nothing, 1]]}").contains("line 1 column"));
        assert!(bad("{\"opacity\": [[1e999, 1]]}").contains("out of range"));
    }
}
