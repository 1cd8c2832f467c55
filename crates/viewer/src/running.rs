//! The window from opening to end. It outlives its drawing device: after a loss it is closed on the display and reopened on another device, with its
//! whole state. Repeated losses end it.
//!
//! ```text
//! open ──► device ──► frames ──► closed by the user
//!            ▲           └─► lost ──► the third time within seconds the CPU draws the volumes, the fourth time it is an error
//!            └──────────────────┘
//! ```

use crate::WindowError;
use crate::device::{self, Device};
use crate::guard::{guarded, own};
use crate::handover::{Handover, viewport};
use crate::window::Window;
use eframe::egui::{self, Ui, ViewportBuilder};
use eframe::egui_wgpu::{WgpuConfiguration, WgpuError};
use eframe::{CreationContext, NativeOptions};
use std::time::{Duration, Instant};

/// Least width and height of a window in points, unless it starts out smaller.
const LEAST_SIZE: [f32; 2] = [640.0, 400.0];

/// Longest time between two losses in a row.
const SOON: Duration = Duration::from_secs(10);

/// Losses in a row until the CPU draws the volumes.
const TRIED: u32 = 3;

/// Fate of a window after the loss of its device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Next {
    /// Another device draws it.
    Again,
    /// Another device draws it, except for the volumes, which the CPU draws.
    OnCpu,
    /// It ends: devices come and go too fast.
    End,
}

/// Device losses so far.
#[derive(Default)]
struct Losses {
    in_a_row: u32,
    last: Option<Instant>,
}

impl Losses {
    /// Records a loss, and decides the window's fate.
    fn note(&mut self, now: Instant) -> Next {
        let is_soon = self.last.is_some_and(|last| now.duration_since(last) < SOON);
        self.in_a_row = if is_soon { self.in_a_row + 1 } else { 1 };
        self.last = Some(now);
        match self.in_a_row {
            TRIED => Next::OnCpu,
            times if times > TRIED => Next::End,
            _ => Next::Again,
        }
    }
}

/// A window on the display, as long as its device lasts.
struct Shown<'a>(&'a mut Window);

impl eframe::App for Shown<'_> {
    fn raw_input_hook(&mut self, egui: &egui::Context, input: &mut egui::RawInput) {
        own(|| self.0.take_input(egui, input));
    }

    fn ui(&mut self, ui: &mut Ui, _frame: &mut eframe::Frame) {
        own(|| self.0.frame(ui));
    }

    fn on_exit(&mut self) {
        own(|| self.0.end());
    }
}

/// Opens a window of a size in points, and returns when it is closed.
///
/// # Errors
/// If it cannot be opened, or its device is lost without another one, or repeatedly. The message contains advice.
pub(crate) fn run(window: &mut Window, size: [f32; 2]) -> Result<(), WindowError> {
    // In anything smaller the panels leave no room for a picture.
    let least = [size[0].min(LEAST_SIZE[0]), size[1].min(LEAST_SIZE[1])];
    let mut viewport = viewport(&window.paths()).with_inner_size(size).with_min_inner_size(least);
    let (mut losses, mut next, mut lost) = (Losses::default(), Next::Again, None);
    loop {
        let reason = lost.as_ref().map(|left: &Handover| left.reason.clone());
        let ended = show(window, viewport, lost.take(), next == Next::OnCpu);
        let Some(left) = window.leave() else {
            // A window that ended by itself has not had this call.
            window.end();
            let problem = |problem| match reason {
                Some(reason) => format!("the GPU was lost ({reason}), and no other can be opened: {problem}"),
                None => problem,
            };
            return ended.map_err(|error| WindowError(problem(error)));
        };
        tracing::warn!("the GPU was lost: {}", left.reason);
        next = losses.note(Instant::now());
        if next == Next::End {
            return Err(WindowError(format!(
                "the GPU was lost {} times within seconds: {}: `brickyard doctor` reports this machine's abilities, \
                 and `brickyard render --backend cpu` draws without a GPU",
                losses.in_a_row, left.reason
            )));
        }
        viewport = left.viewport.clone();
        lost = Some(left);
    }
}

/// Shows a window until it is closed or its device is lost. `lost` is the handover from its previous device.
///
/// # Errors
/// If it cannot be opened, or the display fails: a message for the user.
fn show(window: &mut Window, viewport: ViewportBuilder, lost: Option<Handover>, is_on_cpu: bool) -> Result<(), String> {
    let wgpu_options = WgpuConfiguration { wgpu_setup: device::setup(is_on_cpu), ..WgpuConfiguration::default() };
    // Dithering would alter the picture's pixels.
    let native = NativeOptions { viewport, wgpu_options, dithering: false, ..NativeOptions::default() };
    let shown = &mut *window;
    let open = move |creation: &CreationContext<'_>| {
        let state = creation.wgpu_render_state.as_ref().ok_or("the window is not drawn with wgpu")?;
        let device = Device::new(state, &creation.egui_ctx);
        if let Some(left) = lost {
            creation.egui_ctx.memory_mut(|memory| *memory = left.memory);
            shown.take_up(match is_on_cpu {
                false => "the GPU was lost and has been opened again",
                true => "the GPU was lost repeatedly: the CPU draws the volumes now",
            });
        }
        own(|| shown.draw_on(device, is_on_cpu))?;
        Ok(Box::new(Shown(shown)) as Box<dyn eframe::App>)
    };
    match guarded(|| eframe::run_native("brickyard", native, Box::new(open))) {
        Ok(ended) => ended.map_err(|error| refusal(&error)),
        Err(panic) => {
            let what = if window.has_begun() { "the window cannot go on" } else { "cannot open a window" };
            Err(format!(
                "{what}: {panic}: this display or its driver cannot show the window; `brickyard render` writes \
                 pictures without one"
            ))
        }
    }
}

/// The message for a window that does not open.
fn refusal(error: &eframe::Error) -> String {
    if let eframe::Error::Wgpu(WgpuError::CustomNativeAdapterSelectionError(reason)) = error {
        return format!(
            "cannot open a window: {reason}: `brickyard doctor` lists the adapters; mesa's software Vulkan (lavapipe) \
             draws on every display of 24 bits a pixel"
        );
    }
    let hint = match error {
        eframe::Error::Winit(_) | eframe::Error::WinitEventLoop(_) => {
            "is there a display? `brickyard render` writes pictures without one"
        }
        eframe::Error::Wgpu(_) => {
            "no Vulkan, Metal or DirectX 12 draws on this display; mesa's software Vulkan (lavapipe) will do"
        }
        eframe::Error::AppCreation(_) => "`brickyard doctor` reports this machine's abilities",
    };
    // The text before the reason names files of the window system's crates, which helps nobody.
    let error = error.to_string();
    let reason = error.rsplit(": ").find(|part| part.len() > 2).unwrap_or(&error).trim_end_matches('.');
    format!("cannot open a window: {reason}: {hint}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn losses_in_a_row_end_on_the_cpu_and_then_in_an_error() {
        let (mut losses, now) = (Losses::default(), Instant::now());
        let mut after = |seconds| losses.note(now + Duration::from_secs(seconds));
        assert_eq!([0, 3, 6, 9].map(&mut after), [Next::Again, Next::Again, Next::OnCpu, Next::End]);
        // After a while without a loss, the next one counts as the first.
        assert_eq!([30, 45, 46, 47].map(&mut after), [Next::Again, Next::Again, Next::Again, Next::OnCpu]);
    }
}
