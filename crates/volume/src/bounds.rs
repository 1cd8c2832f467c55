//! Bounds of a scene's numbers. Beyond them single precision (as on GPUs) or the steps of rays no longer separate places, and pictures are silently
//! wrong or black; such scenes are refused. Found by comparing all renderers with the oracle (`tests/bounds.rs`); within them pictures agree.

use crate::camera::ViewRays;
use crate::ensure::ensure;
use crate::geometry::{Geometry, box_corners};
use crate::numbers::significant;
use crate::placement::Placement;
use crate::space::Extent;
use glam::DVec3;
use std::ops::RangeInclusive;

/// The least step, in voxels of the finest visible layer.
pub const LEAST_STEP: f64 = 0.005;
/// The greatest step, in voxels of the finest visible layer.
pub const MOST_STEP: f64 = 16.0;

/// The permitted steps.
pub const STEPS: RangeInclusive<f64> = LEAST_STEP..=MOST_STEP;

/// The least height of an orthographic picture, in voxels.
const LEAST_HEIGHT: f64 = 0.001;

/// Greatest distance of an eye from a volume's middle: in voxels, or in longest sides of the volume, whichever is farther.
const FARTHEST_VOXELS: f64 = 1e5;
const FARTHEST_SIDES: f64 = 8.0;

/// The most steps from an eye to the far end of a volume.
const MOST_STEPS: f64 = (1 << 25) as f64;

/// Permitted voxel sizes in world units.
const VOXEL_SIZES: RangeInclusive<f64> = 1e-15..=1e15;

/// Greatest distance of a volume from the world's origin, in voxels: doubles resolve a thousandth of one there.
const FARTHEST_FROM_ORIGIN: f64 = 1e12;

/// Why a camera's rays cannot draw a volume.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ReachError {
    /// A voxel is too large or too small; the number is its size in world units.
    #[error(
        "a voxel is {} world units large: expected {:e} to {:e}; scale the volume by its matrix",
        significant(*.0, 3), VOXEL_SIZES.start(), VOXEL_SIZES.end()
    )]
    VoxelSize(f64),
    /// The volume is too far from the world's origin; the number is its distance in its own voxels.
    #[error(
        "the volume is {} of its voxels away from the world's origin: expected at most {FARTHEST_FROM_ORIGIN:e}; move it nearer by its \
         matrix", significant(*.0, 3)
    )]
    Origin(f64),
    /// The eye is too far from the volume.
    #[error(
        "the camera's eye is {} voxels away from the volume: expected at most {}; move it nearer, with a wider field \
         of view",
        significant(*.voxels, 3), significant(*.most, 3)
    )]
    Eye {
        /// Distance from the volume's middle in voxels, along the axis where it is greatest.
        voxels: f64,
        /// The greatest permitted distance.
        most: f64,
    },
    /// Parallel rays show too small a part of the volume; the number is the picture's height in voxels.
    #[error(
        "the picture is {} voxels high: expected at least {LEAST_HEIGHT}; give it a greater orthographic height",
        significant(*.0, 3)
    )]
    Height(f64),
    /// A ray takes too many steps; the number is their count.
    #[error(
        "rays take {} steps from the camera's eye to the volume's far end: expected at most {MOST_STEPS}; take longer \
         steps, or move the eye nearer", significant(*.0, 3)
    )]
    Steps(f64),
}

/// A volume placed in a scene's world.
#[derive(Clone, Copy, Debug)]
pub struct Standing<'a> {
    /// Positions of its voxels in its own world.
    pub geometry: &'a Geometry,
    /// Number of voxels along each axis.
    pub extent: Extent,
    /// Placement of its own world in the scene's.
    pub placement: &'a Placement,
}

impl Standing<'_> {
    /// Checks that these rays, with steps of `step` world units, can draw the volume.
    ///
    /// # Errors
    /// The first number out of bounds.
    pub fn check(&self, rays: &ViewRays, step: f64) -> Result<(), ReachError> {
        let Self { geometry, extent, placement } = *self;
        let voxel = placement.voxel_size(geometry, extent);
        ensure(VOXEL_SIZES.contains(&voxel), || ReachError::VoxelSize(voxel))?;
        let world_box = placement.world_box(geometry.world_box(extent));
        let from_origin = world_box.0.abs().max(world_box.1.abs()).max_element() / voxel;
        ensure((0.0..=FARTHEST_FROM_ORIGIN).contains(&from_origin), || ReachError::Origin(from_origin))?;
        let sides = DVec3::from_array(extent.to_array().map(f64::from));
        let eye = geometry.voxel_from_world(placement.volume_from_world(rays.eye));
        let voxels = (eye - sides * 0.5).abs().max_element();
        let most = FARTHEST_VOXELS.max(FARTHEST_SIDES * sides.max_element());
        ensure((0.0..=most).contains(&voxels), || ReachError::Eye { voxels, most })?;
        let height = 2.0 * rays.up.length() / voxel;
        ensure(!(rays.orthographic && height < LEAST_HEIGHT), || ReachError::Height(height))?;
        let farthest = box_corners(world_box).into_iter().map(|corner| corner.distance(rays.eye)).fold(0.0, f64::max);
        let steps = farthest / step;
        if steps > MOST_STEPS { Err(ReachError::Steps(steps)) } else { Ok(()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Camera, Projection};

    #[test]
    fn what_is_out_of_bounds_is_named() {
        let extent = Extent::new(64, 64, 64);
        let of = |eye: DVec3, projection, scale: &str, step: f64| {
            let (geometry, placement) = (Geometry::default(), Placement::from_text(scale).expect("a map"));
            let rays = Camera { eye, target: DVec3::splat(31.5), up: DVec3::Z, projection }.rays(64, 64).expect("rays");
            Standing { geometry: &geometry, extent, placement: &placement }.check(&rays, step)
        };
        let (fov, own) = (Projection::Perspective { fov_y_deg: 1.0 }, "1 0 0 0  0 1 0 0  0 0 1 0");
        let parallel = |height| Projection::Orthographic { height };
        let far = |y: f64| DVec3::new(31.5, y, 31.5);
        assert_eq!(of(far(-9.9e4), fov, own, 1.0), Ok(()));
        assert_eq!(of(far(-9.9e4), parallel(0.001), own, 1.0), Ok(()));
        for (found, word) in [
            (of(far(-2e9), fov, own, 1.0), "2e9 voxels away from the volume: expected at most 100000"),
            (of(far(-2e5), parallel(9.0), own, 1.0), "200000 voxels away"),
            (of(far(-99.0), parallel(1e-6), own, 1.0), "1e-6 voxels high: expected at least 0.001"),
            (of(far(-200.0), fov, own, 5e-6), "steps from the camera's eye"),
            (of(far(-99.0), fov, "1 0 0 1e30  0 1 0 0  0 0 1 0", 1.0), "1e30 of its voxels away"),
            (of(far(-99.0), fov, "1e30 0 0 0  0 1e30 0 0  0 0 1e30 0", 1.0), "a voxel is 1e30 world units"),
        ] {
            let said = found.expect_err(word).to_string();
            assert!(said.contains(word), "{said}");
        }
    }
}
