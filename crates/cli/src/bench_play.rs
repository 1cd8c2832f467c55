//! `brickyard bench --scenario play,scrub`: measured playbacks of time steps, as a table.

use super::named::Named;
use super::{heading, values};
use brickyard::pager::{Ending, Playback, Policy};
use brickyard::stats::Percentiles;
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

pub(super) fn line(stores: &str, scenario: &str, report: &PlayReport) -> String {
    let pair = |of: &Percentiles, digits: usize| format!("{:.digits$} / {:.digits$}", of.p50, of.p95);
    let PlayReport { start_ms, steps_per_second, shown, late, dropped, limit, uncovered, mixed, .. } = report;
    let PlayReport { processor_ms_per_step, decoded_per_step, uploaded_per_step, shared_per_step, .. } = report;
    let levels: Vec<String> = report.levels.iter().map(|share| format!("{:.0} %", share * 100.0)).collect();
    let (levels, quality) = (levels.join(" "), report.quality * 100.0);
    let (jump, whole) = (pair(&report.jump_ms, 0), pair(&report.settle_ms, 0));
    let (draw, stream) = (pair(&report.draw_ms, 1), pair(&report.step_ms, 2));
    let bytes = &report.bytes_per_step;
    let traffic = three([bytes.read, bytes.decoded, bytes.uploaded].map(|bytes| bytes as f64 / 1024.0));
    let memory = three([report.gpu_bytes_peak, report.host_bytes_peak, report.anonymous_peak].map(mib));
    format!(
        "| {stores} | {scenario} | {start_ms:.0} | {steps_per_second:.1} | {shown}, {late}, {dropped} | {levels} | \
         {jump} | {whole} | {quality:.0} % | {draw} | {stream} | {processor_ms_per_step:.1} | \
         {decoded_per_step:.1} / {uploaded_per_step:.1} / {shared_per_step:.1} | {traffic} | {limit} | {memory} | \
         {uncovered}, {mixed} |"
    )
}
