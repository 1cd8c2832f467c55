//! The atlas: one 3D texture of slots, each a padded brick of `(edge + 2 * apron)^3` texels, allocated once. Stored
//! gradients have a second texture, with a slot of nodes for each brick in the same order.
//!
//! [`AtlasPlan`] computes how many slots fit a budget and where each lies. The whole texture is written before anything
//! samples it: otherwise wgpu 30 zero-fills it at the first upload and can deadlock doing so.

use crate::{Gpu, GpuError, buffers};
use brickyard_pager::{DrawCell, Slot};
use brickyard_volume::gradients::NODE_BYTES;
use brickyard_volume::{GradientNodes, Pyramid};
use wgpu::{Extent3d, TextureFormat, TextureUsages};

/// Returns the bytes per texel of a format; all our formats have such a size.
pub(crate) fn texel_bytes(format: TextureFormat) -> u64 {
    format.block_copy_size(None).map_or(0, u64::from)
}

/// The layout of slots in the atlas texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AtlasPlan {
    /// Texels along a slot's edge.
    pub slot_edge: u32,
    /// Slots along x, y, z.
    pub grid: [u32; 3],
    /// Bytes of the atlas, including its gradient texture, if any.
    pub bytes: u64,
}

impl AtlasPlan {
    /// Plans the atlas with the most slots, up to `max_slots`, within `budget_bytes` and `max_edge` texels along an
    /// axis. A slot has `slot_edge`^3 texels and takes `slot_bytes` with its gradients. `None` if not even one slot
    /// fits.
    ///
    /// Among plans with equally many slots the narrowest wins: it puts a brick's neighbouring rows and slices closer
    /// together in memory.
    pub fn new(slot_edge: u32, slot_bytes: u64, budget_bytes: u64, max_edge: u32, max_slots: u32) -> Option<Self> {
        let most = (budget_bytes / slot_bytes).min(max_slots as u64);
        let along = (max_edge / slot_edge) as u64;
        let mut best = [0u64; 3];
        for x in 1..=along.min(most) {
            for y in 1..=along.min(most / x) {
                let z = along.min(most / (x * y));
                if x * y * z > best.iter().product() {
                    best = [x, y, z];
                }
            }
        }
        let slots: u64 = best.iter().product();
        (slots > 0).then(|| Self { slot_edge, grid: best.map(|n| n as u32), bytes: slots * slot_bytes })
    }

    /// The number of slots.
    pub fn slots(&self) -> u32 {
        self.grid.iter().product()
    }

    /// Size of the texture, texels.
    pub fn size(&self) -> [u32; 3] {
        self.grid.map(|n| n * self.slot_edge)
    }

    /// Returns the position of a slot's first texel.
    pub fn origin(&self, slot: Slot) -> [u32; 3] {
        self.place(slot).map(|i| i * self.slot_edge)
    }

    fn place(&self, Slot(slot): Slot) -> [u32; 3] {
        let [nx, ny, _] = self.grid;
        [slot % nx, slot / nx % ny, slot / (nx * ny)]
    }
}

const GRADIENT_FORMAT: TextureFormat = TextureFormat::Rgba16Float;

pub(crate) fn slot_bytes(slot_edge: u32, format: TextureFormat, gradients: GradientNodes) -> u64 {
    (slot_edge as u64).pow(3) * texel_bytes(format) + gradients.bytes() as u64
}

/// The atlas texture, with that of stored gradients if there is one.
#[derive(Debug)]
pub(crate) struct Atlas {
    pub(crate) plan: AtlasPlan,
    pub(crate) format: TextureFormat,
    pub(crate) nodes: GradientNodes,
    pub(crate) texture: wgpu::Texture,
    pub(crate) gradients: Option<wgpu::Texture>,
}

impl Atlas {
    /// Creates and zero-fills the textures. Takes about a second per GiB on a software rasteriser.
    pub(crate) fn new(
        gpu: &Gpu,
        plan: AtlasPlan,
        format: TextureFormat,
        nodes: GradientNodes,
    ) -> Result<Self, GpuError> {
        let texture = texture(gpu, "the brick atlas", plan.size(), format)?;
        let size = plan.grid.map(|n| n * nodes.along());
        let gradients = (nodes.layers > 0).then(|| self::texture(gpu, "the gradients", size, GRADIENT_FORMAT));
        let atlas = Self { plan, format, nodes, texture, gradients: gradients.transpose()? };
        // After a partial write wgpu fills the rest with zeros.
        let zero = [0; NODE_BYTES];
        write(gpu, &atlas.texture, [0; 3], 1, &zero[..texel_bytes(format) as usize]);
        if let Some(gradients) = &atlas.gradients {
            write(gpu, gradients, [0; 3], 1, &zero);
        }
        gpu.wait(gpu.queue.submit([]))?;
        Ok(atlas)
    }

    pub(crate) fn write(&self, gpu: &Gpu, slot: Slot, texels: &[u8], gradients: &[u8]) {
        write(gpu, &self.texture, self.plan.origin(slot), self.plan.slot_edge, texels);
        if let Some(texture) = &self.gradients {
            let along = self.nodes.along();
            write(gpu, texture, self.plan.place(slot).map(|i| i * along), along, gradients);
        }
    }
}

fn texture(
    gpu: &Gpu,
    label: &'static str,
    [width, height, depth_or_array_layers]: [u32; 3],
    format: TextureFormat,
) -> Result<wgpu::Texture, GpuError> {
    let size = Extent3d { width, height, depth_or_array_layers };
    let usage = TextureUsages::TEXTURE_BINDING | TextureUsages::COPY_DST;
    let texels = [width, height, depth_or_array_layers].map(u64::from).iter().product::<u64>();
    gpu.allocate(label, texels * texel_bytes(format), |device| {
        buffers::texture(device, label, size, wgpu::TextureDimension::D3, format, usage)
    })
}

fn write(gpu: &Gpu, texture: &wgpu::Texture, [x, y, z]: [u32; 3], edge: u32, texels: &[u8]) {
    let destination = wgpu::TexelCopyTextureInfo {
        texture,
        mip_level: 0,
        origin: wgpu::Origin3d { x, y, z },
        aspect: wgpu::TextureAspect::All,
    };
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(edge * texel_bytes(texture.format()) as u32),
        rows_per_image: Some(edge),
    };
    let size = Extent3d { width: edge, height: edge, depth_or_array_layers: edge };
    gpu.queue.write_texture(destination, texels, layout, size);
}

/// Returns the scale and offset from level-0 voxels to a cell's atlas texels. Exact in f32 for volumes of up to 2^24
/// voxels along an axis.
pub(crate) fn texel_placement(
    cell: &DrawCell,
    pyramid: &Pyramid,
    atlas: &AtlasPlan,
    apron: u32,
) -> ([f32; 3], [f32; 3]) {
    let factor = pyramid.level(cell.brick.level).factor;
    let index = cell.brick.index.to_array();
    let origin = atlas.origin(cell.slot);
    let offset = |a: usize| (origin[a] + apron) as i64 - index[a] as i64 * pyramid.edge() as i64;
    (factor.map(|f| 1.0 / f as f32), std::array::from_fn(|a| offset(a) as f32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn plans_fill_the_budget_and_stay_inside_every_limit() {
        for (edge, bytes, budget, max_edge, max_slots) in [
            (66, 2, 16 << 20, 4096, u32::MAX),
            (66, 2, 1 << 30, 2048, u32::MAX),
            (18, 1, 3_000_000, 256, u32::MAX),
            (68, 2, 40 << 30, 2048, u32::MAX),
            (66, 1, 1 << 30, 2048, 73),
        ] {
            let slot_bytes = (edge as u64).pow(3) * bytes;
            let plan = AtlasPlan::new(edge, slot_bytes, budget, max_edge, max_slots).unwrap();
            assert_eq!(plan.bytes, plan.slots() as u64 * slot_bytes);
            assert!(plan.bytes <= budget && plan.slots() <= max_slots);
            assert!(plan.size().iter().all(|&n| n <= max_edge));
            // No limit leaves more than 3 % unused: grids are products, and not every number is one.
            let along = (max_edge / edge) as u64;
            let possible = (budget / slot_bytes).min(max_slots as u64).min(along.pow(3));
            assert!(plan.slots() as u64 * 100 >= possible * 97, "{plan:?} of {possible}");
        }
        assert_eq!(AtlasPlan::new(66, 574_992, 574_000, 2048, 9), None);
        assert_eq!(AtlasPlan::new(66, 574_992, 1 << 30, 64, 9), None);
    }

    #[test]
    fn slots_do_not_overlap() {
        let plan = AtlasPlan::new(10, 1000, 1000 * 48, 40, u32::MAX).unwrap();
        let origins: HashSet<_> = (0..plan.slots()).map(|s| plan.origin(Slot(s))).collect();
        assert_eq!(origins.len(), 48);
        for o in origins {
            assert!((0..3).all(|a| o[a] % 10 == 0 && o[a] + 10 <= plan.size()[a]), "{o:?}");
        }
    }
}
