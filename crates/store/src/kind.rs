//! The kind of a store's values.

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
