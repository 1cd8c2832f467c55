//! What a reader of transfer function files is given, and gives.

use super::{TransferFunction, automatic};
use crate::foreground::Foreground;
use crate::geometry::Geometry;
use crate::labels::LabelLook;
use crate::space::Extent;

/// What a transfer function is made for: it fills in what a preset or a file does not say.
#[derive(Clone, Copy, Debug)]
pub struct Subject {
    /// The volume's window, `(low, high)` in data units: presets and colour maps without values of their own span it.
    pub window: (f64, f64),
    /// World distance over which presets that span the window, and maps without opacity, collect their opacity.
    pub unit_distance: f64,
    /// The volume's diagonal divided by the cube root of its number of voxels, in world units. ParaView collects opacity over this
    /// distance, and does not write it down.
    pub cell_length: f64,
    /// Mean of the volume's three voxel spacings, in world units: VTK's unit of length for gradients.
    pub mean_spacing: f64,
    /// Whether the volume's values are labels.
    pub is_labels: bool,
    /// What of the volume is worth showing first; `None` if that is not known, or the window is not the volume's own.
    pub foreground: Option<Foreground>,
}

impl Subject {
    /// No volume: whether a function can be used does not depend on what it is for.
    pub(crate) const NONE: Self = Self {
        window: (0.0, 1.0),
        unit_distance: 1.0,
        cell_length: 1.0,
        mean_spacing: 1.0,
        is_labels: false,
        foreground: None,
    };

    /// The subject for a volume and the window to be shown of it, which becomes the [`shown_window`]: so a volume of one value has the
    /// middle of the colours and of the opacity, instead of being black. The presets' distance is a hundredth of the volume's longest side.
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

    /// This subject in another window, of which nothing is known.
    pub fn in_window(self, window: (f64, f64)) -> Self {
        Self { window, foreground: None, ..self }
    }

    /// The preset `auto`: what of the volume is worth showing first, in the light.
    pub(super) fn automatic_function(&self) -> TransferFunction {
        let foreground = self.foreground.unwrap_or_else(|| Foreground::of_window(self.window));
        automatic::automatic(&foreground, self.window.1, self.unit_distance)
    }

    /// What is shown unless a scene says otherwise: the gray ramp over the window; of labels, each opaque in its own colour.
    pub fn default_function(&self) -> TransferFunction {
        if self.is_labels {
            let (opacity, labels) = (vec![[0.0, 1.0]], Some(LabelLook::hashed()));
            return TransferFunction {
                opacity,
                unit_distance: self.unit_distance,
                labels,
                ..TransferFunction::default()
            };
        }
        TransferFunction::preset("gray", self.window, self.unit_distance).expect("'gray' is a preset")
    }
}

/// The window that is shown: the one given, or where that is a single value, a window about that value.
pub fn shown_window((low, high): (f64, f64)) -> (f64, f64) {
    if low < high {
        return (low, high);
    }
    let reach = low.abs().max(1.0) / 2.0;
    (low - reach, low + reach)
}

/// A transfer function that was read from a file.
#[derive(Clone, Debug)]
pub struct Imported {
    /// The transfer function.
    pub transfer: TransferFunction,
    /// What was left out or chosen when the file was read, for the user to know: a sentence each.
    pub remarks: Vec<String>,
}
