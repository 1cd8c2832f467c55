//! Places in grids of chunks, and in dense arrays of any number of axes, slowest first.

/// Bytes between neighbours of a dense array, the last axis fastest.
pub(crate) fn strides(shape: &[u64], element_bytes: usize) -> Vec<usize> {
    let mut strides = vec![element_bytes; shape.len()];
    for a in (1..shape.len()).rev() {
        strides[a - 1] = strides[a] * shape[a] as usize;
    }
    strides
}

/// The place of a number in a grid, the last axis fastest.
pub(crate) fn place_of(mut number: u64, grid: &[u64]) -> Vec<u64> {
    let mut place = vec![0; grid.len()];
    for a in (0..grid.len()).rev() {
        place[a] = number % grid[a];
        number /= grid[a];
    }
    place
}

/// Moves to the next place between `first` and `last`, the last axis fastest; false after the end.
pub(crate) fn step(place: &mut [u64], first: &[u64], last: &[u64]) -> bool {
    for a in (0..place.len()).rev() {
        if place[a] < last[a] {
            place[a] += 1;
            return true;
        }
        place[a] = first[a];
    }
    false
}
