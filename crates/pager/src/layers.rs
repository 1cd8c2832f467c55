//! Several volumes under one budget: what each needs of a renderer, what each draws, and how they share.
//!
//! A share is decided once, by what is at hand of each volume. So budgets stay hard: what one volume does not use is not lent
//! to another.

use crate::draw_list::DrawList;
use brickyard_volume::{Needs, Pyramid, SlotEncoding, VolumeFrame};

/// What a renderer must provide for one of the volumes that it is made for.
#[derive(Clone, Copy, Debug)]
pub struct VolumeNeeds {
    /// How slot codes stand for values.
    pub encoding: SlotEncoding,
    /// Voxels along the edge of a brick's core.
    pub edge: u32,
    /// Levels of the octree over the volume's bricks: see [`Pyramid::octree_levels`].
    pub levels: u32,
    /// What the pictures need the volume's bricks to have.
    pub bricks: Needs,
    /// The fewest slots with which the volume can be drawn.
    pub least_slots: u32,
    /// The most slots that the volume's bricks could ever fill.
    pub most_slots: u32,
}

impl VolumeNeeds {
    /// Whether bricks of another volume fit this volume's slots. If so, the two volumes share one pool of slots, and each slot can hold a
    /// brick of either.
    pub fn shares_slots_with(&self, other: &Self) -> bool {
        let slot = |needs: &Self| {
            let SlotEncoding { format, has_invalid, is_labels, .. } = needs.encoding;
            (format, has_invalid, is_labels, needs.edge, needs.bricks)
        };
        slot(self) == slot(other)
    }
}

/// The number of each volume's pool of slots. Pools are numbered from 0, in the order of their first volumes.
pub fn pools(volumes: &[VolumeNeeds]) -> Vec<usize> {
    let mut firsts: Vec<&VolumeNeeds> = Vec::new();
    let mut pools = Vec::with_capacity(volumes.len());
    for needs in volumes {
        let known = firsts.iter().position(|first| needs.shares_slots_with(first));
        pools.push(known.unwrap_or(firsts.len()));
        if known.is_none() {
            firsts.push(needs);
        }
    }
    pools
}

/// One volume's part of a picture. A picture need not show all volumes of its renderer.
#[derive(Clone, Copy, Debug)]
pub struct Layer<'a> {
    /// The volume's index among those that the renderer was made for. A picture's layers come in ascending order of it.
    pub volume: usize,
    /// The frame's settings for the volume.
    pub frame: &'a VolumeFrame,
    /// The volume's levels and brick grids.
    pub pyramid: &'a Pyramid,
    /// The bricks that are drawn of the volume.
    pub draw: &'a DrawList,
    /// The number of the cut that `draw` was made from. Layers of the same number share a cut, so that their
    /// [ranks](crate::DrawCell::rank) are in one order.
    pub cut: u32,
}

/// A request for a number of items of one size out of a byte budget.
#[derive(Clone, Copy, Debug)]
pub struct BudgetRequest {
    /// Bytes of one item.
    pub bytes: u64,
    /// The fewest items that are of use.
    pub least: u64,
    /// The most items that are of use.
    pub most: u64,
}

/// How many items each request gets out of a budget: its least, and beyond that the same share of its other items for every request. If
/// the budget has room for everything, each request gets its most.
///
/// # Errors
/// If the budget is too small for the least of all requests together: the error is the least budget that works, in bytes.
pub fn share(budget_bytes: u64, requests: &[BudgetRequest]) -> Result<Vec<u64>, u64> {
    let least: u64 = requests.iter().map(|request| request.least * request.bytes).sum();
    let besides: u128 = requests
        .iter()
        .map(|request| (request.most.max(request.least) - request.least) as u128 * request.bytes as u128)
        .sum();
    let left = budget_bytes.checked_sub(least).ok_or(least)? as u128;
    let share = |request: &BudgetRequest| {
        let more = (request.most.max(request.least) - request.least) as u128;
        // No number of voxels that fits 64 bits makes a product of two such overflow.
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
            // What is left over is a part of one of each, or everybody has all.
            assert!(budget - spent <= 137 || shares == [11, 1000, 3], "{budget}: {shares:?}");
        }
        // Half of what is wanted besides the least.
        assert_eq!(share(least + (1000 + 998 * 7) / 2, &requests), Ok(vec![6, 501, 3]));
    }
}
