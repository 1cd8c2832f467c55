//! Clicks made by a script. They enter the window like the pointer's: a press in one frame and the release in the next.

use eframe::egui::{Event, Modifiers, PointerButton, Pos2, RawInput, pos2};
use std::collections::VecDeque;

/// Clicks still to be made.
#[derive(Default)]
pub(crate) struct Clicks {
    waiting: VecDeque<Pos2>,
    pressed: Option<Pos2>,
    /// Whether this frame has a release, still without effect.
    is_released: bool,
}

impl Clicks {
    /// Queues a click, in points from the window's upper left corner.
    pub(crate) fn add(&mut self, [x, y]: [f64; 2]) {
        self.waiting.push_back(pos2(x as f32, y as f32));
    }

    /// Whether all clicks are made and have taken effect.
    pub(crate) fn are_done(&self) -> bool {
        self.waiting.is_empty() && self.pressed.is_none() && !self.is_released
    }

    /// Adds due clicks to a frame's input.
    pub(crate) fn play(&mut self, input: &mut RawInput) {
        let button = |pos, pressed| Event::PointerButton {
            pos,
            button: PointerButton::Primary,
            pressed,
            modifiers: Modifiers::NONE,
        };
        self.is_released = self.pressed.is_some();
        if let Some(pos) = self.pressed.take() {
            input.events.push(button(pos, false));
        } else if let Some(pos) = self.waiting.pop_front() {
            input.events.extend([Event::PointerMoved(pos), button(pos, true)]);
            self.pressed = Some(pos);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_click_is_done_in_the_frame_after_its_release() {
        let mut clicks = Clicks::default();
        clicks.add([3.0, 4.0]);
        let mut counts = Vec::new();
        while !clicks.are_done() {
            let mut input = RawInput::default();
            clicks.play(&mut input);
            counts.push(input.events.len());
        }
        assert_eq!(counts, [2, 1, 0]);
    }
}
