//! A piece of a mesh that is to be decimated: some of its triangles, their vertices, and the points that they cover.

use glam::{DVec3, Vec3};
use std::collections::{BTreeMap, HashMap};

/// Points of removed vertices, each covered by the triangle nearest to it; those of a triangle follow one another, in the triangles' order.
#[derive(Clone, Debug, Default)]
pub(crate) struct Covered {
    /// Number of points of each triangle.
    pub(crate) counts: Vec<u32>,
    pub(crate) points: Vec<DVec3>,
}

/// Triangles and their vertices.
#[derive(Clone, Debug, Default)]
pub(crate) struct Piece {
    /// Names of the vertices in the whole mesh.
    pub(crate) ids: Vec<u64>,
    pub(crate) places: Vec<DVec3>,
    /// Whether a vertex must stay, since others than this piece's triangles may have it.
    pub(crate) is_fixed: Vec<bool>,
    /// Positions among the vertices.
    pub(crate) triangles: Vec<[u32; 3]>,
    pub(crate) covered: Covered,
}

/// Numbers of a piece's parts, which tell its length in bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Counts {
    pub(crate) vertices: u32,
    pub(crate) triangles: u32,
    pub(crate) points: u32,
}

const VERTEX_BYTES: usize = 32;
const TRIANGLE_BYTES: usize = 16;
const POINT_BYTES: usize = 12;

/// The bit of an id, on disk, of fixed vertices.
const FIXED: u64 = 1 << 63;

/// No vertex.
const NONE: u32 = u32::MAX;

impl Counts {
    pub(crate) fn bytes(self) -> usize {
        VERTEX_BYTES * self.vertices as usize
            + TRIANGLE_BYTES * self.triangles as usize
            + POINT_BYTES * self.points as usize
    }

    /// The work with the piece: its triangles and points.
    pub(crate) fn weight(self) -> u64 {
        u64::from(self.triangles) + u64::from(self.points)
    }
}

impl Piece {
    pub(crate) fn counts(&self) -> Counts {
        let [vertices, triangles, points] =
            [self.ids.len(), self.triangles.len(), self.covered.points.len()].map(|n| n as u32);
        Counts { vertices, triangles, points }
    }

    /// Bytes of memory.
    pub(crate) fn held_bytes(&self) -> u64 {
        let vertices = size_of::<u64>() * self.ids.capacity()
            + size_of::<DVec3>() * self.places.capacity()
            + size_of::<bool>() * self.is_fixed.capacity();
        let triangles = size_of::<[u32; 3]>() * self.triangles.capacity()
            + size_of::<u32>() * self.covered.counts.capacity()
            + size_of::<DVec3>() * self.covered.points.capacity();
        (vertices + triangles) as u64
    }

    /// Some triangles, ascending, with these points covered by each; and their vertices, in the same order.
    pub(crate) fn part(&self, triangles: impl Iterator<Item = (usize, Vec<DVec3>)>) -> Self {
        let mut part = Self::default();
        let mut is_used = vec![false; self.ids.len()];
        for (triangle, points) in triangles {
            let corners = self.triangles[triangle];
            corners.iter().for_each(|vertex| is_used[*vertex as usize] = true);
            part.triangles.push(corners);
            part.covered.counts.push(points.len() as u32);
            part.covered.points.extend(points);
        }
        let mut positions = vec![NONE; self.ids.len()];
        for vertex in (0..self.ids.len()).filter(|vertex| is_used[*vertex]) {
            positions[vertex] = part.ids.len() as u32;
            part.ids.push(self.ids[vertex]);
            part.places.push(self.places[vertex]);
            part.is_fixed.push(self.is_fixed[vertex]);
        }
        part.triangles.iter_mut().flatten().for_each(|vertex| *vertex = positions[*vertex as usize]);
        part
    }

    /// The parts by the cell of each triangle's middle, cells ascending.
    pub(crate) fn split(&self, cell: impl Fn(DVec3) -> u64) -> Vec<(u64, Self)> {
        let mut parts = BTreeMap::<u64, Vec<(usize, Vec<DVec3>)>>::new();
        let mut points = self.covered.points.iter().copied();
        for (triangle, (corners, count)) in self.triangles.iter().zip(&self.covered.counts).enumerate() {
            let [a, b, c] = corners.map(|vertex| self.places[vertex as usize]);
            // The sum of the last two is the same for the triangle turned round.
            let own = points.by_ref().take(*count as usize).collect();
            parts.entry(cell((a + (b + c)) / 3.0)).or_default().push((triangle, own));
        }
        parts.into_iter().map(|(cell, triangles)| (cell, self.part(triangles.into_iter()))).collect()
    }

    /// Joins pieces at the vertices that they share.
    pub(crate) fn join(pieces: &[Self]) -> Self {
        let mut whole = Self::default();
        let mut positions = HashMap::<u64, u32>::new();
        for piece in pieces {
            let place = |vertex: usize| {
                *positions.entry(piece.ids[vertex]).or_insert_with(|| {
                    whole.ids.push(piece.ids[vertex]);
                    whole.places.push(piece.places[vertex]);
                    whole.is_fixed.push(piece.is_fixed[vertex]);
                    whole.ids.len() as u32 - 1
                })
            };
            let vertices: Vec<u32> = (0..piece.ids.len()).map(place).collect();
            whole
                .triangles
                .extend(piece.triangles.iter().map(|corners| corners.map(|vertex| vertices[vertex as usize])));
            whole.covered.counts.extend(&piece.covered.counts);
            whole.covered.points.extend(&piece.covered.points);
        }
        whole
    }

    /// The piece as bytes. Points become 32-bit vectors from their triangle's first corner.
    pub(crate) fn encode(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(self.counts().bytes());
        for ((id, place), is_fixed) in self.ids.iter().zip(&self.places).zip(&self.is_fixed) {
            bytes.extend((id | if *is_fixed { FIXED } else { 0 }).to_le_bytes());
            place.to_array().iter().for_each(|part| bytes.extend(part.to_le_bytes()));
        }
        for (corners, count) in self.triangles.iter().zip(&self.covered.counts) {
            corners.iter().chain([count]).for_each(|word| bytes.extend(word.to_le_bytes()));
        }
        for (point, first) in self.covered.points.iter().zip(self.first_corners()) {
            (*point - first).as_vec3().to_array().iter().for_each(|part| bytes.extend(part.to_le_bytes()));
        }
        bytes
    }

    /// A piece from the bytes of [`encode`](Self::encode).
    pub(crate) fn decode(bytes: &[u8], counts: Counts) -> Self {
        let (vertices, rest) = bytes.split_at(VERTEX_BYTES * counts.vertices as usize);
        let (triangles, points) = rest.split_at(TRIANGLE_BYTES * counts.triangles as usize);
        let mut piece = Self::default();
        for vertex in vertices.chunks_exact(VERTEX_BYTES) {
            let part = |k: usize| u64::from_le_bytes(std::array::from_fn(|i| vertex[8 * k + i]));
            piece.ids.push(part(0) & !FIXED);
            piece.is_fixed.push(part(0) & FIXED > 0);
            piece.places.push(DVec3::from_array([1, 2, 3].map(|k| f64::from_bits(part(k)))));
        }
        for triangle in triangles.chunks_exact(TRIANGLE_BYTES) {
            let word = |k: usize| u32::from_le_bytes(std::array::from_fn(|i| triangle[4 * k + i]));
            piece.triangles.push([0, 1, 2].map(word));
            piece.covered.counts.push(word(3));
        }
        let first: Vec<DVec3> = piece.first_corners().collect();
        for (point, first) in points.chunks_exact(POINT_BYTES).zip(first) {
            let part = |k: usize| f32::from_le_bytes(std::array::from_fn(|i| point[4 * k + i]));
            piece.covered.points.push(first + Vec3::from_array([0, 1, 2].map(part)).as_dvec3());
        }
        piece
    }

    /// The first corner of each covered point's triangle.
    fn first_corners(&self) -> impl Iterator<Item = DVec3> {
        let each = self.triangles.iter().zip(&self.covered.counts);
        each.flat_map(|([first, ..], count)| std::iter::repeat_n(self.places[*first as usize], *count as usize))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_split_kept_as_bytes_and_joined() {
        // Two rows of a strip of triangles, with points above the first and the last one.
        let places = (0..10u32).map(|i| DVec3::new(f64::from(i / 2), f64::from(i % 2), 0.5)).collect();
        let triangles: Vec<[u32; 3]> =
            (0..8).map(|i| if i % 2 > 0 { [i + 1, i, i + 2] } else { [i, i + 1, i + 2] }).collect();
        let points = vec![DVec3::new(0.25, 0.25, 0.75), DVec3::new(3.75, 0.75, 0.25)];
        let covered = Covered { counts: vec![1, 0, 0, 0, 0, 0, 0, 1], points };
        let is_fixed = (0..10).map(|i| i % 3 == 0).collect();
        let piece = Piece { ids: (100..110).collect(), places, is_fixed, triangles, covered };
        let parts = piece.split(|middle| middle.x as u64 / 2);
        assert_eq!(
            parts.iter().map(|(cell, part)| (*cell, part.triangles.len())).collect::<Vec<_>>(),
            [(0, 4), (1, 4)]
        );
        assert_eq!(parts[1].1.ids, [104, 105, 106, 107, 108, 109]);
        let read: Vec<Piece> = parts.iter().map(|(_, part)| Piece::decode(&part.encode(), part.counts())).collect();
        let joined = Piece::join(&read);
        assert_eq!((joined.ids, joined.places, joined.is_fixed), (piece.ids, piece.places, piece.is_fixed));
        assert_eq!(joined.triangles, piece.triangles);
        assert_eq!((joined.covered.counts, joined.covered.points), (piece.covered.counts, piece.covered.points));
    }
}
