//! The flags of packing, shared by `pack` and `synth`; those that determine a store's bytes also by `append`.

use super::advice::with_flags;
use super::failure::{ExitKind, Failure};
use super::interrupt::Interrupt;
use super::named::Named;
use super::plan_text::PlanText;
use super::progress::{Progress, ProgressStyleArgument};
use super::say::{self, say};
use super::{heading, print_json, print_line, store_errors, values, verify};
use brickyard::import::{Note, Source, SourceInfo};
use brickyard::store::{
    self, AppendOptions, Codec, Downsample, Exists, Kind, Ngff, PackError, PackOptions, PackPlan, Reductions, Store,
};
use brickyard::volume::numbers::exact;
use brickyard::volume::{MAX_APRON, VoxelType, counted};
use clap::Args;
use std::num::NonZeroUsize;
use std::path::Path;
use std::sync::OnceLock;
use std::time::Instant;

/// The flags that determine a store's bytes.
#[derive(Args, Clone, Debug)]
pub(crate) struct StoreSettings {
    /// Meaning of the voxels; labels are never averaged [default: labels where the file says so, else image]
    #[arg(help_heading = heading::INPUT, long, value_parser = KINDS)]
    kind: Option<Kind>,
    /// Name of the volume in the store's OME-Zarr metadata [default: none]
    #[arg(help_heading = heading::STORE, long, value_name = "NAME")]
    name: Option<String>,
    /// Version of OME-Zarr of the store's metadata, 0.5 or 0.6 [default: that of the image for labels inside one, of a
    /// store being replaced or resumed, else 0.5]
    #[arg(help_heading = heading::STORE, long, value_name = "VERSION")]
    ngff: Option<Ngff>,
    /// Voxels along a brick's edge; a power of two [default: 64]
    #[arg(help_heading = heading::STORE, long)]
    brick: Option<u32>,
    /// Voxels along a shard file's edge [default: 512]
    #[arg(help_heading = heading::STORE, long)]
    shard: Option<u32>,
    /// zstd:LEVEL, shuffle-zstd:LEVEL or none [default: zstd:1 for 8-bit data, shuffle-zstd:1 for wider]
    #[arg(help_heading = heading::STORE, long)]
    codec: Option<Codec>,
    /// Method of making a level from the finer one: mean, max, min, mode or nearest; mean,max makes both, so maximum
    /// projections lose nothing at any level, and mean,min does so for minima [default: mean,max for images, mode for
    /// labels]
    #[arg(help_heading = heading::STORE, long, value_name = "METHOD[,METHOD]")]
    downsample: Option<Reductions>,
    /// Store each brick's apron too, 1 or 2 voxels wide (2 for tricubic samples): takes a tenth or a fifth more disk,
    /// and views decode no brick only for its neighbours [default: none is stored]
    #[arg(help_heading = heading::STORE, long, value_name = "VOXELS", value_parser = clap::value_parser!(u32).range(1..=MAX_APRON as i64))]
    aprons: Option<u32>,
}

/// Limits of packing, and its display of progress.
#[derive(Args, Clone, Copy, Debug)]
pub(crate) struct PackingLimits {
    /// Limit of the process's own memory
    #[arg(help_heading = heading::WORK, long, value_name = "BYTES", default_value = "2GiB", value_parser = values::bytes)]
    memory: u64,
    /// Threads [default: all]
    #[arg(help_heading = heading::WORK, short = 'j', long, value_parser = values::threads)]
    threads: Option<NonZeroUsize>,
    /// How to show progress
    #[arg(help_heading = heading::WORK, long, value_enum, default_value_t)]
    pub(crate) progress: ProgressStyleArgument,
}

impl PackingLimits {
    pub(crate) fn limit(&self, options: PackOptions) -> PackOptions {
        let threads = self.threads.map_or(options.threads, NonZeroUsize::get);
        PackOptions { memory_bytes: self.memory, threads, ..options }
    }

    /// Compares a packed store with its source, and verifies it.
    ///
    /// # Errors
    /// Exit code 5 if it differs from the source, or anything in it is wrong; every problem is printed.
    pub(crate) fn verify(&self, source: &dyn Source, path: &Path) -> Result<(), Failure> {
        let threads = self.limit(PackOptions::new(source.info().voxel_type)).threads;
        let progress = Progress::new(self.progress, "compare");
        let compared =
            store::compare_within(path, source, self.memory, threads, |done, total| progress.set(done, total));
        progress.finish();
        let difference = compared.map_err(|error| store_errors::verify_failure(error, path))?;
        let mut report = verify::report(path, self.memory, self.progress)?;
        report.problems.splice(0..0, difference);
        verify::tell(&report, path, false, None)?;
        let changed = source.info().notes.iter().map(Note::changed).fold(0, u64::saturating_add);
        let input = match changed {
            0 => "input".into(),
            _ => format!("converted input ({} rounded or clamped)", counted(changed, "value")),
        };
        print_line(&format!("{}: equal to the {input}, voxel by voxel", path.display()))
    }

    pub(crate) fn of_append(&self) -> AppendOptions {
        let threads = self.threads.map_or(AppendOptions::default().threads, NonZeroUsize::get);
        AppendOptions { memory_bytes: self.memory, threads }
    }
}

/// The flags of a pack.
#[derive(Args, Clone, Debug)]
pub(crate) struct PackSettings {
    #[command(flatten)]
    pub(crate) store: StoreSettings,
    /// Time steps in a shard file, at most all: for a series of many small steps, fewer files, and equal bricks in
    /// several steps of a file are stored once
    #[arg(help_heading = heading::STORE, long, value_name = "STEPS", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    shard_time: u32,
    #[command(flatten)]
    pub(crate) limits: PackingLimits,
    /// Continue an interrupted pack of the same input and settings
    #[arg(help_heading = heading::WORK, long, conflicts_with = "overwrite")]
    pub(crate) resume: bool,
    /// Replace an existing output
    #[arg(help_heading = heading::WORK, long)]
    pub(crate) overwrite: bool,
    /// Whether the input is a stream, which is read once.
    #[arg(skip)]
    pub(crate) is_of_stream: bool,
}

pub(crate) const KINDS: Named<Kind> = Named(&[("image", Kind::Image, ""), ("labels", Kind::Labels, "")]);

impl StoreSettings {
    /// Whether the voxels are declared as labels, if a flag tells the kind.
    pub(crate) fn are_labels(&self) -> Option<bool> {
        self.kind.map(|kind| kind == Kind::Labels)
    }

    /// Returns the options of a new store of voxels of this type, which are of this kind unless a flag tells it.
    ///
    /// # Errors
    /// Exit code 2 if they contradict each other.
    pub(crate) fn options(&self, voxel_type: VoxelType, said: Kind) -> Result<PackOptions, Failure> {
        let kind = self.kind.unwrap_or(said);
        let downsample = self.downsample.unwrap_or(Reductions::default_for(kind));
        let averages = [Some(downsample.main()), downsample.second()].contains(&Some(Downsample::Mean));
        if kind == Kind::Labels && averages {
            let problem = "--downsample mean: the mean of two labels is another label: use mode, max, min or nearest \
                           with labels, or --kind image";
            return Err(Failure::usage(problem));
        }
        let defaults = PackOptions::new(voxel_type);
        Ok(PackOptions {
            edge: self.brick.unwrap_or(defaults.edge),
            shard_edge: self.shard.unwrap_or(defaults.shard_edge),
            codec: self.codec.unwrap_or(defaults.codec),
            downsample,
            kind,
            name: self.name.clone(),
            aprons: self.aprons.unwrap_or(0),
            ngff: self.ngff,
            ..defaults
        })
    }

    /// Checks the given flags against an existing store.
    ///
    /// # Errors
    /// Exit code 2 for a flag that contradicts it.
    pub(crate) fn check(&self, store: &Store) -> Result<(), Failure> {
        let info = store.info();
        let codec = self.codec.map(|codec| codec.for_voxel_type(info.voxel_type));
        let flags = [
            ("--name", self.name.clone(), info.name.clone().unwrap_or_else(|| "no name".into())),
            ("--kind", self.kind.map(|kind| KINDS.name(&kind).to_owned()), KINDS.name(&info.kind).to_owned()),
            ("--brick", self.brick.map(|edge| edge.to_string()), info.edge.to_string()),
            ("--shard", self.shard.map(|edge| edge.to_string()), info.shard.to_string()),
            ("--codec", codec.map(|codec| codec.to_string()), info.codec.to_string()),
            ("--downsample", self.downsample.map(|methods| methods.to_string()), info.downsample.to_string()),
            ("--aprons", self.aprons.map(|width| width.to_string()), info.aprons.to_string()),
        ];
        if let (Some(ngff), Some(found)) = (self.ngff, store.ngff())
            && ngff != found
        {
            let path = store.path().display();
            let problem = format!("{path} is OME-Zarr {found}; leave --ngff out, or use `brickyard upgrade`");
            return Err(Failure::usage(format!("--ngff {ngff}: {problem}")));
        }
        for (flag, given, found) in flags {
            if let Some(given) = given.filter(|given| *given != found) {
                let store = store.path().display();
                let problem = format!("{store} was packed with {found}, which cannot change; leave {flag} out");
                return Err(Failure::usage(format!("{flag} {given}: {problem}")));
            }
        }
        Ok(())
    }
}

impl PackSettings {
    /// Returns the options of a new store of voxels of this type, which are of this kind unless a flag tells it.
    ///
    /// # Errors
    /// Exit code 2 if they contradict each other.
    pub(crate) fn options(&self, voxel_type: VoxelType, said: Kind) -> Result<PackOptions, Failure> {
        let exists = match (self.resume, self.overwrite) {
            (true, _) => Exists::Resume,
            (_, true) => Exists::Overwrite,
            _ => Exists::Refuse,
        };
        let options = self.limits.limit(self.store.options(voxel_type, said)?);
        Ok(PackOptions { shard_times: self.shard_time, exists, ..options })
    }

    /// Packs a source into a store, printing the plan first and the result last.
    ///
    /// # Errors
    /// With the exit code for the failure: 2 settings, 3 the input, 4 resumable.
    pub(crate) fn pack(&self, source: &dyn Source, path: &Path) -> Result<(), Failure> {
        let info = source.info();
        let options = self.options(info.voxel_type, Kind::said_by(info))?;
        note_uncalibrated(info);
        let planned = Planned { source, options: &options, shown: PlanShown::Line };
        let watcher = Watcher::new(info, "pack", self.limits.progress, Some(planned), Interrupt::watch()?);
        let started = Instant::now();
        let packed = store::pack(source, path, &options, &watcher);
        watcher.finish();
        let report = packed.map_err(|error| self.failure(error, path))?;
        if report.was_complete {
            say!("{} is complete already", path.display());
            return Ok(());
        }
        let seconds = started.elapsed().as_secs_f64();
        let input_bytes = input_bytes(source);
        say!(
            "packed {} in {seconds:.1} s ({:.0} MB/s); wrote {}",
            values::human_bytes(input_bytes),
            input_bytes as f64 / 1e6 / seconds.max(1e-9),
            values::human_bytes(report.written_bytes),
        );
        if let Some(nodata) = info.nodata.filter(|_| report.nodata > 0) {
            let nodata = exact(nodata, info.voxel_type.is_float());
            say!("note: {} of {nodata}, no data: not drawn and not counted", counted(report.nodata, "voxel"));
        }
        note_non_finite(report.non_finite);
        Ok(())
    }

    /// Makes all checks of [`PackSettings::pack`], and prints the plan and the remarks, but packs nothing.
    ///
    /// # Errors
    /// As for a pack, before its first voxel.
    pub(crate) fn rehearse(&self, source: &dyn Source, path: &Path, json: bool) -> Result<(), Failure> {
        let info = source.info();
        let options = self.options(info.voxel_type, Kind::said_by(info))?;
        note_uncalibrated(info);
        let planned = Planned { source, options: &options, shown: PlanShown::Not };
        let watcher = Watcher::new(info, "pack", ProgressStyleArgument::None, Some(planned), Interrupt::watch()?);
        let plan = store::rehearse(source, path, &options, &watcher).map_err(|error| self.failure(error, path))?;
        let Some(plan) = plan else {
            say!("{} is complete already", path.display());
            return Ok(());
        };
        let text = PlanText { info, plan: &plan, time: store::estimate(source, &options, &plan) };
        if json { print_json(&text.json()) } else { print_line(&text.words()) }
    }

    fn failure(&self, error: PackError, store: &Path) -> Failure {
        let from_stream = "a stream cannot be read again: pack it anew with --overwrite, or from a file";
        let PackError::Cancelled { done, total, .. } = error else {
            let failure = store_errors::pack_failure(error);
            return match failure.kind {
                ExitKind::Incomplete if self.is_of_stream => {
                    Failure::new(failure.kind, format!("{}; but {from_stream}", failure.message))
                }
                _ => failure,
            };
        };
        if done == 0 {
            let problem = format!("{}: stopped before a shard was complete: nothing is left of it", store.display());
            return Failure::new(ExitKind::Interrupted, problem);
        }
        let cure = match self.overwrite {
            _ if self.is_of_stream => from_stream,
            true => "the same command with --resume instead of --overwrite goes on; with --overwrite it starts over",
            false => "the same command with --resume goes on; with --overwrite it starts over",
        };
        let (store, shards) = (store.display(), counted(total, "shard"));
        let problem = format!("{store}: stopped; {done} of {shards} are complete and kept: {cure}");
        Failure::new(ExitKind::Interrupted, problem)
    }
}

fn input_bytes(source: &dyn Source) -> u64 {
    let info = source.info();
    let volumes = info.times as u64 * info.channels as u64;
    volumes * info.extent.volume() * info.voxel_type.bytes() as u64
}

/// Prints a note if a source gives no voxel size.
pub(crate) fn note_uncalibrated(info: &SourceInfo) {
    if !info.calibrated {
        say!("note: the input gives no voxel size: the store is uncalibrated; set one with --spacing and --unit");
    }
}

/// Prints a note on this many voxels without a number, if there are any.
pub(crate) fn note_non_finite(voxels: u64) {
    if voxels > 0 {
        let voxels = counted(voxels, "voxel");
        say!("note: {voxels} without a number (no data, NaN or infinite): not drawn and not counted");
    }
}

/// A pack about to begin.
pub(crate) struct Planned<'a> {
    source: &'a dyn Source,
    options: &'a PackOptions,
    shown: PlanShown,
}

/// Whether a plan is shown before the work.
#[derive(PartialEq)]
enum PlanShown {
    Line,
    /// The plan is the command's result.
    Not,
}

/// Shows the remarks and the progress of a pack or an append, and a pack's plan.
pub(crate) struct Watcher<'a> {
    info: &'a SourceInfo,
    style: ProgressStyleArgument,
    progress: Progress,
    /// The pack; `None` for an append, which shows no plan and no aprons.
    pack: Option<Planned<'a>>,
    /// Set once aprons are made.
    aprons: OnceLock<Progress>,
    interrupt: Interrupt,
}

impl<'a> Watcher<'a> {
    /// `what` names the work in a word.
    pub(crate) fn new(
        info: &'a SourceInfo,
        what: &'static str,
        style: ProgressStyleArgument,
        pack: Option<Planned<'a>>,
        interrupt: Interrupt,
    ) -> Self {
        Self { info, style, progress: Progress::new(style, what), pack, aprons: OnceLock::new(), interrupt }
    }

    pub(crate) fn finish(&self) {
        self.progress.finish();
        self.aprons.get().inspect(|aprons| aprons.finish());
    }
}

/// Returns the hint for a pack of many small steps, each with its own files.
fn of_small_shards(plan: &PackPlan, shard_times: u32) -> Option<String> {
    const MANY: u64 = 1000;
    const SMALL_BYTES: u64 = 1 << 20;
    let shards = plan.layout.shard_count();
    let shard_bytes = plan.output_bytes_at_most / shards.max(1);
    if shard_times > 1 || plan.layout.times == 1 || shards < MANY || shard_bytes >= SMALL_BYTES {
        return None;
    }
    let steps = (8 * SMALL_BYTES).div_ceil(shard_bytes.max(1)).min(plan.layout.times.into());
    Some(format!(
        "{} of {} at most: --shard-time {steps} would put {steps} steps into each, which packs faster and makes fewer \
         files, but no step could be appended then",
        counted(shards, "shard"),
        values::human_bytes(shard_bytes),
    ))
}

impl store::Progress for Watcher<'_> {
    fn planned(&self, plan: &PackPlan) {
        let Some(Planned { source, options, shown }) = &self.pack else { return };
        if *shown == PlanShown::Line {
            // A resumed pack has done some of the work.
            let is_new = options.exists != Exists::Resume && !say::is_quiet();
            let time = is_new.then(|| store::estimate(*source, options, plan)).flatten();
            say!("{}", PlanText { info: self.info, plan, time }.words());
        }
        if let Some(hint) = of_small_shards(plan, options.shard_times) {
            say!("note: {hint}");
        }
    }

    fn note(&self, message: &str) {
        say!("note: {}", with_flags(message));
    }

    fn warn(&self, message: &str) {
        say!("warning: {}", with_flags(message));
    }

    fn advanced(&self, done: u64, total: u64) {
        let bytes = self.info.voxel_type.bytes() as u64;
        self.progress.set(done * bytes, total * bytes);
    }

    fn aprons(&self, done: u64, total: u64) {
        let start = || {
            self.progress.finish();
            Progress::new(self.style, "aprons")
        };
        if self.pack.is_some() {
            self.aprons.get_or_init(start).set(done, total);
        }
    }

    fn is_cancelled(&self) -> bool {
        self.interrupt.is_asked()
    }
}
