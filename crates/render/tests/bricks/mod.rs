//! A volume of one level in padded bricks, for testing the GPU renderer's own properties: the conformance suite
//! (`tests/conformance`) covers the pictures' contents.

use brickyard_pager::{DrawCell, DrawList, Layer, PixelShare, Slot, VolumeNeeds};
use brickyard_render::{Compositor, GpuError, GpuOptions, GpuRenderer};
use brickyard_volume::*;
use glam::DVec3;

#[path = "../../../../tests/support/missing.rs"]
#[expect(unreachable_pub, reason = "the whole-system tests have it in a library")]
pub(crate) mod missing;

pub(crate) const MEMORY_BYTES: u64 = 64 << 20;
pub(crate) const COMPOSITORS: [Compositor; 3] = [Compositor::Sorted, Compositor::Raycast, Compositor::Compute];

/// Waves of 32³ voxels in eight bricks.
pub(crate) struct Bricks {
    pub(crate) pyramid: Pyramid,
    pub(crate) needs: VolumeNeeds,
}

impl Bricks {
    pub(crate) fn new() -> Self {
        let pyramid = Pyramid::new(Extent::new(32, 32, 32), [1.0; 3], 16);
        let encoding = SlotEncoding::new(VoxelType::U8, (0.0, 255.0), false);
        let bricks = Needs { apron: 4, ..Needs::PLAIN };
        let needs = VolumeNeeds { encoding, edge: 16, levels: 2, bricks, least_slots: 2, most_slots: 9 };
        Self { pyramid, needs }
    }

    /// A renderer of `layers` layers of it; `None`, with a loud message, without any adapter.
    pub(crate) fn renderer(&self, compositor: Compositor, layers: usize) -> Option<GpuRenderer> {
        let options = GpuOptions { compositor, ..Default::default() };
        match GpuRenderer::new(&options, &vec![self.needs; layers], MEMORY_BYTES, (64, 64)) {
            Ok(renderer) => Some(renderer),
            Err(error @ GpuError::NoAdapter { .. }) => {
                missing::leave_out("gpu", error);
                None
            }
            Err(error) => panic!("{error}"),
        }
    }

    /// A padded brick, with the volume's faces replicated.
    fn padded(&self, index: BrickIndex) -> Vec<u8> {
        let along = |first: u32| (0..24).map(move |i| (first * 16 + i).saturating_sub(4).min(31) as f64);
        let mut codes = Vec::new();
        for z in along(index.z) {
            for y in along(index.y) {
                codes.extend(
                    along(index.x).map(|x| (127.0 + 120.0 * (x * 0.3).sin() * (y * 0.2 + z * 0.1).cos()) as u8),
                );
            }
        }
        codes
    }

    /// Uploads all bricks, and lists them back to front for [`rays`].
    pub(crate) fn upload(&self, renderer: &mut GpuRenderer) -> DrawList {
        let mut cells = Vec::new();
        for (slot, rank) in (0..8).map(Slot).zip(0..) {
            // The eye is below the middle along x and y, above it along z.
            let index = BrickIndex { x: 1 - (rank & 1), y: 1 - (rank >> 1 & 1), z: rank >> 2 };
            let brick = BrickId { time: 0, channel: 0, level: Level(0), index };
            renderer.upload(0, slot, &self.padded(index)).expect("the slot is there");
            let region = self.pyramid.brick_box_voxel(brick.level, index);
            cells.push(DrawCell { cell: brick, region, pixels: PixelShare::ALL, brick, slot, rank });
        }
        DrawList { cells }
    }

    pub(crate) fn frame(&self, transfer: &TransferFunction) -> FrameSettings {
        FrameSettings {
            rays: rays(40, 30),
            lattice: Lattice::uniform(0.7, 0),
            geometry: Geometry::default(),
            placement: Placement::default(),
            encoding: self.needs.encoding,
            table: TransferTable::new(transfer, &self.needs.encoding).into(),
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

    /// Layers, all with the same list.
    pub(crate) fn layers<'a>(&'a self, frames: &'a [VolumeFrame], draw: &'a DrawList) -> Vec<Layer<'a>> {
        let layer = |(volume, frame)| Layer { volume, frame, pyramid: &self.pyramid, draw, cut: 0 };
        frames.iter().enumerate().map(layer).collect()
    }
}

pub(crate) fn rays(width: u32, height: u32) -> ViewRays {
    let (eye, target) = (DVec3::new(-30.0, -25.0, 50.0), DVec3::splat(16.0));
    let camera = Camera { eye, target, up: DVec3::Z, projection: Projection::Perspective { fov_y_deg: 45.0 } };
    camera.rays(width, height).expect("a camera")
}

pub(crate) fn transfer(hue: f64) -> TransferFunction {
    TransferFunction {
        color: vec![[0.0, hue, 0.2, 1.0 - hue], [255.0, 0.4, 0.6, hue]],
        opacity: vec![[90.0, 0.0], [200.0, 0.4]],
        ..TransferFunction::default()
    }
}
