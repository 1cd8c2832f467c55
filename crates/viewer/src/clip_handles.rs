//! Handles on the faces of the clip box: their places in a picture, the one under the pointer, and the box after a drag.

use crate::overlay::Lens;
use eframe::egui::{Color32, Pos2, Stroke, Vec2};
use glam::DVec3;

/// Grasping radius of a handle, in points.
pub(crate) const REACH: f32 = 9.0;

/// Least thickness of the box, as a share of all volumes along an axis.
const THINNEST: f64 = 1e-3;

/// Colours of lines and edges, and of handles.
pub(crate) const COLOR: Color32 = Color32::WHITE;
pub(crate) const HANDLE: Color32 = Color32::from_rgb(240, 150, 40);

/// A face of a box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Face {
    /// The axis across the face.
    pub(crate) axis: usize,
    /// Whether it is at the greatest coordinate.
    pub(crate) is_high: bool,
}

impl Face {
    fn all() -> impl Iterator<Item = Self> {
        (0..3).flat_map(|axis| [false, true].map(|is_high| Self { axis, is_high }))
    }

    fn middle(self, [low, high]: [DVec3; 2]) -> DVec3 {
        let mut middle = (low + high) * 0.5;
        middle[self.axis] = if self.is_high { high[self.axis] } else { low[self.axis] };
        middle
    }
}

/// Draws a clip box with its handles; the one under the pointer or dragged is larger.
pub(crate) fn show(lens: &Lens, clip: [DVec3; 2], near: Option<Face>) {
    lens.edges((clip[0], clip[1]), Stroke::new(1.0, COLOR.gamma_multiply(0.7)));
    for face in Face::all() {
        let Some(place) = lens.place(face.middle(clip)) else { continue };
        let radius = if near == Some(face) { 7.0 } else { 4.5 };
        lens.painter.circle(place, radius, HANDLE, Stroke::new(1.5, COLOR));
    }
}

/// The nearest handle within reach.
pub(crate) fn at(lens: &Lens, clip: [DVec3; 2], pointer: Pos2) -> Option<Face> {
    lens.nearest(Face::all().map(|face| (face, face.middle(clip))), pointer, REACH)
}

/// The box after dragging a face of `clip` by `by` points. It stays within the volumes' box and keeps some thickness.
pub(crate) fn dragged(lens: &Lens, clip: [DVec3; 2], face: Face, by: Vec2, whole: (DVec3, DVec3)) -> [DVec3; 2] {
    let axis = face.axis;
    let size = whole.1[axis] - whole.0[axis];
    let moved = lens.distance(face.middle(clip), DVec3::AXES[axis], 1e-3 * size, by);
    let Some(moved) = moved else { return clip };
    let thinnest = THINNEST * size;
    let [mut low, mut high] = clip;
    if face.is_high {
        high[axis] = (high[axis] + moved).clamp((low[axis] + thinnest).min(whole.1[axis]), whole.1[axis]);
    } else {
        low[axis] = (low[axis] + moved).clamp(whole.0[axis], (high[axis] - thinnest).max(whole.0[axis]));
    }
    [low, high]
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use brickyard::volume::{Camera, Projection};
    use eframe::egui::{Context, LayerId, Painter, Rect, pos2, vec2};

    pub(crate) const WHOLE: (DVec3, DVec3) = (DVec3::ZERO, DVec3::new(4.0, 2.0, 1.0));

    /// Looks along y at the box, at 100 points per world unit.
    pub(crate) fn lens() -> Lens {
        let target = DVec3::new(2.0, 1.0, 0.5);
        let projection = Projection::Orthographic { height: 3.0 };
        let camera = Camera { eye: target - 9.0 * DVec3::Y, target, up: DVec3::Z, projection };
        let painter = Painter::new(Context::default(), LayerId::background(), Rect::EVERYTHING);
        let area = Rect::from_min_size(pos2(50.0, 20.0), vec2(600.0, 300.0));
        Lens::new(&painter, area, &camera, (1200, 600)).unwrap()
    }

    #[test]
    fn a_face_follows_the_pointer() {
        let (lens, clip) = (lens(), [WHOLE.0, WHOLE.1]);
        let face = Face { axis: 0, is_high: true };
        let place = lens.place(DVec3::new(4.0, 1.0, 0.5)).unwrap();
        assert_eq!(at(&lens, clip, place + vec2(3.0, -3.0)), Some(face));
        assert_eq!(at(&lens, clip, place + vec2(60.0, 0.0)), None);
        let found = dragged(&lens, clip, face, vec2(-150.0, 40.0), WHOLE);
        assert!((found[1] - DVec3::new(2.5, 2.0, 1.0)).length() < 1e-3 && found[0] == clip[0], "{found:?}");
        let up = dragged(&lens, clip, Face { axis: 2, is_high: false }, vec2(0.0, -30.0), WHOLE);
        assert!((up[0].z - 0.3).abs() < 1e-3, "{up:?}");
    }

    #[test]
    fn the_box_stays_a_box() {
        let (lens, clip) = (lens(), [WHOLE.0, WHOLE.1]);
        for face in Face::all() {
            for by in [vec2(9e3, 9e3), vec2(-9e3, -9e3), vec2(9e3, -9e3), Vec2::ZERO] {
                let [low, high] = dragged(&lens, clip, face, by, WHOLE);
                assert!(
                    low.cmplt(high).all() && low.cmpge(WHOLE.0).all() && high.cmple(WHOLE.1).all(),
                    "{face:?} {by:?}"
                );
            }
        }
        // Seen along its axis, a face cannot be dragged.
        let along = Face { axis: 1, is_high: true };
        assert_eq!(dragged(&lens, clip, along, vec2(50.0, 50.0), WHOLE), clip);
    }
}
