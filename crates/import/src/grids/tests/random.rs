//! Random grids whose cells are whole numbers of quarter voxels, against a search through all cells.

use super::{Listed, encoded};
use crate::options::OpenOptions;
use brickyard_volume::{VoxelBox, VoxelType};
use glam::DVec3;
use proptest::prelude::*;
use serde_json::json;

/// A grid in whole numbers: lengths in quarters of the finest spacing.
#[derive(Clone, Debug)]
struct Grid {
    low: [i64; 3],
    step: [i64; 3],
    count: [i64; 3],
    /// No data in voxels whose hash is a multiple of it.
    hole: u64,
}

/// Quarters in the finest spacing, which a first grid has.
const UNIT: i64 = 4;
const NODATA: f64 = 251.0;

impl Grid {
    fn cell(&self, centre: [i64; 3]) -> Option<[i64; 3]> {
        let cell: [i64; 3] = std::array::from_fn(|axis| (centre[axis] - self.low[axis]).div_euclid(self.step[axis]));
        (0..3).all(|axis| (0..self.count[axis]).contains(&cell[axis])).then_some(cell)
    }

    fn value(&self, number: usize, cell: [i64; 3]) -> Option<f64> {
        let key = cell.iter().fold(number as u64 + 7, |key, i| key.wrapping_mul(1009).wrapping_add(*i as u64 + 1));
        let hash = key.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
        (hash % self.hole > 0).then_some((hash % 250) as f64)
    }

    fn volume(&self) -> i64 {
        self.step.iter().product()
    }
}

fn grid(is_finest: bool) -> impl Strategy<Value = Grid> {
    let steps: &[i64] = if is_finest { &[UNIT] } else { &[4, 8, 10, 12, 13, 16] };
    let offset = if is_finest { (-3i64..4).prop_map(|n| n * UNIT).boxed() } else { (-14i64..20).boxed() };
    let along = (offset, prop::sample::select(steps.to_vec()), 1i64..5);
    (prop::array::uniform3(along), prop::sample::select(vec![2u64, 5, 1_000_000])).prop_map(|(along, hole)| Grid {
        low: along.map(|(low, ..)| low),
        step: along.map(|(_, step, _)| step),
        count: along.map(|(.., count)| count),
        hole,
    })
}

/// Equally fine grids share a lattice.
fn fit(mut grid: Grid) -> Grid {
    if grid.step == [UNIT; 3] {
        grid.low = grid.low.map(|low| low.div_euclid(UNIT) * UNIT);
    }
    grid
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn every_voxel_is_that_of_a_search(
        finest in grid(true),
        others in prop::collection::vec(grid(false), 0..4),
        at in any::<prop::sample::Index>(),
        voxel_type in prop::sample::select(vec![VoxelType::U8, VoxelType::I16, VoxelType::F32]),
        scale in prop::sample::select(vec![0.25, 0.1, 3.0]),
        ends in prop::array::uniform3((any::<prop::sample::Index>(), any::<prop::sample::Index>())),
    ) {
        let mut grids: Vec<Grid> = others.into_iter().map(fit).collect();
        grids.insert(at.index(grids.len() + 1), finest.clone());
        let world = |quarters: f64| quarters * scale / UNIT as f64;
        let mut listed = Listed::new();
        for (i, grid) in grids.iter().enumerate() {
            let [x, y, z] = grid.count;
            let cells = (0..z).flat_map(|z| (0..y).flat_map(move |y| (0..x).map(move |x| [x, y, z])));
            let values: Vec<f64> = cells.map(|cell| grid.value(i, cell).unwrap_or(NODATA)).collect();
            let first: [f64; 3] = std::array::from_fn(|a| world(grid.low[a] as f64 + grid.step[a] as f64 / 2.0));
            let place = json!({"spacing": grid.step.map(|step| world(step as f64)), "origin": first});
            listed = listed.with(&format!("{i}.raw"), voxel_type.name(), grid.count.map(|n| n as u32), &values, place);
        }
        let source = listed.open(&json!({"nodata": NODATA}), &OpenOptions::default()).unwrap();
        // Centres of voxels are two quarters from their faces; the lattice is the finest grid's.
        let centre = |axis: usize, voxel: i64| finest.low[axis] + voxel * UNIT + UNIT / 2;
        let range: [(i64, i64); 3] = std::array::from_fn(|axis| {
            let covered = |voxel: &i64| grids.iter().any(|grid| {
                let at = centre(axis, *voxel) - grid.low[axis];
                (0..grid.count[axis] * grid.step[axis]).contains(&at)
            });
            let all: Vec<i64> = (-40..60).filter(covered).collect();
            (all[0], all[all.len() - 1] + 1)
        });
        let extent = source.info().extent;
        prop_assert_eq!(extent.to_array(), range.map(|(low, high)| (high - low) as u32));
        let first: [f64; 3] = std::array::from_fn(|axis| world(centre(axis, range[axis].0) as f64));
        let geometry = &source.info().geometry;
        prop_assert!((geometry.spacing - scale).abs().max_element() < 1e-12);
        prop_assert!((geometry.origin - DVec3::from_array(first)).abs().max_element() < 1e-10);
        let mut order: Vec<usize> = (0..grids.len()).collect();
        order.sort_by_key(|i| grids[*i].volume());
        let expected = |voxel: [u32; 3]| {
            let at = std::array::from_fn(|axis| centre(axis, range[axis].0 + i64::from(voxel[axis])));
            let found = order.iter().find_map(|i| grids[*i].value(*i, grids[*i].cell(at)?));
            encoded(voxel_type, found.unwrap_or(if voxel_type.is_float() { f64::NAN } else { NODATA }))
        };
        let part: [(u32, u32); 3] = std::array::from_fn(|axis| {
            let n = extent.to_array()[axis] as usize;
            let [a, b] = [ends[axis].0.index(n), ends[axis].1.index(n)].map(|end| end as u32);
            (a.min(b), a.max(b) + 1)
        });
        for region in [extent.full_box(), VoxelBox::new(part.map(|(low, _)| low), part.map(|(_, high)| high))] {
            let mut found = vec![0xa5; region.extent().volume() as usize * voxel_type.bytes()];
            source.read_box(0, 0, region, &mut found).unwrap();
            let expected: Vec<u8> = region.voxels().flat_map(expected).collect();
            prop_assert!(found == expected, "{:?}", region);
            if let Some(value) = source.constant_in(0, 0, region) {
                let all = found.chunks_exact(voxel_type.bytes()).all(|voxel| voxel == encoded(voxel_type, value));
                prop_assert!(all);
            }
            source.announce(0, 0, region);
        }
    }
}
