//! What a reader of transfer function files is given, and gives.

use super::TransferFunction;
use crate::geometry::Geometry;
use crate::space::Extent;

/// What a function is for: it fills in what a file does not say.
#[derive(Clone, Copy, Debug)]
pub struct Subject {
    /// The volume's window, data units: colour maps without values of their own span it.
    pub window: (f64, f64),
    /// World distance over which maps without opacity collect that of the presets.
    pub unit_distance: f64,
    /// The diagonal of the volume by the cube root of its number of voxels, world units: the distance over which opacity is
    /// collected in ParaView, which does not write it down.
    pub cell_length: f64,
    /// Mean of the volume's three voxel spacings, world units: VTK's unit of length for gradients.
    pub mean_spacing: f64,
}

impl Subject {
    /// No volume: whether a function can be used does not depend on what it is for.
    pub(crate) const NONE: Self = Self { window: (0.0, 1.0), unit_distance: 1.0, cell_length: 1.0, mean_spacing: 1.0 };

    /// A volume and the window to be shown of it, or where that is a single value, one about it: so a volume of one value has the middle of
    /// the colours and of the opacity, instead of being black. The presets' distance is a hundredth of the longest side.
    pub fn new(geometry: &Geometry, extent: Extent, window: (f64, f64)) -> Self {
        let (low, high) = geometry.world_box(extent);
        let size = high - low;
        Self {
            window: shown_window(window),
            unit_distance: size.max_element() / 100.0,
            cell_length: size.length() / (extent.volume() as f64).cbrt(),
            mean_spacing: geometry.spacing.element_sum() / 3.0,
        }
    }

    /// The gray ramp over the window: what is shown unless something is said.
    pub fn default_function(&self) -> TransferFunction {
        TransferFunction::preset("gray", self.window, self.unit_distance).expect("'gray' is a preset")
    }
}

/// The window that is shown: the one given, or where that is a single value, one about it.
pub fn shown_window((low, high): (f64, f64)) -> (f64, f64) {
    if low < high {
        return (low, high);
    }
    let reach = low.abs().max(1.0) / 2.0;
    (low - reach, low + reach)
}

/// A function from a file.
#[derive(Clone, Debug)]
pub struct Imported {
    /// The function.
    pub transfer: TransferFunction,
    /// What was left out or chosen, for the user to know: a sentence each.
    pub remarks: Vec<String>,
}
