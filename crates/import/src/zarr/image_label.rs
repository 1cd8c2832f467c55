//! The mark of label images, `image-label`: voxels are labels. Its colours and properties have no place in a source. Costs nothing.

use super::field::Ome;
use crate::labels::SaidKind;
use crate::note::Note;
use brickyard_volume::{VoxelType, counted};

/// The member that marks labels.
pub(super) const MARK: &str = "image-label";

/// The folder of labels beside an image's levels.
pub(super) const FOLDER: &str = "labels";

/// Where the word stands, for the note.
const WORD: &str = "image-label of OME-Zarr";

/// The kind of an image's voxels. `is_listed`: the group of labels around the image lists it.
pub(super) fn kind_of(ome: &Ome<'_>, is_listed: bool, voxel_type: VoxelType) -> SaidKind {
    let is_label = ome.get(MARK).is_some() || is_listed;
    if is_label && !voxel_type.is_float() { SaidKind::Labels(WORD) } else { SaidKind::Unsaid }
}

/// A note on what is left out of a label image: its colours, unless `has_colors`, and properties.
pub(super) fn left_out(ome: &Ome<'_>, has_colors: bool) -> Option<Note> {
    let said = ome.get(MARK)?;
    let count = |name: &str| said.get(name).and_then(|list| list.items("").ok()).map_or(0, |items| items.len() as u64);
    let (colors, properties) = (count("colors"), count("properties"));
    let parts = [
        (colors > 0 && !has_colors).then(|| counted(colors, "colour")),
        (properties > 0).then(|| format!("the properties of {}", counted(properties, "label"))),
    ];
    let parts: Vec<String> = parts.into_iter().flatten().collect();
    (!parts.is_empty()).then(|| Note::new(format!("Left out of the labels' description: {}.", parts.join(", "))))
}
