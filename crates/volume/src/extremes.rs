//! Maximum and minimum projections of coarse levels whose voxels are the extremes of the finer voxels in them.
//!
//! A filter would lose those extremes, giving a value between two voxels'. So a brick of a coarse level is not sampled in the middle of a segment;
//! the extreme of all voxels touched by the segment's *box* counts. The box has the segment's ends in opposite corners, and reaches on each side as
//! far as a sample of level 0 takes voxels: half a voxel of level 0 with the linear filter. It touches the coarse voxels of every level-0 sample on
//! the segment, so the projection shows nothing less extreme. All touched voxels lie within a coarse voxel of the ray, so no extreme is invented; but
//! a voxel with a cut through it has the extreme of both sides, as documented for users.
//!
//! Boxes of short segments stray the least from the ray, and stay in a brick's apron: the lattices of such projections have steps of half a voxel at
//! coarse levels. Only while a camera moves are segments longer than a voxel; then only a voxel's length of each is read.

use crate::sampling::Filter;

/// Reach of a segment's box beyond its ends along each axis, in voxels of a level with `factor` level-0 voxels along each axis.
pub fn reach(filter: Filter, factor: [u32; 3]) -> [f64; 3] {
    factor.map(|factor| filter.farthest() / f64::from(factor))
}

/// Half extent of a segment's box, from its middle to its faces. `way` leads from one end of the segment to the other; all are in voxels of the
/// level.
pub fn half_box(way: [f64; 3], reach: [f64; 3]) -> [f64; 3] {
    let longest = way.into_iter().map(f64::abs).fold(1.0, f64::max);
    std::array::from_fn(|a| 0.5 * way[a].abs() / longest + reach[a])
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The box touches the coarse voxels of every level-0 sample on a segment, and none a coarse voxel off.
        #[test]
        fn boxes_touch_what_level_0_would_take(
            from in prop::array::uniform3(0.0f64..9.0), way in prop::array::uniform3(-0.57f64..0.57), at in 0.0f64..1.0, log in prop::array::uniform3(0u32..5),
            filter in prop::sample::select(Filter::ALL.to_vec()), steps in prop::array::uniform3(0u8..4),
        ) {
            let factor = log.map(|log| 1 << log);
            let half = half_box(way, reach(filter, factor));
            for a in 0..3 {
                let middle = from[a] + 0.5 * way[a];
                let touched = (middle - half[a]).floor()..=(middle + half[a]).floor();
                // A sample's place in voxels of level 0, and one of its taps.
                let place = (from[a] + at * way[a]) * f64::from(factor[a]);
                let (first, count) = match filter {
                    Filter::Nearest => (place.floor(), 1),
                    Filter::Trilinear => ((place - 0.5).floor(), 2),
                    Filter::Tricubic => ((place - 0.5).floor() - 1.0, 4),
                };
                let voxel = first + f64::from(steps[a] % count);
                let coarse = (voxel / f64::from(factor[a])).floor();
                prop_assert!(touched.contains(&coarse), "{coarse} is not in {touched:?}");
                let most = if filter == Filter::Tricubic { 2.0 } else { 1.0 };
                prop_assert!(half[a] < most);
            }
        }
    }

    #[test]
    fn no_more_than_a_voxel_of_a_segment_is_looked_at() {
        assert_eq!(half_box([0.2, -0.5, 0.0], [0.0; 3]), [0.1, 0.25, 0.0]);
        assert_eq!(half_box([4.0, -2.0, 0.0], [0.25; 3]), [0.75, 0.5, 0.25]);
    }
}
