//! Remarks of a file on its numbers and places beyond CF's attributes: the fill value of NetCDF's library, and ilastik's voxel size.

use super::attributes::{named, numbers};
use super::tree::{Entry, Tree, join, parent_of};
use crate::array_choice::last_of;
use crate::axes::Axis;
use crate::cf;
use crate::element::Element;
use crate::note::{Note, Setting};
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

/// A warning of NeXus' factors and offsets of values, which lie in fields beside a dataset or a link to it.
pub(super) fn unapplied(tree: &Tree, entry: &Entry) -> Option<Note> {
    let mut found = Vec::new();
    for link in tree.sets.iter().filter(|link| link.set.address() == entry.set.address()) {
        let (group, name) = (parent_of(&link.path), last_of(&link.path));
        let is_nexus = tree.group(group).is_some_and(|group| named(&group.attributes, "NX_class").is_some());
        let of_all = if is_nexus { ["scaling_factor", "offset"].map(str::to_owned).to_vec() } else { Vec::new() };
        let own = ["scaling_factor", "offset"].map(|what| format!("{name}_{what}"));
        found.extend(
            of_all.into_iter().chain(own).map(|name| join(group, &name)).filter(|path| tree.set(path).is_some()),
        );
    }
    let text = format!("{} of NeXus change the values: they are not applied.", found.join(" and "));
    (!found.is_empty()).then(|| Note::warning(text))
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
        info.notes.push(
            Note::warning(format!("{NAME} has {} numbers in place of z, y, x: it is left out.", sizes.len()))
                .settled_by(Setting::Spacing),
        );
        return;
    };
    if [x, y, z].iter().any(|size| !(size.is_finite() && *size > 0.0)) {
        info.notes.push(
            Note::warning(format!("{NAME} {z}, {y}, {x} is no voxel size: it is left out."))
                .settled_by(Setting::Spacing),
        );
        return;
    }
    info.geometry.spacing = glam::DVec3::new(x, y, z);
    info.geometry.unit = Some("micrometer".into());
    info.calibrated = true;
}
