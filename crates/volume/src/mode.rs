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

impl Mode {
    /// Whether the mode is a projection: a picture of one value per ray.
    pub const fn is_projection(self) -> bool {
        match self {
            Self::Mip | Self::MinIp | Self::Average => true,
            Self::Dvr | Self::Isosurface => false,
        }
    }
}
