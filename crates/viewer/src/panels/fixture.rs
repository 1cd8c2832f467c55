//! The fixture of the panels' tests: in-memory volumes, and a scene of them.

use brickyard::pager::{BrickError, BrickSource};
use brickyard::session::VolumeSource;
use brickyard::store::Histogram;
use brickyard::volume::{BrickId, Extent, Geometry, Mesh, MeshLook, Pyramid, Scene, SceneLayer, VoxelType};
use std::sync::Arc;

pub(crate) const EXTENT: [u32; 3] = [16, 24, 32];

/// A volume of one value, in two channels and three time steps.
struct Constant {
    pyramid: Pyramid,
    geometry: Geometry,
    are_labels: bool,
}

impl BrickSource for Constant {
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
    fn is_labels(&self) -> bool {
        self.are_labels
    }
    fn times(&self) -> u32 {
        3
    }
    fn channels(&self) -> u32 {
        2
    }
    fn read_core(&self, _: BrickId, out: &mut [u8]) -> Result<(), BrickError> {
        out.fill(7);
        Ok(())
    }
}

fn volume(are_labels: bool) -> VolumeSource {
    let pyramid = Pyramid::new(Extent::from_array(EXTENT), [1.0; 3], 8);
    let geometry = Geometry { unit: Some("millimeter".into()), ..Geometry::default() };
    VolumeSource::new(Arc::new(Constant { pyramid, geometry, are_labels }))
}

/// A volume of measurements, and one of labels.
pub(crate) fn volumes() -> Vec<VolumeSource> {
    vec![volume(false), volume(true)]
}

/// A scene of two layers of the first volume and one of the second.
pub(crate) fn scene() -> Scene {
    let of = |store| SceneLayer { source: Some(store), ..SceneLayer::default() };
    Scene { layers: vec![of(0), of(0), of(1)], ..Scene::default() }
}

/// A mesh of one triangle.
pub(crate) fn mesh() -> MeshLook {
    let corners = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let mesh = Mesh::new(corners, vec![[0, 1, 2]], Vec::new(), Vec::new()).expect("a triangle");
    MeshLook { mesh: Some(Arc::new(mesh)), ..MeshLook::new("organ.stl") }
}

/// A histogram of two humps.
pub(crate) fn histogram() -> Histogram {
    let hump = |bin: f64, middle: f64, width: f64| (-((bin - middle) / width).powi(2)).exp();
    let count = |bin: u32| (1e6 * hump(f64::from(bin), 30.0, 14.0) + 2e4 * hump(f64::from(bin), 150.0, 30.0)) as u64;
    Histogram { low: 0.0, width: 1.0, counts: (0..256).map(count).collect() }
}

/// Panics if a scene cannot be shown.
#[track_caller]
pub(crate) fn check(scene: &Scene, volumes: &[VolumeSource]) {
    let counts: Vec<_> = volumes.iter().map(VolumeSource::counts).collect();
    if let Err(error) = scene.check(&counts) {
        panic!("{error}");
    }
}
