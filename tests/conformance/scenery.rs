//! Subjects and views: fields, transfer functions, lights and cameras that catch a renderer's usual mistakes.

use crate::volume::Volume;
use brickyard::volume::*;
use glam::DVec3;

pub(crate) fn u8_codes() -> SlotEncoding {
    SlotEncoding::new(VoxelType::U8, (0.0, 255.0), false)
}

/// Codes of 16 bits; 0 is no value.
pub(crate) fn wide_codes() -> SlotEncoding {
    SlotEncoding::new(VoxelType::F32, (-1.0, 3.0), true)
}

/// f32 slots, with a window from about -1 to 3 of a far wider channel, and some voxels without a value.
pub(crate) fn float_slots() -> SlotEncoding {
    SlotEncoding::new(VoxelType::F32, (-1e9, 1e9), true).for_window(Some(Window::of([-1.0, 3.0])), KeptSlots::default())
}

/// Waves past both ends of an encoding's range, with outliers at its channel's limits.
pub(crate) fn wild(encoding: SlotEncoding) -> impl Fn(DVec3) -> f64 {
    let wide = scaled(encoding, |p| 1.2 * waves(p) - 0.03);
    move |p| match p.as_uvec3().to_array() {
        [13, 11, 21] => 1e9,
        [24, 8, 9] => -1e9,
        _ => wide(p),
    }
}

/// Unequal spacings, away from the origin.
pub(crate) fn uneven() -> Geometry {
    Geometry { spacing: DVec3::new(1.0, 0.8, 1.3), origin: DVec3::new(5.0, -20.0, 3.0), ..Geometry::default() }
}

/// A smooth field without symmetry, between 0 and 1 in voxel space.
pub(crate) fn waves(p: DVec3) -> f64 {
    let wave = (p.x * 0.31).sin() + (p.y * 0.23 + 1.0).sin() + (p.z * 0.37 + p.x * 0.1).cos();
    (wave / 6.0 + 0.5).clamp(0.0, 1.0)
}

/// A number between 0 and 1 per voxel, without a pattern.
pub(crate) fn noise(p: DVec3) -> f64 {
    let [x, y, z] = p.as_uvec3().to_array();
    let hash = (x.wrapping_mul(0x9e37_79b1) ^ y.wrapping_mul(0x85eb_ca77) ^ z.wrapping_mul(0xc2b2_ae3d))
        .wrapping_mul(0x27d4_eb2f);
    f64::from((hash ^ hash >> 15).wrapping_mul(0x2c1b_3c6d) >> 8) / f64::from(1 << 24)
}

/// A field between 0 and 1 in a volume's range.
pub(crate) fn scaled(encoding: SlotEncoding, field: impl Fn(DVec3) -> f64) -> impl Fn(DVec3) -> f64 {
    move |p| encoding.low + (encoding.high - encoding.low) * field(p)
}

/// A volume of waves.
pub(crate) fn wavy(extent: [u32; 3], edge: u32) -> Volume {
    Volume::new(extent, edge, uneven(), u8_codes(), scaled(u8_codes(), waves))
}

/// Rapidly changing colours and opacity, with a clear stretch. Points lie on whole 8-bit codes of the range, where tables are exact (the
/// oracle has none).
pub(crate) fn tinted((low, high): (f64, f64)) -> TransferFunction {
    let at = |code: u32| low + code as f64 / 255.0 * (high - low);
    TransferFunction {
        color: vec![[at(25), 0.9, 0.1, 0.2], [at(127), 0.1, 1.0, 0.3], [at(230), 0.2, 0.3, 1.0]],
        opacity: vec![[at(76), 0.0], [at(127), 0.08], [at(178), 0.02], [at(190), 0.3], [at(255), 0.9]],
        unit_distance: 1.5,
        ..TransferFunction::default()
    }
}

/// The tinted function with a jump.
pub(crate) fn vivid((low, high): (f64, f64)) -> TransferFunction {
    let mut vivid = tinted((low, high));
    vivid.opacity[3][0] = low + 179.0 / 255.0 * (high - low);
    vivid
}

/// The tinted function on steep parts of the field, and a region besides. All of it is smooth, because the oracle has no table.
pub(crate) fn steep((low, high): (f64, f64)) -> TransferFunction {
    let code = (high - low) / 255.0;
    let region = Region {
        shape: Shape::Gaussian,
        value: [low + 40.0 * code, low + 200.0 * code],
        gradient: [0.0, 14.0 * code],
        color: [1.0, 0.9, 0.1],
        opacity: 0.15,
    };
    let gradient_opacity = vec![[code, 0.0], [9.0 * code, 1.0], [16.0 * code, 0.4]];
    TransferFunction { gradient_opacity, regions: vec![region], ..tinted((low, high)) }
}

/// One colour with a given opacity over a distance.
pub(crate) fn constant(alpha: f64, unit_distance: f64) -> TransferFunction {
    TransferFunction {
        color: vec![[0.0, 1.0, 0.5, 0.0]],
        opacity: vec![[0.0, alpha]],
        unit_distance,
        ..TransferFunction::default()
    }
}

pub(crate) fn range(encoding: &SlotEncoding) -> (f64, f64) {
    (encoding.low, encoding.high)
}

fn lit(model: LightingModel, gradient: Gradient, lights: &[DVec3]) -> Lighting {
    Lighting { model, gradient, lights: lights.to_vec() }
}

/// Unlit; by gradients of each kind from the eye and by a light; and cool to warm by two lights.
pub(crate) fn lightings() -> [Lighting; 8] {
    let (left, right, below) =
        (DVec3::new(-30.0, 10.0, 40.0), DVec3::new(90.0, 10.0, 40.0), DVec3::new(0.0, -50.0, -20.0));
    let [central, sobel, stored] = Gradient::ALL;
    [
        Lighting::default(),
        lit(LightingModel::BlinnPhong, central, &[]),
        lit(LightingModel::Phong, central, &[left]),
        lit(LightingModel::BlinnPhong, sobel, &[]),
        lit(LightingModel::Phong, sobel, &[left]),
        lit(LightingModel::BlinnPhong, stored, &[left]),
        lit(LightingModel::Phong, stored, &[]),
        lit(LightingModel::Tone, central, &[right, below]),
    ]
}

pub(crate) fn look(eye: DVec3, target: DVec3, fov_y_deg: f64) -> Camera {
    Camera { eye, target, up: DVec3::new(0.1, 0.2, 1.0), projection: Projection::Perspective { fov_y_deg } }
}

/// The same camera without perspective.
pub(crate) fn parallel(eye: DVec3, target: DVec3, height: f64) -> Camera {
    Camera { projection: Projection::Orthographic { height }, ..look(eye, target, 1.0) }
}

/// Extent of a volume for small pictures with an optional hole.
pub(crate) const SMALL: [u32; 3] = [40, 29, 37];

pub(crate) fn is_hole(p: DVec3) -> bool {
    (p - DVec3::new(20.0, 15.0, 18.0)).length() < 6.5
}

/// A small picture of a whole volume; even smaller for splines, which are far slower in the oracle.
pub(crate) fn overview(volume: &Volume, filter: Filter) -> ViewRays {
    let (low, high) = volume.geometry.world_box(volume.pyramid.levels()[0].extent);
    let centre = (low + high) * 0.5;
    let (width, height) = if filter == Filter::Tricubic { (16, 13) } else { (22, 18) };
    look(centre + DVec3::new(-56.0, -41.0, 38.0), centre, 40.0).rays(width, height).expect("a camera")
}

/// Views of a volume of about 50 voxels along an edge, in bricks of 8 or 16. Odd sizes put a ray exactly along the view direction.
pub(crate) fn views(volume: &Volume) -> Vec<(&'static str, ViewRays)> {
    let world = |x: f64, y: f64, z: f64| volume.geometry.world_from_voxel(DVec3::new(x, y, z));
    let level = |camera: Camera| Camera { up: DVec3::Z, ..camera };
    let aside = |eye, target| level(parallel(eye, target, 54.7));
    let whole = volume.geometry.world_box(volume.pyramid.levels()[0].extent);
    let size = |camera: Camera, w, h| camera.rays(w, h).expect("a camera");
    vec![
        ("outside", size(Camera::looking_at_box(whole), 64, 48)),
        ("inside", size(level(look(world(20.3, 11.7, 25.1), world(40.0, 30.0, 20.0), 100.0)), 64, 64)),
        ("far away", size(level(look(world(900.0, -1400.0, 700.0), world(22.0, 18.0, 26.0), 1.6)), 48, 48)),
        ("on a brick's corner", size(level(look(world(16.0, 16.0, 16.0), world(30.0, 17.0, 15.0), 70.0)), 49, 49)),
        ("along the edges of bricks", size(look(world(-20.0, 16.0, 16.0), world(20.0, 16.0, 16.0), 45.0), 41, 33)),
        ("grazing a brick's face", size(level(look(world(16.0, -30.0, 16.0), world(16.0, 30.0, 16.0), 40.0)), 65, 65)),
        ("grazing the volume's face", size(level(look(world(0.0, -30.0, 0.0), world(0.0, 30.0, 0.0), 40.0)), 65, 65)),
        ("parallel, along an axis", size(aside(world(16.0, -30.0, 20.0), world(16.0, 0.0, 20.0)), 55, 55)),
        ("parallel, oblique", size(aside(world(-30.0, -40.0, 60.0), world(22.0, 18.0, 26.0)), 60, 44)),
        ("parallel, from inside", size(aside(world(20.0, 20.0, 20.0), world(30.0, 45.0, 26.0)), 60, 60)),
    ]
}
