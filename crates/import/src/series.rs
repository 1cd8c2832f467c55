//! One file per time step, as one source.
//!
//! Opening the series examines and closes each file, keeping its description and state. During reads, the last few steps are open, and a
//! reopened file must be unchanged. So neither descriptors, maps nor scratch space grow with the number of steps. Steps are mostly read in
//! sequence; jumping between more than the open ones costs an opening each time, which inflates compressed files.

mod one_type;
#[cfg(test)]
mod tests;

use crate::converted;
use crate::error::{ImportError, Result};
use crate::labels::SaidKind;
use crate::mirrored::axes_in_words;
use crate::note::Note;
use crate::options::OpenOptions;
use crate::part::Part;
use crate::source::{Access, Source, SourceInfo, Take};
use crate::stamp::Stamp;
use crate::step_time::StepTime;
use brickyard_volume::{ChannelLook, Geometry, VoxelBox, counted};
use one_type::Encoding;
use std::fmt::Display;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Most steps open at a time: one read by a pack, and one shown meanwhile.
pub(crate) const OPEN_STEPS: usize = 2;

/// Largest distance between two places of a voxel that count as one, in voxels.
const SAME_PLACE_VOXELS: f64 = 1e-3;

/// Description of the file of one time step, kept while it is closed.
pub(crate) struct StepFile {
    pub(crate) info: SourceInfo,
    pub(crate) access: Access,
    /// As [`Source::reader_bytes`], [`Source::held_bytes`] and [`Source::scratch_bytes`].
    pub(crate) reader_bytes: u64,
    pub(crate) held_bytes: u64,
    pub(crate) scratch_bytes: u64,
    pub(crate) step_time: StepTime,
}

impl StepFile {
    pub(crate) fn of(source: &dyn Source) -> Self {
        Self {
            info: source.info().clone(),
            access: source.access(),
            reader_bytes: source.reader_bytes(),
            held_bytes: source.held_bytes(),
            scratch_bytes: source.scratch_bytes(),
            step_time: source.step_time(),
        }
    }
}

/// Opens a step's file.
type Open = dyn Fn(&Path) -> Result<Box<dyn Source>> + Send + Sync;

/// A time series: files of one time step each, with the same extent, channels and spacing, converted to one voxel type.
pub(crate) struct Series {
    /// Description of all steps.
    all: StepFile,
    steps: Vec<Step>,
    open: Box<Open>,
    /// The conversion of all steps, if they are encoded in several ways.
    conversion: Option<Conversion>,
    /// The steps read last, at most [`OPEN_STEPS`], the latest at the end.
    recent: Mutex<Vec<Recent>>,
}

/// A conversion of steps looked through before.
struct Conversion {
    to: Encoding,
    options: OpenOptions,
}

/// A step's file, and its state when the series was opened.
struct Step {
    path: PathBuf,
    stamp: Stamp,
    /// Its voxels as the file has them.
    encoding: Encoding,
    /// Range of the step's own identity in the series'.
    identity: Range<usize>,
}

/// A recently read step, with its open file.
struct Recent {
    time: u32,
    /// `None` until it is open. The opening thread holds the lock, so others wait instead of opening it too.
    source: Arc<Mutex<Option<Arc<dyn Source>>>>,
}

impl Series {
    /// Joins files of one time step each. `options` are the user's, for all files; `check` examines one and closes it; `open` opens it for
    /// reading.
    ///
    /// # Errors
    /// If a file cannot be read, has several time steps or differs from the first, in a voxel type or mark that cannot become one.
    pub(crate) fn new(
        paths: &[PathBuf],
        options: &OpenOptions,
        check: impl Fn(&Path) -> Result<StepFile>,
        open: Box<Open>,
    ) -> Result<Self> {
        let mut all: Option<StepFile> = None;
        let mut has_first_place = false;
        let mut named: Option<(Vec<ChannelLook>, &Path)> = None;
        let mut measured: Option<(Vec<ChannelLook>, &Path)> = None;
        let (mut identity, mut remarks) = (String::new(), Remarks::default());
        let mut kinds = Vec::with_capacity(paths.len());
        let (mut steps, mut step_times) = (Vec::with_capacity(paths.len()), Vec::with_capacity(paths.len()));
        for path in paths {
            let stamp = Stamp::of(path)?;
            let found = check(path);
            // The findings, or an error, hold only for a file with this stamp.
            stamp.check(path)?;
            let mut file = found?;
            let has_place = file.info.has_place();
            // Values given by the user for all files are not compared.
            options.override_place(&mut file.info, path)?;
            let first = &all.as_ref().unwrap_or(&file).info;
            if !(has_place && has_first_place) {
                check_order(&file.info, path, first, &paths[0])?;
            }
            has_first_place |= all.is_none() && has_place;
            check_alike(&file.info, path, first, paths)?;
            if options.unit.is_none() {
                check_unit(&file.info, path, first, &paths[0])?;
            }
            let looks = &file.info.channel_looks;
            match &named {
                Some((others, other)) => check_channels(looks, path, others, other)?,
                None if looks.iter().any(|look| look.name.is_some()) => named = Some((looks.clone(), path)),
                None => {}
            }
            let has_unit = looks.iter().any(|look| look.unit.is_some()) && options.value_unit.is_none();
            match &measured {
                Some((others, other)) if has_unit => check_value_units(looks, path, others, other)?,
                None if has_unit => measured = Some((looks.clone(), path)),
                _ => {}
            }
            let start = identity.len();
            identity += &file.info.identity;
            let encoding = Encoding::of(&file.info, options);
            steps.push(Step { path: path.clone(), stamp, encoding, identity: start..identity.len() });
            identity += "\n";
            remarks.add(&file.info.notes, path.display());
            kinds.push((path.as_path(), file.info.kind));
            step_times.push(std::mem::take(&mut file.step_time));
            let (reader_bytes, held_bytes, scratch_bytes) = (file.reader_bytes, file.held_bytes, file.scratch_bytes);
            let all = all.get_or_insert(file);
            all.reader_bytes = all.reader_bytes.max(reader_bytes);
            all.held_bytes = all.held_bytes.max(held_bytes);
            all.scratch_bytes = all.scratch_bytes.max(scratch_bytes);
        }
        let Some(mut all) = all else {
            return Err(ImportError::options(Path::new("input"), "none given"));
        };
        let is_told = options.time_step.is_some() || options.time_stamps.is_some();
        let (time, note) = if is_told { (None, None) } else { StepTime::axis(&step_times) };
        let encodings: Vec<Encoding> = steps.iter().map(|step| step.encoding).collect();
        let to = Encoding::of_all(&encodings, paths, options)?;
        if let Some(to) = to {
            // Others may be chosen for other steps.
            identity += &format!("as {}\n", to.voxel_type);
            let looked = Self::look_through(&steps, to, &all, &open, options)?;
            looked.iter().for_each(|(notes, path)| remarks.add(notes, path.display()));
            (all.info.voxel_type, all.info.nodata, all.info.knows_nodata) = (to.voxel_type, to.nodata, to.knows_nodata);
            converted::clamp_windows(&mut all.info, to.voxel_type);
            all.reader_bytes = all.reader_bytes.saturating_add(converted::piece_bytes(all.access, all.info.extent, 4));
        }
        let conversion = to.map(|to| {
            let options = OpenOptions { is_looked_at: true, ..options.clone() };
            Conversion { to, options }
        });
        let mut notes = remarks.of_all(steps.len(), "files");
        notes.extend(note);
        notes.extend(to.map(|to| to.note(&encodings)));
        let kind = SaidKind::of_all(kinds, options.are_labels.is_some())?;
        let time = all.info.time.take().or(time);
        all.info = SourceInfo { times: steps.len() as u32, time, kind, identity, notes, ..all.info };
        let open_steps = OPEN_STEPS.min(steps.len()) as u64;
        all.scratch_bytes = all.scratch_bytes.saturating_mul(open_steps);
        let paths: usize = steps.iter().map(|step| step.path.as_os_str().len()).sum();
        let own_bytes = (size_of_val(&steps[..]) + paths + all.info.identity.len()) as u64;
        all.held_bytes = all.held_bytes.saturating_mul(open_steps).saturating_add(own_bytes);
        Ok(Self { all, steps, open, conversion, recent: Mutex::default() })
    }

    /// Looks through the steps to be taken whose values may be lost. Returns the remarks on each.
    fn look_through<'a>(
        steps: &'a [Step],
        to: Encoding,
        all: &StepFile,
        open: &Open,
        options: &OpenOptions,
    ) -> Result<Vec<(Vec<Note>, &'a Path)>> {
        let info = SourceInfo { times: steps.len() as u32, ..all.info.clone() };
        // One component of all is taken before its type is converted.
        let take_channel = if options.component.is_none() { options.take_channel.clone() } else { Vec::new() };
        let taken = OpenOptions { take_channel, ..options.clone() };
        let part = Part::of(&info, &taken, &steps[0].path)?;
        let part_of_one = Part { first_step: 0, stride: 1, steps: 1, ..part.clone() };
        let mut looked = Vec::new();
        for step in (0..part.steps).filter_map(|number| steps.get(part.step(number) as usize)) {
            if !to.may_lose(step.encoding) || options.is_looked_at {
                continue;
            }
            let source = open(&step.path);
            step.stamp.check(&step.path)?;
            let source = source?;
            let before = source.info().notes.len();
            let converted = to.convert(source, &part_of_one, options, &step.path)?;
            looked.push((converted.info().notes.get(before..).unwrap_or_default().to_vec(), &*step.path));
        }
        Ok(looked)
    }

    /// Returns the source of a step, opened unless it is among the last ones.
    fn step(&self, time: u32) -> Result<Arc<dyn Source>> {
        let place = self.place(time);
        let mut source = lock(&place);
        if let Some(source) = &*source {
            return Ok(source.clone());
        }
        let opened = self.reopen(&self.steps[time as usize])?;
        *source = Some(opened.clone());
        Ok(opened)
    }

    /// Makes a step the latest one, and closes the least recent if there are too many.
    fn place(&self, time: u32) -> Arc<Mutex<Option<Arc<dyn Source>>>> {
        let mut recent = lock(&self.recent);
        let step = match recent.iter().position(|step| step.time == time) {
            Some(i) => recent.remove(i),
            None => {
                if recent.len() == OPEN_STEPS {
                    recent.remove(0);
                }
                Recent { time, source: Arc::default() }
            }
        };
        let source = step.source.clone();
        recent.push(step);
        source
    }

    fn reopen(&self, step: &Step) -> Result<Arc<dyn Source>> {
        let opened = (self.open)(&step.path);
        // The findings, or an error, hold only for the file examined before.
        step.stamp.check(&step.path)?;
        let opened = opened?;
        let (found, known) = (opened.info(), &self.all.info);
        let is_same = found.identity == self.all.info.identity[step.identity.clone()]
            && (found.extent, found.channels) == (known.extent, known.channels)
            && found.voxel_type == step.encoding.voxel_type
            && found.times == 1;
        if !is_same {
            let problem = "changed since the series was opened; start over when no program writes to it";
            return Err(ImportError::invalid(&step.path, problem));
        }
        let Some(Conversion { to, options }) = &self.conversion else { return Ok(opened.into()) };
        let part = Part::of(opened.info(), &OpenOptions::default(), &step.path)?;
        Ok(to.convert(opened, &part, options, &step.path)?.into())
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // A panic cannot leave a list of steps, or a step open or not, half changed.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Remarks on parts of a volume, such as the files of a series, each once.
#[derive(Default)]
pub(crate) struct Remarks(Vec<Remark>);

struct Remark {
    note: Note,
    /// Name of the first part with it.
    first: String,
    parts: usize,
}

impl Remarks {
    pub(crate) fn add(&mut self, notes: &[Note], name: impl Display) {
        // A part may have a note twice.
        for (_, note) in notes.iter().enumerate().filter(|(i, note)| !notes[..*i].contains(note)) {
            // Values are counted part by part.
            let is_it = |remark: &&mut Remark| remark.note == *note && note.changed() == 0;
            match self.0.iter_mut().find(is_it) {
                Some(remark) => remark.parts += 1,
                None => self.0.push(Remark { note: note.clone(), first: name.to_string(), parts: 1 }),
            }
        }
    }

    /// Returns the remarks; those on fewer than all `count` parts, called `what`, name the first one with them.
    pub(crate) fn of_all(self, count: usize, what: &str) -> Vec<Note> {
        let named = |Remark { note, first, parts }| match parts {
            _ if parts == count => note,
            1 => note.about(&format!("{first}: ")),
            _ => note.about(&format!("{first} and {} more of {count} {what}: ", parts - 1)),
        };
        self.0.into_iter().map(named).collect()
    }
}

/// Checks that a step agrees with the first in all properties shared by a series.
fn check_alike(step: &SourceInfo, path: &Path, first: &SourceInfo, paths: &[PathBuf]) -> Result<()> {
    let first_path = paths[0].display();
    if step.times != 1 {
        let problem = format!(
            "{} files given, one per time step, but this one holds {}: join them first, as `ncrcat` or `cdo mergetime` does for \
             NetCDF, or `append` its steps one by one, each with `take_time`",
            paths.len(),
            step.times
        );
        return Err(ImportError::options(path, problem));
    }
    let describe = |i: &SourceInfo, voxel_type: &str| {
        let channels = counted(i.channels.into(), "channel");
        format!("{}{voxel_type} with {channels}, spacing {}", i.extent, i.geometry.spacing)
    };
    if describe(step, "") != describe(first, "") {
        let [own, other] = [step, first].map(|info| describe(info, &format!(" {}", info.voxel_type)));
        let problem = format!("is {own}, but {first_path} is {other}: write the steps alike, or pack each by itself");
        return Err(ImportError::invalid(path, problem));
    }
    let (own, other) = (&step.geometry, &first.geometry);
    let says_place = step.calibrated || step.says_origin || own.origin != Geometry::default().origin;
    let shift = ((own.origin - other.origin) / other.spacing).abs().max_element();
    // Volumes in a patient are compared by all of their places, below.
    if says_place && step.orientation.is_none() && shift > SAME_PLACE_VOXELS {
        let problem = format!(
            "its first voxel lies at {}, but that of {first_path} at {}: all steps have one place; give it with `origin`, or \
             pack each by itself",
            own.origin, other.origin
        );
        return Err(ImportError::options(path, problem));
    }
    let lies_there = match (&step.orientation, &first.orientation) {
        (Some(own), Some(other)) => own.agrees(other, step.extent),
        (own, other) => own == other,
    };
    if !lies_there {
        let problem =
            format!("lies differently in the patient than {first_path}: register the steps, or pack each by itself");
        return Err(ImportError::invalid(path, problem));
    }
    Ok(())
}

/// Checks that the voxels of a step, one of two of which at least has no place of its own, come in the order of the first one's.
fn check_order(step: &SourceInfo, path: &Path, first: &SourceInfo, first_path: &Path) -> Result<()> {
    if step.turned == first.turned {
        return Ok(());
    }
    let order = |info: &SourceInfo| match info.turned {
        [false, false, false] => "in the file's order".to_owned(),
        turned => format!("turned round along {}, as its coordinates descend", axes_in_words(turned)),
    };
    let problem = format!(
        "its voxels come {}, but those of {} {}: give all files coordinates, or pack each by itself",
        order(step),
        first_path.display(),
        order(first)
    );
    Err(ImportError::options(path, problem))
}

fn check_unit(step: &SourceInfo, path: &Path, first: &SourceInfo, first_path: &Path) -> Result<()> {
    let [own, other] = [step, first].map(|info| info.geometry.units_in_words());
    if own.is_none() || own == other {
        return Ok(());
    }
    let [own, other] = [own, other].map(|unit| unit.unwrap_or_else(|| "no unit".into()));
    let problem = format!(
        "has lengths in {own}, but {} in {other}: write them in one unit, or give the unit of all with `unit`",
        first_path.display()
    );
    Err(ImportError::options(path, problem))
}

/// Checks the units of a step's values against another file's, the first with any, where both have them.
fn check_value_units(looks: &[ChannelLook], path: &Path, others: &[ChannelLook], other_path: &Path) -> Result<()> {
    let units = |(own, other): (&ChannelLook, &ChannelLook)| own.unit.clone().zip(other.unit.clone());
    let Some((own, other)) = looks.iter().zip(others).filter_map(units).find(|(own, other)| own != other) else {
        return Ok(());
    };
    let problem = format!(
        "has values in {own}, but {} in {other}: write them in one unit, or give the unit of all with `value_unit`",
        other_path.display()
    );
    Err(ImportError::options(path, problem))
}

/// Checks a step's channel names against another file's, the first with such names, where both have them.
fn check_channels(looks: &[ChannelLook], path: &Path, other_looks: &[ChannelLook], other_path: &Path) -> Result<()> {
    let differs = |(own, other): (&ChannelLook, &ChannelLook)| {
        own.name.as_ref().zip(other.name.as_ref()).is_some_and(|(own, other)| own != other)
    };
    if !looks.iter().zip(other_looks).any(differs) {
        return Ok(());
    }
    let (other_path, [own, other]) = (other_path.display(), [looks, other_looks].map(names_of));
    let problem = format!(
        "has the channels {own}, but {other_path} has {other}: write the steps with the same channels in one order, or \
         pack each by itself"
    );
    Err(ImportError::invalid(path, problem))
}

fn names_of(looks: &[ChannelLook]) -> String {
    looks.iter().map(|look| look.name.as_deref().unwrap_or("(no name)")).collect::<Vec<_>>().join(", ")
}

impl Source for Series {
    fn info(&self) -> &SourceInfo {
        &self.all.info
    }

    fn access(&self) -> Access {
        self.all.access
    }

    fn reader_bytes(&self) -> u64 {
        self.all.reader_bytes
    }

    fn held_bytes(&self) -> u64 {
        self.all.held_bytes
    }

    fn scratch_bytes(&self) -> u64 {
        self.all.scratch_bytes
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.all.info.check_box(time, channel, region, out);
        self.step(time)?.read_box(0, channel, region, out)
    }

    fn lend(&self, time: u32, channel: u32, region: VoxelBox, take: Take<'_>) -> Result<bool, ImportError> {
        self.step(time)?.lend(0, channel, region, take)
    }

    fn announce(&self, time: u32, channel: u32, region: VoxelBox) {
        // An opening error is reported to the reader of the step.
        if let Ok(step) = self.step(time) {
            step.announce(0, channel, region);
        }
    }
}
