//! The pictures of one `render`: of one time step or several, from one camera, an orbit or a path. Each view is made in
//! its turn, so their number costs no memory.
//!
//! With several cameras and several steps, both run over all the pictures, as many as the more numerous of the two:
//! time goes on while the camera moves.

use super::Failure;
use super::camera_path::CameraPath;
use super::render_args::RenderArguments;
use brickyard::session::VolumeSource;
use brickyard::volume::{Camera, Scene};

/// The most pictures of an orbit or a path: a camera moving by a third of a thousandth of a degree shows nothing new.
pub(super) const MOST_PICTURES: u32 = 1_000_000;

/// The scenes of the pictures.
pub(super) struct Views {
    scene: Scene,
    cameras: Cameras,
    /// The time steps; at least one. A path's own steps replace them.
    steps: Vec<u32>,
}

enum Cameras {
    One,
    Orbit {
        start: Camera,
        count: u32,
    },
    /// Each camera of a path, or this number of pictures along it.
    Path {
        path: CameraPath,
        count: Option<u32>,
    },
}

impl Views {
    /// Creates the views of a scene with a camera, of some volumes.
    ///
    /// # Errors
    /// If the path cannot be read or is invalid, there is nothing to show, or a step does not exist.
    pub(super) fn new(arguments: &RenderArguments, scene: Scene, volumes: &[VolumeSource]) -> Result<Self, Failure> {
        let within = |flag: &str, count: Option<u32>| match count {
            Some(count) if !(1..=MOST_PICTURES).contains(&count) => {
                Err(Failure::usage(format!("{flag} {count}: expected 1 to {MOST_PICTURES} pictures")))
            }
            _ => Ok(count),
        };
        let orbit = within("--orbit", arguments.orbit)?;
        let frames = within("--frames", arguments.frames)?;
        let cameras = match (orbit, scene.camera, &arguments.path) {
            (Some(count), Some(start), _) => {
                let start = all_around(start, count, &scene, volumes, arguments.size);
                Cameras::Orbit { start, count }
            }
            (_, _, Some(file)) => {
                let path = CameraPath::read(file)?;
                path.check(VolumeSource::timeline(volumes, &scene).steps(), frames.is_some())?;
                path.check_alone(arguments.scene.time.as_ref())?;
                Cameras::Path { path, count: frames }
            }
            _ => Cameras::One,
        };
        let steps = arguments.scene.steps(&scene, volumes)?;
        Ok(Self { scene, cameras, steps })
    }

    pub(super) fn count(&self) -> usize {
        let cameras = match &self.cameras {
            Cameras::One => 1,
            Cameras::Orbit { count, .. } | Cameras::Path { count: Some(count), .. } => *count as usize,
            Cameras::Path { path, count: None } => path.len(),
        };
        cameras.max(self.steps.len())
    }

    /// Returns the scene of a picture.
    ///
    /// # Errors
    /// If nothing is between two cameras of the path.
    pub(super) fn scene(&self, i: usize) -> Result<Scene, Failure> {
        let count = self.count();
        let (camera, step) = match &self.cameras {
            Cameras::One => (self.scene.camera, None),
            Cameras::Orbit { start, .. } => (Some(start.orbited(360.0 * i as f64 / count as f64)), None),
            Cameras::Path { path, count: along } => {
                let (camera, step) = if along.is_some() { path.between(i, count)? } else { path.listed(i, count) };
                (Some(camera), step)
            }
        };
        let time = step.unwrap_or(self.steps[i * self.steps.len() / count]);
        Ok(Scene { camera, time, ..self.scene.clone() })
    }
}

/// Returns the first camera of an orbit of `count` pictures. A default camera, fitted to the volumes from one side, is
/// moved away until they fit from all sides.
fn all_around(start: Camera, count: u32, scene: &Scene, volumes: &[VolumeSource], size_px: (u32, u32)) -> Camera {
    let places: Vec<_> = volumes.iter().map(VolumeSource::place).collect();
    let Ok(world_box) = scene.world_box(&places) else { return start };
    let distance = start.eye.distance(start.target);
    let fitted = |camera: Camera| camera.fitted(world_box, size_px).eye.distance(camera.target);
    if (fitted(start) - distance).abs() > 1e-9 * distance {
        return start;
    }
    // Neighbouring pictures of a longer orbit are so close together that none needs more room.
    let turns = count.min(360);
    let farthest =
        (0..turns).map(|i| fitted(start.orbited(360.0 * f64::from(i) / f64::from(turns)))).fold(distance, f64::max);
    Camera { eye: start.target + (start.eye - start.target) * (farthest / distance), ..start }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn views_are_made_one_by_one() {
        let start = Camera::looking_at_box((DVec3::ZERO, DVec3::ONE));
        let scene = Scene { camera: Some(start), ..Scene::default() };
        let views = Views { scene, cameras: Cameras::Orbit { start, count: MOST_PICTURES }, steps: vec![3] };
        assert_eq!(views.count(), MOST_PICTURES as usize);
        let scene = views.scene(MOST_PICTURES as usize / 2).unwrap();
        assert_eq!((scene.camera.unwrap(), scene.time), (start.orbited(180.0), 3));
    }

    #[test]
    fn time_goes_on_while_the_camera_moves() {
        let start = Camera::looking_at_box((DVec3::ZERO, DVec3::ONE));
        let scene = Scene { camera: Some(start), ..Scene::default() };
        let [a, b] = [0.0, 90.0].map(|turn_deg| start.orbited(turn_deg));
        let views = |cameras, steps: &[u32]| {
            let views = Views { scene: scene.clone(), cameras, steps: steps.to_vec() };
            let scenes = (0..views.count()).map(|i| views.scene(i).unwrap());
            scenes.map(|scene| (scene.camera.unwrap(), scene.time)).collect::<Vec<_>>()
        };
        let path = |count, time| Cameras::Path { path: CameraPath::of(&[a, b], time), count };
        assert_eq!(views(Cameras::One, &[4, 6]), [(start, 4), (start, 6)]);
        assert_eq!(views(path(None, &[]), &[1, 2, 3, 4]), [(a, 1), (a, 2), (b, 3), (b, 4)]);
        let orbit = views(Cameras::Orbit { start, count: 4 }, &[7, 9]);
        assert_eq!(orbit, [(start, 7), (b, 7), (start.orbited(180.0), 9), (start.orbited(270.0), 9)]);
        // As many pictures as steps, evenly around.
        assert_eq!(views(Cameras::Orbit { start, count: 2 }, &[0, 1, 2, 3])[1], (b, 1));
        // A path's own steps, and pictures between its cameras, including the first and the last.
        let timed = [(0, 2), (1, 7)];
        assert_eq!(views(path(None, &timed), &[0]), [(a, 2), (b, 7)]);
        let along = views(path(Some(3), &timed), &[0]);
        assert_eq!((along[0], along[1].1, along[2], along.len()), ((a, 2), 4, (b, 7), 3));
        assert_eq!(views(path(Some(2), &[]), &[4, 5, 6]).iter().map(|view| view.1).collect::<Vec<_>>(), [4, 5, 6]);
    }
}
