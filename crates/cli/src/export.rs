//! `brickyard export`: a level, or a box of it, of one time step or several, to a plain file.

use super::channel_args::channel_of;
use super::interrupt::Interrupt;
use super::output::may_write_array;
use super::progress::{Progress, ProgressStyleArgument};
use super::say::say;
use super::step_range::StepRange;
use super::{Failure, heading, store_errors, values};
use brickyard::store::{self, ExportRequest, ExportTime};
use brickyard::volume::{Extent, Level, VoxelBox, counted};
use clap::Args;
use std::path::PathBuf;

/// `brickyard export STORE OUT --level N`
#[derive(Args)]
pub(crate) struct ExportArguments {
    /// The store
    store: PathBuf,
    /// The output: .raw (little-endian, x fastest) or .npy
    output: PathBuf,
    /// Level; 0 is the finest
    #[arg(help_heading = heading::READ, long, default_value_t = 0)]
    level: u8,
    /// Box in voxels of that level, ends excluded [default: the whole level]
    #[arg(help_heading = heading::READ, long, value_name = "x0:x1,y0:y1,z0:z1", value_parser = values::voxel_box)]
    roi: Option<VoxelBox>,
    /// Time step N; or several, A:B, A:B:S (B excluded) or all, as an array with time as its slowest axis
    #[arg(help_heading = heading::READ, long, value_name = "N|A:B[:S]|all", default_value = "0", allow_negative_numbers = true)]
    time: StepRange,
    /// Channel, by number from 0 or by name [default: 0]
    #[arg(help_heading = heading::READ, long)]
    channel: Option<String>,
    /// Limit of the process's own memory
    #[arg(help_heading = heading::WORK, long, value_name = "BYTES", default_value = "1GiB", value_parser = values::bytes)]
    memory: u64,
    /// Replace an existing file
    #[arg(help_heading = heading::OUTPUT, long)]
    overwrite: bool,
    /// How to show progress
    #[arg(help_heading = heading::WORK, long, value_enum, default_value_t)]
    progress: ProgressStyleArgument,
}

/// Runs `export`.
///
/// # Errors
/// With the message and exit code for the user.
pub(crate) fn run(arguments: &ExportArguments) -> Result<(), Failure> {
    may_write_array(&arguments.output, arguments.overwrite)?;
    let store = store_errors::open(&arguments.store)?;
    let (first, end, stride) = arguments.time.within(store.times())?;
    let time = match arguments.time {
        StepRange::One(step) => ExportTime::Step(step),
        StepRange::Some { .. } => ExportTime::Steps { first, end, stride },
    };
    let channel = arguments.channel.as_deref().map_or(Ok(0), |text| channel_of(text, &store))?;
    let request = ExportRequest {
        time,
        channel,
        level: Level(arguments.level),
        region: arguments.roi,
        overwrite: arguments.overwrite,
        memory_bytes: arguments.memory,
    };
    let interrupt = Interrupt::watch()?;
    let progress = Progress::new(arguments.progress, "export");
    let exported = store::export(&store, &arguments.output, &request, |done, total| {
        progress.set(done, total);
        interrupt.flow()
    });
    progress.finish();
    let Extent { x, y, z } = exported.map_err(store_errors::export_failure)?;
    let steps = match time {
        ExportTime::Step(_) => String::new(),
        ExportTime::Steps { .. } => counted(u64::from((end - first).div_ceil(stride)), "step") + " of ",
    };
    let (output, voxel_type) = (arguments.output.display(), store.voxel_type());
    say!("{output}: {steps}{x} x {y} x {z} {voxel_type}, x fastest, little-endian");
    Ok(())
}
