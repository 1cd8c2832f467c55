//! Visibility of cells to rays, from the renderer's feedback on the last frames.
//!
//! A cell's weight is the greatest transmittance with which a ray entered it, in octaves: coarse enough that noise does not change plans,
//! and few, so a resting view settles. Cells reached by no ray are hidden, and not wanted. Cells not drawn yet inherit from the smallest
//! drawn cell around them, or count as visible.
//!
//! Feedback holds for nearby eyes, while the line of sight to a cell has moved by no more than half the cell's size; smaller cells then
//! inherit from their container. Disoccluded cells, and those entering the frustum, are thus wanted before any report, and reported cells
//! in the next cut. While a view rests, reports accumulate: visible cells stay visible (light let through by finer bricks is added, light
//! they block is not subtracted), so cut, frame and report settle too.
//!
//! Feedback on one time step predicts the visible cells of the others, and so the order of reading and refining them. It hides none of
//! theirs: cells reached by no ray count as barely visible.
//!
//! Costs a hash entry per drawn cell and per ancestor.

use crate::cut::{Node, OPEN, View};
use brickyard_volume::{BrickId, BrickIndex, Level, Placement, Pyramid, ViewRays};
use rustc_hash::FxHashMap;

/// Visibility of cells, accumulated over frames of one view.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Visibility {
    view: View,
    weights: FxHashMap<(Level, BrickIndex), u8>,
}

impl Visibility {
    /// Feedback on one frame: the greatest transmittance with which rays entered each cell.
    pub(crate) fn new(pyramid: &Pyramid, view: &View, told: impl Iterator<Item = (BrickId, f32)>) -> Self {
        let mut weights = FxHashMap::default();
        for (id, transmittance) in told {
            let weight = octave(transmittance);
            let mut cell = Some((id.level, id.index));
            // An ancestor is visible where any of its cells is.
            while let Some((level, index)) = cell {
                let known = weights.entry((level, index)).or_insert(0);
                if level > id.level && *known >= weight.max(1) {
                    break;
                }
                *known = weight.max(*known);
                cell = pyramid.parent(level, index).map(|index| (Level(level.0 + 1), index));
            }
        }
        Self { view: view.clone(), weights }
    }

    pub(crate) fn is_of(&self, view: &View) -> bool {
        self.view == *view
    }

    /// Whether the feedback belongs to this view's content, from any camera.
    pub(crate) fn is_of_content(&self, view: &View) -> bool {
        self.view.time == view.time && self.is_of_steps(view)
    }

    /// Whether the feedback belongs to this view's content, in any time step.
    fn is_of_steps(&self, view: &View) -> bool {
        let content = |view: &View| (view.opaque, view.caps, view.appearance, view.channel);
        let is_same_place = self.view.clip == view.clip && self.view.placement == view.placement;
        content(&self.view) == content(view) && is_same_place
    }

    /// Adds feedback on a later frame of the same view: weights only grow. Returns whether any has changed.
    pub(crate) fn add(&mut self, later: Self) -> bool {
        let mut has_changed = false;
        for (cell, weight) in later.weights {
            let known = self.weights.get(&cell).copied();
            if known.is_none_or(|known| known < weight) {
                self.weights.insert(cell, weight);
                has_changed = true;
            }
        }
        has_changed
    }

    /// Reported weight of a node, if it still holds for the view's eyes. At least 1 if reported for another time step.
    pub(crate) fn weight(&self, view: &View, node: &Node) -> Option<u8> {
        let told = *self.weights.get(&(node.level, node.index))?;
        let allowed = (node.high - node.low).min_element() * 0.5 * view.placement.stretches().1;
        let holds = self.is_of_steps(view)
            && view.eyes().all(|to| self.view.eyes().any(|from| moved(from, to, &view.placement, node) <= allowed));
        let is_same_step = self.view.time == view.time;
        holds.then_some(if is_same_step { told } else { told.max(1) })
    }
}

/// Displacement of the line of sight to a node, in world units.
fn moved(from: &ViewRays, to: &ViewRays, placement: &Placement, node: &Node) -> f64 {
    match (from.orthographic, to.orthographic) {
        (false, false) => from.eye.distance(to.eye),
        (true, true) => {
            let middle = placement.world_from_volume((node.low + node.high) * 0.5);
            let distance = (middle - to.eye).dot(to.forward).abs();
            from.middle().distance(to.middle()) * distance
        }
        _ => f64::INFINITY,
    }
}

/// 0 for nothing, then 1 to [`OPEN`] by factors of two of the transmittance. NaN counts as visible.
fn octave(transmittance: f32) -> u8 {
    if transmittance <= 0.0 { 0 } else { (OPEN as f32 + transmittance.log2().ceil()).min(OPEN as f32).max(1.0) as u8 }
}

/// Factor on a node's screen-space error: a power of two, 1 in the open.
pub(crate) fn factor(weight: u8) -> f64 {
    (weight as f64 - OPEN as f64).exp2()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cut::Cut;
    use crate::source::BrickSource;
    use crate::test_source::{TestSource, box_view};
    use brickyard_volume::{LevelPolicy, Occupancy, Projection};

    #[test]
    fn what_was_told_holds_near_by_and_adds_up_at_rest() {
        let source = TestSource::cube(64);
        let view = box_view(&source, Projection::Perspective { fov_y_deg: 30.0 });
        let brick = |level, x| view.id(Level(level), BrickIndex::new(x, 0, 0));
        let told = |pairs: &[(BrickId, f32)]| Visibility::new(source.pyramid(), &view, pairs.iter().copied());
        let mut known = told(&[(brick(0, 0), 0.0), (brick(0, 1), 0.5), (brick(1, 1), 0.0)]);
        let node = |level: u8, x: u32| {
            let cut = Cut::new(&source, &View { level: LevelPolicy::Locked(level), ..view.clone() }, 999);
            *cut.nodes.iter().find(|node| (node.level, node.index.to_array()) == (Level(level), [x, 0, 0])).unwrap()
        };
        let expected = |known: &Visibility, view: &View| {
            [(0, 0), (0, 1), (1, 0), (1, 1), (0, 2)].map(|(l, x)| known.weight(view, &node(l, x)))
        };
        // An ancestor is as visible as its most visible cell; a descendant is unknown.
        assert_eq!(expected(&known, &view), [Some(0), Some(8), Some(8), Some(0), None]);
        // Bricks of 8 voxels: 5 to the side is too far for the finest, 9 for their parents, too.
        let aside = |by: f64| {
            let mut aside = view.clone();
            aside.rays.eye += aside.rays.right.normalize() * by;
            expected(&known, &aside)
        };
        assert_eq!(aside(3.0), [Some(0), Some(8), Some(8), Some(0), None]);
        assert_eq!(aside(5.0), [None, None, Some(8), Some(0), None]);
        assert_eq!(aside(9.0), [None; 5]);
        let other_values = View { opaque: Some(Occupancy(1)), ..view.clone() };
        assert_eq!(expected(&known, &other_values), [None; 5]);
        let other_step = View { time: 1, ..view.clone() };
        assert_eq!(expected(&known, &other_step), [Some(1), Some(8), Some(8), Some(1), None]);
        assert!(!known.add(told(&[(brick(0, 1), 0.0), (brick(0, 0), 0.0)])), "what was seen stays seen");
        assert!(known.add(told(&[(brick(0, 0), 1.0)])));
        assert_eq!(expected(&known, &view), [Some(9), Some(8), Some(9), Some(0), None]);
    }

    #[test]
    fn weights_are_octaves() {
        for (transmittance, weight) in [(0.0, 0), (1e-9, 1), (0.25, 7), (0.5, 8), (0.51, 9), (1.0, 9), (f32::NAN, 9)] {
            assert_eq!(octave(transmittance), weight, "{transmittance}");
        }
        assert_eq!((factor(OPEN), factor(OPEN - 2)), (1.0, 0.25));
    }
}
