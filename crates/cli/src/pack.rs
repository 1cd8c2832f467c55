//! `brickyard pack`: foreign files into a brick store.

use super::input_args::InputArguments;
use super::pack_settings::PackSettings;
use super::{Failure, store_errors};
use brickyard::import::{self, OpenOptions};
use clap::Args;
use std::path::PathBuf;

/// `brickyard pack INPUT... STORE`
#[derive(Args)]
pub(crate) struct PackArguments {
    /// Input files, a folder of files of one format, or a quoted pattern (step_*.npy, step_%04d.raw), then the store to
    /// create; several files are time steps, or planes
    #[arg(required = true, num_args = 1.., value_name = "INPUT... STORE")]
    paths: Vec<PathBuf>,
    #[command(flatten)]
    input: InputArguments,
    #[command(flatten)]
    settings: PackSettings,
}

/// Runs `pack`.
///
/// # Errors
/// With the message and exit code for the user.
pub(crate) fn run(mut arguments: PackArguments) -> Result<(), Failure> {
    let store = arguments.paths.pop().filter(|_| !arguments.paths.is_empty());
    let store =
        store.ok_or_else(|| Failure::usage("expected at least one input and the store to make: INPUT... STORE"))?;
    let options = OpenOptions { are_labels: arguments.settings.store.are_labels(), ..arguments.input.options() };
    let source = import::open(&arguments.paths, &options).map_err(|error| store_errors::import_failure(&error))?;
    arguments.settings.pack(&*source, &store)
}
