//! Several volumes under one budget: their needs, their parts of a picture, and their shares.
//!
//! Shares are fixed once, from the known needs of each volume. Budgets stay hard: a volume's unused share is not lent to another.

use crate::draw_list::DrawList;
use crate::split::groups;
use brickyard_volume::{Needs, Pyramid, SlotEncoding, VolumeFrame};

/// Needs of one volume of a renderer.
#[derive(Clone, Copy, Debug)]
pub struct VolumeNeeds {
    /// Meaning of the slot codes.
    pub encoding: SlotEncoding,
    /// Voxels along a core's edge.
    pub edge: u32,
    /// Levels of the octree over the volume's bricks: see [`Pyramid::octree_levels`].
    pub levels: u32,
    /// Requirements of the pictures on the volume's bricks.
    pub bricks: Needs,
    /// Fewest slots with which the volume can be drawn.
    pub least_slots: u32,
    /// Most slots that the volume's bricks can fill.
    pub most_slots: u32,
}

impl VolumeNeeds {
    /// Whether bricks of `other` fit this volume's slots. If so, the two share one pool of slots for bricks of either.
    pub fn shares_slots_with(&self, other: &Self) -> bool {
        let slot = |needs: &Self| {
            let SlotEncoding { format, has_invalid, is_labels, .. } = needs.encoding;
            (format, has_invalid, is_labels, needs.edge, needs.bricks)
        };
        slot(self) == slot(other)
    }
}

/// Slot pool of each volume, numbered from 0 in the order of their first volumes.
pub fn pools(volumes: &[VolumeNeeds]) -> Vec<usize> {
    let groups = groups(volumes, VolumeNeeds::shares_slots_with);
    let pool = |volume| groups.iter().position(|members| members.contains(&volume));
    (0..volumes.len()).filter_map(pool).collect()
}

/// One volume's part of a picture, which need not show all volumes of its renderer.
#[derive(Clone, Copy, Debug)]
pub struct Layer<'a> {
    /// Index of the volume in its renderer; ascending over a picture's layers.
    pub volume: usize,
    /// Frame settings of the volume.
    pub frame: &'a VolumeFrame,
    /// Levels and brick grids of the volume.
    pub pyramid: &'a Pyramid,
    /// Bricks to draw.
    pub draw: &'a DrawList,
    /// Number of the cut behind `draw`. Layers with the same number share a cut and one order of [ranks](crate::DrawCell::rank).
    pub cut: u32,
}

/// Request for a number of equally sized items out of a byte budget.
#[derive(Clone, Copy, Debug)]
pub struct BudgetRequest {
    /// Bytes per item.
    pub bytes: u64,
    /// Fewest useful items.
    pub least: u64,
    /// Most useful items.
    pub most: u64,
}

/// Divides a budget: every request gets its least number of items, plus the same fraction of its remaining ones; all of them if there
/// is room.
///
/// # Errors
/// If the budget is below the sum of all least numbers; the error is the least sufficient budget in bytes.
pub fn share(budget_bytes: u64, requests: &[BudgetRequest]) -> Result<Vec<u64>, u64> {
    let least: u64 = requests.iter().map(|request| request.least * request.bytes).sum();
    let besides: u128 = requests
        .iter()
        .map(|request| (request.most.max(request.least) - request.least) as u128 * request.bytes as u128)
        .sum();
    let left = budget_bytes.checked_sub(least).ok_or(least)? as u128;
    let share = |request: &BudgetRequest| {
        let more = (request.most.max(request.least) - request.least) as u128;
        // Voxel counts that fit 64 bits cannot overflow a product of two such numbers.
        request.least + if left >= besides { more } else { more * left / besides } as u64
    };
    Ok(requests.iter().map(share).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everybody_gets_what_it_needs_and_nothing_is_overspent() {
        let requests = [
            BudgetRequest { bytes: 100, least: 1, most: 11 },
            BudgetRequest { bytes: 7, least: 2, most: 1000 },
            BudgetRequest { bytes: 30, least: 3, most: 3 },
        ];
        let least = 100 + 14 + 90;
        assert_eq!(share(least - 1, &requests), Err(least));
        assert_eq!(share(least, &requests), Ok(vec![1, 2, 3]));
        assert_eq!(share(1 << 40, &requests), Ok(vec![11, 1000, 3]));
        for budget in least..10_000 {
            let shares = share(budget, &requests).unwrap();
            let spent: u64 = shares.iter().zip(&requests).map(|(n, request)| n * request.bytes).sum();
            assert!(spent <= budget);
            // The remainder is less than one item of each, unless all have their most.
            assert!(budget - spent <= 137 || shares == [11, 1000, 3], "{budget}: {shares:?}");
        }
        // Half of everything beyond the least.
        assert_eq!(share(least + (1000 + 998 * 7) / 2, &requests), Ok(vec![6, 501, 3]));
    }
}
