//! `brickyard upgrade`: another version of OME-Zarr for a finished store's metadata.

use super::say::say;
use super::{Failure, heading, print_json, print_line, store_errors};
use brickyard::store::{self, Ngff};
use clap::Args;
use std::path::PathBuf;

/// `brickyard upgrade STORE --ngff 0.6`
#[derive(Args)]
pub(crate) struct UpgradeArguments {
    /// The store, whose labels in its folder change with it
    store: PathBuf,
    /// Version of OME-Zarr, 0.5 or 0.6; the way back is the same command
    #[arg(help_heading = heading::STORE, long, value_name = "VERSION", default_value_t = Ngff::V06)]
    ngff: Ngff,
    /// Make all checks, print the documents that would change, and change nothing
    #[arg(help_heading = heading::OUTPUT, long)]
    dry_run: bool,
    /// Print the changed documents as JSON
    #[arg(help_heading = heading::OUTPUT, long)]
    json: bool,
}

/// Runs `upgrade`.
///
/// # Errors
/// With the message and exit code for the user.
pub(crate) fn run(arguments: &UpgradeArguments) -> Result<(), Failure> {
    let &UpgradeArguments { ref store, ngff, dry_run, json } = arguments;
    let upgraded = if dry_run { store::rehearse_upgrade(store, ngff) } else { store::upgrade(store, ngff) };
    let report = upgraded.map_err(store_errors::upgrade_failure)?;
    if json {
        let changed = &report.changed;
        let version = ngff.name();
        print_json(&serde_json::json!({ "store": store, "dry_run": dry_run, "ngff": version, "changed": changed }))?;
    } else {
        report.changed.iter().try_for_each(|path| print_line(&format!("{}: OME-Zarr {ngff}", path.display())))?;
    }
    if report.changed.is_empty() {
        say!("{} is OME-Zarr {ngff} already", store.display());
    }
    for group in &report.stale_groups {
        let what = "holds a copy of this store's metadata of the former version: consolidate it anew";
        say!("warning: {}: {what} (zarr.consolidate_metadata)", group.display());
    }
    if dry_run {
        say!("note: {} is unchanged (--dry-run)", store.display());
    }
    Ok(())
}
