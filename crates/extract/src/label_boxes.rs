//! The labels of a region, and the box of each. Bricks of one label are told by their ranges; the others are read once, on all threads.

use crate::bricks::Bricks;
use crate::error::MeshError;
use crate::points::Points;
use crate::request::MOST_LABELS;
use brickyard_volume::labels::BACKGROUND;
use brickyard_volume::{BrickId, Voxel, VoxelBox, with_voxel_type};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Labels and their boxes.
pub(crate) type LabelBoxes = BTreeMap<i64, VoxelBox>;

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
    let mut found = LabelBoxes::new();
    let mut ids = bricks.of_box(bricks.region());
    loop {
        let some: Vec<BrickId> = ids.by_ref().take(BRICKS_AT_ONCE * rayon::current_num_threads()).collect();
        if some.is_empty() {
            return Ok(found);
        }
        let boxes = some
            .par_iter()
            .map(|id| with_voxel_type!(bricks.store().voxel_type(), T => of_brick::<T>(bricks, *id, nodata)));
        for boxes in boxes.collect::<Result<Vec<_>, _>>()? {
            boxes.into_iter().for_each(|(label, region)| join(&mut found, label, region));
        }
        if found.len() > MOST_LABELS {
            let problem =
                format!("there are more than {MOST_LABELS} labels; take a box of them with `roi`, or one label");
            return Err(MeshError::Unfit(problem));
        }
        progress(some.iter().map(|id| shared(bricks, *id).extent().volume()).sum())?;
    }
}

/// The label of a value; `None` for fractions and NaN among floats, which are none.
pub(crate) fn label_of(value: f64) -> Option<i64> {
    (value.fract() == 0.0).then_some(value as i64)
}

/// The part of a brick within the region.
fn shared(bricks: &Bricks<'_>, id: BrickId) -> VoxelBox {
    bricks.store().pyramid().brick_box(id.level, id.index).intersect(bricks.region())
}

fn join(boxes: &mut LabelBoxes, label: i64, region: VoxelBox) {
    boxes
        .entry(label)
        .and_modify(|joined| {
            let (min, max) = (joined.min.to_array(), joined.max.to_array());
            let min = std::array::from_fn(|a| min[a].min(region.min.to_array()[a]));
            *joined = VoxelBox::new(min, std::array::from_fn(|a| max[a].max(region.max.to_array()[a])));
        })
        .or_insert(region);
}

fn of_brick<T: Voxel>(bricks: &Bricks<'_>, id: BrickId, nodata: Option<f64>) -> Result<LabelBoxes, MeshError> {
    let (mut found, region) = (LabelBoxes::new(), shared(bricks, id));
    match bricks.range(id)? {
        None => return Ok(found),
        Some((low, high)) if low == high && nodata.is_none() => {
            found.extend(label_of(low).filter(|label| *label != BACKGROUND).map(|label| (label, region)));
            return Ok(found);
        }
        Some(_) => {}
    }
    let [first, end] = [region.min, region.max].map(|corner| corner.to_array().map(i64::from));
    let mut points = Points::<T>::new(first, end.map(|v| v - 1), region);
    bricks.fill(&mut points)?;
    for z in region.min.z..region.max.z {
        for y in region.min.y..region.max.y {
            let row = points.row((y - region.min.y) as usize, (z - region.min.z) as usize);
            let row = &points.values[row..row + points.size[0]];
            let mut x = region.min.x;
            // Equal neighbours are one box.
            for run in row.chunk_by(|a, b| a == b) {
                let (value, end) = (run[0].to_f64(), x + run.len() as u32);
                let label = label_of(value).filter(|label| *label != BACKGROUND && nodata != Some(value));
                if let Some(label) = label {
                    join(&mut found, label, VoxelBox::new([x, y, z], [end, y + 1, z + 1]));
                }
                x = end;
            }
        }
    }
    Ok(found)
}
