//! `brickyard append`: time steps into a store, one file each.

use super::advice::with_flags;
use super::failure::{ExitKind, Failure};
use super::input_args::InputArguments;
use super::interrupt::Interrupt;
use super::pack_settings::{PackingLimits, StoreSettings, Watcher, note_non_finite, note_uncalibrated};
use super::say::say;
use super::{heading, store_errors};
use brickyard::import::{self, Described, HeldAs, NoData, OpenOptions, SaidKind, Source};
use brickyard::store::{AppendError, Appender, Kind, OpenError, PackError, Store};
use brickyard::volume::counted;
use clap::Args;
use std::collections::{HashMap, HashSet};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// `brickyard append STORE FILE...`
#[derive(Args)]
pub(crate) struct AppendArguments {
    /// The store; if missing, created from the first file
    store: PathBuf,
    /// A file, a folder of DICOM files or planes, or - for raw voxels on standard input, for each step, in their order
    /// [default: one step, of the channels of --variable NAME=FILE]
    #[arg(required_unless_present = "variable", num_args = 1.., value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Times of the steps, one for each file, ascending [default: they continue evenly]
    #[arg(help_heading = heading::INPUT, long, value_name = "TIME[,TIME...]", value_delimiter = ',', allow_hyphen_values = true)]
    time: Vec<f64>,
    #[command(flatten)]
    input: InputArguments,
    #[command(flatten)]
    settings: StoreSettings,
    #[command(flatten)]
    limits: PackingLimits,
}

/// Settings common to all appended steps.
struct Settings {
    store: PathBuf,
    settings: StoreSettings,
    limits: PackingLimits,
    interrupt: Interrupt,
}

/// Runs `append`. Steps appended before a failing one stay.
///
/// # Errors
/// With the message and exit code for the user.
pub(crate) fn run(arguments: AppendArguments) -> Result<(), Failure> {
    let AppendArguments { store, mut files, time, input, settings, limits } = arguments;
    let options = input.options(&mut files)?;
    if !time.is_empty() && time.len() != files.len() {
        let (given, files) = (counted(time.len() as u64, "time"), counted(files.len() as u64, "file"));
        return Err(Failure::usage(format!("--time: expected one time per file, found {given} for {files}")));
    }
    if let Some(odd) = time.iter().find(|time| !time.is_finite()) {
        return Err(Failure::usage(format!("--time {odd}: expected finite numbers")));
    }
    let input = OpenOptions { is_step: files.len() > 1, ..step_options(&store, &settings, options)? };
    if input.time_stamps.is_some() {
        let problem = "--time-stamps is for pack; give the times of appended files as --time TIME[,TIME...]";
        return Err(Failure::usage(problem));
    }
    if !time.is_empty() && input.time_step.is_some() && input.held_as.is_some() {
        let problem =
            "--time-step with --time: the store exists and --time places its new steps; leave --time-step out";
        return Err(Failure::usage(problem));
    }
    let settings = Settings { store, settings, limits, interrupt: Interrupt::watch()? };
    let (files, time) = match files.len() {
        1 => (files, time),
        _ => in_order(&files, &time, &input)?,
    };
    let (mut input, mut appender, mut said) = (input, None, HashSet::new());
    for (i, file) in files.iter().enumerate() {
        if i > 0 && input.held_as.is_none() {
            // The first file has created the store, whose kind is this file's.
            let created = Store::open_own(&settings.store).ok();
            input.held_as = held_as(created.as_ref());
            input.are_labels = are_labels(created.as_ref(), &settings.settings);
        }
        let source = import::open(std::slice::from_ref(file), &input);
        let source = source.map_err(|error| store_errors::import_failure(&error));
        let appended = source.and_then(|source| {
            let unlike = input.are_labels.and_then(|are_labels| settings.unlike(source.info().kind, are_labels));
            if let Some(words) = unlike.filter(|words| said.insert(words.clone())) {
                say!("{words} (first of {})", file.display());
            }
            settings.append(appender, &once(source, &mut said), file, time.get(i).copied())
        });
        appender = Some(appended.inspect_err(|_| {
            if i > 0 {
                say!("note: {i} of {} appended; go on with {}", counted(files.len() as u64, "file"), file.display());
            }
        })?);
    }
    Ok(())
}

/// A source without the notes said of files before.
fn once(source: Box<dyn Source>, said: &mut HashSet<String>) -> Described<Box<dyn Source>> {
    let mut info = source.info().clone();
    info.notes.retain(|note| note.changed() > 0 || said.insert(note.to_string()));
    Described { info, source, first: 0 }
}

/// Returns the options for opening a store's steps. A missing or unreadable store is reported by its own opening.
fn step_options(store: &Path, settings: &StoreSettings, options: OpenOptions) -> Result<OpenOptions, Failure> {
    let opened = Store::open_own(store).ok();
    if let Some(value) = opened.as_ref().and_then(nodata_of).filter(|_| options.nodata == NoData::None) {
        let path = store.display();
        let problem = format!("--nodata none: in {path}, voxels of {value} hold no data in every step: leave it out");
        return Err(Failure::usage(problem));
    }
    Ok(OpenOptions { are_labels: are_labels(opened.as_ref(), settings), held_as: held_as(opened.as_ref()), ..options })
}

/// Whether voxels are labels: a store's kind holds for all its steps.
fn are_labels(store: Option<&Store>, settings: &StoreSettings) -> Option<bool> {
    store.map(|store| store.info().kind == Kind::Labels).or(settings.are_labels())
}

fn held_as(store: Option<&Store>) -> Option<HeldAs> {
    store.map(|store| HeldAs { voxel_type: store.voxel_type(), nodata: nodata_of(store), turned: store.info().turned })
}

/// The value of a store's voxels without data, if there is one.
fn nodata_of(store: &Store) -> Option<f64> {
    store.info().nodata.map(|nodata| nodata as f64).or(store.info().blanked)
}

/// Orders files by their steps, each with its time if there are any, like a pack of all of them.
fn in_order(files: &[PathBuf], times: &[f64], input: &OpenOptions) -> Result<(Vec<PathBuf>, Vec<f64>), Failure> {
    let (ordered, note) = import::order_steps(files, input).map_err(|error| store_errors::import_failure(&error))?;
    say!("note: {}", with_flags(&note));
    let is_as_given = ordered == files;
    let time_of: HashMap<&PathBuf, f64> = files.iter().zip(times.iter().copied()).collect();
    let times: Vec<f64> = match is_as_given {
        // A file may be named twice.
        true => times.to_vec(),
        false => ordered.iter().filter_map(|file| time_of.get(file).copied()).collect(),
    };
    if let Some(at) = times.windows(2).position(|pair| pair[0] >= pair[1]) {
        let [before, after] = [at, at + 1].map(|i| format!("{} of {}", times[i], ordered[i].display()));
        let way_on = match is_as_given {
            true => "; times ascend",
            false => " by the numbers in the names; pass --order given to keep the order of the files",
        };
        return Err(Failure::usage(format!("--time: {after} is not after {before}, which comes first{way_on}")));
    }
    Ok((ordered, times))
}

impl Settings {
    /// Appends one step, opening or creating the store before the first.
    fn append(
        &self,
        appender: Option<Appender>,
        source: &dyn Source,
        file: &Path,
        stamp: Option<f64>,
    ) -> Result<Appender, Failure> {
        let started = Instant::now();
        let info = source.info();
        let watcher = Watcher::new(info, "append", self.limits.progress, None, self.interrupt.clone());
        let of_file = |error: AppendError| {
            if let AppendError::Cancelled { times, .. } = error {
                let (file, store, steps) = (file.display(), self.store.display(), counted(times.into(), "time step"));
                let way_on = "the same command goes on with the files from this one on";
                return Failure::new(ExitKind::Interrupted, format!("{file}: stopped; {store} has {steps}: {way_on}"));
            }
            let is_of_store = match &error {
                AppendError::Pack(error) => !matches!(error, PackError::Unfit { .. }),
                AppendError::Open(_) | AppendError::Read(_) | AppendError::Begun { .. } => true,
                _ => false,
            };
            let failure = store_errors::append_failure(error);
            match is_of_store {
                true => failure,
                false => Failure::new(failure.kind, format!("{}: {}", file.display(), failure.message)),
            }
        };
        let appender = match appender {
            Some(appender) => Some(appender),
            None => self.open()?,
        };
        let appended = match appender {
            Some(mut appender) => appender.append(source, stamp, &watcher).map(|report| (appender, Some(report))),
            None => {
                note_uncalibrated(info);
                let options = self.limits.limit(self.settings.options(info.voxel_type, Kind::said_by(info))?);
                Appender::create(&self.store, source, stamp, &options, &watcher).map(|appender| (appender, None))
            }
        };
        watcher.finish();
        let (appender, report) = appended.map_err(of_file)?;
        let (step, store) = (appender.times() - 1, self.store.display());
        let seconds = started.elapsed().as_secs_f64();
        say!("{}: step {step} of {store} in {seconds:.1} s", file.display());
        note_non_finite(report.map_or(0, |report| report.non_finite));
        Ok(appender)
    }

    /// A warning or note on a file whose own word is not the store's kind; none if a flag repeats that.
    fn unlike(&self, said: SaidKind, are_labels: bool) -> Option<String> {
        let store = self.store.display();
        match (are_labels, said) {
            _ if self.settings.are_labels().is_some() => None,
            (false, SaidKind::Labels(word)) => Some(format!(
                "warning: voxels are labels, by {word}, but {store} is an image: they are averaged like its values; append \
                 them to a store of labels, or pass --kind image"
            )),
            (true, SaidKind::Image(word)) => Some(format!(
                "warning: voxels are no labels, by {word}, but {store} is of labels: they are taken as such; append them to \
                 an image, or pass --kind labels"
            )),
            (true, SaidKind::Unsaid) => Some(format!(
                "note: the file does not say that its voxels are labels: they are, as in {store}; --kind labels says so, too"
            )),
            _ => None,
        }
    }

    /// Opens the store; `None` if it is missing, or its first step is not packed to the end.
    fn open(&self) -> Result<Option<Appender>, Failure> {
        let times = match Store::open_own(&self.store) {
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
            // Readers see the first step already, but its pack has not ended: the same file ends it, and another is the
            // next step.
            Err(AppendError::Unfinished { replaces: false, .. }) if times == 1 => Ok(None),
            opened => opened.map(Some).map_err(store_errors::append_failure),
        }
    }
}
