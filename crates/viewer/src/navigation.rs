//! Camera motion: turning around a point, moving across the picture, zooming, and flying. All of it is arithmetic on cameras; drags and keys are
//! interpreted elsewhere.

use crate::command::Command;
use brickyard::volume::scene::VolumePlace;
use brickyard::volume::{Camera, Projection, Scene, ViewRays};
use glam::{DQuat, DVec3};

/// Least angle between the view and straight up or down, in degrees: up is undefined there.
const POLE_DEG: f64 = 1.0;

/// Least distance for flying, as a share of the diagonal of all volumes: inside them it would be zero.
const LEAST_DISTANCE: f64 = 0.02;

/// A scene's camera, in a picture of this size, after a command; `None` if it moves no camera.
///
/// # Errors
/// If the command names a side or a place that does not exist.
pub(crate) fn moved(
    command: &Command,
    scene: &Scene,
    places: &[VolumePlace],
    size_px: (u32, u32),
) -> Result<Option<Camera>, String> {
    let camera = scene.camera_for(places, size_px).map_err(|error| error.to_string())?;
    let world_box = || scene.world_box(places).map_err(|error| error.to_string());
    let from = |direction: DVec3, up: DVec3| -> Result<Camera, String> {
        let world_box = world_box()?;
        let whole = Camera::looking_from(direction, up, world_box).fitted(world_box, size_px);
        let is_parallel = matches!(camera.projection, Projection::Orthographic { .. });
        Ok(with_parallel_rays(&whole, is_parallel))
    };
    Ok(Some(match command {
        Command::Orbit { right_deg, up_deg, about } => {
            orbited(&camera, about.unwrap_or(camera.target), *right_deg, *up_deg)
        }
        Command::Look { right_deg, up_deg } => orbited(&camera, camera.eye, *right_deg, *up_deg),
        Command::Roll { angle_deg } => rolled(&camera, *angle_deg),
        Command::Pan { right, up } => panned(&camera, *right, *up),
        Command::Fly { right, up, forward } => flown(&camera, [*right, *up, *forward], world_box()?),
        Command::Zoom { factor, at: None } => zoomed(&camera, camera.target, *factor),
        Command::Zoom { factor, at: Some([right, down]) } => {
            let (width, height) = size_px;
            let place_px = [right * f64::from(width), down * f64::from(height)];
            let towards = point_at_target(&camera, size_px, place_px).ok_or("the place is outside of the view")?;
            zoomed(&camera, towards, *factor)
        }
        Command::Parallel(is_parallel) => with_parallel_rays(&camera, *is_parallel),
        Command::View(viewpoint) => {
            let direction = viewpoint.direction(scene.is_anatomical(places));
            let (direction, up) = direction.ok_or("no store says how its volume lies in a patient: use +x, -y")?;
            from(direction, up)?
        }
        Command::Fit => from((camera.eye - camera.target).normalize_or_zero(), camera.up)?,
        Command::Center(point) => Camera { eye: camera.eye + (*point - camera.target), target: *point, ..camera },
        _ => return Ok(None),
    }))
}

/// Moves a camera right, up and forward by parts of its distance from a box.
pub(crate) fn flown(camera: &Camera, [right, up, forward]: [f64; 3], (low, high): (DVec3, DVec3)) -> Camera {
    let ahead = (camera.target - camera.eye).normalize_or_zero();
    let to_right = ahead.cross(camera.up).normalize_or_zero();
    let distance = camera.eye.distance(camera.eye.clamp(low, high)).max(LEAST_DISTANCE * low.distance(high));
    let by = (to_right * right + to_right.cross(ahead) * up + ahead * forward) * distance;
    Camera { eye: camera.eye + by, target: camera.target + by, ..*camera }
}

/// Turns a camera around a world point: by `right_deg` about its up direction, as if the volume were pushed to the right, and by `up_deg` over the
/// top, as far as straight up or down.
pub(crate) fn orbited(camera: &Camera, around: DVec3, right_deg: f64, up_deg: f64) -> Camera {
    let up = camera.up.normalize_or_zero();
    let forward = (camera.target - camera.eye).normalize_or_zero();
    let right = forward.cross(up).normalize_or_zero();
    // The angle between the view and up stays between the poles.
    let from_up_deg = forward.angle_between(up).to_degrees();
    let up_deg = up_deg.clamp(from_up_deg - 180.0 + POLE_DEG, from_up_deg - POLE_DEG);
    let turn = DQuat::from_axis_angle(up, -right_deg.to_radians()) * DQuat::from_axis_angle(right, up_deg.to_radians());
    let moved = |point: DVec3| around + turn * (point - around);
    Camera { eye: moved(camera.eye), target: moved(camera.target), ..*camera }
}

/// Rolls a camera about its view direction, clockwise as seen in the picture's content.
pub(crate) fn rolled(camera: &Camera, angle_deg: f64) -> Camera {
    let forward = (camera.target - camera.eye).normalize_or_zero();
    // Across the view, so that rolling goes on turning the picture.
    let up = camera.up.reject_from(forward);
    Camera { up: DQuat::from_axis_angle(forward, -angle_deg.to_radians()) * up, ..*camera }
}

/// Moves a camera so that its target moves right and up, by parts of the picture's height.
pub(crate) fn panned(camera: &Camera, right: f64, up: f64) -> Camera {
    let forward = (camera.target - camera.eye).normalize_or_zero();
    let to_right = forward.cross(camera.up).normalize_or_zero();
    let to_up = to_right.cross(forward);
    let by = -(to_right * right + to_up * up) * height_at_target(camera);
    Camera { eye: camera.eye + by, target: camera.target + by, ..*camera }
}

/// Moves a camera closer to a world point, which keeps its place in the picture, dividing its distances by `factor`.
pub(crate) fn zoomed(camera: &Camera, towards: DVec3, factor: f64) -> Camera {
    let moved = |point: DVec3| towards + (point - towards) / factor;
    let projection = match camera.projection {
        Projection::Orthographic { height } => Projection::Orthographic { height: height / factor },
        perspective @ Projection::Perspective { .. } => perspective,
    };
    Camera { eye: moved(camera.eye), target: moved(camera.target), projection, ..*camera }
}

/// Switches between perspective and parallel rays. Content at the target keeps its size.
pub(crate) fn with_parallel_rays(camera: &Camera, parallel: bool) -> Camera {
    let distance = camera.eye.distance(camera.target);
    match (camera.projection, parallel) {
        (Projection::Perspective { .. }, true) => {
            Camera { projection: Projection::Orthographic { height: height_at_target(camera) }, ..*camera }
        }
        (Projection::Orthographic { height }, false) => {
            // The default camera's angle. The eye moves to where the view is equally high.
            let fov_y_deg = 30.0f64;
            let needed = 0.5 * height / (0.5 * fov_y_deg).to_radians().tan();
            let eye = camera.target + (camera.eye - camera.target) * (needed / distance);
            Camera { eye, projection: Projection::Perspective { fov_y_deg }, ..*camera }
        }
        _ => *camera,
    }
}

/// Height of the view at the target, in the world.
fn height_at_target(camera: &Camera) -> f64 {
    match camera.projection {
        Projection::Perspective { fov_y_deg } => {
            2.0 * camera.eye.distance(camera.target) * (0.5 * fov_y_deg).to_radians().tan()
        }
        Projection::Orthographic { height } => height,
    }
}

/// The world point under a place of the picture, in pixels, at the depth of the camera's target.
pub(crate) fn point_at_target(camera: &Camera, size_px: (u32, u32), place_px: [f64; 2]) -> Option<DVec3> {
    Some(point_at_depth_of(camera.target, &camera.rays(size_px.0, size_px.1).ok()?, place_px))
}

/// The world point under a place of the picture, in pixels, at the depth of another point.
pub(crate) fn point_at_depth_of(point: DVec3, rays: &ViewRays, [x_px, y_px]: [f64; 2]) -> DVec3 {
    let ray = rays.ray(x_px, y_px);
    let along = (point - ray.origin).dot(rays.forward) / ray.direction.dot(rays.forward);
    ray.origin + ray.direction * along
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SIZE: (u32, u32) = (640, 480);

    fn camera() -> Camera {
        Camera::looking_at_box((DVec3::new(-1.0, 2.0, 3.0), DVec3::new(7.0, 9.0, 5.0)))
    }

    fn pixel(camera: &Camera, point: DVec3) -> DVec3 {
        let [x, y] = camera.rays(SIZE.0, SIZE.1).unwrap().pixel(point).unwrap();
        DVec3::new(x, y, 0.0)
    }

    #[test]
    fn what_is_pushed_to_the_right_moves_to_the_right() {
        let near = camera().target - (camera().target - camera().eye).normalize();
        let before = pixel(&camera(), near);
        assert!(pixel(&orbited(&camera(), camera().target, 10.0, 0.0), near).x > before.x + 1.0);
        // Over the top: near content moves up in the picture, to lesser rows.
        assert!(pixel(&orbited(&camera(), camera().target, 0.0, 10.0), near).y < before.y - 1.0);
        let beside = camera().target + DVec3::Z;
        assert!(pixel(&rolled(&camera(), 20.0), beside).x > pixel(&camera(), beside).x + 1.0);
    }

    #[test]
    fn the_camera_stops_at_the_poles() {
        for up_deg in [500.0, -500.0] {
            let turned = orbited(&camera(), camera().target, 0.0, up_deg);
            assert!(turned.rays(SIZE.0, SIZE.1).is_ok());
            let angle = (turned.target - turned.eye).angle_between(turned.up).to_degrees();
            assert!((angle.min(180.0 - angle) - POLE_DEG).abs() < 1e-6, "{angle}");
        }
    }

    #[test]
    fn projections_show_the_target_in_the_same_size() {
        let beside = camera().target + DVec3::Z;
        let parallel = with_parallel_rays(&camera(), true);
        let back = with_parallel_rays(&parallel, false);
        assert!(matches!(parallel.projection, Projection::Orthographic { .. }));
        assert!((back.eye - camera().eye).length() < 1e-9 * camera().eye.length());
        let size = |camera: &Camera| pixel(camera, beside).distance(pixel(camera, camera.target));
        assert!((size(&parallel) / size(&camera()) - 1.0).abs() < 0.05);
        assert_eq!(with_parallel_rays(&parallel, true), parallel);
    }

    proptest! {
        /// The point under the pointer stays under it.
        #[test]
        fn a_point_that_is_held_keeps_its_place(
            x in 0.0..640.0, y in 0.0..480.0, factor in 0.2..5.0, right in -0.5..0.5f64, up in -0.5..0.5f64, parallel: bool,
            turn in -180.0..180.0,
        ) {
            let camera = with_parallel_rays(&orbited(&camera(), camera().target, turn, 0.2 * turn), parallel);
            let held = point_at_target(&camera, SIZE, [x, y]).unwrap();
            prop_assert!((pixel(&camera, held) - DVec3::new(x, y, 0.0)).length() < 1e-6);
            prop_assert!((pixel(&zoomed(&camera, held, factor), held) - DVec3::new(x, y, 0.0)).length() < 1e-6);
            let by = DVec3::new(right, -up, 0.0) * f64::from(SIZE.1);
            prop_assert!((pixel(&panned(&camera, right, up), held) - DVec3::new(x, y, 0.0) - by).length() < 1e-6);
        }

        /// Inside the volumes a flight continues, and always keeps the view's direction.
        #[test]
        fn a_flight_keeps_the_direction(right in -2.0..2.0, up in -2.0..2.0, forward in -2.0..2.0f64, x in 0.0..8.0) {
            let world_box = (DVec3::new(-1.0, 2.0, 3.0), DVec3::new(7.0, 9.0, 5.0));
            let start = zoomed(&camera(), camera().target, 1.0 + x);
            let end = flown(&start, [right, up, forward], world_box);
            let direction = |camera: &Camera| (camera.target - camera.eye).normalize();
            prop_assert!(direction(&end).dot(direction(&start)) > 1.0 - 1e-9);
            let moved = (end.eye - start.eye).length();
            prop_assert!(moved > 0.01 * DVec3::new(right, up, forward).length());
        }

        /// The centre of a turn keeps its place and distance.
        #[test]
        fn the_middle_of_a_turn_stays(right in -90.0..90.0, up in -90.0..90.0, x in -3.0..3.0) {
            let around = camera().target + DVec3::new(x, 0.5 * x, 1.0);
            let turned = orbited(&camera(), around, right, up);
            prop_assert!((turned.eye.distance(around) / camera().eye.distance(around) - 1.0).abs() < 1e-9);
            prop_assert!((turned.eye.distance(turned.target) / camera().eye.distance(camera().target) - 1.0).abs() < 1e-9);
        }
    }
}
