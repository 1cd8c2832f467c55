//! `brickyard index`: exact statistics, ranges and coarse levels of another program's image, kept in the user's cache.

use super::interrupt::Interrupt;
use super::progress::{Progress, ProgressStyleArgument};
use super::{Failure, heading, print_json, print_line, store_errors, values};
use brickyard::store;
use brickyard::volume::counted;
use clap::Args;
use std::path::PathBuf;

/// `brickyard index STORE`
#[derive(Args)]
pub(crate) struct IndexArguments {
    /// Another program's Zarr, or FOLDER::PATH for one of several images in it
    store: PathBuf,
    /// Print JSON
    #[arg(help_heading = heading::OUTPUT, long)]
    json: bool,
    /// How to show progress
    #[arg(help_heading = heading::WORK, long, value_enum, default_value_t)]
    progress: ProgressStyleArgument,
}

/// Runs `index`.
///
/// # Errors
/// With the message and exit code for the user.
pub(crate) fn run(arguments: &IndexArguments) -> Result<(), Failure> {
    let (progress, interrupt) = (Progress::new(arguments.progress, "index"), Interrupt::watch()?);
    let report = store::index(&arguments.store, |done, total| {
        progress.set(done, total);
        interrupt.flow()
    });
    progress.finish();
    let report = report.map_err(store_errors::index_failure)?;
    if arguments.json {
        return print_json(&serde_json::json!({ "bricks": report.bricks, "bytes": report.bytes }));
    }
    let (bricks, bytes) = (counted(report.bricks, "brick"), values::human_bytes(report.bytes));
    print_line(&format!("{}: {bricks} indexed, {bytes} in the cache", arguments.store.display()))
}
