//! The `brickyard` command: one subcommand per file, each turning flags into a call of the library and errors into an
//! exit code. 0 ok, 1 failed, 2 usage, 3 bad input, 4 incomplete but resumable, 5 verification failed, 130 stopped by
//! Ctrl-C.

mod address_args;
mod advice;
mod allocator;
mod append;
mod bench;
mod bench_play;
mod cache;
mod camera_path;
mod channel_args;
mod completions;
mod destination;
mod doctor;
mod edit;
mod examples;
mod export;
mod failure;
mod heading;
mod help;
#[cfg(test)]
mod help_tests;
mod index;
mod info;
mod input_args;
mod interrupt;
mod making;
mod man;
mod mesh;
mod named;
mod output;
mod pack;
mod pack_settings;
mod plan_text;
mod probe;
mod progress;
mod quality;
mod reaction;
mod remarks;
mod render;
mod render_args;
mod sampling_args;
mod say;
mod scene_args;
mod session_args;
mod session_errors;
mod slice_argument;
mod step_range;
mod store_errors;
mod synth;
mod upgrade;
mod values;
mod verify;
#[cfg(feature = "viewer")]
mod view;
mod views;
mod volume_args;

use clap::{ArgMatches, CommandFactory, FromArgMatches, Parser, Subcommand};
pub(crate) use failure::Failure;
use std::io::{IsTerminal, Write};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use tracing_subscriber::Layer as _;
use tracing_subscriber::filter::Targets;
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;

/// Packs volumes into brick stores and renders them in any size under fixed budgets.
#[derive(Parser)]
#[command(name = "brickyard", version, propagate_version = true)]
struct Arguments {
    /// Print more; twice for everything
    #[arg(help_heading = heading::ALL, short, long, global = true, action = clap::ArgAction::Count)]
    verbose: u8,
    /// Print nothing but errors
    #[arg(help_heading = heading::ALL, short, long, global = true)]
    quiet: bool,
    #[command(flatten)]
    addresses: address_args::AddressArguments,
    /// The subcommand.
    #[command(subcommand)]
    command: Command,
}

/// The subcommands.
#[derive(Subcommand)]
enum Command {
    /// Turn scans and simulations into a brick store
    #[command(after_help = examples::PACK)]
    Pack(Box<pack::PackArguments>),
    /// Add time steps to a store, one file each; the first one creates it
    #[command(after_help = examples::APPEND)]
    Append(Box<append::AppendArguments>),
    /// Change a store's metadata: place, units, times, name, channels' names and colors
    #[command(after_help = examples::EDIT)]
    Edit(Box<edit::EditArguments>),
    /// Read all of another program's Zarr once, for exact statistics, quicker views and coarse levels
    #[command(after_help = examples::INDEX)]
    Index(index::IndexArguments),
    /// Change a store's version of OME-Zarr, and that of its labels: metadata alone
    #[command(after_help = examples::UPGRADE)]
    Upgrade(upgrade::UpgradeArguments),
    /// Describe a store
    #[command(after_help = examples::INFO)]
    Info(info::InfoArguments),
    /// Print the values of all channels at one place
    #[command(after_help = examples::PROBE)]
    Probe(probe::ProbeArguments),
    /// Check every checksum and statistic of a store, and repair it from its input
    #[command(after_help = examples::VERIFY)]
    Verify(Box<verify::VerifyArguments>),
    /// Write a store, or a part of it, as NIfTI, NRRD, MetaImage, VTK, TIFF, PNG, OME-Zarr, .npy or .raw
    #[command(after_help = examples::EXPORT)]
    Export(export::ExportArguments),
    /// Write an isosurface, or the borders of labels, to .stl, .ply, .obj or .glb
    #[command(after_help = examples::MESH)]
    Mesh(mesh::MeshArguments),
    /// Open a window on a store
    #[cfg(feature = "viewer")]
    #[command(after_help = examples::VIEW)]
    View(Box<view::ViewArguments>),
    /// Render a store to PNG, or to a movie
    #[command(after_help = examples::RENDER)]
    Render(Box<render_args::RenderArguments>),
    /// Make a synthetic volume, as .raw or straight into a store (.zarr)
    #[command(after_help = examples::SYNTH)]
    Synth(synth::SynthArguments),
    /// Fly over stores along scripted paths and print the costs
    #[command(after_help = examples::BENCH)]
    Bench(Box<bench::BenchArguments>),
    /// Measure the quality and speed of sampling methods: tables, curves and maps of a store. The survey sets method,
    /// filter, lighting, jitter, step and level of the scene itself
    #[command(after_help = examples::QUALITY)]
    Quality(Box<quality::QualityArguments>),
    /// Show or delete what is kept on disk of stores at addresses and other programs' Zarr
    #[command(after_help = examples::CACHE)]
    Cache(cache::CacheArguments),
    /// Print this machine's capabilities, and test them
    #[command(after_help = examples::DOCTOR)]
    Doctor(doctor::DoctorArguments),
    /// Print a script for a shell to complete the command line
    #[command(after_help = examples::COMPLETIONS)]
    Completions(completions::CompletionsArguments),
    /// Write manual pages into a folder
    #[command(after_help = examples::MAN)]
    Man(man::ManArguments),
}

fn main() -> ExitCode {
    allocator::map_large_blocks();
    if std::env::var_os("XDG_RUNTIME_DIR").is_none() {
        // Without that folder Mesa's device-select layer, useless to this program, prints an error per adapter.
        // SAFETY: no other thread that could read the environment exists yet.
        unsafe { std::env::set_var("NODEVICE_SELECT", "1") };
    }
    let typed: Vec<_> = std::env::args_os().map(address_args::local).collect();
    let words: Vec<_> = typed.iter().skip(1).map(|word| word.to_string_lossy().into_owned()).collect();
    match help::print(&words) {
        Ok(true) => return ExitCode::SUCCESS,
        Ok(false) => {}
        Err(failure) => return failed(&failure),
    }
    let matches = Arguments::command().get_matches_from(typed);
    let arguments = Arguments::from_arg_matches(&matches);
    let arguments = arguments.unwrap_or_else(|error| error.format(&mut Arguments::command()).exit());
    if arguments.quiet {
        say::be_quiet();
    }
    set_up_log(arguments.verbose, arguments.quiet);
    arguments.addresses.configure(&arguments.command);
    if let Err(error) = fail_past_file_limit() {
        tracing::warn!("a file past the limit of file sizes ends the process: {error}");
    }
    let done = run(arguments.command, &matches);
    address_args::tell_unconfirmed();
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => failed(&failure),
    }
}

fn failed(failure: &Failure) -> ExitCode {
    // Without a reader, the code still reports it.
    say::error(format_args!("error: {}", failure.message));
    ExitCode::from(failure.kind as u8)
}

/// Makes writes past the limit of file sizes (`ulimit -f`) fail like on a full disk; otherwise the system's signal
/// would end the process.
fn fail_past_file_limit() -> std::io::Result<()> {
    signal_hook::flag::register(signal_hook::consts::SIGXFSZ, Arc::<AtomicBool>::default()).map(drop)
}

/// Runs a subcommand; `matches` are those of the whole command line.
///
/// # Errors
/// With the message and exit code for the user.
#[cfg_attr(not(feature = "viewer"), expect(unused_variables, reason = "only `view` looks at them"))]
fn run(command: Command, matches: &ArgMatches) -> Result<(), Failure> {
    match command {
        Command::Pack(arguments) => pack::run(*arguments),
        Command::Append(arguments) => append::run(*arguments),
        Command::Edit(arguments) => edit::run(*arguments),
        Command::Index(arguments) => index::run(&arguments),
        Command::Upgrade(arguments) => upgrade::run(&arguments),
        Command::Info(arguments) => info::run(&arguments),
        Command::Probe(arguments) => probe::run(&arguments),
        Command::Verify(arguments) => verify::run(*arguments),
        Command::Export(arguments) => export::run(&arguments),
        Command::Mesh(arguments) => mesh::run(&arguments),
        #[cfg(feature = "viewer")]
        Command::View(arguments) => view::run(*arguments, matches.subcommand_matches("view")),
        Command::Render(arguments) => render::run(*arguments),
        Command::Synth(arguments) => synth::run(arguments),
        Command::Bench(arguments) => bench::run(&arguments),
        Command::Quality(arguments) => quality::run(&arguments),
        Command::Cache(arguments) => cache::run(&arguments),
        Command::Doctor(arguments) => doctor::run(&arguments),
        Command::Completions(arguments) => completions::run(&arguments),
        Command::Man(arguments) => man::run(&arguments),
    }
}

/// Sends log lines to standard error: warnings, or more or less by flag; `RUST_LOG` overrides.
fn set_up_log(verbose: u8, quiet: bool) {
    let level = match (quiet, verbose) {
        (true, _) => "error",
        (_, 0) => "warn,wgpu_hal=error,wgpu_core=error,winit=error",
        (_, 1) => "info,wgpu_hal=warn,wgpu_core=warn,winit=warn",
        _ => "debug",
    };
    let asked = std::env::var("RUST_LOG").ok().and_then(|text| text.parse::<Targets>().ok());
    let lines = tracing_subscriber::fmt::layer()
        // Lines without a reader are dropped: a panic over one would end a thread about to warn.
        .log_internal_errors(false)
        // By default it colours files and pipes, too.
        .with_ansi(std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty()))
        .with_writer(std::io::stderr)
        .without_time();
    let filter = asked.unwrap_or_else(|| level.parse().expect("levels by target"));
    tracing_subscriber::registry().with(lines.with_filter(filter)).init();
}

fn print_json(value: &impl serde::Serialize) -> Result<(), Failure> {
    let text = serde_json::to_string_pretty(value).map_err(Failure::failed)?;
    print_line(&text)
}

fn print_line(text: &str) -> Result<(), Failure> {
    printed(writeln!(std::io::stdout(), "{text}"))
}

/// Checks a write to standard output: a pipe closed by its reader is no failure.
fn printed(written: std::io::Result<()>) -> Result<(), Failure> {
    match written {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Failure::failed(format!("standard output: {error}")))
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_flags_of_all_commands_are_consistent() {
        Arguments::command().debug_assert();
    }
}
