//! The voxels that each grid gives to the union, and those in no grid, counted from boxes alone. Costs a few operations for each pair of boxes that meet,
//! up to a limit.

use super::Grid;
use super::union::Union;
use crate::boxes::without;
use crate::error::{ImportError, Result};
use crate::note::Note;
use brickyard_volume::numbers::significant;
use brickyard_volume::{VoxelBox, are, counted};
use std::path::Path;

/// Most operations on boxes: a second's.
const MOST_OPERATIONS: u64 = 20_000_000;

/// Grids told one by one.
const MOST_TOLD: usize = 16;

/// Least part of the union in grids: less is a wrong place, or better packed grid by grid.
const LEAST_PART: f64 = 1e-4;

/// Part of the union in grids below which a warning tells it.
const SMALL_PART: f64 = 0.1;

/// Voxels of the union by their grids.
pub(super) struct Coverage {
    /// Voxels of each grid, as listed, but for its voxels without data; `None` if it meets too many others to be counted.
    shares: Vec<Option<u64>>,
    /// Voxels of all grids at most.
    covered: u64,
    total: u64,
}

impl Coverage {
    pub(super) fn of(union: &Union) -> Self {
        let total = union.info.extent.volume();
        let (mut shares, mut covered, mut operations) = (vec![None; union.placed.len()], 0u64, 0);
        for (rank, &grid) in union.order.iter().enumerate() {
            let own = union.placed[grid].region;
            let finer = union.order[..rank].iter().map(|other| union.placed[*other].region);
            let share = rest(own, finer, &mut operations);
            shares[grid] = share;
            covered = covered.saturating_add(share.unwrap_or_else(|| own.extent().volume()));
        }
        Self { shares, covered: covered.min(total), total }
    }

    /// Whether some voxel may be in no grid.
    pub(super) fn may_leave_voxels(&self) -> bool {
        self.covered < self.total || self.shares.contains(&None)
    }

    /// Voxels in no grid, at least.
    pub(super) fn left(&self) -> u64 {
        self.total - self.covered
    }

    /// Refuses a union that is nearly empty.
    pub(super) fn check(&self, union: &Union, list: &Path) -> Result<()> {
        if self.part(self.covered) >= LEAST_PART {
            return Ok(());
        }
        let problem = format!(
            "its grids fill {} of the {} voxels of their common box, {}: correct the spacing, origin or unit of one of them, or \
             pack each by itself and show them in one scene",
            self.covered,
            union.info.extent,
            self.percent(self.covered)
        );
        Err(ImportError::options(list, problem))
    }

    /// Remarks on each grid, and on the voxels in none.
    pub(super) fn notes(&self, grids: &[Grid], union: &Union) -> Vec<Note> {
        let mut notes: Vec<Note> = (0..grids.len().min(MOST_TOLD)).map(|i| self.note(i, &grids[i], union)).collect();
        if let Some(others) = grids.len().checked_sub(MOST_TOLD).filter(|others| *others > 0) {
            let others = others as u64;
            notes.push(Note::new(format!(
                "{} {} read, not listed here.",
                counted(others, "further grid"),
                are(others)
            )));
        }
        if self.left() > 0 {
            let (voxels, percent) = (counted(self.left(), "voxel"), self.percent(self.left()));
            let at_least = if self.shares.contains(&None) { "At least " } else { "" };
            let text = format!("{at_least}{voxels} of the result ({percent}) lie in no grid: no data.");
            let is_small = self.part(self.covered) < SMALL_PART;
            notes.push(if is_small { Note::warning(text) } else { Note::new(text) });
        }
        notes
    }

    fn note(&self, i: usize, grid: &Grid, union: &Union) -> Note {
        let info = grid.source.info();
        let [x, y, z] = info.geometry.spacing.to_array().map(|length| significant(length, 6));
        let unit = info.geometry.units_in_words().map_or(String::new(), |unit| format!(" {unit}"));
        let given = match self.shares[i] {
            Some(0) => "no voxel of the result, where finer grids or those listed before have data".into(),
            Some(share) => format!("{} of the result ({})", counted(share, "voxel"), self.percent(share)),
            None => format!("at most {} of the result", counted(union.placed[i].region.extent().volume(), "voxel")),
        };
        let (name, extent) = (&grid.name, info.extent);
        Note::new(format!("Grid {name}, {extent} voxels of {x},{y},{z}{unit}, gives {given}."))
    }

    fn part(&self, voxels: u64) -> f64 {
        voxels as f64 / self.total as f64
    }

    fn percent(&self, voxels: u64) -> String {
        format!("{} %", significant(100.0 * self.part(voxels), 3))
    }
}

/// The voxels of a box outside others; `None` if there are too many to be counted.
fn rest(whole: VoxelBox, others: impl Iterator<Item = VoxelBox>, operations: &mut u64) -> Option<u64> {
    let mut left = vec![whole];
    for other in others {
        *operations += 1;
        if whole.intersect(other).is_empty() {
            continue;
        }
        *operations += left.len() as u64;
        if *operations > MOST_OPERATIONS {
            return None;
        }
        left = left.into_iter().flat_map(|part| without(part, other)).collect();
    }
    Some(left.iter().map(|part| part.extent().volume()).sum())
}
