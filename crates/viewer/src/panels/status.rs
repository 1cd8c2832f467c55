//! The line below the picture: how far it is, what it takes, and what went wrong last.

use crate::canvas::Canvas;
use crate::panels::widgets::problem_color;
use crate::views::Views;
use brickyard::session::VolumeSource;
use eframe::egui::{Align, Label, Layout, RichText, Ui, vec2};

/// The line's height, in points.
const HEIGHT: f32 = 20.0;

/// What is said of projections that may lose extremes.
const LOST: &str = "This projection is drawn at a coarse level, whose voxels are not the extremes of those in them: specks may be fainter than they are, or missing. \
                    Level 0 (View: level) draws all voxels, and a store packed with --downsample mean,max (or mean,min) loses none at any level.";

const PAST_CUTS: &str = "This projection is drawn at a coarse level. Its voxels at a cut hold the extremes of both sides: what lies up to one of them behind the cut may \
                         show. Level 0 (View: level) cuts exactly.";

/// What the line says on its left.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Said<'a> {
    /// What has gone wrong: nothing else is said until that is over.
    pub(crate) problem: Option<&'a str>,
    /// What has been done.
    pub(crate) note: Option<&'a str>,
    /// What is under the pointer.
    pub(crate) picked: Option<&'a str>,
}

/// Shows how far the pictures are; `None` of an empty window. It is one line, whatever it says: if its height changed, so would the picture's size, and the picture
/// would have to be drawn again. Returns whether the problem is to be said no more.
pub(crate) fn show(ui: &mut Ui, views: Option<&Views>, said: &Said<'_>) -> bool {
    let line =
        ui.allocate_ui_with_layout(vec2(ui.available_width(), HEIGHT), Layout::right_to_left(Align::Center), |ui| {
            if let Some(views) = views {
                progress(ui, views);
            }
            ui.with_layout(Layout::left_to_right(Align::Center), |ui| match said.problem {
                Some(text) => problem(ui, text),
                None => {
                    words(ui, said);
                    false
                }
            })
            .inner
        });
    line.inner
}

/// Shows what has gone wrong, in one line. Returns whether it is to be said no more.
pub(crate) fn problem(ui: &mut Ui, problem: &str) -> bool {
    ui.horizontal(|ui| {
        let is_put_away = ui.small_button("dismiss").on_hover_text("says this no more").clicked();
        let text = RichText::new(one_line(problem)).color(problem_color(ui.visuals()));
        ui.add(Label::new(text).truncate()).on_hover_text(problem);
        is_put_away
    })
    .inner
}

fn words(ui: &mut Ui, said: &Said<'_>) {
    let note = said.note.map(one_line);
    let text = match (&note, said.picked) {
        (Some(note), Some(picked)) => format!("{note}    {picked}"),
        (Some(text), None) => text.clone(),
        (None, Some(picked)) => picked.into(),
        (None, None) => return,
    };
    let text = if said.picked.is_some() { RichText::new(&text).monospace() } else { RichText::new(&text) };
    let hint = text.text().to_string();
    ui.add(Label::new(text).truncate()).on_hover_text(hint);
}

/// A text without breaks.
fn one_line(text: &str) -> String {
    text.lines().collect::<Vec<_>>().join(" ")
}

/// How far the pictures are, and what memory they take, from right to left.
fn progress(ui: &mut Ui, views: &Views) {
    let (backend, host) = views.memory_bytes();
    let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    ui.label(format!("{:.0} MiB of slots, {:.0} MiB of bricks", mib(backend), mib(host)));
    ui.separator();
    ui.label(views.main.backend_line());
    ui.separator();
    ui.label(state(&views.main));
    let doubtful = views.main.doubtful_extremes();
    if !doubtful.lost.is_empty() {
        ui.separator();
        ui.label("specks may be missing").on_hover_text(LOST);
    }
    if !doubtful.past_cuts.is_empty() {
        ui.separator();
        ui.label("shows a little of what is cut away").on_hover_text(PAST_CUTS);
    }
    ui.separator();
}

/// How far a picture is, in words.
fn state(canvas: &Canvas) -> String {
    if canvas.is_failing() {
        return "not drawn".into();
    }
    let Some(status) = canvas.status() else { return "opening".into() };
    let mut words = match (canvas.is_final(), canvas.progress()) {
        _ if canvas.saves() => "saving a picture".to_string(),
        (true, _) => "final".to_string(),
        (false, Some(drawn)) => format!("drawing {:.0} %", 100.0 * drawn),
        (false, None) if status.completeness < 1.0 => format!("loading {:.0} %", 100.0 * status.completeness),
        (false, None) => "coarse while it changes".to_string(),
    };
    if status.failed > 0 {
        let mut stores = canvas.resolved().1.iter().filter_map(VolumeSource::store);
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
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable;

    #[test]
    fn what_is_done_stands_beside_values_and_a_problem_alone() {
        let show = |ui: &mut Ui, said: &mut Said<'static>| {
            if show(ui, None, said) {
                said.problem = None;
            }
        };
        let said = Said { note: Some("wrote a.png"), picked: Some("at 1, 2, 3 mm"), problem: None };
        let mut harness = Harness::new_ui_state(show, said);
        assert!(harness.query_by_label_contains("wrote a.png    at 1, 2, 3 mm").is_some());
        harness.state_mut().problem = Some("the disk\nis full");
        harness.run();
        assert!(harness.query_by_label_contains("the disk is full").is_some());
        assert!(harness.query_by_label_contains("wrote").is_none());
        harness.get_by_label("dismiss").click();
        harness.run();
        assert!(harness.query_by_label_contains("the disk is full").is_none());
    }
}
