//! Smoothing of isosurfaces by Taubin's filter (1995): each iteration shrinks and then grows, so that the volume stays about the same.
//!
//! Vertices move towards the mean of their neighbours. After a number of steps a vertex depends only on those within as many edges: a block with as
//! many cells around it gives its own vertices exactly, in every block alike, since each vertex sums its neighbours in the order of the cells.

use glam::DVec3;

/// Weights of the two steps: the pass band ends at 1 / LAMBDA + 1 / MU, about 0.1.
const LAMBDA: f64 = 0.5;
const MU: f64 = -0.53;

/// Cells around a block for this many iterations.
pub(crate) fn reach_cells(iterations: u32) -> i64 {
    2 * i64::from(iterations)
}

/// Smooths vertices of a closed mesh, whose edges have one triangle in each direction.
pub(crate) fn smooth(places: &mut [DVec3], triangles: &[[u32; 3]], iterations: u32) {
    let mut sums = vec![(DVec3::ZERO, 0u32); places.len()];
    for weight in (0..iterations).flat_map(|_| [LAMBDA, MU]) {
        sums.fill((DVec3::ZERO, 0));
        for &[a, b, c] in triangles {
            for [from, to] in [[a, b], [b, c], [c, a]] {
                let (sum, count) = &mut sums[from as usize];
                *sum += places[to as usize];
                *count += 1;
            }
        }
        for (place, (sum, count)) in places.iter_mut().zip(&sums).filter(|(_, (_, count))| *count > 0) {
            *place += weight * (*sum / f64::from(*count) - *place);
        }
    }
}
