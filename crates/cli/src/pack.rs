//! `brickyard pack`: foreign files into a brick store.

use super::input_args::InputArguments;
use super::pack_settings::PackSettings;
use super::{Failure, heading, store_errors};
use brickyard::import::{self, Described, OpenOptions};
use clap::Args;
use std::path::PathBuf;

/// `brickyard pack INPUT... STORE`
#[derive(Args)]
#[command(mut_arg("take_channel", |flag| flag.visible_alias("channel")))]
#[command(mut_arg("take_time", |flag| flag.visible_alias("time")))]
pub(crate) struct PackArguments {
    /// Input files, a folder of files of one format, a quoted pattern (step_*.npy, step_%04d.raw), or - for raw voxels on
    /// standard input, then the store to create; several files are time steps, or planes. Without an input, the channels
    /// of --variable NAME=FILE
    #[arg(required = true, num_args = 1.., value_name = "INPUT... STORE")]
    paths: Vec<PathBuf>,
    #[command(flatten)]
    input: InputArguments,
    #[command(flatten)]
    settings: PackSettings,
    /// Print the plan and the notes, make all checks, and create nothing
    #[arg(help_heading = heading::OUTPUT, long, conflicts_with = "verify")]
    dry_run: bool,
    /// Print the plan as JSON
    #[arg(help_heading = heading::OUTPUT, long, requires = "dry_run")]
    json: bool,
    /// Compare the store with the input afterwards, voxel by voxel, and check it as `verify` does
    #[arg(help_heading = heading::WORK, long)]
    verify: bool,
}

/// Runs `pack`.
///
/// # Errors
/// With the message and exit code for the user.
pub(crate) fn run(mut arguments: PackArguments) -> Result<(), Failure> {
    let store = arguments.paths.pop();
    let options = arguments.input.options(&mut arguments.paths)?;
    let store = store.filter(|_| !arguments.paths.is_empty());
    let store =
        store.ok_or_else(|| Failure::usage("expected at least one input and the store to make: INPUT... STORE"))?;
    let stream = import::stream_among(&arguments.paths, &options.channel_arrays);
    if let Some(stream) = stream.filter(|_| arguments.settings.resume) {
        let problem = "--resume: a stream cannot be read again from where it stopped; pack it anew with --overwrite, \
                       or from a file";
        return Err(Failure::usage(format!("{}: {problem}", stream.display())));
    }
    arguments.settings.is_of_stream = stream.is_some();
    let options = OpenOptions { are_labels: arguments.settings.store.are_labels(), ..options };
    let source = import::open(&arguments.paths, &options).map_err(|error| store_errors::import_failure(&error))?;
    let mut info = source.info().clone();
    if info.times == 1 && info.time.is_none() {
        info.notes.extend(source.step_time().left_out());
    }
    let source = Described { info, source, first: 0 };
    if arguments.dry_run {
        return arguments.settings.rehearse(&source, &store, arguments.json);
    }
    arguments.settings.pack(&source, &store)?;
    if arguments.verify {
        arguments.settings.limits.verify(&source, &store)?;
    }
    Ok(())
}
