//! What can be undone: the scenes before each edit. Edits of one kind that follow each other while a hand drags are one step. The camera is not
//! part of it: undoing a colour does not throw the view back.

use brickyard::volume::Scene;

/// The most steps that are kept.
const MOST: usize = 200;

/// The scenes before and after the one that is shown.
#[derive(Debug, Default)]
pub(crate) struct History {
    before: Vec<Scene>,
    after: Vec<Scene>,
    /// The kind of edit that goes on; `None` if none does.
    open: Option<String>,
}

impl History {
    /// Notes that `scene` is about to be edited. `kind` names what is edited; edits of the same kind are one step until [`Self::close`].
    pub(crate) fn edit(&mut self, scene: &Scene, kind: &str) {
        if self.open.as_deref() == Some(kind) {
            return;
        }
        self.before.push(scene.clone());
        if self.before.len() > MOST {
            self.before.remove(0);
        }
        self.after.clear();
        self.open = Some(kind.to_string());
    }

    /// Ends the edit that goes on, for example because the hand lets go.
    pub(crate) fn close(&mut self) {
        self.open = None;
    }

    /// Takes back the last edit of `scene`. Returns whether there was one.
    pub(crate) fn undo(&mut self, scene: &mut Scene) -> bool {
        self.close();
        exchange(&mut self.before, &mut self.after, scene)
    }

    /// Makes the last edit that was taken back again. Returns whether there was one.
    pub(crate) fn redo(&mut self, scene: &mut Scene) -> bool {
        self.close();
        exchange(&mut self.after, &mut self.before, scene)
    }

    /// Whether an edit can be taken back, and whether one can be made again.
    pub(crate) fn can(&self) -> (bool, bool) {
        (!self.before.is_empty(), !self.after.is_empty())
    }
}

/// Shows the last of `from`, and puts what was shown on `to`.
fn exchange(from: &mut Vec<Scene>, to: &mut Vec<Scene>, scene: &mut Scene) -> bool {
    let Some(other) = from.pop() else { return false };
    let camera = scene.camera;
    to.push(std::mem::replace(scene, Scene { camera, ..other }));
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard::volume::{Camera, Mode};
    use glam::DVec3;

    #[test]
    fn every_edit_is_taken_back_and_made_again() {
        let (mut history, mut scene) = (History::default(), Scene::default());
        let mut scenes = vec![scene.clone()];
        for (i, kind) in ["step", "step", "time", "step"].into_iter().enumerate() {
            history.edit(&scene, kind);
            scene.step = 1.0 + i as f64;
            if kind == "time" {
                history.close();
            }
            scenes.push(scene.clone());
        }
        // The first two are one.
        scenes.remove(1);
        let mut found = vec![scene.clone()];
        while history.undo(&mut scene) {
            found.insert(0, scene.clone());
        }
        assert_eq!(found, scenes);
        assert_eq!(history.can(), (false, true));
        while history.redo(&mut scene) {}
        assert_eq!(Some(&scene), scenes.last());
        history.undo(&mut scene);
        history.edit(&scene, "mode");
        scene.mode = Mode::Mip;
        assert_eq!(history.can(), (true, false), "what was taken back is given up by another edit");
    }

    #[test]
    fn the_camera_stays() {
        let (mut history, mut scene) = (History::default(), Scene::default());
        history.edit(&scene, "mode");
        scene.mode = Mode::Mip;
        scene.camera = Some(Camera::looking_at_box((DVec3::ZERO, DVec3::ONE)));
        let camera = scene.camera;
        assert!(history.undo(&mut scene) && scene.mode == Mode::Dvr && scene.camera == camera);
    }
}
