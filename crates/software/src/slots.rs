//! A pool of slots in RAM, and the byte account of a renderer.

use crate::channels;
use crate::compositing::{BYTES_PER_CELL_AND_THREAD, BYTES_PER_LAYER_AND_THREAD};
use crate::frame::{Cell, Resident};
use crate::macrocells::boxes;
use crate::meshes;
use crate::options::SoftwareOptions;
use crate::tile;
use crate::tiles::{TILE_PX, Tile, TilePixels};
use crate::{depths, steps};
use brickyard_pager::{Slot, VolumeNeeds};
use brickyard_volume::TransferGrid;
use brickyard_volume::lattice::MAX_ZONES;
use brickyard_volume::macrocells::{self, MacroCells};
use std::sync::Arc;
use std::sync::atomic::AtomicU32;

/// A pool's slots. A slot takes memory once it holds a brick.
#[derive(Debug)]
pub(crate) struct Slots {
    pub(crate) needs: VolumeNeeds,
    skips_empty: bool,
    bricks: Vec<Option<Resident>>,
}

impl Slots {
    pub(crate) fn new(needs: &VolumeNeeds, skips_empty: bool, count: u32) -> Self {
        let mut bricks = Vec::new();
        bricks.resize_with(count as usize, || None);
        Self { needs: *needs, skips_empty, bricks }
    }

    pub(crate) fn len(&self) -> u32 {
        self.bricks.len() as u32
    }

    /// Puts a padded brick into a slot. If empty space is skipped, the codes are read once, for the macro-cells.
    /// Returns the slot's former codes.
    pub(crate) fn upload(&mut self, slot: Slot, codes: Arc<[u8]>) -> Option<Arc<[u8]>> {
        debug_assert!(self.is_padded_brick(&codes));
        let VolumeNeeds { encoding, edge, bricks, .. } = self.needs;
        let voxels = &codes[..voxel_bytes(&self.needs) as usize];
        let cells = match self.skips_empty {
            true => MacroCells::new(voxels, encoding.format, encoding.has_invalid, edge as usize, bricks),
            false => MacroCells::of_anything(encoding.format, edge as usize),
        };
        let voxel_bytes = voxels.len();
        let before = self.bricks[slot.0 as usize].replace(Resident::new(codes, voxel_bytes, cells));
        before.map(Resident::into_codes)
    }

    pub(crate) fn is_padded_brick(&self, codes: &[u8]) -> bool {
        codes.len() as u64 == slot_bytes(&self.needs)
    }

    pub(crate) fn has_brick(&self, slot: Slot) -> bool {
        matches!(self.bricks.get(slot.0 as usize), Some(Some(_)))
    }

    /// The brick in a slot.
    ///
    /// # Panics
    /// If the slot holds no brick, or there is no such slot.
    pub(crate) fn brick(&self, slot: Slot) -> &Resident {
        self.bricks[slot.0 as usize].as_ref().unwrap_or_else(|| panic!("slot {} holds no brick", slot.0))
    }
}

fn voxel_bytes(needs: &VolumeNeeds) -> u64 {
    (needs.edge as u64 + 2 * needs.bricks.apron as u64).pow(3) * needs.encoding.format.bytes() as u64
}

fn slot_bytes(needs: &VolumeNeeds) -> u64 {
    voxel_bytes(needs) + needs.bricks.gradients(needs.edge).bytes() as u64
}

/// Bytes of one slot: its voxels, gradients and macro-cells, the handle to them, and the cell drawing them with its
/// mask or extremes and its light; for layers drawn together, also each thread's data for the cell.
pub(crate) fn bytes_per_slot(needs: &VolumeNeeds, options: &SoftwareOptions, are_several: bool) -> u64 {
    let edge = needs.edge as usize;
    let cells = macrocells::bytes(edge);
    let mask = boxes(edge) * size_of::<f32>();
    let light = size_of::<AtomicU32>() + size_of::<f32>();
    let of_threads = if are_several { options.threads.max(1) * BYTES_PER_CELL_AND_THREAD } else { 0 };
    let beside = cells + mask + light + size_of::<Option<Resident>>() + size_of::<Cell<'_>>() + of_threads;
    slot_bytes(needs) + beside as u64
}

/// Bytes of a renderer besides its slots: the picture as tiles and as rows, the meshes' tree, every thread's rays, and
/// each layer's tables.
pub(crate) fn fixed_bytes(layers: &[VolumeNeeds], options: &SoftwareOptions) -> u64 {
    let tiles: u64 = options.max_picture_px.iter().map(|&n| n.div_ceil(TILE_PX) as u64).product();
    let tile = (size_of::<TilePixels>() + size_of::<Tile>()) as u64;
    let picture = options.max_picture_px.iter().map(|&n| n as u64).product::<u64>() * 3;
    // All layers have the scene's meshes.
    let room = layers[0].bricks.meshes;
    let slabs = if room.is_none() { 0 } else { meshes::BYTES_PER_THREAD };
    let ways = (layers.len() * BYTES_PER_LAYER_AND_THREAD) as u64;
    let walks = if layers.len() > 1 { channels::BYTES_PER_THREAD as u64 } else { 0 };
    let of_threads = options.threads.max(1) as u64 * (tile::BYTES_PER_THREAD + slabs + ways + walks);
    let tables: u64 = layers.iter().map(table_bytes).sum();
    tiles * tile + picture + meshes::bytes(room) + of_threads + tables
}

/// The bytes of the tables of steps, of depths, and of values and gradients.
fn table_bytes(needs: &VolumeNeeds) -> u64 {
    let format = needs.encoding.format;
    let steps = steps::bytes(format, MAX_ZONES) as u64;
    let entries = if needs.bricks.has_grid { TransferGrid::MOST_ROWS * TransferGrid::COLUMNS } else { 0 };
    steps + (depths::bytes(format) + entries * size_of::<[f32; 4]>()) as u64
}
