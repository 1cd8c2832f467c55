//! Uploads of slot codes into the atlas, in batches, with a bound on the staging memory in flight.
//!
//! `write_texture` copies each brick into staging memory of its own, freed only when its submission is done. So bricks
//! are submitted in small batches (also fastest on a software rasteriser), with a limit on those in flight: uploads
//! beyond the [room](Uploader::room_bytes) wait for the oldest.

use crate::atlas::{Atlas, texel_bytes};
use crate::{Gpu, GpuError};
use brickyard_pager::Slot;
use brickyard_volume::gradients::NODE_BYTES;
use brickyard_volume::{GradientNodes, SlotFormat};
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use wgpu::TextureFormat;

/// Most bricks per upload submission. Measured best on lavapipe; 64 is half as fast.
pub(crate) const MAX_BATCH: u64 = 8;

/// Returns the staging bytes of a brick and its gradients, with rows padded to 256 bytes as drivers may do.
pub(crate) fn staging_bytes(slot_edge: u32, format: TextureFormat, gradients: GradientNodes) -> u64 {
    let cube = |edge: u64, bytes: u64| (edge * bytes).next_multiple_of(256) * edge * edge;
    cube(slot_edge as u64, texel_bytes(format)) + cube(gradients.along() as u64, NODE_BYTES as u64)
}

/// Bricks submitted together.
#[derive(Debug)]
struct Batch {
    bricks: u64,
    submission: wgpu::SubmissionIndex,
    is_done: Arc<AtomicBool>,
}

/// Uploads bricks into an atlas, in batches.
#[derive(Debug)]
pub(crate) struct Uploader {
    codes: SlotFormat,
    batch: u64,
    /// Most bricks with staging memory at once.
    most: u64,
    /// Bricks written since the last submission.
    pending: u64,
    /// Batches possibly still in flight, oldest first.
    under_way: VecDeque<Batch>,
    /// Scratch for a brick's texels, if the atlas's format differs from the codes'.
    converted: Vec<u16>,
    /// Bytes of codes and gradients uploaded so far.
    pub(crate) bytes: u64,
}

impl Uploader {
    /// Creates an uploader that submits `batch` bricks at a time and has staging memory for `batches` batches.
    pub(crate) fn new(codes: SlotFormat, batch: u64, batches: u64) -> Self {
        let (most, under_way, converted) = (batch * batches, VecDeque::new(), Vec::new());
        Self { codes, batch, most, pending: 0, under_way, converted, bytes: 0 }
    }

    /// Checks that `codes` has the size of a padded brick with its gradients, and that the slot exists.
    pub(crate) fn check(&self, atlas: &Atlas, slot: Slot, codes: &[u8]) -> Result<(), GpuError> {
        let expected = self.voxel_bytes(atlas) + atlas.nodes.bytes();
        if codes.len() == expected && slot.0 < atlas.plan.slots() {
            return Ok(());
        }
        let (found, slot, slots) = (codes.len(), slot.0, atlas.plan.slots());
        let problem =
            format!("brick of {found} bytes for slot {slot}: expected {expected} bytes and a slot below {slots}");
        Err(GpuError::Mismatch(problem))
    }

    fn voxel_bytes(&self, atlas: &Atlas) -> usize {
        (atlas.plan.slot_edge as usize).pow(3) * self.codes.bytes()
    }

    /// Returns the bytes of codes that fit without waiting, as of the device's last poll.
    pub(crate) fn room_bytes(&mut self, atlas: &Atlas) -> u64 {
        while self.under_way.pop_front_if(|batch| batch.is_done.load(Ordering::Acquire)).is_some() {}
        (self.most - self.staged()) * (self.voxel_bytes(atlas) + atlas.nodes.bytes()) as u64
    }

    fn staged(&self) -> u64 {
        self.pending + self.under_way.iter().map(|batch| batch.bricks).sum::<u64>()
    }

    /// Uploads a brick accepted by [`Uploader::check`]. Waits for the oldest batch if no staging memory is left.
    pub(crate) fn upload(&mut self, gpu: &Gpu, atlas: &Atlas, slot: Slot, codes: &[u8]) -> Result<(), GpuError> {
        while self.staged() >= self.most
            && let Some(batch) = self.under_way.pop_front()
        {
            gpu.wait(batch.submission)?;
        }
        let (voxels, gradients) = codes.split_at(self.voxel_bytes(atlas));
        let texels = convert(voxels, self.codes, atlas.format, &mut self.converted);
        atlas.write(gpu, slot, texels, gradients);
        self.bytes += codes.len() as u64;
        self.pending += 1;
        if self.pending < self.batch { Ok(()) } else { self.submit(gpu) }
    }

    pub(crate) fn submit(&mut self, gpu: &Gpu) -> Result<(), GpuError> {
        let bricks = std::mem::take(&mut self.pending);
        if bricks > 0 {
            let (submission, is_done) = (gpu.queue.submit([]), Arc::new(AtomicBool::new(false)));
            let done = is_done.clone();
            gpu.queue.on_submitted_work_done(move || done.store(true, Ordering::Release));
            self.under_way.push_back(Batch { bricks, submission, is_done });
        }
        gpu.check()
    }
}

/// Converts codes to the atlas's texels: unchanged, 8 bits widened to 16, or as half floats.
fn convert<'a>(codes: &'a [u8], from: SlotFormat, to: TextureFormat, scratch: &'a mut Vec<u16>) -> &'a [u8] {
    scratch.clear();
    match (from, to) {
        (SlotFormat::U8, TextureFormat::R16Unorm) => scratch.extend(codes.iter().map(|&c| c as u16 * 257)),
        (SlotFormat::U16, TextureFormat::R16Float) => scratch.extend(codes.chunks_exact(2).map(|c| {
            let code = u16::from_le_bytes([c[0], c[1]]);
            half::f16::from_f32(code as f32 / 65535.0).to_bits()
        })),
        _ => return codes,
    }
    bytemuck::cast_slice(scratch)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_keep_their_value_in_every_format() {
        let mut scratch = Vec::new();
        let wide = convert(&[0, 1, 128, 255], SlotFormat::U8, TextureFormat::R16Unorm, &mut scratch);
        let wide: Vec<u16> = bytemuck::pod_collect_to_vec(wide);
        assert_eq!(
            wide.iter().map(|&c| c as f64 / 65535.0).collect::<Vec<_>>(),
            [0.0, 1.0 / 255.0, 128.0 / 255.0, 1.0]
        );

        let codes: Vec<u8> = [0u16, 1, 30000, 65535].iter().flat_map(|c| c.to_le_bytes()).collect();
        let halves = convert(&codes, SlotFormat::U16, TextureFormat::R16Float, &mut scratch);
        let halves: Vec<u16> = bytemuck::pod_collect_to_vec(halves);
        for (h, code) in halves.iter().zip([0.0f32, 1.0, 30000.0, 65535.0]) {
            // Half a unit in the last of 11 bits.
            let found = half::f16::from_bits(*h).to_f32();
            assert!((found - code / 65535.0).abs() <= 1.0 / 4096.0 && (code == 0.0) == (found == 0.0));
        }
        assert_eq!(convert(&codes, SlotFormat::U16, TextureFormat::R16Unorm, &mut scratch), codes);
    }
}
