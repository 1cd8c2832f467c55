//! Pictures as planes: PNG, JPEG and BMP files, a z plane each, listed and ordered as single-page TIFF files are.
//!
//! Opening reads the header of each file and closes it again; all must agree in size, depth and channels. Reading decodes the whole picture for
//! any part of its plane: PNG and BMP row by row, JPEG in memory. Numbers are those stored: colour profiles and gamma are not applied.

mod bmp;
mod exif;
mod header;
mod jpeg;
mod png;
mod rows;
#[cfg(test)]
mod tests;

use crate::axes::{Axis, Sizes};
use crate::error::{ImportError, Result};
use crate::format::PictureKind;
use crate::options::OpenOptions;
use crate::page_map::{PageMap, as_told};
use crate::raw::identity;
use crate::series::Remarks;
use crate::source::{Access, Source, SourceInfo};
use crate::spacing::check_alike;
use crate::stamp::Stamp;
use brickyard_volume::VoxelBox;
use header::{Header, PictureFormat};
use rows::Rectangle;
use std::path::{Path, PathBuf};

/// Pictures of one kind and format, a plane each.
struct PictureStack {
    info: SourceInfo,
    kind: PictureKind,
    format: PictureFormat,
    files: Vec<PictureFile>,
    map: PageMap,
    /// Whether palettes are left out, since their indices are labels.
    are_labels: bool,
    /// Memory for decoding the largest picture.
    reader_bytes: u64,
}

struct PictureFile {
    path: PathBuf,
    /// The file's stamp when its header was read.
    stamp: Stamp,
}

/// Opens pictures as planes, in the given order: along z, or by the caller's axes.
///
/// # Errors
/// If one cannot be read, or differs from the first.
pub(crate) fn open(paths: &[PathBuf], kind: PictureKind, options: &OpenOptions) -> Result<Box<dyn Source>> {
    let are_labels = options.are_labels == Some(true);
    let mut first: Option<Header> = None;
    let (mut files, mut remarks) = (Vec::with_capacity(paths.len()), Remarks::default());
    let mut reader_bytes = 0;
    for path in paths {
        let stamp = Stamp::of(path)?;
        let header = header_of(path, kind, are_labels);
        stamp.check(path)?;
        let header = header?;
        remarks.add(&header.notes, path.display());
        reader_bytes = header.reader_bytes.max(reader_bytes);
        files.push(PictureFile { path: path.clone(), stamp });
        let Some(expected) = &first else {
            first = Some(header);
            continue;
        };
        let first_path = paths[0].display();
        if header.format != expected.format {
            let problem = format!(
                "is {}, but {first_path} is {}: write all pictures alike, or name those that are",
                header.format, expected.format
            );
            return Err(ImportError::invalid(path, problem));
        }
        check_alike(path, header.scale, &paths[0], expected.scale, options)?;
    }
    let Some(Header { format, scale: (spacing, unit), .. }) = first else {
        return Err(ImportError::options(Path::new("input"), "no picture given"));
    };
    let map = arrange(&paths[0], paths.len(), &format, options)?;
    let sizes = Sizes { channels: map.sizes.channels.saturating_mul(format.channels()), ..map.sizes };
    sizes.checked_bytes(format.voxel_type().bytes()).map_err(|problem| ImportError::invalid(&paths[0], problem))?;
    let mut info = SourceInfo {
        identity: identity(&format!("pictures {format} {}", map.kind()), paths)?,
        ..SourceInfo::plain(sizes, format.voxel_type())
    };
    if let Some(spacing) = spacing {
        spacing.place(unit, &mut info);
    }
    info.geometry.unit = unit.map(str::to_owned);
    info.channel_looks = format.looks(info.channels);
    info.notes.extend(remarks.of_all(paths.len(), "files"));
    Ok(Box::new(PictureStack { info, kind, format, files, map, are_labels, reader_bytes }))
}

/// Maps planes to pictures.
fn arrange(path: &Path, count: usize, format: &PictureFormat, options: &OpenOptions) -> Result<PageMap> {
    let count = u32::try_from(count).map_err(|_| ImportError::options(path, "too many pictures"))?;
    let (axes, mut sizes) = match &options.axes {
        Some(axes) => as_told(axes, count, options).map_err(|problem| ImportError::options(path, problem))?,
        None => (vec![Axis::Z], Sizes::from_ordered(&[Axis::Z], &[count])),
    };
    [sizes.extent.x, sizes.extent.y] = [format.width, format.height];
    Ok(PageMap::along(&axes, sizes, 1))
}

fn header_of(path: &Path, kind: PictureKind, are_labels: bool) -> Result<Header> {
    match kind {
        PictureKind::Png => png::OpenPng::open(path, are_labels).map(|png| png.header),
        PictureKind::Jpeg => jpeg::OpenJpeg::open(path, are_labels).map(|jpeg| jpeg.header),
        PictureKind::Bmp => bmp::OpenBmp::open(path, are_labels).map(|bmp| bmp.header),
    }
}

impl PictureStack {
    /// Decodes a picture's part in a rectangle.
    fn read(&self, path: &Path, rectangle: &mut Rectangle<'_>) -> Result<()> {
        let check = |header: &Header| match header.format == self.format {
            true => Ok(()),
            false => {
                let problem = "has changed since it was opened; start over when no program writes to it";
                Err(ImportError::invalid(path, problem))
            }
        };
        match self.kind {
            PictureKind::Png => {
                let png = png::OpenPng::open(path, self.are_labels)?;
                check(&png.header)?;
                png.read(rectangle)
            }
            PictureKind::Jpeg => {
                let jpeg = jpeg::OpenJpeg::open(path, self.are_labels)?;
                check(&jpeg.header)?;
                jpeg.read(rectangle)
            }
            PictureKind::Bmp => {
                let bmp = bmp::OpenBmp::open(path, self.are_labels)?;
                check(&bmp.header)?;
                bmp.read(rectangle)
            }
        }
    }
}

impl Source for PictureStack {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn access(&self) -> Access {
        Access::Planes
    }

    fn reader_bytes(&self) -> u64 {
        self.reader_bytes
    }

    fn held_bytes(&self) -> u64 {
        let paths: usize = self.files.iter().map(|file| file.path.as_os_str().len()).sum();
        (size_of_val(&self.files[..]) + paths + self.info.identity.len()) as u64
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.info.check_box(time, channel, region, out);
        let channels = self.format.channels();
        let plane_bytes = out.len() / region.extent().z as usize;
        for (z, plane) in (region.min.z..).zip(out.chunks_exact_mut(plane_bytes)) {
            let place = self.map.place([time, channel / channels, z]);
            let file = &self.files[place.file as usize];
            let mut rectangle = Rectangle::new(region, (channel % channels) as usize, plane);
            let read = self.read(&file.path, &mut rectangle);
            // The bytes, or an error, count only if the file is unchanged since its header was read.
            file.stamp.check(&file.path)?;
            read?;
        }
        Ok(())
    }
}
