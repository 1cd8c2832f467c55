//! Three slices through one point, along the voxels of the first visible layer: their voxels, their scenes, and the cameras looking straight at them.
//! Arithmetic alone.

use crate::panels::layers::style::shown;
use crate::state::{PlaneFilter, Planes};
use brickyard::session::VolumeSource;
use brickyard::volume::{
    Camera, Filter, Lighting, Mode, PixelSamples, Placement, Projection, Sampling, Scene, SceneLayer, Side, Slice,
    TransferChoice,
};
use glam::DVec3;

/// Least size of a voxel shown as a square, in pixels.
const SQUARE_PX: f64 = 2.0;

/// The voxels of a volume in the scene's world.
#[derive(Clone, Debug)]
pub(crate) struct Grid {
    placement: Placement,
    geometry: brickyard::volume::Geometry,
    pub(crate) extent: [u32; 3],
    /// Original voxels per voxel along each axis.
    pub(crate) stride: [u32; 3],
    /// Whether the world is a patient's.
    pub(crate) is_anatomical: bool,
    world_box: (DVec3, DVec3),
}

/// The first visible layer of a scene, if any.
pub(crate) fn first_shown(scene: &Scene) -> Option<usize> {
    scene.layers.iter().position(|layer| layer.visible)
}

impl Grid {
    /// The voxels of a scene's first visible layer, if any.
    pub(crate) fn of(scene: &Scene, volumes: &[VolumeSource]) -> Option<Self> {
        let layer = first_shown(scene)?;
        let volume = volumes.get(scene.store(layer))?;
        let place = volume.place();
        let placement = scene.placement(layer, &place).ok()?;
        Some(Self {
            placement,
            geometry: volume.source.geometry().clone(),
            extent: volume.source.pyramid().levels()[0].extent.to_array(),
            stride: volume.stride(),
            is_anatomical: place.is_anatomical,
            world_box: placement.world_box(place.own_box),
        })
    }

    /// Converts a world point to voxels: voxel `i` reaches from `i` to `i + 1` along each axis.
    pub(crate) fn voxel_from_world(&self, point: DVec3) -> DVec3 {
        self.geometry.voxel_from_world(self.placement.volume_from_world(point))
    }

    pub(crate) fn world_from_voxel(&self, voxel: DVec3) -> DVec3 {
        self.placement.world_from_volume(self.geometry.world_from_voxel(voxel))
    }

    /// The voxel at a world point, or the nearest one.
    pub(crate) fn voxel_at(&self, point: DVec3) -> [u32; 3] {
        let voxel = self.voxel_from_world(point);
        std::array::from_fn(|axis| (voxel[axis].max(0.0) as u32).min(self.extent[axis] - 1))
    }

    pub(crate) fn centre(&self, voxel: [u32; 3]) -> DVec3 {
        self.world_from_voxel(DVec3::from_array(voxel.map(f64::from)) + 0.5)
    }

    /// The slices' common world point: the centre of the crosshair's voxel, or of the middle one.
    pub(crate) fn crosshair(&self, planes: &Planes) -> DVec3 {
        match planes.crosshair {
            Some(point) => self.centre(self.voxel_at(point)),
            None => self.centre(self.extent.map(|count| count / 2)),
        }
    }

    /// The world vector between neighbouring voxels along an axis.
    fn step(&self, axis: usize) -> DVec3 {
        self.placement.world_vector(DVec3::AXES[axis] * self.geometry.spacing)
    }

    /// The slice across an axis of the voxels, through the voxel at a point.
    pub(crate) fn slice(&self, axis: usize, point: DVec3, thickness: f64) -> Slice {
        let across = self.step((axis + 1) % 3).cross(self.step((axis + 2) % 3));
        let nominal = match self.is_anatomical {
            true => Slice::of_patient(dominant(across), 0.0).normal,
            false => Slice::across(dominant(across), 0.0).normal,
        };
        let normal = across * across.dot(nominal).signum();
        Slice { point, normal: normal.normalize_or_zero(), thickness }
    }

    /// Reach of a slice across an axis to each side: half a voxel, or half its thickness if larger.
    pub(crate) fn reach(&self, slice: &Slice, axis: usize) -> f64 {
        let voxel = self.step(axis).dot(slice.normal).abs();
        // Points are rounded on their way through JSON and the world.
        0.5 * voxel.max(slice.thickness) * (1.0 + 1e-9)
    }

    /// The voxels' direction closest to upwards in a slice across an axis.
    fn up(&self, axis: usize, slice: &Slice) -> DVec3 {
        let nominal = if self.is_anatomical { Side::of(slice.normal).up() } else { slice.image_up() };
        let steps = [1, 2].map(|other| self.step((axis + other) % 3).normalize_or_zero());
        let up = steps.into_iter().max_by(|a, b| a.dot(nominal).abs().total_cmp(&b.dot(nominal).abs()));
        up.map_or(nominal, |up| up * up.dot(nominal).signum())
    }

    /// The camera looking straight at a slice across an axis: one that sees all of it, or the given one, moved to it.
    pub(crate) fn camera(&self, axis: usize, slice: &Slice, camera: Option<Camera>, size_px: (u32, u32)) -> Camera {
        let whole = slice.camera(self.world_box, self.up(axis, slice), size_px);
        let Some(camera) = camera else { return whole };
        let target = camera.target - slice.normal * (camera.target - slice.point).dot(slice.normal);
        let distance = whole.eye.distance(whole.target);
        Camera { eye: target + slice.normal * distance, target, up: whole.up, projection: camera.projection }
    }

    /// The name of the slices across an axis: the anatomical one for patients, else their axes.
    pub(crate) fn name(&self, axis: usize) -> &'static str {
        match (self.is_anatomical, axis) {
            (true, _) => ["sagittal", "coronal", "axial"][dominant(self.step(axis))],
            (false, 0) => "yz",
            (false, 1) => "xz",
            (false, _) => "xy",
        }
    }
}

/// The axis of a vector's largest component.
fn dominant(vector: DVec3) -> usize {
    let size = vector.abs();
    if size.z >= size.x && size.z >= size.y { 2 } else { usize::from(size.y > size.x) }
}

/// The scene of a slice: the layers of another scene without light, clips and surfaces, read through a filter. `planes.gray` replaces transfer
/// functions by a gray ramp over the values they span, except for labels.
pub(crate) fn slice_scene(
    scene: &Scene,
    volumes: &[VolumeSource],
    slice: Slice,
    camera: Camera,
    filter: Filter,
    planes: &Planes,
) -> Scene {
    let first = first_shown(scene);
    let layers = scene.layers.iter().enumerate().map(|(i, layer)| SceneLayer {
        isosurfaces: Vec::new(),
        crop: None,
        transfer: layer.transfer.clone().filter(|choice| !planes.gray || is_of_labels(choice)),
        window: planes.window.filter(|_| first == Some(i)).or_else(|| spanned(layer, volumes.get(scene.store(i)))),
        ..layer.clone()
    });
    let is_thick = slice.thickness > 0.0 && scene.mode.is_projection();
    Scene {
        camera: Some(camera),
        stereo: None,
        mode: if is_thick { scene.mode } else { Mode::Average },
        sampling: Sampling { filter, ..Sampling::default() },
        lighting: Lighting::default(),
        pixel_samples: PixelSamples::ONE,
        clip: None,
        clip_planes: Vec::new(),
        caps: None,
        slice: Some(slice),
        meshes: Vec::new(),
        layers: layers.collect(),
        ..scene.clone()
    }
}

/// A layer's window: its own, or the span of a transfer function with values of its own; `None` is the volume's.
fn spanned(layer: &SceneLayer, volume: Option<&VolumeSource>) -> Option<[f64; 2]> {
    let own = layer.transfer.as_ref().filter(|choice| !choice.spans_window() && !is_of_labels(choice));
    layer.window.or_else(|| Some(shown(layer, own.and(volume)?)))
}

fn is_of_labels(choice: &TransferChoice) -> bool {
    matches!(choice, TransferChoice::Function(function) if function.labels.is_some())
}

/// The filter for a slice's voxels in a picture of `height_px` pixels.
pub(crate) fn filter(grid: &Grid, chosen: PlaneFilter, camera: &Camera, height_px: u32) -> Filter {
    let voxel = (0..3).map(|axis| grid.step(axis).length()).fold(f64::INFINITY, f64::min);
    let Projection::Orthographic { height } = camera.projection else { return Filter::Trilinear };
    let is_square = match chosen {
        PlaneFilter::Auto => voxel >= SQUARE_PX * (height / f64::from(height_px)),
        PlaneFilter::Nearest => true,
        PlaneFilter::Linear => false,
    };
    if is_square { Filter::Nearest } else { Filter::Trilinear }
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard::pager::{BrickError, BrickSource};
    use brickyard::volume::{BrickId, Extent, Geometry, Orientation, Pyramid, VoxelType};
    use std::sync::Arc;

    struct Empty(Pyramid, Geometry);

    impl BrickSource for Empty {
        fn pyramid(&self) -> &Pyramid {
            &self.0
        }
        fn geometry(&self) -> &Geometry {
            &self.1
        }
        fn voxel_type(&self) -> VoxelType {
            VoxelType::U8
        }
        fn value_range(&self) -> (f64, f64) {
            (0.0, 255.0)
        }
        fn read_core(&self, _: BrickId, _: &mut [u8]) -> Result<(), BrickError> {
            Ok(())
        }
    }

    fn grid(orientation: Option<Orientation>) -> Grid {
        let geometry =
            Geometry { spacing: DVec3::new(0.5, 1.0, 2.0), origin: DVec3::new(3.0, -2.0, 1.0), ..Geometry::default() };
        let pyramid = Pyramid::new(Extent::new(20, 30, 8), geometry.spacing.to_array(), 8);
        let volume = VolumeSource::new(Arc::new(Empty(pyramid, geometry)));
        let volume = match orientation {
            Some(orientation) => volume.oriented(orientation).unwrap(),
            None => volume,
        };
        Grid::of(&Scene::default(), &[volume]).unwrap()
    }

    #[test]
    fn slices_meet_in_the_centre_of_a_voxel() {
        let grid = grid(None);
        let planes = Planes { crosshair: Some(DVec3::new(5.1, 0.4, 100.0)), ..Planes::default() };
        let point = grid.crosshair(&planes);
        // Voxels of 0.5 x 1 x 2, the first centred at 3, -2, 1; the last one along z at 15.
        assert!((point - DVec3::new(5.0, 0.0, 15.0)).length() < 1e-9, "{point}");
        assert_eq!(grid.voxel_at(point), [4, 2, 7]);
        assert_eq!(grid.voxel_at(grid.crosshair(&Planes::default())), [10, 15, 4]);
    }

    #[test]
    fn slices_are_seen_as_images_are() {
        let grid = grid(None);
        let point = grid.crosshair(&Planes::default());
        for (axis, right, up) in [(2, DVec3::X, DVec3::NEG_Y), (1, DVec3::X, DVec3::Z), (0, DVec3::Y, DVec3::Z)] {
            let slice = grid.slice(axis, point, 0.0);
            let camera = grid.camera(axis, &slice, None, (300, 200));
            let rays = camera.rays(300, 200).unwrap();
            assert!(rays.right.normalize().dot(right) > 1.0 - 1e-9 && rays.up.normalize().dot(up) > 1.0 - 1e-9);
            let moved = grid.slice(axis, point + DVec3::splat(0.9), 0.0);
            let again = grid.camera(axis, &moved, Some(camera), (300, 200));
            assert!((again.target - moved.point).dot(moved.normal).abs() < 1e-9, "it stays on the slice");
            assert_eq!(again.projection, camera.projection);
        }
        assert_eq!([0, 1, 2].map(|axis| grid.name(axis)), ["yz", "xz", "xy"]);
    }

    #[test]
    fn slices_of_a_patient_have_their_names() {
        // Voxels along x go to the head, along y to the left, along z to the front.
        let rows = [[0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 2.0, 0.0], [0.5, 0.0, 0.0, 0.0]];
        let grid = grid(Some(Orientation::new(rows).unwrap()));
        assert_eq!([0, 1, 2].map(|axis| grid.name(axis)), ["axial", "sagittal", "coronal"]);
        let slice = grid.slice(0, grid.crosshair(&Planes::default()), 0.0);
        let rays = grid.camera(0, &slice, None, (300, 200)).rays(300, 200).unwrap();
        // Seen from the feet: the patient's left is on the right, the front is up.
        assert!(rays.right.normalize().dot(DVec3::NEG_X) > 1.0 - 1e-9, "{}", rays.right);
        assert!(rays.up.normalize().dot(DVec3::Y) > 1.0 - 1e-9, "{}", rays.up);
    }

    #[test]
    fn slices_have_a_window_of_their_own_or_that_of_the_function() {
        let (volumes, grid) = (crate::panels::fixture::volumes(), grid(None));
        let slice = grid.slice(2, grid.crosshair(&Planes::default()), 0.0);
        let camera = grid.camera(2, &slice, None, (300, 200));
        let preset = SceneLayer { transfer: Some(TransferChoice::preset("ct-bone")), ..SceneLayer::default() };
        let scene =
            Scene { layers: vec![preset, SceneLayer { source: Some(0), ..SceneLayer::default() }], ..Scene::default() };
        let windows = |planes: &Planes| -> Vec<_> {
            let scene = slice_scene(&scene, &volumes, slice, camera, Filter::Nearest, planes);
            scene.layers.iter().map(|layer| layer.window).collect()
        };
        // The preset spans 150 to 1600 in the panel, on the colour bar, and here.
        assert_eq!(windows(&Planes::default()), [Some(shown(&scene.layers[0], &volumes[0])), None]);
        let brain = Planes { window: Some([0.0, 80.0]), ..Planes::default() };
        assert_eq!(windows(&brain), [Some([0.0, 80.0]), None]);
    }

    #[test]
    fn large_voxels_are_squares() {
        let grid = grid(None);
        let slice = grid.slice(2, grid.crosshair(&Planes::default()), 0.0);
        let camera = grid.camera(2, &slice, None, (300, 300));
        // 30 voxels of 1 over 300 pixels; across the narrow side voxels are half as large.
        assert_eq!(filter(&grid, PlaneFilter::Auto, &camera, 300), Filter::Nearest);
        assert_eq!(filter(&grid, PlaneFilter::Auto, &camera, 100), Filter::Trilinear);
        assert_eq!(filter(&grid, PlaneFilter::Nearest, &camera, 100), Filter::Nearest);
        assert_eq!(filter(&grid, PlaneFilter::Linear, &camera, 300), Filter::Trilinear);
    }
}
