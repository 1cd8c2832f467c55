//! `brickyard export`: a level, or a box of it, of some channels and time steps, to a file of another format.

use super::channel_args::channel_of;
use super::interrupt::Interrupt;
use super::output::may_write_array;
use super::progress::{Progress, ProgressStyleArgument};
use super::say::say;
use super::step_range::StepRange;
use super::{Failure, heading, store_errors, values};
use crate::advice::with_flags;
use brickyard::export::{self, ExportChannels, ExportRequest, ExportTime, Exported, Ngff};
use brickyard::store::Store;
use brickyard::volume::{Extent, Level, VoxelBox, counted};
use clap::Args;
use std::path::PathBuf;
use std::sync::Arc;

/// `brickyard export STORE OUT --level N`
#[derive(Args)]
pub(crate) struct ExportArguments {
    /// The store
    store: PathBuf,
    /// The output, whose name tells the format: .zarr (OME-Zarr), .nii, .nii.gz, .nrrd, .seg.nrrd (labels, for 3D Slicer), .mha, .mhd, .vti, .pvd (a
    /// series of .vti), .tif (ImageJ), .ome.tif, .npy, .raw (with a text for pack beside it), or a folder's name ending in / for PNG planes
    output: PathBuf,
    /// Level; 0 is the finest
    #[arg(help_heading = heading::READ, long, default_value_t = 0)]
    level: u8,
    /// Box in voxels of that level, ends excluded [default: the whole level]
    #[arg(help_heading = heading::READ, long, value_name = "x0:x1,y0:y1,z0:z1", value_parser = values::voxel_box)]
    roi: Option<VoxelBox>,
    /// Time step N; or several, A:B, A:B:S (B excluded) or all, with an axis of time [default: 0]
    #[arg(help_heading = heading::READ, long, value_name = "N|A:B[:S]|all", allow_negative_numbers = true)]
    time: Option<StepRange>,
    /// Channel by number or name; or several, as in 0,DAPI, or all, with an axis of channels [default: 0]
    #[arg(help_heading = heading::READ, long, value_name = "C[,C...]|all")]
    channel: Option<String>,
    /// Version of OME-Zarr: 0.4, 0.5 or 0.6 [default: 0.5]
    #[arg(help_heading = heading::OUTPUT, long, value_name = "VERSION")]
    ngff: Option<Ngff>,
    /// Limit of the process's own memory
    #[arg(help_heading = heading::WORK, long, value_name = "BYTES", default_value = "1GiB", value_parser = values::bytes)]
    memory: u64,
    /// Replace an existing file, a series of .vti, or an OME-Zarr of this program
    #[arg(help_heading = heading::OUTPUT, long)]
    overwrite: bool,
    /// How to show progress
    #[arg(help_heading = heading::WORK, long, value_enum, default_value_t)]
    progress: ProgressStyleArgument,
}

/// The channels of `--channel`: one, several or all.
fn channels_of(text: &str, store: &Store) -> Result<ExportChannels, Failure> {
    if text.trim() == "all" {
        return Ok(ExportChannels::All);
    }
    let numbers = text.split(',').map(|one| channel_of(one.trim(), store)).collect::<Result<Vec<u32>, _>>()?;
    Ok(if let [one] = numbers[..] { ExportChannels::One(one) } else { ExportChannels::Several(numbers) })
}

/// Runs `export`.
///
/// # Errors
/// With the message and exit code for the user.
pub(crate) fn run(arguments: &ExportArguments) -> Result<(), Failure> {
    may_write_array(&arguments.output, arguments.overwrite)?;
    let store = Arc::new(store_errors::open(&arguments.store)?);
    let time = match &arguments.time {
        None => ExportTime::default(),
        Some(range) => match (range, range.within(store.times())?) {
            (StepRange::One(step), _) => ExportTime::Step(*step),
            (_, (first, end, stride)) => ExportTime::Steps { first, end, stride },
        },
    };
    let channels = arguments.channel.as_deref().map(|text| channels_of(text, &store)).transpose()?;
    note_rest(arguments, &store);
    let request = ExportRequest {
        time,
        channels: channels.unwrap_or_default(),
        level: Level(arguments.level),
        region: arguments.roi,
        ngff: arguments.ngff,
        overwrite: arguments.overwrite,
        memory_bytes: arguments.memory,
    };
    let interrupt = Interrupt::watch()?;
    let progress = Progress::new(arguments.progress, "export");
    let exported = export::export(&store, &arguments.output, &request, |done, total| {
        progress.set(done, total);
        interrupt.flow()
    });
    progress.finish();
    let exported = exported.map_err(store_errors::export_failure)?;
    let Exported { extent: Extent { x, y, z }, notes, .. } = &exported;
    notes.iter().for_each(|note| say!("note: {}", with_flags(note)));
    let count = |is_axis: bool, count: u32, noun: &str| match is_axis {
        true => counted(count.into(), noun) + " of ",
        false => String::new(),
    };
    let steps = count(!matches!(request.time, ExportTime::Step(_)), exported.times, "step");
    let channels = count(!matches!(request.channels, ExportChannels::One(_)), exported.channels, "channel");
    let (output, voxel_type) = (arguments.output.display(), store.voxel_type());
    say!("{output}: {steps}{channels}{x} x {y} x {z} {voxel_type}, x fastest, little-endian");
    Ok(())
}

/// Says what of the store is left out by default.
fn note_rest(arguments: &ExportArguments, store: &Store) {
    let (channels, times) = (store.channels(), store.times());
    if arguments.channel.is_none() && channels > 1 {
        say!("note: channel 0 of {channels} is exported: --channel all takes all, --channel 0,1 two");
    }
    if arguments.time.is_none() && times > 1 {
        say!("note: time step 0 of {times} is exported: --time all takes all, --time N another");
    }
}
