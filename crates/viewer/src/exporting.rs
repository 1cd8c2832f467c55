//! The export of voxels from a window: the visible part of a store, and the progress of its file.

use crate::planes::{Grid, first_shown};
use crate::work_row;
use brickyard::background::{self, Background, BackgroundError};
use brickyard::export::{ExportChannels, ExportError, ExportRequest, ExportTime, Exported};
use brickyard::session::VolumeSource;
use brickyard::store::Store;
use brickyard::volume::{Extent, Scene, VoxelBox, VoxelType, box_corners};
use eframe::egui::Ui;
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Distance from a border between voxels, in voxels, within which a face lies on it: the world rounds faces.
const SNAP: f64 = 1e-6;

/// The visible part of a store.
pub(crate) struct Part {
    store: Arc<Store>,
    request: ExportRequest,
    pub(crate) extent: Extent,
}

impl Part {
    /// The first visible layer within clip box and crop, in its finest voxels: every voxel the boxes overlap. A box turned against the voxels counts
    /// as its bounding box in voxels.
    ///
    /// # Errors
    /// If no layer is visible, its volume is no store yet, or the boxes leave nothing of it.
    pub(crate) fn of(scene: &Scene, volumes: &[VolumeSource]) -> Result<Self, String> {
        let layer = first_shown(scene).ok_or("no layer is shown")?;
        let volume = volumes.get(scene.store(layer)).ok_or("the layer's volume is missing")?;
        let grid = Grid::of(scene, volumes).ok_or("the layer has no valid placement")?;
        let store = volume.store().ok_or("voxels are exported from a store: wait until this volume is packed")?.clone();
        let crop = scene.layers[layer].crop;
        let region = scene.clip.map(|clip| voxels_around(&grid, clip)).into_iter().chain(crop);
        let everything = VoxelBox::new([0; 3], grid.extent);
        let region = region.fold(everything, |region, corners| region.intersect(touched(corners, grid.extent)));
        if region.is_empty() {
            return Err("the first visible layer has no voxels within clip box and crop".into());
        }
        let step = VolumeSource::timeline(volumes, scene).step_of(scene.store(layer), scene.time);
        let (time, channels) = (ExportTime::Step(step), ExportChannels::One(scene.layers[layer].channel));
        let request = ExportRequest { time, channels, region: Some(region), ..ExportRequest::default() };
        Ok(Self { store, request, extent: region.extent() })
    }

    pub(crate) fn voxel_type(&self) -> VoxelType {
        self.store.voxel_type()
    }

    pub(crate) fn bytes(&self) -> u64 {
        self.extent.volume() * self.voxel_type().bytes() as u64
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

/// An export under way. Dropping it stops the export and waits for its end.
pub(crate) struct Exporting {
    path: PathBuf,
    voxel_type: VoxelType,
    work: Background<Exported, ExportError>,
}

impl Exporting {
    /// Starts writing a part to a file, whose name tells the format. An existing file is left as it is.
    pub(crate) fn start(part: Part, path: &Path) -> Self {
        let voxel_type = part.voxel_type();
        Self { path: path.into(), voxel_type, work: background::export(part.store, path.into(), part.request) }
    }

    /// The resulting message, once it is over.
    pub(crate) fn poll(&mut self) -> Option<Result<String, String>> {
        let path = self.path.display();
        Some(match self.work.poll()? {
            Ok(Exported { extent: Extent { x, y, z }, notes, .. }) => {
                let wrote = format!("wrote {path}: {x} x {y} x {z} {}", self.voxel_type);
                Ok([&[wrote][..], &notes[..]].concat().join(". "))
            }
            Err(BackgroundError::Failed(ExportError::Exists { .. })) => {
                Err(format!("{path}: exists already; choose another name"))
            }
            Err(error) => Err(error.to_string()),
        })
    }

    pub(crate) fn is_stopped(&self) -> bool {
        self.work.meter().is_cancelled()
    }

    /// Shows the progress, and a button to stop it.
    pub(crate) fn show(&self, ui: &mut Ui) {
        if work_row::show(ui, "exporting", &self.path, self.work.meter().progress(), true) {
            self.work.meter().cancel();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard::import::{SynthKind, SynthSource};
    use brickyard::store::{PackOptions, pack};
    use brickyard::volume::{Placement, SceneLayer};
    use glam::{DAffine3, DQuat};

    fn store(folder: &Path) -> VolumeSource {
        let source = SynthSource::new(SynthKind::Turbulence, Extent::new(30, 20, 10), VoxelType::U16, 1, 1).unwrap();
        let path = folder.join("a.zarr");
        pack(&source, &path, &PackOptions::new(VoxelType::U16), &()).unwrap();
        VolumeSource::open(path).unwrap()
    }

    fn region(scene: &Scene, volume: &VolumeSource) -> Result<VoxelBox, String> {
        Part::of(scene, std::slice::from_ref(volume)).map(|part| part.request.region.unwrap())
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
        assert_eq!(region(&scene, &volume), Ok(VoxelBox::new([0; 3], [30, 20, 10])));
        let grid = Grid::of(&scene, std::slice::from_ref(&volume)).unwrap();
        let clip =
            |low: [f64; 3], high: [f64; 3]| Some([low, high].map(|at| grid.world_from_voxel(DVec3::from_array(at))));
        // Borders rounded in the world are borders all the same.
        scene.clip = clip([3.0, 6.0, 7.0], [29.0, 13.0, 9.0]);
        assert_eq!(region(&scene, &volume), Ok(VoxelBox::new([3, 6, 7], [29, 13, 9])));
        scene.clip = clip([3.4, 6.9, -50.0], [3.5, 13.01, 1e9]);
        assert_eq!(region(&scene, &volume), Ok(VoxelBox::new([3, 6, 0], [4, 14, 10])));
        scene.layers[0].crop = Some([DVec3::new(0.0, 8.5, 2.0), DVec3::new(30.0, 12.0, 5.0)]);
        assert_eq!(region(&scene, &volume), Ok(VoxelBox::new([3, 8, 2], [4, 12, 5])));
        scene.clip = clip([40.0; 3], [50.0; 3]);
        assert!(region(&scene, &volume).unwrap_err().contains("no voxels within"));
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
        let found = region(&scene, &volume).unwrap();
        for at in [low, high, DVec3::new(low.x, high.y, 2.0), DVec3::new(high.x, low.y, 2.0)] {
            let voxel = turn.inverse().transform_point3(at) + 0.5;
            for axis in 0..3 {
                let span = f64::from(found.min.to_array()[axis]) - SNAP..=f64::from(found.max.to_array()[axis]) + SNAP;
                assert!(span.contains(&voxel[axis]), "{voxel} is not in {found:?}");
            }
        }
    }

    #[test]
    fn what_cannot_be_exported_is_said() {
        let preview = crate::nothing::volume();
        assert!(region(&Scene::default(), &preview).unwrap_err().contains("until this volume is packed"));
        let mut scene = Scene::default();
        scene.layers[0].visible = false;
        assert!(region(&scene, &preview).unwrap_err().contains("no layer is shown"));
        let folder = tempfile::tempdir().unwrap();
        let volume = store(folder.path());
        let path = folder.path().join("a.raw");
        let ended = || {
            let part = Part::of(&Scene::default(), std::slice::from_ref(&volume)).unwrap();
            assert_eq!(part.bytes(), 12_000);
            let mut exporting = Exporting::start(part, &path);
            loop {
                if let Some(ended) = exporting.poll() {
                    return ended;
                }
                std::thread::yield_now();
            }
        };
        assert_eq!(ended(), Ok(format!("wrote {}: 30 x 20 x 10 u16", path.display())));
        assert!(ended().unwrap_err().ends_with("exists already; choose another name"));
    }
}
