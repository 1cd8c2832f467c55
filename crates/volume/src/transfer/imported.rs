//! What a reader of transfer function files is given, and gives.

use super::TransferFunction;

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

/// A function from a file.
#[derive(Clone, Debug)]
pub struct Imported {
    /// The function.
    pub transfer: TransferFunction,
    /// What was left out or chosen, for the user to know: a sentence each.
    pub remarks: Vec<String>,
}
