//! A user's description of a file, for metadata it lacks: everything for a raw file, the order of axes for an array, the voxel size and whether
//! voxels are labels for any file. A form of the file dialogs edits it, and a command carries it.

use crate::panels::widgets::{choice, menu, row};
use brickyard::import::{AxisOrder, Endian, OpenOptions};
use brickyard::opening::OpeningOptions;
use brickyard::store::Kind;
use brickyard::volume::{Extent, VoxelType};
use eframe::egui::{DragValue, TextEdit, Ui};
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Most suggestions shown.
const MOST_FITS: usize = 8;

/// Most suggested voxels along an axis.
const MOST_VOXELS: u64 = 4096;

/// The description of a file. The rest is the file's own.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Description {
    /// Voxels along x, y and z; a file with these is read as raw. 0 is unset.
    shape: [u32; 3],
    /// The type of a raw file's voxels.
    voxel_type: Option<VoxelType>,
    /// Whether a raw file has the most significant byte first.
    big_endian: bool,
    /// Bytes before the first voxel of a raw file.
    offset: u64,
    /// Letters of the axes, slowest first; empty for the file's own or the usual ones.
    axes: String,
    /// Time steps of a raw file; 0 is one.
    times: u32,
    /// Channels of a raw file; 0 is one.
    channels: u32,
    /// The distance between centres of voxels.
    spacing: Option<DVec3>,
    /// Its unit, or those of x, y and z with commas between; empty is the file's own.
    unit: String,
    /// The unit of the values; empty is the file's own.
    value_unit: String,
    labels: bool,
    /// Whether numbers without an exact voxel value may be rounded.
    allow_lossy: bool,
}

/// Units of length, and their names in files.
const UNITS: [(&str, &str); 6] = [
    ("", "as in the file"),
    ("nanometer", "nm"),
    ("micrometer", "\u{b5}m"),
    ("millimeter", "mm"),
    ("centimeter", "cm"),
    ("meter", "m"),
];

impl Description {
    /// The options for the described file, on top of `base`.
    ///
    /// # Errors
    /// If the axes are malformed.
    pub(crate) fn options(&self, base: &OpeningOptions) -> Result<OpeningOptions, String> {
        let axes = if self.axes.is_empty() { None } else { Some(self.axes.parse::<AxisOrder>()?) };
        let count = |count: u32| (count > 0).then_some(count);
        let files = OpenOptions {
            shape: self.shape.iter().all(|count| *count > 0).then(|| Extent::from_array(self.shape)),
            voxel_type: self.voxel_type.map(Into::into),
            endian: if self.big_endian { Endian::Big } else { Endian::Little },
            offset: (self.offset > 0).then_some(self.offset),
            axes,
            times: count(self.times),
            channels: count(self.channels),
            spacing: self.spacing,
            unit: (!self.unit.is_empty()).then(|| self.unit.clone()),
            value_unit: Some(self.value_unit.trim()).filter(|unit| !unit.is_empty() && !self.labels).map(str::to_owned),
            allow_lossy: self.allow_lossy,
            scratch_dir: base.files.scratch_dir.clone(),
            ..OpenOptions::default()
        };
        let kind = self.labels.then_some(Kind::Labels);
        Ok(OpeningOptions { files, kind, store: None, preview_bytes: base.preview_bytes })
    }

    /// Shows the form, for a file whose size is known once chosen.
    pub(crate) fn show(&mut self, ui: &mut Ui, bytes: Option<u64>) {
        let hint =
            "whole numbers as names of things, from a segmentation: each has a colour, and they are never averaged";
        row(ui, "values", hint, |ui, _| ui.checkbox(&mut self.labels, "the voxels are labels").on_hover_text(hint));
        let hint = "the unit of the values, such as HU; empty: the file's own";
        row(ui, "value unit", hint, |ui, label| {
            let field = TextEdit::singleline(&mut self.value_unit).desired_width(70.0);
            ui.add_enabled(!self.labels, field).labelled_by(label).on_hover_text(hint);
        });
        self.size_of_voxels(ui);
        let hint = "axis letters of an array, slowest first, such as tzyx; empty: the file's, or the usual ones";
        row(ui, "axes", hint, |ui, label| {
            ui.add(TextEdit::singleline(&mut self.axes).desired_width(70.0)).labelled_by(label).on_hover_text(hint);
            for axes in ["tzyx", "czyx", "zyxc"] {
                if ui.small_button(axes).clicked() {
                    self.axes = axes.into();
                }
            }
        });
        let hint = "64-bit numbers become the nearest number that a voxel can hold";
        row(ui, "numbers", hint, |ui, _| ui.checkbox(&mut self.allow_lossy, "may be rounded").on_hover_text(hint));
        ui.separator();
        ui.weak("For a raw file, which has no header:");
        self.raw(ui);
        if let Some(bytes) = bytes {
            self.suggestions(ui, bytes);
        }
    }

    fn size_of_voxels(&mut self, ui: &mut Ui) {
        let hint = "the distance between voxel centres along x, y and z, if the file's is wrong or missing";
        row(ui, "voxel size", hint, |ui, label| {
            let mut is_own = self.spacing.is_some();
            if ui.checkbox(&mut is_own, "").labelled_by(label).on_hover_text(hint).changed() {
                self.spacing = is_own.then_some(DVec3::ONE);
            }
            for part in self.spacing.iter_mut().flat_map(DVec3::as_mut) {
                ui.add(DragValue::new(part).range(1e-12..=1e12).speed(0.01)).labelled_by(label);
            }
        });
        let choices = UNITS.map(|unit| (unit.0, unit.1, ""));
        let known = UNITS.iter().find(|(name, _)| *name == self.unit).map_or("", |(name, _)| *name);
        if let Some(unit) = menu(ui, "unit", "the unit of voxel size and coordinates", known, &choices, |_| None) {
            self.unit = unit.into();
        }
    }

    fn raw(&mut self, ui: &mut Ui) {
        row(ui, "voxels", "the number of voxels along x, y and z", |ui, label| {
            for count in &mut self.shape {
                ui.add(DragValue::new(count)).labelled_by(label);
            }
        });
        let types = VoxelType::ALL.map(|voxel_type| (Some(voxel_type), voxel_type.name(), ""));
        let choices = [&[(None, "not said", "")], &types[..]].concat();
        choice(ui, "type", "the type of a voxel", &mut self.voxel_type, &choices);
        row(ui, "bytes", "layout of the file", |ui, label| {
            ui.add(DragValue::new(&mut self.offset).suffix(" before the voxels")).labelled_by(label);
            ui.checkbox(&mut self.big_endian, "big-endian");
        });
        row(ui, "more", "time steps and channels in the file", |ui, label| {
            for (count, name) in [(&mut self.times, " time steps"), (&mut self.channels, " channels")] {
                let mut shown = (*count).max(1);
                ui.add(DragValue::new(&mut shown).range(1..=u32::MAX).suffix(name)).labelled_by(label);
                *count = if shown > 1 { shown } else { 0 };
            }
        });
    }

    /// Shows shapes that fit a file's size, for a click.
    fn suggestions(&mut self, ui: &mut Ui, bytes: u64) {
        let fits = self.fits(bytes);
        ui.label(format!(
            "The file has {bytes} bytes{}",
            if fits.is_empty() { "." } else { ", which fits these shapes:" }
        ));
        ui.horizontal_wrapped(|ui| {
            for ([x, y, z], voxel_type) in fits {
                if ui.small_button(format!("{x} x {y} x {z} {}", voxel_type.name())).clicked() {
                    (self.shape, self.voxel_type) = ([x, y, z], Some(voxel_type));
                }
            }
        });
    }

    /// Shapes and types that take all bytes of a file: of the chosen type, cubes before stacks of square planes.
    fn fits(&self, bytes: u64) -> Vec<([u32; 3], VoxelType)> {
        let sets = u64::from(self.times.max(1)) * u64::from(self.channels.max(1));
        let body = bytes.saturating_sub(self.offset);
        let types = [VoxelType::U8, VoxelType::U16, VoxelType::I16, VoxelType::F32];
        let types = self.voxel_type.map_or(types.to_vec(), |chosen| vec![chosen]);
        let mut fits = Vec::new();
        for voxel_type in types {
            let voxel_bytes = sets * voxel_type.bytes() as u64;
            let count = body / voxel_bytes;
            if body == 0 || !body.is_multiple_of(voxel_bytes) {
                continue;
            }
            let sides = (2..=MOST_VOXELS).filter(|side| count.is_multiple_of(side * side));
            let stacks = sides.map(|side| (side, count / (side * side)));
            for (side, planes) in stacks.filter(|(side, planes)| (2..=4 * side).contains(planes)) {
                // Scanners' planes mostly have such sides.
                let is_usual = side % 64 == 0 || side % 100 == 0 || side == planes;
                let farness = (side as f64 / planes as f64).ln().abs() + if is_usual { 0.0 } else { 3.0 };
                fits.push((farness, [side as u32, side as u32, planes as u32], voxel_type));
            }
        }
        fits.sort_by(|a, b| a.0.total_cmp(&b.0));
        fits.into_iter().map(|(_, shape, voxel_type)| (shape, voxel_type)).take(MOST_FITS).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::accesskit::Role;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable;

    #[test]
    fn shapes_that_fit_a_file_are_suggested() {
        let of = |voxel_type| Description { voxel_type: Some(voxel_type), ..Description::default() };
        assert_eq!(of(VoxelType::U8).fits(64 * 64 * 64)[0].0, [64; 3]);
        assert!(of(VoxelType::I16).fits(2 * 256 * 256 * 108).contains(&([256, 256, 108], VoxelType::I16)));
        let with_header = Description { offset: 352, times: 3, ..of(VoxelType::F32) };
        assert!(with_header.fits(352 + 4 * 3 * 128 * 128 * 40).contains(&([128, 128, 40], VoxelType::F32)));
        assert!(Description::default().fits(0).is_empty() && of(VoxelType::U16).fits(7).is_empty());
        assert!(Description::default().fits(1 << 40).len() <= MOST_FITS);
    }

    #[test]
    fn a_form_says_what_a_raw_file_does_not() {
        let show = |ui: &mut Ui, description: &mut Description| description.show(ui, Some(64 * 64 * 64));
        let mut harness = Harness::new_ui_state(show, Description::default());
        harness.get_by_label("64 x 64 x 64 u8").click();
        harness.run();
        harness.get_by_label("the voxels are labels").click();
        harness.run();
        harness.get_by_role_and_label(Role::CheckBox, "voxel size").click();
        harness.run();
        harness.get_by_label("tzyx").click();
        harness.run();
        let base = OpeningOptions::default();
        let options = harness.state().options(&base).unwrap();
        assert_eq!(
            (options.files.shape, options.files.voxel_type),
            (Some(Extent::new(64, 64, 64)), Some(VoxelType::U8.into()))
        );
        assert_eq!((options.kind, options.files.spacing), (Some(Kind::Labels), Some(DVec3::ONE)));
        assert_eq!(options.files.axes, Some("tzyx".parse().unwrap()));
        let wrong = Description { axes: "tzzz".into(), ..Description::default() };
        assert!(wrong.options(&base).unwrap_err().contains("'z' stands twice"));
    }

    #[test]
    fn looking_at_the_form_says_nothing() {
        let show = |ui: &mut Ui, description: &mut Description| description.show(ui, Some(1000));
        let mut harness = Harness::new_ui_state(show, Description::default());
        for _ in 0..30 {
            harness.key_press(eframe::egui::Key::Tab);
            harness.run_steps(2);
        }
        assert_eq!(*harness.state(), Description::default());
    }
}
