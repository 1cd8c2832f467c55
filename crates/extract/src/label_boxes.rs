//! The labels of a region, and the box of each. Bricks of one label are told by their ranges; the others are read once, on all threads.

use crate::bricks::Bricks;
use crate::error::MeshError;
use crate::points::Points;
use crate::request::MOST_LABELS;
use brickyard_volume::labels::{BACKGROUND, label_of};
use brickyard_volume::{BrickId, LabelBoxes, Voxel, VoxelBox, with_voxel_type};
use rayon::prelude::*;

/// Bricks between two reports of progress, for each thread.
const BRICKS_AT_ONCE: usize = 16;

/// Finds all labels of a region but the background. Calls `progress` with the voxels so far.
///
/// # Errors
/// If a brick cannot be read, there are more than [`MOST_LABELS`], or `progress` fails.
pub(crate) fn label_boxes(
    bricks: &Bricks<'_>,
    nodata: Option<f64>,
    mut progress: impl FnMut(u64) -> Result<(), MeshError>,
) -> Result<LabelBoxes, MeshError> {
    let mut found = LabelBoxes::default();
    let mut ids = bricks.of_box(bricks.region());
    loop {
        let some: Vec<BrickId> = ids.by_ref().take(BRICKS_AT_ONCE * rayon::current_num_threads()).collect();
        if some.is_empty() {
            return Ok(found);
        }
        let boxes = some
            .par_iter()
            .map(|id| with_voxel_type!(bricks.store().voxel_type(), T => of_brick::<T>(bricks, *id, nodata)));
        boxes.collect::<Result<Vec<_>, _>>()?.into_iter().for_each(|boxes| found.join(boxes));
        if found.0.len() > MOST_LABELS {
            let problem =
                format!("there are more than {MOST_LABELS} labels; take a box of them with `roi`, or one label");
            return Err(MeshError::Unfit(problem));
        }
        progress(some.iter().map(|id| shared(bricks, *id).extent().volume()).sum())?;
    }
}

/// The part of a brick within the region.
fn shared(bricks: &Bricks<'_>, id: BrickId) -> VoxelBox {
    bricks.store().pyramid().brick_box(id.level, id.index).intersect(bricks.region())
}

fn of_brick<T: Voxel>(bricks: &Bricks<'_>, id: BrickId, nodata: Option<f64>) -> Result<LabelBoxes, MeshError> {
    let (mut found, region) = (LabelBoxes::default(), shared(bricks, id));
    match bricks.range(id)? {
        None => return Ok(found),
        Some((low, high)) if low == high && nodata.is_none() => {
            label_of(low).into_iter().for_each(|label| found.add(label, region));
        }
        Some(_) => {
            let [first, end] = [region.min, region.max].map(|corner| corner.to_array().map(i64::from));
            let mut points = Points::<T>::new(first, end.map(|v| v - 1), region);
            bricks.fill(&mut points)?;
            // With the background, and no data.
            found.add_voxels(region, &points.values, MOST_LABELS + 2);
        }
    }
    found.0.retain(|label, _| *label != BACKGROUND && nodata != Some(*label as f64));
    Ok(found)
}
