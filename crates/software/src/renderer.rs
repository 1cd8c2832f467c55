//! The renderer itself: slots in RAM inside a byte budget, and the picture of a draw list over them.

use crate::frame::{Cell, Frame, Resident, occludes};
use crate::macrocells::boxes;
use crate::meshes::{self, MeshTree};
use crate::steps;
use crate::tile::{self, TILE_PX, Tile, TilePixels};
use brickyard_pager::{DrawList, Slot};
use brickyard_volume::lattice::MAX_ZONES;
use brickyard_volume::macrocells::{self, MacroCells};
use brickyard_volume::{FrameSettings, Needs, Picture, Pyramid, SlotEncoding, TransferGrid};
use rayon::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

/// What a renderer is made for; fixed for its life.
#[derive(Clone, Copy, Debug)]
pub struct SoftwareOptions {
    /// What slot codes mean.
    pub encoding: SlotEncoding,
    /// Voxels along a brick's core edge, as in the pyramid.
    pub edge: u32,
    /// What the pictures need of bricks: an apron of at least 1 among it.
    pub needs: Needs,
    /// The most that slots and everything else of the renderer may take.
    pub memory_bytes: u64,
    /// Width and height of the largest picture.
    pub max_picture_px: [u32; 2],
    /// Threads that draw; at least 1.
    pub threads: usize,
    /// Whether rays leap over what shows nothing; without, pictures are the same and take longer.
    pub leaps: bool,
}

/// Why a renderer cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum SoftwareError {
    /// Not one slot fits.
    #[error(
        "{given_bytes} bytes of --gpu-memory hold no brick: the CPU renderer needs at least {least_bytes} bytes here"
    )]
    Budget {
        /// What was given.
        given_bytes: u64,
        /// The least that works: one slot.
        least_bytes: u64,
    },
    /// Bricks whose voxels cannot be indexed.
    #[error("bricks of {edge} voxels an edge cannot be drawn: expected 1 to {}", SoftwareRenderer::MAX_EDGE)]
    Edge {
        /// The edge asked for.
        edge: u32,
    },
    /// The operating system gives no threads.
    #[error("cannot start {threads} drawing threads: {source}")]
    Threads {
        /// How many were asked for.
        threads: usize,
        /// What the system said.
        source: rayon::ThreadPoolBuildError,
    },
}

/// Slots in RAM and threads that draw from them.
#[derive(Debug)]
pub struct SoftwareRenderer {
    options: SoftwareOptions,
    slots: Slots,
    fixed_bytes: u64,
    visibility: Option<Vec<f32>>,
    /// Over the last frame's meshes.
    meshes: MeshTree,
    pool: rayon::ThreadPool,
}

impl SoftwareRenderer {
    /// The longest core edge: padded bricks then stay below 2^31 voxels.
    pub const MAX_EDGE: u32 = 1024;

    /// Makes as many slots as the budget allows; a slot takes memory once it holds a brick.
    ///
    /// # Errors
    /// If the budget holds not one slot, the bricks are too large, or the threads do not start.
    ///
    /// # Panics
    /// If there is no apron: bricks would show their seams.
    pub fn new(options: SoftwareOptions) -> Result<Self, SoftwareError> {
        let SoftwareOptions { edge, needs, memory_bytes, threads, .. } = options;
        assert!(needs.apron >= needs.filter.taps(), "samples need an apron");
        if !(1..=Self::MAX_EDGE).contains(&edge) {
            return Err(SoftwareError::Edge { edge });
        }
        let fixed_bytes = fixed_bytes(&options);
        let each = bytes_per_slot(&options);
        let count = memory_bytes.saturating_sub(fixed_bytes) / each;
        if count == 0 {
            return Err(SoftwareError::Budget { given_bytes: memory_bytes, least_bytes: fixed_bytes + each });
        }
        let pool = pool(threads)?;
        let slots = Slots::new(count.min(u32::MAX as u64) as u32);
        Ok(Self { options, slots, fixed_bytes, visibility: None, meshes: MeshTree::default(), pool })
    }

    /// How many bricks it holds at once.
    pub fn slots(&self) -> u32 {
        self.slots.len()
    }

    /// What it takes when every slot is full, drawing included; at most the budget.
    pub fn bytes(&self) -> u64 {
        self.fixed_bytes + self.slots() as u64 * bytes_per_slot(&self.options)
    }

    /// Puts a padded brick into a slot: `(edge + 2 * apron)^3` little-endian codes, x fastest, and stored gradients behind them if
    /// pictures need some. Nothing is copied; the codes are read once, for the macro-cells.
    ///
    /// # Panics
    /// If there is no such slot or the length is not a padded brick's.
    pub fn upload(&mut self, slot: Slot, codes: Arc<[u8]>) {
        self.slots.upload(&self.options, slot, codes);
    }

    /// Draws the list. Costs time in proportion to the samples taken; the draw list may not be longer than
    /// [`SoftwareRenderer::slots`] for the byte account to hold.
    ///
    /// # Panics
    /// If the list names a slot that was never uploaded, or settings, pyramid and options do not belong together.
    pub fn render(&mut self, settings: &FrameSettings, pyramid: &Pyramid, list: &DrawList) -> Picture {
        let SoftwareOptions { encoding, edge, needs, max_picture_px, .. } = self.options;
        let (width, height) = (settings.rays.width, settings.rays.height);
        assert!(width <= max_picture_px[0] && height <= max_picture_px[1], "the picture is larger than was agreed");
        assert_eq!(edge, pyramid.edge(), "other bricks");
        assert_eq!(encoding, settings.encoding, "other codes");
        assert!(needs.satisfy(&settings.needs()), "{:?} of bricks for {needs:?}", settings.needs());
        assert!(settings.placement.is_identity(), "one volume is drawn in its own world");
        if !self.meshes.is_of(&settings.meshes) {
            // The old one goes first: both together would pass the budget.
            self.meshes = MeshTree::default();
            self.meshes = self.pool.install(|| MeshTree::new(&settings.meshes));
        }
        let tiles: Vec<Tile> = tile::tiles(width, height).collect();
        let (drawn, light): (Vec<TilePixels>, _) = self.pool.install(|| {
            let mut frame = Frame::new(settings, pyramid, list, &needs, |slot| self.slots.brick(slot));
            frame.meshes = (!settings.meshes.is_empty()).then_some(&self.meshes);
            let draw = tile::for_frame(&frame);
            (tiles.par_iter().map(|t| draw(&frame, t)).collect(), frame.light)
        });
        let occludes = occludes(settings.mode);
        self.visibility = occludes.then(|| light.iter().map(|l| f32::from_bits(l.load(Ordering::Relaxed))).collect());
        tile::picture((width, height), &tiles, &drawn)
    }

    /// For each entry of the list drawn last, in its order, the greatest transmittance with which a ray entered its cell: 1
    /// where nothing is in front, 0 where no ray came because the light had been used up, or the cell is out of view. `None`
    /// after projections, in which nothing hides anything, and before the first picture.
    pub fn visibility(&self) -> Option<&[f32]> {
        self.visibility.as_deref()
    }
}

/// Places for bricks; one takes memory once it holds a brick.
#[derive(Debug)]
pub(crate) struct Slots(Vec<Option<Resident>>);

impl Slots {
    pub(crate) fn new(count: u32) -> Self {
        let mut slots = Vec::new();
        slots.resize_with(count as usize, || None);
        Self(slots)
    }

    pub(crate) fn len(&self) -> u32 {
        self.0.len() as u32
    }

    /// See [`SoftwareRenderer::upload`].
    pub(crate) fn upload(&mut self, options: &SoftwareOptions, slot: Slot, codes: Arc<[u8]>) {
        assert_eq!(codes.len() as u64, slot_bytes(options), "not a padded brick");
        let SoftwareOptions { encoding, edge, needs, leaps, .. } = *options;
        let voxels = &codes[..voxel_bytes(options) as usize];
        let cells = match leaps {
            true => MacroCells::new(voxels, encoding.format, encoding.has_invalid, edge as usize, needs),
            false => MacroCells::of_anything(encoding.format, edge as usize),
        };
        self.0[slot.0 as usize] = Some(Resident::new(codes, voxel_bytes(options) as usize, cells));
    }

    pub(crate) fn brick(&self, slot: Slot) -> &Resident {
        self.0[slot.0 as usize].as_ref().unwrap_or_else(|| panic!("slot {} holds no brick", slot.0))
    }
}

/// The threads that draw.
pub(crate) fn pool(threads: usize) -> Result<rayon::ThreadPool, SoftwareError> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads.max(1)).thread_name(|i| format!("draw-{i}"));
    pool.build().map_err(|source| SoftwareError::Threads { threads, source })
}

fn voxel_bytes(options: &SoftwareOptions) -> u64 {
    (options.edge as u64 + 2 * options.needs.apron as u64).pow(3) * options.encoding.format.bytes() as u64
}

fn slot_bytes(options: &SoftwareOptions) -> u64 {
    voxel_bytes(options) + options.needs.gradients(options.edge).bytes() as u64
}

/// A slot's voxels and macro-cells, the handle to them, and the cell that draws them with its mask or
/// extremes and its light.
pub(crate) fn bytes_per_slot(options: &SoftwareOptions) -> u64 {
    let edge = options.edge as usize;
    let cells = macrocells::bytes(edge);
    let mask = boxes(edge) * size_of::<u16>();
    let light = size_of::<AtomicU32>() + size_of::<f32>();
    slot_bytes(options) + (cells + mask + light + size_of::<Option<Resident>>() + size_of::<Cell<'_>>()) as u64
}

/// The picture as tiles and as rows, what steps do, the table of values and gradients, the meshes' tree, and every thread's rays.
pub(crate) fn fixed_bytes(options: &SoftwareOptions) -> u64 {
    let tiles: u64 = options.max_picture_px.iter().map(|&n| n.div_ceil(TILE_PX) as u64).product();
    let tile = (size_of::<TilePixels>() + size_of::<Tile>()) as u64;
    let picture = options.max_picture_px.iter().map(|&n| n as u64).product::<u64>() * 3;
    let steps = steps::bytes(options.encoding.format, MAX_ZONES) as u64;
    let rows = TransferGrid::most_rows(options.encoding.format.max_code() + 1);
    let entries = if options.needs.has_grid { rows * TransferGrid::COLUMNS } else { 0 };
    let grid = (entries * size_of::<[f32; 4]>()) as u64;
    let room = options.needs.meshes;
    let layers = if room.is_none() { 0 } else { meshes::BYTES_PER_THREAD };
    let of_threads = options.threads.max(1) as u64 * (tile::BYTES_PER_THREAD + layers);
    tiles * tile + picture + steps + grid + meshes::bytes(room) + of_threads
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_volume::VoxelType;

    fn options(memory_bytes: u64) -> SoftwareOptions {
        let encoding = SlotEncoding::new(VoxelType::U16, (0.0, 1.0), false);
        SoftwareOptions {
            encoding,
            edge: 32,
            needs: Needs::PLAIN,
            memory_bytes,
            max_picture_px: [640, 481],
            threads: 2,
            leaps: true,
        }
    }

    #[test]
    fn the_budget_holds_and_its_least_is_enough() {
        let Err(SoftwareError::Budget { given_bytes: 1000, least_bytes }) = SoftwareRenderer::new(options(1000)) else {
            panic!("1000 bytes cannot be enough");
        };
        assert!(SoftwareRenderer::new(options(least_bytes - 1)).is_err());
        assert_eq!(SoftwareRenderer::new(options(least_bytes)).unwrap().slots(), 1);
        for budget in [least_bytes, 10 << 20, 64 << 20] {
            let renderer = SoftwareRenderer::new(options(budget)).unwrap();
            assert!(renderer.bytes() <= budget);
            assert!(renderer.bytes() + bytes_per_slot(&renderer.options) > budget, "a slot was left unused");
        }
    }

    #[test]
    fn impossible_bricks_are_refused() {
        for edge in [0, 1025] {
            let refused = SoftwareRenderer::new(SoftwareOptions { edge, ..options(1 << 40) });
            assert!(matches!(refused, Err(SoftwareError::Edge { edge: e }) if e == edge));
        }
    }
}
