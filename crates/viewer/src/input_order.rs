//! Order of what a hand does, also within one slow frame. A frame sees a press and a release of a button at once, and forgets the drag between them; and it does
//! what keys say before what the pointer does. So each frame gets one press or release at most, and no keys behind it; the rest waits for the next frame.

use eframe::egui::{Event, RawInput};

/// How much may wait. A hand is not as fast as that: where programs are, input that waited ever longer would be worse than input whose order is lost.
const MOST: usize = 64;

/// Input that waits for its frame.
#[derive(Default)]
pub(crate) struct InputOrder {
    waiting: Vec<Event>,
}

impl InputOrder {
    /// Leaves to a frame the part of its input, and of what waited for it, that it can tell the order of.
    pub(crate) fn split(&mut self, input: &mut RawInput) {
        let mut events = std::mem::take(&mut self.waiting);
        events.append(&mut input.events);
        if events.len() <= MOST {
            self.waiting = events.split_off(first_part(&events));
        }
        input.events = events;
    }

    /// Whether some input waits for the next frame.
    pub(crate) fn is_waiting(&self) -> bool {
        !self.waiting.is_empty()
    }
}

/// How many of these events a frame can tell the order of.
fn first_part(events: &[Event]) -> usize {
    let (mut has_button, mut has_key) = (false, false);
    let goes_behind = |event: &Event| {
        let (is_button, is_key) = match event {
            Event::PointerButton { .. } => (true, false),
            Event::Key { pressed, .. } => (false, *pressed),
            _ => (false, false),
        };
        let is_behind = has_button && (is_button || is_key) || has_key && is_button;
        (has_button, has_key) = (has_button || is_button, has_key || is_key);
        is_behind
    };
    events.iter().position(goes_behind).unwrap_or(events.len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::{Key, Modifiers, PointerButton, Pos2};

    fn key() -> Event {
        Event::Key { key: Key::Comma, physical_key: None, pressed: true, repeat: false, modifiers: Modifiers::NONE }
    }

    fn button(pressed: bool) -> Event {
        Event::PointerButton { pos: Pos2::ZERO, button: PointerButton::Primary, pressed, modifiers: Modifiers::NONE }
    }

    #[test]
    fn a_frame_has_one_press_or_release_and_no_key_behind_it() {
        let moved = || Event::PointerMoved(Pos2::ZERO);
        let hand =
            [key(), key(), moved(), button(true), moved(), moved(), button(false), key(), button(true), button(false)];
        let mut order = InputOrder::default();
        let mut parts = Vec::new();
        let mut input = RawInput { events: hand.to_vec(), ..RawInput::default() };
        loop {
            order.split(&mut input);
            parts.push(input.events.clone());
            if !order.is_waiting() {
                break;
            }
            input = RawInput::default();
        }
        assert_eq!(parts.iter().map(Vec::len).collect::<Vec<_>>(), [3, 3, 1, 1, 1, 1]);
        assert_eq!(parts.concat(), hand, "nothing is lost");
        // What comes meanwhile comes after what waits.
        input.events = vec![button(true), button(false)];
        order.split(&mut input);
        input.events = vec![key()];
        order.split(&mut input);
        assert!(input.events == [button(false)] && order.is_waiting());
        input.events = vec![button(true); MOST];
        order.split(&mut input);
        assert!(input.events.len() == MOST + 1 && !order.is_waiting(), "no hand is as fast");
    }
}
