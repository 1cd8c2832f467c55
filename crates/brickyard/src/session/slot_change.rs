//! Changes of slot contents in a live session. Where the window of a look has become too narrow for the codes in the
//! slots, or wide enough for codes again, slots of another format take their place, and all bricks are uploaded anew. A
//! change therefore waits until the window's drag rests, and happens once. Until then the look is drawn from the
//! present slots, as exactly as they allow; while the new ones fill, the previous picture is shown, as long as nothing
//! else changes. Costs a copy of the scene for each waiting step.

use crate::session::fit::Fit;
use crate::session::volume_source::VolumeSource;
use brickyard_volume::{KeptSlots, Scene, Window};
use std::time::Duration;

/// How long windows rest before slots change: longer than pauses in a drag.
const AFTER_DRAG: Duration = Duration::from_millis(250);

/// A change of slot contents, postponed or under way.
#[derive(Default)]
pub(crate) struct SlotChange {
    put_off: Option<PutOff>,
    /// The shot of the previous picture, shown while the change is under way.
    before: Option<Shot>,
}

/// A postponed change of slots.
struct PutOff {
    /// Places and windows of the layers with a need for other slots.
    asked: Vec<(usize, Option<Window>)>,
    /// Since when they have not changed.
    since: Duration,
    /// The last step meanwhile.
    last: Option<Shot>,
}

/// A scene and the size of its picture, width and height in pixels.
#[derive(PartialEq)]
pub(crate) struct Shot {
    pub(crate) scene: Scene,
    pub(crate) size_px: (u32, u32),
}

impl SlotChange {
    /// Whether a fit's slots stay as they are in a step towards a valid scene at the time `now`, although some of its
    /// looks need others.
    pub(crate) fn is_put_off(&mut self, fit: &Fit, volumes: &[VolumeSource], scene: &Scene, now: Duration) -> bool {
        let asked: Vec<_> = (0..scene.layers.len()).filter_map(|place| asked(fit, volumes, scene, place)).collect();
        if asked.is_empty() {
            self.put_off = None;
            return false;
        }
        match &self.put_off {
            Some(put_off) if put_off.asked == asked => now.saturating_sub(put_off.since) < AFTER_DRAG,
            _ => {
                self.put_off = Some(PutOff { asked, since: now, last: None });
                true
            }
        }
    }

    /// Begins a step towards a shot. If slots change now, the previous step's picture is shown meanwhile, provided it
    /// is of the same shot.
    pub(crate) fn begin_step(&mut self, shot: &Shot, is_put_off: bool) {
        self.before.take_if(|before| before != shot);
        if is_put_off {
            return;
        }
        let last = self.put_off.take().and_then(|put_off| put_off.last);
        self.before = last.filter(|last| last == shot).or(self.before.take());
    }

    /// Ends a step towards a shot. `is_whole`: nothing more is on its way to the slots.
    pub(crate) fn end_step(&mut self, shot: Shot, is_whole: bool) {
        if let Some(put_off) = &mut self.put_off {
            put_off.last = Some(shot);
        }
        self.before.take_if(|_| is_whole);
    }

    /// Whether to show the picture from before a change.
    pub(crate) fn shows_before(&self) -> bool {
        self.before.is_some()
    }
}

/// Returns the place and window of a layer whose look needs other slots than the fit's; `None` if it needs none, or if
/// the fit's slots cannot show it at all.
fn asked(fit: &Fit, volumes: &[VolumeSource], scene: &Scene, place: usize) -> Option<(usize, Option<Window>)> {
    let layer = &*scene.look(place);
    let volume = scene.store(place);
    let slots = fit.slots_of(place, volume)?;
    let channel = volumes[volume].encoding(layer.channel);
    // An expression reads values as they are. Another channel has other codes.
    if scene.expression.is_some() || channel.in_slots(slots.floats) != slots {
        return None;
    }
    let window = Window::new(&volumes[volume].function(layer).ok()?, &layer.isosurfaces, scene.mode);
    let wanted = channel.for_window(window, KeptSlots::replaceable(slots.floats));
    (wanted.of_slots() != slots).then_some((place, window))
}
