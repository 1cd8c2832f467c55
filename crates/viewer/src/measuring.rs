//! Measuring: one click starts a distance and the next one ends it; it then stays as a field of the window's document. A slice takes only places on
//! it, so its lengths are true. A projection has no places along its rays: there, distances run across the view.

use crate::command::Command;
use crate::navigation::point_at_depth_of;
use crate::overlay::{self, Lens};
use crate::state::{State, Tool};
use brickyard::volume::{Scene, Slice, ViewRays};
use glam::DVec3;
use serde_json::json;

/// A distance measurement in progress.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Measuring {
    from: Option<DVec3>,
}

impl Measuring {
    /// Drops a started distance unless the tool measures.
    pub(crate) fn suit(&mut self, tool: Tool) {
        if tool != Tool::Distance {
            self.from = None;
        }
    }

    pub(crate) fn from(&self) -> Option<DVec3> {
        self.from
    }

    /// Takes a click: the start of a distance, or its end.
    pub(crate) fn click(&mut self, place: DVec3, state: &State) -> Option<Command> {
        let Some(from) = self.from.take() else {
            self.from = Some(place);
            return None;
        };
        let distances = [&state.window.distances[..], &[[from, place]]].concat();
        Some(Command::set("window.distances", json!(distances)))
    }

    /// Takes a click in a slice as the end of a distance, restarting one that started beside the slice.
    pub(crate) fn click_in(&mut self, slice: &Slice, reach: f64, place: DVec3, state: &State) -> Option<Command> {
        self.from = self.from.filter(|from| is_in(slice, reach, *from));
        self.click(place, state)
    }

    /// Whether a started distance lies in a slice so far.
    pub(crate) fn is_in(&self, slice: &Slice, reach: f64) -> bool {
        self.from.is_some_and(|from| is_in(slice, reach, from))
    }

    /// Draws the mark at the start, and the line to the current end.
    pub(crate) fn show(&self, lens: &Lens, to: Option<DVec3>, unit: &str) {
        let Some(from) = self.from else { return };
        overlay::beginning(lens, from);
        overlay::distances(lens, to.map(|to| [from, to]).as_slice(), unit);
    }
}

/// Whether a point is in a slice of this `reach` to both sides.
fn is_in(slice: &Slice, reach: f64, point: DVec3) -> bool {
    (point - slice.point).dot(slice.normal).abs() <= reach
}

/// The distances lying in a slice.
pub(crate) fn lying_in(distances: &[[DVec3; 2]], slice: &Slice, reach: f64) -> Vec<[DVec3; 2]> {
    distances.iter().filter(|ends| ends.iter().all(|end| is_in(slice, reach, *end))).copied().collect()
}

/// The end of a distance from `from`, at a place of a scene's picture with `picked` under it. In a projection it is the ray's crossing with the
/// plane through `from` parallel to the picture: extremes lie at invisible depths.
pub(crate) fn end(
    scene: &Scene,
    rays: &ViewRays,
    from: Option<DVec3>,
    place_px: Option<[f64; 2]>,
    picked: Option<DVec3>,
) -> Option<DVec3> {
    let Some(from) = from.filter(|_| scene.mode.is_projection() && scene.slice.is_none()) else { return picked };
    Some(point_at_depth_of(from, rays, place_px?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard::volume::{Camera, Mode};

    fn state() -> State {
        let mut state = State::default();
        state.window.distances = vec![[DVec3::ZERO, DVec3::X]];
        state
    }

    #[test]
    fn two_clicks_are_a_distance() {
        let mut measuring = Measuring::default();
        assert_eq!(measuring.click(DVec3::Y, &state()), None);
        measuring.suit(Tool::Distance);
        assert_eq!(measuring.from(), Some(DVec3::Y));
        let both = json!([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]]);
        assert_eq!(measuring.click(DVec3::Z, &state()), Some(Command::set("window.distances", both)));
        assert_eq!(measuring.from(), None);
        measuring.click(DVec3::Y, &state());
        measuring.suit(Tool::Turn);
        assert_eq!(measuring.from(), None);
    }

    #[test]
    fn a_slice_has_the_distances_that_lie_in_it() {
        let slice = Slice { point: DVec3::new(0.0, 0.0, 4.0), normal: DVec3::Z, thickness: 0.0 };
        let at = |x: f64, z: f64| DVec3::new(x, 0.0, z);
        let inside = [at(0.0, 4.2), at(5.0, 3.6)];
        assert_eq!(lying_in(&[inside, [at(0.0, 4.0), at(5.0, 9.0)]], &slice, 0.5), [inside]);
        let mut measuring = Measuring::default();
        assert_eq!(measuring.click(at(1.0, 9.0), &state()), None);
        assert_eq!(measuring.click_in(&slice, 0.5, at(2.0, 4.0), &state()), None, "it was begun in another slice");
        assert_eq!(measuring.from(), Some(at(2.0, 4.0)));
        assert!(measuring.click_in(&slice, 0.5, at(3.0, 4.0), &state()).is_some());
    }

    #[test]
    fn a_distance_in_a_projection_is_one_across_the_view() {
        let camera = Camera::looking_from(DVec3::Z, DVec3::Y, (DVec3::splat(-1.0), DVec3::ONE));
        let rays = camera.rays(300, 200).unwrap();
        let (from, hidden) = (DVec3::new(-0.2, 0.0, 0.7), DVec3::new(0.3, 0.1, -0.6));
        let place_px = rays.pixel(hidden);
        for mode in [Mode::Mip, Mode::MinIp, Mode::Average] {
            let scene = Scene { mode, ..Scene::default() };
            let found = end(&scene, &rays, Some(from), place_px, Some(hidden)).unwrap();
            assert!((found - from).dot(rays.forward).abs() < 1e-9, "{found}");
            let seen = rays.pixel(found).unwrap();
            assert!(seen.iter().zip(place_px.unwrap()).all(|(a, b)| (a - b).abs() < 1e-6), "{seen:?}");
            // The first end is at the extreme; beside the volume there is an end, too.
            assert_eq!(end(&scene, &rays, None, place_px, Some(hidden)), Some(hidden));
            assert!(end(&scene, &rays, Some(from), Some([1.0, 1.0]), None).is_some());
        }
        let fog = Scene::default();
        assert_eq!(end(&fog, &rays, Some(from), place_px, Some(hidden)), Some(hidden));
    }
}
