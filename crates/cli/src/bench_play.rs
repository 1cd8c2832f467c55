//! `brickyard bench --scenario play,scrub`: measured playbacks of time steps, as a table.

use super::named::Named;
use super::{heading, values};
use brickyard::pager::{Ending, Playback, Policy};
use brickyard_measure::playing::PlayReport;
use clap::Args;

/// The flags of playbacks.
#[derive(Args)]
pub(super) struct PlayArguments {
    /// Requested steps per second of `play`
    #[arg(help_heading = heading::MEASURED, long, value_name = "R", default_value = "20", value_parser = values::positive, allow_negative_numbers = true)]
    rate: f64,
    /// Policy of `play` when it cannot hold the rate
    #[arg(help_heading = heading::MEASURED, long, value_parser = POLICIES, default_value = "hold-rate")]
    policy: Policy,
    /// Number of time steps of `play` and jumps of `scrub`, cyclic if the stores have fewer
    #[arg(help_heading = heading::MEASURED, long, value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u32).range(1..))]
    pub(super) steps: u32,
    /// Draw nothing in `play` and `scrub`: measure streaming alone, up to the draw lists
    #[arg(help_heading = heading::MEASURED, long)]
    pub(super) no_drawing: bool,
}

const POLICIES: Named<Policy> = Named(&[
    ("hold-rate", Policy::HoldRate, "Show every step on time, as coarse as necessary"),
    ("hold-quality", Policy::HoldQuality, "Show only complete steps at the wanted level, and drop late ones"),
    ("every-step", Policy::EveryStep, "Show every step, complete, however long it takes"),
]);

impl PlayArguments {
    pub(super) fn playback(&self) -> Playback {
        Playback { steps_per_second: self.rate, is_backward: false, ending: Ending::Loop, policy: self.policy }
    }
}

pub(super) fn mib(bytes: u64) -> f64 {
    bytes as f64 / (1 << 20) as f64
}

/// Formats three whole numbers for one cell.
pub(super) fn three(numbers: [f64; 3]) -> String {
    numbers.map(|number| format!("{number:.0}")).join(" / ")
}

pub(super) const HEAD: &str = "\
| stores | scenario | start ms | steps/s | shown, late, dropped | levels shown, finest first | jump ms p50 / p95 | whole ms p50 / p95 | quality | draw ms p50 / p95 | \
stream ms p50 / p95 | CPU ms a step | bricks decoded / uploaded / shared a step | read / decoded / uploaded KiB a step | limit | backend / host / anonymous MiB | uncovered, mixed |
| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |";

pub(super) fn line(stores: &str, scenario: &str, r: &PlayReport) -> String {
    let kib = |bytes: u64| bytes as f64 / 1024.0;
    let levels: Vec<String> = r.levels.iter().map(|share| format!("{:.0} %", share * 100.0)).collect();
    format!(
        "| {stores} | {scenario} | {:.0} | {:.1} | {}, {}, {} | {} | {:.0} / {:.0} | {:.0} / {:.0} | {:.0} % | {:.1} / {:.1} | {:.2} / {:.2} | {:.1} | \
         {:.1} / {:.1} / {:.1} | {} | {} | {} | {}, {} |",
        r.start_ms,
        r.steps_per_second,
        r.shown,
        r.late,
        r.dropped,
        levels.join(" "),
        r.jump_ms.p50,
        r.jump_ms.p95,
        r.settle_ms.p50,
        r.settle_ms.p95,
        r.quality * 100.0,
        r.draw_ms.p50,
        r.draw_ms.p95,
        r.step_ms.p50,
        r.step_ms.p95,
        r.processor_ms_per_step,
        r.decoded_per_step,
        r.uploaded_per_step,
        r.shared_per_step,
        three([r.bytes_per_step.read, r.bytes_per_step.decoded, r.bytes_per_step.uploaded].map(kib)),
        r.limit,
        three([r.gpu_bytes_peak, r.host_bytes_peak, r.anonymous_peak].map(mib)),
        r.uncovered,
        r.mixed,
    )
}
