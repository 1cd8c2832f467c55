//! VTK's curves, drawn by ParaView and 3D Slicer, as points with straight lines between them.
//!
//! Between two of VTK's nodes the first one's midpoint is the place of the half-way value, and its sharpness the suddenness of
//! the change: 0 is two straight lines, 1 a step, and anything in between a cubic (`vtkPiecewiseFunction::GetTable`).

use super::{TransferError, check_points};

/// Greatest distance of the straight lines from the curve: a quarter of one step of an 8-bit picture.
const TOLERANCE: f64 = 0.25 / 255.0;

/// Most halvings of a stretch. The sharpest cubic (0.99) takes 8 to be within the tolerance.
const MAX_HALVINGS: u32 = 12;

/// A node: its point `[value, ...]`, and the shape of the curve to the next one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Node<const N: usize> {
    pub(super) point: [f64; N],
    pub(super) midpoint: f64,
    pub(super) sharpness: f64,
}

impl<const N: usize> Node<N> {
    /// The midpoint, a little off the nodes: on a node it would make a step beside it.
    fn middle(&self) -> f64 {
        self.midpoint.clamp(0.001, 0.999)
    }
}

impl Node<2> {
    /// The nodes of a list of opacities, each `[value, alpha, midpoint, sharpness]`.
    pub(super) fn opacities(list: &'static str, points: &[[f64; 4]]) -> Result<Vec<Self>, TransferError> {
        check_points(list, points)?;
        let node =
            |&[value, alpha, midpoint, sharpness]: &[f64; 4]| Self { point: [value, alpha], midpoint, sharpness };
        Ok(points.iter().map(node).collect())
    }
}

/// A point moved to a value.
pub(super) fn moved<const N: usize>(mut point: [f64; N], value: f64) -> [f64; N] {
    point[0] = value;
    point
}

/// The points of a curve through nodes, in order of their values: those at one value stay in the file's order, as a step.
pub(super) fn points<const N: usize>(mut nodes: Vec<Node<N>>) -> Vec<[f64; N]> {
    nodes.sort_by(|a, b| a.point[0].total_cmp(&b.point[0]));
    let mut points = Vec::new();
    for pair in nodes.windows(2) {
        between(&pair[0], pair[1].point, &mut points);
    }
    points.extend(nodes.last().map(|last| last.point));
    points
}

/// Adds the node's point and those on the way to the next, without the latter.
fn between<const N: usize>(node: &Node<N>, next: [f64; N], points: &mut Vec<[f64; N]>) {
    let (a, middle) = (node.point, node.middle());
    points.push(a);
    if a[1..] == next[1..] || a[0] == next[0] {
        return;
    }
    if node.sharpness > 0.99 {
        let value = a[0] + middle * (next[0] - a[0]);
        points.extend([moved(a, value), moved(next, value)]);
    } else if node.sharpness >= 0.01 {
        follow(&|t| cubic(node, next, t), middle, points);
    } else if middle != 0.5 {
        let mean = std::array::from_fn(|k| (a[k] + next[k]) / 2.0);
        points.push(moved(mean, a[0] + middle * (next[0] - a[0])));
    }
}

/// The cubic from a node to the next, `t` in 0..1 between their values.
fn cubic<const N: usize>(node: &Node<N>, next: [f64; N], t: f64) -> [f64; N] {
    let (a, middle, sharpness) = (node.point, node.middle(), node.sharpness);
    let s = if t < middle { 0.5 * t / middle } else { 0.5 + 0.5 * (t - middle) / (1.0 - middle) };
    let power = 1.0 + 10.0 * sharpness;
    let s = if s < 0.5 { 0.5 * (2.0 * s).powf(power) } else { 1.0 - 0.5 * (2.0 - 2.0 * s).powf(power) };
    let (s2, s3) = (s * s, s * s * s);
    // Hermite's, with the same slope at both ends.
    let (rise, slopes) = (3.0 * s2 - 2.0 * s3, 2.0 * s3 - 3.0 * s2 + s);
    let done = (rise + slopes * (1.0 - sharpness)).clamp(0.0, 1.0);
    let point = std::array::from_fn(|k| a[k] + done * (next[k] - a[k]));
    moved(point, a[0] + t * (next[0] - a[0]))
}

/// Adds points of a curve over `t` in 0..1, without its ends, dense enough for straight lines within the tolerance. The curve
/// may have one sharp bend, at `turn`.
pub(super) fn follow<const N: usize>(curve: &dyn Fn(f64) -> [f64; N], turn: f64, points: &mut Vec<[f64; N]>) {
    let (start, middle, end) = (curve(0.0), curve(turn), curve(1.0));
    halve(curve, 0.0, start, turn, middle, MAX_HALVINGS, points);
    points.push(middle);
    halve(curve, turn, middle, 1.0, end, MAX_HALVINGS, points);
}

fn halve<const N: usize>(
    curve: &dyn Fn(f64) -> [f64; N],
    from: f64,
    a: [f64; N],
    to: f64,
    b: [f64; N],
    halvings: u32,
    points: &mut Vec<[f64; N]>,
) {
    let on_line = |part: f64| {
        let found = curve(from + part * (to - from));
        (1..N).all(|k| (a[k] + part * (b[k] - a[k]) - found[k]).abs() <= TOLERANCE)
    };
    if halvings == 0 || [0.25, 0.5, 0.75].into_iter().all(on_line) {
        return;
    }
    let t = (from + to) / 2.0;
    let middle = curve(t);
    halve(curve, from, a, t, middle, halvings - 1, points);
    points.push(middle);
    halve(curve, t, middle, to, b, halvings - 1, points);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transfer::interpolate;

    fn node(value: f64, alpha: f64, midpoint: f64, sharpness: f64) -> Node<2> {
        Node { point: [value, alpha], midpoint, sharpness }
    }

    #[test]
    fn straight_ways_bend_at_the_midpoint_and_sharp_ones_step_there() {
        let last = node(20.0, 0.2, 0.5, 0.0);
        assert_eq!(points(vec![last, node(10.0, 0.6, 0.5, 0.0)]), [[10.0, 0.6], [20.0, 0.2]], "sorted");
        let bent = points(vec![node(10.0, 0.6, 0.25, 0.0), last]);
        assert_eq!(bent, [[10.0, 0.6], [12.5, 0.4], [20.0, 0.2]]);
        let step = points(vec![node(10.0, 0.6, 0.25, 1.0), last]);
        assert_eq!(step, [[10.0, 0.6], [12.5, 0.6], [12.5, 0.2], [20.0, 0.2]]);
        // Two nodes at one value are a step too, in the file's order.
        let pair = points(vec![last, node(20.0, 0.9, 0.5, 0.0), node(0.0, 0.0, 0.5, 0.0)]);
        assert_eq!(pair, [[0.0, 0.0], [20.0, 0.2], [20.0, 0.9]]);
    }

    /// `vtkPiecewiseFunction` of VTK 9.7.2 with `AddPoint(0, 0.1, midpoint, sharpness)` and `AddPoint(1, 0.9)`, at 0.1 to 0.9.
    const VTK: [(f64, f64, [f64; 9]); 4] = [
        (0.3, 0.5, [0.100275, 0.119803, 0.5, 0.779743, 0.868381, 0.892678, 0.898749, 0.899891, 0.899998]),
        (0.5, 0.05, [0.134221, 0.197891, 0.282084, 0.383602, 0.5, 0.616398, 0.717916, 0.802109, 0.865779]),
        (0.5, 0.98, [0.1, 0.1, 0.100042, 0.10532, 0.5, 0.89468, 0.899958, 0.9, 0.9]),
        (0.9, 0.2, [0.100439, 0.103526, 0.112014, 0.128991, 0.158196, 0.204309, 0.272961, 0.370081, 0.5]),
    ];

    #[test]
    fn cubics_are_vtks() {
        for (midpoint, sharpness, expected) in VTK {
            let points = points(vec![node(0.0, 0.1, midpoint, sharpness), node(1.0, 0.9, 0.5, 0.0)]);
            assert!(points.len() < 200, "{} points at {midpoint} {sharpness}", points.len());
            for (i, expected) in expected.into_iter().enumerate() {
                let [_, found] = interpolate(&points, (i + 1) as f64 / 10.0);
                assert!((found - expected).abs() < 1.2 * TOLERANCE, "{midpoint} {sharpness} {i}: {found} {expected}");
            }
        }
    }

    #[test]
    fn lines_stay_within_the_tolerance_of_every_curve() {
        for sharpness in [0.01, 0.1, 0.5, 0.9, 0.99] {
            for midpoint in [0.0, 0.01, 0.5, 0.8, 1.0] {
                let (first, last) = (node(0.0, 0.0, midpoint, sharpness), node(1.0, 1.0, 0.5, 0.0));
                let points = points(vec![first, last]);
                for i in 0..=1000 {
                    let t = i as f64 / 1000.0;
                    let [_, exact] = cubic(&first, last.point, t);
                    let [_, found] = interpolate(&points, t);
                    // Between the three checked places, the greatest distance can be a little more.
                    assert!((found - exact).abs() < 1.2 * TOLERANCE, "{midpoint} {sharpness} at {t}: {found} {exact}");
                }
            }
        }
    }
}
