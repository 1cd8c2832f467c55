//! The GPU budget: the picture's targets, tables, staging and read-back come first; pools of slots get the rest, each
//! slot with the compositor's data for it.

use crate::GpuError;
use crate::adapter::{DISPLAY_FORMAT, GpuFormats};
use crate::atlas::{AtlasPlan, slot_bytes, texel_bytes};
use crate::buffers::TIMESTAMP_BYTES;
use crate::transfer_table::{COMBINED, TableCapacity};
use crate::upload::{MAX_BATCH, staging_bytes};
use brickyard_pager::{BudgetRequest, VolumeNeeds, pools, share};
use brickyard_shaders::{CellBrick, CellInstance, FrameUniform, MeshLook, MeshVertex};
use brickyard_volume::{MeshCapacity, OpaqueCodes, SlotFormat};
use wgpu::TextureFormat;

/// Most bricks of cells, of all layers, per submission of `sorted`. Longer draw lists take several, so that no watchdog
/// sees a hang.
pub(crate) const CELLS_PER_SUBMISSION: usize = 1024;
/// Most answers about pictures in flight: as many as a swap chain lets a program be frames ahead.
pub(crate) const ANSWERS: u64 = 3;
/// Most layers of meshes peeled without waiting for their counts.
pub(crate) const MOST_LAYERS: u32 = 64;
pub(crate) const COUNTS_BYTES: u64 = MOST_LAYERS as u64 * 8;
/// Fewest slots for a layer: with fewer than two, a picture cannot be refined at all.
pub(crate) const MIN_SLOTS: u32 = 2;

/// Division of the GPU memory budget.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct MemoryPlan {
    pub(crate) pools: Vec<PoolPlan>,
    /// Index of each layer's pool.
    pub(crate) pool_of: Vec<usize>,
    /// Bricks of a pool per upload submission.
    pub(crate) batch: u64,
    /// Number of upload batches with staging memory at once.
    pub(crate) batches: u64,
    /// Bytes independent of the number of slots.
    pub(crate) fixed_bytes: u64,
}

/// A pool's share of the GPU memory budget.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct PoolPlan {
    pub(crate) atlas: AtlasPlan,
    /// Least number of slots for drawing anything.
    pub(crate) least: u64,
    /// The sizes behind the buffers for rays; `None` if the compositor casts none.
    pub(crate) raycast: Option<RaycastPlan>,
    /// Bytes kept by the compositor beside each slot.
    pub(crate) beside_bytes: u64,
}

/// The sizes behind a pool's share of the buffers for rays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RaycastPlan {
    /// Voxels along a core's edge.
    pub(crate) edge: u32,
    /// Most octree levels of any layer.
    pub(crate) levels: u32,
    /// Number of layers with bricks in the pool.
    pub(crate) layers: u32,
    pub(crate) skips_empty: bool,
}

impl RaycastPlan {
    /// Returns the bytes per slot beside the atlas: macro-cells, the code range on the host, its share of the octrees
    /// (twice, for staging), and its share of the marks (in answers and on the host too).
    pub(crate) fn bytes_per_slot(&self) -> u64 {
        self.list_bytes(1) - self.list_bytes(0) + self.ranges_bytes(1) + size_of::<[u16; 2]>() as u64
    }

    /// Returns the bytes that grow with draw lists: octrees, their bricks and marks. 0 slots give the octrees' roots.
    pub(crate) fn list_bytes(&self, slots: u32) -> u64 {
        2 * (self.nodes_bytes(slots) + self.bricks_bytes(slots)) + (2 + ANSWERS) * self.marks_bytes(slots)
    }

    /// Returns the most slots with buffers within `max_binding_bytes`.
    pub(crate) fn max_slots(&self, max_binding_bytes: u64) -> u64 {
        let each = self.ranges_bytes(1).max(self.bricks_bytes(1) - self.bricks_bytes(0));
        max_binding_bytes.saturating_sub(self.bricks_bytes(0)) / each
    }
}

pub(crate) fn opaque_bytes(codes: SlotFormat) -> u64 {
    OpaqueCodes::most(codes) as u64 * 4
}

/// Input of a memory plan.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MemoryNeeds<'a> {
    pub(crate) formats: GpuFormats,
    pub(crate) layers: &'a [VolumeNeeds],
    /// The most slots for each pool; empty unless the device has refused more.
    pub(crate) most_slots: &'a [u32],
    pub(crate) budget_bytes: u64,
    pub(crate) max_size_px: (u32, u32),
    pub(crate) max_texture_3d: u32,
    /// The largest buffer visible to a shader, bytes.
    pub(crate) max_binding_bytes: u64,
    /// Whether rays skip empty space; `None` if no compositor casts any.
    pub(crate) casts_rays: Option<bool>,
    /// Whether a compositor draws cells as boxes.
    pub(crate) draws_boxes: bool,
    /// Whether to reserve the transfer table of an expression over layers.
    pub(crate) has_expressions: bool,
    /// Whether to reserve the left eye's picture, as on an application's device.
    pub(crate) has_two_eyes: bool,
    pub(crate) batches: u64,
}

/// Alignment gaps in shared buffers per layer, bytes: parts begin where any device can bind them.
const GAP_BYTES: u64 = 4 * PART_BYTES;

/// Alignment of the parts of shared buffers, bytes.
pub(crate) const PART_BYTES: u64 = 256;

/// A pool's demand for memory.
struct Ask {
    slot_edge: u32,
    slot_bytes: u64,
    beside_bytes: u64,
    staging_bytes: u64,
    fixed_bytes: u64,
    most: u64,
    least: u64,
    raycast: Option<RaycastPlan>,
}

/// Returns the bytes of a row of the read-back buffer, padded as copies require.
pub(crate) fn read_back_row_bytes(width_px: u32) -> u64 {
    (width_px as u64 * texel_bytes(DISPLAY_FORMAT)).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as u64)
}

/// Returns the bytes of a pixel in a picture's targets: gathered samples, the two sums of joined projections, and the
/// finished picture.
pub(crate) fn pixel_bytes(gathered: u64, formats: &GpuFormats, is_joined: bool) -> u64 {
    let sums = if is_joined { 2 * texel_bytes(formats.composite) } else { 0 };
    gathered + sums + texel_bytes(DISPLAY_FORMAT)
}

/// Returns the bytes of a picture's targets, read-back buffer and answers. `is_joined` adds the two sums of joined
/// projections.
pub(crate) fn picture_bytes(formats: &GpuFormats, (width_px, height_px): (u32, u32), is_joined: bool) -> u64 {
    let pixels = width_px as u64 * height_px as u64;
    let gather = texel_bytes(formats.composite).max(texel_bytes(formats.project));
    pixels * pixel_bytes(gather, formats, is_joined)
        + read_back_row_bytes(width_px) * height_px as u64
        + (1 + ANSWERS) * TIMESTAMP_BYTES
        + ANSWERS * COUNTS_BYTES
}

/// Format of the colours of a layer of meshes, finer than a picture's.
pub(crate) const COLOR_FORMAT: TextureFormat = TextureFormat::Rgba16Float;

/// Format of distances to a layer of meshes, as shares of [`Meshes::far`](crate::meshes::Meshes::far).
pub(crate) const DEPTH_FORMAT: TextureFormat = TextureFormat::Depth32Float;

/// Format of the triangle number in each pixel of a layer of meshes.
pub(crate) const NUMBER_FORMAT: TextureFormat = TextureFormat::R32Uint;

/// Returns the bytes of the meshes on the GPU: vertices, triangles, and looks.
pub(crate) fn geometry_bytes(room: MeshCapacity) -> [u64; 3] {
    let each = [size_of::<MeshVertex>(), 3 * size_of::<u32>(), size_of::<MeshLook>()];
    let counts = [room.vertices, room.triangles, room.meshes];
    std::array::from_fn(|i| each[i] as u64 * counts[i] as u64)
}

/// Returns the total bytes of meshes: vertices, triangles and looks on the GPU and in staging, the counts of layers,
/// and per pixel two distances, two numbers, a layer's colour and the colour in front, of format `front`. 0 without
/// meshes.
pub(crate) fn mesh_bytes(room: MeshCapacity, pixels: u64, front: TextureFormat) -> u64 {
    if room.is_none() {
        return 0;
    }
    let per_layer = texel_bytes(DEPTH_FORMAT) + texel_bytes(NUMBER_FORMAT);
    let per_pixel = 2 * per_layer + texel_bytes(COLOR_FORMAT) + texel_bytes(front);
    2 * geometry_bytes(room).iter().sum::<u64>() + 2 * COUNTS_BYTES + pixels * per_pixel
}

impl MemoryNeeds<'_> {
    /// Returns the requirements of one of `pools` pools, with these layers and at most `most_slots` slots.
    fn ask(&self, layers: &[&VolumeNeeds], most_slots: u32, pools: usize) -> Ask {
        // All of them have such bricks.
        let VolumeNeeds { encoding, edge, bricks, .. } = *layers[0];
        let (codes, gradients) = (encoding.format, bricks.gradients(edge));
        let (slot_edge, format) = (edge + 2 * bricks.apron, self.formats.atlas(codes));
        let levels = layers.iter().map(|layer| layer.levels).max().unwrap_or(0);
        let raycast =
            self.casts_rays.map(|skips_empty| RaycastPlan { edge, levels, layers: layers.len() as u32, skips_empty });
        let bindable = raycast.map_or(u64::MAX, |plan| plan.max_slots(self.max_binding_bytes / pools as u64));
        // A single layer can be drawn in passes, with any number of slots.
        let is_alone = self.layers.len() == 1;
        let least = |layer: &VolumeNeeds| {
            let least = if is_alone { MIN_SLOTS } else { layer.least_slots.max(MIN_SLOTS) };
            least.min(layer.most_slots) as u64
        };
        Ask {
            slot_edge,
            slot_bytes: slot_bytes(slot_edge, format, gradients),
            beside_bytes: raycast.map_or(0, |plan| plan.bytes_per_slot()),
            staging_bytes: staging_bytes(slot_edge, format, gradients) + raycast.map_or(0, |plan| plan.ranges_bytes(1)),
            fixed_bytes: raycast.map_or(0, |plan| plan.list_bytes(0)) + GAP_BYTES,
            most: bindable.min(most_slots as u64).min(layers.iter().map(|layer| layer.most_slots as u64).sum()),
            least: layers.iter().map(|layer| least(layer)).sum(),
            raycast,
        }
    }

    /// A layer's bytes independent of slots: tables, counts of opaque entries on the GPU, on the host and in staging,
    /// its frame.
    fn layer_bytes(&self, layer: &VolumeNeeds) -> u64 {
        let codes = layer.encoding.format;
        let counts = if self.casts_rays.is_some() { 3 * opaque_bytes(codes) } else { 0 };
        TableCapacity::new(codes, &layer.bricks).bytes_staged() + counts + GAP_BYTES + size_of::<FrameUniform>() as u64
    }

    /// All bytes independent of slots and batches.
    fn small_bytes(&self, asks: &[Ask]) -> Result<u64, GpuError> {
        let pixels = u64::from(self.max_size_px.0) * u64::from(self.max_size_px.1);
        let room = self.layers[0].bricks.meshes;
        let largest = geometry_bytes(room).into_iter().fold(0, u64::max);
        if largest > self.max_binding_bytes {
            return Err(GpuError::Meshes { bytes: largest, limit_bytes: self.max_binding_bytes });
        }
        let boxes = match self.draws_boxes {
            true => (CELLS_PER_SUBMISSION * (size_of::<CellInstance>() + size_of::<CellBrick>())) as u64,
            false => 0,
        };
        let combined = if self.has_expressions { TableCapacity::of_places(COMBINED).bytes_staged() } else { 0 };
        let left_eye = if self.has_two_eyes { pixels * texel_bytes(DISPLAY_FORMAT) } else { 0 };
        Ok(picture_bytes(&self.formats, self.max_size_px, self.layers.len() > 1)
            + left_eye
            + mesh_bytes(room, pixels, self.formats.composite)
            + boxes
            + combined
            + size_of::<FrameUniform>() as u64
            + self.layers.iter().map(|layer| self.layer_bytes(layer)).sum::<u64>()
            + asks.iter().map(|ask| ask.fixed_bytes).sum::<u64>())
    }
}

impl MemoryPlan {
    pub(crate) fn new(needs: &MemoryNeeds<'_>) -> Result<Self, GpuError> {
        let pool_of = pools(needs.layers);
        let mut members: Vec<Vec<&VolumeNeeds>> = Vec::new();
        for (layer, &pool) in needs.layers.iter().zip(&pool_of) {
            members.resize_with(members.len().max(pool + 1), Vec::new);
            members[pool].push(layer);
        }
        let most = needs.most_slots.iter().copied().chain(std::iter::repeat(u32::MAX));
        let asks: Vec<Ask> =
            members.iter().zip(most).map(|(layers, most)| needs.ask(layers, most, members.len())).collect();
        let small = needs.small_bytes(&asks)?;
        let staging: u64 = asks.iter().map(|ask| ask.staging_bytes).sum();
        // Together at most an eighth of the budget.
        let batches = needs.batches;
        let batch = (needs.budget_bytes / (8 * batches) / staging).clamp(1, MAX_BATCH);
        let fixed_bytes = small + batches * batch * staging;
        let request =
            |ask: &Ask| BudgetRequest { bytes: ask.slot_bytes + ask.beside_bytes, least: ask.least, most: ask.most };
        let requests: Vec<BudgetRequest> = asks.iter().map(request).collect();
        let least_slots_bytes: u64 = requests.iter().map(|request| request.least * request.bytes).sum();
        let too_little = || GpuError::Budget {
            given_bytes: needs.budget_bytes,
            least_bytes: small + batches * staging + least_slots_bytes,
            width_px: needs.max_size_px.0,
            height_px: needs.max_size_px.1,
            slot_edge: asks.iter().map(|ask| ask.slot_edge).max().unwrap_or(0),
        };
        let shares = share(needs.budget_bytes.saturating_sub(fixed_bytes), &requests).map_err(|_| too_little())?;
        let pool = |(ask, slots): (&Ask, u64)| {
            let most = u32::try_from(slots).unwrap_or(u32::MAX);
            let (each, edge) = (ask.slot_bytes, needs.max_texture_3d);
            let atlas = AtlasPlan::new(ask.slot_edge, each, slots * each, edge, most);
            let atlas = atlas.filter(|atlas| atlas.slots() as u64 >= ask.least).ok_or_else(too_little)?;
            Ok(PoolPlan { atlas, least: ask.least, raycast: ask.raycast, beside_bytes: ask.beside_bytes })
        };
        let pools = asks.iter().zip(shares).map(pool).collect::<Result<_, GpuError>>()?;
        Ok(Self { pools, pool_of, batch, batches, fixed_bytes })
    }

    /// Returns the most bytes the renderer may hold at once.
    pub(crate) fn bytes(&self) -> u64 {
        let of = |plan: &PoolPlan| plan.atlas.bytes + plan.atlas.slots() as u64 * plan.beside_bytes;
        self.fixed_bytes + self.pools.iter().map(of).sum::<u64>()
    }

    /// Returns the bytes of all pools' octrees, of the bricks in their leaves, and of the marks.
    pub(crate) fn list_bytes(&self) -> [u64; 3] {
        let casting = self.pools.iter().filter_map(|pool| Some((pool.raycast?, pool.atlas.slots())));
        casting.fold([0; 3], |[nodes, bricks, marks], (plan, slots)| {
            [nodes + plan.nodes_bytes(slots), bricks + plan.bricks_bytes(slots), marks + plan.marks_bytes(slots)]
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_volume::{Needs, SlotEncoding, VoxelType};

    const FORMATS: GpuFormats = GpuFormats {
        atlas_u8: TextureFormat::R16Unorm,
        atlas_u16: TextureFormat::R16Unorm,
        composite: TextureFormat::Rgba32Float,
        project: TextureFormat::Rg32Float,
    };

    #[test]
    fn half_floats_do_for_measurements_and_not_for_labels() {
        let halves = GpuFormats { atlas_u16: TextureFormat::R16Float, ..FORMATS };
        let labels = |voxel_type| SlotEncoding::of_labels(voxel_type, (0.0, 9.0), false, None);
        assert!(halves.tells_apart(&layer(VoxelType::U16).encoding) && halves.tells_apart(&labels(VoxelType::U8)));
        assert!(!halves.tells_apart(&labels(VoxelType::U16)) && FORMATS.tells_apart(&labels(VoxelType::U16)));
    }

    fn layer(voxel_type: VoxelType) -> VolumeNeeds {
        VolumeNeeds {
            encoding: SlotEncoding::new(voxel_type, (0.0, 1.0), false),
            edge: 64,
            levels: 9,
            bricks: Needs::PLAIN,
            least_slots: 2,
            most_slots: u32::MAX,
        }
    }

    fn needs(layers: &[VolumeNeeds], budget_bytes: u64) -> MemoryNeeds<'_> {
        MemoryNeeds {
            formats: FORMATS,
            layers,
            most_slots: &[],
            budget_bytes,
            max_size_px: (512, 512),
            max_texture_3d: 4096,
            max_binding_bytes: 128 << 20,
            casts_rays: None,
            draws_boxes: true,
            has_expressions: false,
            has_two_eyes: false,
            batches: 2,
        }
    }

    fn both(needs: MemoryNeeds<'_>) -> [MemoryNeeds<'_>; 2] {
        let needs = MemoryNeeds { has_expressions: needs.layers.len() > 1, ..needs };
        [needs, MemoryNeeds { casts_rays: Some(true), draws_boxes: false, ..needs }]
    }

    #[test]
    fn sixteen_mebibytes_hold_a_picture_and_ten_bricks() {
        for layers in [VoxelType::U8, VoxelType::U16].map(|voxel_type| [layer(voxel_type)]) {
            for needs in both(needs(&layers, 16 << 20)) {
                let plan = MemoryPlan::new(&needs).unwrap();
                assert!(plan.pools[0].atlas.slots() >= 10 && plan.bytes() <= 16 << 20, "{plan:?}");
            }
        }
    }

    #[test]
    fn the_least_that_works_works_and_a_byte_less_does_not() {
        let three =
            [layer(VoxelType::U8), VolumeNeeds { least_slots: 5, ..layer(VoxelType::U16) }, layer(VoxelType::U8)];
        // The first and the last share slots.
        for (layers, least) in [(&three[..1], &[2][..]), (&three, &[4, 5])] {
            for needs in both(needs(layers, 1 << 20)) {
                let Err(GpuError::Budget { least_bytes, .. }) = MemoryPlan::new(&needs) else { panic!("1 MiB") };
                let with = |budget_bytes| MemoryPlan::new(&MemoryNeeds { budget_bytes, ..needs });
                let plan = with(least_bytes).unwrap();
                assert_eq!(plan.pools.iter().map(|pool| pool.atlas.slots()).collect::<Vec<_>>(), least);
                assert!(with(least_bytes - 1).is_err());
            }
        }
    }

    #[test]
    fn no_budget_is_overspent() {
        let layers = [layer(VoxelType::U8), layer(VoxelType::U16)];
        for mebibytes in [26, 27, 40, 64, 100, 500, 1024, 5000] {
            for needs in
                both(needs(&layers, mebibytes << 20)).into_iter().chain(both(needs(&layers[..1], mebibytes << 20)))
            {
                let plan = MemoryPlan::new(&needs).unwrap();
                assert!(plan.bytes() <= mebibytes << 20, "{mebibytes}: {plan:?}");
            }
        }
    }

    #[test]
    fn gradients_are_paid_for() {
        let plain = layer(VoxelType::U8);
        let stored = VolumeNeeds { bricks: Needs { gradient_layers: 1, ..plain.bricks }, ..plain };
        for is_cast in [None, Some(true)] {
            let of = |layer: VolumeNeeds| {
                MemoryPlan::new(&MemoryNeeds {
                    casts_rays: is_cast,
                    draws_boxes: is_cast.is_none(),
                    ..needs(&[layer], 100 << 20)
                })
                .unwrap()
            };
            let (plain, stored) = (of(plain), of(stored));
            assert!(stored.bytes() <= 100 << 20);
            let (atlas, slot_bytes) = (stored.pools[0].atlas, 34 * 34 * 34 * 8 + 66 * 66 * 66 * 2);
            assert_eq!(atlas.bytes, atlas.slots() as u64 * slot_bytes);
            assert!(atlas.slots() * 10 < plain.pools[0].atlas.slots() * 8, "{stored:?} {plain:?}");
        }
    }

    #[test]
    fn meshes_are_paid_for_and_may_be_too_large() {
        let meshes = MeshCapacity { meshes: 2, vertices: 5_000, triangles: 10_000 };
        let of = |meshes| {
            let plain = layer(VoxelType::U8);
            MemoryPlan::new(&needs(&[VolumeNeeds { bricks: Needs { meshes, ..plain.bricks }, ..plain }], 64 << 20))
        };
        let more = of(meshes).unwrap().fixed_bytes - of(MeshCapacity::NONE).unwrap().fixed_bytes;
        // 32 bytes a vertex, 12 a triangle, twice; and two distances and numbers, a colour and a sum for each pixel.
        assert!(more > 2 * (5_000 * 32 + 10_000 * 12) + 512 * 512 * 40, "{more}");
        assert!(of(meshes).unwrap().bytes() <= 64 << 20);
        let huge = MeshCapacity { vertices: 5 << 20, ..meshes };
        assert!(matches!(of(huge), Err(GpuError::Meshes { .. })));
    }

    #[test]
    fn buffers_are_within_the_account_and_the_binding_limit() {
        let layers = [layer(VoxelType::U8)];
        let needs = MemoryNeeds { max_binding_bytes: 1 << 20, casts_rays: Some(true), ..needs(&layers, 5000 << 20) };
        let plan = MemoryPlan::new(&needs).unwrap().pools[0];
        let (raycast, slots) = (plan.raycast.unwrap(), plan.atlas.slots());
        let buffers = [raycast.nodes_bytes(slots), raycast.bricks_bytes(slots), raycast.ranges_bytes(slots)];
        let marks = 2 * raycast.marks_bytes(slots);
        assert!(buffers.iter().all(|&b| b <= 1 << 20), "{buffers:?}");
        assert!(slots > 300, "{slots} slots of 64 entries fill 1 MiB");
        let accounted = raycast.list_bytes(0) + slots as u64 * plan.beside_bytes;
        assert!(buffers.iter().sum::<u64>() + marks <= accounted);
    }

    #[test]
    fn layers_of_one_pool_have_the_slots_of_all_and_one_may_use_them() {
        let few = VolumeNeeds { most_slots: 40, least_slots: 9, ..layer(VoxelType::U8) };
        let other = VolumeNeeds { edge: 32, ..few };
        let layers = [few, few, other, VolumeNeeds { levels: 4, ..few }];
        for needs in both(needs(&layers, 1 << 30)) {
            let plan = MemoryPlan::new(&needs).unwrap();
            assert_eq!(plan.pool_of, [0, 0, 1, 0]);
            assert_eq!(plan.pools.iter().map(|pool| pool.least).collect::<Vec<_>>(), [27, 9]);
            // All that they could fill.
            assert_eq!(plan.pools.iter().map(|pool| pool.atlas.slots()).collect::<Vec<_>>(), [120, 40]);
            if let Some(raycast) = plan.pools[0].raycast {
                let alone = RaycastPlan { layers: 1, ..raycast };
                assert_eq!(raycast.levels, 9);
                let roots = raycast.nodes_bytes(0) - alone.nodes_bytes(0);
                assert_eq!(raycast.nodes_bytes(120) - roots, alone.nodes_bytes(120), "one layer may use them all");
            }
            let refused = MemoryPlan::new(&MemoryNeeds { most_slots: &[60, 40], ..needs }).unwrap();
            assert_eq!(refused.pools.iter().map(|pool| pool.atlas.slots()).collect::<Vec<_>>(), [60, 40]);
        }
    }
}
