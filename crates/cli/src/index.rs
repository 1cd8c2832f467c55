//! `brickyard index`: exact statistics, ranges and coarse levels of another program's image, kept in the user's cache; or those of a store, made again
//! after another program wrote into it.

use super::interrupt::Interrupt;
use super::progress::{Progress, ProgressStyleArgument};
use super::say::say;
use super::{Failure, heading, print_json, print_line, store_errors, values};
use brickyard::store::{self, Changes};
use brickyard::volume::counted;
use clap::Args;
use serde_json::json;
use std::path::PathBuf;

/// `brickyard index STORE`
#[derive(Args)]
pub(crate) struct IndexArguments {
    /// Another program's Zarr, or FOLDER::PATH for one of several images in it; or a store that another program wrote into
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
        let of_store = |Changes { bricks, lost_shards }| json!({ "bricks": bricks, "lost_shards": lost_shards });
        let changed = report.changes.map(of_store);
        return print_json(&json!({ "bricks": report.bricks, "bytes": report.cache_bytes, "changed": changed }));
    }
    let bricks = counted(report.bricks, "brick");
    let words = match report.changes {
        None => format!("{bricks} indexed, {} in the cache", values::human_bytes(report.cache_bytes)),
        Some(changes) => format!("{bricks} indexed, {} of the finest level changed", counted(changes.bricks, "brick")),
    };
    if let Some(lost @ 1..) = report.changes.map(|changes| changes.lost_shards) {
        let lost = counted(lost, "shard");
        say!("warning: {}: {lost} of the finest level had no file any more: zeros now", arguments.store.display());
    }
    print_line(&format!("{}: {words}", arguments.store.display()))
}
