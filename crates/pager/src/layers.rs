//! Several volumes under one budget: what each needs of a renderer, what each draws, and how they share.
//!
//! A share is decided once, by what is at hand of each volume. So budgets stay hard: what one volume does not use is not lent
//! to another.

use crate::draw_list::DrawList;
use brickyard_volume::{Needs, Pyramid, SlotEncoding, VolumeFrame};

/// What a renderer of several volumes is made for, volume by volume.
#[derive(Clone, Copy, Debug)]
pub struct VolumeNeeds {
    /// How slot codes stand for values.
    pub encoding: SlotEncoding,
    /// Voxels along a brick's core edge.
    pub edge: u32,
    /// Levels of the octree over its bricks: see [`Pyramid::octree_levels`].
    pub levels: u32,
    /// What the pictures need of bricks.
    pub bricks: Needs,
    /// Slots without which nothing can be drawn.
    pub least_slots: u32,
    /// Slots that could ever be filled.
    pub most_slots: u32,
}

impl VolumeNeeds {
    /// Whether bricks of another volume fit this one's slots: then the two share one pool of them, and a brick of either can be in
    /// any.
    pub fn shares_slots_with(&self, other: &Self) -> bool {
        let slot = |needs: &Self| (needs.encoding.format, needs.encoding.has_invalid, needs.edge, needs.bricks);
        slot(self) == slot(other)
    }
}

/// The number of each volume's pool of slots: pools are numbered from 0 in the order of the first volume of each.
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

/// One volume's part of a picture, in which the others may be left out.
#[derive(Clone, Copy, Debug)]
pub struct Layer<'a> {
    /// Which it is of the volumes that the renderer was made for. In a picture they come in ascending order.
    pub volume: usize,
    /// Its frame.
    pub frame: &'a VolumeFrame,
    /// Its levels.
    pub pyramid: &'a Pyramid,
    /// What is drawn of it.
    pub draw: &'a DrawList,
    /// Which cut that is drawn from: layers of the same number share one, so their [ranks](crate::DrawCell::rank) are of one order.
    pub cut: u32,
}

/// A number of things of one size that somebody wants.
#[derive(Clone, Copy, Debug)]
pub struct BudgetRequest {
    /// Bytes of each.
    pub bytes: u64,
    /// Without so many there is nothing.
    pub least: u64,
    /// More are of no use.
    pub most: u64,
}

/// How many each gets of a budget: the least that each needs, and of the rest the same share of what each wants besides. All that
/// there is, together, if it is not enough for the least.
///
/// # Errors
/// The least budget that works.
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
