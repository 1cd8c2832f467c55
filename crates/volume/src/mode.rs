//! Rendering modes.

use crate::enum_all::every;
use serde::{Deserialize, Serialize};

/// How samples along a ray become a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// Emission and absorption through the transfer function (direct volume rendering).
    #[default]
    Dvr,
    /// Maximum intensity projection: the greatest sample, opaque, in the transfer function's colour.
    Mip,
    /// Minimum intensity projection: the least sample, opaque, in the transfer function's colour.
    MinIp,
    /// Average projection: the length-weighted mean of the samples, opaque, in the transfer function's colour.
    Average,
    /// Only the scene's isosurfaces (see [`surface`](crate::surface)).
    Isosurface,
}

every!(Mode: Dvr Mip MinIp Average Isosurface);

/// The end of a ray's values that a projection shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Extreme {
    /// The greatest.
    Greatest,
    /// The least.
    Least,
}

impl Mode {
    /// The mode's word in commands and scene files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Dvr => "dvr",
            Self::Mip => "mip",
            Self::MinIp => "minip",
            Self::Average => "average",
            Self::Isosurface => "isosurface",
        }
    }

    /// The mode's meaning, for users.
    pub const fn meaning(self) -> &'static str {
        match self {
            Self::Dvr => "Direct volume rendering: glowing fog, which hides things behind it",
            Self::Mip => "Maximum intensity projection: the greatest value along each ray",
            Self::MinIp => "Minimum intensity projection: the least value along each ray (airways)",
            Self::Average => "The mean value along each ray, as in an X-ray picture",
            Self::Isosurface => "Only surfaces of one value, lit",
        }
    }

    /// Whether the mode is a projection: a picture of one value per ray.
    pub const fn is_projection(self) -> bool {
        match self {
            Self::Mip | Self::MinIp | Self::Average => true,
            Self::Dvr | Self::Isosurface => false,
        }
    }

    /// The extreme shown by a projection; `None` for other modes.
    pub const fn extreme(self) -> Option<Extreme> {
        match self {
            Self::Mip => Some(Extreme::Greatest),
            Self::MinIp => Some(Extreme::Least),
            Self::Dvr | Self::Average | Self::Isosurface => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scene_files_have_the_words_of_commands() {
        for mode in Mode::ALL {
            assert_eq!(serde_json::to_value(mode).unwrap(), mode.name());
        }
    }
}
