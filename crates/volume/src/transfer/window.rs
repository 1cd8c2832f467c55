//! Transfer functions moved, bent and dimmed by a layer's style. Each operation costs a pass over the function's points.

use super::{TransferFunction, curve, interpolate};

impl TransferFunction {
    /// The least and the greatest value of the points of colour and opacity.
    pub fn span(&self) -> (f64, f64) {
        let values = || self.color.iter().map(|p| p[0]).chain(self.opacity.iter().map(|p| p[0]));
        (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max))
    }

    /// The least and the greatest value between which the function changes: outside, colour and opacity are constant. `None` if it never
    /// changes.
    pub fn changes(&self) -> Option<[f64; 2]> {
        fn of<const N: usize>(points: &[[f64; N]]) -> impl Iterator<Item = f64> {
            let pairs = || points.windows(2).filter(|pair| pair[0][1..] != pair[1][1..]);
            pairs().next().map(|pair| pair[0][0]).into_iter().chain(pairs().next_back().map(|pair| pair[1][0]))
        }
        let regions = self.regions.iter().flat_map(|region| region.value);
        let values = || of(&self.color).chain(of(&self.opacity)).chain(regions.clone());
        let (low, high) = (values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max));
        (low <= high).then_some([low, high])
    }

    /// [`changes`](Self::changes) of fog, where colours of clear values do not count. `None` without any visible change.
    pub fn visible_changes(&self) -> Option<[f64; 2]> {
        let [low, high] = self.changes()?;
        let opacity = &self.opacity;
        let first = opacity.iter().position(|point| point[1] > 0.0);
        let last = opacity.iter().rposition(|point| point[1] > 0.0);
        let fog = first.zip(last).map(|(first, last)| {
            let before = first.checked_sub(1).map_or(low, |clear| opacity[clear][0].max(low));
            [before, opacity.get(last + 1).map_or(high, |clear| clear[0].min(high))]
        });
        let join = |a: [f64; 2], b: [f64; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        self.regions.iter().map(|region| region.value).chain(fog).reduce(join).filter(|[low, high]| low <= high)
    }

    /// The least distance between two neighbouring points of colour or opacity within a window, the limit of its detail.
    pub(crate) fn thinnest(&self, [low, high]: [f64; 2]) -> f64 {
        fn of<const N: usize>(points: &[[f64; N]]) -> impl Iterator<Item = [f64; 2]> {
            points.windows(2).map(|pair| [pair[0][0], pair[1][0]])
        }
        let gaps = of(&self.color).chain(of(&self.opacity)).chain(self.regions.iter().map(|region| region.value));
        let within = gaps.filter(|gap| gap[0] < gap[1] && low <= gap[0] && gap[1] <= high);
        within.map(|gap| gap[1] - gap[0]).fold(f64::INFINITY, f64::min)
    }

    /// Moves the function from the values of the interval `from` to the interval `to`, widened to 1 if empty. Gradient magnitudes have the
    /// same units as values, and are stretched alike.
    pub fn stretched(mut self, from: (f64, f64), to: (f64, f64)) -> Self {
        let to = if to.1 > to.0 { to } else { (to.0, to.0 + 1.0) };
        let scale = (to.1 - to.0) / (from.1 - from.0);
        // Each operation is monotonic, so points stay sorted in spite of rounding.
        let moved = |value: &mut f64| *value = to.0 + (*value - from.0) / (from.1 - from.0) * (to.1 - to.0);
        self.color.iter_mut().for_each(|p| moved(&mut p[0]));
        self.opacity.iter_mut().for_each(|p| moved(&mut p[0]));
        self.gradient_opacity.iter_mut().for_each(|p| p[0] *= scale);
        for region in &mut self.regions {
            region.value.iter_mut().for_each(moved);
            region.gradient.iter_mut().for_each(|magnitude| *magnitude *= scale);
        }
        self
    }

    /// Bends the function's colours and opacities over a window: its new look at a share `t` of the window is the old one at `t` to the
    /// power of `gamma`. Outside the window it is unchanged, and so are factors and regions by gradient.
    pub fn bent(mut self, window: (f64, f64), gamma: f64) -> Self {
        if gamma != 1.0 {
            self.color = bent(&self.color, window, gamma);
            self.opacity = bent(&self.opacity, window, gamma);
        }
        self
    }

    /// The function with the opacities of all points and regions multiplied by `opacity`.
    pub fn scaled(&self, opacity: f64) -> Self {
        let mut scaled = self.clone();
        scaled.opacity.iter_mut().for_each(|point| point[1] *= opacity);
        scaled.regions.iter_mut().for_each(|region| region.opacity *= opacity);
        scaled
    }
}

/// Bends points over a window, with more between them, so that straight lines stay near the curve.
fn bent<const N: usize>(points: &[[f64; N]], (low, high): (f64, f64), gamma: f64) -> Vec<[f64; N]> {
    let power = |value: f64, power: f64| {
        let share = (value - low) / (high - low);
        if share > 0.0 && share < 1.0 { low + (high - low) * share.powf(power) } else { value }
    };
    let at = |value: f64| curve::moved(interpolate(points, power(value, gamma)), value);
    // A straight line that leaves the window has a corner there.
    let mut all = points.to_vec();
    for corner in [low, high].map(|edge| curve::moved(interpolate(points, edge), edge)) {
        let place = all.partition_point(|point| point[0] < corner[0]);
        if place > 0 && all.get(place).is_some_and(|next| next[0] > corner[0]) {
            all.insert(place, corner);
        }
    }
    let placed = |point: [f64; N]| curve::moved(point, power(point[0], 1.0 / gamma));
    let mut bent = Vec::new();
    for pair in all.windows(2) {
        let [from, to] = [placed(pair[0]), placed(pair[1])];
        bent.push(from);
        if low <= from[0] && from[0] < to[0] && to[0] <= high {
            curve::follow(&|t| at(from[0] + t * (to[0] - from[0])), 0.5, &mut bent);
        }
    }
    bent.extend(all.last().map(|&point| placed(point)));
    // Powers may be rounded past each other.
    let mut greatest = f64::NEG_INFINITY;
    for point in &mut bent {
        greatest = greatest.max(point[0]);
        point[0] = greatest;
    }
    bent
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transfer::{Region, Shape};

    fn function() -> TransferFunction {
        TransferFunction {
            color: vec![[-2.0, 0.1, 0.9, 0.0], [1.0, 1.0, 0.0, 0.5], [1.0, 0.3, 0.2, 0.1], [9.0, 0.0, 0.6, 1.0]],
            opacity: vec![[0.0, 0.0], [4.0, 0.8], [11.0, 0.2]],
            gradient_opacity: vec![[1.0, 0.0], [3.0, 1.0]],
            regions: vec![Region {
                shape: Shape::Gaussian,
                value: [2.0, 6.0],
                gradient: [0.5, 2.0],
                color: [1.0, 0.0, 0.0],
                opacity: 0.5,
            }],
            ..TransferFunction::default()
        }
    }

    #[test]
    fn a_moved_function_is_to_moved_data_what_it_was() {
        let (function, moved) = (function(), function().stretched((-2.0, 11.0), (100.0, 139.0)));
        moved.validate().unwrap();
        assert_eq!((function.span(), moved.span()), ((-2.0, 11.0), (100.0, 139.0)));
        for i in 0..200 {
            let (value, gradient) = (-3.0 + 0.073 * i as f64, 0.017 * i as f64);
            let (before, after) = (function.at(value, gradient), moved.at(106.0 + 3.0 * value, 3.0 * gradient));
            (0..4).for_each(|k| assert!((before[k] - after[k]).abs() < 1e-12, "{value}: {before:?} {after:?}"));
        }
    }

    #[test]
    fn a_function_changes_between_its_first_and_its_last_change() {
        let of = |color: &[[f64; 4]], opacity: &[[f64; 2]]| {
            let (color, opacity) = (color.to_vec(), opacity.to_vec());
            TransferFunction { color, opacity, ..TransferFunction::default() }.changes()
        };
        let red = [0.0, 1.0, 0.0, 0.0];
        assert_eq!(of(&[red], &[[3.0, 0.5], [9.0, 0.5]]), None);
        assert_eq!(of(&[red], &[[-9.0, 0.0], [2.0, 0.0], [3.0, 0.5], [9.0, 0.5]]), Some([2.0, 3.0]));
        assert_eq!(of(&[red, [0.0, 0.0, 1.0, 0.0]], &[[3.0, 0.5]]), Some([0.0, 0.0]), "a step");
        assert_eq!(of(&[red, [5.0, 0.0, 1.0, 0.0]], &[[2.0, 0.0], [7.0, 0.5]]), Some([0.0, 7.0]));
        assert_eq!(function().changes(), Some([-2.0, 11.0]));
    }

    #[test]
    fn a_bent_function_takes_a_power_of_the_place_in_its_window() {
        let (low, high) = (-1.0, 8.0);
        for gamma in [0.3, 0.5, 2.2, 6.0] {
            let (before, bent) = (function(), function().bent((low, high), gamma));
            bent.validate().unwrap();
            for i in 0..1300 {
                let value = -2.5 + 0.01099 * i as f64;
                let share: f64 = (value - low) / (high - low);
                let old = if (0.0..=1.0).contains(&share) { low + (high - low) * share.powf(gamma) } else { value };
                let expected = [before.rgb(old)[0], before.rgb(old)[1], before.rgb(old)[2], before.alpha(old)];
                let found = [bent.rgb(value)[0], bent.rgb(value)[1], bent.rgb(value)[2], bent.alpha(value)];
                // Half of an 8-bit step.
                (0..4).for_each(|k| {
                    assert!((found[k] - expected[k]).abs() < 0.5 / 255.0, "{gamma} at {value}: {found:?} {expected:?}");
                });
            }
        }
        assert_eq!(function().bent((low, high), 1.0), function());
    }
}
