//! Reference pictures (`--compositor reference`), the standard for streamed ones, from whole levels held in memory as
//! f64.

use crate::session::ResolvedScene;
use brickyard_pager::{BrickSource, Cut, View};
use brickyard_reference::{Array, ReferenceVolume};
use brickyard_store::{ReadError, Store};
use brickyard_volume::{BrickIndex, Extent, Level, Picture, Pyramid, VolumeFrame};
use glam::DVec3;
use std::collections::HashSet;
use std::time::{Duration, Instant};

/// Errors in rendering a reference picture.
#[derive(Debug, thiserror::Error)]
pub enum OracleError {
    /// Whole levels do not fit into the allowed memory.
    #[error(
        "the reference compositor holds whole levels in memory: it needs {needed} bytes, and {allowed} are allowed"
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
    /// The picture was not finished in time.
    #[error("the picture is not drawn after {waited_s:.1} s")]
    TooLong {
        /// Seconds waited.
        waited_s: f64,
    },
}

/// Renders a scene with the reference renderer, from the cuts on which streaming with unlimited memory would settle.
/// `stores` are those of the resolved scene.
///
/// # Errors
/// If the levels needed by all layers' views do not fit `host_memory_bytes` as f64, or cannot be read.
pub fn render_reference(
    stores: &[&Store],
    scene: &ResolvedScene,
    host_memory_bytes: u64,
) -> Result<Picture, OracleError> {
    render_reference_within(stores, scene, host_memory_bytes, Duration::MAX)
}

/// Renders a scene like [`render_reference`], and gives up after `max_wait`.
///
/// # Errors
/// The errors of [`render_reference`], and an error if the picture is not finished in time.
pub fn render_reference_within(
    stores: &[&Store],
    scene: &ResolvedScene,
    host_memory_bytes: u64,
    max_wait: Duration,
) -> Result<Picture, OracleError> {
    let begun = Instant::now();
    scene.supersampled(|sample| render_sample(stores, sample, host_memory_bytes, begun, max_wait))
}

fn render_sample(
    stores: &[&Store],
    scene: &ResolvedScene,
    host_memory_bytes: u64,
    begun: Instant,
    max_wait: Duration,
) -> Result<Picture, OracleError> {
    let views = || scene.layers.iter().map(|layer| (stores[layer.volume], &layer.view));
    let needed = views().map(|(store, view)| Wanted::new(store, view).bytes(store)).fold(0, u64::saturating_add);
    if needed > host_memory_bytes {
        return Err(OracleError::TooLarge { needed, allowed: host_memory_bytes });
    }
    let levels = views().map(|(store, view)| Levels::read(store, view)).collect::<Result<Vec<_>, _>>()?;
    let level_at: Vec<_> = levels.iter().map(|levels| |point: DVec3| levels.at(point)).collect();
    let mut volumes = Vec::new();
    for ((levels, level_at), layer) in levels.iter().zip(&level_at).zip(&scene.layers) {
        volumes.push(ReferenceVolume { levels: &levels.arrays, level_at, transfer: &layer.transfer });
    }
    scene.picture(|eye| {
        let frames: Vec<VolumeFrame> = scene.layers.iter().map(|layer| layer.frames[eye].clone()).collect();
        let goes_on = || begun.elapsed() < max_wait;
        let picture = brickyard_reference::render_while(&frames, &volumes, scene.combination.as_ref(), goes_on);
        picture.ok_or_else(|| OracleError::TooLong { waited_s: begun.elapsed().as_secs_f64() })
    })
}

/// The cells wanted by a view, and whether each level has any.
struct Wanted {
    cells: HashSet<(Level, BrickIndex)>,
    used: Vec<bool>,
}

impl Wanted {
    fn new(store: &Store, view: &View) -> Self {
        let cells: HashSet<_> = Cut::new(store, view, usize::MAX).cells().map(|c| (c.level, c.index)).collect();
        let levels = 0..BrickSource::pyramid(store).levels().len();
        let used = levels.map(|l| cells.iter().any(|c| c.0.index() == l)).collect();
        Self { cells, used }
    }

    /// Each level is held as stored bytes and as f64 during its conversion.
    fn bytes(&self, store: &Store) -> u64 {
        let levels = BrickSource::pyramid(store).levels().iter().zip(&self.used);
        let voxels = levels.filter(|(_, used)| **used).map(|(grid, _)| grid.extent.volume()).sum::<u64>();
        voxels.saturating_mul(8 + store.voxel_type().bytes() as u64)
    }
}

/// The levels wanted by a view, whole; others are empty.
struct Levels<'a> {
    pyramid: &'a Pyramid,
    wanted: Wanted,
    arrays: Vec<Array>,
}

impl<'a> Levels<'a> {
    fn read(store: &'a Store, view: &View) -> Result<Self, OracleError> {
        let (pyramid, wanted) = (BrickSource::pyramid(store), Wanted::new(store, view));
        let mut arrays = Vec::with_capacity(wanted.used.len());
        for (l, grid) in pyramid.levels().iter().enumerate() {
            if !wanted.used[l] {
                arrays.push(Array { extent: grid.extent, factor: grid.factor, values: Vec::new() });
                continue;
            }
            let mut bytes = vec![0; grid.extent.volume() as usize * store.voxel_type().bytes()];
            store.read_box(view.time, view.channel, Level(l as u8), grid.extent.full_box(), &mut bytes)?;
            arrays.push(Array::from_bytes(grid, store.voxel_type(), BrickSource::nodata(store), &bytes));
        }
        if !wanted.used.contains(&true) {
            // Nothing is wanted, so nothing is visible: one voxel without a value stands everywhere.
            arrays[0] = Array { extent: Extent::new(1, 1, 1), factor: arrays[0].factor, values: vec![f64::NAN] };
        }
        Ok(Self { pyramid, wanted, arrays })
    }

    /// The level at a point. Invisible or empty cells are not in the cut; finer levels show nothing there either.
    fn at(&self, point: DVec3) -> usize {
        let Wanted { cells, used } = &self.wanted;
        let cell_of = |l: usize| {
            let size = self.pyramid.levels()[l].factor.map(|f| (f * self.pyramid.edge()) as f64);
            let at = point.max(DVec3::ZERO).to_array();
            (Level(l as u8), BrickIndex::from_array(std::array::from_fn(|a| (at[a] / size[a]) as u32)))
        };
        let any = used.iter().position(|&u| u).unwrap_or(0);
        (0..used.len()).find(|&l| used[l] && cells.contains(&cell_of(l))).unwrap_or(any)
    }
}
