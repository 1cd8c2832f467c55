//! Places of a level's voxels in the scene's world, and the precision that they need.

use brickyard_store::Store;
use brickyard_volume::{Level, VoxelBox};
use glam::{DMat3, DVec3};

/// Least distance of an isosurface's vertex from the voxels at both ends of its edge, in voxels. So no two vertices meet, also where a voxel equals the
/// isovalue, and 32-bit coordinates tell vertices apart up to 8192 voxels from the origin.
pub(crate) const LEAST_DISTANCE: f64 = 1.0 / 1024.0;

/// The affine map from continuous indices of voxels (whole at centres) to the world.
#[derive(Clone, Copy, Debug)]
pub(crate) struct World {
    first: DVec3,
    steps: [DVec3; 3],
    /// Whether the map turns faces inside out.
    pub(crate) mirrors: bool,
    /// Least edge of a voxel.
    pub(crate) least_step: f64,
}

impl World {
    pub(crate) fn of(store: &Store, level: Level) -> Self {
        let (spacing, centre) = store.geometry().level_placement(store.pyramid().level(level).factor);
        let placement = store.placement();
        let steps: [DVec3; 3] = std::array::from_fn(|a| placement.world_vector(DVec3::AXES[a] * spacing[a]));
        Self {
            first: placement.world_from_volume(centre),
            steps,
            mirrors: steps[0].cross(steps[1]).dot(steps[2]) < 0.0,
            least_step: spacing.min_element() * placement.stretches().1,
        }
    }

    pub(crate) fn place(&self, index: DVec3) -> DVec3 {
        let [x, y, z] = self.steps;
        self.first + index.x * x + index.y * y + index.z * z
    }

    /// The continuous index of a place: the inverse of [`place`](Self::place).
    pub(crate) fn index(&self, place: DVec3) -> DVec3 {
        let [x, y, z] = self.steps;
        DMat3::from_cols(x, y, z).inverse() * (place - self.first)
    }

    /// Whether 32-bit coordinates keep apart all vertices of surfaces in this box of voxels.
    pub(crate) fn fits_single(&self, region: VoxelBox) -> bool {
        let ends = [region.min.to_array().map(f64::from), region.max.to_array().map(f64::from)];
        let corner = |i: usize| self.place(DVec3::from_array(std::array::from_fn(|a| ends[i >> a & 1][a])));
        let greatest = (0..8).map(|i| corner(i).abs().max_element()).fold(0.0, f64::max) as f32;
        let unit = f64::from(greatest.next_up()) - f64::from(greatest);
        // Vertices differ in some coordinate by this over the root of three; rounding takes a unit at most.
        unit * 2.0 <= LEAST_DISTANCE * self.least_step
    }
}
