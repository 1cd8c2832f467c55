//! Fewer triangles for a piece of a mesh: edges collapse into one of their ends (half-edge collapses by quadric errors, after Garland and Heckbert 1997).
//!
//! Each removed vertex stays as a *covered* point of the nearest triangle, and no collapse takes a covered point further than the tolerance from its
//! triangle: a bound, whatever the order. Vertices at the piece's border never move or vanish, and no new edge joins two of them, so pieces fit together
//! without knowing each other. Costs some 7 µs for each removed vertex.
//!
//! Labels turn triangles round. All sums and ties are independent of that, so both neighbours get the same common border.

use crate::piece::{Covered, Piece};
use glam::{DMat3, DVec3};
use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;

/// Least cosine between a triangle's normals before and after a collapse.
const LEAST_TURN: f64 = 0.3;

/// Least cosine between the normals of neighbours, unless they were folded more before.
const LEAST_FOLD: f64 = -0.3;

/// Least quality of a new triangle, unless one had less before: 1 of an equilateral one, 0 of a line.
const LEAST_QUALITY: f64 = 0.05;

/// Weight of an edge's length among errors, so that even surfaces are thinned out evenly.
const LENGTH_WEIGHT: f64 = 1e-4;

/// Most triangles around a vertex.
const MOST_AROUND: usize = 32;

/// No covered point.
const NONE: u32 = u32::MAX;

/// Collapses the edges of a piece, as long as no removed vertex is further than `tolerance` from it.
pub(crate) fn collapse(piece: Piece, tolerance: f64) -> Piece {
    let mut work = Work::new(piece, tolerance);
    for vertex in 0..work.stars.len() as u32 {
        work.queue(vertex, None);
    }
    while let Some(Reverse(entry)) = work.heap.pop() {
        if entry.stamp != work.stamps[entry.vertex as usize] {
            continue;
        }
        match work.checked(entry.vertex, entry.target.vertex) {
            Some(collapse) => work.apply(collapse),
            None => work.queue(entry.vertex, Some(entry.target)),
        }
    }
    work.finish()
}

/// A vertex in the queue.
#[derive(Clone, Copy, Debug)]
struct Entry {
    vertex: u32,
    /// The vertex's stamp at that time; others are outdated.
    stamp: u32,
    target: Target,
}

impl PartialEq for Entry {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Entry {}

impl PartialOrd for Entry {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Entry {
    fn cmp(&self, other: &Self) -> Ordering {
        self.target.error.total_cmp(&other.target.error).then(self.vertex.cmp(&other.vertex))
    }
}

/// A neighbour to collapse into.
#[derive(Clone, Copy, Debug)]
struct Target {
    error: f64,
    vertex: u32,
}

/// A collapse that has passed all checks.
struct Collapse {
    from: u32,
    to: u32,
    /// The neighbours of `from`, in a circle.
    ring: Vec<u32>,
    /// Triangles that stay, with their corners then.
    kept: Vec<(u32, [u32; 3])>,
    /// Covered points, and the position among `kept` of the triangle that covers each.
    covered: Vec<(u32, usize)>,
    /// The triangle to cover `from`.
    covers_from: usize,
}

struct Work {
    piece: Piece,
    tolerance: f64,
    /// Triangles around each vertex.
    stars: Vec<Vec<u32>>,
    stamps: Vec<u32>,
    heap: BinaryHeap<Reverse<Entry>>,
    /// The first covered point of each triangle, and the one after each.
    first: Vec<u32>,
    points: Vec<DVec3>,
    next: Vec<u32>,
}

impl Work {
    fn new(mut piece: Piece, tolerance: f64) -> Self {
        let mut stars = vec![Vec::new(); piece.places.len()];
        for (i, triangle) in piece.triangles.iter().enumerate() {
            triangle.iter().for_each(|vertex| stars[*vertex as usize].push(i as u32));
        }
        let Covered { counts, points } = std::mem::take(&mut piece.covered);
        let (mut first, mut next, mut at) = (vec![NONE; piece.triangles.len()], vec![NONE; points.len()], 0);
        for (first, count) in first.iter_mut().zip(counts) {
            for _ in 0..count {
                next[at as usize] = std::mem::replace(first, at);
                at += 1;
            }
        }
        let stamps = vec![0; stars.len()];
        let mut work = Self { piece, tolerance, stars, stamps, heap: BinaryHeap::new(), first, points, next };
        work.fix_border();
        work
    }

    /// Fixes the ends of edges without exactly two triangles, and vertices whose triangles are not one circle.
    fn fix_border(&mut self) {
        let mut edges: Vec<[u32; 2]> = Vec::with_capacity(3 * self.piece.triangles.len());
        for &[a, b, c] in &self.piece.triangles {
            edges.extend([[a, b], [b, c], [c, a]].map(|[a, b]| [a.min(b), a.max(b)]));
        }
        edges.sort_unstable();
        for uses in edges.chunk_by(|a, b| a == b).filter(|uses| uses.len() != 2) {
            uses[0].iter().for_each(|vertex| self.piece.is_fixed[*vertex as usize] = true);
        }
        for vertex in 0..self.stars.len() as u32 {
            if !self.is_fixed(vertex) && self.ring(vertex).is_none() {
                self.piece.is_fixed[vertex as usize] = true;
            }
        }
    }

    fn is_fixed(&self, vertex: u32) -> bool {
        self.piece.is_fixed[vertex as usize]
    }

    fn star(&self, vertex: u32) -> &[u32] {
        &self.stars[vertex as usize]
    }

    fn corners(&self, triangle: u32) -> [u32; 3] {
        self.piece.triangles[triangle as usize]
    }

    fn place(&self, vertex: u32) -> DVec3 {
        self.piece.places[vertex as usize]
    }

    /// Twice the triangle's area, along its normal.
    fn normal(&self, corners: [u32; 3]) -> DVec3 {
        let [a, b, c] = corners.map(|vertex| self.place(vertex));
        (b - a).cross(c - a)
    }

    /// The other two corners of a triangle around a vertex.
    fn sides(&self, triangle: u32, vertex: u32) -> [u32; 2] {
        let [a, b, c] = self.corners(triangle);
        if a == vertex {
            [b, c]
        } else if b == vertex {
            [c, a]
        } else {
            [a, b]
        }
    }

    /// The neighbours of a vertex in a circle; `None` unless its triangles are a single one.
    fn ring(&self, vertex: u32) -> Option<Vec<u32>> {
        let star = self.star(vertex);
        let side = |triangle: &u32| self.sides(*triangle, vertex);
        let first = side(star.first()?);
        let mut ring = vec![first[0]];
        let mut at = first[1];
        while at != first[0] {
            if ring.len() == star.len() {
                return None;
            }
            ring.push(at);
            at = star.iter().map(side).find(|[from, _]| *from == at)?[1];
        }
        (ring.len() == star.len() && ring.len() >= 3).then_some(ring)
    }

    /// The neighbour with the least error, of those after `last`: the sum of squared distances from the planes around the vertex, by area.
    fn target(&self, vertex: u32, last: Option<Target>) -> Option<Target> {
        let place = self.place(vertex);
        let mut planes = DMat3::ZERO;
        for normal in self.star(vertex).iter().map(|t| self.normal(self.corners(*t))) {
            let length = normal.length();
            if length > 0.0 {
                let scaled = normal / length;
                planes += DMat3::from_cols(normal * scaled.x, normal * scaled.y, normal * scaled.z);
            }
        }
        let order = |a: &Target, b: &Target| {
            a.error.total_cmp(&b.error).then_with(|| ordered(self.place(a.vertex), self.place(b.vertex)))
        };
        // Around a vertex that is not fixed, each neighbour follows it in one triangle.
        let others = self.star(vertex).iter().map(|triangle| self.sides(*triangle, vertex)[0]);
        let targets = others.map(|other| {
            let way = self.place(other) - place;
            let error = way.dot(planes * way) + LENGTH_WEIGHT * way.length_squared().powi(2);
            Target { error, vertex: other }
        });
        targets.filter(|target| last.is_none_or(|last| order(target, &last).is_gt())).min_by(order)
    }

    /// Queues a vertex for the best neighbour after `last`.
    fn queue(&mut self, vertex: u32, last: Option<Target>) {
        if self.is_fixed(vertex) || self.star(vertex).is_empty() {
            return;
        }
        if let Some(target) = self.target(vertex, last) {
            let stamp = self.stamps[vertex as usize];
            self.heap.push(Reverse(Entry { vertex, stamp, target }));
        }
    }

    /// A collapse, if the mesh stays closed, without folds and within the tolerance.
    fn checked(&self, from: u32, to: u32) -> Option<Collapse> {
        let ring = self.ring(from)?;
        let n = ring.len();
        let at = ring.iter().position(|vertex| *vertex == to)?;
        let [before, after] = [ring[(at + n - 1) % n], ring[(at + 1) % n]];
        let is_beside = |vertex: u32| vertex == to || vertex == before || vertex == after;
        // The link condition: else an edge would get four triangles.
        let around = self.star(to).iter().flat_map(|t| self.corners(*t)).filter(|vertex| *vertex != from);
        if around.clone().any(|vertex| !is_beside(vertex) && ring.contains(&vertex)) {
            return None;
        }
        if self.is_fixed(to) {
            // Another piece may have such an edge, too.
            if ring.iter().any(|vertex| !is_beside(*vertex) && self.is_fixed(*vertex)) {
                return None;
            }
        } else if self.star(to).len() + n - 4 > MOST_AROUND {
            return None;
        }
        if n == 3 {
            // A triangle that may be there, or in another piece: a tetrahedron stays one.
            let is_same = |t: &u32| {
                let corners = self.corners(*t);
                corners.contains(&before) && corners.contains(&after)
            };
            if self.star(to).iter().any(is_same) || [to, before, after].iter().all(|vertex| self.is_fixed(*vertex)) {
                return None;
            }
        }
        let stays = |t: &&u32| !self.corners(**t).contains(&to);
        let moved = |t: &u32| (*t, self.corners(*t).map(|vertex| if vertex == from { to } else { vertex }));
        let kept: Vec<(u32, [u32; 3])> = self.star(from).iter().filter(stays).map(moved).collect();
        if !self.keeps_shape(from, &kept) {
            return None;
        }
        let (covered, covers_from) = self.cover(from, &kept)?;
        Some(Collapse { from, to, ring, kept, covered, covers_from })
    }

    /// Whether no triangle turns round, folds onto a neighbour, or becomes a sliver.
    fn keeps_shape(&self, from: u32, kept: &[(u32, [u32; 3])]) -> bool {
        let quality = |corners: [u32; 3]| {
            let [a, b, c] = corners.map(|vertex| self.place(vertex));
            let sides = a.distance_squared(b) + b.distance_squared(c) + c.distance_squared(a);
            2.0 * 3f64.sqrt() * (b - a).cross(c - a).length() / sides
        };
        let worst = self.star(from).iter().map(|t| quality(self.corners(*t))).fold(LEAST_QUALITY, f64::min);
        let mut normals = Vec::with_capacity(kept.len());
        for (triangle, corners) in kept {
            let normal = self.normal(*corners).normalize_or_zero();
            let old = self.normal(self.corners(*triangle)).normalize_or_zero();
            // Not a number fails, too.
            let is_good = normal.dot(old) >= LEAST_TURN && quality(*corners) >= worst;
            if !is_good {
                return false;
            }
            normals.push(normal);
        }
        let found = self.sharpest(from, kept, &normals);
        if found >= LEAST_FOLD {
            return true;
        }
        let old: Vec<(u32, [u32; 3])> = self.star(from).iter().map(|t| (*t, self.corners(*t))).collect();
        let normals: Vec<DVec3> = old.iter().map(|(_, corners)| self.normal(*corners).normalize_or_zero()).collect();
        found >= self.sharpest(from, &old, &normals)
    }

    /// The least cosine between normals across an edge of these triangles, which stand for those around `from`. Edges between fixed vertices do not
    /// count: there another piece or another label begins.
    fn sharpest(&self, from: u32, triangles: &[(u32, [u32; 3])], normals: &[DVec3]) -> f64 {
        let mut least = 1.0f64;
        for (i, (_, corners)) in triangles.iter().enumerate() {
            for k in 0..3 {
                let [a, b] = [corners[k], corners[(k + 1) % 3]];
                if self.is_fixed(a) && self.is_fixed(b) {
                    continue;
                }
                let has_both = |corners: &[u32; 3]| corners.contains(&a) && corners.contains(&b);
                let among = triangles.iter().enumerate().find(|(j, (_, corners))| *j != i && has_both(corners));
                let beyond = || {
                    let outer = self.star(a).iter().map(|t| self.corners(*t));
                    let mut outer = outer.filter(|corners| has_both(corners) && !corners.contains(&from));
                    outer.next().map(|corners| self.normal(corners).normalize_or_zero())
                };
                if let Some(other) = among.map(|(j, _)| normals[j]).or_else(beyond) {
                    least = least.min(normals[i].dot(other));
                }
            }
        }
        least
    }

    /// The triangles nearest to the points covered so far, and to `from`; `None` if one is too far.
    fn cover(&self, from: u32, kept: &[(u32, [u32; 3])]) -> Option<(Vec<(u32, usize)>, usize)> {
        let corners: Vec<[DVec3; 3]> =
            kept.iter().map(|(_, corners)| either_way(corners.map(|vertex| self.place(vertex)))).collect();
        let limit = self.tolerance * self.tolerance;
        let nearest = |point: DVec3| {
            let mut best = (f64::INFINITY, 0);
            for (i, corners) in corners.iter().enumerate() {
                let squared = squared_distance(point, *corners);
                if squared < best.0 {
                    best = (squared, i);
                }
            }
            (best.0 <= limit).then_some(best.1)
        };
        let covers_from = nearest(self.place(from))?;
        let mut covered = Vec::new();
        for triangle in self.star(from) {
            let mut point = self.first[*triangle as usize];
            while point != NONE {
                covered.push((point, nearest(self.points[point as usize])?));
                point = self.next[point as usize];
            }
        }
        Some((covered, covers_from))
    }

    fn apply(&mut self, collapse: Collapse) {
        let Collapse { from, to, ring, kept, covered, covers_from } = collapse;
        let star = std::mem::take(&mut self.stars[from as usize]);
        for triangle in star {
            self.first[triangle as usize] = NONE;
            if self.corners(triangle).contains(&to) {
                for vertex in self.corners(triangle) {
                    self.stars[vertex as usize].retain(|t| *t != triangle);
                }
            }
        }
        for (triangle, corners) in &kept {
            self.piece.triangles[*triangle as usize] = *corners;
            self.stars[to as usize].push(*triangle);
        }
        let removed = self.points.len() as u32;
        self.points.push(self.place(from));
        self.next.push(NONE);
        for (point, at) in covered.into_iter().chain([(removed, covers_from)]) {
            let first = &mut self.first[kept[at].0 as usize];
            self.next[point as usize] = std::mem::replace(first, point);
        }
        for vertex in ring {
            self.stamps[vertex as usize] = self.stamps[vertex as usize].wrapping_add(1);
            self.queue(vertex, None);
        }
    }

    /// The piece without what has gone.
    fn finish(self) -> Piece {
        let Self { piece, stars, first, points, next, .. } = self;
        let mut triangles = vec![false; piece.triangles.len()];
        stars.iter().flatten().for_each(|triangle| triangles[*triangle as usize] = true);
        let covered = |triangle: usize| {
            let some = |point: u32| (point != NONE).then_some(point);
            let chain = std::iter::successors(some(first[triangle]), |point| some(next[*point as usize]));
            chain.map(|point| points[point as usize]).collect()
        };
        let triangles = (0..triangles.len()).filter(|triangle| triangles[*triangle]);
        piece.part(triangles.map(|triangle| (triangle, covered(triangle))))
    }
}

/// Places in an order, for ties.
fn ordered(a: DVec3, b: DVec3) -> Ordering {
    let by_axis = a.to_array().into_iter().zip(b.to_array()).map(|(a, b)| a.total_cmp(&b));
    by_axis.fold(Ordering::Equal, Ordering::then)
}

/// The corners of a triangle, in the same order for the triangle turned round.
fn either_way([a, b, c]: [DVec3; 3]) -> [DVec3; 3] {
    if ordered(b, c).is_gt() { [a, c, b] } else { [a, b, c] }
}

/// The squared distance of a point from a triangle (Ericson, 2005).
fn squared_distance(point: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let (ab, ac, ap) = (b - a, c - a, point - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return ap.length_squared();
    }
    let bp = point - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return bp.length_squared();
    }
    let of_c = d1 * d4 - d3 * d2;
    if of_c <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return (ap - ab * (d1 / (d1 - d3))).length_squared();
    }
    let cp = point - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return cp.length_squared();
    }
    let of_b = d5 * d2 - d1 * d6;
    if of_b <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return (ap - ac * (d2 / (d2 - d6))).length_squared();
    }
    let of_a = d3 * d6 - d5 * d4;
    if of_a <= 0.0 && d4 >= d3 && d5 >= d6 {
        let share = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return (bp - (c - b) * share).length_squared();
    }
    let sum = of_a + of_b + of_c;
    (ap - ab * (of_b / sum) - ac * (of_c / sum)).length_squared()
}
