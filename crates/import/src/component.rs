//! One channel of a source of several: a component by name or number, the magnitude of all, or the phase of a complex number. A component passes through
//! as it is. Magnitude and phase are f32 computed in f64, part by part of a box: each costs a read of every channel, and memory for one part.

#[cfg(test)]
mod tests;

use crate::choice::{ChannelChoice, names_of};
use crate::error::{ImportError, Result};
use crate::labels::SaidKind;
use crate::note::Note;
use crate::options::OpenOptions;
use crate::source::{Access, Source, SourceInfo, Take};
use brickyard_volume::{ChannelLook, VoxelBox, VoxelType, with_voxel_type};
use std::path::{Path, PathBuf};

/// Voxels computed at a time where boxes may be cut anywhere: a few MB with their channels.
const PART_VOXELS: u64 = 1 << 16;

/// One channel in place of several.
pub(crate) struct Component {
    info: SourceInfo,
    source: Box<dyn Source>,
    of: Of,
    path: PathBuf,
    /// Value of a stored voxel without data.
    nodata: Option<f64>,
    /// Whether a magnitude beyond f32 may become infinite.
    allow_lossy: bool,
}

/// The origin of the channel.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Of {
    Channel(u32),
    /// The root of the sum of all channels' squares.
    Magnitude,
    /// The angle of the second channel, imaginary, over the first, real, in radians.
    Phase,
}

impl Component {
    /// Takes a component by its name, its number, or `magnitude` or `phase`. `path` is for messages.
    ///
    /// # Errors
    /// If the source has one channel, none is so called, or labels would be computed with.
    pub(crate) fn new(source: Box<dyn Source>, component: &str, path: &Path, options: &OpenOptions) -> Result<Self> {
        let known = source.info();
        let names: Vec<String> = (0..known.channels.min(64)).map(|channel| name_of(known, channel)).collect();
        let refuse = |problem: String| Err(ImportError::options(path, format!("`component` {component}: {problem}")));
        if known.channels < 2 {
            return refuse("the input has one channel; leave it out".into());
        }
        let listed = names.join(", ");
        let of = match of_name(known, component) {
            Ok(Some(of)) => of,
            Ok(None) => return refuse(format!("expected a channel's name or number ({listed}), magnitude or phase")),
            Err(problem) => return refuse(problem),
        };
        if of == Of::Phase && known.channels != 2 {
            return refuse(format!(
                "a phase is of two channels, real and imaginary, not of {} ({listed})",
                known.channels
            ));
        }
        if !matches!(of, Of::Channel(_)) && options.take_labels(known.kind) {
            return refuse("labels are names of things, and no numbers; choose a channel, or `kind` image".into());
        }
        let mut info = known.clone();
        info.channels = 1;
        info.identity = format!("component {of:?} of {}", known.identity);
        match of {
            Of::Channel(channel) => {
                info.channel_looks = known.channel_looks.get(channel as usize).cloned().into_iter().collect();
                info.notes.push(Note::new(format!("Of the channels {listed}, {} is read.", name_of(known, channel))));
            }
            Of::Magnitude => {
                let how = "the root of the sum of their squares";
                computed(&mut info, "magnitude", &format!("The magnitude of {listed} is stored: {how}."));
            }
            Of::Phase => {
                let how = "in radians, of the second as imaginary part over the first as real part";
                computed(&mut info, "phase", &format!("The phase of {listed} is stored, {how}."));
            }
        }
        let nodata = known.sought_nodata();
        Ok(Self { info, of, path: path.to_owned(), nodata, allow_lossy: options.allow_lossy, source })
    }

    /// Cuts a box into parts to be computed at once: planes where a source decodes them, else rows.
    fn parts(&self, region: VoxelBox) -> impl Iterator<Item = VoxelBox> + use<> {
        let rows = match self.source.access() {
            Access::Planes => region.extent().y,
            Access::Box => self.rows_at_once(region.extent().x).min(region.extent().y),
        };
        let [min, max] = [region.min.to_array(), region.max.to_array()];
        (min[2]..max[2]).flat_map(move |z| {
            let starts = (min[1]..max[1]).step_by(rows as usize);
            starts.map(move |y| VoxelBox::new([min[0], y, z], [max[0], max[1].min(y.saturating_add(rows)), z + 1]))
        })
    }

    fn rows_at_once(&self, x: u32) -> u32 {
        u32::try_from(PART_VOXELS / u64::from(x)).unwrap_or(u32::MAX).max(1)
    }

    /// Computes a part of a box.
    fn compute(&self, time: u32, part: VoxelBox, out: &mut [u8]) -> Result<()> {
        let stored = self.source.info();
        let voxels = part.extent().volume() as usize;
        let mut bytes = vec![0; voxels * stored.voxel_type.bytes()];
        // Of a magnitude, the sum so far; of a phase, its real part first.
        let mut values = vec![0.0; voxels];
        for channel in 0..stored.channels {
            self.source.read_box(time, channel, part, &mut bytes)?;
            with_voxel_type!(stored.voxel_type, T => {
                for (value, voxel) in values.iter_mut().zip(bytes.chunks_exact(size_of::<T>())) {
                    let mut own = [0; size_of::<T>()];
                    own.copy_from_slice(voxel);
                    let own = T::from_le_bytes(own) as f64;
                    let own = if self.nodata == Some(own) { f64::NAN } else { own };
                    *value = match (self.of, channel) {
                        (Of::Phase, 0) => own,
                        (Of::Phase, _) => own.atan2(*value),
                        _ => *value + own * own,
                    };
                }
            });
        }
        for (out, value) in out.chunks_exact_mut(4).zip(values) {
            let value = if self.of == Of::Magnitude { value.sqrt() } else { value };
            let narrow = value as f32;
            if value.is_finite() && !narrow.is_finite() && !self.allow_lossy {
                let problem = format!(
                    "a magnitude of {value:e} at time step {time} is beyond f32; pass `allow_lossy` to make it infinite"
                );
                return Err(ImportError::options(&self.path, problem));
            }
            out.copy_from_slice(&narrow.to_le_bytes());
        }
        Ok(())
    }
}

/// Describes a computed channel. Voxels without data have become NaN.
fn computed(info: &mut SourceInfo, name: &str, note: &str) {
    (info.voxel_type, info.kind) = (VoxelType::F32, SaidKind::Unsaid);
    (info.nodata, info.knows_nodata) = (None, info.nodata.is_some() || info.knows_nodata);
    info.channel_looks = vec![ChannelLook { name: Some(name.into()), ..ChannelLook::default() }];
    info.notes.push(Note::new(note));
}

/// A channel's name, or its number.
fn name_of(info: &SourceInfo, channel: u32) -> String {
    let name = info.channel_looks.get(channel as usize).and_then(|look| look.name.clone());
    name.unwrap_or_else(|| channel.to_string())
}

/// The component so called; `None` if there is none. A channel of the very name comes before the words.
///
/// # Errors
/// If several channels are so called.
fn of_name(info: &SourceInfo, component: &str) -> Result<Option<Of>, String> {
    let names = names_of(info);
    match component {
        "magnitude" | "phase" if !names.contains(&Some(component)) => {
            Ok(Some(if component == "phase" { Of::Phase } else { Of::Magnitude }))
        }
        _ => Ok(component.parse::<ChannelChoice>()?.place_among(info.channels, &names)?.map(Of::Channel)),
    }
}

impl Source for Component {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn beneath(&self) -> Option<&dyn Source> {
        Some(&*self.source)
    }

    fn reader_bytes(&self) -> u64 {
        let own = match self.of {
            Of::Channel(_) => 0,
            _ => {
                let (x, y) = (u64::from(self.info.extent.x), u64::from(self.info.extent.y));
                let voxels = if self.access() == Access::Planes { x.saturating_mul(y) } else { x.max(PART_VOXELS) };
                voxels.saturating_mul(self.source.info().voxel_type.bytes() as u64 + size_of::<f64>() as u64)
            }
        };
        self.source.reader_bytes().saturating_add(own)
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.info.check_box(time, channel, region, out);
        if let Of::Channel(own) = self.of {
            return self.source.read_box(time, own, region, out);
        }
        let mut rest = out;
        for part in self.parts(region) {
            let bytes = part.extent().volume() as usize * self.info.voxel_type.bytes();
            let (own, behind) = rest.split_at_mut(bytes);
            self.compute(time, part, own)?;
            rest = behind;
        }
        Ok(())
    }

    fn lend(&self, time: u32, _channel: u32, region: VoxelBox, take: Take<'_>) -> Result<bool, ImportError> {
        match self.of {
            Of::Channel(own) => self.source.lend(time, own, region, take),
            _ => Ok(false),
        }
    }

    fn announce(&self, time: u32, _channel: u32, region: VoxelBox) {
        match self.of {
            Of::Channel(own) => self.source.announce(time, own, region),
            _ => (0..self.source.info().channels).for_each(|channel| self.source.announce(time, channel, region)),
        }
    }

    fn constant_in(&self, time: u32, _channel: u32, region: VoxelBox) -> Option<f64> {
        match self.of {
            Of::Channel(own) => self.source.constant_in(time, own, region),
            _ => None,
        }
    }
}
