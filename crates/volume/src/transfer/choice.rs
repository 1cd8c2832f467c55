//! Choice of a scene's transfer function: written out, a preset by name, or a file. In JSON each is an object: the function's
//! own, `{"preset": "viridis"}`, or `{"file": "ct.json"}`. Files are read with the scene; afterwards a choice becomes a
//! function without any I/O, at the cost of copying its points.

use super::{Subject, TransferError, TransferFunction, automatic};
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::Value;
use std::path::PathBuf;
use std::sync::Arc;

/// The transfer function requested by a scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum TransferChoice {
    /// A written-out function.
    Function(TransferFunction),
    /// A preset: one of [`TransferFunction::PRESETS`], by its name.
    Preset(TransferPreset),
    /// The function of a file.
    File(TransferFile),
}

/// A preset by its name.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransferPreset {
    /// Name of the preset.
    pub preset: String,
}

/// A file with a transfer function, in any form of [`file`](super::file).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransferFile {
    /// Path of the file.
    #[serde(rename = "file")]
    pub path: PathBuf,
    /// Name of the function among the file's; `None` is the first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// The file's function; `None` until it has been read. In JSON a scene has the file's name alone.
    #[serde(skip)]
    pub function: Option<Arc<TransferFunction>>,
}

impl TransferChoice {
    /// Chooses the preset of this name; [`TransferChoice::function`] checks its existence.
    pub fn preset(name: impl Into<String>) -> Self {
        Self::Preset(TransferPreset { preset: name.into() })
    }

    /// Returns the chosen transfer function for a subject.
    ///
    /// # Errors
    /// If there is no such preset, the file has not been read, or the function is not valid.
    pub fn function(&self, subject: &Subject) -> Result<TransferFunction, TransferError> {
        let function = match self {
            Self::Preset(_) if self.is_automatic() => return Ok(subject.automatic_function()),
            Self::Preset(TransferPreset { preset }) => {
                return TransferFunction::preset(preset, subject.window, subject.unit_distance);
            }
            Self::Function(function) => function,
            Self::File(TransferFile { path, function, .. }) => {
                function.as_deref().ok_or_else(|| TransferError::NotRead(path.clone()))?
            }
        };
        function.validate().map(|()| function.clone())
    }

    /// Chooses the default first look of a volume: see [`Foreground`](crate::Foreground).
    pub fn automatic() -> Self {
        Self::preset(automatic::NAME)
    }

    /// Whether the automatic function is chosen.
    pub fn is_automatic(&self) -> bool {
        matches!(self, Self::Preset(TransferPreset { preset }) if preset == automatic::NAME)
    }

    /// Whether the chosen function depends on the gradient magnitude. Presets do not; unread files count as not.
    pub fn is_by_gradient(&self) -> bool {
        match self {
            Self::Function(function) => function.is_by_gradient(),
            Self::Preset(_) => false,
            Self::File(file) => file.function.as_ref().is_some_and(|function| function.is_by_gradient()),
        }
    }

    /// Whether the function spans any window; other functions have values of their own.
    pub fn spans_window(&self) -> bool {
        matches!(self, Self::Preset(TransferPreset { preset }) if !TransferFunction::is_absolute(preset))
    }
}

impl From<TransferFunction> for TransferChoice {
    fn from(function: TransferFunction) -> Self {
        Self::Function(function)
    }
}

impl<'de> Deserialize<'de> for TransferChoice {
    fn deserialize<D: Deserializer<'de>>(input: D) -> Result<Self, D::Error> {
        // By hand: errors of serde's untagged enums do not name an unknown field.
        let value = Value::deserialize(input)?;
        let choice = if value.get("preset").is_some() {
            serde_json::from_value(value).map(Self::Preset)
        } else if value.get("file").is_some() {
            serde_json::from_value(value).map(Self::File)
        } else if value.is_object() {
            serde_json::from_value(value).map(Self::Function)
        } else {
            let problem = r#"expected a transfer function, {"preset": NAME} or {"file": PATH}"#;
            return Err(D::Error::custom(format!("{problem}, found {value}")));
        };
        choice.map_err(D::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::super::file::tests::SUBJECT;
    use super::*;

    fn read(text: &str) -> Result<TransferChoice, String> {
        serde_json::from_str(text).map_err(|error| error.to_string())
    }

    #[test]
    fn choices_are_told_by_their_fields_and_round_trip() {
        let function = TransferFunction { opacity: vec![[1.0, 0.5]], ..TransferFunction::default() };
        let file = TransferFile { path: "a.json".into(), name: Some("Hot".into()), function: None };
        for choice in [function.clone().into(), TransferChoice::preset("fire"), TransferChoice::File(file.clone())] {
            let text = serde_json::to_string(&choice).unwrap();
            assert_eq!(read(&text), Ok(choice), "{text}");
        }
        let read_by_now =
            TransferChoice::File(TransferFile { function: Some(function.clone().into()), ..file.clone() });
        assert_eq!(read_by_now.function(&SUBJECT).unwrap(), function);
        assert!(matches!(TransferChoice::File(file).function(&SUBJECT), Err(TransferError::NotRead(_))));
        for (bad, word) in [
            (r#"{"preset": "fire", "windw": 1}"#, "unknown field `windw`"),
            (r#"{"file": "a", "nme": "b"}"#, "unknown field `nme`"),
            (r#"{"color": [], "opacity": [], "unit": 2}"#, "unknown field `unit`"),
            (r#""fire""#, r#"{"preset": NAME}"#),
        ] {
            let error = read(bad).unwrap_err();
            assert!(error.contains(word), "{bad}: {error}");
        }
    }
}
