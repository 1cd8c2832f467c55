//! Input and output of the readers of transfer function files.

use super::{TransferError, TransferFunction, automatic};
use crate::foreground::Foreground;
use crate::geometry::Geometry;
use crate::labels::LabelLook;
use crate::space::Extent;

/// The volume of a transfer function: supplies settings missing in a preset or a file.
#[derive(Clone, Copy, Debug)]
pub struct Subject {
    /// The volume's window, `(low, high)` in data units: presets and colour maps without values of their own span it.
    pub window: (f64, f64),
    /// World distance for collecting opacity in window-spanning presets and maps without opacity.
    pub unit_distance: f64,
    /// The volume's diagonal divided by the cube root of its number of voxels, in world units. ParaView collects opacity over this
    /// distance, and does not store it.
    pub cell_length: f64,
    /// Mean of the volume's three voxel spacings, in world units: VTK's unit of length for gradients.
    pub mean_spacing: f64,
    /// Whether the volume's values are labels.
    pub is_labels: bool,
    /// The volume's foreground; `None` if unknown, or if the window is not the volume's own.
    pub foreground: Option<Foreground>,
}

impl Subject {
    /// No volume: a function's validity does not depend on its volume.
    pub(crate) const NONE: Self = Self {
        window: (0.0, 1.0),
        unit_distance: 1.0,
        cell_length: 1.0,
        mean_spacing: 1.0,
        is_labels: false,
        foreground: None,
    };

    /// Creates the subject of a volume and its requested window, made a [`shown_window`]: a volume of one value thus has the middle of the
    /// colours and of the opacity, instead of being black. The presets' distance is a hundredth of the volume's longest side.
    pub fn new(geometry: &Geometry, extent: Extent, window: (f64, f64)) -> Self {
        let (low, high) = geometry.world_box(extent);
        let size = high - low;
        Self {
            window: shown_window(window),
            unit_distance: size.max_element() / 100.0,
            cell_length: size.length() / (extent.volume() as f64).cbrt(),
            mean_spacing: geometry.spacing.element_sum() / 3.0,
            is_labels: false,
            foreground: None,
        }
    }

    /// Returns this subject in another window, without a known foreground.
    pub fn in_window(self, window: (f64, f64)) -> Self {
        Self { window, foreground: None, ..self }
    }

    /// The preset `auto`, for the volume's foreground in the light.
    pub(super) fn automatic_function(&self) -> TransferFunction {
        let foreground = self.foreground.unwrap_or_else(|| Foreground::of_window(self.window));
        automatic::automatic(&foreground, self.window.1, self.unit_distance)
    }

    /// The default function: a gray ramp over the window; for labels, each opaque in its own colour.
    pub fn default_function(&self) -> TransferFunction {
        if self.is_labels {
            let (opacity, labels, unit_distance) = (vec![[0.0, 1.0]], Some(LabelLook::hashed()), self.unit_distance);
            return TransferFunction { opacity, labels, unit_distance, ..TransferFunction::default() };
        }
        TransferFunction::preset("gray", self.window, self.unit_distance).expect("'gray' is a preset")
    }
}

/// The effective window: the given one, or one about its single value.
pub fn shown_window((low, high): (f64, f64)) -> (f64, f64) {
    if low < high {
        return (low, high);
    }
    let reach = low.abs().max(1.0) / 2.0;
    (low - reach, low + reach)
}

/// A transfer function from a file.
#[derive(Clone, Debug)]
pub struct Imported {
    /// The transfer function.
    pub transfer: TransferFunction,
    /// Omissions and choices of the reader, for the user: a sentence each.
    pub remarks: Vec<String>,
}

impl Imported {
    /// A function to be validated, and remarks about it.
    pub(super) fn checked(transfer: TransferFunction, remarks: Vec<String>) -> Result<Self, TransferError> {
        transfer.validate()?;
        Ok(Self { transfer, remarks })
    }
}
