//! The atlas: one 3D texture of slots, each a padded brick of `(edge + 2 * apron)^3` texels, made once.
//!
//! [`AtlasPlan`] is the arithmetic: how many slots fit a budget and where each lies. The whole texture is written before
//! anything samples it, because wgpu 30 otherwise zero-fills it at the first upload, and can deadlock on it.

use crate::adapter::Gpu;
use crate::error::GpuError;
use brickyard_pager::Slot;
use wgpu::{Extent3d, TextureFormat};

/// Bytes of a texel of the formats an atlas can have.
pub(crate) fn texel_bytes(format: TextureFormat) -> u64 {
    if format == TextureFormat::R8Unorm { 1 } else { 2 }
}

/// How slots are laid out in the texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AtlasPlan {
    /// Texels along a slot's edge.
    pub slot_edge: u32,
    /// Slots along x, y, z.
    pub grid: [u32; 3],
    /// Size of the texture.
    pub bytes: u64,
}

impl AtlasPlan {
    /// The atlas with the most slots of `slot_edge`^3 texels of `texel_bytes` that fits `budget_bytes` and `max_edge`
    /// texels along an axis, but no more than `max_slots`. `None` if not one slot fits.
    ///
    /// Among equals the narrowest wins: neighbouring rows and slices of a brick then lie closer together in memory.
    pub fn new(slot_edge: u32, texel_bytes: u64, budget_bytes: u64, max_edge: u32, max_slots: u32) -> Option<Self> {
        let slot_bytes = (slot_edge as u64).pow(3) * texel_bytes;
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

    /// The texture's size in texels.
    pub fn size(&self) -> [u32; 3] {
        self.grid.map(|n| n * self.slot_edge)
    }

    /// The slot's first texel.
    pub fn origin(&self, Slot(slot): Slot) -> [u32; 3] {
        let [nx, ny, _] = self.grid;
        [slot % nx, slot / nx % ny, slot / (nx * ny)].map(|i| i * self.slot_edge)
    }
}

/// The texture.
#[derive(Debug)]
pub(crate) struct Atlas {
    pub(crate) plan: AtlasPlan,
    pub(crate) format: TextureFormat,
    pub(crate) texture: wgpu::Texture,
}

impl Atlas {
    /// Makes and zero-fills the texture. Costs about a second per GiB on a software rasteriser.
    pub(crate) fn new(gpu: &Gpu, plan: AtlasPlan, format: TextureFormat) -> Result<Self, GpuError> {
        let [width, height, depth_or_array_layers] = plan.size();
        let descriptor = wgpu::TextureDescriptor {
            label: Some("atlas"),
            size: Extent3d { width, height, depth_or_array_layers },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D3,
            format,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        };
        let texture = gpu.allocate("the brick atlas", plan.bytes, |device| device.create_texture(&descriptor))?;
        let atlas = Self { plan, format, texture };
        // A partial write makes wgpu fill all the rest with zeros.
        let zero = [0; 2];
        atlas.write(gpu, [0; 3], 1, &zero[..texel_bytes(format) as usize]);
        gpu.wait(gpu.queue.submit([]))?;
        Ok(atlas)
    }

    /// Queues a cube of texels.
    pub(crate) fn write(&self, gpu: &Gpu, [x, y, z]: [u32; 3], edge: u32, texels: &[u8]) {
        let destination = wgpu::TexelCopyTextureInfo {
            texture: &self.texture,
            mip_level: 0,
            origin: wgpu::Origin3d { x, y, z },
            aspect: wgpu::TextureAspect::All,
        };
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(edge * texel_bytes(self.format) as u32),
            rows_per_image: Some(edge),
        };
        let size = Extent3d { width: edge, height: edge, depth_or_array_layers: edge };
        gpu.queue.write_texture(destination, texels, layout, size);
    }
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
            let plan = AtlasPlan::new(edge, bytes, budget, max_edge, max_slots).unwrap();
            let slot_bytes = (edge as u64).pow(3) * bytes;
            assert_eq!(plan.bytes, plan.slots() as u64 * slot_bytes);
            assert!(plan.bytes <= budget && plan.slots() <= max_slots);
            assert!(plan.size().iter().all(|&n| n <= max_edge));
            // No limit leaves more than 3 % unused: grids are products, and not every number is one.
            let along = (max_edge / edge) as u64;
            let possible = (budget / slot_bytes).min(max_slots as u64).min(along.pow(3));
            assert!(plan.slots() as u64 * 100 >= possible * 97, "{plan:?} of {possible}");
        }
        assert_eq!(AtlasPlan::new(66, 2, 574_000, 2048, 9), None);
        assert_eq!(AtlasPlan::new(66, 2, 1 << 30, 64, 9), None);
    }

    #[test]
    fn slots_do_not_overlap() {
        let plan = AtlasPlan::new(10, 1, 1000 * 48, 40, u32::MAX).unwrap();
        let origins: HashSet<_> = (0..plan.slots()).map(|s| plan.origin(Slot(s))).collect();
        assert_eq!(origins.len(), 48);
        for o in origins {
            assert!((0..3).all(|a| o[a] % 10 == 0 && o[a] + 10 <= plan.size()[a]), "{o:?}");
        }
    }
}
