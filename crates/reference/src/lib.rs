//! The oracle: renders whole arrays in f64, one pixel after the other, with no bricks, no caches and no tricks.
//!
//! It states the sampling rule of [`brickyard_volume::lattice`] as plainly as possible, so that every fast renderer can be
//! tested against it. A volume is a list of levels held whole in memory; which level a place is drawn at is the caller's
//! function, so pictures of mixed levels have an oracle too. Costs about a microsecond a sample.

mod medium;
mod mesh;
mod surface;
mod together;

pub use together::{pixel_together, render_together};

pub use mesh::layers;

use brickyard_volume::{
    Clip, Extent, Filter, FrameSettings, LevelGrid, Mode, Picture, Pyramid, Ray, Segment, TransferFunction, Voxel,
    VoxelType, sampling, with_voxel_type,
};
use glam::DVec3;

/// One level as a whole array of data values; NaN marks invalid voxels.
#[derive(Clone, Debug)]
pub struct Array {
    /// Voxels along each axis.
    pub extent: Extent,
    /// Level-0 voxels per voxel.
    pub factor: [u32; 3],
    /// `extent.volume()` values, x fastest.
    pub values: Vec<f64>,
}

impl Array {
    /// A level whose voxels come from a function of its integer voxel coordinates.
    pub fn from_fn(grid: &LevelGrid, value: impl Fn([u32; 3]) -> f64) -> Self {
        let e = grid.extent;
        let mut values = Vec::with_capacity(e.volume() as usize);
        for z in 0..e.z {
            for y in 0..e.y {
                values.extend((0..e.x).map(|x| value([x, y, z])));
            }
        }
        Self { extent: e, factor: grid.factor, values }
    }

    /// A level from its little-endian voxels, x fastest. Infinite values become NaN: they are invalid too.
    ///
    /// # Panics
    /// If `bytes` is not exactly the level.
    pub fn from_bytes(grid: &LevelGrid, voxel_type: VoxelType, bytes: &[u8]) -> Self {
        fn decode<T: Voxel>(bytes: &[u8]) -> Vec<f64> {
            let value = |v: T| if v.is_valid() { v.to_f64() } else { f64::NAN };
            bytes.chunks_exact(size_of::<T>()).map(|b| value(bytemuck::pod_read_unaligned(b))).collect()
        }
        let values = with_voxel_type!(voxel_type, T => decode::<T>(bytes));
        assert_eq!(values.len() as u64, grid.extent.volume(), "bytes do not fill the level");
        Self { extent: grid.extent, factor: grid.factor, values }
    }

    /// The voxel, with indices past a face replicated.
    fn voxel(&self, index: [i64; 3]) -> f64 {
        let n = self.extent.to_array();
        let inside = std::array::from_fn(|a| index[a].clamp(0, n[a] as i64 - 1) as u32);
        self.values[self.extent.linear(inside) as usize]
    }

    /// Differences across two voxels along each axis between nodes in the middle of eight voxels: see
    /// [`gradients`](brickyard_volume::gradients).
    fn stored_differences(&self, point: DVec3) -> DVec3 {
        let p = DVec3::from_array(std::array::from_fn(|a| (point[a] / self.factor[a] as f64 - 1.0) / 2.0));
        let (base, t) = (p.floor(), p - p.floor());
        let mut sum = DVec3::ZERO;
        for corner in (0..8).map(|i| [i & 1, i >> 1 & 1, i >> 2].map(f64::from)) {
            let weight: f64 = (0..3).map(|a| if corner[a] > 0.0 { t[a] } else { 1.0 - t[a] }).product();
            let node = base + DVec3::from_array(corner);
            sum += weight * self.node_differences(node.as_i64vec3().to_array());
        }
        sum
    }

    /// Those at a node: the mean of what its eight voxels have of them, and 0 where they have none.
    fn node_differences(&self, node: [i64; 3]) -> DVec3 {
        let last = self.extent.to_array().map(|n| n as i64 - 1);
        let low: [i64; 3] = std::array::from_fn(|a| (2 * node[a]).min(last[a] - 1).max(0));
        let along = |a: usize| {
            let pairs = (0..8i64).map(|i| [i & 1, i >> 1 & 1, i >> 2]).filter(|corner| corner[a] == 0);
            let difference = |corner: [i64; 3]| {
                let near: [i64; 3] = std::array::from_fn(|k| low[k] + corner[k]);
                let mut far = near;
                far[a] += 1;
                self.voxel(far) - self.voxel(near)
            };
            let known: Vec<f64> = pairs.map(difference).filter(|d| d.is_finite()).collect();
            2.0 * known.iter().sum::<f64>() / known.len().max(1) as f64
        };
        DVec3::new(along(0), along(1), along(2))
    }

    /// Filtered value at a point of voxel space (level-0 voxels). Invalid voxels are left out; where they hold more than
    /// half the weight there is no value.
    pub fn sample(&self, point: DVec3, filter: Filter) -> Option<f64> {
        let p: [f64; 3] = std::array::from_fn(|a| point[a] / self.factor[a] as f64 - 0.5);
        let base = p.map(|v| v.floor());
        // From one voxel below the place to two above it.
        let weights: [[f64; 4]; 3] = std::array::from_fn(|a| match p[a] - base[a] {
            t if filter == Filter::Tricubic => sampling::b_spline(t),
            t => [0.0, 1.0 - t, t, 0.0],
        });
        let (mut sum, mut weight) = (0.0, 0.0);
        // Of those, the two or four with a weight.
        let (first, count) = match filter {
            Filter::Trilinear => (1, 2),
            Filter::Tricubic => (0, 4),
        };
        for voxel in 0..count * count * count {
            let at = [voxel % count, voxel / count % count, voxel / (count * count)].map(|i| i + first);
            let w: f64 = (0..3).map(|a| weights[a][at[a]]).product();
            let value = self.voxel(std::array::from_fn(|a| base[a] as i64 + at[a] as i64 - 1));
            if value.is_finite() {
                sum += w * value;
                weight += w;
            }
        }
        (weight >= 0.5).then(|| sum / weight)
    }
}

/// The volume as the oracle sees it.
pub struct ReferenceVolume<'a> {
    /// All levels, finest first.
    pub levels: &'a [Array],
    /// The level at a point of voxel space.
    pub level_at: &'a dyn Fn(DVec3) -> usize,
    /// The exact transfer function; of `FrameSettings::table` only running integrals are used, and whether there is a grid.
    pub transfer: &'a TransferFunction,
}

/// Renders the whole picture. `FrameSettings` gives rays, lattice, placement, mode and background.
///
/// # Panics
/// If the volume has no level.
pub fn render(frame: &FrameSettings, volume: &ReferenceVolume<'_>) -> Picture {
    let rays = &frame.rays;
    let mut rgb = Vec::with_capacity(rays.width as usize * rays.height as usize);
    for y in 0..rays.height {
        for x in 0..rays.width {
            let color = pixel(frame, volume, x, y);
            rgb.push(Picture::quantise(color.map(|c| c as f32)));
        }
    }
    Picture { width: rays.width, height: rays.height, rgb }
}

/// The display-referred colour of one pixel: from back to front, slabs of the volume and the meshes between them.
pub fn pixel(frame: &FrameSettings, volume: &ReferenceVolume<'_>, x: u32, y: u32) -> [f64; 3] {
    let path = Path::new(frame, x, y);
    let mut color = DVec3::from_array(frame.background.map(f64::from));
    let mut far = f64::INFINITY;
    for layer in layers(frame, &path.world).into_iter().rev() {
        color = slab(frame, volume, &Path { limits: [layer.t, far], ..path }, color);
        color = color.lerp(layer.color, layer.opacity);
        far = layer.t;
    }
    slab(frame, volume, &Path { limits: [0.0, far], ..path }, color).to_array()
}

/// What a part of a ray shows over what is behind it.
fn slab(frame: &FrameSettings, volume: &ReferenceVolume<'_>, path: &Path, behind: DVec3) -> DVec3 {
    if matches!(frame.mode, Mode::Dvr | Mode::Isosurface) {
        return medium::color(frame, volume, path, behind);
    }
    let samples = samples_along(frame, volume, path);
    let values = || samples.iter().map(|s| s.value);
    let value = match frame.mode {
        Mode::Mip => values().reduce(f64::max),
        Mode::MinIp => values().reduce(f64::min),
        Mode::Average => {
            let length: f64 = samples.iter().map(|s| s.length).sum();
            let sum: f64 = samples.iter().map(|s| s.value * s.length).sum();
            (length > 0.0).then(|| sum / length)
        }
        Mode::Dvr | Mode::Isosurface => None,
    };
    value.map_or(behind, |v| DVec3::from_array(volume.transfer.rgb(v)))
}

/// A valid sample and the world length it stands for.
struct Sample {
    value: f64,
    length: f64,
}

fn samples_along(frame: &FrameSettings, volume: &ReferenceVolume<'_>, path: &Path) -> Vec<Sample> {
    let sample = |s: Segment| {
        let point = path.at(s.middle());
        let value = volume.levels[(volume.level_at)(point)].sample(point, frame.sampling.filter)?;
        Some(Sample { value, length: s.length() })
    };
    path.segments(frame, volume).filter_map(sample).collect()
}

/// A part of a ray in voxel space, with world distances along it.
struct Path {
    /// In the scene's world, and in the volume's own.
    world: Ray,
    own: Ray,
    origin: DVec3,
    direction: DVec3,
    /// How far its lattice is moved, in segments.
    jitter: f64,
    /// From where to where.
    limits: [f64; 2],
}

impl Path {
    /// That of a pixel's centre, the whole of it.
    fn new(frame: &FrameSettings, x: u32, y: u32) -> Self {
        let world = frame.rays.ray(x as f64 + 0.5, y as f64 + 0.5);
        let own = frame.placement.volume_ray(&world);
        let origin = frame.geometry.voxel_from_world(own.origin);
        let jitter = frame.sampling.jitter.share(x, y);
        let direction = own.direction / frame.geometry.spacing;
        Self { world, own, origin, direction, jitter, limits: [0.0, f64::INFINITY] }
    }

    fn at(&self, t: f64) -> DVec3 {
        self.origin + self.direction * t
    }

    /// The segments inside of what is shown, near to far.
    fn segments(&self, frame: &FrameSettings, volume: &ReferenceVolume<'_>) -> impl Iterator<Item = Segment> {
        let inside = self.stretch(frame, volume);
        let [near, far] = self.limits;
        inside.into_iter().flat_map(move |(t_in, t_out)| {
            let shift = frame.lattice.shift(self.jitter, t_in);
            let segments = frame.lattice.segments(t_in.max(near) + shift, t_out.min(far) + shift);
            segments.map(move |s| Segment { start: s.start - shift, end: s.end - shift })
        })
    }

    /// Where it is inside of what is shown.
    fn stretch(&self, frame: &FrameSettings, volume: &ReferenceVolume<'_>) -> Option<(f64, f64)> {
        let inside = clip(self.origin, self.direction, frame.shown_box(volume.levels[0].extent))?;
        clip_by_planes(&self.own, frame, inside)
    }
}

/// What of the stretch is on the inner sides of all clip planes.
fn clip_by_planes(ray: &Ray, frame: &FrameSettings, (mut t_in, mut t_out): (f64, f64)) -> Option<(f64, f64)> {
    for plane in frame.clip.iter().flat_map(Clip::planes) {
        // The height above the plane is `height + slope * t`.
        let (height, slope) = (plane.height(ray.origin), plane.normal.dot(ray.direction));
        match slope {
            0.0 if height < 0.0 => return None,
            0.0 => {}
            slope if slope > 0.0 => t_in = t_in.max(-height / slope),
            slope => t_out = t_out.min(-height / slope),
        }
    }
    (t_in < t_out).then_some((t_in, t_out))
}

/// Where the ray is inside the half-open box, `t >= 0`.
fn clip(origin: DVec3, direction: DVec3, (low, high): (DVec3, DVec3)) -> Option<(f64, f64)> {
    let (mut t_in, mut t_out) = (0.0f64, f64::INFINITY);
    for a in 0..3 {
        let (o, d) = (origin[a], direction[a]);
        if d == 0.0 {
            if o < low[a] || o >= high[a] {
                return None;
            }
            continue;
        }
        let (near, far) = ((low[a] - o) / d, (high[a] - o) / d);
        t_in = t_in.max(near.min(far));
        t_out = t_out.min(near.max(far));
    }
    (t_in < t_out).then_some((t_in, t_out))
}

/// The level function of a view that shows one level everywhere.
pub fn one_level(level: usize) -> impl Fn(DVec3) -> usize {
    move |_| level
}

/// All levels of a volume given by level 0, each the mean of the finer one (f64, unrounded; invalid voxels left out).
pub fn mean_levels(pyramid: &Pyramid, finest: Array) -> Vec<Array> {
    let mut levels = vec![finest];
    for grid in &pyramid.levels()[1..] {
        let fine = &levels[levels.len() - 1];
        let step: [u32; 3] = std::array::from_fn(|a| grid.factor[a] / fine.factor[a]);
        let n = fine.extent.to_array();
        let coarse = Array::from_fn(grid, |index| {
            let (mut sum, mut count) = (0.0, 0);
            for corner in 0..8u32 {
                let bit: [u32; 3] = std::array::from_fn(|a| corner >> a & 1);
                let at: [u32; 3] = std::array::from_fn(|a| index[a] * step[a] + bit[a]);
                if (0..3).any(|a| bit[a] >= step[a] || at[a] >= n[a]) {
                    continue;
                }
                let value = fine.values[fine.extent.linear(at) as usize];
                if value.is_finite() {
                    sum += value;
                    count += 1;
                }
            }
            if count > 0 { sum / count as f64 } else { f64::NAN }
        });
        levels.push(coarse);
    }
    levels
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use brickyard_volume::{
        Camera, Geometry, Lattice, Lighting, Mesh, Placement, Projection, Sampling, ShownMesh, SlotEncoding,
        TransferTable,
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
        }
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
        let geometry = Geometry { spacing: DVec3::new(1.0, 2.0, 0.5), origin: DVec3::new(3.0, -1.0, 7.0), unit: None };
        let levels = [cube(9, |_| 100.0)];
        let transfer = fog(0.2);
        let volume = ReferenceVolume { levels: &levels, level_at: &one_level(0), transfer: &transfer };
        let (low, high) = geometry.world_box(levels[0].extent);
        for step in [0.1, 0.7, 3.0] {
            let frame = settings(Mode::Dvr, geometry.clone(), camera(low * 2.0 - high, high), &transfer, step);
            // The central ray runs along the box's long diagonal, corner to corner.
            let alpha = 1.0 - 0.8f64.powf((high - low).length() / 2.0);
            let expected = [alpha + (1.0 - alpha) * 0.25, alpha * 0.5, 1.0 - alpha];
            let found = pixel(&frame, &volume, 16, 16);
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
            let found = pixel(&frame, &volume, 16, 16)[0];
            // Samples stand half a step inside; the outermost half voxel is constant.
            assert!((found - expected).abs() < 1e-3, "{mode:?}: {found}");
        }
        let frame = settings(Mode::Mip, Geometry::default(), view, &transfer, 0.5);
        assert_eq!(pixel(&frame, &volume, 0, 0), [0.25, 0.0, 1.0], "a miss shows the background");
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
        // The volume is from -0.5 to 15.5; what is behind 10.3 is not seen.
        let (fog, blue) = (DVec3::new(1.0, 0.5, 0.0), DVec3::Z);
        let over = |length: f64, behind: DVec3| fog.lerp(behind, 0.8f64.powf(length / 2.0));
        let expected = over(4.5 + 0.2, over(10.3 - 4.2, blue).lerp(blue, 0.3));
        for step in [0.1, 0.7, 3.0] {
            let meshes = vec![wall(12.0, 0.5), wall(10.3, 1.0), wall(4.2, 0.3)];
            let frame = settings(Mode::Dvr, Geometry::default(), view, &transfer, step);
            let frame = FrameSettings { meshes, ..frame };
            let ray = frame.rays.ray(16.5, 16.5);
            assert_eq!(layers(&frame, &ray).len(), 2);
            // The walls' places are single numbers: 1e-7 of themselves off.
            let found = DVec3::from_array(pixel(&frame, &volume, 16, 16));
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
            pixel(&frame, &volume, 16, 16)
        };
        // A step's half is not seen.
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
