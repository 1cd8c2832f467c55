//! Triangles of a cell by the sides of its eight corners: marching cubes (Lorensen and Cline, 1987) with one rule for ambiguous faces.
//!
//! The table is made, not written down. Each face connects crossed edges so that its corners inside are cut off one by one: a rule by the face alone,
//! the same from both of its cells, so no holes arise. Connections close to loops, and loops are split into triangles without a diagonal in a face
//! of the cell, which the neighbour might have too: every edge then has exactly two triangles.

use std::sync::LazyLock;

/// Corner `i` of a cell is at its far end of x, y, z where bits 0, 1, 2 are set.
pub(crate) type Corner = u8;

/// An edge of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Edge {
    /// The corner of lower coordinates.
    pub(crate) corner: Corner,
    /// The axis along which it runs.
    pub(crate) axis: u8,
}

/// Triangles by the corners inside, as a mask; vertices are on edges of [`edges`].
pub(crate) static TRIANGLES: LazyLock<Vec<Vec<[u8; 3]>>> = LazyLock::new(|| (0..=255).map(triangles).collect());

/// The twelve edges of a cell.
pub(crate) fn edges() -> [Edge; 12] {
    let mut edges = [Edge { corner: 0, axis: 0 }; 12];
    let all = (0..3u8).flat_map(|axis| (0..8u8).filter(move |c| c >> axis & 1 == 0).map(move |corner| (corner, axis)));
    for (edge, (corner, axis)) in edges.iter_mut().zip(all) {
        *edge = Edge { corner, axis };
    }
    edges
}

/// The edge between two corners.
fn edge_between(a: Corner, b: Corner) -> u8 {
    let wanted = Edge { corner: a.min(b), axis: (a ^ b).trailing_zeros() as u8 };
    edges().iter().position(|edge| *edge == wanted).unwrap_or_default() as u8
}

/// The corners of the six faces, anticlockwise from outside of the cell.
fn faces() -> [[Corner; 4]; 6] {
    std::array::from_fn(|i| {
        let (axis, side) = (i / 2, (i % 2) as u8);
        let (u, v) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
        let mut corners = [0, u, u | v, v].map(|corner| corner | side << axis);
        if side == 0 {
            corners.reverse();
        }
        corners
    })
}

/// Whether two edges are in one face.
fn share_face(a: u8, b: u8) -> bool {
    let is_in = |face: &[Corner; 4], edge: u8| (0..4).any(|k| edge_between(face[k], face[(k + 1) % 4]) == edge);
    faces().iter().any(|face| is_in(face, a) && is_in(face, b))
}

/// The loops of crossed edges around the corners inside.
fn loops(inside: u8) -> Vec<Vec<u8>> {
    let is_inside = |corner: Corner| inside >> corner & 1 > 0;
    let mut next = [None; 12];
    for face in faces() {
        for k in (0..4).filter(|&k| !is_inside(face[k]) && is_inside(face[(k + 1) % 4])) {
            // The run of corners inside, from its first to its last one.
            let last = (k + 1..k + 4).take_while(|j| is_inside(face[j % 4])).last().unwrap_or(k + 1);
            let [enters, leaves] = [k, last].map(|j| edge_between(face[j % 4], face[(j + 1) % 4]));
            next[usize::from(enters)] = Some(leaves);
        }
    }
    let mut found = Vec::new();
    for first in 0..12 {
        let mut around = Vec::new();
        let mut at = first;
        while let Some(following) = next[usize::from(at)].take() {
            around.push(at);
            at = following;
        }
        if !around.is_empty() {
            found.push(around);
        }
    }
    found
}

fn triangles(inside: u8) -> Vec<[u8; 3]> {
    let split = |around: Vec<u8>| split(&around).unwrap_or_default();
    loops(inside).into_iter().flat_map(split).collect()
}

/// Splits a loop, from its first to its last vertex, without diagonals in a face; `None` if there is no such way.
fn split(around: &[u8]) -> Option<Vec<[u8; 3]>> {
    let [first, between @ .., last] = around else { return None };
    if between.is_empty() {
        return Some(Vec::new());
    }
    (1..=between.len()).find_map(|k| {
        let is_side = |from: usize, to: usize| to - from == 1;
        let is_free = |from: usize, to: usize| is_side(from, to) || !share_face(around[from], around[to]);
        if !is_free(0, k) || !is_free(k, around.len() - 1) {
            return None;
        }
        let mut all = split(&around[..=k])?;
        all.extend(split(&around[k..])?);
        all.push([*first, around[k], *last]);
        Some(all)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use std::collections::HashMap;

    fn place(edge: u8) -> DVec3 {
        let Edge { corner, axis } = edges()[usize::from(edge)];
        let at = |a: u8| f64::from(corner >> a & 1) + if a == axis { 0.5 } else { 0.0 };
        DVec3::new(at(0), at(1), at(2))
    }

    #[test]
    fn every_case_is_split_and_no_diagonal_is_in_a_face() {
        for inside in 0..=255u8 {
            let around = loops(inside);
            let expected: usize = around.iter().map(|around| around.len() - 2).sum();
            let found = &TRIANGLES[usize::from(inside)];
            assert!(found.len() == expected && expected <= 5, "{inside:08b}");
            let mut uses = HashMap::<[u8; 2], i32>::new();
            for [a, b, c] in found {
                for [from, to] in [[*a, *b], [*b, *c], [*c, *a]] {
                    *uses.entry([from.min(to), from.max(to)]).or_default() += if from < to { 1 } else { -1 };
                }
            }
            for ([a, b], uses) in uses {
                // Sides of loops are used once, and diagonals in both directions.
                assert_eq!(uses.abs() == 1, share_face(a, b), "{inside:08b}: {a} to {b}");
            }
        }
    }

    #[test]
    fn triangles_face_away_from_corners_inside() {
        for corner in 0..8u8 {
            for (inside, sign) in [(1u8 << corner, 1.0), (!(1u8 << corner), -1.0)] {
                let [[a, b, c]] = TRIANGLES[usize::from(inside)].as_slice() else { panic!("one triangle") };
                let [a, b, c] = [*a, *b, *c].map(place);
                let at = DVec3::from_array([0, 1, 2].map(|axis: u8| f64::from(corner >> axis & 1)));
                assert!(sign * (b - a).cross(c - a).dot(a - at) > 0.0, "{inside:08b}");
            }
        }
    }
}
