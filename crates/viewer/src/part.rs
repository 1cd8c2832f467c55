//! The visible part of a store, to make files of it: the voxels of the first visible layer within clip box and crop, at any level.

use crate::planes::{Grid, first_shown};
use brickyard::session::VolumeSource;
use brickyard::store::Store;
use brickyard::volume::{Extent, Level, Scene, VoxelBox, box_corners};
use glam::DVec3;
use std::sync::Arc;

/// Distance from a border between voxels, in voxels, within which a face lies on it: the world rounds faces.
const SNAP: f64 = 1e-6;

/// The visible part of a store.
#[derive(Clone)]
pub(crate) struct Part {
    pub(crate) store: Arc<Store>,
    /// The layer's channel, and its shown step.
    pub(crate) channel: u32,
    pub(crate) step: u32,
    pub(crate) level: Level,
    /// The visible box, in voxels of the level.
    pub(crate) region: VoxelBox,
}

/// The first visible layer, its volume, and the volume's store.
///
/// # Errors
/// If no layer is visible, or its volume is no store yet.
pub(crate) fn first_store<'a>(
    scene: &Scene,
    volumes: &'a [VolumeSource],
) -> Result<(usize, &'a VolumeSource, &'a Arc<Store>), String> {
    let layer = first_shown(scene).ok_or("no layer is shown")?;
    let volume = volumes.get(scene.store(layer)).ok_or("the layer's volume is missing")?;
    let store = volume.store().ok_or("this takes a store: wait until this volume is packed")?;
    Ok((layer, volume, store))
}

impl Part {
    /// The first visible layer within clip box and crop, in voxels of a level: every voxel the boxes overlap. A box turned against the voxels counts as
    /// its bounding box in voxels.
    ///
    /// # Errors
    /// If no layer is visible, its volume is no store yet or lacks the level, or the boxes leave nothing of it.
    pub(crate) fn of(scene: &Scene, volumes: &[VolumeSource], level: u8) -> Result<Self, String> {
        let (layer, _, store) = first_store(scene, volumes)?;
        let grid = Grid::of(scene, volumes).ok_or("the layer has no valid placement")?;
        let levels = store.pyramid().levels();
        let of_level = levels.get(usize::from(level)).ok_or_else(|| {
            let coarsest = store.pyramid().coarsest();
            format!("there is no level {level}: expected 0 to {coarsest}")
        })?;
        let factor = DVec3::from_array(of_level.factor.map(f64::from));
        let boxes = scene.clip.map(|clip| voxels_around(&grid, clip)).into_iter().chain(scene.layers[layer].crop);
        let touched = boxes.map(|corners| touched(corners.map(|corner| corner / factor), of_level.extent.to_array()));
        let region = touched.fold(of_level.extent.full_box(), VoxelBox::intersect);
        if region.is_empty() {
            return Err("the first visible layer has no voxels within clip box and crop".into());
        }
        let step = VolumeSource::timeline(volumes, scene).step_of(scene.store(layer), scene.time);
        let channel = scene.layers[layer].channel;
        Ok(Self { store: store.clone(), channel, step, level: Level(level), region })
    }

    /// The coarsest level of the store.
    pub(crate) fn coarsest(&self) -> u8 {
        self.store.pyramid().coarsest().0
    }

    /// The part in words.
    pub(crate) fn in_words(&self) -> String {
        let Extent { x, y, z } = self.region.extent();
        format!("{x} x {y} x {z} voxels, {}", self.store.voxel_type())
    }
}

/// Corners of a world box's bounding box, in voxels.
fn voxels_around(grid: &Grid, [low, high]: [DVec3; 2]) -> [DVec3; 2] {
    let corners = box_corners((low, high)).into_iter().map(|corner| grid.voxel_from_world(corner));
    corners.fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], at| [low.min(at), high.max(at)])
}

fn touched([low, high]: [DVec3; 2], extent: [u32; 3]) -> VoxelBox {
    let within = |at: DVec3| std::array::from_fn(|axis| at[axis].clamp(0.0, f64::from(extent[axis])) as u32);
    VoxelBox::new(within((low + SNAP).floor()), within((high - SNAP).ceil()))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use brickyard::import::{SynthKind, SynthSource};
    use brickyard::store::{PackOptions, pack};
    use brickyard::volume::{Placement, SceneLayer, VoxelType};
    use glam::{DAffine3, DQuat};
    use std::path::Path;

    /// A store of 30 x 20 x 10 voxels in three steps, with a second level.
    pub(crate) fn store(folder: &Path) -> VolumeSource {
        let source = SynthSource::new(SynthKind::Turbulence, Extent::new(30, 20, 10), VoxelType::U16, 3, 1).unwrap();
        let path = folder.join("a.zarr");
        pack(&source, &path, &PackOptions { edge: 16, ..PackOptions::new(VoxelType::U16) }, &()).unwrap();
        VolumeSource::open(path).unwrap()
    }

    fn region(scene: &Scene, volume: &VolumeSource, level: u8) -> Result<VoxelBox, String> {
        Part::of(scene, std::slice::from_ref(volume), level).map(|part| part.region)
    }

    /// A scene of one layer, its voxels scaled by 0.1 and moved.
    fn scene() -> Scene {
        let placement =
            DAffine3::from_scale(DVec3::splat(0.1)) * DAffine3::from_translation(DVec3::new(7.0, -3.0, 0.7));
        let layer = SceneLayer { world_from_volume: Placement::new(placement).unwrap(), ..SceneLayer::default() };
        Scene { layers: vec![layer], ..Scene::default() }
    }

    #[test]
    fn boxes_of_the_world_leave_the_voxels_that_they_have_a_part_of() {
        let folder = tempfile::tempdir().unwrap();
        let volume = store(folder.path());
        let mut scene = scene();
        assert_eq!(region(&scene, &volume, 0), Ok(VoxelBox::new([0; 3], [30, 20, 10])));
        let grid = Grid::of(&scene, std::slice::from_ref(&volume)).unwrap();
        let clip =
            |low: [f64; 3], high: [f64; 3]| Some([low, high].map(|at| grid.world_from_voxel(DVec3::from_array(at))));
        // Borders rounded in the world are borders all the same.
        scene.clip = clip([3.0, 6.0, 7.0], [29.0, 13.0, 9.0]);
        assert_eq!(region(&scene, &volume, 0), Ok(VoxelBox::new([3, 6, 7], [29, 13, 9])));
        assert_eq!(region(&scene, &volume, 1), Ok(VoxelBox::new([1, 3, 3], [15, 7, 5])));
        assert!(region(&scene, &volume, 2).unwrap_err().contains("expected 0 to 1"));
        scene.clip = clip([3.4, 6.9, -50.0], [3.5, 13.01, 1e9]);
        assert_eq!(region(&scene, &volume, 0), Ok(VoxelBox::new([3, 6, 0], [4, 14, 10])));
        scene.layers[0].crop = Some([DVec3::new(0.0, 8.5, 2.0), DVec3::new(30.0, 12.0, 5.0)]);
        assert_eq!(region(&scene, &volume, 0), Ok(VoxelBox::new([3, 8, 2], [4, 12, 5])));
        scene.clip = clip([40.0; 3], [50.0; 3]);
        assert!(region(&scene, &volume, 0).unwrap_err().contains("no voxels within"));
    }

    #[test]
    fn a_box_across_turned_voxels_is_within_what_is_left() {
        let folder = tempfile::tempdir().unwrap();
        let volume = store(folder.path());
        let mut scene = Scene::default();
        let turn = DAffine3::from_quat(DQuat::from_rotation_z(0.5));
        scene.layers[0].world_from_volume = Placement::new(turn).unwrap();
        let [low, high] = [DVec3::new(2.0, 9.0, 1.0), DVec3::new(9.0, 12.0, 5.0)];
        scene.clip = Some([low, high]);
        let found = region(&scene, &volume, 0).unwrap();
        for at in [low, high, DVec3::new(low.x, high.y, 2.0), DVec3::new(high.x, low.y, 2.0)] {
            let voxel = turn.inverse().transform_point3(at) + 0.5;
            for axis in 0..3 {
                let span = f64::from(found.min.to_array()[axis]) - SNAP..=f64::from(found.max.to_array()[axis]) + SNAP;
                assert!(span.contains(&voxel[axis]), "{voxel} is not in {found:?}");
            }
        }
    }

    #[test]
    fn what_has_no_part_is_said() {
        let preview = crate::nothing::volume();
        assert!(region(&Scene::default(), &preview, 0).unwrap_err().contains("until this volume is packed"));
        let mut scene = Scene::default();
        scene.layers[0].visible = false;
        assert!(region(&scene, &preview, 0).unwrap_err().contains("no layer is shown"));
    }
}
