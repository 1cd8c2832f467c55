//! The line below the picture: its progress, its memory, and the last problem.

use crate::canvas::Canvas;
use crate::messages::Messages;
use crate::panels::widgets::problem_color;
use crate::read_out::ReadOut;
use crate::views::Views;
use brickyard::addresses::{Traffic, traffic};
use brickyard::session::VolumeSource;
use eframe::egui::{Align, Color32, Label, Layout, RichText, TextStyle, TextWrapMode, Ui, vec2};

/// Height of the line, in points.
const HEIGHT: f32 = 20.0;

/// Largest share of the line's left for a problem, and the width of its button in points. The rest is for the read-out.
const MOST_OF_PROBLEM: f32 = 0.5;
const DISMISS: f32 = 70.0;

/// Space behind a note, in points.
const GAP: f32 = 16.0;

/// Warnings about projections.
const LOST: &str = "This projection is drawn at a coarse level, whose voxels lack the extremes of the finer ones: \
                    specks may be fainter than they are, or missing. Level 0 (sampling: level) draws all voxels, and a \
                    store packed with --downsample mean,max (or mean,min) loses none at any level.";

const PAST_CUTS: &str = "This projection is drawn at a coarse level. Its voxels at a cut hold the extremes of both \
                         sides: values up to one voxel behind the cut may show. Level 0 (sampling: level) cuts exactly.";

/// Shows the progress of the pictures; `None` for an empty window. It is always one line: another height would change the picture's size and cause a
/// redraw. Returns whether the problem is too long for it, and has to be shown elsewhere.
pub(crate) fn show(ui: &mut Ui, views: Option<&Views>, messages: &mut Messages, picked: Option<&ReadOut>) -> bool {
    let line =
        ui.allocate_ui_with_layout(vec2(ui.available_width(), HEIGHT), Layout::right_to_left(Align::Center), |ui| {
            if let Some(views) = views {
                progress(ui, views);
            }
            ui.with_layout(Layout::left_to_right(Align::Center), |ui| left(ui, messages, picked)).inner
        });
    line.inner
}

/// Shows the texts on the line's left. The pointer does not affect a problem's place.
fn left(ui: &mut Ui, messages: &mut Messages, picked: Option<&ReadOut>) -> bool {
    let most = MOST_OF_PROBLEM * ui.available_width();
    let is_long = |text: &str| width(ui, &one_line(text), TextStyle::Body) + DISMISS >= most;
    let is_long = messages.problem().is_some_and(is_long);
    if !is_long {
        problem(ui, messages, TextWrapMode::Truncate);
    }
    words(ui, messages.note(), picked);
    is_long
}

/// Shows the problem, if any, truncated to one line or wrapped, until the user dismisses it.
pub(crate) fn problem(ui: &mut Ui, messages: &mut Messages, wrap: TextWrapMode) {
    let Some(problem) = messages.problem() else { return };
    let is_dismissed = ui.horizontal(|ui| {
        let is_dismissed = ui.small_button("dismiss").on_hover_text("hides this message").clicked();
        let text = RichText::new(one_line(problem)).color(problem_color(ui.visuals()));
        ui.add(Label::new(text).wrap_mode(wrap)).on_hover_text(problem);
        is_dismissed
    });
    if is_dismissed.inner {
        messages.dismiss();
    }
}

/// Shows a note, in the room before the read-out.
fn words(ui: &mut Ui, note: Option<&str>, picked: Option<&ReadOut>) {
    let room = ui.available_width();
    let note = note.map(|note| (one_line(note), width(ui, &one_line(note), TextStyle::Body) + GAP));
    let of_note = note.as_ref().map_or(0.0, |(_, width)| width.min(0.5 * room));
    let has_room = |text: &str| width(ui, text, TextStyle::Monospace) < room - of_note;
    let values = picked.map(|picked| (picked.fitting(has_room), picked.all()));
    if let Some((note, wanted)) = note {
        let of_values = values.as_ref().map_or(0.0, |(text, _)| width(ui, text, TextStyle::Monospace) + GAP);
        let size = vec2(wanted.min(room - of_values).max(0.0), HEIGHT);
        ui.allocate_ui(size, |ui| ui.add(Label::new(&note).truncate()).on_hover_text(&note));
    }
    if let Some((text, all)) = values {
        ui.add(Label::new(RichText::new(text).monospace()).truncate()).on_hover_text(all);
    }
}

/// Width of a text in one line, in points.
fn width(ui: &Ui, text: &str, style: TextStyle) -> f32 {
    ui.painter().layout_no_wrap(text.into(), style.resolve(ui.style()), Color32::WHITE).size().x
}

fn one_line(text: &str) -> String {
    text.lines().collect::<Vec<_>>().join(" ")
}

/// Shows the progress of the pictures, and their memory, from right to left.
fn progress(ui: &mut Ui, views: &Views) {
    let (backend, host) = views.memory_bytes();
    let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    ui.label(format!("{:.0} MiB of slots, {:.0} MiB of bricks", mib(backend), mib(host)));
    ui.separator();
    ui.label(views.main.backend_line());
    ui.separator();
    ui.label(state(&views.main));
    fetched(ui, traffic());
    let doubtful = views.main.doubtful_extremes();
    if !doubtful.lost.is_empty() {
        ui.separator();
        ui.label("specks may be missing").on_hover_text(LOST);
    }
    if !doubtful.past_cuts.is_empty() {
        ui.separator();
        ui.label("cuts are not exact").on_hover_text(PAST_CUTS);
    }
    ui.separator();
}

/// Shows what came from addresses, if anything was asked for.
fn fetched(ui: &mut Ui, traffic: Traffic) {
    let Traffic { requests, bytes, failures, cancelled, unconfirmed, request_time } = traffic;
    if requests == 0 && unconfirmed == 0 {
        return;
    }
    ui.separator();
    let took = request_time.as_millis();
    let hint = format!(
        "{requests} requests, {failures} of them failed, {cancelled} were ended unneeded; the last ones took {took} ms"
    );
    ui.label(format!("{:.1} MB fetched", bytes as f64 / 1e6)).on_hover_text(hint);
    if unconfirmed > 0 {
        ui.separator();
        let hint = "a server could not be reached: what it gave before is shown, from this machine's disk";
        ui.colored_label(problem_color(ui.visuals()), "offline").on_hover_text(hint);
    }
}

/// The progress of a picture, in words.
fn state(canvas: &Canvas) -> String {
    if canvas.is_failing() {
        return "not drawn".into();
    }
    let Some(status) = canvas.status() else { return "opening".into() };
    let volumes = &canvas.resolved().1;
    let making = volumes.iter().filter_map(VolumeSource::store).find_map(|store| store.making());
    let mut words = match (canvas.is_final(), canvas.progress()) {
        _ if canvas.saves() => "saving a picture".to_string(),
        (true, _) => "final".to_string(),
        (false, Some(drawn)) => format!("drawing {:.0} %", 100.0 * drawn),
        (false, None) if status.completeness < 1.0 => match making {
            Some(making) => making.to_string(),
            None => format!("loading {:.0} %", 100.0 * status.completeness),
        },
        (false, None) => "coarse while it changes".to_string(),
    };
    if status.failed > 0 {
        let mut stores = volumes.iter().filter_map(VolumeSource::store);
        words += &match stores.find(|store| store.is_replaced()) {
            Some(store) => format!(", {} was replaced, moved or deleted: open it again", store.path().display()),
            None => format!(", {} bricks cannot be read", status.failed),
        };
    }
    if status.memory_bound {
        words += &format!(", as fine as memory allows ({:.1} px)", status.effective_error_px);
    }
    words
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::About;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable;

    /// The line with its messages; and whether the problem is too long.
    fn harness<'a>(
        width: f32,
        problem: &str,
        note: Option<&str>,
        picked: &'a ReadOut,
    ) -> Harness<'a, (Messages, bool)> {
        let mut messages = Messages::default();
        messages.say(About::Work, problem);
        note.into_iter().for_each(|note| messages.notice(note.into()));
        let show = |ui: &mut Ui, (messages, is_long): &mut (Messages, bool)| {
            *is_long = show(ui, None, messages, Some(picked));
        };
        Harness::builder().with_size(vec2(width, 40.0)).build_ui_state(show, (messages, false))
    }

    fn read_out(count: u32) -> ReadOut {
        let value = |i| format!("  layer{i} {i}");
        ReadOut { place: "at 1, 2, 3 mm".into(), values: (1..=count).map(value).collect() }
    }

    #[test]
    fn a_problem_and_what_is_done_stand_beside_values() {
        let picked = read_out(1);
        let mut harness = harness(900.0, "the disk\nis full", Some("wrote a.png"), &picked);
        harness.run();
        for text in ["the disk is full", "wrote a.png", "at 1, 2, 3 mm  layer1 1"] {
            assert!(harness.query_by_label(text).is_some(), "{text}");
        }
        harness.get_by_label("dismiss").click();
        harness.run();
        assert!(harness.query_by_label("the disk is full").is_none());
        assert_eq!(harness.state().0.problem(), None);
    }

    #[test]
    fn what_has_no_room_is_counted_or_said_elsewhere() {
        let (picked, long) = (read_out(30), "the disk is full ".repeat(9));
        let harness = harness(400.0, &long, None, &picked);
        assert!(harness.state().1);
        assert!(harness.query_by_label("dismiss").is_none());
        assert!(harness.query_by_label_contains("at 1, 2, 3 mm  layer1 1  layer2 2  layer3 3  +27").is_some());
    }
}
