//! Threads and kept bricks within a budget of memory. The worst block is counted, in which every edge is crossed.

use crate::decimation::MOST_WEIGHT;
use crate::error::MeshError;
use crate::format::BUFFER_BYTES;
use crate::number_table::TABLE_BYTES;
use crate::patch::PatchVertex;
use crate::request::{MeshRequest, MeshSurface};
use crate::smoothing::reach_cells;
use brickyard_store::Store;

/// The program, its stacks and its allocator.
const PROGRAM_BYTES: u64 = 24 << 20;

/// Greatest patches in memory, for each thread: one at work, and others waiting to be written.
const PATCHES_PER_THREAD: u64 = 2;

/// Voxels along the edge of a block and its borders, without smoothing.
const BLOCK_POINTS: u64 = 34;

/// A label and its box, as found and as a target.
const LABEL_BYTES: u64 = 256;

/// The part of spare memory for the list of pieces, and the least of it.
const LIST_SHARE: u64 = 16;
const LEAST_LIST_BYTES: u64 = 8 << 20;

/// Shares of the memory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Budget {
    pub(crate) threads: usize,
    pub(crate) bricks: usize,
    /// For the list of pieces, in bytes.
    pub(crate) list_bytes: u64,
    /// For patches waiting to be written, and their pieces.
    pub(crate) waiting_bytes: u64,
}

impl Budget {
    /// Threads, as many as the memory allows, then bricks in what is left.
    ///
    /// # Errors
    /// If the memory is too little for one thread.
    pub(crate) fn of(store: &Store, request: &MeshRequest) -> Result<Self, MeshError> {
        let core = store.core_bytes() as u64;
        let labels = match request.surface {
            MeshSurface::Labels => LABEL_BYTES * crate::request::MOST_LABELS as u64,
            _ => 0,
        };
        let is_decimated = request.decimation_voxels.is_some();
        let least_list_bytes = if is_decimated { LEAST_LIST_BYTES } else { 0 };
        let table_bytes = if is_decimated { TABLE_BYTES } else { 0 };
        let fixed_bytes = PROGRAM_BYTES + store.cache_bytes() + labels + 4 * BUFFER_BYTES as u64 + table_bytes;
        // A brick being decoded: encoded, shuffled and decoded; and one that others keep from being dropped.
        let patches = PATCHES_PER_THREAD * patch_bytes(request);
        let decimation = if is_decimated { decimation_bytes(request) } else { 0 };
        let thread = working_bytes(store, request) + patches + decimation + 4 * core;
        let least = fixed_bytes + least_list_bytes + thread + core;
        if request.memory_bytes < least {
            return Err(MeshError::Memory { needed_bytes: least, given_bytes: request.memory_bytes });
        }
        let spare_bytes = if is_decimated { (request.memory_bytes - least) / LIST_SHARE } else { 0 };
        let list_bytes = least_list_bytes + spare_bytes;
        let room = request.memory_bytes - fixed_bytes - list_bytes;
        let threads = (rayon::current_num_threads() as u64).min((room - core) / thread).max(1);
        let bricks = (room - threads * thread) / core;
        let pieces_bytes = if is_decimated { pieces_bytes(request) } else { 0 };
        let waiting_bytes = threads * (PATCHES_PER_THREAD - 1) * (patch_bytes(request) + pieces_bytes);
        Ok(Self { threads: threads as usize, bricks: bricks as usize, list_bytes, waiting_bytes })
    }
}

/// A growing vector takes up to twice its length.
const GROWTH: u64 = 2;

/// Vertices and triangles of a voxel, at most.
fn of_voxel(request: &MeshRequest) -> (u64, u64) {
    match request.surface {
        MeshSurface::Isosurface(_) => (3, 5),
        MeshSurface::Label(_) | MeshSurface::Labels => (4, 12),
    }
}

/// Bytes of a block's patch.
fn patch_bytes(request: &MeshRequest) -> u64 {
    let (vertices, triangles) = of_voxel(request);
    GROWTH * BLOCK_POINTS.pow(3) * (vertices * size_of::<PatchVertex>() as u64 + (12 + 8) * triangles)
}

/// Bytes of a piece at work, for each vertex and triangle: places, names, triangles around, and the queue; edges, corners, and covered points.
const VERTEX_WORK_BYTES: u64 = 256;
const TRIANGLE_WORK_BYTES: u64 = 64;

/// Bytes of a block's pieces.
fn pieces_bytes(request: &MeshRequest) -> u64 {
    let (vertices, triangles) = of_voxel(request);
    BLOCK_POINTS.pow(3) * (vertices * 33 + triangles * 16)
}

/// Bytes of a decimating thread: a block, whose pieces wait, or later the heaviest region; its triangles are twice its vertices.
fn decimation_bytes(request: &MeshRequest) -> u64 {
    let (vertices, triangles) = of_voxel(request);
    let points = BLOCK_POINTS.pow(3);
    let block = points * (vertices * VERTEX_WORK_BYTES + triangles * TRIANGLE_WORK_BYTES);
    let waiting = PATCHES_PER_THREAD * pieces_bytes(request);
    let region = MOST_WEIGHT * (VERTEX_WORK_BYTES / 2 + TRIANGLE_WORK_BYTES);
    (block + waiting).max(region)
}

/// Bytes of a thread at work on a block.
fn working_bytes(store: &Store, request: &MeshRequest) -> u64 {
    let voxel_bytes = store.voxel_type().bytes() as u64;
    match request.surface {
        MeshSurface::Isosurface(_) => {
            let points = (BLOCK_POINTS + 2 * reach_cells(request.smoothing) as u64).pow(3);
            // Values, numbers of vertices; places, classes and sums of vertices, and triangles.
            points * (voxel_bytes + 12 + GROWTH * (3 * (24 + 8 + 32) + 5 * 12 + 5 * 4))
        }
        MeshSurface::Label(_) | MeshSurface::Labels => {
            let points = (BLOCK_POINTS + 2 * u64::from(request.smoothing)).pow(3);
            let moved = if request.smoothing > 0 { 4 + GROWTH * (3 * 24 + 24 + 32) } else { 0 };
            // Values, labels, numbers of vertices, and their places.
            points * (voxel_bytes + 8 + 16 + moved)
        }
    }
}
