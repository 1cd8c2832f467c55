//! Triangle meshes in one picture with the volume, and the rule for them shared by all renderers.
//!
//! A ray meets a mesh in a *layer*: a distance, a colour and an opacity. Layers cut a ray's stretch in the volume into *slabs*;
//! slabs and layers follow one another from the eye, each dimmed by everything in front, up to the first opaque layer. Each slab is
//! a stretch of its own, cut into segments (see [`lattice`](crate::lattice)) that begin and end just at the layers. So an opaque
//! mesh has its exact place in every mode, and fog in front of a translucent one its exact length.
//!
//! Nothing clips a mesh: box, planes and slices are cuts of the volume. Both sides of a triangle are shown, lit from the eye.

use crate::ensure::ensure;
use crate::lighting::headlight;
use crate::ray::Ray;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::Arc;

/// Default colour of a mesh with none in its file or the scene: a light gray.
pub const PLAIN_COLOR: [f64; 3] = [0.8; 3];

/// A triangle mesh in the world: vertices and the triangles between them. All numbers are finite, and the vertices of every triangle
/// exist.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    positions: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
    normals: Vec<[f32; 3]>,
    colors: Vec<[u8; 3]>,
}

/// Why vertices and triangles make no mesh.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// There is no triangle.
    #[error("it has no triangles: expected at least one")]
    Empty,
    /// A triangle refers to a missing vertex.
    #[error("triangle {triangle} names vertex {index}, but there are {vertices}, numbered from 0")]
    Index {
        /// Index of the first such triangle.
        triangle: usize,
        /// Index of the missing vertex.
        index: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// A position or a normal has a number that is NaN or infinite.
    #[error("the {what} of vertex {vertex} is {found:?}: expected finite numbers")]
    NotFinite {
        /// `position` or `normal`.
        what: &'static str,
        /// Index of the first such vertex.
        vertex: usize,
        /// The position or normal of that vertex, as given.
        found: [f32; 3],
    },
    /// There are normals or colours, but not one for each vertex.
    #[error("there are {found} {what} for {vertices} vertices: expected one each, or none")]
    Count {
        /// `normals` or `colours`.
        what: &'static str,
        /// Number of normals or colours.
        found: usize,
        /// Number of vertices.
        vertices: usize,
    },
    /// The vertices and triangles, of this total number, are too many for 32 bits.
    #[error("{0} vertices and triangles: expected fewer than 2^31 in all")]
    TooLarge(usize),
}

impl Mesh {
    /// Creates a mesh of vertices and triangles between them. Normals and colours are one for each vertex, or empty.
    ///
    /// # Errors
    /// If there is no triangle, a triangle's vertex does not exist, a number is not finite, there are too many vertices and
    /// triangles, or normals or colours do not match the vertices.
    pub fn new(
        positions: Vec<[f32; 3]>,
        triangles: Vec<[u32; 3]>,
        normals: Vec<[f32; 3]>,
        colors: Vec<[u8; 3]>,
    ) -> Result<Self, MeshError> {
        let vertices = positions.len();
        let numbers = vertices.saturating_add(triangles.len());
        ensure(!triangles.is_empty(), || MeshError::Empty)?;
        ensure(numbers < 1 << 31, || MeshError::TooLarge(numbers))?;
        for (what, found) in [("normals", normals.len()), ("colours", colors.len())] {
            ensure(found == 0 || found == vertices, || MeshError::Count { what, found, vertices })?;
        }
        for (what, all) in [("position", &positions), ("normal", &normals)] {
            if let Some(vertex) = all.iter().position(|v| v.iter().any(|x| !x.is_finite())) {
                return Err(MeshError::NotFinite { what, vertex, found: all[vertex] });
            }
        }
        for (triangle, corners) in triangles.iter().enumerate() {
            if let Some(&index) = corners.iter().find(|&&index| index as usize >= vertices) {
                return Err(MeshError::Index { triangle, index, vertices });
            }
        }
        Ok(Self { positions, triangles, normals, colors })
    }

    /// World positions of the vertices.
    pub fn positions(&self) -> &[[f32; 3]] {
        &self.positions
    }

    /// Indices of the three vertices of each triangle.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// The vertices' normals, of any length; empty if there are none.
    pub fn normals(&self) -> &[[f32; 3]] {
        &self.normals
    }

    /// The vertices' colours, display-referred; empty if there are none.
    pub fn colors(&self) -> &[[u8; 3]] {
        &self.colors
    }

    /// World positions of a triangle's corners.
    ///
    /// # Panics
    /// If there is no such triangle.
    pub fn corners(&self, triangle: usize) -> [DVec3; 3] {
        self.triangles[triangle].map(|i| DVec3::from_array(self.positions[i as usize].map(f64::from)))
    }

    /// Size in memory, in bytes.
    pub fn bytes(&self) -> u64 {
        let triples = self.positions.len() + self.triangles.len() + self.normals.len();
        (12 * triples + 3 * self.colors.len()) as u64
    }
}

/// A mesh of a scene, and its look.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeshLook {
    /// The mesh's file.
    pub path: PathBuf,
    /// Colour of the mesh, display-referred, in 0..=1; `None` is the file's, or [`PLAIN_COLOR`].
    pub color: Option<[f64; 3]>,
    /// Opacity of the mesh, from 0 (not there) to 1 (opaque).
    #[serde(default = "opaque")]
    pub opacity: f64,
    /// Whether the mesh is lit from the eye; if not, it shows its plain colour.
    #[serde(default = "lit")]
    pub lit: bool,
    /// The mesh in the file; `None` until it has been read. In JSON a scene has the file's name alone.
    #[serde(skip)]
    pub mesh: Option<Arc<Mesh>>,
}

fn opaque() -> f64 {
    1.0
}

fn lit() -> bool {
    true
}

impl MeshLook {
    /// Returns a mesh of a file, opaque and lit, not yet read.
    pub fn new(path: impl Into<PathBuf>) -> Self {
        Self { path: path.into(), color: None, opacity: opaque(), lit: lit(), mesh: None }
    }

    /// Returns the mesh in the renderers' form.
    ///
    /// # Errors
    /// If the colour or the opacity is not in 0..=1, or the file has not been read.
    pub fn shown(&self) -> Result<ShownMesh, MeshLookError> {
        let path = || self.path.clone();
        let &Self { color, opacity, lit, .. } = self;
        if let Some(color) = color.filter(|c| !c.iter().all(|v| (0.0..=1.0).contains(v))) {
            return Err(MeshLookError::Color { path: path(), color });
        }
        ensure((0.0..=1.0).contains(&opacity), || MeshLookError::Opacity { path: path(), opacity })?;
        let mesh = self.mesh.clone().ok_or_else(|| MeshLookError::NotRead(path()))?;
        Ok(ShownMesh { mesh, color, opacity, lit })
    }
}

/// Why a mesh cannot be shown as requested.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MeshLookError {
    /// The mesh's colour is not in 0..=1.
    #[error("the mesh {}: its colour is {color:?}: expected red, green and blue in 0..1", path.display())]
    Color {
        /// The mesh's file.
        path: PathBuf,
        /// The given colour.
        color: [f64; 3],
    },
    /// The mesh's opacity is not in 0..=1.
    #[error("the mesh {}: its opacity is {opacity}: expected a number from 0 to 1", path.display())]
    Opacity {
        /// The mesh's file.
        path: PathBuf,
        /// The given opacity.
        opacity: f64,
    },
    /// The mesh's file, at this path, has not been read.
    #[error("the mesh {} has not been read: set MeshLook::mesh to the file's mesh", .0.display())]
    NotRead(PathBuf),
    /// The mesh is translucent in a projection, which shows one value of the whole ray without an order of depth.
    #[error(
        "the mesh {} has opacity {opacity}, and a projection shows one value of the whole ray, without depth: make the \
         mesh opaque, or choose the mode dvr or isosurface", path.display()
    )]
    Projection {
        /// The mesh's file.
        path: PathBuf,
        /// The mesh's opacity.
        opacity: f64,
    },
    /// A scene's vertices and triangles, of this total number, are too many for 32 bits.
    #[error("the meshes have {0} vertices and triangles in all: expected fewer than 2^31")]
    TooLarge(u64),
}

/// A mesh in the renderers' form, and its look.
#[derive(Clone, Debug)]
pub struct ShownMesh {
    /// Vertices and triangles of the mesh.
    pub mesh: Arc<Mesh>,
    /// Colour of the mesh, display-referred, in 0..=1; `None` is the mesh's own, or [`PLAIN_COLOR`].
    pub color: Option<[f64; 3]>,
    /// Opacity of the mesh, 0 to 1.
    pub opacity: f64,
    /// Whether the mesh is lit from the eye; if not, it shows its plain colour.
    pub lit: bool,
}

impl ShownMesh {
    /// The straight colour of a triangle for a ray of this unit direction. `weights` are the corners' weights at the hit.
    pub fn color_at(&self, triangle: usize, weights: [f64; 3], direction: DVec3) -> DVec3 {
        let mesh = &self.mesh;
        let corners = mesh.triangles[triangle];
        let mean = |of: &dyn Fn(usize) -> DVec3| (0..3).map(|k| of(corners[k] as usize) * weights[k]).sum::<DVec3>();
        let own = match self.color {
            Some(color) => DVec3::from_array(color),
            None if !mesh.colors.is_empty() => mean(&|i| DVec3::from_array(mesh.colors[i].map(|c| c as f64 / 255.0))),
            None => DVec3::from_array(PLAIN_COLOR),
        };
        if !self.lit {
            return own;
        }
        let given = match mesh.normals.is_empty() {
            true => DVec3::ZERO,
            false => mean(&|i| DVec3::from_array(mesh.normals[i].map(f64::from))),
        };
        let normal = given.try_normalize().or_else(|| {
            let [a, b, c] = mesh.corners(triangle);
            (b - a).cross(c - a).try_normalize()
        });
        let (share, white) = headlight(normal.map(|normal| normal.dot(direction)));
        own * share + white
    }
}

/// A ray's hit on a mesh, with its look there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layer {
    /// World distance from the origin of the ray.
    pub t: f64,
    /// Number of the triangle, counted over all meshes. Of two triangles at one distance the one with the lower number is in front.
    pub number: u32,
    /// Straight colour of the mesh along the ray.
    pub color: DVec3,
    /// Opacity of the mesh: 1 hides everything behind.
    pub opacity: f64,
}

/// Intersects a ray with a triangle: the distance, and each corner's weight there. `None` without a hit in front of its origin. A
/// ray through the common edge of two triangles, on two sides of it, meets just one of them.
pub fn hit(corners: [DVec3; 3], ray: &Ray) -> Option<(f64, [f64; 3])> {
    let [a, b, c] = corners.map(|corner| corner - ray.origin);
    let sides = [(b, c), (c, a), (a, b)].map(|(from, to)| side(from, to, ray.direction));
    let [(of_a, is_past_a), (of_b, is_past_b), (of_c, is_past_c)] = sides;
    if is_past_a != is_past_b || is_past_b != is_past_c {
        return None;
    }
    let sum = of_a + of_b + of_c;
    let weights = [of_a, of_b, of_c].map(|height| height / sum);
    let t = (a * weights[0] + b * weights[1] + c * weights[2]).dot(ray.direction);
    // A triangle without area has a sum of 0, and no distance.
    (t > 0.0 && t.is_finite()).then_some((t, weights))
}

/// The distance of a ray from the origin to an edge, times the triangle's size, and whether it passes on the positive side. Computed
/// in the same order for both directions of an edge, so both of its triangles get the same number but for the sign.
fn side(from: DVec3, to: DVec3, direction: DVec3) -> (f64, bool) {
    let is_turned = from.to_array() > to.to_array();
    let (low, high) = if is_turned { (to, from) } else { (from, to) };
    let height = direction.dot(low.cross(high));
    (if is_turned { -height } else { height }, (height >= 0.0) != is_turned)
}

/// The total size of meshes, for which a renderer makes room.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct MeshCapacity {
    /// Number of meshes.
    pub meshes: u32,
    /// Number of vertices of all meshes.
    pub vertices: u32,
    /// Number of triangles of all meshes.
    pub triangles: u32,
}

impl MeshCapacity {
    /// The capacity for no mesh.
    pub const NONE: Self = Self { meshes: 0, vertices: 0, triangles: 0 };

    /// The capacity for these meshes.
    pub fn of<'a>(meshes: impl IntoIterator<Item = &'a Mesh>) -> Self {
        meshes.into_iter().fold(Self::NONE, |room, mesh| Self {
            meshes: room.meshes + 1,
            vertices: room.vertices.saturating_add(mesh.positions.len() as u32),
            triangles: room.triangles.saturating_add(mesh.triangles.len() as u32),
        })
    }

    /// Whether there is no room for any triangle.
    pub fn is_none(&self) -> bool {
        self.triangles == 0
    }

    /// The capacity for the meshes of either of two pictures.
    pub fn union(self, other: Self) -> Self {
        Self {
            meshes: self.meshes.max(other.meshes),
            vertices: self.vertices.max(other.vertices),
            triangles: self.triangles.max(other.triangles),
        }
    }

    /// Whether this capacity suffices for `other`.
    pub fn holds(&self, other: &Self) -> bool {
        self.meshes >= other.meshes && self.vertices >= other.vertices && self.triangles >= other.triangles
    }

    /// Greatest memory of meshes of this capacity, in bytes.
    pub fn bytes(&self) -> u64 {
        self.vertices as u64 * (12 + 12 + 3) + self.triangles as u64 * 12
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ray(origin: [f64; 3], direction: [f64; 3]) -> Ray {
        Ray { origin: origin.into(), direction: DVec3::from_array(direction).normalize() }
    }

    #[test]
    fn what_is_no_mesh_is_refused() {
        let triangle = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let mesh = |positions: &[[f32; 3]], triangles: &[[u32; 3]]| {
            Mesh::new(positions.to_vec(), triangles.to_vec(), vec![], vec![])
        };
        assert_eq!(mesh(&triangle, &[]), Err(MeshError::Empty));
        assert_eq!(
            mesh(&triangle, &[[0, 1, 2], [2, 3, 1]]),
            Err(MeshError::Index { triangle: 1, index: 3, vertices: 3 })
        );
        let bad = [[0.0; 3], [1.0, f32::NAN, 0.0], [0.0; 3]];
        assert!(matches!(mesh(&bad, &[[0, 1, 2]]), Err(MeshError::NotFinite { what: "position", vertex: 1, .. })));
        let of_two = Mesh::new(triangle.clone(), vec![[0, 1, 2]], vec![], vec![[0; 3]; 2]);
        assert_eq!(of_two, Err(MeshError::Count { what: "colours", found: 2, vertices: 3 }));
        assert!(mesh(&triangle, &[[0, 1, 2]]).is_ok());
    }

    #[test]
    fn hits_have_their_distance_and_weights() {
        let corners = [DVec3::new(0.0, 0.0, 5.0), DVec3::new(4.0, 0.0, 5.0), DVec3::new(0.0, 4.0, 9.0)];
        let (t, weights) = hit(corners, &ray([1.0, 2.0, -1.0], [0.0, 0.0, 1.0])).unwrap();
        assert_eq!((t, weights), (8.0, [0.25, 0.25, 0.5]));
        assert_eq!(hit([corners[2], corners[1], corners[0]], &ray([1.0, 2.0, -1.0], [0.0, 0.0, 1.0])).unwrap().0, 8.0);
        assert!(hit(corners, &ray([1.0, 2.0, 20.0], [0.0, 0.0, 1.0])).is_none(), "behind the eye");
        assert!(hit(corners, &ray([3.0, 2.0, -1.0], [0.0, 0.0, 1.0])).is_none(), "beside");
        let thin = [DVec3::Z, DVec3::Z * 2.0, DVec3::Z * 3.0];
        assert!(hit(thin, &ray([0.0; 3], [0.0, 0.0, 1.0])).is_none(), "no area");
    }

    #[test]
    fn a_ray_through_an_edge_meets_one_of_its_triangles() {
        // A square in four triangles about its centre, either way round each: rays through all edges, and nearly all corners.
        let square = [
            DVec3::new(-1.0, -1.0, 2.0),
            DVec3::new(1.0, -1.0, 2.0),
            DVec3::new(1.0, 1.0, 2.0),
            DVec3::new(-1.0, 1.0, 2.0),
        ];
        let centre = DVec3::new(0.0, 0.0, 2.0);
        for turned in 0..16 {
            for i in 1..20 {
                let at = -1.0 + 0.1 * i as f64;
                for target in [[at, at, 2.0], [at, -at, 2.0]] {
                    if i == 10 {
                        continue;
                    }
                    let hits = (0..4).filter(|&k| {
                        let (a, b) = (square[k], square[(k + 1) % 4]);
                        let corners = if turned >> k & 1 == 1 { [centre, b, a] } else { [centre, a, b] };
                        hit(corners, &ray([0.0; 3], target)).is_some()
                    });
                    assert_eq!(hits.count(), 1, "{turned} {target:?}");
                }
            }
        }
    }

    #[test]
    fn a_look_may_override_the_files_colours() {
        let positions = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let colors = vec![[255, 0, 0], [0, 255, 0], [0, 0, 255]];
        let mesh = Mesh::new(positions, vec![[0, 1, 2]], vec![[0.0, 0.0, 2.0]; 3], colors).unwrap();
        let look = MeshLook { lit: false, mesh: Some(Arc::new(mesh)), ..MeshLook::new("a.ply") };
        let seen = |look: &MeshLook| look.shown().unwrap().color_at(0, [0.5, 0.25, 0.25], DVec3::Z);
        assert_eq!(seen(&look), DVec3::new(0.5, 0.25, 0.25));
        let red = MeshLook { color: Some([0.5, 0.0, 0.0]), ..look.clone() };
        assert_eq!(seen(&red), DVec3::new(0.5, 0.0, 0.0));
        let (own, white) = headlight(Some(1.0));
        assert_eq!(seen(&MeshLook { lit: true, ..red.clone() }), DVec3::new(0.5 * own + white, white, white));
        assert!(matches!(MeshLook { opacity: 1.5, ..red.clone() }.shown(), Err(MeshLookError::Opacity { .. })));
        assert!(matches!(
            MeshLook { color: Some([0.0, f64::NAN, 0.0]), ..red }.shown(),
            Err(MeshLookError::Color { .. })
        ));
        assert!(matches!(MeshLook::new("b.stl").shown(), Err(MeshLookError::NotRead(_))));
    }
}
