//! `brickyard synth`: synthetic volumes, as a raw file or straight into a store; and a simulation that appends its
//! steps to a store as it runs.

use super::output::may_write;
use super::pack_settings::PackSettings;
use super::progress::Progress;
use super::reaction::Reaction;
use super::values::human_bytes;
use super::{Failure, heading, store_errors, values};
use brickyard::import::{Source, SynthKind, SynthSource, write_raw};
use brickyard::store::{Appender, Kind};
use brickyard::volume::{Extent, VoxelType};
use clap::Args;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::str::FromStr;

/// `brickyard synth KIND --shape X,Y,Z OUT`
#[derive(Args)]
pub(crate) struct SynthArguments {
    /// turbulence, marschner-lobb, spheres, ct, flow, sparse, ramp or constant; or reaction, a simulation with each
    /// step appended to OUT.zarr as soon as it is computed
    #[arg(id = "generator", value_name = "KIND")]
    generator: Generator,
    /// The output: OUT.raw, or OUT.zarr for a store without a raw file in between
    output: PathBuf,
    /// Voxels along each axis
    #[arg(help_heading = heading::MADE, long, value_name = "X,Y,Z", value_parser = values::extent)]
    shape: Extent,
    /// Voxel type: u8, u16 or f32
    #[arg(help_heading = heading::MADE, long, default_value = "u8")]
    dtype: VoxelType,
    /// Time steps
    #[arg(help_heading = heading::MADE, long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    steps: u32,
    /// Seed of everything random
    #[arg(help_heading = heading::MADE, long, default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    settings: PackSettings,
}

/// A source of synthetic volumes.
#[derive(Clone, Copy)]
enum Generator {
    /// A formula for each voxel.
    Formula(SynthKind),
    /// A simulation, with its steps in turn.
    Reaction,
}

impl FromStr for Generator {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        match name {
            "reaction" => Ok(Self::Reaction),
            _ => name.parse().map(Self::Formula).map_err(|error| format!("{error}, reaction")),
        }
    }
}

/// Runs `synth`.
///
/// # Errors
/// With the message and exit code for the user.
pub(crate) fn run(arguments: SynthArguments) -> Result<(), Failure> {
    let Generator::Formula(kind) = arguments.generator else { return simulate(&arguments) };
    let SynthArguments { output, shape, dtype, steps, seed, settings, .. } = arguments;
    let source = SynthSource::new(kind, shape, dtype, steps, seed).map_err(Failure::usage)?;
    if output.extension().is_some_and(|e| e == "zarr") {
        return settings.pack(&source, &output);
    }
    if output.extension().is_none_or(|e| e != "raw") {
        return Err(Failure::usage(format!("{}: expected a name ending in .raw or .zarr", output.display())));
    }
    may_write(&output, settings.overwrite)?;
    let progress = Progress::new(settings.limits.progress, "synth");
    let written = write_raw(&source, &output, settings.overwrite, &mut |done, total| progress.set(done, total));
    progress.finish();
    written.map_err(Failure::failed)
}

/// Runs a simulation for some steps, each appended to a new store as soon as it is computed.
fn simulate(arguments: &SynthArguments) -> Result<(), Failure> {
    let SynthArguments { ref output, shape, dtype: voxel_type, steps, seed, ref settings, .. } = *arguments;
    let named = |problem: &str| Failure::usage(format!("{}: {problem}", output.display()));
    if output.extension().is_none_or(|extension| extension != "zarr") {
        return Err(named("expected a name ending in .zarr: a simulation appends its steps to a store"));
    }
    if output.exists() {
        return Err(named("exists already; choose another name: a simulation makes a new store"));
    }
    let options = settings.options(voxel_type, Kind::Image)?;
    if options.shard_times > 1 {
        return Err(named("--shard-time: a simulation appends its steps, each to shards of its own; leave it out"));
    }
    let needed_bytes = Reaction::bytes(shape, voxel_type);
    if needed_bytes > options.memory_bytes {
        let (needed, given) = (human_bytes(needed_bytes), human_bytes(options.memory_bytes));
        return Err(named(&format!("--memory {given}: the simulation takes {needed}, besides packing; allow more")));
    }
    let mut reaction = Reaction::new(shape, seed);
    let threads = NonZeroUsize::new(options.threads).unwrap_or(NonZeroUsize::MIN);
    let progress = Progress::new(settings.limits.progress, "synth");
    let mut appender: Option<Appender> = None;
    for step in 0..steps {
        let volume = reaction.step(voxel_type).ok_or_else(|| named("a simulation takes --dtype u8, u16 or f32"))?;
        let bytes = (volume.info().extent.volume() * voxel_type.bytes() as u64).max(1);
        let joined = match appender {
            Some(mut appender) => appender.append(&volume, None, &()).map(|_| appender),
            None => Appender::create(output, &volume, None, &options, &()),
        };
        appender = Some(joined.map_err(store_errors::append_failure)?);
        progress.set(u64::from(step + 1) * bytes, u64::from(steps) * bytes);
        if step + 1 < steps {
            reaction.advance(threads);
        }
    }
    progress.finish();
    Ok(())
}
