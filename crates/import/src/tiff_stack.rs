//! TIFF stacks on the `tiff` crate: multi-page files and BigTIFF, strips and tiles in every compression it decodes, lists of single-plane
//! files, sets of OME-TIFF files, and the page order and value meaning described by ImageJ, OME-XML, tifffile and MetaMorph.
//!
//! Opening walks all directories once: planes must agree, and their data must lie inside the file. Reading decodes only the strips or tiles
//! that intersect a box; since those mostly span a plane's width, each plane is best requested once. Each reading thread has a decoder of its
//! own, kept for the next call. Single-directory stacks (ImageJ's over 4 GiB, MetaMorph's) are plain arrays, read through
//! [`RawSource`](crate::raw::RawSource).

mod arrange;
mod calibration;
mod description;
mod gdal;
mod hyperstack;
mod imagej;
mod indices;
mod jpeg;
mod lzw;
mod ome;
mod ome_opening;
mod ome_pages;
mod ome_set;
mod opening;
mod page;
mod page_tags;
mod refusal;
mod scifio;
mod shaped;
mod stk;
mod tag_scale;
#[cfg(test)]
mod tests;
mod thumbnails;
mod told;
mod turn;
mod units;
mod walk;
mod xml;

pub(crate) use ome_opening::is_whole_set;
pub(crate) use ome_set::is_companion;
pub(crate) use opening::{has_several_planes, open_file, open_planes};

use crate::axes::Sizes;
use crate::direct::direct;
use crate::element::{Decode, Endian};
use crate::error::{ImportError, Result};
use crate::losses::Losses;
use crate::note::Note;
use crate::options::OpenOptions;
use crate::page_map::{PageMap, Place};
use crate::raw::identity;
use crate::source::{Access, Source, SourceInfo};
use crate::stamp::Stamp;
use crate::step_time::StepTime;
use brickyard_volume::{ChannelLook, VoxelBox};
use description::Description;
use page::{OpenTiff, PageFormat};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Most idle decoders: each is an open file, and a process may have some 1,000.
const MOST_IDLE: usize = 128;

/// A stack of planes in TIFF files as a source.
struct TiffStack {
    info: SourceInfo,
    /// Conversion of the library's samples, in this machine's byte order, to voxels.
    decode: Decode,
    parts: Parts,
    step_time: StepTime,
}

struct TiffFile {
    path: PathBuf,
    /// The file's stamp when its pages were checked.
    stamp: Stamp,
    pages: u32,
}

/// A stack's files, page format, and map of planes to pages.
struct Parts {
    files: Vec<TiffFile>,
    format: PageFormat,
    map: PageMap,
    /// Memory for the largest strip or tile.
    reader_bytes: u64,
    /// Idle decoders, each with the number of its file.
    idle: Mutex<Vec<(u32, OpenTiff)>>,
}

/// Looks of a photograph's channels: red, green and blue over all values of the type; further ones give opacity, and are black.
fn photograph(info: &SourceInfo, samples: u16) -> Vec<ChannelLook> {
    let whole = (!info.voxel_type.is_float()).then(|| info.voxel_type.limits());
    let parts = [("red", [255, 0, 0]), ("green", [0, 255, 0]), ("blue", [0, 0, 255]), ("opacity", [0; 3])];
    let look = |channel: u32| {
        let (name, color) = parts[(channel as usize % samples as usize).min(3)];
        ChannelLook { name: Some(name.into()), color: Some(color), window: whole.map(Into::into), unit: None }
    };
    (0..info.channels).map(look).collect()
}

impl TiffStack {
    fn new(parts: Parts, description: &Description, options: &OpenOptions) -> Result<Self> {
        let Parts { files, format, map, .. } = &parts;
        let path = &files[0].path;
        let (scale, note) = description.scale(format, options.nodata);
        let decode = Decode { element: format.element, endian: Endian::native(), scale };
        let sizes = Sizes { channels: map.sizes.channels.saturating_mul(format.samples as u32), ..map.sizes };
        sizes.checked_bytes(format.element.bytes()).map_err(|p| ImportError::invalid(path, p))?;
        let paths: Vec<&Path> = files.iter().map(|f| f.path.as_path()).collect();
        let mut info = SourceInfo {
            identity: identity(&format!("tiff {}", map.kind()), &paths)?,
            ..SourceInfo::plain(sizes, decode.voxel_type())
        };
        description.place(&mut info, format.element, scale);
        // A composite has a look for each channel.
        let are_told = !info.channel_looks.is_empty() && info.channel_looks.iter().all(|look| look.window.is_some());
        if format.is_rgb && !are_told {
            info.channel_looks = photograph(&info, format.samples);
        }
        description.place_values(&mut info, scale, note);
        if format.samples > 1 {
            let note = format!("Each page holds {} samples a pixel; they are read as channels.", format.samples);
            info.notes.push(Note::new(note));
        }
        let mut stack = Self { info, decode, parts, step_time: description.step_time.clone() };
        stack.count_losses(description.nodata_value(scale), options)?;
        description.mark(&mut stack.info, scale, options.nodata);
        Ok(stack)
    }

    /// Counts the losses of voxels in all planes; a forbidden loss is an error.
    fn count_losses(&mut self, nodata: Option<f64>, options: &OpenOptions) -> Result<()> {
        self.decode = direct(self.decode, nodata, options);
        self.info.voxel_type = self.decode.voxel_type();
        let path = |place: Place| &self.parts.files[place.file as usize].path;
        let Some(mut losses) = Losses::may_occur(&self.parts.files[0].path, self.decode, nodata, options) else {
            return Ok(());
        };
        let mut last = 0;
        for place in self.parts.map.by_file() {
            if place.file != last {
                losses.next_file(path(place));
                last = place.file;
            }
            self.with_page(place, |tiff| tiff.each_chunk(&self.parts.format, |samples| losses.see(samples)))?;
        }
        let (note, decode) = (losses.note(), losses.decode());
        self.info.notes.push(note);
        self.decode = decode;
        self.info.voxel_type = decode.voxel_type();
        Ok(())
    }

    /// Runs `f` on a decoder positioned at the page.
    fn with_page(&self, place: Place, f: impl FnOnce(&mut OpenTiff) -> Result<()>) -> Result<()> {
        let file = &self.parts.files[place.file as usize];
        // A poisoned lock still holds valid decoders: only the list changes under it.
        let rest = || self.parts.idle.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let idle = {
            let mut rest = rest();
            rest.iter().rposition(|(of, _)| *of == place.file).map(|i| rest.remove(i).1)
        };
        let read = || {
            let mut tiff = idle.map_or_else(|| OpenTiff::open(&file.path), Ok)?;
            tiff.seek(place.page)?;
            if tiff.format()? != self.parts.format {
                let problem = format!(
                    "page {} has changed since the file was opened; start over when no program writes to it",
                    place.page + 1
                );
                return Err(ImportError::invalid(&file.path, problem));
            }
            f(&mut tiff)?;
            Ok(tiff)
        };
        let tiff = read();
        // The bytes, or an error, count only if the file is unchanged since its pages were checked.
        file.stamp.check(&file.path)?;
        let tiff = tiff?;
        // The only page of a file needs no search.
        if file.pages > 1 {
            let mut rest = rest();
            if rest.len() >= MOST_IDLE {
                rest.remove(0);
            }
            rest.push((place.file, tiff.rest()));
        }
        Ok(())
    }
}

impl Source for TiffStack {
    fn step_time(&self) -> StepTime {
        self.step_time.clone()
    }

    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn access(&self) -> Access {
        Access::Planes
    }

    fn reader_bytes(&self) -> u64 {
        self.parts.reader_bytes
    }

    fn held_bytes(&self) -> u64 {
        let paths: usize = self.parts.files.iter().map(|file| file.path.as_os_str().len()).sum();
        let tables = size_of_val(&self.parts.files[..]) + self.parts.map.held_bytes() + self.info.identity.len();
        (tables + paths) as u64
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.info.check_box(time, channel, region, out);
        let samples = self.parts.format.samples as u32;
        let plane_bytes = out.len() / region.extent().z as usize;
        for (z, plane) in (region.min.z..).zip(out.chunks_exact_mut(plane_bytes)) {
            let place = self.parts.map.place([time, channel / samples, z]);
            self.with_page(place, |tiff| {
                tiff.read_rectangle(&self.parts.format, channel % samples, self.decode, region, plane)
            })?;
        }
        Ok(())
    }
}
