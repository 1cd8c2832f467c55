//! What the GPU budget pays for: the picture's targets, tables, staging and read-back come first; the rest goes
//! to slots, each with what the compositor keeps beside it.

use crate::adapter::GpuFormats;
use crate::atlas::{AtlasPlan, slot_bytes};
use crate::error::GpuError;
use crate::table::Room;
use crate::upload::{MAX_BATCH, staging_bytes};
use brickyard_shaders::{CellInstance, FrameUniform, MeshLook, MeshVertex};
use brickyard_volume::{GradientNodes, MeshRoom, SlotFormat};
use wgpu::TextureFormat;

/// Cells drawn per submission: longer draw lists take several. Short enough that no watchdog sees one as a hang.
pub(crate) const CELLS_PER_SUBMISSION: usize = 1024;
/// Two timestamps and their room in the read-back buffer.
pub(crate) const TIMESTAMP_BYTES: u64 = 16;
/// A picture that leaves no room for two slots cannot be refined at all.
pub(crate) const MIN_SLOTS: u32 = 2;

/// How a budget is spent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MemoryPlan {
    pub(crate) atlas: AtlasPlan,
    /// Bricks per upload submission.
    pub(crate) batch: u64,
    /// Everything that does not depend on the number of slots.
    pub(crate) fixed_bytes: u64,
    /// What the compositor keeps beside each slot.
    pub(crate) beside_bytes: u64,
}

/// What sizes the buffers of the raycast compositor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RaycastPlan {
    /// Voxels along a brick's core edge.
    pub(crate) edge: u32,
    /// Levels of the pyramid.
    pub(crate) levels: u32,
    /// The counts of opaque entries.
    pub(crate) opaque_bytes: u64,
    /// Whether macro-cells are to be leapt over.
    pub(crate) leaps: bool,
}

impl RaycastPlan {
    pub(crate) fn new(edge: u32, levels: u32, codes: SlotFormat, leaps: bool) -> Self {
        Self { edge, levels, leaps, opaque_bytes: (codes.max_code() as u64 + 2) * 4 }
    }

    /// What a slot's brick needs: its macro-cells, its range on the host, its part of the octree, twice for staging, and its part of
    /// the marks, in the read-back and on the host too.
    pub(crate) fn bytes_per_slot(&self) -> u64 {
        self.list_bytes(1) - self.list_bytes(0) + self.ranges_bytes(1) + size_of::<[u16; 2]>() as u64
    }

    /// What it needs besides: the counts on the GPU, on the host and in staging, and the octree's root.
    pub(crate) fn fixed_bytes(&self) -> u64 {
        3 * self.opaque_bytes + self.list_bytes(0)
    }

    /// All that grows with the draw list.
    fn list_bytes(&self, slots: u32) -> u64 {
        2 * (self.nodes_bytes(slots) + self.bricks_bytes(slots)) + 3 * self.marks_bytes(slots)
    }

    /// No more slots than a binding can describe.
    pub(crate) fn max_slots(&self, max_binding_bytes: u64) -> u64 {
        let each = self.ranges_bytes(1).max(self.bricks_bytes(1) - self.bricks_bytes(0));
        max_binding_bytes.saturating_sub(self.bricks_bytes(0)) / each
    }
}

/// What a plan is made for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MemoryNeeds {
    pub(crate) formats: GpuFormats,
    /// What tables there is room for.
    pub(crate) tables: Room,
    pub(crate) slot_edge: u32,
    /// Stored with each brick.
    pub(crate) gradients: GradientNodes,
    pub(crate) budget_bytes: u64,
    pub(crate) max_size_px: (u32, u32),
    pub(crate) max_texture_3d: u32,
    pub(crate) max_slots: u32,
    /// The greatest buffer that a shader can see.
    pub(crate) max_binding_bytes: u64,
    /// Where the compositor is `raycast`.
    pub(crate) raycast: Option<RaycastPlan>,
    /// The meshes that pictures may have.
    pub(crate) meshes: MeshRoom,
}

/// Bytes of a row of the read-back buffer.
pub(crate) fn read_back_row_bytes(width_px: u32) -> u64 {
    (width_px as u64 * 4).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as u64)
}

pub(crate) fn target_bytes(format: TextureFormat) -> u64 {
    match format {
        TextureFormat::Rgba32Float => 16,
        TextureFormat::Rgba16Float | TextureFormat::Rg32Float => 8,
        _ => 4,
    }
}

/// Bytes of a picture's targets, and of the way back.
pub(crate) fn picture_bytes(formats: &GpuFormats, (width_px, height_px): (u32, u32)) -> u64 {
    let pixels = width_px as u64 * height_px as u64;
    let gather = target_bytes(formats.composite).max(target_bytes(formats.project));
    pixels * (gather + 4) + read_back_row_bytes(width_px) * height_px as u64 + 2 * TIMESTAMP_BYTES
}

/// Colours of a layer: finer than those of a picture.
pub(crate) const COLOR_FORMAT: TextureFormat = TextureFormat::Rgba16Float;

/// Which triangle a layer is of.
pub(crate) const NUMBER_FORMAT: TextureFormat = TextureFormat::R32Uint;

pub(crate) const QUERY_BYTES: u64 = 8;

/// What the meshes' triangles take on the GPU.
pub(crate) fn geometry_bytes(room: MeshRoom) -> [u64; 3] {
    let each = [size_of::<MeshVertex>(), 3 * size_of::<u32>(), size_of::<MeshLook>()];
    let counts = [room.vertices, room.triangles, room.meshes];
    std::array::from_fn(|i| each[i] as u64 * counts[i] as u64)
}

/// What meshes take in all: triangles on the GPU and in staging, the answer to the query, and per pixel two distances and numbers, a
/// layer's colour, and what is in front.
pub(crate) fn mesh_bytes(room: MeshRoom, pixels: u64, front: TextureFormat) -> u64 {
    if room.is_none() {
        return 0;
    }
    let per_pixel = 2 * (4 + target_bytes(NUMBER_FORMAT)) + target_bytes(COLOR_FORMAT) + target_bytes(front);
    2 * geometry_bytes(room).iter().sum::<u64>() + 2 * QUERY_BYTES + pixels * per_pixel
}

/// The greatest buffer that a shader has to see.
pub(crate) fn largest_mesh_bytes(room: MeshRoom) -> u64 {
    geometry_bytes(room).into_iter().max().unwrap_or(0)
}

impl MemoryPlan {
    pub(crate) fn new(needs: &MemoryNeeds) -> Result<Self, GpuError> {
        let (width_px, height_px) = needs.max_size_px;
        let pixels = width_px as u64 * height_px as u64;
        let picture = picture_bytes(&needs.formats, needs.max_size_px);
        let table = needs.tables.bytes_staged();
        let (compositor, beside_bytes, most) = match needs.raycast {
            None => ((CELLS_PER_SUBMISSION * size_of::<CellInstance>()) as u64, 0, u64::MAX),
            Some(plan) => (plan.fixed_bytes(), plan.bytes_per_slot(), plan.max_slots(needs.max_binding_bytes)),
        };
        let format = needs.formats.atlas(needs.tables.codes);
        let staging = staging_bytes(needs.slot_edge, format, needs.gradients)
            + needs.raycast.map_or(0, |plan| plan.ranges_bytes(1));
        // Two batches are under way at once; together at most an eighth of the budget.
        let batch = (needs.budget_bytes / 16 / staging).clamp(1, MAX_BATCH);
        let largest = largest_mesh_bytes(needs.meshes);
        if largest > needs.max_binding_bytes {
            return Err(GpuError::Meshes { bytes: largest, limit_bytes: needs.max_binding_bytes });
        }
        let meshes = mesh_bytes(needs.meshes, pixels, needs.formats.composite);
        let small = picture + meshes + table + compositor + size_of::<FrameUniform>() as u64;
        let fixed_bytes = small + 2 * batch * staging;
        let left = needs.budget_bytes.saturating_sub(fixed_bytes);
        let slot_bytes = slot_bytes(needs.slot_edge, format, needs.gradients);
        let slots = (left / (slot_bytes + beside_bytes)).min(most).min(needs.max_slots as u64);
        let atlas = AtlasPlan::new(needs.slot_edge, slot_bytes, slots * slot_bytes, needs.max_texture_3d, slots as u32);
        let enough = atlas.filter(|a| a.slots() >= MIN_SLOTS.min(needs.max_slots));
        let least_bytes = small + 2 * staging + MIN_SLOTS as u64 * (slot_bytes + beside_bytes);
        let atlas = enough.ok_or(GpuError::Budget {
            given_bytes: needs.budget_bytes,
            least_bytes,
            width_px,
            height_px,
            slot_edge: needs.slot_edge,
        })?;
        Ok(Self { atlas, batch, fixed_bytes, beside_bytes })
    }

    /// Everything the renderer may hold at once.
    pub(crate) fn bytes(&self) -> u64 {
        self.atlas.bytes + self.fixed_bytes + self.atlas.slots() as u64 * self.beside_bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn needs(budget_bytes: u64) -> MemoryNeeds {
        MemoryNeeds {
            formats: GpuFormats {
                atlas_u8: TextureFormat::R16Unorm,
                atlas_u16: TextureFormat::R16Unorm,
                composite: TextureFormat::Rgba32Float,
                project: TextureFormat::Rg32Float,
            },
            tables: Room::of_places(SlotFormat::U8),
            slot_edge: 66,
            gradients: GradientNodes { edge: 64, layers: 0 },
            budget_bytes,
            max_size_px: (512, 512),
            max_texture_3d: 4096,
            max_slots: u32::MAX,
            max_binding_bytes: 128 << 20,
            raycast: None,
            meshes: MeshRoom::NONE,
        }
    }

    /// For either compositor.
    fn both(needs: MemoryNeeds) -> [MemoryNeeds; 2] {
        [needs, MemoryNeeds { raycast: Some(RaycastPlan::new(64, 9, needs.tables.codes, true)), ..needs }]
    }

    #[test]
    fn sixteen_mebibytes_hold_a_picture_and_ten_bricks() {
        for tables in [SlotFormat::U8, SlotFormat::U16].map(Room::of_places) {
            for needs in both(MemoryNeeds { tables, ..needs(16 << 20) }) {
                let plan = MemoryPlan::new(&needs).unwrap();
                assert!(plan.atlas.slots() >= 10 && plan.bytes() <= 16 << 20, "{plan:?}");
            }
        }
    }

    #[test]
    fn the_least_that_works_works_and_a_byte_less_does_not() {
        for needs in both(needs(1 << 20)) {
            let Err(GpuError::Budget { least_bytes, .. }) = MemoryPlan::new(&needs) else { panic!("1 MiB") };
            let with = |budget_bytes| MemoryPlan::new(&MemoryNeeds { budget_bytes, ..needs });
            assert_eq!(with(least_bytes).unwrap().atlas.slots(), 2);
            assert!(with(least_bytes - 1).is_err());
        }
    }

    #[test]
    fn no_budget_is_overspent() {
        for mebibytes in [12, 13, 20, 64, 100, 500, 1024, 5000] {
            for needs in both(needs(mebibytes << 20)) {
                let plan = MemoryPlan::new(&needs).unwrap();
                assert!(plan.bytes() <= mebibytes << 20, "{mebibytes}: {plan:?}");
            }
        }
    }

    #[test]
    fn gradients_are_paid_for() {
        for plain in both(needs(100 << 20)) {
            let stored = MemoryNeeds { gradients: GradientNodes { edge: 64, layers: 1 }, ..plain };
            let [plain, stored] = [plain, stored].map(|needs| MemoryPlan::new(&needs).unwrap());
            assert!(stored.bytes() <= 100 << 20);
            let slot_bytes = 34 * 34 * 34 * 8 + 66 * 66 * 66 * 2;
            assert_eq!(stored.atlas.bytes, stored.atlas.slots() as u64 * slot_bytes);
            assert!(stored.atlas.slots() * 10 < plain.atlas.slots() * 8, "{stored:?} {plain:?}");
        }
    }

    #[test]
    fn meshes_are_paid_for_and_may_be_too_large() {
        let meshes = MeshRoom { meshes: 2, vertices: 5_000, triangles: 10_000 };
        let [plain, _] = both(needs(64 << 20));
        let of = |meshes| MemoryPlan::new(&MemoryNeeds { meshes, ..plain });
        let more = of(meshes).unwrap().fixed_bytes - of(MeshRoom::NONE).unwrap().fixed_bytes;
        // 32 bytes a vertex, 12 a triangle, twice; and two distances and numbers, a colour and a sum for each pixel.
        assert!(more > 2 * (5_000 * 32 + 10_000 * 12) + 512 * 512 * 40, "{more}");
        assert!(of(meshes).unwrap().bytes() <= 64 << 20);
        let huge = MeshRoom { vertices: 5 << 20, ..meshes };
        assert!(matches!(of(huge), Err(GpuError::Meshes { .. })));
    }

    #[test]
    fn buffers_are_within_the_account_and_the_binding_limit() {
        let [_, mut needs] = both(needs(5000 << 20));
        needs.max_binding_bytes = 1 << 20;
        let plan = MemoryPlan::new(&needs).unwrap();
        let (raycast, slots) = (needs.raycast.unwrap(), plan.atlas.slots());
        let buffers = [raycast.nodes_bytes(slots), raycast.bricks_bytes(slots), raycast.ranges_bytes(slots)];
        let marks = 2 * raycast.marks_bytes(slots);
        assert!(buffers.iter().all(|&b| b <= 1 << 20), "{buffers:?}");
        assert!(slots > 300, "{slots} slots of 64 entries fill 1 MiB");
        let accounted = raycast.fixed_bytes() + slots as u64 * plan.beside_bytes;
        assert!(buffers.iter().sum::<u64>() + marks + raycast.opaque_bytes <= accounted);
    }
}
