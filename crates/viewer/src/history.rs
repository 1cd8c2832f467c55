//! The undo history: the states before each edit. Consecutive edits of one kind during a drag are one step. Views are no part of it: undoing a colour
//! does not move the camera back.

use crate::state::State;

/// Most steps kept.
const MOST: usize = 200;

/// The states before and after the current one.
#[derive(Debug, Default)]
pub(crate) struct History {
    before: Vec<State>,
    after: Vec<State>,
    /// The kind of the edit in progress, if any.
    open: Option<String>,
}

impl History {
    /// Records `state` before an edit of `kind`; edits of the same kind are one step until [`Self::close`].
    pub(crate) fn edit(&mut self, state: &State, kind: &str) {
        if self.open.as_deref() == Some(kind) {
            return;
        }
        self.before.push(state.clone());
        if self.before.len() > MOST {
            self.before.remove(0);
        }
        self.after.clear();
        self.open = Some(kind.to_string());
    }

    /// Ends the edit in progress, as on releasing a button.
    pub(crate) fn close(&mut self) {
        self.open = None;
    }

    /// Undoes the last edit of `state`. Returns whether there was one.
    pub(crate) fn undo(&mut self, state: &mut State) -> bool {
        self.close();
        exchange(&mut self.before, &mut self.after, state)
    }

    /// Redoes the last undone edit. Returns whether there was one.
    pub(crate) fn redo(&mut self, state: &mut State) -> bool {
        self.close();
        exchange(&mut self.after, &mut self.before, state)
    }

    /// Whether an edit can be undone, and one redone.
    pub(crate) fn can(&self) -> (bool, bool) {
        (!self.before.is_empty(), !self.after.is_empty())
    }

    /// Drops all edits, as their volumes are replaced.
    pub(crate) fn clear(&mut self) {
        *self = Self::default();
    }
}

/// Restores the last of `from`, and pushes the current state to `to`.
fn exchange(from: &mut Vec<State>, to: &mut Vec<State>, state: &mut State) -> bool {
    let Some(mut other) = from.pop() else { return false };
    other.keep_navigation_of(state);
    to.push(std::mem::replace(state, other));
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard::volume::{Camera, Mode, Scene};
    use glam::DVec3;
    use proptest::prelude::*;

    #[test]
    fn every_edit_is_taken_back_and_made_again() {
        let (mut history, mut state) = (History::default(), State::default());
        let mut states = vec![state.clone()];
        for (i, kind) in ["step", "step", "time", "step"].into_iter().enumerate() {
            history.edit(&state, kind);
            state.scene.step = 1.0 + i as f64;
            if kind == "time" {
                history.close();
            }
            states.push(state.clone());
        }
        // The first two are one.
        states.remove(1);
        let mut found = vec![state.clone()];
        while history.undo(&mut state) {
            found.insert(0, state.clone());
        }
        assert_eq!(found, states);
        assert_eq!(history.can(), (false, true));
        while history.redo(&mut state) {}
        assert_eq!(Some(&state), states.last());
        history.undo(&mut state);
        history.edit(&state, "mode");
        state.scene.mode = Mode::Mip;
        assert_eq!(history.can(), (true, false), "what was taken back is given up by another edit");
    }

    #[test]
    fn the_camera_stays() {
        let (mut history, mut state) = (History::default(), State::default());
        history.edit(&state, "mode");
        state.scene.mode = Mode::Mip;
        state.scene.camera = Some(Camera::looking_at_box((DVec3::ZERO, DVec3::ONE)));
        let camera = state.scene.camera;
        assert!(history.undo(&mut state) && state.scene.mode == Mode::Dvr && state.scene.camera == camera);
    }

    proptest! {
        /// Undoing everything restores the first state, except for the views.
        #[test]
        fn undoing_everything_gives_the_first_state(windows in prop::collection::vec(crate::state::tests::window(), 1..6)) {
            let (mut history, mut state) = (History::default(), State::default());
            let first = state.clone();
            for (i, window) in windows.into_iter().enumerate() {
                history.edit(&state, &i.to_string());
                state = State { window, scene: Scene { time: i as u32, ..Scene::default() }, ..State::default() };
            }
            let mut expected = first;
            expected.keep_navigation_of(&state);
            while history.undo(&mut state) {}
            prop_assert_eq!(state, expected);
        }
    }
}
