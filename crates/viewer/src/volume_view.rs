//! The scene's picture in the window, its overlays, and the pointer's actions in it.

use crate::canvas::Canvas;
use crate::clip_handles::{self, Face};
use crate::command::Command;
use crate::drag::drag_by;
use crate::measuring::{self, Measuring};
use crate::overlay::{self, Lens, bricks};
use crate::picking::Picking;
use crate::plane_handles::{self, PlaneHandle};
use crate::state::{State, Tool};
use brickyard::overlay::World;
use brickyard::session::{SessionError, VolumeSource};
use brickyard::volume::{Camera, ClipPlane, Scene};
use eframe::egui::{self, Color32, Key, Painter, PointerButton, Pos2, Rect, Response, Sense, Ui, vec2};
use glam::DVec3;
use serde_json::json;

/// Turn of the volume when dragging over the picture's height.
const TURN_DEG: f64 = 180.0;

/// Turn of the eye when dragging over the picture's height.
const LOOK_DEG: f64 = 60.0;

/// Flight per second, as a share of the eye's distance from the volumes.
const FLIGHT: f64 = 0.8;

/// Flight keys with their directions: right, up, forward.
pub(crate) const FLIGHT_KEYS: [(Key, [f64; 3]); 6] = [
    (Key::W, [0.0, 0.0, 1.0]),
    (Key::S, [0.0, 0.0, -1.0]),
    (Key::A, [-1.0, 0.0, 0.0]),
    (Key::D, [1.0, 0.0, 0.0]),
    (Key::E, [0.0, 1.0, 0.0]),
    (Key::Q, [0.0, -1.0, 0.0]),
];

/// The subject of a view: the window's state, and its volumes.
pub(crate) struct Seen<'a> {
    pub(crate) state: &'a State,
    pub(crate) volumes: &'a [VolumeSource],
    /// Their world; `None` if no layer has a place.
    pub(crate) world: Option<World<'a>>,
}

/// The object of a drag.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Hold {
    /// The volumes, turned around a point; `None` is the camera's target.
    Turn(Option<DVec3>),
    /// The view's direction.
    Look,
    /// The picture, rolled.
    Roll,
    /// The volumes, moved.
    Pan,
    /// The distance from the volumes.
    Zoom,
    /// A face of the clip box.
    Face(Face),
    /// A handle of a clip plane.
    Plane(PlaneHandle),
}

/// The scene's picture in the window.
#[derive(Default)]
pub(crate) struct VolumeView {
    /// The picture's size in the last frame.
    pub(crate) size_px: (u32, u32),
    hold: Option<Hold>,
    pub(crate) picking: Picking,
}

impl VolumeView {
    /// Shows the scene's picture in the rest of `ui`, and turns the pointer's actions into commands.
    ///
    /// # Errors
    /// If the picture cannot be advanced; it stays as it was.
    pub(crate) fn show(
        &mut self,
        ui: &mut Ui,
        canvas: &mut Canvas,
        seen: &Seen<'_>,
        measuring: &mut Measuring,
        commands: &mut Vec<Command>,
    ) -> Result<(), SessionError> {
        let (size_px, shown) = whole_pixels(ui);
        self.size_px = size_px;
        let drawn = canvas.show(&seen.state.scene, size_px);
        let (area, response) = ui.allocate_exact_size(shown, Sense::click_and_drag());
        canvas.paint(ui.painter(), area);
        dim_failed(ui.painter(), canvas, area);
        let Some(camera) = seen.state.scene.camera else { return drawn };
        // The picture may be of the previous camera: marks lie on the picture, and the pointer touches it.
        let shown = canvas.camera().unwrap_or(camera);
        let Some(lens) = Lens::new(ui.painter(), area, &shown, size_px) else { return drawn };
        self.decorate(&lens, &shown, canvas, seen, measuring, response.hover_pos());
        if self.hold.is_none() {
            self.picking.look(canvas, &lens, &response);
        }
        commands.extend(self.dragged(&lens, seen, &response));
        commands.extend(self.clicked(&lens, seen, measuring, &response));
        if response.hovered() {
            commands.extend(scrolled(ui, &lens));
        }
        if seen.state.window.tool == Tool::Fly {
            commands.extend(flown(ui));
        }
        drawn
    }

    /// Draws over a picture of this camera.
    fn decorate(
        &self,
        lens: &Lens,
        camera: &Camera,
        canvas: &Canvas,
        seen: &Seen<'_>,
        measuring: &Measuring,
        pointer: Option<Pos2>,
    ) {
        let (scene, window) = (&seen.state.scene, &seen.state.window);
        let Some(world) = &seen.world else { return };
        if window.overlays.bricks {
            bricks::show(lens, scene, seen.volumes, &canvas.draw_lists());
        }
        overlay::show(lens, &window.overlays, scene, camera, seen.volumes, world);
        overlay::distances(lens, &window.distances, world.unit);
        measuring.show(lens, self.end(lens, seen, measuring, pointer), world.unit);
        if window.overlays.clip_handles {
            let near = self.hold.or_else(|| pointer.and_then(|pointer| handle(lens, scene, world, pointer)));
            let (face, plane) = match near {
                Some(Hold::Face(face)) => (Some(face), None),
                Some(Hold::Plane(plane)) => (None, Some(plane)),
                _ => (None, None),
            };
            scene.clip.iter().for_each(|clip| clip_handles::show(lens, *clip, face));
            plane_handles::show(lens, &scene.clip_planes, world.corners, plane);
        }
    }

    /// The visible world point under the pointer, if any.
    fn point(&self) -> Option<DVec3> {
        self.picking.picked.as_ref().map(|picked| picked.pick.point)
    }

    /// The object of a drag that starts here.
    fn grasp(&self, lens: &Lens, seen: &Seen<'_>, response: &Response, from: Pos2) -> Hold {
        let (scene, window) = (&seen.state.scene, &seen.state.window);
        let modifiers = response.ctx.input(|input| input.modifiers);
        let world = seen.world.as_ref().filter(|_| window.overlays.clip_handles);
        let handle = world.and_then(|world| handle(lens, scene, world, from));
        if response.dragged_by(PointerButton::Secondary) {
            return Hold::Zoom;
        }
        if response.dragged_by(PointerButton::Middle) || modifiers.shift {
            return Hold::Pan;
        }
        match (handle, modifiers.command, window.tool) {
            (Some(handle), ..) => handle,
            (None, true, _) => Hold::Roll,
            (None, false, Tool::Fly) => Hold::Look,
            (None, false, _) => Hold::Turn(self.point()),
        }
    }

    fn dragged(&mut self, lens: &Lens, seen: &Seen<'_>, response: &Response) -> Option<Command> {
        if response.drag_started() {
            let from = response.ctx.input(|input| input.pointer.press_origin());
            let from = from.or_else(|| response.interact_pointer_pos()).unwrap_or(lens.area.center());
            self.hold = Some(self.grasp(lens, seen, response, from));
        }
        if !response.dragged() {
            self.hold = None;
        }
        let by = drag_by(response);
        let hold = self.hold.filter(|_| by != egui::Vec2::ZERO)?;
        let parts = by / lens.area.height().max(1.0);
        let (right, down) = (f64::from(parts.x), f64::from(parts.y));
        let whole = seen.world.as_ref().map(|world| world.corners);
        Some(match hold {
            Hold::Turn(about) => Command::Orbit { right_deg: TURN_DEG * right, up_deg: -TURN_DEG * down, about },
            Hold::Look => Command::Look { right_deg: LOOK_DEG * right, up_deg: -LOOK_DEG * down },
            Hold::Roll => Command::Roll { angle_deg: TURN_DEG * right },
            Hold::Pan => Command::Pan { right, up: -down },
            Hold::Zoom => Command::Zoom { factor: (-2.0 * down).exp(), at: None },
            Hold::Face(face) => {
                let clip = clip_handles::dragged(lens, seen.state.scene.clip?, face, by, whole?);
                Command::set("clip", json!(clip))
            }
            Hold::Plane(PlaneHandle { plane: i, is_tip }) => {
                let plane = *seen.state.scene.clip_planes.get(i)?;
                let ClipPlane { point, normal } = plane_handles::dragged(lens, plane, is_tip, by, whole?);
                let field = |name: &str, value: DVec3| (format!("clip_planes.{i}.{name}"), json!(value));
                Command::Set(vec![field("point", point), field("normal", normal)])
            }
        })
    }

    /// The place under the pointer where a distance would start or end.
    fn end(&self, lens: &Lens, seen: &Seen<'_>, measuring: &Measuring, pointer: Option<Pos2>) -> Option<DVec3> {
        let place_px = pointer.map(|pointer| lens.pixel(pointer));
        measuring::end(&seen.state.scene, &lens.rays, measuring.from(), place_px, self.point())
    }

    fn clicked(&self, lens: &Lens, seen: &Seen<'_>, measuring: &mut Measuring, response: &Response) -> Option<Command> {
        if response.clicked() && response.ctx.input(|input| input.modifiers.alt) {
            return isolation(seen, &self.picking);
        }
        match seen.state.window.tool {
            Tool::Turn if response.double_clicked() => Some(self.point().map_or(Command::Fit, Command::Center)),
            Tool::Distance if response.clicked() => {
                // The mark of the first click appears in the next frame, which nothing else may request.
                response.ctx.request_repaint();
                let place = self.end(lens, seen, measuring, response.interact_pointer_pos())?;
                measuring.click(place, seen.state)
            }
            _ => None,
        }
    }
}

/// Dims a picture that stands in for a failed one.
pub(crate) fn dim_failed(painter: &Painter, canvas: &Canvas, area: Rect) {
    if canvas.is_failing() {
        painter.rect_filled(area, 0.0, Color32::from_black_alpha(160));
    }
}

/// The handle at a place, of the clip box or of a clip plane.
fn handle(lens: &Lens, scene: &Scene, world: &World<'_>, place: Pos2) -> Option<Hold> {
    let face = scene.clip.and_then(|clip| clip_handles::at(lens, clip, place)).map(Hold::Face);
    face.or_else(|| plane_handles::at(lens, &scene.clip_planes, world.corners, place).map(Hold::Plane))
}

/// Shows the picked label alone, or all labels if it is alone already.
pub(crate) fn isolation(seen: &Seen<'_>, picking: &Picking) -> Option<Command> {
    let picked = picking.picked.as_ref()?;
    let (layer, label) = (picked.pick.layer, picked.label?);
    let is_alone = seen.state.scene.layers.get(layer)?.show_labels == Some(vec![label]);
    let shown = if is_alone { json!(null) } else { json!([label]) };
    Some(Command::set(&format!("layers.{layer}.show_labels"), shown))
}

/// The rest of a part of the window, in whole pixels and in points.
pub(crate) fn whole_pixels(ui: &Ui) -> ((u32, u32), egui::Vec2) {
    let scale = ui.ctx().pixels_per_point();
    let size = ui.available_size();
    let pixels = |points: f32| ((points * scale).floor() as u32).max(1);
    let size_px = (pixels(size.x), pixels(size.y));
    (size_px, vec2(size_px.0 as f32, size_px.1 as f32) / scale)
}

/// Zooms towards the pointer, by wheel and pinch.
fn scrolled(ui: &Ui, lens: &Lens) -> Option<Command> {
    let (wheel, pinch, pointer) =
        ui.input(|input| (input.smooth_scroll_delta().y, input.zoom_delta(), input.pointer.hover_pos()));
    let factor = f64::from(pinch) * (f64::from(wheel) / 200.0).exp();
    let pointer = pointer.filter(|_| factor != 1.0)?;
    let place = (pointer - lens.area.min) / lens.area.size();
    Some(Command::Zoom { factor, at: Some([f64::from(place.x), f64::from(place.y)]) })
}

/// Flies while flight keys are held.
fn flown(ui: &Ui) -> Option<Command> {
    if ui.ctx().egui_wants_keyboard_input() {
        return None;
    }
    let (by, seconds) = ui.input(|input| {
        let held = FLIGHT_KEYS.iter().filter(|(key, _)| input.key_down(*key) && input.modifiers.is_none());
        let by = held.fold(DVec3::ZERO, |sum, (_, by)| sum + DVec3::from_array(*by));
        (by, f64::from(input.stable_dt.min(0.1)))
    });
    let [right, up, forward] = (by * FLIGHT * seconds).to_array();
    (by != DVec3::ZERO).then_some(Command::Fly { right, up, forward })
}
