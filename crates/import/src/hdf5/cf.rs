//! Remarks of a file on its numbers and places beyond CF's attributes: the fill value of NetCDF's library, and ilastik's voxel size.

use super::attributes::{named, numbers};
use super::tree::{Entry, Tree};
use crate::axes::Axis;
use crate::cf;
use crate::element::Element;
use crate::note::Note;
use crate::source::SourceInfo;

/// The value of numbers never written, in files of NetCDF's library, if the dataset has it.
pub(super) fn default_fill(tree: &Tree, entry: &Entry, element: Element) -> Option<f64> {
    let root = tree.group("/")?;
    named(&root.attributes, "_NCProperties")?;
    let expected = cf::default_fill(element)?;
    let fill = entry.set.fill_value()?.value.as_ref()?;
    let fill = *entry.stored.as_ref().ok()?.numbers(fill).first()?;
    (fill == expected).then_some(expected)
}

/// Sets the voxel size of ilastik and Fiji's plugins: micrometres along z, y, x.
pub(super) fn place(info: &mut SourceInfo, tree: &Tree, entry: &Entry, axes: &[Axis]) {
    const NAME: &str = "element_size_um";
    let of_root = || numbers(&tree.group("/")?.attributes, NAME);
    let Some(mut sizes) = numbers(&entry.attributes, NAME).or_else(of_root) else { return };
    if sizes.len() == 2 && !axes.contains(&Axis::Z) {
        sizes.insert(0, 1.0);
    }
    let [z, y, x] = sizes[..] else {
        info.notes
            .push(Note::warning(format!("{NAME} has {} numbers in place of z, y, x: it is left out.", sizes.len())));
        return;
    };
    if [x, y, z].iter().any(|size| !(size.is_finite() && *size > 0.0)) {
        info.notes.push(Note::warning(format!("{NAME} {z}, {y}, {x} is no voxel size: it is left out.")));
        return;
    }
    info.geometry.spacing = glam::DVec3::new(x, y, z);
    info.geometry.unit = Some("micrometer".into());
    info.calibrated = true;
}
