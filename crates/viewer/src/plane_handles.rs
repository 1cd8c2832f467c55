//! Handles of clip planes: a dot in the middle of the plane's section moves the plane, and the tip of its normal turns it. Their places in a picture,
//! the one under the pointer, and the plane after a drag.

use crate::clip_handles::{COLOR, HANDLE, REACH};
use crate::overlay::Lens;
use brickyard::overlay::box_axes;
use brickyard::volume::ClipPlane;
use eframe::egui::{Pos2, Shape, Stroke, Vec2};
use glam::DVec3;

/// Length of normals, as a share of the box's diagonal.
const LENGTH: f64 = 0.15;

/// A handle of a clip plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct PlaneHandle {
    /// Index of the plane in the scene.
    pub(crate) plane: usize,
    /// Whether it is the tip of the normal.
    pub(crate) is_tip: bool,
}

/// Section of a box by a plane: the polygon's corners in order, its middle, and the tip of the normal there; `None` if empty.
struct Cut {
    corners: Vec<DVec3>,
    middle: DVec3,
    tip: DVec3,
}

impl Cut {
    fn of(plane: &ClipPlane, whole: (DVec3, DVec3)) -> Option<Self> {
        let normal = plane.normalized().ok()?.normal;
        let crossings = box_axes::edges(whole).filter_map(|[a, b]| {
            let (low, high) = (plane.height(a), plane.height(b));
            ((low <= 0.0) != (high <= 0.0)).then(|| a + (b - a) * (low / (low - high)))
        });
        let mut corners: Vec<DVec3> = crossings.collect();
        if corners.len() < 3 {
            return None;
        }
        let middle = corners.iter().sum::<DVec3>() / corners.len() as f64;
        let right = normal.any_orthonormal_vector();
        let angle = |corner: &DVec3| {
            let from_middle = *corner - middle;
            f64::atan2(from_middle.dot(normal.cross(right)), from_middle.dot(right))
        };
        corners.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
        let tip = middle + normal * (LENGTH * whole.0.distance(whole.1));
        Some(Self { corners, middle, tip })
    }

    fn place(&self, is_tip: bool) -> DVec3 {
        if is_tip { self.tip } else { self.middle }
    }
}

/// Draws planes with their handles; the one under the pointer or dragged is larger.
pub(crate) fn show(lens: &Lens, planes: &[ClipPlane], whole: (DVec3, DVec3), near: Option<PlaneHandle>) {
    for (i, plane) in planes.iter().enumerate() {
        let Some(cut) = Cut::of(plane, whole) else { continue };
        let line = Stroke::new(1.0, COLOR.gamma_multiply(0.7));
        for (k, corner) in cut.corners.iter().enumerate() {
            lens.line(*corner, cut.corners[(k + 1) % cut.corners.len()], line);
        }
        lens.line(cut.middle, cut.tip, Stroke::new(2.0, HANDLE));
        for is_tip in [false, true] {
            let Some(place) = lens.place(cut.place(is_tip)) else { continue };
            let radius = if near == Some(PlaneHandle { plane: i, is_tip }) { 7.0 } else { 4.5 };
            let edge = Stroke::new(1.5, COLOR);
            lens.painter.add(match is_tip {
                false => Shape::circle_filled(place, radius, HANDLE),
                true => {
                    let corners = [[0.0, -1.3], [1.3, 0.0], [0.0, 1.3], [-1.3, 0.0]];
                    let corners = corners.map(|[x, y]| place + radius * Vec2::new(x, y));
                    Shape::convex_polygon(corners.to_vec(), HANDLE, edge)
                }
            });
            if !is_tip {
                lens.painter.circle_stroke(place, radius, edge);
            }
        }
    }
}

/// The nearest handle within reach.
pub(crate) fn at(lens: &Lens, planes: &[ClipPlane], whole: (DVec3, DVec3), pointer: Pos2) -> Option<PlaneHandle> {
    let cuts = planes.iter().enumerate().filter_map(|(plane, it)| Some((plane, Cut::of(it, whole)?)));
    let handles =
        cuts.flat_map(|(plane, cut)| [false, true].map(|is_tip| (PlaneHandle { plane, is_tip }, cut.place(is_tip))));
    lens.nearest(handles, pointer, REACH)
}

/// The plane after dragging a handle by `by` points. It stays as it was rather than miss the box.
pub(crate) fn dragged(lens: &Lens, plane: ClipPlane, is_tip: bool, by: Vec2, whole: (DVec3, DVec3)) -> ClipPlane {
    let Some(Cut { middle, tip, .. }) = Cut::of(&plane, whole) else { return plane };
    let small = 1e-3 * whole.0.distance(whole.1);
    let moved = if is_tip {
        // The tip goes with the pointer, in the plane of the picture.
        let [right, up] = [lens.rays.right, lens.rays.up].map(DVec3::normalize_or_zero);
        let rate = |direction: DVec3| lens.rate(tip, direction, small);
        let (Some(of_right), Some(of_up)) = (rate(right), rate(up)) else { return plane };
        let [x, y] = [(by.x, of_right.x), (by.y, of_up.y)].map(|(by, rate)| f64::from(by) / f64::from(rate));
        let normal = (tip + right * x + up * y - middle).normalize_or_zero();
        ClipPlane { point: middle, normal }
    } else {
        let normal = plane.normal.normalize_or_zero();
        let Some(by) = lens.distance(middle, normal, small, by) else { return plane };
        ClipPlane { point: plane.point + normal * by, ..plane }
    };
    let is_fit = moved.point.is_finite() && moved.normal.is_finite() && Cut::of(&moved, whole).is_some();
    if is_fit { moved } else { plane }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clip_handles::tests::{WHOLE, lens};
    use eframe::egui::vec2;

    const PLANE: ClipPlane = ClipPlane { point: DVec3::new(1.0, 7.0, 9.0), normal: DVec3::new(3.0, 0.0, 0.0) };

    #[test]
    fn a_plane_follows_the_pointer() {
        let lens = lens();
        let place = lens.place(DVec3::new(1.0, 1.0, 0.5)).unwrap();
        let of = |is_tip| Some(PlaneHandle { plane: 0, is_tip });
        assert_eq!(at(&lens, &[PLANE], WHOLE, place + vec2(-3.0, 3.0)), of(false));
        let tip = place + vec2(100.0 * (LENGTH * WHOLE.1.length()) as f32, 0.0);
        assert_eq!(at(&lens, &[PLANE], WHOLE, tip), of(true));
        assert_eq!(at(&lens, &[PLANE], WHOLE, place + vec2(0.0, 40.0)), None);
        let moved = dragged(&lens, PLANE, false, vec2(150.0, 40.0), WHOLE);
        assert!((moved.point - DVec3::new(2.5, 7.0, 9.0)).length() < 1e-3 && moved.normal == PLANE.normal);
    }

    #[test]
    fn a_normal_follows_the_pointer() {
        let length = 100.0 * (LENGTH * WHOLE.1.length()) as f32;
        // The tip goes up by the length of the normal: half a right angle.
        let turned = dragged(&lens(), PLANE, true, vec2(0.0, -length), WHOLE);
        assert!((turned.normal - DVec3::new(1.0, 0.0, 1.0).normalize()).length() < 1e-3, "{turned:?}");
        assert!((turned.point - DVec3::new(1.0, 1.0, 0.5)).length() < 1e-9, "it turns about its middle: {turned:?}");
    }

    #[test]
    fn a_plane_goes_on_cutting_something() {
        for is_tip in [false, true] {
            for by in [vec2(9e3, 9e3), vec2(-9e3, 0.0), vec2(f32::NAN, 0.0), Vec2::ZERO] {
                let found = dragged(&lens(), PLANE, is_tip, by, WHOLE);
                assert!(Cut::of(&found, WHOLE).is_some(), "{is_tip} {by:?}: {found:?}");
            }
        }
        let beside = ClipPlane { point: DVec3::new(9.0, 0.0, 0.0), ..PLANE };
        assert_eq!(at(&lens(), &[beside], WHOLE, lens().place(beside.point).unwrap()), None);
        assert_eq!(dragged(&lens(), beside, false, vec2(50.0, 0.0), WHOLE), beside);
    }
}
