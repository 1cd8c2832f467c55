//! Extrapolated camera motion.
//!
//! The eye's velocity and turning rate over the last views are held: the eye continues on an arc that turns with the camera,
//! exact for a straight flight and, but for the chord, for an orbit. A pure function of the views and their times.

use brickyard_volume::ViewRays;
use glam::{DMat3, DQuat, DVec3};
use std::collections::VecDeque;
use std::time::Duration;

/// Look-back time, always including the last view: long enough to even out uneven frames.
const WINDOW: Duration = Duration::from_millis(150);

/// Time without a new view after which the camera is at rest.
const REST: Duration = Duration::from_millis(1000);

/// Largest extrapolated turn, in radians; beyond it a camera is thrown about rather than turned.
const MOST_TURN: f64 = 1.0;

/// Cameras of the last frames, for foreseeing the next ones.
#[derive(Debug, Default)]
pub(crate) struct Motion {
    /// Oldest first.
    past: VecDeque<(Duration, ViewRays)>,
}

impl Motion {
    pub(crate) fn see(&mut self, at: Duration, rays: &ViewRays) {
        if self.past.back().is_some_and(|(last, _)| at < *last || at - *last > REST) {
            self.past.clear();
        }
        self.past.push_back((at, *rays));
        while self.past.len() > 2 && self.past.get(1).is_some_and(|(time, _)| at - *time >= WINDOW) {
            self.past.pop_front();
        }
    }

    /// Expected camera at a time `ahead`, plus one frame, after the last view; `None` if the camera is at rest, has changed its
    /// projection, or has too few views.
    pub(crate) fn foresee(&self, ahead: Duration) -> Option<ViewRays> {
        let ((first, from), (last, to)) = (self.past.front()?, self.past.back()?);
        let (_, before) = self.past.iter().rev().nth(1)?;
        let seconds = (*last - *first).as_secs_f64();
        if before == to || seconds <= 0.0 || from.orthographic != to.orthographic {
            return None;
        }
        let frame = seconds / (self.past.len() - 1) as f64;
        let steps = (ahead.as_secs_f64() + frame) / seconds;
        let turn = (orientation(to) * orientation(from).inverse()).normalize();
        let (axis, angle) = turn.to_axis_angle();
        let angle = if angle > std::f64::consts::PI { angle - std::f64::consts::TAU } else { angle };
        let part = |steps: f64| DQuat::from_axis_angle(axis, (angle * steps).clamp(-MOST_TURN, MOST_TURN));
        // The way so far points along its middle; the way ahead, along its own.
        let way = part((1.0 + steps) * 0.5) * (to.eye - from.eye) * steps;
        let turn = part(steps);
        let rays =
            ViewRays { eye: to.eye + way, forward: turn * to.forward, right: turn * to.right, up: turn * to.up, ..*to };
        (rays.eye.is_finite() && rays.forward.is_finite()).then_some(rays)
    }
}

fn orientation(rays: &ViewRays) -> DQuat {
    let axis = |v: DVec3| v.normalize_or_zero();
    DQuat::from_mat3(&DMat3::from_cols(axis(rays.right), axis(rays.up), axis(-rays.forward)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_volume::{Camera, Projection};

    fn camera() -> Camera {
        let projection = Projection::Perspective { fov_y_deg: 40.0 };
        Camera { eye: DVec3::new(10.0, 0.0, 2.0), target: DVec3::ZERO, up: DVec3::Z, projection }
    }

    fn at(frame: u32) -> Duration {
        Duration::from_millis(50) * frame
    }

    fn foreseen(camera: impl Fn(f64) -> Camera) -> (ViewRays, ViewRays) {
        let rays = |frame: f64| camera(frame).rays(64, 48).unwrap();
        let mut motion = Motion::default();
        (0..8).for_each(|frame| motion.see(at(frame), &rays(frame as f64)));
        // Six frames of 50 ms, and one.
        (motion.foresee(Duration::from_millis(300)).unwrap(), rays(14.0))
    }

    #[test]
    fn a_straight_flight_goes_on() {
        let way = DVec3::new(0.5, -0.25, 0.125);
        let (foreseen, then) = foreseen(|frame| {
            let (eye, target) = (camera().eye + way * frame, way * frame);
            Camera { eye, target, ..camera() }
        });
        assert!(foreseen.eye.distance(then.eye) < 1e-9 && foreseen.forward.distance(then.forward) < 1e-9);
    }

    #[test]
    fn an_orbit_goes_on_round() {
        let (foreseen, then) = foreseen(|frame| camera().orbited(3.0 * frame));
        // The way ahead is 21 degrees of arc, 3.7 long; its chord is 0.5 % shorter.
        assert!(foreseen.eye.distance(then.eye) < 0.05, "{} {}", foreseen.eye, then.eye);
        assert!(foreseen.forward.distance(then.forward) < 1e-9);
        assert!((foreseen.right - then.right).length() < 1e-9 && (foreseen.up - then.up).length() < 1e-9);
    }

    #[test]
    fn a_camera_at_rest_stays() {
        let rays = camera().rays(64, 48).unwrap();
        let moved = ViewRays { eye: rays.eye * 1.1, ..rays };
        let mut motion = Motion::default();
        let ahead = Duration::from_millis(300);
        assert_eq!(motion.foresee(ahead), None);
        for (frame, rays, moves) in [(0, rays, false), (1, moved, true), (2, moved, false), (60, rays, false)] {
            motion.see(at(frame), &rays);
            assert_eq!(motion.foresee(ahead).is_some(), moves, "{frame}");
        }
        // Without times there is no speed.
        let mut still = Motion::default();
        [rays, moved].iter().for_each(|rays| still.see(Duration::ZERO, rays));
        assert_eq!(still.foresee(ahead), None);
    }
}
