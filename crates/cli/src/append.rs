//! `brickyard append`: time steps into a store, one file each.

use super::advice::with_flags;
use super::failure::{ExitKind, Failure};
use super::heading;
use super::input_args::InputArguments;
use super::interrupt::Interrupt;
use super::pack_settings::{PackingLimits, StoreSettings};
use super::progress::Progress;
use super::say::say;
use super::store_errors;
use brickyard::import::{self, Source};
use brickyard::store::{self, AppendError, Appender, OpenError, Store};
use brickyard::volume::counted;
use clap::Args;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// `brickyard append STORE FILE...`
#[derive(Args)]
pub(crate) struct AppendArguments {
    /// The store; where there is none, the first file makes it
    store: PathBuf,
    /// A file, or a folder of DICOM files or planes, for each step, in their order
    #[arg(required = true, num_args = 1.., value_name = "FILE")]
    files: Vec<PathBuf>,
    /// When the steps were taken, a time for each file, ascending [default: they go on evenly]
    #[arg(help_heading = heading::INPUT, long, value_name = "TIME[,TIME...]", value_delimiter = ',', allow_hyphen_values = true)]
    time: Vec<f64>,
    #[command(flatten)]
    input: InputArguments,
    #[command(flatten)]
    settings: StoreSettings,
    #[command(flatten)]
    limits: PackingLimits,
}

/// How steps are appended, whatever their files.
struct Settings {
    store: PathBuf,
    settings: StoreSettings,
    limits: PackingLimits,
    interrupt: Interrupt,
}

/// Runs `append`. What was appended before a step that fails, stays.
///
/// # Errors
/// With the message and exit code for the user.
pub(crate) fn run(arguments: AppendArguments) -> Result<(), Failure> {
    let AppendArguments { store, files, time, input, settings, limits } = arguments;
    if !time.is_empty() && time.len() != files.len() {
        let (given, files) = (counted(time.len() as u64, "time"), counted(files.len() as u64, "file"));
        return Err(Failure::usage(format!("--time: expected one for each file, found {given} for {files}")));
    }
    let settings = Settings { store, settings, limits, interrupt: Interrupt::watch()? };
    let input = input.options();
    let mut appender = None;
    for (i, file) in files.iter().enumerate() {
        let source = import::open(std::slice::from_ref(file), &input);
        let source = source.map_err(|error| store_errors::import_failure(&error))?;
        appender = Some(settings.append(appender, &*source, file, time.get(i).copied())?);
    }
    Ok(())
}

impl Settings {
    /// Appends one step; opens the store, or makes it, before the first.
    fn append(
        &self,
        appender: Option<Appender>,
        source: &dyn Source,
        file: &Path,
        stamp: Option<f64>,
    ) -> Result<Appender, Failure> {
        let started = Instant::now();
        let progress = Progress::new(self.limits.progress, "append");
        let interrupt = self.interrupt.clone();
        let watcher = Watcher { voxel_bytes: source.info().voxel_type.bytes() as u64, progress, interrupt };
        let of_file = |error: AppendError| {
            if let AppendError::Cancelled { times, .. } = error {
                return self.stopped(times, file);
            }
            let Failure { kind, message } = store_errors::append_failure(error);
            Failure::new(kind, format!("{}: {message}", file.display()))
        };
        let appender = match appender {
            Some(appender) => Some(appender),
            None => self.open()?,
        };
        let appended = match appender {
            Some(mut appender) => appender.append(source, stamp, &watcher).map(|report| (appender, Some(report))),
            None => {
                if !source.info().calibrated {
                    say!(
                        "note: the input gives no voxel size: the store is uncalibrated; set one with --spacing and --unit"
                    );
                }
                let options = self.limits.limit(self.settings.options(source.info().voxel_type)?);
                Appender::create(&self.store, source, stamp, &options, &watcher).map(|appender| (appender, None))
            }
        };
        watcher.progress.finish();
        let (appender, report) = appended.map_err(of_file)?;
        let (step, store) = (appender.times() - 1, self.store.display());
        let seconds = started.elapsed().as_secs_f64();
        say!("{}: step {step} of {store} in {seconds:.1} s", file.display());
        if let Some(voxels) = report.map(|report| report.non_finite).filter(|voxels| *voxels > 0) {
            say!("note: {voxels} voxels are NaN or infinite: they are not drawn and not counted");
        }
        Ok(appender)
    }

    /// The failure of a step that the user stopped.
    fn stopped(&self, times: u32, file: &Path) -> Failure {
        Failure::new(
            ExitKind::Interrupted,
            format!(
                "{}: stopped; {} has {}: the same command goes on with the files from this one on",
                file.display(),
                self.store.display(),
                counted(times.into(), "time step")
            ),
        )
    }

    /// Opens the store; `None` where there is none, or one whose first step is not packed to the end.
    fn open(&self) -> Result<Option<Appender>, Failure> {
        let times = match Store::open(&self.store) {
            Ok(store) => {
                self.settings.check(&store)?;
                store.times()
            }
            Err(OpenError::NotAStore { .. } | OpenError::Incomplete { .. }) => return Ok(None),
            Err(OpenError::Io { error, .. }) if error.kind() == ErrorKind::NotFound && !self.store.exists() => {
                return Ok(None);
            }
            Err(error) => return Err(store_errors::open_failure(&error)),
        };
        match Appender::open(&self.store, self.limits.of_append()) {
            // Readers see the first step already, but its pack has not ended: the same file ends it.
            Err(AppendError::Unfinished { replaces: false, .. }) if times == 1 => Ok(None),
            opened => opened.map(Some).map_err(store_errors::append_failure),
        }
    }
}

/// Shows warnings and progress.
struct Watcher {
    voxel_bytes: u64,
    progress: Progress,
    interrupt: Interrupt,
}

impl store::Progress for Watcher {
    fn warn(&self, message: &str) {
        say!("warning: {}", with_flags(message));
    }

    fn advanced(&self, done: u64, total: u64) {
        self.progress.set(done * self.voxel_bytes, total * self.voxel_bytes);
    }

    fn is_cancelled(&self) -> bool {
        self.interrupt.is_asked()
    }
}
