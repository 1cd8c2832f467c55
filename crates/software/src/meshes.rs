//! Meshes: a tree of boxes over the triangles, and the layers met by a tile's rays, one after the other.
//!
//! A tile descends the tree through the boxes its rays may meet, and intersects the rays with the triangles. The
//! nearest hit behind the previous layer is the next layer: so a tile keeps one layer per ray, however many there are,
//! and searches the tree once for each. The tree is built when the meshes change, by all threads, in n log n.

use crate::outline::pixels;
use crate::ray::FAINTEST;
use crate::tiles::{PIXELS, TILE_PX, Tile, place};
use brickyard_volume::{FrameSettings, Mesh, MeshCapacity, PixelRect, Ray, ShownMesh, ViewRays, mesh};
use glam::{DVec3, Vec4};
use std::sync::Arc;

/// Most triangles of a leaf: fewer cost more for boxes than for rays.
const LEAF: usize = 8;

/// Triangles below which a thread builds a subtree alone.
const ALONE: usize = 1 << 14;

/// The most bytes of the tree over meshes, beside the meshes themselves; 0 without room for meshes. Every triangle
/// takes its place in the order of leaves, a leaf has at least half of [`LEAF`] triangles, and there are fewer inner
/// nodes than leaves.
pub(crate) fn bytes(room: MeshCapacity) -> u64 {
    let nodes = room.triangles as usize * 2 / (LEAF / 2) + 1;
    let each = room.triangles as usize * size_of::<u32>() + nodes * size_of::<Node>();
    if room.is_none() { 0 } else { (each + room.meshes as usize * size_of::<Held>()) as u64 }
}

pub(crate) const BYTES_PER_THREAD: u64 = size_of::<MeshLayers>() as u64;

/// Tree of boxes over the triangles of a frame's meshes.
#[derive(Debug, Default)]
pub(crate) struct MeshTree {
    held: Vec<Held>,
    /// The triangles' numbers, in the order of leaves.
    order: Vec<u32>,
    /// The nodes, root first; behind an inner node its first child.
    nodes: Vec<Node>,
}

/// A mesh, and the number of its first triangle.
#[derive(Debug)]
struct Held {
    mesh: Arc<Mesh>,
    first: u32,
}

/// A box and its contents: a leaf's triangles, or the children of an inner node, whose `count` is 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Node {
    low: [f32; 3],
    high: [f32; 3],
    count: u32,
    /// The leaf's first triangle in the order, or the second child.
    at: u32,
}

fn nodes(triangles: usize) -> usize {
    if triangles <= LEAF { 1 } else { 1 + nodes(triangles / 2) + nodes(triangles - triangles / 2) }
}

impl MeshTree {
    pub(crate) fn is_of(&self, meshes: &[ShownMesh]) -> bool {
        let is_same = |(held, shown): (&Held, &ShownMesh)| Arc::ptr_eq(&held.mesh, &shown.mesh);
        self.held.len() == meshes.len() && self.held.iter().zip(meshes).all(is_same)
    }

    pub(crate) fn new(meshes: &[ShownMesh]) -> Self {
        let mut count = 0;
        let mut held = Vec::new();
        for shown in meshes {
            held.push(Held { mesh: shown.mesh.clone(), first: count });
            count += shown.mesh.triangles().len() as u32;
        }
        let (mut order, mut tree) = ((0..count).collect::<Vec<u32>>(), vec![Node::default(); nodes(count as usize)]);
        if count > 0 {
            Build { held: &held }.node(&mut order, &mut tree, 0, 0);
        }
        Self { held, order, nodes: tree }
    }

    /// Finds, for each of a tile's rays, the next layer of meshes behind the current one.
    pub(crate) fn peel(&self, settings: &FrameSettings, tile: &Tile, layers: &mut MeshLayers) {
        let rays = &settings.rays;
        let beam = Beam::new(rays, tile);
        layers.next = [Found::NONE; PIXELS];
        let mut open = vec![0usize];
        while let Some(i) = open.pop() {
            let Some(node) = self.nodes.get(i).filter(|node| beam.may_meet(node)) else { continue };
            if node.count == 0 {
                open.extend([node.at as usize, i + 1]);
                continue;
            }
            for &number in &self.order[node.at as usize..(node.at + node.count) as usize] {
                let (held, triangle) = self.triangle(number);
                layers.meet(rays, tile, self.held[held].mesh.corners(triangle), number);
            }
        }
        for (found, ray) in layers.next.iter_mut().zip(&layers.rays) {
            if let Some(number) = found.number {
                let (held, triangle) = self.triangle(number);
                let shown = &settings.meshes[held];
                let color = shown.color_at(triangle, found.weights, ray.direction).as_vec3();
                found.color = (color * shown.opacity as f32).extend(1.0 - shown.opacity as f32);
            }
        }
    }

    /// The mesh of this triangle, and the triangle's index in it.
    fn triangle(&self, number: u32) -> (usize, usize) {
        let held = self.held.partition_point(|held| held.first <= number) - 1;
        (held, (number - self.held[held].first) as usize)
    }
}

struct Build<'a> {
    held: &'a [Held],
}

impl Build<'_> {
    fn corners(&self, number: u32) -> [[f32; 3]; 3] {
        let held = &self.held[self.held.partition_point(|held| held.first <= number) - 1];
        held.mesh.triangles()[(number - held.first) as usize].map(|i| held.mesh.positions()[i as usize])
    }

    /// Three quarters of the triangle's middle: halves do not overflow.
    fn middle(&self, number: u32, axis: usize) -> f32 {
        self.corners(number).iter().map(|corner| corner[axis] * 0.25).sum()
    }

    /// Builds the node at the front of `tree`, at index `place` of the whole tree, over these triangles; `first` is
    /// their start in the order.
    fn node(&self, order: &mut [u32], tree: &mut [Node], place: usize, first: usize) {
        let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for corner in order.iter().flat_map(|&number| self.corners(number)) {
            for a in 0..3 {
                (low[a], high[a]) = (low[a].min(corner[a]), high[a].max(corner[a]));
            }
        }
        if order.len() <= LEAF {
            tree[0] = Node { low, high, count: order.len() as u32, at: first as u32 };
            return;
        }
        let size = |a: usize| high[a] as f64 - low[a] as f64;
        let longest = (0..3).max_by(|&a, &b| size(a).total_cmp(&size(b))).unwrap_or(0);
        let half = order.len() / 2;
        // Ties break by number: the same meshes make the same tree.
        order.select_nth_unstable_by(half, |&a, &b| {
            self.middle(a, longest).total_cmp(&self.middle(b, longest)).then(a.cmp(&b))
        });
        let left = nodes(half);
        tree[0] = Node { low, high, count: 0, at: (place + 1 + left) as u32 };
        let is_alone = order.len() < ALONE;
        let (near, far) = order.split_at_mut(half);
        let (near_tree, far_tree) = tree[1..].split_at_mut(left);
        let mut near = || self.node(near, near_tree, place + 1, first);
        let mut far = || self.node(far, far_tree, place + 1 + left, first + half);
        if is_alone {
            near();
            far();
        } else {
            rayon::join(near, far);
        }
    }
}

/// Four planes around a tile's rays.
struct Beam {
    /// Each plane's inward normal, and its height above the world's origin.
    planes: [(DVec3, f64); 4],
}

impl Beam {
    fn new(rays: &ViewRays, tile: &Tile) -> Self {
        let [x0, x1, y0, y1] = [tile.x0, tile.x1, tile.y0, tile.y1].map(f64::from);
        let corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)].map(|(x, y)| rays.ray(x, y));
        let middle = rays.ray(0.5 * (x0 + x1), 0.5 * (y0 + y1));
        let planes = std::array::from_fn(|i| {
            let (a, b) = (corners[i], corners[(i + 1) % 4]);
            let normal = a.direction.cross(b.origin + b.direction - a.origin);
            let is_inward = normal.dot(middle.origin + middle.direction - a.origin) > 0.0;
            let normal = if is_inward { normal } else { -normal };
            (normal, normal.dot(a.origin))
        });
        Self { planes }
    }

    fn may_meet(&self, node: &Node) -> bool {
        self.planes.iter().all(|(normal, height)| {
            let highest = |a: usize| if normal[a] > 0.0 { node.high[a] } else { node.low[a] } as f64;
            normal.dot(DVec3::new(highest(0), highest(1), highest(2))) >= *height
        })
    }
}

/// The next mesh layer of a ray; none without a number.
#[derive(Clone, Copy, Debug)]
struct Found {
    t: f64,
    number: Option<u32>,
    weights: [f64; 3],
    /// Premultiplied, and the transmitted light.
    color: Vec4,
}

impl Found {
    const NONE: Self = Self { t: f64::INFINITY, number: None, weights: [0.0; 3], color: Vec4::W };
}

/// The progress of a tile's rays through the layers of meshes, and the colours so far.
pub(crate) struct MeshLayers {
    rays: [Ray; PIXELS],
    /// The picture in front: premultiplied colour and transmitted light.
    front: [Vec4; PIXELS],
    /// The previous layer; the next one is behind it.
    before: [(f64, u32); PIXELS],
    next: [Found; PIXELS],
}

impl MeshLayers {
    pub(crate) fn new(rays: &ViewRays, tile: &Tile) -> Box<Self> {
        // On the heap, to spare the threads' stacks. Places without a pixel have rays, too.
        let ray = |i: u32| rays.ray((tile.x0 + i % TILE_PX) as f64 + 0.5, (tile.y0 + i / TILE_PX) as f64 + 0.5);
        Box::new(Self {
            rays: std::array::from_fn(|i| ray(i as u32)),
            front: [Vec4::W; PIXELS],
            before: [(0.0, 0); PIXELS],
            next: [Found::NONE; PIXELS],
        })
    }

    /// Intersects a triangle with the rays that may meet it.
    fn meet(&mut self, view: &ViewRays, tile: &Tile, corners: [DVec3; 3], number: u32) {
        let Some(PixelRect { x0, x1, y0, y1 }) = pixels(view, *tile, corners) else { return };
        for y in y0..y1 {
            for x in x0..x1 {
                let i = place(tile, x, y);
                if self.front[i].w < FAINTEST {
                    continue;
                }
                let Some((t, weights)) = mesh::hit(corners, &self.rays[i]) else { continue };
                let next = &mut self.next[i];
                // Of two at one distance the first is in front.
                let is_behind = (t, number + 1) > self.before[i];
                if is_behind && (t, number) < (next.t, next.number.unwrap_or(u32::MAX)) {
                    *next = Found { t, number: Some(number), weights, color: Vec4::W };
                }
            }
        }
    }

    /// The distances bounding a ray's next slab: from the previous layer to the next one. Both are 0 if nearly no light
    /// is left.
    pub(crate) fn limits(&self, place: usize) -> [f64; 2] {
        if self.front[place].w < FAINTEST { [0.0; 2] } else { [self.before[place].0, self.next[place].t] }
    }

    /// Puts a ray's slab, and then the layer of meshes behind it, behind the picture in front. Returns whether more may
    /// be visible behind.
    pub(crate) fn compose(&mut self, place: usize, seen: Vec4) -> bool {
        let (front, next) = (&mut self.front[place], self.next[place]);
        for color in [seen, next.color] {
            *front = (*front + color * front.w).with_w(front.w * color.w);
        }
        match next.number {
            Some(number) => self.before[place] = (next.t, number + 1),
            // Nothing is behind the last slab.
            None => self.before[place] = (f64::INFINITY, u32::MAX),
        }
        next.number.is_some() && front.w >= FAINTEST
    }

    /// A ray's result: premultiplied colour and transmitted light.
    pub(crate) fn color(&self, place: usize) -> Vec4 {
        self.front[place]
    }
}
