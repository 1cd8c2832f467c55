//! The volume of an empty window: one voxel. It gives an empty window sessions, a scene and commands like any other.

use brickyard::pager::{BrickError, BrickSource};
use brickyard::session::VolumeSource;
use brickyard::volume::{BrickId, Extent, Geometry, Pyramid, VoxelType};
use std::sync::Arc;

/// Voxels along the edge of its only brick.
const EDGE: u32 = 8;

pub(crate) fn volume() -> VolumeSource {
    let pyramid = Pyramid::new(Extent::new(1, 1, 1), [1.0; 3], EDGE);
    VolumeSource::new(Arc::new(Nothing { pyramid, geometry: Geometry::default() }))
}

struct Nothing {
    pyramid: Pyramid,
    geometry: Geometry,
}

impl BrickSource for Nothing {
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
        (0.0, 1.0)
    }

    fn read_core(&self, _: BrickId, out: &mut [u8]) -> Result<(), BrickError> {
        out.fill(0);
        Ok(())
    }
}
