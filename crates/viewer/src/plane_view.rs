//! A slice in the window, one of three through a common point: its picture, the lines of the other two, and the pointer's actions in it.

use crate::canvas::Canvas;
use crate::command::Command;
use crate::drag::drag_by;
use crate::measuring::{Measuring, lying_in};
use crate::navigation::{panned, point_at_target, zoomed};
use crate::overlay::{self, AXIS_COLORS, Lens};
use crate::panels::slices::{dragged, shown_window, window_unit};
use crate::picking::Picking;
use crate::planes::{Grid, filter, slice_scene};
use crate::state::{State, Tool};
use crate::volume_view::{Seen, dim_failed, isolation, whole_pixels};
use brickyard::session::SessionError;
use brickyard::volume::numbers::within_span;
use brickyard::volume::units::with_unit;
use brickyard::volume::{Camera, ClipPlane, Slice};
use eframe::egui::{
    Align2, Color32, Event, MouseWheelUnit, PointerButton, Pos2, Response, Sense, Stroke, Ui, Vec2, vec2,
};
use glam::DVec3;
use serde_json::json;

/// Motion of two fingers for one slice, in points.
const POINTS_A_SLICE: f32 = 24.0;

/// A slice in the window.
pub(crate) struct PlaneView {
    axis: usize,
    pub(crate) picking: Picking,
    /// Finger motion towards the next slice, in points.
    rolled: f32,
}

impl PlaneView {
    pub(crate) fn across(axis: usize) -> Self {
        Self { axis, picking: Picking::default(), rolled: 0.0 }
    }

    /// Shows the slice of a grid in the rest of `ui`, and turns the pointer's actions into commands.
    ///
    /// # Errors
    /// If the picture cannot be advanced; it stays as it was.
    pub(crate) fn show(
        &mut self,
        ui: &mut Ui,
        canvas: &mut Canvas,
        grid: &Grid,
        seen: &Seen<'_>,
        measuring: &mut Measuring,
        commands: &mut Vec<Command>,
    ) -> Result<(), SessionError> {
        let (axis, planes) = (self.axis, &seen.state.window.planes);
        let (size_px, shown) = whole_pixels(ui);
        let point = grid.crosshair(planes);
        let slice = grid.slice(axis, point, planes.thickness);
        let camera = grid.camera(axis, &slice, planes.cameras[axis], size_px);
        let filter = filter(grid, planes.filter, &camera, size_px.1);
        let scene = slice_scene(&seen.state.scene, seen.volumes, slice, camera, filter, planes);
        let drawn = canvas.show(&scene, size_px);
        let (area, response) = ui.allocate_exact_size(shown, Sense::click_and_drag());
        ui.painter().rect_filled(area, 0.0, Color32::BLACK);
        canvas.paint(ui.painter(), area);
        dim_failed(ui.painter(), canvas, area);
        // Marks lie on the picture, which may be of the previous camera.
        let shown = canvas.camera().unwrap_or(camera);
        let Some(lens) = Lens::new(ui.painter(), area, &shown, size_px) else { return drawn };
        let reach = grid.reach(&slice, axis);
        let section = Section { lens: &lens, grid, axis, slice, reach, point, camera, seen };
        section.decorate(&shown);
        let under = response.hover_pos().and_then(|pointer| section.under(pointer));
        section.distances(measuring, under);
        self.picking.look(canvas, &lens, &response);
        if response.clicked() && response.ctx.input(|input| input.modifiers.alt) {
            commands.extend(isolation(seen, &self.picking));
            return drawn;
        }
        let is_measuring = seen.state.window.tool == Tool::Distance;
        if let Some(place) = under.filter(|_| is_measuring && response.clicked()) {
            commands.extend(measuring.click_in(&slice, reach, place, seen.state));
            // The mark of the first click appears in the next frame, which nothing else may request.
            response.ctx.request_repaint();
        }
        commands.extend(section.dragged(&response, is_measuring));
        if response.hovered() {
            commands.extend(self.scrolled(ui, &section));
        }
        if response.double_clicked() {
            commands.push(section.set_camera(None));
        }
        drawn
    }

    /// The wheel goes from slice to slice; with the command key, or by pinching, it zooms.
    fn scrolled(&mut self, ui: &Ui, section: &Section<'_>) -> Option<Command> {
        let (zoom, pointer, events) =
            ui.input(|input| (f64::from(input.zoom_delta()), input.pointer.hover_pos(), input.events.clone()));
        if let Some(pointer) = pointer.filter(|_| zoom != 1.0) {
            let towards = section.under(pointer)?;
            return Some(section.set_camera(Some(zoomed(&section.camera, towards, zoom))));
        }
        let mut slices = 0;
        for event in &events {
            match event {
                Event::MouseWheel { unit: MouseWheelUnit::Point, delta, modifiers, .. } if !modifiers.command => {
                    self.rolled += delta.y;
                    slices += (self.rolled / POINTS_A_SLICE).trunc() as i64;
                    self.rolled %= POINTS_A_SLICE;
                }
                Event::MouseWheel { delta, modifiers, .. } if !modifiers.command => slices += delta.y.round() as i64,
                _ => {}
            }
        }
        let Section { grid, axis, .. } = *section;
        let mut voxel = grid.voxel_at(section.point);
        let last = i64::from(grid.extent[axis]) - 1;
        voxel[axis] = (i64::from(voxel[axis]) + slices).clamp(0, last) as u32;
        (slices != 0).then(|| Command::set("window.planes.crosshair", json!(grid.centre(voxel))))
    }
}

/// A slice in its picture.
struct Section<'a> {
    lens: &'a Lens,
    grid: &'a Grid,
    /// The axis of the voxels across the slice.
    axis: usize,
    slice: Slice,
    /// Reach of the slice to both sides.
    reach: f64,
    /// The common point of all slices.
    point: DVec3,
    /// The wanted camera. Its target is on the slice.
    camera: Camera,
    seen: &'a Seen<'a>,
}

impl Section<'_> {
    fn set_camera(&self, camera: Option<Camera>) -> Command {
        Command::set(&format!("window.planes.cameras.{}", self.axis), json!(camera))
    }

    /// The world point on the slice at a place of the window.
    fn under(&self, place: Pos2) -> Option<DVec3> {
        let rays = &self.lens.rays;
        point_at_target(&self.camera, (rays.width, rays.height), self.lens.pixel(place))
    }

    /// The primary button moves the slices' common point, while measuring only by a drag; shift or the middle button moves the picture, and the
    /// secondary button sets the black and white values.
    fn dragged(&self, response: &Response, is_measuring: bool) -> Option<Command> {
        let by = drag_by(response) / self.lens.area.height().max(1.0);
        let (right, down) = (f64::from(by.x), f64::from(by.y));
        let (modifiers, is_primary) = response.ctx.input(|input| (input.modifiers, input.pointer.primary_down()));
        if by != Vec2::ZERO {
            if response.dragged_by(PointerButton::Secondary) {
                let State { scene, window, .. } = self.seen.state;
                let window = shown_window(&window.planes, scene, self.seen.volumes)?;
                return Some(Command::set("window.planes.window", json!(dragged(window, right, down))));
            }
            if response.dragged_by(PointerButton::Middle) || response.dragged() && modifiers.shift {
                return Some(self.set_camera(Some(panned(&self.camera, right, -down))));
            }
        }
        let is_held = if is_measuring { response.dragged() } else { response.is_pointer_button_down_on() };
        let is_moved = is_held && !modifiers.shift && is_primary && !modifiers.alt;
        let on_slice = self.under(response.interact_pointer_pos().filter(|_| is_moved)?)?;
        let is_far = on_slice.distance(self.point) > 1e-9 * self.lens.rays.pixel_size(1.0);
        is_far.then(|| Command::set("window.planes.crosshair", json!(on_slice)))
    }

    /// Draws the distances lying in the slice, the one being measured to `under` the pointer, and the black and white values.
    fn distances(&self, measuring: &Measuring, under: Option<DVec3>) {
        let Self { lens, slice, reach, seen, .. } = *self;
        let unit = seen.world.as_ref().map_or("", |world| world.unit);
        if let Some(window) = shown_window(&seen.state.window.planes, &seen.state.scene, seen.volumes) {
            let [black, white] = window.map(|value| within_span(value, window[1] - window[0]));
            let corner = lens.area.left_bottom() + vec2(8.0, -6.0);
            let white = with_unit(&white, window_unit(&seen.state.scene, seen.volumes));
            lens.text(corner, Align2::LEFT_BOTTOM, &format!("{black} to {white}"), 11.0, Color32::from_gray(200));
        }
        overlay::distances(lens, &lying_in(&seen.state.window.distances, &slice, reach), unit);
        if measuring.is_in(&slice, reach) {
            measuring.show(lens, under, unit);
        }
    }

    /// Draws the lines of the other slices, the clip box, the lines of clip planes, and the slice's name and place, over a picture of this camera.
    fn decorate(&self, shown: &Camera) {
        let Self { lens, grid, axis, point, seen, .. } = *self;
        let voxel = grid.voxel_at(point);
        for other in (0..3).filter(|&other| other != axis) {
            // The slice across `other` crosses this one along the third axis.
            let along = 3 - axis - other;
            let end = |at: f64| {
                let mut place = grid.voxel_from_world(point);
                place[along] = at;
                grid.world_from_voxel(place)
            };
            let color = AXIS_COLORS[other].gamma_multiply(0.8);
            lens.line(end(0.0), end(f64::from(grid.extent[along])), Stroke::new(1.0, color));
        }
        let of_clips = Stroke::new(1.0, Color32::from_rgb(240, 150, 40));
        if let Some(clip) = seen.state.scene.clip {
            lens.edges((clip[0], clip[1]), of_clips);
        }
        let Some(world) = &seen.world else { return };
        for plane in &seen.state.scene.clip_planes {
            if let Some([from, to]) = trace(plane, &self.slice, world.corners) {
                lens.line(from, to, of_clips);
            }
        }
        if seen.state.window.overlays.letters && world.is_anatomical {
            overlay::letters(lens, Some(point));
        }
        if seen.state.window.overlays.scale_bar {
            overlay::scale_bar(lens, shown, world.unit);
        }
        let [at, count] = [voxel[axis], grid.extent[axis]].map(|number| number * grid.stride[axis]);
        let text = format!("{}  {at} / {}", grid.name(axis), count - 1);
        let corner: Pos2 = lens.area.left_top() + vec2(8.0, 6.0);
        lens.text(corner, Align2::LEFT_TOP, &text, 13.0, AXIS_COLORS[axis]);
    }
}

/// The line common to a clip plane and a slice, within reach of a box with these corners, if any.
fn trace(plane: &ClipPlane, slice: &Slice, (low, high): (DVec3, DVec3)) -> Option<[DVec3; 2]> {
    // The part of the plane's normal in the slice points across the line.
    let across = plane.normal - slice.normal * plane.normal.dot(slice.normal);
    let reach = low.distance(high);
    let is_crossed = across.length() > 1e-6 * plane.normal.length();
    // From the middle, so that the line reaches as far as the box.
    let middle = 0.5 * (low + high);
    let middle = middle - slice.normal * slice.normal.dot(middle - slice.point);
    let foot = middle - across * (plane.height(middle) / across.length_squared());
    let along = slice.normal.cross(across).normalize_or_zero() * reach;
    (is_crossed && foot.distance(middle) <= reach).then_some([foot - along, foot + along])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clip_plane_is_a_line_in_the_slices_that_it_crosses() {
        let corners = (DVec3::new(-2.0, 0.0, 0.0), DVec3::new(8.0, 6.0, 4.0));
        let slice = Slice { point: DVec3::new(1.0, 1.0, 3.0), normal: DVec3::new(0.0, 0.0, -1.0), thickness: 0.0 };
        let plane =
            |normal: [f64; 3]| ClipPlane { point: DVec3::new(2.0, 3.0, 1.0), normal: DVec3::from_array(normal) };
        for normal in [[1.0, 0.0, 0.0], [0.3, -2.0, 0.0], [1.0, 1.0, 0.5]] {
            let line = trace(&plane(normal), &slice, corners).expect("it is crossed");
            for end in line {
                assert!(plane(normal).height(end).abs() < 1e-9 && (end.z - 3.0).abs() < 1e-9, "{normal:?}: {end}");
            }
            assert!(line[0].distance(line[1]) > 2.0 * 11.0);
        }
        assert_eq!(trace(&plane([0.0, 0.0, 2.0]), &slice, corners), None);
        // It crosses the slice far from the box.
        assert_eq!(trace(&plane([0.01, 0.0, 1.0]), &slice, corners), None);
    }
}
