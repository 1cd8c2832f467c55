//! Order of user input within a slow frame. egui takes a frame's events together: it misses drags with a press or release in the same frame, reads
//! keys before buttons, and sends text to the field Tab moves on to. So a frame gets the longest prefix of the input that egui reads in order; the
//! rest waits for the next frame.

use eframe::egui::{Context, Event, InputOptions, Key, Modifiers, RawInput};

/// Most waiting presses and keys. No user is as fast; from programs, ever later input would be worse than lost order.
const MOST: usize = 64;

/// The slowest frame, in seconds, that double clicks allow for.
const SLOWEST_S: f64 = 0.5;

/// Input that waits for its frame.
#[derive(Default)]
pub(crate) struct InputOrder {
    waiting: Vec<Event>,
}

impl InputOrder {
    /// Leaves a frame the first part of its input, after waiting input.
    pub(crate) fn split(&mut self, input: &mut RawInput) {
        let mut events = std::mem::take(&mut self.waiting);
        events.append(&mut input.events);
        if events.iter().filter(|event| !is_motion(event)).count() <= MOST {
            self.waiting = events.split_off(first_part(&events));
        }
        input.events = events;
    }

    /// Lets double clicks take two frames longer. egui times a click by its frame, and a press and a release take a frame each.
    pub(crate) fn allow_slow_clicks(egui: &Context, input: &RawInput) {
        let frame_s = input.time.map_or(0.0, |now_s| now_s - egui.input(|last| last.time)).clamp(0.0, SLOWEST_S);
        let delay_s = InputOptions::default().max_double_click_delay + 2.0 * frame_s;
        egui.options_mut(|options| options.input_options.max_double_click_delay = delay_s);
    }

    /// Whether some input waits for the next frame.
    pub(crate) fn is_waiting(&self) -> bool {
        !self.waiting.is_empty()
    }
}

fn is_motion(event: &Event) -> bool {
    matches!(event, Event::PointerMoved(_) | Event::MouseMoved(_) | Event::PointerGone)
}

fn is_typed(event: &Event) -> bool {
    matches!(event, Event::Key { pressed: true, .. } | Event::Text(_) | Event::Paste(_) | Event::Ime(_))
}

/// Summary of a part's events.
#[derive(Default)]
struct Part {
    has_motion: bool,
    has_typed: bool,
    has_tab: bool,
    /// The modifiers of its press or release.
    button: Option<Modifiers>,
}

impl Part {
    /// Whether egui reads an event in order behind the part's.
    fn takes(&self, event: &Event) -> bool {
        match event {
            Event::PointerButton { pressed, .. } => {
                self.button.is_none() && !self.has_typed && (*pressed || !self.has_motion)
            }
            Event::ModifiersChanged(modifiers) => self.button.is_none_or(|of_button| of_button == *modifiers),
            Event::Key { key: Key::Tab, pressed: true, .. } => self.button.is_none() && !self.has_typed,
            event if is_typed(event) => self.button.is_none() && !self.has_tab,
            event if is_motion(event) => self.button.is_none(),
            _ => true,
        }
    }

    fn take(&mut self, event: &Event) {
        self.has_motion |= is_motion(event);
        self.has_typed |= is_typed(event);
        match event {
            Event::PointerButton { modifiers, .. } => self.button = Some(*modifiers),
            Event::Key { key: Key::Tab, pressed: true, .. } => self.has_tab = true,
            _ => {}
        }
    }
}

/// Number of events in the first part.
fn first_part(events: &[Event]) -> usize {
    let mut part = Part::default();
    let is_behind = |event: &Event| {
        let is_behind = !part.takes(event);
        part.take(event);
        is_behind
    };
    events.iter().position(is_behind).unwrap_or(events.len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::{PointerButton, Pos2};

    fn key(key: Key) -> Event {
        Event::Key { key, physical_key: None, pressed: true, repeat: false, modifiers: Modifiers::NONE }
    }

    fn button(pressed: bool, modifiers: Modifiers) -> Event {
        Event::PointerButton { pos: Pos2::ZERO, button: PointerButton::Primary, pressed, modifiers }
    }

    /// Number of events in each frame of a user's input.
    fn parts(hand: &[Event]) -> Vec<usize> {
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
        assert_eq!(parts.concat(), hand, "nothing is lost");
        parts.iter().map(Vec::len).collect()
    }

    #[test]
    fn motion_comes_between_a_press_and_its_release_and_keys_behind_them() {
        let moved = || Event::PointerMoved(Pos2::ZERO);
        let [press, release] = [true, false].map(|pressed| button(pressed, Modifiers::NONE));
        let comma = || key(Key::Comma);
        let hand = [comma(), comma(), moved(), press.clone(), moved(), moved(), release.clone(), comma()];
        assert_eq!(parts(&hand), [3, 1, 2, 1, 1]);
        let twice = [press.clone(), release.clone(), press.clone(), release.clone()];
        assert_eq!(parts(&twice), [1; 4]);
        // New input follows waiting input.
        let (mut order, mut input) = (InputOrder::default(), RawInput::default());
        input.events = vec![press.clone(), release.clone()];
        order.split(&mut input);
        input.events = vec![comma()];
        order.split(&mut input);
        assert!(input.events == [release] && order.is_waiting());
        input.events = vec![press; MOST];
        order.split(&mut input);
        assert!(input.events.len() == MOST + 1 && !order.is_waiting(), "no hand is as fast");
    }

    /// A mouse reports motion a thousand times a second.
    #[test]
    fn motion_alone_is_never_too_much() {
        let motion = vec![Event::PointerMoved(Pos2::ZERO); 10 * MOST];
        let hand = [vec![button(true, Modifiers::NONE)], motion, vec![button(false, Modifiers::NONE)]].concat();
        assert_eq!(parts(&hand), [1, 10 * MOST, 1]);
    }

    /// Whether two clicks are one double click where frames take so long.
    fn is_double_click(frame_s: f64, hand: &[Event], later: &[Event]) -> bool {
        let (egui, mut order, mut is_double) = (Context::default(), InputOrder::default(), false);
        for frame in 0..8 {
            let mut input = RawInput { time: Some(10.0 + frame_s * f64::from(frame)), ..RawInput::default() };
            input.events = [hand, later].get(frame as usize).map_or(Vec::new(), |events| events.to_vec());
            InputOrder::allow_slow_clicks(&egui, &input);
            order.split(&mut input);
            let mut output = egui.run_ui(input, |ui| {
                is_double |= ui.input(|input| input.pointer.button_double_clicked(PointerButton::Primary));
            });
            output.textures_delta.clear();
        }
        is_double
    }

    #[test]
    fn double_clicks_are_seen_in_slow_frames() {
        let click = [true, false].map(|pressed| button(pressed, Modifiers::NONE));
        for frame_s in [0.016, 0.15, 0.4] {
            assert!(is_double_click(frame_s, &[click.clone(), click.clone()].concat(), &[]), "{frame_s}");
            assert!(is_double_click(frame_s, &click, &click), "{frame_s}: a frame between");
        }
        assert!(!is_double_click(2.0, &click, &click), "2 s are two clicks");
    }

    #[test]
    fn modifiers_are_those_of_the_click() {
        let (alt, none) = (Modifiers::ALT, Modifiers::NONE);
        let changed = Event::ModifiersChanged;
        let hand = [changed(alt), button(true, alt), changed(alt), button(false, alt), changed(alt), changed(none)];
        assert_eq!(parts(&hand), [3, 2, 1]);
    }

    #[test]
    fn text_goes_to_the_field_that_it_was_typed_into() {
        let text = |text: &str| Event::Text(text.into());
        assert_eq!(parts(&[key(Key::Num3), text("3"), key(Key::Tab), text("4"), key(Key::Enter)]), [2, 1, 2]);
        assert_eq!(parts(&[button(false, Modifiers::NONE), text("3")]), [1, 1]);
    }
}
