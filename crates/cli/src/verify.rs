//! `brickyard verify`: every checksum and statistic of a store.

use super::failure::{ExitKind, Failure};
use super::heading;
use super::progress::{Progress, ProgressStyleArgument};
use super::values;
use super::{print_json, print_line, store_errors};
use brickyard::store;
use brickyard::volume::counted;
use clap::Args;
use std::path::PathBuf;

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
}

/// Runs `verify`.
///
/// # Errors
/// Exit code 5 if anything in the store is not what it should be; every problem is printed.
pub(crate) fn run(arguments: &VerifyArguments) -> Result<(), Failure> {
    let progress = Progress::new(arguments.progress, "verify");
    let report = store::verify_within(&arguments.store, arguments.memory, |done, total| progress.set(done, total));
    progress.finish();
    let report = report.map_err(|error| store_errors::verify_failure(error, &arguments.store))?;
    if arguments.json {
        let problem =
            |p: &store::VerifyProblem| serde_json::json!({ "brick": p.brick, "path": p.path, "what": p.what });
        print_json(&serde_json::json!({
            "bricks": report.bricks,
            "shards": report.shards,
            "bytes": report.bytes,
            "problems": report.problems.iter().map(problem).collect::<Vec<_>>(),
        }))?;
    } else {
        for problem in &report.problems {
            print_line(&problem.to_string())?;
        }
    }
    if !report.problems.is_empty() {
        let count = counted(report.problems.len() as u64, "problem");
        return Err(Failure::new(
            ExitKind::VerificationFailed,
            format!("{}: {count} in {}", arguments.store.display(), counted(report.bricks, "brick")),
        ));
    }
    if !arguments.json {
        print_line(&format!(
            "{}: {} in {} are sound",
            arguments.store.display(),
            counted(report.bricks, "brick"),
            counted(report.shards, "shard")
        ))?;
    }
    Ok(())
}
