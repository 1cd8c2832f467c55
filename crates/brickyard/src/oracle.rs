//! `--compositor reference`: the picture that streaming must equal, from whole levels held in memory as f64.

use crate::session::ResolvedScene;
use brickyard_pager::{BrickSource, Cut};
use brickyard_reference::{Array, ReferenceVolume};
use brickyard_store::{ReadError, Store};
use brickyard_volume::{BrickIndex, Level, Picture};
use glam::DVec3;
use std::collections::HashSet;

/// The reference picture could not be made.
#[derive(Debug, thiserror::Error)]
pub enum OracleError {
    /// Whole levels do not fit.
    #[error(
        "the reference compositor holds whole levels in memory: it needs {needed} bytes and --host-memory allows {allowed}; lock a coarser --level or allow more"
    )]
    TooLarge {
        /// Bytes needed.
        needed: u64,
        /// Bytes allowed.
        allowed: u64,
    },
    /// The store cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
}

/// Renders the scene from the same cut that streaming with unlimited memory would settle on.
///
/// # Errors
/// If the levels that the view needs do not fit `host_memory_bytes` as f64, or cannot be read.
pub fn render_reference(store: &Store, scene: &ResolvedScene, host_memory_bytes: u64) -> Result<Picture, OracleError> {
    let pyramid = BrickSource::pyramid(store);
    let cut = Cut::new(store, &scene.view, usize::MAX);
    let cells: HashSet<(Level, BrickIndex)> = cut.cells().map(|c| (c.level, c.index)).collect();
    let used: Vec<bool> = (0..pyramid.levels().len()).map(|l| cells.iter().any(|c| c.0.index() == l)).collect();
    let voxels = |l: usize| if used[l] { pyramid.levels()[l].extent.volume() } else { 0 };
    // Each level is held as stored bytes and as f64 while it is converted.
    let needed = (0..used.len()).map(voxels).sum::<u64>().saturating_mul(8 + store.voxel_type().bytes() as u64);
    if needed > host_memory_bytes {
        return Err(OracleError::TooLarge { needed, allowed: host_memory_bytes });
    }
    let mut levels = Vec::with_capacity(used.len());
    for (l, grid) in pyramid.levels().iter().enumerate() {
        if !used[l] {
            levels.push(Array { extent: grid.extent, factor: grid.factor, values: Vec::new() });
            continue;
        }
        let mut bytes = vec![0; grid.extent.volume() as usize * store.voxel_type().bytes()];
        store.read_box(scene.view.time, scene.view.channel, Level(l as u8), grid.extent.full_box(), &mut bytes)?;
        levels.push(Array::from_bytes(grid, store.voxel_type(), &bytes));
    }
    // Cells that are invisible or empty are not in the cut; nothing is seen there at any finer level either.
    let any = used.iter().position(|&u| u).unwrap_or(0);
    let level_at = |point: DVec3| {
        let cell_of = |l: usize| {
            let size = pyramid.levels()[l].factor.map(|f| (f * pyramid.edge()) as f64);
            let at = point.max(DVec3::ZERO).to_array();
            (Level(l as u8), BrickIndex::from_array(std::array::from_fn(|a| (at[a] / size[a]) as u32)))
        };
        (0..used.len()).find(|&l| used[l] && cells.contains(&cell_of(l))).unwrap_or(any)
    };
    let volume = ReferenceVolume { levels: &levels, level_at: &level_at, transfer: &scene.transfer };
    scene.picture(|_, frame| Ok(brickyard_reference::render(frame, &volume)))
}
