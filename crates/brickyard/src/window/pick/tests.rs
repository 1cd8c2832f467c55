//! Picks in volumes of formulas, from several cameras: each is within a voxel of the closed form.

use super::*;
use crate::session::resolve::resolve;
use brickyard_import::{ImportError, Source, SourceInfo};
use brickyard_pager::BrickSource;
use brickyard_store::{PackOptions, pack};
use brickyard_volume::{
    BrickId, Camera, ClipPlane, Extent, Filter, Geometry, Isosurface, LevelPolicy, Placement, Projection, Pyramid,
    Sampling, Scene, SceneExpression, SceneLayer, Slice, TransferFunction, VoxelBox, VoxelType,
};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

const SIZE: (u32, u32) = (200, 160);
const EXTENT: Extent = Extent::new(200, 190, 180);
const CENTRE: DVec3 = DVec3::new(101.3, 94.2, 88.9);
const RADIUS: f64 = 60.0;

/// A volume of a function of the world, sampled at the middles of voxels at every level.
struct Formula<F> {
    pyramid: Pyramid,
    geometry: Geometry,
    value: F,
    reads: AtomicUsize,
}

impl<F: Fn(DVec3) -> f64 + Send + Sync> BrickSource for Formula<F> {
    fn pyramid(&self) -> &Pyramid {
        &self.pyramid
    }

    fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    fn voxel_type(&self) -> VoxelType {
        VoxelType::F32
    }

    fn value_range(&self) -> (f64, f64) {
        (-1e5, 1e5)
    }

    fn read_core(&self, id: BrickId, out: &mut [u8]) -> Result<(), BrickError> {
        self.reads.fetch_add(1, Ordering::Relaxed);
        let factor = DVec3::from_array(self.pyramid.level(id.level).factor.map(f64::from));
        for (voxel, place) in out.chunks_exact_mut(4).zip(self.pyramid.core_voxels(id.index)) {
            let place = (DVec3::from_array(place.map(f64::from)) + 0.5) * factor;
            let value = (self.value)(self.geometry.world_from_voxel(place));
            voxel.copy_from_slice(&(value as f32).to_le_bytes());
        }
        Ok(())
    }
}

fn formula<F: Fn(DVec3) -> f64 + Send + Sync + 'static>(value: F) -> (Arc<Formula<F>>, VolumeSource) {
    let geometry = Geometry::default();
    let pyramid = Pyramid::new(EXTENT, geometry.spacing.to_array(), 32);
    let source = Arc::new(Formula { pyramid, geometry, value, reads: AtomicUsize::new(0) });
    (source.clone(), VolumeSource::new(source))
}

/// A ball of 200 in 0.
fn ball() -> VolumeSource {
    formula(|p| if (p - CENTRE).length() < RADIUS { 200.0 } else { 0.0 }).1
}

/// A cone peaking at the centre: 255 there, and 2 less for each voxel away from it.
fn cone() -> VolumeSource {
    formula(|p| 255.0 - 2.0 * (p - CENTRE).length()).1
}

/// A transfer function for the ball, opaque or with `alpha` in each voxel.
fn inside(alpha: f64) -> TransferFunction {
    TransferFunction {
        color: vec![[0.0, 1.0, 1.0, 1.0]],
        opacity: vec![[99.0, 0.0], [101.0, alpha]],
        unit_distance: 1.0,
        ..TransferFunction::default()
    }
}

/// Cameras at all sides, near and far, perspective and orthographic.
fn cameras() -> Vec<Camera> {
    let directions = [[-1.0, 0.0, 0.0], [0.3, -0.9, 0.4], [0.1, 0.2, -0.97], [0.6, 0.55, 0.7]].map(DVec3::from_array);
    let camera = |direction: DVec3, distance: f64, projection| Camera {
        eye: CENTRE + direction.normalize() * distance,
        target: CENTRE,
        up: DVec3::new(0.1, 0.0, 1.0),
        projection,
    };
    let of = |direction: DVec3| {
        [
            camera(direction, 300.0, Projection::Perspective { fov_y_deg: 35.0 }),
            camera(direction, 2500.0, Projection::Perspective { fov_y_deg: 5.0 }),
            camera(direction, 400.0, Projection::Orthographic { height: 190.0 }),
        ]
    };
    directions.into_iter().flat_map(of).collect()
}

/// Places in and beside the ball.
const PLACES: [[f64; 2]; 6] = [[100.0, 80.0], [113.5, 71.5], [71.2, 95.0], [100.5, 51.0], [140.5, 88.5], [3.5, 3.5]];

fn ray(scene: &ResolvedScene, place: [f64; 2]) -> Ray {
    scene.layers[0].frames[0].settings.rays.ray(place[0], place[1])
}

/// The distances at which a ray enters and leaves the ball; `Some(None)` if it misses. `None` near the edge, where half
/// a voxel matters.
fn chord(ray: &Ray) -> Option<Option<[f64; 2]>> {
    let along = (CENTRE - ray.origin).dot(ray.direction);
    let off = (ray.origin + ray.direction * along - CENTRE).length();
    let half = (RADIUS * RADIUS - off * off).max(0.0).sqrt();
    match off {
        _ if off < RADIUS - 10.0 => Some(Some([along - half, along + half])),
        _ if off > RADIUS + 2.0 => Some(None),
        _ => None,
    }
}

/// Checks every place of every camera's picture against a formula for the distance, `None` where nothing is visible.
fn check(
    scene: &Scene,
    volumes: &[VolumeSource],
    allowed: f64,
    expected: impl Fn(&ResolvedScene, &Ray) -> Option<Option<f64>>,
) {
    let (mut seen, mut picker) = (0, Picker::default());
    for camera in cameras() {
        let scene = Scene { camera: Some(camera), ..scene.clone() };
        let resolved = resolve(volumes, &scene, SIZE).unwrap();
        for place in PLACES {
            let ray = ray(&resolved, place);
            let Some(expected) = expected(&resolved, &ray) else { continue };
            let found = picker.pick(&resolved, volumes, place).unwrap();
            let what = format!("{camera:?} {place:?}");
            assert_eq!(found.as_ref().map(|_| ()), expected.map(|_| ()), "{what}: {found:?}");
            if let (Some(found), Some(t)) = (found, expected) {
                assert!((found.distance - t).abs() <= allowed, "{what}: {} for {t}", found.distance);
                assert!((found.point - (ray.origin + ray.direction * found.distance)).length() < 1e-9, "{what}");
                seen += 1;
            }
        }
    }
    assert!(seen > 20, "{seen}");
}

#[test]
fn of_what_is_opaque_the_front_is_seen() {
    for filter in Filter::ALL {
        let scene = Scene { sampling: Sampling { filter, ..Sampling::default() }, ..Scene::of(inside(1.0)) };
        check(&scene, &[ball()], 1.0, |_, ray| chord(ray).map(|chord| chord.map(|[from, _]| from)));
    }
}

#[test]
fn of_fog_it_is_where_half_of_it_has_been_passed() {
    let alpha = 0.02f64;
    let half = |[from, to]: [f64; 2]| {
        let passed = (1.0 - alpha).powf(to - from);
        from + (0.5 + 0.5 * passed).ln() / (1.0 - alpha).ln()
    };
    check(&Scene::of(inside(alpha)), &[ball()], 1.0, |_, ray| chord(ray).map(|chord| chord.map(half)));
    // 120 voxels of it are less than a fiftieth.
    let resolved = resolve(&[ball()], &Scene { camera: Some(cameras()[0]), ..Scene::of(inside(1e-4)) }, SIZE).unwrap();
    assert_eq!(Picker::default().pick(&resolved, &[ball()], PLACES[0]).unwrap(), None);
}

#[test]
fn surfaces_are_found_where_they_are() {
    let surface = |value, opacity| Isosurface { opacity, ..Isosurface::at(value) };
    // The cone has 135 on the ball; a surface behind it plays no part.
    let surfaces = |opacity| SceneLayer {
        isosurfaces: vec![surface(135.0, opacity), surface(200.0, 1.0)],
        ..TransferFunction { opacity: vec![[0.0, 0.0]], ..inside(0.0) }.into()
    };
    let front = |_: &ResolvedScene, ray: &Ray| chord(ray).map(|chord| chord.map(|[from, _]| from));
    for opacity in [1.0, 0.1] {
        let scene = Scene { mode: Mode::Isosurface, layers: vec![surfaces(opacity)], ..Scene::default() };
        check(&scene, &[cone()], 0.2, front);
    }
    check(&Scene { layers: vec![surfaces(0.9)], ..Scene::default() }, &[cone()], 0.2, front);
}

#[test]
fn extremes_are_found_where_rays_pass_the_peak() {
    let nearest = |_: &ResolvedScene, ray: &Ray| {
        let t = (CENTRE - ray.origin).dot(ray.direction);
        // Half of each coarse voxel at the volume's faces is constant.
        let point = ray.origin + ray.direction * t;
        let inside = point.cmpgt(DVec3::splat(10.0)).all() && point.cmplt(DVec3::new(190.0, 180.0, 170.0)).all();
        inside.then_some(Some(t))
    };
    check(&Scene { mode: Mode::Mip, ..Scene::of(inside(1.0)) }, &[cone()], 1.0, nearest);
    let (_, pit) = formula(|p| 2.0 * (p - CENTRE).length() - 255.0);
    check(&Scene { mode: Mode::MinIp, ..Scene::of(inside(1.0)) }, &[pit], 1.0, nearest);
}

#[test]
fn clip_planes_box_and_crops_count() {
    let plane = ClipPlane { point: CENTRE + DVec3::new(3.0, -2.0, 5.0), normal: DVec3::new(0.2, 1.0, -0.4) };
    let cut = |ray: &Ray, [from, to]: [f64; 2]| {
        let (height, rise) = (plane.height(ray.origin), plane.normal.dot(ray.direction));
        let at = -height / rise;
        let [from, to] = if rise > 0.0 { [from.max(at), to] } else { [from, to.min(at)] };
        // Skip pieces so thin that rounding decides.
        ((to - from).abs() > 3.0).then_some((from < to).then_some(from))
    };
    let clipped = Scene { clip_planes: vec![plane], ..Scene::of(inside(1.0)) };
    let met = |_: &ResolvedScene, ray: &Ray| match chord(ray)? {
        Some(chord) => cut(ray, chord),
        None => Some(None),
    };
    check(&clipped, &[ball()], 1.0, met);
    // On the ball's surface, or on its cap.
    let surface = SceneLayer { isosurfaces: vec![Isosurface::at(100.0)], ..inside(1.0).into() };
    check(&Scene { mode: Mode::Isosurface, layers: vec![surface], ..clipped }, &[ball()], 1.0, met);
    // Only the part above the centre, in voxels or in the world: the same, since the origin is a voxel's centre.
    let low = DVec3::new(-10.0, -10.0, 90.0);
    let above = |_: &ResolvedScene, ray: &Ray| {
        let at = (low.z - ray.origin.z) / ray.direction.z;
        match chord(ray)? {
            Some(_) if ray.direction.z.abs() < 1e-6 => None,
            Some([from, to]) => {
                let [from, to] = if ray.direction.z > 0.0 { [from.max(at), to] } else { [from, to.min(at)] };
                ((to - from).abs() > 3.0).then_some((from < to).then_some(from))
            }
            None => Some(None),
        }
    };
    let boxed = Scene { clip: Some([low, DVec3::splat(300.0)]), ..Scene::of(inside(1.0)) };
    check(&boxed, &[ball()], 1.0, above);
    let crop = Some([low + 0.5, DVec3::splat(300.0)]);
    check(
        &Scene { layers: vec![SceneLayer { crop, ..inside(1.0).into() }], ..Scene::default() },
        &[ball()],
        1.0,
        above,
    );
}

#[test]
fn layers_are_found_where_they_are_placed_and_if_they_are_shown() {
    // A turn about z and a stretch of 1.5, then a move; the second layer is at its store's place.
    let placed = Placement::from_text("0 -1.5 0 260  1.5 0 0 -40  0 0 1.5 -30").unwrap();
    let moved = SceneLayer { world_from_volume: placed, source: Some(0), ..inside(1.0).into() };
    let still = SceneLayer { source: Some(0), ..inside(1.0).into() };
    let volumes = [ball()];
    let own = |ray: &Ray| {
        let own = placed.volume_ray(ray);
        let stretch = own.direction.length();
        let unit = Ray { origin: own.origin, direction: own.direction / stretch };
        chord(&unit).map(|chord| chord.map(|ends| ends.map(|t| t / stretch)))
    };
    let first = |chord: Option<[f64; 2]>| chord.map(|[from, _]| from).filter(|from| *from > 0.0);
    let alone = Scene { layers: vec![moved.clone()], ..Scene::default() };
    check(&alone, &volumes, 1.5, |_, ray| own(ray).map(first).filter(|t| t.is_none_or(|t| t > 5.0)));
    let scene = Scene { camera: Some(cameras()[2]), layers: vec![moved.clone(), still.clone()], ..Scene::default() };
    let both = resolve(&volumes, &scene, SIZE).unwrap();
    let ray = ray(&both, PLACES[1]);
    let [Some(Some(of_moved)), Some(Some(of_still))] = [own(&ray), chord(&ray)] else { panic!("both are there") };
    let nearer = usize::from(of_still[0] < of_moved[0]);
    let found = Picker::default().pick(&both, &volumes, PLACES[1]).unwrap().unwrap();
    assert_eq!(found.layer, nearer);
    // Without it the other one is visible, under its own index.
    let mut scene = scene;
    scene.layers[nearer].visible = false;
    let other = resolve(&volumes, &scene, SIZE).unwrap();
    let found = Picker::default().pick(&other, &volumes, PLACES[1]).unwrap().unwrap();
    assert_eq!(found.layer, 1 - nearer);
}

#[test]
fn slices_and_means_are_picked_where_they_are_looked_at() {
    let volumes = [cone()];
    let slice =
        Slice { point: CENTRE + DVec3::new(1.0, 7.0, -4.0), normal: DVec3::new(0.3, -0.2, 0.9), thickness: 0.0 };
    let on_plane = |_: &ResolvedScene, ray: &Ray| {
        let t = (slice.point - ray.origin).dot(slice.normal) / ray.direction.dot(slice.normal);
        let point = ray.origin + ray.direction * t;
        let is_inside = point.cmpgt(DVec3::ONE).all() && point.cmplt(DVec3::new(198.0, 188.0, 178.0)).all();
        (is_inside && t > 0.0).then_some(Some(t))
    };
    check(&Scene { mode: Mode::Average, slice: Some(slice), ..Scene::of(inside(1.0)) }, &volumes, 1e-2, on_plane);
    let nearest = |_: &ResolvedScene, ray: &Ray| {
        let t = (CENTRE - ray.origin).dot(ray.direction);
        let point = ray.origin + ray.direction * t;
        let is_inside = point.cmpgt(DVec3::ONE).all() && point.cmplt(DVec3::new(198.0, 188.0, 178.0)).all();
        is_inside.then_some(Some(t))
    };
    check(&Scene { mode: Mode::Average, ..Scene::of(inside(1.0)) }, &volumes, 1e-9, nearest);
}

#[test]
fn values_are_those_of_the_voxel() {
    let volumes = [cone()];
    let resolved = resolve(&volumes, &Scene { camera: Some(cameras()[1]), ..Scene::of(inside(1.0)) }, SIZE).unwrap();
    let found = Picker::default().pick(&resolved, &volumes, PLACES[2]).unwrap().unwrap();
    let [PickedValues { layer: 0, volume: 0, probe }] = &found.values[..] else { panic!("{found:?}") };
    assert!((probe.world - found.point).abs().max_element() <= 0.5 + 1e-9, "the voxel that the point is in");
    assert_eq!(probe.values, [f64::from((255.0 - 2.0 * (probe.world - CENTRE).length()) as f32)]);
}

#[test]
fn few_bricks_are_read_and_none_twice() {
    let (source, volume) = formula(|p| if (p - CENTRE).length() < RADIUS { 200.0 } else { 0.0 });
    let volumes = [volume];
    let mut picker = Picker::new(8 << 20);
    for camera in cameras() {
        let resolved = resolve(&volumes, &Scene { camera: Some(camera), ..Scene::of(inside(0.01)) }, SIZE).unwrap();
        for place in PLACES {
            let before = source.reads.load(Ordering::Relaxed);
            let found = picker.pick(&resolved, &volumes, place).unwrap();
            let read = source.reads.load(Ordering::Relaxed);
            // The ray's, and at most eight around the hit in each of four levels; most often one.
            assert!(read - before <= 16 + 32, "{}", read - before);
            assert!(picker.bytes() <= 8 << 20);
            assert_eq!(picker.pick(&resolved, &volumes, place).unwrap(), found);
            assert_eq!(source.reads.load(Ordering::Relaxed), read, "again");
        }
    }
    assert_eq!(picker.decoded(), source.reads.load(Ordering::Relaxed) as u64);
    // Nothing is kept for other volumes.
    let others = [ball()];
    let resolved = resolve(&others, &Scene { camera: Some(cameras()[0]), ..Scene::of(inside(1.0)) }, SIZE).unwrap();
    let before = picker.decoded();
    picker.pick(&resolved, &others, PLACES[0]).unwrap();
    assert!(picker.decoded() > before && picker.bytes() <= (picker.decoded() - before) * 4 * 32 * 32 * 32);
}

/// A cube of bytes to pack, and a function for its voxels.
struct CubeSource(SourceInfo, fn([u32; 3]) -> u8);

impl Source for CubeSource {
    fn info(&self) -> &SourceInfo {
        &self.0
    }

    fn read_box(&self, _: u32, _: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        let [x, y, z] = region.extent().to_array();
        let places = (0..z).flat_map(|k| (0..y).flat_map(move |j| (0..x).map(move |i| [i, j, k])));
        for (voxel, place) in out.iter_mut().zip(places) {
            let first = region.min.to_array();
            *voxel = self.1(std::array::from_fn(|a| first[a] + place[a]));
        }
        Ok(())
    }
}

/// Almost parallel to the volume's faces and beside it: inside them only very far away.
#[test]
fn a_ray_that_passes_by_finds_nothing() {
    let volumes = [ball()];
    for (eye, up) in [(DVec3::Z, DVec3::Y), (DVec3::X, DVec3::Z), (DVec3::Y, DVec3::X)] {
        let projection = Projection::Orthographic { height: 2000.0 };
        let camera = Camera { eye: CENTRE + eye * 900.0 + up * 1e-10, target: CENTRE, up, projection };
        let scene = Scene { camera: Some(camera), level: LevelPolicy::Locked(0), ..Scene::of(inside(1.0)) };
        let resolved = resolve(&volumes, &scene, SIZE).unwrap();
        for place in [[100.0, 3.5], [3.5, 80.0], [3.5, 3.5], [196.5, 156.5]] {
            assert_eq!(Picker::default().pick(&resolved, &volumes, place).unwrap(), None, "{eye} {place:?}");
        }
        assert!(Picker::default().pick(&resolved, &volumes, [100.0, 80.0]).unwrap().is_some(), "{eye}");
    }
}

/// Packs a cube into a store with bricks of 16 voxels.
fn packed(folder: &tempfile::TempDir, voxel: fn([u32; 3]) -> u8) -> VolumeSource {
    let path = folder.path().join("cube.zarr");
    let info = SourceInfo {
        calibrated: true,
        identity: "a cube".into(),
        ..SourceInfo::of_volume(Extent::new(96, 96, 96), VoxelType::U8)
    };
    let options = PackOptions { edge: 16, shard_edge: 64, threads: 2, ..PackOptions::new(VoxelType::U8) };
    pack(&CubeSource(info, voxel), &path, &options, &()).unwrap();
    VolumeSource::open(&path).unwrap()
}

/// A speck in the corner of a coarse voxel: a filter between coarse voxels makes it less than the block behind it.
#[test]
fn a_speck_is_picked_at_coarse_levels() {
    let folder = tempfile::tempdir().unwrap();
    let speck = |[x, y, z]: [u32; 3]| match [x, y, z] {
        [35, 43, 20] => 250,
        _ if z > 70 => 150,
        _ => 50,
    };
    let volumes = [packed(&folder, speck).suited(Mode::Mip).unwrap()];
    let camera = Camera {
        eye: DVec3::new(48.0, 48.0, -200.0),
        target: DVec3::splat(48.0),
        up: DVec3::Y,
        projection: Projection::Orthographic { height: 96.0 },
    };
    for level in 0..3 {
        let level = LevelPolicy::Locked(level);
        let scene = Scene { camera: Some(camera), mode: Mode::Mip, level, ..Scene::of(inside(1.0)) };
        let resolved = resolve(&volumes, &scene, (96, 96)).unwrap();
        let rays = resolved.layers[0].frames[0].settings.rays;
        let place = rays.pixel(DVec3::new(35.0, 43.0, 20.0)).unwrap();
        let found = Picker::default().pick(&resolved, &volumes, place).unwrap().unwrap();
        assert!((found.point - DVec3::new(35.0, 43.0, 20.0)).length() < 1.0, "{level:?}: {found:?}");
        assert_eq!(found.values[0].probe.values, [250.0], "{level:?}");
    }
}

/// A store records its empty bricks: rays beside the ball decode nothing, and opaque ones only the bricks they meet.
#[test]
fn what_is_empty_is_not_read() {
    let folder = tempfile::tempdir().unwrap();
    let ball = |place: [u32; 3]| {
        let at = DVec3::from_array(place.map(f64::from)) - 48.0;
        if at.length() < 30.0 { 200 } else { 0 }
    };
    let volumes = [packed(&folder, ball)];
    let camera = Camera {
        eye: DVec3::new(48.0, 48.0, -200.0),
        target: DVec3::splat(48.0),
        up: DVec3::Y,
        projection: Projection::Orthographic { height: 96.0 },
    };
    let resolved = resolve(&volumes, &Scene { camera: Some(camera), ..Scene::of(inside(1.0)) }, (96, 96)).unwrap();
    let mut picker = Picker::default();
    assert_eq!(picker.pick(&resolved, &volumes, [4.5, 5.5]).unwrap(), None);
    assert_eq!(picker.decoded(), 0);
    let found = picker.pick(&resolved, &volumes, [50.5, 45.5]).unwrap().unwrap();
    assert!(((found.point - 48.0).length() - 30.0).abs() < 1.0, "{found:?}");
    assert!(picker.decoded() <= 4, "{}", picker.decoded());
}

#[test]
fn values_of_expressions_are_picked() {
    let scene = Scene {
        layers: vec![SceneLayer::default()],
        expression: Some(SceneExpression { text: "a / 2".into(), transfer: Some(half_as_much().into()) }),
        ..Scene::default()
    };
    check(&scene, &[ball()], 1.0, |_, ray| chord(ray).map(|chord| chord.map(|[from, _]| from)));
}

/// Creates a transfer function for a ball of half the value.
fn half_as_much() -> TransferFunction {
    TransferFunction {
        opacity: vec![[49.0, 0.0], [51.0, 1.0]],
        color: vec![[0.0, 1.0, 1.0, 1.0], [100.0, 1.0, 1.0, 1.0]],
        ..inside(1.0)
    }
}
