//! `brickyard synth`: synthetic volumes, as a raw file or straight into a store.

use super::failure::Failure;
use super::output::may_write;
use super::pack_settings::PackSettings;
use super::progress::Progress;
use super::values;
use brickyard::import::{SynthKind, SynthSource, write_raw};
use brickyard::volume::{Extent, VoxelType};
use clap::Args;
use std::path::PathBuf;

/// `brickyard synth KIND --shape X,Y,Z OUT`
#[derive(Args)]
pub(crate) struct SynthArguments {
    /// turbulence, marschner-lobb, spheres, ct, flow, sparse, ramp or constant
    #[arg(id = "generator", value_name = "KIND")]
    kind: SynthKind,
    /// The output: OUT.raw, or OUT.zarr for a store without a raw file in between
    output: PathBuf,
    /// Voxels along each axis
    #[arg(long, value_name = "X,Y,Z", value_parser = values::extent)]
    shape: Extent,
    /// Voxel type: u8, u16 or f32
    #[arg(long, default_value = "u8")]
    dtype: VoxelType,
    /// Time steps
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    steps: u32,
    /// Seed of everything random
    #[arg(long, default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    settings: PackSettings,
}

/// Runs `synth`.
///
/// # Errors
/// With the message and exit code for the user.
pub(crate) fn run(arguments: SynthArguments) -> Result<(), Failure> {
    let SynthArguments { kind, output, shape, dtype, steps, seed, settings } = arguments;
    let source = SynthSource::new(kind, shape, dtype, steps, seed).map_err(Failure::usage)?;
    if output.extension().is_some_and(|e| e == "zarr") {
        return settings.pack(&source, &output);
    }
    if output.extension().is_none_or(|e| e != "raw") {
        return Err(Failure::usage(format!("{}: expected a name ending in .raw or .zarr", output.display())));
    }
    may_write(&output, settings.overwrite())?;
    let progress = Progress::new(settings.progress(), "synth");
    let written = write_raw(&source, &output, settings.overwrite(), &mut |done, total| progress.set(done, total));
    progress.finish();
    written.map_err(Failure::failed)
}
