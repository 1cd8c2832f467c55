//! The oracle: renders whole arrays in f64, one pixel after the other, with no bricks, no caches and no tricks.
//!
//! It states the sampling rule of [`brickyard_volume::lattice`], and the joining of layers
//! ([`brickyard_volume::compositing`]), as plainly as possible, as a standard for testing every fast renderer. A volume
//! is a list of levels held whole in memory; the level at each place is the caller's function, so pictures of mixed
//! levels have an oracle too. Costs about a microsecond a sample.
//!
//! The stages of a pixel, in order: `mesh` finds the layers of triangles that cut its ray into slabs; in each slab
//! `layer` takes every layer's way through its volume (`path`), by the rules of `medium` and `surface` for one segment,
//! or as a projection; `join` combines them into one colour.

mod array;
mod join;
mod layer;
mod medium;
mod mesh;
mod path;
mod surface;

pub use array::{Array, mean_levels, one_level};
pub use mesh::layers;

use brickyard_volume::{Combination, Picture, TransferFunction, ViewRays, VolumeFrame};
use glam::DVec3;
use layer::Way;

/// One volume for the oracle: its levels, the level at each place, and its transfer function.
pub struct ReferenceVolume<'a> {
    /// All levels of the volume, finest first.
    pub levels: &'a [Array],
    /// The index of the sampled level at a point of voxel space (level-0 voxels).
    pub level_at: &'a dyn Fn(DVec3) -> usize,
    /// The exact transfer function. Of `FrameSettings::table` only the running integrals, the adaptive step and the
    /// presence of a grid are used.
    pub transfer: &'a TransferFunction,
}

/// Renders the whole picture of one or more layers, each a frame and its volume, or of an expression over the values of
/// all of them (`combination`).
///
/// # Panics
/// If there is no frame, the numbers of volumes and frames differ, or a volume has no level.
pub fn render(frames: &[VolumeFrame], volumes: &[ReferenceVolume<'_>], combination: Option<&Combination>) -> Picture {
    render_while(frames, volumes, combination, || true).expect("it goes on")
}

/// Renders a picture like [`render`] while `goes_on`, called after each pixel, returns true; `None` once it returns false.
///
/// # Panics
/// As [`render`].
pub fn render_while(
    frames: &[VolumeFrame],
    volumes: &[ReferenceVolume<'_>],
    combination: Option<&Combination>,
    goes_on: impl Fn() -> bool,
) -> Option<Picture> {
    let ViewRays { width, height, .. } = frames[0].settings.rays;
    let color = |x, y| Picture::quantise(pixel(frames, volumes, combination, x, y).map(|channel| channel as f32));
    let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let drawn = places.map(|(x, y)| {
        let rgb = color(x, y);
        goes_on().then_some(rgb)
    });
    let rgb = drawn.collect::<Option<_>>()?;
    Some(Picture { width, height, rgb })
}

/// Returns the display-referred RGB colour of the pixel in column `x` and row `y`: from back to front, slabs of the
/// volumes and the meshes between them.
///
/// # Panics
/// As [`render`].
pub fn pixel(
    frames: &[VolumeFrame],
    volumes: &[ReferenceVolume<'_>],
    combination: Option<&Combination>,
    x: u32,
    y: u32,
) -> [f64; 3] {
    assert_eq!(frames.len(), volumes.len(), "a frame for each volume");
    let all = frames.iter().zip(volumes).enumerate();
    let ways: Vec<Way> = all.filter_map(|(i, (frame, volume))| Way::new(i, frame, volume, x, y)).collect();
    let scene = &frames[0].settings;
    let mut color = DVec3::from_array(scene.background.map(f64::from));
    let mut far = f64::INFINITY;
    let ray = scene.rays.ray(x as f64 + 0.5, y as f64 + 0.5);
    for layer in layers(scene, &ray).into_iter().rev() {
        color = join::slab(&ways, combination, [layer.t, far], color);
        color = color.lerp(layer.color, layer.opacity);
        far = layer.t;
    }
    join::slab(&ways, combination, [0.0, far], color).to_array()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use brickyard_volume::{
        Camera, Extent, Filter, FrameSettings, Geometry, Lattice, Lighting, Mesh, Mode, Placement, Projection, Pyramid,
        Sampling, ShownMesh, SlotEncoding, TransferTable, VoxelType,
    };
    use std::sync::Arc;

    pub(crate) fn settings(
        mode: Mode,
        geometry: Geometry,
        camera: Camera,
        transfer: &TransferFunction,
        step: f64,
    ) -> FrameSettings {
        let encoding = SlotEncoding::new(VoxelType::U8, (0.0, 255.0), false);
        FrameSettings {
            rays: camera.rays(33, 33).unwrap(),
            lattice: Lattice::uniform(step, 0),
            geometry,
            placement: Placement::default(),
            encoding,
            table: TransferTable::new(transfer, &encoding).into(),
            mode,
            surfaces: Vec::new(),
            sampling: Sampling::default(),
            lighting: Lighting::default(),
            background: [0.25, 0.0, 1.0],
            clip: None,
            meshes: Vec::new(),
            caps: false,
            keeps_extremes: false,
        }
    }

    /// The pixel of a single layer.
    pub(crate) fn alone(frame: &FrameSettings, volume: &ReferenceVolume<'_>, x: u32, y: u32) -> [f64; 3] {
        pixel(&[VolumeFrame::alone(frame.clone())], std::slice::from_ref(volume), None, x, y)
    }

    pub(crate) fn camera(eye: DVec3, target: DVec3) -> Camera {
        Camera { eye, target, up: DVec3::Z, projection: Projection::Perspective { fov_y_deg: 30.0 } }
    }

    pub(crate) fn cube(n: u32, value: impl Fn([u32; 3]) -> f64) -> Array {
        let pyramid = Pyramid::new(Extent::new(n, n, n), [1.0; 3], 64);
        Array::from_fn(&pyramid.levels()[0], value)
    }

    fn fog(alpha: f64) -> TransferFunction {
        TransferFunction {
            color: vec![[0.0, 1.0, 0.5, 0.0]],
            opacity: vec![[0.0, alpha]],
            unit_distance: 2.0,
            ..TransferFunction::default()
        }
    }

    #[test]
    fn a_constant_medium_is_beer_lambert_at_any_step() {
        let geometry =
            Geometry { spacing: DVec3::new(1.0, 2.0, 0.5), origin: DVec3::new(3.0, -1.0, 7.0), ..Geometry::default() };
        let levels = [cube(9, |_| 100.0)];
        let transfer = fog(0.2);
        let volume = ReferenceVolume { levels: &levels, level_at: &one_level(0), transfer: &transfer };
        let (low, high) = geometry.world_box(levels[0].extent);
        for step in [0.1, 0.7, 3.0] {
            let frame = settings(Mode::Dvr, geometry.clone(), camera(low * 2.0 - high, high), &transfer, step);
            // The central ray runs along the box's long diagonal, corner to corner.
            let alpha = 1.0 - 0.8f64.powf((high - low).length() / 2.0);
            let expected = [alpha + (1.0 - alpha) * 0.25, alpha * 0.5, 1.0 - alpha];
            let found = alone(&frame, &volume, 16, 16);
            for k in 0..3 {
                assert!((found[k] - expected[k]).abs() < 1e-9, "step {step}: {found:?} {expected:?}");
            }
        }
    }

    #[test]
    fn modes_see_a_ramp_as_its_ends_and_its_middle() {
        let levels = [cube(16, |[x, ..]| x as f64)];
        let transfer = TransferFunction {
            color: vec![[0.0, 0.0, 0.0, 0.0], [15.0, 1.0, 1.0, 1.0]],
            opacity: vec![[0.0, 1.0]],
            unit_distance: 1.0,
            ..TransferFunction::default()
        };
        let volume = ReferenceVolume { levels: &levels, level_at: &one_level(0), transfer: &transfer };
        let view = camera(DVec3::new(-40.0, 7.5, 7.5), DVec3::new(7.5, 7.5, 7.5));
        for (mode, expected) in [(Mode::Mip, 1.0), (Mode::MinIp, 0.0), (Mode::Average, 0.5)] {
            let frame = settings(mode, Geometry::default(), view, &transfer, 0.05);
            let found = alone(&frame, &volume, 16, 16)[0];
            // Samples are half a step inside; the outermost half voxel is constant.
            assert!((found - expected).abs() < 1e-3, "{mode:?}: {found}");
        }
        let frame = settings(Mode::Mip, Geometry::default(), view, &transfer, 0.5);
        assert_eq!(alone(&frame, &volume, 0, 0), [0.25, 0.0, 1.0], "a miss shows the background");
    }

    /// A square across x at this place, of this opacity.
    fn wall(x: f32, opacity: f64) -> ShownMesh {
        let positions = [[-90.0, -90.0], [90.0, -90.0], [90.0, 90.0], [-90.0, 90.0]].map(|[y, z]| [x, y, z]);
        let mesh = Mesh::new(positions.to_vec(), vec![[0, 1, 2], [0, 2, 3]], vec![], vec![]).unwrap();
        ShownMesh { mesh: Arc::new(mesh), color: Some([0.0, 0.0, 1.0]), opacity, lit: false }
    }

    #[test]
    fn meshes_stand_in_fog_of_just_their_distance() {
        let levels = [cube(16, |_| 100.0)];
        let transfer = fog(0.2);
        let volume = ReferenceVolume { levels: &levels, level_at: &one_level(0), transfer: &transfer };
        let view = camera(DVec3::new(-40.0, 7.5, 7.5), DVec3::new(7.5, 7.5, 7.5));
        // The volume is from -0.5 to 15.5; everything behind 10.3 is hidden.
        let (fog, blue) = (DVec3::new(1.0, 0.5, 0.0), DVec3::Z);
        let over = |length: f64, behind: DVec3| fog.lerp(behind, 0.8f64.powf(length / 2.0));
        let expected = over(4.5 + 0.2, over(10.3 - 4.2, blue).lerp(blue, 0.3));
        for step in [0.1, 0.7, 3.0] {
            let meshes = vec![wall(12.0, 0.5), wall(10.3, 1.0), wall(4.2, 0.3)];
            let frame = settings(Mode::Dvr, Geometry::default(), view, &transfer, step);
            let frame = FrameSettings { meshes, ..frame };
            let ray = frame.rays.ray(16.5, 16.5);
            assert_eq!(layers(&frame, &ray).len(), 2);
            // The walls' places are in single precision: off by 1e-7 of themselves.
            let found = DVec3::from_array(alone(&frame, &volume, 16, 16));
            assert!((found - expected).length() < 1e-6, "step {step}: {found} {expected}");
        }
    }

    #[test]
    fn a_mesh_ends_what_projections_see() {
        let levels = [cube(16, |[x, ..]| x as f64)];
        let transfer = TransferFunction {
            color: vec![[0.0, 0.0, 0.0, 0.0], [15.0, 1.0, 1.0, 1.0]],
            opacity: vec![[0.0, 1.0]],
            unit_distance: 1.0,
            ..TransferFunction::default()
        };
        let volume = ReferenceVolume { levels: &levels, level_at: &one_level(0), transfer: &transfer };
        let view = camera(DVec3::new(-40.0, 7.5, 7.5), DVec3::new(7.5, 7.5, 7.5));
        let seen = |x: f32| {
            let frame = settings(Mode::Mip, Geometry::default(), view, &transfer, 0.01);
            let frame = FrameSettings { meshes: vec![wall(x, 1.0)], ..frame };
            alone(&frame, &volume, 16, 16)
        };
        // Half a step is not seen.
        assert!((seen(9.0)[0] - 9.0 / 15.0).abs() < 1e-3);
        assert_eq!(seen(-2.0), [0.0, 0.0, 1.0], "in front of the volume");
    }

    #[test]
    fn invalid_voxels_are_transparent() {
        let array = cube(4, |[x, ..]| if x == 1 { f64::NAN } else { 10.0 * x as f64 });
        assert_eq!(array.sample(DVec3::new(1.5, 2.0, 2.0), Filter::Trilinear), None);
        assert_eq!(array.sample(DVec3::new(0.9, 2.0, 2.0), Filter::Trilinear), Some(0.0));
        assert_eq!(array.sample(DVec3::new(2.25, 2.0, 2.0), Filter::Trilinear), Some(20.0));
    }

    #[test]
    fn mean_levels_average_what_exists() {
        let pyramid = Pyramid::new(Extent::new(5, 4, 1), [1.0; 3], 2);
        let levels = mean_levels(&pyramid, Array::from_fn(&pyramid.levels()[0], |[x, y, _]| (x + 10 * y) as f64));
        assert_eq!(levels[1].values, [5.5, 7.5, 9.0, 25.5, 27.5, 29.0]);
        // The odd last column holds one fine column: it weighs as much as a full one in the next mean.
        assert_eq!(levels[2].values, [16.5, 19.0]);
    }
}
