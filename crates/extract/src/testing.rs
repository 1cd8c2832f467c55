//! Volumes for tests, and a mesh read back with the checks that every mesh must pass.

use crate::extraction::mesh;
use crate::report::MeshReport;
use crate::request::MeshRequest;
use brickyard_import::{ImportError, Source, SourceInfo};
use brickyard_store::{Downsample, Edit, Kind, PackOptions, Store, edit, pack};
use brickyard_volume::{Extent, Geometry, Orientation, Voxel, VoxelBox};
use glam::DVec3;
use std::collections::{HashMap, HashSet};
use std::ops::ControlFlow;

/// A volume by a function of its voxels.
pub(crate) struct Made<F> {
    pub(crate) info: SourceInfo,
    value: F,
}

impl<F> Made<F> {
    pub(crate) fn new<T: Voxel>(extent: [u32; 3], value: F) -> Self
    where
        F: Fn([u32; 3]) -> T,
    {
        let info = SourceInfo {
            calibrated: true,
            identity: "made".into(),
            ..SourceInfo::of_volume(Extent::from_array(extent), T::TYPE)
        };
        Self { info, value }
    }

    pub(crate) fn spaced(mut self, spacing: DVec3, origin: DVec3) -> Self {
        self.info.geometry = Geometry { spacing, origin, ..Geometry::default() };
        self
    }

    pub(crate) fn oriented(mut self, rows: [[f64; 4]; 3]) -> Self {
        self.info.orientation = Some(Orientation::new(rows).unwrap());
        self.info.geometry.unit = Some("millimeter".into());
        self
    }
}

impl<T: Voxel, F: Fn([u32; 3]) -> T + Send + Sync> Source for Made<F>
where
    F: Fn([u32; 3]) -> T,
{
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_box(&self, _: u32, _: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        let (min, max) = (region.min, region.max);
        let rows = (min.z..max.z).flat_map(|z| (min.y..max.y).map(move |y| (y, z)));
        let voxels = rows.flat_map(|(y, z)| (min.x..max.x).map(move |x| [x, y, z]));
        for (voxel, bytes) in voxels.zip(out.chunks_exact_mut(size_of::<T>())) {
            bytes.copy_from_slice(bytemuck::bytes_of(&(self.value)(voxel)));
        }
        Ok(())
    }
}

/// A store in a folder of its own.
pub(crate) struct Packed {
    pub(crate) folder: tempfile::TempDir,
    pub(crate) store: Store,
}

impl Packed {
    pub(crate) fn image(source: &dyn Source, edge: u32) -> Self {
        Self::new(source, edge, Kind::Image, Downsample::Mean)
    }

    pub(crate) fn labels(source: &dyn Source, edge: u32) -> Self {
        Self::new(source, edge, Kind::Labels, Downsample::Mode)
    }

    /// Labels of any values, as no pack makes them, but an edit may.
    pub(crate) fn image_called_labels(source: &dyn Source, edge: u32) -> Self {
        let Self { folder, .. } = Self::new(source, edge, Kind::Image, Downsample::Mode);
        let path = folder.path().join("s.zarr");
        edit(&path, &Edit { kind: Some(Kind::Labels), ..Edit::default() }).unwrap();
        Self { store: Store::open(&path).unwrap(), folder }
    }

    fn new(source: &dyn Source, edge: u32, kind: Kind, downsample: Downsample) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("s.zarr");
        let options = PackOptions {
            edge,
            shard_edge: 2 * edge,
            threads: 1,
            kind,
            downsample: downsample.into(),
            ..PackOptions::new(source.info().voxel_type)
        };
        pack(source, &path, &options, &()).unwrap();
        Self { store: Store::open(&path).unwrap(), folder }
    }

    /// Extracts a mesh to PLY and reads it back.
    pub(crate) fn ply(&self, request: &MeshRequest) -> (Ply, MeshReport) {
        let path = self.folder.path().join("mesh.ply");
        let request = MeshRequest { overwrite: true, ..*request };
        let report = mesh(&self.store, &path, &request, go_on).unwrap();
        (Ply::read(&std::fs::read(path).unwrap()), report)
    }
}

pub(crate) fn go_on(_: u64, _: u64) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// A mesh read back.
pub(crate) struct Ply {
    pub(crate) places: Vec<DVec3>,
    pub(crate) triangles: Vec<[u32; 3]>,
}

impl Ply {
    pub(crate) fn read(bytes: &[u8]) -> Self {
        let end = bytes.windows(11).position(|window| window == b"end_header\n").unwrap() + 11;
        let header = std::str::from_utf8(&bytes[..end]).unwrap();
        let count = |word: &str| -> usize {
            let line = header.lines().find_map(|line| line.strip_prefix(word)).unwrap();
            line.trim().parse().unwrap()
        };
        let (vertices, faces) = (count("element vertex "), count("element face "));
        let is_single = header.contains("property float x");
        let part_bytes = if is_single { 4 } else { 8 };
        let (of_vertices, of_faces) = bytes[end..].split_at(3 * part_bytes * vertices);
        assert_eq!(of_faces.len(), 13 * faces);
        let part = |bytes: &[u8]| match is_single {
            true => f64::from(f32::from_le_bytes(bytes.try_into().unwrap())),
            false => f64::from_le_bytes(bytes.try_into().unwrap()),
        };
        let parts: Vec<f64> = of_vertices.chunks_exact(part_bytes).map(part).collect();
        let word = |bytes: &[u8], k: usize| u32::from_le_bytes(bytes[1 + 4 * k..5 + 4 * k].try_into().unwrap());
        let triangles = of_faces.chunks_exact(13).map(|bytes| [0, 1, 2].map(|k| word(bytes, k))).collect();
        Self { places: parts.chunks_exact(3).map(DVec3::from_slice).collect(), triangles }
    }

    /// Checks that each edge has two triangles, in opposite directions, and that each vertex is used and stands alone. Returns Euler's number.
    pub(crate) fn checked(&self) -> i64 {
        let mut edges = HashMap::<[u32; 2], u32>::new();
        for &[a, b, c] in &self.triangles {
            assert!(a != b && b != c && c != a);
            for edge in [[a, b], [b, c], [c, a]] {
                *edges.entry(edge).or_default() += 1;
            }
        }
        for (&[a, b], &uses) in &edges {
            assert_eq!(
                (uses, edges.get(&[b, a]).copied()),
                (1, Some(1)),
                "{} to {}",
                self.places[a as usize],
                self.places[b as usize]
            );
        }
        let used: HashSet<u32> = self.triangles.iter().flatten().copied().collect();
        assert_eq!(used.len(), self.places.len());
        let places: HashSet<[u64; 3]> = self.places.iter().map(|place| place.to_array().map(f64::to_bits)).collect();
        assert_eq!(places.len(), self.places.len());
        self.places.len() as i64 - edges.len() as i64 / 2 + self.triangles.len() as i64
    }

    pub(crate) fn corners(&self) -> impl Iterator<Item = [DVec3; 3]> {
        self.triangles.iter().map(|triangle| triangle.map(|vertex| self.places[vertex as usize]))
    }

    pub(crate) fn volume(&self) -> f64 {
        self.corners().map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
    }

    pub(crate) fn area(&self) -> f64 {
        self.corners().map(|[a, b, c]| 0.5 * (b - a).cross(c - a).length()).sum()
    }

    /// The least cosine between the normals of neighbours.
    pub(crate) fn sharpest_fold(&self) -> f64 {
        let mut normals = HashMap::new();
        for (&[a, b, c], [p, q, r]) in self.triangles.iter().zip(self.corners()) {
            let normal = (q - p).cross(r - p).normalize();
            assert!(normal.is_finite());
            normals.extend([[a, b], [b, c], [c, a]].map(|edge| (edge, normal)));
        }
        normals.iter().map(|([a, b], normal)| normal.dot(normals[&[*b, *a]])).fold(1.0, f64::min)
    }

    /// The distance of a point from the nearest triangle.
    pub(crate) fn distance(&self, point: DVec3) -> f64 {
        let of_segment = |from: DVec3, to: DVec3| {
            let share = ((point - from).dot(to - from) / from.distance_squared(to)).clamp(0.0, 1.0);
            point.distance(from.lerp(to, share))
        };
        let of_triangle = |[a, b, c]: [DVec3; 3]| {
            let normal = (b - a).cross(c - a).normalize();
            let is_within = |from: DVec3, to: DVec3| (to - from).cross(point - from).dot(normal) >= 0.0;
            match is_within(a, b) && is_within(b, c) && is_within(c, a) {
                true => normal.dot(point - a).abs(),
                false => of_segment(a, b).min(of_segment(b, c)).min(of_segment(c, a)),
            }
        };
        self.corners().map(of_triangle).fold(f64::INFINITY, f64::min)
    }

    /// The triangles by the bits of their places, beginning at the least corner; sorted.
    pub(crate) fn sorted(&self) -> Vec<[[u64; 3]; 3]> {
        let mut all: Vec<_> = self.corners().map(by_bits).collect();
        all.sort_unstable();
        all
    }
}

/// A triangle by the bits of its places, turned so that the least corner is first.
pub(crate) fn by_bits(corners: [DVec3; 3]) -> [[u64; 3]; 3] {
    let mut bits = corners.map(|place| place.to_array().map(f64::to_bits));
    let least = (0..3).min_by_key(|k| bits[*k]).unwrap();
    bits.rotate_left(least);
    bits
}
