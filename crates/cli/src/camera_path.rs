//! Files of camera paths: JSON lists of cameras, each with an optional time step.

use super::Failure;
use super::step_range::StepRange;
use brickyard::text_file::read_text;
use brickyard::volume::{Camera, Projection, counted};
use glam::DVec3;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// A camera of the file: a [`Camera`] with an optional time step.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Keyframe {
    eye: DVec3,
    target: DVec3,
    up: DVec3,
    projection: Projection,
    time: Option<u32>,
}

/// Cameras, some with time steps.
pub(super) struct CameraPath {
    file: PathBuf,
    /// At least one.
    cameras: Vec<Camera>,
    /// The indices of the cameras with a time step, ascending, and the steps.
    steps: Vec<(usize, u32)>,
}

impl CameraPath {
    /// Reads a path.
    ///
    /// # Errors
    /// Exit code 3 if the file cannot be read, is no list of cameras, or is empty.
    pub(super) fn read(file: &Path) -> Result<Self, Failure> {
        let bad = |problem: String| Failure::bad_input(format!("{}: {problem}", file.display()));
        let text = read_text(file).map_err(Failure::bad_input)?;
        let keyframes: Vec<Keyframe> =
            serde_json::from_str(&text).map_err(|error| bad(format!("not a list of cameras: {error}")))?;
        if keyframes.is_empty() {
            return Err(bad("the list of cameras is empty".into()));
        }
        let steps = keyframes.iter().enumerate().filter_map(|(i, keyframe)| Some((i, keyframe.time?))).collect();
        let camera = |Keyframe { eye, target, up, projection, .. }| Camera { eye, target, up, projection };
        Ok(Self { file: file.into(), cameras: keyframes.into_iter().map(camera).collect(), steps })
    }

    /// Creates a path of these cameras, with time steps for some of them by index.
    #[cfg(test)]
    pub(super) fn of(cameras: &[Camera], steps: &[(usize, u32)]) -> Self {
        Self { file: "p.json".into(), cameras: cameras.into(), steps: steps.into() }
    }

    pub(super) fn len(&self) -> usize {
        self.cameras.len()
    }

    /// Checks whether the cameras are valid, with `between` also the interpolated ones; and whether a series of `times`
    /// steps has the path's steps.
    ///
    /// # Errors
    /// Exit code 2 and the camera if not.
    pub(super) fn check(&self, times: u32, between: bool) -> Result<(), Failure> {
        let bad = |i: usize, problem: String| Failure::usage(format!("{}: camera {i} {problem}", self.file.display()));
        for (i, camera) in self.cameras.iter().enumerate() {
            camera.rays(1, 1).map_err(|error| bad(i, format!("cannot be used: {error}")))?;
            if let Some(next) = self.cameras.get(i + 1).filter(|_| between) {
                camera
                    .between(next, 0.5)
                    .map_err(|error| bad(i, format!("cannot be interpolated to the next: {error}")))?;
            }
        }
        match self.steps.iter().find(|(_, step)| *step >= times) {
            Some(&(i, step)) => {
                let steps = counted(times.into(), "time step");
                Err(bad(i, format!("has time {step}: the store has {steps}, numbered from 0")))
            }
            None => Ok(()),
        }
    }

    /// Checks that only one source gives the time steps: the flag `--time` or this path.
    ///
    /// # Errors
    /// Exit code 2 and both if both do.
    pub(super) fn check_alone(&self, asked: Option<&StepRange>) -> Result<(), Failure> {
        match (asked, self.steps.first()) {
            (Some(asked), Some((i, step))) => Err(Failure::usage(format!(
                "--time {asked}: {} gives time steps, too (camera {i} has time {step}); leave one of the two out",
                self.file.display()
            ))),
            _ => Ok(()),
        }
    }

    /// The camera of picture `i` of `count` without interpolation: with more pictures than cameras, several show the
    /// same one.
    pub(super) fn listed(&self, i: usize, count: usize) -> (Camera, Option<u32>) {
        let camera = i * self.cameras.len() / count;
        (self.cameras[camera], self.step(camera, (0, 1)))
    }

    /// The camera of picture `i` of `count`, evenly from the first camera to the last, interpolated where needed.
    ///
    /// # Errors
    /// If two cameras have nothing in between.
    pub(super) fn between(&self, i: usize, count: usize) -> Result<(Camera, Option<u32>), Failure> {
        let (legs, intervals) = (self.cameras.len() as u64 - 1, (count as u64 - 1).max(1));
        let along = i as u64 * legs;
        let (before, rest) = ((along / intervals) as usize, along % intervals);
        let camera = self.cameras[before];
        let camera = match (rest, self.cameras.get(before + 1)) {
            (1.., Some(next)) => {
                let t = rest as f64 / intervals as f64;
                camera.between(next, t).map_err(|error| Failure::usage(format!("{}: {error}", self.file.display())))?
            }
            _ => camera,
        };
        Ok((camera, self.step(before, (rest, intervals))))
    }

    /// Returns the time step at a camera, or behind it by a fraction, less than 1, of the way to the next: interpolated
    /// between the nearest two cameras with a step and rounded down, constant before the first and after the last of
    /// them. `None` if no camera has one.
    fn step(&self, camera: usize, (numerator, denominator): (u64, u64)) -> Option<u32> {
        let after = self.steps.partition_point(|(of_step, _)| *of_step <= camera);
        let Some((from_camera, from)) = after.checked_sub(1).map(|before| self.steps[before]) else {
            return self.steps.first().map(|(_, step)| *step);
        };
        let Some(&(to_camera, to)) = self.steps.get(after) else { return Some(from) };
        // In integers: rounding must not turn an exactly reached step into the previous one.
        let denominator = i128::from(denominator);
        let gone = (camera - from_camera) as i128 * denominator + i128::from(numerator);
        let way = (to_camera - from_camera) as i128 * denominator;
        let step = i128::from(from) + ((i128::from(to) - i128::from(from)) * gone).div_euclid(way);
        // Between two steps, so in range.
        Some(step as u32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn path(times: &[Option<u32>]) -> CameraPath {
        let start = Camera::looking_at_box((DVec3::ZERO, DVec3::ONE));
        let cameras: Vec<Camera> = (0..times.len()).map(|i| start.orbited(10.0 * i as f64)).collect();
        let steps: Vec<_> = times.iter().enumerate().filter_map(|(i, time)| Some((i, (*time)?))).collect();
        CameraPath::of(&cameras, &steps)
    }

    fn listed(times: &[Option<u32>], count: usize) -> Vec<u32> {
        let path = path(times);
        (0..count).map(|i| path.listed(i, count).1.unwrap()).collect()
    }

    fn between(times: &[Option<u32>], count: usize) -> Vec<u32> {
        let path = path(times);
        (0..count).map(|i| path.between(i, count).unwrap().1.unwrap()).collect()
    }

    #[test]
    fn steps_between_cameras_are_rounded_down() {
        assert_eq!(listed(&[Some(3), Some(9), Some(1)], 3), [3, 9, 1]);
        assert_eq!(listed(&[Some(0), None, None, Some(5)], 4), [0, 1, 3, 5]);
        assert_eq!(listed(&[Some(5), None, None, Some(0)], 4), [5, 3, 1, 0], "5, 3.33, 1.67, 0");
        assert_eq!(listed(&[None, Some(2), None, Some(4), None], 5), [2, 2, 3, 4, 4]);
        assert_eq!(listed(&[None, Some(u32::MAX), None, Some(0)], 4), [u32::MAX, u32::MAX, u32::MAX / 2, 0]);
        assert_eq!(listed(&[Some(0), Some(1)], 4), [0, 0, 1, 1]);
    }

    #[test]
    fn pictures_between_cameras_show_the_steps_between_theirs() {
        assert_eq!(between(&[Some(0), Some(5)], 6), [0, 1, 2, 3, 4, 5]);
        assert_eq!(between(&[Some(0), Some(5)], 4), [0, 1, 3, 5]);
        assert_eq!(between(&[Some(0), Some(2)], 5), [0, 0, 1, 1, 2]);
        assert_eq!(between(&[Some(4), Some(4), Some(0)], 5), [4, 4, 4, 2, 0]);
        assert_eq!(between(&[Some(0), None, Some(3)], 7), [0, 0, 1, 1, 2, 2, 3]);
        assert_eq!(between(&[None, Some(3)], 1), [3]);
        // Exactly reached steps, some of which floating point would miss.
        let all: Vec<u32> = (0..=1000).collect();
        assert_eq!(between(&[Some(0), Some(1000)], 1001), all);
    }

    #[test]
    fn cameras_are_the_lists_at_its_places_and_between_them_elsewhere() {
        let path = path(&[None; 3]);
        let camera = |i| path.between(i, 5).unwrap().0;
        assert_eq!([camera(0), camera(2), camera(4)], path.cameras[..]);
        let expected = path.cameras[0].orbited(5.0);
        assert!(camera(1).eye.distance(expected.eye) < 1e-9 && path.between(1, 5).unwrap().1.is_none());
        assert_eq!(path.listed(3, 4).0, path.cameras[2]);
        assert_eq!(path.between(0, 1).unwrap().0, path.cameras[0]);
    }

    #[test]
    fn files_are_read_with_their_times() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("p.json");
        let camera = r#""eye": [0, -9, 0], "target": [0, 0, 0], "up": [0, 0, 1], "projection": {"perspective": {"fov_y_deg": 30}}"#;
        let read = |text: String| {
            std::fs::write(&file, text).unwrap();
            CameraPath::read(&file)
        };
        let path = read(format!("[{{{camera}}}, {{{camera}, \"time\": 4}}]")).unwrap();
        assert_eq!((path.len(), &path.steps[..]), (2, &[(1, 4)][..]));
        assert!(path.check(5, true).is_ok());
        let failure = path.check(4, false).unwrap_err().message;
        assert!(failure.contains("p.json: camera 1 has time 4") && failure.contains("4 time steps"), "{failure}");
        assert!(path.check_alone(None).is_ok());
        let failure = path.check_alone("0:3".parse().ok().as_ref()).unwrap_err().message;
        assert!(failure.contains("--time 0:3") && failure.contains("p.json"), "{failure}");
        for time in ["-1", "1.5", "\"2\"", "4294967296"] {
            let failure = read(format!("[{{{camera}, \"time\": {time}}}]")).err().expect(time).message;
            assert!(failure.contains("p.json: not a list of cameras"), "{failure}");
        }
        assert!(read(format!("[{{{camera}}}]")).unwrap().check_alone("3".parse().ok().as_ref()).is_ok());
        assert!(read(format!("[{{{camera}, \"tiem\": 1}}]")).err().unwrap().message.contains("tiem"));
        let up = camera.replace("[0, 0, 1]", "[0, 1, 0]");
        let failure = read(format!("[{{{camera}}}, {{{up}}}]")).unwrap().check(1, false).unwrap_err().message;
        assert!(failure.contains("camera 1 cannot be used: the camera's up"), "{failure}");
    }
}
