//! A source with its voxels converted to another type, by the rules of [`Conversion`].
//!
//! Where values may be lost, the part of the input to be taken is read for it once when it is opened: losses are counted and told, or the
//! first one is an error with its place. A box is read in pieces of at most 4 MiB, or of a plane, and converted; nothing is lent.

use crate::boxes::{blocks, pieces};
use crate::conversion::{Conversion, Fate};
use crate::error::{ImportError, Result};
use crate::note::Note;
use crate::options::OpenOptions;
use crate::part::Part;
use crate::source::{Access, Source, SourceInfo};
use brickyard_volume::numbers::exact;
use brickyard_volume::{Extent, VoxelBox, VoxelType, counted};
use std::path::{Path, PathBuf};

/// Most bytes of a piece, except of planes that are decoded as a whole.
const PIECE_BYTES: u64 = 4 << 20;

/// Voxels along the edge of the boxes in which the input is looked through: those of a pack by default.
const LOOK_EDGE: u32 = 64;

/// A source of another one's voxels in another type.
pub(crate) struct Converted {
    source: Box<dyn Source>,
    info: SourceInfo,
    conversion: Conversion,
    lossy: bool,
    are_labels: bool,
    path: PathBuf,
}

/// A voxel of the input, for messages.
struct Place {
    time: u32,
    channel: u32,
    voxel: [u32; 3],
}

/// Counts of lost values.
#[derive(Default)]
struct Lost {
    count: u64,
    rounded: u64,
    clamped: u64,
    /// The first lost value, a clamped one if there is any, and its place.
    example: Option<(f64, Place)>,
}

impl Converted {
    /// Converts a source's voxels. Only the `part` of them is read later.
    ///
    /// # Errors
    /// If values would be lost that may not be, in the part; or reading fails.
    pub(crate) fn new(
        source: Box<dyn Source>,
        to: VoxelType,
        part: &Part,
        options: &OpenOptions,
        path: &Path,
    ) -> Result<Self> {
        let whole = source.info();
        let conversion = Conversion::new(whole, to, options).map_err(|nodata| {
            let problem = format!(
                "`to_voxel_type` {to}: voxels of {nodata} hold no data, a value that {to} cannot hold; convert to another \
                 type, or choose the value with `nodata`"
            );
            ImportError::options(path, problem)
        })?;
        let mut info = whole.clone();
        let from = info.voxel_type;
        info.voxel_type = to;
        info.identity = format!("{}, {from} as {to}", info.identity);
        if to.is_float() {
            info.nodata = info.nodata.map(|nodata| f64::from(nodata as f32));
            info.knows_nodata |= info.nodata.is_some();
        } else if from.is_float() || info.nodata.is_some() {
            info.nodata = conversion.marker;
            info.knows_nodata &= conversion.marker.is_none();
        }
        clamp_windows(&mut info, to);
        let are_labels = options.take_labels(whole.kind);
        let (lossy, path) = (options.allow_lossy && !are_labels, path.to_owned());
        let mut converted = Self { source, info, conversion, lossy, are_labels, path };
        if from == to {
            // Only voxels without data change their mark.
        } else if !conversion.may_lose() {
            converted.info.notes.push(Note::new(format!("Voxels are {from} and become {to}: no value is changed.")));
        } else if !options.is_looked_at {
            let lost = converted.look_through(part)?;
            converted.info.notes.push(lost.note(from, to));
        }
        Ok(converted)
    }

    /// Reads the part once, and counts the values to be lost.
    fn look_through(&self, part: &Part) -> Result<Lost> {
        let mut lost = Lost::default();
        let (from, to) = (self.conversion.from.bytes(), self.conversion.to.bytes());
        let (mut voxels, mut out) = (Vec::new(), Vec::new());
        for time in (0..part.steps).map(|step| part.step(step)) {
            for &channel in &part.channels {
                for region in self.looks(part.region) {
                    let count = region.extent().volume() as usize;
                    voxels.resize(count * from, 0);
                    out.resize(count * to, 0);
                    self.source.read_box(time, channel, region, &mut voxels)?;
                    self.conversion.convert(&voxels, &mut out, |i, value, fate| {
                        let place = || Place { time, channel, voxel: voxel_of(region, i) };
                        self.check(value, fate, place)?;
                        lost.add(value, fate, place);
                        Ok::<(), ImportError>(())
                    })?;
                    lost.count += count as u64;
                }
            }
        }
        Ok(lost)
    }

    /// The boxes in which a region is looked through: planes where these are decoded as a whole.
    fn looks(&self, region: VoxelBox) -> impl Iterator<Item = VoxelBox> + use<> {
        let extent = region.extent();
        let steps = match self.source.access() {
            Access::Planes => [extent.x, extent.y, 1],
            Access::Box => [LOOK_EDGE; 3],
        };
        blocks(region, steps)
    }

    /// Refuses a value that may not be converted.
    fn check(&self, value: f64, fate: Fate, place: impl FnOnce() -> Place) -> Result<()> {
        if fate.is_allowed(self.lossy) {
            return Ok(());
        }
        let (from, to) = (self.conversion.from, self.conversion.to);
        let Place { time, channel, voxel: [x, y, z] } = place();
        let value = exact(value, from.is_float());
        let of = format!(
            "voxels are {from}, and the value {value} (voxel {x},{y},{z}, channel {channel}, time step {time})"
        );
        let problem = match fate {
            Fate::Unmarked => {
                format!("{of} is no data, for which {to} has no value; give one with `nodata`, or convert to f32")
            }
            Fate::Beside => {
                let marker = self.conversion.marker.unwrap_or_default();
                format!(
                    "{of} cannot be held in {to} beside {marker}, which means no data; convert to another type, or \
                     choose another value for no data with `nodata`"
                )
            }
            _ if self.are_labels => format!(
                "{of} cannot be held as it is in {to}, and rounded or clamped labels become others: convert to a wider \
                 type, or number them anew from 1"
            ),
            _ => {
                let becomes = if fate == Fate::Rounded { "rounded to the nearest" } else { "clamped to its limits" };
                format!("{of} cannot be held as it is in {to}; pass `allow_lossy` to have such values {becomes}")
            }
        };
        Err(ImportError::options(&self.path, problem))
    }
}

impl Lost {
    fn add(&mut self, value: f64, fate: Fate, place: impl FnOnce() -> Place) {
        let is_first = match fate {
            Fate::Rounded => {
                self.rounded += 1;
                self.example.is_none()
            }
            Fate::Clamped => {
                self.clamped += 1;
                self.clamped == 1
            }
            _ => false,
        };
        if is_first {
            self.example = Some((value, place()));
        }
    }

    fn note(&self, from: VoxelType, to: VoxelType) -> Note {
        let Some((value, Place { time, channel, voxel: [x, y, z] })) = &self.example else {
            return Note::new(format!("Voxels are {from} and become {to}: no value is changed."));
        };
        let lost = [(self.clamped, "clamped to its limits"), (self.rounded, "rounded to the nearest")];
        let lost = lost.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}"));
        let (lost, values) = (lost.collect::<Vec<_>>().join(", "), counted(self.count, "value"));
        let value = exact(*value, from.is_float());
        let text = format!(
            "Voxels are {from} and become {to}: of {values}, {lost} (such as {value} of voxel {x},{y},{z}, \
             channel {channel}, time step {time})."
        );
        Note::of_changed(self.clamped.saturating_add(self.rounded), text)
    }
}

/// Whether voxels are held otherwise in a type: numbers of another, or marked by a value, which is NaN in converted floats.
pub(crate) fn is_to_be_converted(info: &SourceInfo, to: VoxelType) -> bool {
    info.voxel_type != to || to.is_float() && info.nodata.is_some() && !info.knows_nodata
}

/// Keeps the windows of channels within a type.
pub(crate) fn clamp_windows(info: &mut SourceInfo, to: VoxelType) {
    let (least, most) = to.limits();
    for look in &mut info.channel_looks {
        let within = look.window.map(|window| window.map(|end| end.clamp(least, most)));
        look.window = within.filter(|[low, high]| low < high);
    }
}

/// Most bytes of a piece of a volume of voxels of `from` bytes each.
pub(crate) fn piece_bytes(access: Access, extent: Extent, from: u64) -> u64 {
    let plane = match access {
        Access::Planes => u64::from(extent.x) * u64::from(extent.y) * from,
        Access::Box => 0,
    };
    plane.max(extent.volume().saturating_mul(from).min(PIECE_BYTES))
}

/// The voxel of this number in a box, x fastest.
fn voxel_of(region: VoxelBox, i: usize) -> [u32; 3] {
    let [x, y, _] = region.extent().to_array().map(|n| n as usize);
    let place = [i % x, i / x % y, i / (x * y)];
    let first = region.min.to_array();
    std::array::from_fn(|axis| first[axis] + place[axis] as u32)
}

impl Source for Converted {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn beneath(&self) -> Option<&dyn Source> {
        Some(&*self.source)
    }

    fn reader_bytes(&self) -> u64 {
        let bytes = piece_bytes(self.access(), self.info.extent, self.conversion.from.bytes() as u64);
        self.source.reader_bytes().saturating_add(bytes)
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.info.check_box(time, channel, region, out);
        let (from, to) = (self.conversion.from.bytes(), self.conversion.to.bytes());
        let (mut voxels, mut rest) = (Vec::new(), out);
        let most = PIECE_BYTES / from as u64;
        for piece in pieces(region, self.access(), most) {
            let count = piece.extent().volume() as usize;
            voxels.resize(count * from, 0);
            self.source.read_box(time, channel, piece, &mut voxels)?;
            let (converted, others) = std::mem::take(&mut rest).split_at_mut(count * to);
            // The values were seen when the input was opened, unless its file has changed.
            self.conversion.convert(&voxels, converted, |i, value, fate| {
                self.check(value, fate, || Place { time, channel, voxel: voxel_of(piece, i) })
            })?;
            rest = others;
        }
        Ok(())
    }

    fn announce(&self, time: u32, channel: u32, region: VoxelBox) {
        self.source.announce(time, channel, region);
    }

    fn constant_in(&self, time: u32, channel: u32, region: VoxelBox) -> Option<f64> {
        let (value, fate) = self.conversion.of(self.source.constant_in(time, channel, region)?);
        (fate.is_allowed(self.lossy) && value.is_finite()).then_some(value)
    }
}
