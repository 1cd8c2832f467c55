//! Progress on standard error: a bar on a terminal, lines elsewhere, JSON for machines, or nothing.

use super::say;
use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::{IsTerminal, Write};
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// The style of progress.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum ProgressStyleArgument {
    /// A bar on a terminal, else plain
    #[default]
    Auto,
    /// A line every few seconds
    Plain,
    /// A JSON object per line
    Json,
    /// Nothing
    None,
}

/// A running count of bytes, shared by threads.
pub(crate) struct Progress {
    bar: Option<ProgressBar>,
    lines: Option<Mutex<Lines>>,
}

struct Lines {
    json: bool,
    what: &'static str,
    started: Instant,
    last: Option<Instant>,
}

impl Progress {
    /// Starts at zero; `what` names the work in a word.
    pub(crate) fn new(style: ProgressStyleArgument, what: &'static str) -> Self {
        let style = if say::is_quiet() { ProgressStyleArgument::None } else { style };
        let on_terminal = std::io::stderr().is_terminal();
        let bar = (style == ProgressStyleArgument::Auto && on_terminal).then(|| {
            let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr_with_hz(5));
            let template = "{prefix} {wide_bar} {bytes}/{total_bytes} {binary_bytes_per_sec} {eta}";
            bar.set_style(ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar.with_prefix(what)
        });
        let lines = (bar.is_none() && style != ProgressStyleArgument::None).then(|| {
            let json = style == ProgressStyleArgument::Json;
            Mutex::new(Lines { json, what, started: Instant::now(), last: None })
        });
        Self { bar, lines }
    }

    /// Shows `done` of `total` bytes.
    pub(crate) fn set(&self, done: u64, total: u64) {
        if let Some(bar) = &self.bar {
            bar.set_length(total);
            bar.set_position(done);
        }
        if let Some(lines) = &self.lines
            && let Ok(mut lines) = lines.lock()
        {
            lines.set(done, total);
        }
    }

    pub(crate) fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

impl Lines {
    fn set(&mut self, done: u64, total: u64) {
        let wait = if self.json { Duration::from_millis(500) } else { Duration::from_secs(5) };
        if done < total && self.last.unwrap_or(self.started).elapsed() < wait {
            return;
        }
        self.last = Some(Instant::now());
        let seconds = self.started.elapsed().as_secs_f64();
        let rate = done as f64 / seconds.max(1e-9);
        let eta_s = (total.saturating_sub(done)) as f64 / rate.max(1.0);
        let line = if self.json {
            let what = self.what;
            serde_json::json!({ "what": what, "bytes": done, "total": total, "seconds": seconds, "eta_s": eta_s })
                .to_string()
        } else {
            let percent = 100.0 * done as f64 / total.max(1) as f64;
            // Before the first bytes there is no rate to go by.
            let left = if done > 0 { format!(", {eta_s:.0} s left") } else { String::new() };
            format!("{}: {percent:.0} %, {:.0} MB/s{left}", self.what, rate / 1e6)
        };
        let _ = writeln!(std::io::stderr(), "{line}");
    }
}
