//! Voxels of a series: rescaled values (Hounsfield units of a CT), integers if slopes and intercepts are, else floats. If 16 stored bits and an
//! intercept may not fit in 16 bits, all slices are decoded once to decide, on all cores.

use super::frames::Frames;
use super::header::Header;
use super::pixels::Meaning;
use super::stack::Slice;
use super::{dose, floats};
use crate::batches::{self, MOST_THREADS};
use crate::element::smallest_type;
use crate::error::{ImportError, Result};
use crate::options::{HeldAs, NoData, OpenOptions};
use brickyard_volume::{VoxelType, with_voxel_type};
use dicom_dictionary_std::tags;

/// Most memory for frames decoded in search of the smallest voxel type: there is no memory budget yet.
const MOST_LOOKED_AT_BYTES: u64 = 256 << 20;

pub(super) fn meaning_of(header: &Header, frames: &Frames, frame: usize, nodata: NoData) -> Result<Meaning> {
    if frames.format.is_float {
        return floats::meaning_of(header, frames, frame, nodata);
    }
    let first = |tag, name: &str| match (header.numbers(frame, tag), header.written(frame, tag)) {
        (Some(numbers), _) => Ok(Some(numbers[0])),
        (None, Some(text)) => {
            let problem = format!(
                "{name} is '{text}', expected a finite number: the meaning of its values is not known; write the file \
                 again"
            );
            Err(ImportError::invalid(&header.path, problem))
        }
        (None, None) => Ok(None),
    };
    let slope =
        dose::scale(header)?.map_or_else(|| first(tags::RESCALE_SLOPE, "RescaleSlope"), |scale| Ok(Some(scale)))?;
    let intercept = first(tags::RESCALE_INTERCEPT, "RescaleIntercept")?;
    if header.has_value_table && slope.is_none() {
        return Err(ImportError::unsupported(&header.path, "a table of values (ModalityLUTSequence)"));
    }
    if slope == Some(0.0) {
        let problem = "RescaleSlope is 0: all voxels would have the same value; expected another slope, or none";
        return Err(ImportError::invalid(&header.path, problem));
    }
    // Some writers store it as unsigned, whatever the pixels are.
    let wrap = |n: f64| frames.format.wrapped(n as i64);
    let padding = header.number(tags::PIXEL_PADDING_VALUE).filter(|_| nodata == NoData::OfFile).and_then(|value| {
        let limit = header.number(tags::PIXEL_PADDING_RANGE_LIMIT).unwrap_or(value);
        let [a, b] = [wrap(value), wrap(limit)];
        let [least, greatest] = frames.format.limits();
        let stored = [a.min(b).max(least), a.max(b).min(greatest)];
        (stored[0] <= stored[1]).then_some(stored)
    });
    let (slope, intercept) = (slope.unwrap_or(1.0), intercept.unwrap_or(0.0));
    Ok(Meaning { slope, intercept, padding, float_padding: None })
}

/// The first padding value, which is NaN in float voxels, for comparison with later steps.
pub(super) fn padding_of_floats(slices: &[Slice], voxel_type: VoxelType) -> Option<f64> {
    let meaning = slices.iter().map(|slice| slice.meaning).find(|meaning| meaning.padding.is_some())?;
    let [least, _] = meaning.padding.filter(|_| voxel_type.is_float())?;
    // Turns -0 into 0.
    Some(f64::from(meaning.value(least) as f32) + 0.0)
}

/// Voxel type, and the value of missing slices.
pub(super) struct Voxels {
    pub(super) voxel_type: VoxelType,
    pub(super) blank: f64,
}

/// Chooses the smallest type for every value, plus an unused one if slices are missing; floats if values are not integers.
pub(super) fn voxels_of(
    files: &[(Header, Frames)],
    slices: &[Slice],
    are_missing: bool,
    held_as: Option<HeldAs>,
) -> Result<Voxels> {
    let floats = Voxels { voxel_type: VoxelType::F32, blank: f64::NAN };
    let are_floats = files.iter().any(|(_, frames)| frames.format.is_float);
    if are_floats || !slices.iter().all(|slice| slice.meaning.is_whole()) {
        return Ok(floats);
    }
    // One integer marks padding in all slices; if it would be a value in some, padding is NaN.
    let first = slices[0].meaning;
    let is_padded = slices.iter().any(|slice| slice.meaning.padding.is_some());
    if is_padded && slices.iter().any(|slice| slice.meaning != first) {
        return Ok(floats);
    }
    let voxels = |[least, greatest]: [f64; 2]| {
        // Padding has a value already.
        let blank = first.padding.map_or(least - 1.0, |[padding, _]| first.value(padding));
        // As in the steps before, unless a voxel has that value here.
        let theirs = held_as.and_then(|held| held.nodata).filter(|value| !(least..=greatest).contains(value));
        let blank = if is_padded { blank } else { theirs.unwrap_or(blank) };
        let (least, greatest) = if are_missing { (least.min(blank), greatest.max(blank)) } else { (least, greatest) };
        let holds = |voxel_type: &VoxelType| voxel_type.holds(least) && voxel_type.holds(greatest);
        let theirs = held_as.map(|held| held.voxel_type).filter(|voxel_type| !voxel_type.is_float());
        let voxel_type = theirs.filter(holds).unwrap_or_else(|| smallest_type(least, greatest));
        if voxel_type.is_float() { Voxels { voxel_type, ..floats } } else { Voxels { voxel_type, blank } }
    };
    let possible = voxels(range_of(slices, 1, |slice| Ok(files[slice.file].1.format.limits()))?);
    let is_short = files.iter().all(|(_, frames)| frames.format.width <= 2);
    let frame_bytes = files.iter().map(|(_, frames)| frames.reader_bytes()).max().unwrap_or(0).max(1);
    if possible.voxel_type.bytes() < 4 || !is_short || frame_bytes > MOST_LOOKED_AT_BYTES {
        return Ok(possible);
    }
    // Scanners that shift 16 stored bits seldom use them all: decode to avoid doubling the memory.
    let most_threads = (MOST_LOOKED_AT_BYTES / frame_bytes).min(MOST_THREADS as u64) as usize;
    range_of(slices, most_threads, |slice| {
        let (header, frames) = &files[slice.file];
        let samples = frames.read(header, slice.frame)?;
        let range = samples.range(&frames.format, slice.meaning.padding);
        samples.confirm().map(|()| range)
    })
    .map(voxels)
}

/// Refuses 32-bit numbers needlessly changed as floats: labels, those beside missing slices, and those scaled only by whole numbers.
pub(super) fn check_exact(
    files: &[(Header, Frames)],
    slices: &[Slice],
    voxel_type: VoxelType,
    are_missing: bool,
    options: &OpenOptions,
) -> Result<()> {
    let is_long = |frames: &Frames| frames.format.width == 4 && !frames.format.is_float;
    let Some((header, _)) = files.iter().find(|(_, frames)| is_long(frames) && voxel_type.is_float()) else {
        return Ok(());
    };
    let what = match () {
        () if options.are_labels == Some(true) => "a series of 32-bit labels, some of which f32 would merge,",
        () if are_missing => "a 32-bit series with missing slices, which would become f32,",
        () if !options.allow_lossy && slices.iter().all(|slice| slice.meaning.is_whole()) => {
            let problem = "no integer type holds all 32-bit numbers of this series and its padding, and f32 rounds to \
                           24 bits; pass `allow_lossy` to accept rounding";
            return Err(ImportError::options(&header.path, problem));
        }
        () => return Ok(()),
    };
    Err(ImportError::unsupported(&header.path, what))
}

/// Least and greatest of the rescaled ends of each slice's stored range.
fn range_of(
    slices: &[Slice],
    most_threads: usize,
    stored: impl Fn(&Slice) -> Result<[i64; 2]> + Sync,
) -> Result<[f64; 2]> {
    let (mut least, mut greatest) = (f64::INFINITY, f64::NEG_INFINITY);
    batches::each(slices, most_threads, stored, |slice, range| {
        for value in range?.map(|n| slice.meaning.value(n)) {
            least = least.min(value);
            greatest = greatest.max(value);
        }
        Ok::<_, ImportError>(())
    })?;
    Ok([least, greatest])
}

pub(super) fn fill(plane: &mut [u8], voxel_type: VoxelType, value: f64) {
    with_voxel_type!(voxel_type, T => {
        let (voxels, _) = plane.as_chunks_mut::<{ size_of::<T>() }>();
        voxels.fill((value as T).to_le_bytes());
    });
}
