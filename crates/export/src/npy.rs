//! NumPy's `.npy`: an array of shape (z, y, x), with axes of steps and channels before where several are asked for. It keeps voxels alone.

use crate::plan::{Body, Layout, Plan};
use crate::volume::Volume;

const MAGIC: &[u8] = b"\x93NUMPY\x01\x00";

pub(crate) fn plan(volume: &Volume) -> Plan {
    Plan::new(volume, "A .npy file", &[], Body::Flat(Layout::after(header(volume), volume)))
}

/// A header of version 1.0: a Python dictionary, padded so the data start at a multiple of 64.
fn header(volume: &Volume) -> Vec<u8> {
    let voxel_type = volume.info.voxel_type;
    // Byte order, then the initial of "uint", "int" or "float", then bytes: such as "|u1" and "<f4".
    let order = if voxel_type.bytes() == 1 { '|' } else { '<' };
    let descr = format!("{order}{:.1}{}", voxel_type.zarr_name(), voxel_type.bytes());
    let [x, y, z] = volume.info.extent.to_array();
    let (times, channels) = (volume.info.times, volume.info.channels);
    let outer = [(volume.has_time_axis, times), (volume.has_channel_axis, channels)];
    let outer: String = outer.iter().filter(|(is_there, _)| *is_there).map(|(_, count)| format!("{count}, ")).collect();
    let dictionary = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({outer}{z}, {y}, {x}), }}");
    let bytes = (MAGIC.len() + 2 + dictionary.len() + 1).next_multiple_of(64);
    let padded = format!("{dictionary:width$}\n", width = bytes - MAGIC.len() - 3);
    [MAGIC, &(padded.len() as u16).to_le_bytes(), padded.as_bytes()].concat()
}
