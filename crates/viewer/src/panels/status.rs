//! The line below the picture: how far it is, what it takes, and what went wrong last.

use crate::canvas::Canvas;
use crate::views::Views;
use eframe::egui::{Align, Color32, Label, Layout, RichText, Ui, vec2};

/// The line's height, in points.
const HEIGHT: f32 = 20.0;

const MESSAGE: Color32 = Color32::from_rgb(230, 120, 60);

/// Shows how far the pictures are; `None` of an empty window. `message` is what the user is to be told, `picked` what is under the pointer; `None` if there is
/// nothing. It is one line, whatever it says: if its height changed, so would the picture's size, and the picture would have to be drawn again.
pub(crate) fn show(ui: &mut Ui, views: Option<&Views>, message: Option<&str>, picked: Option<&str>) {
    ui.allocate_ui_with_layout(vec2(ui.available_width(), HEIGHT), Layout::right_to_left(Align::Center), |ui| {
        if let Some(views) = views {
            progress(ui, views);
        }
        ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
            if let Some(message) = message {
                let text = RichText::new(message.lines().collect::<Vec<_>>().join(" ")).color(MESSAGE);
                ui.add(Label::new(text).truncate()).on_hover_text(message);
            } else if let Some(picked) = picked {
                ui.add(Label::new(RichText::new(picked).monospace()).truncate()).on_hover_text(picked);
            }
        });
    });
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
    ui.separator();
}

/// How far a picture is, in words.
fn state(canvas: &Canvas) -> String {
    let Some(status) = canvas.status() else { return "opening".into() };
    let mut words = match canvas.is_final() {
        true => "final".to_string(),
        false => format!("{:.0} % of bricks, quality {:.0} %", 100.0 * status.completeness, 100.0 * canvas.quality()),
    };
    if status.failed > 0 {
        words += &format!(", {} bricks cannot be read", status.failed);
    }
    if status.memory_bound {
        words += &format!(", as fine as memory allows ({:.1} px)", status.effective_error_px);
    }
    words
}
