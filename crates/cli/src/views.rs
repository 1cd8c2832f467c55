//! The pictures that one `render` makes: of one time step or several, from one camera, an orbit or those of a path. Each view is made when its turn
//! comes, so that their number costs no memory.
//!
//! Where there are several cameras and several steps, both run over all the pictures, of which there are as many as of the more numerous: time goes on
//! while the camera moves.

use super::failure::Failure;
use super::output::may_write;
use super::render_args::RenderArguments;
use brickyard::text_file::read_text;
use brickyard::volume::{Camera, Scene};
use std::path::{Path, PathBuf};

/// The most pictures of an orbit: a camera that moves by a third of a thousandth of a degree shows nothing new.
pub(super) const MOST_PICTURES: u32 = 1_000_000;

/// Pictures, numbered.
pub(super) struct Views {
    scene: Scene,
    cameras: Cameras,
    /// The time steps; at least one.
    steps: Vec<u32>,
    output: PathBuf,
}

enum Cameras {
    One,
    Orbit { start: Camera, count: u32 },
    Path(Vec<Camera>),
}

impl Views {
    /// The views of a scene, which has a camera, at some time steps. All their files may be written, and the statistics'.
    ///
    /// # Errors
    /// If not, or if the path cannot be read or there is nothing to show.
    pub(super) fn new(arguments: &RenderArguments, scene: Scene, steps: Vec<u32>) -> Result<Self, Failure> {
        let cameras = match (arguments.orbit, scene.camera, &arguments.path) {
            (Some(count), Some(start), _) => {
                if !(1..=MOST_PICTURES).contains(&count) {
                    return Err(Failure::usage(format!("--orbit {count}: expected 1 to {MOST_PICTURES} pictures")));
                }
                Cameras::Orbit { start, count }
            }
            (_, _, Some(path)) => Cameras::Path(cameras(path)?),
            _ => Cameras::One,
        };
        let views = Self { scene, cameras, steps, output: arguments.output.clone() };
        for i in 0..views.count() {
            let path = views.output(i);
            may_write(&path, arguments.overwrite)?;
            if arguments.stats.as_ref() == Some(&path) {
                let problem = format!("{}: cannot be a picture and hold the statistics", path.display());
                return Err(Failure::usage(problem));
            }
        }
        arguments.stats.iter().try_for_each(|path| may_write(path, arguments.overwrite))?;
        Ok(views)
    }

    fn count(&self) -> usize {
        let cameras = match &self.cameras {
            Cameras::One => 1,
            Cameras::Orbit { count, .. } => *count as usize,
            Cameras::Path(cameras) => cameras.len(),
        };
        cameras.max(self.steps.len())
    }

    /// The first scene.
    pub(super) fn first(&self) -> Scene {
        self.scene(0)
    }

    fn scene(&self, i: usize) -> Scene {
        let count = self.count();
        let camera = match &self.cameras {
            Cameras::One => self.scene.camera,
            Cameras::Orbit { start, .. } => Some(start.orbited(360.0 * i as f64 / count as f64)),
            Cameras::Path(cameras) => cameras.get(i * cameras.len() / count).copied(),
        };
        Scene { camera, time: self.steps[i * self.steps.len() / count], ..self.scene.clone() }
    }

    fn output(&self, i: usize) -> PathBuf {
        numbered(&self.output, i, self.count())
    }

    /// Each scene and the file of its picture.
    pub(super) fn iter(&self) -> impl Iterator<Item = (Scene, PathBuf)> {
        (0..self.count()).map(|i| (self.scene(i), self.output(i)))
    }
}

fn cameras(path: &Path) -> Result<Vec<Camera>, Failure> {
    let bad = |problem: String| Failure::bad_input(format!("{}: {problem}", path.display()));
    let text = read_text(path).map_err(Failure::bad_input)?;
    let cameras: Vec<Camera> =
        serde_json::from_str(&text).map_err(|error| bad(format!("not a list of cameras: {error}")))?;
    if cameras.is_empty() {
        return Err(bad("the list of cameras is empty".into()));
    }
    Ok(cameras)
}

/// With at least three digits, and as many as the last one needs, so that names sort like pictures.
fn numbered(path: &Path, index: usize, count: usize) -> PathBuf {
    if count == 1 {
        return path.to_path_buf();
    }
    let digits = (count - 1).to_string().len().max(3);
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let extension = path.extension().unwrap_or("png".as_ref()).to_string_lossy();
    path.with_file_name(format!("{stem}_{index:0digits$}.{extension}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn several_pictures_are_numbered() {
        assert_eq!(numbered(Path::new("a/b.png"), 0, 1), Path::new("a/b.png"));
        assert_eq!(numbered(Path::new("a/b.png"), 7, 20), Path::new("a/b_007.png"));
        assert_eq!(numbered(Path::new("b"), 1, 2), Path::new("b_001.png"));
        assert_eq!(numbered(Path::new("b.png"), 7, 1000), Path::new("b_007.png"));
        assert_eq!(numbered(Path::new("b.png"), 7, 1001), Path::new("b_0007.png"));
    }

    #[test]
    fn views_are_made_one_by_one() {
        let scene = Scene { camera: Some(Camera::looking_at_box((DVec3::ZERO, DVec3::ONE))), ..Scene::default() };
        let start = scene.camera.unwrap();
        let cameras = Cameras::Orbit { start, count: MOST_PICTURES };
        let views = Views { scene, cameras, steps: vec![3], output: "o.png".into() };
        let (scene, output) = views.iter().nth(MOST_PICTURES as usize / 2).unwrap();
        assert_eq!((scene.camera.unwrap(), output), (start.orbited(180.0), "o_500000.png".into()));
        assert_eq!(views.iter().count(), MOST_PICTURES as usize);
    }

    #[test]
    fn time_goes_on_while_the_camera_moves() {
        let start = Camera::looking_at_box((DVec3::ZERO, DVec3::ONE));
        let scene = Scene { camera: Some(start), ..Scene::default() };
        let [a, b] = [0.0, 90.0].map(|turn_deg| start.orbited(turn_deg));
        let views = |cameras, steps: &[u32]| {
            let views = Views { scene: scene.clone(), cameras, steps: steps.to_vec(), output: "o.png".into() };
            views.iter().map(|(scene, _)| (scene.camera.unwrap(), scene.time)).collect::<Vec<_>>()
        };
        assert_eq!(views(Cameras::One, &[4, 6]), [(start, 4), (start, 6)]);
        assert_eq!(views(Cameras::Path(vec![a, b]), &[1, 2, 3, 4]), [(a, 1), (a, 2), (b, 3), (b, 4)]);
        let orbit = views(Cameras::Orbit { start, count: 4 }, &[7, 9]);
        assert_eq!(orbit, [(start, 7), (b, 7), (start.orbited(180.0), 9), (start.orbited(270.0), 9)]);
        // As many pictures as steps, evenly around.
        assert_eq!(views(Cameras::Orbit { start, count: 2 }, &[0, 1, 2, 3])[1], (b, 1));
    }
}
