//! A volume in memory from a function: padded bricks of codes on every level, as from a store, and the same values as whole arrays
//! for the oracle. Takes a few milliseconds for the sizes drawn here.

use brickyard_pager::{Slot, VolumeNeeds};
use brickyard_reference::Array;
use brickyard_volume::*;
use glam::DVec3;
use std::sync::Arc;

/// Encodes values as the contents of slots, and rounds them to the encoded values.
fn hold(encoding: &SlotEncoding, values: &mut [f64]) -> Vec<u8> {
    if encoding.floats.is_some() {
        let mut slots = vec![0; values.len() * 4];
        let write = |v: &f64| match encoding.voxel_type {
            VoxelType::U32 => (*v as u32).to_le_bytes(),
            VoxelType::I32 => (*v as i32).to_le_bytes(),
            _ => (*v as f32).to_le_bytes(),
        };
        let voxels: Vec<u8> = values.iter().flat_map(write).collect();
        values.iter_mut().enumerate().for_each(|(i, v)| *v = encoding.voxel_type.read(&voxels, i));
        encoding.encode(&voxels, &mut slots);
        return slots;
    }
    let max = encoding.format.max_code() as f64;
    let code = |v: f64| {
        let first = encoding.has_invalid as u32 as f64;
        let scaled = (v - encoding.low) / (encoding.high - encoding.low) * max;
        if v.is_nan() { 0 } else { scaled.round().clamp(first, max) as u16 }
    };
    let decode = |c: u16| if encoding.has_invalid && c == 0 { f64::NAN } else { encoding.value(c as f64 / max) };
    let codes: Vec<u16> = values.iter().map(|&v| code(v)).collect();
    values.iter_mut().zip(&codes).for_each(|(v, &c)| *v = decode(c));
    codes.iter().flat_map(|code| code.to_le_bytes()[..encoding.format.bytes()].to_vec()).collect()
}

/// A volume whose level arrays hold exactly the values of its slot codes.
pub(crate) struct Volume {
    pub(crate) pyramid: Pyramid,
    pub(crate) geometry: Geometry,
    pub(crate) encoding: SlotEncoding,
    pub(crate) levels: Vec<Array>,
    /// Slots' contents for each level's voxels.
    slots: Vec<Vec<u8>>,
}

impl Volume {
    /// Samples `value`, given in voxel space, at the voxel centres of every level; NaN is invalid.
    pub(crate) fn new(
        extent: [u32; 3],
        edge: u32,
        geometry: Geometry,
        encoding: SlotEncoding,
        value: impl Fn(DVec3) -> f64,
    ) -> Self {
        let pyramid = Pyramid::new(Extent::from_array(extent), geometry.spacing.to_array(), edge);
        let (mut levels, mut slots) = (Vec::new(), Vec::new());
        for grid in pyramid.levels() {
            let factor = DVec3::from_array(grid.factor.map(f64::from));
            let mut level = Array::from_fn(grid, |i| value((DVec3::from_array(i.map(f64::from)) + 0.5) * factor));
            slots.push(hold(&encoding, &mut level.values));
            levels.push(level);
        }
        Self { pyramid, geometry, encoding, levels, slots }
    }

    /// A renderer's description of the volume, with bricks for these needs.
    pub(crate) fn needs(&self, bricks: &Needs) -> VolumeNeeds {
        // An atlas of exactly this many slots may have no shape: a tenth more, as in sessions.
        let slots = self.pyramid.brick_count() as u32;
        VolumeNeeds {
            encoding: self.encoding,
            edge: self.pyramid.edge(),
            levels: self.pyramid.levels().len() as u32,
            bricks: *bricks,
            least_slots: 1,
            most_slots: slots + slots / 8 + 2,
        }
    }

    /// All its bricks, the coarsest first.
    pub(crate) fn bricks(&self) -> impl Iterator<Item = BrickId> {
        let levels = (0..self.levels.len() as u8).rev().map(Level);
        levels.flat_map(|level| {
            let n = self.pyramid.level(level).bricks.to_array();
            let all = (0..n[2]).flat_map(move |z| (0..n[1]).flat_map(move |y| (0..n[0]).map(move |x| [x, y, z])));
            all.map(move |[x, y, z]| BrickId { time: 0, channel: 0, level, index: BrickIndex { x, y, z } })
        })
    }

    /// A brick's slot, in the order of [`Self::bricks`].
    pub(crate) fn slot(&self, brick: BrickId) -> Slot {
        let coarser = &self.pyramid.levels()[brick.level.index() + 1..];
        let before: u64 = coarser.iter().map(|grid| grid.bricks.volume()).sum();
        let (n, BrickIndex { x, y, z }) = (self.pyramid.level(brick.level).bricks, brick.index);
        Slot(before as u32 + x + n.x * (y + n.y * z))
    }

    /// A brick with its apron, the volume's faces replicated, and with gradients if needed.
    pub(crate) fn padded(&self, brick: BrickId, needs: &Needs) -> Arc<[u8]> {
        let (edge, apron, level) = (self.pyramid.edge(), needs.apron, brick.level.index());
        let (extent, SlotEncoding { format, has_invalid, .. }) = (self.levels[level].extent, self.encoding);
        let unit = self.encoding.floats.map_or(format.max_code() as f32, |floats| floats.unit as f32);
        let (n, first) = (extent.to_array(), brick.index.to_array().map(|i| (i * edge) as i64));
        let along = |a: usize| {
            let start = first[a] - apron as i64;
            (start..start + (edge + 2 * apron) as i64).map(move |i| i.clamp(0, n[a] as i64 - 1) as u32)
        };
        let mut bytes = Vec::new();
        for z in along(2) {
            for y in along(1) {
                for x in along(0) {
                    let at = extent.linear([x, y, z]) as usize * format.bytes();
                    bytes.extend_from_slice(&self.slots[level][at..at + format.bytes()]);
                }
            }
        }
        let gradients = needs.gradients(edge);
        if gradients.layers > 0 {
            let inside = std::array::from_fn(|a| -first[a]..n[a] as i64 - first[a]);
            let mut nodes = vec![0; gradients.bytes()];
            gradients.fill(PaddedCodes { codes: &bytes, format, has_invalid, unit, apron }, &inside, &mut nodes);
            bytes.extend(nodes);
        }
        bytes.into()
    }

    /// A frame of fog through a transfer function.
    pub(crate) fn frame(&self, rays: ViewRays, transfer: &TransferFunction, lattice: Lattice) -> FrameSettings {
        FrameSettings {
            rays,
            lattice,
            geometry: self.geometry.clone(),
            placement: Placement::default(),
            encoding: self.encoding,
            table: TransferTable::new(transfer, &self.encoding).into(),
            mode: Mode::Dvr,
            surfaces: Vec::new(),
            sampling: Sampling::default(),
            lighting: Lighting::default(),
            background: [0.2, 0.1, 0.4],
            clip: None,
            meshes: Vec::new(),
            caps: false,
            keeps_extremes: false,
        }
    }

    /// The same in another mode; with an isosurface at the transfer function's middle colour.
    pub(crate) fn frame_in(
        &self,
        mode: Mode,
        rays: ViewRays,
        transfer: &TransferFunction,
        lattice: Lattice,
    ) -> FrameSettings {
        let middle = Isosurface::at(transfer.color[transfer.color.len() / 2][0]);
        let shown = if mode == Mode::Isosurface { vec![middle] } else { Vec::new() };
        let surfaces = Surface::all(&shown, transfer, &self.encoding);
        FrameSettings { mode, surfaces, ..self.frame(rays, transfer, lattice) }
    }
}
