//! `brickyard verify`: every checksum and statistic of a store; and its repair from the input it was packed from.

use super::failure::{ExitKind, Failure};
use super::input_args::InputArguments;
use super::interrupt::Interrupt;
use super::progress::{Progress, ProgressStyleArgument};
use super::say::say;
use super::{heading, print_json, print_line, store_errors, values};
use brickyard::addresses::is_address;
use brickyard::import::{self, OpenOptions};
use brickyard::store::{self, AppendOptions, Kind, VerifyError, VerifyReport};
use brickyard::volume::{BrickId, counted};
use clap::Args;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// `brickyard verify STORE`
#[derive(Args)]
pub(crate) struct VerifyArguments {
    /// The store
    store: PathBuf,
    /// Limit of the process's own memory
    #[arg(help_heading = heading::WORK, long, value_name = "BYTES", default_value = "2GiB", value_parser = values::bytes)]
    memory: u64,
    /// Print JSON
    #[arg(help_heading = heading::OUTPUT, long)]
    json: bool,
    /// How to show progress
    #[arg(help_heading = heading::WORK, long, value_enum, default_value_t)]
    progress: ProgressStyleArgument,
    /// Make damaged files again, from the input the store was packed from, given as for `pack` and with its flags
    /// [default: nothing is changed]
    #[arg(help_heading = heading::WORK, long, value_name = "INPUT", num_args = 0..)]
    repair: Option<Vec<PathBuf>>,
    #[command(flatten)]
    input: InputArguments,
}

/// Runs `verify`.
///
/// # Errors
/// Exit code 5 if anything in the store is wrong; every problem is printed.
pub(crate) fn run(arguments: VerifyArguments) -> Result<(), Failure> {
    let VerifyArguments { store, memory, json, progress, repair, input } = arguments;
    let mut inputs = repair.clone().unwrap_or_default();
    let options = input.options(&mut inputs)?;
    let repaired = match repair {
        Some(_) => Some(Repair { store: &store, inputs, options, memory, progress }.run(json)?),
        None if options == OpenOptions::default() => None,
        None => return Err(Failure::usage("these flags describe the input of --repair INPUT, which is missing")),
    };
    tell(&report(&store, memory, progress)?, &store, json, repaired.as_deref())
}

/// A repair of a store from its input.
struct Repair<'a> {
    store: &'a Path,
    inputs: Vec<PathBuf>,
    options: OpenOptions,
    memory: u64,
    progress: ProgressStyleArgument,
}

impl Repair<'_> {
    /// Repairs the store, and returns the files made again, which are printed unless `json`.
    ///
    /// # Errors
    /// With the message and exit code for the user.
    fn run(self, json: bool) -> Result<Vec<PathBuf>, Failure> {
        let Self { store, inputs, options, memory, progress } = self;
        if inputs.is_empty() {
            return Err(Failure::usage("--repair: expected the input the store was packed from"));
        }
        if let Some(stream) = import::stream_among(&inputs, &options.channel_arrays) {
            let problem = "--repair: a stream cannot be read again, which a repair may do; give a file";
            return Err(Failure::usage(format!("{}: {problem}", stream.display())));
        }
        let known = store::recorded_settings(store)
            .map_err(|error| store_errors::verify_failure(VerifyError::Open(error), store))?;
        let options = OpenOptions { are_labels: Some(known.kind == Kind::Labels), ..options };
        let source = import::open(&inputs, &options).map_err(|error| store_errors::import_failure(&error))?;
        let interrupt = Interrupt::watch()?;
        let shown = Progress::new(progress, "repair");
        let threads = AppendOptions::default().threads;
        let report = store::repair(store, &*source, memory, threads, |done, total| {
            // Until the damage is known there is nothing to count.
            if total > 0 {
                shown.set(done, total);
            }
            interrupt.flow()
        });
        shown.finish();
        let report = report.map_err(|error| store_errors::repair_failure(error, store))?;
        if !json {
            report.repaired.iter().try_for_each(|path| print_line(&format!("{}: repaired", path.display())))?;
        }
        report.left.iter().for_each(|problem| say!("warning: {problem}"));
        Ok(report.repaired)
    }
}

/// Verifies a store. As it only reads, Ctrl-C ends the process, also after work that Ctrl-C stops in good order.
///
/// # Errors
/// If it cannot be read.
pub(crate) fn report(store: &Path, memory: u64, style: ProgressStyleArgument) -> Result<VerifyReport, Failure> {
    let (progress, interrupt) = (Progress::new(style, "verify"), Interrupt::watch()?);
    let report = store::verify_within(store, memory, |done, total| {
        progress.set(done, total);
        interrupt.end_if_asked();
    });
    progress.finish();
    report.map_err(|error| store_errors::verify_failure(error, store))
}

/// Prints a store's report, after a repair with the files made again.
///
/// # Errors
/// Exit code 5 if it has problems.
pub(crate) fn tell(
    report: &VerifyReport,
    store: &Path,
    json: bool,
    repaired: Option<&[PathBuf]>,
) -> Result<(), Failure> {
    if json {
        let listed = |problems: &[store::VerifyProblem]| {
            let problem =
                |p: &store::VerifyProblem| serde_json::json!({ "brick": p.brick, "path": p.path, "what": p.what });
            problems.iter().map(problem).collect::<Vec<_>>()
        };
        let mut told = serde_json::json!({
            "bricks": report.bricks,
            "shards": report.shards,
            "bytes": report.bytes,
            "is_cut_short": report.is_cut_short,
            "problems": listed(&report.problems),
            "edits": listed(&report.edits),
        });
        if let Some(repaired) = repaired {
            told["repaired"] = serde_json::json!(repaired);
        }
        print_json(&told)?;
    } else {
        for problem in &report.problems {
            print_line(&problem.to_string())?;
        }
        for edit in &report.edits {
            say!("note: {edit}, edited by another program; the edited value is used");
        }
    }
    if !report.problems.is_empty() {
        let cure = match repaired {
            None if is_address(store) => "; repair the store where it lies, or put it there again",
            None => "; `verify --repair INPUT` makes damaged files again",
            Some(_) => "",
        };
        let problem = format!("{}: {}{cure}", store.display(), summary(report));
        return Err(Failure::new(ExitKind::VerificationFailed, problem));
    }
    if !json {
        let are = if report.bricks == 1 { "is" } else { "are" };
        let (bricks, shards) = (counted(report.bricks, "brick"), counted(report.shards, "shard"));
        print_line(&format!("{}: {bricks} in {shards} {are} sound", store.display()))?;
    }
    Ok(())
}

/// Describes a report's problems in one line: the number and places of damaged bricks, and the number of other
/// problems.
fn summary(report: &VerifyReport) -> String {
    let bricks = counted(report.bricks, "brick");
    let damaged: BTreeSet<BrickId> = report.problems.iter().filter_map(|problem| problem.brick).collect();
    let others = report.problems.iter().filter(|problem| problem.brick.is_none()).count() as u64;
    let damage = || {
        let are = if damaged.len() == 1 { "is" } else { "are" };
        let levels = listed("level", damaged.iter().map(|id| id.level.0.into()));
        let steps = listed("time step", damaged.iter().map(|id| id.time));
        let channels = listed("channel", damaged.iter().map(|id| id.channel));
        format!("{} of {bricks} {are} damaged, in {levels}, {steps}, {channels}", damaged.len())
    };
    let found = match (damaged.is_empty(), others) {
        (true, _) => format!("{} in {bricks}", counted(others, "problem")),
        (false, 0) => damage(),
        (false, _) => format!("{}; and {} of whole files or documents", damage(), counted(others, "problem")),
    };
    if report.is_cut_short { format!("{found}; there are more: the check stopped here") } else { found }
}

/// Lists numbers of one kind, each once: the first few, and their count if there are more.
fn listed(what: &str, numbers: impl Iterator<Item = u32>) -> String {
    const FEW: usize = 4;
    let numbers: BTreeSet<u32> = numbers.collect();
    let first: Vec<String> = numbers.iter().take(FEW).map(u32::to_string).collect();
    match numbers.len() {
        1 => format!("{what} {}", first[0]),
        count if count <= FEW => format!("{what}s {}", first.join(", ")),
        count => format!("{count} {what}s ({}, ...)", first.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard::store::VerifyProblem;
    use brickyard::volume::{BrickIndex, Level};

    fn problem(brick: Option<BrickId>) -> VerifyProblem {
        VerifyProblem { brick, path: "a.zarr/0".into(), what: "damaged".into() }
    }

    fn brick(level: u8, time: u32) -> Option<BrickId> {
        Some(BrickId { time, channel: 1, level: Level(level), index: BrickIndex::new(0, 0, time) })
    }

    #[test]
    fn damaged_bricks_are_one_line() {
        let summary = |bricks: &[Option<BrickId>]| {
            let problems = bricks.iter().copied().map(problem).collect();
            summary(&VerifyReport { bricks: 1200, problems, ..VerifyReport::default() })
        };
        assert_eq!(summary(&[brick(0, 3)]), "1 of 1200 bricks is damaged, in level 0, time step 3, channel 1");
        let twice: Vec<_> = (0..5).flat_map(|time| [brick(0, time), brick(2, time), brick(2, time)]).collect();
        let words = "10 of 1200 bricks are damaged, in levels 0, 2, 5 time steps (0, 1, 2, 3, ...), channel 1";
        assert_eq!(summary(&twice), words);
        assert_eq!(summary(&[None, None]), "2 problems in 1200 bricks");
        assert!(summary(&[None, brick(0, 0)]).ends_with("channel 1; and 1 problem of whole files or documents"));
    }
}
