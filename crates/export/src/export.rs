//! The engine: a part of a store becomes a file of the format of the output's name.

use crate::budget::{Needs, pool, shares};
use crate::error::ExportError;
use crate::flat;
use crate::folder::{create_folder, keep_folder};
use crate::format::Format;
use crate::gzip::{self, Gzip};
use crate::job::{Blocks, Job};
use crate::nrrd::check_segments;
use crate::output::{Target, check};
use crate::plan::{Body, Plan};
use crate::planes::for_each_layer;
use crate::png;
use crate::pvd;
use crate::request::{ExportChannels, ExportRequest, ExportTime};
use crate::segments;
use crate::store_source::store_source;
use crate::volume::Volume;
use crate::zarr::{self, Written};
use brickyard_import::{ChannelChoice, OpenOptions, Source, StepChoice, take};
use brickyard_store::{Destination, Kind, Store};
use brickyard_volume::{Extent, VoxelBox};
use std::fs::File;
use std::io::BufWriter;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;

/// A written file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Exported {
    /// Voxels along x, y, z of one channel and step.
    pub extent: Extent,
    /// Number of channels.
    pub channels: u32,
    /// Number of time steps.
    pub times: u32,
    /// Sentences on facts lost in the format, and on those kept in its own way.
    pub notes: Vec<String>,
}

/// Exports voxels to `output`, whose name selects the format ([`Format::of`]). Calls `progress` with the bytes of voxels written so far and in total;
/// it may cancel.
///
/// # Errors
/// If the output exists and may not be replaced, its name has no format, the format cannot hold the voxels, the request is outside the store, a brick
/// cannot be read, the memory is too little for one thread, the file cannot be written, or `progress` cancels. Then nothing new is left behind.
pub fn export(
    store: &Arc<Store>,
    output: &Path,
    request: &ExportRequest,
    progress: impl Fn(u64, u64) -> ControlFlow<()> + Sync,
) -> Result<Exported, ExportError> {
    let region = request.checked_region(store)?;
    let format = Format::of(output).ok_or_else(|| ExportError::Extension { path: output.into() })?;
    if request.ngff.is_some() && format != Format::Zarr {
        return Err(ExportError::unfit(output, "`ngff` is for names ending in .zarr: choose one, or leave it out"));
    }
    let source = part_of(store, output, request, region)?;
    let info = source.info();
    let blocks = Blocks { edge: store.pyramid().edge(), first: region.min.to_array() };
    let job = Job::new(&*source, blocks, request.memory_bytes, output, &progress)?;
    let volume = Volume {
        info,
        name: store.info().name.as_deref(),
        is_labels: store.info().kind == Kind::Labels,
        has_channel_axis: !matches!(request.channels, ExportChannels::One(_)),
        has_time_axis: !matches!(request.time, ExportTime::Step(_)),
        segments: &[],
        ngff: request.ngff.unwrap_or_default(),
        output,
    };
    let segments = match format {
        Format::SegNrrd => {
            check_segments(&volume)?;
            Target::of(format, output).check(request.overwrite)?;
            segments::survey(&job, store.label_colors())?
        }
        _ => Vec::new(),
    };
    let volume = Volume { segments: &segments, ..volume };
    let plan = format.plan(&volume)?;
    let exported =
        Exported { extent: info.extent, channels: info.channels, times: info.times, notes: plan.notes.clone() };
    match &plan.body {
        Body::Flat(layout) => {
            write_file(&job, format, &plan, request, |file| flat::write(&job, layout, 0..info.times, file))?
        }
        Body::Gzip(head) => write_file(&job, format, &plan, request, |file| write_gzip(&job, head, file))?,
        Body::Pictures => {
            let Target { data: path, .. } = Target::of(format, output);
            check(&path, request.overwrite)?;
            let folder = create_folder(&path)?;
            png::write(&job, folder.path())?;
            keep_folder(folder, &path)?;
        }
        Body::Series => {
            let target = Target::of(format, output);
            target.check(request.overwrite)?;
            let folder = create_folder(&target.data)?;
            pvd::write(&job, &volume, folder.path())?;
            target.keep_series(folder, plan.text.as_deref().unwrap_or_default(), request.overwrite)?;
        }
        &Body::Zarr(version) => {
            let place = zarr_place(store, output, request.overwrite)?;
            zarr::write(&job, &Written { store, version, place: &place })?;
        }
    }
    Ok(exported)
}

/// The requested part of the store.
fn part_of(
    store: &Arc<Store>,
    output: &Path,
    request: &ExportRequest,
    region: VoxelBox,
) -> Result<Box<dyn Source>, ExportError> {
    let level = store_source(store.clone(), request.level).map_err(|error| {
        let problem = format!("level {} has no place in the patient ({error}): export a finer one", request.level);
        ExportError::unfit(output, problem)
    })?;
    let (first, end, stride) = request.time.range();
    let options = OpenOptions {
        roi: Some(region),
        take_channel: request.channels.numbers(store.channels()).into_iter().map(ChannelChoice::number).collect(),
        take_time: Some(StepChoice { first, end: Some(end), stride }),
        ..OpenOptions::default()
    };
    Ok(take(Box::new(level), &options, store.path())?)
}

/// The place of an OME-Zarr, which is not the exported store's.
fn zarr_place(store: &Store, output: &Path, overwrite: bool) -> Result<Destination, ExportError> {
    let place = Destination::new(output, overwrite).map_err(|error| zarr::of_pack(output, error))?;
    let is_store = [place.path(), store.path()].map(|path| path.canonicalize().ok());
    if is_store[0].is_some() && is_store[0] == is_store[1] {
        return Err(ExportError::unfit(output, "is the exported store itself: choose another name"));
    }
    Ok(place)
}

/// Writes a file, and the text beside it.
fn write_file(
    job: &Job,
    format: Format,
    plan: &Plan,
    request: &ExportRequest,
    write: impl FnOnce(&File) -> Result<(), ExportError>,
) -> Result<(), ExportError> {
    let target = Target::of(format, job.output);
    target.check(request.overwrite)?;
    let file = target.create()?;
    write(file.as_file())?;
    target.keep(file, plan.text.as_deref(), request.overwrite)
}

/// Writes header and planes through gzip.
fn write_gzip(job: &Job, head: &[u8], file: &File) -> Result<(), ExportError> {
    let extent = job.source.info().extent;
    let plane = VoxelBox::new([0; 3], [extent.x, extent.y, 1]);
    let needs = Needs { thread_bytes: gzip::THREAD_BYTES, plane_bytes: job.bytes_of(plane) as u64 };
    let shares = shares(job, needs)?;
    let io = ExportError::io(job.output);
    pool(shares.threads)?.install(|| {
        let mut gzip = Gzip::new(BufWriter::new(file)).map_err(&io)?;
        gzip.write(&[head]).map_err(&io)?;
        // Planes enough to keep all threads busy.
        let at_once = (shares.threads * gzip::PIECE_BYTES).div_ceil(job.bytes_of(plane));
        for_each_layer(job, shares, |layer| {
            layer.planes.chunks(at_once).try_for_each(|planes| {
                let planes: Vec<&[u8]> = planes.iter().map(Vec::as_slice).collect();
                gzip.write(&planes).map_err(&io)?;
                job.advance(planes.iter().map(|plane| plane.len() as u64).sum())
            })
        })?;
        gzip.finish().map_err(&io)
    })
}

#[cfg(test)]
mod round_trip_tests;
#[cfg(test)]
mod tests;
