//! The renderer itself: slots in RAM within a byte budget, and pictures of layers' draw lists over them.

use crate::frame::{Frame, is_plain_fog};
use crate::march::Work;
use crate::meshes::MeshTree;
use crate::options::SoftwareOptions;
use crate::painting::Painting;
use crate::slots::{Slots, bytes_per_slot, fixed_bytes};
use crate::tile::Scene;
use crate::tiles::{self, Tile, TilePixels};
use brickyard_pager::{BudgetRequest, Layer, Slot, VolumeNeeds, pools, share};
use brickyard_volume::numbers::mebibytes;
use brickyard_volume::{Clip, Combination, FrameSettings, Geometry, Picture, PixelRect, Placement, Pyramid};
use rayon::prelude::*;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Instant;

/// An error of creating or using a renderer.
#[derive(Debug, thiserror::Error)]
pub enum SoftwareError {
    /// The budget does not hold one slot, or the layers' least number of slots.
    #[error(
        "{} of memory for slots hold no brick: the CPU needs at least {} here", mebibytes(*given_bytes), mebibytes(*least_bytes)
    )]
    Budget {
        /// The given budget, in bytes.
        given_bytes: u64,
        /// The least sufficient budget, in bytes.
        least_bytes: u64,
    },
    /// The bricks' cores have no voxels, or more than can be indexed.
    #[error("bricks of {edge} voxels an edge cannot be drawn: expected 1 to {}", SoftwareRenderer::MAX_EDGE)]
    Edge {
        /// The requested edge, in voxels.
        edge: u32,
    },
    /// The operating system provides no threads.
    #[error("cannot start {threads} drawing threads: {source}")]
    Threads {
        /// The requested number of threads.
        threads: usize,
        /// The system's error.
        source: rayon::ThreadPoolBuildError,
    },
    /// A picture was abandoned while being drawn: see [`Painting::abandon`].
    #[error("the picture was abandoned")]
    Abandoned,
    /// A picture was not finished in the allowed time: see [`SoftwareRenderer::draw_until`].
    #[error("the picture was not drawn in the time allowed")]
    TooLong,
    /// The caller passed layers, frames, lists or bricks that do not belong to the renderer: a programming error.
    #[error("the CPU renderer was given {0}")]
    Mismatch(String),
}

/// Returns the problem unless `is_right`.
fn expect(is_right: bool, what: impl FnOnce() -> String) -> Result<(), SoftwareError> {
    if is_right { Ok(()) } else { Err(SoftwareError::Mismatch(what())) }
}

/// The CPU renderer: pools of slots in RAM, and threads that draw layers from them.
#[derive(Debug)]
pub struct SoftwareRenderer {
    options: SoftwareOptions,
    layers: Vec<VolumeNeeds>,
    /// The number of each layer's pool.
    pool_of: Vec<usize>,
    pools: Vec<Slots>,
    bytes: u64,
    /// By layer; empty for projections.
    visibility: Vec<Vec<f32>>,
    meshes: MeshTree,
    /// The deadline, if any.
    until: Option<Instant>,
    /// The drawn part of the picture; `None` for all of it.
    window: Option<PixelRect>,
    painting: Option<Arc<Painting>>,
    threads: rayon::ThreadPool,
}

impl SoftwareRenderer {
    /// The longest edge of a brick's core, in voxels. Padded bricks then stay below 2^31 voxels.
    pub const MAX_EDGE: u32 = 1024;

    /// Creates a renderer for these layers, and divides its budget among the layers' pools of slots (see [`pools`]). A
    /// slot takes memory once it holds a brick.
    ///
    /// # Errors
    /// If the budget does not hold the least that each layer needs (one slot for a single layer), the bricks' edge is
    /// out of range, or the threads do not start. Also if there is no layer, or the bricks' apron is too narrow for the
    /// samples, which would show seams.
    pub fn new(layers: &[VolumeNeeds], options: &SoftwareOptions) -> Result<Self, SoftwareError> {
        expect(!layers.is_empty(), || "no layer".into())?;
        for VolumeNeeds { edge, bricks, .. } in layers {
            let (apron, taps) = (bricks.apron, bricks.filter.taps());
            expect(apron >= taps, || format!("bricks with an apron of {apron}, whose samples need {taps}"))?;
            if !(1..=Self::MAX_EDGE).contains(edge) {
                return Err(SoftwareError::Edge { edge: *edge });
            }
        }
        let (fixed_bytes, are_several) = (fixed_bytes(layers, options), layers.len() > 1);
        let pool_of = pools(layers);
        let request = |(pool, needs): (usize, &VolumeNeeds)| {
            let members = || layers.iter().zip(&pool_of).filter(move |(_, of)| **of == pool).map(|(needs, _)| needs);
            BudgetRequest {
                bytes: bytes_per_slot(needs, options, are_several),
                least: if are_several { members().map(|needs| needs.least_slots as u64).sum() } else { 1 },
                most: members().map(|needs| needs.most_slots as u64).sum(),
            }
        };
        // The first layer of each pool.
        let firsts = (0..layers.len()).filter(|&i| !pool_of[..i].contains(&pool_of[i])).map(|i| &layers[i]);
        let requests: Vec<BudgetRequest> = firsts.clone().enumerate().map(request).collect();
        let too_little = |least: u64| SoftwareError::Budget {
            given_bytes: options.memory_bytes,
            least_bytes: fixed_bytes.saturating_add(least),
        };
        let shares = share(options.memory_bytes.saturating_sub(fixed_bytes), &requests).map_err(too_little)?;
        let used: u64 = shares.iter().zip(&requests).map(|(count, request)| count * request.bytes).sum();
        if fixed_bytes + used > options.memory_bytes {
            return Err(too_little(used));
        }
        let slots = firsts.zip(shares);
        let slots =
            slots.map(|(needs, count)| Slots::new(needs, options.skips_empty, count.min(u32::MAX as u64) as u32));
        let threads = rayon::ThreadPoolBuilder::new().num_threads(options.threads.max(1));
        let threads = threads.thread_name(|i| format!("draw-{i}")).build();
        Ok(Self {
            options: *options,
            pools: slots.collect(),
            layers: layers.to_vec(),
            pool_of,
            bytes: fixed_bytes + used,
            visibility: Vec::new(),
            meshes: MeshTree::default(),
            until: None,
            window: None,
            painting: None,
            threads: threads.map_err(|source| SoftwareError::Threads { threads: options.threads, source })?,
        })
    }

    /// The number of slots in a layer's pool, shared by all layers of the pool.
    ///
    /// # Panics
    /// If there is no such layer.
    pub fn slots(&self, layer: usize) -> u32 {
        self.pools[self.pool_of[layer]].len()
    }

    /// Sets a deadline: pictures unfinished at this time are given up; `None` gives none up.
    pub fn draw_until(&mut self, until: Option<Instant>) {
        self.until = until;
    }

    /// Draws from now on only these pixels, and others of their tiles; others are black. `None` draws all.
    pub fn draw_within(&mut self, window: Option<PixelRect>) {
        self.window = window;
    }

    /// Shows pictures on this painting from now on, while drawing them, and stops if it is abandoned; `None` shows
    /// nothing.
    pub fn draw_on(&mut self, painting: Option<Arc<Painting>>) {
        self.painting = painting;
    }

    /// The renderer's bytes with every slot full, drawing included; at most the budget.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Puts a layer's padded brick into a slot of the layer's pool: `(edge + 2 * apron)^3` little-endian codes, x
    /// fastest, followed by any stored gradients. Nothing is copied; if empty space is skipped, the codes are read
    /// once, for the macro-cells. Returns the slot's former codes, whose memory may serve another brick.
    ///
    /// # Errors
    /// If there is no such layer or slot, or the length is not a padded brick's.
    pub fn upload(&mut self, layer: usize, slot: Slot, codes: Arc<[u8]>) -> Result<Option<Arc<[u8]>>, SoftwareError> {
        let pool = self.pool_of.get(layer).and_then(|&pool| self.pools.get_mut(pool));
        let Some(pool) = pool else { return Err(SoftwareError::Mismatch(format!("a brick of layer {layer}"))) };
        let (bytes, slots) = (codes.len(), pool.len());
        expect(slot.0 < slots && pool.is_padded_brick(&codes), || {
            format!("a brick of {bytes} bytes for slot {} of {slots}", slot.0)
        })?;
        Ok(pool.upload(slot, codes))
    }

    /// Draws layers, or an expression over them. Other layers of the renderer are left out. The time is proportional to
    /// the samples taken. For the byte account to hold, no draw list may be longer than [`SoftwareRenderer::slots`].
    ///
    /// # Errors
    /// If there are no layers, they are not in ascending order, or one is not the renderer's; if the picture exceeds
    /// the agreed size; if a list uses a slot without a brick; if frames, pyramids and needs do not belong together; if
    /// a layer read by an expression has surfaces, is classified by value and gradient, or is drawn by another mode or
    /// method than the plain one; if the [deadline](SoftwareRenderer::draw_until) has passed; or if it was
    /// [abandoned](Painting::abandon).
    pub fn render(
        &mut self,
        layers: &[Layer<'_>],
        combination: Option<&Combination>,
    ) -> Result<Picture, SoftwareError> {
        self.check(layers, combination.is_some())?;
        let settings = &layers[0].frame.settings;
        let size = (settings.rays.width, settings.rays.height);
        if !self.meshes.is_of(&settings.meshes) {
            // The old one goes first: both together would exceed the budget.
            self.meshes = MeshTree::default();
            self.meshes = self.threads.install(|| MeshTree::new(&settings.meshes));
        }
        let is_within = |tile: &Tile| self.window.is_none_or(|window| window.meets(tile));
        let tiles: Vec<Tile> = tiles::tiles(size.0, size.1).filter(is_within).collect();
        let is_mixed = is_mixed(layers, combination);
        let meshes = (!settings.meshes.is_empty()).then_some(&self.meshes);
        let (drawn, visibility) = self.threads.install(|| {
            let by_itself = !is_mixed || settings.mode.is_projection();
            let slots = |layer: &Layer<'_>| &self.pools[self.pool_of[layer.volume]];
            let (until, painting) = (self.until, self.painting.as_deref());
            painting.into_iter().for_each(|painting| painting.begin(size, tiles.len()));
            let of_layer = |layer| Frame { until, painting, ..frame(layer, slots(layer), by_itself) };
            let frames = layers.iter().map(of_layer).collect();
            let scene = Scene::new(frames, meshes, is_mixed, is_one_cut(layers), combination);
            let kept = painting.and_then(Painting::kept);
            let draw = |work: &mut Box<Work>, tile: &Tile| {
                let before = kept.as_ref().and_then(|kept| kept.get(tile));
                let drawn = before.unwrap_or_else(|| scene.draw(tile, work));
                // A picture given up meanwhile is incomplete.
                match painting {
                    Some(painting) if painting.is_abandoned() => return Err(SoftwareError::Abandoned),
                    _ if scene.frames()[0].is_given_up() => return Err(SoftwareError::TooLong),
                    painting => painting.into_iter().for_each(|painting| painting.put(size, tile, &drawn)),
                }
                kept.iter().filter(|_| before.is_none()).for_each(|kept| kept.put(tile, &drawn));
                Ok(drawn)
            };
            let drawn: Result<Vec<TilePixels>, SoftwareError> = tiles.par_iter().map_init(Work::new, draw).collect();
            let light = |frame: &Frame<'_>| -> Vec<f32> {
                frame.light.iter().map(|light| f32::from_bits(light.load(Ordering::Relaxed))).collect()
            };
            (drawn, scene.frames().iter().map(light).collect::<Vec<_>>())
        });
        self.visibility = Vec::new();
        let drawn = drawn?;
        if !settings.mode.is_projection() {
            self.visibility.resize(self.layers.len(), Vec::new());
            layers.iter().zip(visibility).for_each(|(layer, light)| self.visibility[layer.volume] = light);
        }
        Ok(tiles::picture(size, &tiles, &drawn))
    }

    /// Checks that layers can be drawn, as an expression's operands (`are_read`) or themselves.
    fn check(&self, layers: &[Layer<'_>], are_read: bool) -> Result<(), SoftwareError> {
        let is_ordered = !layers.is_empty() && layers.is_sorted_by(|a, b| a.volume < b.volume);
        expect(is_ordered && layers.iter().all(|layer| layer.volume < self.layers.len()), || {
            let numbers: Vec<usize> = layers.iter().map(|layer| layer.volume).collect();
            format!("layers {numbers:?}, in this order, of {}", self.layers.len())
        })?;
        let [width, height] = self.options.max_picture_px;
        for layer in layers {
            check(layer, &self.layers[layer.volume], are_read)?;
            let rays = &layer.frame.settings.rays;
            expect(rays.width <= width && rays.height <= height, || {
                format!("a picture of {}x{} pixels, where {width}x{height} were agreed", rays.width, rays.height)
            })?;
            let slots = &self.pools[self.pool_of[layer.volume]];
            let missing = layer.draw.cells.iter().map(|cell| cell.slot).find(|&slot| !slots.has_brick(slot));
            if let Some(Slot(slot)) = missing {
                return Err(SoftwareError::Mismatch(format!("a list with slot {slot}, which holds no brick")));
            }
        }
        Ok(())
    }

    /// For each entry of a layer's draw list in the last picture, in order, the greatest transmittance with which a ray
    /// entered the cell. It is 1 with nothing in front of the cell, 0 if no ray came because the light was used up or
    /// the cell is out of view. Empty if the picture left the layer out. `None` after projections, where nothing hides
    /// anything, before the first picture, and if there is no such layer.
    pub fn visibility(&self, layer: usize) -> Option<&[f32]> {
        self.visibility.get(layer).map(Vec::as_slice)
    }
}

fn frame<'a>(layer: &Layer<'a>, slots: &'a Slots, by_itself: bool) -> Frame<'a> {
    let brick = |slot| slots.brick(slot);
    Frame::new(layer.frame, layer.pyramid, layer.draw, &slots.needs.bricks, by_itself, brick)
}

/// Whether the layers need more than the loops for a single layer.
fn is_mixed(layers: &[Layer<'_>], combination: Option<&Combination>) -> bool {
    combination.is_some() || !matches!(layers, [layer] if layer.frame.is_plain())
}

/// Whether the layers' draw lists are of one cut, which all rays meet alike.
fn is_one_cut(layers: &[Layer<'_>]) -> bool {
    fn view<'a>(layer: &Layer<'a>) -> (u32, &'a Geometry, &'a Placement, &'a Option<Clip>, &'a Pyramid) {
        let FrameSettings { geometry, placement, clip, .. } = &layer.frame.settings;
        (layer.cut, geometry, placement, clip, layer.pyramid)
    }
    layers[1..].iter().all(|layer| view(layer) == view(&layers[0]))
}

fn check(layer: &Layer<'_>, needs: &VolumeNeeds, is_read: bool) -> Result<(), SoftwareError> {
    let settings = &layer.frame.settings;
    let edge = layer.pyramid.edge();
    expect(needs.edge == edge && needs.encoding.of_slots() == settings.encoding.of_slots(), || {
        format!(
            "a frame of {:?} in bricks of {edge}: it was made for {:?} in bricks of {}",
            settings.encoding, needs.encoding, needs.edge
        )
    })?;
    let (asked, given) = (settings.needs(), needs.bricks);
    expect(given.satisfy(&asked), || format!("a frame of {asked:?}: its bricks have {given:?}"))?;
    expect(!is_read || is_plain_fog(settings), || "an expression over other than values, sampled plainly".into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_volume::{Needs, SlotEncoding, VoxelType};

    fn needs(edge: u32) -> VolumeNeeds {
        VolumeNeeds {
            encoding: SlotEncoding::new(VoxelType::U16, (0.0, 1.0), false),
            edge,
            levels: 1,
            bricks: Needs::PLAIN,
            least_slots: 2,
            most_slots: u32::MAX,
        }
    }

    fn options(memory_bytes: u64) -> SoftwareOptions {
        SoftwareOptions { memory_bytes, max_picture_px: [640, 481], threads: 2, skips_empty: true }
    }

    #[test]
    fn the_budget_holds_and_its_least_is_enough() {
        for layers in [vec![needs(32)], vec![needs(32), needs(16)]] {
            let least_slots = layers.len() as u32;
            let with = |memory_bytes| SoftwareRenderer::new(&layers, &options(memory_bytes));
            let Err(SoftwareError::Budget { given_bytes: 1000, least_bytes }) = with(1000) else {
                panic!("1000 bytes cannot be enough");
            };
            assert!(with(least_bytes - 1).is_err());
            assert_eq!(with(least_bytes).unwrap().slots(0), least_slots);
            let largest = bytes_per_slot(&layers[0], &options(0), layers.len() > 1);
            for budget in [least_bytes, 10 << 20, 64 << 20] {
                let renderer = with(budget).unwrap();
                assert!(renderer.bytes() <= budget);
                assert!(renderer.bytes() + layers.len() as u64 * largest > budget, "a slot was left unused");
            }
        }
    }

    #[test]
    fn impossible_bricks_are_refused() {
        for edge in [0, 1025] {
            let refused = SoftwareRenderer::new(&[needs(edge)], &options(1 << 40));
            assert!(matches!(refused, Err(SoftwareError::Edge { edge: e }) if e == edge));
        }
    }
}
