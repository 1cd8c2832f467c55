//! Names of channels that are parts of one number or colour.

use brickyard_volume::{ChannelLook, VoxelType};

/// The parts of complex numbers.
pub(crate) const COMPLEX: [&str; 2] = ["real", "imaginary"];

/// Looks of channels with these names, and otherwise the defaults.
pub(crate) fn named(names: &[&str]) -> Vec<ChannelLook> {
    names.iter().map(|name| ChannelLook { name: Some((*name).into()), ..ChannelLook::default() }).collect()
}

/// Looks of the first channels of red, green, blue and opacity, which together show the colours as they are; opacity is black.
pub(crate) fn colors(voxel_type: VoxelType, channels: u32) -> Vec<ChannelLook> {
    let window = (!voxel_type.is_float()).then(|| voxel_type.limits().into());
    let parts = [("red", [255, 0, 0]), ("green", [0, 255, 0]), ("blue", [0, 0, 255]), ("opacity", [0; 3])];
    let look =
        |(name, color): (&str, _)| ChannelLook { name: Some(name.into()), color: Some(color), window, unit: None };
    parts.into_iter().take(channels as usize).map(look).collect()
}
