//! Segments of 3D Slicer: the labels of a volume with their boxes and colours, and the keys that name them in the header of `.seg.nrrd`. The volume is
//! read once more for them, on all threads.

use crate::budget::{Needs, pool, shares};
use crate::error::ExportError;
use crate::job::Job;
use brickyard_volume::labels::{BACKGROUND, LabelColor, LabelLook};
use brickyard_volume::{VoxelBox, VoxelType};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::fmt::Write;

/// Most segments: Slicer has a row of its table for each.
const MOST_SEGMENTS: usize = 1 << 16;
/// Memory of a thread for boxes of the most labels.
const THREAD_BYTES: u64 = 8 << 20;

/// Boxes of voxels by label.
type Boxes = BTreeMap<i64, VoxelBox>;

/// A label as Slicer shows it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Segment {
    label: i64,
    /// The box of its voxels.
    region: VoxelBox,
    /// Red, green and blue, each in 0..=1.
    color: [f64; 3],
    /// Whether the store has this colour, or it is only the one shown.
    is_given: bool,
}

/// Finds the labels of the first channel and step, but for background and no data. `colors` are the store's, sorted by label.
///
/// # Errors
/// If there are more than [`MOST_SEGMENTS`], one is beyond Slicer's numbers, the memory is too little, a block cannot be read, or the export is cancelled.
pub(crate) fn survey(job: &Job, colors: &[LabelColor]) -> Result<Vec<Segment>, ExportError> {
    let info = job.source.info();
    let shares = shares(job, Needs { thread_bytes: THREAD_BYTES, ..Needs::default() })?;
    let bars = job.blocks.bars(info.extent.full_box(), shares.width);
    let look = |(mut found, mut buffer): (Boxes, Vec<u8>), bar: VoxelBox| -> Result<(Boxes, Vec<u8>), ExportError> {
        buffer.resize(job.bytes_of(bar), 0);
        job.source.read_box(0, 0, bar, &mut buffer)?;
        add_runs(&mut found, info.voxel_type, bar, &buffer);
        check_count(job, &found)?;
        // Nothing is written yet, but the export may be cancelled.
        job.advance(0)?;
        Ok((found, buffer))
    };
    let join = |mut all: Boxes, more: Boxes| {
        more.into_iter().for_each(|(label, region)| add(&mut all, label, region));
        check_count(job, &all).map(|()| all)
    };
    let boxes: Result<Boxes, ExportError> = pool(shares.threads)?.install(|| {
        let parts = bars.par_bridge().try_fold(Default::default, look);
        parts.map(|part| part.map(|(found, _)| found)).try_reduce(Boxes::new, join)
    });
    let shown = LabelLook { shown: None, colors: Some(colors.to_vec()) };
    let is_label = |label: &i64| *label != BACKGROUND && info.nodata != Some(*label as f64);
    let boxes = boxes?.into_iter().filter(|(label, _)| is_label(label));
    let segment = |(label, region): (i64, VoxelBox)| {
        if i32::try_from(label).is_err() {
            let problem =
                format!("3D Slicer numbers labels up to {}, and one is {label}: choose .nii or .raw", i32::MAX);
            return Err(ExportError::unfit(job.output, problem));
        }
        let is_given = colors.binary_search_by_key(&label, |color| color.label).is_ok();
        Ok(Segment { label, region, color: shown.color(label).unwrap_or_default(), is_given })
    };
    boxes.map(segment).collect()
}

fn check_count(job: &Job, found: &Boxes) -> Result<(), ExportError> {
    match found.len() <= MOST_SEGMENTS {
        true => Ok(()),
        false => {
            let problem =
                format!("there are more than {MOST_SEGMENTS} labels: choose a box of them by `roi`, or .nii or .nrrd");
            Err(ExportError::unfit(job.output, problem))
        }
    }
}

/// Adds a bar's runs of equal voxels, until there are more labels than segments.
fn add_runs(found: &mut Boxes, voxel_type: VoxelType, bar: VoxelBox, voxels: &[u8]) {
    let (voxel_bytes, width) = (voxel_type.bytes(), bar.extent().x);
    let rows = (bar.min.z..bar.max.z).flat_map(|z| (bar.min.y..bar.max.y).map(move |y| (y, z)));
    for ((y, z), row) in rows.zip(voxels.chunks_exact(width as usize * voxel_bytes)) {
        if found.len() > MOST_SEGMENTS {
            return;
        }
        let voxel = |x: u32| &row[x as usize * voxel_bytes..][..voxel_bytes];
        let mut first = 0;
        while first < width {
            let end = (first + 1..width).find(|x| voxel(*x) != voxel(first)).unwrap_or(width);
            let label = voxel_type.read(voxel(first), 0) as i64;
            add(found, label, VoxelBox::new([bar.min.x + first, y, z], [bar.min.x + end, y + 1, z + 1]));
            first = end;
        }
    }
}

fn add(boxes: &mut Boxes, label: i64, region: VoxelBox) {
    let joined = boxes.entry(label).or_insert(region);
    let corner = |of: fn(&VoxelBox) -> [u32; 3], pick: fn(u32, u32) -> u32| {
        let (one, two) = (of(joined), of(&region));
        [0, 1, 2].map(|axis| pick(one[axis], two[axis]))
    };
    let (min, max) = (corner(|of| of.min.to_array(), u32::min), corner(|of| of.max.to_array(), u32::max));
    *joined = VoxelBox::new(min, max);
}

/// The lines of keys.
pub(crate) fn keys(segments: &[Segment]) -> String {
    let mut text = String::new();
    for (i, segment) in segments.iter().enumerate() {
        let Segment { label, region: VoxelBox { min, max }, color: [red, green, blue], is_given } = segment;
        let mut line = |key: &str, value: String| {
            writeln!(text, "Segment{i}_{key}:={value}").expect("a string takes all");
        };
        line("ID", format!("Segment_{label}"));
        line("Name", format!("label_{label}"));
        line("NameAutoGenerated", "1".into());
        line("LabelValue", label.to_string());
        line("Layer", "0".into());
        line("Color", format!("{red:.6} {green:.6} {blue:.6}"));
        line("ColorAutoGenerated", u8::from(!is_given).to_string());
        let [x, y, z] =
            [(min.x, max.x), (min.y, max.y), (min.z, max.z)].map(|(first, end)| format!("{first} {}", end - 1));
        line("Extent", format!("{x} {y} {z}"));
    }
    // The later name is that of newer versions.
    text + "Segmentation_ContainedRepresentationNames:=Binary labelmap|\n\
            Segmentation_MasterRepresentation:=Binary labelmap\n\
            Segmentation_SourceRepresentation:=Binary labelmap\n\
            Segmentation_ReferenceImageExtentOffset:=0 0 0\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_of_voxels_have_boxes() {
        let bar = VoxelBox::new([4, 2, 1], [7, 4, 2]);
        let voxels: Vec<u8> = [5i16, 5, -3, 0, 5, 5].into_iter().flat_map(i16::to_le_bytes).collect();
        let mut found = Boxes::from([(5, VoxelBox::new([9, 3, 0], [10, 4, 1]))]);
        add_runs(&mut found, VoxelType::I16, bar, &voxels);
        let expected = [
            (-3, VoxelBox::new([6, 2, 1], [7, 3, 2])),
            (0, VoxelBox::new([4, 3, 1], [5, 4, 2])),
            (5, VoxelBox::new([4, 2, 0], [10, 4, 2])),
        ];
        assert_eq!(found, Boxes::from(expected));
    }

    #[test]
    fn keys_are_those_of_slicer() {
        let region = VoxelBox::new([1, 2, 3], [4, 6, 9]);
        let segment = Segment { label: 7, region, color: [1.0, 0.5, 0.0], is_given: true };
        assert_eq!(
            keys(&[segment]),
            "Segment0_ID:=Segment_7\n\
             Segment0_Name:=label_7\n\
             Segment0_NameAutoGenerated:=1\n\
             Segment0_LabelValue:=7\n\
             Segment0_Layer:=0\n\
             Segment0_Color:=1.000000 0.500000 0.000000\n\
             Segment0_ColorAutoGenerated:=0\n\
             Segment0_Extent:=1 3 2 5 3 8\n\
             Segmentation_ContainedRepresentationNames:=Binary labelmap|\n\
             Segmentation_MasterRepresentation:=Binary labelmap\n\
             Segmentation_SourceRepresentation:=Binary labelmap\n\
             Segmentation_ReferenceImageExtentOffset:=0 0 0\n"
        );
    }
}
