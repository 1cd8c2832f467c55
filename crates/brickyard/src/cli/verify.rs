//! `brickyard verify`: every checksum and statistic of a store.

use super::failure::{ExitKind, Failure};
use super::progress::{Progress, ProgressStyleArgument};
use super::{print_json, print_line, store_errors};
use brickyard::store::{self, OpenError};
use clap::Args;
use std::path::{Path, PathBuf};

/// `brickyard verify STORE`
#[derive(Args)]
pub(crate) struct VerifyArguments {
    /// The store
    store: PathBuf,
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// How to show progress
    #[arg(long, value_enum, default_value_t)]
    progress: ProgressStyleArgument,
}

/// Runs `verify`.
///
/// # Errors
/// Exit code 5 if anything in the store is not what it should be; every problem is printed.
pub(crate) fn run(arguments: &VerifyArguments) -> Result<(), Failure> {
    let progress = Progress::new(arguments.progress, "verify");
    let report = store::verify(&arguments.store, |done, total| progress.set(done, total));
    progress.finish();
    let report = report.map_err(|error| open_failure(&error, &arguments.store))?;
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
        let count = report.problems.len();
        return Err(Failure::new(
            ExitKind::VerificationFailed,
            format!("{}: {count} problems in {} bricks", arguments.store.display(), report.bricks),
        ));
    }
    if !arguments.json {
        print_line(&format!(
            "{}: {} bricks in {} shards are sound",
            arguments.store.display(),
            report.bricks,
            report.shards
        ))?;
    }
    Ok(())
}

/// A finished store whose documents or side data are damaged has failed verification; what is none has not.
fn open_failure(error: &OpenError, store: &Path) -> Failure {
    let is_damaged = match error {
        OpenError::Invalid { .. } => true,
        OpenError::Io { path, .. } => path != store && path.starts_with(store),
        _ => false,
    };
    if is_damaged { Failure::new(ExitKind::VerificationFailed, error) } else { store_errors::open_failure(error) }
}
