//! Edits a transfer function's lists of points: moving, adding and removing. The lists stay sorted, and a moved or added point keeps its distance
//! from its neighbours.

/// Moves a point to a value, between its neighbours at a distance of `least` and the ends of `within`. A point without room stays.
pub(crate) fn move_point<const N: usize>(points: &mut [[f64; N]], index: usize, to: f64, within: [f64; 2], least: f64) {
    let before = index.checked_sub(1).map_or(f64::NEG_INFINITY, |before| points[before][0] + least);
    let behind = points.get(index + 1).map_or(f64::INFINITY, |behind| behind[0] - least);
    // A point may be outside already: it is not pulled in, but goes no farther.
    let now = points[index][0];
    let (low, high) = (before.max(within[0].min(now)), behind.min(within[1].max(now)));
    if to.is_finite() && to != now && low <= high {
        points[index][0] = to.clamp(low, high);
    }
}

/// Adds a point. Returns its place; `None` if another one is nearer than `least`.
pub(crate) fn add_point<const N: usize>(points: &mut Vec<[f64; N]>, point: [f64; N], least: f64) -> Option<usize> {
    let has_room = points.iter().all(|other| (other[0] - point[0]).abs() >= least);
    if !has_room || point.iter().any(|number| !number.is_finite()) {
        return None;
    }
    let place = points.partition_point(|other| other[0] < point[0]);
    points.insert(place, point);
    Some(place)
}

/// Removes a point, unless fewer than `fewest` would be left. Returns whether it is gone.
pub(crate) fn remove_point<const N: usize>(points: &mut Vec<[f64; N]>, index: usize, fewest: usize) -> bool {
    let can = index < points.len() && points.len() > fewest;
    if can {
        points.remove(index);
    }
    can
}

/// The fewest points with the same straight lines up to `tolerance` (Douglas and Peucker, along the value's axis). Steps stay.
pub(crate) fn simplified<const N: usize>(points: &[[f64; N]], tolerance: f64) -> Vec<[f64; N]> {
    let Some((first, last)) = points.first().zip(points.last()) else { return Vec::new() };
    let off = |point: &[f64; N]| {
        let width = last[0] - first[0];
        let share = if width > 0.0 { (point[0] - first[0]) / width } else { 0.0 };
        let line = |i: usize| first[i] + share * (last[i] - first[i]);
        (1..N).map(|i| (point[i] - line(i)).abs()).fold(0.0, f64::max)
    };
    let offs = points.iter().map(off).enumerate();
    let (worst, most) = offs.fold((0, 0.0), |worst, this| if this.1 > worst.1 { this } else { worst });
    if points.len() <= 2 || most <= tolerance || worst == 0 || worst == points.len() - 1 {
        return if points.len() > 1 { vec![*first, *last] } else { vec![*first] };
    }
    let mut kept = simplified(&points[..=worst], tolerance);
    kept.extend(simplified(&points[worst..], tolerance).into_iter().skip(1));
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard::volume::TransferFunction;
    use proptest::prelude::*;

    #[test]
    fn a_point_stops_at_its_neighbours() {
        let moved = |index, to| {
            let mut points = vec![[0.0, 0.1], [5.0, 0.2], [9.0, 0.3]];
            move_point(&mut points, index, to, [0.0, 10.0], 0.5);
            points[index][0]
        };
        assert_eq!([moved(1, 6.0), moved(1, 20.0), moved(1, -3.0)], [6.0, 8.5, 0.5]);
        assert_eq!([moved(0, -3.0), moved(2, 30.0), moved(1, f64::NAN)], [0.0, 10.0, 5.0]);
    }

    #[test]
    fn a_step_is_not_torn_by_being_lifted() {
        let mut points = vec![[0.0, 0.1], [5.0, 0.2], [5.0, 0.8], [9.0, 0.3]];
        move_point(&mut points, 1, 5.0, [0.0, 10.0], 0.5);
        assert_eq!(points[1][0], 5.0);
        move_point(&mut points, 1, 7.0, [0.0, 10.0], 0.5);
        assert_eq!(points[1][0], 4.5);
    }

    #[test]
    fn a_map_of_many_points_becomes_one_of_few_that_looks_the_same() {
        for name in TransferFunction::PRESETS {
            let map = TransferFunction::preset(name, (-3.0, 8.0), 1.0).expect("a preset");
            let few = TransferFunction { color: simplified(&map.color, 1.5 / 255.0), ..map.clone() };
            few.validate().expect("sorted");
            assert!(few.color.len() <= 36, "{name}: {}", few.color.len());
            for i in 0..=500 {
                let (low, high) = map.span();
                let value = low + (high - low) * f64::from(i) / 500.0;
                let apart = (0..3).map(|k| (map.rgb(value)[k] - few.rgb(value)[k]).abs()).fold(0.0, f64::max);
                assert!(apart <= 1.51 / 255.0, "{name} at {value}: {apart}");
            }
        }
    }

    proptest! {
        /// After any edits in any order the lists are valid, and points that were apart stay apart.
        #[test]
        fn lists_stay_valid(
            preset in 0..TransferFunction::PRESETS.len(),
            deeds in prop::collection::vec((0..3u8, 0..40usize, -0.5..1.5f64, 0.0..=1.0f64), 1..60),
        ) {
            let name = TransferFunction::PRESETS[preset];
            let mut function = TransferFunction::preset(name, (0.0, 200.0), 1.0).expect("a preset");
            let (low, high) = function.span();
            let least = (high - low) / 2000.0;
            for (deed, index, share, part) in deeds {
                let value = low + share * (high - low);
                let (of_opacity, of_color) = (index % function.opacity.len(), index % function.color.len());
                match deed {
                    0 => {
                        move_point(&mut function.opacity, of_opacity, value, [low, high], least);
                        move_point(&mut function.color, of_color, value, [low, high], least);
                    }
                    1 => {
                        add_point(&mut function.opacity, [value, part], least);
                        add_point(&mut function.color, [value, part, part, part], least);
                    }
                    _ => {
                        remove_point(&mut function.opacity, of_opacity, 2);
                        remove_point(&mut function.color, of_color, 1);
                    }
                }
                prop_assert!(function.validate().is_ok(), "{:?}", function.validate());
                let is_apart = |pair: &[[f64; 2]]| pair[1][0] - pair[0][0] > 0.9 * least;
                prop_assert!(function.opacity.windows(2).all(is_apart), "{:?}", function.opacity);
                prop_assert!(function.opacity.len() >= 2 && !function.color.is_empty());
            }
        }
    }
}
