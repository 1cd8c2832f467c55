//! What the GPU budget pays for: the picture's targets, tables, staging and read-back come first, and the atlas gets the rest.

use crate::adapter::GpuFormats;
use crate::atlas::{AtlasPlan, texel_bytes};
use crate::error::GpuError;
use crate::upload::{MAX_BATCH, staging_bytes};
use brickyard_shaders::{CellInstance, FrameUniform};
use brickyard_volume::SlotFormat;
use wgpu::TextureFormat;

/// Cells drawn per submission: longer draw lists take several. Short enough that no watchdog sees one as a hang.
pub(crate) const CELLS_PER_SUBMISSION: usize = 1024;
/// Two timestamps and their room in the read-back buffer.
pub(crate) const TIMESTAMP_BYTES: u64 = 16;
/// A picture that leaves no room for two slots cannot be refined at all.
const MIN_SLOTS: u64 = 2;

/// How a budget is spent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct MemoryPlan {
    pub(crate) atlas: AtlasPlan,
    /// Bricks per upload submission.
    pub(crate) batch: u64,
    /// Everything but the atlas.
    pub(crate) fixed_bytes: u64,
}

/// What a plan is made for.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MemoryNeeds {
    pub(crate) formats: GpuFormats,
    pub(crate) codes: SlotFormat,
    pub(crate) slot_edge: u32,
    pub(crate) budget_bytes: u64,
    pub(crate) max_size_px: (u32, u32),
    pub(crate) max_texture_3d: u32,
    pub(crate) max_slots: u32,
}

/// Bytes of a row of the read-back buffer.
pub(crate) fn read_back_row_bytes(width_px: u32) -> u64 {
    (width_px as u64 * 4).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as u64)
}

fn target_bytes(format: TextureFormat) -> u64 {
    match format {
        TextureFormat::Rgba32Float => 16,
        TextureFormat::Rgba16Float | TextureFormat::Rg32Float => 8,
        _ => 4,
    }
}

impl MemoryPlan {
    pub(crate) fn new(needs: &MemoryNeeds) -> Result<Self, GpuError> {
        let (width_px, height_px) = needs.max_size_px;
        let pixels = width_px as u64 * height_px as u64;
        let gather = target_bytes(needs.formats.composite).max(target_bytes(needs.formats.project));
        let picture = pixels * (gather + 4) + read_back_row_bytes(width_px) * height_px as u64 + 2 * TIMESTAMP_BYTES;
        let table = (needs.codes.max_code() as u64 + 1) * 16;
        let cells = (CELLS_PER_SUBMISSION * size_of::<CellInstance>()) as u64;
        let format = needs.formats.atlas(needs.codes);
        let staging = staging_bytes(needs.slot_edge, format);
        // Two batches are under way at once; together at most an eighth of the budget.
        let batch = (needs.budget_bytes / 16 / staging).clamp(1, MAX_BATCH);
        let small = picture + table + cells + size_of::<FrameUniform>() as u64;
        let fixed_bytes = small + 2 * batch * staging;
        let left = needs.budget_bytes.saturating_sub(fixed_bytes);
        let texel = texel_bytes(format);
        let atlas = AtlasPlan::new(needs.slot_edge, texel, left, needs.max_texture_3d, needs.max_slots);
        let enough = atlas.filter(|a| a.slots() as u64 >= MIN_SLOTS.min(needs.max_slots as u64));
        let least_bytes = small + 2 * staging + MIN_SLOTS * (needs.slot_edge as u64).pow(3) * texel;
        let atlas = enough.ok_or(GpuError::Budget {
            given_bytes: needs.budget_bytes,
            least_bytes,
            width_px,
            height_px,
            slot_edge: needs.slot_edge,
        })?;
        Ok(Self { atlas, batch, fixed_bytes })
    }

    /// Everything the renderer may hold at once.
    pub(crate) fn bytes(&self) -> u64 {
        self.atlas.bytes + self.fixed_bytes
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
            codes: SlotFormat::U8,
            slot_edge: 66,
            budget_bytes,
            max_size_px: (512, 512),
            max_texture_3d: 4096,
            max_slots: u32::MAX,
        }
    }

    #[test]
    fn sixteen_mebibytes_hold_a_picture_and_ten_bricks() {
        for codes in [SlotFormat::U8, SlotFormat::U16] {
            let plan = MemoryPlan::new(&MemoryNeeds { codes, ..needs(16 << 20) }).unwrap();
            assert!(plan.atlas.slots() >= 10 && plan.bytes() <= 16 << 20, "{plan:?}");
        }
    }

    #[test]
    fn the_least_that_works_works_and_a_byte_less_does_not() {
        let Err(GpuError::Budget { least_bytes, .. }) = MemoryPlan::new(&needs(1 << 20)) else { panic!("1 MiB") };
        assert_eq!(MemoryPlan::new(&needs(least_bytes)).unwrap().atlas.slots(), 2);
        assert!(MemoryPlan::new(&needs(least_bytes - 1)).is_err());
    }

    #[test]
    fn no_budget_is_overspent() {
        for mebibytes in [12, 13, 20, 64, 100, 500, 1024, 5000] {
            let plan = MemoryPlan::new(&needs(mebibytes << 20)).unwrap();
            assert!(plan.bytes() <= mebibytes << 20, "{mebibytes}: {plan:?}");
        }
    }
}
