//! The kind of a store's values.

use brickyard_import::SourceInfo;
use serde::{Deserialize, Serialize};

/// Meaning of a store's values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// The values are intensities, and may be interpolated.
    #[default]
    Image,
    /// The values are identifiers, and must never be mixed.
    Labels,
}

impl Kind {
    /// The kind of a source's values by its files' own word; an image if they have none.
    pub fn said_by(source: &SourceInfo) -> Self {
        if source.kind.are_labels() { Self::Labels } else { Self::Image }
    }
}
