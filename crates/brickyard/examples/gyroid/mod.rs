//! A procedural volume of 4096³ voxels: bricks are computed on demand. Stored, it would be 64 GiB.

use brickyard::volume::{BrickId, Extent, Geometry, Lighting, LightingModel, Pyramid, TransferFunction, VoxelType};
use brickyard::{BrickError, BrickSource, Scene, VolumeSource};
use std::sync::Arc;

/// Voxels along an axis.
pub(crate) const EDGE: u32 = 4096;
const BRICK_EDGE: u32 = 32;

/// A periodic surface without end, which divides space in two.
struct Gyroid {
    pyramid: Pyramid,
    geometry: Geometry,
}

impl Gyroid {
    fn new() -> Self {
        let geometry = Geometry::default();
        let pyramid = Pyramid::new(Extent::new(EDGE, EDGE, EDGE), geometry.spacing.to_array(), BRICK_EDGE);
        Self { pyramid, geometry }
    }

    /// The value at a place in voxels of level 0, from 0 to 255: 127.5 on the surface, and 0 outside a ball.
    fn value([x, y, z]: [f64; 3]) -> u8 {
        let radius = [x, y, z].map(|p| (p / f64::from(EDGE) - 0.5).powi(2)).iter().sum::<f64>().sqrt();
        let [a, b, c] = [x, y, z].map(|p| p * 8.0 * std::f64::consts::TAU / f64::from(EDGE));
        let gyroid = a.sin() * b.cos() + b.sin() * c.cos() + c.sin() * a.cos();
        if radius > 0.48 { 0 } else { (127.5 + 80.0 * gyroid).clamp(0.0, 255.0) as u8 }
    }
}

impl BrickSource for Gyroid {
    fn pyramid(&self) -> &Pyramid {
        &self.pyramid
    }

    fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    fn voxel_type(&self) -> VoxelType {
        VoxelType::U8
    }

    fn value_range(&self) -> (f64, f64) {
        (0.0, 255.0)
    }

    fn read_core(&self, id: BrickId, out: &mut [u8]) -> Result<(), BrickError> {
        let factor = self.pyramid.level(id.level).factor;
        for (voxel, place) in out.iter_mut().zip(self.pyramid.core_voxels(id.index)) {
            // A coarse voxel covers several of level 0; this is their middle.
            let middle = |axis: usize| (f64::from(place[axis]) + 0.5) * f64::from(factor[axis]) - 0.5;
            *voxel = Self::value([0, 1, 2].map(middle));
        }
        Ok(())
    }
}

pub(crate) fn volume() -> VolumeSource {
    VolumeSource::new(Arc::new(Gyroid::new()))
}

pub(crate) fn scene() -> Scene {
    let transfer = TransferFunction {
        color: vec![[100.0, 0.1, 0.3, 0.8], [160.0, 1.0, 0.6, 0.2]],
        opacity: vec![[110.0, 0.0], [125.0, 0.9], [130.0, 0.9], [145.0, 0.0]],
        unit_distance: f64::from(EDGE) / 200.0,
        ..TransferFunction::default()
    };
    Scene { lighting: Lighting { model: LightingModel::Phong, ..Lighting::default() }, ..Scene::of(transfer) }
}
